"""Speed over the voltage, and the smallest step."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mems_impact.actuator import tables
from mems_impact.actuator.drives import Drive
from mems_impact.actuator.parameters import Actuator
from mems_impact.analysis.state import State
from mems_impact.engines.options import Options
from mems_impact.errors import InvalidParameter
from mems_impact.tables.common import bare

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import ArrayLike


__all__ = ["resolution", "speed_over_voltage"]


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
