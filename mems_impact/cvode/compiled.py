"""One arc through SUNDIALS' C API, with callbacks compiled by numba: the engine at native speed.

Three layers meet here. The functions of an automaton become C functions (`kernels`), which CVODE
calls without Python. The contract of `mems_impact.cvode.engine` gets overloads, so that a loop
compiled by numba calls CVODE directly. `Engine` owns the memory of one CVODE object.

Everything is cached on disk. numba notices a change of the file in which a compiled function
stands, not of the files that it draws on; so each compiled function closes over a fingerprint of
all sources, which makes it part of the cache's key.
"""

from __future__ import annotations

import ctypes
import hashlib
import inspect
import math
import weakref
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import carray, cfunc, types
from numba.extending import intrinsic, overload, register_jitable

from mems_impact.cvode import engine as contract
from mems_impact.cvode import library
from mems_impact.cvode.options import Options

CV_ADAMS, CV_BDF, CV_ONE_STEP = 1, 2, 2

_cvode = library.symbol("CVode")
_reinit = library.symbol("CVodeReInit")
_root_info = library.symbol("CVodeGetRootInfo")
_dky = library.symbol("CVodeGetDky")
_set_stop = library.symbol("CVodeSetStopTime")
_clear_stop = library.symbol("CVodeClearStopTime")
_data = library.symbol("N_VGetArrayPointer")

# One signature for all functions of an automaton:
# kernel(mode, code, t, y, control, out) -> mode; arrays are addresses.
KERNEL = types.int64(types.int64, types.int64, types.float64, types.intp, types.intp, types.intp)
RHS = types.int32(types.float64, types.intp, types.intp, types.intp)


@intrinsic
def _pointer(_typing: Any, address: Any) -> Any:
    """Turn an address into a pointer to double."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.inttoptr(args[0], ir.DoubleType().as_pointer())

    return types.CPointer(types.float64)(types.intp), codegen


@intrinsic
def _call(
    _typing: Any, address: Any, mode: Any, code: Any, t: Any, y: Any, control: Any, out: Any
) -> Any:
    """Call the kernel at `address`."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        word, real = ir.IntType(64), ir.DoubleType()
        function = ir.FunctionType(word, [word, word, real, word, word, word])
        return builder.call(builder.inttoptr(args[0], function.as_pointer()), args[1:])

    return types.int64(types.int64, *KERNEL.args), codegen


# Functions that numba can call already: the contract's have overloads below.
_compilable: set[FunctionType] = {
    contract.step,
    contract.time,
    contract.state,
    contract.fired,
    contract.interpolate,
    contract.restart,
    contract.control,
    contract.flow,
    contract.margins,
    contract.transition,
}


def make_compilable(function: FunctionType) -> FunctionType:
    """Let numba compile `function` and every plain function that it draws on; return it.

    Calls of plain Python functions are not compiled by numba unless it is told to. Doing so here,
    for whatever a function names, keeps numba's decorators out of the equations.
    """
    if function in _compilable:
        return function
    _compilable.add(function)
    for callee in _callees(function):
        make_compilable(callee)
    register_jitable(function)
    return function


def _callees(function: FunctionType) -> list[FunctionType]:
    """Return the plain Python functions, outside libraries, that `function` names."""
    code = function.__code__
    cells = function.__closure__ or ()
    named = [function.__globals__.get(name) for name in code.co_names]
    named += [cell.cell_contents for cell in cells]
    for module in [value for value in named if inspect.ismodule(value)]:
        named += [getattr(module, name, None) for name in code.co_names]
    functions = [value for value in named if isinstance(value, FunctionType)]
    libraries = ("numpy", "numba", "math")
    return [f for f in functions if f.__module__.split(".")[0] not in libraries]


def fingerprint(functions: Iterable[FunctionType] = ()) -> int:
    """Hash the state of the package's sources and of the files in which `functions` stand."""
    files = set(Path(__file__).resolve().parents[1].rglob("*.py"))
    for function in functions:
        for member in (function, *_callees(function)):
            source = Path(member.__code__.co_filename)
            if source.exists():
                files.add(source.resolve())
    digest = hashlib.sha256()
    for file in sorted(files):
        stat = file.stat()
        digest.update(f"{file.name}:{stat.st_size}:{stat.st_mtime_ns};".encode())
    return int.from_bytes(digest.digest()[:7], "big")


