"""Statistics of a run, gathered while it goes on, so that long runs need no more memory."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mems_impact.analysis.moments import Moments
from mems_impact.hybrid import loop
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.trajectory import Events, Floats, Instant
from mems_impact.hybrid.written import NO_GUARD

if TYPE_CHECKING:
    from mems_impact.analysis.system import System

__all__ = ["Gatherer", "Gathering", "Span", "Watcher", "observed"]


class Gatherer(Protocol):
    """Takes the events of a run as they come and says at the end what they amount to."""

    def __call__(self, events: Events) -> None:
        """Take the next chunk of events."""

    def anchor(self, border: int) -> Instant:
        """Return the beginning of the arc in which the window begins (0) or ends (1)."""

    def result(self, final: Instant, borders: Sequence[Floats]) -> Mapping[str, float]:
        """Return the statistics of a run that ended at `final`.

        `borders` are the states where the window begins and ends.
        """


class Watcher(Protocol):
    """Looks at the events of a run as they come, and tells what the user should know of it."""

    def __call__(self, events: Events) -> None:
        """Take the next chunk of events."""

    def tell(self, final: Instant) -> None:
        """Tell it of a run that ended at `final`."""


class Deferred:
    """A gatherer that takes the events of a run when it is first asked for what they amount to.

    Parameters
    ----------
    begin : callable
        Makes the gatherer. One that an observable has interrupted is begun again, not gone on with.
    events : Events
        All that the run has kept.
    lengths : sequence of int
        Of the chunks in which they came: sums are made chunk by chunk.
    """

    def __init__(
        self, begin: Callable[[], Gatherer], events: Events, lengths: Sequence[int]
    ) -> None:
        self._begin, self._events, self._lengths = begin, events, list(lengths)

    @cached_property
    def ready(self) -> Gatherer:
        """The gatherer, with all events."""
        gatherer, first = self._begin(), 0
        for length in self._lengths:
            gatherer(self._events[first : first + length])
            first += length
        return gatherer


@dataclass(frozen=True)
class Span:
    """The part of a run that statistics are about.

    Attributes
    ----------
    first, last : float
        In periods; half open: an event at its end is outside.
    period : float
    """

    first: float
    last: float
    period: float

    def instant(self, border: int) -> tuple[int, float]:
        """Return a border as whole periods and the time within the next one."""
        periods = (self.first, self.last)[border]
        whole = math.floor(periods)
        return whole, (periods - whole) * self.period

    def since(self, border: int, cycle: NDArray[np.int64], time: Floats) -> Floats:
        """Return the times from the beginning (0) or end (1) of the window."""
        at_cycle, at_time = self.instant(border)
        # Periods are counted in integers first, so that late ones lose no digits.
        result: Floats = (cycle - at_cycle) * self.period + (time - at_time)
        return result

    def contains(self, events: Events) -> NDArray[np.bool_]:
        """Return which events lie within."""
        inside: NDArray[np.bool_] = self.since(0, events.cycle, events.time) >= 0.0
        return inside & (self.since(1, events.cycle, events.time) < 0.0)

    def until(self, final: Instant) -> Span:
        """Return what lies before `final`: a run that failed may have ended within, or before."""
        reached = final.cycle + final.time / self.period
        return Span(self.first, max(self.first, min(self.last, reached)), self.period)


class Anchors:
    """Where the arcs begin in which a window begins and ends, and how long each mode has lasted."""

    def __init__(self, window: Span, start: Instant, modes: int) -> None:
        self._window = window
        self._anchors = [start, start]
        self._last = start  # the latest event, whose mode lasts until the next one
        self._remembered = start.remembered  # by the engine, after it
        self.durations = np.zeros(modes)

    def take(self, events: Events) -> None:
        """Take the next chunk of events."""
        if len(events) == 0:
            return
        self._take_durations(events.cycle, events.time, events.mode_after)
        for border in (0, 1):
            begins = events.begin_arcs
            begins &= self._window.since(border, events.cycle, events.time) <= 0.0
            places = np.flatnonzero(begins)
            if places.size > 0:
                row = int(places[-1])
                known = events[:row].remembered(self._remembered)
                self._anchors[border] = replace(instant_after(events, row), remembered=known)
        self._last = instant_after(events, len(events) - 1)
        self._remembered = events.remembered(self._remembered)

    def end(self, final: Instant) -> None:
        """Take the end of the run."""
        self._take_durations(
            np.array([final.cycle]), np.array([final.time]), np.array([final.mode])
        )
        self._last = final

    def __getitem__(self, border: int) -> Instant:
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


class Gathering:
    """What is told of any system: events by guard, shares of modes, and its observables."""

    def __init__(self, system: System, problem: Problem, start: Instant, window: Span) -> None:
        self.resume(system, problem)
        self._window = window
        self._anchors = Anchors(window, start, len(system.modes))
        self._counts = np.zeros(len(system.automaton.guards), dtype=np.int64)
        self._chatter = 0
        self._moments = {each.name: Moments() for each in system.observables if each.at}

    def resume(self, system: System, problem: Problem) -> None:
        """Go on for a system and what is integrated of it."""
        self._system, self._problem = system, problem

    def gathered(self) -> dict[str, Any]:
        """Return what was gathered so far, from which `of` goes on."""
        linked = ("_system", "_problem")
        return {name: value for name, value in vars(self).items() if name not in linked}

    @classmethod
    def of(cls, **gathered: Any) -> Gathering:
        """Return what had gathered this; it waits for `resume`."""
        gathering = cls.__new__(cls)
        vars(gathering).update(gathered)
        return gathering

    def __call__(self, events: Events) -> None:
        """Take the next chunk of events."""
        self._anchors.take(events)
        inside = events[self._window.contains(events)]
        fired = inside.guard[inside.kind == loop.TRANSITION]
        self._counts += np.bincount(fired, minlength=self._counts.size)
        self._chatter += int((inside.kind == loop.ACCUMULATION).sum())
        for name, values in observed(self._system, self._problem, inside).items():
            self._moments[name].add(values[~np.isnan(values)])

    def anchor(self, border: int) -> Instant:
        """Return the beginning of the arc in which the window begins (0) or ends (1)."""
        return self._anchors[border]

    def result(self, final: Instant, borders: Sequence[Floats]) -> dict[str, float]:
        """Return the statistics of a run that ended at `final`."""
        self._anchors.end(final)
        window, system = self._window.until(final), self._system
        # Without forcing periods, time itself is counted.
        unit = 1.0 if system.forced else window.period
        each_period = "per period" if system.forced else "per time"
        first, last = window.first * unit, window.last * unit
        periods = last - first
        guards = [guard for guard in system.automaton.guards if guard.name != NO_GUARD]
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
                values[each.name] = reduced(each.reduce, moments, periods)
            else:
                begin, end = (system.measure(each, y, self._problem) for y in borders)
                values[each.name] = ratio(end - begin, periods)
        return values


def observed(system: System, problem: Problem, events: Events) -> dict[str, Floats]:
    """Return the observables of a system at events; NaN where one does not apply."""
    names = [guard.name for guard in system.automaton.guards]
    found: dict[str, Floats] = {}
    for each in system.observables:
        if each.at:
            values = np.full(len(events), math.nan)
            chosen = np.isin(events.guard, [names.index(name) for name in each.at])
            chosen &= np.isin(events.kind, (loop.TRANSITION, loop.ACCUMULATION))
            for i in np.flatnonzero(chosen):
                values[i] = system.measure_event(each, events, int(i), problem)
            found[each.name] = values
    return found


def reduced(reduce: str, moments: Moments, periods: float) -> float:
    """Return what is told of the values of an observable at events."""
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


def instant_after(events: Events, row: int) -> Instant:
    """Return the instant just after an event."""
    return Instant(
        int(events.cycle[row]),
        float(events.time[row]),
        int(events.mode_after[row]),
        events.after[row].copy(),
    )


def ratio(part: float, whole: float) -> float:
    """Return part / whole, NaN where there is nothing to share."""
    return part / whole if whole > 0 else math.nan
