"""Characteristics of a device: speed over voltage, response, duty cycle, period-one window."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mems_impact._util.formatting import stability_name
from mems_impact.actuator import results
from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.automaton import direction_of, side_of
from mems_impact.actuator.design.energy import arcs_of_orbit, arcs_of_run
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.parameters import numbers_for
from mems_impact.actuator.results import ActuatorOrbit, ActuatorRun
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.actuator.terms.base import drive_unit
from mems_impact.errors import InvalidParameter, OrbitError, RunError
from mems_impact.integrators.options import Options
from mems_impact.studies.sweep import sweep
from mems_impact.systems.result import ParameterResult, Result, SummaryRepr
from mems_impact.systems.state import State
from mems_impact.tables import unit_of

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import ArrayLike

    from mems_impact._util.progress import Watch
    from mems_impact.analysis.branch import Branch
    from mems_impact.analysis.orbit import Orbit
    from mems_impact.analysis.special_points import SpecialPoint

__all__ = [
    "DutyCycle",
    "FrequencyResponse",
    "PeriodOneWindow",
    "SpeedOverVoltage",
    "duty_cycle",
    "end_of",
    "frequency_response",
    "lasts_until",
    "period_one_window",
    "speed_over_voltage",
]

# --- Duty cycle


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
    table = results.duty([modes[mode] for mode in indices], shares[indices], period, motion.system)
    return DutyCycle(
        flying=float(shares[sides == 0].sum()),
        in_contact=float(shares[sides != 0].sum()),
        stuck=float(shares[slips == 0].sum()),
        forward=float(shares[slips > 0].sum()),
        backward=float(shares[slips < 0].sum()),
        table=table,
    )


# --- Frequency response

GROUPS = ["amplitude", "direction"]  # columns whose values each have one response


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class FrequencyResponse(ParameterResult):
    """Deflection and speed of a device over the frequency, at one or more voltages.

    Attributes
    ----------
    system : ActuatorSystem
        At its own frequency and voltage.
    parameter : str
        "omega", or "frequency" if the drive is given by its frequency.
    table : DataFrame
        One row per amplitude, direction and frequency, in the order of computation: these three,
        the largest deflection of the block (delta with impacts; NaN without a turning point),
        impacting, impacts and blows per period, displacement per period, mean speed, and status.

    See Also
    --------
    frequency_response, plot_response

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> response = mi.frequency_response(actuator, drive, [0.46, 0.48, 0.5], [0.1, 0.24])
    >>> response.impact_onset[["amplitude", "omega from", "omega to"]].iloc[-1].tolist()
    [0.24, 0.46, 0.5]
    """

    @property
    def impact_onset(self) -> pd.DataFrame:
        """The computed frequencies with impacts, one row per amplitude and direction.

        The lowest and the highest frequency with impacts (NaN if there are none), between which
        there may be frequencies without impacts, and the smallest and largest mean speed among
        them.
        """
        import pandas as pd

        rows, name = [], self.parameter
        for (amplitude, direction), group in self.table.groupby(GROUPS, sort=False):
            on = group[group["impacting"]]
            value, speed = on[name], on["mean speed"]
            rows.append(
                {
                    "amplitude": amplitude,
                    "direction": direction,
                    f"{name} from": value.min(),
                    f"{name} to": value.max(),
                    "mean speed min": speed.min(),
                    "mean speed max": speed.max(),
                }
            )
        result = pd.DataFrame(rows)
        units = {heading: unit_of(heading, self.table.attrs.get("units", {})) for heading in result}
        result.attrs = {"units": {heading: unit for heading, unit in units.items() if unit}}
        return result


def frequency_response(
    actuator: Actuator,
    drive: Drive,
    frequencies: ArrayLike,
    amplitudes: ArrayLike | None = None,
    *,
    direction: Literal["up", "down", "both"] = "both",
    transient: int = 100,
    periods: int = 20,
    options: Options = Options(),  # noqa: B008 - immutable
    workers: int | None = None,
) -> FrequencyResponse:
    """Compute the frequency response of a device, sweeping up and down, at one or more voltages.

    Each value is computed in the steady state (see `steady_state`).

    Parameters
    ----------
    actuator : Actuator
    drive : Drive
        A drive with an ``amplitude``, and an ``omega`` or a ``frequency``.
    frequencies : array_like of float
        Values of omega [rad/s], or of the frequency [Hz] if the drive is given by its frequency.
    amplitudes : array_like of float, optional
        Voltages [V]; by default the voltage of the drive.
    direction, transient, periods, options, workers
        As for `mems_impact.sweep`.

    Returns
    -------
    FrequencyResponse

    Raises
    ------
    InvalidParameter
        If an argument is out of range, or the drive has no such parameter.

    See Also
    --------
    FrequencyResponse, plot_response, ring_down

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> response = mi.frequency_response(actuator, drive, [0.46, 0.48, 0.5], [0.1, 0.24])
    >>> response.table["amplitude"].unique().tolist()
    [0.1, 0.24]
    """
    import pandas as pd

    system = ActuatorSystem(actuator, drive)
    parameter = system.frequency_parameter
    for name in (parameter, "amplitude"):
        system.check_parameter(name)
    amplitude_values = system.parameters["amplitude"] if amplitudes is None else amplitudes
    amplitude_values = system.units.parse("amplitude", amplitude_values, "amplitudes")
    values = np.atleast_1d(np.asarray(amplitude_values, dtype=float))
    tables = []
    for amplitude in values.tolist():
        summary = sweep(
            system.changed(amplitude=amplitude), parameter, frequencies, direction=direction,
            transient=transient, periods=periods, steady=True, options=options, workers=workers,
        ).statistics  # fmt: skip
        summary.insert(0, "amplitude", amplitude)
        tables.append(summary)
    joined = pd.concat(tables, ignore_index=True)
    gap = joined["closest approach"].to_numpy()
    deflection = np.where(joined["impacting"], actuator.delta, actuator.delta - gap)
    columns = ["impacting", "impacts per period", "blows per period", "displacement per period",
               "mean speed", "status"]  # fmt: skip
    first = joined[["amplitude", "direction", parameter]].assign(deflection=deflection)
    table = pd.concat([first, joined[columns]], axis=1)
    units = {**summary.attrs["units"]}
    if system.units:
        units |= {"deflection": "m", "amplitude": system.drive_unit}
    kept_units = {name: unit for name, unit in units.items() if name in table}
    table.attrs = {
        "units": kept_units,
        "system": repr(system),
        "symbols": dict(system.units.symbols),
    }
    return FrequencyResponse(system=system, parameter=parameter, table=table)


# --- Speed over voltage, and the smallest step


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SpeedOverVoltage(ParameterResult):
    """Steps and speed of a device over the voltage.

    Attributes
    ----------
    system : ActuatorSystem
        At its own voltage.
    parameter : str
        The voltage that varies, such as "amplitude".
    table : DataFrame
        One row per amplitude, ascending: impacts and blows (see `mems_impact.BlowStatistics`) per
        period, displacement per period, per impact and per blow, mean speed. The period is the
        period of v^2, even if a term depends on the sign of the voltage.

    See Also
    --------
    speed_over_voltage, period_one_window

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> speeds = mi.speed_over_voltage(actuator, drive, [0.2, 0.24])
    >>> f"{speeds.resolution():.2e}"
    '1.45e-04'
    """

    def resolution(self) -> float:
        """Return the smallest forward step, a mean over the periods of a motion.

        Only voltages with one blow per forcing period count. The steps of a motion of period 1 are
        equal; those of a motion of a longer period differ from their mean.

        Returns
        -------
        float
            Displacement per blow [m].

        Raises
        ------
        InvalidParameter
            If there is no voltage with one blow per period that moves the frame forward.
        """
        blows, moved = self.table["blows per period"], self.table["displacement per blow"]
        one = np.isclose(blows, 1.0)
        forward = moved[one & (moved > 0.0)]
        if forward.empty:
            raise InvalidParameter("amplitudes", None, "", problem=_no_step(blows, one))
        return float(forward.min())


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
) -> SpeedOverVoltage:
    """Compute steps and speed over the voltage, sweeping down to stay on the branch with impacts.

    Each value is computed in the steady state (see `steady_state`).

    Parameters
    ----------
    actuator : Actuator
    drive : Drive
    amplitudes : array_like
        Values of the voltage.
    parameter : str
        The voltage of the drive that varies, such as ``"right.amplitude"`` of a two-sided drive.
    transient, periods, initial, options, workers
        As for `mems_impact.sweep`.

    Returns
    -------
    SpeedOverVoltage

    See Also
    --------
    SpeedOverVoltage, force_curve, sweep

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> speeds = mi.speed_over_voltage(actuator, drive, [0.2, 0.24])
    >>> bool(speeds.table["mean speed"].is_monotonic_increasing)
    True
    """
    system = ActuatorSystem(actuator, drive)
    summary = sweep(
        system, parameter, amplitudes, direction="down", transient=transient, periods=periods,
        steady=True, initial=initial, options=options, workers=workers,
    ).statistics.iloc[::-1]  # fmt: skip
    share = drive.period / system.forcing_period  # below 1 if a term depends on the sign
    table = results.speed(
        parameter,
        summary[parameter].to_numpy(),
        share * summary["impacts per period"].to_numpy(),
        share * summary["blows per period"].to_numpy(),
        share * summary["displacement per period"].to_numpy(),
        drive.period,
        system,
    )
    return SpeedOverVoltage(system=system, parameter=parameter, table=table)


def _no_step(blows: pd.Series, one: pd.Series) -> str:
    """Return why a table does not determine the resolution."""
    if one.any():
        return (
            f"the frame moves forward at none of the {int(one.sum())} voltages with one blow in a "
            "period; take a drive that pulls the block to the right"
        )
    suffix = f", but {blows.min():g} to {blows.max():g}" if blows.notna().any() else ""
    return (
        f"no voltage in the table makes one blow in a period{suffix}; add voltages at which the "
        "device walks (see period_one_window), or a longer transient"
    )


# --- Voltage window of a period-1 orbit

STABILITY_LOSS_LABELS = (
    "G",
    "CF",
    "PD",
    "NS",
    "BP",
)  # labels of points at which a stable orbit ends
AMPLITUDE_STEP_BEYOND_JUMP = 1e-4  # relative distance beyond a jump of a run
JUMPS = 10  # that a window may span


@dataclass(frozen=True, kw_only=True, repr=False)
class PeriodOneWindow(SummaryRepr):
    """The voltage window of a stable period-1 orbit.

    Attributes
    ----------
    low, high : float
        Amplitudes [V] at the ends.
    low_kind, high_kind : str
        Special point at each end: "grazing", "fold", "period-doubling", …, or "bound" where the
        search ended.
    margin : float
        Half the width divided by the middle: the relative tolerance of a voltage in the middle.
    si : bool
        Whether the quantities are in SI, as of a device in SI.
    drive_unit : str
        SI unit of the amplitudes: "C" under a `ChargeDrive`.

    See Also
    --------
    period_one_window

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> window = mi.period_one_window(actuator, drive, (0.17, 0.26))
    >>> window.low < drive.amplitude < window.high
    True
    """

    low: float
    high: float
    low_kind: str
    high_kind: str
    si: bool = False
    drive_unit: str = "V"

    @property
    def _si_units(self) -> Mapping[str, str]:  # type: ignore[override]
        """SI units of the amplitudes."""
        return dict.fromkeys(("low", "high"), self.drive_unit)

    def summary(self) -> dict[str, Any]:
        """Return the ends, their special points and the margin."""
        return {name: each for name, each in super().summary().items() if name != "drive_unit"}

    @property
    def margin(self) -> float:  # noqa: D102 - above
        return (self.high - self.low) / (self.high + self.low)


def period_one_window(
    actuator: Actuator,
    drive: Drive,
    bounds: tuple[float, float],
    *,
    guess: State | None = None,
    transient: int = 300,
) -> PeriodOneWindow:
    """Compute the range of amplitudes of the stable period-1 orbit at `drive`.

    The orbit is continued in both directions until it grazes, folds or loses stability. A change of
    the slips of the frame does not end the window, nor does a jump to a stable period-1 orbit with
    as many impacts.

    Parameters
    ----------
    actuator : Actuator
    drive : Drive
        A drive with an ``amplitude`` at which the orbit is stable.
    bounds : tuple of float
        The lowest and the highest amplitude of the search [V].
    guess : State, optional
        An initial state that leads to the orbit; a kick by default.
    transient : int, optional
        Forcing periods to run before the orbit is computed.

    Returns
    -------
    PeriodOneWindow

    Raises
    ------
    OrbitError
        If the run from the guess does not lead to a stable orbit with impacts.

    See Also
    --------
    PeriodOneWindow, continue_solution, operating_chart

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> window = mi.period_one_window(actuator, drive, (0.17, 0.26))
    >>> window.low_kind, f"{window.low:.6f}"
    ('fold', '0.176515')
    """
    from mems_impact.actuator.state_space import kicked_state
    from mems_impact.analysis.orbit import find_orbit

    amplitude = float(drive.amplitude)  # type: ignore[attr-defined]
    low, high = numbers_for(actuator, "bounds", bounds, "V")
    if not low < amplitude < high:
        raise InvalidParameter("amplitude", amplitude, f"between the bounds {low:g} and {high:g}")
    start = kicked_state(actuator) if guess is None else guess
    orbit = find_orbit(actuator, drive, guess=start, periods=1, transient=transient)
    if not (orbit.stable and orbit.admissible and len(orbit.impacts)):
        flaw = stability_name(orbit.stable) if orbit.admissible else "inadmissible"
        flaw = flaw if len(orbit.impacts) else "without impacts"
        reason = f"at amplitude = {amplitude:g} the initial state leads to an orbit that is {flaw}"
        raise OrbitError(reason, "take an amplitude inside the window, or another guess", orbit)
    (low, low_kind, _), (high, high_kind, _) = (
        lasts_until(orbit, stop, transient) for stop in (low, high)
    )
    return PeriodOneWindow(
        low=low,
        low_kind=low_kind,
        high=high,
        high_kind=high_kind,
        si=actuator.scales.named,
        drive_unit=drive_unit(actuator.terms),
    )


def lasts_until(
    orbit: Orbit, stop: float, transient: int, watch: Watch | None = None
) -> tuple[float, str, SpecialPoint | None]:
    """Return the end of the window between `orbit` and an amplitude, and its kind.

    The third value is the special point at the end, if there is one. `watch` is called with each
    amplitude; an exception that it raises ends the search.
    """
    from mems_impact.analysis.branch import continue_solution
    from mems_impact.analysis.orbit import find_orbit

    value, kind = math.nan, ""
    ends: list[SpecialPoint] = []
    for _ in range(JUMPS):
        branch = continue_solution(
            orbit, "amplitude", stop, stop_at=STABILITY_LOSS_LABELS, progress=watch or False
        )
        value, kind = end_of(branch, stop)
        ends = [special for special in branch.special_points if special.value == value]
        if kind == "bound" or any(special.label in STABILITY_LOSS_LABELS for special in ends):
            break
        last = min(branch.orbits, key=lambda each: abs(each.system.parameters["amplitude"] - value))
        ahead = value + math.copysign(AMPLITUDE_STEP_BEYOND_JUMP * value, stop - value)
        if (stop - ahead) * (stop - value) <= 0.0:
            break
        try:
            system = last.system.changed(amplitude=ahead)
            orbit = find_orbit(system, guess=last.state, periods=1, transient=transient)
        except (OrbitError, RunError):
            break
        if not orbit.stable or len(orbit.impacts) != len(last.impacts):
            break
    return value, kind, ends[0] if ends else None


def end_of(branch: Branch, stop: float) -> tuple[float, str]:
    """Return where the stable orbit at the start of a branch ends, and the kind of this end.

    Events of the frame, such as the end of a slip that coincides with an impact, may leave it
    stable.

    Parameters
    ----------
    branch : Branch
    stop : float
        Bound of the branch: the kind of an end there is "bound".
    """
    values = [orbit.system.parameters[branch.parameter] for orbit in branch.orbits]
    sign = math.copysign(1.0, stop - values[0])
    for special in branch.special_points:
        beyond = (
            orbit.stable and orbit.admissible
            for value, orbit in zip(values, branch.orbits, strict=True)
            if sign * (value - special.value) > 0.0
        )
        if special.label in STABILITY_LOSS_LABELS or not next(beyond, False):
            return special.value, special.kind
    reached = math.isclose(values[-1], stop, rel_tol=1e-9)
    return (stop, "bound") if reached else (values[-1], branch.ended)
