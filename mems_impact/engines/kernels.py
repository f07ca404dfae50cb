"""The functions of an automaton as C functions, and what compiled code needs to call them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import cfunc, types
from numba.extending import intrinsic

from mems_impact.engines.compiling import (
    FOR_C,
    WORD,
    array,
    cacheable,
    fingerprint,
    identity,
    make_compilable,
    matrix,
)

# One signature for all functions of an automaton, arrays being addresses:
# kernel(mode, code, t, y, parameters, number of parameters, out) -> mode
_word, _real = types.int64, types.float64
KERNEL = _word(_word, _word, _real, _word, _word, _word, _word)

# What compiled code needs of any engine: addresses and numbers. A record is one pointer to numba.
# Each method adds fields of its own, by which its records are told from those of another one.
FIELDS = [
    ("y", np.int64),
    ("fired", np.int64),
    ("bias", np.int64),
    ("parameters", np.int64),
    ("flow", np.int64),
    ("margins", np.int64),
    ("transition", np.int64),
    ("n", np.int64),
    ("m", np.int64),
    ("parameter_count", np.int64),
    ("t", np.float64),
    ("mode", np.int64),
    ("last_instant", np.float64),
    ("section", np.int64),  # component, -1 for none
    ("level", np.float64),
    (f"sources_{fingerprint()}", np.int64),  # no value: puts the sources into the type
]


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


def _kernel(*functions: Callable[..., Any]) -> tuple[int, Callable[..., Any]]:
    """Return the stamp of `functions`, and what compiles a kernel that calls them."""
    for function in functions:
        make_compilable(function)
    keep = cacheable(*functions)
    name = identity(functions)

    def kernel(function: Callable[..., Any]) -> Any:
        # Symbols of compiled code carry this name: automata that meet in a process must not share.
        function.__qualname__ += f"_{name}"
        return cfunc(KERNEL, cache=keep, **FOR_C)(function)

    return fingerprint(functions), kernel


@cache
def kernels(
    flow: Callable[..., Any],
    margins: Callable[..., Any],
    transition: Callable[..., Any],
    n: int,
    m: int,
) -> Kernels:
    """Compile the functions of an automaton with `n` states and `m` guards to C functions."""
    stamp, kernel = _kernel(flow, margins, transition)

    @kernel
    def flow_kernel(mode, code, t, y, p, size, out):  # type: ignore[no-untyped-def]
        _ = stamp
        flow(mode, t, array(y, n), array(p, size), array(out, n))
        return mode

    @kernel
    def margins_kernel(mode, code, t, y, p, size, out):  # type: ignore[no-untyped-def]
        _ = stamp
        g, r = array(out, m), array(out + WORD * m, m)
        for i in range(m):
            g[i] = 1.0
            r[i] = 1.0
        margins(mode, t, array(y, n), array(p, size), g, r)
        return mode

    @kernel
    def transition_kernel(mode, code, t, y, p, size, out):  # type: ignore[no-untyped-def]
        _ = stamp
        return transition(mode, code, t, array(y, n), array(p, size))

    return Kernels(flow_kernel, margins_kernel, transition_kernel)


@cache
def jacobian_of(jacobian: Callable[..., Any], n: int) -> Any:
    """Compile the Jacobian of an automaton with `n` states to a C function; BDF alone needs it."""
    stamp, kernel = _kernel(jacobian)

    @kernel
    def jacobian_kernel(mode, code, t, y, p, size, out):  # type: ignore[no-untyped-def]
        _ = stamp
        jacobian(mode, t, array(y, n), array(p, size), matrix(out, n))
        return mode

    return jacobian_kernel
