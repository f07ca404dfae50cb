"""Periodic orbits of the actuator under a drive."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mems_impact import tables
from mems_impact.actuator.drive import Drive
from mems_impact.actuator.modes import GUARDS, MODES, STATES, V1, X1, X2, direction_of
from mems_impact.actuator.parameters import PARAMETER_NAMES, PARAMETER_UNITS, Actuator
from mems_impact.actuator.units import Scales
from mems_impact.engines.options import Options
from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.hybrid import loop
from mems_impact.hybrid.run import run
from mems_impact.hybrid.trajectory import Events, Floats, Instant, Samples
from mems_impact.hybrid.unguarded import unguarded
from mems_impact.orbits import orbit as orbits
from mems_impact.orbits.family import Family
from mems_impact.orbits.orbit import Defect, PeriodicOrbit
from mems_impact.orbits.shooting import Point
from mems_impact.orbits.signature import BOUNDARY
from mems_impact.studies.impacts import concatenate, energy_lost, frame_steps, is_impact
from mems_impact.studies.run import assembled, check_direction, problem_of
from mems_impact.studies.simulate import instant_of_state
from mems_impact.studies.state import STATE_UNITS, State, is_number

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["IF_STIFF", "ORBIT_OPTIONS", "Orbit", "System", "find_orbit", "reporting", "whole"]

ORBIT_OPTIONS = Options(method="dop853", rtol=1e-11, atol=1e-13)
"""Tighter than for runs, as special points are located to ten digits; arcs are short."""
IF_STIFF = "bdf"
"""The method that takes over from that of `ORBIT_OPTIONS`."""

PERIOD_ENDS = "period ends"
SWITCH = 2 * len(GUARDS)  # the code of the drive's switch


@dataclass(frozen=True, kw_only=True)
class System:
    """An actuator under a drive, with every number of theirs as a parameter.

    Attributes
    ----------
    actuator : Actuator
    drive : Drive
    options : Options
    scales : Scales
        In which the numerics count parameters; they stay when a parameter is varied from which
        they were made.
    """

    actuator: Actuator
    drive: Drive
    options: Options
    scales: Scales

    @classmethod
    def of(cls, actuator: Actuator, drive: Drive, options: Options) -> System:
        """Return the system in the actuator's own scales; InvalidParameter for wrong types."""
        problem_of(actuator, drive, options)
        return cls(actuator=actuator, drive=drive, options=options, scales=actuator.scales)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of all numbers of drive and actuator."""
        return tuple(dict.fromkeys([*self.drive.names, *PARAMETER_NAMES]))

    def check_parameter(self, name: str, field: str = "parameter") -> None:
        """Raise InvalidParameter unless `name` can be varied continuously."""
        if name not in self.parameters:
            raise InvalidParameter(field, name, f"one of {', '.join(self.parameters)}")
        if name.rpartition(".")[2] == "bias" and self.value(name) == 0.0:
            problem = "the forcing period doubles where the bias sets in; begin with another value"
            raise InvalidParameter(name, 0.0, "", problem=problem)

    def value(self, name: str) -> float:
        """Return a parameter in the user's units."""
        if name in self.drive.names:
            return self.drive.number(name)
        return float(getattr(self.actuator, name))

    def changed(self, *, checked: bool = True, **values: float) -> System:
        """Return the system at other values.

        Differences by a parameter at the end of its range look beyond it, as do trial steps: not
        `checked`, everything is taken. Otherwise InvalidParameter is raised if a value is not
        allowed.
        """
        names = self.drive.names
        of_drive = {name: value for name, value in values.items() if name in names}
        of_actuator = {name: value for name, value in values.items() if name not in names}
        actuator, drive = self.actuator, self.drive
        if of_drive:
            drive = drive.varied(of_drive, checked=checked)
        if of_actuator and checked:
            actuator = actuator.replace(**of_actuator)
        elif of_actuator:
            actuator = actuator.replace_unchecked(**of_actuator)
        return replace(self, actuator=actuator, drive=drive)

    def unit(self, name: str) -> str:
        """Return the SI unit of a parameter, empty for a pure number."""
        of_drive = name in self.drive.names
        return self.drive.unit(name) if of_drive else PARAMETER_UNITS.get(name, "")

    def into(self, name: str, value: float) -> float:
        """Return a value of a parameter in the units of the numerics."""
        unit = self.unit(name)
        return float(self.scales.into(value, unit)) if unit else value

    def out(self, name: str, value: float) -> float:
        """Return a value of a parameter in the user's units."""
        unit = self.unit(name)
        return float(self.scales.out(value, unit)) if unit else value

    def label(self, name: str) -> str:
        """Return the heading of a parameter's column."""
        return self.scales.label(name, self.unit(name))

    def family(self) -> Family:
        """Return the problems for all values of the parameters, in the units of the numerics."""

        def build(inner: Mapping[str, float]) -> Any:
            here = self._at(inner)
            return assembled(here.actuator, here.drive, self.options)

        return Family(build, self._inner)

    def at_orbit(self, found: PeriodicOrbit) -> System:
        """Return the system at the values of an orbit, and with the options of it."""
        options = found.family.problem().options
        return replace(self._at(found.family.values), options=options)

    @cached_property
    def _inner(self) -> dict[str, float]:
        """All parameters in the units of the numerics."""
        return {name: self.into(name, self.value(name)) for name in self.parameters}

    def _at(self, inner: Mapping[str, float]) -> System:
        """Return the system at values in the units of the numerics, allowed or not."""
        here = self._inner
        changes = {n: self.out(n, v) for n, v in inner.items() if v != here[n]}
        return self.changed(checked=False, **changes) if changes else self


