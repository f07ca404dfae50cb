"""The functions of this room compiled by numba, unchanged."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import cache
from typing import Any

from numba import typeof, types
from numba.extending import overload

from mems_impact.engines.auto import (  # noqa: F401 - give the contract its overloads
    compiled as _auto,
)
from mems_impact.engines.cache import compile_loop
from mems_impact.engines.compiling import INNER, JIT, WORD, address, caller, data, pointer
from mems_impact.engines.cvode import compiled as _cvode  # noqa: F401 - as above
from mems_impact.engines.kernels import call_kernel
from mems_impact.engines.onestep import compiled as _onestep  # noqa: F401 - as above
from mems_impact.engines.snapshot import mark_overloaded, take
from mems_impact.hybrid import gathering, loop, record, settling, stretching

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


mark_overloaded(record.row, record.event_row, record.sample_row, record.event_at, record.sample_at)


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


@overload(record.event_at, jit_options={**JIT, **INNER})
def _event_at(s, i):  # type: ignore[no-untyped-def]
    if _is_clock(s):
        return lambda s, i: pointer(s.events + WORD * (record.HEAD + 2 * s.n) * i)


@overload(record.sample_at, jit_options={**JIT, **INNER})
def _sample_at(s, i):  # type: ignore[no-untyped-def]
    if _is_clock(s):
        return lambda s, i: pointer(s.samples + WORD * (3 + s.n) * i)


mark_overloaded(
    gathering.observe,
    gathering.memo,
    settling.advance,
    settling.numbers_of,
    settling.result_of,
    stretching.run_on,
)
_call_advance = caller(types.int64(types.int64, types.int64, types.int64))


@overload(gathering.observe, jit_options={**JIT, **INNER})
def _observe(engine, w, mode, code, t, states, out):  # type: ignore[no-untyped-def]
    if _is_work(w):

        def implementation(engine, w, mode, code, t, states, out):  # type: ignore[no-untyped-def]
            size, p = engine.parameter_count, engine.parameters
            return call_kernel(w.observe, mode, code, t, data(states), p, size, data(out))

        return implementation


@overload(settling.advance, jit_options={**JIT, **INNER})
def _advance(engine, s, w):  # type: ignore[no-untyped-def]
    if _is_work(w):
        bite = settling.BITE
        return lambda engine, s, w: _call_advance(w.advance, (address(engine), address(s), bite))


@overload(stretching.run_on, jit_options={**JIT, **INNER})
def _run_on(s, w):  # type: ignore[no-untyped-def]
    if isinstance(w, types.Record) and "plain" in w.fields:
        bite = stretching.BITE
        return lambda s, w: _call_advance(w.advance, (w.plain, address(s), bite))


@overload(gathering.memo, jit_options={**JIT, **INNER})
def _memo(w, i):  # type: ignore[no-untyped-def]
    if _is_work(w):
        return lambda w, i: pointer(w.memory + WORD * w.memory_width * i)


@overload(settling.numbers_of, jit_options={**JIT, **INNER})
def _numbers_of(w):  # type: ignore[no-untyped-def]
    if _is_work(w):
        return lambda w: pointer(w.inputs + WORD * w.input_width * w.point)


@overload(settling.result_of, jit_options={**JIT, **INNER})
def _result_of(w):  # type: ignore[no-untyped-def]
    if _is_work(w):
        return lambda w: pointer(w.results + WORD * w.result_width * w.point)


def _is_work(kind: Any) -> bool:
    return isinstance(kind, types.Record) and "observe" in kind.fields


def address_of_loop(handle: Any, clock: Any) -> int:
    """Return where the compiled event loop is, for an engine's record and that of a run.

    As a C function of two addresses and the quota: what calls it need not be compiled with it.
    """
    entry: Any = compiled(loop.advance)
    kinds = typeof(handle), typeof(clock), types.int64
    with _making:
        entry.compile(kinds)
    made = entry.overloads[kinds]
    return int(made.library.get_pointer_to_function(made.fndesc.llvm_cfunc_wrapper_name))
