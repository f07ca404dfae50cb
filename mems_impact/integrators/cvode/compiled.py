"""CVODE through SUNDIALS' C interface, with callbacks compiled by numba.

Every function of SUNDIALS that this package calls is declared here, once, with its C signature.
scikit-sundae's wheels contain SUNDIALS as shared libraries with hashed names; on Linux and macOS
opening the extension module that links to them makes the dynamic loader resolve all symbols.

In Python the functions are ctypes functions (`load`). In code compiled by numba they are external
symbols (`symbol`), whose addresses LLVM receives under a prefixed name. Compiled code contains no
address, so it can be cached on disk.

`CompiledCvode` owns the memory of one CVODE object. A loop compiled by numba calls CVODE without
Python, by the functions of `functions`.
"""

from __future__ import annotations

import ctypes
import math
import os
import sys
import weakref
from functools import cache
from importlib.machinery import ModuleSpec, PathFinder
from importlib.util import find_spec, module_from_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numba import from_dtype, types

from mems_impact.errors import EngineUnavailable
from mems_impact.integrators import interface
from mems_impact.integrators.cvode.interpreted import first_step, scaled_tolerances
from mems_impact.integrators.interface import COLUMN_WEIGHT, Equations
from mems_impact.integrators.jit.closures import sources, take_snapshot
from mems_impact.integrators.jit.kernels import (
    ENGINE_FIELDS,
    METHOD_SIGNATURES,
    CompiledEngine,
    call_kernel,
    jacobian_of,
    method_entries,
)
from mems_impact.integrators.jit.numba_support import (
    address,
    compile_callback,
    data,
    pointer,
    record_at,
)
from mems_impact.integrators.options import Options

# --- SUNDIALS' C API

SUPPORTED_MAJOR = 7
LIBRARY_REMEDY = (
    "install a scikit-sundae wheel of version 1.x, use method 'dop853', which needs no SUNDIALS, "
    "or engine 'interpreted'"
)

_int, _real, _ptr = ctypes.c_int32, ctypes.c_double, ctypes.c_void_p

# name: (result, arguments). sunrealtype is double and sunindextype int32 (checked in `load`).
SIGNATURES: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "SUNContext_Create": (_int, (_int, _ptr)),
    "SUNContext_Free": (_int, (_ptr,)),
    "SUNContext_ClearErrHandlers": (_int, (_ptr,)),
    "N_VMake_Serial": (_ptr, (_int, _ptr, _ptr)),
    "N_VDestroy": (None, (_ptr,)),
    "N_VGetArrayPointer_Serial": (_ptr, (_ptr,)),
    "SUNDenseMatrix": (_ptr, (_int, _int, _ptr)),
    "SUNDenseMatrix_Data": (_ptr, (_ptr,)),
    "SUNMatDestroy": (None, (_ptr,)),
    "SUNLinSol_Dense": (_ptr, (_ptr, _ptr, _ptr)),
    "SUNLinSolFree": (_int, (_ptr,)),
    "SUNNonlinSol_FixedPoint": (_ptr, (_ptr, _int, _ptr)),
    "SUNNonlinSolFree": (_int, (_ptr,)),
    "CVodeCreate": (_ptr, (_int, _ptr)),
    "CVodeFree": (None, (_ptr,)),
    "CVodeInit": (_int, (_ptr, _ptr, _real, _ptr)),
    "CVodeReInit": (_int, (_ptr, _real, _ptr)),
    "CVodeSStolerances": (_int, (_ptr, _real, _real)),
    "CVodeWFtolerances": (_int, (_ptr, _ptr)),
    "CVodeSetUserData": (_int, (_ptr, _ptr)),
    "CVodeSetNonlinearSolver": (_int, (_ptr, _ptr)),
    "CVodeSetLinearSolver": (_int, (_ptr, _ptr, _ptr)),
    "CVodeSetJacFn": (_int, (_ptr, _ptr)),
    "CVodeRootInit": (_int, (_ptr, _int, _ptr)),
    "CVodeSetRootDirection": (_int, (_ptr, _ptr)),
    "CVodeSetNoInactiveRootWarn": (_int, (_ptr,)),
    "CVodeSetMaxStep": (_int, (_ptr, _real)),
    "CVodeSetInitStep": (_int, (_ptr, _real)),
    "CVodeSetMaxHnilWarns": (_int, (_ptr, _int)),
    "CVodeSetEtaFixedStepBounds": (_int, (_ptr, _real, _real)),
    "CVodeSetStopTime": (_int, (_ptr, _real)),
    "CVodeClearStopTime": (_int, (_ptr,)),
    "CVode": (_int, (_ptr, _real, _ptr, _ptr, _int)),
    "CVodeGetRootInfo": (_int, (_ptr, _ptr)),
    "CVodeGetDky": (_int, (_ptr, _real, _int, _ptr)),
}

