"""Statistics of runs and quantities of orbits of a device.

One accumulator serves every run, kept or streamed, so that each number has one definition. Its
memory and its cost per period do not grow with the length of the run.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact.actuator.automaton import GUARDS, MODES, STATES, V2, X1, X2, side_of
from mems_impact.actuator.impact_statistics import (
    SLIPPING,
    BlowCounter,
    RestDetector,
    contact_loss,
    contacts,
    energy_lost,
    is_impact,
    yields,
)
from mems_impact.actuator.parameters import Actuator
from mems_impact.hybrid.attractors.mapper import RecurrenceResult
from mems_impact.hybrid.attractors.recurrence import HIGH, LOW, NUMBER, TOTAL
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.simulation import Events, Trajectory
from mems_impact.hybrid.state import HybridState
from mems_impact.systems.observables import MULTIPLIER, Quantity, TimeWindow
from mems_impact.systems.statistics import Moments, WindowCheckpoints, closest_approach, ratio

if TYPE_CHECKING:
    from mems_impact.actuator.system import ActuatorSystem

__all__ = [
    "REDUCED",
    "Accumulator",
    "Statistics",
    "actuator_quantities",
    "measure_names",
    "measures",
    "standstill_period",
]

# --- What studies tell of where the motion of an actuator has come to.

REDUCED: tuple[Literal["min", "mean", "max"], ...] = ("min", "mean", "max")
_MEASURES = (
    "impacts per period",
    "displacement per period",
    "displacement per period std",
    "displacement per impact",
    "mean speed",
    *(f"impact speed {reduce}" for reduce in REDUCED),
    "energy lost per period",
    "chatter per period",
    "share slipping",
    "share resting",
    "closest approach",
)
_ENERGY = ("energy in per period", "energy in per impact")  # where it is kept account of
_IMPACT = [guard.impact for guard in GUARDS]
_RESTING = np.array([side_of(mode) != 0 for mode in range(len(MODES))])


def measure_names(system: ActuatorSystem) -> tuple[str, ...]:
    """Return the headings of `measures`."""
    return (*_MEASURES, *_ENERGY) if "energy in" in system.observed.gains else _MEASURES


def measures(system: ActuatorSystem, settled: RecurrenceResult, period: float) -> dict[str, float]:
    """Return what was gathered of a point by heading, as `Statistics` has it.

    The deviation of the displacement is its standard deviation from forcing period to forcing
    period; in contacts with stoppers that yield there are no impact speeds.
    """
    periods = settled.duration / period
    hits = float(settled.counts[_IMPACT].sum())
    gains, marks = settled.gains, settled.marks
    displacement, deviation = gains["step"], settled.deviations["step"]
    speeds = marks["impact speed mean"]
    lost = gains["energy lost"] if "energy lost" in gains else float(marks["energy lost"][TOTAL])
    slipping = float(settled.lasted[SLIPPING].sum())
    resting = float(settled.lasted[_RESTING].sum())
    struck = speeds[NUMBER] > 0.0
    values = {
        "impacts per period": ratio(hits, periods),
        "displacement per period": ratio(displacement, periods),
        "displacement per period std": deviation,
        "displacement per impact": ratio(displacement, hits),
        "mean speed": ratio(displacement, settled.duration),
        "impact speed min": float(speeds[LOW]) if struck else math.nan,
        "impact speed mean": float(speeds[TOTAL] / speeds[NUMBER]) if struck else math.nan,
        "impact speed max": float(speeds[HIGH]) if struck else math.nan,
        "energy lost per period": ratio(lost, periods),
        "chatter per period": ratio(settled.endings, periods),
        "share slipping": ratio(slipping, settled.duration),
        "share resting": ratio(resting, settled.duration),
    }
    if "energy in" in gains:
        given = gains["energy in"]
        values |= zip(_ENERGY, (ratio(given, periods), ratio(given, hits)), strict=True)
    found = {name: float(system.out(name, value)) for name, value in values.items()}
    touched = hits > 0.0
    found["closest approach"] = math.nan if touched else closest_approach(system, settled)
    if not touched and resting > 0.0:
        found["closest approach"] = 0.0
    return found


# --- Statistics of a run, gathered from its events as they come.


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
        that lasts longer than bounces do (see `RestDetector`), and counts when it ends.
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
    start : HybridState
        Where the run begins.
    window : TimeWindow
    """

    def __init__(self, actuator: Actuator, start: HybridState, window: TimeWindow) -> None:
        self._actuator, self._window = actuator, window
        self._anchors = WindowCheckpoints(window, start, len(MODES))
        self._waiting: Events | None = None  # from an impact on whose step has not ended
        self._impacts = self._chatter = 0
        self._speeds = Moments()
        self._steps = Moments()
        self._blows = BlowCounter()
        self._rests = RestDetector(actuator, window.period)
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

    def anchor(self, border: int) -> HybridState:
        """Return the beginning of the arc in which the window begins (0) or ends (1)."""
        return self._anchors[border]

    def result(self, final: HybridState, borders: Sequence[Floats]) -> dict[str, float]:
        """Return the statistics of a run that ended at `final`, by name.

        Parameters
        ----------
        final : HybridState
        borders : sequence of two float array
            The state where the window begins and ends.
        """
        measured = asdict(self.measured(final, borders))
        return {name.replace("_", " "): value for name, value in measured.items()}

    def measured(self, final: HybridState, borders: Sequence[Floats]) -> Statistics:
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
        ended = (events.kind == workspace.ACCUMULATION) & inside
        self._impacts += int(struck.sum())
        self._chatter += int(ended.sum())
        self._speeds.add(np.abs(events.before[struck, V2]))
        if not yields(self._actuator):
            self._energy += float(energy_lost(events[struck | ended], self._actuator).sum())
        turned = events[(events.kind == workspace.APPROACH) & inside]
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


