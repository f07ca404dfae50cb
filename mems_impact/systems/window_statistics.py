"""Statistics over a window: moments of values, totals of a motion, and their accumulation in a run.

Runs and studies compute their statistics from the same `MotionTotals`.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact.hybrid.attractors.mapper import RecurrenceColumns
from mems_impact.hybrid.attractors.recurrence import HIGH, LOW, NUMBER, TOTAL
from mems_impact.hybrid.automaton import Guard
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.simulation import Events
from mems_impact.hybrid.state import HybridState
from mems_impact.systems.observables import EventObserver


def where(condition: Any, value: Any, other: Any) -> Any:
    """Return `value` where a condition is true, else `other`; of numbers or of columns."""
    if isinstance(condition, np.ndarray):
        return np.where(condition, value, other)
    return value if condition else other


def ratio(part: Any, total: Any) -> Any:
    """Return part / total, NaN where `total` is zero; of numbers or of columns."""
    if isinstance(total, np.ndarray):
        return np.divide(part, total, out=np.full(total.shape, math.nan), where=total > 0)
    return part / total if total > 0 else math.nan


class Moments:
    """Number, sum, standard deviation and extremes of values that arrive in chunks."""

    def __init__(self) -> None:
        self.count, self.total, self._squares = 0, 0.0, 0.0
        self.low, self.high = math.inf, -math.inf

    @classmethod
    def of(cls, mark: Floats) -> Moments:
        """Return columns, of an observable of `RecurrenceColumns`; the deviation is unknown."""
        moments: Any = cls()
        moments.count, moments.total = mark[:, NUMBER], mark[:, TOTAL]
        moments.low, moments.high = mark[:, LOW], mark[:, HIGH]
        moments._squares = math.nan
        return cast(Moments, moments)

    @property
    def mean(self) -> Any:
        """Mean value; NaN without values."""
        return ratio(self.total, self.count)

    def add(self, values: Floats) -> None:
        """Add the next chunk of values."""
        if values.size == 0:
            return
        # Update of Chan, Golub and LeVeque: sums of squares would lose the deviations of nearly
        # equal values.
        mean = float(values.mean())
        self._squares += float(((values - mean) ** 2).sum())
        if self.count:
            difference = mean - self.mean
            total = self.count + values.size
            self._squares += difference * difference * self.count * values.size / total
        self.count += values.size
        self.total += float(values.sum())
        self.low = min(self.low, float(values.min()))
        self.high = max(self.high, float(values.max()))

    def deviation(self) -> float:
        """Return the population standard deviation; NaN without values."""
        return math.sqrt(self._squares / self.count) if self.count else math.nan

    def reduced(self, reduction: str, periods: Any) -> Any:
        """Return the sum per period, the mean, or the smallest or largest value.

        Without values the sum is zero, and the others are NaN.
        """
        if reduction == "sum":
            return where(self.count == 0, 0.0, ratio(self.total, periods))
        value = {"mean": self.mean, "min": self.low, "max": self.high}[reduction]
        return where(self.count == 0, math.nan, value)


@dataclass(frozen=True, kw_only=True)
class MotionTotals:
    """Totals of a motion over a window; or of several motions, by columns.

    Columns have one more axis, the first.
    """

    duration: Any  # length of the window
    periods: Any  # the same in forcing periods; for an autonomous system in its unit of time
    counts: NDArray[Any]  # transitions by guard, shape (m,)
    chatter: Any  # completed chatter sequences
    durations: Floats  # time in each mode, shape (modes,)
    gains: Mapping[str, Any]  # changes of observables of the state
    moments: Mapping[str, Moments]  # of the values of observables at events

    @classmethod
    def of(cls, settled: RecurrenceColumns, periods: Floats) -> MotionTotals:
        """Return the totals of attractors."""
        return cls(
            duration=settled.duration,
            periods=periods,
            counts=settled.counts,
            chatter=settled.endings,
            durations=settled.lasted,
            gains=settled.gains,
            moments={name: Moments.of(mark) for name, mark in settled.marks.items()},
        )

    def per_period(self, total: Any) -> Any:
        """Return a total per period, or per unit of time of an autonomous system."""
        return ratio(total, self.periods)

    def impacts(self, guards: Sequence[Guard]) -> Any:
        """Return the number of impacts, from the first guards of an automaton."""
        return self.transitions([i for i, guard in enumerate(guards) if guard.impact])

    def transitions(self, guards: Sequence[int]) -> Any:
        """Return the number of transitions at some guards."""
        return _sum(self.counts[..., guards])

    def share(self, modes: Sequence[int]) -> Any:
        """Return the fraction of time in some modes."""
        share = ratio(_sum(self.durations[..., modes]), self.duration)
        return where(share > 1.0, 1.0, share)  # the sum of the durations is rounded


def _sum(values: NDArray[Any]) -> Any:
    """Return the sum over the last axis, in the order of its components."""
    total: Any = np.zeros(values.shape[:-1])
    for i in range(values.shape[-1]):
        total = total + values[..., i]
    return total if total.ndim else float(total)


@dataclass(frozen=True)
class TimeWindow:
    """The part of a run over which statistics are computed."""

    first: float  # in periods, as `last`; the window is half-open: an event at its end is outside.
    last: float
    period: float

    def instant(self, border: int) -> tuple[int, float]:
        """Return the start (0) or end (1) as whole periods and the time within the next one."""
        periods = (self.first, self.last)[border]
        cycle = math.floor(periods)
        return cycle, (periods - cycle) * self.period

    def since(self, border: int, cycle: NDArray[np.int64], time: Floats) -> Floats:
        """Return the times since the start (0) or end (1) of the window."""
        at_cycle, at_time = self.instant(border)
        # Subtract whole periods as integers first, so that late instants lose no digits.
        return (cycle - at_cycle) * self.period + (time - at_time)

    def contains(self, events: Events) -> NDArray[np.bool_]:
        """Return which events lie within."""
        inside: NDArray[np.bool_] = self.since(0, events.cycle, events.time) >= 0.0
        return inside & (self.since(1, events.cycle, events.time) < 0.0)

    def until(self, final: HybridState) -> TimeWindow:
        """Return the part before `final`: a failed run may end within the window, or before."""
        reached = final.cycle + final.time / self.period
        return TimeWindow(self.first, max(self.first, min(self.last, reached)), self.period)


class StatisticsAccumulator(EventObserver, ABC):
    """Accumulates statistics over the events of a run; a call takes the next chunk of events.

    Its memory does not grow with the length of the run, which begins at `start`. Events are counted
    of the first `guards` guards.
    """

    def __init__(self, window: TimeWindow, start: HybridState, modes: int, guards: int) -> None:
        self._window = window
        self._anchors = [start, start]  # starts of the arcs that contain the borders of the window
        self._last = start  # the last event, whose mode lasts until the next one
        self._remembered = start.remembered  # by the engine, after it
        self._durations = np.zeros(modes)
        self._counts = np.zeros(guards, dtype=np.int64)
        self._chatter = 0

    @abstractmethod
    def __call__(self, events: Events) -> None:
        """Take the next chunk of events."""

    @abstractmethod
    def result(self, final: HybridState, borders: Sequence[Floats]) -> Mapping[str, float]:
        """Return the statistics of a run that ended at `final`.

        `borders` are the states at the start and end of the window.
        """

    def anchor(self, border: int) -> HybridState:
        """Return the start of the arc that contains the start (0) or end (1) of the window."""
        return self._anchors[border]

    def _take(self, events: Events) -> NDArray[np.bool_]:
        """Count the next events; return a mask of the events within the window."""
        inside = self._window.contains(events)
        if len(events) == 0:
            return inside
        self._take_durations(events.cycle, events.time, events.mode_after)
        for border in (0, 1):
            since = self._window.since(border, events.cycle, events.time) / self._window.period
            rows = np.flatnonzero(events.arcs_until(since))
            if rows.size > 0:
                row = int(rows[-1])
                remembered = events[:row].remembered(self._remembered)
                self._anchors[border] = replace(events.instant(row), remembered=remembered)
        self._last = events.instant(len(events) - 1)
        self._remembered = events.remembered(self._remembered)
        fired = events.guard[inside & (events.kind == workspace.TRANSITION)]
        self._counts += np.bincount(fired, minlength=self._counts.size)[: self._counts.size]
        self._chatter += int((inside & (events.kind == workspace.ACCUMULATION)).sum())
        return inside

    def _totals(
        self,
        final: HybridState,
        period: float,
        gains: Mapping[str, float],
        moments: Mapping[str, Moments],
    ) -> MotionTotals:
        """Return the totals of a run that ended at `final`; rates are per `period` of the window.

        `period` is 1, or the duration of a period in the unit of rates.
        """
        self._take_durations(
            np.array([final.cycle]), np.array([final.time]), np.array([final.mode])
        )
        self._last = final
        window = self._window.until(final)
        return MotionTotals(
            duration=(window.last - window.first) * window.period,
            periods=window.last * period - window.first * period,
            counts=self._counts,
            chatter=self._chatter,
            durations=self._durations,
            gains=gains,
            moments=moments,
        )

    def _take_durations(
        self, cycle: NDArray[np.int64], time: Floats, mode: NDArray[np.int64]
    ) -> None:
        cycle = np.concatenate([[self._last.cycle], cycle])
        time = np.concatenate([[self._last.time], time])
        during = np.concatenate([[self._last.mode], mode[:-1]]).astype(np.int64)
        lengths = np.diff(cycle) * self._window.period + np.diff(time)
        lengths += np.minimum(self._window.since(0, cycle, time)[:-1], 0.0)
        lengths -= np.maximum(self._window.since(1, cycle, time)[1:], 0.0)
        np.add.at(self._durations, during, np.maximum(lengths, 0.0))
