"""Functions of an automaton as C functions, and the handle of a compiled engine.

numba compiles the event loop once for each type of record. This module has the overloads of
`mems_impact.integrators.interface` that are common to all methods; each method has its own `step`,
`restart` and `interpolate`.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload, register_jitable

from mems_impact.integrators import interface
from mems_impact.integrators.interface import Equations, SingleMethodEngine
from mems_impact.integrators.jit.closures import Snapshot, mark_overloaded, take_snapshot
from mems_impact.integrators.jit.numba_support import (
    INNER,
    JIT,
    WORD,
    announce_uncached,
    array,
    compile_callback,
    data,
    integers,
    matrix,
    pointer,
)
from mems_impact.integrators.python_functions import (
    FLOW,
    HEAD,
    JACOBIAN,
    MARGINS,
    NO_MODE,
    TRANSITION,
    Fault,
    recorded_fault,
)

# --- Kernels

# Common signature of all functions of an automaton, with arrays as addresses:
# kernel(mode, code, t, y, parameters, number of parameters, out) -> mode
_word, _real = types.int64, types.float64
KERNEL = _word(_word, _word, _real, _word, _word, _word, _word)

# Fields of every engine: addresses and values. Each method adds its own fields, which identify its
# records.
KERNEL_FIELDS = [
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
    """The functions of an automaton as C functions, which must live as long as the engine."""

    flow: Any
    margins: Any
    transition: Any


# One compilation at a time: simultaneous threads often need the same kernels.
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

    They are compiled again if any dependency has changed. With `bounds` they check array bounds.
    The parameters are followed by a fault record (`mems_impact.integrators.python_functions`) of
    HEAD + n values.
    """
    snapshot = take_snapshot(flow, margins, transition)
    with _compiling:
        return _kernels(snapshot, n, m, bounds)


@register_jitable(**JIT, **INNER)
def record_fault(role, mode, code, t, y, p, size, n):  # type: ignore[no-untyped-def]
    """Record a failed call after the parameters, if it is the first."""
    record, state = array(p + WORD * size, HEAD + n), array(y, n)
    if record[0] == 0.0:
        record[0] = role
        record[1] = mode
        record[2] = code
        record[3] = t
        for i in range(n):
            record[HEAD + i] = state[i]


@register_jitable(**JIT, **INNER)
def fill_nan(values):  # type: ignore[no-untyped-def]
    """Fill an array with nan."""
    for i in range(values.size):
        values[i] = math.nan


@cache
def _kernels(snapshot: Snapshot, n: int, m: int, bounds: bool) -> Kernels:
    flow, margins, transition = snapshot.frozen(boundscheck=bounds)

    # Numba turns each bytecode instruction inside try and except into a block of its own, with a
    # check for an exception. So these contain one call and a bare except: half the compile time.

    def flow_kernel(mode, code, t, y, p, size, out):  # type: ignore[no-untyped-def]
        state, parameters, slope = array(y, n), array(p, size), array(out, n)
        if bounds:
            fill_nan(slope)  # reveals unwritten components
        failed = True
        try:
            flow(mode, t, state, parameters, slope)
            failed = False
        except:  # noqa: E722
            pass
        if failed:
            record_fault(FLOW, mode, code, t, y, p, size, n)
            fill_nan(slope)
        return mode

    def margins_kernel(mode, code, t, y, p, size, out):  # type: ignore[no-untyped-def]
        state, parameters = array(y, n), array(p, size)
        g, r = array(out, m), array(out + WORD * m, m)
        for i in range(m):
            g[i] = 1.0
            r[i] = 1.0
        failed = True
        try:
            margins(mode, t, state, parameters, g, r)
            failed = False
        except:  # noqa: E722
            pass
        if failed:
            record_fault(MARGINS, mode, code, t, y, p, size, n)
            fill_nan(g)
        return mode

    def transition_kernel(mode, code, t, y, p, size, out):  # type: ignore[no-untyped-def]
        state, parameters, record = array(y, n), array(p, size), array(p + WORD * size, HEAD + n)
        first = record[0] == 0.0
        if first:  # the transition may change the state before it fails
            for i in range(n):
                record[HEAD + i] = state[i]
        after, failed = NO_MODE, True
        try:
            after = transition(mode, code, t, state, parameters)
            failed = False
        except:  # noqa: E722
            pass
        if failed:
            if first:
                for i in range(n):
                    state[i] = record[HEAD + i]
            record_fault(TRANSITION, mode, code, t, y, p, size, n)
        return after

    name = f"{snapshot.name}_{n}_{m}_{bounds:d}"
    cached = name if snapshot.lasting else None
    if cached is None:
        announce_uncached(snapshot.passing)
    compiled = [
        _kernel(each, name, cached) for each in (flow_kernel, margins_kernel, transition_kernel)
    ]
    return Kernels(*compiled)


