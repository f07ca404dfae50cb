"""Numbers with tangents for numba: exact derivatives of users' functions, which stay as they are.

A `Dual` is a value with the tangents of w directions, which LLVM keeps in a vector. A `DualVector`
is a view of memory that holds them: for each number one record of 1 + w doubles, value and
tangents. numba compiles the source of a function for arguments of these types in place of numbers
and arrays; an operand without tangents stays a number. Values have the bits of the plain function.
Comparisons, indices and integers take the value alone.

The derivatives of elementary functions are those of `mems_impact.integrators.derivatives`.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typeconv import Conversion
from numba.core.typing import signature
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import intrinsic, models, overload, overload_attribute, register_model

from mems_impact.integrators.derivatives import (
    BINARY,
    PIECEWISE_CONSTANT,
    UNARY,
    digamma,
    digamma_above_zero,
    of_numpy,
)
from mems_impact.integrators.jit import trigonometry
from mems_impact.integrators.jit.integer_arithmetic import OF_REALS, end_where_undefined, multiplied
from mems_impact.integrators.jit.numba_support import FOR_C, INNER, WORD

__all__ = ["dual", "vector", "vector_at"]

DOUBLE, INTEGER = ir.DoubleType(), ir.IntType(64)
NUMBER = (types.Float, types.Integer, types.Boolean)
_OPTIONS: dict[str, Any] = {"jit_options": {**FOR_C, **INNER}, "strict": False}

# --- Types


class DualType(types.Type):
    """The type of a number with `width` tangents."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(f"Dual({width})")

    def unify(self, _typing: Any, other: Any) -> Any:
        """Return the type of a variable that is a number on another path."""
        return self if isinstance(other, NUMBER) else None

    def can_convert_from(self, _typing: Any, other: Any) -> Any:
        """Return the conversion from a type, or None."""
        return Conversion.safe if isinstance(other, NUMBER) else None


