"""Derivatives of second and higher order along vectors: of maps by their Jacobian, and of flows."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple, TypeVar

import numpy as np

from mems_impact._util.arrays import Complexes, Floats
from mems_impact.errors import OrbitError

# --- Of maps and equations, by differences of their Jacobian

LARGEST_STEP_RATIO = 0.05  # of the size of the states, of the differences
STEP_RATIO = 0.5  # from one step length to the next
MAX_STEPS = 14
GROWTH = 2.0  # factor by which errors grow where rounding takes over
LINE_POINTS = 4  # on either side, of polynomials along a line
LARGEST_LINE_RATIO = 0.4  # of the size of the states, of the line
JACOBIAN_RTOL = 1e-13  # error of a Jacobian, relative to its largest entry
ROUNDING = 1e-12  # relative error that a derivative has at least
PLAIN_STEP_RATIOS = (2e-4, 1e-5)  # of the size of the states, of a single difference

NOT_DIFFERENTIABLE = "the map near the orbit could not be differentiated"
FARTHER_REMEDY = "take a point farther from a grazing"

Jacobian = Callable[[Floats], Floats]
V = TypeVar("V", Floats, complex)


class DirectionalDerivatives(NamedTuple):
    """Second and third derivatives of a map along a vector u, shape (k, k).

    The errors are estimates for their entries.
    """

    second: Floats  # its product with w is B(u, w)
    third: Floats  # its product with w is C(u, u, w)
    second_error: float
    third_error: float


def directional_derivatives(jacobian: Jacobian, u: Floats, size: float) -> DirectionalDerivatives:
    """Differentiate the Jacobian of a map at zero along `u`.

    Central differences with one extrapolation (Richardson). Of the step lengths, from `size` times
    `LARGEST_STEP_RATIO` down, each derivative takes that at which it changes least. Raises
    OrbitError if the map cannot be evaluated at two steps.
    """
    length = float(np.linalg.norm(u))
    center = jacobian(np.zeros(u.size))
    estimates: list[tuple[Floats, Floats]] = []
    best = [(math.inf, center), (math.inf, center)]
    extrapolated: list[Floats] = []
    h = LARGEST_STEP_RATIO * size / length
    for _ in range(MAX_STEPS):
        try:
            up, down = jacobian(h * u), jacobian(-h * u)
        except OrbitError:
            h *= STEP_RATIO
            continue
        estimates.append(((up - down) / (2.0 * h), (up + down - 2.0 * center) / h**2))
        h *= STEP_RATIO
        if len(estimates) < 2:
            continue
        coarse, fine = estimates[-2:]
        share = STEP_RATIO**2
        new = [(b - share * a) / (1.0 - share) for a, b in zip(coarse, fine, strict=True)]
        if extrapolated:
            # Rounding errors may agree by chance: a linear map has derivatives of that size.
            rounding = JACOBIAN_RTOL * float(np.abs(center).max()) / (h / STEP_RATIO)
            errors = [
                max(float(np.abs(a - b).max()), smallest)
                for a, b, smallest in zip(
                    extrapolated, new, (rounding, rounding * STEP_RATIO / h), strict=True
                )
            ]
            if all(error > GROWTH * kept[0] for error, kept in zip(errors, best, strict=True)):
                break  # rounding grows from here on
            best = [
                (error, value) if error < kept[0] else kept
                for error, value, kept in zip(errors, new, best, strict=True)
            ]
        extrapolated = new
    if not math.isfinite(best[0][0]):
        raise OrbitError(NOT_DIFFERENTIABLE, FARTHER_REMEDY)
    (second_error, second), (third_error, third) = best
    # Steps at which two results agree by chance say nothing of rounding.
    third_error = max(third_error, ROUNDING * float(np.abs(third).max(initial=0.0)))
    second_error = max(
        second_error,
        ROUNDING * float(np.abs(second).max(initial=0.0)),
        third_error * ROUNDING * size,
    )
    return DirectionalDerivatives(second, third, second_error, third_error)


def plain_derivatives(jacobian: Jacobian, u: Floats, size: float) -> DirectionalDerivatives:
    """Differentiate as `directional_derivatives` by one central difference, without its error.

    Raises OrbitError if the map cannot be evaluated at the steps.
    """
    center, length = jacobian(np.zeros(u.size)), float(np.linalg.norm(u))
    for ratio in PLAIN_STEP_RATIOS:
        h = ratio * size / length
        try:
            up, down = jacobian(h * u), jacobian(-h * u)
        except OrbitError:
            continue
        second, third = (up - down) / (2.0 * h), (up + down - 2.0 * center) / h**2
        return DirectionalDerivatives(second, third, math.nan, math.nan)
    raise OrbitError(NOT_DIFFERENTIABLE, FARTHER_REMEDY)


def line_derivatives(jacobian: Jacobian, u: Floats, size: float) -> tuple[Sequence[Floats], float]:
    """Return the first four derivatives of the Jacobian of a map at zero along `u`, and an error.

    The derivatives are those of polynomials through equidistant points on a line, whose length is
    halved until the last derivative changes least. Raises OrbitError if the map cannot be evaluated
    on two lines.
    """
    positions = np.arange(-LINE_POINTS, LINE_POINTS + 1) / LINE_POINTS
    powers = np.linalg.inv(np.vander(positions, increasing=True))[1:5]

    def derivatives(h: float) -> list[Floats]:
        values = np.array([jacobian(h * position * u) for position in positions])
        return [
            math.factorial(k) * np.tensordot(row, values, 1) / h**k
            for k, row in enumerate(powers, 1)
        ]

    longest = LARGEST_LINE_RATIO * size / float(np.linalg.norm(u))
    derivative, error = least_changing(derivatives, longest)
    floor = ROUNDING * max(float(np.abs(each).max()) for each in derivative)
    return derivative, max(error, floor)


def least_changing(
    estimates: Callable[[float], Sequence[V]], length: float
) -> tuple[Sequence[V], float]:
    """Return the estimates at the length at which the last of them changes least, and that change.

    The first length is halved, or doubled if the change grows from there on. Raises OrbitError if
    no two lengths have estimates, arrays or numbers.
    """
    best: tuple[float, Sequence[V]] = (math.inf, [])
    tried: list[Sequence[V]] = []
    for step in range(MAX_STEPS):
        try:
            new = estimates(length * STEP_RATIO**step)
        except OrbitError:
            continue
        tried.append(new)
        if len(tried) > 1:
            error = _change(*tried[-2:])
            if error > GROWTH * best[0]:
                break
            if error < best[0]:
                best = error, new
    if len(tried) > 1 and best[1] is tried[1]:  # rounding grows from the first length on
        shorter = tried[0]
        for step in range(1, MAX_STEPS):
            try:
                longer = estimates(length / STEP_RATIO**step)
            except OrbitError:
                break
            error = _change(shorter, longer)
            if error >= best[0]:
                break
            best, shorter = (error, shorter), longer
            if error <= ROUNDING * float(np.abs(longer[-1]).max()):
                break
    if not best[1]:
        raise OrbitError(NOT_DIFFERENTIABLE, FARTHER_REMEDY)
    return best[1], best[0]


def _change(one: Sequence[V], other: Sequence[V]) -> float:
    """Return the largest difference of the last of two estimates."""
    return float(np.abs(one[-1] - other[-1]).max())


# --- Of flows


def lyapunov_coefficient(
    derivatives: Callable[..., Floats],
    matrix: Floats,
    right: Complexes,
    left: Complexes,
    omega: float,
) -> float:
    """Return the first Lyapunov coefficient of a Hopf point, Re(<p, ...>) / 2.

    ``derivatives(*vectors)`` returns the derivatives by the states, and others after them, of the
    derivative of the flow along one or two vectors. `matrix` is the Jacobian of the flow, shape (n,
    n); `right` and `left` are its eigenvectors of i omega, ``conj(left) right = 1``.
    """
    n = right.size
    u, v = np.array(right.real), np.array(right.imag)
    second = derivatives(u)[:, :n] + 1j * derivatives(v)[:, :n]  # B(q, .)
    third = derivatives(u, u)[:, :n] + derivatives(v, v)[:, :n]  # C(q, conj(q), .)
    mean = -np.linalg.solve(matrix, second @ right.conj())
    double = np.linalg.solve(2j * omega * np.eye(n) - matrix, second @ right)
    terms = third @ right + 2.0 * second @ mean + second.conj() @ double
    return 0.5 * float((left.conj() @ terms).real)
