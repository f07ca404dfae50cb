"""Whether what is given as a derivative is one: by differences with a bound of their error."""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence

from mems_impact.hybrid.blaming import Function
from mems_impact.hybrid.tried import Place, Tried

__all__ = ["along", "check_constraint", "check_jacobian", "check_rate", "derivative"]

PART = 2.5e-4  # the step of differences, of the time scale
HOLDS = 1e-5  # of what a constraint changes by where states do by their sizes: it is zero
SLACK = 1e-6  # of the size of a derivative, which no difference is asked to see
CENTRAL = (4.0 / 5.0, -1.0 / 5.0, 4.0 / 105.0, -1.0 / 280.0)  # of order 8
FORWARD = (-25.0 / 12.0, 4.0, -3.0, 4.0 / 3.0, -1.0 / 4.0)  # of order 4


def along(at: Place, slope: Sequence[float], h: float) -> Place:
    """Return the point that lies `h` ahead on the straight line along the flow."""
    return Place(at.mode, at.t + h, [y + h * d for y, d in zip(at.y, slope, strict=True)])


def derivative(values: Sequence[float], h: float) -> tuple[float, float]:
    """Return the derivative amid nine values at distances `h`, and a bound of its error.

    The bound is what formulas of two steps, and of both sides, differ by: a corner shows in it.
    """
    middle = len(values) // 2

    def value(k: int) -> float:
        return values[middle + k]

    fine = math.fsum(w * (value(k) - value(-k)) for k, w in enumerate(CENTRAL, 1)) / h
    coarse = (8.0 * (value(2) - value(-2)) - (value(4) - value(-4))) / (24.0 * h)
    right = math.fsum(w * value(k) for k, w in enumerate(FORWARD)) / h
    left = -math.fsum(w * value(-k) for k, w in enumerate(FORWARD)) / h
    rounding = 64.0 * sys.float_info.epsilon * max(map(abs, values)) / h
    return fine, 4.0 * (abs(fine - coarse) + abs(right - left)) + rounding


def rate_of(
    tried: Tried, i: int, at: Place, slope: Sequence[float], unit: float
) -> tuple[float, float]:
    """Return the rate of a margin by differences along the flow, and a bound of its error."""
    h = PART * unit
    return derivative([tried.margin(i, along(at, slope, k * h)) for k in range(-4, 5)], h)


def check_rate(tried: Tried, i: int, at: Place, slope: Sequence[float], unit: float) -> None:
    """Raise FunctionError unless the given rate of margin `i` is its derivative along the flow."""
    guard = tried.definition.guards[i]
    given = tried.rate(i, at)
    found, error = rate_of(tried, i, at, slope, unit)
    error += SLACK * (abs(found) + abs(given))
    if not abs(given - found) > error:
        return
    if not abs(given - found) > error + rounding_of(tried, i, at, slope, unit):
        return
    assert guard.rate is not None
    where = tried.place(at)
    problem = f"is {given:.6g} where the margin changes at {found:.6g} ({where[3:]})"
    remedy = "return the derivative of the margin along the flow, or give none"
    raise Function("rate", guard.rate, guard.name).error(problem, remedy)


def check_constraint(tried: Tried, i: int, at: Place, slope: Sequence[float], unit: float) -> None:
    """Raise FunctionError unless a constraint is zero in its mode, and stays so along the flow."""
    value, h, size = tried.constraint(i, at), PART * unit, 0.0
    for j, y in enumerate(at.y):
        part = PART * max(abs(y), abs(slope[j]) * unit, 1e-3)
        beside = Place(at.mode, at.t, [*at.y[:j], y + part, *at.y[j + 1 :]])
        by_state = abs(tried.constraint(i, beside) - value) / part
        size = max(size, by_state * max(abs(y), abs(slope[j]) * unit, 1e-3))
    rate, error = derivative(
        [tried.constraint(i, along(at, slope, k * h)) for k in range(-4, 5)], h
    )
    function = Function("constraint", tried.definition.constraints[i][1])
    if abs(value) > HOLDS * size:
        problem = f"is {value:.6g} {tried.place(at)}, and has to be zero in this mode"
        raise function.error(problem, "let transitions into the mode make it zero, and the start")
    if abs(rate) * unit > HOLDS * size + error * unit:
        problem = f"changes at the rate {rate:.6g} {tried.place(at)}, and has to stay zero"
        raise function.error(problem, "let the flow of the mode keep it zero")


def rounding_of(tried: Tried, i: int, at: Place, slope: Sequence[float], unit: float) -> float:
    """Return what the rounding of a state makes of differences of margin `i`.

    A small gap between bodies that are far from the origin is a difference of large numbers.
    """
    here, rounding = tried.margin(i, at), 0.0
    for j, value in enumerate(at.y):
        h = PART * max(abs(value), abs(slope[j]) * unit, 1e-3)
        y = [*at.y[:j], value + h, *at.y[j + 1 :]]
        by_state = (tried.margin(i, Place(at.mode, at.t, y)) - here) / h
        rounding += abs(by_state * value)
    return 64.0 * sys.float_info.epsilon * rounding / (PART * unit)


def check_jacobian(tried: Tried, at: Place, unit: float) -> None:
    """Raise FunctionError unless the given Jacobian is that of the flow."""
    given = tried.jacobian(at)
    slope = tried.flow(at)
    for j in range(tried.n):
        h = PART * max(abs(at.y[j]), abs(slope[j]) * unit, 1e-3)
        columns = []
        for k in range(-4, 5):
            y = [value + k * h * (i == j) for i, value in enumerate(at.y)]
            columns.append(tried.flow(Place(at.mode, at.t, y)))
        for i in range(tried.n):
            found, error = derivative([column[i] for column in columns], h)
            if abs(given[i][j] - found) > error + 1e-3 * (abs(found) + abs(given[i][j])):
                problem = (
                    f"has J[{i}, {j}] = {given[i][j]:.6g} where the flow's is {found:.6g} "
                    f"({tried.place(at)[3:]})"
                )
                remedy = "write the derivative of component i of the flow by state j, or give none"
                function = Function("jacobian", tried.definition.jacobian or tried.definition.flow)
                raise function.error(problem, remedy)
