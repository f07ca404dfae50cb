"""Statistics of runs, orbits and attractors."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cache, cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats, distance_to_nearest
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.attractors.mapper import CompiledObservables, RecurrenceColumns, observed
from mems_impact.hybrid.automaton import Guard
from mems_impact.hybrid.definition import PLACEHOLDER_GUARD, writes_into_arrays
from mems_impact.hybrid.diagnostics.user_functions import UserFunction
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import INSTANT_RTOL, Events, Samples, Trajectory
from mems_impact.hybrid.state import HybridState
from mems_impact.orbits.period_detection import flow_at
from mems_impact.systems import observables as quantity
from mems_impact.systems.description import SystemDescription
from mems_impact.systems.observables import Observable, Quantity
from mems_impact.systems.units import Conversion
from mems_impact.systems.window_statistics import (
    Moments,
    MotionTotals,
    StatisticsAccumulator,
    TimeWindow,
    ratio,
)
from mems_impact.tables import unit_of

# --- Maxima of states, along an arc or a run.

SAMPLES_PER_PERIOD = 200  # between which maxima are located
MIN_MOTION_RATIO = 1e-9  # relative variation below which a state is constant


def largest_values(arc: Trajectory, grid: Samples) -> Floats:
    """Return the largest value of each state along an arc without events, shape (n,).

    Around the largest sample a state is interpolated by a cubic Hermite polynomial.
    """
    largest = np.maximum(arc.start.y, arc.final.y)
    if not len(grid.y):
        return np.asarray(largest)
    at = grid.cycle * arc.period + grid.time
    for state, i in enumerate(np.argmax(grid.y, axis=0).tolist()):
        largest[state] = max(largest[state], grid.y[i, state])
        for j in (i - 1, i):
            if j >= 0 and j + 1 < len(grid.y):
                length = float(at[j + 1] - at[j])
                rates = [
                    length * flow_at(arc.problem, HybridState(0, at[k], arc.start.mode, grid.y[k]))
                    for k in (j, j + 1)
                ]
                ends = grid.y[j, state], grid.y[j + 1, state]
                top = _top(*ends, rates[0][state], rates[1][state])
                largest[state] = max(largest[state], top)
    return np.asarray(largest)


def maxima(run: Trajectory, first: float) -> list[Floats]:
    """Return, for each state, its local maxima along a run from `first`, in order.

    They include corners, and values before and after events. A constant state has one, its value; a
    monotonic state has none. `first` is in periods of the run's problem.
    """
    grid = run.samples(SAMPLES_PER_PERIOD, first)
    log = run.events[
        np.isin(run.events.kind, (workspace.TRANSITION, workspace.ACCUMULATION, workspace.SWITCH))
    ]
    log = log[log.cycle * run.period + log.time >= first * run.period]
    instants, sampled = (each.cycle * run.period + each.time for each in (log, grid))
    # A sample at the instant of an event may be the state on either side of it.
    separate = distance_to_nearest(sampled, instants) > INSTANT_RTOL * run.period
    at = [instants, instants, sampled[separate]]
    # Order at one instant: state before an event, state after it.
    kinds = np.repeat([0, 1, 2], [each.size for each in at])
    order = np.lexsort((kinds, np.concatenate(at)))
    time, kinds = np.concatenate(at)[order], kinds[order]
    y = np.concatenate([log.before, log.after, grid.y[separate]])[order]
    mode = np.concatenate([log.mode_before, log.mode_after, grid.mode[separate]])[order]
    arc = np.cumsum(kinds == 1)

    @cache
    def slopes(j: int) -> Floats:
        return flow_at(run.problem, HybridState(0, float(time[j]), int(mode[j]), y[j]))

    def slope(i: int, j: int) -> float:
        return float(slopes(j)[i])

    return [_maxima(time, y[:, i], partial(slope, i), arc) for i in range(y.shape[1])]


def _maxima(
    time: Floats, y: Floats, slope: Callable[[int], float], arc: NDArray[np.int64]
) -> Floats:
    """Return the local maxima of one state, with the number of the arc of each sample."""
    extent = float(np.ptp(y)) if y.size else 0.0
    if not extent > MIN_MOTION_RATIO * float(np.abs(y).max(initial=0.0)):
        return y[-1:]
    # Values that differ only by rounding are a plateau with one maximum.
    changes = np.flatnonzero(np.abs(np.diff(y)) > MIN_MOTION_RATIO * extent)
    begins, ends = np.append(0, changes + 1), np.append(changes, y.size - 1)
    values = y[begins]
    peaks = np.flatnonzero((values[1:-1] > values[:-2]) & (values[1:-1] > values[2:])) + 1
    tops = []
    for begin, end in zip(begins[peaks].tolist(), ends[peaks].tolist(), strict=True):
        top = float(y[begin : end + 1].max())
        for j in (begin - 1, end):
            if arc[j] == arc[j + 1]:
                length = float(time[j + 1] - time[j])
                top = max(top, _top(y[j], y[j + 1], length * slope(j), length * slope(j + 1)))
        tops.append(top)
    return np.array(tops)


def _top(first: float, last: float, rate: float, last_rate: float) -> float:
    """Return the maximum on [0, 1] of the cubic with these values and rates at the ends."""
    rise = last - first
    cubic, square = rate + last_rate - 2.0 * rise, 3.0 * rise - 2.0 * rate - last_rate
    polynomial = np.polynomial.Polynomial([first, rate, square, cubic])
    extrema = polynomial.deriv().roots()
    inside = extrema[np.isreal(extrema) & (extrema.real > 0.0) & (extrema.real < 1.0)].real
    return float(max(first, last, *polynomial(inside)))


# --- Names of motions in tables.

# A motion that has not repeated itself is unsettled until its Lyapunov exponent classifies it.
OFF, RESTING, PERIODIC, UNSETTLED, FAILED = "off", "resting", "periodic", "unsettled", "failed"
CHAOTIC, QUASI_PERIODIC = "chaotic", "quasi-periodic"


def counted_periods(count: int) -> str:
    """Return the name of a periodic motion of `count` periods: ``"period 2"``."""
    return f"period {count}"


# --- Statistics of a run, accumulated during the run, so that memory does not grow with its length.


class LazyStatistics:
    """An accumulator that processes the events of a run on first access.

    `begin` creates the accumulator: if an observable fails, the next access starts again from the
    first event. `events` are all that the run has kept, `lengths` those of the chunks in which they
    arrived, since sums are computed chunk by chunk.
    """

    def __init__(
        self, begin: Callable[[], StatisticsAccumulator], events: Events, lengths: Sequence[int]
    ) -> None:
        self._begin, self._events, self.lengths = begin, events, list(lengths)

    @cached_property
    def ready(self) -> StatisticsAccumulator:
        """The accumulator, after all events."""
        gatherer, first = self._begin(), 0
        for length in self.lengths:
            gatherer(self._events[first : first + length])
            first += length
        return gatherer


class RunStatistics(StatisticsAccumulator):
    """Statistics of any system: events by guard, fractions of time in modes, and observables."""

    def __init__(
        self, source: SystemStatistics, problem: Problem, start: HybridState, window: TimeWindow
    ) -> None:
        system = source._system
        super().__init__(window, start, len(system.modes), len(system.automaton.guards))
        self.resume(source, problem)
        self._moments = {each.name: Moments() for each in system.observables if each.at}

    def resume(self, source: SystemStatistics, problem: Problem) -> None:
        """Continue with the statistics of a system and its problem."""
        self._source, self._problem = source, problem

    def gathered(self) -> dict[str, Any]:
        """Return the accumulated data, from which `of` continues."""
        linked = ("_source", "_problem")
        return {name: value for name, value in vars(self).items() if name not in linked}

    @classmethod
    def of(cls, **gathered: Any) -> RunStatistics:
        """Return an accumulator with this data; it needs `resume`."""
        gathering = cls.__new__(cls)
        vars(gathering).update(gathered)
        return gathering

    def __call__(self, events: Events) -> None:
        """Take the next chunk of events."""
        inside = events[self._take(events)]
        for name, values in self._source.at_events(inside, self._problem).items():
            self._moments[name].add(values[~np.isnan(values)])

    def result(self, final: HybridState, borders: Sequence[Floats]) -> dict[str, float]:
        """Return the statistics of a run that ended at `final`."""
        system = self._source._system
        gains: dict[str, float] = {}
        for each in system.observables:
            if not each.at:
                begin, end = (self._source.value(each, y, self._problem) for y in borders)
                gains[each.name] = end - begin
        # Rates of an autonomous system are per unit of time.
        period = 1.0 if system.forced else float(system.units.out("time", self._window.period))
        totals = self._totals(final, period, gains, self._moments)
        window = self._window.until(final)
        return {
            "window first": window.first * period,
            "window last": window.last * period,
            "impacts": int(totals.impacts(system.automaton.guards)),
            **event_rates(system, totals),
            "chatter sequences": totals.chatter,
            **mode_shares(system, totals),
            **observable_rates(system.observables, totals),
        }


def event_rates(system: SystemDescription, totals: MotionTotals) -> dict[str, Any]:
    """Return the number of impacts, and of events of each guard, per period or unit of time."""
    each = "period" if system.forced else "time"
    guards = system.automaton.guards
    values = {f"impacts per {each}": totals.per_period(totals.impacts(guards))}
    for i, guard in enumerate(guards):
        if guard.name != PLACEHOLDER_GUARD:
            values[f"{guard.name} per {each}"] = totals.per_period(totals.transitions([i]))
    return values


def mode_shares(system: SystemDescription, totals: MotionTotals) -> dict[str, Any]:
    """Return the fraction of time in each mode, if there are several."""
    if len(system.modes) == 1:
        return {}
    return {f"share {mode}": totals.share([i]) for i, mode in enumerate(system.modes)}


def observable_rates(observables: Sequence[Observable], totals: MotionTotals) -> dict[str, Any]:
    """Return the reduced values of observables at events, and the rates of change of others."""
    return {
        each.name: totals.moments[each.name].reduced(each.reduce, totals.periods)
        if each.at
        else totals.per_period(totals.gains[each.name])
        for each in observables
    }


# --- Statistics of attractors in studies.

RETURN = "return time"  # of an autonomous system


class SystemStatistics:
    """The statistics of a system: of runs, of orbits, and of attractors in studies.

    ``state(y)`` and ``parameters(problem)`` return a scaled state and the parameters of a problem
    as the functions of observables receive them.
    """

    def __init__(
        self,
        system: SystemDescription,
        state: Callable[[Floats], Any],
        parameters: Callable[[Problem], Any],
    ) -> None:
        self._system, self._state, self._parameters = system, state, parameters

    @property
    def observables(self) -> tuple[Observable, ...]:
        """The observables that studies record."""
        return self._system.observables

    def value(self, observable: Observable, y: Floats, problem: Problem) -> float:
        """Return an observable at a scaled state."""
        return _value(observable, self._state(y), self._parameters(problem))

    def at_events(self, events: Events, problem: Problem) -> dict[str, Floats]:
        """Return the observables at events in scaled units; NaN where one does not apply."""
        names = [guard.name for guard in self._system.automaton.guards]
        time = self._system.units.out("time", events.cycle * problem.period + events.time)
        totals: dict[str, Floats] = {}
        for each in self._system.observables:
            if each.at:
                values = np.full(len(events), math.nan)
                chosen = np.isin(events.guard, [names.index(name) for name in each.at])
                chosen &= np.isin(events.kind, (workspace.TRANSITION, workspace.ACCUMULATION))
                for i in np.flatnonzero(chosen).tolist():
                    mode, p = int(events.mode_before[i]), self._parameters(problem)
                    before, after = self._state(events.before[i]), self._state(events.after[i])
                    values[i] = _value(each, mode, float(time[i]), before, after, p)
                totals[each.name] = values
        return totals

    @property
    def recorded(self) -> CompiledObservables:
        """The observables that studies record, as one function of scaled states."""
        system, definition = self._system, self._system.definition
        return observed(
            tuple((each.name, each.function, self.codes(each)) for each in self.observables),
            system.states,
            None if definition is None else definition.parameters,
            definition is not None and writes_into_arrays(definition.flow),
            system.units.typical,
        )

    def codes(self, observable: Observable) -> tuple[int, ...]:
        """Return the codes of the transitions at which studies evaluate an observable."""
        guards = [guard.name for guard in self._system.automaton.guards]
        numbers = tuple(guards.index(name) for name in observable.at)
        return (*numbers, *(len(guards) + number for number in numbers))

    def accumulator(
        self, problem: Problem, start: HybridState, window: TimeWindow
    ) -> StatisticsAccumulator:
        """Return the accumulator of the statistics of a run."""
        return RunStatistics(self, problem, start, window)

    def standstill_test(self) -> Callable[[Trajectory], float | None]:
        """Return a test for standstill: the number of periods after which a run rests, or None."""
        problem = "for actuators only; give a function (mode, t, y, p) that falls through zero"
        raise InvalidParameter("until", "still", "", problem=problem)

    def moves(self, instant: HybridState) -> bool:
        """Return whether statistics need the state within an arc."""
        return any(not each.at for each in self._system.observables)

    @property
    def names(self) -> tuple[str, ...]:
        """The headings of the statistics of attractors."""
        each, automaton = "period" if self._system.forced else "time", self._system.automaton
        guards = [guard.name for guard in automaton.guards if guard.name != PLACEHOLDER_GUARD]
        names = [f"impacts per {each}", *(f"{guard} per {each}" for guard in guards)]
        names.append(f"chatter per {each}")
        if len(automaton.modes) > 1:
            names += [f"share {mode}" for mode in automaton.modes]
        for observable in self.observables:
            names.append(observable.name)
            if not observable.at:
                names.append(f"{observable.name} std")
        if any(guard.impact for guard in automaton.guards):
            names.append("closest approach")
        return tuple(names) if self._system.forced else (*names, RETURN)

    def of_attractors(
        self, settled: RecurrenceColumns, periods: Floats, out: Conversion
    ) -> dict[str, Floats]:
        """Return the statistics of attractors that studies write, by heading.

        `out` converts columns to the units of tables; `periods`, shape (points,), are the lengths
        of the statistics, in forcing periods or in the unit of time of tables.
        """
        system, totals = self._system, MotionTotals.of(settled, periods)
        each = "period" if system.forced else "time"
        values = {
            **event_rates(system, totals),
            f"chatter per {each}": totals.per_period(totals.chatter),
            **mode_shares(system, totals),
            **observable_rates(self.observables, totals),
        }
        values |= {f"{name} std": deviation for name, deviation in settled.deviations.items()}
        guards = system.automaton.guards
        if any(guard.impact for guard in guards):
            units = np.array([system.units.margin_factor(guard.name) for guard in guards])
            values["closest approach"] = closest_gap(settled.closest * units, guards)
        result = {name: out(name, value) for name, value in values.items()}
        if not system.forced:
            result[RETURN] = out("time", ratio(settled.duration, settled.measured))
        return result

    @property
    def sweep_columns(self) -> tuple[str, ...]:
        """The statistics in the table of a sweep."""
        counted = "period" if self._system.forced else "time"
        return (f"impacts per {counted}", *(each.name for each in self._system.observables))

    @property
    def plotted(self) -> Mapping[str, tuple[str, str]]:
        """The statistics that a figure of a sweep can show: column and label, by a short name."""
        return {each.name: (each.name, each.name) for each in self._system.observables}

    @property
    def orbit_quantities(self) -> tuple[Quantity, ...]:
        """The quantities of an orbit that `sensitivity` and `optimize` differentiate.

        The gain per period of each cyclic state, the observables (over the orbit, as in the tables
        of branches), the period of a limit cycle, the largest impact speed, the closest approach,
        and the largest modulus of a multiplier.
        """
        system = self._system
        each, automaton = "period" if system.forced else "cycle", system.automaton
        found: list[tuple[str, Callable[[Any], float], str]] = []
        for state in (automaton.states[i] for i in automaton.cyclic):
            found.append((f"{state} per {each}", partial(quantity.gain, state=state), state))
        for name in (other.name for other in system.observables):
            found.append((name, partial(quantity.observable, name=name), name))
        if not system.forced:
            found.append(("period", quantity.period, "time"))
        if any(guard.impact for guard in automaton.guards):
            found.append(("impact speed", quantity.impact_speed, "impact speed"))
            found.append(("closest approach", quantity.closest_approach, "closest approach"))
        quantities = (Quantity(a, f, unit_of(of, system.units)) for a, f, of in found)
        return (*quantities, quantity.MULTIPLIER)


def _value(observable: Observable, *arguments: Any) -> float:
    """Return an observable; FunctionError, with the user's line, if its function fails."""
    try:
        return float(observable.function(*arguments))
    except Exception as error:
        function = UserFunction(f"observable {observable.name}", observable.function)
        raise function.explain_exception(error)[0] from error


def closest_gap(closest: Floats, guards: Sequence[Guard]) -> Floats:
    """Return the smallest gap at which bodies turned back without an impact, or NaN.

    `closest` has the smallest margin of each guard at closest approaches, by columns.
    """
    impacts = [i for i, guard in enumerate(guards) if guard.impact]
    smallest = closest[:, impacts].min(axis=1, initial=math.inf)
    return np.where(np.isfinite(smallest), smallest, math.nan)
