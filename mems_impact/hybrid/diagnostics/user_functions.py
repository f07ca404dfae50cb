"""Checked calls of user functions, and explanations of their exceptions.

`CheckedFunctions` checks the results of every call. A mistake raises `FunctionError` with the
function, the line and the remedy; an error that may depend on the values, such as the logarithm of
a negative number or the end of a table, raises `DomainError`.
"""

from __future__ import annotations

import math
import sysconfig
from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from difflib import get_close_matches
from itertools import product
from numbers import Integral, Real
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from mems_impact._util.formatting import printable, shown
from mems_impact.errors import FunctionError
from mems_impact.hybrid.automaton import GENERATED
from mems_impact.hybrid.definition import Definition, named_tuple, writes_into_arrays
from mems_impact.hybrid.event_loop.workspace import ENDS, NO_FIT

# --- Arrays with checked access


class ArrayMisuse(Exception):
    """An invalid access to an array, with a remedy."""

    def __init__(self, problem: str, remedy: str) -> None:
        super().__init__(f"{problem}; {remedy}")
        self.problem, self.remedy = problem, remedy


class CheckedVector(list[Any]):
    """A list with checked access; None marks unwritten components."""

    def __init__(self, name: str, values: Iterable[Any], *, fixed: bool = False) -> None:
        super().__init__(values)
        self._name, self._fixed = name, fixed

    def __getitem__(self, i: Any) -> Any:
        self._check(i, "reads")
        value = super().__getitem__(i)
        if value is None:
            raise ArrayMisuse(f"reads {self._name}[{i}] before it is written", "write it first")
        return value

    def __setitem__(self, i: Any, value: Any) -> None:
        if self._fixed:
            problem = f"writes {self._name}[{i}]"
            raise ArrayMisuse(problem, "leave it as it is, and write into the last argument")
        self._check(i, "writes")
        super().__setitem__(i, value)

    def _check(self, i: Any, verb: str) -> None:
        if isinstance(i, int) and not -len(self) <= i < len(self):
            problem = f"{verb} {self._name}[{i}], but it has {len(self)} components"
            raise ArrayMisuse(problem, f"go from 0 to {len(self) - 1}")


# --- Errors of user functions, with their lines

_PACKAGE = str(Path(__file__).resolve().parents[2])
LIBRARY_FOLDERS = tuple(
    str(Path(sysconfig.get_path(name))) for name in ("stdlib", "purelib", "platlib")
)
DOMAIN = "treat this case separately"


class UserFunction(NamedTuple):
    """A function of a system and its role."""

    kind: str
    call: Callable[..., Any]
    guard: str = ""

    @property
    def role(self) -> str:
        """The role of the function in the system, and its name."""
        name = getattr(self.call, "__name__", type(self.call).__name__)
        name = "a lambda" if name == "<lambda>" else repr(name)
        return f"{self.kind} of {self.guard!r}, {name}," if self.guard else f"{self.kind} {name}"

    def error(self, problem: str, remedy: str) -> FunctionError:
        """Return an error about a result of the function."""
        return FunctionError(self.role, problem, remedy, *place_of(self.call))

    def explain_exception(self, error: BaseException) -> tuple[FunctionError, bool]:
        """Return the error for an exception, and whether it is independent of the values."""
        problem, remedy, is_structural = _explanation(error)
        location = innermost_user_line(error.__traceback__, self.call)
        return FunctionError(self.role, problem, remedy, *location), is_structural


def place_of(function: Callable[..., Any]) -> tuple[str, int]:
    """Return the file and the line where a function begins."""
    code = getattr(getattr(function, "py_func", function), "__code__", None)
    if code is None or code.co_filename == GENERATED:
        return "", 0
    return code.co_filename, code.co_firstlineno


def is_user_file(file: str) -> bool:
    """Return whether a file is outside the package and all libraries."""
    return file != GENERATED and not file.startswith((_PACKAGE, *LIBRARY_FOLDERS))


