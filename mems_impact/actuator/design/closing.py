"""Closing of a contact: closing time, bounces, impact speeds, settling."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from mems_impact._util.arrays import Floats
from mems_impact._util.quantities import quantity
from mems_impact._util.warning_scopes import collected_warnings
from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.automaton import RIGHT_IMPACT
from mems_impact.actuator.design.energy import Energy, energy
from mems_impact.actuator.drives.aperiodic import AperiodicDrive
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.equations import V2, X2
from mems_impact.actuator.impact_statistics import contact_side, is_impact
from mems_impact.actuator.results import ActuatorRun
from mems_impact.analysis.settling import MOST_DIGITS, digits
from mems_impact.analysis.simulate import simulate
from mems_impact.errors import InvalidParameter, RunError
from mems_impact.hybrid.simulation import CheckpointGrid, Trajectory, resample
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.options import Options
from mems_impact.systems.result import Result
from mems_impact.systems.state import State, is_number
from mems_impact.tables import category_column, table

if TYPE_CHECKING:
    import pandas as pd

LENGTHS = (8.0, 64.0, 512.0)  # natural periods after the voltage is constant, until it settles
FLIGHT_SAMPLES = 64  # of a bounce, for its height
MIN_SAMPLED_HEIGHT = 4e-4  # relative to the travel: four times that of bounces that are parabolas
DURATION_RATIO = 1.25  # of a voltage to the run, which ends before it is switched off
REST_LENGTH = 1.0  # natural periods of contact after which it is permanent
CHARGES = ("charge", "left_charge", "offset", "left_offset")
CHARGE_RTOL = 1e-3  # change of a charge over a run, at its final rate, of a constant charge
HOLD_FACTOR, HOLD_RUNS = 8.0, 16  # between lengths of runs until charges are constant; their number
TOLERANCE_RATIO = 0.1  # of the run that gives the errors of another one
MIN_COMPARED_RTOL = 1e-13  # of that run, which takes larger tolerances below
UNKNOWN = "within the error of the integration; lower rtol and atol"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Closing(Result):
    """Closing of the contact between block and stopper, in the units of the device.

    Attributes
    ----------
    closing_time : float
        Time of the first impact [s]; NaN if the contact does not close within the run.
    impact_speed : float
        Speed of the block in the first impact [m/s].
    bounces : int
        Number of bounces on the stopper of the first impact that are at least `smallest_bounce`
        high.
    settling_time : float
        Time from which on the block stays on the stopper [s]; NaN if the block does not stay within
        the run, or leaves the stopper later, before charges and offsets of the electrodes are
        constant.
    stopper : str
        "right" or "left"; empty if the contact does not close within the run.
    smallest_bounce : float
        Least height of a bounce that counts, relative to the travel.
    errors : dict of str to float
        Errors of the times and of the impact speed, by their names: the change under tolerances ten
        times as small. Infinite if the contact closes, or stays closed, in one of both runs only.
    table : DataFrame
        One row per impact: time t, stopper, impact speed; contact, the duration of the contact (0
        for an impact with restitution; the time of the rest contact at the end of a chatter
        sequence, with its last, unresolved impacts); flight, the duration of the bounce that
        follows, and its height. NaN if the block stays on the stopper, or does not return.
    run : ActuatorRun
        The run, from which `energy` is computed.

    See Also
    --------
    closing, plot_closing, SoftLanding

    Examples
    --------
    >>> import mems_impact as mi
    >>> switch = mi.load_actuator("abdulrahim2016")
    >>> found = mi.closing(switch, mi.VoltageStep(amplitude=90))
    >>> f"{found.energy.lost:.3g} J dissipated"
    '6.97e-11 J dissipated'
    """

    _si_units = {"closing_time": "s", "impact_speed": "m/s", "settling_time": "s"}  # noqa: RUF012 - ClassVar in SummaryRepr

    closing_time: float
    impact_speed: float
    bounces: int
    settling_time: float
    stopper: str
    smallest_bounce: float
    errors: Mapping[str, float] = field(repr=False)
    table: pd.DataFrame = field(repr=False)
    run: ActuatorRun = field(repr=False)
    si: bool = False

    def summary(self) -> dict[str, Any]:
        """Return the stopper, times, speed and bounces, with the digits that are known."""
        values = super().summary()
        for name, error in self.errors.items():
            value = values[name]
            if error < abs(value):
                values[name] = float(f"{value:.{digits(error / abs(value), MOST_DIGITS)}g}")
            elif error > 0.0:
                values[name] = UNKNOWN
        return values

    @cached_property
    def energy(self) -> Energy:
        """Energy balance of the run: given by the drive, lost and stored."""
        return energy(self.run, 0.0, self.run.periods)


def closing(
    actuator: Actuator,
    drive: Drive,
    *,
    duration: float | str | None = None,
    initial: State | Mapping[str, float] | None = None,
    smallest_bounce: float = 0.01,
    options: Options = Options(),  # noqa: B008 - immutable
) -> Closing:
    """Compute the closing of a contact: closing time, bounces, impact speeds, settling.

    The stopper is the contact of a switch, the block its armature.

    Parameters
    ----------
    actuator : Actuator
    drive : Drive
        A voltage that is switched on at t = 0: `VoltageStep` or `PulseAndHold`, or the first part
        of any other drive.
    duration : float or str, optional
        Length of the run [s], or a text with a unit; by default until the contact stays closed and
        the charges and offsets of the electrodes are constant, at most 512 natural periods of the
        block after the last change of the voltage, one forcing period of a periodic drive, or until
        the voltage is switched off.
    initial : State or mapping of str to float, optional
        Initial state; at rest in the middle by default.
    smallest_bounce : float, optional
        Least height of a bounce that counts, relative to the travel; > 0. With restitution, a
        chatter sequence has infinitely many bounces.
    options : Options, optional
        Options of the integration; method "adams" by default, and "auto" with a stiff term.

    Returns
    -------
    Closing

    Raises
    ------
    InvalidParameter
        If an argument is out of range.

    See Also
    --------
    Closing, plot_closing, soft_landing, pull_in_voltage

    Notes
    -----
    An actuator with a heavy frame is a switch on a chip that keeps its place: ``mass_ratio=1e5``
    and ``friction=1`` in `Actuator.from_design`. A compliant stopper (`CompliantStopper`) makes
    contacts of finite duration.

    Examples
    --------
    >>> import mems_impact as mi
    >>> switch = mi.load_actuator("abdulrahim2016")
    >>> found = mi.closing(switch, mi.VoltageStep(amplitude=90))
    >>> f"{found.closing_time * 1e6:.1f} us at {found.impact_speed:.3f} m/s"
    '27.8 us at 0.234 m/s'
    >>> found.bounces, f"{found.settling_time * 1e6:.1f} us"
    (2, '37.4 us')
    """
    if not isinstance(actuator, Actuator):
        raise InvalidParameter("actuator", actuator, "an Actuator (see load_actuator)")
    if not isinstance(drive, Drive):
        raise InvalidParameter("drive", drive, "a Drive, such as VoltageStep(amplitude=…)")
    si = actuator.units == "SI"
    fixed = quantity("duration", duration, "s" if si else None, "device")
    if fixed is not None and not (is_number(fixed) and fixed > 0.0):
        raise InvalidParameter("duration", duration, "a finite number > 0")
    if not (is_number(smallest_bounce) and 0.0 < smallest_bounce < 1.0):
        raise InvalidParameter("smallest_bounce", smallest_bounce, "between 0 and 1 (exclusive)")
    natural = natural_period(actuator)
    if fixed is not None:
        lengths = [float(fixed)]
    elif not isinstance(drive, AperiodicDrive):
        lengths = [drive.period]
    elif drive.duration is not None:
        lengths = [drive.duration]
    else:
        lengths = [drive.switching_time + count * natural for count in LENGTHS]
    for length in lengths:
        run = run_of(actuator, drive, length, initial, options)
        if contact_length(run) > REST_LENGTH * natural and charges_are_constant(run):
            break
    unbounded = fixed is None and isinstance(drive, AperiodicDrive) and drive.duration is None
    stays = not unbounded or holds(run, drive, initial, options)
    result = result_of(run, smallest_bounce, stays=stays)
    coarse = TOLERANCE_RATIO * options.rtol < MIN_COMPARED_RTOL
    ratio = 1.0 / TOLERANCE_RATIO if coarse else TOLERANCE_RATIO
    other_options = replace(options, rtol=ratio * options.rtol, atol=ratio * options.atol)
    other_run = run_of(actuator, drive, length, initial, other_options)
    other = result_of(other_run, smallest_bounce, stays=stays)
    return replace(result, errors={name: difference(result, other, name) for name in result.errors})


def difference(one: Closing, other: Closing, name: str) -> float:
    """Return the difference of a number of two closings, infinite if one of both is NaN."""
    a, b = getattr(one, name), getattr(other, name)
    if math.isnan(a) or math.isnan(b):
        return 0.0 if math.isnan(a) and math.isnan(b) else math.inf
    return abs(a - b)


def natural_period(actuator: Actuator) -> float:
    """Return the period of the free oscillation of the block in a held frame, without damping."""
    return 2.0 * math.pi * math.sqrt(actuator.m2 / actuator.k)


def run_of(
    actuator: Actuator,
    drive: Drive,
    length: float,
    initial: State | Mapping[str, float] | None,
    options: Options,
) -> ActuatorRun:
    """Return the run from the switching on of a voltage over a length in the device's units."""
    if isinstance(drive, AperiodicDrive) and length <= (drive.duration or math.inf):
        drive = drive.lasting(DURATION_RATIO * length)
    system = actuator.under(drive)
    periods = length / system.forcing_period
    run: Any = simulate(system, periods, initial=initial, window=(0.0, periods), options=options)
    return run


