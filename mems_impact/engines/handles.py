"""Compiled engines: the record that compiled code takes for one, and what all methods share.

numba compiles the event loop once for each type of record. The contract of
`mems_impact.engines.contract` gets its overloads here, as far as they are the same for every
method; `step`, `restart` and `interpolate` are each method's own.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numba.extending import overload

from mems_impact.engines import contract
from mems_impact.engines.compiling import INNER, JIT, WORD, data, integers, pointer
from mems_impact.engines.equations import Equations
from mems_impact.engines.faults import HEAD, Fault, fault_in
from mems_impact.engines.kernels import call_kernel, kernels
from mems_impact.engines.snapshot import mark_overloaded


class HandleOwner:
    """A record of addresses for compiled code, and the memory that it points to.

    Parameters
    ----------
    dtype : numpy.dtype
        `mems_impact.engines.kernels.FIELDS` and the fields of the method.
    equations : Equations
    arrays : dict of str to int
        Memory of the method, how many numbers; the field of that name gets the address.
    """

    def __init__(self, dtype: np.dtype[Any], equations: Equations, arrays: dict[str, int]) -> None:
        n, m, parameters = equations.n, equations.m, np.asarray(equations.parameters, dtype=float)
        flow, margins, transition = equations.flow, equations.margins, equations.transition
        self._kernels = kernels(flow, margins, transition, n, m, equations.bounds)
        # The handle holds addresses in here; it lives as long as the engine. The kernels note
        # behind the parameters where they fail.
        sizes = {"y": n, "bias": m, "parameters": parameters.size + HEAD + n, **arrays}
        fired = 2 * m + 1  # as 32-bit integers, two to a number
        block = np.zeros(sum(sizes.values()) + fired // 2 + 1)
        handles = np.zeros(1, dtype=dtype)
        self._memory = block
        self.address = handles.ctypes.data
        # A plain record that keeps them alive. By item a field is reached ten times as fast as by
        # attribute.
        self.handle = handle = handles[0]
        place, begin = block.ctypes.data, 0
        for name, size in sizes.items():
            handle[name] = place + WORD * begin
            if name == "parameters":
                note = begin + parameters.size
                self.parameters = block[begin:note]
                self.parameters[:] = parameters
                self._note = block[note : begin + size]
            begin += size
        handle["fired"] = place + WORD * begin
        handle["n"], handle["m"], handle["parameter_count"] = n, m, parameters.size
        handle["section"], handle["level"], _ = equations.crossing
        handle["flow"] = self._kernels.flow.address
        handle["margins"] = self._kernels.margins.address
        handle["transition"] = self._kernels.transition.address

    @property
    def implicit_arcs(self) -> int:
        """Arcs begun so far by the second of two methods: 0, where there is one."""
        return 0

    def learnt(self) -> tuple[int, ...]:
        """Return what it has learnt of each mode: nothing."""
        return ()

    def learn(self, known: tuple[int, ...]) -> None:
        """Begin with what was learnt of each mode: it makes no difference."""

    def is_stiff(self) -> bool:
        """Return whether stability, not accuracy, has limited steps; False if it can't tell."""
        return False

    def close(self) -> None:
        """Do nothing: the memory goes with the object."""

    def fault(self) -> Fault | None:
        """Return the first call of a function that failed, and forget it."""
        fault = fault_in(self._note)
        self._note[0] = 0.0
        return fault


def is_handle(kind: Any) -> bool:
    """Return whether the numba type `kind` is the record of an engine."""
    return isinstance(kind, types.Record) and "last_instant" in kind.fields


mark_overloaded(
    contract.step,
    contract.time,
    contract.state,
    contract.ended,
    contract.fired,
    contract.interpolate,
    contract.restart,
    contract.renew,
    contract.sharpen,
    contract.remembered,
    contract.bias,
    contract.set_bias,
    contract.parameter,
    contract.set_parameter,
    contract.flow,
    contract.margins,
    contract.transition,
)


@overload(contract.time, jit_options={**JIT, **INNER})
def _time(engine):  # type: ignore[no-untyped-def]
    if is_handle(engine):
        return lambda engine: engine.t


@overload(contract.state, jit_options={**JIT, **INNER})
def _state(engine, y):  # type: ignore[no-untyped-def]
    if is_handle(engine):

        def implementation(engine, y):  # type: ignore[no-untyped-def]
            for i in range(engine.n):
                y[i] = pointer(engine.y)[i]

        return implementation


@overload(contract.fired, jit_options={**JIT, **INNER})
def _fired(engine, i):  # type: ignore[no-untyped-def]
    if is_handle(engine):
        return lambda engine, i: np.int64(integers(engine.fired)[i])


@overload(contract.remembered, jit_options={**JIT, **INNER})
def _remembered(engine, mode):  # type: ignore[no-untyped-def]
    if is_handle(engine) and "implicit" not in engine.fields:
        return lambda engine, mode: 0


@overload(contract.bias, jit_options={**JIT, **INNER})
def _bias(engine, i):  # type: ignore[no-untyped-def]
    if is_handle(engine):
        return lambda engine, i: pointer(engine.bias)[i]


@overload(contract.set_bias, jit_options={**JIT, **INNER})
def _set_bias(engine, i, value):  # type: ignore[no-untyped-def]
    if is_handle(engine):

        def implementation(engine, i, value):  # type: ignore[no-untyped-def]
            pointer(engine.bias)[i] = value

        return implementation


@overload(contract.parameter, jit_options={**JIT, **INNER})
def _parameter(engine, i):  # type: ignore[no-untyped-def]
    if is_handle(engine):
        return lambda engine, i: pointer(engine.parameters)[i]


@overload(contract.set_parameter, jit_options={**JIT, **INNER})
def _set_parameter(engine, i, value):  # type: ignore[no-untyped-def]
    if is_handle(engine):

        def implementation(engine, i, value):  # type: ignore[no-untyped-def]
            pointer(engine.parameters)[i] = value

        return implementation


@overload(contract.flow, jit_options={**JIT, **INNER})
def _flow(engine, mode, t, y, dy):  # type: ignore[no-untyped-def]
    if is_handle(engine):

        def implementation(engine, mode, t, y, dy):  # type: ignore[no-untyped-def]
            size, p = engine.parameter_count, engine.parameters
            call_kernel(engine.flow, mode, 0, t, data(y), p, size, data(dy))

        return implementation


@overload(contract.margins, jit_options={**JIT, **INNER})
def _margins(engine, mode, t, y, out):  # type: ignore[no-untyped-def]
    if is_handle(engine):

        def implementation(engine, mode, t, y, out):  # type: ignore[no-untyped-def]
            size, p = engine.parameter_count, engine.parameters
            call_kernel(engine.margins, mode, 0, t, data(y), p, size, data(out))

        return implementation


@overload(contract.transition, jit_options={**JIT, **INNER})
def _transition(engine, mode, code, t, y):  # type: ignore[no-untyped-def]
    if is_handle(engine):

        def implementation(engine, mode, code, t, y):  # type: ignore[no-untyped-def]
            size, p = engine.parameter_count, engine.parameters
            return call_kernel(engine.transition, mode, code, t, data(y), p, size, p)

        return implementation
