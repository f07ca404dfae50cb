"""Lanes: vectors of numbers, one of each of several trajectories, in compiled functions.

Arithmetic and functions of `math` take vectors in place of numbers. Each lane has the bits of the
same operation on numbers. A comparison gives a mask, which cannot decide a branch.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typeconv import Conversion
from numba.core.typing import signature
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import intrinsic, models, overload, register_model

from mems_impact.integrators.jit import trigonometry
from mems_impact.integrators.jit.numba_support import FOR_C, INNER, WORD

LANES = 8
"""Trajectories in a vector: doubles in the widest vector registers."""

DOUBLE, INTEGER, BIT = ir.DoubleType(), ir.IntType(64), ir.IntType(1)
REALS, BITS = ir.VectorType(DOUBLE, LANES), ir.VectorType(BIT, LANES)

# --- Types


class _Lanes(types.Type):
    def __init__(self) -> None:
        super().__init__("Lanes")

    def unify(self, _typing: Any, other: Any) -> Any:
        """Return the common type with a number."""
        return self if isinstance(other, types.Float | types.Integer) else None

    def can_convert_from(self, _typing: Any, other: Any) -> Any:
        """Return that a number becomes a vector of equal numbers."""
        return Conversion.safe if isinstance(other, types.Float | types.Integer) else None


class _Mask(types.Type):
    def __init__(self) -> None:
        super().__init__("Mask")


class _LanePointer(types.Type):
    def __init__(self) -> None:
        super().__init__("LanePointer")


class _LaneVector(types.Type):
    def __init__(self) -> None:
        super().__init__("LaneVector")


Lanes, Mask = _Lanes(), _Mask()
LanePointer = _LanePointer()  # to vectors, without a length
LaneVector = _LaneVector()  # an array of vectors, in place of an array of numbers


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, REALS)


@register_model(_Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, BITS)


@register_model(_LanePointer)
class _LanePointerModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, INTEGER)


@register_model(_LaneVector)
class _LaneVectorModel(models.StructModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        members = [("address", types.int64), ("length", types.int64)]
        super().__init__(manager, kind, members)


def splat(builder: Any, value: Any) -> Any:
    """Return a vector of equal numbers."""
    undefined = ir.Constant(ir.VectorType(value.type, LANES), ir.Undefined)
    first = builder.insert_element(undefined, value, ir.Constant(ir.IntType(32), 0))
    zeros = ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES)
    return builder.shuffle_vector(first, undefined, zeros)


@lower_cast(types.Float, _Lanes)
@lower_cast(types.Integer, _Lanes)
def _cast_number(context: Any, builder: Any, source: Any, _kind: Any, value: Any) -> Any:
    return splat(builder, context.cast(builder, value, source, types.float64))


def has_lanes(kind: Any) -> bool:
    """Return whether values of a type contain vectors."""
    if isinstance(kind, types.BaseTuple):
        return any(map(has_lanes, kind.types))
    return kind in (Lanes, LaneVector)


# --- Arithmetic


def is_number(kind: Any) -> bool:
    """Return whether a type is that of a number or a vector."""
    return isinstance(kind, _Lanes | types.Float | types.Integer)


def _operation(operation: Any, count: int, result: Any, emit: Callable[..., Any]) -> None:
    """Register `operation` on `count` vectors."""

    @infer_global(operation)
    class _Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            if kws or len(args) != count or not all(map(is_number, args)) or Lanes not in args:
                return None
            return signature(result, *[Lanes] * count)

    @lower_builtin(operation, *[_Lanes] * count)
    def _lower(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return emit(context, builder, *args)


def _call(builder: Any, name: str, *args: Any) -> Any:
    kind = ir.FunctionType(REALS, [REALS] * len(args))
    intrinsic_name = f"llvm.{name}.v{LANES}f64"
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, intrinsic_name), args)


# Minimum and maximum return the first argument unless the second one is beyond, as those of numba.
def _minimum(_: Any, builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered("<", b, a), b, a)


def _maximum(_: Any, builder: Any, a: Any, b: Any) -> Any:
    return builder.select(builder.fcmp_ordered(">", b, a), b, a)


for _name, _emit in {
    "add": lambda _, builder, a, b: builder.fadd(a, b),
    "sub": lambda _, builder, a, b: builder.fsub(a, b),
    "mul": lambda _, builder, a, b: builder.fmul(a, b),
    "truediv": lambda _, builder, a, b: builder.fdiv(a, b),
}.items():
    _operation(getattr(operator, _name), 2, Lanes, _emit)
    _operation(getattr(operator, f"i{_name}"), 2, Lanes, _emit)
for _name, _sign in {"lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "=="}.items():
    _operation(
        getattr(operator, _name),
        2,
        Mask,
        lambda _, builder, a, b, sign=_sign: builder.fcmp_ordered(sign, a, b),
    )
_operation(operator.ne, 2, Mask, lambda _, builder, a, b: builder.fcmp_unordered("!=", a, b))
_operation(min, 2, Lanes, _minimum)
_operation(max, 2, Lanes, _maximum)
_operation(operator.neg, 1, Lanes, lambda _, builder, a: builder.fneg(a))
_operation(operator.pos, 1, Lanes, lambda _, builder, a: a)
for _function, _intrinsic in {
    abs: "fabs", math.fabs: "fabs", math.sqrt: "sqrt", math.floor: "floor", math.ceil: "ceil",
    math.trunc: "trunc",
}.items():  # fmt: skip
    _operation(_function, 1, Lanes, lambda _, builder, a, name=_intrinsic: _call(builder, name, a))
_operation(math.copysign, 2, Lanes, lambda _, builder, a, b: _call(builder, "copysign", a, b))

# --- Functions of `math`


def _each_lane(function: Any, context: Any, builder: Any, args: Any) -> Any:
    """Call a function of numbers for each lane."""
    typing = context.typing_context
    kind = typing.resolve_value_type(function)
    call_signature = kind.get_call_type(typing, (types.float64,) * len(args), {})
    call = context.get_function(kind, call_signature)
    context.add_linking_libs(getattr(call, "libs", ()))
    result = ir.Constant(REALS, ir.Undefined)
    for i in range(LANES):
        index = ir.Constant(ir.IntType(32), i)
        values = [builder.extract_element(vector, index) for vector in args]
        result = builder.insert_element(result, call(builder, values), index)
    return result


def _by_lane(function: Any, count: int) -> None:
    _operation(
        function,
        count,
        Lanes,
        lambda context, builder, *args: _each_lane(function, context, builder, args),
    )


for _function in (
    math.exp, math.expm1, math.log, math.log1p, math.log2, math.log10, math.tan, math.asin,
    math.acos, math.atan, math.sinh, math.cosh, math.tanh, math.asinh, math.acosh, math.atanh,
    math.erf, math.erfc, math.gamma, math.lgamma, math.sin, math.cos,
):  # fmt: skip
    _by_lane(_function, 1)
for _function in (math.atan2, math.hypot, math.pow, operator.mod):
    _by_lane(_function, 2)


@infer_global(operator.pow)
class _PowerTemplate(AbstractTemplate):
    prefer_literal = True

    def generic(self, args: Any, kws: Any) -> Any:
        if kws or not all(map(is_number, args)) or Lanes not in args:
            return None
        constant = isinstance(args[1], types.IntegerLiteral)
        return signature(Lanes, Lanes, args[1] if constant else Lanes)


@lower_builtin(operator.pow, _Lanes, _Lanes)
def _variable_power(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
    return _each_lane(operator.pow, context, builder, args)


@lower_builtin(operator.pow, _Lanes, types.IntegerLiteral)
def _constant_power(_context: Any, builder: Any, signature: Any, args: Any) -> Any:
    """Raise to a constant power, by the same products as numba for numbers."""
    power, square, result = signature.args[1].literal_value, args[0], splat(builder, DOUBLE(1.0))
    remaining = abs(power)
    while remaining > 0:
        if remaining & 1:
            result = builder.fmul(result, square)
        remaining >>= 1
        square = builder.fmul(square, square)
    return builder.fdiv(splat(builder, DOUBLE(1.0)), result) if power < 0 else result


class _Reduction(trigonometry.Reduction):
    """The reduction of `trigonometry` for vectors."""

    real, word, bit = REALS, ir.VectorType(INTEGER, LANES), BITS
    suffix = f"v{LANES}f64"


def _register_sine(
    stand_in: Callable[..., Any], library: Callable[..., Any], quarter_turns: int
) -> None:
    """Register the sine or cosine of `trigonometry`, with the bits of that of numbers."""

    @intrinsic
    def advanced_sine(_typing: Any, x: Any) -> Any:
        def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            return _Reduction(builder, args[0]).value(quarter_turns)

        return signature(Lanes, Lanes), codegen

    @overload(stand_in, jit_options={**FOR_C, **INNER}, strict=False)
    def _compiled(x):  # type: ignore[no-untyped-def]
        if x != Lanes:
            return None
        if not trigonometry.has_fma():
            return lambda x: library(x)

        def implementation(x):  # type: ignore[no-untyped-def]
            size = abs(x)
            is_within = (size > 0.0) & (size < trigonometry.LARGEST_ARGUMENT)
            value = advanced_sine(x)
            if bits(is_within) != ALL:
                value = select(is_within, value, library(x))
            return value

        return implementation


ALL = 2**LANES - 1
_register_sine(trigonometry.sin, math.sin, 0)
_register_sine(trigonometry.cos, math.cos, 1)

# --- Masks and memory


@intrinsic
def select(_typing: Any, mask: Any, a: Any, b: Any) -> Any:
    """Return `a` in the lanes of a mask, `b` in the others."""

    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        values = [
            context.cast(builder, value, kind, Lanes)
            for value, kind in zip(args[1:], (a, b), strict=True)
        ]
        return builder.select(args[0], *values)

    return signature(Lanes, mask, a, b), codegen


@intrinsic
def bits(_typing: Any, mask: Any) -> Any:
    """Return a mask as an integer, with the first lane in the lowest bit."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.zext(builder.bitcast(args[0], ir.IntType(LANES)), INTEGER)

    return signature(types.int64, mask), codegen