class TangentsType(types.Type):
    """The type of `width` tangents."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(f"Tangents({width})")


class VectorType(types.Type):
    """The type of a view of numbers with `width` tangents each."""

    def __init__(self, width: int) -> None:
        self.width = width
        super().__init__(f"DualVector({width})")


dual, vector = cache(DualType), cache(VectorType)


def _register(kind: Any, members: Callable[[Any], list[tuple[str, Any]]]) -> None:
    class Model(models.StructModel):
        def __init__(self, manager: Any, kind: Any) -> None:
            super().__init__(manager, kind, members(kind))

    register_model(kind)(Model)


@register_model(TangentsType)
class _TangentsModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(DOUBLE, kind.width))


_register(DualType, lambda kind: [("value", types.float64), ("slope", TangentsType(kind.width))])
_register(VectorType, lambda _: [("address", types.int64), ("length", types.int64)])


def _packed(context: Any, builder: Any, kind: Any, value: Any, slope: Any) -> Any:
    result = cgutils.create_struct_proxy(kind)(context, builder)
    result.value, result.slope = value, slope
    return result._getvalue()


def _parts(context: Any, builder: Any, kind: Any, number: Any) -> tuple[Any, Any]:
    """Return value and tangents; None for the tangents of a plain number."""
    if isinstance(kind, DualType):
        struct = cgutils.create_struct_proxy(kind)(context, builder, value=number)
        return struct.value, struct.slope
    return context.cast(builder, number, kind, types.float64), None


def _zeros(width: int) -> Any:
    return ir.Constant(ir.VectorType(DOUBLE, width), [0.0] * width)


def _times(builder: Any, width: int, factor: Any, slope: Any) -> Any:
    """Return the product of a number and tangents, where there are any."""
    if slope is None:
        return None
    undefined = ir.Constant(ir.VectorType(DOUBLE, width), ir.Undefined)
    first = builder.insert_element(undefined, factor, ir.Constant(ir.IntType(32), 0))
    order = ir.Constant(ir.VectorType(ir.IntType(32), width), [0] * width)
    return builder.fmul(builder.shuffle_vector(first, undefined, order), slope)


def _product(builder: Any, width: int, factor: Any, slope: Any) -> Any:
    """Return this product; a tangent of zero stays zero if the factor is infinite."""
    product = _times(builder, width, factor, slope)
    return builder.select(builder.fcmp_ordered("==", slope, _zeros(width)), slope, product)


def _sum(builder: Any, one: Any, other: Any) -> Any:
    if one is None or other is None:
        return other if one is None else one
    return builder.fadd(one, other)


@lower_cast(types.Float, DualType)
@lower_cast(types.Integer, DualType)
@lower_cast(types.Boolean, DualType)
def _of_number(context: Any, builder: Any, source: Any, kind: Any, number: Any) -> Any:
    value = context.cast(builder, number, source, types.float64)
    return _packed(context, builder, kind, value, _zeros(kind.width))


# --- Arithmetic

Emit = Callable[..., Any]
"""Code of an operation: of builder, width, and value and tangents of each operand."""


def _common(kinds: Sequence[Any]) -> Any:
    """Return the type of the dual numbers among numbers; None if there are none, or others."""
    duals = {kind for kind in kinds if isinstance(kind, DualType)}
    others = [kind for kind in kinds if not isinstance(kind, (DualType, *NUMBER))]
    return duals.pop() if len(duals) == 1 and not others else None


def _operation(function: Any, count: int, emit: Emit, result: Any = None) -> None:
    """Define a function of `count` numbers, one of them dual at least."""

    @infer_global(function)
    class Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            if kws or len(args) != count or (kind := _common(args)) is None:
                return None
            kinds = [each if isinstance(each, DualType) else types.float64 for each in args]
            return signature(result or kind, *kinds)

    def lower(context: Any, builder: Any, kinds: Any, numbers: Any) -> Any:
        kind = _common(kinds.args)
        pairs = [_parts(context, builder, *each) for each in zip(kinds.args, numbers, strict=True)]
        values = [pair[0] for pair in pairs]
        if function in (operator.truediv, operator.itruediv):
            end_where_undefined(context, builder, operator.truediv, None, values)
        emitted = emit(builder, kind.width, *pairs)
        return emitted if result else _packed(context, builder, kind, *emitted)

    for bits in range(1, 2**count):
        kinds = [DualType if bits >> i & 1 else types.Float for i in range(count)]
        lower_builtin(function, *kinds)(lower)


def _add(builder: Any, _: int, x: Any, y: Any) -> Any:
    return builder.fadd(x[0], y[0]), _sum(builder, x[1], y[1])


def _subtract(builder: Any, _: int, x: Any, y: Any) -> Any:
    if y[1] is None:
        return builder.fsub(x[0], y[0]), x[1]
    slope = builder.fneg(y[1]) if x[1] is None else builder.fsub(x[1], y[1])
    return builder.fsub(x[0], y[0]), slope


def _multiply(builder: Any, width: int, x: Any, y: Any) -> Any:
    terms = _times(builder, width, y[0], x[1]), _times(builder, width, x[0], y[1])
    return builder.fmul(x[0], y[0]), _sum(builder, *terms)


def _divide(builder: Any, width: int, x: Any, y: Any) -> Any:
    quotient = builder.fdiv(x[0], y[0])
    inverse = builder.fdiv(ir.Constant(DOUBLE, 1.0), y[0])
    slope = x[1]
    if y[1] is not None:
        part = _times(builder, width, quotient, y[1])
        slope = builder.fneg(part) if slope is None else builder.fsub(slope, part)
    return quotient, _times(builder, width, inverse, slope)


def _choose(relation: str) -> Emit:
    """Return the code of min or max, which take the first of equal operands, as Python does."""

    def emit(builder: Any, width: int, first: Any, *others: Any) -> Any:
        for other in others:
            replaces = builder.fcmp_ordered(relation, other[0], first[0])
            slopes = [_zeros(width) if each[1] is None else each[1] for each in (other, first)]
            first = tuple(
                builder.select(replaces, *pair) for pair in ((other[0], first[0]), slopes)
            )
        return first

    return emit


def _compare(relation: str) -> Emit:
    return lambda builder, _, x, y: builder.fcmp_ordered(relation, x[0], y[0])


for _name, _emit in {
    "add": _add, "sub": _subtract, "mul": _multiply, "truediv": _divide
}.items():  # fmt: skip
    _operation(getattr(operator, _name), 2, _emit)
    _operation(getattr(operator, f"i{_name}"), 2, _emit)
for _name, _relation in {"lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "=="}.items():
    _operation(getattr(operator, _name), 2, _compare(_relation), types.boolean)
_operation(
    operator.ne, 2, lambda builder, _, x, y: builder.fcmp_unordered("!=", x[0], y[0]), types.boolean
)
for _count in (2, 3, 4):
    _operation(min, _count, _choose("<"))
    _operation(max, _count, _choose(">"))
_operation(operator.neg, 1, lambda builder, _, x: (builder.fneg(x[0]), builder.fneg(x[1])))
_operation(operator.pos, 1, lambda _builder, _, x: x)

# --- Elementary functions


@intrinsic
def value_of(_typing: Any, x: Any) -> Any:
    """Return the value of a number."""

    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return _parts(context, builder, x, args[0])[0]

    return types.float64(x), codegen


@intrinsic
def of_one(_typing: Any, x: Any, value: Any, derivative: Any) -> Any:
    """Return a value with the tangents of x times a derivative."""

    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        _, slope = _parts(context, builder, x, args[0])
        slope = _product(builder, x.width, args[2], slope)
        return _packed(context, builder, x, args[1], slope)

    return x(x, types.float64, types.float64), codegen


@intrinsic
def of_two(_typing: Any, x: Any, y: Any, value: Any, by_x: Any, by_y: Any) -> Any:
    """Return a value with the tangents of x and y, each times a derivative."""

    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        slopes = [_parts(context, builder, x, number)[1] for number in args[:2]]
        terms = [
            _product(builder, x.width, derivative, slope)
            for slope, derivative in zip(slopes, args[3:], strict=True)
        ]
        return _packed(context, builder, x, args[2], builder.fadd(*terms))

    return x(x, x, types.float64, types.float64, types.float64), codegen


for _function in (digamma_above_zero, digamma):  # in the order of their calls

    def _overload_plain(function: Any) -> None:
        overload(function, **_OPTIONS)(lambda x: function)

    _overload_plain(_function)

_NAMES: dict[str, Any] = {
    **{name: getattr(math, name) for name in dir(math)},
    "sin": trigonometry.sin,
    "cos": trigonometry.cos,
    "digamma": digamma,
    "value_of": value_of,
    "of_one": of_one,
    "of_two": of_two,
}


def _defined(source: str, **names: Any) -> Callable[..., Any]:
    """Return the function `rule` of a source."""
    space = {**_NAMES, **names}
    exec(source, space)
    return space["rule"]


def _unary(function: Any, evaluate: Any, derivative: str) -> None:
    rule = _defined(
        f"def rule(x):\n v = value_of(x)\n f = evaluate(v)\n return of_one(x, f, {derivative})",
        evaluate=evaluate,
    )

    @overload(function, **_OPTIONS)
    def implementation(x):  # type: ignore[no-untyped-def]
        return rule if isinstance(x, DualType) else None


def _binary(function: Any, evaluate: Any, by_x: str, by_y: str) -> None:
    source = "def rule(x, y):\n a, b = {}, {}\n f = evaluate(a, b)\n return {}"
    kinds = {
        (True, True): ("value_of(x)", "value_of(y)", f"of_two(x, y, f, {by_x}, {by_y})"),
        (True, False): ("value_of(x)", "float(y)", f"of_one(x, f, {by_x})"),
        (False, True): ("float(x)", "value_of(y)", f"of_one(y, f, {by_y})"),
    }
    rules = {key: _defined(source.format(*each), evaluate=evaluate) for key, each in kinds.items()}

    @overload(function, **_OPTIONS)
    def implementation(x, y):  # type: ignore[no-untyped-def]
        if _common((x, y)) is None:
            return None
        return rules[isinstance(x, DualType), isinstance(y, DualType)]


for _function, _derivative in UNARY.items():
    _substitute = trigonometry.SUBSTITUTES.get(_function)
    for _each in (_function, _substitute):
        if _each is not None:
            _unary(_each, _substitute or OF_REALS.get(_function, _function), _derivative)
    if (_each := of_numpy(_function)) is not None:
        _unary(_each, _each, _derivative)
for _function, _derivatives in BINARY.items():
    if _function is not operator.pow:
        _binary(_function, OF_REALS.get(_function, _function), *_derivatives)
    if (_each := of_numpy(_function)) is not None:
        _binary(_each, _each, *_derivatives)


def _of_value(function: Any) -> None:
    @overload(function, **_OPTIONS)
    def implementation(x):  # type: ignore[no-untyped-def]
        return (lambda x: function(value_of(x))) if isinstance(x, DualType) else None


@overload(math.ldexp, **_OPTIONS)
def _ldexp(x, i):  # type: ignore[no-untyped-def]
    if not isinstance(x, DualType):
        return None
    return lambda x, i: of_one(x, math.ldexp(value_of(x), i), math.ldexp(1.0, i))


for _each in (*PIECEWISE_CONSTANT, int, bool, round, np.sign, np.rint):
    _of_value(_each)


def _absolute(x):  # type: ignore[no-untyped-def]
    v = value_of(x)
    return of_one(x, abs(v), 1.0 if v > 0.0 else (-1.0 if v < 0.0 else 0.0))


def _floor_quotient(x, y):  # type: ignore[no-untyped-def]
    return value_of(x) // value_of(y)


def _stand_for(function: Any, count: int, other: Any) -> None:
    """Define a function of NumPy as a builtin function."""
    names = ", ".join("xyz"[:count])
    rule = _defined(f"def rule({names}):\n return other({names})", other=other)

    def typed(*kinds: Any) -> Any:
        return rule if _common(kinds) is not None else None

    overload(function, **_OPTIONS)(_defined(f"rule = lambda {names}: typed({names})", typed=typed))


_stand_for(np.maximum, 2, max)
_stand_for(np.minimum, 2, min)
_stand_for(np.square, 1, _defined("rule = lambda x: x * x"))
for _each in (abs, math.fabs, np.absolute, np.fabs):

    @overload(_each, **_OPTIONS)
    def _size(x):  # type: ignore[no-untyped-def]
        return _absolute if isinstance(x, DualType) else None


@overload(operator.floordiv, **_OPTIONS)
def _quotient(x, y):  # type: ignore[no-untyped-def]
    return _floor_quotient if _common((x, y)) is not None else None


@overload(float, **_OPTIONS)
def _float(x):  # type: ignore[no-untyped-def]
    return (lambda x: x) if isinstance(x, DualType) else None


# --- Powers


def raised(x: Any, y: Any) -> Any:
    """Return a power whose exponent is no constant integer."""
    return x**y


_binary(raised, OF_REALS[operator.pow], *BINARY[operator.pow])
_binary(math.pow, OF_REALS[math.pow], *BINARY[operator.pow])


@infer_global(operator.ipow)
@infer_global(operator.pow)
class _Power(AbstractTemplate):
    prefer_literal = True

    def generic(self, args: Any, kws: Any) -> Any:
        if kws or len(args) != 2 or (kind := _common(args)) is None:
            return None
        if isinstance(args[1], types.IntegerLiteral) and 0 <= args[1].literal_value <= 16:
            return signature(kind, *args)
        kinds = [each if isinstance(each, DualType) else types.float64 for each in args]
        return signature(kind, *kinds)


@lower_builtin(operator.ipow, DualType, types.IntegerLiteral)
@lower_builtin(operator.pow, DualType, types.IntegerLiteral)
def _small_power(context: Any, builder: Any, kinds: Any, numbers: Any) -> Any:
    kind, exponent = kinds.args[0], kinds.args[1].literal_value
    value, slope = _parts(context, builder, kind, numbers[0])
    factor = multiplied(builder, value, max(exponent - 1, 0))
    factor = builder.fmul(ir.Constant(DOUBLE, float(exponent)), factor)
    slope = _times(builder, kind.width, factor, slope)
    return _packed(context, builder, kind, multiplied(builder, value, exponent), slope)


def _real_power(context: Any, builder: Any, kinds: Any, numbers: Any) -> Any:
    return context.compile_internal(builder, lambda x, y: raised(x, y), kinds, numbers)


for _kinds in ((DualType, DualType), (DualType, types.Float), (types.Float, DualType)):
    lower_builtin(operator.pow, *_kinds)(_real_power)
    lower_builtin(operator.ipow, *_kinds)(_real_power)

# --- Vectors


def _record(builder: Any, kind: Any, address: Any, index: Any) -> tuple[Any, Any]:
    """Return pointers to the value and the tangents of a number in memory."""
    size = ir.Constant(INTEGER, WORD * (1 + kind.width))
    value = builder.add(address, builder.mul(index, size))
    slope = builder.add(value, ir.Constant(INTEGER, WORD))
    tangents = ir.VectorType(DOUBLE, kind.width).as_pointer()
    return builder.inttoptr(value, DOUBLE.as_pointer()), builder.inttoptr(slope, tangents)


@intrinsic
def _load(_typing: Any, numbers: Any, index: Any) -> Any:
    kind = dual(numbers.width)

    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        view = cgutils.create_struct_proxy(numbers)(context, builder, value=args[0])
        value, slope = _record(builder, kind, view.address, args[1])
        return _packed(context, builder, kind, builder.load(value), builder.load(slope, align=WORD))

    return kind(numbers, types.int64), codegen


@intrinsic
def _store(_typing: Any, numbers: Any, index: Any, number: Any) -> Any:
    kind = dual(numbers.width)

    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        view = cgutils.create_struct_proxy(numbers)(context, builder, value=args[0])
        parts = _parts(context, builder, kind, args[2])
        for part, place in zip(parts, _record(builder, kind, view.address, args[1]), strict=True):
            builder.store(part, place, align=WORD)
        return context.get_dummy_value()

    return types.none(numbers, types.int64, kind), codegen


def _member(name: str) -> Any:
    @intrinsic
    def member(_typing: Any, numbers: Any) -> Any:
        def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            view = cgutils.create_struct_proxy(numbers)(context, builder, value=args[0])
            return getattr(view, name)

        return types.int64(numbers), codegen

    return member


_address, _length = _member("address"), _member("length")


@cache
def vector_at(width: int) -> Any:
    """Return an intrinsic: a view of `length` numbers with tangents at an address."""
    kind = vector(width)

    @intrinsic
    def view(_typing: Any, address: Any, length: Any) -> Any:
        def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            numbers = cgutils.create_struct_proxy(kind)(context, builder)
            numbers.address, numbers.length = args
            return numbers._getvalue()

        return kind(types.int64, types.int64), codegen

    return view


@overload(len, **_OPTIONS)
def _len(numbers):  # type: ignore[no-untyped-def]
    return (lambda numbers: _length(numbers)) if isinstance(numbers, VectorType) else None


@overload_attribute(VectorType, "size", **_OPTIONS)
def _count_of(numbers):  # type: ignore[no-untyped-def]
    return lambda numbers: _length(numbers)


def _place(numbers, index):  # type: ignore[no-untyped-def]
    """Return an index from the first number."""
    i = index + _length(numbers) if index < 0 else index
    if i < 0 or i >= _length(numbers):
        raise IndexError("index out of range")
    return i


_place_overload = overload(_place, **_OPTIONS)(lambda numbers, index: _place)


@overload(operator.getitem, **_OPTIONS)
def _get(numbers, index):  # type: ignore[no-untyped-def]
    if not isinstance(numbers, VectorType):
        return None
    if isinstance(index, types.Integer):
        return lambda numbers, index: _load(numbers, _place(numbers, index))
    if isinstance(index, types.SliceType) and not index.has_step:
        at, size = vector_at(numbers.width), WORD * (1 + numbers.width)

        def part(numbers, index):  # type: ignore[no-untyped-def]
            start, stop, _ = index.indices(_length(numbers))
            return at(_address(numbers) + size * start, max(0, stop - start))

        return part
    return None


@overload(operator.setitem, **_OPTIONS)
def _set(numbers, index, number):  # type: ignore[no-untyped-def]
    if not isinstance(numbers, VectorType) or not isinstance(index, types.Integer):
        return None
    return lambda numbers, index, number: _store(numbers, _place(numbers, index), number)
