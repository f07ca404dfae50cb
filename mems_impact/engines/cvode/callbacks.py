"""What CVODE calls back, compiled to C functions: right-hand side, roots, Jacobian."""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import from_dtype, types

from mems_impact.engines.cache import compile_callback
from mems_impact.engines.compiling import pointer, record_at
from mems_impact.engines.cvode import library
from mems_impact.engines.kernels import FIELDS, call_kernel
from mems_impact.engines.snapshot import sources

_data = library.symbol("N_VGetArrayPointer_Serial")
_matrix_data = library.symbol("SUNDenseMatrix_Data")

CALLBACK = types.int32(types.float64, types.intp, types.intp, types.intp)
JACOBIAN_CALLBACK = types.int32(types.float64, *[types.intp] * 7)

# It lies where CVODE's callbacks find it as user data.
HANDLE = np.dtype(
    [
        ("cvode", np.int64),
        ("vector", np.int64),  # N_Vector around y
        ("dense", np.int64),  # N_Vector around spare
        ("spare", np.int64),
        ("jacobian", np.int64),
        ("seen", np.int64),  # what the root functions were made of when last asked for, and when
        ("seen_at", np.float64),
        ("rtol", np.float64),
        ("atol", np.float64),
        ("share", np.float64),  # of the tolerances, that of the last arc
        ("longest", np.float64),  # step
        *FIELDS,
    ],
    align=True,
)
_handle = record_at(from_dtype(HANDLE))


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
        values, bias, seen = pointer(out), pointer(handle.bias), pointer(handle.seen)
        handle.seen_at = t
        for i in range(2 * m):
            seen[i] = values[i]
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
    return Callbacks(compile_callback(rhs, CALLBACK, name), compile_callback(roots, CALLBACK, name))


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
