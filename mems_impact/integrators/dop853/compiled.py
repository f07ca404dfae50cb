"""DOP853 in compiled code.

The stepper is compiled to C functions over the address of a HANDLE and cached on disk; the handle
has the addresses of the automaton's functions. SUNDIALS is not required.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import from_dtype, types
from numba.extending import overload

from mems_impact.integrators.dop853 import stepper
from mems_impact.integrators.dop853.stepper import ENGINE_NUMBERS, LOW, ROWS, STATE
from mems_impact.integrators.interface import Equations
from mems_impact.integrators.jit.closures import mark_overloaded, sources, take_snapshot
from mems_impact.integrators.jit.kernels import (
    ENGINE_FIELDS,
    METHOD_SIGNATURES,
    CompiledEngine,
    is_handle,
    method_entries,
)
from mems_impact.integrators.jit.lanes import LANE_BITS, LANES, Lanes, strided_at
from mems_impact.integrators.jit.numba_support import (
    INNER,
    JIT,
    WORD,
    address,
    caller,
    check_numba,
    compile_callback,
    integers,
    pointer,
    record_at,
)
from mems_impact.integrators.options import Options

_WORDS = ("rows", "width", "components", "approaches", "direction", "begun", "rest", "has_dense")
_COUNTS = ("at_border", "off_border", "stiff", "steps")
_REALS = ("rtol", "atol", "max_step", "longest", "t_start", "t_end", "stop", "h_next")
HANDLE = np.dtype(
    [
        *ENGINE_FIELDS,
        *((name, np.int64) for name in ("stages", "dense", *_WORDS, *_COUNTS)),
        *((name, np.float64) for name in _REALS),
    ],
    align=True,
)
# Fused multiply-add saves 5 % of the time. Automata are compiled without it, since exact zeros of
# differences must be preserved.
CONTRACTED = {"fastmath": {"contract"}}
# The same record, for code that computes groups of components at once. Few components are computed
# faster one by one, since a vector is read late from memory that has been written by numbers.
WIDE = np.dtype([*HANDLE.descr, ("wide", np.int64)], align=True)
_handle, _wide = record_at(from_dtype(HANDLE)), record_at(from_dtype(WIDE))

# Numbers of a component, and vectors of a group or a row.
_numbers_at, _vectors_at = strided_at(LANES, 1), strided_at(LANES, LANES)
_adjacent_at = strided_at(1, LANES)

_word, _real = types.int64, types.float64
SIGNATURES = {
    **METHOD_SIGNATURES,
    "stages": _real(_word, _real, _real),
    "dense": types.void(_word, _real, _real),
}


def prepare() -> None:
    """Raise EngineUnavailable if numba is disabled."""
    check_numba()


class CompiledDop853(CompiledEngine):
    """A handle for the compiled stepper.

    The parameters are those of `mems_impact.integrators.cvode.interpreted.InterpretedCvode`; an
    explicit method does not use the Jacobian.
    """

    def __init__(self, equations: Equations, options: Options, max_step: float) -> None:
        size = -(-equations.n // LANES) * LANES  # the last group has components of zero
        width = max(size, 2 * equations.m + 2)
        # A group may begin at the last component of the last row.
        arrays = {"rows": ROWS * width + LANES, "components": size * ENGINE_NUMBERS}
        super().__init__(HANDLE, equations, arrays, functions(wide=equations.columns > 0))
        handle = self.handle
        self._approaches = np.array(equations.approaches, dtype=np.float64)
        handle["approaches"] = self._approaches.ctypes.data
        handle["y"] = handle["rows"] + WORD * width * STATE
        handle["width"] = width
        handle["direction"] = equations.crossing[2]
        handle["rtol"], handle["atol"] = options.rtol, options.atol
        handle["max_step"] = max_step

    def is_stiff(self) -> bool:
        """Return whether stability, not accuracy, has limited steps."""
        return bool(self.handle["stiff"] == 1)


def end_margins(engine: Any, out: Any) -> None:
    """Write margins and rates at the present time into `out`."""
    low = stepper.row(engine, LOW)
    for i in range(2 * engine.m):
        out[i] = low[i]


def sharpen(engine: Any, share: float, flight_time: float) -> None:
    """Do nothing: errors in short flights are far smaller than the tolerance."""


def method_memory(engine: Any, mode: int) -> int:
    """Return 0: a single method has no memory."""
    return 0


@cache
def functions(wide: bool) -> dict[str, Any]:
    """Compile the stepper to C functions over a HANDLE, or WIDE, or load them from the cache."""
    method, handle = ("dop853_wide", _wide) if wide else ("dop853", _handle)
    run_stages, run_dense, run_step, run_interpolate = take_snapshot(
        stepper.stages, stepper.dense, stepper.step, stepper.interpolate
    ).frozen(**CONTRACTED)
    run_end_margins, run_restart, run_sharpen, run_lengthen, run_reset, run_method_memory = (
        take_snapshot(
            end_margins, stepper.restart, sharpen, stepper.lengthen, stepper.reset, method_memory
        ).frozen()
    )

    def stages(engine, t, h):  # type: ignore[no-untyped-def]
        return run_stages(handle(engine), t, h)

    def dense(engine, t, h):  # type: ignore[no-untyped-def]
        run_dense(handle(engine), t, h)

    entries: list[Callable[..., Any]] = [stages, dense]
    for entry in entries:
        entry.__qualname__ = f"{method}_{entry.__name__}"
    entries += method_entries(
        method,
        handle,
        (
            run_step,
            run_end_margins,
            run_interpolate,
            run_restart,
            run_sharpen,
            run_lengthen,
            run_reset,
            run_method_memory,
        ),
    )
    contracted = {"stages", "dense", "step", "interpolate"}
    return {
        function.__name__: compile_callback(
            function,
            SIGNATURES[function.__name__],
            sources(),
            **(CONTRACTED if function.__name__ in contracted else {}),
        )
        for function in entries
    }


def _is_onestep(kind: Any) -> bool:
    return is_handle(kind) and "h_next" in kind.fields


def _is_wide(kind: Any) -> bool:
    return _is_onestep(kind) and "wide" in kind.fields


mark_overloaded(
    stepper.row,
    stepper.component,
    stepper.groups,
    stepper.group,
    stepper.group_size,
    stepper.grouped,
    stepper.adjacent,
    stepper.sum_of,
    stepper.largest_of,
    stepper.records_approaches,
    stepper.set_fired,
    stepper.try_step,
    stepper.make_dense,
)


@overload(stepper.row, jit_options={**JIT, **INNER})
def _row(engine, i):  # type: ignore[no-untyped-def]
    if _is_onestep(engine):
        return lambda engine, i: pointer(engine.rows + WORD * engine.width * i)


@overload(stepper.component, jit_options={**JIT, **INNER})
def _component(engine, j):  # type: ignore[no-untyped-def]
    if _is_wide(engine):
        skipped = LANES * (ENGINE_NUMBERS - 1)  # numbers of a group between components
        return lambda engine, j: _numbers_at(
            engine.components + WORD * (j + skipped * (j >> LANE_BITS))
        )
    if _is_onestep(engine):
        return lambda engine, j: pointer(engine.components + WORD * ENGINE_NUMBERS * j)


@overload(stepper.groups, jit_options={**JIT, **INNER})
def _groups(engine):  # type: ignore[no-untyped-def]
    if _is_wide(engine):
        return lambda engine: (engine.n + LANES - 1) // LANES
    if _is_onestep(engine):
        return lambda engine: engine.n


@overload(stepper.group, jit_options={**JIT, **INNER})
def _group(engine, j):  # type: ignore[no-untyped-def]
    if _is_wide(engine):
        return lambda engine, j: _vectors_at(engine.components + WORD * ENGINE_NUMBERS * LANES * j)
    if _is_onestep(engine):
        return lambda engine, j: stepper.component(engine, j)


@overload(stepper.group_size, jit_options={**JIT, **INNER})
def _group_size(engine):  # type: ignore[no-untyped-def]
    if _is_wide(engine):
        return lambda engine: LANES
    if _is_onestep(engine):
        return lambda engine: 1


@overload(stepper.adjacent, jit_options={**JIT, **INNER})
def _adjacent(engine, i):  # type: ignore[no-untyped-def]
    if _is_wide(engine):
        return lambda engine, i: _adjacent_at(engine.rows + WORD * engine.width * i)
    if _is_onestep(engine):
        return lambda engine, i: stepper.row(engine, i)


@overload(stepper.sum_of, jit_options={**JIT, **INNER})
def _sum_of(group):  # type: ignore[no-untyped-def]
    if isinstance(group, Lanes):
        return lambda group: (group[0] + group[1]) + (group[2] + group[3])
    return lambda group: group


@overload(stepper.largest_of, jit_options={**JIT, **INNER})
def _largest_of(group):  # type: ignore[no-untyped-def]
    if isinstance(group, Lanes):
        return lambda group: max(max(group[0], group[1]), max(group[2], group[3]))
    return lambda group: group


@overload(stepper.grouped, jit_options={**JIT, **INNER})
def _grouped(engine, i):  # type: ignore[no-untyped-def]
    if _is_wide(engine):
        return lambda engine, i: _vectors_at(engine.rows + WORD * engine.width * i)
    if _is_onestep(engine):
        return lambda engine, i: stepper.row(engine, i)


@overload(stepper.records_approaches, jit_options={**JIT, **INNER})
def _records_approaches(engine, i):  # type: ignore[no-untyped-def]
    if _is_onestep(engine):
        return lambda engine, i: (
            engine.approach_search == 1 and pointer(engine.approaches)[i] == 1.0
        )


@overload(stepper.set_fired, jit_options={**JIT, **INNER})
def _set_fired(engine, i, direction):  # type: ignore[no-untyped-def]
    if _is_onestep(engine):

        def implementation(engine, i, direction):  # type: ignore[no-untyped-def]
            integers(engine.fired)[i] = direction

        return implementation


# Calls of the compiled functions by their addresses in the handle.
_call_stages = caller(SIGNATURES["stages"])
_call_dense = caller(SIGNATURES["dense"])


@overload(stepper.try_step, jit_options={**JIT, **INNER})
def _try_step(engine, t, h):  # type: ignore[no-untyped-def]
    if _is_onestep(engine):
        return lambda engine, t, h: _call_stages(engine.stages, (address(engine), t, h))


@overload(stepper.make_dense, jit_options={**JIT, **INNER})
def _make_dense(engine, t, h):  # type: ignore[no-untyped-def]
    if _is_onestep(engine):
        return lambda engine, t, h: _call_dense(engine.dense, (address(engine), t, h))
