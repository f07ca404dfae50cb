"""What is wrong with a user's function, told as one sentence with the line where it is wrong."""

from __future__ import annotations

import sysconfig
from collections.abc import Callable
from difflib import get_close_matches
from numbers import Real
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from mems_impact.errors import FunctionError
from mems_impact.hybrid.guarded import Misuse
from mems_impact.hybrid.written import GENERATED
from mems_impact.wording import shown

__all__ = ["Function", "line_of", "place_of", "told"]

_PACKAGE = str(Path(__file__).resolve().parents[1])
_LIBRARIES = tuple(str(Path(sysconfig.get_path(name))) for name in ("stdlib", "purelib", "platlib"))
DOMAIN = "compiled it goes on with nan or inf there: treat this case apart"


class Function(NamedTuple):
    """A function of a system, and what it is of it."""

    kind: str
    call: Callable[..., Any]
    guard: str = ""

    @property
    def role(self) -> str:
        """What it is of the system, and its name."""
        name = getattr(self.call, "__name__", type(self.call).__name__)
        name = "a lambda" if name == "<lambda>" else repr(name)
        return f"{self.kind} of {self.guard!r}, {name}," if self.guard else f"{self.kind} {name}"

    def error(self, problem: str, remedy: str) -> FunctionError:
        """Return the sentence about a result of it."""
        return FunctionError(self.role, problem, remedy, *place_of(self.call))

    def blamed(self, error: BaseException) -> tuple[FunctionError, bool]:
        """Return the sentence about what it raised, and whether it is wrong whatever the values."""
        problem, remedy, always = _told(error)
        place = line_of(error.__traceback__, self.call)
        return FunctionError(self.role, problem, remedy, *place), always


def place_of(function: Callable[..., Any]) -> tuple[str, int]:
    """Return the file and the line in which a function begins."""
    code = getattr(getattr(function, "py_func", function), "__code__", None)
    if code is None or code.co_filename == GENERATED:
        return "", 0
    return code.co_filename, code.co_firstlineno


def is_users(file: str) -> bool:
    """Return whether a file is neither of the package nor of a library."""
    return file != GENERATED and not file.startswith((_PACKAGE, *_LIBRARIES))


def line_of(trace: TracebackType | None, function: Callable[..., Any]) -> tuple[str, int]:
    """Return the innermost line of the user's in a traceback; else where `function` begins."""
    own = place = place_of(function)
    while trace is not None:
        file = trace.tb_frame.f_code.co_filename
        if is_users(file) or file == own[0]:
            place = file, trace.tb_lineno
        trace = trace.tb_next
    return place


def told(value: Any) -> str:
    """Return what a function gave in place of numbers."""
    match value:
        case None:
            return "nothing"
        case list():
            return "a list"
        case tuple():
            return f"a tuple of {len(value)}"
        case Real():
            return f"the one number {shown(value)}"
        case _:
            return f"{shown(value)} (a {type(value).__name__})"


def suggestion(error: AttributeError) -> str:
    """Return what may have been meant by the name of a state or a parameter."""
    known = getattr(error.obj, "_fields", ())
    near = get_close_matches(str(error.name), known, n=1)
    return f"did you mean {near[0]}?" if near else f"there are {', '.join(known) or 'none'}"


def _told(error: BaseException) -> tuple[str, str, bool]:
    """Return problem, remedy, and whether it is wrong whatever the values."""
    raised = f"raises {type(error).__name__}: {error}"
    match error:
        case Misuse():
            return error.problem, error.remedy, True
        case RecursionError():
            return "calls itself without end", "let it end", True
        case AttributeError() if type(error.obj).__name__ == "State":
            problem = f"reads y.{error.name}, but there is no such state"
            return problem, suggestion(error), True
        case AttributeError() if type(error.obj).__name__ == "Parameters":
            problem = f"reads p.{error.name}, but there is no such parameter"
            return problem, suggestion(error), True
        case AttributeError() if isinstance(error.obj, list):
            return f"reads .{error.name} of an array", "write y[0], y[1], …", True
        case AttributeError() | NameError() | TypeError() | ImportError():
            return raised, "mend this line", True
        case ArithmeticError() | ValueError():
            return raised, DOMAIN, False
        case _:
            return raised, "let it have a value wherever the system goes", False