@dataclass(frozen=True, kw_only=True, eq=False)
class Orbit:
    """A periodic orbit of the actuator, stable or not.

    Attributes
    ----------
    system : System
        Actuator, drive and options.
    found : PeriodicOrbit
        The orbit as arrays.
    """

    system: System = field(repr=False)
    found: PeriodicOrbit = field(repr=False)

    def __repr__(self) -> str:
        kind = "stable" if self.stable else "unstable"
        kind += "" if self.admissible else ", inadmissible"
        hits = len(self._log[is_impact(self._log)])
        return f"Orbit(periods={self.periods}, impacts={hits}, {kind}, {self.state})"

    @property
    def actuator(self) -> Actuator:
        """The device."""
        return self.system.actuator

    @property
    def drive(self) -> Drive:
        """The voltage."""
        return self.system.drive

    @property
    def options(self) -> Options:
        """How it is integrated."""
        return self.system.options

    @property
    def period(self) -> float:
        """The forcing period; the orbit takes `periods` of them."""
        return self.drive.period

    @property
    def periods(self) -> int:
        """Forcing periods after which the orbit closes."""
        return self.found.periods

    @property
    def state(self) -> State:
        """The state where a forcing period begins; ``initial`` of a run along the orbit."""
        y = _at_rest_if_stuck(self.found.segments[0].mode, self.found.state)
        return _state(y, self.actuator.scales)

    @property
    def multipliers(self) -> NDArray[np.complex128]:
        """Floquet multipliers over the whole orbit, largest first.

        Of the components of the state that are free where the orbit begins: x2 and v2 where the
        frame is stuck. A single 0 where none is: at rest on a stopper.
        """
        return self.found.multipliers

    @property
    def stable(self) -> bool:
        """Whether all multipliers lie inside the unit circle."""
        return self.found.stable

    @property
    def admissible(self) -> bool:
        """Whether the actuator has this orbit; if not, `defects` says why."""
        return self.found.admissible

    @property
    def defects(self) -> tuple[str, ...]:
        """In words, how the solution violates the rules of impact and friction."""
        return tuple(self._sentence(defect) for defect in self.found.defects)

    @property
    def residual(self) -> float:
        """Largest residual of the equations of the orbit, in the units of the numerics."""
        return self.found.residual

    @property
    def step(self) -> float:
        """Displacement of the frame over the orbit."""
        return float(self.actuator.scales.out(self.found.advance[0], "m"))

    @property
    def closest_approach(self) -> float:
        """Smallest distance from a stopper at which the block turns back, NaN if nowhere.

        Negative on an inadmissible orbit that penetrates a stopper.
        """
        sides = [i for i, guard in enumerate(GUARDS) if guard.impact]
        least = min(float(arc.minima[sides].min()) for arc in self.found.point.arcs)
        return float(self.actuator.scales.out(least, "m")) if math.isfinite(least) else math.nan

    @cached_property
    def impacts(self) -> pd.DataFrame:
        """One row an impact, with the columns of `Run.impacts`."""
        # The step after the last impact may end in the next pass of the orbit.
        later = replace(self._log, cycle=self._log.cycle + self.periods)
        log = concatenate([self._log, replace(later, after=self._ahead(later.after))])
        steps = frame_steps(log)[1]
        hits = self._log[is_impact(self._log)]
        lost = energy_lost(hits, self.actuator.to_dimensionless())
        scales = self.actuator.scales
        return tables.impacts(hits, steps[: len(hits)], lost, self._period, scales)

    @cached_property
    def segments(self) -> pd.DataFrame:
        """One row a stretch of the orbit within one mode and one forcing period.

        Columns: period, mode, start and end (since the start of that forcing period), and what
        ends it.
        """
        shown = self.found.segments
        return tables.segments(
            [s.cycle for s in shown],
            [s.mode for s in shown],
            self.found.point.starts,
            self.found.point.ends,
            [_what_ends(s.code) for s in shown],
            self.actuator.scales,
        )

    def section(self, direction: int = 0) -> pd.DataFrame:
        """Return the crossings of the Poincaré section x2 = 0, with the columns of `Run.section`.

        Parameters
        ----------
        direction : {0, 1, -1}, optional
            Both directions, v2 > 0 or v2 < 0.
        """
        check_direction("direction", direction)
        return tables.section(self._crossings, direction, self.actuator.scales)

    def samples(self, per_period: int = 200) -> pd.DataFrame:
        """Return the state at equal intervals over the orbit, with the columns of `Run.samples`.

        An inadmissible orbit is sampled as it was solved, through the stopper.
        """
        count = whole("per_period", per_period, 1)
        parts: list[Samples] = []
        seen = -1
        for cycle, offset, trajectory in self._arcs():
            grid = trajectory.samples(count)
            number = np.rint((cycle + grid.cycle + grid.time / self._period) * count)
            new = number > seen
            if new.any():
                seen = int(number[-1])
                y = grid.y[new].copy()
                y[:, X1] += offset
                parts.append(Samples(grid.cycle[new] + cycle, grid.time[new], grid.mode[new], y))
        columns = (
            np.concatenate([getattr(part, name) for part in parts])
            for name in ("cycle", "time", "mode", "y")
        )
        return tables.samples(Samples(*columns), self._period, self.actuator.scales)

    @property
    def _period(self) -> float:
        return self.found.family.problem().period

    @cached_property
    def _log(self) -> Events:
        """The events of the orbit, in the form of a run's."""
        m, n = len(GUARDS), len(STATES)
        rows, offset = [], 0.0
        found = self.found
        for i, (segment, arc) in enumerate(zip(found.segments, found.point.arcs, strict=True)):
            event = found.point.events[i]
            before = np.array(arc.end)
            before[X1] += offset
            offset = before[X1]
            if event is None:
                continue
            after = np.array(event.after)
            after[X1] = offset
            kind, guard = loop.TRANSITION, segment.code
            if segment.code == SWITCH:
                kind, guard = loop.SWITCH, loop.NONE
            elif segment.code >= m:
                kind, guard = loop.ACCUMULATION, segment.code - m
            row = np.zeros(loop.HEAD + 2 * n)
            row[loop.CYCLE], row[loop.TIME] = segment.cycle, found.point.ends[i]
            row[loop.KIND], row[loop.GUARD] = kind, guard
            row[loop.MODE_BEFORE], row[loop.MODE_AFTER] = segment.mode, event.mode
            row[loop.HEAD : loop.HEAD + n], row[loop.HEAD + n :] = before, after
            rows.append(row)
        return Events.from_rows(np.array(rows).reshape(len(rows), loop.HEAD + 2 * n))

    def _ahead(self, states: Floats) -> Floats:
        """Return states one pass of the orbit later."""
        later = states.copy()
        later[:, X1] += self.found.advance[0]
        return later

    @cached_property
    def _crossings(self) -> Events:
        """The crossings of x2 = 0, in the units of the numerics."""
        parts = []
        for cycle, offset, trajectory in self._arcs():
            log = trajectory.events
            log = log[log.kind == loop.SECTION_CROSSING]
            log = replace(log, cycle=log.cycle + cycle)
            log.before[:, X1] += offset
            log.after[:, X1] += offset
            parts.append(log)
        return concatenate(parts)

    def _arcs(self) -> Iterator[tuple[int, float, Any]]:
        """Integrate the orbit's segments, each in its mode to its end whatever the guards say.

        The orbit may penetrate a stopper, and one that is very unstable would be left by a run.
        """
        found = self.found
        problem = found.family.problem()
        problem = replace(problem, automaton=unguarded(problem.automaton), section=(X2, 0.0, 0))
        states, _ = found.shooting.unpack(found.point.unknowns)
        offset = 0.0
        for i, segment in enumerate(found.segments):
            start, end = float(found.point.starts[i]), float(found.point.ends[i])
            if end > start:
                y = _at_rest_if_stuck(segment.mode, states[i])
                begin = Instant(0, start, segment.mode, y)
                yield segment.cycle, offset, run(problem, begin, (end - start) / problem.period)
            offset += float(found.point.arcs[i].end[X1])

    def _sentence(self, defect: Defect) -> str:
        segment = self.found.segments[defect.segment]
        where = f"segment {defect.segment} ({MODES[segment.mode]})"
        value = f"{defect.value:.3g}"
        match defect.kind:
            case "missed":
                return f"{where} passes the {defect.guard} without it, by {value}"
            case "reversed":
                return f"{where} ends with a {defect.guard} from the wrong side, at speed {value}"
            case "mode":
                return f"{where} ends with a {defect.guard} into {MODES[int(defect.value)]}"
            case "order":
                return f"{where} ends before it starts, by {-defect.value:.3g}"
        return f"{where}: {defect.guard}, {defect.kind}, {value}"


