"""What the functions of a problem depend on: time, and the place of a component of the state."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.trajectory import Floats, Instant

INSTANTS = 64  # at which the functions are looked at: few enough to be quick, a pulse may be short
UNEVEN = 0.6180339887498949  # part of the period from one to the next, so that none coincide
FAR = (-0.618034, 0.381966, 7.23607)  # parts of a size by which a state is shifted
ALIKE = 1e-9  # difference, relative to the largest, of what is the same but for rounding

_Function = Callable[[int, float, Floats], Any]  # of mode, time and state


def time_enters(problem: Problem, y: Floats) -> bool:
    """Return whether flow, margins or transitions at a state depend on time, in any mode.

    A function without it returns the same to the last bit, whenever it is called.
    """
    if problem.switches:
        return True
    return any(
        _varies(each, mode, y, problem.period)
        for mode in range(len(problem.automaton.modes))
        for each in _functions(problem)
    )


def state_enters(problem: Problem, at: Instant, shift: Floats, *, exactly: bool) -> bool:
    """Return whether flow, margins or transitions change where the state is shifted.

    `exactly` is whether a difference of the order of rounding is one.
    """
    try:
        for each in _functions(problem, shift):
            here, there = each(at.mode, at.time, at.y), each(at.mode, at.time, at.y + shift)
            size = 0.0 if exactly else float(np.abs(np.nan_to_num(here)).max(initial=0.0))
            if not np.allclose(there, here, rtol=0.0, atol=ALIKE * size, equal_nan=True):
                return True
    except (ArithmeticError, ValueError, IndexError):
        return True
    return False


def unread(problem: Problem, at: Instant, component: int) -> bool:
    """Return whether no function reads a component of the state, as far as an instant tells."""
    shift = np.zeros(at.y.size)
    shift[component] = 1.0 + abs(at.y[component])
    return not any(state_enters(problem, at, f * shift, exactly=True) for f in FAR)


def _functions(problem: Problem, shift: Floats | None = None) -> Iterator[_Function]:
    """Yield flow, margins and transitions; of a transition to a shifted state what it changes."""
    automaton = problem.automaton
    p = np.array(problem.parameters, dtype=float)
    n, m = len(automaton.states), len(automaton.guards)

    def flow(mode: int, t: float, y: Floats) -> Any:
        slope = np.zeros(n)
        automaton.flow(mode, t, y.copy(), p, slope)
        return slope

    def margins(mode: int, t: float, y: Floats) -> Any:
        margins, rates = np.zeros(m), np.zeros(m)
        automaton.margins(mode, t, y.copy(), p, margins, rates)
        return margins

    def transition(code: int) -> _Function:
        def after(mode: int, t: float, y: Floats) -> Any:
            new = y.copy()
            into = automaton.transition(mode, code, t, new, p)
            return [into, *(new if shift is None else np.where(shift == 0.0, new, new - y))]

        return after

    yield flow
    yield margins
    yield from (transition(code) for code in range(2 * m))


def _varies(function: _Function, mode: int, y: Floats, period: float) -> bool:
    times = (UNEVEN * i % 1.0 * period for i in range(INSTANTS))
    try:
        first = function(mode, 0.0, y)
        return not all(np.array_equal(function(mode, t, y), first, equal_nan=True) for t in times)
    except (ArithmeticError, ValueError, IndexError):
        return False  # a state that does not belong to the mode
