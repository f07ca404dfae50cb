"""Fractions of time in each mode."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from mems_impact.actuator.automaton import direction_of, side_of
from mems_impact.actuator.design.energy import arcs_of_orbit, arcs_of_run
from mems_impact.actuator.results import ActuatorOrbit, ActuatorRun
from mems_impact.errors import InvalidParameter
from mems_impact.systems.result import Result
from mems_impact.tables import row_table

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class DutyCycle(Result):
    """Fractions of time in each state of block and frame, between 0 and 1.

    Attributes
    ----------
    flying, in_contact : float
        Fractions of time in which the block is free, and on a stopper.
    stuck, forward, backward : float
        Fractions of time in which the frame sticks, slips forward, and slips backward.
    table : DataFrame
        One row per mode that occurs: mode, share, time per period.

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


def duty_cycle(motion: ActuatorRun | ActuatorOrbit) -> DutyCycle:
    """Compute the fractions of time that block and frame spend in each mode.

    Parameters
    ----------
    motion : ActuatorRun or ActuatorOrbit
        A run with events, evaluated over its window, or an orbit.

    Returns
    -------
    DutyCycle

    Raises
    ------
    InvalidParameter
        If `motion` is neither a run nor an orbit, or the run has no events.

    Warns
    -----
    TransientWarning
        If the statistics of the run still change.

    See Also
    --------
    DutyCycle, energy, life

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
        period = motion.numeric.point.period
    elif isinstance(motion, ActuatorRun):
        if motion.keep != "events":
            allowed = "'events' for its duty cycle; simulate again with keep='events'"
            raise InvalidParameter("keep", motion.keep, allowed)
        motion.warn_of_transient()
        first, last = (min(border, motion.extent[1]) for border in motion.window)
        arcs, window = arcs_of_run(motion, motion.trajectory.events, first), (first, last)
        period = motion.trajectory.period
    else:
        raise InvalidParameter("motion", motion, "a run or an orbit of an actuator")
    first, last = window
    modes = motion.system.modes
    lasted = np.zeros(len(modes))
    for arc in arcs:
        begin = arc.begin.cycle + arc.begin.time / period
        end = begin + arc.length / period
        lasted[arc.begin.mode] += max(0.0, min(end, last) - max(begin, first))
    shares = lasted / (last - first)
    slips, sides = np.array([[direction_of(mode), side_of(mode)] for mode in range(len(modes))]).T
    indices = np.flatnonzero(shares)
    duration = float(motion.system.forcing_period)
    rows = [(modes[mode], shares[mode], shares[mode] * duration) for mode in indices]
    table = row_table({"mode": str, "share": float, "time": float}, rows, motion.system)
    return DutyCycle(
        flying=float(shares[sides == 0].sum()),
        in_contact=float(shares[sides != 0].sum()),
        stuck=float(shares[slips == 0].sum()),
        forward=float(shares[slips > 0].sum()),
        backward=float(shares[slips < 0].sum()),
        table=table,
    )
