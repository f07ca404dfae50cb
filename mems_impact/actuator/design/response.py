"""What the block does over the frequency: its amplitude, where it strikes, what that moves."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from mems_impact.actuator.drives import Drive
from mems_impact.actuator.parameters import Actuator
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.engines.options import Options
from mems_impact.errors import InvalidParameter
from mems_impact.studies.sweep import sweep
from mems_impact.tables.sweep import sweep_summary

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import ArrayLike

__all__ = ["frequency_response", "impact_onset"]


def frequency_response(
    actuator: Actuator,
    drive: Drive,
    omegas: ArrayLike,
    amplitudes: ArrayLike | None = None,
    *,
    direction: Literal["up", "down", "both"] = "both",
    transient: int = 100,
    periods: int = 20,
    options: Options = Options(),  # noqa: B008 - immutable
    workers: int | None = None,
) -> pd.DataFrame:
    """Return what the device does over the frequency, up and down, at one voltage or several.

    Parameters
    ----------
    actuator : Actuator
    drive : Drive
        With an ``omega`` and an ``amplitude``.
    omegas : array_like of float
        Angular frequencies [rad/s].
    amplitudes : array_like of float, optional
        Voltages [V]; that of the drive by default.
    direction, transient, periods, options, workers
        As for `mems_impact.sweep`.

    Returns
    -------
    DataFrame
        One row an amplitude, direction and omega, in the order in which they were computed: these,
        the largest deflection of the block (delta where it strikes; NaN where it does not turn
        back), impacting, impacts and blows per period, displacement per period and mean speed, and
        the status.

    Raises
    ------
    InvalidParameter
        If an argument is out of range, or the drive has no such parameter.

    See Also
    --------
    impact_onset, plot_response, ring_down

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> table = mi.frequency_response(actuator, drive, [0.46, 0.48, 0.5], [0.1, 0.24], transient=50)
    >>> table["amplitude"].unique().tolist()
    [0.1, 0.24]
    """
    import pandas as pd

    system = ActuatorSystem(actuator, drive)
    for name in ("omega", "amplitude"):
        system.check_parameter(name)
    given = system.value("amplitude") if amplitudes is None else amplitudes
    values = np.atleast_1d(np.asarray(given, dtype=float))
    parts = []
    for amplitude in values.tolist():
        table = sweep(
            system.changed(amplitude=amplitude), "omega", omegas, direction=direction,
            transient=transient, periods=periods, options=options, workers=workers,
        )  # fmt: skip
        summary = sweep_summary(table)
        summary.insert(0, "amplitude", amplitude)
        parts.append(summary)
    found = pd.concat(parts, ignore_index=True)
    gap = found["closest approach"].to_numpy()
    deflection = np.where(found["impacting"], actuator.delta, actuator.delta - gap)
    columns = ["impacting", "impacts per period", "blows per period", "displacement per period",
               "mean speed", "status"]  # fmt: skip
    first = found[["amplitude", "direction", "omega"]].assign(deflection=deflection)
    result = pd.concat([first, found[columns]], axis=1)
    units = {**table.attrs["units"]}
    if system.units:
        units |= {"deflection": "m", "amplitude": "V"}
    shown = {name: unit for name, unit in units.items() if name in result}
    result.attrs = {"units": shown, "system": repr(system)}
    return result


def impact_onset(table: pd.DataFrame) -> pd.DataFrame:
    """Return between which frequencies the block strikes, by amplitude and direction.

    Parameters
    ----------
    table : DataFrame
        From `frequency_response`.

    Returns
    -------
    DataFrame
        One row an amplitude and direction: the lowest and the highest omega of the table at which
        there are impacts (NaN without), and the smallest and largest mean speed among them.

    Raises
    ------
    InvalidParameter
        If the table is another one.

    See Also
    --------
    frequency_response, plot_response

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> table = mi.frequency_response(actuator, drive, [0.46, 0.48, 0.5], [0.1, 0.24], transient=50)
    >>> mi.impact_onset(table).columns.tolist()
    ['amplitude', 'direction', 'omega from', 'omega to', 'mean speed min', 'mean speed max']
    """
    import pandas as pd

    if not {"omega", "direction", "deflection", "impacting"} <= set(table.columns):
        raise InvalidParameter("table", None, "", problem="not a table of frequency_response")
    rows = []
    for (amplitude, direction), group in table.groupby(["amplitude", "direction"], sort=False):
        on = group[group["impacting"]]
        omega, speed = on["omega"], on["mean speed"]
        rows.append(
            {
                "amplitude": amplitude,
                "direction": direction,
                "omega from": omega.min(),
                "omega to": omega.max(),
                "mean speed min": speed.min(),
                "mean speed max": speed.max(),
            }
        )
    result = pd.DataFrame(rows)
    units = table.attrs.get("units", {})
    names = {"omega from": "omega", "omega to": "omega", "amplitude": "amplitude",
             "mean speed min": "mean speed", "mean speed max": "mean speed"}  # fmt: skip
    result.attrs = {"units": {name: units[of] for name, of in names.items() if of in units}}
    return result
