"""Observables of a system as one function over arrays, for compiled code and interpreted."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

from mems_impact.hybrid.scaling import Typical
from mems_impact.hybrid.written import GENERATED, function, indented, named

__all__ = ["Observed", "observed"]


@dataclass(frozen=True)
class Observed:
    """The observables that are gathered of a motion, and what gives them.

    Attributes
    ----------
    function : callable
        ``function(mode, code, t, states, p, out)`` writes the observables: with `code` -1 those of
        the state, the first `gains` of `out`; with the number of a guard those that its events
        have, behind them. `states` are the state before and after an event, one behind the other.
    gains, marks : tuple of str
        Names of the observables of the state, and at events.
    """

    function: Callable[..., Any]
    gains: tuple[str, ...]
    marks: tuple[str, ...]


@cache
def observed(
    given: tuple[tuple[str, Callable[..., Any], tuple[int, ...]], ...],
    states: tuple[str, ...],
    parameters: tuple[str, ...] | None,
    by_array: bool = False,
    typical: Typical | None = None,
) -> Observed:
    """Return observables as one function; the same one for the same functions.

    Parameters
    ----------
    given : tuple of (str, callable, tuple of int)
        Name, function, and the guards at whose events it is taken; none for one of the state.
    states : tuple of str
    parameters : tuple of str or None
        By which functions read ``p``; None for those that take it as an array.
    by_array : bool
        Whether functions take the state as an array.
    typical : Typical, optional
        The units of the numerics, if they are not those of the functions.
    """
    gains = [each for each in given if not each[2]]
    marks = [each for each in given if each[2]]
    n, count = len(states), 0 if parameters is None else len(parameters)
    space: dict[str, Any] = {"__name__": __name__, "nan": math.nan}
    unit = [1.0] * n if typical is None else list(typical.states)
    inner = [1.0] * count if typical is None else list(typical.parameters)
    time = 1.0 if typical is None else typical.time

    def state(first: int) -> str:
        if by_array:
            return f"y[{first}:{first + n}]"
        return "State(" + ", ".join(_times(f"y[{first + i}]", unit[i]) for i in range(n)) + ")"

    lines: list[str] = []
    if by_array and typical is not None:
        space["SIZE"] = typical.states * 2
        lines += [f"for k in range({2 * n}):", "    y[k] *= SIZE[k]"]
    if not by_array:
        space["State"] = named("State", states)
    if parameters is None:
        lines.append("q = p")
    else:
        space["Parameters"] = named("Parameters", parameters)
        values = (_times(f"p[{i}]", inner[i]) for i in range(count))
        lines.append("q = Parameters(" + ", ".join(values) + ")")
    lines += [f"before = {state(0)}", f"after = {state(n)}", f"time = {_times('t', time)}"]
    of_state, at_events = [], []
    for i, (_, gives, _guards) in enumerate(gains):
        space[f"gain_{i}"] = gives
        of_state.append(f"out[{i}] = gain_{i}(before, q)")
    for i, (_, gives, guards) in enumerate(marks):
        space[f"mark_{i}"] = gives
        test = " or ".join(f"code == {guard}" for guard in guards)
        at_events.append(f"if {test}:")
        at_events += indented([f"out[{len(gains) + i}] = mark_{i}(mode, time, before, after, q)"])
    lines += ["if code < 0:", *indented(of_state or ["pass"])]
    lines += ["else:", *indented(at_events or ["pass"])]
    text = function("observe(mode, code, t, y, p, out)", lines)
    exec(compile(text, GENERATED, "exec"), space)
    names = (tuple(each[0] for each in some) for some in (gains, marks))
    return Observed(space["observe"], *names)


def _times(name: str, unit: float) -> str:
    return name if unit == 1.0 else f"{name} * {unit!r}"
