"""Garbage collection during work that makes many objects."""

import gc
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def pause_collection() -> Iterator[None]:
    """Suspend the garbage collector, for work that makes many objects and few cycles.

    The collector takes a tenth of the time of a compilation, which makes many lasting objects.
    After a compilation it reads these objects repeatedly: a twentieth of the time of a map.
    """
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
