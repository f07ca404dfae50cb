"""Derivatives of elementary functions, for numbers that carry tangents.

Each rule is the source of an expression over the argument v (or a and b) and the value f, for
numbers and for numbers that carry tangents alike, so that higher derivatives follow from the same
rules.

At a kink the derivative is that of the branch that is executed. Rules of single points: abs(0) and
hypot(0, 0) have the derivative 0; of equal arguments, min and max take the first; where a
derivative is infinite, as of sqrt(0), a tangent of zero stays zero.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

import numpy as np

__all__ = ["BINARY", "PIECEWISE_CONSTANT", "UNARY", "digamma", "of_numpy"]

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
    math.acosh: "1.0 / sqrt((v - 1.0) * (v + 1.0))",
    math.atanh: "1.0 / ((1.0 - v) * (1.0 + v))",
    math.exp: "f",
    math.exp2: "0.6931471805599453 * f",
    math.expm1: "exp(v)",
    math.log: "1.0 / v",
    math.log2: "1.4426950408889634 / v",
    math.log10: "0.4342944819032518 / v",
    math.log1p: "1.0 / (1.0 + v)",
    math.sqrt: "0.5 / f",
    math.cbrt: "1.0 / (3.0 * f * f)",
    math.erf: "1.1283791670955126 * exp(-v * v)",
    math.erfc: "-1.1283791670955126 * exp(-v * v)",
    math.gamma: "f * digamma(v)",
    math.lgamma: "digamma(v)",
    math.radians: "0.017453292519943295",
    math.degrees: "57.29577951308232",
}
"""The derivative of a function of one number."""

BINARY: dict[Callable[..., Any], tuple[str, str]] = {
    math.atan2: ("b / (a * a + b * b)", "-a / (a * a + b * b)"),
    math.hypot: ("0.0 if f == 0.0 else a / f", "0.0 if f == 0.0 else b / f"),
    math.copysign: ("0.0 if a == 0.0 else copysign(1.0, a) * copysign(1.0, b)", "0.0"),
    math.fmod: ("1.0", "floor((f - a) / b + 0.5)"),  # a / b may be rounded to the next integer
    operator.mod: ("1.0", "floor((f - a) / b + 0.5)"),
    operator.pow: ("0.0 if b == 0.0 else b * a ** (b - 1.0)", "f * log(a) if a > 0.0 else 0.0"),
}
"""The derivatives of a function by its two arguments."""

PIECEWISE_CONSTANT = (math.floor, math.ceil, math.trunc, math.isnan, math.isinf, math.isfinite)
"""Functions of a number whose derivative is zero."""


def digamma(x: Any) -> Any:
    """Return the logarithmic derivative of the gamma function."""
    if x < 0.0:
        return digamma_above_zero(1.0 - x) - math.pi / math.tan(math.pi * x)
    return digamma_above_zero(x)


def digamma_above_zero(x: Any) -> Any:
    """Return the same of a positive number, by the asymptotic series (error below 1e-16)."""
    shift = 0.0 * x
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
    found = getattr(np, _NAMES.get(function.__name__, function.__name__), None)
    return found if isinstance(found, np.ufunc) else None
