"""One arc through SUNDIALS' C API, with callbacks compiled by numba: the engine at native speed.

`Engine` owns the memory of one CVODE object, whose callbacks are those of `engines.kernels`. The
contract of `mems_impact.engines.contract` gets overloads here, so that a loop compiled by numba
calls CVODE directly, without Python.
"""

from __future__ import annotations

import ctypes
import math
import weakref
from typing import Any

import numpy as np
from numba.extending import overload

from mems_impact.engines import contract
from mems_impact.engines.compiling import INNER, JIT, address, data, pointer
from mems_impact.engines.cvode import library
from mems_impact.engines.cvode.callbacks import HANDLE, callbacks, jacobian_callback
from mems_impact.engines.cvode.first_step import first_step, sharpened
from mems_impact.engines.equations import Equations
from mems_impact.engines.handles import HandleOwner, is_handle
from mems_impact.engines.kernels import call_kernel, jacobian_of
from mems_impact.engines.options import Options
from mems_impact.engines.snapshot import take

CV_ADAMS, CV_BDF, CV_ONE_STEP = 1, 2, 2

_cvode = library.symbol("CVode")
_reinit = library.symbol("CVodeReInit")
_root_info = library.symbol("CVodeGetRootInfo")
_dky = library.symbol("CVodeGetDky")
_set_stop = library.symbol("CVodeSetStopTime")
_clear_stop = library.symbol("CVodeClearStopTime")
_set_max_step = library.symbol("CVodeSetMaxStep")
_set_first_step = library.symbol("CVodeSetInitStep")
_set_tolerances = library.symbol("CVodeSStolerances")
_T_OFFSET = HANDLE.fields["t"][1]  # type: ignore[index]


def prepare() -> None:
    """Bind SUNDIALS; raises EngineUnavailable where that cannot be done."""
    library.load()


class Engine(HandleOwner):
    """One CVODE object whose callbacks are compiled; its memory is freed with it.

    The parameters are those of `mems_impact.engines.cvode.interpreted.Engine`. Adams runs with
    fixed-point iteration, which needs no matrix; BDF with Newton's method and a dense matrix.
    """

    def __init__(self, equations: Equations, options: Options, max_step: float) -> None:
        sun = library.load()
        n, m, jacobian = equations.n, equations.m, equations.jacobian
        super().__init__(HANDLE, equations, {"spare": n, "seen": 2 * m})
        handle, direction = self.handle, equations.crossing[2]
        self._callbacks = callbacks()
        context = ctypes.c_void_p()
        sun.SUNContext_Create(0, ctypes.byref(context))
        # The default handler prints to standard error; the codes say it all.
        sun.SUNContext_ClearErrHandlers(context)
        vector = sun.N_VMake_Serial(n, int(handle["y"]), context)
        dense = sun.N_VMake_Serial(n, int(handle["spare"]), context)
        bdf = options.method == "bdf"
        memory = sun.CVodeCreate(CV_BDF if bdf else CV_ADAMS, context)
        handle["cvode"], handle["vector"], handle["dense"] = memory, vector, dense
        owned = _Owned(sun, context, memory, [vector, dense])
        self._finalizer = weakref.finalize(self, owned.free)

        _must(sun.CVodeInit(memory, self._callbacks.rhs.address, 0.0, vector), "CVodeInit")
        _must(sun.CVodeSStolerances(memory, options.rtol, options.atol), "CVodeSStolerances")
        handle["rtol"], handle["atol"] = options.rtol, options.atol
        handle["share"], handle["longest"] = 1.0, max_step
        _must(sun.CVodeSetUserData(memory, self.address), "CVodeSetUserData")
        if bdf:
            owned.matrix = sun.SUNDenseMatrix(n, n, context)
            owned.linear = sun.SUNLinSol_Dense(vector, owned.matrix, context)
            flag = sun.CVodeSetLinearSolver(memory, owned.linear, owned.matrix)
            _must(flag, "CVodeSetLinearSolver")
            if jacobian is not None:
                self._jacobian = jacobian_of(jacobian, n)
                handle["jacobian"] = self._jacobian.address
                flag = sun.CVodeSetJacFn(memory, jacobian_callback().address)
                _must(flag, "CVodeSetJacFn")
        else:
            owned.nonlinear = sun.SUNNonlinSol_FixedPoint(vector, 0, context)
            _must(sun.CVodeSetNonlinearSolver(memory, owned.nonlinear), "CVodeSetNonlinearSolver")
            # By default the step grows only if it may grow by half, and an arc between two
            # impacts is over before the order has risen: 1.2 saves a sixth of the steps on the
            # paper's set, at a smaller error.
            _must(sun.CVodeSetEtaFixedStepBounds(memory, 0.0, 1.2), "CVodeSetEtaFixedStepBounds")
        flag = sun.CVodeRootInit(memory, 2 * m + 1, self._callbacks.roots.address)
        _must(flag, "CVodeRootInit")
        directions = np.array([-1] * m + [1] * m + [direction], dtype=np.int32)
        flag = sun.CVodeSetRootDirection(memory, directions.ctypes.data)
        _must(flag, "CVodeSetRootDirection")
        _must(sun.CVodeSetNoInactiveRootWarn(memory), "CVodeSetNoInactiveRootWarn")
        _must(sun.CVodeSetMaxStep(memory, max_step), "CVodeSetMaxStep")
        _must(sun.CVodeSetMaxHnilWarns(memory, -1), "CVodeSetMaxHnilWarns")
        first = first_step(max_step, options.rtol, math.inf)
        _must(sun.CVodeSetInitStep(memory, first), "CVodeSetInitStep")

    def close(self) -> None:
        """Free CVODE's memory now rather than with the object."""
        self._finalizer()


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