def find_orbit(
    actuator: Actuator,
    drive: Drive,
    *,
    guess: State = State(),  # noqa: B008 - immutable
    periods: int = 1,
    transient: float = 0,
    options: Options | None = None,
) -> Orbit:
    """Find a periodic orbit near a state.

    Its modes and events are read off a run from `guess`; all its states and event times are then
    corrected together by Newton's method, which finds unstable orbits as well.

    Parameters
    ----------
    actuator : Actuator
    drive : Drive
    guess : State, optional
        A state near the orbit, such as the last one of a run; at rest in the middle by default.
    periods : int, optional
        Forcing periods after which the orbit closes, >= 1.
    transient : float, optional
        Forcing periods to run before that, >= 0: a stable orbit attracts.
    options : Options, optional
        How it is integrated; by default with method ``"dop853"``, or ``"bdf"`` if the run from
        the guess is found stiff, to 1e-11 relative and 1e-13 absolute. `Orbit.options` has what
        was taken.

    Returns
    -------
    Orbit

    Raises
    ------
    InvalidParameter
        If an argument is out of range.
    OrbitError
        If there is no orbit near the guess; its ``partial`` is the `State` that was reached.
    RunError
        If the run from the guess fails.
    """
    system = System.of(actuator, drive, ORBIT_OPTIONS if options is None else options)
    if_stiff = IF_STIFF if options is None else None
    count = whole("periods", periods, 1)
    if not is_number(transient) or transient < 0.0:
        raise InvalidParameter("transient", transient, "a finite number >= 0")
    start = instant_of_state(actuator, drive, guess)
    try:
        found = orbits.find_orbit(
            system.family(), start, periods=count, transient=float(transient), if_stiff=if_stiff
        )
    except OrbitError as error:
        if isinstance(error.partial, Point):
            error.partial = _reached(error.partial, system.scales)
        raise
    return Orbit(system=system.at_orbit(found), found=found)


