"""Whether time enters the functions of a problem."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.trajectory import Floats

INSTANTS = 64  # at which the functions are looked at: few enough to be quick, a pulse may be short
UNEVEN = 0.6180339887498949  # part of the period from one to the next, so that none coincide


def time_enters(problem: Problem, y: Floats) -> bool:
    """Return whether flow, margins or transitions at a state depend on time, in any mode.

    A function without it returns the same to the last bit, whenever it is called.
    """
    automaton = problem.automaton
    p = np.array(problem.parameters, dtype=float)
    n, m = len(automaton.states), len(automaton.guards)
    if problem.switches:
        return True

    def flow(mode: int, t: float) -> Any:
        slope = np.zeros(n)
        automaton.flow(mode, t, y.copy(), p, slope)
        return slope

    def margins(mode: int, t: float) -> Any:
        margins, rates = np.zeros(m), np.zeros(m)
        automaton.margins(mode, t, y.copy(), p, margins, rates)
        return margins

    def transition(code: int) -> Callable[[int, float], Any]:
        def after(mode: int, t: float) -> Any:
            new = y.copy()
            return [automaton.transition(mode, code, t, new, p), *new]

        return after

    looked = [flow, margins, *(transition(code) for code in range(2 * m))]
    return any(_varies(each, mode, problem.period) for mode in range(len(automaton.modes))
               for each in looked)  # fmt: skip


def _varies(function: Callable[[int, float], Any], mode: int, period: float) -> bool:
    try:
        first = function(mode, 0.0)
        return any(
            not np.array_equal(function(mode, (UNEVEN * i) % 1.0 * period), first, equal_nan=True)
            for i in range(1, INSTANTS)
        )
    except (ArithmeticError, ValueError, IndexError):
        return False  # a state that does not belong to the mode
