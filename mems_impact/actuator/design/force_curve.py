"""Speed over an opposing load, and the largest load."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.bisection import bisect
from mems_impact._util.progress import progress_bar
from mems_impact.actuator import equations as eq
from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.automaton import direction_of
from mems_impact.actuator.design.energy import accounted_problem
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.equations import V1, X1
from mems_impact.actuator.model import compose
from mems_impact.actuator.parameters import numbers_for
from mems_impact.actuator.results import ActuatorRun
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.actuator.terms.frame_force import FrameForce
from mems_impact.analysis.simulate import simulate
from mems_impact.analysis.steady_state import steady_state
from mems_impact.errors import Interrupted, InvalidParameter, RunError
from mems_impact.integrators.options import Options
from mems_impact.systems.result import Result
from mems_impact.systems.state import State, is_number, whole
from mems_impact.tables import row_table

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import ArrayLike

LOAD = "frame_force.force"
WALKS, BACK, STANDS, AWAY = "walks", "walks back", "stands", "runs away"
FASTER = 1e3  # factor of the speed at which friction is checked for a frame that runs away
SPEEDS = np.geomspace(1e-9, 1e9, 18001)  # of a slip, in scaled units
MIN_DISPLACEMENT = 1e-12  # of delta: a smaller displacement is rounding
COARSE_LOADS = 5  # up to the holding force, between which a stall force is sought
LOADS = 9  # of a curve by default, up to just below the stall force
NEAR, BEYOND = 0.99, 1.1  # the last loads by default, relative to the stall force
STALL_RTOL = 1e-4  # accuracy of a stall force, relative to the holding force
MOST_DOUBLINGS = 8  # of the holding force, for a device that walks against it


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ForceCurve(Result):
    """Mean speed over an opposing force, in the units of the device.

    Attributes
    ----------
    system : ActuatorSystem
        The system without load.
    table : DataFrame
        One row per load, ascending: load, displacement per period, mean speed and its error (see
        `Settling`), power (load times speed), and what the frame ``does``: "walks", "walks back",
        "stands", or "runs away" without a mean speed.
    sliding_force : float
        Largest load at which every slip ends by itself: the friction on a slipping frame [N]. Above
        this load, a device that slips back runs away.
    holding_force : float
        Largest load that static friction holds without voltage [N].
    stall_force : float
        Largest load against which the device walks, to 1e-4 of the holding force [N]: above it the
        device walks back, stands, or runs away; negative for a device that walks to the left. NaN
        for a device that does not walk without a load.

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
    stall_force: float

    def summary(self) -> dict[str, Any]:
        """Return the characteristic loads."""
        names = ("sliding_force", "holding_force", "stall_force")
        return {"system": repr(self.system), **{name: getattr(self, name) for name in names}}


class LoadedMotion(NamedTuple):
    """The settled motion under a load: displacement per period, its error, state, what it does."""

    displacement: float
    error: float
    does: str
    state: State | None = None


