"""A branch of periodic orbits in one parameter, by pseudo-arclength continuation."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import brentq

from mems_impact.continuation.corrector import correct, step, tangent
from mems_impact.continuation.monitors import (
    FOLD,
    GRAZING,
    LABELS,
    NEAR,
    NEIMARK_SACKER,
    PERIOD_DOUBLING,
    Monitor,
    closest,
    monitors,
)
from mems_impact.continuation.resignature import reconnect
from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.hybrid.trajectory import Floats
from mems_impact.orbits.orbit import PeriodicOrbit, defects, make_orbit, reduced
from mems_impact.orbits.shooting import Point, Shooting

SAME_HALVES = 2e-3  # relative difference between the halves of an orbit of half the period
SAME = 1e-5  # difference between the unknowns of one orbit, met twice
NOISE = 1e-6  # of a product of multipliers
COINCIDENT = 1e-7  # distance on the branch below which two losses are one
STRAIGHT = 0.9  # cosine of the angle by which a branch may turn in one step
SHORT = 0.1  # part of the largest step below which a branch says what holds it back
EASY, HARD = 2, 5  # Newton steps below which a step may grow, above which it shrinks


@dataclass(frozen=True, kw_only=True)
class Steps:
    """Control of the step length, in the space of unknowns and parameter.

    Attributes
    ----------
    initial, smallest, largest : float
    most : int
        Points that a branch may have.
    """

    initial: float = 1e-3
    smallest: float = 1e-7
    largest: float = 0.05
    most: int = 2000


@dataclass(frozen=True)
class SpecialPoint:
    """A point of a branch at which something happens, located on it.

    Attributes
    ----------
    kind : str
        "grazing", "fold", "period-doubling", "Neimark-Sacker", or the name of the guard whose
        margin is touched.
    label : str
        As in the paper: G, CF, PD; else the kind.
    value : float
        Of the parameter.
    orbit : PeriodicOrbit
    direction : float array
        Tangent of the branch.
    monitor : Monitor
        The test function that is zero.
    """

    kind: str
    label: str
    value: float
    orbit: PeriodicOrbit = field(repr=False)
    direction: Floats = field(repr=False)
    monitor: Monitor = field(repr=False)


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
    special_points : list of SpecialPoint
    ended : str
        Why the branch ends.
    """

    parameter: str
    points: list[BranchPoint] = field(default_factory=list)
    special_points: list[SpecialPoint] = field(default_factory=list)
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
    if not low <= orbit.family.value(parameter) <= high:
        value = orbit.family.value(parameter)
        raise InvalidParameter(parameter, value, f"between the bounds {low:g} and {high:g}")
    branch = OrbitBranch(parameter)
    shooting = Shooting(orbit.family, orbit.segments, (parameter,))
    shooting.pinned = orbit.shooting.pinned
    value = orbit.family.value(parameter)
    try:
        point = shooting.solve(orbit.point.unknowns, np.array([value]))
    except OrbitError as error:
        branch.ended = f"the first orbit could not be corrected: {error}"
        return branch
    along = tangent(point)
    if direction < 0.0:
        along = -along
    walker = _Walker(branch, low, high, steps or Steps(), reconnecting)
    try:
        for found in walker.walk(shooting, point, along):
            if progress is not None:
                progress(found.value)
    except (OrbitError, InvalidParameter) as error:
        branch.ended = str(error)
    return branch


@dataclass(frozen=True)
class _Found:
    """What a step passed: special points in order, the last of them where the orbit is lost."""

    special_points: list[SpecialPoint]
    lost: SpecialPoint | None


