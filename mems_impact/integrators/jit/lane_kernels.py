"""Functions of an automaton in lanes: flow and margins over vectors.

The functions are compiled unchanged with vectors in place of numbers. A branch on the state becomes
a selection where it can (`if_conversion`). A function with other branches is computed lane
by lane, and its caller in vectors. Modes may differ only between calls. Each lane has the bits of
the function compiled for numbers.
"""

from __future__ import annotations

import inspect
import threading
from collections.abc import Callable
from functools import cache
from types import FunctionType
from typing import Any, NamedTuple

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.errors import NumbaError, TypingError
from numba.core.registry import cpu_target
from numba.core.typing import signature
from numba.extending import intrinsic, overload
from numba.np.arrayobj import make_array, populate_array

from mems_impact.integrators.jit.closures import ProcessorCopier, Snapshot, take_snapshot
from mems_impact.integrators.jit.if_conversion import LaneCompiler
from mems_impact.integrators.jit.kernel_code import Kernel, KernelCode
from mems_impact.integrators.jit.kernels import compile_role, flow_body, margins_body
from mems_impact.integrators.jit.lanes import (
    DOUBLE,
    INTEGER,
    LANES,
    REALS,
    STRIDE,
    Lanes,
    LaneVector,
    Mask,
    has_lanes,
    load_vector,
    splat,
    store_vector,
    vector_at,
)
from mems_impact.integrators.jit.numba_support import WORD, caller

# --- Functions lane by lane


class LaneCopier(ProcessorCopier):
    """Copies functions so that any of them may be called with vectors.

    numba tries the function with vectors first, and if it does not compile, with each lane.
    """

    def prepare(self, copy: FunctionType, function: FunctionType) -> FunctionType:
        """Return the copy of a function, ready to be called by compiled code."""
        super().prepare(copy, function)
        wrapper = lane_by_lane(copy)
        overload(copy, jit_options=self._options, strict=False)(
            lambda *kinds, **_: wrapper if any(map(has_lanes, kinds)) else None
        )
        return copy


def lane_by_lane(function: FunctionType) -> FunctionType:
    """Return a function of vectors that calls a function of numbers for each lane."""

    @intrinsic
    def call_each(typing: Any, arguments: Any) -> Any:
        callee = typing.resolve_value_type(function)
        call_signature = callee.get_call_type(typing, tuple(map(scalar_kind, arguments.types)), {})

        def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            call = context.get_function(callee, call_signature)
            context.add_linking_libs(getattr(call, "libs", ()))
            values = cgutils.unpack_tuple(builder, args[0], len(arguments.types))
            readers = [
                _reader(context, builder, *pair)
                for pair in zip(arguments.types, values, strict=True)
            ]
            write, result = _writer(context, builder, call_signature.return_type)
            with cgutils.for_range(builder, ir.Constant(INTEGER, LANES), intp=INTEGER) as loop:
                write(loop.index, call(builder, [read(loop.index) for read in readers]))
            return result()

        return signature(vector_kind(call_signature.return_type), arguments), codegen

    names = ", ".join(inspect.signature(function).parameters)
    space = {"call_each": call_each, "__name__": __name__}
    exec(f"def wrapper({names}):\n    return call_each(({names},))", space)
    wrapper: Any = space["wrapper"]
    wrapper.__defaults__ = function.__defaults__
    wrapper.__qualname__ = f"lane_by_lane_{function.__qualname__}"
    return wrapper


STRIDED = types.Array(types.float64, 1, "A")


def scalar_kind(kind: Any) -> Any:
    """Return the type of a value in one lane."""
    if isinstance(kind, types.BaseTuple):
        tuple_class = getattr(kind, "instance_class", None)
        return types.BaseTuple.from_types(tuple(map(scalar_kind, kind.types)), tuple_class)
    return {Lanes: types.float64, LaneVector: STRIDED}.get(kind, types.unliteral(kind))


def vector_kind(kind: Any) -> Any:
    """Return the type of the results in all lanes."""
    if isinstance(kind, types.BaseTuple):
        tuple_class = getattr(kind, "instance_class", None)
        return types.BaseTuple.from_types(tuple(map(vector_kind, kind.types)), tuple_class)
    if kind not in (types.float64, types.boolean, types.none):
        raise TypingError(f"a function of lanes returns {kind}")
    return {types.float64: Lanes, types.boolean: Mask}.get(kind, kind)


