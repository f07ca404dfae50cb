"""Which share of the time the block flies, and the frame slips."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from mems_impact.actuator import tables
from mems_impact.actuator.design.arcs import arcs_of_orbit, arcs_of_run
from mems_impact.actuator.modes import MODES, direction_of, side_of
from mems_impact.actuator.results import ActuatorOrbit, ActuatorRun
from mems_impact.analysis.values import Value
from mems_impact.errors import InvalidParameter

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Duty", "duty_cycle"]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Duty(Value):
    """Shares of the time, between 0 and 1.

    Attributes
    ----------
    flying, in_contact : float
        In which the block is free, and in which it is on a stopper.
    stuck, forward, backward : float
        In which the frame rests on the ground, and in which it slips.
    table : DataFrame
        One row a mode that occurs: mode, share, time per period.

    See Also
    --------
    duty_cycle

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> run = mi.simulate(actuator, drive, periods=60)
    >>> duty = mi.duty_cycle(run)
    >>> abs(duty.flying + duty.in_contact - 1.0) < 1e-9
    True
    """

    flying: float
    in_contact: float
    stuck: float
    forward: float
    backward: float
    table: pd.DataFrame = field(repr=False)


def duty_cycle(motion: ActuatorRun | ActuatorOrbit) -> Duty:
    """Return which share of the time block and frame spend in which mode.

    Parameters
    ----------
    motion : ActuatorRun or ActuatorOrbit
        A run with its events kept: over its window. Of an orbit, once round.

    Returns
    -------
    Duty

    Raises
    ------
    InvalidParameter
        If `motion` is neither, or the run kept no events.

    See Also
    --------
    Duty, energy, life

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> run = mi.simulate(actuator, drive, periods=60)
    >>> f"{mi.duty_cycle(run).stuck:.3f}"
    '0.998'
    """
    if isinstance(motion, ActuatorOrbit):
        arcs, window = arcs_of_orbit(motion), (0.0, float(motion.periods))
        period = motion.found.point.period
    elif isinstance(motion, ActuatorRun):
        if motion.keep != "events":
            allowed = "'events' for its duty cycle; simulate again with keep='events'"
            raise InvalidParameter("keep", motion.keep, allowed)
        first, last = (min(border, motion.extent[1]) for border in motion.window)
        arcs, window = arcs_of_run(motion, motion.trajectory.events, first), (first, last)
        period = motion.trajectory.period
    else:
        raise InvalidParameter("motion", motion, "a run or an orbit of an actuator")
    first, last = window
    lasted = np.zeros(len(MODES))
    for arc in arcs:
        begin = arc.begin.cycle + arc.begin.time / period
        end = begin + arc.length / period
        lasted[arc.begin.mode] += max(0.0, min(end, last) - max(begin, first))
    shares = lasted / (last - first)
    slips, sides = np.array([[direction_of(mode), side_of(mode)] for mode in range(len(MODES))]).T
    there = np.flatnonzero(shares)
    table = tables.duty([MODES[mode] for mode in there], shares[there], period, motion.system)
    return Duty(
        flying=float(shares[sides == 0].sum()),
        in_contact=float(shares[sides != 0].sum()),
        stuck=float(shares[slips == 0].sum()),
        forward=float(shares[slips > 0].sum()),
        backward=float(shares[slips < 0].sum()),
        table=table,
    )
