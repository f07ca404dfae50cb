"""The event loop in compiled code."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import cache
from typing import Any

from numba import from_dtype, typeof, types
from numba.core.imputils import lower_builtin
from numba.core.typing.templates import ConcreteTemplate, infer_global
from numba.extending import overload
from numba.np.arrayobj import make_array

from mems_impact.hybrid.attractors import recurrence
from mems_impact.hybrid.event_loop import loop, workspace
from mems_impact.hybrid.variational import saltation, tangents
from mems_impact.integrators.jit.closures import mark_overloaded, take_snapshot
from mems_impact.integrators.jit.dual_numbers import split_at, vector_at
from mems_impact.integrators.jit.kernels import ENGINE, call_kernel
from mems_impact.integrators.jit.numba_support import (
    FOR_C,
    INNER,
    JIT,
    VECTOR,
    WORD,
    address,
    caller,
    compile_loop,
    data,
    pointer,
    record_at,
    view,
)

_compilation_lock = threading.Lock()  # simultaneous threads compile a loop only once
_engine_at = record_at(from_dtype(ENGINE))


def compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return `function`, written over `integrators.interface`, compiled; it releases the GIL.

    The result takes the address of the engine in its place.
    """
    with _compilation_lock:
        return _compiled(function)


@cache
def _compiled(function: Callable[..., Any]) -> Callable[..., Any]:
    snapshot = take_snapshot(function)
    (frozen,) = snapshot.frozen()
    return compile_loop(frozen, snapshot.name if snapshot.lasting else None, _engine_at)


mark_overloaded(
    workspace.table_row,
    workspace.event_at,
    workspace.sample_at,
)


def _is_clock(kind: Any) -> bool:
    return isinstance(kind, types.Record) and "table" in kind.fields


@overload(workspace.table_row, jit_options={**JIT, **INNER})
def _table_row(s, i):  # type: ignore[no-untyped-def]
    if _is_clock(s):
        return lambda s, i: pointer(s.table + WORD * s.width * i)


@overload(workspace.event_at, jit_options={**JIT, **INNER})
def _event_at(s, i):  # type: ignore[no-untyped-def]
    if _is_clock(s):
        return lambda s, i: pointer(s.events + WORD * (workspace.HEAD + 2 * s.n) * i)


@overload(workspace.sample_at, jit_options={**JIT, **INNER})
def _sample_at(s, i):  # type: ignore[no-untyped-def]
    if _is_clock(s):
        return lambda s, i: pointer(s.samples + WORD * (3 + s.n) * i)


mark_overloaded(
    loop.advance,
    recurrence.observe,
    recurrence.scratch_row,
    recurrence.numbers_of,
    recurrence.result_of,
    saltation.event_tangents,
    tangents.numbers,
    tangents.split_numbers,
    tangents.plain_numbers,
    tangents.evaluate,
)
_call_advance = caller(types.int64(types.int64, types.int64, types.int64))
TANGENTS: dict[str, Any] = {"jit_options": {**FOR_C, **INNER}, "strict": False}


@overload(recurrence.observe, jit_options={**JIT, **INNER})
def _observe(engine, w, mode, code, t, states, out):  # type: ignore[no-untyped-def]
    if _is_work(w):

        def implementation(engine, w, mode, code, t, states, out):  # type: ignore[no-untyped-def]
            size, p = engine.parameter_count, engine.parameters
            return call_kernel(w.observe, mode, code, t, data(states), p, size, data(out))

        return implementation


@overload(loop.advance, jit_options={**JIT, **INNER})
def _advance(engine, s, w, quota):  # type: ignore[no-untyped-def]
    if _is_clock(s):

        def implementation(engine, s, w, quota):  # type: ignore[no-untyped-def]
            return _call_advance(w.advance, (address(engine), address(s), quota))

        return implementation


@overload(saltation.event_tangents, jit_options={**JIT, **INNER})
def _event_tangents(engine, workspace, mode, code, t, y, memory):  # type: ignore[no-untyped-def]
    def implementation(engine, workspace, mode, code, t, y, memory):  # type: ignore[no-untyped-def]
        size, p = engine.parameter_count, engine.parameters
        call_kernel(workspace.tangents, mode, code, t, data(y), p, size, data(memory))

    return implementation


@overload(tangents.numbers, prefer_literal=True, **TANGENTS)
def _numbers(memory, start, count, width):  # type: ignore[no-untyped-def]
    at = vector_at(width.literal_value)
    return lambda memory, start, count, width: at(data(memory) + WORD * start, count)


@overload(tangents.split_numbers, prefer_literal=True, **TANGENTS)
def _split_numbers(values, count, tangents, start, stride, width):  # type: ignore[no-untyped-def]
    at = split_at(width.literal_value)

    def implementation(values, count, tangents, start, stride, width):  # type: ignore[no-untyped-def]
        return at(data(values), count, data(tangents) + WORD * start, WORD * stride)

    return implementation


# No overload, since a function without reference counts must not return a new array.
@infer_global(tangents.plain_numbers)
class _PlainNumbers(ConcreteTemplate):
    cases = (VECTOR(VECTOR, types.int64, types.int64),)


@lower_builtin(tangents.plain_numbers, VECTOR, types.int64, types.int64)
def _plain_numbers(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
    memory, start, count = arguments
    first = builder.gep(make_array(VECTOR)(context, builder, memory).data, [start])
    return view(VECTOR, context, builder, builder.ptrtoint(first, start.type), [count])


@overload(tangents.evaluate, **TANGENTS)
def _evaluate(function, owner, by_differences, arguments, records):  # type: ignore[no-untyped-def]
    def implementation(function, owner, by_differences, arguments, records):  # type: ignore[no-untyped-def]
        function(*arguments)

    return implementation


@overload(recurrence.scratch_row, jit_options={**JIT, **INNER})
def _scratch_row(w, i):  # type: ignore[no-untyped-def]
    if _is_work(w):
        return lambda w, i: pointer(w.memory + WORD * w.memory_width * i)


@overload(recurrence.numbers_of, jit_options={**JIT, **INNER})
def _numbers_of(w):  # type: ignore[no-untyped-def]
    if _is_work(w):
        return lambda w: pointer(w.inputs + WORD * w.input_width * w.point)


@overload(recurrence.result_of, jit_options={**JIT, **INNER})
def _result_of(w):  # type: ignore[no-untyped-def]
    if _is_work(w):
        return lambda w: pointer(w.results + WORD * w.result_width * w.point)


def _is_work(kind: Any) -> bool:
    return isinstance(kind, types.Record) and "observe" in kind.fields


def address_of_loop(clock: Any) -> int:
    """Return the address of the compiled event loop for the type of a clock.

    The driver is a C function of two addresses and the quota, which callers can use without
    recompilation.
    """
    entry: Any = compiled(loop.run_steps)
    kinds = types.int64, typeof(clock), types.int64
    with _compilation_lock:
        entry.compile(kinds)
    result = entry.overloads[kinds]
    return int(result.library.get_pointer_to_function(result.fndesc.llvm_cfunc_wrapper_name))