SYMBOL_PREFIX = "mems_impact_"


def load() -> SimpleNamespace:
    """Open SUNDIALS, check it, and return the functions of `SIGNATURES`, known to LLVM.

    Raises `EngineUnavailable` if numba is disabled, or scikit-sundae's build does not match these
    declarations: another major version of SUNDIALS, real or index type, or a missing symbol.
    """
    found = _opened()
    if isinstance(found, EngineUnavailable):
        raise found.with_traceback(None)
    return found


@cache
def _opened() -> SimpleNamespace | EngineUnavailable:
    """Return the functions, or why there are none, which each problem would find out again."""
    try:
        return _open()
    except EngineUnavailable as error:
        return error


def _open() -> SimpleNamespace:
    from mems_impact.integrators.jit.numba_support import check_numba

    check_numba()
    try:
        libraries = [ctypes.CDLL(str(file)) for file in _library_files()]
        config = _build_config()
    except (ImportError, AttributeError, OSError) as error:
        raise EngineUnavailable(
            f"scikit-sundae's CVODE can't be opened: {error}", LIBRARY_REMEDY
        ) from error
    check(config)
    functions = SimpleNamespace()
    for name, (result, arguments) in SIGNATURES.items():
        function = next((f for each in libraries if (f := getattr(each, name, None))), None)
        if function is None:
            files = ", ".join(each._name for each in libraries)
            raise EngineUnavailable(f"SUNDIALS' {name} is not in {files}", LIBRARY_REMEDY)
        function.restype, function.argtypes = result, arguments
        setattr(functions, name, function)

    import llvmlite.binding as llvm

    for name, function in vars(functions).items():
        llvm.add_symbol(SYMBOL_PREFIX + name, ctypes.cast(function, ctypes.c_void_p).value)
    return functions


def _library_files() -> list[Path]:
    """Return the files that contain SUNDIALS' functions, or link to them.

    Linux and macOS find the functions through the extension module, whatever the libraries are
    called. On Windows each library has functions of its own.
    """
    libraries = (file for folder in _dll_folders() for file in folder.glob("*sundials*.dll"))
    return [Path(str(_extension("_cy_cvode").origin)), *sorted(libraries)]


@cache
def _dll_folders() -> list[Path]:
    """Return the folders of SUNDIALS' DLLs, from now on known to the loader; none but on Windows.

    The wheel contains one; conda has a package of its own for SUNDIALS.
    """
    package = find_spec("sksundae")
    if sys.platform != "win32" or package is None:
        return []
    wheel = Path(str(package.origin)).parents[1] / "scikit_sundae.libs"
    folders = [each for each in (wheel, Path(sys.prefix) / "Library" / "bin") if each.is_dir()]
    for folder in folders:
        os.add_dll_directory(str(folder))
    return folders


