"""The one-step method compiled by numba: the text of `stepper`, once for all automata.

The stepper becomes C functions over the address of a HANDLE, kept in numba's cache on disk; they
reach the automaton through the addresses in it. Nothing here needs SUNDIALS.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import cfunc, from_dtype, types
from numba.extending import intrinsic, overload

from mems_impact.engines import contract
from mems_impact.engines.compiling import (
    INNER,
    JIT,
    address,
    array,
    fingerprint,
    integers,
    make_compilable,
    mark_compilable,
    record_at,
    table,
)
from mems_impact.engines.handles import HandleOwner, is_handle
from mems_impact.engines.kernels import FIELDS
from mems_impact.engines.onestep import method, stepper
from mems_impact.engines.onestep.method import ROWS, STATE
from mems_impact.engines.options import Options

_WORDS = ("step", "interpolate", "rows", "width", "direction", "begun", "rest", "dense")
_COUNTS = ("at_border", "off_border", "stiff", "steps", "evaluations")
_REALS = ("rtol", "atol", "max_step", "t_start", "t_end", "stop", "h_next", "error")
HANDLE = np.dtype(
    [
        *((name, np.int64) for name in (*_WORDS, *_COUNTS)),
        *((name, np.float64) for name in _REALS),
        *FIELDS,
    ],
    align=True,
)
_handle = record_at(from_dtype(HANDLE))

_word, _real = types.int64, types.float64
STEP = _word(_word)
INTERPOLATE = types.void(_word, _real, _word)


class Engine(HandleOwner):
    """A handle for the compiled stepper.

    The parameters are those of `mems_impact.engines.cvode.interpreted.Engine`; an explicit method
    has no use for the Jacobian.
    """

    def __init__(
        self,
        flow: Callable[..., Any],
        margins: Callable[..., Any],
        transition: Callable[..., Any],
        jacobian: Callable[..., Any] | None = None,
        *,
        n: int,
        m: int,
        parameters: Any,
        options: Options,
        max_step: float,
        section: tuple[int, float, int] | None = None,
    ) -> None:
        rows = np.zeros((ROWS, max(n, 2 * m + 1)))
        super().__init__(
            HANDLE, flow, margins, transition, n=n, m=m, parameters=parameters, section=section,
            arrays={"rows": rows, "y": rows[STATE]},
        )  # fmt: skip
        self._functions = functions()
        handle = self.handle
        handle.step = self._functions.step.address
        handle.interpolate = self._functions.interpolate.address
        handle.width = rows.shape[1]
        handle.direction = section[2] if section is not None else 0
        handle.rtol, handle.atol, handle.max_step = options.rtol, options.atol, max_step
        handle.error = 1.0

    @property
    def stiff(self) -> int:
        """1 once steps have been limited by stability rather than accuracy."""
        return int(self.handle.stiff)

    def close(self) -> None:
        """Do nothing: the memory goes with the object."""


class Stepper(NamedTuple):
    """The stepper as C functions over the address of a HANDLE."""

    step: Any
    interpolate: Any


@cache
def functions() -> Stepper:
    """Compile the stepper, or find it in the cache."""
    make_compilable(stepper.step)
    make_compilable(stepper.interpolate)
    stamp = fingerprint()

    @cfunc(STEP, cache=True, **JIT)
    def step(engine):  # type: ignore[no-untyped-def]
        _ = stamp
        handle = _handle(engine)
        return stepper.step(handle, table(handle.rows, ROWS, handle.width))

    @cfunc(INTERPOLATE, cache=True, **JIT)
    def interpolate(engine, t, y):  # type: ignore[no-untyped-def]
        _ = stamp
        handle = _handle(engine)
        w = table(handle.rows, ROWS, handle.width)
        stepper.interpolate(handle, w, t, array(y, handle.n))

    return Stepper(step, interpolate)


def _is_onestep(kind: Any) -> bool:
    return is_handle(kind) and "h_next" in kind.fields


mark_compilable(method.set_fired)
make_compilable(stepper.restart)


@overload(method.set_fired, jit_options={**JIT, **INNER})
def _set_fired(engine, i, direction):  # type: ignore[no-untyped-def]
    if _is_onestep(engine):

        def implementation(engine, i, direction):  # type: ignore[no-untyped-def]
            integers(engine.fired)[i] = direction

        return implementation


@intrinsic
def _call_step(_typing: Any, function: Any, engine: Any) -> Any:
    """Call the STEP at the address `function`."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        word = ir.IntType(64)
        kind = ir.FunctionType(word, [word])
        return builder.call(builder.inttoptr(args[0], kind.as_pointer()), args[1:])

    return _word(_word, _word), codegen


@intrinsic
def _call_interpolate(_typing: Any, function: Any, engine: Any, t: Any, y: Any) -> Any:
    """Call the INTERPOLATE at the address `function`."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        word = ir.IntType(64)
        kind = ir.FunctionType(ir.VoidType(), [word, ir.DoubleType(), word])
        builder.call(builder.inttoptr(args[0], kind.as_pointer()), args[1:])
        return _context.get_dummy_value()

    return types.void(_word, _word, _real, _word), codegen


@overload(contract.step, jit_options={**JIT, **INNER})
def _step(engine):  # type: ignore[no-untyped-def]
    if _is_onestep(engine):
        return lambda engine: _call_step(engine.step, address(engine))


@overload(contract.interpolate, jit_options={**JIT, **INNER})
def _interpolate(engine, t, y):  # type: ignore[no-untyped-def]
    if _is_onestep(engine):

        def implementation(engine, t, y):  # type: ignore[no-untyped-def]
            _call_interpolate(engine.interpolate, address(engine), t, y.ctypes.data)

        return implementation


@overload(contract.restart, jit_options={**JIT, **INNER})
def _restart(engine, mode, t, y, stop):  # type: ignore[no-untyped-def]
    if _is_onestep(engine):

        def implementation(engine, mode, t, y, stop):  # type: ignore[no-untyped-def]
            w = table(engine.rows, ROWS, engine.width)
            stepper.restart(engine, w, mode, t, y, stop)

        return implementation
