"""Estimates in closed form: pull-in, resting voltage, step length.

Formulas are in the units of the actuator; each docstring states the simplifications, and
`Run.step_lengths` compares the formula with the simulation.
"""

from __future__ import annotations

import math

from mems_impact._util.bisection import bisect
from mems_impact.actuator.design.static_forces import StaticForces, holding_voltage
from mems_impact.actuator.drives.sine import Sine
from mems_impact.actuator.parameters import ActuatorParameters
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.actuator.terms.base import drive_unit
from mems_impact.analysis.simulate import simulate
from mems_impact.errors import InvalidParameter

HOLDING_FRICTION = 1e6  # coefficient of friction that holds the frame
DYNAMIC_PERIODS = 30  # periods of the resonance in which the block strikes, or never does
DYNAMIC_RTOL = 1e-9  # relative accuracy of a dynamic pull-in voltage found by simulation


def pull_in_voltage(actuator: ActuatorParameters, *, dynamic: bool = False) -> float:
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
    return holding_voltage(actuator, min(actuator.delta, actuator.d / 3.0))


def pull_in_charge(actuator: ActuatorParameters) -> float:
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


def _check_voltage(actuator: ActuatorParameters) -> None:
    """Raise InvalidParameter if the drive sets a charge."""
    if drive_unit(actuator.terms) == "C":
        problem = "ChargeDrive sets a charge instead of a voltage; use pull_in_charge"
        raise InvalidParameter("terms", actuator.terms, "", problem=problem)


def contact_voltage(actuator: ActuatorParameters) -> float:
    """Return the slowly rising voltage at which the block reaches the right stopper.

    This is the pull-in voltage, or, for a comb drive, the voltage of the equilibrium at the
    stopper.
    """
    _check_voltage(actuator)
    if actuator.terms:
        return float(actuator.scales.out(StaticForces(actuator).contact(), "V"))
    return pull_in_voltage(actuator)


def _dynamic_pull_in(actuator: ActuatorParameters) -> float:
    """Return the dynamic pull-in voltage."""
    if actuator.c == 0.0 and not actuator.terms:
        position = min(actuator.delta, 0.5 * actuator.d)
        energy = actuator.k * actuator.d * position * (actuator.d - position) / 2.0
        return math.sqrt(energy / actuator.alpha)
    # The frame is held by friction that no force overcomes.
    gravity = actuator.g or actuator.scales.out(1.0, "m/s^2")
    held_frame = actuator.replace_unchecked(mu_s=HOLDING_FRICTION, mu_d=HOLDING_FRICTION, g=gravity)
    omega = math.sqrt(actuator.k / actuator.m2)

    def rests(voltage: float) -> bool:
        drive = Sine(amplitude=0.0, omega=omega, bias=voltage)
        system = ActuatorSystem(held_frame, drive)
        run = simulate(system, DYNAMIC_PERIODS, keep="statistics", window=(0, DYNAMIC_PERIODS))
        return bool(run._scaled_statistics["impacts"] == 0)

    static = pull_in_voltage(actuator)
    if static == 0.0:
        return 0.0
    return bisect(rests, 0.0, static, DYNAMIC_RTOL * static)[1]


def resting_voltage(actuator: ActuatorParameters) -> float:
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
    return holding_voltage(actuator, actuator.delta)
