"""The functions of this room compiled by numba, unchanged."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import cache
from typing import Any

from numba import types
from numba.extending import overload

from mems_impact.engines.auto import (  # noqa: F401 - give the contract its overloads
    compiled as _auto,
)
from mems_impact.engines.cache import compile_loop
from mems_impact.engines.compiling import INNER, JIT, WORD, pointer
from mems_impact.engines.cvode import compiled as _cvode  # noqa: F401 - as above
from mems_impact.engines.onestep import compiled as _onestep  # noqa: F401 - as above
from mems_impact.engines.snapshot import mark_overloaded, take
from mems_impact.hybrid import record

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


mark_overloaded(record.row, record.event_row, record.sample_row)


def _is_clock(kind: Any) -> bool:
    return isinstance(kind, types.Record) and "table" in kind.fields


@overload(record.row, jit_options={**JIT, **INNER})
def _row(s, i):  # type: ignore[no-untyped-def]
    if _is_clock(s):
        return lambda s, i: pointer(s.table + WORD * s.width * i)


@overload(record.event_row, jit_options={**JIT, **INNER})
def _event_row(s):  # type: ignore[no-untyped-def]
    if _is_clock(s):
        return lambda s: pointer(s.events + WORD * (record.HEAD + 2 * s.n) * s.rows)


@overload(record.sample_row, jit_options={**JIT, **INNER})
def _sample_row(s):  # type: ignore[no-untyped-def]
    if _is_clock(s):
        return lambda s: pointer(s.samples + WORD * (3 + s.n) * s.taken)
