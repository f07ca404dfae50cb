"""Onset of complete chatter on a branch: where a rest after accumulating impacts has no length.

Towards it, ever more impacts count, each nearer to the release. An orbit has as many as its
signature says and takes the rest of the sequence for one impact without rebound. So the length of
its rest becomes zero a little beside the onset, and the onset itself is found by runs.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.bisection import bisect
from mems_impact.continuation.arclength import CONTINUATION_ERRORS, tangent
from mems_impact.continuation.special_points import BranchEvent
from mems_impact.continuation.test_functions import CHATTER_ONSET, ORBIT_LABELS, SegmentLengthTest
from mems_impact.hybrid.event_loop.workspace import ACCUMULATION
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.orbits.newton import solve
from mems_impact.orbits.periodic_orbit import PeriodicOrbit, make_orbit
from mems_impact.orbits.signature import BOUNDARY, Segment, read_guess

__all__ = ["ACROSS_START", "BEYOND_ONSET", "chatter_onset", "rests_after_chatter"]

ONSET_DISTANCES = (
    1e-7,
    1e-6,
    1e-5,
    1e-4,
    1e-3,
)  # of the parameter, in which the onset is looked for
BEYOND_ONSET = (
    "beyond it the impacts do not come to rest before the contact is released, and orbits of ever "
    "more impacts accumulate here; find an orbit beyond and follow that"
)
ACROSS_START = (
    "a sequence of accumulating impacts comes to the start of a period, which infinitely many "
    "impacts cannot pass one by one; begin the period elsewhere: give the forcing a phase"
)


def rests_after_chatter(segments: tuple[Segment, ...], i: int, m: int) -> bool:
    """Return whether segment `i` is the rest after a sequence of impacts, with `m` guards."""
    return m <= segments[i - 1].code < 2 * m


def chatter_onset(met: BranchEvent, parameter: str) -> BranchEvent | None:
    """Return the onset of complete chatter beside `met`, where a rest after chatter has no length.

    Runs of the orbit's length, from where the branch says that it begins, come to rest on one side
    of the onset and not on the other. The orbit is the last one that rests, with its own sequence
    of impacts. None if runs rest on both sides.
    """
    assert isinstance(met.monitor, SegmentLengthTest)
    orbit, i = met.orbit, met.monitor.segment
    m, onward = orbit.shooting.m, float(np.sign(met.direction[-1]))
    if onward == 0.0 or orbit.segments[i].code == BOUNDARY:
        return None
    code = orbit.segments[i - 1].code
    sequences = sum(segment.code == code for segment in orbit.segments)

    def begin(distance: float) -> tuple[PeriodicOrbit, HybridState]:
        """Return where the orbit begins at a distance in the parameter beyond `met`."""
        moved = onward * distance * _state_rates(met)
        start = replace(orbit.instant, y=orbit.instant.y + moved)
        value = met.value + onward * distance
        return replace(orbit, family=orbit.family.at(**{parameter: value})), start

    def rests(distance: float) -> bool:
        there, start = begin(distance)
        events = run(there.family.problem(), start, orbit.periods).events
        ends = (events.kind == ACCUMULATION) & (events.guard == code - m)
        return int(ends.sum()) >= sequences

    try:
        before = next((-d for d in ONSET_DISTANCES if rests(-d)), None)
        beyond = next((d for d in ONSET_DISTANCES if not rests(d)), None)
        if before is None or beyond is None:
            return None
        before, _ = bisect(rests, before, beyond, abs(float(np.spacing(met.value))))
        there, start = begin(before)
    except CONTINUATION_ERRORS:
        return None
    onset = replace(
        met,
        kind=CHATTER_ONSET,
        label=ORBIT_LABELS[CHATTER_ONSET],
        value=met.value + onward * before,
    )
    try:
        return _with_orbit(onset, there, start, parameter)
    except CONTINUATION_ERRORS:
        return onset


def _state_rates(met: BranchEvent) -> Floats:
    """Return how the first state of the orbits changes with the parameter."""
    shooting, rates = met.orbit.shooting, np.zeros(met.orbit.shooting.n)
    rates[shooting.free] = met.direction[: len(shooting.free)] / met.direction[-1]
    return rates


def _with_orbit(
    onset: BranchEvent, there: PeriodicOrbit, start: HybridState, parameter: str
) -> BranchEvent:
    """Return the onset with the orbit whose sequence of impacts a run has there.

    Raises
    ------
    OrbitError
        If it cannot be corrected.
    """
    guess = read_guess(there.family.problem(), start, there.periods)
    shooting = there.equations((parameter,), guess.segments, pinned={})
    unknowns, values = shooting.pack(guess), np.array([onset.value])
    shooting.pin(shooting.evaluate(unknowns, values))
    orbit = make_orbit(shooting, solve(shooting, unknowns, values))
    assert isinstance(onset.monitor, SegmentLengthTest)
    code = onset.orbit.segments[onset.monitor.segment - 1].code
    places = [i for i, s in enumerate(guess.segments) if guess.segments[i - 1].code == code]
    if not places or not orbit.admissible:
        return onset
    shortest = min(places, key=lambda i: float(orbit.point.ends[i] - orbit.point.starts[i]))
    along = tangent(orbit.point)
    return replace(
        onset,
        orbit=orbit,
        direction=along if along[-1] * onset.direction[-1] > 0.0 else -along,
        monitor=SegmentLengthTest(onset.monitor.kind, shortest),
    )
