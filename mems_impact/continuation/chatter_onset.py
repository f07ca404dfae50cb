"""Onset of complete chatter on a branch, where the rest after a chatter sequence has length zero.

Near the onset the number of significant impacts grows without bound. The signature of an orbit
has finitely many, and replaces the remainder of the sequence by one impact without rebound. So the
length of the rest becomes zero at a small distance from the onset, and runs locate the onset.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.bisection import bisect
from mems_impact.continuation.arclength import CONTINUATION_ERRORS, tangent
from mems_impact.continuation.branch import OrbitEvent
from mems_impact.continuation.test_functions import CHATTER_ONSET, ORBIT_LABELS, SegmentLengthTest
from mems_impact.hybrid.event_loop.workspace import ACCUMULATION
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.orbits.newton import solve
from mems_impact.orbits.periodic_orbit import PeriodicOrbit, make_orbit
from mems_impact.orbits.signature import BOUNDARY, Segment, read_guess

# Distances in the parameter at which the onset is bracketed.
ONSET_DISTANCES = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3)
BEYOND_ONSET = (
    "beyond it the contact releases before chatter is complete, and branches with increasing "
    "numbers of impacts accumulate here; find an orbit beyond it and continue that orbit"
)
ACROSS_START = (
    "a chatter sequence reaches the start of a period, which its infinitely many impacts cannot "
    "cross one by one; shift the start of the period: give the forcing a phase"
)


def rests_after_chatter(segments: tuple[Segment, ...], i: int, m: int) -> bool:
    """Return whether segment `i` is the rest after a sequence of impacts, with `m` guards."""
    return m <= segments[i - 1].code < 2 * m


def chatter_onset(event: OrbitEvent, parameter: str) -> OrbitEvent | None:
    """Return the onset of complete chatter near `event`, a rest of length zero after chatter.

    Runs over the orbit's period, from initial states that are extrapolated along the branch, end
    in sticking contact on one side of the onset only. The result has the last orbit with a rest,
    with its own sequence of impacts. None if both sides have a rest.
    """
    assert isinstance(event.monitor, SegmentLengthTest)
    orbit, i = event.solution, event.monitor.segment
    m, onward = orbit.shooting.m, float(np.sign(event.direction[-1]))
    if onward == 0.0 or orbit.segments[i].code == BOUNDARY:
        return None
    code = orbit.segments[i - 1].code
    sequences = sum(segment.code == code for segment in orbit.segments)

    def begin(distance: float) -> tuple[PeriodicOrbit, HybridState]:
        """Return the orbit's initial state at a distance in the parameter beyond `event`."""
        moved = onward * distance * _state_rates(event)
        start = replace(orbit.instant, y=orbit.instant.y + moved)
        value = event.value + onward * distance
        return replace(orbit, family=orbit.family.at(**{parameter: value})), start

    def rests(distance: float) -> bool:
        orbit_at, start = begin(distance)
        events = run(orbit_at.family.problem(), start, orbit.periods).events
        ends = (events.kind == ACCUMULATION) & (events.guard == code - m)
        return int(ends.sum()) >= sequences

    try:
        before = next((-d for d in ONSET_DISTANCES if rests(-d)), None)
        beyond = next((d for d in ONSET_DISTANCES if not rests(d)), None)
        if before is None or beyond is None:
            return None
        before, _ = bisect(rests, before, beyond, abs(float(np.spacing(event.value))))
        orbit_before, start = begin(before)
    except CONTINUATION_ERRORS:
        return None
    onset = replace(
        event,
        kind=CHATTER_ONSET,
        label=ORBIT_LABELS[CHATTER_ONSET],
        value=event.value + onward * before,
    )
    try:
        return _with_orbit(onset, orbit_before, start, parameter)
    except CONTINUATION_ERRORS:
        return onset


def _state_rates(event: OrbitEvent) -> Floats:
    """Return the derivative of the first state along the branch by the parameter."""
    shooting, rates = event.solution.shooting, np.zeros(event.solution.shooting.n)
    rates[shooting.free] = event.direction[: len(shooting.free)] / event.direction[-1]
    return rates


def _with_orbit(
    onset: OrbitEvent, there: PeriodicOrbit, start: HybridState, parameter: str
) -> OrbitEvent:
    """Return the onset with an orbit that has the sequence of impacts of a run.

    Raises OrbitError if the orbit cannot be corrected.
    """
    guess = read_guess(there.family.problem(), start, there.periods)
    shooting = there.equations((parameter,), guess.segments, pinned={})
    unknowns, values = shooting.pack(guess), np.array([onset.value])
    shooting.pin(shooting.evaluate(unknowns, values))
    orbit = make_orbit(shooting, solve(shooting, unknowns, values))
    assert isinstance(onset.monitor, SegmentLengthTest)
    code = onset.solution.segments[onset.monitor.segment - 1].code
    numbers = [i for i, s in enumerate(guess.segments) if guess.segments[i - 1].code == code]
    if not numbers or not orbit.admissible:
        return onset
    shortest = min(numbers, key=lambda i: float(orbit.point.ends[i] - orbit.point.starts[i]))
    direction = tangent(orbit.point)
    return replace(
        onset,
        solution=orbit,
        direction=direction if direction[-1] * onset.direction[-1] > 0.0 else -direction,
        monitor=SegmentLengthTest(onset.monitor.kind, shortest),
    )
