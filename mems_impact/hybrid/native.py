"""The functions of this room compiled by numba, unchanged."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import cache
from typing import Any

from mems_impact.engines.cache import compile_loop
from mems_impact.engines.cvode import (  # noqa: F401 - give the contract its overloads
    compiled as _cvode,
)
from mems_impact.engines.onestep import compiled as _onestep  # noqa: F401 - as above
from mems_impact.engines.snapshot import take

_making = threading.Lock()  # threads that start together want the same loop, compiled once


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return `function`, written over the engine's contract, compiled; it releases the GIL."""
    with _making:
        return _compiled(function)


@cache
def _compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    snapshot = take(function)
    (frozen,) = snapshot.frozen()
    return compile_loop(frozen, snapshot.name if snapshot.lasting else None)
