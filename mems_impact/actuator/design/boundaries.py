"""The boundaries of a chart: curves where there are any, and crises by simulation."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mems_impact.actuator.design.chart import (
    AMPLITUDE,
    OFF,
    OMEGA,
    ON,
    SLIP,
    STEADY_FROM,
    STEADY_TO,
    Chart,
    Point,
)
from mems_impact.actuator.design.crisis import crisis
from mems_impact.actuator.design.estimates import pull_in_voltage
from mems_impact.actuator.design.thresholds import onset, steady, switching_off
from mems_impact.actuator.modes import BREAK_AWAY, GUARDS
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.analysis.curve import curve_of
from mems_impact.analysis.special import CodimensionTwo, GrazingType, SpecialPoint
from mems_impact.analysis.state import State
from mems_impact.analysis.threads import Watch, stoppable_threads
from mems_impact.continuation import first_impact
from mems_impact.continuation.branch import BranchEvent, BranchPoint, OrbitBranch, Steps, points_of
from mems_impact.continuation.curve import CurvePoint, OrbitCurve, follow_curve
from mems_impact.engines.options import Options
from mems_impact.errors import OrbitError
from mems_impact.orbits.family import Family
from mems_impact.orbits.finding import find_orbit

__all__ = ["Boundaries"]

CRISIS = "crisis"
SLIPS = GUARDS[BREAK_AWAY].name
COLUMNS = 9  # frequencies at which thresholds are looked for, if nothing is simulated to its end
FIRST = 0.1  # amplitude at which the orbit without impacts is found, in voltages of pull-in
SEPARATING = ("grazing-fold", "degenerate grazing")  # points between two types
ABOVE = 1e-3  # part of the amplitude by which the chaos is looked for above the fold
SAME = 1e-9  # part of the frequency within which two points are one, located twice
SLIDES = "raise mu_s, soften k, or take another range of omega"
TOUCH = 1e-3  # part of the amplitude within which two curves are taken to meet


@dataclass(frozen=True)
class _Place:
    """A point of a boundary, and that of a branch from which its curve may be followed."""

    omega: float
    amplitude: float
    kind: str
    event: BranchEvent | None

    @property
    def point(self) -> Point:
        return self.omega, self.amplitude


class Boundaries:
    """The parts of a chart, in the units of the numerics.

    Parameters
    ----------
    system : ActuatorSystem
    options : Options
    steps : Steps
    tell : callable
        Called with a line for every part.
    omega : tuple of float
        The range of the chart.
    """

    def __init__(
        self,
        system: ActuatorSystem,
        options: Options,
        steps: Steps,
        tell: Callable[[str], None],
        omega: tuple[float, float],
    ) -> None:
        self.system, self.steps, self.tell, self.omega = system, steps, tell, omega
        self.options = options
        self.family: Family = system.family(options)
        self.notes: list[str] = []
        # By frequency: the branch of the orbit without impacts on its way up, its points to come.
        self.met: dict[float, tuple[OrbitBranch, Iterator[BranchPoint]]] = {}
        self.special_points: tuple[CodimensionTwo, ...] = ()
        self.marks: set[float] = set()  # frequencies of these
        self.regions: list[tuple[GrazingType, float, float]] = []
        self.pieces: list[tuple[str, GrazingType | None, str, Sequence[Point]]] = []
        self.done = self.total = 0  # pieces that are whole, and that there will be
        self.pull_in = system.into(AMPLITUDE, pull_in_voltage(system.actuator))

    def make(self, crises: int, periods: int, workers: int) -> None:
        """Compute the parts, those last that take longest; `chart` gives what is done."""
        low, high = self.omega
        if SLIPS in (self._first(low)[1], self._first(high)[1]):
            self._thresholds(crises, periods, workers)
            return
        curve = self._grazings(low, high)
        marks = [s for s in curve.special_points if s.kind in SEPARATING]
        marks.sort(key=lambda s: s.values[1])
        self.special_points = tuple(
            sorted(
                (s for s in curve_of(self.system, curve).special_points if s.kind in SEPARATING),
                key=lambda s: s.values[OMEGA],
            )
        )
        self.marks = {s.values[1] for s in marks}
        edges = [low, *(s.values[1] for s in marks), high]
        self.total = 2 * (len(edges) - 1)
        simulated = []
        for left, right in pairwise(edges):
            slack = SAME * right
            inside = [p for p in curve.points if left - slack <= p.values[1] <= right + slack]
            ends = [(s.values[1], s.values[0]) for s in marks if s.values[1] in (left, right)]
            grazings = _joined(dict(_values(inside)), ends)
            region = self._type(left, right)
            self.tell(f"{self._at(left)} to {self._number(right)}: type {region.paper}")
            self.regions.append((region, left, right))
            for piece in self._followed(region, left, right, grazings):
                self.pieces.append(piece)
                self.done += 1
                if piece[:3] == (ON, region, "fold"):
                    simulated.append((region, left, right, piece[3]))
        for region, left, right, folds in simulated:
            found: list[Point] = []
            self.pieces.append((OFF, region, CRISIS, found))
            if crises:
                self._crises(left, right, folds, crises, periods, workers, found)
            self.done += 1

    def chart(self) -> Chart:
        """Return the chart of what is done."""
        order = {ON: 0, OFF: 1, SLIP: 2, STEADY_FROM: 3, STEADY_TO: 4}
        pieces = [(side, region, kind, tuple(sorted(points)))
                  for side, region, kind, points in self.pieces]  # fmt: skip
        pieces.sort(key=lambda piece: (order[piece[0]], piece[3][0] if piece[3] else (0.0, 0.0)))
        low, high = self.omega
        return Chart(
            system=self.system,
            omega=(self.system.out(OMEGA, low), self.system.out(OMEGA, high)),
            special_points=self.special_points,
            notes=tuple(self.notes),
            regions=tuple(self.regions),
            pieces=tuple(pieces),
        )

    def _special(
        self,
        omega: float,
        wanted: Callable[[BranchEvent], bool],
        watch: Watch | None = None,
    ) -> list[BranchEvent]:
        """Return what the orbit without impacts meets on the way up, at one frequency.

        The branch is followed no further than to the first point that is wanted.
        """
        if omega not in self.met:
            self.met[omega] = self._set_out(omega)
        branch, points = self.met[omega]
        while not any(map(wanted, branch.special_points)):
            point = next(points, None)
            if point is None:
                break
            if watch is not None:
                watch(point.value)
        return branch.special_points

    def _set_out(self, omega: float) -> tuple[OrbitBranch, Iterator[BranchPoint]]:
        """Return the branch at one frequency, empty, and its points."""
        amplitude = FIRST * self.pull_in
        family = self.family.at(amplitude=amplitude, omega=omega)
        here = self.system.changed(
            amplitude=self.system.out(AMPLITUDE, amplitude), omega=self.system.out(OMEGA, omega)
        )
        rest = here.instant(State(), family.problem())
        try:
            orbit = find_orbit(family, rest, active=(AMPLITUDE,))
        except OrbitError as error:
            where = f"{self._at(omega)} and {self._voltage(amplitude)}"
            raise OrbitError(f"at {where}: {error.reason}", SLIDES) from error
        branch, low = OrbitBranch(AMPLITUDE), 0.5 * amplitude
        return branch, points_of(branch, orbit, low=low, high=self.pull_in, steps=self.steps)

    def _grazings(self, low: float, high: float) -> OrbitCurve:
        """Return the grazing curve of the orbit without impacts."""
        for end, direction in ((high, -1.0), (low, 1.0)):
            touching = [s for s in self._special(end, _grazes) if _grazes(s)]
            if touching:
                self.tell("the grazing curve of the orbit without impacts")
                curve = self._curve(touching[0], low, high, direction)
                reached = curve.points[-1].values[1] if curve.points else end
                if abs(reached - (low if direction < 0.0 else high)) > 1e-9:
                    self.notes.append(f"the grazing curve: {curve.ended}")
                return curve
        raise OrbitError(
            f"{self._not_grazing(low)}, and {self._not_grazing(high)}", self._remedy(low, high)
        )

    def _first(self, omega: float) -> tuple[float, str]:
        """Return the amplitude at which frame or block begin to move at one frequency, and how."""

        def wanted(special: BranchEvent) -> bool:
            return _grazes(special) or _slips(special)

        try:
            met = [special for special in self._special(omega, wanted) if wanted(special)]
        except OrbitError:  # the frame moves at the smallest voltage
            return FIRST * self.pull_in, SLIPS
        return (met[0].value, met[0].kind) if met else (self.pull_in, "")

    def _thresholds(self, crises: int, periods: int, workers: int) -> None:
        """Find where the frame slips, and the block strikes or not, at equal distances."""
        omegas = np.linspace(*self.omega, crises or COLUMNS).tolist()
        found: dict[str, list[_Place]] = {}
        self.total, most = len(omegas), 1.5 * self.system.out(AMPLITUDE, self.pull_in)

        def one(omega: float) -> Iterator[tuple[str, _Place]]:
            first, kind = self._first(omega)
            if kind == SLIPS:
                yield SLIP, _Place(omega, first, kind, self._slip(omega))
            here = self.system.changed(omega=self.system.out(OMEGA, omega))
            begin = self.system.out(AMPLITUDE, first)
            try:
                on, kind, special, state = onset(here, begin, most, watch)
                yield ON, self._place(omega, on, kind, special)
                if crises:
                    off = min(on, switching_off(here, on, state, periods, watch))
                    yield OFF, self._place(omega, off, CRISIS, None)
                for side, end, what, special in steady(here, on, most, state):
                    yield side, self._place(omega, end, what, special)
            except OrbitError as error:
                self.notes.append(f"at {self._at(omega)}: {error}")

        self.tell(f"slip and impacts, at {len(omegas)} frequencies")
        with stoppable_threads(workers) as (threads, watch):
            for column in threads.map(lambda omega: [*one(omega)], omegas):
                for side, place in column:
                    found.setdefault(side, []).append(place)
                self.done += 1
        for side, places in found.items():
            self.tell(f"the curves of {side}")
            for kind, points in self._joined_by_curves(places):
                self.pieces.append((side, None, kind, points))

    def _slip(self, omega: float) -> BranchEvent | None:
        """Return where the frame begins to move on the branch at one frequency, if it has any."""
        if omega not in self.met:
            return None
        return next((s for s in self._special(omega, _slips) if _slips(s)), None)

    def _place(
        self, omega: float, amplitude: float, kind: str, special: SpecialPoint | None
    ) -> _Place:
        event = special.without_impact if special is not None else None
        kind = kind if special is None else special.kind
        return _Place(omega, self.system.into(AMPLITUDE, amplitude), kind, event)

    def _joined_by_curves(self, places: list[_Place]) -> Iterator[tuple[str, tuple[Point, ...]]]:
        """Give the places at ascending frequencies, by curves where these lead to the next one."""
        alone: dict[str, list[Point]] = {}
        points: list[Point] = []
        for place, following in pairwise([*places, None]):
            assert place is not None
            points = points or [place.point]
            between = self._between(place, following) if following is not None else None
            if between is not None and following is not None:
                points += [*between, following.point]
                continue
            if len(points) > 1:
                yield place.kind, tuple(points)
            else:
                alone.setdefault(place.kind, []).extend(points)
            points = []
        for kind, found in alone.items():
            yield kind, tuple(found)

    def _between(self, left: _Place, right: _Place) -> list[Point] | None:
        """Return the points of the curve from one place to another, None if it does not lead there.

        It is followed from either of them.
        """
        if left.kind != right.kind:
            return None
        for begin, end in ((left, right), (right, left)):
            if begin.event is None:
                continue
            way = 1.0 if end is right else -1.0
            try:
                curve = self._curve(begin.event, left.omega, right.omega, way)
            except OrbitError:
                continue
            points = [(p.values[1], p.values[0]) for p in curve.points if p.orbit.admissible]
            risen = all(way * (b[0] - a[0]) > 0.0 for a, b in pairwise(points))
            if len(points) < len(curve.points) or not points or not risen:
                continue
            omega, amplitude = points[-1]
            same = abs(omega - end.omega) <= SAME * end.omega
            if same and abs(amplitude - end.amplitude) < TOUCH * end.amplitude:
                return sorted(p for p in points if left.omega < p[0] < right.omega)
        return None

    def _remedy(self, *omegas: float) -> str:
        """Say what lets the orbit without impacts graze that does not at any of `omegas`."""
        return "lower the damping c, or take another range of omega"

    def _grazing(self, omega: float) -> BranchEvent:
        """Return where the orbit without impacts grazes; OrbitError if it does not."""
        for special in self._special(omega, _grazes):
            if _grazes(special):
                return special
        raise OrbitError(self._not_grazing(omega), "take another range of omega")

    def _not_grazing(self, omega: float) -> str:
        """Say what the orbit without impacts meets at a frequency at which it does not graze."""
        all_of_them = self._special(omega, lambda special: False)
        met = [f"a {s.kind} at {self.system.out(AMPLITUDE, s.value):.6g}" for s in all_of_them]
        return (
            f"at {self._at(omega)} the orbit without impacts does not graze up to pull-in at "
            f"{self._voltage(self.pull_in)} (it meets {', '.join(met) or 'nothing'})"
        )

    def _voltage(self, amplitude: float) -> str:
        """Return an amplitude in words, in the user's units."""
        value = self.system.out(AMPLITUDE, amplitude)
        return f"{self.system.label(AMPLITUDE)} = {value:.6g}"

    def _number(self, omega: float) -> str:
        return f"{self.system.out(OMEGA, omega):.9g}"

    def _at(self, omega: float) -> str:
        """Return a frequency in words, in the user's units."""
        return f"{self.system.label(OMEGA)} = {self._number(omega)}"

    def _curve(self, special: BranchEvent, low: float, high: float, direction: float) -> OrbitCurve:
        return follow_curve(
            special, AMPLITUDE, OMEGA, low=low, high=high, direction=direction, steps=self.steps
        )

    def _type(self, left: float, right: float) -> GrazingType:
        """Return the type between two points of codimension two, where they are far."""
        middle = 0.5 * (left + right)
        touching = self._grazing(middle)
        try:
            return GrazingType(first_impact.grazing_type(touching.orbit, touching.monitor))
        except OrbitError as error:
            where = f"{self._at(middle)} and {self._voltage(touching.value)}"
            raise OrbitError(f"at {where}: {error.reason}", error.remedy) from error

    def _followed(
        self, region: GrazingType, left: float, right: float, grazings: tuple[Point, ...]
    ) -> Iterator[tuple[str, GrazingType, str, tuple[Point, ...]]]:
        """Give the boundaries of one type that are curves: all but a crisis."""
        if region == GrazingType.CONTINUOUS:
            yield ON, region, "grazing", grazings
            yield OFF, region, "grazing", grazings
        elif region == GrazingType.JUMP:
            yield ON, region, "grazing", grazings
            folds = self._folds(left, right, without_impact=False, ends=grazings)
            yield OFF, region, "fold", folds
        else:
            folds = self._folds(left, right, without_impact=True, ends=grazings)
            yield ON, region, "fold", folds

    def _folds(
        self,
        left: float,
        right: float,
        *,
        without_impact: bool,
        ends: tuple[Point, ...],
    ) -> tuple[Point, ...]:
        """Return the fold curve of the orbit with or without impacts between two frequencies."""
        middle = 0.5 * (left + right)
        what = f"the fold curve of the orbit with{'out' if without_impact else ''} impacts"
        self.tell(what)

        def wanted(special: BranchEvent) -> bool:
            return special.kind == "fold" and (not special.orbit.impacts) == without_impact

        folds = [special for special in self._special(middle, wanted) if wanted(special)]
        if not folds:
            self.notes.append(f"{what}: none at {self._at(middle)}")
            return ()
        ending = [end for end in ends if end[0] in self.marks]
        points: list[CurvePoint] = []
        for direction, bound in ((-1.0, left), (1.0, right)):
            # A curve that ends in the grazing curve does so at a point that is known.
            at_mark = [end for end in ending if end[0] == bound]
            goal = bound + 0.02 * direction * (right - left) * len(at_mark)
            curve = self._curve(folds[0], min(middle, goal), max(middle, goal), direction)
            here = [p for p in curve.points if p.orbit.admissible]
            points += here
            reached = here[-1].values[1] if here else middle
            if not at_mark and abs(reached - bound) > 1e-9:
                self.notes.append(f"{what} ends at {self._at(reached)}: {curve.ended}")
        values = dict(_values(points))
        touching = [end for end in ending if self._ends_in_grazing(end, values)]
        return _joined(values, touching)

    def _ends_in_grazing(self, end: tuple[float, float], values: dict[float, float]) -> bool:
        """Return whether a curve comes to the end of the grazing curve."""
        nearest = min(values, key=lambda omega: abs(omega - end[0]))
        return abs(values[nearest] - end[1]) < TOUCH * abs(end[1])

    def _crises(
        self,
        left: float,
        right: float,
        folds: tuple[Point, ...],
        crises: int,
        periods: int,
        workers: int,
        found: list[Point],
    ) -> None:
        """Simulate the crisis at equal distances, each begun just above the fold, into `found`."""
        if not folds:
            return
        found += [end for end in folds if end[0] in self.marks]
        # Where the type ends in a point of codimension two, the two boundaries meet.
        known = len(self.marks & {left, right})
        omegas = np.linspace(left, right, crises + known)
        omegas = omegas[[i for i, w in enumerate(omegas) if w not in self.marks]]
        out = self.system.out

        def one(omega: float) -> Point | str:
            try:
                specials = self._special(omega, lambda special: special.kind == "fold", watch)
                met = [s.value for s in specials if s.kind == "fold"]
                if not met:
                    raise OrbitError("no fold to begin at", "take another range of omega")
                fold = met[0]
                here = self.system.changed(omega=out(OMEGA, omega))
                value = crisis(
                    here.actuator,
                    here.drive,
                    below=out(AMPLITUDE, fold),
                    begin=out(AMPLITUDE, fold * (1.0 + ABOVE)),
                    width=0.2 * out(AMPLITUDE, fold),
                    periods=periods,
                    watch=watch,
                )
                return omega, self.system.into(AMPLITUDE, value)
            except OrbitError as error:
                return f"crisis at {self._at(omega)}: {error}"

        at = "1 frequency" if crises == 1 else f"{crises} frequencies"
        self.tell(f"the crisis, simulated at {at}")
        with stoppable_threads(workers) as (threads, watch):
            for result in threads.map(one, omegas.tolist()):
                if isinstance(result, str):
                    self.notes.append(result)
                else:
                    found.append(result)


def _grazes(special: BranchEvent) -> bool:
    return special.label == "G" and special.monitor.role == "approach"


def _slips(special: BranchEvent) -> bool:
    return special.kind == SLIPS


def _values(points: list[CurvePoint]) -> tuple[Point, ...]:
    """Return (omega, amplitude) in ascending omega."""
    return tuple(sorted({p.values[1]: p.values[0] for p in points}.items()))


def _joined(
    values: dict[float, float], ends: list[tuple[float, float]]
) -> tuple[tuple[float, float], ...]:
    """Return a boundary with its ends, each in place of what was located next to it.

    A point in which two curves end is located on both, at numbers that differ by rounding.
    """
    kept = {w: a for w, a in values.items() if all(abs(w - end) > SAME * end for end, _ in ends)}
    return tuple(sorted({**kept, **dict(ends)}.items()))
