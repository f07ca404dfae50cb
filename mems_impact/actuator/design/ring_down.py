"""How the swing of the block dies out once the voltage is gone."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from mems_impact.actuator import tables
from mems_impact.actuator.design.impacts import is_impact, is_release, yields
from mems_impact.actuator.drives.sine import Sine
from mems_impact.actuator.modes import X2
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.analysis.simulate import simulate
from mems_impact.analysis.state import State, is_number, state_from
from mems_impact.analysis.system import System
from mems_impact.analysis.values import Value
from mems_impact.analysis.verbs import takes_system
from mems_impact.engines.options import Options
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid import loop
from mems_impact.hybrid.trajectory import Floats, Instant, Trajectory

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["RingDown", "ring_down"]

PERIODS, MOST = 64, 8192  # half natural periods of the first run, and of the last


@dataclass(frozen=True, kw_only=True, eq=False)
class RingDown(Value):
    """The free swing of the block, in the units of the device.

    Attributes
    ----------
    frequency : float
        Swings in a unit of time [Hz], on average.
    decrement : float
        Natural logarithm of the ratio of two amplitudes in succession, on average.
    damping_ratio, quality : float
        Of the linear oscillator with that decrement.
    time_constant : float
        In which the amplitude falls to 1/e [s], on average.
    time : float
        From switching off until the amplitude is down to the share that was asked for, of that of
        the first swing that strikes nothing [s].
    table : DataFrame
        One row a swing after the last impact: t (since switching off) and amplitude.

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

    frequency: float
    decrement: float
    damping_ratio: float
    quality: float
    time_constant: float
    time: float
    table: pd.DataFrame = field(repr=False)


@takes_system(start="initial")
def ring_down(
    system: System,
    *,
    initial: State | Mapping[str, float] | None = None,
    share: float = 0.01,
    options: Options = Options(),  # noqa: B008 - immutable
) -> RingDown:
    """Switch the voltage off, and return how the swing of the block dies out.

    Parameters
    ----------
    system : Actuator and Drive, or Run or Orbit
        A run or an orbit stands for its device, and for the state in which it is switched off.
    initial : State or mapping of str to float, optional
        The state at that time; with a kick by default (see `kicked`).
    share : float, optional
        Of the first amplitude, down to which it shall be followed; between 0 and 1.
    options : Options, optional

    Returns
    -------
    RingDown

    Raises
    ------
    InvalidParameter
        If the system is no actuator, `share` is out of range, or the block does not swing, or does
        not stop to.

    See Also
    --------
    RingDown, frequency_response

    Notes
    -----
    With the damper of the paper alone, and the frame at rest, the decrement is 2 pi zeta/sqrt(1 -
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
    off = ActuatorSystem(actuator, quiet)
    start: Any = system.start_of("down") if initial is None else initial
    if isinstance(start, State):
        start = start.replace(time=0.0)
    begin = 0.0
    if yields(actuator):
        off, start, begin = after_contacts(off, start, options)
    periods = PERIODS
    while True:
        run = simulate(off, periods, initial=start, options=options)
        t, amplitude = swings(run.trajectory)
        t = begin + t
        low = np.flatnonzero(amplitude <= share * amplitude[:1].max(initial=0.0))
        fallen = math.log(amplitude[0] / amplitude[-1]) if amplitude.size > 1 else 0.0
        if low.size or fallen * MOST < periods * math.log(1.0 / share):
            break
        periods *= 4
    if not low.size:
        problem = "the block does not swing, or its swing does not die out"
        raise InvalidParameter("initial", start, "", problem=problem)
    last = int(low[0])
    decrement = math.log(amplitude[0] / amplitude[last]) / last
    swing = (t[last] - t[0]) / last
    # Within the last swing the amplitude falls exponentially.
    over = math.log(share * amplitude[0] / amplitude[last])
    fall = math.log(amplitude[last - 1] / amplitude[last])
    reached = t[last] - over / fall * (t[last] - t[last - 1])
    ratio = decrement / math.hypot(2.0 * math.pi, decrement)
    return RingDown(
        frequency=1.0 / float(off.scales.out(swing, "s")),
        decrement=decrement,
        damping_ratio=ratio,
        quality=0.5 / ratio,
        time_constant=float(off.scales.out(swing / decrement, "s")),
        time=float(off.scales.out(reached, "s")),
        table=tables.swings(t[: last + 1], amplitude[: last + 1], off),
    )


def after_contacts(
    off: ActuatorSystem, start: Any, options: Options
) -> tuple[ActuatorSystem, State, float]:
    """Return a device with rigid stoppers, its state after the last contact, and the time of that.

    The turning points of a swing are those before a stopper that does not yield; the swing that
    follows reaches neither.
    """
    run = simulate(off, PERIODS, initial=start, options=options)
    log = run.trajectory.events
    log = log[is_release(log)]
    rigid = ActuatorSystem(
        off.actuator.without(*(t.name() for t in off.actuator.terms if t.instead == "stopper")),
        off.drive,
        off.scales,
    )
    begin, state = 0.0, off.state_of(off.instant(start, off.problem(options)))
    if len(log):
        begin = float(log.cycle[-1] * run.trajectory.period + log.time[-1])
        state = off.state_of(Instant(0, 0.0, int(log.mode_after[-1]), log.after[-1]))
    values = {name: state[name] for name in rigid.states}
    delta = off.actuator.delta
    values["x2"] = min(max(values["x2"], -delta), delta)
    return rigid, state_from(values), begin


def swings(trajectory: Trajectory) -> tuple[Floats, Floats]:
    """Return when the block turns back on the right, and half its way to where it does next.

    From the last impact on; in the units of the numerics.
    """
    log, period = trajectory.events, trajectory.period
    struck = np.flatnonzero(is_impact(log) | (log.kind == loop.ACCUMULATION))
    log = log[struck[-1] + 1 :] if struck.size else log
    turned = log[log.kind == loop.APPROACH]
    right = np.flatnonzero((turned.guard[:-1] == 0) & (turned.guard[1:] == 1))
    x2 = turned.before[:, X2]
    return (turned.cycle * period + turned.time)[right], 0.5 * (x2[right] - x2[right + 1])
