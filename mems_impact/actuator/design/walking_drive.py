"""A sine under which a device walks: frequency and amplitude, found by simulation."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from mems_impact._util.bisection import bisect
from mems_impact._util.units import si_amount
from mems_impact._util.warning_scopes import collected_warnings
from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.design.data_sheet_quantities import OF_PARAMETER
from mems_impact.actuator.design.static_forces import contact_amount, normal_force, static_contact
from mems_impact.actuator.drives.sine import Sine
from mems_impact.actuator.plausibility import voltage_limits
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.actuator.terms.base import drive_unit
from mems_impact.actuator.units import PARAMETER_UNITS
from mems_impact.analysis.simulate import simulate
from mems_impact.errors import OrbitError, RunError

RESONANT_RATIOS = (1.0, 1.05, 0.95, 1.1, 0.9)  # of forcing frequency and resonance
SLOW_RATIOS = (0.4, 0.2, 0.1, 0.04)  # of forcing frequency and the resonance, or relaxation
SLOW_FIRST = 4.0  # quality factor below which slow drives are tried before resonant ones
MAX_AMPLITUDE_RATIO = 2.0  # of the largest amplitude and the static voltage of contact
MIN_AMPLITUDE_RATIO = 0.02
ONSET_RTOL = 0.03  # relative accuracy of the amplitude from which the block strikes
ABOVE_ONSET = (1.1, 1.2, 1.35, 1.55, 1.8)  # amplitudes that are tried, relative to the onset
MARGIN = 0.95, 1.05  # relative amplitudes at which the device still walks
ONSET_PERIODS = 60  # near the resonance, within which the block strikes above the onset
WALK_PERIODS, RINGING_PERIODS = 100, 300  # of a run, and of one with a high quality factor
RINGING = 100.0  # quality factor above which the motion settles slowly
MIN_PERIODS = 20  # of any run
MAX_DEVIATION = 0.1  # of the displacements of blows, relative to their mean
MAX_SLIPPING = 0.5  # of the time, of a frame that friction stops between blows
MIN_STEP = 1e-4  # of the frame in a period, relative to delta
MIN_MASS_RATIO = 0.1  # of a frame that is proposed, and the block
DIGITS = 3  # of frequency and amplitude

STILL, HEAVY, SLIPPERY, IRREGULAR = "still", "heavy", "slippery", "irregular"
CHANGES: Mapping[str, Sequence[tuple[str, Sequence[float]]]] = {
    STILL: (("k", (8.0, 2.0, 0.5)),),  # of the stiffness with the limit as static voltage
    HEAVY: (("m1", (0.8, 0.5, 0.2)),),  # of the mass for a sufficient step, by momentum
    SLIPPERY: (("g", (0.3, 1.0, 3.0)),),  # of the weight whose friction stops the frame
    IRREGULAR: (("e", (0.8, 0.6, 0.4)), ("c", (2.0, 5.0)), ("m1", (0.5, 2.0))),
}
"""Changes that may make a device walk: parameters and factors, from near to far."""


class Walk(NamedTuple):
    """A drive under which a device walks, and the displacement of the frame in a period."""

    drive: Sine
    step: float


class Failure(NamedTuple):
    """Why no drive makes a device walk, with the displacement of a frame that is too heavy."""

    kind: str
    step: float = 0.0


def walking_drive(actuator: Actuator) -> Sine:
    """Find a sine under which a device walks, by simulation.

    Under this sine a run from rest settles to one blow per forcing period that moves the frame,
    also at amplitudes 5 % lower and higher. Forcing frequencies (twice that of the sine) near the
    resonance come first, for overdamped devices those far below; a drive that moves the frame to
    the right is preferred. Amplitudes end at the breakdown of the narrowest gap, and at twice the
    static voltage at which the block reaches the stopper.

    Parameters
    ----------
    actuator : Actuator

    Returns
    -------
    Sine
        With a frequency in SI, omega for a dimensionless device, to three digits.

    Raises
    ------
    OrbitError
        If there is none among the drives that are tried: the reason, and the nearest change of a
        parameter with which the device walks.

    See Also
    --------
    Actuator, period_one_window, operating_chart

    Examples
    --------
    >>> import mems_impact as mi
    >>> device = mi.load_actuator("mita2003")
    >>> drive = mi.walking_drive(device)
    >>> mi.simulate(device, drive).statistics["blows per period"].item()
    1.0
    """
    return find_walk(actuator).drive


def find_walk(actuator: Actuator) -> Walk:
    """Return the drive of `walking_drive`, with the displacement of the frame in a period."""
    found = _search(actuator)
    if isinstance(found, Walk):
        return found
    raise OrbitError(_reason(actuator, found), _nearest_change(actuator, found))


def first_drive(actuator: Actuator) -> Sine:
    """Return the drive of `walking_drive`, or else the static voltage of contact at resonance."""
    found = _search(actuator)
    return found.drive if isinstance(found, Walk) else snap_drive(actuator)


def snap_drive(actuator: Actuator) -> Sine:
    """Return a sine with the static voltage of contact at half the resonance."""
    return _sine(actuator, 1.0, static_contact(actuator))


def _search(actuator: Actuator) -> Walk | Failure:
    """Return a walk to the right, or else to the left, or else why there is none."""
    failure = Failure(STILL)
    for ratios in _frequency_ratios(actuator):
        left: Walk | None = None
        for ratio in ratios:
            for amplitude in _amplitudes(actuator, ratio):
                stroke = _stroke(actuator, ratio, amplitude)
                if isinstance(stroke, Failure):
                    failure = failure if failure.kind == SLIPPERY else stroke
                    if failure.kind == HEAVY:
                        return failure
                    if failure.kind == SLIPPERY:
                        break  # a larger amplitude accelerates the frame more
                    continue
                if stroke.step < 0.0 and left is not None:
                    continue
                near = [_stroke(actuator, ratio, each * amplitude) for each in MARGIN]
                if any(isinstance(each, Failure) or each.step * stroke.step < 0 for each in near):
                    failure = Failure(IRREGULAR)
                    continue
                if stroke.step > 0.0:
                    return stroke
                left = stroke
        if left is not None:
            return left
    return failure


def _amplitudes(actuator: Actuator, ratio: float) -> Iterator[float]:
    """Yield amplitudes above the least at which the block strikes from rest."""
    periods = _periods(ONSET_PERIODS, ratio)

    def rests(amplitude: float) -> bool:
        measured = _measured(actuator, _sine(actuator, ratio, amplitude), periods, 0)
        return measured is None or measured["impacts"] == 0

    highest = _limit(actuator)[0] / MARGIN[1]
    top = highest / ABOVE_ONSET[0]
    if not rests(top):
        lowest = MIN_AMPLITUDE_RATIO * static_contact(actuator)
        onset = bisect(rests, lowest, top, ONSET_RTOL * top)[1]
        yield from (factor * onset for factor in ABOVE_ONSET if factor * onset <= highest)


def _frequency_ratios(actuator: Actuator) -> tuple[Sequence[float], Sequence[float]]:
    """Return ratios of forcing frequency and resonance, in the order of the search."""
    quality = _quality(actuator)
    slow = [min(1.0, quality) * ratio for ratio in SLOW_RATIOS]
    return (slow, RESONANT_RATIOS) if quality < SLOW_FIRST else (RESONANT_RATIOS, slow)


def _quality(actuator: Actuator) -> float:
    return math.sqrt(actuator.k * actuator.m2) / actuator.c if actuator.c else math.inf


def _periods(resonant: int, ratio: float) -> int:
    """Return the length of a run by that at the resonance; slow drives leave no transient."""
    return max(MIN_PERIODS, round(resonant * min(1.0, ratio)))


def _sine(actuator: Actuator, ratio: float, amplitude: float) -> Sine:
    """Return a sine by the ratio of forcing frequency and resonance."""
    omega = 0.5 * ratio * math.sqrt(actuator.k / actuator.m2)
    volts = float(f"{amplitude:.{DIGITS}g}")
    if not actuator.scales.named:
        return Sine(amplitude=volts, omega=float(f"{omega:.{DIGITS}g}"))
    return Sine(amplitude=volts, frequency=float(f"{omega / (2.0 * math.pi):.{DIGITS}g}"))


def _measured(
    actuator: Actuator, drive: Sine, periods: int, first: int
) -> Mapping[str, float] | None:
    """Return the statistics of a run from rest, from a period to its end."""
    system = ActuatorSystem(actuator, drive)
    try:
        with collected_warnings():
            run = simulate(system, periods, window=(first, periods), keep="statistics")
    except RunError:
        return None
    measured: Mapping[str, float] = run.measured  # type: ignore[attr-defined]
    return measured


def _stroke(actuator: Actuator, ratio: float, amplitude: float) -> Walk | Failure:
    """Return the walk of a run with one equal blow in each period of v^2."""
    resonant = RINGING_PERIODS if _quality(actuator) > RINGING else WALK_PERIODS
    drive, periods = _sine(actuator, ratio, amplitude), _periods(resonant, ratio)
    measured = _measured(actuator, drive, periods, periods // 2)
    if measured is None:
        return Failure(IRREGULAR)
    share = drive.period / ActuatorSystem(actuator, drive).forcing_period
    step = float(actuator.scales.out(share * measured["displacement per period"], "m"))
    # A blow at the border of the window may be inside or outside.
    if abs(share * measured["blows per period"] - 1.0) > 1.5 / (periods // 2):
        return Failure(IRREGULAR)
    if abs(step) < MIN_STEP * actuator.delta:
        return Failure(SLIPPERY if measured["share slipping"] > MAX_SLIPPING else HEAVY, abs(step))
    deviation, mean = measured["displacement per blow std"], measured["displacement per blow"]
    return Walk(drive, step) if deviation <= MAX_DEVIATION * abs(mean) else Failure(IRREGULAR)


# --- Voltages


def _limit(actuator: Actuator) -> tuple[float, str]:
    """Return the largest amplitude, and its name."""
    contact = MAX_AMPLITUDE_RATIO * static_contact(actuator), "twice the static voltage of contact"
    if not actuator.scales.named or drive_unit(actuator.terms) != "V":
        return contact
    limits = ((each.value, each.quantity) for each in voltage_limits(actuator))
    return min([contact, *limits])


# --- Reasons


def _reason(actuator: Actuator, failure: Failure) -> str:
    """Return why there is no walking drive."""

    def told(value: float, unit: str) -> str:
        return si_amount(value, unit if actuator.scales.named else "")

    if failure.kind == STILL:
        limit, name = _limit(actuator)
        return (
            f"no sine up to {told(limit, drive_unit(actuator.terms))}, the {name}, strikes; a "
            f"slowly rising voltage reaches the stopper at {contact_amount(actuator)}"
        )
    if failure.kind == HEAVY:
        return (
            f"blows move the frame, {actuator.m1 / actuator.m2:.3g} times as heavy as the block, "
            f"by {told(failure.step, 'm')} in a period, less than {MIN_STEP:g} of the travel"
        )
    if failure.kind == SLIPPERY:
        friction = actuator.mu_d * normal_force(actuator.to_array(), actuator.terms)
        return f"friction, {told(friction, 'N')}, does not stop the frame between blows"
    return "no drive that strikes settles to equal steps, one in each forcing period"


def _nearest_change(actuator: Actuator, failure: Failure) -> str:
    """Return the nearest change of a parameter with which a device walks, confirmed by a search."""
    if failure.kind == SLIPPERY and actuator.mu_d * actuator.g == 0.0:
        return "give the frame friction on the ground (mu_d, and g or a Clamp)"
    base = 1.0
    if failure.kind == HEAVY:
        base = math.sqrt(failure.step / (MIN_STEP * actuator.delta))
    elif failure.kind == STILL:
        base = (_limit(actuator)[0] / static_contact(actuator)) ** 2
    elif failure.kind == SLIPPERY:  # in half a period, after a blow of the block at resonance
        total = actuator.m1 + actuator.m2
        blow = (1.0 + actuator.e) * actuator.m2 / total * actuator.delta
        slowing = blow * actuator.k / actuator.m2 / math.pi
        base = slowing * actuator.m1 / (actuator.mu_d * total * actuator.g)
    for parameter, factors in CHANGES[failure.kind]:
        before = getattr(actuator, parameter)
        for factor in factors:
            value = float(f"{factor * base * before:.{DIGITS}g}")
            if value == before or (parameter == "m1" and value < MIN_MASS_RATIO * actuator.m2):
                continue
            if isinstance(_search(actuator.replace(**{parameter: value})), Walk):
                return f"it walks with {_change(actuator, parameter, value)}"
    names = " or ".join(f"{OF_PARAMETER[name]} {name}" for name, _ in CHANGES[failure.kind])
    return f"another {names} alone does not help; see operating_chart"


def _change(actuator: Actuator, parameter: str, value: float) -> str:
    """Return a change of a parameter as text; a change of gravity as the force of a clamp."""
    before = getattr(actuator, parameter)
    if parameter == "g":
        force = (value - before) * (actuator.m1 + actuator.m2)
        return f"a clamp_force of {si_amount(force, 'N' if actuator.scales.named else '')}"
    unit = PARAMETER_UNITS.get(parameter, "") if actuator.scales.named else ""
    amounts = f"{si_amount(value, unit)} instead of {si_amount(before, unit)}"
    return f"{OF_PARAMETER[parameter]} {parameter} = {amounts}"