def _extension(name: str) -> ModuleSpec:
    """Find an extension module of scikit-sundae without its package, which imports scipy.optimize.

    That would take a third of the time until a first run.
    """
    _dll_folders()
    package = find_spec("sksundae")
    path = package.submodule_search_locations if package is not None else None
    spec = PathFinder.find_spec(f"sksundae.{name}", path) if path is not None else None
    if spec is None:
        raise ImportError(f"there is no sksundae.{name}")
    return spec


def _build_config() -> dict[str, str]:
    """Return how scikit-sundae's SUNDIALS was built."""
    spec = _extension("_cy_common")
    module = sys.modules.get(spec.name)
    if module is None:
        module = module_from_spec(spec)
        assert spec.loader is not None
        spec.loader.exec_module(module)
    config: dict[str, str] = module.config
    return config


def sundials_version() -> str:
    """Return the version of SUNDIALS in scikit-sundae; empty if there is none."""
    try:
        return str(_build_config().get("SUNDIALS_VERSION", ""))
    except (ImportError, AttributeError):
        return ""


def check(config: dict[str, str]) -> None:
    """Raise EngineUnavailable unless scikit-sundae's `config` matches the declarations here."""
    expected = {"SUNDIALS_FLOAT_TYPE": "double", "SUNDIALS_INT_TYPE": "int"}
    for key, value in expected.items():
        if config.get(key) != value:
            reason = f"{key} is {config.get(key)!r} where the bindings need {value!r}"
            raise EngineUnavailable(reason, LIBRARY_REMEDY)
    version = str(config.get("SUNDIALS_VERSION", ""))
    if version.split(".")[0] != str(SUPPORTED_MAJOR):
        reason = f"SUNDIALS_VERSION is {version!r} where the bindings need {SUPPORTED_MAJOR}.x"
        raise EngineUnavailable(reason, LIBRARY_REMEDY)


def symbol(name: str) -> Any:
    """Return the function `name` for numba code; `load` must run before the code does."""
    from numba import types

    numba_types: dict[Any, Any] = {None: types.void, _int: types.int32}
    numba_types |= {_real: types.float64, _ptr: types.intp}
    result, arguments = SIGNATURES[name]
    signature = numba_types[result](*(numba_types[argument] for argument in arguments))
    return types.ExternalFunction(SYMBOL_PREFIX + name, signature)


# --- Callbacks of CVODE: right-hand side, roots, Jacobian

_data = symbol("N_VGetArrayPointer_Serial")
_matrix_data = symbol("SUNDenseMatrix_Data")

CALLBACK = types.int32(types.float64, types.intp, types.intp, types.intp)
WEIGHTS_CALLBACK = types.int32(*[types.intp] * 3)
JACOBIAN_CALLBACK = types.int32(types.float64, *[types.intp] * 7)

# User data of CVODE's callbacks.
HANDLE = np.dtype(
    [
        *ENGINE_FIELDS,
        ("cvode", np.int64),
        ("vector", np.int64),  # N_Vector around y
        ("dense", np.int64),  # N_Vector around spare
        ("spare", np.int64),
        ("jacobian", np.int64),
        ("last_margins", np.int64),  # margins and rates of the last evaluation, and its time
        ("last_time", np.float64),
        ("rtol", np.float64),
        ("atol", np.float64),
        ("share", np.float64),  # factor on the tolerances of the last arc
        ("max_step", np.float64),  # longest step
        ("longest", np.float64),  # the same in this arc
    ],
    align=True,
)
_handle = record_at(from_dtype(HANDLE))


class Callbacks(NamedTuple):
    """Callbacks of CVODE: C functions over a HANDLE."""

    rhs: Any
    roots: Any