@intrinsic
def mask_of(_typing: Any, number: Any) -> Any:
    """Return the mask of an integer of `bits`."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.bitcast(builder.trunc(args[0], ir.IntType(LANES)), BITS)

    return signature(Mask, types.int64), codegen


@intrinsic
def first_lane(_typing: Any, number: Any) -> Any:
    """Return the first lane in an integer of `bits`, which is not zero."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.cttz(args[0], ir.Constant(BIT, 1))

    return signature(types.int64, types.int64), codegen


@intrinsic
def count_lanes(_typing: Any, number: Any) -> Any:
    """Return the number of lanes in an integer of `bits`."""

    def codegen(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return builder.ctpop(args[0])

    return signature(types.int64, types.int64), codegen


for _operator, _instruction in {operator.and_: "and_", operator.or_: "or_"}.items():

    @infer_global(_operator)
    class _MaskTemplate(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            return signature(Mask, Mask, Mask) if args == (Mask, Mask) and not kws else None

    @lower_builtin(_operator, _Mask, _Mask)
    def _lower_mask(
        _context: Any, builder: Any, _signature: Any, args: Any, name: str = _instruction
    ) -> Any:
        return getattr(builder, name)(*args)


@infer_global(operator.invert)
class _InvertTemplate(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        return signature(Mask, Mask) if args == (Mask,) and not kws else None


@lower_builtin(operator.invert, _Mask)
def _lower_invert(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
    return builder.not_(args[0])


@intrinsic
def lane_pointer(_typing: Any, address: Any) -> Any:
    """Convert an address to a pointer to vectors."""

    def codegen(_context: Any, _builder: Any, _signature: Any, args: Any) -> Any:
        return args[0]

    return signature(LanePointer, types.int64), codegen


def _place(builder: Any, address: Any, index: Any) -> Any:
    step = builder.mul(index, ir.Constant(INTEGER, WORD * LANES))
    return builder.inttoptr(builder.add(address, step), REALS.as_pointer())


def load_vector(builder: Any, address: Any, index: Any) -> Any:
    """Load vector `index` after an address."""
    return builder.load(_place(builder, address, index), align=WORD * LANES)


def store_vector(builder: Any, address: Any, index: Any, value: Any) -> None:
    """Store vector `index` after an address."""
    builder.store(value, _place(builder, address, index), align=WORD * LANES)


@infer_global(operator.getitem)
class _GetTemplate(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        if args[0] == LanePointer and isinstance(args[1], types.Integer):
            return signature(Lanes, LanePointer, types.int64)
        return None


@lower_builtin(operator.getitem, _LanePointer, types.Integer)
def _get(_context: Any, builder: Any, _signature: Any, args: Any) -> Any:
    return load_vector(builder, *args)


@infer_global(operator.setitem)
class _SetTemplate(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        if args[0] == LanePointer and isinstance(args[1], types.Integer) and is_number(args[2]):
            return signature(types.none, LanePointer, types.int64, Lanes)
        return None


@lower_builtin(operator.setitem, _LanePointer, types.Integer, _Lanes)
def _set(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
    store_vector(builder, *args)
    return context.get_dummy_value()


@intrinsic
def _address(_typing: Any, vector: Any) -> Any:
    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return cgutils.create_struct_proxy(LaneVector)(context, builder, value=args[0]).address

    return signature(types.int64, LaneVector), codegen


@intrinsic
def _length(_typing: Any, vector: Any) -> Any:
    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return cgutils.create_struct_proxy(LaneVector)(context, builder, value=args[0]).length

    return signature(types.int64, LaneVector), codegen


def vector_at(context: Any, builder: Any, address: Any, length: Any) -> Any:
    """Return an array of vectors as an LLVM value."""
    view = cgutils.create_struct_proxy(LaneVector)(context, builder)
    view.address, view.length = address, length
    return view._getvalue()


@intrinsic
def _part(_typing: Any, address: Any, length: Any) -> Any:
    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return vector_at(context, builder, *args)

    return signature(LaneVector, types.int64, types.int64), codegen


@overload(len, jit_options={**FOR_C, **INNER})
def _len(vector):  # type: ignore[no-untyped-def]
    if vector == LaneVector:
        return lambda vector: _length(vector)


@overload(operator.getitem, jit_options={**FOR_C, **INNER})
def _get_checked(vector, index):  # type: ignore[no-untyped-def]
    if vector != LaneVector:
        return None
    if isinstance(index, types.Integer):

        def number(vector, index):  # type: ignore[no-untyped-def]
            i = index + _length(vector) if index < 0 else index
            if i < 0 or i >= _length(vector):
                raise IndexError("index out of range")
            return lane_pointer(_address(vector))[i]

        return number
    if isinstance(index, types.SliceType) and not index.has_step:

        def part(vector, index):  # type: ignore[no-untyped-def]
            start, stop, _ = index.indices(_length(vector))
            return _part(_address(vector) + STRIDE * start, max(0, stop - start))

        return part
    return None


STRIDE = WORD * LANES


@overload(operator.setitem, jit_options={**FOR_C, **INNER})
def _set_checked(vector, index, value):  # type: ignore[no-untyped-def]
    if vector != LaneVector or not isinstance(index, types.Integer) or not is_number(value):
        return None

    def number(vector, index, value):  # type: ignore[no-untyped-def]
        i = index + _length(vector) if index < 0 else index
        if i < 0 or i >= _length(vector):
            raise IndexError("index out of range")
        lane_pointer(_address(vector))[i] = value

    return number
