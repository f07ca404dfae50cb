"""Interpreted evaluation of flow, margins and transitions; the record of a fault.

Exceptions do not pass through compiled C functions. So a failed call is recorded, and its result is
nan (or an invalid mode), which ends the run. The driver then repeats the call interpreted, where
Python raises the exception.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mems_impact.integrators.interface import Equations, SingleMethodEngine

# --- Faults

FLOW, MARGINS, TRANSITION = 1, 2, 3
HEAD = 4  # values of a fault record before the state
NO_MODE = -(2**31)  # result of a transition that failed


class Fault(NamedTuple):
    """A call that failed, with the exception of an interpreted call."""

    role: int  # FLOW, MARGINS or TRANSITION
    mode: int
    code: int
    time: float
    y: NDArray[np.float64]
    error: Exception | None = None


def recorded_fault(record: Any) -> Fault | None:
    """Return the failed call that compiled code has recorded, or None."""
    if record[0] == 0.0:
        return None
    role, mode, code = (int(number) for number in record[:3])
    return Fault(role, mode, code, float(record[3]), np.array(record[HEAD:]))


# --- Interpreted calls

# Exceptions where a function is undefined; margins and flow are nan there.
_DOMAIN = (ArithmeticError, ValueError)


def scalars(y: Any, n: int) -> list[float]:
    """Return the first `n` values of a list or array as a list of Python floats."""
    return list(map(float, y[:n])) if isinstance(y, list) else y[:n].tolist()


def _real(values: list[Any]) -> list[float]:
    # A root of a negative number is complex.
    return [math.nan if isinstance(value, complex) else float(value) for value in values]


def apply_transition(
    transition: Callable[..., Any], mode: int, code: int, t: float, y: list[float], p: list[float]
) -> tuple[int, list[float]]:
    """Return mode and state after a transition."""
    arguments = int(mode), int(code), float(t)
    new_state: Any = list(y)
    new_mode = transition(*arguments, new_state, p)
    return int(new_mode), [float(value) for value in new_state]


class Functions(SingleMethodEngine):
    """The methods of an interpreted engine that are common to all integration methods.

    Functions receive Python floats: NumPy scalars are slow, and do not support all operations (for
    example, the difference of booleans).
    """

    def __init__(self, equations: Equations) -> None:
        self._flow, self._margins = equations.flow, equations.margins
        self._transition = equations.transition
        self.n, self.m = equations.n, equations.m
        self.states, self.perturbations = equations.states, equations.perturbations
        self.interpolated = equations.interpolated
        self.parameters: list[float] = np.asarray(equations.parameters, dtype=float).tolist()
        self.bias = np.zeros(2 * equations.m)
        self.approach_search = 1
        self._fault: Fault | None = None

    def method_memory(self, mode: int) -> int:
        """Return 0: a single method has no memory."""
        return 0

    def fault(self) -> Fault | None:
        """Return the first failed call, and clear the record."""
        fault, self._fault = self._fault, None
        return fault

    def record_fault(
        self, error: Exception, role: int, mode: int, code: int, t: float, y: Any
    ) -> None:
        """Record a failed call, if it is the first."""
        if self._fault is None:
            state = np.array(y[: self.n], dtype=float)
            self._fault = Fault(role, int(mode), int(code), float(t), state, error)

    def flow(self, mode: int, t: float, y: Any, dy: Any) -> None:
        """Write the derivative of the state in `mode` into `dy`."""
        n = self.n
        slope = [math.nan] * n  # reveals unwritten components
        try:
            self._flow(int(mode), float(t), scalars(y, n), self.parameters, slope)
            dy[:n] = _real(slope)
        except _DOMAIN:
            dy[:n] = [math.nan] * n
        except Exception as error:
            self.record_fault(error, FLOW, mode, 0, t, y)
            dy[:n] = [math.nan] * n

    def margins(self, mode: int, t: float, y: Any, out: Any) -> None:
        """Write the m margins, then their m rates, into `out`."""
        m = self.m
        g, r = [1.0] * m, [1.0] * m
        try:
            self._margins(int(mode), float(t), scalars(y, self.states), self.parameters, g, r)
            out[: 2 * m] = _real(g) + _real(r)
        except _DOMAIN:
            out[: 2 * m] = [math.nan] * (2 * m)
        except Exception as error:
            self.record_fault(error, MARGINS, mode, 0, t, y)
            out[: 2 * m] = [math.nan] * (2 * m)

    def transition(self, mode: int, code: int, t: float, y: Any) -> int:
        """Apply the transition `code`, changing `y` in place; return the new mode."""
        state = scalars(y, self.states)
        try:
            mode, new_state = apply_transition(
                self._transition, mode, code, t, state, self.parameters
            )
        except Exception as error:
            self.record_fault(error, TRANSITION, mode, code, t, y)
            return NO_MODE
        y[: self.states] = new_state
        return mode
