"""Answers to a designer's usual questions: step length, resolution and speed, voltages.

Formulas are in the units of the actuator; what they leave out stands with each of them, and
`step_lengths` sets the formula beside the simulation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from mems_impact.actuator import equations as eq
from mems_impact.actuator import tables
from mems_impact.actuator.composing import compose
from mems_impact.actuator.design.at_rest import AtRest, coasting
from mems_impact.actuator.design.impacts import frame_steps
from mems_impact.actuator.drive import Drive
from mems_impact.actuator.modes import RIGHT_IMPACT, V1, V2
from mems_impact.actuator.parameters import Actuator
from mems_impact.analysis.state import State
from mems_impact.analysis.values import Summarized
from mems_impact.engines.options import Options
from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.hybrid.trajectory import Events, Floats
from mems_impact.tables.common import bare

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import ArrayLike

    from mems_impact.actuator.results import ActuatorRun

__all__ = [
    "Window",
    "period_one_window",
    "pull_in_voltage",
    "resolution",
    "resting_voltage",
    "speed_over_voltage",
    "step_length",
    "step_lengths",
]


def pull_in_voltage(actuator: Actuator) -> float:
    """Return the lowest voltage at which the block, pulled slowly, reaches the right stopper.

    In equilibrium k x2 = alpha v^2 / (d - x2)^2, that is v^2 = k x2 (d - x2)^2 / alpha, which has
    its largest value at x2 = d/3: beyond ``sqrt(4 k d^3 / (27 alpha))`` no equilibrium is left
    and the block snaps to the stopper. A stopper nearer than d/3 is reached before that, at
    `resting_voltage`.

    With terms, the largest voltage that an equilibrium takes between where the block rests without
    voltage and the stopper is found numerically. What stands before the electrode passes a slow
    voltage, and its insulation is free of charge.

    Parameters
    ----------
    actuator : Actuator

    Returns
    -------
    float
        [V]; 0 where the block is on the stopper without voltage.

    Raises
    ------
    InvalidParameter
        If where the states of a term come to rest is not known.

    See Also
    --------
    resting_voltage, load_actuator

    Examples
    --------
    >>> import mems_impact as mi
    >>> f"{mi.pull_in_voltage(mi.load_actuator('mita2003')):.2f} V"
    '31.57 V'
    """
    if actuator.terms:
        return float(actuator.scales.out(AtRest(actuator).pull_in(), "V"))
    if actuator.delta <= actuator.d / 3.0:
        return resting_voltage(actuator)
    return math.sqrt(4.0 * actuator.k * actuator.d / (27.0 * actuator.alpha)) * actuator.d


def resting_voltage(actuator: Actuator) -> float:
    """Return the voltage above which a block on the right stopper stays there.

    ``sqrt(k delta / alpha) (d - delta)``: attraction against spring, the frame at rest. With terms,
    attraction and adhesion against all forces that hold then; see `pull_in_voltage`.

    Parameters
    ----------
    actuator : Actuator

    Returns
    -------
    float
        [V]; 0 where it stays without voltage.

    Raises
    ------
    InvalidParameter
        If where the states of a term come to rest is not known.

    See Also
    --------
    pull_in_voltage, Adhesion

    Examples
    --------
    >>> import mems_impact as mi
    >>> f"{mi.resting_voltage(mi.load_actuator('mita2003')):.2f} V"
    '29.00 V'
    """
    if actuator.terms:
        return float(actuator.scales.out(AtRest(actuator).resting(), "V"))
    return math.sqrt(actuator.k * actuator.delta / actuator.alpha) * (actuator.d - actuator.delta)


def step_length(actuator: Actuator, speed: ArrayLike, voltage: ArrayLike = 0.0) -> Any:
    """Return how far one impact on the right stopper moves the frame, by the momentum argument.

    A frame at rest leaves an impact of the block at `speed` with v1' = (1 + e) m2/(m1 + m2) speed
    (Equation 5); friction and the load of spring, damper and attraction just after the impact
    slow it down by a_f = (mu_d N - L)/m1 (Equations 1 and 3), so that it comes to rest after
    v1'^2/(2 a_f). That leaves out how load and friction change while the frame slides, and
    whatever comes before rest: another impact above all. Terms enter by what they are just after
    the impact.

    Parameters
    ----------
    actuator : Actuator
    speed : array_like
        Speed v2 of the block before the impact [m/s], >= 0.
    voltage : array_like, optional
        At the impact, at the electrode [V].

    Returns
    -------
    float or ndarray
        [m]; infinite where the load overcomes friction.

    Raises
    ------
    InvalidParameter
        If the actuator has terms for which the formula does not hold: stoppers that yield, friction
        without rest, or forces with a past of their own.

    See Also
    --------
    step_lengths, resolution

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> f"{mi.step_length(actuator, 0.4):.3e}"
    '2.337e-03'
    """
    if actuator.terms:
        return _step_with_terms(actuator, speed, voltage)
    p = actuator.to_array()
    speeds, volts = np.broadcast_arrays(np.asarray(speed, float), np.asarray(voltage, float))
    after = eq.frame_speed_after(0.0, 1.0, actuator.e, p) * speeds
    pull = actuator.alpha * volts**2 / (actuator.d - actuator.delta) ** 2
    load = actuator.k * actuator.delta - actuator.c * actuator.e * speeds - pull
    slowing = (eq.sliding_friction(1, p) - load) / actuator.m1
    with np.errstate(divide="ignore", invalid="ignore"):
        result = np.where(slowing > 0.0, after**2 / (2.0 * slowing), np.inf)
    return float(result) if result.ndim == 0 else result


def _step_with_terms(actuator: Actuator, speed: ArrayLike, voltage: ArrayLike) -> Any:
    scales, device = actuator.scales, AtRest(actuator)

    def step(one: float, volts: float) -> float:
        y = device.after_impact(float(scales.into(one, "m/s")))
        inner = coasting(device.model, y, float(scales.into(volts, "V")), 0.0, device.p)
        return float(scales.out(inner, "m"))

    result = np.vectorize(step, otypes=[float])(speed, voltage)
    return float(result) if result.ndim == 0 else result


def step_lengths(run: ActuatorRun) -> pd.DataFrame:
    """Return the steps of a run beside the formula.

    Parameters
    ----------
    run : Run
        With its events kept.

    Returns
    -------
    DataFrame
        One row an impact on the right stopper that struck a frame at rest: period, phase, speed
        v2 before, voltage, step (simulated), formula, and their ratio.

    See Also
    --------
    step_length, simulate, blows

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> run = mi.simulate(actuator, drive, periods=300)
    >>> mi.step_lengths(run).columns.tolist()
    ['period', 'phase', 'v2 before', 'voltage', 'step', 'formula', 'ratio']
    """
    log, period = run.trajectory.events, run.trajectory.period
    rows, steps = frame_steps(log)
    struck = np.zeros(len(log), dtype=bool)
    struck[rows] = True
    hits = log[struck]
    chosen = (hits.guard == RIGHT_IMPACT) & (hits.before[:, V1] == 0.0) & (steps > 0.0)
    hits, steps = hits[chosen], steps[chosen]
    scales = run.system.scales
    volts = run.drive.value(scales.out(hits.time, "s"))
    speed = scales.out(hits.before[:, V2], "m/s")
    if run.actuator.terms:
        formula = scales.out(_steps_after(run, hits), "m")
    else:
        formula = step_length(run.actuator, speed, volts)
    return tables.step_lengths(
        hits.cycle, hits.time / period, speed, volts, scales.out(steps, "m"), formula, run.system
    )


def _steps_after(run: ActuatorRun, hits: Events) -> Floats:
    """Return the formula from the states after impacts, with those of the terms."""
    system = run.system
    if any(term.instead == "stopper" for term in system.actuator.terms):
        AtRest(system.actuator).after_impact(0.0)  # says why there is none
    numbers = system.numbers()
    left = system.drive.left_voltage is not None
    model = compose(tuple(term.kind for term in system.actuator.terms), 2 if left else 1)
    times = system.scales.out(hits.time, "s")
    volts = [
        system.scales.into(system.drive.value(times, left=side), "V") for side in (False, True)
    ]
    rows = zip(hits.after, *volts, strict=True)
    return np.array([coasting(model, y, v, w, numbers.parameters) for y, v, w in rows])


def speed_over_voltage(
    actuator: Actuator,
    drive: Drive,
    amplitudes: ArrayLike,
    *,
    parameter: str = "amplitude",
    transient: int = 300,
    periods: int = 60,
    initial: State | None = None,
    options: Options = Options(),  # noqa: B008 - immutable
    workers: int | None = None,
) -> pd.DataFrame:
    """Return steps and speed over the voltage, from the highest down: what is on stays on.

    Parameters
    ----------
    actuator : Actuator
    drive : Drive
    amplitudes : array_like
        Values of the voltage.
    parameter : str
        Which voltage of the drive is varied, such as ``"right.amplitude"`` of a two-sided one.
    transient, periods, initial, options, workers
        As for `mems_impact.sweep`.

    Returns
    -------
    DataFrame
        One row an amplitude, ascending: impacts and blows (see `mems_impact.Blows`) per period,
        displacement per period, per impact and per blow, mean speed. A period is that of the
        drive, of v^2, also where a term makes the sign of the voltage matter.

    See Also
    --------
    resolution, load_curve, sweep

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> speeds = mi.speed_over_voltage(
    ...     actuator, drive, [0.2, 0.24], transient=100, periods=10, initial=mi.kicked(actuator)
    ... )
    >>> bool(speeds["mean speed"].is_monotonic_increasing)
    True
    """
    from mems_impact.actuator.system import ActuatorSystem
    from mems_impact.studies.sweep import sweep
    from mems_impact.tables.sweep import sweep_summary

    system = ActuatorSystem(actuator, drive)
    table = sweep(
        system, parameter, amplitudes, direction="down", transient=transient, periods=periods,
        initial=initial, options=options, workers=workers,
    )  # fmt: skip
    summary = sweep_summary(table).iloc[::-1]
    share = drive.period / system.forcing_period  # below 1 where a term makes the sign matter
    return tables.speed(
        parameter,
        summary[parameter].to_numpy(),
        share * summary["impacts per period"].to_numpy(),
        share * summary["blows per period"].to_numpy(),
        share * summary["displacement per period"].to_numpy(),
        drive.period,
        system,
    )


def resolution(speeds: pd.DataFrame) -> float:
    """Return the smallest forward step in a table of `speed_over_voltage`.

    Of the voltages with one blow in a forcing period: there, each step is the same.

    Parameters
    ----------
    speeds : DataFrame

    Returns
    -------
    float
        Displacement per blow [m].

    Raises
    ------
    InvalidParameter
        If the table is none of `speed_over_voltage`, or no voltage in it makes one blow in a
        period that moves the frame forward.

    See Also
    --------
    speed_over_voltage, period_one_window

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> speeds = mi.speed_over_voltage(
    ...     actuator, drive, [0.2, 0.24], transient=300, periods=10, initial=mi.kicked(actuator)
    ... )
    >>> f"{mi.resolution(speeds):.2e}"
    '1.45e-04'
    """
    table = bare(speeds)
    if "displacement per blow" not in table:
        raise InvalidParameter("speeds", None, "", problem="not a table of speed_over_voltage")
    blows, moved = table["blows per period"], table["displacement per blow"]
    one = np.isclose(blows, 1.0)
    forward = moved[one & (moved > 0.0)]
    if forward.empty:
        problem = _no_step(blows, one)
        raise InvalidParameter("speeds", None, "", problem=problem)
    return float(forward.min())


def _no_step(blows: pd.Series, one: pd.Series) -> str:
    """Return why no row of a table tells the resolution."""
    if one.any():
        return (
            f"the frame moves forward at none of the {int(one.sum())} voltages with one blow in a "
            "period; take a drive that pulls the block to the right"
        )
    seen = f", but {blows.min():g} to {blows.max():g}" if blows.notna().any() else ""
    return (
        f"no voltage in the table makes one blow in a period{seen}; add voltages at which the "
        "device walks (see period_one_window), or a longer transient"
    )


@dataclass(frozen=True, kw_only=True)
class Window(Summarized):
    """The voltages between which an orbit lasts.

    Attributes
    ----------
    low, high : float
        Amplitudes [V] at the ends.
    low_kind, high_kind : str
        What happens there: "grazing", "fold", "period-doubling", …, or "bound" where the search
        ended.
    margin : float
        Half the width over the middle: how far off, relatively, a voltage in the middle may be.

    See Also
    --------
    period_one_window

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> window = mi.period_one_window(actuator, drive, low=0.17, high=0.26)
    >>> window.low < drive.amplitude < window.high
    True
    """

    low: float
    high: float
    low_kind: str
    high_kind: str

    @property
    def margin(self) -> float:  # noqa: D102 - above
        return (self.high - self.low) / (self.high + self.low)


def period_one_window(
    actuator: Actuator,
    drive: Drive,
    *,
    low: float,
    high: float,
    guess: State | None = None,
    transient: int = 300,
) -> Window:
    """Return between which amplitudes the stable orbit of one forcing period at `drive` lasts.

    The orbit is continued both ways until it grazes, folds or loses its stability.

    Parameters
    ----------
    actuator : Actuator
    drive : Drive
        With an ``amplitude`` at which the orbit is stable.
    low, high : float
        Where the search ends.
    guess : State, optional
        A state that leads to the orbit; a kick by default.
    transient : int, optional
        Forcing periods to run before the orbit is read.

    Returns
    -------
    Window

    Raises
    ------
    OrbitError
        If the run from the guess does not lead to a stable orbit with impacts.

    See Also
    --------
    Window, continue_orbit, operating_chart

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> window = mi.period_one_window(actuator, drive, low=0.17, high=0.26)
    >>> window.low_kind, f"{window.low:.6f}"
    ('fold', '0.176515')
    """
    from mems_impact.actuator.system import kicked
    from mems_impact.analysis.branch import continue_orbit
    from mems_impact.analysis.finding import find_orbit

    amplitude = float(drive.amplitude)  # type: ignore[attr-defined]
    if not low < amplitude < high:
        raise InvalidParameter("amplitude", amplitude, f"between low = {low:g} and high = {high:g}")
    start = kicked(actuator) if guess is None else guess
    orbit = find_orbit(actuator, drive, guess=start, periods=1, transient=transient)
    if not (orbit.stable and orbit.admissible and len(orbit.impacts)):
        reason = f"at amplitude = {amplitude:g} there is no stable orbit with impacts of one period"
        raise OrbitError(reason, "take an amplitude inside the window", orbit)
    ends = []
    for stop in (low, high):
        branch = continue_orbit(orbit, "amplitude", stop=stop)
        first = branch.special_points[0] if branch.special_points else None
        ends.append((first.value, first.kind) if first is not None else (stop, "bound"))
    return Window(low=ends[0][0], low_kind=ends[0][1], high=ends[1][0], high_kind=ends[1][1])
