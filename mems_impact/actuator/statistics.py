"""Statistics of runs and attractors, and quantities of orbits, of a device."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from operator import attrgetter
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.actuator.automaton import GUARDS, IMPACTS, MODES, direction_of
from mems_impact.actuator.design.energy import energy
from mems_impact.actuator.equations import STATES, V2, X1, X2
from mems_impact.actuator.impact_statistics import (
    BlowCounter,
    RestDetector,
    contact_loss,
    contact_side,
    contacts,
    energy_lost,
    is_impact,
    is_slipping,
)
from mems_impact.actuator.parameters import ActuatorParameters
from mems_impact.actuator.terms.base import is_compliant
from mems_impact.hybrid.attractors.mapper import RecurrenceColumns
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import Events, Trajectory
from mems_impact.hybrid.state import HybridState
from mems_impact.systems import observables
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.observables import MULTIPLIER, Observable, Quantity
from mems_impact.systems.statistics import SystemStatistics, closest_gap
from mems_impact.systems.units import Conversion
from mems_impact.systems.window_statistics import (
    Moments,
    MotionTotals,
    StatisticsAccumulator,
    TimeWindow,
    ratio,
    where,
)

# --- Statistics of attractors

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
_ENERGY = ("energy in per period", "energy in per impact")  # with energy accounting


def motion_values(totals: MotionTotals, impacts: Any, speeds: Moments) -> dict[str, Any]:
    """Return the common statistics of runs and studies, by heading."""
    displacement, lost = totals.gains["step"], totals.gains.get("energy lost")
    if lost is None:
        lost = totals.moments["energy lost"].total
    return {
        "impacts per period": totals.per_period(impacts),
        "displacement per period": totals.per_period(displacement),
        "displacement per impact": ratio(displacement, impacts),
        "mean speed": ratio(displacement, totals.duration),
        **{f"impact speed {each}": speeds.reduced(each, totals.periods) for each in REDUCED},
        "energy lost per period": totals.per_period(lost),
        "share slipping": totals.share(_modes_with(is_slipping, totals)),
        "share resting": resting_share(totals),
    }


def resting_share(totals: MotionTotals) -> Any:
    """Return the fraction of time in which the block rests on a stopper."""
    return totals.share(_modes_with(contact_side, totals))


def _modes_with(test: Callable[[Any], Any], totals: MotionTotals) -> list[int]:
    return np.flatnonzero(test(np.arange(totals.durations.shape[-1]))).tolist()


def approach(totals: MotionTotals, impacts: Any, closest: Any) -> Any:
    """Return the closest approach of a motion: NaN with impacts, 0 with rest contact."""
    closest = where(resting_share(totals) > 0.0, 0.0, closest)
    return where(impacts > 0.0, math.nan, closest)


# --- Statistics of a run


class Accumulator(StatisticsAccumulator):
    """Accumulator of the statistics of one run, called with every chunk of its events.

    Its memory and cost per period are independent of the length of the run. The actuator is in
    scaled units; `modes` is a multiple of the number for an actuator without terms. `sums` names
    integrals with a statistic per period: the states whose sum each is.
    """

    def __init__(
        self,
        actuator: ActuatorParameters,
        start: HybridState,
        window: TimeWindow,
        modes: int = len(MODES),
        sums: Mapping[str, Sequence[int]] = MappingProxyType({}),
    ) -> None:
        super().__init__(window, start, modes, len(GUARDS))
        self._actuator, self._sums = actuator, dict(sums)
        self._waiting: Events | None = None  # events since an impact whose step has not ended
        self._speeds, self._steps, self._energies = Moments(), Moments(), Moments()
        self._blows = BlowCounter()
        self._rests = RestDetector(actuator, window.period)
        self._closest = math.inf

    def __call__(self, events: Events) -> None:
        """Process the next chunk of events."""
        if len(events) == 0:
            return
        events = self._rests(events)
        inside = self._take(events)
        struck = is_impact(events) & inside
        self._speeds.add(np.abs(events.before[struck, V2]))
        if not is_compliant(self._actuator):
            ended = (events.kind == workspace.ACCUMULATION) & inside
            self._energies.add(energy_lost(events[struck | ended], self._actuator))
        turned = events[(events.kind == workspace.APPROACH) & inside]
        side = np.where(turned.guard == 0, 1.0, -1.0)
        gaps = self._actuator.delta - side * turned.before[:, X2]
        self._closest = min(self._closest, float(gaps.min(initial=math.inf)))
        self._take_steps(events)

    def result(self, final: HybridState, borders: Sequence[Floats]) -> dict[str, float]:
        """Return the statistics of a run that ended at `final`, by name.

        `borders` has the states at the start and end of the window. Undefined values are NaN:
        speeds and displacements per impact or blow without any, and the closest approach with
        impacts. A blow is a chatter sequence on one stopper that ends in sticking contact; any
        other impact is a blow of its own, also in a sequence that the end of the run truncates.
        Standard deviations are of the population.
        """
        if self._waiting is not None:
            self._take_steps(self._waiting[:0], last=True)
        change = borders[1] - borders[0]
        gains = {"step": float(change[X1])}
        if is_compliant(self._actuator):
            gains["energy lost"] = float(change[contact_loss(self._actuator)])
        totals = self._totals(final, 1.0, gains, {"energy lost": self._energies})
        window, blows = self._window.until(final), self._blows
        impacts = int(totals.impacts(GUARDS))
        closest = self._closest if math.isfinite(self._closest) else math.nan
        common = motion_values(totals, impacts, self._speeds)
        per_period, per_impact, lost = (
            common.pop(f"{name} per {each}")
            for name, each in (
                ("displacement", "period"), ("displacement", "impact"), ("energy lost", "period"),
            )
        )  # fmt: skip
        values = {
            # In forcing periods; the window is half-open: an event at its end is outside.
            "window first": window.first,
            "window last": window.last,
            "periods": totals.periods,
            "impacts": impacts,  # each bounce is one
            "impacts per period": common.pop("impacts per period"),
            "blows": blows.count,  # that start in the window
            "blows per period": totals.per_period(blows.count),
            "displacement per period": per_period,
            "displacement per impact": per_impact,
            # Of the steps of the frame (see `frame_steps`) after the impacts of the window, without
            # a step that has not ended.
            "displacement per impact std": self._steps.deviation(),
            "displacement per blow": ratio(gains["step"], blows.count),
            # Of the sums of the steps after the impacts of each blow, without a blow whose last
            # step has not ended.
            "displacement per blow std": blows.displacements.deviation(),
            **common,
            # At turning points, in a window without impacts; 0 with rest contact.
            "closest approach": approach(totals, impacts, closest),
            # That ended in sticking contact. On compliant stoppers, the number of contacts longer
            # than a bounce (see `RestDetector`), counted at their ends.
            "chatter sequences": totals.chatter,
            "energy lost per period": lost,
        }
        sums = {
            name: ratio(float(change[list(places)].sum()), totals.periods)
            for name, places in self._sums.items()
        }
        return values | sums

    def _take_steps(self, events: Events, *, last: bool = False) -> None:
        if self._waiting is not None:
            events = Events.joined([self._waiting, events])
        log, steps = contacts(events)
        inside = self._window.contains(log)
        open_ = np.isnan(steps)
        self._steps.add(steps[is_impact(log) & inside & ~open_])
        # Only the step after the last impact, with the end of its chatter, can be unfinished.
        held = int(np.argmax(open_)) if open_.any() and not last else len(log)
        self._waiting = log[held:]
        self._blows.add(log[:held], steps[:held], inside[:held], last=last)


# --- Standstill

MAX_PERIODICITY = 12  # forcing periods; motions of period 1, 2, 3, 4, 6 and 12 are recognized
STILL_RTOL = 1e-6


def standstill_period(trajectory: Trajectory, actuator: ActuatorParameters) -> float | None:
    """Return the number of periods of a run until standstill; None without it.

    At standstill the states at the starts of 12 successive periods equal the states 12 periods
    earlier, within 1e-6 of delta, and of delta times the natural frequency; states of terms, within
    1e-6 of their largest value. The block is included, since a growing oscillation may still move
    the frame. The actuator is in scaled units.
    """
    grid = trajectory.samples(per_period=1)
    near = np.array([1.0, (actuator.k / actuator.m2) ** 0.5] * 2) * STILL_RTOL * actuator.delta
    own = STILL_RTOL * np.abs(grid.y[:, len(STATES) :]).max(axis=0, initial=0.0)  # states of terms
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


# --- Quantities of orbits


def _per_period(orbit: Any) -> float:
    return float(orbit.step / orbit.periods)


def _per_impact(orbit: Any) -> float:
    impacts = len(orbit.impact_speeds)
    return float(orbit.step / impacts) if impacts else math.nan


def _mean_speed(orbit: Any) -> float:
    return float(orbit.step / (orbit.periods * orbit.period))


def _energy_lost(orbit: Any) -> float:
    return float(orbit.observables["energy lost"] / orbit.periods)


def _energy_given(orbit: Any) -> float:
    return energy(orbit).input / orbit.periods


FUNCTIONS = {
    "displacement per period": _per_period,
    "mean speed": _mean_speed,
    "displacement per impact": _per_impact,
    "impact speed": observables.impact_speed,
    "closest approach": observables.closest_approach,
    "energy lost per period": _energy_lost,
}
"""Functions of an orbit by the heading of the statistic."""


# --- The statistics of a device

SWEEP_COLUMNS = (
    "impacts per period",
    "blows per period",
    "displacement per period",
    "displacement per impact",
    "mean speed",
    "closest approach",
)
"""The statistics in the table of a sweep."""


def _impact_speed(mode: int, t: float, before: Any, after: Any, p: Any) -> float:
    return abs(float(before.v2))


IMPACT_SPEED = Observable("impact speed", _impact_speed, at=IMPACTS, reduce="mean", unit="m/s")


class NamedState:
    """A state of the actuator by name."""

    def __init__(self, states: Sequence[str], y: Floats) -> None:
        vars(self).update(zip(states, y.tolist(), strict=False))


class ActuatorStatistics(SystemStatistics):
    """The statistics of an actuator under a drive, with the definitions of `Accumulator.result`.

    `given` has the energy input of the drive; `sums` names integrals of runs, per period: the
    states whose sum each is.
    """

    _system: Any

    def __init__(
        self,
        system: HybridSystem,
        given: tuple[Observable, ...] = (),
        sums: Mapping[str, Sequence[int]] = MappingProxyType({}),
    ) -> None:
        super().__init__(system, partial(NamedState, system.states), attrgetter("parameters"))
        self._given, self._sums = given, dict(sums)

    @property
    def observables(self) -> tuple[Observable, ...]:
        """Displacement of the frame, impact speeds and energies."""
        return (*self._system.observables, IMPACT_SPEED, *self._given)

    def codes(self, observable: Observable) -> tuple[int, ...]:
        """Return the codes of the transitions at which studies evaluate an observable.

        The end of chatter loses energy, but it is no impact.
        """
        codes = super().codes(observable)
        return codes[: len(observable.at)] if observable is IMPACT_SPEED else codes

    def accumulator(
        self, problem: Problem, start: HybridState, window: TimeWindow
    ) -> StatisticsAccumulator:
        """Return the accumulator of the statistics of a run."""
        modes = len(problem.automaton.modes)
        return Accumulator(self._system.inner_actuator, start, window, modes, self._sums)

    def standstill_test(self) -> Callable[[Trajectory], float | None]:
        """Return a test for standstill: the number of periods after which a run rests, or None."""
        return partial(standstill_period, actuator=self._system.inner_actuator)

    def moves(self, instant: HybridState) -> bool:
        """Return whether the frame slides, or an integral grows."""
        return direction_of(instant.mode) != 0 or bool(self._sums)

    @property
    def names(self) -> tuple[str, ...]:
        """The headings of the statistics of attractors."""
        return (*_MEASURES, *_ENERGY) if self._given else _MEASURES

    def of_attractors(
        self, settled: RecurrenceColumns, periods: Floats, out: Conversion
    ) -> dict[str, Floats]:
        """Return the statistics of attractors that studies write, by heading.

        "displacement per period std" is the standard deviation over forcing periods. Compliant
        stoppers have no impact speeds.
        """
        totals = MotionTotals.of(settled, periods)
        hits = totals.impacts(GUARDS)
        values = {
            **motion_values(totals, hits, totals.moments["impact speed"]),
            "displacement per period std": settled.deviations["step"],
            "chatter per period": totals.per_period(totals.chatter),
        }
        if "energy in" in totals.gains:
            given = totals.gains["energy in"]
            values |= zip(_ENERGY, (totals.per_period(given), ratio(given, hits)), strict=True)
        closest = closest_gap(settled.closest, GUARDS)
        values["closest approach"] = approach(totals, hits, closest)
        return {name: out(name, value) for name, value in values.items()}

    @property
    def sweep_columns(self) -> tuple[str, ...]:
        """The statistics in the table of a sweep."""
        return (*SWEEP_COLUMNS, *self._sums)

    @property
    def plotted(self) -> Mapping[str, tuple[str, str]]:
        """The step and the speed of the frame."""
        return {
            "step": ("displacement per impact", "step per impact"),
            "speed": ("mean speed", "mean speed"),
        }

    @property
    def orbit_quantities(self) -> tuple[Quantity, ...]:
        """The quantities of an actuator's orbits.

        The energy input of the drive is computed on request only, since it requires an integration
        of the orbit's arcs.
        """
        units = self._system.units
        known = [Quantity(name, each, units.get(name, "")) for name, each in FUNCTIONS.items()]
        joule = units.get("energy lost per period", "")
        given = Quantity("energy given per period", _energy_given, joule, costly=True)
        return (*known, given, MULTIPLIER)
