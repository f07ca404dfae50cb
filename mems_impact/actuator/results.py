"""Runs and orbits of a device, and their tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Generic

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.actuator.automaton import RIGHT_IMPACT
from mems_impact.actuator.design.step_length import step_lengths
from mems_impact.actuator.equations import V1, V2, X1
from mems_impact.actuator.impact_statistics import (
    RestDetector,
    each_blow,
    energy_lost,
    frame_steps,
    is_impact,
)
from mems_impact.actuator.numerics import A
from mems_impact.analysis.orbit import Orbit
from mems_impact.analysis.run import Run
from mems_impact.hybrid.simulation import Events
from mems_impact.systems.result import SummaryRepr
from mems_impact.tables import Labels, category_column, table, time_columns

if TYPE_CHECKING:
    import pandas as pd

    from mems_impact.actuator.drives.base import Drive

# --- Tables of actuators


def impacts(
    rows: Events, steps: Floats, energy: Floats, period: float, labels: Labels
) -> pd.DataFrame:
    """Return one row per impact, from events that are impacts.

    A step is the displacement of the frame from an impact until the frame rests or the next impact
    comes; `energy` is the kinetic energy lost in each, `period` the forcing period.
    """
    columns = {
        **time_columns(rows.cycle, rows.time, period, labels),
        "phase": rows.time / period,
        "stopper": _stopper(rows),
        "v1 before": rows.before[:, V1],
        "v1 after": rows.after[:, V1],
        "v2 before": rows.before[:, V2],
        "v2 after": rows.after[:, V2],
        "energy lost": energy,
        "x1": rows.after[:, X1],
        **labels.state_space.derived_columns(rows.cycle, rows.time, rows.after),
        "step": steps,
    }
    return table(columns, labels)


def _stopper(impacts: Events) -> Any:
    return category_column(["right", "left"], (impacts.guard != RIGHT_IMPACT).astype(np.int64))


# --- Runs and orbits of an actuator


class _OfActuator(Generic[A]):
    """Mixin of results of an actuator under a drive."""

    system: Any

    @property
    def actuator(self) -> A:
        """The device."""
        actuator: A = self.system.actuator
        return actuator

    @property
    def drive(self) -> Drive:
        """The voltage."""
        drive: Drive = self.system.drive
        return drive


@dataclass(frozen=True, kw_only=True, repr=False)
class BlowStatistics(SummaryRepr):
    """Statistics of the blows in the window of a run (`Run.blow_statistics`).

    A blow is an impact, or a chatter sequence on one stopper that ends in sticking contact;
    `mems_impact.Run.blows` has one row per blow. Numbers per *impact*, in `Run.statistics`, count
    every bounce.

    Attributes
    ----------
    count : int
        Number of blows whose first impact is in the window.
    per_period : float
        Blows per forcing period.
    displacement_per_blow : float
        Displacement of the frame over the window divided by the number of blows, with the slip
        between blows, which the column "displacement" of `Run.blows` excludes; 0 without
        displacement and blows, NaN if the frame slips without blows.
    displacement_std : float
        Population standard deviation of the column "displacement"; NaN without blows.
    si : bool
        Whether the displacements are in SI, as for a device in SI.

    See Also
    --------
    simulate, step_length

    Examples
    --------
    >>> import mems_impact as mi
    >>> mita = mi.load_actuator("mita2003")
    >>> run = mi.simulate(mita, mi.Sine(amplitude=100, omega=6.283), periods=6, window=(2, 6))
    >>> found = run.blow_statistics
    >>> f"{found.displacement_per_blow * 1e9:.1f} nm", found.per_period
    ('20.0 nm', 1.0)
    """

    _si_units = {"displacement_per_blow": "m", "displacement_std": "m"}  # noqa: RUF012 - ClassVar in Summarized

    count: int
    per_period: float
    displacement_per_blow: float
    displacement_std: float
    si: bool = False


class ActuatorRun(_OfActuator[A], Run):
    """A run of an actuator under a drive."""

    _stored: ClassVar[tuple[str, ...]] = (*Run._stored, "blows")
    figure = "mems_impact.actuator.plots.motion:plot_run"
    scene = "mems_impact.actuator.plots.animation:device_scene"

    @cached_property
    def impacts(self) -> pd.DataFrame:
        """One row per impact.

        Columns: period, time and phase (in [0, 1)) within it, running time t, stopper, velocities
        of frame (v1) and block (v2) before and after, energy lost, position x1 of the frame, the
        voltages at the electrodes ("node voltage", "left node voltage") if they differ from those
        of the drive, and the step of the frame: the displacement until it rests or the next impact
        comes (NaN if the run ends before).
        """
        log = self._log("impacts")
        steps = frame_steps(log)[1]
        struck = is_impact(log)
        lost = energy_lost(log, self.system.inner_actuator)[struck]
        return impacts(log[struck], steps, lost, self.trajectory.period, self.system)

    def step_lengths(self) -> pd.DataFrame:
        """Return the steps of the run beside the formula of `step_length`.

        One row per impact on the right stopper with the frame at rest: period, phase, speed v2
        before, voltage, step (simulated), formula, and their ratio. InvalidParameter states why the
        formula applies to no impact of the run.
        """
        return step_lengths(self)

    @cached_property
    def blows(self) -> pd.DataFrame:
        """One row per blow: an impact, or a chatter sequence that ends in sticking contact.

        Columns: period, time and phase (in [0, 1)) of the first impact, running time t, stopper,
        the number of impacts, whether the blow ends in rest, velocity v2 of the block before the
        first impact, energy lost, position x1 of the frame at the first impact, and the
        displacement of the frame: the sum of the steps after the impacts (NaN if the last has not
        ended). The impacts of a sequence that the end of the run truncates are separate blows.
        """
        actuator, period = self.system.inner_actuator, self.trajectory.period
        each = each_blow(RestDetector(actuator, period)(self._log("blows")), actuator)
        first = each.first
        columns = {
            **time_columns(first.cycle, first.time, period, self.system),
            "phase": first.time / period,
            "stopper": _stopper(first),
            "impacts": each.impacts,
            "ends in rest": each.rests,
            "v2 before": first.before[:, V2],
            "energy lost": each.energy,
            "x1": first.after[:, X1],
            "displacement": each.displacement,
        }
        return table(columns, self.system)

    @property
    def blow_statistics(self) -> BlowStatistics:
        """Statistics of the blows in the window."""
        measured, scales = self.measured, self.system.units.scales
        still = measured["blows"] == 0 and measured["displacement per period"] == 0.0
        mean = 0.0 if still else measured["displacement per blow"]
        return BlowStatistics(
            count=int(measured["blows"]),
            per_period=measured["blows per period"],
            displacement_per_blow=scales.out(mean, "m"),
            displacement_std=scales.out(measured["displacement per blow std"], "m"),
            si=scales.named,
        )

    @property
    def measured(self) -> Mapping[str, float]:
        """The statistics by name, dimensionless like the trajectory."""
        return self._scaled_statistics


class ActuatorOrbit(_OfActuator[A], Orbit):
    """A periodic orbit of an actuator under a drive."""

    figure = "mems_impact.actuator.plots.motion:plot_orbit"

    @property
    def step(self) -> float:
        """Displacement of the frame over the orbit; 0 if x1 is not cyclic."""
        return self.gains.get("x1", 0.0)

    @property
    def log(self) -> Events:
        """The events of the orbit, in scaled units."""
        return self._log

    @cached_property
    def impacts(self) -> pd.DataFrame:
        """One row per impact, with the columns of `ActuatorRun.impacts`."""
        # The step after the last impact may end in the next pass of the orbit.
        later = replace(self._log, cycle=self._log.cycle + self.periods)
        log = Events.joined([self._log, replace(later, after=self._one_period_later(later.after))])
        steps = frame_steps(log)[1]
        hits = self._hits
        lost = energy_lost(log, self.system.inner_actuator)[is_impact(log)]
        period = self.numeric.point.period
        return impacts(hits, steps[: len(hits)], lost[: len(hits)], period, self.system)

    @cached_property
    def impact_speeds(self) -> list[float]:
        """The speed of the block in each impact."""
        speeds = np.abs(self._hits.before[:, V2])
        return list(self.system.units.out("impact speed", speeds).tolist())

    @property
    def _hits(self) -> Events:
        # By the actuator's guards: with compliant stoppers, the automaton has no resets.
        return self._log[is_impact(self._log)]
