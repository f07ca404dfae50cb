"""Wear life by Archard's law."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from mems_impact._util.quantities import quantity
from mems_impact.actuator.design.energy import energy
from mems_impact.actuator.design.static_forces import clamp_force
from mems_impact.actuator.numerics import ActuatorNumerics
from mems_impact.actuator.results import ActuatorOrbit, ActuatorRun
from mems_impact.errors import InvalidParameter
from mems_impact.systems.result import SummaryRepr
from mems_impact.systems.state import is_number

MAX_FRICTION = 1.0  # static friction over weight, above which another force presses the frame


@dataclass(frozen=True, kw_only=True, repr=False)
class WearLife(SummaryRepr):
    """Wear and life of a device, in the units of the device.

    Attributes
    ----------
    normal_force : float
        Normal force of the frame on the ground, of a driven clamp the mean over the slip path [N].
    slip_per_period, slip_per_blow : float
        Total slip path of the frame [m]; NaN per blow without blows.
    volume_per_blow : float
        Worn volume [m^3]; NaN without blows.
    blows : float
        Blows (see `mems_impact.BlowStatistics`) until the depth is reached; infinite without slip,
        0 if the frame slips without blows.
    time : float
        Time until the depth is reached [s].
    distance : float
        Distance walked until the depth is reached [m].
    si : bool
        Whether the quantities are in SI, as of a device in SI.

    See Also
    --------
    life

    Examples
    --------
    >>> import mems_impact as mi
    >>> mita = mi.load_actuator("mita2003")
    >>> run = mi.simulate(mita, mi.Sine(amplitude=100, omega=6.283), periods=6, window=(2, 6))
    >>> found = mi.life(run, wear=1e-13, area=1e-8, depth=0.1e-6)
    >>> f"{found.distance:.0f} m", f"{found.slip_per_blow * 1e9:.1f} nm"
    ('81 m', '20.0 nm')
    """

    _si_units = {  # noqa: RUF012 - ClassVar in Summarized
        "normal_force": "N", "slip_per_period": "m", "slip_per_blow": "m",
        "volume_per_blow": "m^3", "time": "s", "distance": "m",
    }  # fmt: skip

    normal_force: float
    slip_per_period: float
    slip_per_blow: float
    volume_per_blow: float
    blows: float
    time: float
    distance: float
    si: bool = False


def life(
    motion: ActuatorRun | ActuatorOrbit,
    *,
    wear: float,
    area: float,
    depth: float,
    normal_force: float | None = None,
) -> WearLife:
    """Estimate the life of a device whose frame wears by slip.

    Parameters
    ----------
    motion : ActuatorRun or ActuatorOrbit
        The motion during the whole life; for a run, over its window.
    wear : float
        Specific wear rate [m^3/(N m)], Archard's K over the hardness, > 0: for polysilicon on
        polysilicon some 1e-15 to 1e-12.
    area : float
        Contact area of the frame [m^2], > 0.
    depth : float
        Allowed wear depth [m], > 0.
    normal_force : float, optional
        Normal force of the frame on the ground [N], > 0. By default that of weight and clamps
        (`Clamp`, `ClampElectrode`), for a driven clamp its mean over the slip path; required if
        static friction exceeds the weight of a device without a clamp.

    Returns
    -------
    WearLife

    Raises
    ------
    InvalidParameter
        If a number is out of range, `motion` is neither run nor orbit, or the friction is larger
        than the weight and no normal force is given.

    Warns
    -----
    TransientWarning
        If the statistics of the run still change.

    See Also
    --------
    WearLife, duty_cycle, energy

    Notes
    -----
    The volume is the wear rate times normal force times path (J. F. Archard, "Contact and rubbing
    of flat surfaces", J. Appl. Phys. 24, 981 (1953)). The coefficients of friction are assumed
    constant.

    Examples
    --------
    >>> import mems_impact as mi
    >>> mita = mi.load_actuator("mita2003")
    >>> run = mi.simulate(mita, mi.Sine(amplitude=100, omega=6.283), periods=6, window=(2, 6))
    >>> f"{mi.life(run, wear=1e-13, area=1e-8, depth=0.1e-6).blows:.2e}"
    '4.05e+09'
    """
    si = isinstance(motion, ActuatorRun | ActuatorOrbit) and motion.system.units.scales.named
    rate = WearRate.of(si, wear=wear, area=area, depth=depth)
    if normal_force is not None:
        normal_force = _positive("normal_force", normal_force, "N", si)
    balance = energy(motion)
    system, slip = balance.system, balance.slip_path / balance.periods
    if normal_force is None:
        table = balance.table.set_index(["kind", "account"])
        lost = table["energy"]["lost", "friction"] / balance.periods
        normal_force = mean_normal_force(system, lost, slip)
    if isinstance(motion, ActuatorOrbit):
        blows = len(balance.by_blow) / balance.periods
    else:
        blows = motion.measured["blows per period"]
    periods = rate.periods(normal_force, slip)
    walked = _walked(motion)
    return WearLife(
        normal_force=normal_force,
        slip_per_period=slip,
        slip_per_blow=slip / blows if blows > 0.0 else math.nan,
        volume_per_blow=rate.wear * normal_force * slip / blows if blows > 0.0 else math.nan,
        blows=periods * blows if periods < math.inf else math.inf,
        time=periods * float(system.forcing_period),
        distance=periods * walked if walked != 0.0 else 0.0,
        si=si,
    )


class WearRate(NamedTuple):
    """Specific wear rate, contact area and allowed depth."""

    wear: float
    area: float
    depth: float

    @classmethod
    def of(cls, si: bool, **values: Any) -> WearRate:
        """Return them from numbers or texts with units; InvalidParameter unless they are > 0."""
        units = {"wear": "m^2/N", "area": "m^2", "depth": "m"}  # m^3/(N m)
        return cls(**{name: _positive(name, values[name], unit, si)
                      for name, unit in units.items()})  # fmt: skip

    def periods(self, normal_force: float, slip: float) -> float:
        """Return the forcing periods until the depth is reached, by the slip path in each."""
        volume = self.wear * normal_force * slip
        return self.area * self.depth / volume if volume > 0.0 else math.inf


def _positive(field: str, value: Any, unit: str, si: bool) -> float:
    number = quantity(field, value, unit if si else None, "device")
    if not (is_number(number) and number > 0.0):
        raise InvalidParameter(field, number, "a finite number > 0")
    return float(number)


def mean_normal_force(system: ActuatorNumerics, friction_loss: float, slip: float) -> float:
    """Return the normal force during slips, of a driven clamp the mean over the slip path.

    `friction_loss` and `slip` are heat of friction and slip path over the same time. Raises
    InvalidParameter if the device does not tell its normal force.
    """
    forces, scales = system.normal_forces(), system.units.scales
    name, force, friction = "normal_force", float(scales.out(forces[0], "N")), system.actuator.mu_s
    if forces.min() < forces.max():  # a clamp that the drive moves
        laws = [term for term in system.actuator.terms if term.replaced_rule == "friction"]
        if system.actuator.mu_d == 0.0 or laws:
            problem = "the normal force varies, and friction does not tell its mean: give it"
            raise InvalidParameter(name, None, "", problem=problem)
        return friction_loss / (system.actuator.mu_d * slip) if slip else force
    if friction > MAX_FRICTION and clamp_force(system.actuator.terms) == 0.0:
        unit = " N" if scales.named else ""
        problem = (
            f"the static friction of {friction * force:.4g}{unit} is {friction:.4g} times the "
            "weight, from which no normal force follows: give the normal force on the ground as "
            "normal_force=, or the device a Clamp and its coefficients of friction"
        )
        raise InvalidParameter(name, None, "", problem=problem)
    return force


def _walked(motion: ActuatorRun | ActuatorOrbit) -> float:
    """Return the displacement per period."""
    if isinstance(motion, ActuatorOrbit):
        return motion.step / motion.periods
    return float(motion.statistics["displacement per period"])