class Kernels(NamedTuple):
    """The compiled functions of an automaton; keep it as long as an engine uses it."""

    rhs: Any
    roots: Any
    flow: Any
    margins: Any
    transition: Any


@cache
def kernels(
    flow: FunctionType,
    margins: FunctionType,
    transition: FunctionType,
    n: int,
    m: int,
) -> Kernels:
    """Compile the functions of an automaton with `n` states and `m` guards to C functions."""
    library.load()
    for function in (flow, margins, transition):
        make_compilable(function)
    stamp = fingerprint((flow, margins, transition))
    bias = contract.BIAS
    words = 8  # bytes of a double

    @cfunc(RHS, cache=True)
    def rhs(t, y, dy, user):  # type: ignore[no-untyped-def]
        _ = stamp
        control = carray(_pointer(user), bias)
        p = carray(_pointer(user + words * (bias + m)), int(control[contract.COUNT]))
        slope = carray(_pointer(_data(dy)), n)
        now = min(t, control[contract.LAST_INSTANT])
        flow(int(control[contract.MODE]), now, carray(_pointer(_data(y)), n), p, slope)
        for i in range(n):
            if not math.isfinite(slope[i]):
                return -1
        return 0

    @cfunc(RHS, cache=True)
    def roots(t, y, out, user):  # type: ignore[no-untyped-def]
        _ = stamp
        control = carray(_pointer(user), bias + m)
        p = carray(_pointer(user + words * (bias + m)), int(control[contract.COUNT]))
        x = carray(_pointer(_data(y)), n)
        values = carray(_pointer(out), 2 * m + 1)
        for i in range(2 * m + 1):
            values[i] = 1.0
        now = min(t, control[contract.LAST_INSTANT])
        margins(int(control[contract.MODE]), now, x, p, values[:m], values[m : 2 * m])
        for i in range(m):
            values[i] += control[bias + i]
        component = int(control[contract.SECTION])
        if component >= 0:
            values[2 * m] = x[component] - control[contract.LEVEL]
        return 0

    @cfunc(KERNEL, cache=True)
    def flow_kernel(mode, code, t, y, user, out):  # type: ignore[no-untyped-def]
        _ = stamp
        control = carray(_pointer(user), bias)
        p = carray(_pointer(user + words * (bias + m)), int(control[contract.COUNT]))
        flow(mode, t, carray(_pointer(y), n), p, carray(_pointer(out), n))
        return mode

    @cfunc(KERNEL, cache=True)
    def margins_kernel(mode, code, t, y, user, out):  # type: ignore[no-untyped-def]
        _ = stamp
        control = carray(_pointer(user), bias)
        p = carray(_pointer(user + words * (bias + m)), int(control[contract.COUNT]))
        values = carray(_pointer(out), 2 * m)
        for i in range(2 * m):
            values[i] = 1.0
        margins(mode, t, carray(_pointer(y), n), p, values[:m], values[m:])
        return mode

    @cfunc(KERNEL, cache=True)
    def transition_kernel(mode, code, t, y, user, out):  # type: ignore[no-untyped-def]
        _ = stamp
        control = carray(_pointer(user), bias)
        p = carray(_pointer(user + words * (bias + m)), int(control[contract.COUNT]))
        return transition(mode, code, t, carray(_pointer(y), n), p)

    return Kernels(rhs, roots, flow_kernel, margins_kernel, transition_kernel)


class Handle(NamedTuple):
    """What compiled code needs of an engine."""

    memory: int
    vector: int
    dense: int
    y: np.ndarray
    spare: np.ndarray
    t: np.ndarray
    roots: np.ndarray
    control: np.ndarray
    flow: int
    margins: int
    transition: int


