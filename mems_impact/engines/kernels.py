"""Compiled C functions: those of an automaton, and the callbacks through which CVODE calls them."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import from_dtype, types
from numba.extending import intrinsic

from mems_impact.engines.cache import compile_callback
from mems_impact.engines.compiling import WORD, array, matrix, pointer
from mems_impact.engines.cvode import library
from mems_impact.engines.snapshot import Snapshot, sources, take

_data = library.symbol("N_VGetArrayPointer_Serial")
_matrix_data = library.symbol("SUNDenseMatrix_Data")

# One signature for all functions of an automaton, arrays being addresses:
# kernel(mode, code, t, y, parameters, number of parameters, out) -> mode
_word, _real = types.int64, types.float64
KERNEL = _word(_word, _word, _real, _word, _word, _word, _word)
CALLBACK = types.int32(types.float64, types.intp, types.intp, types.intp)
JACOBIAN_CALLBACK = types.int32(types.float64, *[types.intp] * 7)


# What compiled code needs of an engine: addresses and numbers. A record is one pointer to numba,
# and lies where CVODE's callbacks find it as user data.
HANDLE = np.dtype(
    [
        ("cvode", np.int64),
        ("vector", np.int64),  # N_Vector around y
        ("dense", np.int64),  # N_Vector around spare
        ("y", np.int64),
        ("spare", np.int64),
        ("fired", np.int64),
        ("bias", np.int64),
        ("parameters", np.int64),
        ("flow", np.int64),
        ("margins", np.int64),
        ("transition", np.int64),
        ("jacobian", np.int64),
        ("n", np.int64),
        ("m", np.int64),
        ("parameter_count", np.int64),
        ("t", np.float64),
        ("mode", np.int64),
        ("last_instant", np.float64),
        ("section", np.int64),  # component, -1 for none
        ("level", np.float64),
    ],
    align=True,
)
HANDLE_TYPE = from_dtype(HANDLE)


@intrinsic
def _handle(_typing: Any, address: Any) -> Any:
    """Turn an address into the HANDLE there."""

    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], context.get_value_type(HANDLE_TYPE))

    return HANDLE_TYPE(types.int64), codegen


@intrinsic
def call_kernel(
    _typing: Any,
    address: Any,
    mode: Any,
    code: Any,
    t: Any,
    y: Any,
    parameters: Any,
    size: Any,
    out: Any,
) -> Any:
    """Call the kernel at `address`."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        word, real = ir.IntType(64), ir.DoubleType()
        function = ir.FunctionType(word, [word, word, real, word, word, word, word])
        return builder.call(builder.inttoptr(args[0], function.as_pointer()), args[1:])

    return types.int64(types.int64, *KERNEL.args), codegen


class Kernels(NamedTuple):
    """The functions of an automaton as C functions; keep it as long as an engine uses it."""

    flow: Any
    margins: Any
    transition: Any


# One compilation at a time: threads that start together want the same kernels.
_compiling = threading.RLock()


def kernels(
    flow: Callable[..., Any],
    margins: Callable[..., Any],
    transition: Callable[..., Any],
    n: int,
    m: int,
) -> Kernels:
    """Compile the functions of an automaton with `n` states and `m` guards to C functions.

    They are compiled anew if anything that they draw on has changed since.
    """
    snapshot = take(flow, margins, transition)
    with _compiling:
        return _kernels(snapshot, n, m)


@cache
def _kernels(snapshot: Snapshot, n: int, m: int) -> Kernels:
    flow, margins, transition = snapshot.frozen()

    def flow_kernel(mode, code, t, y, p, size, out):  # type: ignore[no-untyped-def]
        flow(mode, t, array(y, n), array(p, size), array(out, n))
        return mode

    def margins_kernel(mode, code, t, y, p, size, out):  # type: ignore[no-untyped-def]
        g, r = array(out, m), array(out + WORD * m, m)
        for i in range(m):
            g[i] = 1.0
            r[i] = 1.0
        margins(mode, t, array(y, n), array(p, size), g, r)
        return mode

    def transition_kernel(mode, code, t, y, p, size, out):  # type: ignore[no-untyped-def]
        return transition(mode, code, t, array(y, n), array(p, size))

    name = f"{snapshot.name}_{n}_{m}"
    return Kernels(
        _kernel(flow_kernel, name, snapshot.lasting),
        _kernel(margins_kernel, name, snapshot.lasting),
        _kernel(transition_kernel, name, snapshot.lasting),
    )


