"""Speed over an opposing load, and the largest load."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mems_impact.actuator import equations as eq
from mems_impact.actuator import results
from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.automaton import BREAK_AWAY, direction_of
from mems_impact.actuator.design.energy import accounted_problem
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.equations import V1, X1
from mems_impact.actuator.model import compose
from mems_impact.actuator.parameters import numbers_for
from mems_impact.actuator.results import ActuatorOrbit, ActuatorRun
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.actuator.terms.frame_force import FrameForce
from mems_impact.analysis.orbit import ORBIT_OPTIONS, find_orbit
from mems_impact.analysis.simulate import simulate
from mems_impact.analysis.steady_state import steady_state
from mems_impact.errors import InvalidParameter, OrbitError, RunError
from mems_impact.integrators.options import Options
from mems_impact.systems.result import Result
from mems_impact.systems.state import State, is_number, whole

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import ArrayLike

__all__ = ["ForceCurve", "force_curve"]

LOAD = "frame_force.force"
WALKS, BACK, STANDS, AWAY = "walks", "walks back", "stands", "runs away"
FASTER = 1e3  # factor of the speed at which friction is checked for a frame that runs away
ROUNDS = 8  # number of successive orbits on which the walking load is sought
SPEEDS = np.geomspace(1e-9, 1e9, 18001)  # of a slip, in scaled units
MIN_DISPLACEMENT = 1e-12  # of delta: a smaller displacement is rounding


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ForceCurve(Result):
    """Mean speed over an opposing force, in the units of the device.

    Attributes
    ----------
    system : ActuatorSystem
        The system without load.
    table : DataFrame
        One row per load, ascending: load, displacement per period, mean speed, power (load times
        speed), motion ("walks", "walks back", "stands", or "runs away" without a mean speed), and
        whether it is from an "orbit" or a "run".
    sliding_force : float
        Largest load at which every slip ends by itself: the friction on a slipping frame [N]. Above
        this load, a device that slips back runs away.
    holding_force : float
        Largest load that static friction holds without voltage [N].
    walking_force : float
        Largest load at which the device walks on the continued orbit: above it the frame breaks
        away backwards during a rest and runs away [N]; NaN if this load is above the given loads,
        or no orbit was continued. A device whose frame slips back in every period has no such load,
        but slows down, stalls, and walks back.
    stall_force : float
        Load at which the speed is zero, interpolated between two rows [N]; NaN if the speed is
        never zero: a device that friction holds between its blows still walks at the load at which
        its frame breaks away.

    See Also
    --------
    force_curve, plot_force_curve

    Notes
    -----
    A device runs away if its frame slips in one direction throughout the measured periods, and the
    external forces exceed the friction at any speed.

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> curve = mi.force_curve(actuator, drive, [0, 5, 10], transient=60, periods=10)
    >>> bool((curve.table["mean speed"].diff().dropna() < 0).all())
    True
    """

    system: ActuatorSystem = field(repr=False)
    table: pd.DataFrame = field(repr=False)
    sliding_force: float
    holding_force: float
    walking_force: float
    stall_force: float

    def summary(self) -> dict[str, Any]:
        """Return the characteristic loads."""
        names = ("sliding_force", "holding_force", "walking_force", "stall_force")
        return {"system": repr(self.system), **{name: getattr(self, name) for name in names}}


class _Row(NamedTuple):
    displacement: float
    does: str
    by: str


def force_curve(
    actuator: Actuator,
    drive: Drive,
    loads: ArrayLike,
    *,
    transient: int = 100,
    periods: int = 40,
    initial: State | None = None,
    options: Options = Options(),  # noqa: B008 - immutable
) -> ForceCurve:
    """Compute the mean speed of a device over an opposing force.

    Loads are processed in ascending order, each from the state at the previous load, along a stable
    periodic orbit, or else by runs.

    Parameters
    ----------
    actuator : Actuator
        The device; its own `FrameForce` is ignored.
    drive : Drive
    loads : array_like of float or str
        Forces [N] to the left, against motion to the right; texts may have units (``"3 uN"``).
    transient, periods : int, optional
        Forcing periods of transient and of measurement in each run.
    initial : State, optional
        Initial state of the run at the smallest load; a kick by default (see `kicked_state`).
    options : Options, optional
        Options of runs; orbits use the tolerances of `find_orbit`.

    Returns
    -------
    ForceCurve

    Raises
    ------
    InvalidParameter
        If an argument is out of range.
    RunError
        If a run fails, and the device does not run away.

    See Also
    --------
    ForceCurve, plot_force_curve, FrameForce

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> curve = mi.force_curve(actuator, drive, [0, 5, 10], transient=60, periods=10)
    >>> f"{curve.holding_force:.2f}", f"{curve.sliding_force:.2f}"
    ('23.54', '15.89')
    """
    if not isinstance(actuator, Actuator):
        raise InvalidParameter("actuator", actuator, "an Actuator (see load_actuator)")
    load_values = numbers_for(actuator, "loads", loads, "N")
    try:
        values = np.sort(np.atleast_1d(np.asarray(load_values, dtype=float)))
    except (TypeError, ValueError):
        values = np.array([])
    if values.ndim != 1 or values.size == 0 or not all(map(is_number, values.tolist())):
        raise InvalidParameter("loads", loads, "one or more finite numbers")
    transient, periods = whole("transient", transient, 0), whole("periods", periods, 1)
    system = actuator.adding(FrameForce(force=0.0)).under(drive)
    start = system.state_space.initial("down") if initial is None else initial
    chain = _Chain(system, start, transient, periods, options)
    rows = [chain.at(load) for load in values.tolist()]
    sliding, holding = _holding_loads(system)
    moved = np.array([row.displacement for row in rows])
    speed = moved / float(system.forcing_period)
    table = results.load(
        values, moved, speed, [row.does for row in rows], [row.by for row in rows], system
    )
    return ForceCurve(
        system=system,
        table=table,
        sliding_force=sliding,
        holding_force=holding,
        walking_force=chain.limit(),
        stall_force=_zero(values, speed),
    )


class _Chain:
    """Successive loads, each from the state at the previous one."""

    def __init__(
        self, system: ActuatorSystem, start: State, transient: int, periods: int, options: Options
    ) -> None:
        self.system, self.start, self.state = system, start, start
        self.transient, self.periods, self.options = transient, periods, options
        self.tight = replace(ORBIT_OPTIONS, engine=options.engine)
        self.orbit: ActuatorOrbit | None = None
        self.load, self.expected = math.nan, math.inf
        self.away = False  # backwards, which no larger load ends

    def at(self, load: float) -> _Row:
        """Return the row of a load."""
        if self.away:
            return _Row(math.nan, AWAY, "run")
        system = self.system.changed(**{LOAD: load})
        continues = self.orbit is not None and load < self.expected
        if continues and (row := self._follow(system, load)):
            return row
        run, direction = self._run(system)
        if direction != 0:
            self.away, self.state = direction < 0, self.start
            return _Row(math.nan, AWAY, "run")
        self.state, self.expected = run.final, math.inf
        row = self._follow(system, load)
        return row or self._row(float(run.statistics["displacement per period"]), "run")

    def limit(self) -> float:
        """Return the load at which the orbit ends; NaN if it was not reached.

        If a run beyond it still walks, with one more slip, the search continues on its orbit.
        """
        for _ in range(ROUNDS):
            expected = self.expected
            if not self.away or self.orbit is None or not math.isfinite(expected):
                return math.nan
            load = self.load + 0.999 * (expected - self.load)
            self._follow(self.system.changed(**{LOAD: load}), load)
            expected = self.expected
            beyond = expected + 1e-6 * abs(expected)
            system = self.system.changed(**{LOAD: beyond})
            _, direction = self._run(system)
            if direction != 0:
                return expected
            if not self._follow(system, beyond):
                return math.nan
        return math.nan

    def _run(self, system: ActuatorSystem) -> tuple[ActuatorRun, int]:
        """Return a run from the last state, and the direction of running away, or 0."""
        length = self.transient + self.periods
        first = self.state.time / system.forcing_period + self.transient
        try:
            run: Any = simulate(
                system, length, initial=self.state, options=self.options,
                window=(first, first + self.periods),
            )  # fmt: skip
        except RunError as error:
            run = error.partial
            direction = _runaway(run, self.periods)
            if direction == 0:
                raise
            return run, direction
        direction = _runaway(run, self.periods)
        if direction == 0:
            run = steady_state(run)
        return run, direction

    def _follow(self, system: ActuatorSystem, load: float) -> _Row | None:
        """Find the stable orbit near the last state; return its row."""
        periods = None if self.orbit is None else self.orbit.periods
        try:
            orbit: Any = find_orbit(system, guess=self.state, periods=periods, options=self.tight)
        except (OrbitError, RunError):
            self.orbit = None
            return None
        if not (orbit.stable and orbit.admissible):
            self.orbit = None
            return None
        self.orbit, self.state, self.load = orbit, orbit.state, load
        # The force on a frame at rest grows with the load, all else being equal. A rest that ends
        # by break-away does so without additional load.
        margins = [
            float(arc.minima[BREAK_AWAY])
            for segment, arc in zip(orbit.numeric.segments, orbit.numeric.point.arcs, strict=True)
            if direction_of(segment.mode) == 0 and segment.code != BREAK_AWAY
        ]
        held = float(system.units.scales.out(min(margins), "N")) if margins else math.inf
        self.expected = load + held
        return self._row(orbit.step / orbit.periods, "orbit")

    def _row(self, moved: float, by: str) -> _Row:
        moved = 0.0 if abs(moved) < MIN_DISPLACEMENT * self.system.actuator.delta else moved
        return _Row(moved, STANDS if moved == 0.0 else WALKS if moved > 0.0 else BACK, by)


def _runaway(run: ActuatorRun, periods: int) -> int:
    """Return the direction (1, -1) in which the frame runs away at the end of a run, or 0."""
    trajectory = run.trajectory
    log, final = trajectory.events, trajectory.final
    direction = direction_of(final.mode)
    first = final.cycle + final.time / trajectory.period - periods
    late = log[log.cycle + log.time / trajectory.period >= first]
    modes = {*late.mode_before.tolist(), *late.mode_after.tolist()}
    if direction == 0 or any(direction_of(mode) != direction for mode in modes):
        return 0
    system = run.system
    model = compose(tuple(term.kind for term in system.actuator.terms), 1)
    p, normal = accounted_problem(system, Options()).parameters, float(system.normal_forces().max())
    for factor in (1.0, FASTER):
        y = final.y.copy()
        y[[X1, V1]] *= factor
        outside = model.on_frame(y, p) + model.on_block(y, p)
        if direction * (outside - model.sliding_friction(direction, y[V1], normal, p)) <= 0.0:
            return 0
    return direction


def _holding_loads(system: ActuatorSystem) -> tuple[float, float]:
    """Return the least loads that friction holds on a slipping frame, and on a frame at rest."""
    model = compose(tuple(term.kind for term in system.actuator.terms), 1)
    p = accounted_problem(system, Options()).parameters
    y = np.zeros(len(model.layout.states))
    outside = model.on_frame(y, p) + model.on_block(y, p)
    # If friction depends on the speed, it holds at most its minimum.
    speeds = SPEEDS if model.sticks else SPEEDS[-1:]
    normal = float(system.normal_forces().min())
    friction = [model.sliding_friction(1, speed, normal, p) for speed in speeds.tolist()]
    sliding, static = min(friction) + outside, eq.mu_s(p) * normal + outside
    return float(system.units.scales.out(sliding, "N")), float(system.units.scales.out(static, "N"))


def _zero(loads: Any, speed: Any) -> float:
    """Return the load of zero speed, by linear interpolation between two loads."""
    for i in np.flatnonzero(speed[:-1] * speed[1:] <= 0.0).tolist():
        if speed[i] > speed[i + 1]:
            share = speed[i] / (speed[i] - speed[i + 1])
            return float(loads[i] + share * (loads[i + 1] - loads[i]))
    return math.nan
