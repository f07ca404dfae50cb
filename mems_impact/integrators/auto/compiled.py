"""Automatic switching between DOP853 and BDF in compiled code."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numba import from_dtype
from numba.extending import overload

from mems_impact.integrators import interface
from mems_impact.integrators.auto import stiffness
from mems_impact.integrators.auto.stiffness import IMPLICIT, MEMORY, ROWS
from mems_impact.integrators.cvode import compiled as cvode
from mems_impact.integrators.cvode.compiled import HANDLE as CVODE_HANDLE
from mems_impact.integrators.dop853 import compiled as onestep
from mems_impact.integrators.interface import Equations
from mems_impact.integrators.jit.closures import mark_overloaded, sources, take_snapshot
from mems_impact.integrators.jit.kernels import (
    ENGINE_FIELDS,
    METHOD_SIGNATURES,
    CompiledEngine,
    is_handle,
    method_entries,
)
from mems_impact.integrators.jit.numba_support import (
    INNER,
    JIT,
    WORD,
    compile_callback,
    pointer,
    record_at,
)
from mems_impact.integrators.options import Options

_WORDS = ("explicit", "implicit", "rows", "width", "modes")
_COUNTS = ("now", "wanted", "handed_over", "trial", "checks", "steps", "directed", "begun",
           "suspected", "patience")  # fmt: skip
_REALS = ("rtol", "atol", "longest", "longest_before", "t_begin", "t_middle")
HANDLE = np.dtype(
    [
        *ENGINE_FIELDS,
        *((name, np.int64) for name in (*_WORDS, *_COUNTS)),
        *((name, np.float64) for name in _REALS),
    ],
    align=True,
)
_handle = record_at(from_dtype(HANDLE))
_explicit_at = record_at(from_dtype(onestep.HANDLE))
_implicit_at = record_at(from_dtype(CVODE_HANDLE))


def prepare() -> None:
    """Bind SUNDIALS; raises EngineUnavailable where that cannot be done."""
    cvode.prepare()


class CompiledAuto(CompiledEngine):
    """A handle for both engines, which share its parameters and biases.

    Parameters are as in `mems_impact.integrators.cvode.interpreted.InterpretedCvode`.
    """

    def __init__(self, equations: Equations, options: Options, max_step: float) -> None:
        width = max(equations.n, equations.modes)
        super().__init__(HANDLE, equations, {"rows": ROWS * width}, functions())
        self._explicit = onestep.CompiledDop853(
            equations, replace(options, method="dop853"), max_step
        )
        self._implicit = cvode.CompiledCvode(equations, replace(options, method="bdf"), max_step)
        handle = self.handle
        for one in (self._explicit, self._implicit):
            one.handle["parameters"], one.handle["bias"] = handle["parameters"], handle["bias"]
        handle["explicit"], handle["implicit"] = self._explicit.address, self._implicit.address
        handle["width"], handle["rtol"], handle["atol"] = width, options.rtol, options.atol
        handle["modes"] = equations.modes
        first = int(handle["rows"] - self.memory.ctypes.data) // WORD + MEMORY * width
        self._mode_memory = self.memory[first : first + equations.modes]

    @property
    def implicit_arcs(self) -> int:
        """Arcs that BDF has begun so far."""
        return int(self.handle["begun"])

    def export_memory(self) -> tuple[int, ...]:
        """Return the memory of each mode; see `stiffness`."""
        return tuple(map(int, self._mode_memory.tolist()))

    def import_memory(self, memory: tuple[int, ...]) -> None:
        """Set the memory of each mode."""
        self._mode_memory[: len(memory)] = memory

    def close(self) -> None:
        """Free CVODE's memory now rather than with the object."""
        self._implicit.close()


def _end_margins(engine: Any, out: Any) -> None:
    if engine.now == IMPLICIT:
        interface.end_margins(stiffness.implicit(engine), out)
    else:
        interface.end_margins(stiffness.explicit(engine), out)


def _interpolate(engine: Any, t: float, y: Any) -> None:
    if engine.now == IMPLICIT:
        interface.interpolate(stiffness.implicit(engine), t, y)
    else:
        interface.interpolate(stiffness.explicit(engine), t, y)


@cache
def functions() -> dict[str, Any]:
    """Compile the functions of the method over a HANDLE, or load them from the cache."""
    frozen = take_snapshot(
        stiffness.step,
        _end_margins,
        _interpolate,
        stiffness.restart,
        stiffness.sharpen,
        stiffness.lengthen,
        stiffness.reset,
        stiffness.method_memory,
    ).frozen()
    return {
        entry.__name__: compile_callback(entry, METHOD_SIGNATURES[entry.__name__], sources())
        for entry in method_entries("auto", _handle, frozen)
    }


def _is_auto(kind: Any) -> bool:
    return is_handle(kind) and "implicit" in kind.fields


mark_overloaded(stiffness.explicit, stiffness.implicit, stiffness.mirror_active, stiffness.row)


@overload(stiffness.explicit, jit_options={**JIT, **INNER})
def _explicit(engine):  # type: ignore[no-untyped-def]
    if _is_auto(engine):
        return lambda engine: _explicit_at(engine.explicit)


@overload(stiffness.implicit, jit_options={**JIT, **INNER})
def _implicit(engine):  # type: ignore[no-untyped-def]
    if _is_auto(engine):
        return lambda engine: _implicit_at(engine.implicit)


@overload(stiffness.mirror_active, jit_options={**JIT, **INNER})
def _mirror_active(engine, one):  # type: ignore[no-untyped-def]
    if _is_auto(engine):

        def implementation(engine, one):  # type: ignore[no-untyped-def]
            engine.t = one.t
            engine.y = one.y
            engine.fired = one.fired

        return implementation


@overload(stiffness.row, jit_options={**JIT, **INNER})
def _row(engine, i):  # type: ignore[no-untyped-def]
    if _is_auto(engine):
        return lambda engine, i: pointer(engine.rows + WORD * engine.width * i)
