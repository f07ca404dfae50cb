"""Working points of a device over a parameter: step, speed, energy, wear and stall force."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.design.force_curve import stall_force
from mems_impact.actuator.design.wear import WearRate, mean_normal_force
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.errors import Interrupted, InvalidParameter, RunError
from mems_impact.integrators.options import Options
from mems_impact.studies.sampling import axis
from mems_impact.studies.sweep import sweep
from mems_impact.systems.parameter_result import ParameterResult
from mems_impact.systems.state import State
from mems_impact.tables import error_column, sweep_summary, table, unit_of

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import ArrayLike

DIRECTION, STATUS = "direction", "status"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Characteristic(ParameterResult):
    """Working points of a device over a parameter, one or more curves.

    Attributes
    ----------
    system : ActuatorSystem
        At its own values of the parameters.
    parameter : str
    table : DataFrame
        One row per working point, in the order of computation: the parameter that distinguishes
        curves, if there is one, the parameter, direction, status, impacting, the largest deflection
        of the block (delta with impacts; NaN without a turning point), impacts and blows per period
        (see `mems_impact.BlowStatistics`), displacement per period and per blow, mean speed and its
        error (see `Settling`), energy input per period and per blow, mean power, and slip path of
        the frame per period. With a wear rate, the life and the distance until the allowed depth
        is worn; with `stall`, the stall force (see `ForceCurve`).
    curves : str
        The parameter that distinguishes curves; empty for a single curve.

    See Also
    --------
    characteristic, plot_characteristic

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> curve = mi.characteristic(
    ...     actuator, drive, "omega", [0.46, 0.48, 0.5], curves=("amplitude", [0.1, 0.24])
    ... )
    >>> curve.impact_onset[["amplitude", "omega from", "omega to"]].iloc[-1].tolist()
    [0.24, 0.46, 0.5]
    """

    curves: str = ""

    @property
    def impact_onset(self) -> pd.DataFrame:
        """The values with impacts, one row per curve and direction.

        The lowest and the highest value with impacts (NaN if there are none), between which there
        may be values without impacts, and the smallest and largest mean speed among them.
        """
        import pandas as pd

        rows, name = [], self.parameter
        keys = [*([self.curves] if self.curves else []), DIRECTION]
        for key, group in self.table.groupby(keys, sort=False):
            on = group[group["impacting"]]
            value, speed = on[name], on["mean speed"]
            ends = {f"{name} from": value.min(), f"{name} to": value.max()}
            speeds = {"mean speed min": speed.min(), "mean speed max": speed.max()}
            rows.append({**dict(zip(keys, key, strict=True)), **ends, **speeds})
        result = pd.DataFrame(rows)
        units = {heading: unit_of(heading, self.table.attrs.get("units", {})) for heading in result}
        result.attrs = {"units": {heading: unit for heading, unit in units.items() if unit}}
        return result

    def resolution(self) -> float:
        """Return the smallest forward step, a mean over the periods of a motion.

        Only working points with one blow per forcing period count. The steps of a motion of period
        1 are equal; those of a motion of a longer period differ from their mean.

        Returns
        -------
        float
            Displacement per blow [m].

        Raises
        ------
        InvalidParameter
            If there is no working point with one blow per period that moves the frame forward.
        """
        blows, moved = self.table["blows per period"], self.table["displacement per blow"]
        one = np.isclose(blows, 1.0)
        forward = moved[one & (moved > 0.0)]
        if forward.empty:
            raise InvalidParameter("values", None, "", problem=_no_step(blows, one))
        return float(forward.min())


def _no_step(blows: pd.Series, one: Any) -> str:
    """Return why a table does not determine the resolution."""
    if one.any():
        return (
            f"the frame moves forward at none of the {int(one.sum())} values with one blow in a "
            "period; take a drive that pulls the block to the right"
        )
    suffix = f", but {blows.min():g} to {blows.max():g}" if blows.notna().any() else ""
    return (
        f"no value in the table makes one blow in a period{suffix}; add values at which the device "
        "walks (see period_one_window and walking_drive)"
    )


def characteristic(
    actuator: Actuator,
    drive: Drive,
    parameter: str,
    values: ArrayLike,
    *,
    curves: tuple[str, ArrayLike] | None = None,
    direction: Literal["up", "down", "both"] = "both",
    stall: bool = False,
    wear: float | str | None = None,
    area: float | str | None = None,
    depth: float | str | None = None,
    transient: int = 100,
    periods: int = 20,
    initial: State | None = None,
    options: Options = Options(),  # noqa: B008 - immutable
    workers: int | None = None,
    progress: bool | Callable[[float], None] = False,
) -> Characteristic:
    """Compute step, speed, energy and wear over a voltage, a frequency or another parameter.

    Every working point is in the steady state (see `steady_state`), and starts from the motion at
    the previous value, as in `sweep`.

    Parameters
    ----------
    actuator : Actuator
    drive : Drive
    parameter : str
        A number of the drive, such as ``"amplitude"`` or ``"frequency"``, or of the device.
    values : array_like of float or str
        Values of the parameter; texts may have units (``"70 V"``).
    curves : tuple of str and array_like, optional
        A second parameter, with one curve for each of its values: ``("amplitude", [20, 30])``.
    direction : {"up", "down", "both"}, optional
        Ascending values from rest, descending values from a kick, or both.
    stall : bool, optional
        Whether to find the stall force of each working point.
    wear : float or str, optional
        Specific wear rate [m^3/(N m)], as for `life`, together with `area` and `depth`.
    area : float or str, optional
        Contact area of the frame [m^2].
    depth : float or str, optional
        Allowed wear depth [m].
    transient : int, optional
        Forcing periods discarded at each value, before the steady state is sought.
    periods : int, optional
        Forcing periods then measured at each value.
    initial : State, optional
        Initial state of both directions; by default at rest upwards, and with a kick downwards.
    options : Options, optional
        Options of the integration; method "adams" by default, and "auto" with a stiff term.
    workers : int, optional
        Number of threads, at most one for each direction. Results do not depend on it.
    progress : bool or callable, optional
        Show progress; a function is called with the number of finished working points.

    Returns
    -------
    Characteristic

    Raises
    ------
    InvalidParameter
        If an argument is out of range, or there is no such parameter.
    Interrupted
        On Ctrl-C; ``partial`` is the table of the finished working points.

    Warns
    -----
    TransientWarning
        If statistics of a working point still change.

    See Also
    --------
    Characteristic, plot_characteristic, force_curve, sweep, operating_chart

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> curve = mi.characteristic(actuator, drive, "amplitude", [0.2, 0.24], direction="down")
    >>> f"{curve.resolution():.2e}"
    '1.45e-04'
    """
    system = ActuatorSystem(actuator, drive).with_energy()
    rate = None
    if not (wear is None and area is None and depth is None):
        for name, value in (("wear", wear), ("area", area), ("depth", depth)):
            if value is None:
                problem = "a life needs wear, area and depth"
                raise InvalidParameter(name, None, "", problem=problem)
        rate = WearRate.of(system.units.scales.named, wear=wear, area=area, depth=depth)
        mean_normal_force(system, 0.0, 0.0)  # now, not after the computation
    first, families = "", [(system, dict[str, float]())]
    if curves is not None:
        first, numbers = axis("curves", curves, tuple(system.parameters), system)
        families = [(system.changed(**{first: each}), {first: each}) for each in numbers]
    tables: list[pd.DataFrame] = []
    try:
        for case, key in families:
            before = sum(map(len, tables))
            show = progress if isinstance(progress, bool) else partial(_counting, progress, before)
            swept = sweep(
                case, parameter, values, direction=direction, steady=True, transient=transient,
                periods=periods, initial=initial, options=options, workers=workers, progress=show,
            )  # fmt: skip
            tables.append(_working_points(case, parameter, key, swept.table, rate))
            if stall:
                forces = _stall_forces(case, parameter, tables[-1], initial, transient, periods,
                                       options)  # fmt: skip
                tables[-1]["stall force"] = forces
    except KeyboardInterrupt as error:
        if isinstance(error, Interrupted):
            tables.append(_working_points(case, parameter, key, error.partial, rate))
        if not sum(map(len, tables)):
            raise
        after = f"{sum(map(len, tables))} working points"
        raise Interrupted("characteristic", after, _joined(tables, system)) from None
    joined = _joined(tables, system)
    return Characteristic(system=system, parameter=parameter, table=joined, curves=first)


def _counting(progress: Callable[[float], None], before: int, number: float) -> None:
    progress(before + number)


def _working_points(
    system: ActuatorSystem,
    parameter: str,
    key: dict[str, float],
    swept: pd.DataFrame,
    rate: WearRate | None,
) -> pd.DataFrame:
    """Return the rows of one curve."""
    found = sweep_summary(swept)
    cases = [system.changed(**{parameter: value}) for value in found[parameter].tolist()]
    delta = np.array([case.actuator.delta for case in cases])
    period = np.array([float(case.forcing_period) for case in cases])
    blows, moved, given, slip = (
        found[name].to_numpy() for name in ("blows per period", "displacement per period",
                                            "energy in per period", "slip per period")
    )  # fmt: skip
    each = np.where(blows > 0.0, blows, math.nan)
    copied = ("impacts per period", "blows per period", "displacement per period")
    columns = {
        **{name: np.full(len(found), value) for name, value in key.items()},
        **{name: found[name] for name in (parameter, DIRECTION, STATUS, "impacting")},
        "deflection": np.where(found["impacting"], delta, delta - found["closest approach"]),
        **{name: found[name] for name in copied},
        "displacement per blow": moved / each,
        "mean speed": found["mean speed"],
        "mean speed error": found[error_column("mean speed")],
        "energy in per period": given,
        "energy in per blow": given / each,
        "power in": given / period,
        "slip per period": slip,
    }
    if rate is not None:
        losses = found["friction loss per period"].tolist()
        worn = np.array([
            rate.periods(mean_normal_force(case, loss, path), path)
            for case, loss, path in zip(cases, losses, slip.tolist(), strict=True)
        ])  # fmt: skip
        still = moved == 0.0
        columns["life"] = worn * period
        columns["distance"] = np.where(still, 0.0, np.where(still, 0.0, worn) * moved)
    return table({}, system, user_columns=columns, symbols=dict(system.units.symbols))


def _stall_forces(
    system: ActuatorSystem, parameter: str, points: pd.DataFrame, initial: State | None,
    transient: int, periods: int, options: Options,
) -> list[float]:  # fmt: skip
    """Return the stall forces of working points; NaN if one does not walk, or a run fails."""
    forces, before, state = [], "", initial
    for row in points[[parameter, DIRECTION, "mean speed"]].to_dict("records"):
        if row[DIRECTION] != before:
            before = row[DIRECTION]
            state = initial or system.state_space.initial(before)
        force = math.nan
        if abs(row["mean speed"]) > 0.0:
            with contextlib.suppress(RunError):
                case = system.changed(**{parameter: row[parameter]})
                force, state = stall_force(case, state, transient, periods, options)
        forces.append(force)
    return forces


def _joined(tables: list[pd.DataFrame], system: ActuatorSystem) -> pd.DataFrame:
    import pandas as pd

    result = pd.concat(tables, ignore_index=True)
    units = {name: unit_of(str(name), system.units) for name in result}
    result.attrs = {
        **tables[0].attrs,
        "units": {name: unit for name, unit in units.items() if unit},
        "system": repr(system),
    }
    return result
