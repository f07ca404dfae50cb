"""Interpreted evaluation of flow, margins and transitions; the record of a fault.

Compiled code that calls a C function hears of no exception. So the call that fails is noted, its
result is no number (a transition leads to no mode), and whatever goes on from there ends. The
driver then makes the same call interpreted, where Python says what it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mems_impact.integrators.interface import Engine, Equations

__all__ = [
    "FLOW",
    "HEAD",
    "JACOBIAN",
    "MARGINS",
    "NO_MODE",
    "TRANSITION",
    "Fault",
    "carry_out",
    "fault_in",
]

# --- Where a function of an automaton failed: noted by an engine, told by its driver.

FLOW, MARGINS, TRANSITION, JACOBIAN = 1, 2, 3, 4
HEAD = 4  # numbers of a note, before the state
NO_MODE = -(2**31)  # where a transition leads that failed


class Fault(NamedTuple):
    """A call that failed.

    Attributes
    ----------
    role : int
        FLOW, MARGINS, TRANSITION or JACOBIAN.
    mode, code : int
    time : float
    y : float array, shape (n,)
    error : Exception or None
        What an interpreted call raised.
    """

    role: int
    mode: int
    code: int
    time: float
    y: NDArray[np.float64]
    error: Exception | None = None


def fault_in(note: Any) -> Fault | None:
    """Return the call that a note of compiled code tells of, if there is one."""
    if note[0] == 0.0:
        return None
    role, mode, code = (int(number) for number in note[:3])
    return Fault(role, mode, code, float(note[3]), np.array(note[HEAD:]))


# --- The functions of an automaton as an interpreted engine calls them.

# What Python raises where compiled code goes on with infinity or not-a-number.
_DOMAIN = (ArithmeticError, ValueError)


def scalars(y: Any, n: int) -> list[float]:
    """Return the first `n` numbers of a list or array as a list of Python's own."""
    return list(map(float, y[:n])) if isinstance(y, list) else y[:n].tolist()


def _real(values: list[Any]) -> list[float]:
    # A root of a negative number is complex.
    return [math.nan if isinstance(value, complex) else float(value) for value in values]


def carry_out(
    transition: Callable[..., Any], mode: int, code: int, t: float, y: list[float], p: list[float]
) -> tuple[int, list[float]]:
    """Return mode and state after a transition."""
    arguments = int(mode), int(code), float(t)
    after: Any = list(y)
    try:
        into = transition(*arguments, after, p)
    except _DOMAIN:
        # NumPy's numbers go on with infinity, as compiled code does: it may come to a number again.
        after = np.array(y)
        into = transition(*arguments, after, p)
    return int(into), [float(value) for value in after]


class Functions(Engine):
    """The part of the contract of `mems_impact.integrators.interface` that no method changes.

    Functions get numbers of Python alone: those of NumPy are slow one by one, and not all that
    Python takes does with them (booleans, say, are not subtracted).

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
        self._fault: Fault | None = None

    def remembered(self, mode: int) -> int:
        """Return what has been learnt of `mode`: nothing."""
        return 0

    def fault(self) -> Fault | None:
        """Return the first call of a function that failed, and forget it."""
        fault, self._fault = self._fault, None
        return fault

    def note(self, error: Exception, role: int, mode: int, code: int, t: float, y: Any) -> None:
        """Note a call that failed, if it is the first."""
        if self._fault is None:
            state = np.array(y[: self.n], dtype=float)
            self._fault = Fault(role, int(mode), int(code), float(t), state, error)

    def flow(self, mode: int, t: float, y: Any, dy: Any) -> None:
        """Write the derivative of the state in `mode` into `dy`."""
        n = self.n
        slope = [math.nan] * n  # what is never written is found out
        try:
            self._flow(int(mode), float(t), scalars(y, n), self.parameters, slope)
            dy[:n] = _real(slope)
        except _DOMAIN:
            dy[:n] = [math.nan] * n
        except Exception as error:
            self.note(error, FLOW, mode, 0, t, y)
            dy[:n] = [math.nan] * n

    def margins(self, mode: int, t: float, y: Any, out: Any) -> None:
        """Write the m margins, then their m rates, into `out`."""
        m = self.m
        g, r = [1.0] * m, [1.0] * m
        try:
            self._margins(int(mode), float(t), scalars(y, self.n), self.parameters, g, r)
            out[: 2 * m] = _real(g) + _real(r)
        except _DOMAIN:
            out[: 2 * m] = [math.nan] * (2 * m)
        except Exception as error:
            self.note(error, MARGINS, mode, 0, t, y)
            out[: 2 * m] = [math.nan] * (2 * m)

    def transition(self, mode: int, code: int, t: float, y: Any) -> int:
        """Apply the transition `code`, changing `y` in place; return the new mode."""
        before = scalars(y, self.n)
        try:
            mode, after = carry_out(self._transition, mode, code, t, before, self.parameters)
        except Exception as error:
            self.note(error, TRANSITION, mode, code, t, y)
            return NO_MODE
        y[: self.n] = after
        return mode
