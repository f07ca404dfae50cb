"""Statistics of a run, gathered from its events as they come.

One accumulator serves every run, kept or streamed, so that each number has one definition. Its
memory and its cost per period do not grow with the length of the run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mems_impact.actuator.modes import MODES, V2, X2, side_of
from mems_impact.actuator.parameters import Actuator
from mems_impact.hybrid import loop
from mems_impact.hybrid.trajectory import Events, Floats, Instant
from mems_impact.studies.blows import BlowCounter, contacts
from mems_impact.studies.impacts import (
    SLIPPING,
    begins_arc,
    concatenate,
    energy_lost,
    is_impact,
)
from mems_impact.studies.moments import Moments

__all__ = ["Accumulator", "Statistics", "instant_of"]

_RESTING = np.array([side_of(mode) != 0 for mode in range(len(MODES))])


@dataclass(frozen=True, kw_only=True)
class Statistics:
    """What a run did over a window.

    NaN stands for what is not defined: speeds and displacements per impact and per blow without
    one, the closest approach with one.

    Attributes
    ----------
    window_first, window_last : float
        The window, in forcing periods; half open: an event at its end is outside.
    periods : float
        Its length.
    impacts : int
        Every bounce is one.
    impacts_per_period : float
    blows : int
        Blows that begin in the window: a sequence of ever weaker impacts on one stopper that ends
        in rest is one blow, as an experiment sees it; every other impact is a blow of its own, as
        are those of a sequence that the end of the run cuts short.
    blows_per_period : float
    displacement_per_period : float
        Displacement of the frame over the window, by its length.
    displacement_per_impact : float
        The same, by the number of impacts.
    displacement_per_impact_std : float
        Standard deviation of the steps of the frame (see `frame_steps`) after the impacts of the
        window, over their number. A step that no rest and no impact has ended is left out.
    displacement_per_blow : float
        Displacement of the frame over the window, by the number of blows.
    displacement_per_blow_std : float
        Standard deviation of the displacements of the blows, each the sum of the steps after its
        impacts, over their number. A blow whose last step has not ended is left out.
    mean_speed : float
        Displacement of the frame over the window, by its duration.
    impact_speed_min, impact_speed_mean, impact_speed_max : float
        Of abs(v2) before the impacts.
    share_slipping, share_resting : float
        Shares of the time in which the frame slips, and in which the block rests on a stopper.
    closest_approach : float
        Smallest distance from a stopper at which the block turned back in a window without
        impacts; 0 if it rested on a stopper.
    chatter_sequences : int
        Sequences of impacts that ended in rest on a stopper.
    energy_lost_per_period : float
        In impacts, chatter included.
    """

    window_first: float
    window_last: float
    periods: float
    impacts: int
    impacts_per_period: float
    blows: int
    blows_per_period: float
    displacement_per_period: float
    displacement_per_impact: float
    displacement_per_impact_std: float
    displacement_per_blow: float
    displacement_per_blow_std: float
    mean_speed: float
    impact_speed_min: float
    impact_speed_mean: float
    impact_speed_max: float
    share_slipping: float
    share_resting: float
    closest_approach: float
    chatter_sequences: int
    energy_lost_per_period: float


class Accumulator:
    """Gathers the statistics of one run; called with every chunk of its events.

    Parameters
    ----------
    actuator : Actuator
    period : float
        Forcing period.
    start : Instant
        Where the run begins.
    window : tuple of float
        First and last forcing period.
    """

    def __init__(
        self, actuator: Actuator, period: float, start: Instant, window: tuple[float, float]
    ) -> None:
        self._actuator, self._period, self._window = actuator, period, window
        self._borders = tuple(instant_of(border, period) for border in window)
        self._anchors = [start, start]
        self._last = start  # the latest event, whose mode lasts until the next one
        self._waiting: Events | None = None  # from an impact on whose step has not ended
        self._impacts = self._chatter = 0
        self._speeds = Moments()
        self._steps = Moments()
        self._blows = BlowCounter()
        self._slipping = self._resting = self._energy = 0.0
        self._closest = math.inf

    def __call__(self, events: Events) -> None:
        """Take the next chunk of events."""
        if len(events) == 0:
            return
        after_first = self._since(0, events.cycle, events.time) >= 0.0
        before_last = self._since(1, events.cycle, events.time) < 0.0
        inside = after_first & before_last
        self._take_durations(events.cycle, events.time, events.mode_after)
        self._take_impacts(events, inside)
        self._take_steps(events)
        self._keep_anchors(events)
        end = len(events) - 1
        self._last = _instant(events, end)

    def anchor(self, border: int) -> Instant:
        """Return the beginning of the arc in which the window begins (0) or ends (1)."""
        return self._anchors[border]

    def result(self, final: Instant, positions: Sequence[float]) -> Statistics:
        """Return the statistics of a run that ended at `final`.

        Parameters
        ----------
        final : Instant
        positions : sequence of two float
            x1 where the window begins and ends.
        """
        # A run that failed may have ended within the window, or before it.
        first, last = self._window
        last = max(first, min(last, final.cycle + final.time / self._period))
        self._take_durations(
            np.array([final.cycle]), np.array([final.time]), np.array([final.mode])
        )
        self._last = final
        if self._waiting is not None:
            self._take_steps(self._waiting[:0], last=True)
        displacement = positions[1] - positions[0]
        periods = last - first
        duration = periods * self._period
        impacts, blows = self._impacts, self._blows.count
        closest = self._closest if math.isfinite(self._closest) else math.nan
        if self._resting > 0.0:
            closest = 0.0
        return Statistics(
            window_first=first,
            window_last=last,
            periods=periods,
            impacts=impacts,
            impacts_per_period=_ratio(impacts, periods),
            blows=blows,
            blows_per_period=_ratio(blows, periods),
            displacement_per_period=_ratio(displacement, periods),
            displacement_per_impact=_ratio(displacement, impacts),
            displacement_per_impact_std=self._steps.deviation(),
            displacement_per_blow=_ratio(displacement, blows),
            displacement_per_blow_std=self._blows.displacements.deviation(),
            mean_speed=_ratio(displacement, duration),
            impact_speed_min=self._speeds.low if impacts else math.nan,
            impact_speed_mean=self._speeds.mean if impacts else math.nan,
            impact_speed_max=self._speeds.high if impacts else math.nan,
            share_slipping=_ratio(self._slipping, duration),
            share_resting=_ratio(self._resting, duration),
            closest_approach=math.nan if impacts else closest,
            chatter_sequences=self._chatter,
            energy_lost_per_period=_ratio(self._energy, periods),
        )

    def _since(self, border: int, cycle: NDArray[np.int64], time: Floats) -> Floats:
        """Return the times from the beginning (0) or end (1) of the window."""
        at_cycle, at_time = self._borders[border]
        # Periods are counted in integers first, so that late ones lose no digits.
        result: Floats = (cycle - at_cycle) * self._period + (time - at_time)
        return result

    def _take_durations(
        self, cycle: NDArray[np.int64], time: Floats, mode: NDArray[np.int64]
    ) -> None:
        cycle = np.concatenate([[self._last.cycle], cycle])
        time = np.concatenate([[self._last.time], time])
        during = np.concatenate([[self._last.mode], mode[:-1]]).astype(np.int64)
        lengths = np.diff(cycle) * self._period + np.diff(time)
        lengths += np.minimum(self._since(0, cycle, time)[:-1], 0.0)
        lengths -= np.maximum(self._since(1, cycle, time)[1:], 0.0)
        lengths = np.maximum(lengths, 0.0)
        self._slipping += float(lengths[SLIPPING[during]].sum())
        self._resting += float(lengths[_RESTING[during]].sum())

    def _take_impacts(self, events: Events, inside: NDArray[np.bool_]) -> None:
        struck = is_impact(events) & inside
        ended = (events.kind == loop.ACCUMULATION) & inside
        self._impacts += int(struck.sum())
        self._chatter += int(ended.sum())
        self._speeds.add(np.abs(events.before[struck, V2]))
        self._energy += float(energy_lost(events[struck | ended], self._actuator).sum())
        turned = events[(events.kind == loop.APPROACH) & inside]
        side = np.where(turned.guard == 0, 1.0, -1.0)
        gaps = self._actuator.delta - side * turned.before[:, X2]
        self._closest = min(self._closest, float(gaps.min(initial=math.inf)))

    def _take_steps(self, events: Events, *, last: bool = False) -> None:
        if self._waiting is not None:
            events = concatenate([self._waiting, events])
        log, steps = contacts(events)
        inside = self._since(0, log.cycle, log.time) >= 0.0
        inside &= self._since(1, log.cycle, log.time) < 0.0
        open_ = np.isnan(steps)
        self._steps.add(steps[is_impact(log) & inside & ~open_])
        # Only the last impact can wait for its end, and the end of chatter with it.
        held = int(np.argmax(open_)) if open_.any() and not last else len(log)
        self._waiting = log[held:]
        self._blows.add(log[:held], steps[:held], inside[:held], last=last)

    def _keep_anchors(self, events: Events) -> None:
        for border in (0, 1):
            begins = begins_arc(events)
            begins &= self._since(border, events.cycle, events.time) <= 0.0
            places = np.flatnonzero(begins)
            if places.size > 0:
                self._anchors[border] = _instant(events, int(places[-1]))


def instant_of(border: float, period: float) -> tuple[int, float]:
    """Return a number of periods as whole periods and the time within the next one."""
    whole = math.floor(border)
    return whole, (border - whole) * period


def _instant(events: Events, row: int) -> Instant:
    return Instant(
        int(events.cycle[row]),
        float(events.time[row]),
        int(events.mode_after[row]),
        events.after[row].copy(),
    )


def _ratio(part: float, whole: float) -> float:
    return part / whole if whole > 0 else math.nan
