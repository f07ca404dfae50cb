"""Construction of operating charts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from mems_impact._util.progress import Watch
from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.automaton import BREAK_AWAY, GUARDS, SLIP_END
from mems_impact.actuator.design.estimates import contact_voltage, pull_in_charge
from mems_impact.actuator.design.operating_chart import (
    AMPLITUDE,
    OFF,
    ON,
    SLIP,
    STEADY_FROM,
    STEADY_TO,
    OperatingChart,
    Point,
)
from mems_impact.actuator.design.thresholds import (
    IMPACT_OFFSET_RATIO,
    locate_crisis,
    onset,
    steady,
    switching_off,
)
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.drives.sine import Sine
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.actuator.terms.base import Term
from mems_impact.analysis.curve import curve_of
from mems_impact.analysis.orbit import ORBIT_OPTIONS
from mems_impact.analysis.special_points import CodimensionTwo, GrazingType, SpecialPoint
from mems_impact.continuation import grazing
from mems_impact.continuation.arclength import StepControl
from mems_impact.continuation.branch import OrbitBranch, OrbitCurve, OrbitEvent, OrbitPoint
from mems_impact.continuation.orbit_branch import points_of
from mems_impact.continuation.orbit_curve import follow_curve
from mems_impact.continuation.test_functions import ClosestApproachTest
from mems_impact.errors import Interrupted, InvalidParameter, OrbitError
from mems_impact.integrators.options import Options
from mems_impact.orbits.family import Family
from mems_impact.orbits.orbit_search import find_periodic_orbit
from mems_impact.studies.engine.executors import stoppable_threads
from mems_impact.systems.state import State, is_number, whole

CRISIS = "crisis"
SLIPS = GUARDS[BREAK_AWAY].name
FRICTION_EVENTS = (SLIPS, GUARDS[SLIP_END].name)
FREQUENCY_COLUMNS = 9  # default number of frequencies of thresholds
START_AMPLITUDE_RATIO = 0.1  # amplitude of the first orbit without impacts, relative to pull-in,
STARTS = 3  # and that of the next, relative to the one before, while the frame slips on it
SEPARATING = ("grazing-fold", "degenerate grazing")  # points between two types
SAME_FREQUENCY_RTOL = 1e-9  # largest relative difference of equal frequencies
SLIDES = "raise mu_s, soften k, or take another range of frequency"
TOUCH = 1e-3  # largest relative difference of amplitudes at a common point of two curves


@dataclass(frozen=True)
class _Place:
    """A point of a boundary, and the special point from which its curve can be continued."""

    omega: float
    amplitude: float
    kind: str
    event: OrbitEvent | None

    @property
    def point(self) -> Point:
        return self.omega, self.amplitude


class ChartBuilder:
    """Computes the parts of a chart, in scaled units.

    `report` is called with a line of text for every part; `omega` is the range of the chart, of
    omega or frequency.
    """

    def __init__(
        self,
        system: ActuatorSystem,
        options: Options,
        steps: StepControl,
        report: Callable[[str], None],
        omega: tuple[float, float],
    ) -> None:
        self.system, self.steps, self.report, self.omega = system, steps, report, omega
        self.name = system.frequency_parameter
        self.options = options
        self.family: Family = system.family(options)
        self.notes: list[str] = []
        # By frequency: the branch of the orbit without impacts, and the iterator of its points.
        self.met: dict[float, tuple[OrbitBranch, Iterator[OrbitPoint]]] = {}
        self.special_points: tuple[CodimensionTwo, ...] = ()
        self.marks: set[float] = set()  # frequencies of these
        self.regions: list[tuple[GrazingType, float, float]] = []
        self.pieces: list[tuple[str, GrazingType | None, str, Sequence[Point]]] = []
        self.done = self.total = 0  # number of completed parts, and of all parts
        compute = pull_in_charge if system.drive_unit == "C" else contact_voltage
        self.pull_in = system.units.into(AMPLITUDE, compute(system.actuator))

    def make(self, crises: int, columns: int, periods: int, workers: int) -> None:
        """Compute the parts, the slowest last; `chart` returns the completed ones."""
        low, high = self.omega
        if SLIPS in (self._first(low)[1], self._first(high)[1]):
            self._thresholds(columns, periods, workers)
            return
        curve = self._grazings(low, high)
        marks = [s for s in curve.special_points if s.kind in SEPARATING]
        marks.sort(key=lambda s: s.values[1])
        edges = [low, *(s.values[1] for s in marks), high]
        if any(self._first(0.5 * (left + right))[1] == SLIPS for left, right in pairwise(edges)):
            self.notes.clear()  # of the curve of grazings, which this replaces
            self._thresholds(columns, periods, workers)
            return
        try:
            types = [self._type(left, right) for left, right in pairwise(edges)]
        except OrbitError as error:
            # As where the frame, once it slips, slips on: sliding friction holds less than the
            # spring or the electrodes pull.
            self.notes[:] = [f"no types: {error}"]
            self._thresholds(columns, periods, workers)
            return
        self.special_points = tuple(
            sorted(
                (s for s in curve_of(self.system, curve).special_points if s.kind in SEPARATING),
                key=lambda s: s.values[self.name],
            )
        )
        self.marks = {s.values[1] for s in marks}
        self.total = 2 * (len(edges) - 1)
        simulated = []
        for region, (left, right) in zip(types, pairwise(edges), strict=True):
            slack = SAME_FREQUENCY_RTOL * right
            reached = [curve.values(each)[::-1] for each in curve.points]
            inside = [p for p in reached if left - slack <= p[0] <= right + slack]
            ends = [(s.values[1], s.values[0]) for s in marks if s.values[1] in (left, right)]
            grazings = _joined(dict(sorted(inside)), ends)
            self.report(f"{self._at(left)} to {self._number(right)}: type {region.paper}")
            self.regions.append((region, left, right))
            for piece in self._followed(region, left, right, grazings):
                self.pieces.append(piece)
                self.done += 1
                if piece[:3] == (ON, region, "fold"):
                    simulated.append((region, left, right, piece[3]))
        for region, left, right, folds in simulated:
            points: list[Point] = []
            self.pieces.append((OFF, region, CRISIS, points))
            if crises:
                self._crises(left, right, folds, crises, periods, workers, points)
            self.done += 1

    def chart(self) -> OperatingChart:
        """Return the chart of the completed parts."""
        order = {ON: 0, OFF: 1, SLIP: 2, STEADY_FROM: 3, STEADY_TO: 4}
        pieces = [(side, region, kind, tuple(sorted(points)))
                  for side, region, kind, points in self.pieces]  # fmt: skip
        pieces.sort(key=lambda piece: (order[piece[0]], piece[3][0] if piece[3] else (0.0, 0.0)))
        low, high = self.omega
        return OperatingChart(
            system=self.system,
            frequencies=(
                self.system.units.out(self.name, low),
                self.system.units.out(self.name, high),
            ),
            special_points=self.special_points,
            notes=tuple(self.notes),
            regions=tuple(self.regions),
            pieces=tuple(pieces),
        )

    def _special(
        self,
        omega: float,
        wanted: Callable[[OrbitEvent], bool],
        watch: Watch | None = None,
    ) -> list[OrbitEvent]:
        """Return the wanted special points of the orbit without impacts at one frequency.

        The branch is continued up to the first of them.
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
        return list(filter(wanted, branch.special_points))

    def _set_out(self, omega: float) -> tuple[OrbitBranch, Iterator[OrbitPoint]]:
        """Return the branch at one frequency, empty, and its points."""
        for amplitude in (self.pull_in * START_AMPLITUDE_RATIO**i for i in range(1, 1 + STARTS)):
            family = self.family.at(**{AMPLITUDE: amplitude, self.name: omega})
            start_system = self._system_at(omega).changed(
                amplitude=self.system.units.out(AMPLITUDE, amplitude)
            )
            rest = start_system.state_space.instant(State(), family.problem())
            try:
                orbit = find_periodic_orbit(family, rest, active=(AMPLITUDE,))
            except OrbitError as error:
                reason = error.reason
                continue
            guards = family.automaton.guards
            codes = [each.code for each in orbit.segments if each.code < len(guards)]
            if any(guards[code].name in FRICTION_EVENTS for code in codes if code >= 0):
                reason = "the frame slips"
                continue
            branch, low = OrbitBranch(AMPLITUDE), 0.5 * amplitude
            # Only its special points are shown, so that no short steps lead away from its start.
            steps = replace(self.steps, initial_step=self.steps.max_step)
            return branch, points_of(branch, orbit, low=low, high=self.pull_in, steps=steps)
        location = f"{self._at(omega)} and {self._voltage(amplitude)}"
        raise OrbitError(f"at {location}: {reason}", SLIDES)

    def _grazings(self, low: float, high: float) -> OrbitCurve:
        """Return the grazing curve of the orbit without impacts."""
        for end, direction in ((high, -1.0), (low, 1.0)):
            touching = self._special(end, _grazes)
            if touching:
                self.report("the grazing curve of the orbit without impacts")
                curve = self._curve(touching[0], low, high, direction)
                reached = curve.values(curve.points[-1])[1] if curve.points else end
                if abs(reached - (low if direction < 0.0 else high)) > 1e-9:
                    self.notes.append(f"the grazing curve: {curve.ended}")
                return curve
        raise OrbitError(
            f"{self._not_grazing(low)}, and {self._not_grazing(high)}",
            "lower the damping c, or take another range of frequency",
        )

    def _first(self, omega: float) -> tuple[float, str]:
        """Return the amplitude of the first slip or impact at one frequency, and its kind."""

        def wanted(special: OrbitEvent) -> bool:
            return _grazes(special) or _slips(special)

        try:
            passed = self._special(omega, wanted)
        except OrbitError:  # the frame moves at the smallest voltage
            return START_AMPLITUDE_RATIO**STARTS * self.pull_in, SLIPS
        return (passed[0].value, passed[0].kind) if passed else (self.pull_in, "")

    def _thresholds(self, columns: int, periods: int, workers: int) -> None:
        """Locate the thresholds of slip and impacts at equally spaced frequencies."""
        omegas = np.linspace(*self.omega, columns or FREQUENCY_COLUMNS).tolist()
        located: dict[str, list[_Place]] = {}
        self.total, highest = len(omegas), 1.5 * self.system.units.out(AMPLITUDE, self.pull_in)

        def one(omega: float) -> Iterator[tuple[str, _Place]]:
            first, kind = self._first(omega)
            if kind == SLIPS:
                yield SLIP, _Place(omega, first, kind, self._slip(omega))
            system = self._system_at(omega)
            lowest = max(first, START_AMPLITUDE_RATIO * self.pull_in)  # of the search for impacts
            begin = self.system.units.out(AMPLITUDE, lowest)
            try:
                on, kind, special, state = onset(system, begin, highest, watch)
                yield ON, self._place(omega, on, kind, special)
                if columns:
                    off = min(on, switching_off(system, on, state, periods, watch))
                    yield OFF, self._place(omega, off, CRISIS, None)
                for side, end, kind_of_end, special in steady(system, on, highest, state, watch):
                    yield side, self._place(omega, end, kind_of_end, special)
            except OrbitError as error:
                self.notes.append(f"at {self._at(omega)}: {error}")

        self.report(f"slip and impacts, at {len(omegas)} frequencies")
        try:
            with stoppable_threads(workers) as (threads, watch):
                for column in threads.map(lambda omega: [*one(omega)], omegas):
                    for side, point in column:
                        located.setdefault(side, []).append(point)
                    self.done += 1
        except KeyboardInterrupt:
            for side, same_side in located.items():
                for kind in dict.fromkeys(point.kind for point in same_side):
                    selected = [point.point for point in same_side if point.kind == kind]
                    self.pieces.append((side, None, kind, selected))
            raise
        for side, same_side in located.items():
            self.report(f"the curves of {side}")
            for kind, points in self._joined_by_curves(same_side):
                self.pieces.append((side, None, kind, points))

    def _slip(self, omega: float) -> OrbitEvent | None:
        """Return the onset of slip on the branch at one frequency, if any."""
        if omega not in self.met:
            return None
        return next(iter(self._special(omega, _slips)), None)

    def _place(
        self, omega: float, amplitude: float, kind: str, special: SpecialPoint | None
    ) -> _Place:
        event = special.without_impact if special is not None else None
        kind = kind if special is None else special.kind
        return _Place(omega, self.system.units.into(AMPLITUDE, amplitude), kind, event)

    def _joined_by_curves(self, ends: list[_Place]) -> Iterator[tuple[str, tuple[Point, ...]]]:
        """Yield the points at ascending frequencies, joined by curves where these connect them."""
        alone: dict[str, list[Point]] = {}
        points: list[Point] = []
        for end, following in pairwise([*ends, None]):
            assert end is not None
            points = points or [end.point]
            between = self._between(end, following) if following is not None else None
            if between is not None and following is not None:
                points += [*between, following.point]
                continue
            if len(points) > 1:
                yield end.kind, tuple(points)
            else:
                alone.setdefault(end.kind, []).extend(points)
            points = []
        for kind, isolated in alone.items():
            yield kind, tuple(isolated)

    def _between(self, left: _Place, right: _Place) -> list[Point] | None:
        """Return the curve from one point to another, None if it does not connect them.

        The curve is continued from either point.
        """
        if left.kind != right.kind:
            return None
        for begin, end in ((left, right), (right, left)):
            if begin.event is None:
                continue
            direction = 1.0 if end is right else -1.0
            try:
                curve = self._curve(begin.event, left.omega, right.omega, direction)
            except OrbitError:
                continue
            points = [curve.values(each)[::-1] for each in curve.points if each.admissible]
            risen = all(direction * (b[0] - a[0]) > 0.0 for a, b in pairwise(points))
            if len(points) < len(curve.points) or not points or not risen:
                continue
            omega, amplitude = points[-1]
            same = abs(omega - end.omega) <= SAME_FREQUENCY_RTOL * end.omega
            if same and abs(amplitude - end.amplitude) < TOUCH * end.amplitude:
                slack = SAME_FREQUENCY_RTOL * right.omega  # within it, a point is an end itself
                return sorted(p for p in points if slack < p[0] - left.omega
                              and slack < right.omega - p[0])  # fmt: skip
        return None

    def _grazing(self, omega: float) -> OrbitEvent:
        """Return the grazing of the orbit without impacts; OrbitError if there is none."""
        if grazings := self._special(omega, _grazes):
            return grazings[0]
        raise OrbitError(self._not_grazing(omega), "take another range of frequency")

    def _not_grazing(self, omega: float) -> str:
        """Return a description of the special points at a frequency without grazing."""
        self._special(omega, lambda special: False)  # up to the end
        listed = [
            f"a {s.kind} at {self.system.units.out(AMPLITUDE, s.value):.6g}"
            for s in self.met[omega][0].special_points
        ]
        return (
            f"at {self._at(omega)} the orbit without impacts does not graze up to static contact "
            f"at {self._voltage(self.pull_in)} (special points: {', '.join(listed) or 'none'})"
        )

    def _voltage(self, amplitude: float) -> str:
        """Return an amplitude as text, in the system's units."""
        value = self.system.units.out(AMPLITUDE, amplitude)
        return f"{self.system.units.label(AMPLITUDE)} = {value:.6g}"

    def _system_at(self, omega: float) -> ActuatorSystem:
        return self.system.changed(**{self.name: self.system.units.out(self.name, omega)})

    def _number(self, omega: float) -> str:
        return f"{self.system.units.out(self.name, omega):.9g}"

    def _at(self, omega: float) -> str:
        """Return a frequency as text, in the system's units."""
        return f"{self.system.units.label(self.name)} = {self._number(omega)}"

    def _curve(self, special: OrbitEvent, low: float, high: float, direction: float) -> OrbitCurve:
        return follow_curve(
            special, AMPLITUDE, self.name, low=low, high=high, direction=direction, steps=self.steps
        )

    def _type(self, left: float, right: float) -> GrazingType:
        """Return the type midway between two points of codimension two."""
        middle = 0.5 * (left + right)
        touching = self._grazing(middle)
        try:
            return GrazingType(grazing.grazing_type(touching.solution, touching.monitor))
        except OrbitError as error:
            location = f"{self._at(middle)} and {self._voltage(touching.value)}"
            raise OrbitError(f"at {location}: {error.reason}", error.remedy) from error

    def _followed(
        self, region: GrazingType, left: float, right: float, grazings: tuple[Point, ...]
    ) -> Iterator[tuple[str, GrazingType, str, tuple[Point, ...]]]:
        """Compute the boundaries of one type except a crisis."""
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
        subject = f"the fold curve of the orbit with{'out' if without_impact else ''} impacts"
        self.report(subject)

        def wanted(special: OrbitEvent) -> bool:
            return special.kind == "fold" and (not special.solution.impacts) == without_impact

        folds = self._special(middle, wanted)
        if not folds:
            self.notes.append(f"{subject}: none at {self._at(middle)}")
            return ()
        ending = [end for end in ends if end[0] in self.marks]
        points: list[Point] = []
        for direction, bound in ((-1.0, left), (1.0, right)):
            # A curve that ends on the grazing curve does so at a known point.
            at_mark = [end for end in ending if end[0] == bound]
            goal = bound + 0.02 * direction * (right - left) * len(at_mark)
            curve = self._curve(folds[0], min(middle, goal), max(middle, goal), direction)
            admissible = [curve.values(each)[::-1] for each in curve.points if each.admissible]
            points += admissible
            reached = admissible[-1][0] if admissible else middle
            if not at_mark and abs(reached - bound) > 1e-9:
                self.notes.append(f"{subject} ends at {self._at(reached)}: {curve.ended}")
        values = dict(sorted(points))
        touching = [end for end in ending if self._ends_in_grazing(end, values)]
        return _joined(values, touching)

    def _ends_in_grazing(self, end: tuple[float, float], values: dict[float, float]) -> bool:
        """Return whether a curve ends at the end of the grazing curve."""
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
        points: list[Point],
    ) -> None:
        """Locate the crisis at equally spaced frequencies, from just above the fold."""
        if not folds:
            return
        points += [end for end in folds if end[0] in self.marks]
        # The two boundaries meet where the type ends in a point of codimension two.
        known_ends = len(self.marks & {left, right})
        omegas = np.linspace(left, right, crises + known_ends)
        omegas = omegas[[i for i, w in enumerate(omegas) if w not in self.marks]]
        out = self.system.units.out

        def one(omega: float) -> Point | str:
            try:
                found = self._special(omega, lambda special: special.kind == "fold", watch)
                if not found:
                    raise OrbitError("no fold to begin at", "take another range of frequency")
                fold = found[0].value
                system = self._system_at(omega)
                value = locate_crisis(
                    system.actuator,
                    system.drive,
                    amplitude=out(AMPLITUDE, fold),
                    begin=out(AMPLITUDE, fold * (1.0 + IMPACT_OFFSET_RATIO)),
                    width=0.2 * out(AMPLITUDE, fold),
                    periods=periods,
                    watch=watch,
                )
                return omega, self.system.units.into(AMPLITUDE, value)
            except OrbitError as error:
                return f"crisis at {self._at(omega)}: {error}"

        at = "1 frequency" if crises == 1 else f"{crises} frequencies"
        self.report(f"the crisis, simulated at {at}")
        with stoppable_threads(workers) as (threads, watch):
            for result in threads.map(one, omegas.tolist()):
                if isinstance(result, str):
                    self.notes.append(result)
                else:
                    points.append(result)


