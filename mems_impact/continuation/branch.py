"""A branch of periodic orbits in one parameter, by pseudo-arclength continuation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from mems_impact.continuation.anew import anew
from mems_impact.continuation.closing import CLOSED, Beginning
from mems_impact.continuation.corrector import (
    EASY,
    HARD,
    NODES,
    STRAIGHT,
    Step,
    Steps,
    correct,
    tangent,
)
from mems_impact.continuation.ending import LOSSES, none_beyond, spent, stuck
from mems_impact.continuation.locating import (
    BranchEvent,
    locate,
    rank,
    special_at,
)
from mems_impact.continuation.monitors import (
    BRANCH_POINT,
    FOLD,
    GRAZING,
    NEIMARK_SACKER,
    PERIOD_DOUBLING,
    Monitor,
    monitors,
    without_folds_at_crossings,
)
from mems_impact.continuation.resignature import reconnect
from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.hybrid.trajectory import Floats
from mems_impact.orbits.cycles import check_moving, well_begun
from mems_impact.orbits.newton import solve
from mems_impact.orbits.orbit import PeriodicOrbit, defects, make_orbit
from mems_impact.orbits.shooting import Point, Shooting

NOISE = 1e-6  # of a product of multipliers
COINCIDENT = 1e-7  # distance on the branch below which two losses are one


@dataclass(frozen=True)
class BranchPoint:
    """One orbit on a branch.

    Attributes
    ----------
    orbit : PeriodicOrbit
    value : float
        Of the parameter.
    direction : float array
        Tangent.
    piece : int
        Number of the signature on the branch, counted from 0.
    """

    orbit: PeriodicOrbit
    value: float
    direction: Floats
    piece: int


@dataclass
class OrbitBranch:
    """A branch and what was found on it.

    Attributes
    ----------
    parameter : str
    points : list of BranchPoint
    special_points : list of BranchEvent
    ended : str
        Why the branch ends.
    """

    parameter: str
    points: list[BranchPoint] = field(default_factory=list)
    special_points: list[BranchEvent] = field(default_factory=list)
    ended: str = ""


def follow(
    orbit: PeriodicOrbit,
    parameter: str,
    *,
    low: float,
    high: float,
    direction: float = 1.0,
    steps: Steps | None = None,
    reconnecting: bool = True,
    progress: Callable[[float], None] | None = None,
) -> OrbitBranch:
    """Follow `orbit` in `parameter` until a bound, an end or the budget of points.

    Parameters
    ----------
    orbit : PeriodicOrbit
    parameter : str
        A parameter of the orbit's family.
    low, high : float
        Bounds of the parameter.
    direction : float
        Sign of the first step in the parameter; the branch is followed this way only.
    steps : Steps, optional
    reconnecting : bool
        Whether to go on with the changed signature where a guard is touched at zero speed. If
        not, the branch goes on with the old one onto orbits that the automaton does not have.
    progress : callable, optional
        Called with every value of the parameter.

    Returns
    -------
    OrbitBranch
        Whatever ends it, what was found is in it, and `ended` says why it ends.
    """
    branch = OrbitBranch(parameter)
    points = points_of(
        branch, orbit, low=low, high=high, direction=direction, steps=steps,
        reconnecting=reconnecting,
    )  # fmt: skip
    for found in points:
        if progress is not None:
            progress(found.value)
    return branch


def points_of(
    branch: OrbitBranch,
    orbit: PeriodicOrbit,
    *,
    low: float,
    high: float,
    direction: float = 1.0,
    steps: Steps | None = None,
    reconnecting: bool = True,
) -> Iterator[BranchPoint]:
    """Follow `orbit` as `follow` does, as far as the caller asks for points.

    `branch`, an empty one in the parameter that is varied, gets all that is found.
    """
    parameter, value = branch.parameter, orbit.family.value(branch.parameter)
    if not low <= value <= high:
        raise InvalidParameter(parameter, value, f"between the bounds {low:g} and {high:g}")
    shooting = orbit.equations((parameter,))
    try:
        point = solve(shooting, orbit.point.unknowns, np.array([value]))
    except LOSSES as error:
        branch.ended = f"the first orbit could not be corrected: {error}"
        return
    along = tangent(point)
    if direction < 0.0:
        along = -along
    walker = _Walker(branch, low, high, steps or Steps(), reconnecting)
    try:
        yield from walker.walk(shooting, point, along)
    except LOSSES as error:
        branch.ended = str(error)


@dataclass(frozen=True)
class _Found:
    """What a step passed: special points in order, the last of them where the orbit is lost."""

    special_points: list[BranchEvent]
    lost: BranchEvent | None


class _Walker:
    """The iteration along a branch, from one signature to the next."""

    def __init__(
        self, branch: OrbitBranch, low: float, high: float, steps: Steps, reconnecting: bool
    ) -> None:
        self.branch, self.low, self.high, self.steps = branch, low, high, steps
        self.reconnecting = reconnecting

    def walk(self, shooting: Shooting, point: Point, along: Floats) -> Iterator[BranchPoint]:
        """Yield the points of the branch."""
        piece, parameter = 0, self.branch.parameter
        held = ""  # why the last step that was shortened was
        self.branch.points.append(
            BranchPoint(make_orbit(shooting, point), point.values[0], along, 0)
        )
        yield self.branch.points[-1]
        length = self.steps.initial
        budget = self.steps.most  # of events that move into another period, or past another one
        before = monitors(shooting, point, along)
        beginning = Beginning(shooting, point, along)
        behind: list[Floats] = []
        while len(self.branch.points) < self.steps.most:
            try:
                if budget == 0:
                    raise OrbitError("events go to and fro", "take shorter steps")
                length = self.steps.within(self.low, self.high, point, along, length)
                step = Step(partial(correct, shooting), point, along, behind[-NODES:])
                following, iterations = step.at(length).point, step.at(length).iterations
                check_moving(shooting, point, following)
                closing = beginning.within(shooting, step, length)
                if closing is not None:  # what lies beyond has been passed before
                    length, following = closing, step.at(closing).point
                ahead = tangent(following, along)
                after = monitors(shooting, following, ahead)
                found = self._locate(shooting, step, length, before, after)
                # Where an event meets a switch the branch has a corner, and ends.
                at_corner = found.lost is not None and found.lost.monitor.role == "length"
                if ahead @ along < STRAIGHT and not at_corner:
                    raise OrbitError("the branch turns too sharply", "take a shorter step")
                self._check_kept(shooting, following, found)
                value = float(following.values[0])
                at_bound = found.lost is None and not self.low <= value <= self.high
                if at_bound:
                    self._finish(shooting, point, following, piece)
            except LOSSES as error:
                length /= 2.0
                held = str(error)
                if budget == 0 or length < self.steps.smallest:
                    self.branch.ended = stuck(self.branch.points[-1].orbit, parameter, error)
                    return
                continue
            self.branch.special_points += found.special_points
            passed = found.special_points[-1:]
            if passed and passed[0].kind == PERIOD_DOUBLING and passed[0].monitor.kind == FOLD:
                self._append(shooting, passed[0].orbit.point, passed[0].direction, piece)
                yield self.branch.points[-1]
                self.branch.ended = "the orbit of half the period, from which this one comes"
                return
            lost = found.lost
            if at_bound:
                yield self.branch.points[-1]
                self.branch.ended = f"{self.branch.parameter} reached its bound"
                return
            if lost is not None and self.reconnecting:
                joined, reason = self._other_side(lost)
                # An event that moves into the next period, or past another one, changes nothing.
                passing = joined is not None and lost.monitor.role == "length"
                if not passing:
                    self.branch.points.append(
                        BranchPoint(lost.orbit, lost.value, lost.direction, piece)
                    )
                    yield self.branch.points[-1]
                if joined is None:
                    self.branch.ended = f"{lost.kind}: {reason}"
                    return
                shooting, point, along = joined
                behind = []
                earlier, before = before, monitors(shooting, point, along)
                if passing:
                    self._rename(lost, found.special_points, earlier, before)
                    length = max(length / 2.0, self.steps.initial)
                    budget -= 1
                    continue
                piece += 1
                length = self.steps.initial
                self._append(shooting, point, along, piece)
                yield self.branch.points[-1]
                continue
            behind.append(step.start)
            point, along, before = following, ahead, after
            self._append(shooting, point, along, piece)
            yield self.branch.points[-1]
            if closing is not None:
                self.branch.ended = CLOSED
                return
            if not well_begun(shooting, point):
                shooting, point, along = anew(shooting, point, along)
                before, behind = monitors(shooting, point, along), []
            if iterations <= EASY:
                length = min(1.5 * length, self.steps.largest)
            elif iterations >= HARD:
                length /= 1.5
                held = f"a correction takes {iterations} Newton steps"
        moved, value = abs(float(along[-1])) * length, float(point.values[0])
        self.branch.ended = spent(
            self.steps, length, held, parameter, moved / max(abs(value), moved)
        )

    def _check_kept(self, shooting: Shooting, following: Point, found: _Found) -> None:
        """Raise OrbitError if a step leads off the automaton's orbits at no point that was found.

        A closest approach may come into being within a step, and be too close at its end.
        """
        if not self.reconnecting or found.lost or not self.branch.points[-1].orbit.admissible:
            return
        if defects(shooting, following):
            raise OrbitError("a margin is lost where none was watched", "take a shorter step")

    def _other_side(self, lost: BranchEvent) -> tuple[tuple[Shooting, Point, Floats] | None, str]:
        """Return what `reconnect` finds at `lost`, or None and why it finds nothing."""
        try:
            return reconnect(lost.orbit, lost.monitor, self.branch.parameter), ""
        except LOSSES as error:
            return None, none_beyond(error)

    def _rename(
        self,
        met: BranchEvent,
        located: list[BranchEvent],
        before: dict[Monitor, float],
        after: dict[Monitor, float],
    ) -> None:
        """Call a point at which two events met what happens there, or drop it if nothing does.

        At a switch of the drive the branch has a corner, and may turn or lose its stability.
        Elsewhere the orbit is only cut in another way, and its test functions go on.
        """
        changed = [
            monitor
            for monitor in (Monitor(kind) for kind in (FOLD, PERIOD_DOUBLING, NEIMARK_SACKER))
            if before[monitor] * after[monitor] < 0.0
            and sum(special.monitor == monitor for special in located) % 2 == 0
        ]
        i, segments = met.monitor.segment, met.orbit.segments
        at_switch = 2 * met.orbit.shooting.m in (segments[i - 1].code, segments[i].code)
        # By what it is: points are compared by their arrays, which have no one truth.
        self.branch.special_points[:] = [s for s in self.branch.special_points if s is not met]
        if at_switch and changed:
            self.branch.special_points.append(met)
        elif changed:
            special = special_at(changed[0], met.orbit.shooting, met.orbit.point, met.direction)
            self.branch.special_points += [special] if special else []

    def _append(self, shooting: Shooting, point: Point, along: Floats, piece: int) -> None:
        found = BranchPoint(make_orbit(shooting, point), float(point.values[0]), along, piece)
        self.branch.points.append(found)

    def _finish(self, shooting: Shooting, point: Point, beyond: Point, piece: int) -> None:
        """Put the last orbit at the bound, which lies between `point` and `beyond`."""
        bound = self.low if beyond.values[0] < self.low else self.high
        share = (bound - point.values[0]) / (beyond.values[0] - point.values[0])
        unknowns = point.unknowns + share * (beyond.unknowns - point.unknowns)
        last = solve(shooting, unknowns, np.array([bound]))
        onward = np.append(last.unknowns - point.unknowns, bound - point.values[0])
        self._append(shooting, last, tangent(last, onward), piece)

    def _locate(
        self,
        shooting: Shooting,
        step: Step,
        length: float,
        before: dict[Monitor, float],
        after: dict[Monitor, float],
    ) -> _Found:
        """Locate all sign changes of the last step, up to where the orbit is lost."""

        def crossed(after: dict[Monitor, float], reach: float) -> list[tuple[float, BranchEvent]]:
            found = [
                locate(shooting, step, reach, monitor)
                for monitor, value in before.items()
                if monitor in after and value * after[monitor] < 0.0
            ]
            inside = [item for item in found if item and self.low <= item[1].value <= self.high]
            return sorted(inside, key=lambda item: item[0])

        # Back to what the automaton has, nothing is lost.
        lost = crossed(
            {m: v for m, v in after.items() if m.role and before.get(m, 0.0) > 0.0}, length
        )
        first, reach = None, length
        if lost:
            first = min(
                (item for item in lost if item[0] <= lost[0][0] + COINCIDENT),
                key=lambda item: rank(item[1]),
            )
            # Beyond, the test functions may jump, and what they say is of no interest.
            reach = max(lost[0][0] - COINCIDENT, 0.0)
            here = step.at(reach).point
            after = monitors(shooting, here, tangent(here, step.along))
        # Multipliers may stay on the unit circle, and orbits lie side by side.
        quiet = {m for m in before if m.kind in (NEIMARK_SACKER, BRANCH_POINT)}
        quiet = {m for m in quiet if max(abs(before[m]), abs(after.get(m, 0.0))) < NOISE}
        smooth = {m: v for m, v in after.items() if not m.role and m not in quiet}
        special_points = [each for _, each in without_folds_at_crossings(crossed(smooth, reach))]
        if first is None:
            return _Found(special_points, None)
        return _Found([*special_points, first[1]], first[1])


__all__ = ["FOLD", "GRAZING", "BranchEvent", "BranchPoint", "OrbitBranch", "Steps", "follow"]