def is_own(function: Callable[..., Any]) -> bool:
    """Return whether a function belongs to the package."""
    code = getattr(getattr(function, "py_func", function), "__code__", None)
    return code is not None and code.co_filename.startswith((_PACKAGE, GENERATED))


def innermost_user_line(
    trace: TracebackType | None, function: Callable[..., Any]
) -> tuple[str, int]:
    """Return the innermost user line in a traceback; else the first line of `function`."""
    definition = location = place_of(function)
    while trace is not None:
        file = trace.tb_frame.f_code.co_filename
        if is_user_file(file) or file == definition[0]:
            location = file, trace.tb_lineno
        trace = trace.tb_next
    return location


def describe_value(value: Any) -> str:
    """Return a description of a value that should have been numbers."""
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
    """Return a suggestion for an unknown state or parameter."""
    names = getattr(error.obj, "_fields", ())
    matches = get_close_matches(str(error.name), names, n=1)
    return f"did you mean {matches[0]}?" if matches else f"there are {', '.join(names) or 'none'}"


def _explanation(error: BaseException) -> tuple[str, str, bool]:
    """Return problem, remedy, and whether the error is independent of the values."""
    exception = f"raises {type(error).__name__}: {printable(' '.join(str(error).split()))}"
    match error:
        case ArrayMisuse():
            return error.problem, error.remedy, True
        case RecursionError():
            return "has unbounded recursion", "end the recursion", True
        case AttributeError() if type(error.obj).__name__ == "State":
            problem = f"reads y.{error.name}, but there is no such state"
            return problem, suggestion(error), True
        case AttributeError() if type(error.obj).__name__ == "Parameters":
            problem = f"reads p.{error.name}, but there is no such parameter"
            return problem, suggestion(error), True
        case AttributeError() if isinstance(error.obj, list):
            return f"reads .{error.name} of an array", "write y[0], y[1], …", True
        case TypeError() if "indices must be" in str(error):
            return exception, "a state is read as y.NAME, a parameter as p.NAME", True
        case AttributeError() | NameError() | TypeError() | ImportError():
            return exception, "correct this line", True
        case ArithmeticError() | ValueError():
            return exception, DOMAIN, False
        case _:
            return exception, "define it for all states that the system reaches", False


# --- Checked calls

MAX_COMPONENTS = 8  # components of a state in a message


class EvaluationPoint(NamedTuple):
    """The arguments of a call; `mode` as the function receives it."""

    mode: Any
    t: float
    y: list[float]


class DomainError(Exception):
    """A function is undefined at some values; `error` is the message."""

    def __init__(self, error: FunctionError) -> None:
        super().__init__(str(error))
        self.error = error


