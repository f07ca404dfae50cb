"""Why numba cannot compile a function, in one sentence."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, NamedTuple

from mems_impact.engines.compiling import JIT
from mems_impact.engines.snapshot import take

__all__ = ["Compiling", "compiling"]

# numba's words for what it lacks where nothing may own memory, and ours.
_OWNING = ("NRT required", "Only accept returning of array", "NRT", "reflected list")
_PLACE = re.compile(r'File "(?P<a>[^"]+)", line (?P<i>\d+)|at (?P<b>\S+) \((?P<j>\d+)\)')
_FRAME = ("Failed in", "File ", "During", "raised from", ">>>", "There are", "- Of which")


class Compiling(NamedTuple):
    """What became of compiling a function.

    Attributes
    ----------
    problem : str
        Why it cannot be compiled; empty if it can.
    line : int
        The line of the function's file where that is, 0 if numba does not tell.
    returned : numba type or None
        What it returns, where it can be compiled.
    """

    problem: str
    line: int = 0
    returned: Any = None


def compiling(function: Callable[..., Any], arguments: tuple[Any, ...]) -> Compiling:
    """Compile a function by itself, for arguments of these types of numba's."""
    from numba import njit

    file = function.__code__.co_filename
    try:
        (frozen,) = take(function).frozen()
        compiled = njit(**JIT)(frozen)
        compiled.compile(arguments)
    except Exception as error:  # numba raises what it likes
        message = str(error) or type(error).__name__
        return Compiling(told(message), _line(message, file))
    return Compiling("", 0, compiled.overloads[arguments].signature.return_type)


def told(message: str) -> str:
    """Return what numba's message says is wrong, without its pages of context.

    That is the innermost of its reports, which stands after the last of the headings.
    """
    if any(words in message for words in _OWNING):
        return "it makes a list, an array or a text while it runs"
    last = message.rpartition("Failed in nopython mode pipeline")[2].partition("\n")
    lines = [line.strip() for line in (last[2] or message).splitlines() if line.strip()]
    telling = [line for line in lines if not line.startswith(_FRAME)]
    text = (telling or lines or ["no reason given"])[0]
    text = re.sub(r"<function (\w+?)_[0-9a-f]{32}_\d+ at 0x[0-9a-f]+>", r"\1", text)
    return re.sub(r"_[0-9a-f]{32}_\d+", "", text)[:200].rstrip(" .")


def _line(message: str, file: str) -> int:
    """Return the first line of `file` that a message names: the innermost."""
    name = file.replace("\\", "/").rpartition("/")[2]
    for found in _PLACE.finditer(message):
        if (found["a"] or found["b"]).replace("\\", "/").rpartition("/")[2] == name:
            return int(found["i"] or found["j"])
    return 0
