"""Ring-down and quality factor."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import Chebyshev

from mems_impact._util.arrays import Floats
from mems_impact.actuator.drives.sine import Sine
from mems_impact.actuator.equations import V1, V2, X2
from mems_impact.actuator.impact_statistics import is_impact, is_release, is_slipping
from mems_impact.actuator.model import compose
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.actuator.terms.base import is_compliant
from mems_impact.analysis.orbit import ORBIT_OPTIONS
from mems_impact.analysis.run import Run
from mems_impact.analysis.simulate import simulate
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.simulation import Trajectory
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.options import Options
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.dispatch import takes_system
from mems_impact.systems.result import Result
from mems_impact.systems.state import State, is_number, state_from
from mems_impact.tables import table

if TYPE_CHECKING:
    import pandas as pd

PERIODS, MOST = 64, 131072  # half natural periods of the first run, and of the last
DIRECT_HALF_PERIODS = (
    1024  # half natural periods for which a slowly decaying oscillation is simulated
)
SWING_BISECTIONS = 40
LEVELS, SKIPPED = 9, 4  # amplitudes of a slow decay; cycles until it is regular
ERROR = 1e-9  # relative error of a decrement in a slow decay
MIN_DECREMENT = 1e-8  # smallest decrement above rounding


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class RingDown(Result):
    """Free decay of the block's oscillation, in the units of the device.

    The measurement starts with the first cycle without impacts and with the frame at rest, since a
    slipping frame dissipates energy.

    Attributes
    ----------
    frequency : float
        Mean frequency [Hz].
    decrement : float
        Logarithmic decrement: mean logarithm of the ratio of two successive amplitudes.
    damping_ratio, quality : float
        Damping ratio and quality factor of the linear oscillator with this decrement.
    time_constant : float
        Mean time in which the amplitude falls to 1/e [s].
    time : float
        Time from switching off until the amplitude has fallen to `share` of the first measured
        amplitude [s].
    table : DataFrame
        One row per measured cycle: t (since switching off) and amplitude; nine rows for a decay
        over hundreds of cycles.
    si : bool
        Whether the quantities are in SI, as of a device in SI.

    See Also
    --------
    ring_down

    Examples
    --------
    >>> import mems_impact as mi
    >>> mita = mi.load_actuator("mita2003")
    >>> found = mi.ring_down(mita, mi.Sine(amplitude=100, omega=6.283))
    >>> f"{found.damping_ratio:.4f}", f"{found.quality:.2f}"
    ('0.1000', '5.00')
    """

    _si_units = {"frequency": "Hz", "time_constant": "s", "time": "s"}  # noqa: RUF012 - ClassVar in Summarized

    frequency: float
    decrement: float
    damping_ratio: float
    quality: float
    time_constant: float
    time: float
    table: pd.DataFrame = field(repr=False)
    si: bool = False


@takes_system(start="initial", recurrent=False)
def ring_down(
    system: HybridSystem,
    *,
    initial: State | Mapping[str, float] | None = None,
    share: float = 0.01,
    options: Options = ORBIT_OPTIONS,
) -> RingDown:
    """Switch the voltage off and measure the free decay of the block.

    Parameters
    ----------
    system : Actuator and Drive, or Run or Orbit
        A run or an orbit provides its device and, as `initial`, its last state.
    initial : State or mapping of str to float, optional
        The state at switching off; by default a kick (see `kicked_state`), or a weaker kick if
        impacts or slip of the frame last long.
    share : float, optional
        Fraction of the first measured amplitude at which the measurement ends; between 0 and 1.
    options : Options, optional
        By default the options of `find_orbit`: numerical damping counts as damping.

    Returns
    -------
    RingDown

    Raises
    ------
    InvalidParameter
        If the system is not an actuator, `share` is out of range, or the block does not oscillate,
        or the oscillation does not decay.

    See Also
    --------
    RingDown, characteristic

    Notes
    -----
    A decay over hundreds of cycles is not simulated to its end: its decrement is measured at nine
    amplitudes down to `share` of the first amplitude, with tolerances adapted to the size of the
    amplitude. The table then has a row for each of these.

    With only the damper of the paper, and the frame at rest, the decrement is 2 pi zeta/sqrt(1 -
    zeta^2) with zeta = c/(2 sqrt(k m2)).

    Examples
    --------
    >>> import mems_impact as mi
    >>> mita = mi.load_actuator("mita2003")
    >>> found = mi.ring_down(mita, mi.Sine(amplitude=100, omega=6.283))
    >>> f"{found.frequency:.1f} Hz", f"{found.time * 1e3:.1f} ms"
    ('238.7 Hz', '34.6 ms')
    """
    if not isinstance(system, ActuatorSystem):
        raise InvalidParameter("system", system, "an Actuator and a Drive, or a run or orbit of it")
    if not (is_number(share) and 0.0 < share < 1.0):
        raise InvalidParameter("share", share, "between 0 and 1 (exclusive)")
    actuator = system.actuator
    quiet = Sine(amplitude=0.0, omega=math.sqrt(actuator.k / actuator.m2))
    free_system = ActuatorSystem(actuator, quiet)
    sticks = comes_to_rest(free_system)
    start: Any = system.state_space.initial("down") if initial is None else initial
    if isinstance(start, State):
        start = start.replace(time=0.0)
    begin = 0.0
    if is_compliant(actuator):
        free_system, start, begin = after_contacts(free_system, start, options)
    if initial is None:
        start, options = gentle(free_system, start, sticks, options)
    periods = PERIODS
    while True:
        run = simulate(free_system, periods, initial=start, options=options)
        t, amplitude = swings(run.trajectory, sticks)
        low = np.flatnonzero(amplitude <= share * amplitude[:1].max(initial=0.0))
        free = not disturbed(run, sticks)
        if low.size or periods >= (DIRECT_HALF_PERIODS if free else MOST):
            break
        periods *= 4
    if low.size:
        last = int(low[0])
        t, amplitude, count = t[: last + 1], amplitude[: last + 1], float(last)
        # Within the last cycle the amplitude decays exponentially.
        fall = math.log(amplitude[-2] / amplitude[-1])
        over = math.log(share * amplitude[0] / amplitude[-1])
        reached = t[-1] - over / fall * (t[-1] - t[-2])
    elif free and amplitude.size > 1:
        t, amplitude, count = slow_decay(free_system, run, t[0], amplitude[0], share, options)
        reached = t[-1]
    else:
        problem = "the block does not oscillate"
        if not free:
            problem = (
                f"impacts, or slip of the frame, last over {periods // 2:.0f} free oscillations; "
                "start with less speed"
            )
        raise InvalidParameter("initial", start, "", problem=problem)
    decrement = math.log(amplitude[0] / amplitude[-1]) / count
    swing = (t[-1] - t[0]) / count
    ratio = decrement / math.hypot(2.0 * math.pi, decrement)
    return RingDown(
        frequency=1.0 / float(free_system.units.scales.out(swing, "s")),
        decrement=decrement,
        damping_ratio=ratio,
        quality=0.5 / ratio,
        time_constant=float(free_system.units.scales.out(swing / decrement, "s")),
        time=float(free_system.units.scales.out(begin + reached, "s")),
        table=swing_table(begin + t, amplitude, free_system),
        si=free_system.units.scales.named,
    )


def swing_table(t: Floats, amplitude: Floats, system: ActuatorSystem) -> pd.DataFrame:
    """Return one row per cycle: time, and amplitude, in the units of a deflection."""
    result = table({"t": t, "x2": amplitude}, system)
    result.attrs["units"] = {
        name.replace("x2", "amplitude"): unit for name, unit in result.attrs["units"].items()
    }
    return result.rename(columns={"x2": "amplitude"})


def slow_decay(
    system: ActuatorSystem, run: Run, first: float, amplitude: float, share: float, options: Options
) -> tuple[Floats, Floats, float]:
    """Return times and amplitudes of a decay over very many cycles, and the number of cycles.

    The block oscillates freely at the end of `run`; `first` and `amplitude` are time and amplitude
    of the first measured cycle, `share` is the last amplitude relative to the first. The decrement
    is a smooth function of the amplitude. It is measured in short runs at some amplitudes; number
    of cycles and time are integrals over the logarithm of the amplitude. Raises InvalidParameter if
    the oscillation does not decay.
    """
    log = run.trajectory.events
    extrema = np.flatnonzero((log.kind == workspace.APPROACH) & (log.guard == 0))
    mode, state = int(log.mode_after[extrema[-1]]), log.after[extrema[-1]]
    last = swings(run.trajectory, True)[1][-1]
    middle = state[X2] - last
    method = "dop853" if options.method == "dop853" else "auto"
    fine = replace(options, method=method)
    heights = math.log(amplitude) + math.log(share) * np.linspace(0.0, 1.0, LEVELS)
    rows = []
    for height in heights:
        part = math.exp(height) / last
        begin = state.copy()
        begin[X2] = middle + part * (state[X2] - middle)
        begin[V1], begin[V2] = part * state[V1], part * state[V2]
        initial = system.state_space.state(HybridState(0, 0.0, mode, begin))
        for _ in range(2):  # the first run determines the tolerances of the second
            decay = simulate(system, PERIODS, initial=initial, options=fine)
            t, high = (each[SKIPPED:] for each in swings(decay.trajectory, True))
            count = len(t) - 1
            decrement = math.log(high[0] / high[-1]) / count
            rtol = max(1e-14, ERROR * decrement)
            fine = replace(fine, rtol=rtol, atol=rtol * high[-1])
        if decrement < MIN_DECREMENT:
            problem = f"the oscillation decays by less than {MIN_DECREMENT:g} per cycle"
            raise InvalidParameter("initial", initial, "", problem=problem)
        rows.append((0.5 * math.log(high[0] * high[-1]), decrement, (t[-1] - t[0]) / count))
    amplitudes, decrements, times = np.array(rows).T
    span = [heights[-1], heights[0]]
    swung, passed = (
        Chebyshev.fit(amplitudes, values / decrements, LEVELS - 1, span).integ()
        for values in (np.ones(LEVELS), times)
    )
    return (
        first + passed(heights[0]) - passed(heights),
        np.exp(heights),
        float(swung(heights[0]) - swung(heights[-1])),
    )


def after_contacts(
    system: ActuatorSystem, start: Any, options: Options
) -> tuple[ActuatorSystem, State, float]:
    """Return a device with rigid stoppers, and its state and time after the last contact.

    Turning points then belong to free oscillation between rigid stoppers, which later cycles do
    not reach.
    """
    run = simulate(system, PERIODS, initial=start, options=options)
    log = run.trajectory.events
    log = log[is_release(log)]
    stoppers = [each.name() for each in system.actuator.terms if each.replaced_rule == "stopper"]
    rigid = ActuatorSystem(system.actuator.without(*stoppers), system.drive, system.units.scales)
    begin, state = (
        0.0,
        system.state_space.state(system.state_space.instant(start, system.problem(options))),
    )
    if len(log):
        begin = float(log.cycle[-1] * run.trajectory.period + log.time[-1])
        state = system.state_space.state(
            HybridState(0, 0.0, int(log.mode_after[-1]), log.after[-1])
        )
    values = {name: state[name] for name in rigid.states}
    delta = system.actuator.delta
    values["x2"] = min(max(values["x2"], -delta), delta)
    return rigid, state_from(values), begin


def comes_to_rest(system: ActuatorSystem) -> bool:
    """Return whether friction can hold the frame."""
    model = compose(tuple(term.kind for term in system.actuator.terms), 1)
    return model.sticks and bool(system.actuator.mu_s * system.normal_forces().max() > 0.0)


def gentle(
    system: ActuatorSystem, start: State, sticks: bool, options: Options
) -> tuple[State, Options]:
    """Return a kick after which the block soon oscillates freely, and options scaled to it."""
    for _ in range(SWING_BISECTIONS):
        if not disturbed(simulate(system, PERIODS, initial=start, options=options), sticks):
            break
        start = start.replace(v2=0.5 * start["v2"])
        options = replace(options, atol=0.5 * options.atol)
    return start, options


def disturbed(run: Run, sticks: bool) -> bool:
    """Return whether the block does not oscillate freely in the second half of a run."""
    return free_from(run.trajectory, sticks) > 0.5 * run.periods * run.trajectory.period


def free_from(trajectory: Trajectory, sticks: bool) -> float:
    """Return the time after which there are no impacts and a frame that `sticks` is at rest."""
    log, final = trajectory.events, trajectory.final
    disturbed = is_impact(log) | (log.kind == workspace.ACCUMULATION)
    if sticks:
        if is_slipping(final.mode):
            return final.cycle * trajectory.period + final.time
        disturbed |= is_slipping(log.mode_before)
    rows = np.flatnonzero(disturbed)
    return float(log.cycle[rows[-1]] * trajectory.period + log.time[rows[-1]]) if rows.size else 0.0


def swings(trajectory: Trajectory, sticks: bool) -> tuple[Floats, Floats]:
    """Return the times of the right turning points, and the amplitudes that follow them.

    During free oscillation (see `free_from`); in scaled units.
    """
    log, period = trajectory.events, trajectory.period
    time = log.cycle * period + log.time
    turning = (log.kind == workspace.APPROACH) & (time > free_from(trajectory, sticks))
    log, time = log[turning], time[turning]
    right = np.flatnonzero((log.guard[:-1] == 0) & (log.guard[1:] == 1))
    x2 = log.before[:, X2]
    return time[right], 0.5 * (x2[right] - x2[right + 1])
