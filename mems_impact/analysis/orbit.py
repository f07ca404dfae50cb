"""Periodic orbits of a system."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from mems_impact import tables as run_tables
from mems_impact._util.arrays import Floats
from mems_impact._util.formatting import stability_name
from mems_impact.analysis.run import check_direction
from mems_impact.errors import InvalidParameter, OrbitError, RunError
from mems_impact.hybrid.automaton import unguarded
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import CheckpointGrid, Events, Samples, Trajectory, run
from mems_impact.hybrid.state import HybridState
from mems_impact.hybrid.variational.tangents import differences_reason
from mems_impact.integrators.options import Options
from mems_impact.orbits import orbit_search
from mems_impact.orbits.orbit_search import drift_of
from mems_impact.orbits.period_detection import (
    DIVERGED,
    UNBOUNDED_REMEDY,
    diverged_component,
    is_time_dependent,
)
from mems_impact.orbits.periodic_orbit import AdmissibilityViolation, PeriodicOrbit
from mems_impact.orbits.shooting import ShootingEvaluation
from mems_impact.orbits.signature import BOUNDARY
from mems_impact.systems.base import HybridSystem, system_at
from mems_impact.systems.dispatch import takes_system
from mems_impact.systems.result import Result
from mems_impact.systems.state import State, positive, whole, with_units
from mems_impact.systems.statistics import SAMPLES_PER_PERIOD, largest_values
from mems_impact.systems.typical_scales import warn_if_below_differences
from mems_impact.systems.window_statistics import Moments
from mems_impact.tables import CHATTER_ENDS, DRIVE_SWITCHES

if TYPE_CHECKING:
    import pandas as pd

# --- Descriptions of defects


def sentence(system: HybridSystem, orbit: PeriodicOrbit, defect: AdmissibilityViolation) -> str:
    """Return a description of a defect of an orbit, in the system's units."""
    segment, modes = orbit.segments[defect.segment], system.modes
    location = f"segment {defect.segment} ({modes[segment.mode]})"
    value = system.units.margin_amount(defect.guard, defect.value, rate=defect.kind == "reversed")
    match defect.kind:
        case "missed":
            return f"{location} passes the margin of {defect.guard} without the event, by {value}"
        case "reversed":
            return f"{location} ends with a {defect.guard} from the wrong side, at speed {value}"
        case "mode":
            return f"{location} ends with a {defect.guard} into {modes[int(defect.value)]}"
        case "order":
            return (
                f"{location} ends before it starts, by {system.units.amount('time', -defect.value)}"
            )
    return f"{location}: {defect.guard}, {defect.kind}, {value}"


# --- Periodic orbits

PERIOD_ENDS = "period ends"