def whole(field: str, value: Any, least: int) -> int:
    """Return `value` as an int; InvalidParameter unless it is a whole number >= `least`."""
    if not (is_number(value) and value >= least and value == int(value)):
        raise InvalidParameter(field, value, f"a whole number >= {least}")
    return int(value)


@contextmanager
def reporting(
    progress: bool | Callable[[float], None], name: str, out: Callable[[float], float]
) -> Iterator[Callable[[float], None] | None]:
    """Give what continuation calls with every value; with a counter while it is shown."""
    if callable(progress):
        tell = progress
        yield lambda value: tell(out(value))
        return
    if not progress:
        yield None
        return
    from tqdm import tqdm

    with tqdm(delay=1.0, unit=" orbits") as bar:

        def show(value: float) -> None:
            bar.set_postfix_str(f"{name} = {out(value):.6g}", refresh=False)
            bar.update()

        yield show


def _state(y: Floats, scales: Scales) -> State:
    values = zip(STATES, y.tolist(), strict=True)
    return State(**{name: scales.out(value, STATE_UNITS[name]) for name, value in values})


def _at_rest_if_stuck(mode: int, y: Floats) -> Floats:
    # Newton's method leaves a rounding there, with which a run would begin to slip.
    return y if direction_of(mode) != 0 else np.where(np.arange(y.size) == V1, 0.0, y)


def _reached(point: Point, scales: Scales) -> State | None:
    """Return the first state of an iteration that did not converge."""
    free = [i for i in range(len(STATES)) if i != X1]
    y = np.zeros(len(STATES))
    y[free] = point.unknowns[: len(free)]
    return _state(y, scales) if np.isfinite(y).all() else None


def _what_ends(code: int) -> str:
    m = len(GUARDS)
    if code == BOUNDARY:
        return PERIOD_ENDS
    if code == SWITCH:
        return tables.DRIVE_SWITCHES
    return GUARDS[code].name if code < m else tables.CHATTER_ENDS
