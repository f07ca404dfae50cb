"""Central differences."""

from __future__ import annotations

from collections.abc import Callable

from mems_impact._util.arrays import Floats


def weight_of(s: int) -> float:
    """Return the weight of the value at `s` steps in a central difference of sixth order."""
    weight = 45.0 if abs(s) == 1 else (-9.0 if abs(s) == 2 else 1.0)
    return weight / 60.0 if s > 0 else -weight / 60.0


def central_difference(function: Callable[[float], Floats], step: float) -> Floats:
    """Return the derivative of `function` at zero, with an error of second order in `step`."""
    return (function(step) - function(-step)) / (2.0 * step)


def sixth_order_difference(function: Callable[[float], Floats], step: float) -> Floats:
    """Return the derivative of `function` at zero, with an error of sixth order in `step`."""
    terms = (weight_of(s) / step * (function(s * step) - function(-s * step)) for s in (1, 2, 3))
    first, second, third = terms
    return first + second + third