def _grazes(special: OrbitEvent) -> bool:
    return special.label == "G" and isinstance(special.monitor, ClosestApproachTest)


def _slips(special: OrbitEvent) -> bool:
    return special.kind == SLIPS


def _joined(
    values: dict[float, float], ends: list[tuple[float, float]]
) -> tuple[tuple[float, float], ...]:
    """Return a boundary with its ends, each in place of a point located next to it.

    A common end point of two curves is located on both, with a difference by rounding.
    """
    distinct = {
        w: a
        for w, a in values.items()
        if all(abs(w - end) > SAME_FREQUENCY_RTOL * end for end, _ in ends)
    }
    return tuple(sorted({**distinct, **dict(ends)}.items()))


BAND = (0.88, 1.02)  # range of the forcing frequency by default, in the block's own: as in Fig. 7


def operating_chart(
    actuator: Actuator,
    drive: Drive | None = None,
    *,
    omega: tuple[float | None, float | None] | None = None,
    frequency: tuple[float | None, float | None] | None = None,
    crises: int = 7,
    columns: int | None = None,
    periods: int = 2000,
    steps: StepControl = StepControl(initial_step=0.01),  # noqa: B008 - immutable
    options: Options = ORBIT_OPTIONS,
    workers: int | None = None,
    progress: bool | Callable[[str], None] = False,
) -> OperatingChart:
    """Compute the on- and off-voltages of a device over the frequency.

    The grazing curve of the orbit without impacts is continued over the whole range. Its points of
    codimension two divide the range, and the normal form determines the type of each part. Type I
    switches on at the grazing and off at the fold of the orbit with impacts; type II switches on
    and off at the grazing; type III switches on at the fold of the orbit without impacts and off in
    a crisis of the chaotic attractor, which is located by simulation.

    If the spring moves the frame before the block strikes, or keeps the frame slipping after a weak
    impact, there are no types. The chart then contains, at `columns` frequencies, the voltage of
    the first slip; the voltage of the first impact, on the orbit with slip; the voltage below which
    impacts cease, by simulation; and the window of the period-1 orbit with impacts, bounded by
    period doublings, folds or grazings.

    Parameters
    ----------
    actuator : Actuator
    drive : Drive, optional
        A waveform with ``amplitude`` and ``omega``, whose values are ignored; a sine by default.
    omega : tuple of float, optional
        Range of the angular frequency [rad/s]; by default a band about the resonance of the block.
        In this band the force repeats 0.88 to 1.02 times in ``2 pi sqrt(m2/k)``; for the device of
        the paper this is the range of Fig. 7, 0.44 to 0.51. The default may replace either end.
    frequency : tuple of float, optional
        Range of the frequency [Hz], in place of `omega`. Tables and figures are then in hertz, as
        for a drive given by its frequency.
    crises : int, optional
        Number of frequencies of type III at which the crisis is simulated, >= 0.
    columns : int, optional
        Number of frequencies at which the voltages are found if there are no types; by default
        `crises`; 0 gives 9 frequencies without the off-voltage.
    periods : int, optional
        Forcing periods for which an attractor must persist in these simulations.
    steps : StepControl, optional
        Steps of the continuation.
    options : Options, optional
        Options of the integration; by default those of `find_orbit`.
    workers : int, optional
        Threads for the simulations; by default one for each, up to 4.
    progress : bool or callable, optional
        True: a line on standard error for each part. A function is called with the line.

    Returns
    -------
    OperatingChart
        The chart; its ``notes`` list parts that could not be computed.

    Raises
    ------
    InvalidParameter
        If an argument is out of range, or the device has compliant stoppers or a term that depends
        on the sign of the voltage.
    OrbitError
        If the orbit without impacts has neither a grazing nor a slip at either end of the range;
        the message lists its special points.
    Interrupted
        On Ctrl-C; ``partial`` is the chart of the completed parts.

    See Also
    --------
    OperatingChart, plot_chart, continue_curve, GrazingType

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> chart = mi.operating_chart(actuator, drive, omega=(0.478, 0.495), crises=0)
    >>> chart.types["type"].tolist()
    ['III', 'II', 'I']
    """
    drive = Sine(amplitude=0.0, omega=1.0) if drive is None else drive
    if frequency is not None:
        if omega is not None:
            raise InvalidParameter("frequency", frequency, "omitted if omega is given")
        drive = drive.replace(frequency=1.0)
    elif omega is not None:
        drive = drive.replace(omega=1.0)
    system = ActuatorSystem(actuator, drive)
    name = system.frequency_parameter
    for term in actuator.terms:
        if term.replaced_rule == "stopper":
            raise _uncharted(term, "without impacts there is no grazing of the paper's types")
        if term.signed:
            raise _uncharted(term, "every grazing occurs twice in a period of the voltage")
        if term.source(drive) is not drive:
            raise _uncharted(term, "its switching times change with the amplitude")
    if not {AMPLITUDE, name} <= set(system.parameters):
        raise InvalidParameter("drive", drive, "a waveform with amplitude and omega")
    low, high = _range(name, frequency or omega or (None, None), system)
    system.changed(**{name: low})
    crises, periods = whole("crises", crises, 0), whole("periods", periods, 1)
    columns = crises if columns is None else whole("columns", columns, 0)
    workers = min(4, max(1, crises)) if workers is None else whole("workers", workers, 1)
    report = progress_line(progress)
    ends = system.units.into(name, low), system.units.into(name, high)
    maker = ChartBuilder(system, options, steps, report, ends)
    try:
        maker.make(crises, columns, periods, workers)
    except KeyboardInterrupt:
        # Their number is unknown until the types of the range are.
        after = f"{maker.done} of {maker.total} parts" if maker.total else "0 parts"
        raise Interrupted("chart", after, maker.chart()) from None
    return maker.chart()


