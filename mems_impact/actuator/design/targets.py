"""Measured numbers: what can be measured of a device, and what a model of it gives instead."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

from mems_impact.actuator.design.blows import blows
from mems_impact.actuator.design.estimates import pull_in_voltage, resting_voltage
from mems_impact.actuator.drives import Drive
from mems_impact.actuator.parameters import Actuator
from mems_impact.analysis.state import is_number
from mems_impact.errors import InvalidParameter

if TYPE_CHECKING:
    from mems_impact.actuator.results import ActuatorRun as Run

__all__ = ["OF_RUN", "QUANTITIES", "Target", "of_device"]


def _per_impact(run: Run) -> float:
    """Return the displacement per impact; 0, which a fit can work with, where nothing happens."""
    moved = run.measured.displacement_per_period
    each = run.measured.displacement_per_impact if moved != 0.0 else 0.0
    return float(run.actuator.scales.out(each, "m"))


# What can be measured with a run, and its unit; what follows from the device alone, and its unit.
# The names are those of `Run.statistics`.
OF_RUN: dict[str, tuple[Callable[[Run], float], str]] = {
    "displacement per blow": (lambda run: blows(run).displacement_per_blow, "m"),
    "blows per period": (lambda run: run.measured.blows_per_period, ""),
    "displacement per impact": (_per_impact, "m"),
    "impacts per period": (lambda run: run.measured.impacts_per_period, ""),
    "displacement per period": (
        lambda run: run.actuator.scales.out(run.measured.displacement_per_period, "m"),
        "m",
    ),
    "mean speed": (
        lambda run: run.actuator.scales.out(run.measured.mean_speed, "m/s"),
        "m/s",
    ),
}
OF_DEVICE: dict[str, tuple[Callable[[Actuator], float], str]] = {
    "pull-in voltage": (pull_in_voltage, "V"),
    "resting voltage": (resting_voltage, "V"),
    "resonance": (lambda a: math.sqrt(a.k / a.m2), "rad/s"),
}
QUANTITIES = (*OF_RUN, *OF_DEVICE)


def of_device(actuator: Actuator) -> dict[str, tuple[float, str]]:
    """Return the quantities that need no drive, by name, each with its SI unit."""
    return {name: (value(actuator), unit) for name, (value, unit) in OF_DEVICE.items()}


@dataclass(frozen=True, kw_only=True)
class Target:
    """A measured number.

    Parameters
    ----------
    quantity : str
        Measured under a drive: "displacement per blow" and "blows per period" (a sequence of
        impacts that ends in rest is one blow, as an experiment sees it), "displacement per
        impact" and "impacts per period" (every bounce is one), "displacement per period", "mean
        speed"; of the device alone: "pull-in voltage", "resting voltage", "resonance" (of the
        block in a frame that is held, [rad/s]).
    value : float
        In the units of the actuator; per forcing period.
    drive : Drive, optional
        Under which it was measured; for the first six.
    tolerance : float, optional
        Standard error of the value, > 0: the weight of this target. 1 % of the value by default.

    See Also
    --------
    fit, Fit

    Examples
    --------
    >>> import mems_impact as mi
    >>> drive = mi.Sine(amplitude=100, omega=6.283)
    >>> step = mi.Target(quantity="displacement per blow", value=20e-9, tolerance=1e-9, drive=drive)
    >>> step.quantity, step.tolerance
    ('displacement per blow', 1e-09)
    """

    quantity: str
    value: float
    drive: Drive | None = None
    tolerance: float | None = None

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            raise InvalidParameter("quantity", self.quantity, f"one of {', '.join(QUANTITIES)}")
        if not is_number(self.value):
            raise InvalidParameter("value", self.value, "a finite number")
        if (self.quantity in OF_RUN) != isinstance(self.drive, Drive):
            needs = "a Drive" if self.quantity in OF_RUN else f"left out for {self.quantity}"
            raise InvalidParameter("drive", self.drive, needs)
        if self.tolerance is not None and not (is_number(self.tolerance) and self.tolerance > 0.0):
            raise InvalidParameter("tolerance", self.tolerance, "a finite number > 0")
        if self.tolerance is None and self.value == 0.0:
            raise InvalidParameter("tolerance", None, "given where the value is 0")

    @property
    def unit(self) -> str:
        """The SI unit of the quantity."""
        return {**OF_RUN, **OF_DEVICE}[self.quantity][1]

    @property
    def weight(self) -> float:
        """What the difference is divided by."""
        return self.tolerance if self.tolerance is not None else 0.01 * abs(self.value)

    def computed(self, actuator: Actuator, runs: Mapping[Drive, Run]) -> float:
        """Return what an actuator does in its place; `runs` are its runs by drive."""
        if self.drive is None:
            return OF_DEVICE[self.quantity][0](actuator)
        return OF_RUN[self.quantity][0](runs[self.drive])

    def label(self, actuator: Actuator) -> str:
        """Return the quantity with its unit, if the actuator is in SI."""
        return actuator.scales.label(self.quantity, self.unit)
