"""Statistics of runs, orbits and attractors."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache, cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats, distance_to_nearest
from mems_impact.hybrid.attractors.mapper import RecurrenceColumns
from mems_impact.hybrid.automaton import Guard
from mems_impact.hybrid.definition import PLACEHOLDER_GUARD
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import INSTANT_RTOL, Events, Samples, Trajectory
from mems_impact.hybrid.state import HybridState
from mems_impact.orbits.period_detection import flow_at
from mems_impact.systems.base import Conversion, HybridSystem
from mems_impact.systems.observables import Observable
from mems_impact.systems.window_statistics import (
    Moments,
    MotionTotals,
    StatisticsAccumulator,
    TimeWindow,
    ratio,
)

__all__ = [
    "CHAOTIC",
    "FAILED",
    "OFF",
    "PERIODIC",
    "QUASI_PERIODIC",
    "RESTING",
    "SAMPLES_PER_PERIOD",
    "UNSETTLED",
    "RunStatistics",
    "closest_gap",
    "counted_periods",
    "evaluate_observables",
    "largest_values",
    "maxima",
    "measure_names",
    "measures",
]

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
    monotonic state has none.

    Parameters
    ----------
    run : Trajectory
    first : float
        In periods of the run's problem.
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

    Parameters
    ----------
    begin : callable
        Creates the accumulator. If an observable fails, the next access starts again from the first
        event.
    events : Events
        All events that the run has kept.
    lengths : sequence of int
        Lengths of the chunks in which they arrived: sums are computed chunk by chunk.
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
        self, system: HybridSystem, problem: Problem, start: HybridState, window: TimeWindow
    ) -> None:
        super().__init__(window, start, len(system.modes), len(system.automaton.guards))
        self.resume(system, problem)
        self._moments = {each.name: Moments() for each in system.observables if each.at}

    def resume(self, system: HybridSystem, problem: Problem) -> None:
        """Continue with a system and its problem."""
        self._system, self._problem = system, problem

    def gathered(self) -> dict[str, Any]:
        """Return the accumulated data, from which `of` continues."""
        linked = ("_system", "_problem")
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
        for name, values in evaluate_observables(self._system, self._problem, inside).items():
            self._moments[name].add(values[~np.isnan(values)])

    def result(self, final: HybridState, borders: Sequence[Floats]) -> dict[str, float]:
        """Return the statistics of a run that ended at `final`."""
        system = self._system
        gains: dict[str, float] = {}
        for each in system.observables:
            if not each.at:
                begin, end = (system.evaluate_observable(each, y, self._problem) for y in borders)
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


def evaluate_observables(
    system: HybridSystem, problem: Problem, events: Events
) -> dict[str, Floats]:
    """Return the observables of a system at events; NaN where one does not apply."""
    names = [guard.name for guard in system.automaton.guards]
    totals: dict[str, Floats] = {}
    for each in system.observables:
        if each.at:
            values = np.full(len(events), math.nan)
            chosen = np.isin(events.guard, [names.index(name) for name in each.at])
            chosen &= np.isin(events.kind, (workspace.TRANSITION, workspace.ACCUMULATION))
            for i in np.flatnonzero(chosen):
                values[i] = system.evaluate_event_observable(each, events, int(i), problem)
            totals[each.name] = values
    return totals


def event_rates(system: HybridSystem, totals: MotionTotals) -> dict[str, Any]:
    """Return the number of impacts, and of events of each guard, per period or unit of time."""
    each = "period" if system.forced else "time"
    guards = system.automaton.guards
    values = {f"impacts per {each}": totals.per_period(totals.impacts(guards))}
    for i, guard in enumerate(guards):
        if guard.name != PLACEHOLDER_GUARD:
            values[f"{guard.name} per {each}"] = totals.per_period(totals.transitions([i]))
    return values


def mode_shares(system: HybridSystem, totals: MotionTotals) -> dict[str, Any]:
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


def measure_names(system: HybridSystem) -> tuple[str, ...]:
    """Return the headings of `measures`."""
    each = "period" if system.forced else "time"
    names = [f"impacts per {each}"]
    guards = [guard.name for guard in system.automaton.guards if guard.name != PLACEHOLDER_GUARD]
    names += [f"{guard} per {each}" for guard in guards] + [f"chatter per {each}"]
    if len(system.modes) > 1:
        names += [f"share {mode}" for mode in system.modes]
    for observable in system.study_observables:
        names.append(observable.name)
        if not observable.at:
            names.append(f"{observable.name} std")
    if any(guard.impact for guard in system.automaton.guards):
        names.append("closest approach")
    return tuple(names) if system.forced else (*names, RETURN)


def measures(
    system: HybridSystem, settled: RecurrenceColumns, periods: Floats, out: Conversion
) -> dict[str, Floats]:
    """Return the statistics of attractors by heading; see `HybridSystem.measures`."""
    totals = MotionTotals.of(settled, periods)
    each = "period" if system.forced else "time"
    values = {
        **event_rates(system, totals),
        f"chatter per {each}": totals.per_period(totals.chatter),
        **mode_shares(system, totals),
        **observable_rates(system.study_observables, totals),
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


def closest_gap(closest: Floats, guards: Sequence[Guard]) -> Floats:
    """Return the smallest gap at which bodies turned back without an impact, or NaN.

    `closest` has the smallest margin of each guard at closest approaches, by columns.
    """
    impacts = [i for i, guard in enumerate(guards) if guard.impact]
    smallest = closest[:, impacts].min(axis=1, initial=math.inf)
    return np.where(np.isfinite(smallest), smallest, math.nan)