class Engine:
    """One CVODE object whose callbacks are compiled; its memory is freed with it.

    The parameters are those of `mems_impact.cvode.interpreted.Engine`. Adams runs with fixed-point
    iteration, which needs no matrix; BDF with Newton's method and a dense matrix.
    """

    def __init__(
        self,
        flow: FunctionType,
        margins: FunctionType,
        transition: FunctionType,
        *,
        n: int,
        m: int,
        parameters: Any,
        options: Options,
        max_step: float,
        section: tuple[int, float, int] | None = None,
    ) -> None:
        sun = library.load()
        self._kernels = kernels(flow, margins, transition, n, m)
        component, level, direction = section if section is not None else (-1, 0.0, 0)
        self.control = contract.new_control(m, component, level, parameters)
        y, spare = np.zeros(n), np.zeros(n)
        roots = np.zeros(2 * m + 1, dtype=np.int32)
        directions = np.array([-1] * m + [1] * m + [direction], dtype=np.int32)

        context = ctypes.c_void_p()
        sun.SUNContext_Create(0, ctypes.byref(context))
        # The default handler prints to standard error; the codes say it all.
        sun.SUNContext_ClearErrHandlers(context)
        vector = sun.N_VMake_Serial(n, y.ctypes.data, context)
        dense = sun.N_VMake_Serial(n, spare.ctypes.data, context)
        bdf = options.method == "bdf"
        memory = sun.CVodeCreate(CV_BDF if bdf else CV_ADAMS, context)
        owned = _Owned(sun, context, memory, [vector, dense])
        self._finalizer = weakref.finalize(self, owned.free)

        _must(sun.CVodeInit(memory, self._kernels.rhs.address, 0.0, vector), "CVodeInit")
        _must(sun.CVodeSStolerances(memory, options.rtol, options.atol), "CVodeSStolerances")
        _must(sun.CVodeSetUserData(memory, self.control.ctypes.data), "CVodeSetUserData")
        if bdf:
            owned.matrix = sun.SUNDenseMatrix(n, n, context)
            owned.linear = sun.SUNLinSol_Dense(vector, owned.matrix, context)
            flag = sun.CVodeSetLinearSolver(memory, owned.linear, owned.matrix)
            _must(flag, "CVodeSetLinearSolver")
        else:
            owned.nonlinear = sun.SUNNonlinSol_FixedPoint(vector, 0, context)
            _must(sun.CVodeSetNonlinearSolver(memory, owned.nonlinear), "CVodeSetNonlinearSolver")
        flag = sun.CVodeRootInit(memory, 2 * m + 1, self._kernels.roots.address)
        _must(flag, "CVodeRootInit")
        flag = sun.CVodeSetRootDirection(memory, directions.ctypes.data)
        _must(flag, "CVodeSetRootDirection")
        _must(sun.CVodeSetNoInactiveRootWarn(memory), "CVodeSetNoInactiveRootWarn")
        _must(sun.CVodeSetMaxStep(memory, max_step), "CVodeSetMaxStep")
        self._sun = sun
        self.handle = Handle(
            memory=memory,
            vector=vector,
            dense=dense,
            y=y,
            spare=spare,
            t=np.zeros(1),
            roots=roots,
            control=self.control,
            flow=self._kernels.flow.address,
            margins=self._kernels.margins.address,
            transition=self._kernels.transition.address,
        )

    def begin(self) -> None:
        """Do nothing: the callbacks read the control array itself."""

    def close(self) -> None:
        """Free CVODE's memory now rather than with the object."""
        self._finalizer()

    def counters(self) -> dict[str, int]:
        """Return CVODE's counts of steps and right-hand sides since the last restart."""
        value = ctypes.c_long()
        counts = {}
        for key, name in (("steps", "CVodeGetNumSteps"), ("rhs", "CVodeGetNumRhsEvals")):
            getattr(self._sun, name)(self.handle.memory, ctypes.byref(value))
            counts[key] = value.value
        return counts


