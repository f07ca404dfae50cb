"""The event loop compiled by numba, from the very functions of `hybrid.loop`."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from mems_impact.cvode import compiled
from mems_impact.hybrid import loop


@cache
def advance() -> Callable[..., int]:
    """Return `loop.advance` as a compiled function that releases the GIL."""
    from numba import njit

    compiled.library.load()
    compiled.make_compilable(loop.advance)
    stamp = compiled.fingerprint()

    @njit(nogil=True, cache=True)
    def compiled_advance(engine, s, y, layout, buffers, quota):  # type: ignore[no-untyped-def]
        _ = stamp
        return loop.advance(engine, s, y, layout, buffers, quota)

    return compiled_advance