@cache
def callbacks() -> Callbacks:
    """Compile the two callbacks of CVODE; they call the automaton through the handle."""
    load()  # before anything that names a symbol of SUNDIALS is linked

    def rhs(t, y, dy, user):  # type: ignore[no-untyped-def]
        handle = _handle(user)
        slope = _data(dy)
        time = min(t, handle.last_instant)
        size, p = handle.parameter_count, handle.parameters
        call_kernel(handle.flow, handle.mode, 0, time, _data(y), p, size, slope)
        total = 0.0
        for i in range(handle.n):
            total += abs(pointer(slope)[i])
        return 0 if math.isfinite(total) else -1

    def roots(t, y, out, user):  # type: ignore[no-untyped-def]
        handle = _handle(user)
        m = handle.m
        state = _data(y)
        time = min(t, handle.last_instant)
        size, p = handle.parameter_count, handle.parameters
        call_kernel(handle.margins, handle.mode, 0, time, state, p, size, out)
        values, bias = pointer(out), pointer(handle.bias)
        last_margins = pointer(handle.last_margins)
        handle.last_time = t
        for i in range(2 * m):
            last_margins[i] = values[i]
        for i in range(m):
            if math.isnan(values[i]) or math.isnan(values[m + i]):
                return -1
            values[i] += bias[i]
            values[m + i] += bias[m + i]
            # CVODE accepts a zero at the end of a step as the root, and misses an earlier one: for
            # example the rate of a waveform with zero slope at a switch.
            if values[m + i] == 0.0:
                values[m + i] = 1e-300
        values[2 * m] = 1.0
        if handle.section >= 0:
            values[2 * m] = pointer(state)[handle.section] - handle.level
        return 0

    name = sources()
    return Callbacks(compile_callback(rhs, CALLBACK, name), compile_callback(roots, CALLBACK, name))


@cache
def weights_callback() -> Any:
    """Compile the callback for the weights of errors of state and columns.

    CVODE's norm is the root of the mean square over all components.
    """
    load()

    def error_weights(y, out, user):  # type: ignore[no-untyped-def]
        handle = _handle(user)
        n, columns = handle.states, handle.perturbations
        values, weights, rtol = pointer(_data(y)), pointer(_data(out)), handle.rtol
        factor = math.sqrt(1.0 + columns)
        for i in range(n):
            weights[i] = factor / (rtol * abs(values[i]) + handle.atol)
        for c in range(columns):
            size = 1.0
            for i in range(n):
                size = max(size, abs(values[n + columns * i + c]))
            for i in range(n):
                j = n + columns * i + c
                weights[j] = COLUMN_WEIGHT * factor / (rtol * abs(values[j]) + handle.atol * size)
        return 0

    return compile_callback(error_weights, WEIGHTS_CALLBACK, sources())


@cache
def jacobian_callback() -> Any:
    """Compile the callback for the Jacobian."""
    load()

    def jacobian(t, y, slope, out, user, work1, work2, work3):  # type: ignore[no-untyped-def]
        handle = _handle(user)
        time = min(t, handle.last_instant)
        size, p = handle.parameter_count, handle.parameters
        entries = _matrix_data(out)
        for i in range(handle.n * handle.n):
            pointer(entries)[i] = 0.0
        call_kernel(handle.jacobian, handle.mode, 0, time, _data(y), p, size, entries)
        return 0

    return compile_callback(jacobian, JACOBIAN_CALLBACK, sources())


# --- Compiled engine

CV_ADAMS, CV_BDF, CV_ONE_STEP = 1, 2, 2

_cvode = symbol("CVode")
_reinit = symbol("CVodeReInit")
_root_info = symbol("CVodeGetRootInfo")
_dky = symbol("CVodeGetDky")
_set_stop = symbol("CVodeSetStopTime")
_clear_stop = symbol("CVodeClearStopTime")
_set_max_step = symbol("CVodeSetMaxStep")
_set_first_step = symbol("CVodeSetInitStep")
_set_tolerances = symbol("CVodeSStolerances")
_T_OFFSET = HANDLE.fields["t"][1]  # type: ignore[index]