def rest_start(trajectory: Trajectory) -> float:
    """Return the time since which the block has been on a stopper; NaN if it is not at the end."""
    log = trajectory.events
    if contact_side(trajectory.final.mode) == 0:
        return math.nan
    begins = np.flatnonzero(
        (contact_side(log.mode_before) == 0) & (contact_side(log.mode_after) != 0)
    )
    return float(times(trajectory)[begins[-1]]) if begins.size else 0.0


def contact_length(run: ActuatorRun) -> float:
    """Return how long the block has been on a stopper at the end, in the device's units."""
    return run.end - float(run.system.units.out("time", rest_start(run.trajectory)))


def holds(
    run: ActuatorRun,
    drive: Drive,
    initial: State | Mapping[str, float] | None,
    options: Options,
) -> bool:
    """Return whether the block stays on its stopper after a run, until the charges are constant."""
    longer = run
    for _ in range(HOLD_RUNS):
        if charges_are_constant(longer):
            return True
        try:
            with collected_warnings():  # of the length, which is not the user's
                length = HOLD_FACTOR * longer.end
                longer = run_of(run.system.actuator, drive, length, initial, options)
        except RunError:  # steps of a free oscillation, after a release
            return False
        if not contact_length(longer) >= longer.end - run.end:
            return False
    return False


