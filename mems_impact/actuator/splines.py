"""Shape-preserving splines through tables, and their evaluation in compiled equations."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.actuator.terms.base import Function

MIN_POINTS = 4
COEFFICIENTS = 6  # of an interval
BEYOND_RATIO = 0.125  # of the length of a table, over which it is continued by a cubic
MAX_SLOPE_RATIO = 1.25  # of a slope to the adjacent secants, below which an interval is monotone


@lru_cache(maxsize=64)
def coefficients(x: tuple[float, ...], y: tuple[float, ...]) -> tuple[float, ...]:
    """Return the coefficients of the spline through a table, six per interval.

    The coefficients belong to the powers of (x - x_i)/(x_i+1 - x_i), the lowest first. The spline
    is the interpolant of degree 5 (3 with fewer than six points) whose first four derivatives are
    continuous. Where it is not monotone although the table is, slopes and second derivatives at the
    adjacent points are replaced by a limited slope and zero: only two derivatives are continuous
    there. `x` is ascending, of `MIN_POINTS` or more.
    """
    from scipy.interpolate import make_interp_spline

    origin, length, size = x[0], x[-1] - x[0], max(map(abs, y)) or 1.0
    points, values = (np.array(x) - origin) / length, np.array(y) / size
    spline = make_interp_spline(points, values, k=5 if len(x) > 5 else 3)
    slopes, curvatures = spline(points, 1), spline(points, 2)
    _preserve_shape(np.diff(points), np.diff(values), slopes, curvatures)
    h = np.diff(points)
    first, second = h * slopes[:-1], 0.5 * h**2 * curvatures[:-1]
    value_residual = np.diff(values) - first - second
    slope_residual = h * slopes[1:] - first - 2.0 * second
    curvature_residual = h**2 * curvatures[1:] - 2.0 * second
    columns = (
        values[:-1],
        first,
        second,
        10.0 * value_residual - 4.0 * slope_residual + 0.5 * curvature_residual,
        -15.0 * value_residual + 7.0 * slope_residual - curvature_residual,
        6.0 * value_residual - 3.0 * slope_residual + 0.5 * curvature_residual,
    )
    return tuple((size * np.column_stack(columns)).ravel().tolist())


def _preserve_shape(h: Floats, rises: Floats, slopes: Floats, curvatures: Floats) -> None:
    """Change slopes and second derivatives where the spline is not monotone but the table is.

    An interval is monotone if the differences of its Bernstein coefficients have one sign. With
    second derivatives of zero that holds for slopes up to 5/4 of the secant.
    """
    signs = np.sign(rises)
    padded_signs = np.concatenate([signs[:1], signs, signs[-1:]])
    is_monotone = (padded_signs[:-2] == signs) & (padded_signs[2:] == signs) | (signs == 0.0)
    limited_slopes = _limited_slopes(h, rises)
    is_limited = np.zeros(slopes.size, dtype=bool)
    while True:
        first, last = h * slopes[:-1] / 5.0, h * slopes[1:] / 5.0
        left, right = h**2 * curvatures[:-1] / 20.0, h**2 * curvatures[1:] / 20.0
        steps = np.array(
            [first, first + left, rises - 2.0 * (first + last) + right - left, last - right, last]
        )
        is_violated = np.where(
            signs == 0.0, np.abs(steps).max(axis=0) > 0.0, (signs * steps).min(axis=0) < 0.0
        )
        intervals = np.flatnonzero(is_violated & is_monotone & ~(is_limited[:-1] & is_limited[1:]))
        if intervals.size == 0:
            return
        for i in (*intervals, *(intervals + 1)):
            is_limited[i], slopes[i], curvatures[i] = True, limited_slopes[i], 0.0


def _limited_slopes(h: Floats, rises: Floats) -> Floats:
    """Return the slopes of Fritsch and Butland, limited; at the ends, as if the table went on."""
    from scipy.interpolate import PchipInterpolator

    gaps, changes = (np.concatenate([each[:1], each, each[-1:]]) for each in (h, rises))
    x, y = (np.append(0.0, np.cumsum(each)) for each in (gaps, changes))
    secants = np.abs(changes / gaps)
    bound = MAX_SLOPE_RATIO * np.minimum(secants[:-1], secants[1:])
    slopes: Floats = np.clip(PchipInterpolator(x, y).derivative()(x[1:-1]), -bound, bound)
    return slopes


class TableSpline(NamedTuple):
    """A spline through a table, as functions ``f(x, p)`` for numba.

    Beyond the table it is continued by its Taylor polynomial of third order over an eighth of the
    table, and then by a tangent: a step that ends at a stopper has trial points beyond it, and
    differences of derivatives too.
    """

    value: Function
    slope: Function
    integral: Function  # from the first point


def spline_functions(points: int, polynomials: int, count: int) -> TableSpline:
    """Return the spline through a table of `count` points.

    `points` and `polynomials` are the first indices in ``p`` of the points and their
    `coefficients`.
    """
    last = count - 1

    def interval_of(x, p):  # type: ignore[no-untyped-def]
        low, high = 0, last
        while high - low > 1:
            middle = (low + high) // 2
            if x >= p[points + middle]:
                low = middle
            else:
                high = middle
        return low

    def locate(x, p):  # type: ignore[no-untyped-def]
        # Interval, position in it from 0 to 1, its length, and the distances beyond the table along
        # the Taylor polynomial and along its tangent.
        x_table = min(max(x, p[points]), p[points + last])
        low = interval_of(x_table, p)
        h = p[points + low + 1] - p[points + low]
        max_offset = BEYOND_RATIO * (p[points + last] - p[points])
        cubic_offset = min(max(x - x_table, -max_offset), max_offset)
        return low, (x_table - p[points + low]) / h, h, cubic_offset, x - x_table - cubic_offset

    def taylor(i, u, p):  # type: ignore[no-untyped-def]
        # Value and derivatives by the position in the interval, over their factorials.
        c = polynomials + COEFFICIENTS * i
        value, first, second, third = p[c + 5], 0.0, 0.0, 0.0
        for k in range(4, -1, -1):
            third = third * u + second
            second = second * u + first
            first = first * u + value
            value = value * u + p[c + k]
        return value, first, second, third

    def value(x, p):  # type: ignore[no-untyped-def]
        i, u, h, cubic_offset, linear_offset = locate(x, p)
        a, b, c, d = taylor(i, u, p)
        s = cubic_offset / h
        tangent = (b + s * (2.0 * c + s * 3.0 * d)) / h
        return a + s * (b + s * (c + s * d)) + linear_offset * tangent

    def slope(x, p):  # type: ignore[no-untyped-def]
        i, u, h, cubic_offset, _ = locate(x, p)
        _, b, c, d = taylor(i, u, p)
        s = cubic_offset / h
        return (b + s * (2.0 * c + s * 3.0 * d)) / h

    def interval_integral(i, u, p):  # type: ignore[no-untyped-def]
        c = polynomials + COEFFICIENTS * i
        result = 0.0
        for k in range(5, -1, -1):
            result = (result + p[c + k] / (k + 1.0)) * u
        return result * (p[points + i + 1] - p[points + i])

    def integral(x, p):  # type: ignore[no-untyped-def]
        i, u, h, cubic_offset, linear_offset = locate(x, p)
        total = interval_integral(i, u, p)
        for j in range(i):
            total += interval_integral(j, 1.0, p)
        a, b, c, d = taylor(i, u, p)
        s = cubic_offset / h
        total += cubic_offset * (a + s * (b / 2.0 + s * (c / 3.0 + s * d / 4.0)))
        end = a + s * (b + s * (c + s * d))
        return total + linear_offset * (
            end + 0.5 * linear_offset * (b + s * (2.0 * c + s * 3.0 * d)) / h
        )

    return TableSpline(value, slope, integral)