@dataclass(frozen=True, kw_only=True, eq=False)
class Orbit(Result):
    """A periodic orbit of a system, stable or unstable.

    Attributes
    ----------
    system : System
        At the parameters of the orbit.
    numeric : PeriodicOrbit
        The orbit as arrays.

    See Also
    --------
    find_orbit, continue_solution, plot_orbit, sensitivity

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> [f"{abs(number):.3f}" for number in orbit.multipliers]
    ['0.433', '0.433']
    >>> orbit.segments["mode"].tolist()
    ['stuck-free', 'forward-free', 'stuck-free']
    >>> orbit.residual < 1e-9, orbit.admissible
    (True, True)
    """

    figure: ClassVar[str] = ""  # "module:function" that draws it instead of `plot_orbit`
    system: HybridSystem = field(repr=False)
    numeric: PeriodicOrbit = field(repr=False)

    _stored: ClassVar[tuple[str, ...]] = (
        "events",
        "impacts",
        "observables",
        "shown_states",
        "_crossings",
    )

    def __repr__(self) -> str:
        kind = stability_name(self.stable)
        kind += "" if self.admissible else ", inadmissible"
        hits = len(self._hits)
        length = f"periods={self.periods}" if self.system.forced else f"period={self.period:.9g}"
        state = with_units(self.state, self.system.units)
        differences = ", by differences" if self._differences else ""
        return f"{type(self).__name__}({length}, impacts={hits}, {kind}, {state}{differences})"

    @property
    def _differences(self) -> str:
        return differences_reason(self.system.automaton)

    def summary(self) -> dict[str, Any]:
        """Return its parameters and state, its stability and its admissibility."""
        largest = self.multipliers[:3].tolist()
        lasts = self.system.units.scales.label("period", self.system.units.get("time", ""))
        return {
            "system": repr(self.system),
            **({"periods": self.periods} if self.system.forced else {lasts: self.period}),
            "state": repr(self.state),
            "impacts": len(self._hits),
            "stability": stability_name(self.stable),
            "multipliers": ", ".join(f"{each:.6g}" for each in largest),
            "admissible": self.admissible or "; ".join(self.defects),
            **({"derivatives by differences": self._differences} if self._differences else {}),
        }

    @property
    def period(self) -> float:
        """The forcing period (see `periods`), or the period of a limit cycle."""
        return float(self.system.units.out("time", self.numeric.point.period))

    @property
    def options(self) -> Options:
        """Options of the integration."""
        return self._problem.options

    @property
    def periods(self) -> int:
        """Forcing periods after which the orbit closes; 1 for a limit cycle."""
        return self.numeric.periods

    @property
    def state(self) -> State:
        """The state at the start of a forcing period; ``initial`` of a run along the orbit.

        The state before the switch if the forcing switches there.
        """
        return self.system.state_space.state(self._start)

    @property
    def multipliers(self) -> NDArray[np.complex128]:
        """Floquet multipliers over the whole orbit, largest first.

        One per component of the state that is free at the start of the orbit: x2 and v2 if the
        frame of an actuator is stuck. A single 0 if no component is free, as at rest on a stopper.
        """
        return self.numeric.resolved_multipliers

    @property
    def stable(self) -> bool | None:
        """Whether all multipliers lie inside the unit circle.

        None ("neutral") if a multiplier lies on the circle within its error, and no multiplier
        beyond, as of conservative motions and at bifurcations. The error of the monodromy matrix is
        the error of the integration, at least 1e-7 of the largest entry.
        """
        return self.numeric.stable

    @property
    def admissible(self) -> bool:
        """Whether the orbit obeys all guards; otherwise `defects` lists the violations."""
        return self.numeric.admissible

    @property
    def defects(self) -> tuple[str, ...]:
        """Violations of the system's guards and transitions, one sentence each."""
        return tuple(sentence(self.system, self.numeric, defect) for defect in self.numeric.defects)

    @property
    def residual(self) -> float:
        """Largest residual of the equations of the orbit, in scaled units."""
        return self.numeric.residual

    @property
    def gains(self) -> dict[str, float]:
        """The change of each cyclic state over the orbit."""
        cyclic = (self.system.states[i] for i in self.system.automaton.cyclic)
        return {
            name: self.system.units.out(name, float(gain))
            for name, gain in zip(cyclic, self.numeric.advance, strict=True)
        }

    @property
    def closest_approach(self) -> float:
        """Smallest gap at which two bodies turn back without an impact, NaN without such a gap.

        Negative for an inadmissible orbit with penetration.
        """
        guards = self.system.automaton.guards
        gaps = [i for i, guard in enumerate(guards) if guard.impact]
        units = np.array([self.system.units.margin_factor(guards[i].name) for i in gaps])
        minima = (arc.minima[gaps] * units for arc in self.numeric.point.arcs)
        smallest = min(float(gap.min(initial=math.inf)) for gap in minima)
        if not math.isfinite(smallest):
            return math.nan
        return float(self.system.units.out("closest approach", smallest))

    @cached_property
    def events(self) -> pd.DataFrame:
        """One row per transition, with the columns of `Run.events`."""
        return run_tables.events(
            self._log, self.numeric.point.period, self.system, self._observed(self._log)
        )

    @cached_property
    def impacts(self) -> pd.DataFrame:
        """One row per impact, with the columns of `Run.impacts`."""
        hits = self._hits
        return run_tables.impacts(
            hits, self.numeric.point.period, self.system, self._observed(hits)
        )

    @cached_property
    def corners(self) -> pd.DataFrame:
        """One row per transition, with the columns of `Run.corners`."""
        return run_tables.corners(self._log, self._problem.period, self.system)

    @cached_property
    def segments(self) -> pd.DataFrame:
        """One row per segment of the orbit within one mode and one forcing period.

        Columns: period, mode, start and end (since the start of that forcing period), and the event
        at its end.
        """
        segments = self.numeric.segments
        return run_tables.segments(
            [s.cycle for s in segments],
            [s.mode for s in segments],
            self.numeric.point.starts,
            self.numeric.point.ends,
            [self._segment_end(s.code) for s in segments],
            self.system,
        )

    def section(self, direction: int = 0) -> pd.DataFrame:
        """Return the crossings of the Poincaré section, or else the starts of periods.

        Parameters
        ----------
        direction : {0, 1, -1}, optional
            Direction of the crossings: both (0), upwards (1) or downwards (-1).
        """
        check_direction("direction", direction)
        if self.system.section is None:
            return self.samples(1).iloc[: self.periods]
        log = self._crossings.crossings(direction)
        return run_tables.section(log, self.numeric.point.period, self.system)

    def samples(self, per_period: int = 200) -> pd.DataFrame:
        """Return the state at equal intervals over the orbit, with the columns of `Run.samples`.

        An inadmissible orbit is sampled with its penetration.
        """
        grid = self._grid(whole("per_period", per_period, 1))
        return run_tables.samples(grid, self.numeric.point.period, self.system)

    def _grid(self, per_period: int) -> Samples:
        pieces: list[Samples] = []
        last, period = -1, self.numeric.point.period
        for cycle, offset, _, grid in self._arcs(per_period):
            number = np.rint((cycle + grid.cycle + grid.time / period) * per_period)
            new = number > last
            if new.any():
                last = int(number[-1])
                y = grid.y[new] + offset
                pieces.append(Samples(grid.cycle[new] + cycle, grid.time[new], grid.mode[new], y))
        columns = (
            np.concatenate([getattr(part, name) for part in pieces])
            for name in ("cycle", "time", "mode", "y")
        )
        grid = Samples(*columns)
        grid.y[0], grid.mode[0] = self._start.y, self._start.mode
        return grid

    @property
    def returns(self) -> tuple[HybridState, ...]:
        """The states at returns, in scaled units: starts of periods, or upward crossings."""
        if self.system.forced:
            grid = self._grid(1)
            later = range(1, self.periods)
            starts = [HybridState(0, 0.0, int(grid.mode[i]), grid.y[i]) for i in later]
            return self._start, *starts
        log = self._crossings.crossings(1)
        rows = zip(log.mode_after.tolist(), log.after, strict=True)
        return tuple(HybridState(0, 0.0, mode, y) for mode, y in rows)

    @property
    def _start(self) -> HybridState:
        start = self.numeric.instant
        return replace(start, y=self.system.state_space.snap(start.mode, start.y))

    @cached_property
    def _crossings(self) -> Events:
        """The crossings of the section in both directions."""
        logs = []
        for cycle, offset, trajectory, _ in self._arcs():
            log = trajectory.events.crossings(0)
            moved: dict[str, Any] = {"before": log.before + offset, "after": log.after + offset}
            logs.append(replace(log, cycle=log.cycle + cycle, **moved))
        return Events.joined(logs)

    @cached_property
    def impact_speeds(self) -> list[float]:
        """The closing speed of the bodies in each impact: the rate of the gap."""
        guards = self.system.automaton.guards
        m, time = len(guards), float(self.system.units.factor("time"))
        units = [self.system.units.margin_factor(guard.name) / time for guard in guards]
        hits = (
            (segment.guard(m), event)
            for segment, event in zip(self.numeric.segments, self.numeric.point.events, strict=True)
        )
        return [
            units[guard] * abs(float(event.rates[guard]))
            for guard, event in hits
            if event is not None and guard >= 0 and guards[guard].impact
        ]

    @cached_property
    def observables(self) -> dict[str, float]:
        """The system's observables over the orbit."""
        values: dict[str, float] = {}
        at_events = self._observed(self._log)
        first = self.numeric.state
        last = self._one_period_later(first[None])[0]
        for each in self.system.observables:
            if each.at:
                moments = Moments()
                moments.add(at_events[each.name][~np.isnan(at_events[each.name])])
                values[each.name] = moments.reduced(each.reduce, 1.0)
            else:
                begin, end = (
                    self.system.statistics.value(each, y, self._problem) for y in (first, last)
                )
                values[each.name] = end - begin
        return {name: float(self.system.units.out(name, value)) for name, value in values.items()}

    @cached_property
    def shown_states(self) -> dict[str, Floats]:
        """The displayed states, at upward crossings of the section or starts of periods.

        For a limit cycle without a section, their largest values. Each state in descending order.
        """
        if self.system.section is not None:
            y = self._crossings.crossings(1).after
        elif self.system.forced:
            y = self._grid(1).y[: self.periods]
        else:
            y = self._largest[None]
        indices = [self.system.states.index(name) for name in self.system.state_space.displayed]
        falling = -np.sort(-y[:, indices], axis=0)
        return {
            name: np.asarray(self.system.units.out(name, values))
            for name, values in zip(self.system.state_space.displayed, falling.T, strict=True)
        }

    @property
    def _largest(self) -> Floats:
        """The largest value of each state over the orbit."""
        passed = self._arcs(SAMPLES_PER_PERIOD)
        arcs = (offset + largest_values(arc, grid) for _, offset, arc, grid in passed)
        return np.max([*self._log.before, *self._log.after, *arcs], axis=0)

    @property
    def _problem(self) -> Problem:
        return self.numeric.problem

    @property
    def _hits(self) -> Events:
        return self._log[self._log.impacts(self.system.automaton)]

    def _observed(self, log: Events) -> dict[str, Floats]:
        if not any(each.at for each in self.system.observables):
            return {}
        return self.system.statistics.at_events(log, self._problem)

    @cached_property
    def _log(self) -> Events:
        """The events of the orbit, in the form of the events of a run."""
        automaton = self.system.automaton
        m, n = len(automaton.guards), len(automaton.states)
        cyclic = list(automaton.cyclic)
        rows, offset = [], np.zeros(n)
        orbit = self.numeric
        for i, (segment, arc) in enumerate(zip(orbit.segments, orbit.point.arcs, strict=True)):
            event = orbit.point.events[i]
            before = arc.end + offset
            offset[cyclic] = before[cyclic]
            if event is None:
                continue
            after = np.array(event.after)
            after[cyclic] = before[cyclic]
            kind, guard = workspace.TRANSITION, segment.code
            if segment.code == automaton.switch_code:
                kind, guard = workspace.SWITCH, workspace.NONE
            elif segment.code >= m:
                kind, guard = workspace.ACCUMULATION, segment.code - m
            row = np.zeros(workspace.HEAD + 2 * n)
            row[workspace.CYCLE], row[workspace.TIME] = segment.cycle, orbit.point.ends[i]
            row[workspace.KIND], row[workspace.GUARD] = kind, guard
            row[workspace.MODE_BEFORE], row[workspace.MODE_AFTER] = segment.mode, event.mode
            row[workspace.HEAD : workspace.HEAD + n], row[workspace.HEAD + n :] = before, after
            rows.append(row)
        return Events.from_rows(np.array(rows).reshape(len(rows), workspace.HEAD + 2 * n))

    def _one_period_later(self, states: Floats) -> Floats:
        """Return states one pass of the orbit later."""
        later = states.copy()
        later[:, list(self.system.automaton.cyclic)] += self.numeric.advance
        return later

    def _arcs(self, per_period: int = 0) -> Iterator[tuple[int, Floats, Trajectory, Samples]]:
        """Integrate the pieces of the orbit, each in its mode to its end, ignoring guards.

        The orbit may penetrate, and a run would leave a very unstable orbit. Each arc is returned
        with its forcing period, the cyclic states before it, and its samples.
        """
        orbit, problem = self.numeric, self._problem
        cyclic = list(problem.automaton.cyclic)
        problem = replace(problem, automaton=unguarded(problem.automaton))
        offset = np.zeros(len(problem.automaton.states))
        for piece in orbit.shooting.pieces(orbit.point):
            # At the start of a period the time of an event may be negative by rounding.
            start, end = max(piece.start, 0.0), piece.end
            if end > start:
                y = self.system.state_space.snap(piece.mode, piece.state)
                begin = HybridState(0, start, piece.mode, y, switched=True)
                length = (end - start) / problem.period
                arc = run(problem, begin, length, checkpoints=CheckpointGrid(per_period))
                yield orbit.segments[piece.segment].cycle, offset.copy(), arc, arc.checkpoints
            offset[cyclic] += piece.arc.end[cyclic]

    def _segment_end(self, code: int) -> str:
        automaton = self.system.automaton
        names = {BOUNDARY: PERIOD_ENDS, automaton.switch_code: DRIVE_SWITCHES}
        names |= {number: guard.name for number, guard in enumerate(automaton.guards)}
        return names.get(code, CHATTER_ENDS)