def jacobian_of(jacobian: Callable[..., Any], n: int) -> Any:
    """Compile the Jacobian of an automaton with `n` states to a C function, for BDF only."""
    snapshot = take_snapshot(jacobian)
    with _compiling:
        return _jacobian(snapshot, n)


@cache
def _jacobian(snapshot: Snapshot, n: int) -> Any:
    (jacobian,) = snapshot.frozen(boundscheck=True)

    def jacobian_kernel(mode, code, t, y, p, size, out):  # type: ignore[no-untyped-def]
        state, parameters, entries = array(y, n), array(p, size), matrix(out, n)
        failed = True
        try:
            jacobian(mode, t, state, parameters, entries)
            failed = False
        except:  # noqa: E722
            pass
        if failed:
            record_fault(JACOBIAN, mode, code, t, y, p, size, n)
        return mode

    name = f"{snapshot.name}_{n}"
    return _kernel(jacobian_kernel, name, name if snapshot.lasting else None)


def observables_of(observe: Callable[..., Any], n: int, count: int) -> Any:
    """Compile a function of `count` observables of states of length `n` to a C function.

    It has the signature of a kernel, with two states in succession, and returns 1 if it fails.
    """
    snapshot = take_snapshot(observe)
    with _compiling:
        return _observables(snapshot, n, count)


@cache
def _observables(snapshot: Snapshot, n: int, count: int) -> Any:
    (observe,) = snapshot.frozen(boundscheck=True)

    def observe_kernel(mode, code, t, y, p, size, out):  # type: ignore[no-untyped-def]
        states, parameters, values = array(y, 2 * n), array(p, size), array(out, count)
        failed = 1
        try:
            observe(mode, code, t, states, parameters, values)
            failed = 0
        except:  # noqa: E722
            pass
        return failed

    name = f"{snapshot.name}_{n}_{count}"
    return _kernel(observe_kernel, name, name if snapshot.lasting else None)


def _kernel(function: Callable[..., Any], name: str, cached: str | None) -> Any:
    # Symbols of compiled code contain this name, which keeps automata of a process apart.
    function.__qualname__ += f"_{name}"
    return compile_callback(function, KERNEL, cached)


# --- Compiled engines


