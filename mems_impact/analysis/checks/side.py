"""On which side of its guards a run starts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.trajectory import Instant
from mems_impact.telling import tell
from mems_impact.warnings import StartWarning

if TYPE_CHECKING:
    from mems_impact.analysis.terms import Terms

__all__ = ["tell_of_side"]

CLEARLY = 1e3  # tolerances beyond zero


def tell_of_side(system: Terms, problem: Problem, start: Instant) -> None:
    """Warn where a guard that moves the state starts beyond its margin.

    Impacts are refused by the run itself. A guard that changes the mode alone may start there: a
    relay switches at once. Where the transition leaves the state in its place, nothing is told
    either, nor where the margin is zero but for what the tolerances make of it.
    """
    automaton, options = problem.automaton, problem.options
    plain = [
        i for i, guard in enumerate(automaton.guards) if not guard.impact and not guard.records
    ]
    if not plain:
        return
    p = np.array(problem.parameters, dtype=float)
    m = len(automaton.guards)
    margins, aside, rates = np.zeros((3, m))
    room = np.zeros(m)
    sizes = options.rtol * np.abs(start.y) + options.atol
    try:
        automaton.margins(start.mode, start.time, start.y.copy(), p, margins, rates)
        if not (margins[plain] < 0.0).any():
            return
        for j, size in enumerate(sizes):
            y = start.y.copy()
            y[j] += size
            automaton.margins(start.mode, start.time, y, p, aside, rates)
            room += np.abs(aside - margins)
        for i in plain:
            if not margins[i] < -CLEARLY * room[i]:
                continue
            y = start.y.copy()
            automaton.transition(start.mode, i, start.time, y, p)
            if not (np.abs(y - start.y) > CLEARLY * sizes).any():
                continue
            moved = ", ".join(
                f"{system.label(state)} from {system.out(state, a):.6g} to "
                f"{system.out(state, b):.6g}"
                for state, a, b, size in zip(system.states, start.y, y, sizes, strict=True)
                if abs(b - a) > CLEARLY * size
            )
            name = automaton.guards[i].name
            message = (
                f"the margin of {name!r} is negative where the motion starts, and a margin is "
                f"positive until its guard fires: once it falls there, the transition takes "
                f"{moved}; turn the sign of the margin, or start on its other side"
            )
            tell(message, StartWarning, name)
    except (ArithmeticError, ValueError, TypeError, AttributeError, IndexError, NameError):
        return  # what is wrong with a function is told elsewhere
