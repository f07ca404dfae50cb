"""Statistics of runs, orbits and attractors."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache, cached_property, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact.hybrid.attractors.mapper import RecurrenceResult
from mems_impact.hybrid.attractors.recurrence import HIGH, LOW, NUMBER, TOTAL
from mems_impact.hybrid.definition import PLACEHOLDER_GUARD
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import Events, Samples, Trajectory
from mems_impact.hybrid.state import HybridState
from mems_impact.orbits.period_detection import flow_at
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.observables import StatisticsAccumulator, TimeWindow

__all__ = [
    "CHAOTIC",
    "FAILED",
    "OFF",
    "PERIODIC",
    "QUASI_PERIODIC",
    "RESTING",
    "SAMPLES_PER_PERIOD",
    "UNSETTLED",
    "Moments",
    "RunStatistics",
    "closest_approach",
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
    found = np.maximum(arc.start.y, arc.final.y)
    if not len(grid.y):
        return np.asarray(found)
    at = grid.cycle * arc.period + grid.time
    for state, i in enumerate(np.argmax(grid.y, axis=0).tolist()):
        found[state] = max(found[state], grid.y[i, state])
        for j in (i - 1, i):
            if j >= 0 and j + 1 < len(grid.y):
                length = float(at[j + 1] - at[j])
                rates = [
                    length * flow_at(arc.problem, HybridState(0, at[k], arc.start.mode, grid.y[k]))
                    for k in (j, j + 1)
                ]
                ends = grid.y[j, state], grid.y[j + 1, state]
                top = _top(*ends, rates[0][state], rates[1][state])
                found[state] = max(found[state], top)
    return np.asarray(found)


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
    at = [each.cycle * run.period + each.time for each in (log, log, grid)]
    # Order at one instant: state before an event, state after it, sample.
    kinds = np.repeat([0, 1, 2], [len(log), len(log), len(grid.y)])
    order = np.lexsort((kinds, np.concatenate(at)))
    time, kinds = np.concatenate(at)[order], kinds[order]
    y = np.concatenate([log.before, log.after, grid.y])[order]
    mode = np.concatenate([log.mode_before, log.mode_after, grid.mode])[order]
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
    found = []
    for begin, end in zip(begins[peaks].tolist(), ends[peaks].tolist(), strict=True):
        top = float(y[begin : end + 1].max())
        for j in (begin - 1, end):
            if arc[j] == arc[j + 1]:
                length = float(time[j + 1] - time[j])
                top = max(top, _top(y[j], y[j + 1], length * slope(j), length * slope(j + 1)))
        found.append(top)
    return np.array(found)


def _top(first: float, last: float, rate: float, last_rate: float) -> float:
    """Return the maximum on [0, 1] of the cubic with these values and rates at the ends."""
    rise = last - first
    cubic, square = rate + last_rate - 2.0 * rise, 3.0 * rise - 2.0 * rate - last_rate
    polynomial = np.polynomial.Polynomial([first, rate, square, cubic])
    turns = polynomial.deriv().roots()
    inside = turns[np.isreal(turns) & (turns.real > 0.0) & (turns.real < 1.0)].real
    return float(max(first, last, *polynomial(inside)))


# --- Names of motions in tables.

# A motion that has not repeated itself is unsettled until its Lyapunov exponent classifies it.
OFF, RESTING, PERIODIC, UNSETTLED, FAILED = "off", "resting", "periodic", "unsettled", "failed"
CHAOTIC, QUASI_PERIODIC = "chaotic", "quasi-periodic"


def counted_periods(count: int) -> str:
    """Return the name of a periodic motion of `count` periods: ``"period 2"``."""
    return f"period {count}"


# --- Moments of values that arrive in chunks.


class Moments:
    """Number, mean, standard deviation and extremes of values that arrive in chunks.

    Attributes
    ----------
    count : int
    mean : float
    low, high : float
        Smallest and largest value.
    """

    def __init__(self) -> None:
        self.count = 0
        self.mean = self._squares = 0.0
        self.low, self.high = math.inf, -math.inf

    def add(self, values: Floats) -> None:
        """Add the next chunk of values."""
        if values.size == 0:
            return
        # Update of Chan, Golub and LeVeque: sums of squares would lose the deviations of nearly
        # equal values.
        mean = float(values.mean())
        squares = float(((values - mean) ** 2).sum())
        total = self.count + values.size
        apart = mean - self.mean
        self._squares += squares + apart * apart * self.count * values.size / total
        self.mean += apart * values.size / total
        self.count = total
        self.low, self.high = (
            min(self.low, float(values.min())),
            max(self.high, float(values.max())),
        )

    def deviation(self) -> float:
        """Return the population standard deviation; NaN without values."""
        return math.sqrt(self._squares / self.count) if self.count else math.nan


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
        self._begin, self._events, self._lengths = begin, events, list(lengths)

    @cached_property
    def ready(self) -> StatisticsAccumulator:
        """The accumulator, after all events."""
        gatherer, first = self._begin(), 0
        for length in self._lengths:
            gatherer(self._events[first : first + length])
            first += length
        return gatherer


class WindowCheckpoints:
    """Starts of the arcs that contain the borders of a window, and durations of the modes."""

    def __init__(self, window: TimeWindow, start: HybridState, modes: int) -> None:
        self._window = window
        self._anchors = [start, start]
        self._last = start  # the last event, whose mode lasts until the next one
        self._remembered = start.remembered  # by the engine, after it
        self.durations = np.zeros(modes)

    def take(self, events: Events) -> None:
        """Take the next chunk of events."""
        if len(events) == 0:
            return
        self._take_durations(events.cycle, events.time, events.mode_after)
        for border in (0, 1):
            begins = events.starts_arc
            begins &= self._window.since(border, events.cycle, events.time) <= 0.0
            places = np.flatnonzero(begins)
            if places.size > 0:
                row = int(places[-1])
                known = events[:row].remembered(self._remembered)
                self._anchors[border] = replace(instant_after(events, row), remembered=known)
        self._last = instant_after(events, len(events) - 1)
        self._remembered = events.remembered(self._remembered)

    def end(self, final: HybridState) -> None:
        """Process the end of the run."""
        self._take_durations(
            np.array([final.cycle]), np.array([final.time]), np.array([final.mode])
        )
        self._last = final

    def __getitem__(self, border: int) -> HybridState:
        return self._anchors[border]

    def _take_durations(
        self, cycle: NDArray[np.int64], time: Floats, mode: NDArray[np.int64]
    ) -> None:
        cycle = np.concatenate([[self._last.cycle], cycle])
        time = np.concatenate([[self._last.time], time])
        during = np.concatenate([[self._last.mode], mode[:-1]]).astype(np.int64)
        lengths = np.diff(cycle) * self._window.period + np.diff(time)
        lengths += np.minimum(self._window.since(0, cycle, time)[:-1], 0.0)
        lengths -= np.maximum(self._window.since(1, cycle, time)[1:], 0.0)
        np.add.at(self.durations, during, np.maximum(lengths, 0.0))


class RunStatistics:
    """Statistics of any system: events by guard, fractions of time in modes, and observables."""

    def __init__(
        self, system: HybridSystem, problem: Problem, start: HybridState, window: TimeWindow
    ) -> None:
        self.resume(system, problem)
        self._window = window
        self._anchors = WindowCheckpoints(window, start, len(system.modes))
        self._counts = np.zeros(len(system.automaton.guards), dtype=np.int64)
        self._chatter = 0
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
        self._anchors.take(events)
        inside = events[self._window.contains(events)]
        fired = inside.guard[inside.kind == workspace.TRANSITION]
        self._counts += np.bincount(fired, minlength=self._counts.size)
        self._chatter += int((inside.kind == workspace.ACCUMULATION).sum())
        for name, values in evaluate_observables(self._system, self._problem, inside).items():
            self._moments[name].add(values[~np.isnan(values)])

    def anchor(self, border: int) -> HybridState:
        """Return the start of the arc that contains the start (0) or end (1) of the window."""
        return self._anchors[border]

    def result(self, final: HybridState, borders: Sequence[Floats]) -> dict[str, float]:
        """Return the statistics of a run that ended at `final`."""
        self._anchors.end(final)
        window, system = self._window.until(final), self._system
        # Rates of an autonomous system are per unit of time.
        unit = 1.0 if system.forced else window.period
        each_period = "per period" if system.forced else "per time"
        first, last = window.first * unit, window.last * unit
        periods = last - first
        guards = [guard for guard in system.automaton.guards if guard.name != PLACEHOLDER_GUARD]
        impacts = sum(
            int(count) for count, guard in zip(self._counts, guards, strict=False) if guard.impact
        )
        values: dict[str, float] = {
            "window first": first,
            "window last": last,
            "impacts": impacts,
            f"impacts {each_period}": ratio(impacts, periods),
        }
        for guard, count in zip(guards, self._counts, strict=False):
            values[f"{guard.name} {each_period}"] = ratio(int(count), periods)
        values["chatter sequences"] = self._chatter
        if len(system.modes) > 1:
            for mode, lasted in zip(system.modes, self._anchors.durations, strict=True):
                duration = (window.last - window.first) * window.period
                values[f"share {mode}"] = ratio(float(lasted), duration)
        for each in system.observables:
            if each.at:
                moments = self._moments[each.name]
                values[each.name] = reduce_values(each.reduce, moments, periods)
            else:
                begin, end = (system.evaluate_observable(each, y, self._problem) for y in borders)
                values[each.name] = ratio(end - begin, periods)
        return values


def evaluate_observables(
    system: HybridSystem, problem: Problem, events: Events
) -> dict[str, Floats]:
    """Return the observables of a system at events; NaN where one does not apply."""
    names = [guard.name for guard in system.automaton.guards]
    found: dict[str, Floats] = {}
    for each in system.observables:
        if each.at:
            values = np.full(len(events), math.nan)
            chosen = np.isin(events.guard, [names.index(name) for name in each.at])
            chosen &= np.isin(events.kind, (workspace.TRANSITION, workspace.ACCUMULATION))
            for i in np.flatnonzero(chosen):
                values[i] = system.evaluate_event_observable(each, events, int(i), problem)
            found[each.name] = values
    return found


def reduce_values(reduce: str, moments: Moments, periods: float) -> float:
    """Return the reduced value of an observable at events."""
    if moments.count == 0:
        return 0.0 if reduce == "sum" else math.nan
    match reduce:
        case "sum":
            return ratio(moments.mean * moments.count, periods)
        case "mean":
            return moments.mean
        case "min":
            return moments.low
    return moments.high


def instant_after(events: Events, row: int) -> HybridState:
    """Return the instant just after an event."""
    return HybridState(
        int(events.cycle[row]),
        float(events.time[row]),
        int(events.mode_after[row]),
        events.after[row].copy(),
    )


def ratio(part: float, whole: float) -> float:
    """Return part / whole, NaN if `whole` is zero."""
    return part / whole if whole > 0 else math.nan


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


def measures(system: HybridSystem, settled: RecurrenceResult, period: float) -> dict[str, float]:
    """Return the statistics of an attractor by heading, in the units of tables.

    Parameters
    ----------
    system : HybridSystem
    settled : RecurrenceResult
    period : float
        The period of the problem, in scaled units.
    """
    lasted = settled.duration / period
    periods = lasted if system.forced else float(system.out("time", settled.duration))
    each = "period" if system.forced else "time"
    automaton = system.automaton
    hits = sum(
        float(count)
        for guard, count in zip(automaton.guards, settled.counts, strict=True)
        if guard.impact
    )
    values = {f"impacts per {each}": ratio(hits, periods)}
    for guard, count in zip(automaton.guards, settled.counts, strict=True):
        if guard.name != PLACEHOLDER_GUARD:
            values[f"{guard.name} per {each}"] = ratio(float(count), periods)
    values[f"chatter per {each}"] = ratio(settled.endings, periods)
    if len(system.modes) > 1:
        for mode, lasted in zip(system.modes, settled.lasted, strict=True):
            values[f"share {mode}"] = ratio(float(lasted), settled.duration)
    for observable in system.study_observables:
        name = observable.name
        if observable.at:
            values[name] = _reduced(observable.reduce, settled.marks[name], periods)
        else:
            values[name] = ratio(settled.gains[name], periods)
            values[f"{name} std"] = settled.deviations[name]
    for name in values:
        values[name] = float(system.out(name, values[name]))
    if any(guard.impact for guard in automaton.guards):
        values["closest approach"] = closest_approach(system, settled)
    if not system.forced:
        values[RETURN] = float(system.out("time", ratio(settled.duration, settled.measured)))
    return values


def closest_approach(system: HybridSystem, settled: RecurrenceResult) -> float:
    """Return the smallest gap at which bodies turned back without an impact, or NaN."""
    guards = system.automaton.guards
    gaps = [
        float(least) * system.margin_unit(guard.name)
        for guard, least in zip(guards, settled.closest, strict=True)
        if guard.impact
    ]
    least = min(gaps, default=math.inf)
    if not math.isfinite(least):
        return math.nan
    return float(system.out("closest approach", least))


def _reduced(reduce: str, mark: np.ndarray, periods: float) -> float:
    if mark[NUMBER] == 0.0:
        return 0.0 if reduce == "sum" else math.nan
    match reduce:
        case "sum":
            return ratio(float(mark[TOTAL]), periods)
        case "mean":
            return float(mark[TOTAL] / mark[NUMBER])
        case "min":
            return float(mark[LOW])
    return float(mark[HIGH])
