"""Statistics of a run, gathered from its events as they come.

One accumulator serves every run, kept or streamed, so that each number has one definition. Its
memory and its cost per period do not grow with the length of the run.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from mems_impact.actuator.design.blows import BlowCounter, contacts
from mems_impact.actuator.design.impacts import (
    SLIPPING,
    contact_loss,
    energy_lost,
    is_impact,
    yields,
)
from mems_impact.actuator.design.rests import Rests
from mems_impact.actuator.modes import MODES, V2, X1, X2, side_of
from mems_impact.actuator.parameters import Actuator
from mems_impact.analysis.moments import Moments
from mems_impact.analysis.statistics import Anchors, Span, ratio
from mems_impact.hybrid import loop
from mems_impact.hybrid.trajectory import Events, Floats, Instant

__all__ = ["Accumulator", "Statistics"]

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
        Shares of the time in which the frame slips, and in which the block rests on a stopper; on
        one that yields, in which it is in contact.
    closest_approach : float
        Smallest distance from a stopper at which the block turned back in a window without
        impacts; 0 if it rested on a stopper.
    chatter_sequences : int
        Sequences of impacts that ended in rest on a stopper. Rest on one that yields is a contact
        that lasts longer than bounces do (see `Rests`), and counts when it ends.
    energy_lost_per_period : float
        In impacts, chatter included, and in contacts with stoppers that yield.
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
        In the units of the numerics.
    start : Instant
        Where the run begins.
    window : Span
    """

    def __init__(self, actuator: Actuator, start: Instant, window: Span) -> None:
        self._actuator, self._window = actuator, window
        self._anchors = Anchors(window, start, len(MODES))
        self._waiting: Events | None = None  # from an impact on whose step has not ended
        self._impacts = self._chatter = 0
        self._speeds = Moments()
        self._steps = Moments()
        self._blows = BlowCounter()
        self._rests = Rests(actuator, window.period)
        self._energy = 0.0
        self._closest = math.inf

    def __call__(self, events: Events) -> None:
        """Take the next chunk of events."""
        if len(events) == 0:
            return
        events = self._rests(events)
        self._anchors.take(events)
        self._take_impacts(events, self._window.contains(events))
        self._take_steps(events)

    def anchor(self, border: int) -> Instant:
        """Return the beginning of the arc in which the window begins (0) or ends (1)."""
        return self._anchors[border]

    def result(self, final: Instant, borders: Sequence[Floats]) -> dict[str, float]:
        """Return the statistics of a run that ended at `final`, by name.

        Parameters
        ----------
        final : Instant
        borders : sequence of two float array
            The state where the window begins and ends.
        """
        measured = asdict(self.measured(final, borders))
        return {name.replace("_", " "): value for name, value in measured.items()}

    def measured(self, final: Instant, borders: Sequence[Floats]) -> Statistics:
        """Return the same as an object."""
        window = self._window.until(final)
        self._anchors.end(final)
        if self._waiting is not None:
            self._take_steps(self._waiting[:0], last=True)
        displacement = float(borders[1][X1] - borders[0][X1])
        periods = window.last - window.first
        duration = periods * window.period
        impacts, blows = self._impacts, self._blows.count
        closest = self._closest if math.isfinite(self._closest) else math.nan
        energy = self._energy
        if yields(self._actuator):
            place = contact_loss(self._actuator)
            energy = float(borders[1][place] - borders[0][place])
        slipping = float(self._anchors.durations[SLIPPING].sum())
        resting = float(self._anchors.durations[_RESTING].sum())
        if resting > 0.0:
            closest = 0.0
        return Statistics(
            window_first=window.first,
            window_last=window.last,
            periods=periods,
            impacts=impacts,
            impacts_per_period=ratio(impacts, periods),
            blows=blows,
            blows_per_period=ratio(blows, periods),
            displacement_per_period=ratio(displacement, periods),
            displacement_per_impact=ratio(displacement, impacts),
            displacement_per_impact_std=self._steps.deviation(),
            displacement_per_blow=ratio(displacement, blows),
            displacement_per_blow_std=self._blows.displacements.deviation(),
            mean_speed=ratio(displacement, duration),
            impact_speed_min=self._speeds.low if impacts else math.nan,
            impact_speed_mean=self._speeds.mean if impacts else math.nan,
            impact_speed_max=self._speeds.high if impacts else math.nan,
            share_slipping=ratio(slipping, duration),
            share_resting=ratio(resting, duration),
            closest_approach=math.nan if impacts else closest,
            chatter_sequences=self._chatter,
            energy_lost_per_period=ratio(energy, periods),
        )

    def _take_impacts(self, events: Events, inside: NDArray[np.bool_]) -> None:
        struck = is_impact(events) & inside
        ended = (events.kind == loop.ACCUMULATION) & inside
        self._impacts += int(struck.sum())
        self._chatter += int(ended.sum())
        self._speeds.add(np.abs(events.before[struck, V2]))
        if not yields(self._actuator):
            self._energy += float(energy_lost(events[struck | ended], self._actuator).sum())
        turned = events[(events.kind == loop.APPROACH) & inside]
        side = np.where(turned.guard == 0, 1.0, -1.0)
        gaps = self._actuator.delta - side * turned.before[:, X2]
        self._closest = min(self._closest, float(gaps.min(initial=math.inf)))

    def _take_steps(self, events: Events, *, last: bool = False) -> None:
        if self._waiting is not None:
            events = Events.joined([self._waiting, events])
        log, steps = contacts(events)
        inside = self._window.contains(log)
        open_ = np.isnan(steps)
        self._steps.add(steps[is_impact(log) & inside & ~open_])
        # Only the last impact can wait for its end, and the end of chatter with it.
        held = int(np.argmax(open_)) if open_.any() and not last else len(log)
        self._waiting = log[held:]
        self._blows.add(log[:held], steps[:held], inside[:held], last=last)