class _Walker:
    """The iteration along a branch, from one signature to the next."""

    def __init__(
        self, branch: OrbitBranch, low: float, high: float, steps: Steps, reconnecting: bool
    ) -> None:
        self.branch, self.low, self.high, self.steps = branch, low, high, steps
        self.reconnecting = reconnecting

    def walk(self, shooting: Shooting, point: Point, along: Floats) -> Iterator[BranchPoint]:
        """Yield the points of the branch."""
        piece = 0
        held = ""  # why the last step that was shortened was
        self.branch.points.append(
            BranchPoint(make_orbit(shooting, point), point.values[0], along, 0)
        )
        yield self.branch.points[-1]
        length = self.steps.initial
        budget = self.steps.most  # of events that move into another period, or past another one
        before = monitors(shooting, point, along)
        while len(self.branch.points) < self.steps.most:
            try:
                if budget == 0:
                    raise OrbitError("events go to and fro", "take shorter steps")
                length = self._within_bounds(point, along, length)
                following, iterations = step(shooting, point, along, length)
                ahead = tangent(following, along)
                after = monitors(shooting, following, ahead)
                found = self._locate(shooting, point, along, length, before, after)
                # Where an event meets a switch the branch has a corner, and ends.
                at_corner = found.lost is not None and found.lost.monitor.role == "length"
                if ahead @ along < STRAIGHT and not at_corner:
                    raise OrbitError("the branch turns too sharply", "take a shorter step")
                self._check_kept(shooting, following, found)
                closed = found.lost is None and self._closed(shooting, point, along, length)
                value = float(following.values[0])
                at_bound = found.lost is None and not self.low <= value <= self.high
                if at_bound:
                    self._finish(shooting, point, following, piece)
            except (OrbitError, InvalidParameter) as error:
                length /= 2.0
                held = str(error)
                if budget == 0 or length < self.steps.smallest:
                    self.branch.ended = f"no further step possible: {error}"
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
            if closed:
                self.branch.ended = "the branch closed upon itself"
                return
            point, along, before = following, ahead, after
            self._append(shooting, point, along, piece)
            yield self.branch.points[-1]
            if iterations <= EASY:
                length = min(1.5 * length, self.steps.largest)
            elif iterations >= HARD:
                length /= 1.5
                held = f"a correction takes {iterations} Newton steps"
        self.branch.ended = f"the budget of {self.steps.most} points is used up"
        if held and length < SHORT * self.steps.largest:
            self.branch.ended += f"; steps are down to a length of {length:.2g}: {held}"
        else:
            moved = abs(float(along[-1])) * length
            self.branch.ended += (
                f"; a step of length {length:.2g} moves {self.branch.parameter} by a part of "
                f"{moved / max(abs(float(point.values[0])), moved):.1g}"
            )

    def _check_kept(self, shooting: Shooting, following: Point, found: _Found) -> None:
        """Raise OrbitError if a step leads off the automaton's orbits at no point that was found.

        A closest approach may come into being within a step, and be too close at its end.
        """
        if not self.reconnecting or found.lost or not self.branch.points[-1].orbit.admissible:
            return
        if defects(shooting, following):
            raise OrbitError("a margin is lost where none was watched", "take a shorter step")

    def _other_side(self, lost: SpecialPoint) -> tuple[tuple[Shooting, Point, Floats] | None, str]:
        """Return what `reconnect` finds at `lost`, or None and why it finds nothing."""
        try:
            return reconnect(lost.orbit, lost.monitor, self.branch.parameter), ""
        except (OrbitError, InvalidParameter) as error:
            return None, str(error)

    def _rename(
        self,
        met: SpecialPoint,
        located: list[SpecialPoint],
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
        self.branch.special_points.remove(met)
        if at_switch and changed:
            self.branch.special_points.append(met)
        elif changed:
            special = special_at(changed[0], met.orbit.shooting, met.orbit.point, met.direction)
            self.branch.special_points += [special] if special else []

    def _within_bounds(self, point: Point, along: Floats, length: float) -> float:
        """Shorten a step that would go far beyond a bound, where the model may end."""
        ahead = point.values[0] + length * along[-1]
        bound = self.high if along[-1] > 0.0 else self.low
        if self.low <= ahead <= self.high:
            return length
        return max(1.001 * (bound - point.values[0]) / along[-1], self.steps.smallest)

    def _append(self, shooting: Shooting, point: Point, along: Floats, piece: int) -> None:
        found = BranchPoint(make_orbit(shooting, point), float(point.values[0]), along, piece)
        self.branch.points.append(found)

    def _closed(self, shooting: Shooting, point: Point, along: Floats, length: float) -> bool:
        """Return whether the first point of the branch lies within the step from `point`."""
        first = self.branch.points[0]
        if len(self.branch.points) < 5 or first.orbit.segments != shooting.segments:
            return False
        here = np.append(point.unknowns, point.values[0])
        there = np.append(first.orbit.point.unknowns, first.value)
        position = float((there - here) @ along)
        if not 0.0 < position <= length or along @ first.direction < 0.5:
            return False
        # The branch is curved: what lies across the step counts, once it is corrected.
        again, _ = correct(shooting, here + position * along, along)
        passed = np.append(again.unknowns, again.values[0])
        return bool(np.abs(passed - there).max() < SAME)

    def _finish(self, shooting: Shooting, point: Point, beyond: Point, piece: int) -> None:
        """Put the last orbit at the bound, which lies between `point` and `beyond`."""
        bound = self.low if beyond.values[0] < self.low else self.high
        share = (bound - point.values[0]) / (beyond.values[0] - point.values[0])
        unknowns = point.unknowns + share * (beyond.unknowns - point.unknowns)
        last = shooting.solve(unknowns, np.array([bound]))
        onward = np.append(last.unknowns - point.unknowns, bound - point.values[0])
        self._append(shooting, last, tangent(last, onward), piece)

    def _locate(
        self,
        shooting: Shooting,
        point: Point,
        along: Floats,
        length: float,
        before: dict[Monitor, float],
        after: dict[Monitor, float],
    ) -> _Found:
        """Locate all sign changes of the last step, up to where the orbit is lost."""

        def crossed(after: dict[Monitor, float], reach: float) -> list[tuple[float, SpecialPoint]]:
            found = [
                locate(shooting, point, along, reach, monitor)
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
                key=lambda item: _rank(item[1]),
            )
            # Beyond, the test functions may jump, and what they say is of no interest.
            reach = max(lost[0][0] - COINCIDENT, 0.0)
            start = np.append(point.unknowns, point.values[0])
            here, _ = correct(shooting, start + reach * along, along)
            after = monitors(shooting, here, tangent(here, along))
        # Multipliers may stay on the unit circle.
        smooth = {
            m: v
            for m, v in after.items()
            if not m.role and not (m.kind == NEIMARK_SACKER and max(abs(v), abs(before[m])) < NOISE)
        }
        special_points = [special for _, special in crossed(smooth, reach)]
        if first is None:
            return _Found(special_points, None)
        return _Found([*special_points, first[1]], first[1])


def locate(
    shooting: Shooting, point: Point, along: Floats, length: float, monitor: Monitor
) -> tuple[float, SpecialPoint] | None:
    """Locate the zero of `monitor` within the step of `length` from `point` along `along`.

    Returns the position in the step with the point, or None if the sign change is no zero.

    Raises
    ------
    OrbitError
        If the step is too long for the zero to be found within it.
    """
    start = np.append(point.unknowns, point.values[0])
    last: list[tuple[Point, Floats]] = []

    def test(s: float) -> float:
        here, _ = correct(shooting, start + s * along, along)
        direction = tangent(here, along)
        last.append((here, direction))
        return monitors(shooting, here, direction)[monitor]

    try:
        position = brentq(test, 0.0, length, xtol=1e-14, rtol=1e-14)
        test(position)
    except (KeyError, ValueError) as error:
        raise OrbitError(f"a {monitor.kind} could not be located", "take a shorter step") from error
    special = special_at(monitor, shooting, *last[-1])
    return None if special is None else (position, special)


def special_at(
    monitor: Monitor, shooting: Shooting, here: Point, direction: Floats
) -> SpecialPoint | None:
    """Return what `here` is called, where `monitor` changes its sign; None if it is no zero.

    A test function may change its sign through infinity (an impact at zero speed), and the product
    of two real multipliers may pass one.
    """
    orbit = make_orbit(shooting, here)
    if monitor.kind == PERIOD_DOUBLING and np.abs(orbit.multipliers + 1.0).min() > NEAR:
        return None
    off_axis = orbit.multipliers[np.abs(orbit.multipliers.imag) > 1e-9]
    if monitor.kind == NEIMARK_SACKER and not np.any(np.abs(np.abs(off_axis) - 1.0) < NEAR):
        return None
    kind = PERIOD_DOUBLING if monitor.kind == FOLD and halves(orbit) else monitor.kind
    label, value = LABELS.get(kind, kind), float(here.values[0])
    return SpecialPoint(kind, label, value, orbit, direction, monitor)


def _rank(special: SpecialPoint) -> int:
    """Return which of several losses in one point to name and to act upon, the lowest first.

    Where a guard is touched at zero speed, what would follow on the event loses its margin in the
    same point. Where an event meets another one, its margin is zero at an end of a segment.
    """
    monitor = special.monitor
    if monitor.role == "approach":
        touch = closest(special.orbit.shooting, special.orbit.point, monitor.guard)
        return 1 if touch is not None and touch.inside else 3
    return 0 if monitor.role == "rate" else 2


def halves(orbit: PeriodicOrbit) -> bool:
    """Return whether an orbit is one of half the period, at its period doubling.

    The second half repeats the first, and of the multipliers over half the period it is -1, not +1,
    that is in play. There the branch of the doubled orbit turns back upon itself. With +1 it is a
    fold, of an orbit that is traversed twice.
    """
    half, odd = divmod(len(orbit.segments), 2)
    if odd or orbit.periods % 2:
        return False
    codes = [segment.code for segment in orbit.segments]
    if codes[:half] != codes[half:]:
        return False
    states, _ = orbit.shooting.unpack(orbit.point.unknowns)
    apart = float(np.abs(states[:half] - states[half:]).max())
    if apart >= SAME_HALVES * float(np.abs(states).max()):
        return False
    multipliers = np.linalg.eigvals(reduced(orbit.shooting, orbit.point, half))
    return bool(np.abs(multipliers + 1.0).min() < np.abs(multipliers - 1.0).min())


__all__ = ["FOLD", "GRAZING", "BranchPoint", "OrbitBranch", "SpecialPoint", "Steps", "follow"]