def charges_are_constant(run: ActuatorRun) -> bool:
    """Return whether the charges of the electrodes, which hold the block, no longer change."""
    trajectory = run.trajectory
    final, problem, log = trajectory.final, trajectory.problem, trajectory.events
    charges = [i for i, name in enumerate(run.system.states) if name in CHARGES]
    p = problem.parameters_at(final.cycle)
    rates = problem.automaton.slope_at(final.mode, final.time, final.y, p)[charges]
    size = np.abs(np.vstack([log.before, final.y])[:, charges]).max(axis=0)
    length = final.cycle * problem.period + final.time
    return bool((np.abs(rates) * length <= CHARGE_RTOL * size).all())


def times(trajectory: Trajectory) -> Floats:
    """Return the times of all events since the start of the first forcing period."""
    log = trajectory.events
    result: Floats = log.cycle * trajectory.period + log.time
    return result


def result_of(run: ActuatorRun, smallest_bounce: float, *, stays: bool) -> Closing:
    """Return the closing of a run, after which a block that is held may stay on its stopper."""
    system, trajectory = run.system, run.trajectory
    log, when = trajectory.events, times(run.trajectory)
    hits = np.flatnonzero(is_impact(log))
    delta = float(system.units.into("delta", system.parameters["delta"]))
    side = np.where(log.guard[hits] == RIGHT_IMPACT, 1, -1)
    contact, flight, height = (np.full(hits.size, math.nan) for _ in range(3))
    for i, row in enumerate(hits.tolist()):
        end, following = row, int(hits[i + 1]) if i + 1 < hits.size else len(log)
        closed_rows = np.flatnonzero(contact_side(log.mode_after[row:following]))
        if closed_rows.size:  # in a compliant contact, or after the end of a chatter sequence
            end = row + int(closed_rows[-1]) + 1
            if end == following:
                continue
        contact[i] = when[end] - when[row]
        if following < len(log):
            flight[i] = when[following] - when[end]
            height[i] = bounce_height(trajectory, end, following, delta, int(side[i]))
    closed = bool(hits.size)
    # A block that moves within a compliant contact may leave it.
    held = trajectory.final.y[V2] == 0.0
    held = held or contact_length(run) > REST_LENGTH * natural_period(system.actuator)
    stays = stays and closed and held and contact_side(trajectory.final.mode) == side[0]
    settled = rest_start(trajectory) if stays else math.nan
    speeds = np.abs(log.before[hits, V2])
    same_side = side == side[0] if closed else np.zeros(0, dtype=bool)
    columns = {
        "t": when[hits],
        "impact speed": speeds,
        "contact": contact,
        "flight": flight,
        "height": height,
    }
    contacts = table(columns, system)
    contacts.insert(1, "stopper", category_column(["right", "left"], (side != 1).astype(np.int64)))
    return Closing(
        closing_time=float(system.units.out("time", when[hits[0]])) if closed else math.nan,
        impact_speed=float(system.units.out("impact speed", speeds[0])) if closed else math.nan,
        bounces=int((height[same_side] >= smallest_bounce * delta).sum()),
        settling_time=float(system.units.out("time", settled)),
        stopper=("right" if side[0] == 1 else "left") if closed else "",
        smallest_bounce=float(smallest_bounce),
        errors=dict.fromkeys(("closing_time", "impact_speed", "settling_time"), 0.0),
        table=contacts,
        run=run,
        si=system.units.scales.named,
    )


