"""The functions of an automaton as C functions, and what compiled code needs to call them."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, register_jitable

from mems_impact.engines.cache import announce_unkept, compile_callback
from mems_impact.engines.compiling import INNER, JIT, WORD, array, matrix
from mems_impact.engines.faults import FLOW, HEAD, JACOBIAN, MARGINS, NO_MODE, TRANSITION
from mems_impact.engines.snapshot import Snapshot, take

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


# One compilation at a time: threads that start together want the same kernels.
_compiling = threading.RLock()


def kernels(
    flow: Callable[..., Any],
    margins: Callable[..., Any],
    transition: Callable[..., Any],
    n: int,
    m: int,
    bounds: bool = True,
) -> Kernels:
    """Compile the functions of an automaton with `n` states and `m` guards to C functions.

    They are compiled anew if anything that they draw on has changed since. With `bounds` they read
    and write nothing beyond arrays. Behind the parameters there is room for a note
    (`mems_impact.engines.faults`) of HEAD + n numbers.
    """
    snapshot = take(flow, margins, transition)
    with _compiling:
        return _kernels(snapshot, n, m, bounds)


@register_jitable(**JIT, **INNER)
def note(role, mode, code, t, y, p, size, n):  # type: ignore[no-untyped-def]
    """Note a call that failed behind the parameters, if it is the first."""
    record, state = array(p + WORD * size, HEAD + n), array(y, n)
    if record[0] == 0.0:
        record[0] = role
        record[1] = mode
        record[2] = code
        record[3] = t
        for i in range(n):
            record[HEAD + i] = state[i]


@register_jitable(**JIT, **INNER)
def no_numbers(values):  # type: ignore[no-untyped-def]
    """Fill an array with what is told from every result."""
    for i in range(values.size):
        values[i] = math.nan


@cache
def _kernels(snapshot: Snapshot, n: int, m: int, bounds: bool) -> Kernels:
    flow, margins, transition = snapshot.frozen(boundscheck=bounds)

    def flow_kernel(mode, code, t, y, p, size, out):  # type: ignore[no-untyped-def]
        if bounds:
            no_numbers(array(out, n))  # what is never written is found out
        try:
            flow(mode, t, array(y, n), array(p, size), array(out, n))
        except Exception:
            note(FLOW, mode, code, t, y, p, size, n)
            no_numbers(array(out, n))
        return mode

    def margins_kernel(mode, code, t, y, p, size, out):  # type: ignore[no-untyped-def]
        g, r = array(out, m), array(out + WORD * m, m)
        for i in range(m):
            g[i] = 1.0
            r[i] = 1.0
        try:
            margins(mode, t, array(y, n), array(p, size), g, r)
        except Exception:
            note(MARGINS, mode, code, t, y, p, size, n)
            no_numbers(g)
        return mode

    def transition_kernel(mode, code, t, y, p, size, out):  # type: ignore[no-untyped-def]
        state, record = array(y, n), array(p + WORD * size, HEAD + n)
        first = record[0] == 0.0
        if first:  # it may change some of the state before it fails
            for i in range(n):
                record[HEAD + i] = state[i]
        try:
            return transition(mode, code, t, state, array(p, size))
        except Exception:
            if first:
                for i in range(n):
                    state[i] = record[HEAD + i]
            note(TRANSITION, mode, code, t, y, p, size, n)
        return NO_MODE

    name = f"{snapshot.name}_{n}_{m}_{bounds:d}"
    kept = name if snapshot.lasting else None
    if kept is None:
        announce_unkept(snapshot.passing)
    made = [_kernel(each, name, kept) for each in (flow_kernel, margins_kernel, transition_kernel)]
    return Kernels(*made)


def jacobian_of(jacobian: Callable[..., Any], n: int) -> Any:
    """Compile the Jacobian of an automaton with `n` states to a C function; BDF alone needs it."""
    snapshot = take(jacobian)
    with _compiling:
        return _jacobian(snapshot, n)


@cache
def _jacobian(snapshot: Snapshot, n: int) -> Any:
    (jacobian,) = snapshot.frozen(boundscheck=True)

    def jacobian_kernel(mode, code, t, y, p, size, out):  # type: ignore[no-untyped-def]
        try:
            jacobian(mode, t, array(y, n), array(p, size), matrix(out, n))
        except Exception:
            note(JACOBIAN, mode, code, t, y, p, size, n)
        return mode

    name = f"{snapshot.name}_{n}"
    return _kernel(jacobian_kernel, name, name if snapshot.lasting else None)


def observables_of(observe: Callable[..., Any], n: int, count: int) -> Any:
    """Compile what gives `count` observables of states of length `n` to a C function.

    It has the signature of a transition, with two states one behind the other, and returns 1 if it
    fails.
    """
    snapshot = take(observe)
    with _compiling:
        return _observables(snapshot, n, count)


@cache
def _observables(snapshot: Snapshot, n: int, count: int) -> Any:
    (observe,) = snapshot.frozen(boundscheck=True)

    def observe_kernel(mode, code, t, y, p, size, out):  # type: ignore[no-untyped-def]
        try:
            observe(mode, code, t, array(y, 2 * n), array(p, size), array(out, count))
        except Exception:
            return 1
        return 0

    name = f"{snapshot.name}_{n}_{count}"
    return _kernel(observe_kernel, name, name if snapshot.lasting else None)


def _kernel(function: Callable[..., Any], name: str, kept: str | None) -> Any:
    # Symbols of compiled code carry this name: automata that meet in a process must not share.
    function.__qualname__ += f"_{name}"
    return compile_callback(function, KERNEL, kept)
