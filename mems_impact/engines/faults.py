"""Where a function of an automaton failed: noted by an engine, told by its driver.

Compiled code that calls a C function hears of no exception. So the call that fails is noted, its
result is no number (a transition leads to no mode), and whatever goes on from there ends. The
driver then makes the same call interpreted, where Python says what it is.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["FLOW", "HEAD", "JACOBIAN", "MARGINS", "NO_MODE", "TRANSITION", "Fault", "fault_in"]

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
    """

    role: int
    mode: int
    code: int
    time: float
    y: NDArray[np.float64]


def fault_in(note: Any) -> Fault | None:
    """Return the call that a note of compiled code tells of, if there is one."""
    if note[0] == 0.0:
        return None
    role, mode, code = (int(number) for number in note[:3])
    return Fault(role, mode, code, float(note[3]), np.array(note[HEAD:]))
