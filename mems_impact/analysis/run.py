"""Results of a simulation."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Literal, Self

import numpy as np

from mems_impact import tables as run_tables
from mems_impact._util.arrays import Floats
from mems_impact._util.warning_scopes import warn
from mems_impact.analysis.settling import Settling, settling_of
from mems_impact.analysis.verification import Verification, compare, other_family
from mems_impact.errors import FunctionsMissing, InvalidParameter, RunError, TransientWarning
from mems_impact.hybrid.simulation import Events, Samples, Trajectory
from mems_impact.hybrid.simulation import run as integrate
from mems_impact.integrators.options import Options
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.result import Result
from mems_impact.systems.settling import CHANGING
from mems_impact.systems.state import State, is_number, with_units
from mems_impact.systems.statistics import LazyStatistics
from mems_impact.systems.window_statistics import StatisticsAccumulator, TimeWindow

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import ArrayLike

    from mems_impact.analysis.run_derivatives import RunDerivatives

Keep = Literal["events", "statistics"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Run(Result):
    """A run of a system. Its tables are computed on first access.

    Results are in the units of the system, given in ``table.attrs["units"]``.

    Attributes
    ----------
    system : System
    options : Options
    keep : {"events", "statistics"}
    window : tuple of float
        First and last forcing period of the statistics; times for an autonomous system.
    trajectory : Trajectory
        The result of the event loop: the events as arrays, the first and last instant; always in
        scaled units.
    ended : str
        Reason why the run ended: "time", "until", or "still".

    See Also
    --------
    simulate, plot_run, load, Verification, RunDerivatives

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> run = mi.simulate(actuator, drive, periods=300)
    >>> len(run.events), len(run.impacts)
    (584, 292)
    >>> samples = run.samples(per_period=100, first=299, last=300)
    >>> len(samples)
    101
    >>> f"{run.final.v2:.4f}"
    '0.3376'
    """

    system: HybridSystem = field(repr=False)
    options: Options = field(repr=False)
    keep: Keep
    window: tuple[float, float]
    figure: ClassVar[str] = ""  # "module:function" that draws it instead of `plot_run`
    scene: ClassVar[str] = ""  # and that animates it instead of `animate`
    trajectory: Trajectory = field(repr=False)
    ended: str = "time"
    _gatherer: StatisticsAccumulator | LazyStatistics = field(repr=False, compare=False)
    _borders: tuple[Floats, ...] = field(repr=False, compare=False, default=())

    _stored: ClassVar[tuple[str, ...]] = ("events", "impacts", "_scaled_statistics", "settling")

    def __repr__(self) -> str:
        first, last = (border * self.unit for border in self.extent)
        unit = "periods" if self.system.forced else "time"
        arcs = f", {self._arcs_by_method}" if self.options.method == "auto" else ""
        return (
            f"{type(self).__name__}({unit} {first:g} to {last:g}, "
            f"{len(self.trajectory.events)} events, {self.trajectory.steps} steps{arcs}, "
            f"{with_units(self.final, self.system.units)}"
            f"{f'; {self.settling}' if self._is_transient else ''})"
        )

    def summary(self) -> dict[str, Any]:
        """Return the system, the length of the run, and its last state."""
        first, last = (border * self.unit for border in self.extent)
        return {
            "system": repr(self.system),
            "periods" if self.system.forced else "time": f"{first:g} to {last:g}",
            "events": len(self.trajectory.events),
            "steps": self.trajectory.steps,
            "method": f"{self.options.method}, rtol {self.options.rtol:g}",
            "arcs": self._arcs_by_method,
            "final": repr(self.final),
            "ended": self.ended,
            **({"settling": str(self.settling)} if self._is_transient else {}),
        }

    @property
    def arcs(self) -> dict[str, int]:
        """Number of arcs, between transitions or handovers, integrated by each method."""
        count, implicit = self.trajectory.arcs, self.trajectory.implicit_arcs
        if self.options.method != "auto":
            return {str(self.options.method): count}
        return {"dop853": count - implicit, "bdf": implicit}

    @cached_property
    def handovers(self) -> pd.DataFrame:
        """One row per change of method by ``"auto"``: its time, the mode, the new method.

        An arc starts with the method at the end of the previous arc in its mode.
        """
        log = self._log("handovers").handovers
        return run_tables.handovers(log, self.trajectory.period, self.system)

    @property
    def _arcs_by_method(self) -> str:
        return ", ".join(f"{count} arcs by {method}" for method, count in self.arcs.items())

    @property
    def periods(self) -> float:
        """Forcing periods done."""
        first, last = self.extent
        return last - first

    @property
    def extent(self) -> tuple[float, float]:
        """Start and end of the run, in forcing periods; 0 is the start of the first period."""
        start, final = self.trajectory.start, self.trajectory.final
        period = self.trajectory.period
        return start.cycle + start.time / period, final.cycle + final.time / period

    @property
    def end(self) -> float:
        """The time at the end; ``start`` of a run that continues this run."""
        final = self.trajectory.final
        return float(
            self.system.units.out("time", final.cycle * self.trajectory.period + final.time)
        )

    @property
    def final(self) -> State:
        """The state at the end; ``initial`` of a run that continues this run."""
        return self.system.state_space.state(self.trajectory.final)

    @cached_property
    def events(self) -> pd.DataFrame:
        """One row per transition: time, event, modes before and after, state after, observables."""
        log = self._log("events")
        return run_tables.events(log, self.trajectory.period, self.system, self._observed(log))

    @cached_property
    def impacts(self) -> pd.DataFrame:
        """One row per impact.

        Columns: forcing period, time and phase (in [0, 1)) within the period, running time t,
        guard ("event"), states before and after, observables. Without forcing, the time only.
        """
        log = self._log("impacts")
        hits = log[log.impacts(self.system.automaton)]
        return run_tables.impacts(hits, self.trajectory.period, self.system, self._observed(hits))

    @cached_property
    def corners(self) -> pd.DataFrame:
        """One row per transition: time, event, modes, whether it is an impact, states around it.

        At these instants the curves of the states have corners and jumps.
        """
        return run_tables.corners(self._log("corners"), self.trajectory.period, self.system)

    def section(self, direction: int = 0) -> pd.DataFrame:
        """Return the crossings of the Poincaré section.

        Parameters
        ----------
        direction : {0, 1, -1}, optional
            Direction of the crossings: both (0), upwards (1) or downwards (-1).

        Returns
        -------
        DataFrame
            Time, state and direction; one row per crossing. For a system with forcing and no
            section, the states at the starts of the forcing periods.
        """
        check_direction("direction", direction)
        log = self._log("section")
        if self.system.section is None and self.system.forced:
            return self.samples(per_period=1)
        return run_tables.section(log.crossings(direction), self.trajectory.period, self.system)

    def samples(
        self,
        per_period: int = 200,
        first: float | None = None,
        last: float | None = None,
        *,
        times: ArrayLike | None = None,
        forces: bool = False,
    ) -> pd.DataFrame:
        """Return the state at equal intervals, or at some times.

        Parameters
        ----------
        per_period : int, optional
            Samples per forcing period, > 0; for an autonomous system, samples per ``time_scale`` (1
            by default).
        first, last : float, optional
            First and last forcing period of the samples; the whole run by default. Times for an
            autonomous system.
        times : array_like of float, optional
            Times of the samples, ascending, in place of equal intervals. At an event the state
            after it.
        forces : bool, optional
            Whether columns "force of NAME" show the force of each `Friction` and `Stopper` among
            the parts on its velocity: friction, normal force at rest, force of a compliant stop;
            nan if several contacts hold a body and their shares are indeterminate.

        Returns
        -------
        DataFrame
            Time, state and mode, and forces.
        """
        self._log("samples")
        grid = self._grid(per_period, first, last) if times is None else self._states_at(times)
        table = run_tables.samples(grid, self.trajectory.period, self.system)
        if forces:
            problem = self.system.problem(self.options)
            table = table.assign(**self.system.state_space.contact_forces(grid, problem))
        return table

    def _grid(self, per_period: int, first: float | None, last: float | None) -> Samples:
        """Return the state at equal intervals."""
        is_integer = isinstance(per_period, int | np.integer) and not isinstance(per_period, bool)
        if not is_integer or per_period <= 0:
            raise InvalidParameter("per_period", per_period, "a whole number > 0")
        unit = self.unit
        begin, end = (border * unit for border in self.extent)
        low, high = begin if first is None else first, end if last is None else last
        if not (is_number(low) and is_number(high) and low <= high and high >= begin):
            allowed = f"between {begin:g} and {end:g}, first before last"
            raise InvalidParameter("first, last", (first, last), allowed)
        return self.trajectory.samples(
            int(per_period),
            None if first is None else first / unit,
            None if last is None else last / unit,
        )

    def _states_at(self, times: ArrayLike) -> Samples:
        """Return the state at ascending times."""
        scaled = self._scaled_times(times)
        if not (len(scaled) and (np.diff(scaled) >= 0.0).all()):
            raise InvalidParameter("times", np.ravel(times).tolist(), "ascending, at least one")
        return self.trajectory.at(np.column_stack(np.divmod(scaled, self.trajectory.period)))

    def _scaled_times(self, times: ArrayLike) -> Floats:
        """Return times in scaled units; InvalidParameter unless they lie within the run."""
        units, period = self.system.units, self.trajectory.period
        try:
            at = np.atleast_1d(np.asarray(times, dtype=float))
        except (TypeError, ValueError):
            raise InvalidParameter("times", times, "numbers") from None
        first, last = (border * period for border in self.extent)
        scaled = np.array([float(units.into("time", time)) for time in at])
        if not (np.isfinite(at).all() and (scaled >= first).all() and (scaled <= last).all()):
            low, high = (float(units.out("time", border)) for border in (first, last))
            raise InvalidParameter("times", at.tolist(), f"times from {low:g} to {high:g}")
        return scaled

    def verify(self) -> Verification:
        """Repeat the run by an independent, more precise method and compare event by event.

        A run by Adams or BDF is verified by dop853, a run by dop853 or ``"auto"`` by Adams, with a
        hundredth of its tolerances (rtol at least 1e-13, atol 1e-15). In a stiff system ``"auto"``
        replaces dop853 and BDF replaces Adams, so that BDF repeats the stiff arcs.

        Returns
        -------
        Verification
            Whether the runs agree, up to which forcing period, and the size of their differences.

        Raises
        ------
        InvalidParameter
            If the run was made with ``keep="statistics"``.
        RunError
            If the second run fails.

        Warns
        -----
        StiffnessWarning
            If a run by BDF is so stiff that dop853 takes a long time.

        Examples
        --------
        >>> import mems_impact as mi
        >>> zhao = mi.load_actuator("zhao2004")
        >>> run = mi.simulate(zhao, mi.Sine(amplitude=0.24, omega=0.5), periods=50)
        >>> run.verify().verdict
        'agree to the end, period 50'
        """
        self._log("verification")
        chose = self.options.method == "auto"  # which has detected whether the system is stiff
        stiff = self.trajectory.stiff if chose else self.trajectory.automaton.stiff
        problem = self.system.problem(other_family(self.options, stiff=stiff))
        try:
            again = integrate(problem, self.trajectory.start, self.periods)
        except RunError as error:
            error.convert(self.system.units, forced=self.system.forced)
            raise
        return compare(self.trajectory, again, self.options.rtol, self.system)

    def derivatives(self, names: Sequence[str]) -> RunDerivatives[Self]:
        """Return the derivatives of the run by some parameters and initial states.

        Parameters
        ----------
        names : sequence of str
            Parameters of the system, and initial states: ``"x0.x"`` is the initial value of x.

        Returns
        -------
        RunDerivatives
            Of the last state, events, samples and functions of the run.

        Raises
        ------
        InvalidParameter
            If a name is unknown, or the equations do not read it as a real number.
        RunError
            If an arc cannot be integrated with its derivatives.

        Examples
        --------
        >>> import mems_impact as mi
        >>> zhao = mi.load_actuator("zhao2004")
        >>> run = mi.simulate(zhao, mi.Sine(amplitude=0.24, omega=0.5), periods=20)
        >>> found = run.derivatives(["e", "amplitude"])
        >>> list(found.final.columns)
        ['e', 'amplitude']
        """
        from mems_impact.analysis.run_derivatives import derivatives_of

        return derivatives_of(self, names)

    @cached_property
    def statistics(self) -> pd.Series:
        """The statistics of the window.

        Warns
        -----
        TransientWarning
            If a statistic still changes by more than 0.1 % (see `Settling`).
        """
        self.warn_of_transient()
        return run_tables.statistics(self._scaled_statistics, self.system)

    def warn_of_transient(self) -> None:
        """Warn if the statistics belong to a transient."""
        if self._is_transient:
            warn(str(self.settling), TransientWarning)

    @property
    def _is_transient(self) -> bool:
        """Whether a statistic of a run of given length still changes."""
        with contextlib.suppress(FunctionsMissing, RunError):
            return self.ended == "time" and self.settling.kind == CHANGING
        return False

    @cached_property
    def settling(self) -> Settling:
        """The distance of the statistics from the statistics of the attractor."""
        first, last = (border / self.unit for border in self.window)
        window = TimeWindow(first, last, self.trajectory.period).until(self.trajectory.final)
        return settling_of(self.system, self.trajectory, window, self._scaled_statistics)

    @cached_property
    def _scaled_statistics(self) -> Mapping[str, float]:
        """The statistics by name, in scaled units."""
        borders = [self._state_at(border) for border in (0, 1)]
        return self._accumulator.result(self.trajectory.final, borders)

    @property
    def _accumulator(self) -> StatisticsAccumulator:
        """The accumulator of the statistics, after all events."""
        waiting = self._gatherer
        return waiting.ready if isinstance(waiting, LazyStatistics) else waiting

    @property
    def unit(self) -> float:
        """Unit of the arguments: forcing periods, or the unit of time of an autonomous system."""
        if self.system.forced:
            return 1.0
        return float(self.system.units.out("time", self.trajectory.period))

    def _state_at(self, border: int) -> Floats:
        """Return the state at the start (0) or end (1) of the window."""
        if self._borders:
            return self._borders[border]
        final, period = self.trajectory.final, self.trajectory.period
        first, last = (value / self.unit for value in self.window)
        cycle, time = TimeWindow(first, last, period).instant(border)
        if (final.cycle, final.time) <= (cycle, time):
            return final.y
        anchor = self._accumulator.anchor(border)
        wait = (cycle - anchor.cycle) + (time - anchor.time) / period
        if wait <= 0.0 or not self.system.statistics.moves(anchor):
            return anchor.y
        # Integrate the arc that contains this instant again, up to it.
        problem = self.system.problem(self.options)
        try:
            return integrate(problem, anchor, wait, consume=lambda _: None).final.y
        except RunError as error:
            error.convert(self.system.units, forced=self.system.forced)
            raise

    def _observed(self, log: Events) -> dict[str, Floats]:
        return self.system.statistics.at_events(log, self.trajectory.problem)

    def _log(self, table: str) -> Events:
        if self.keep != "events":
            allowed = f"'events' for the run's {table}; simulate again with keep='events'"
            raise InvalidParameter("keep", self.keep, allowed)
        return self.trajectory.events


def check_direction(field: str, direction: object) -> None:
    """Raise InvalidParameter unless `direction` is 1, -1 or 0."""
    if direction not in (-1, 0, 1):
        raise InvalidParameter(field, direction, "1 (upwards), -1 (downwards) or 0 (both)")
