"""The functions of an automaton as an interpreted engine calls them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mems_impact.engines.equations import Equations

# What Python raises where compiled code goes on with infinity or not-a-number.
_DOMAIN = (ArithmeticError, ValueError)


def scalars(y: Any, n: int) -> list[float]:
    """Return the first `n` numbers of a list or array, for Python to read: out of a list."""
    return y[:n] if isinstance(y, list) else y[:n].tolist()


def _real(values: list[Any]) -> list[float]:
    try:
        return [float(value) for value in values]
    except TypeError:  # a root of a negative number is complex
        return [math.nan] * len(values)


class Functions:
    """The part of the contract of `mems_impact.engines.contract` that no method changes.

    Parameters
    ----------
    equations : Equations
    """

    def __init__(self, equations: Equations) -> None:
        self._flow, self._margins = equations.flow, equations.margins
        self._transition = equations.transition
        self.n, self.m = equations.n, equations.m
        self.parameters: list[float] = np.asarray(equations.parameters, dtype=float).tolist()
        self.bias = np.zeros(equations.m)

    def flow(self, mode: int, t: float, y: Any, dy: Any) -> None:
        """Write the derivative of the state in `mode` into `dy`."""
        n = self.n
        slope = [0.0] * n
        try:
            self._flow(mode, t, scalars(y, n), self.parameters, slope)
        except _DOMAIN:
            slope = [math.nan] * n
        dy[:n] = _real(slope)

    def margins(self, mode: int, t: float, y: Any, out: Any) -> None:
        """Write the m margins, then their m rates, into `out`."""
        m = self.m
        g, r = [1.0] * m, [1.0] * m
        try:
            self._margins(mode, t, scalars(y, self.n), self.parameters, g, r)
        except _DOMAIN:
            g = r = [math.nan] * m
        out[: 2 * m] = _real(g) + _real(r)

    def transition(self, mode: int, code: int, t: float, y: Any) -> int:
        """Apply the transition `code`, changing `y` in place; return the new mode."""
        after = np.array(y[: self.n])  # what it may compute beyond the numbers does not raise
        mode = int(self._transition(mode, code, t, after, self.parameters))
        y[: self.n] = after.tolist()
        return mode
