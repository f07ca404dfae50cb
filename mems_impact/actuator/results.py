"""What runs and orbits of an actuator tell beside what those of any system do."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from mems_impact.actuator import tables
from mems_impact.actuator.design.blows import each_blow
from mems_impact.actuator.design.impacts import energy_lost, frame_steps, is_impact
from mems_impact.actuator.design.rests import Rests
from mems_impact.actuator.design.statistics import Accumulator, Statistics
from mems_impact.actuator.modes import V2
from mems_impact.analysis.orbit import Orbit
from mems_impact.analysis.run import Run
from mems_impact.hybrid.trajectory import Events

if TYPE_CHECKING:
    import pandas as pd

    from mems_impact.actuator.drives import Drive
    from mems_impact.actuator.parameters import Actuator

__all__ = ["ActuatorOrbit", "ActuatorRun"]


class _OfActuator:
    """What comes of an actuator under a drive."""

    system: Any

    @property
    def actuator(self) -> Actuator:
        """The device."""
        actuator: Actuator = self.system.actuator
        return actuator

    @property
    def drive(self) -> Drive:
        """The voltage."""
        drive: Drive = self.system.drive
        return drive


class ActuatorRun(_OfActuator, Run):
    """A run of an actuator under a drive."""

    kept: ClassVar[tuple[str, ...]] = (*Run.kept, "blows")
    figure = "mems_impact.actuator.figures.run:plot_run"
    scene = "mems_impact.actuator.figures.device:device_scene"

    @cached_property
    def impacts(self) -> pd.DataFrame:
        """One row an impact.

        Columns: period, time and phase (in [0, 1)) within it, running time t, stopper, velocities
        of frame (v1) and block (v2) before and after, energy lost, position x1 of the frame, and
        its step: the displacement until the frame rests or the next impact comes (NaN if neither
        came).
        """
        log = self._log("impacts")
        steps = frame_steps(log)[1]
        struck = is_impact(log)
        lost = energy_lost(log, self.system.inner_actuator)[struck]
        return tables.impacts(log[struck], steps, lost, self.trajectory.period, self.system)

    @cached_property
    def blows(self) -> pd.DataFrame:
        """One row a blow: an impact, or a sequence of ever weaker ones that ends in rest.

        Columns: period, time and phase (in [0, 1)) of the first impact, running time t, stopper,
        the number of impacts, whether the blow ends in rest, velocity v2 of the block before the
        first impact, energy lost, position x1 of the frame at the first impact, and the
        displacement of the frame: the sum of the steps after the impacts (NaN if the last has not
        ended). The impacts of a sequence that the end of the run cuts short stand as blows of
        their own.
        """
        actuator, period = self.system.inner_actuator, self.trajectory.period
        each = each_blow(Rests(actuator, period)(self._log("blows")), actuator)
        return tables.blows(
            each.first, each.impacts, each.rests, each.displacement, each.energy, period,
            self.system,
        )  # fmt: skip

    @cached_property
    def measured(self) -> Statistics:
        """The statistics as numbers with names, dimensionless like the trajectory."""
        gatherer = self.gatherer
        assert isinstance(gatherer, Accumulator)
        borders = [self._state_at(border) for border in (0, 1)]
        return gatherer.measured(self.trajectory.final, borders)


class ActuatorOrbit(_OfActuator, Orbit):
    """A periodic orbit of an actuator under a drive."""

    figure = "mems_impact.actuator.figures.orbit:plot_orbit"

    @property
    def step(self) -> float:
        """Displacement of the frame over the orbit; 0 where x1 matters, and closes too."""
        return self.gains.get("x1", 0.0)

    @property
    def log(self) -> Events:
        """The events once round, in the units of the numerics."""
        return self._log

    @cached_property
    def impacts(self) -> pd.DataFrame:
        """One row an impact, with the columns of `ActuatorRun.impacts`."""
        # The step after the last impact may end in the next pass of the orbit.
        later = replace(self._log, cycle=self._log.cycle + self.periods)
        log = Events.joined([self._log, replace(later, after=self._ahead(later.after))])
        steps = frame_steps(log)[1]
        hits = self._hits
        lost = energy_lost(log, self.system.inner_actuator)[is_impact(log)]
        period = self.found.point.period
        return tables.impacts(hits, steps[: len(hits)], lost[: len(hits)], period, self.system)

    @cached_property
    def impact_speeds(self) -> list[float]:
        """The speed of the block in each impact."""
        speeds = np.abs(self._hits.before[:, V2])
        return list(self.system.out("impact speed", speeds).tolist())

    @property
    def _hits(self) -> Events:
        # By the actuator's guards: where stoppers yield, those of its automaton reset nothing.
        return self._log[is_impact(self._log)]
