"""Test functions: quantities whose zeros along a branch are the points where something happens."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mems_impact.continuation.branching import regularity
from mems_impact.hybrid.automaton import Guard
from mems_impact.hybrid.record import NONE
from mems_impact.hybrid.trajectory import Floats
from mems_impact.orbits.shooting import Point, Shooting

GRAZING, FOLD, PERIOD_DOUBLING, NEIMARK_SACKER, BRANCH_POINT, UNEXPLAINED = (
    "grazing",
    "fold",
    "period-doubling",
    "Neimark-Sacker",
    "branch point",
    "unexplained",
)
NEAR = 1e-3  # distance from -1, or from the unit circle, of a multiplier that is taken to be there
AT_ZERO = 1e-9  # a margin, or its rate, that is zero but for rounding
VANISHING = 1e-6  # length of a segment below which its margins are those of its end
LABELS = {
    GRAZING: "G",
    FOLD: "CF",
    PERIOD_DOUBLING: "PD",
    NEIMARK_SACKER: "NS",
    BRANCH_POINT: "BP",
    UNEXPLAINED: "?",
}


@dataclass(frozen=True)
class Monitor:
    """One test function.

    Attributes
    ----------
    kind : str
        "fold", "period-doubling", "Neimark-Sacker", "branch point" (another branch crosses),
        "grazing" (of a guard with impacts), or the name of another guard whose margin is touched.
    role : str
        For a guard: "approach" (its smallest margin along the orbit, or in a segment), "rate" (the
        speed at which the guard that ends a segment is reached), "length" (of a segment, zero
        where two events meet) or "choice" (the margin after the event that ends a segment, in a
        mode to which that may lead).
    segment, guard, mode : int
        -1 where it is none or any.
    """

    kind: str
    role: str = ""
    segment: int = -1
    guard: int = -1
    mode: int = -1


@dataclass(frozen=True)
class Closest:
    """Where along an orbit a margin is smallest.

    Attributes
    ----------
    value : float
    segment : int
    time : float
        Since the start of the period of the segment.
    inside : bool
        Whether it is a closest approach within the segment, not a value at one of its ends.
    """

    value: float
    segment: int
    time: float
    inside: bool


def closest(shooting: Shooting, point: Point, guard: int, within: int = -1) -> Closest | None:
    """Return the smallest value of a margin where it applies; None if it applies nowhere.

    In the segment `within` alone, unless that is -1.

    A gap does not jump, so that its closest approaches are those inside the segments, and where an
    event turns its rate. Another margin may jump, and then its values at the ends of the segments
    count too, but for the one that ends a segment and the one that starts at zero and does not
    fall. Where static friction is no larger than dynamic, such a margin, the speed, starts with a
    rate that is zero but for rounding.
    """
    m = shooting.m
    impact = shooting.automaton.guards[guard].impact
    found: list[Closest] = []
    for i, segment in enumerate(shooting.segments):
        if within not in (-1, i):
            continue
        arc = point.arcs[i]
        start, end = float(point.starts[i]), float(point.ends[i])
        margin, rate = float(arc.margins[0, guard]), float(arc.rates[0, guard])
        own_start = not impact and abs(margin) < AT_ZERO and rate > -AT_ZERO
        time = float(arc.minima_time[guard])
        if np.isfinite(arc.minima[guard]) and not (own_start and time - start < VANISHING):
            found.append(Closest(float(arc.minima[guard]), i, time, True))
        own = segment.guard(m)
        if impact:
            following = point.arcs[(i + 1) % len(shooting.segments)]
            turns = arc.rates[1, guard] < 0.0 < following.rates[0, guard]
            if turns and own != guard and point.events[i] is not None:
                found.append(Closest(float(arc.margins[1, guard]), i, end, False))
            continue
        if own != guard:
            found.append(Closest(float(arc.margins[1, guard]), i, end, False))
        elif end - start < VANISHING:
            continue  # the event meets another, or the start of a period: see "length"
        if not own_start:
            found.append(Closest(margin, i, start, False))
    return min(found, key=lambda c: c.value, default=None)


def monitors(shooting: Shooting, point: Point, direction: Floats) -> dict[Monitor, float]:
    """Return all test functions at `point`; positive margins and falling rates are admissible."""
    values = {Monitor(FOLD): float(direction[-1])}
    if direction.size == point.unknowns.size + 1:  # on a branch, not on a curve
        values[Monitor(BRANCH_POINT)] = regularity(point, direction)
    automaton, m = shooting.automaton, shooting.m
    for i, segment in enumerate(shooting.segments):
        event = point.events[i]
        values[Monitor("simultaneous events", "length", i)] = float(point.ends[i] - point.starts[i])
        guard = segment.guard(m)
        if event is not None and guard != NONE:
            kind = kind_of(automaton.guards[guard])
            values[Monitor(kind, "rate", i, guard)] = -float(event.rates[guard])
    for j, each in enumerate(automaton.guards):
        smallest = closest(shooting, point, j)
        if smallest is not None:
            values[Monitor(kind_of(each), "approach", -1, j)] = smallest.value
    return values


def choice_margins(shooting: Shooting, point: Point, i: int, mode: int) -> Floats:
    """Return the margins in `mode` after the event that ends segment `i`, shape (m,)."""
    event = point.events[i]
    assert event is not None
    variational = shooting.variational(point.setting)
    return variational.margins(mode, float(point.ends[i]), np.array(event.after))[0]


def kind_of(guard: Guard) -> str:
    """Return what it is called when the margin of `guard` is touched."""
    return GRAZING if guard.impact else guard.name