def _step(engine: Any) -> int:
    # CVODE uses the end of the interval for direction and first step only.
    time = address(engine) + _T_OFFSET
    flag = _cvode(engine.cvode, engine.t + 1.0, engine.vector, time, CV_ONE_STEP)
    if flag == interface.ROOT:
        _root_info(engine.cvode, engine.fired)
    return int(flag)


def _end_margins(engine: Any, out: Any) -> None:
    if engine.last_time == engine.t:
        for i in range(2 * engine.m):
            out[i] = pointer(engine.last_margins)[i]
    else:  # the root search evaluated other times afterwards
        time, y = min(engine.t, engine.last_instant), engine.y
        size, p = engine.parameter_count, engine.parameters
        call_kernel(engine.margins, engine.mode, 0, time, y, p, size, data(out))


def _interpolate(engine: Any, t: float, y: Any) -> None:
    status = _dky(engine.cvode, t, 0, engine.dense)
    for i in range(engine.n):  # no value outside the last step, in place of the former one
        y[i] = pointer(engine.spare)[i] if status == 0 else math.nan


def _restart(engine: Any, mode: int, t: float, y: Any, stop: float) -> None:
    for i in range(engine.n):
        pointer(engine.y)[i] = y[i]
    engine.t = t
    engine.mode = mode
    _reinit(engine.cvode, t, engine.vector)
    if engine.longest != engine.max_step:
        _lengthen(engine, engine.max_step)
    if stop < math.inf:
        engine.last_instant = np.nextafter(stop, 0.0)
        _set_stop(engine.cvode, stop)
    else:
        engine.last_instant = math.inf
        _clear_stop(engine.cvode)


def _sharpen(engine: Any, share: float, flight_time: float) -> None:
    if share < 1.0 or engine.share < 1.0:
        rtol, atol = scaled_tolerances(engine.rtol, engine.atol, share)
        engine.share = share
        if engine.states == engine.n:
            _set_tolerances(engine.cvode, rtol, atol)
        _set_first_step(engine.cvode, first_step(engine.max_step, rtol, flight_time))


def _lengthen(engine: Any, longest: float) -> None:
    engine.longest = longest
    _set_max_step(engine.cvode, longest)


def _reset(engine: Any, max_step: float) -> None:
    engine.max_step = max_step
    engine.share = 1.0
    if engine.states == engine.n:
        _set_tolerances(engine.cvode, engine.rtol, engine.atol)
    _lengthen(engine, max_step)
    _set_first_step(engine.cvode, first_step(max_step, engine.rtol, math.inf))


def _method_memory(engine: Any, mode: int) -> int:
    return 0


@cache
def functions() -> dict[str, Any]:
    """Compile the functions of the method over a HANDLE, or load them from the cache."""
    load()  # before anything that names a symbol of SUNDIALS is linked
    frozen = take_snapshot(
        _step, _end_margins, _interpolate, _restart, _sharpen, _lengthen, _reset, _method_memory
    ).frozen()
    return {
        entry.__name__: compile_callback(entry, METHOD_SIGNATURES[entry.__name__], sources())
        for entry in method_entries("cvode", _handle, frozen)
    }


def prepare() -> None:
    """Bind SUNDIALS; raise EngineUnavailable if that fails."""
    load()