def bounce_height(
    trajectory: Trajectory, leaves: int, returns: int, delta: float, side: int
) -> float:
    """Return the largest distance from a stopper in the flight between two events."""
    log, period = trajectory.events, trajectory.period
    start, end = log.instant(leaves), log.instant(returns)
    length = (end.cycle - start.cycle) * period + end.time - start.time
    speed = max(abs(float(start.y[V2])), abs(float(log.before[returns, V2])))
    if speed * length < MIN_SAMPLED_HEIGHT * delta:
        return 0.25 * speed * length  # of a parabola
    end = HybridState(end.cycle, end.time, int(log.mode_before[returns]), log.before[returns])
    count = math.ceil(FLIGHT_SAMPLES * period / length)
    grid = resample(trajectory.problem, start, end, CheckpointGrid(count))
    elapsed = (grid.cycle - start.cycle) * period + grid.time - start.time
    within = (elapsed > 0.0) & (elapsed < length)
    y = np.vstack([start.y, grid.y[within], end.y])
    positions = side * y[:, X2]
    path = CubicHermiteSpline([0.0, *elapsed[within], length], positions, side * y[:, V2])
    turns = path.derivative().roots(extrapolate=False)
    lowest = path(turns[np.isfinite(turns)]).min(initial=float(positions.min()))
    return delta - float(lowest)