def orbit_of(system: HybridSystem, solution: PeriodicOrbit) -> Orbit:
    """Return an orbit of `orbits` as an `Orbit` at its own parameters."""
    orbit: Orbit = (system._orbit_type or Orbit)(
        system=system_at(system, solution.family.values), numeric=solution
    )
    return orbit


# --- Search for a periodic orbit

ORBIT_OPTIONS = Options(method="auto", rtol=1e-11, atol=1e-13)
"""Tighter than for runs, as special points are located to ten digits."""
DEFECTS = 3  # largest number of defects in a message
UNFORCED_PROBLEM = (
    "no function of the system depends on t, and its motion does not repeat with this period: omit "
    "period= of the System to find its limit cycle"
)


@takes_system(start="guess")
def find_orbit(
    system: HybridSystem,
    *,
    guess: State | Mapping[str, float] | None = None,
    periods: int | None = None,
    period: float | None = None,
    transient: float = 0,
    options: Options = ORBIT_OPTIONS,
) -> Orbit:
    """Find a periodic orbit near a state.

    A run from `guess` provides modes and events; Newton's method then corrects all states and event
    times together (multiple shooting), and finds unstable orbits as well. For an autonomous system
    the orbit is a limit cycle, and its period is an unknown.

    Parameters
    ----------
    system : System, or Actuator and Drive, or Run
        A run provides its system and, as `guess`, its last state.
    guess : State or mapping of str to float, optional
        A state near the orbit, such as the last state of a run; by default the initial state of the
        system.
    periods : int, optional
        Number of forcing periods after which the orbit closes, >= 1; detected in a run by default.
    period : float, optional
        Approximate period of a limit cycle near `guess`, for an autonomous system; detected in a
        run by default.
    transient : float, optional
        Forcing periods to run before the search, >= 0, so that the run approaches a stable orbit. A
        time for an autonomous system.
    options : Options, optional
        Options of the integration; by default tolerances of 1e-11 relative and 1e-13 absolute, and
        method ``"auto"``: the run from the guess selects ``"dop853"`` or, if the system is stiff,
        ``"bdf"``. `Orbit.options` holds the selected method.

    Returns
    -------
    Orbit

    Raises
    ------
    InvalidParameter
        If an argument is out of range, or the system has a forcing period although none of its
        functions depends on time.
    OrbitError
        If there is no orbit near the guess, or the motion does not return, diverges, comes to rest,
        or grows without bound in a state that should be `cyclic`; ``partial`` is the last `State`.
        If the converged solution is inadmissible; ``partial`` is this `Orbit`, whose ``defects``
        list the violations.
    RunError
        If the run from the guess fails.
    FunctionError
        If a function is wrong in a mode of the orbit that no run has reached.

    See Also
    --------
    Orbit, continue_solution, simulate, lyapunov

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> orbit.stable, len(orbit.impacts)
    (True, 1)
    >>> f"{orbit.step:.4e}"
    '3.6665e-04'
    """
    if periods is not None:
        periods = whole("periods", periods, 1)
    if period is not None:
        positive("period", period)
    transient = positive("transient", transient, zero=True)
    if not system.forced and periods is not None:
        refusal = "the system has no forcing period to count"
        raise InvalidParameter("periods", periods, "", problem=refusal)
    if system.forced and period is not None:
        refusal = "an orbit of this system closes after whole forcing periods: give periods"
        raise InvalidParameter("period", period, "", problem=refusal)
    family = system.family(options)
    problem = family.problem()
    start = system.state_space.instant(guess, problem, field="guess")
    system.checks.start_side(problem, start)
    try:
        if system.forced:
            solution = orbit_search.find_periodic_orbit(
                family, start, periods=periods, transient=transient
            )
        else:
            solution = orbit_search.find_cycle(
                family,
                start,
                period=None if period is None else float(system.units.into("time", period)),
                transient=float(system.units.into("time", transient)),
            )
    except (OrbitError, RunError) as error:
        cause = _diverged(error, system, problem)
        if cause is None and isinstance(error, OrbitError):
            cause = _drifting(system, problem, start, transient)
        if cause is not None:
            raise cause from error
        if isinstance(error, RunError):
            raise
        if system.forced and not is_time_dependent(problem, start.y):
            raise _unforced(system) from error
        if isinstance(error.partial, ShootingEvaluation):
            error.partial = _reached(error.partial, system)
        elif isinstance(error.partial, HybridState):
            error.partial = system.state_space.state(error.partial)
        raise
    # A state of rest repeats with any period; a motion that leaves it does not.
    if system.forced and solution.stable is False and not is_time_dependent(problem, start.y):
        raise _unforced(system)
    segments = zip(solution.segments, solution.point.ends, solution.point.arcs, strict=True)
    states = (HybridState(s.cycle, float(end), s.mode, arc.end) for s, end, arc in segments)
    system.checks.motion(problem, states)
    orbit = orbit_of(system, solution)
    if not orbit.admissible:
        raise OrbitError(
            f"the converged solution is inadmissible: {'; '.join(orbit.defects[:DEFECTS])}",
            "give a longer transient, or a guess with the events of an orbit",
            orbit,
        )
    if not system.units.is_scaled and orbit._differences:
        _check_sizes(system, solution)
    return orbit


