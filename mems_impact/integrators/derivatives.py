"""Derivatives of elementary functions, for numbers that carry tangents.

Each rule is the source of an expression over the argument v (or a and b) and the value f, for
numbers and for numbers that carry tangents alike, so that higher derivatives follow from the same
rules.

At a kink the derivative is that of the branch that is executed. Rules of single points: abs(0) and
hypot(0, 0) have the derivative 0; of equal arguments, min and max take the first; where a
derivative is infinite, as of sqrt(0) and cbrt(0), or undefined (NaN), as of atan2(0, 0), a tangent
of zero stays zero.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np

UNARY: dict[Callable[..., Any], str] = {
    math.sin: "cos(v)",
    math.cos: "-sin(v)",
    math.tan: "1.0 + f * f",
    math.asin: "1.0 / sqrt((1.0 - v) * (1.0 + v))",
    math.acos: "-1.0 / sqrt((1.0 - v) * (1.0 + v))",
    math.atan: "1.0 / (1.0 + v * v)",
    math.sinh: "cosh(v)",
    math.cosh: "sinh(v)",
    math.tanh: "(1.0 - f) * (1.0 + f) if f * f < 0.5 else (1.0 / cosh(min(abs(v), 350.0))) ** 2",
    math.asinh: "1.0 / hypot(1.0, v)",
    math.acosh: "1.0 / (sqrt(v - 1.0) * sqrt(v + 1.0))",
    math.atanh: "1.0 / ((1.0 - v) * (1.0 + v))",
    math.exp: "f",
    math.exp2: "0.6931471805599453 * f",
    math.expm1: "exp(v)",
    math.log: "1.0 / v",
    math.log2: "1.4426950408889634 / v",
    math.log10: "0.4342944819032518 / v",
    math.log1p: "1.0 / (1.0 + v)",
    math.sqrt: "0.5 / abs(f)",
    math.cbrt: "1.0 / (3.0 * f * f)",
    math.erf: "1.1283791670955126 * exp(-v * v)",
    math.erfc: "-1.1283791670955126 * exp(-v * v)",
    math.gamma: "f * digamma(v)",
    math.lgamma: "digamma(v)",
    math.radians: "0.017453292519943295",
    math.degrees: "57.29577951308232",
    np.reciprocal: "-f * f",
}
"""The derivative of a function of one number."""

BINARY: dict[Callable[..., Any], tuple[str, str]] = {
    math.atan2: ("b / hypot(a, b) / hypot(a, b)", "-a / hypot(a, b) / hypot(a, b)"),
    math.hypot: ("0.0 if f == 0.0 else a / f", "0.0 if f == 0.0 else b / f"),
    math.copysign: ("0.0 if a == 0.0 else copysign(1.0, a) * copysign(1.0, b)", "0.0"),
    math.fmod: ("1.0", "floor((f - a) / b + 0.5)"),  # a / b may be rounded to the next integer
    operator.mod: ("1.0", "floor((f - a) / b + 0.5)"),
    operator.pow: ("0.0 if b == 0.0 else b * a ** (b - 1.0)", "f * log(a) if a > 0.0 else 0.0"),
    np.divide: ("1.0 / b", "-f / b"),
    np.logaddexp: ("exp(a - f)", "exp(b - f)"),
    np.logaddexp2: ("exp2(a - f)", "exp2(b - f)"),
}
"""The derivatives of a function by its two arguments."""
BINARY[np.float_power] = BINARY[operator.pow]

PIECEWISE_CONSTANT: tuple[Any, ...] = (
    *(math.floor, math.ceil, math.trunc, math.isnan, math.isinf, math.isfinite),
    *(np.rint, np.sign, np.signbit, np.spacing),
)
"""Functions of a number whose derivative is zero."""

EXPRESSIONS: dict[Callable[..., Any], str] = {
    np.add: "x + y",
    np.subtract: "x - y",
    np.multiply: "x * y",
    np.negative: "-x",
    np.positive: "x",
    np.conjugate: "x",
    np.square: "x * x",
    np.absolute: "abs(x)",
    np.fabs: "abs(x)",
    np.deg2rad: "radians(x)",
    np.rad2deg: "degrees(x)",
    np.maximum: "x if x >= y or x != x else y",
    np.minimum: "x if x <= y or x != x else y",
    np.fmax: "x if x >= y or y != y else y",
    np.fmin: "x if x <= y or y != y else y",
    np.heaviside: "0.0 if x < 0.0 else 1.0 if x > 0.0 else y if x == 0.0 else x",
    np.less: "x < y",
    np.less_equal: "x <= y",
    np.greater: "x > y",
    np.greater_equal: "x >= y",
    np.equal: "x == y",
    np.not_equal: "x != y",
    np.logical_not: "not bool(x)",
    np.logical_and: "bool(x) and bool(y)",
    np.logical_or: "bool(x) or bool(y)",
}
"""Functions of NumPy in terms of others."""


def digamma(x: Any) -> Any:
    """Return the logarithmic derivative of the gamma function."""
    if x < 0.0:
        return digamma_above_zero(1.0 - x) - math.pi / math.tan(math.pi * x)
    return digamma_above_zero(x)


def digamma_above_zero(x: Any) -> Any:
    """Return the same of a positive number, by the asymptotic series (error below 1e-16)."""
    shift = 0.0
    while x < 10.0:
        shift -= 1.0 / x
        x += 1.0
    s = 1.0 / (x * x)
    series = s * (
        1 / 12 - s * (1 / 120 - s * (1 / 252 - s * (1 / 240 - s * (1 / 132 - s * 691 / 32760))))
    )
    return shift + math.log(x) - 0.5 / x - series


# Functions of NumPy with other names than those of `math`.
_NAMES = {
    "acos": "arccos", "acosh": "arccosh", "asin": "arcsin", "asinh": "arcsinh", "atan": "arctan",
    "atan2": "arctan2", "atanh": "arctanh", "pow": "power",
}  # fmt: skip


def of_numpy(function: Callable[..., Any]) -> Any:
    """Return NumPy's function for one of `math`, or None."""
    if isinstance(function, np.ufunc):
        return None
    found = getattr(np, _NAMES.get(function.__name__, function.__name__), None)
    return found if isinstance(found, np.ufunc) else None
