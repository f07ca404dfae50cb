"""Random expressions, some of which Python cannot evaluate: compiled against Python.

A compiled function gives the number of Python, or fails. Expressions have comparisons, minima and
arctangents, which take infinity and nan for numbers.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit
from numba.core.errors import NumbaError

from mems_impact.integrators.jit.closures import take_snapshot
from mems_impact.integrators.jit.numba_support import JIT
from validation.campaign.comparing import Unit, Verdict

VALUES = (0.0, -0.0, 1.0, -1.0, 0.5, -2.5, 3.7, 40.0, -750.0, 1e-200, 1e160)
LEAVES = ("x", "y", "0.0", "1.0", "2", "-3", "0.5", "1e3")
BINARY = ("+", "-", "*", "/", "/", "**", "%", "//")
FUNCTIONS = (
    "acos", "acosh", "asin", "asinh", "atan", "atanh", "cos", "cosh", "exp", "exp2", "expm1", "log",
    "log10", "log1p", "log2", "sin", "sinh", "sqrt", "tan", "tanh",
)  # fmt: skip
DEPTH = 3
RTOL = 1e-11  # of two libraries' rounding errors, amplified by the expression


def drawn(rng: np.random.Generator, depth: int = DEPTH) -> str:
    """Draw an expression of x and y."""
    if depth == 0:
        return str(rng.choice(LEAVES))
    a, b = drawn(rng, depth - 1), drawn(rng, depth - 1)
    kind = rng.random()
    if kind < 0.4:
        if rng.random() < 0.1:
            return f"({a}) ** {rng.choice([2, 3, -1, 0.5])}"
        return f"({a} {rng.choice(BINARY)} ({b}))"
    if kind < 0.65:
        return f"math.{rng.choice(FUNCTIONS)}({a})"
    if kind < 0.7:
        return f"math.{rng.choice(['fmod', 'log', 'pow', 'remainder'])}({a}, {b})"
    if kind < 0.8:
        return f"{rng.choice(['min', 'max'])}(1.0 * ({a}), {b})"
    if kind < 0.9:
        return f"math.atan({a} / ({b}))"
    return f"(1.0 if {a} < {b} else {rng.choice(LEAVES)} * 1.0)"


def value_of(function: Callable[..., Any], *arguments: float) -> float | None:
    """Return a real value; None if there is none."""
    try:
        value = function(*arguments)
    except (ArithmeticError, ValueError, StopIteration, TypeError):  # complex numbers compare not
        return None
    return None if isinstance(value, complex) else float(value)


def differ(value: float | None, right: float | None) -> bool:
    """Return whether a compiled number is not Python's."""
    if value is None or (right is not None and math.isnan(right) and math.isnan(value)):
        return False
    return right is None or not (value == right or math.isclose(value, right, rel_tol=RTOL))


def check(seed: int, number: int, unit: Unit) -> Verdict:
    """Try a case; its events are the numbers that agree."""
    expression = drawn(np.random.default_rng([seed, number, 7]))
    space: dict[str, Any] = {"math": math}
    exec(f"def function(x, y):\n    return 1.0 * ({expression})\n", space)
    function, verdict = space["function"], Verdict("expressions", number)
    machine = njit(**JIT)(take_snapshot(function).frozen()[0])
    for x, y in itertools.product(VALUES, VALUES):
        right = value_of(function, x, y)
        try:
            value = value_of(machine, x, y)
        except (NumbaError, NotImplementedError):  # complex constants
            break
        verdict.events += value is not None
        if differ(value, right):
            verdict.story = f"{expression} at {x}, {y}: {value}, not {right}"
    return verdict