def _check_sizes(system: HybridSystem, solution: PeriodicOrbit) -> None:
    """Warn if states of an orbit are smaller than the steps of finite differences."""
    automaton = system.automaton
    sizes = np.abs([arc.end for arc in solution.point.arcs]).max(axis=0)
    sizes[list(automaton.cyclic)] = math.nan  # perturbations have no such components
    warn_if_below_differences(
        system.states,
        sizes,
        lambda: run(solution.problem, solution.instant, float(solution.periods)),
    )


def _diverged(
    error: OrbitError | RunError, system: HybridSystem, problem: Problem
) -> OrbitError | None:
    """Return an error that states where the motion diverged; None if it did not."""
    if isinstance(error, RunError):
        at = error.partial.final if isinstance(error.partial, Trajectory) else None
    else:
        at = error.partial if isinstance(error.partial, HybridState) else None
    index = None if at is None else diverged_component(problem, at)
    if at is None or index is None:
        return None
    name, state = system.states[index], system.state_space.state(at)
    elapsed = at.cycle * problem.period + at.time
    location = f"{name} = {system.units.amount(name, at.y[index])}"
    when = f" at t = {system.units.amount('time', elapsed)}" if elapsed > 0.0 else " in the guess"
    return OrbitError(f"{DIVERGED}: {location}{when}", UNBOUNDED_REMEDY, state)