class CompiledCvode(CompiledEngine):
    """One CVODE object whose callbacks are compiled; its memory is freed with it.

    The parameters are those of `mems_impact.integrators.cvode.interpreted.InterpretedCvode`.
    Adams runs with fixed-point iteration, which needs no matrix; BDF with Newton's method and a
    dense matrix.
    """

    def __init__(self, equations: Equations, options: Options, max_step: float) -> None:
        sun = load()
        n, m, jacobian = equations.n, equations.m, equations.jacobian
        super().__init__(HANDLE, equations, {"spare": n, "last_margins": 2 * m}, functions())
        handle, direction = self.handle, equations.crossing[2]
        self._callbacks = callbacks()
        context = ctypes.c_void_p()
        sun.SUNContext_Create(0, ctypes.byref(context))
        # The default handler prints to standard error; the return codes suffice.
        sun.SUNContext_ClearErrHandlers(context)
        vector = sun.N_VMake_Serial(n, int(handle["y"]), context)
        dense = sun.N_VMake_Serial(n, int(handle["spare"]), context)
        bdf = options.method == "bdf"
        memory = sun.CVodeCreate(CV_BDF if bdf else CV_ADAMS, context)
        handle["cvode"], handle["vector"], handle["dense"] = memory, vector, dense
        objects = _Objects(sun, context, memory, [vector, dense])
        self._finalizer = weakref.finalize(self, objects.free)

        _check_flag(sun.CVodeInit(memory, self._callbacks.rhs.address, 0.0, vector), "CVodeInit")
        flag = sun.CVodeSStolerances(memory, options.rtol, options.atol)
        _check_flag(flag, "CVodeSStolerances")
        if equations.columns:
            flag = sun.CVodeWFtolerances(memory, weights_callback().address)
            _check_flag(flag, "CVodeWFtolerances")
        handle["rtol"], handle["atol"] = options.rtol, options.atol
        handle["share"], handle["max_step"], handle["longest"] = 1.0, max_step, max_step
        _check_flag(sun.CVodeSetUserData(memory, self.address), "CVodeSetUserData")
        if bdf:
            objects.matrix = sun.SUNDenseMatrix(n, n, context)
            objects.linear = sun.SUNLinSol_Dense(vector, objects.matrix, context)
            flag = sun.CVodeSetLinearSolver(memory, objects.linear, objects.matrix)
            _check_flag(flag, "CVodeSetLinearSolver")
            if jacobian is not None:
                self._jacobian = jacobian_of(jacobian, n, equations.jacobian_memory)
                handle["jacobian"] = self._jacobian.address
                flag = sun.CVodeSetJacFn(memory, jacobian_callback().address)
                _check_flag(flag, "CVodeSetJacFn")
        else:
            objects.nonlinear = sun.SUNNonlinSol_FixedPoint(vector, 0, context)
            _check_flag(
                sun.CVodeSetNonlinearSolver(memory, objects.nonlinear), "CVodeSetNonlinearSolver"
            )
            # By default the step grows only if it may grow by half, and an arc between two impacts
            # ends before the order has increased: 1.2 saves a sixth of the steps on the paper's
            # set, with a smaller error.
            _check_flag(
                sun.CVodeSetEtaFixedStepBounds(memory, 0.0, 1.2), "CVodeSetEtaFixedStepBounds"
            )
        flag = sun.CVodeRootInit(memory, 2 * m + 1, self._callbacks.roots.address)
        _check_flag(flag, "CVodeRootInit")
        directions = np.array([-1] * m + [1] * m + [direction], dtype=np.int32)
        flag = sun.CVodeSetRootDirection(memory, directions.ctypes.data)
        _check_flag(flag, "CVodeSetRootDirection")
        _check_flag(sun.CVodeSetNoInactiveRootWarn(memory), "CVodeSetNoInactiveRootWarn")
        _check_flag(sun.CVodeSetMaxStep(memory, max_step), "CVodeSetMaxStep")
        _check_flag(sun.CVodeSetMaxHnilWarns(memory, -1), "CVodeSetMaxHnilWarns")
        initial_step = first_step(max_step, options.rtol, math.inf)
        _check_flag(sun.CVodeSetInitStep(memory, initial_step), "CVodeSetInitStep")

    def close(self) -> None:
        """Free CVODE's memory before the object is destroyed."""
        self._finalizer()


class _Objects:
    """The C objects of one engine, freed in the order that SUNDIALS requires."""

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


def _check_flag(flag: int, name: str) -> None:
    if flag < 0:
        raise RuntimeError(f"{name} failed with code {flag}")