def _reader(context: Any, builder: Any, kind: Any, value: Any) -> Callable[[Any], Any]:
    """Return a function that emits the value of an argument in the lane of an index."""
    if kind == Lanes:
        memory = cgutils.alloca_once_value(builder, value)
        numbers = builder.bitcast(memory, DOUBLE.as_pointer())
        return lambda i: builder.load(builder.gep(numbers, [i]))
    if kind == LaneVector:
        vector = cgutils.create_struct_proxy(LaneVector)(context, builder, value=value)

        def lane(i: Any) -> Any:
            view = make_array(STRIDED)(context, builder)
            address = builder.add(vector.address, builder.mul(i, ir.Constant(INTEGER, WORD)))
            populate_array(
                view,
                data=builder.inttoptr(address, view.data.type),
                shape=[vector.length],
                strides=[ir.Constant(INTEGER, STRIDE)],
                itemsize=ir.Constant(INTEGER, WORD),
                meminfo=None,
            )
            return view._getvalue()

        return lane
    if isinstance(kind, types.BaseTuple):
        parts = zip(kind.types, cgutils.unpack_tuple(builder, value, len(kind)), strict=True)
        readers = [_reader(context, builder, *part) for part in parts]
        return lambda i: context.make_tuple(
            builder, scalar_kind(kind), [read(i) for read in readers]
        )
    return lambda _: value


def _writer(
    context: Any, builder: Any, kind: Any
) -> tuple[Callable[[Any, Any], None], Callable[[], Any]]:
    """Return functions that emit the storage of a result of a lane, and that of all lanes."""
    if isinstance(kind, types.BaseTuple):
        parts = [_writer(context, builder, part) for part in kind.types]

        def write_parts(i: Any, value: Any) -> None:
            values = cgutils.unpack_tuple(builder, value, len(kind))
            for (write, _), part_value in zip(parts, values, strict=True):
                write(i, part_value)

        def all_parts() -> Any:
            return context.make_tuple(builder, vector_kind(kind), [result() for _, result in parts])

        return write_parts, all_parts
    if kind == types.none:
        return lambda *_: None, context.get_dummy_value
    memory = cgutils.alloca_once(builder, REALS)
    numbers = builder.bitcast(memory, DOUBLE.as_pointer())
    is_bit = kind == types.boolean

    def write(i: Any, value: Any) -> None:
        number = builder.uitofp(value, DOUBLE) if is_bit else value
        builder.store(number, builder.gep(numbers, [i]))

    def result() -> Any:
        vector = builder.load(memory)
        zeros = splat(builder, DOUBLE(0.0))
        return builder.fcmp_ordered("!=", vector, zeros) if is_bit else vector

    return write, result


# --- Functions of an automaton

# kernel(mode, address of t, y, parameters, number of parameters, out) -> mode
LANE_KERNEL = ir.FunctionType(INTEGER, [INTEGER] * 6)


class LaneKernelCode(KernelCode):
    """The body of a C function over vectors."""

    kind = LANE_KERNEL

    def __init__(self, builder: ir.IRBuilder, function: Any) -> None:
        self._builder, self._function = builder, function
        self._context = cpu_target.target_context
        self.mode, time, self.y, self.parameters, self.size, self.out = builder.function.args
        self.t = load_vector(builder, time, self.count(0))

    def vector(self, address: Any, size: Any) -> Any:
        """Return `size` vectors at `address` as an array."""
        return vector_at(self._context, self._builder, address, size)

    def after(self, address: Any, size: Any) -> Any:
        """Return the address after `size` vectors at `address`."""
        return self._builder.add(address, self._builder.mul(size, self.count(STRIDE)))

    def fill(self, address: Any, size: int, value: float) -> None:
        """Set `size` vectors at `address` to `value`."""
        for i in range(size):
            store_vector(self._builder, address, self.count(i), splat(self._builder, DOUBLE(value)))

    def record_fault(self, role: int, n: int) -> None:
        """Do nothing: a call for a single trajectory repeats and records the fault."""


FOR_LANES: dict[str, Any] = {
    "copier": LaneCopier, "code": LaneKernelCode, "pipeline_class": LaneCompiler
}  # fmt: skip
_compilation_lock = threading.Lock()  # simultaneous threads compile a system only once


class LaneKernels(NamedTuple):
    """Flow and margins of an automaton over vectors, which must live as long as their addresses."""

    flow: Kernel
    margins: Kernel


def lane_kernels(
    flow: Callable[..., Any], margins: Callable[..., Any], n: int, m: int
) -> LaneKernels | None:
    """Compile functions of an automaton for lanes; None if numba cannot."""
    with _compilation_lock:
        return _lane_kernels(take_snapshot(flow), take_snapshot(margins), n, m)


@cache
def _lane_kernels(flow: Snapshot, margins: Snapshot, n: int, m: int) -> LaneKernels | None:
    kinds = types.int64, Lanes, LaneVector, LaneVector, LaneVector
    flow_code, margins_code = flow_body(n, bounds=True), margins_body(n, m)
    try:
        return LaneKernels(
            compile_role("flow_lanes", flow, kinds, flow_code, (n,), **FOR_LANES),
            compile_role(
                "margins_lanes", margins, (*kinds, LaneVector), margins_code, (n, m), **FOR_LANES
            ),
        )
    except NumbaError:
        return None


call_lane_kernel = caller(types.int64(*[types.int64] * 6))
