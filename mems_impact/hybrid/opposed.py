"""Two modes that push against each other: told where a run cannot go on for it."""

from __future__ import annotations

import numpy as np

from mems_impact.hybrid import loop
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.trajectory import Events

__all__ = ["LOOKED_AT", "SLIDE", "opposed"]

LOOKED_AT = 4  # events at the end of a run
ASIDE = 1e-3  # of a period, by which a state is moved back to see on which side modes lie
AT_ONCE = 1e-6  # of a period, within which they follow each other

SLIDE = (
    "say how the state slides between them, in a mode of its own (mems_impact.Surface does), or "
    "give the switching a hysteresis"
)


def opposed(events: Events, problem: Problem) -> str:
    """Return in words which two modes push against each other at the end of a run.

    Each leads to the guard where the other begins, so that their events alternate in no time. Empty
    if that is not how the run ends.
    """
    automaton, period = problem.automaton, problem.period
    last = slice(-LOOKED_AT, None)
    modes, leads = events.mode_before[last], events.mode_after[last]
    if len(modes) < LOOKED_AT or not (events.kind[last] == loop.TRANSITION).all():
        return ""
    when = events.cycle[last] * period + events.time[last]
    alternate = (modes[1:] == leads[:-1]).all() and (modes[2:] == modes[:-2]).all()
    if not alternate or modes[0] == modes[1] or np.ptp(when) > AT_ONCE * period:
        return ""
    guards = [automaton.guards[i] for i in sorted(set(events.guard[last].tolist()))]
    if any(guard.impact for guard in guards):
        return ""
    if len(guards) == 1 and _one_side(problem, events):
        return ""
    one, other = (repr(automaton.modes[mode]) for mode in sorted(modes[:2].tolist()))
    names = " and ".join(repr(guard.name) for guard in guards)
    return f"the modes {one} and {other} push against each other at {names}: neither can last"


def _one_side(problem: Problem, events: Events) -> bool:
    """Return whether both modes lie on the same side of the guard that both watch.

    Then they lead through it in the same direction, and do not push against each other.
    """
    automaton, p = problem.automaton, np.asarray(problem.parameters, dtype=float)
    one, other = events.mode_before[-2:].tolist()
    time, y, guard = float(events.time[-1]), events.before[-1], int(events.guard[-1])
    slope = np.zeros(y.size)
    automaton.flow(one, time, y, p, slope)
    behind = y - ASIDE * problem.period * slope

    def is_above(mode: int) -> bool:
        margins, rates = np.ones(len(automaton.guards)), np.ones(len(automaton.guards))
        automaton.margins(mode, time, behind, p, margins, rates)
        return bool(margins[guard] > 0.0)

    return is_above(one) == is_above(other)
