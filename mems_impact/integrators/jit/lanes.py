"""Vectors of doubles for numba, which LLVM keeps in the registers of vector instructions.

`Strided` is an address: its element i is a vector of `width` doubles, or a double, `stride` doubles
after element i - 1. Sums of products contract to fused multiply-adds, as in `fastmath` code.
"""

from __future__ import annotations

import operator
from functools import cache
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import lower_builtin
from numba.core.typing import signature
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import intrinsic, models, register_model

from mems_impact.integrators.jit.numba_support import WORD

LANE_BITS = 2
LANES = 1 << LANE_BITS  # numbers of a vector
DOUBLE, INTEGER = ir.DoubleType(), ir.IntType(64)
VECTOR = ir.VectorType(DOUBLE, LANES)


class Lanes(types.Type):
    """The type of a vector of `LANES` doubles."""


class Strided(types.Type):
    """The type of an address of vectors, or of doubles."""

    def __init__(self, stride: int, width: int) -> None:
        self.stride, self.element = stride, lanes if width > 1 else types.float64
        super().__init__(f"Strided({stride}, {width})")


lanes = Lanes("Lanes")


@register_model(Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, VECTOR)


@register_model(Strided)
class _StridedModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, INTEGER)


@cache
def strided_at(stride: int, width: int) -> Any:
    """Return an intrinsic that converts an address to a `Strided`."""
    kind = Strided(stride, width)

    @intrinsic
    def view(_typing: Any, address: Any) -> Any:
        return kind(types.int64), lambda _context, _builder, _signature, args: args[0]

    return view


@infer_global(operator.getitem)
class _Get(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        if isinstance(args[0], Strided):
            return signature(args[0].element, args[0], types.int64)
        return signature(types.float64, lanes, types.int64) if args[0] == lanes else None


@infer_global(operator.setitem)
class _Set(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        if isinstance(args[0], Strided):
            return signature(types.none, args[0], types.int64, args[0].element)
        return None


def _place(builder: Any, kind: Any, address: Any, index: Any) -> Any:
    offset = builder.mul(index, ir.Constant(INTEGER, WORD * kind.stride))
    element = VECTOR if kind.element == lanes else DOUBLE
    return builder.inttoptr(builder.add(address, offset), element.as_pointer())


@lower_builtin(operator.getitem, Strided, types.int64)
def _get(_context: Any, builder: Any, kinds: Any, args: Any) -> Any:
    return builder.load(_place(builder, kinds.args[0], *args), align=WORD)


@lower_builtin(operator.setitem, Strided, types.int64, types.Any)
def _set(context: Any, builder: Any, kinds: Any, args: Any) -> Any:
    builder.store(args[2], _place(builder, kinds.args[0], *args[:2]), align=WORD)
    return context.get_dummy_value()


@lower_builtin(operator.getitem, Lanes, types.int64)
def _number(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
    return builder.extract_element(*args)


def _vector(context: Any, builder: Any, kind: Any, number: Any) -> Any:
    """Return a vector, or a number in all lanes."""
    if kind == lanes:
        return number
    number, index = context.cast(builder, number, kind, types.float64), ir.IntType(32)
    undefined = ir.Constant(VECTOR, ir.Undefined)
    first = builder.insert_element(undefined, number, ir.Constant(index, 0))
    order = ir.Constant(ir.VectorType(index, LANES), [0] * LANES)
    return builder.shuffle_vector(first, undefined, order)


def _operation(function: Any, count: int, emit: Any) -> None:
    @infer_global(function)
    class Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            numbers = all(isinstance(each, Lanes | types.Float) for each in args)
            return signature(lanes, *args) if numbers and lanes in args and not kws else None

    def lower(context: Any, builder: Any, kinds: Any, numbers: Any) -> Any:
        pairs = zip(kinds.args, numbers, strict=True)
        return emit(builder, *(_vector(context, builder, *pair) for pair in pairs))

    for bits in range(1, 2**count):
        lower_builtin(function, *(Lanes if bits >> i & 1 else types.Float for i in range(count)))(
            lower
        )


def _absolute(builder: Any, x: Any) -> Any:
    kind, name = ir.FunctionType(VECTOR, [VECTOR]), f"llvm.fabs.v{LANES}f64"
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), [x])


def _larger(builder: Any, x: Any, y: Any) -> Any:
    return builder.select(builder.fcmp_ordered(">", y, x), y, x)


for _name, _emit in {"add": "fadd", "sub": "fsub", "mul": "fmul", "truediv": "fdiv"}.items():

    def _arithmetic(builder: Any, x: Any, y: Any, emit: str = _emit) -> Any:
        return getattr(builder, emit)(x, y, flags=("contract",))

    _operation(getattr(operator, _name), 2, _arithmetic)
_operation(operator.iadd, 2, lambda builder, x, y: builder.fadd(x, y, flags=("contract",)))
_operation(max, 2, _larger)
_operation(abs, 1, _absolute)
