"""What a run of the actuator returns: tables, statistics and the last state."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from mems_impact import tables
from mems_impact.actuator.drive import Drive
from mems_impact.actuator.modes import STATES, X1, X2, actuator_automaton, direction_of
from mems_impact.actuator.parameters import Actuator
from mems_impact.actuator.units import DIMENSIONLESS, inner, unscaled_fields
from mems_impact.engines.options import Options
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid import run as hybrid
from mems_impact.hybrid.trajectory import Events, Trajectory
from mems_impact.studies.blows import each_blow
from mems_impact.studies.impacts import energy_lost, frame_steps
from mems_impact.studies.state import STATE_UNITS, State, is_number
from mems_impact.studies.statistics import Accumulator, Statistics, instant_of
from mems_impact.studies.verification import Verification, compare, other_family

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Keep", "Run", "check_direction", "problem_of"]

Keep = Literal["events", "statistics"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """A run of the actuator; its tables are made when they are first asked for.

    Results are in the units of the actuator. The headings of tables carry them where it is in SI
    (``"x1 [m]"``), and are the symbols alone where it is dimensionless (``"x1"``).

    Attributes
    ----------
    actuator : Actuator
    drive : Drive
    options : Options
    keep : {"events", "statistics"}
    window : tuple of float
        First and last forcing period of the statistics.
    trajectory : Trajectory
        What the event loop returned: the events as arrays, the first and last instant; always
        dimensionless, in the actuator's ``scales``.
    """

    actuator: Actuator
    drive: Drive
    options: Options = field(repr=False)
    keep: Keep
    window: tuple[float, float]
    trajectory: Trajectory = field(repr=False)
    _accumulator: Accumulator = field(repr=False)

    @property
    def periods(self) -> float:
        """Forcing periods done."""
        start, final = self.trajectory.start, self.trajectory.final
        return final.cycle - start.cycle + (final.time - start.time) / self.trajectory.period

    @property
    def extent(self) -> tuple[float, float]:
        """Where the run begins and ends, in forcing periods (0: start of the first of them)."""
        start, final = self.trajectory.start, self.trajectory.final
        period = self.trajectory.period
        return start.cycle + start.time / period, final.cycle + final.time / period

    @property
    def final(self) -> State:
        """The state at the end; ``initial`` of a run that goes on from there."""
        final = self.trajectory.final
        values = dict(zip(STATES, final.y.tolist(), strict=True))
        state = State(**values, time=final.time)
        scales = self.actuator.scales
        if scales is DIMENSIONLESS:
            return state
        out = replace(state, **unscaled_fields(state, STATE_UNITS, scales))
        # Scaling may round a block on its stopper, or the end of a period, to just beyond it.
        delta, last = self.actuator.delta, math.nextafter(self.drive.period, 0.0)
        return replace(out, x2=min(max(out.x2, -delta), delta), time=min(out.time, last))

    @cached_property
    def impacts(self) -> pd.DataFrame:
        """One row an impact.

        Columns: period, time and phase (in [0, 1)) within it, stopper, velocities of frame (v1)
        and block (v2) before and after, energy lost, position x1 of the frame, and its step: the
        displacement until the frame rests or the next impact comes (NaN if neither came).
        """
        log = self._events("impacts")
        rows, steps = frame_steps(log)
        struck = np.zeros(len(log), dtype=bool)
        struck[rows] = True
        hits = log[struck]
        lost = energy_lost(hits, self.actuator.to_dimensionless())
        return tables.impacts(hits, steps, lost, self.trajectory.period, self.actuator.scales)

    @cached_property
    def blows(self) -> pd.DataFrame:
        """One row a blow: an impact, or a sequence of ever weaker ones that ends in rest.

        Columns: period, time and phase (in [0, 1)) of the first impact, stopper, the number of
        impacts, whether the blow ends in rest, velocity v2 of the block before the first impact,
        energy lost, position x1 of the frame at the first impact, and the displacement of the
        frame: the sum of the steps after the impacts (NaN if the last has not ended). The impacts
        of a sequence that the end of the run cuts short stand as blows of their own.
        """
        each = each_blow(self._events("blows"), self.actuator.to_dimensionless())
        return tables.blows(
            each.first, each.impacts, each.rests, each.displacement, each.energy,
            self.trajectory.period, self.actuator.scales,
        )  # fmt: skip

    @cached_property
    def events(self) -> pd.DataFrame:
        """One row a transition: period, time, event, modes before and after, state after."""
        return tables.events(self._events("events"), self.actuator.scales)

    def section(self, direction: int = 0) -> pd.DataFrame:
        """Return the crossings of the Poincaré section x2 = 0.

        Parameters
        ----------
        direction : {0, 1, -1}, optional
            Both directions, v2 > 0 or v2 < 0.

        Returns
        -------
        DataFrame
            period, time, v2, v1, x1, direction; one row a crossing.
        """
        check_direction("direction", direction)
        return tables.section(self._events("section"), direction, self.actuator.scales)

    def samples(
        self, per_period: int = 200, first: float | None = None, last: float | None = None
    ) -> pd.DataFrame:
        """Return the state at equal intervals.

        Parameters
        ----------
        per_period : int, optional
            Samples per forcing period, > 0.
        first, last : float, optional
            Forcing periods between which to sample; the whole run by default.

        Returns
        -------
        DataFrame
            period, time within it, t (from the start of period 0), x1, v1, x2, v2, mode.
        """
        self._events("samples")
        whole = isinstance(per_period, int | np.integer) and not isinstance(per_period, bool)
        if not whole or per_period <= 0:
            raise InvalidParameter("per_period", per_period, "a whole number > 0")
        begin, end = self.extent
        low, high = begin if first is None else first, end if last is None else last
        if not (is_number(low) and is_number(high) and low <= high and high >= begin):
            allowed = f"between {begin:g} and {end:g}, first before last"
            raise InvalidParameter("first, last", (first, last), allowed)
        grid = self.trajectory.samples(int(per_period), first, last)
        return tables.samples(grid, self.trajectory.period, self.actuator.scales)

    def verify(self) -> Verification:
        """Run the same again by an unrelated method, more precisely, and compare event by event.

        A run by Adams or BDF is verified by dop853 and one by dop853 by Adams, with a hundredth of
        its tolerances (rtol at least 1e-13, atol 1e-15).

        Returns
        -------
        Verification
            Whether the runs agree, up to which forcing period, and by how much they differ.

        Raises
        ------
        InvalidParameter
            If the run has kept no events.
        RunError
            If the second run cannot go on.

        Warns
        -----
        StiffnessWarning
            If a run by BDF is so stiff that dop853 takes long.

        Examples
        --------
        >>> import mems_impact as mi
        >>> zhao = mi.load_actuator("zhao2004")
        >>> run = mi.simulate(zhao, mi.Sine(amplitude=0.24, omega=0.5), periods=50)
        >>> run.verify().verdict
        'agree to the end, period 50'
        """
        self._events("verification")
        problem = problem_of(self.actuator, self.drive, other_family(self.options))
        again = hybrid.run(problem, self.trajectory.start, self.periods)
        return compare(self.trajectory, again, self.options.rtol, self.actuator.scales)

    @cached_property
    def statistics(self) -> pd.Series:
        """What happened in the window, number by number (see `studies.statistics.Statistics`)."""
        return tables.statistics(asdict(self.measured), self.actuator.scales)

    @cached_property
    def measured(self) -> Statistics:
        """The statistics as numbers with names, dimensionless like the trajectory."""
        return self._accumulator.result(self.trajectory.final, (self._x1(0), self._x1(1)))

    def _x1(self, border: int) -> float:
        """Return x1 where the window begins (0) or ends (1)."""
        final, period = self.trajectory.final, self.trajectory.period
        cycle, time = instant_of(self.window[border], period)
        if (final.cycle, final.time) <= (cycle, time):
            return float(final.y[X1])
        anchor = self._accumulator.anchor(border)
        wait = (cycle - anchor.cycle) + (time - anchor.time) / period
        if wait > 0.0 and direction_of(anchor.mode) != 0:
            # The frame slides across the border: integrate the arc again, up to there.
            problem = problem_of(self.actuator, self.drive, self.options)
            anchor = hybrid.run(problem, anchor, wait, consume=lambda _: None).final
        return float(anchor.y[X1])

    def _events(self, table: str) -> Events:
        if self.keep != "events":
            allowed = f"'events' for the run's {table}; simulate again with keep='events'"
            raise InvalidParameter("keep", self.keep, allowed)
        return self.trajectory.events


def problem_of(actuator: Actuator, drive: Drive, options: Options) -> hybrid.Problem:
    """Return the actuator under a drive as a problem of the hybrid layer, dimensionless."""
    if not isinstance(actuator, Actuator):
        raise InvalidParameter("actuator", actuator, "an Actuator (see load_actuator)")
    if not isinstance(drive, Drive):
        raise InvalidParameter("drive", drive, "a Drive, such as Sine(amplitude=…, omega=…)")
    drive.check()
    return assembled(actuator, drive, options)


def assembled(actuator: Actuator, drive: Drive, options: Options) -> hybrid.Problem:
    """Return the problem of an actuator and a drive that have been checked."""
    actuator, drive = inner(actuator, drive)
    waveforms = (drive.voltage, drive.voltage_rate, drive.left_voltage, drive.left_rate)
    return hybrid.Problem(
        automaton=actuator_automaton(*waveforms),
        parameters=np.concatenate([actuator.to_array(), drive.parameters()]),
        period=drive.period,
        switches=drive.switches,
        time_scale=drive.time_scale,
        section=(X2, 0.0, 0),
        options=options,
    )


def check_direction(field: str, direction: object) -> None:
    """Raise InvalidParameter unless `direction` is that of crossings of a section."""
    if direction not in (-1, 0, 1):
        raise InvalidParameter(field, direction, "1 (v2 > 0), -1 (v2 < 0) or 0 (both)")
