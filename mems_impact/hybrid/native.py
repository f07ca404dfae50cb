"""The functions of this room compiled by numba, unchanged."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from numba import njit

from mems_impact.engines.compiling import JIT, make_callees_compilable
from mems_impact.engines.cvode import (  # noqa: F401 - give the contract its overloads
    compiled as _cvode,
)
from mems_impact.engines.onestep import compiled as _onestep  # noqa: F401 - as above


@cache
def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return `function`, written over the engine's contract, compiled; it releases the GIL.

    The handle of the engine carries the fingerprint of all sources in its type, and so in the key
    of numba's cache on disk.
    """
    make_callees_compilable(function)
    result: Callable[..., Any] = njit(nogil=True, cache=True, **JIT)(function)
    return result
