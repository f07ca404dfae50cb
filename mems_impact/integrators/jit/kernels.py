"""Functions of an automaton as C functions, and the handle of a compiled engine.

The handle is a record, whose first fields are those of `ENGINE` for every method: addresses of the
automaton's functions, of the method's functions (`METHOD_SIGNATURES`) and of arrays. The event loop
knows these only, so it is compiled once for all automata and methods. This module has the overloads
of `mems_impact.integrators.interface`, which read these fields or call the functions there.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import types
from numba.extending import intrinsic, overload

from mems_impact.integrators import interface
from mems_impact.integrators.interface import Equations, SingleMethodEngine
from mems_impact.integrators.jit.closures import Snapshot, mark_overloaded, take_snapshot
from mems_impact.integrators.jit.kernel_code import KERNEL, Kernel, KernelCode, compile_kernel
from mems_impact.integrators.jit.numba_support import (
    INNER,
    JIT,
    MATRIX,
    VECTOR,
    WORD,
    address,
    announce_uncached,
    caller,
    data,
    integers,
    pointer,
)
from mems_impact.integrators.python_functions import (
    FLOW,
    HEAD,
    MARGINS,
    NO_MODE,
    TRANSITION,
    Fault,
    recorded_fault,
)

# --- Kernels

_word, _real = types.int64, types.float64
_ARGUMENTS = (_word, _word, _real, _word, _word, _word, _word)  # of a KERNEL

# C functions of a method, over the address of its handle; arrays are addresses.
METHOD_SIGNATURES = {
    "step": _word(_word),
    "end_margins": types.void(_word, _word),
    "interpolate": types.void(_word, _real, _word),
    "restart": types.void(_word, _word, _real, _word, _real),
    "sharpen": types.void(_word, _real, _real),
    "lengthen": types.void(_word, _real),
    "reset": types.void(_word, _real),
    "method_memory": _word(_word, _word),
}

# Fields of every engine: addresses and values. Each method adds its own fields after them.
ENGINE_FIELDS = [
    *((name, np.int64) for name in METHOD_SIGNATURES),
    ("y", np.int64),
    ("fired", np.int64),
    ("bias", np.int64),
    ("parameters", np.int64),
    ("flow", np.int64),
    ("margins", np.int64),
    ("transition", np.int64),
    ("n", np.int64),
    ("states", np.int64),  # components without columns
    ("perturbations", np.int64),  # columns
    ("interpolated", np.int64),  # components
    ("m", np.int64),
    ("parameter_count", np.int64),
    ("t", np.float64),
    ("mode", np.int64),
    ("approach_search", np.int64),
    ("last_instant", np.float64),
    ("section", np.int64),  # component, -1 for none
    ("level", np.float64),
]
ENGINE = np.dtype(ENGINE_FIELDS, align=True)


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
        return builder.call(builder.inttoptr(args[0], KERNEL.as_pointer()), args[1:])

    return _word(_word, *_ARGUMENTS), codegen


class Kernels(NamedTuple):
    """The functions of an automaton as C functions, which the engine needs to the end."""

    flow: Kernel
    margins: Kernel
    transition: Kernel


# One compilation at a time: simultaneous threads often need the same kernels.
_compilation_lock = threading.RLock()


def kernels(
    flow: Callable[..., Any],
    margins: Callable[..., Any],
    transition: Callable[..., Any],
    n: int,
    m: int,
    bounds: bool = True,
    columns: int = 0,
) -> Kernels:
    """Compile the functions of an automaton with `n` states and `m` guards to C functions.

    Margins and transitions take the state without its last `columns` components.

    They are compiled again if any dependency has changed. With `bounds` they check array bounds.
    The parameters are followed by a fault record (`mems_impact.integrators.python_functions`) of
    HEAD + n values.
    """
    snapshot = take_snapshot(flow, margins, transition)
    with _compilation_lock:
        return _kernels(snapshot, n, m, bounds, columns)


@cache
def _kernels(snapshot: Snapshot, n: int, m: int, bounds: bool, columns: int) -> Kernels:
    if not snapshot.lasting:
        announce_uncached(snapshot.volatile_dependencies)
    # Each function by itself, so that a change of one requires no compilation of the others.
    flow, margins, transition = (take_snapshot(function) for function in snapshot.functions)
    return Kernels(
        _flow_kernel(flow, n, bounds),
        _margins_kernel(margins, n - columns, m, bounds),
        _transition_kernel(transition, n - columns, bounds),
    )


@cache
def _flow_kernel(snapshot: Snapshot, n: int, bounds: bool) -> Kernel:
    def body(code: KernelCode) -> Any:
        if bounds:
            code.fill(code.out, n, math.nan)  # reveals unwritten components
        state, slope = code.vector(code.y, code.count(n)), code.vector(code.out, code.count(n))
        parameters = code.vector(code.parameters, code.size)
        with code.call(code.mode, code.t, state, parameters, slope):
            with code.only_if(code.is_fault()):  # a step beyond its domain is shortened
                code.record_fault(FLOW, n)
            code.fill(code.out, n, math.nan)
        return code.mode

    kinds = (_word, _real, VECTOR, VECTOR, VECTOR)
    return compile_role("flow", snapshot, kinds, body, (n, bounds), bounds)


@cache
def _margins_kernel(snapshot: Snapshot, n: int, m: int, bounds: bool) -> Kernel:
    def body(code: KernelCode) -> Any:
        code.fill(code.out, 2 * m, 1.0)
        state, parameters = (
            code.vector(code.y, code.count(n)),
            code.vector(code.parameters, code.size),
        )
        g = code.vector(code.out, code.count(m))
        r = code.vector(code.after(code.out, code.count(m)), code.count(m))
        with code.call(code.mode, code.t, state, parameters, g, r):
            with code.only_if(code.is_fault()):  # a step beyond its domain is shortened
                code.record_fault(MARGINS, n)
            code.fill(code.out, 2 * m, math.nan)
        return code.mode

    kinds = (_word, _real, VECTOR, VECTOR, VECTOR, VECTOR)
    return compile_role("margins", snapshot, kinds, body, (n, m, bounds), bounds)


@cache
def _transition_kernel(snapshot: Snapshot, n: int, bounds: bool) -> Kernel:
    def body(code: KernelCode) -> Any:
        record = code.after(code.parameters, code.size)
        state_copy, is_first = code.after(record, code.count(HEAD)), code.is_first_fault()
        with code.only_if(is_first, likely=True):
            # The transition may change the state before it fails.
            code.copy(state_copy, code.y, n)
        state, parameters = (
            code.vector(code.y, code.count(n)),
            code.vector(code.parameters, code.size),
        )
        with code.call(code.mode, code.code, code.t, state, parameters):
            with code.only_if(is_first, likely=True):
                code.copy(code.y, state_copy, n)
            code.record_fault(TRANSITION, n)
        return code.result(if_failed=NO_MODE)

    kinds = (_word, _word, _real, VECTOR, VECTOR)
    return compile_role("transition", snapshot, kinds, body, (n, bounds), bounds)


def jacobian_of(jacobian: Callable[..., Any], n: int, size: int) -> Kernel:
    """Compile the Jacobian of a flow with `n` states to a C function.

    `size` is the length of its scratch.
    """
    snapshot = take_snapshot(jacobian)
    with _compilation_lock:
        return _jacobian_kernel(snapshot, n, size)


@cache
def _jacobian_kernel(snapshot: Snapshot, n: int, size: int) -> Kernel:
    def body(code: KernelCode) -> Any:
        state, parameters = (
            code.vector(code.y, code.count(n)),
            code.vector(code.parameters, code.size),
        )
        memory = code.vector(code.scratch(size), code.count(size))
        with code.call(code.mode, code.t, state, parameters, memory, code.matrix(code.out, n)):
            code.record_fault(FLOW, n)
        return code.mode

    kinds = (_word, _real, VECTOR, VECTOR, VECTOR, MATRIX)
    return compile_role("jacobian", snapshot, kinds, body, (n, size), True)


def observables_of(observe: Callable[..., Any], n: int, count: int) -> Kernel:
    """Compile a function of `count` observables of states of length `n` to a C function.

    The function has the signature of a kernel, with two states in succession, and returns 1 if it
    fails.
    """
    snapshot = take_snapshot(observe)
    with _compilation_lock:
        return _observables_kernel(snapshot, n, count)


@cache
def _observables_kernel(snapshot: Snapshot, n: int, count: int) -> Kernel:
    def body(code: KernelCode) -> Any:
        states, values = (
            code.vector(code.y, code.count(2 * n)),
            code.vector(code.out, code.count(count)),
        )
        parameters = code.vector(code.parameters, code.size)
        with code.call(code.mode, code.code, code.t, states, parameters, values):
            pass
        return code.either(if_failed=1, if_successful=0)

    kinds = (_word, _word, _real, VECTOR, VECTOR, VECTOR)
    return compile_role("observables", snapshot, kinds, body, (n, count), True)


def tangents_of(tangents: Callable[..., Any], n: int, size: int) -> Kernel:
    """Compile a function that writes derivatives of an event, `size` values, to a C function.

    The function has the signature of a kernel, and writes nan if it fails.
    """
    snapshot = take_snapshot(tangents)
    with _compilation_lock:
        return _tangents_kernel(snapshot, n, size)


@cache
def _tangents_kernel(snapshot: Snapshot, n: int, size: int) -> Kernel:
    def body(code: KernelCode) -> Any:
        state, values = code.vector(code.y, code.count(n)), code.vector(code.out, code.count(size))
        parameters = code.vector(code.parameters, code.size)
        with code.call(code.mode, code.code, code.t, state, parameters, values):
            code.fill(code.out, size, math.nan)
        return code.mode

    kinds = (_word, _word, _real, VECTOR, VECTOR, VECTOR)
    return compile_role("tangents", snapshot, kinds, body, (n, size), True)


def compile_role(
    role: str,
    snapshot: Snapshot,
    kinds: tuple[Any, ...],
    body: Callable[[KernelCode], Any],
    sizes: tuple[int, ...],
    boundscheck: bool,
) -> Kernel:
    """Compile the function of an automaton with a role; see `compile_kernel`."""
    # Symbols of compiled code contain this name, which keeps automata of a process apart.
    name = "_".join([f"{role}_kernel", snapshot.name, *(f"{size:d}" for size in sizes)])

    def function() -> Any:
        return snapshot.frozen(boundscheck=boundscheck)[0]

    return compile_kernel(function, kinds, body, name, snapshot.lasting, boundscheck)


# --- Compiled engines


def method_entries(
    method: str, handle: Callable[..., Any], functions: Sequence[Callable[..., Any]]
) -> list[Callable[..., Any]]:
    """Return `functions`, in the order of METHOD_SIGNATURES, over addresses of records.

    `method` distinguishes their symbols; `handle` converts an address to the record of the method
    (`record_at`).
    """
    (
        run_step,
        run_end_margins,
        run_interpolate,
        run_restart,
        run_sharpen,
        run_lengthen,
        run_reset,
        run_method_memory,
    ) = functions

    def step(engine):  # type: ignore[no-untyped-def]
        return run_step(handle(engine))

    def end_margins(engine, out):  # type: ignore[no-untyped-def]
        run_end_margins(handle(engine), pointer(out))

    def interpolate(engine, t, y):  # type: ignore[no-untyped-def]
        run_interpolate(handle(engine), t, pointer(y))

    def restart(engine, mode, t, y, stop):  # type: ignore[no-untyped-def]
        run_restart(handle(engine), mode, t, pointer(y), stop)

    def sharpen(engine, share, flight_time):  # type: ignore[no-untyped-def]
        run_sharpen(handle(engine), share, flight_time)

    def lengthen(engine, longest):  # type: ignore[no-untyped-def]
        run_lengthen(handle(engine), longest)

    def reset(engine, max_step):  # type: ignore[no-untyped-def]
        run_reset(handle(engine), max_step)

    def method_memory(engine, mode):  # type: ignore[no-untyped-def]
        return run_method_memory(handle(engine), mode)

    entries: list[Callable[..., Any]] = [
        step,
        end_margins,
        interpolate,
        restart,
        sharpen,
        lengthen,
        reset,
        method_memory,
    ]
    for entry in entries:
        entry.__qualname__ = f"{method}_{entry.__name__}"
    return entries


class CompiledEngine(SingleMethodEngine):
    """A record of addresses for compiled code, and the memory that it points to.

    The record, `handle`, has the fields `ENGINE_FIELDS`, which the event loop reads at `address`,
    and those of the method: addresses of its `arrays`, named with their lengths, and `functions`.
    """

    def __init__(
        self,
        dtype: np.dtype[Any],
        equations: Equations,
        arrays: dict[str, int],
        functions: dict[str, Any],
    ) -> None:
        n, m, parameters = equations.n, equations.m, np.asarray(equations.parameters, dtype=float)
        flow, margins, transition = equations.flow, equations.margins, equations.transition
        self._kernels = kernels(
            flow, margins, transition, n, m, equations.bounds, equations.columns
        )
        # The handle has addresses in this block, which lives as long as the engine. The kernels
        # write a fault record after the parameters.
        sizes = {"y": n, "bias": 2 * m, "parameters": parameters.size + HEAD + n, **arrays}
        root_count = 2 * m + 1  # as 32-bit integers, two to a number
        block = np.zeros(sum(sizes.values()) + root_count // 2 + 1)
        handles = np.zeros(1, dtype=dtype)
        self.memory = block
        self.address = handles.ctypes.data
        # A record that keeps the arrays alive. Access by item is ten times as fast as by attribute.
        self.handle = handle = handles[0]
        self._functions = functions
        for name, function in functions.items():
            handle[name] = function.address
        base, offset = block.ctypes.data, 0
        for name, size in sizes.items():
            handle[name] = base + WORD * offset
            if name == "parameters":
                fault_start = offset + parameters.size
                self.parameters = block[offset:fault_start]
                self.parameters[:] = parameters
                self._fault_record = block[fault_start : offset + size]
            offset += size
        handle["fired"] = base + WORD * offset
        handle["n"], handle["m"], handle["parameter_count"] = n, m, parameters.size
        handle["states"], handle["perturbations"] = equations.states, equations.perturbations
        handle["interpolated"], handle["approach_search"] = equations.interpolated, 1
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
    return isinstance(kind, types.Record) and "transition" in kind.fields


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
    interface.lengthen,
    interface.method_memory,
    interface.search_approaches,
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


def _overload_method(name: str) -> None:
    """Let compiled code call a function of the method by its address in the handle."""
    call = caller(METHOD_SIGNATURES[name])

    @overload(getattr(interface, name), jit_options={**JIT, **INNER})
    def method(engine, *arguments):  # type: ignore[no-untyped-def]
        if is_handle(engine):
            return lambda engine, *arguments: call(engine[name], (address(engine), *arguments))


for _name in METHOD_SIGNATURES:
    _overload_method(_name)


@overload(interface.search_approaches, jit_options={**JIT, **INNER})
def _search_approaches(engine, search):  # type: ignore[no-untyped-def]
    if is_handle(engine):

        def implementation(engine, search):  # type: ignore[no-untyped-def]
            engine.approach_search = search

        return implementation


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
