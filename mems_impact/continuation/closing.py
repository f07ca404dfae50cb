"""Whether a branch, or a curve, has come back to the orbit where it began."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from mems_impact.continuation.corrector import Step
from mems_impact.hybrid.trajectory import Floats
from mems_impact.orbits.shooting import Point, Shooting

CLOSED = "the branch closed upon itself"
SAME = 1e-5  # difference between the states of one orbit, met twice
PARTS = 64  # into which a segment of a cycle is cut to find where a state is nearest
REFINEMENTS = 6  # of that place, by Newton's method


class Beginning:
    """Where a branch or a curve begins, to be recognised when it comes back.

    Parameters
    ----------
    shooting : Shooting
    point : Point
        The first orbit.
    along : float array
        The direction in which the branch sets out.
    """

    def __init__(self, shooting: Shooting, point: Point, along: Floats) -> None:
        self.mode, self.values = shooting.segments[0].mode, point.values
        self.state, self.forward = shooting.unpack(point.unknowns)[0][0], along[-1] > 0.0

    def within(self, shooting: Shooting, step: Step[Point], length: float) -> float | None:
        """Return where in a step the first orbit is met again in the same direction, or None.

        It may begin with another of its forcing periods there, a cycle anywhere, and its events may
        be cut in another way: an orbit is the same if the first state lies on it.

        Raises
        ------
        OrbitError
            If a point within the step cannot be corrected.
        """

        def beyond(point: Point) -> float:
            return float(point.values[-1] - self.values[-1])

        first, last = (beyond(step.at(s).point) for s in (0.0, length))
        if first == 0.0 or first * last > 0.0 or (last > first) != self.forward:
            return None
        place = step.zero(beyond, length)
        return place if self._lies_on(shooting, step.at(place).point) else None

    def _lies_on(self, shooting: Shooting, point: Point) -> bool:
        if np.abs(point.values - self.values).max() > SAME:
            return False
        states, _ = shooting.unpack(point.unknowns)
        for i, segment in enumerate(shooting.segments):
            if segment.mode != self.mode:
                continue
            if shooting.phase is not None:
                apart = self._nearest(shooting, point, i, states[i])
            elif i == 0 or shooting.segments[i - 1].cycle != segment.cycle:
                apart = self._apart(shooting, states[i])
            else:
                continue
            if apart < SAME:
                return True
        return False

    def _apart(self, shooting: Shooting, y: Floats) -> float:
        return float(np.abs(y - self.state)[shooting.free].max(initial=0.0))

    def _nearest(self, shooting: Shooting, point: Point, i: int, y: Floats) -> float:
        """Return the least distance of a segment of a cycle from the first state."""
        mode, free = shooting.segments[i].mode, shooting.free
        variational = shooting.variational(point.setting)
        times = np.linspace(point.starts[i], point.ends[i], PARTS + 1)
        passed = [y]
        for begin, end in pairwise(times.tolist()):
            passed.append(variational.arc(mode, passed[-1], begin, end).end)
        nearest = int(np.argmin([np.linalg.norm((each - self.state)[free]) for each in passed]))
        time, here = float(times[nearest]), passed[nearest]
        for _ in range(REFINEMENTS):
            # The arc may go a little beyond its end, as trial steps do.
            slope = variational.arc(mode, here, time, time).slope_end[free]
            ahead = float(slope @ (self.state - here)[free] / max(slope @ slope, 1e-300))
            limit = times[1] - times[0]
            later = time + float(np.clip(ahead, -limit, limit))
            here, time = variational.arc(mode, here, time, later).end, later
        return self._apart(shooting, here)