class CompiledEngine(SingleMethodEngine):
    """A record of addresses for compiled code, and the memory that it points to.

    Parameters
    ----------
    dtype : numpy.dtype
        `mems_impact.integrators.jit.kernels.KERNEL_FIELDS` and the fields of the method.
    equations : Equations
    arrays : dict of str to int
        Arrays of the method: number of values; the field of that name has the address.
    """

    def __init__(self, dtype: np.dtype[Any], equations: Equations, arrays: dict[str, int]) -> None:
        n, m, parameters = equations.n, equations.m, np.asarray(equations.parameters, dtype=float)
        flow, margins, transition = equations.flow, equations.margins, equations.transition
        self._kernels = kernels(flow, margins, transition, n, m, equations.bounds)
        # The handle has addresses in this block, which lives as long as the engine. The kernels
        # write a fault record after the parameters.
        sizes = {"y": n, "bias": m, "parameters": parameters.size + HEAD + n, **arrays}
        fired = 2 * m + 1  # as 32-bit integers, two to a number
        block = np.zeros(sum(sizes.values()) + fired // 2 + 1)
        handles = np.zeros(1, dtype=dtype)
        self._memory = block
        self.address = handles.ctypes.data
        # A record that keeps the arrays alive. Access by item is ten times as fast as by attribute.
        self.handle = handle = handles[0]
        place, begin = block.ctypes.data, 0
        for name, size in sizes.items():
            handle[name] = place + WORD * begin
            if name == "parameters":
                fault_start = begin + parameters.size
                self.parameters = block[begin:fault_start]
                self.parameters[:] = parameters
                self._fault_record = block[fault_start : begin + size]
            begin += size
        handle["fired"] = place + WORD * begin
        handle["n"], handle["m"], handle["parameter_count"] = n, m, parameters.size
        handle["section"], handle["level"], _ = equations.crossing
        handle["flow"] = self._kernels.flow.address
        handle["margins"] = self._kernels.margins.address
        handle["transition"] = self._kernels.transition.address

    def fault(self) -> Fault | None:
        """Return the first failed call, and clear the record."""
        fault = recorded_fault(self._fault_record)
        self._fault_record[0] = 0.0
        return fault


def is_handle(kind: Any) -> bool:
    """Return whether the numba type `kind` is the record of an engine."""
    return isinstance(kind, types.Record) and "last_instant" in kind.fields


mark_overloaded(
    interface.step,
    interface.time,
    interface.state,
    interface.end_margins,
    interface.root_directions,
    interface.interpolate,
    interface.restart,
    interface.reset,
    interface.sharpen,
    interface.method_memory,
    interface.bias,
    interface.set_bias,
    interface.parameter,
    interface.set_parameter,
    interface.flow,
    interface.margins,
    interface.transition,
)


@overload(interface.time, jit_options={**JIT, **INNER})
def _time(engine):  # type: ignore[no-untyped-def]
    if is_handle(engine):
        return lambda engine: engine.t


@overload(interface.state, jit_options={**JIT, **INNER})
def _state(engine, y):  # type: ignore[no-untyped-def]
    if is_handle(engine):

        def implementation(engine, y):  # type: ignore[no-untyped-def]
            for i in range(engine.n):
                y[i] = pointer(engine.y)[i]

        return implementation


@overload(interface.root_directions, jit_options={**JIT, **INNER})
def _root_directions(engine, i):  # type: ignore[no-untyped-def]
    if is_handle(engine):
        return lambda engine, i: np.int64(integers(engine.fired)[i])


@overload(interface.method_memory, jit_options={**JIT, **INNER})
def _method_memory(engine, mode):  # type: ignore[no-untyped-def]
    if is_handle(engine) and "implicit" not in engine.fields:
        return lambda engine, mode: 0


@overload(interface.bias, jit_options={**JIT, **INNER})
def _bias(engine, i):  # type: ignore[no-untyped-def]
    if is_handle(engine):
        return lambda engine, i: pointer(engine.bias)[i]


@overload(interface.set_bias, jit_options={**JIT, **INNER})
def _set_bias(engine, i, value):  # type: ignore[no-untyped-def]
    if is_handle(engine):

        def implementation(engine, i, value):  # type: ignore[no-untyped-def]
            pointer(engine.bias)[i] = value

        return implementation


@overload(interface.parameter, jit_options={**JIT, **INNER})
def _parameter(engine, i):  # type: ignore[no-untyped-def]
    if is_handle(engine):
        return lambda engine, i: pointer(engine.parameters)[i]


@overload(interface.set_parameter, jit_options={**JIT, **INNER})
def _set_parameter(engine, i, value):  # type: ignore[no-untyped-def]
    if is_handle(engine):

        def implementation(engine, i, value):  # type: ignore[no-untyped-def]
            pointer(engine.parameters)[i] = value

        return implementation


@overload(interface.flow, jit_options={**JIT, **INNER})
def _flow(engine, mode, t, y, dy):  # type: ignore[no-untyped-def]
    if is_handle(engine):

        def implementation(engine, mode, t, y, dy):  # type: ignore[no-untyped-def]
            size, p = engine.parameter_count, engine.parameters
            call_kernel(engine.flow, mode, 0, t, data(y), p, size, data(dy))

        return implementation


@overload(interface.margins, jit_options={**JIT, **INNER})
def _margins(engine, mode, t, y, out):  # type: ignore[no-untyped-def]
    if is_handle(engine):

        def implementation(engine, mode, t, y, out):  # type: ignore[no-untyped-def]
            size, p = engine.parameter_count, engine.parameters
            call_kernel(engine.margins, mode, 0, t, data(y), p, size, data(out))

        return implementation


@overload(interface.transition, jit_options={**JIT, **INNER})
def _transition(engine, mode, code, t, y):  # type: ignore[no-untyped-def]
    if is_handle(engine):

        def implementation(engine, mode, code, t, y):  # type: ignore[no-untyped-def]
            size, p = engine.parameter_count, engine.parameters
            return call_kernel(engine.transition, mode, code, t, data(y), p, size, p)

        return implementation
