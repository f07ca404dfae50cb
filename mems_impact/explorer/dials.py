"""The sliders of a system: how far each goes, in which steps, in which unit it is told."""

from __future__ import annotations

import math
from dataclasses import dataclass

from mems_impact.analysis.system import System
from mems_impact.errors import MemsImpactError
from mems_impact.explorer.magnitudes import told_in
from mems_impact.explorer.subject import Subject

__all__ = ["Dial", "allowed_range", "dials_of"]

PARTS = 100  # of the way from a value to an end; where the end is not allowed, one of them is
STEPS = 500  # of a slider, at least


@dataclass(frozen=True, kw_only=True)
class Dial:
    """The slider of one parameter.

    Attributes
    ----------
    name : str
    unit : str
        In which it is told, empty for a pure number.
    factor : float
        That unit in the system's own: what stands at the slider times `factor` is the parameter.
    low, high, step : float
        In the system's own unit.
    """

    name: str
    unit: str
    factor: float
    low: float
    high: float
    step: float

    @property
    def label(self) -> str:
        """The name with the unit."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


def dials_of(subject: Subject) -> tuple[Dial, ...]:
    """Return a slider for each parameter: from 0 to twice its value, as far as that is allowed.

    One that is 0 goes as far to either side.
    """
    return tuple(_dial(subject, name, value) for name, value in subject.system.parameters.items())


def allowed_range(system: System, name: str, low: float, high: float) -> tuple[float, float]:
    """Return the part of a range around a parameter's value that the system allows.

    What is allowed is asked of the system itself, which may compare the parameter with others.
    """
    value = system.value(name)
    return _farthest(system, name, value, low), _farthest(system, name, value, high)


def _dial(subject: Subject, name: str, value: float) -> Dial:
    system = subject.system
    size = subject.sizes.get(name) or abs(float(system.out(name, 1.0)))
    low, high = (min(0.0, 2.0 * value), max(0.0, 2.0 * value)) if value else (-size, size)
    low, high = (float(f"{end:.6g}") for end in allowed_range(system, name, low, high))
    factor, unit = told_in(system.unit(name), abs(value) or size)
    return Dial(
        name=name, unit=unit, factor=factor, low=low, high=high, step=_round_step(high - low)
    )


def _farthest(system: System, name: str, value: float, end: float) -> float:
    """Return how far a parameter may go from its value towards an end."""

    def place(part: int) -> float:
        return value + (end - value) * part / PARTS if part < PARTS else end

    if _allows(system, name, end):
        return end
    inside, outside = 0, PARTS
    while outside - inside > 1:
        middle = (inside + outside) // 2
        if _allows(system, name, place(middle)):
            inside = middle
        else:
            outside = middle
    return place(inside)


def _allows(system: System, name: str, value: float) -> bool:
    try:
        system.changed(**{name: value}).numbers()
    except (MemsImpactError, ArithmeticError, ValueError):
        return False
    return True


def _round_step(length: float) -> float:
    """Return a step of 1, 2 or 5 times a power of ten."""
    if not length > 0.0:
        return 1.0
    rough = length / STEPS
    power = 10.0 ** math.floor(math.log10(rough))
    return power * max(each for each in (1.0, 2.0, 5.0) if each * power <= rough * (1.0 + 1e-9))