def _is_cvode(kind: Any) -> bool:
    return is_handle(kind) and "cvode" in kind.fields


@overload(contract.step, jit_options={**JIT, **INNER})
def _step(engine):  # type: ignore[no-untyped-def]
    if _is_cvode(engine):

        def implementation(engine):  # type: ignore[no-untyped-def]
            # CVODE takes the end of the interval for direction and first step only.
            time = address(engine) + _T_OFFSET
            flag = _cvode(engine.cvode, engine.t + 1.0, engine.vector, time, CV_ONE_STEP)
            if flag == contract.ROOT:
                _root_info(engine.cvode, engine.fired)
            return int(flag)

        return implementation


@overload(contract.ended, jit_options={**JIT, **INNER})
def _ended(engine, out):  # type: ignore[no-untyped-def]
    if _is_cvode(engine):

        def implementation(engine, out):  # type: ignore[no-untyped-def]
            if engine.seen_at == engine.t:
                for i in range(2 * engine.m):
                    out[i] = pointer(engine.seen)[i]
            else:  # CVODE has looked for a root on both sides of it
                now, y = min(engine.t, engine.last_instant), engine.y
                size, p = engine.parameter_count, engine.parameters
                call_kernel(engine.margins, engine.mode, 0, now, y, p, size, data(out))

        return implementation


@overload(contract.interpolate, jit_options={**JIT, **INNER})
def _interpolate(engine, t, y):  # type: ignore[no-untyped-def]
    if _is_cvode(engine):

        def implementation(engine, t, y):  # type: ignore[no-untyped-def]
            _dky(engine.cvode, t, 0, engine.dense)
            for i in range(engine.n):
                y[i] = pointer(engine.spare)[i]

        return implementation


@overload(contract.restart, jit_options={**JIT, **INNER})
def _restart(engine, mode, t, y, stop):  # type: ignore[no-untyped-def]
    if _is_cvode(engine):

        def implementation(engine, mode, t, y, stop):  # type: ignore[no-untyped-def]
            for i in range(engine.n):
                pointer(engine.y)[i] = y[i]
            engine.t = t
            engine.mode = mode
            _reinit(engine.cvode, t, engine.vector)
            if stop < math.inf:
                engine.last_instant = np.nextafter(stop, 0.0)
                _set_stop(engine.cvode, stop)
            else:
                engine.last_instant = math.inf
                _clear_stop(engine.cvode)

        return implementation


@overload(contract.renew, jit_options={**JIT, **INNER})
def _renew(engine, max_step):  # type: ignore[no-untyped-def]
    if _is_cvode(engine):
        (first,) = take(first_step).frozen()

        def implementation(engine, max_step):  # type: ignore[no-untyped-def]
            engine.longest = max_step
            engine.share = 1.0
            _set_tolerances(engine.cvode, engine.rtol, engine.atol)
            _set_max_step(engine.cvode, max_step)
            _set_first_step(engine.cvode, first(max_step, engine.rtol, math.inf))

        return implementation


@overload(contract.sharpen, jit_options={**JIT, **INNER})
def _sharpen(engine, share, lasts):  # type: ignore[no-untyped-def]
    if _is_cvode(engine):
        first, sharper = take(first_step, sharpened).frozen()

        def implementation(engine, share, lasts):  # type: ignore[no-untyped-def]
            if share < 1.0 or engine.share < 1.0:
                rtol, atol = sharper(engine.rtol, engine.atol, share)
                engine.share = share
                _set_tolerances(engine.cvode, rtol, atol)
                _set_first_step(engine.cvode, first(engine.longest, rtol, lasts))

        return implementation