def _drifting(
    system: HybridSystem, problem: Problem, start: HybridState, transient: float
) -> OrbitError | None:
    """Return an error that states which states grow without bound; None if none does."""
    names = system.states
    units = np.array([float(system.units.into(name, 1.0)) for name in names])
    try:
        if transient > 0.0:
            if not system.forced:
                transient = float(system.units.into("time", transient)) / problem.period
            start = run(problem, start, transient).final
        drift = drift_of(problem, start, units, forced=system.forced)
    except RunError:
        return None
    if drift is None:
        return None
    each = 1.0 if system.forced else float(system.units.out("time", problem.period))
    grows = []
    for index, rate in zip(drift.places, drift.rates, strict=True):
        name = names[index]
        gain = (
            f"{abs(system.units.out(name, rate)) / each:.4g} {system.units.get(name, '')}".rstrip()
        )
        grows.append(f"{name} {'grows' if rate > 0.0 else 'falls'} by {gain}")
    listed = [names[index] for index in drift.places]
    pronoun, together = "it" if len(listed) == 1 else "them", " and ".join(listed)
    reason, remedy = {
        "unread": (
            f"no function reads {pronoun}",
            f"name {pronoun} in cyclic=[{', '.join(map(repr, listed))}], and an orbit need not "
            f"close in {pronoun}",
        ),
        "angle": (
            f"functions repeat every 2 pi of {pronoun}",
            f"bring {together} back by guards at pi and -pi, whose transitions subtract and add "
            "2 pi",
        ),
        "together": (
            "functions read only the distance between them",
            f"take the distances between {together} as states, and only one of their positions, in "
            "cyclic=",
        ),
    }[drift.kind]
    per = "a period" if system.forced else "in a unit of time"
    reached = system.state_space.state(replace(start, cycle=0, time=0.0))
    return OrbitError(f"{' and '.join(grows)} {per}, and {reason}", remedy, reached)


def _unforced(system: HybridSystem) -> InvalidParameter:
    return InvalidParameter("period", system.forcing_period, "", problem=UNFORCED_PROBLEM)


def _reached(point: ShootingEvaluation, system: HybridSystem) -> State | None:
    """Return the state at the start of the orbit, from an iteration that did not converge."""
    free = [i for i in range(len(system.states)) if i not in system.automaton.cyclic]
    y = np.zeros(len(system.states))
    y[free] = point.unknowns[: len(free)]
    if not np.isfinite(y).all():
        return None
    return system.state_space.state(HybridState(0, 0.0, 0, y)).replace(mode=None)