def _uncharted(term: Term, reason: str) -> InvalidParameter:
    """Return the error for a device without a chart."""
    problem = f"no chart with {term.name()}: {reason}; sweep the amplitude instead"
    return InvalidParameter("terms", None, "", problem=problem)


def _band(system: ActuatorSystem) -> tuple[float, float]:
    """Return the band of omega or frequency in which the force is near the block's resonance."""
    omega = math.sqrt(system.actuator.k / system.actuator.m2)
    drive = system.drive.replace(omega=omega)
    repeats = 2.0 * math.pi / (omega * drive.period)  # times the force repeats in 2 pi/omega
    unit = 2.0 * math.pi if system.frequency_parameter == "frequency" else 1.0
    return BAND[0] * omega / repeats / unit, BAND[1] * omega / repeats / unit


def _range(
    name: str, bounds: tuple[float | None, float | None], system: ActuatorSystem
) -> tuple[float, float]:
    allowed = "(lowest, highest) with 0 < lowest < highest"
    try:
        given_low, given_high = bounds
    except (TypeError, ValueError):
        raise InvalidParameter(name, bounds, allowed) from None
    low, high = (
        usual if end is None else system.units.parse(name, end)
        for end, usual in zip((given_low, given_high), _band(system), strict=True)
    )
    if not (is_number(low) and is_number(high) and 0.0 < low < high):
        raise InvalidParameter(name, (low, high), allowed)
    return float(low), float(high)


def progress_line(progress: bool | Callable[[str], None]) -> Callable[[str], None]:
    """Return the function that shows a line of progress."""
    if callable(progress):
        return progress
    if not progress:
        return lambda _: None
    import sys

    def report(line: str) -> None:
        sys.stderr.write(f"{line}\n")

    return report