def force_curve(
    actuator: Actuator,
    drive: Drive,
    loads: ArrayLike | None = None,
    *,
    transient: int = 100,
    periods: int = 40,
    initial: State | None = None,
    options: Options = Options(),  # noqa: B008 - immutable
    progress: bool | Callable[[float], None] = False,
) -> ForceCurve:
    """Compute the mean speed of a device over an opposing force, and its stall force.

    Loads are processed in ascending order, each from the state at the previous load, in the steady
    state (see `steady_state`).

    Parameters
    ----------
    actuator : Actuator
        The device; its own `FrameForce` is ignored.
    drive : Drive
    loads : array_like of float or str, optional
        Forces [N] to the left, against motion to the right; texts may have units (``"3 uN"``). By
        default from none to somewhat more than the stall force.
    transient, periods : int, optional
        Forcing periods of transient and of measurement in each run.
    initial : State, optional
        Initial state of the run without load; a kick by default (see `kicked_state`).
    options : Options, optional
        Options of the integration; method "adams" by default, and "auto" with a stiff term.
    progress : bool or callable, optional
        Show progress; a function is called with the number of finished loads.

    Returns
    -------
    ForceCurve

    Raises
    ------
    InvalidParameter
        If an argument is out of range.
    RunError
        If a run fails, and the device does not run away.
    Interrupted
        On Ctrl-C; ``partial`` is the table of the finished loads.

    See Also
    --------
    ForceCurve, plot_force_curve, characteristic, FrameForce

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
    transient, periods = whole("transient", transient, 0), whole("periods", periods, 1)
    system = actuator.adding(FrameForce(force=0.0)).under(drive)
    chain = LoadChain(system, initial, transient, periods, options)
    sliding, holding = holding_loads(system)
    stall = chain.stall(holding)
    values = _loads(actuator, loads, holding, stall)
    motions: list[LoadedMotion] = []

    def table() -> pd.DataFrame:
        columns = dict.fromkeys(
            ("load", "displacement per period", "mean speed", "mean speed error", "power"), float
        )
        period = float(system.forcing_period)
        rows = [
            (load, moved, moved / period, error / period, load * moved / period, does)
            for load, (moved, error, does, _) in zip(values.tolist(), motions, strict=False)
        ]
        return row_table({**columns, "does": str}, rows, system)

    with progress_bar(progress, "loads", values.size, "load curve") as show:
        try:
            for number, motion in enumerate(chain.along(values.tolist()), start=1):
                motions.append(motion)
                if show is not None:
                    show(number)
        except KeyboardInterrupt:
            after = f"{len(motions)} of {values.size} loads"
            raise Interrupted("load curve", after, table()) from None
    return ForceCurve(
        system=system, table=table(), sliding_force=sliding, holding_force=holding,
        stall_force=stall,
    )  # fmt: skip


def _loads(actuator: Actuator, loads: Any, holding: float, stall: float) -> Floats:
    """Return the loads in ascending order."""
    if loads is None:
        end = stall if math.isfinite(stall) and stall != 0.0 else holding
        values = [*np.linspace(0.0, NEAR * end, LOADS).tolist(), BEYOND * end]
    else:
        values = numbers_for(actuator, "loads", loads, "N")
    try:
        found = np.sort(np.atleast_1d(np.asarray(values, dtype=float)))
    except (TypeError, ValueError):
        found = np.array([])
    if found.ndim != 1 or found.size == 0 or not all(map(is_number, found.tolist())):
        raise InvalidParameter("loads", loads, "one or more finite numbers")
    return found


def stall_force(
    system: ActuatorSystem, initial: State | None, transient: int, periods: int, options: Options
) -> tuple[float, State]:
    """Return `ForceCurve.stall_force` of a device under a drive, and its state without load."""
    loaded = system.actuator.adding(FrameForce(force=0.0)).under(system.drive)
    chain = LoadChain(loaded, initial, transient, periods, options)
    return chain.stall(holding_loads(loaded)[1]), chain.start


class LoadChain:
    """Settled motions under successive loads, each from the state under the previous one."""

    def __init__(
        self,
        system: ActuatorSystem,
        initial: State | None,
        transient: int,
        periods: int,
        options: Options,
    ) -> None:
        self.system, self.options = system, options
        self.start = system.state_space.initial("down") if initial is None else initial
        self.transient, self.periods = transient, periods

    def along(self, loads: Iterable[float]) -> Iterator[LoadedMotion]:
        """Yield the motions under ascending loads."""
        motion = LoadedMotion(math.nan, math.nan, STANDS, self.start)
        for load in loads:
            if motion.state is not None:
                motion = self.at(load, motion.state)
            yield motion

    def stall(self, holding: float) -> float:
        """Return the largest load against which the device walks; NaN if it does not walk."""
        free = self.at(0.0, self.start)
        if free.does not in (WALKS, BACK) or free.state is None:
            return math.nan
        sign, state = math.copysign(1.0, free.displacement), free.state
        self.start = state

        def walks(size: float) -> bool:
            nonlocal state
            motion = self.at(sign * size, state)
            if motion.state is None or not sign * motion.displacement > 0.0:
                return False
            state = motion.state
            return True

        unit = holding if holding > 0.0 else float(self.system.units.scales.out(1.0, "N"))
        steps = np.linspace(0.0, unit, COARSE_LOADS)[1:].tolist()
        low = 0.0
        for high in (*steps, *(unit * 2.0**i for i in range(1, MOST_DOUBLINGS))):
            if not walks(high):
                return sign * bisect(walks, low, high, STALL_RTOL * unit)[0]
            low = high
        return math.nan

    def at(self, load: float, start: State) -> LoadedMotion:
        """Return the motion under a load; its state is None where the frame runs away backwards."""
        system = self.system.changed(**{LOAD: load})
        length = self.transient + self.periods
        first = start.time / system.forcing_period + self.transient
        try:
            run: Any = simulate(
                system, length, initial=start, options=self.options,
                window=(first, first + self.periods),
            )  # fmt: skip
        except RunError as error:
            run = error.partial
            if _runaway(run, self.periods) == 0:
                raise
        if direction := _runaway(run, self.periods):
            # No larger load ends the motion backwards.
            return LoadedMotion(math.nan, math.nan, AWAY, None if direction < 0 else self.start)
        run = steady_state(run)
        moved = float(run.statistics["displacement per period"])
        moved = 0.0 if abs(moved) < MIN_DISPLACEMENT * self.system.actuator.delta else moved
        does = STANDS if moved == 0.0 else WALKS if moved > 0.0 else BACK
        return LoadedMotion(moved, run.settling.remaining("displacement per period"), does,
                            run.final)  # fmt: skip


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


def holding_loads(system: ActuatorSystem) -> tuple[float, float]:
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
