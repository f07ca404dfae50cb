"""Estimates in closed form: pull-in, resting voltage, step length.

Formulas are in the units of the actuator; each docstring states the simplifications, and
`Run.step_lengths` compares the formula with the simulation.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.actuator import equations as eq
from mems_impact.actuator import impact_law, results
from mems_impact.actuator.automaton import RIGHT_IMPACT
from mems_impact.actuator.design.static_forces import StaticForces
from mems_impact.actuator.equations import V1, V2, X2
from mems_impact.actuator.impact_statistics import frame_steps
from mems_impact.actuator.model import Model, compose
from mems_impact.actuator.parameters import Actuator, numbers_for
from mems_impact.actuator.terms.base import drive_unit
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.simulation import Events

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import ArrayLike

    from mems_impact.actuator.results import ActuatorRun

__all__ = [
    "contact_voltage",
    "pull_in_charge",
    "pull_in_voltage",
    "resting_voltage",
    "step_length",
    "step_lengths",
]

HOLDING_FRICTION = 1e6  # coefficient of friction that holds the frame
DYNAMIC_PERIODS = 30  # periods of the resonance in which the block strikes, or never does
DYNAMIC_RTOL = 1e-9  # relative accuracy of a dynamic pull-in voltage found by simulation


def coasting(model: Model, y: Floats, v: float, w: float, p: Floats) -> float:
    """Return the distance that the frame slides to the right from a state under constant forces.

    The result is infinite if the forces overcome friction. `v` and `w` are the right and
    left voltages.
    """
    pull = model.pull(v, w, y, p) + model.force(y, p)
    push = eq.load(y[X2], y[V2], pull, p) + model.on_frame(y, p)
    slowing = (model.sliding_friction(1, y[V1], p) - push) / p[eq.M1]
    return float(y[V1] ** 2 / (2.0 * slowing)) if slowing > 0.0 else math.inf


# --- Estimates of pull-in voltage, resting voltage and step length


def pull_in_voltage(actuator: Actuator, *, dynamic: bool = False) -> float:
    """Compute the pull-in voltage, at which the block reaches the right stopper.

    In equilibrium k x2 = alpha v^2 / (d - x2)^2, that is v^2 = k x2 (d - x2)^2 / alpha, which has
    its maximum at x2 = d/3: above ``sqrt(4 k d^3 / (27 alpha))`` there is no equilibrium and the
    block snaps to the stopper. The block reaches a stopper closer than d/3 at a lower voltage,
    `resting_voltage`.

    With terms, the largest voltage of an equilibrium between the position without voltage and the
    stopper is computed numerically. Terms in series with the electrode transmit a slow voltage, and
    its insulation is free of trapped charge. A force that does not depend on the position, as of a
    comb drive, has no pull-in.

    The dynamic pull-in voltage is the least voltage that, switched on suddenly, brings the block
    from rest to the stopper in a held frame. Without damping, the energy gives v^2 = k d x2 (d -
    x2) / (2 alpha), with its maximum at x2 = d/2: ``sqrt(k d^3 / (8 alpha))``, 0.9186 of the static
    voltage, for a stopper beyond d/2. With damping or terms, simulations find this voltage.

    Parameters
    ----------
    actuator : Actuator
    dynamic : bool, optional
        Compute the dynamic instead of the static voltage.

    Returns
    -------
    float
        Voltage [V]; 0 if the block is on the stopper without voltage.

    Raises
    ------
    InvalidParameter
        If the equilibrium of the states of a term is unknown, or the device has no pull-in.

    See Also
    --------
    resting_voltage, load_actuator

    Examples
    --------
    >>> import mems_impact as mi
    >>> f"{mi.pull_in_voltage(mi.load_actuator('mita2003')):.2f} V"
    '31.57 V'
    """
    _check_voltage(actuator)
    if dynamic:
        return _dynamic_pull_in(actuator)
    if actuator.terms:
        return float(actuator.scales.out(StaticForces(actuator).pull_in(), "V"))
    if actuator.delta <= actuator.d / 3.0:
        return resting_voltage(actuator)
    return math.sqrt(4.0 * actuator.k * actuator.d / (27.0 * actuator.alpha)) * actuator.d


def pull_in_charge(actuator: Actuator) -> float:
    """Compute the charge of a `ChargeDrive` at which the block reaches the right stopper.

    With a parasitic capacitance Cp, the block of parallel plates is stable up to (d/3) (1 + 2
    alpha/(d Cp)) (J. I. Seeger, B. E. Boser, J. Microelectromech. Syst. 12, 656 (2003)); the block
    snaps from there, or is pulled as far as a closer stopper. With other terms, the largest charge
    of an equilibrium is computed numerically, as in `pull_in_voltage`.

    Parameters
    ----------
    actuator : Actuator
        With a `ChargeDrive`.

    Returns
    -------
    float
        Charge [C]; 0 if the block is on the stopper without charge.

    Raises
    ------
    InvalidParameter
        If the actuator has no `ChargeDrive`, or the equilibrium of the states of a term is unknown.

    See Also
    --------
    ChargeDrive, pull_in_voltage

    Examples
    --------
    >>> import mems_impact as mi
    >>> charged = mi.load_actuator("mita2003").adding(mi.ChargeDrive())
    >>> f"{1e12 * mi.pull_in_charge(charged):.2f} pC"
    '2.05 pC'
    """
    if drive_unit(actuator.terms) != "C":
        problem = "the drive sets a voltage; use pull_in_voltage, or add ChargeDrive"
        raise InvalidParameter("terms", actuator.terms, "", problem=problem)
    return float(actuator.scales.out(StaticForces(actuator).pull_in(), "C"))


def _check_voltage(actuator: Actuator) -> None:
    """Raise InvalidParameter if the drive sets a charge."""
    if drive_unit(actuator.terms) == "C":
        problem = "ChargeDrive sets a charge instead of a voltage; use pull_in_charge"
        raise InvalidParameter("terms", actuator.terms, "", problem=problem)


def contact_voltage(actuator: Actuator) -> float:
    """Return the slowly rising voltage at which the block reaches the right stopper.

    This is the pull-in voltage, or, for a comb drive, the voltage of the equilibrium at the
    stopper.
    """
    _check_voltage(actuator)
    if actuator.terms:
        return float(actuator.scales.out(StaticForces(actuator).contact(), "V"))
    return pull_in_voltage(actuator)


def _dynamic_pull_in(actuator: Actuator) -> float:
    """Return the dynamic pull-in voltage."""
    if actuator.c == 0.0 and not actuator.terms:
        position = min(actuator.delta, 0.5 * actuator.d)
        energy = actuator.k * actuator.d * position * (actuator.d - position) / 2.0
        return math.sqrt(energy / actuator.alpha)
    from mems_impact.actuator.drives.sine import Sine
    from mems_impact.actuator.system import ActuatorSystem
    from mems_impact.analysis.simulate import simulate

    # The frame is held by friction that no force overcomes.
    gravity = actuator.g or actuator.scales.out(1.0, "m/s^2")
    held_frame = actuator.replace_unchecked(mu_s=HOLDING_FRICTION, mu_d=HOLDING_FRICTION, g=gravity)
    omega = math.sqrt(actuator.k / actuator.m2)

    def strikes(voltage: float) -> bool:
        drive = Sine(amplitude=0.0, omega=omega, bias=voltage)
        system = ActuatorSystem(held_frame, drive)
        run = simulate(system, DYNAMIC_PERIODS, keep="statistics", window=(0, DYNAMIC_PERIODS))
        return bool(run._scaled_statistics["impacts"] > 0)

    low, high = 0.0, pull_in_voltage(actuator)
    if high == 0.0:
        return 0.0
    while high - low > DYNAMIC_RTOL * high:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if strikes(middle) else (middle, high)
    return high


def resting_voltage(actuator: Actuator) -> float:
    """Compute the voltage above which a block stays on the right stopper.

    The voltage is ``sqrt(k delta / alpha) (d - delta)``, from the balance of attraction and spring
    with the frame at rest. With terms, attraction and adhesion balance all static forces; see
    `pull_in_voltage`.

    Parameters
    ----------
    actuator : Actuator

    Returns
    -------
    float
        Voltage [V]; 0 if the block stays without voltage.

    Raises
    ------
    InvalidParameter
        If the equilibrium of the states of a term is unknown.

    See Also
    --------
    pull_in_voltage, Adhesion

    Examples
    --------
    >>> import mems_impact as mi
    >>> f"{mi.resting_voltage(mi.load_actuator('mita2003')):.2f} V"
    '29.00 V'
    """
    _check_voltage(actuator)
    if actuator.terms:
        return float(actuator.scales.out(StaticForces(actuator).resting(), "V"))
    return math.sqrt(actuator.k * actuator.delta / actuator.alpha) * (actuator.d - actuator.delta)


def step_length(actuator: Actuator, speed: ArrayLike, voltage: ArrayLike = 0.0) -> Any:
    """Estimate the displacement of the frame by one impact on the right stopper, from momentum.

    A frame at rest leaves an impact of the block at `speed` with v1' = (1 + e) m2/(m1 + m2) speed
    (Equation 5); friction and the load of spring, damper and attraction just after the impact
    decelerate the frame by a_f = (mu_d N - L)/m1 (Equations 1 and 3), so that the frame stops after
    v1'^2/(2 a_f). The estimate neglects changes of load and friction during the slip, and events
    before rest, in particular another impact. Terms contribute their forces just after the impact.

    Parameters
    ----------
    actuator : Actuator
    speed : array_like
        Speed v2 of the block before the impact [m/s], >= 0.
    voltage : array_like, optional
        Voltage at the electrode at the impact [V].

    Returns
    -------
    float or ndarray
        Displacement [m]; infinite if the load overcomes friction.

    Raises
    ------
    InvalidParameter
        If the actuator has terms for which the formula does not hold: compliant stoppers, friction
        without sticking, or forces with memory.

    See Also
    --------
    Run, SpeedOverVoltage

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> f"{mi.step_length(actuator, 0.4):.3e}"
    '2.337e-03'
    """
    speed = numbers_for(actuator, "speed", speed, "m/s")
    voltage = numbers_for(actuator, "voltage", voltage, "V")
    if actuator.terms:
        return _step_with_terms(actuator, speed, voltage)
    p = actuator.to_array()
    speeds, volts = np.broadcast_arrays(np.asarray(speed, float), np.asarray(voltage, float))
    after = impact_law.frame_speed_after(0.0, 1.0, actuator.e, p) * speeds
    pull = actuator.alpha * volts**2 / (actuator.d - actuator.delta) ** 2
    load = actuator.k * actuator.delta - actuator.c * actuator.e * speeds - pull
    slowing = (eq.sliding_friction(1, p) - load) / actuator.m1
    with np.errstate(divide="ignore", invalid="ignore"):
        result = np.where(slowing > 0.0, after**2 / (2.0 * slowing), np.inf)
    return float(result) if result.ndim == 0 else result


def _step_with_terms(actuator: Actuator, speed: ArrayLike, voltage: ArrayLike) -> Any:
    scales, device = actuator.scales, StaticForces(actuator)

    def step(one: float, volts: float) -> float:
        y = device.after_impact(float(scales.into(one, "m/s")))
        inner = coasting(device.model, y, float(scales.into(volts, "V")), 0.0, device.p)
        return float(scales.out(inner, "m"))

    result = np.vectorize(step, otypes=[float])(speed, voltage)
    return float(result) if result.ndim == 0 else result


def step_lengths(run: ActuatorRun) -> pd.DataFrame:
    """Return the table of `Run.step_lengths`."""
    log, period = run.trajectory.events, run.trajectory.period
    rows, steps = frame_steps(log)
    struck = np.zeros(len(log), dtype=bool)
    struck[rows] = True
    hits = log[struck]
    right = hits.guard == RIGHT_IMPACT
    at_rest = right & (hits.before[:, V1] == 0.0)
    chosen = at_rest & (steps > 0.0)
    if not chosen.any():
        problem = _stepless(run, int(right.sum()), int(at_rest.sum()))
        raise InvalidParameter("run", None, "", problem=problem)
    hits, steps = hits[chosen], steps[chosen]
    scales = run.system.units.scales
    volts = run.system.node_voltages(hits.cycle, hits.time, hits.after)["node voltage"]
    volts = scales.out(volts, "V")
    speed = scales.out(hits.before[:, V2], "m/s")
    if run.actuator.terms:
        formula = scales.out(_steps_after(run, hits), "m")
    else:
        formula = step_length(run.actuator, speed, volts)
    return results.step_lengths(
        hits.cycle, hits.time / period, speed, volts, scales.out(steps, "m"), formula, run.system
    )


def _stepless(run: ActuatorRun, right: int, at_rest: int) -> str:
    """Return why the formula applies to no impact of a run."""
    if right == 0:
        return "no impact on the right stopper; raise the voltage, or start with a kick"
    if at_rest:
        return f"no step of {at_rest} that begin at rest has ended; simulate more periods"
    return (
        f"each of {right} impacts on the right stopper strikes a frame that already slips (for "
        f"{run.measured.share_slipping:.3g} of the time), so that no step ends before the "
        "next; use run.blow_statistics.displacement_per_blow"
    )


def _steps_after(run: ActuatorRun, hits: Events) -> Floats:
    """Return the formula evaluated at the states after impacts, including those of terms."""
    system = run.system
    if any(term.replaced_rule == "stopper" for term in system.actuator.terms):
        StaticForces(system.actuator).after_impact(0.0)  # raises an error if there is none
    numbers = system.numbers()
    left = system.drive.left_voltage is not None
    model = compose(tuple(term.kind for term in system.actuator.terms), 2 if left else 1)
    times = system.units.scales.out(hits.time, "s")
    volts = [system.into_drive(system.source.value(times, left=side)) for side in (False, True)]
    rows = zip(hits.after, *volts, strict=True)
    return np.array([coasting(model, y, v, w, numbers.parameters) for y, v, w in rows])