# --- When a device has come to stand still.

MAX_PERIODICITY = 12  # of which motions that repeat in 1, 2, 3, 4, 6 or 12 periods are told
NEAR = 1e-6


def standstill_period(trajectory: Trajectory, actuator: Actuator) -> float | None:
    """Return after how many periods of a run the frame stands still; None if it never does.

    That is when, for 12 periods running, frame and block are at the start of each where they were
    12 periods before: to 1e-6 of delta, and of delta times the natural frequency. A block whose
    swing still grows tells that the frame may move yet.

    Parameters
    ----------
    trajectory : Trajectory
    actuator : Actuator
        In the units of the numerics.
    """
    grid = trajectory.samples(per_period=1)
    near = np.array([1.0, (actuator.k / actuator.m2) ** 0.5] * 2) * NEAR * actuator.delta
    own = NEAR * np.abs(grid.y[:, len(STATES) :]).max(axis=0, initial=0.0)  # of terms
    apart = np.abs(grid.y[MAX_PERIODICITY:] - grid.y[:-MAX_PERIODICITY])
    same = (apart <= np.concatenate([near, own])).all(axis=1)
    running = (
        np.convolve(same, np.ones(MAX_PERIODICITY), mode="valid")
        if same.size >= MAX_PERIODICITY
        else same
    )
    found = np.flatnonzero(running >= MAX_PERIODICITY)
    if found.size == 0:
        return None
    start = trajectory.start
    cycle = int(grid.cycle[found[0] + 2 * MAX_PERIODICITY - 1])
    return cycle - start.cycle - start.time / trajectory.period


# --- The numbers of an actuator's orbit that its designers want to move.


def _per_period(orbit: Any) -> float:
    return float(orbit.step / orbit.periods)


def _per_impact(orbit: Any) -> float:
    impacts = len(orbit.impact_speeds)
    return float(orbit.step / impacts) if impacts else math.nan


def _mean_speed(orbit: Any) -> float:
    return float(orbit.step / (orbit.periods * orbit.period))


def _impact_speed(orbit: Any) -> float:
    return float(max(orbit.impact_speeds, default=math.nan))


def _closest_approach(orbit: Any) -> float:
    return float(orbit.closest_approach)


def _energy_lost(orbit: Any) -> float:
    return float(orbit.observables["energy lost"] / orbit.periods)


def _energy_given(orbit: Any) -> float:
    from mems_impact.actuator.design.energy import energy  # which needs the system itself

    return energy(orbit).given / orbit.periods


FUNCTIONS = {
    "displacement per period": _per_period,
    "mean speed": _mean_speed,
    "displacement per impact": _per_impact,
    "impact speed": _impact_speed,
    "closest approach": _closest_approach,
    "energy lost per period": _energy_lost,
}
"""By the names that tables and statistics have for them."""


def actuator_quantities(units: Mapping[str, str]) -> tuple[Quantity, ...]:
    """Return the quantities of an actuator's orbits.

    Of the energy, what impacts lose; asked for, what the drive gives too, which takes an
    integration of the orbit's arcs.
    """
    known = [Quantity(name, each, units.get(name, "")) for name, each in FUNCTIONS.items()]
    joule = units.get("energy lost per period", "")
    given = Quantity("energy given per period", _energy_given, joule, costly=True)
    return (*known, given, MULTIPLIER)