class _Owned:
    """The C objects of one engine, freed in the order that SUNDIALS asks for."""

    def __init__(self, sun: Any, context: Any, memory: int, vectors: list[int]) -> None:
        self.sun, self.context, self.memory, self.vectors = sun, context, memory, vectors
        self.matrix = self.linear = self.nonlinear = None

    def free(self) -> None:
        sun = self.sun
        sun.CVodeFree(ctypes.byref(ctypes.c_void_p(self.memory)))
        if self.nonlinear is not None:
            sun.SUNNonlinSolFree(self.nonlinear)
        if self.linear is not None:
            sun.SUNLinSolFree(self.linear)
            sun.SUNMatDestroy(self.matrix)
        for vector in self.vectors:
            sun.N_VDestroy(vector)
        sun.SUNContext_Free(ctypes.byref(self.context))


def _must(flag: int, name: str) -> None:
    if flag < 0:
        raise RuntimeError(f"{name} failed with code {flag}")


def _is_handle(kind: Any) -> bool:
    return isinstance(kind, types.NamedTuple) and kind.instance_class is Handle


@overload(contract.step)
def _step(engine):  # type: ignore[no-untyped-def]
    if _is_handle(engine):

        def implementation(engine):  # type: ignore[no-untyped-def]
            # CVODE takes the end of the interval for direction and first step only.
            flag = _cvode(
                engine.memory, engine.t[0] + 1.0, engine.vector, engine.t.ctypes.data, CV_ONE_STEP
            )
            if flag == contract.ROOT:
                _root_info(engine.memory, engine.roots.ctypes.data)
            return int(flag)

        return implementation


@overload(contract.time)
def _time(engine):  # type: ignore[no-untyped-def]
    if _is_handle(engine):
        return lambda engine: engine.t[0]


@overload(contract.state)
def _state(engine, y):  # type: ignore[no-untyped-def]
    if _is_handle(engine):

        def implementation(engine, y):  # type: ignore[no-untyped-def]
            for i in range(engine.y.size):
                y[i] = engine.y[i]

        return implementation


@overload(contract.fired)
def _fired(engine, i):  # type: ignore[no-untyped-def]
    if _is_handle(engine):
        return lambda engine, i: int(engine.roots[i])


@overload(contract.interpolate)
def _interpolate(engine, t, y):  # type: ignore[no-untyped-def]
    if _is_handle(engine):

        def implementation(engine, t, y):  # type: ignore[no-untyped-def]
            _dky(engine.memory, t, 0, engine.dense)
            for i in range(engine.spare.size):
                y[i] = engine.spare[i]

        return implementation


@overload(contract.restart)
def _restart(engine, t, y, stop):  # type: ignore[no-untyped-def]
    if _is_handle(engine):

        def implementation(engine, t, y, stop):  # type: ignore[no-untyped-def]
            for i in range(engine.y.size):
                engine.y[i] = y[i]
            engine.t[0] = t
            _reinit(engine.memory, t, engine.vector)
            if stop < math.inf:
                _set_stop(engine.memory, stop)
            else:
                _clear_stop(engine.memory)

        return implementation


@overload(contract.control)
def _control(engine):  # type: ignore[no-untyped-def]
    if _is_handle(engine):
        return lambda engine: engine.control


@overload(contract.flow)
def _flow(engine, mode, t, y, dy):  # type: ignore[no-untyped-def]
    if _is_handle(engine):

        def implementation(engine, mode, t, y, dy):  # type: ignore[no-untyped-def]
            user = engine.control.ctypes.data
            _call(engine.flow, mode, 0, t, y.ctypes.data, user, dy.ctypes.data)

        return implementation


@overload(contract.margins)
def _margins(engine, mode, t, y, out):  # type: ignore[no-untyped-def]
    if _is_handle(engine):

        def implementation(engine, mode, t, y, out):  # type: ignore[no-untyped-def]
            user = engine.control.ctypes.data
            _call(engine.margins, mode, 0, t, y.ctypes.data, user, out.ctypes.data)

        return implementation


@overload(contract.transition)
def _transition(engine, mode, code, t, y):  # type: ignore[no-untyped-def]
    if _is_handle(engine):

        def implementation(engine, mode, code, t, y):  # type: ignore[no-untyped-def]
            user = engine.control.ctypes.data
            return _call(engine.transition, mode, code, t, y.ctypes.data, user, user)

        return implementation
