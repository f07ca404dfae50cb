"""The event loop compiled by numba, from the very functions of `hybrid.loop`."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from numba import njit

from mems_impact.cvode import (  # noqa: F401 - compiled gives the contract its overloads
    compiled,
    library,
)
from mems_impact.cvode.compiling import JIT, make_callees_compilable
from mems_impact.hybrid import loop


@cache
def advance() -> Callable[..., int]:
    """Return `loop.advance` as a compiled function that releases the GIL."""
    library.load()
    make_callees_compilable(loop.advance)
    compiled_advance: Callable[..., int] = njit(nogil=True, cache=True, **JIT)(loop.advance)
    return compiled_advance