def jacobian_of(jacobian: Callable[..., Any], n: int) -> Any:
    """Compile the Jacobian of an automaton with `n` states to a C function; BDF alone needs it."""
    snapshot = take(jacobian)
    with _compiling:
        return _jacobian(snapshot, n)


@cache
def _jacobian(snapshot: Snapshot, n: int) -> Any:
    (jacobian,) = snapshot.frozen()

    def jacobian_kernel(mode, code, t, y, p, size, out):  # type: ignore[no-untyped-def]
        jacobian(mode, t, array(y, n), array(p, size), matrix(out, n))
        return mode

    return _kernel(jacobian_kernel, f"{snapshot.name}_{n}", snapshot.lasting)


def _kernel(function: Callable[..., Any], name: str, lasting: bool) -> Any:
    # Symbols of compiled code carry this name: automata that meet in a process must not share.
    function.__qualname__ += f"_{name}"
    return compile_callback(function, KERNEL, name if lasting else None)


class Callbacks(NamedTuple):
    """What CVODE calls, whatever the automaton: C functions over a HANDLE."""

    rhs: Any
    roots: Any


@cache
def callbacks() -> Callbacks:
    """Compile the two callbacks of CVODE; they reach the automaton through the handle."""
    library.load()  # before anything that names a symbol of SUNDIALS is linked

    def rhs(t, y, dy, user):  # type: ignore[no-untyped-def]
        handle = _handle(user)
        slope = _data(dy)
        now = min(t, handle.last_instant)
        size, p = handle.parameter_count, handle.parameters
        call_kernel(handle.flow, handle.mode, 0, now, _data(y), p, size, slope)
        total = 0.0
        for i in range(handle.n):
            total += abs(pointer(slope)[i])
        return 0 if math.isfinite(total) else -1

    def roots(t, y, out, user):  # type: ignore[no-untyped-def]
        handle = _handle(user)
        m = handle.m
        state = _data(y)
        now = min(t, handle.last_instant)
        size, p = handle.parameter_count, handle.parameters
        call_kernel(handle.margins, handle.mode, 0, now, state, p, size, out)
        values, bias = pointer(out), pointer(handle.bias)
        for i in range(m):
            if math.isnan(values[i]) or math.isnan(values[m + i]):
                return -1
            values[i] += bias[i]
            # CVODE takes a zero at the end of a step for the root, and then overlooks one before
            # it: the rate of a waveform that ends level, at a switch, is such a zero.
            if values[m + i] == 0.0:
                values[m + i] = 1e-300
        values[2 * m] = 1.0
        if handle.section >= 0:
            values[2 * m] = pointer(state)[handle.section] - handle.level
        return 0

    name = sources()
    return Callbacks(
        compile_callback(rhs, CALLBACK, name),
        compile_callback(roots, CALLBACK, name),
    )


@cache
def jacobian_callback() -> Any:
    """Compile the callback by which CVODE asks for the Jacobian."""
    library.load()

    def jacobian(t, y, slope, out, user, work1, work2, work3):  # type: ignore[no-untyped-def]
        handle = _handle(user)
        now = min(t, handle.last_instant)
        size, p = handle.parameter_count, handle.parameters
        entries = _matrix_data(out)
        for i in range(handle.n * handle.n):
            pointer(entries)[i] = 0.0
        call_kernel(handle.jacobian, handle.mode, 0, now, _data(y), p, size, entries)
        return 0

    return compile_callback(jacobian, JACOBIAN_CALLBACK, sources())