class CheckedFunctions:
    """The functions of a definition at some values of its parameters, without hidden ones."""

    def __init__(self, definition: Definition, parameters: Sequence[float]) -> None:
        self.definition = definition
        self.states, self.n = definition.states, len(definition.states)
        self.by_array = writes_into_arrays(definition.flow)
        self.p = named_tuple("Parameters", definition.parameters)(*parameters)
        self._repetitions: set[Any] = set()  # functions and modes with a repeated call

    def state(self, y: Sequence[float]) -> Any:
        """Return a state as functions receive it."""
        return list(y) if self.by_array else named_tuple("State", self.states)(*y)

    def flow(self, point: EvaluationPoint) -> list[float]:
        """Return the flow."""
        function = UserFunction("flow", self.definition.flow)
        if not self.by_array:
            return self._tuple(function, self._call(function, point), point)
        slope: list[Any] = [None] * self.n
        self._call(function, point, slope)
        if None in slope:
            problem = f"does not write dy[{slope.index(None)}] in mode {self._mode(point)}"
            remedy = "write every component, 0.0 for a state that does not change"
            raise function.error(problem, remedy)
        return self._finite(function, slope, point)

    def margin(self, i: int, point: EvaluationPoint) -> float:
        """Return the margin of guard `i`."""
        return self._scalar("margin", i, point)

    def constraint(self, i: int, point: EvaluationPoint) -> float:
        """Return the value of constraint `i`, zero if it holds."""
        return self._number(UserFunction("constraint", self.definition.constraints[i][1]), point)

    def transition(
        self, kind: str, i: int | None, point: EvaluationPoint
    ) -> tuple[int, list[float]]:
        """Return mode and state after the "transition" or "rest" of guard `i`, or at a switch."""
        guard = None if i is None else self.definition.guards[i]
        call = getattr(guard or self.definition, kind)
        if call is None:
            return point.mode, point.y
        function = UserFunction(kind, call, guard.name if guard else "")
        if self.by_array:
            new: list[Any] = list(point.y)
            mode = self._call(function, point, new)
            return self._mode_number(function, mode), self._finite(function, new, point)
        result = self._call(function, point)
        if not (isinstance(result, tuple) and len(result) == 2):
            problem = f"returns {describe_value(result)} in mode {self._mode(point)}"
            remedy = "return the new mode and the new state on every path: mode, (…)"
            raise function.error(problem, remedy)
        mode, state = result
        return self._mode_number(function, mode), self._tuple(function, state, point)

    def _scalar(self, kind: str, i: int, point: EvaluationPoint) -> float:
        guard = self.definition.guards[i]
        return self._number(UserFunction(kind, getattr(guard, kind), guard.name), point)

    def _number(self, function: UserFunction, point: EvaluationPoint) -> float:
        value = self._call(function, point)
        if not isinstance(value, Real | complex):
            problem = f"returns {describe_value(value)} in mode {self._mode(point)}"
            raise function.error(problem, "return one number on every path")
        if isinstance(value, complex) or math.isnan(value):
            raise self._domain_error(function, value, "", point)
        return float(value)

    def _call(self, function: UserFunction, point: EvaluationPoint, *out: Any) -> Any:
        """Call a function as the engine does; twice for its first call in a mode."""
        call = getattr(function.call, "py_func", function.call)  # the source of a numba function
        mode, t, y = point
        state = self.state(y)
        copies = [list(each) for each in out]
        try:
            result = call(mode, t, state, self.p, *out)
            if self.by_array and any(a is not b for a, b in zip(state, y, strict=True)):
                raise ArrayMisuse(
                    "writes into y", "leave it as it is, and write into the last argument"
                )
        except Exception as error:
            raise self._error_of(function, error, point, copies) from error
        if (call, mode) not in self._repetitions:
            self._repetitions.add((call, mode))
            try:
                repetition = call(mode, t, state, self.p, *copies)
            except Exception as error:
                repetition = error
            if not same((result, *map(list, out)), (repetition, *map(list, copies))):
                problem = "returns two results for the same mode, time and state"
                remedy = "let it depend on its arguments alone: no random numbers, no counters"
                raise function.error(problem, remedy)
        return result

    def _error_of(
        self, function: UserFunction, error: Exception, point: EvaluationPoint, out: Sequence[Any]
    ) -> FunctionError | DomainError:
        """Return the error for an exception, after a call with checked arrays."""
        if self.by_array and not isinstance(error, ArrayMisuse):
            name = "dy" if function.kind == "flow" else "new"
            arrays = [CheckedVector(name, a) if isinstance(a, list) else a for a in out]
            try:
                function.call(
                    point.mode, point.t, CheckedVector("y", point.y, fixed=True), self.p, *arrays
                )
            except Exception as checked_error:
                error = checked_error
        cause, is_structural = function.explain_exception(error)
        if is_structural:
            return cause
        problem = f"{cause.problem} {self.location(point)}"
        return DomainError(FunctionError(cause.role, problem, cause.remedy, cause.file, cause.line))

    def _tuple(self, function: UserFunction, values: Any, point: EvaluationPoint) -> list[float]:
        """Return a tuple with one number per state as a list."""
        names = ", ".join(self.states[:MAX_COMPONENTS]) + (", …" if self.n > MAX_COMPONENTS else "")
        remedy = f"return a tuple of {self.n}, for {names}, on every path"
        if not isinstance(values, tuple):
            raise function.error(
                f"returns {describe_value(values)} in mode {self._mode(point)}", remedy
            )
        if len(values) != self.n:
            problem = (
                f"returns {len(values)} numbers for {self.n} states in mode {self._mode(point)}"
            )
            raise function.error(problem, remedy)
        return self._finite(function, values, point)

    def _finite(
        self, function: UserFunction, values: Sequence[Any], point: EvaluationPoint
    ) -> list[float]:
        for name, value in zip(self.states, values, strict=True):
            if isinstance(value, float | int) and math.isfinite(value):
                continue
            if not isinstance(value, Real | complex):
                raise function.error(
                    f"gives {describe_value(value)} for {name}", "let it be a number"
                )
            if isinstance(value, complex) or not math.isfinite(value):
                raise self._domain_error(function, value, f" for {name}", point)
        return [float(value) for value in values]

    def _mode_number(self, function: UserFunction, mode: Any) -> int:
        """Return an existing mode."""
        modes = self.definition.modes
        if isinstance(mode, Integral) and (
            int(mode) in (ENDS, *range(len(modes))) or int(mode) <= NO_FIT
        ):
            return int(mode)
        description = f"mode {mode}" if isinstance(mode, Real) else describe_value(mode)
        choices = ", ".join(f"{i} ({name})" for i, name in enumerate(modes))
        remedy = f"return one of the modes {choices}, or give all modes to System as modes="
        raise function.error(f"returns {description}", remedy)

    def _domain_error(
        self, function: UserFunction, value: Any, suffix: str, point: EvaluationPoint
    ) -> DomainError:
        problem = f"gives {value}{suffix} {self.location(point)}"
        remedy = "treat this case separately, or start elsewhere"
        return DomainError(function.error(problem, remedy))

    def location(self, point: EvaluationPoint) -> str:
        """Return the values of a point, for the end of a message."""
        *sizes, time = self.definition.sizes or [1.0] * (self.n + 1)
        components = list(zip(self.states, point.y, sizes, strict=True))[:MAX_COMPONENTS]
        numbers = [f"{name} = {value * size:.6g}" for name, value, size in components]
        numbers += ["…"] if self.n > MAX_COMPONENTS else []
        return f"at {', '.join(numbers)}, t = {point.t * time:.6g}, mode {self._mode(point)}"

    def _mode(self, point: EvaluationPoint) -> str:
        modes = self.definition.modes
        exists = isinstance(point.mode, int) and 0 <= point.mode < len(modes)
        return modes[point.mode] if exists else str(point.mode)


def same(value: Any, other: Any) -> bool:
    """Return whether two results are the same, nan for nan."""
    if isinstance(value, tuple | list) and isinstance(other, tuple | list):
        return len(value) == len(other) and all(map(same, value, other))
    try:
        return bool(value == other) or bool(value != value and other != other)
    except ValueError:  # arrays, which other checks report
        return True


ROUNDING_RTOL = 1e-13  # of a value that is zero but for rounding, relative to the largest


def rounding_size(
    values: Callable[[EvaluationPoint], list[float]],
    points: Iterable[EvaluationPoint],
    modes: Sequence[int],
) -> float:
    """Return the size of the rounding errors of values at some points, zero where undefined.

    The largest value in any of the modes counts: a mode that slides mixes the values of others, and
    has their rounding errors.
    """
    largest = 0.0
    for point, mode in product(points, modes):
        with suppress(FunctionError, DomainError, ArithmeticError):
            largest = max(largest, *map(abs, values(point._replace(mode=mode))))
    return ROUNDING_RTOL * largest
