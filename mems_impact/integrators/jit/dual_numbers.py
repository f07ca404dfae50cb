"""Numbers with tangents for numba: exact derivatives of users' functions, which stay as they are.

A `Dual` is a value with the tangents of w directions, which LLVM keeps in vectors. A `DualVector`
is a view of memory that holds them: for each number one record of 1 + w doubles, value and
tangents. numba compiles the source of a function for arguments of these types in place of numbers
and arrays; an operand without tangents stays a number. Values have the bits of the plain function.
Comparisons, indices and integers take the value alone.

The derivatives of elementary functions are those of `mems_impact.integrators.derivatives`.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial, reduce
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.registry import cpu_target
from numba.core.typeconv import Conversion
from numba.core.typing import signature
from numba.core.typing.templates import AbstractTemplate, infer_global
from numba.extending import intrinsic, models, overload, overload_attribute, register_model

from mems_impact.integrators.derivatives import (
    BINARY,
    EXPRESSIONS,
    PIECEWISE_CONSTANT,
    UNARY,
    digamma,
    digamma_above_zero,
    of_numpy,
)
from mems_impact.integrators.dual_numbers import after, along, by_differences, with_rate, with_rates
from mems_impact.integrators.jit import trigonometry
from mems_impact.integrators.jit.integer_arithmetic import OF_REALS, end_where_undefined, multiplied
from mems_impact.integrators.jit.lanes import LANES
from mems_impact.integrators.jit.numba_support import FOR_C, INNER, VECTOR, WORD, data, view

DOUBLE, INTEGER = ir.DoubleType(), ir.IntType(64)
NUMBER = (types.Float, types.Integer, types.Boolean)
_OPTIONS: dict[str, Any] = {"jit_options": {**FOR_C, **INNER}, "strict": False}

# --- Types


class DualType(types.Type):
    """The type of a number with `width` tangents.

    Its value may be a dual number, too; it then has one tangent, which is a dual number.
    """

    def __init__(self, width: int, value: Any = types.float64) -> None:
        self.width, self.value = width, value
        self.slope = TangentsType(width) if width > 1 else value
        super().__init__(f"Dual({width}, {value})")

    @property
    def inner(self) -> tuple[Any, ...]:
        """The types of its value, of the value of this, and so on."""
        return (self.value, *getattr(self.value, "inner", ()))

    def unify(self, _typing: Any, other: Any) -> Any:
        """Return the type of a variable that is a number on another path."""
        return self if isinstance(other, NUMBER) or other in self.inner else None

    def can_convert_from(self, _typing: Any, other: Any) -> Any:
        """Return the conversion from a type, or None."""
        return Conversion.safe if isinstance(other, NUMBER) or other in self.inner else None


class TangentsType(types.Type):
    """The type of `width` tangents, in vectors of the processor."""

    def __init__(self, width: int) -> None:
        self.width = width
        sizes = [min(LANES, width - first) for first in range(0, width, LANES)]
        self.vectors = [ir.VectorType(DOUBLE, size) for size in sizes]
        super().__init__(f"Tangents({width})")


class VectorType(types.Type):
    """The type of a view of dual numbers."""

    def __init__(self, kind: DualType) -> None:
        self.kind = kind
        super().__init__(f"DualVector({kind})")


class SplitType(types.Type):
    """The type of a view of dual numbers whose values and tangents are two arrays."""

    def __init__(self, kind: DualType) -> None:
        self.kind = kind
        super().__init__(f"SplitVector({kind})")


VIEWS = (VectorType, SplitType)
PARTS = tuple, list
dual = cache(DualType)


def vector(width: int) -> VectorType:
    """Return the type of a view of numbers with `width` tangents."""
    return VectorType(dual(width))


def _register(kind: Any, members: Callable[[Any], list[tuple[str, Any]]]) -> None:
    class Model(models.StructModel):
        def __init__(self, manager: Any, kind: Any) -> None:
            super().__init__(manager, kind, members(kind))

    register_model(kind)(Model)


@register_model(TangentsType)
class _TangentsModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.LiteralStructType(kind.vectors))


_register(DualType, lambda kind: [("value", kind.value), ("slope", kind.slope)])
_WORDS = [(name, types.int64) for name in ("address", "length", "slopes", "stride")]
_register(VectorType, lambda _: _WORDS[:2])
_register(SplitType, lambda _: _WORDS)

# --- Numbers as parts: a double, a list of vectors of tangents, or a pair of value and slope, each
# of parts; None is zero


def _parts(context: Any, builder: Any, kind: Any, number: Any) -> Any:
    """Return the parts of a number."""
    if isinstance(kind, DualType):
        struct = cgutils.create_struct_proxy(kind)(context, builder, value=number)
        pair = (kind.value, struct.value), (kind.slope, struct.slope)
        return tuple(_parts(context, builder, *each) for each in pair)
    if isinstance(kind, TangentsType):
        return cgutils.unpack_tuple(builder, number, len(kind.vectors))
    return context.cast(builder, number, kind, types.float64)


def _lifted(context: Any, builder: Any, kind: Any, number: Any, to: Any) -> Any:
    """Return the parts of a number as those of a type that holds it."""
    if kind == to or not isinstance(to, DualType):
        return _parts(context, builder, kind, number)
    return _lifted(context, builder, kind, number, to.value), None


def _packed(context: Any, builder: Any, kind: Any, parts: Any) -> Any:
    """Return a number of its parts."""
    if isinstance(kind, TangentsType):
        vectors = [ir.Constant(each, None) for each in kind.vectors] if parts is None else parts
        return cgutils.pack_struct(builder, vectors)
    if not isinstance(kind, DualType):
        return ir.Constant(DOUBLE, 0.0) if parts is None else parts
    result = cgutils.create_struct_proxy(kind)(context, builder)
    value, slope = (None, None) if parts is None else parts
    result.value = _packed(context, builder, kind.value, value)
    result.slope = _packed(context, builder, kind.slope, slope)
    return result._getvalue()


def _innermost(parts: Any) -> Any:
    """Return the value of a number."""
    return _innermost(parts[0]) if isinstance(parts, tuple) else parts


def _constant(value: float, like: Any) -> Any:
    """Return a constant with the parts of another number."""
    return (_constant(value, like[0]), None) if isinstance(like, tuple) else like.type(value)


def _add(builder: Any, x: Any, y: Any) -> Any:
    if x is None or y is None:
        return y if x is None else x
    if isinstance(x, PARTS):
        return type(x)(map(partial(_add, builder), x, y))
    return builder.fadd(x, y)


def _negative(builder: Any, x: Any) -> Any:
    if x is None or isinstance(x, PARTS):
        return x and type(x)(map(partial(_negative, builder), x))
    return builder.fneg(x)


def _subtract(builder: Any, x: Any, y: Any) -> Any:
    if x is None or y is None:
        return x if y is None else _negative(builder, y)
    if isinstance(x, PARTS):
        return type(x)(map(partial(_subtract, builder), x, y))
    return builder.fsub(x, y)


def _multiply(builder: Any, x: Any, y: Any, tangent: bool = False) -> Any:
    """Return a product; with `tangent`, a zero of the second factor stays zero."""
    if x is None or y is None:
        return None
    if isinstance(x, tuple):
        terms = ((x[1], y[0]), (x[0], y[1]))
        slope = _add(builder, *(_multiply(builder, *each, tangent) for each in terms))
        return _multiply(builder, x[0], y[0], tangent), slope
    if isinstance(x, list):
        return [_multiply(builder, each, y, tangent) for each in x]
    if isinstance(y, list):
        return [_multiply(builder, x, each, tangent) for each in y]
    x, y = _splat(builder, x, y.type), _splat(builder, y, x.type)
    product = builder.fmul(x, y)
    if not tangent:
        return product
    return builder.select(builder.fcmp_ordered("==", y, ir.Constant(y.type, None)), y, product)


def _splat(builder: Any, number: Any, kind: Any) -> Any:
    """Return a double as a vector, if the other factor, of a type, is one."""
    if number.type == kind or kind == DOUBLE:
        return number
    undefined = ir.Constant(kind, ir.Undefined)
    first = builder.insert_element(undefined, number, ir.Constant(ir.IntType(32), 0))
    order = ir.Constant(ir.VectorType(ir.IntType(32), kind.count), [0] * kind.count)
    return builder.shuffle_vector(first, undefined, order)


def _divide(builder: Any, x: Any, y: Any) -> Any:
    if not isinstance(y, tuple):
        return builder.fdiv(x, y)
    quotient = _divide(builder, x[0], y[0])
    inverse = _divide(builder, _constant(1.0, y[0]), y[0])
    slope = _subtract(builder, x[1], _multiply(builder, quotient, y[1]))
    return quotient, _multiply(builder, inverse, slope)


def _select(builder: Any, condition: Any, x: Any, y: Any) -> Any:
    if x is None and y is None:
        return None
    x, y = (_constant_zero(b) if a is None else a for a, b in ((x, y), (y, x)))
    if isinstance(x, PARTS):
        return type(x)(map(partial(_select, builder, condition), x, y))
    return builder.select(condition, x, y)


def _constant_zero(like: Any) -> Any:
    if isinstance(like, tuple):
        return _constant_zero(like[0]), None
    if isinstance(like, list):
        return list(map(_constant_zero, like))
    return ir.Constant(like.type, None)


@lower_cast(types.Float, DualType)
@lower_cast(types.Integer, DualType)
@lower_cast(types.Boolean, DualType)
@lower_cast(DualType, DualType)
def _of_number(context: Any, builder: Any, source: Any, kind: Any, number: Any) -> Any:
    return _packed(context, builder, kind, _lifted(context, builder, source, number, kind))


# --- Arithmetic

Emit = Callable[..., Any]
"""Code of an operation: of builder, and the parts of each operand."""


def _common(kinds: Sequence[Any]) -> Any:
    """Return the type of the dual numbers among numbers; None if there are none, or others."""
    duals = [kind for kind in kinds if isinstance(kind, DualType)]
    outer = max(duals, key=lambda kind: len(kind.inner), default=None)
    if outer is None:
        return None
    known = {outer, *outer.inner}
    return outer if all(isinstance(kind, NUMBER) or kind in known for kind in kinds) else None


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
        operands = [
            _lifted(context, builder, *each, kind) for each in zip(kinds.args, numbers, strict=True)
        ]
        if function in (operator.truediv, operator.itruediv):
            values = list(map(_innermost, operands))
            end_where_undefined(context, builder, operator.truediv, None, values)
        emitted = emit(builder, *operands)
        return emitted if result else _packed(context, builder, kind, emitted)

    for bits in range(1, 2**count):
        kinds = [DualType if bits >> i & 1 else types.Float for i in range(count)]
        lower_builtin(function, *kinds)(lower)


def _compare(relation: str, ordered: bool = True) -> Emit:
    def emit(builder: Any, x: Any, y: Any) -> Any:
        compare = builder.fcmp_ordered if ordered else builder.fcmp_unordered
        return compare(relation, _innermost(x), _innermost(y))

    return emit


for _name, _emit in {
    "add": _add, "sub": _subtract, "mul": _multiply, "truediv": _divide
}.items():  # fmt: skip
    _operation(getattr(operator, _name), 2, _emit)
    _operation(getattr(operator, f"i{_name}"), 2, _emit)
for _name, _relation in {"lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "=="}.items():
    _operation(getattr(operator, _name), 2, _compare(_relation), types.boolean)
_operation(operator.ne, 2, _compare("!=", ordered=False), types.boolean)
_operation(operator.neg, 1, _negative)
_operation(operator.pos, 1, lambda _builder, x: x)


def _choice(function: Any, relation: str) -> None:
    """Define min or max, which take the first of equal numbers, as Python does."""

    @infer_global(function)
    class Template(AbstractTemplate):
        def generic(self, args: Any, kws: Any) -> Any:
            kind = None if kws or len(args) < 2 else _common(args)
            return kind and signature(kind, *[kind] * len(args))

    @lower_builtin(function, types.VarArg(DualType))
    def lower(context: Any, builder: Any, kinds: Any, numbers: Any) -> Any:
        first, *others = (_parts(context, builder, kinds.return_type, each) for each in numbers)
        for other in others:
            replaces = builder.fcmp_ordered(relation, _innermost(other), _innermost(first))
            first = _select(builder, replaces, other, first)
        return _packed(context, builder, kinds.return_type, first)

    @overload(function, **_OPTIONS)
    def of_tuple(values):  # type: ignore[no-untyped-def]
        if isinstance(values, types.BaseTuple) and _common(values.types) is not None:
            return lambda values: function(*values)
        return None


_choice(min, "<")
_choice(max, ">")

# --- Elementary functions


@intrinsic
def value_of(_typing: Any, x: Any) -> Any:
    """Return the value of a number."""
    kind = x.value if isinstance(x, DualType) else types.float64

    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        parts = _parts(context, builder, x, args[0])
        return _packed(context, builder, kind, parts[0]) if isinstance(parts, tuple) else parts

    return kind(x), codegen


def _chain(x: Any, context: Any, builder: Any, kinds: Any, numbers: Any) -> Any:
    """Return the parts of a value whose derivatives by dual numbers are given."""
    parts = list(map(partial(_parts, context, builder), kinds, numbers))
    count = len(parts) // 2
    terms = zip(parts[count + 1 :], parts[:count], strict=True)
    products = (_multiply(builder, each, number[1], tangent=True) for each, number in terms)
    return _packed(context, builder, x, (parts[count], reduce(partial(_add, builder), products)))


@intrinsic
def of_one(_typing: Any, x: Any, value: Any, derivative: Any) -> Any:
    """Return a value with the tangents of x times a derivative."""
    kinds = x, x.value, x.value
    return x(*kinds), lambda context, builder, _, args: _chain(x, context, builder, kinds, args)


@intrinsic
def of_two(_typing: Any, x: Any, y: Any, value: Any, by_x: Any, by_y: Any) -> Any:
    """Return a value with the tangents of x and y, each times a derivative."""
    kinds = x, x, x.value, x.value, x.value
    return x(*kinds), lambda context, builder, _, args: _chain(x, context, builder, kinds, args)


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


def _rules(function: Any, evaluate: Any, source: str) -> Callable[[Any], Any]:
    """Return the rule of a function for the type of its numbers, whose values may be dual."""
    outer = _defined(source, evaluate=function)
    inner = outer if evaluate is function else _defined(source, evaluate=evaluate)
    return lambda kind: outer if isinstance(kind.value, DualType) else inner


def _unary(function: Any, evaluate: Any, derivative: str) -> None:
    source = f"def rule(x):\n v = value_of(x)\n f = evaluate(v)\n return of_one(x, f, {derivative})"
    rule = _rules(function, evaluate, source)

    @overload(function, **_OPTIONS)
    def implementation(x):  # type: ignore[no-untyped-def]
        return rule(x) if isinstance(x, DualType) else None


def _binary(function: Any, evaluate: Any, by_x: str, by_y: str) -> None:
    source = "def rule(x, y):\n a, b = {}, {}\n f = evaluate(a, b)\n return {}"
    kinds = {
        (True, True): ("value_of(x)", "value_of(y)", f"of_two(x, y, f, {by_x}, {by_y})"),
        (True, False): ("value_of(x)", "float(y)", f"of_one(x, f, {by_x})"),
        (False, True): ("float(x)", "value_of(y)", f"of_one(y, f, {by_y})"),
    }
    rules = {key: _rules(function, evaluate, source.format(*each)) for key, each in kinds.items()}

    @overload(function, **_OPTIONS)
    def implementation(x, y):  # type: ignore[no-untyped-def]
        if (kind := _common((x, y))) is None:
            return None
        return rules[x == kind, y == kind](kind)


for _function, _derivative in UNARY.items():
    _substitute = trigonometry.SUBSTITUTES.get(_function)
    for _each in (_function, _substitute):
        if _each is not None:
            _unary(_each, _substitute or OF_REALS.get(_function, _function), _derivative)
    if (_each := of_numpy(_function)) is not None:
        _unary(_each, _each, _derivative)
for _function, _derivatives in BINARY.items():
    if _function is operator.mod:
        _binary(operator.imod, OF_REALS.get(_function, _function), *_derivatives)
    if _function is not operator.pow:
        _binary(_function, OF_REALS.get(_function, _function), *_derivatives)
    if (_each := of_numpy(_function)) is not None:
        _binary(_each, _each, *_derivatives)


def _of_value(function: Any) -> None:
    @overload(function, **_OPTIONS)
    def implementation(x):  # type: ignore[no-untyped-def]
        return (lambda x: function(value_of(x))) if isinstance(x, DualType) else None


for _each in (math.ldexp, np.ldexp):

    @overload(_each, **_OPTIONS)
    def _ldexp(x, i):  # type: ignore[no-untyped-def]
        if not isinstance(x, DualType):
            return None
        return lambda x, i: of_one(x, math.ldexp(value_of(x), i), math.ldexp(1.0, i))


for _each in (*PIECEWISE_CONSTANT, *map(of_numpy, PIECEWISE_CONSTANT), int, bool, round):
    if _each is not None:
        _of_value(_each)


def _absolute(x):  # type: ignore[no-untyped-def]
    v = value_of(x)
    return of_one(x, abs(v), 1.0 if v > 0.0 else (-1.0 if v < 0.0 else 0.0 * v))


def _floor_quotient(x, y):  # type: ignore[no-untyped-def]
    return value_of(x) // value_of(y)


for _each in (abs, math.fabs):

    @overload(_each, **_OPTIONS)
    def _size(x):  # type: ignore[no-untyped-def]
        return _absolute if isinstance(x, DualType) else None


def _expressed(function: Any, expression: str) -> None:
    """Define a function of NumPy by an expression."""
    names = ", ".join("xyz"[: function.nin])
    rule = _defined(f"def rule({names}):\n return {expression}")

    def typed(*kinds: Any) -> Any:
        return rule if _common(kinds) is not None else None

    overload(function, **_OPTIONS)(_defined(f"rule = lambda {names}: typed({names})", typed=typed))


for _each, _expression in EXPRESSIONS.items():
    _expressed(_each, _expression)


for _each in (operator.floordiv, operator.ifloordiv):

    @overload(_each, **_OPTIONS)
    def _quotient(x, y):  # type: ignore[no-untyped-def]
        return _floor_quotient if _common((x, y)) is not None else None


@overload(float, **_OPTIONS)
def _float(x):  # type: ignore[no-untyped-def]
    return (lambda x: x) if isinstance(x, DualType) else None


@overload(np.searchsorted, **_OPTIONS)
def _place_among(a, v, side="left"):  # type: ignore[no-untyped-def]
    if not isinstance(v, DualType):
        return None
    return lambda a, v, side="left": np.searchsorted(a, value_of(v), side)


@overload(np.digitize, **_OPTIONS)
def _bin(x, bins, right=False):  # type: ignore[no-untyped-def]
    if not isinstance(x, DualType):
        return None
    return lambda x, bins, right=False: np.digitize(value_of(x), bins, right)


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
    power = _whole_power(builder, _parts(context, builder, kind, numbers[0]), exponent)
    return _packed(context, builder, kind, power)


def _whole_power(builder: Any, x: Any, exponent: int) -> Any:
    if not isinstance(x, tuple):
        return multiplied(builder, x, exponent)
    factor = _whole_power(builder, x[0], max(exponent - 1, 0))
    factor = _multiply(builder, _constant(float(exponent), x[0]), factor)
    return _whole_power(builder, x[0], exponent), _multiply(builder, factor, x[1])


def _real_power(context: Any, builder: Any, kinds: Any, numbers: Any) -> Any:
    return context.compile_internal(builder, lambda x, y: raised(x, y), kinds, numbers)


for _kinds in ((DualType, DualType), (DualType, types.Float), (types.Float, DualType)):
    lower_builtin(operator.pow, *_kinds)(_real_power)
    lower_builtin(operator.ipow, *_kinds)(_real_power)

# --- Vectors


def _doubles(kind: Any) -> int:
    """Return the number of doubles of a number in memory."""
    if isinstance(kind, DualType):
        return _doubles(kind.value) + _doubles(kind.slope)
    return kind.width if isinstance(kind, TangentsType) else 1


def _in_memory(builder: Any, kind: Any, address: Any, index: Any) -> Iterator[Any]:
    """Yield pointers to value and tangents of a number, and of those that are dual."""
    place = builder.add(address, builder.mul(index, ir.Constant(INTEGER, WORD * _doubles(kind))))
    if not isinstance(kind, DualType):
        for i, of in enumerate(kind.vectors if isinstance(kind, TangentsType) else [DOUBLE]):
            shifted = builder.add(place, ir.Constant(INTEGER, WORD * LANES * i))
            yield builder.inttoptr(shifted, of.as_pointer())
        return
    first = ir.Constant(INTEGER, 0)
    yield from _in_memory(builder, kind.value, place, first)
    after = builder.add(place, ir.Constant(INTEGER, WORD * _doubles(kind.value)))
    yield from _in_memory(builder, kind.slope, after, first)


def _places(builder: Any, numbers: Any, view: Any, index: Any) -> Iterator[Any]:
    """Yield these pointers of a number of a view."""
    if isinstance(numbers, VectorType):
        yield from _in_memory(builder, numbers.kind, view.address, index)
        return
    yield from _in_memory(builder, numbers.kind.value, view.address, index)
    slope = builder.add(view.slopes, builder.mul(index, view.stride))
    yield from _in_memory(builder, numbers.kind.slope, slope, ir.Constant(INTEGER, 0))


def _loaded(builder: Any, kind: Any, places: Iterator[Any]) -> Any:
    if isinstance(kind, DualType):
        return tuple(_loaded(builder, each, places) for each in (kind.value, kind.slope))
    if isinstance(kind, TangentsType):
        return [builder.load(next(places), align=WORD) for _ in kind.vectors]
    return builder.load(next(places), align=WORD)


def _stored(builder: Any, parts: Any, places: Iterator[Any]) -> None:
    if isinstance(parts, PARTS):
        for each in parts:
            _stored(builder, each, places)
    else:
        builder.store(parts, next(places), align=WORD)


@intrinsic
def _load(_typing: Any, numbers: Any, index: Any) -> Any:
    kind = numbers.kind

    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        view = cgutils.create_struct_proxy(numbers)(context, builder, value=args[0])
        places = _places(builder, numbers, view, args[1])
        return _packed(context, builder, kind, _loaded(builder, kind, places))

    return kind(numbers, types.int64), codegen


@intrinsic
def _store(_typing: Any, numbers: Any, index: Any, number: Any) -> Any:
    kind = numbers.kind

    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        view = cgutils.create_struct_proxy(numbers)(context, builder, value=args[0])
        places = _places(builder, numbers, view, args[1])
        _stored(builder, _parts(context, builder, kind, args[2]), places)
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
_slopes, _stride = _member("slopes"), _member("stride")


def vector_at(width: int) -> Any:
    """Return an intrinsic: a view of `length` numbers with tangents at an address."""
    return _vector_at(dual(width))


@cache
def _vector_at(number: DualType) -> Any:
    kind = VectorType(number)

    @intrinsic
    def view(_typing: Any, address: Any, length: Any) -> Any:
        def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            numbers = cgutils.create_struct_proxy(kind)(context, builder)
            numbers.address, numbers.length = args
            return numbers._getvalue()

        return kind(types.int64, types.int64), codegen

    return view


@cache
def split_at(width: int) -> Any:
    """Return an intrinsic: a view of values and of tangents at two addresses, `stride` bytes apart.

    Its arguments are the address of the values, the number of values, the address of the tangents
    and the stride.
    """
    kind = SplitType(dual(width))

    @intrinsic
    def view(_typing: Any, address: Any, length: Any, slopes: Any, stride: Any) -> Any:
        def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            numbers = cgutils.create_struct_proxy(kind)(context, builder)
            numbers.address, numbers.length, numbers.slopes, numbers.stride = args
            return numbers._getvalue()

        return kind(*[types.int64] * 4), codegen

    return view


@overload(len, **_OPTIONS)
def _len(numbers):  # type: ignore[no-untyped-def]
    return (lambda numbers: _length(numbers)) if isinstance(numbers, VIEWS) else None


@overload_attribute(VectorType, "size", **_OPTIONS)
@overload_attribute(SplitType, "size", **_OPTIONS)
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
    if not isinstance(numbers, VIEWS):
        return None
    if isinstance(index, types.Integer):
        return lambda numbers, index: _load(numbers, _place(numbers, index))
    if isinstance(index, types.SliceType) and not index.has_step:
        if isinstance(numbers, SplitType):
            split = split_at(numbers.kind.width)

            def split_part(numbers, index):  # type: ignore[no-untyped-def]
                start, stop, _ = index.indices(_length(numbers))
                slopes, stride = _slopes(numbers), _stride(numbers)
                address, length = _address(numbers) + WORD * start, max(0, stop - start)
                return split(address, length, slopes + stride * start, stride)

            return split_part
        at, size = _vector_at(numbers.kind), WORD * _doubles(numbers.kind)

        def part(numbers, index):  # type: ignore[no-untyped-def]
            start, stop, _ = index.indices(_length(numbers))
            return at(_address(numbers) + size * start, max(0, stop - start))

        return part
    return None


@overload(operator.setitem, **_OPTIONS)
def _set(numbers, index, number):  # type: ignore[no-untyped-def]
    if not isinstance(numbers, VIEWS) or not isinstance(index, types.Integer):
        return None
    return lambda numbers, index, number: _store(numbers, _place(numbers, index), number)


# --- Rates


@infer_global(with_rate)
class _WithRate(AbstractTemplate):
    def generic(self, args: Any, kws: Any) -> Any:
        kind = _common(args) or types.float64
        return None if kws else signature(dual(1, kind), *[kind] * len(args))


@lower_builtin(with_rate, types.Float, types.Float)
@lower_builtin(with_rate, DualType, DualType)
@lower_builtin(with_rate, types.Float, types.Float, types.Float)
@lower_builtin(with_rate, DualType, DualType, DualType)
def _of_rate(context: Any, builder: Any, kinds: Any, numbers: Any) -> Any:
    result = kinds.return_type
    value, rate, *_ = map(partial(_parts, context, builder), kinds.args, numbers)
    return _packed(context, builder, result, (value, rate))


@intrinsic
def _value_and_rate(_typing: Any, number: Any, time: Any) -> Any:
    """Return value and rate of a number; the rate is zero if the number does not change."""
    kind = time.value
    result = types.UniTuple(kind, 2)

    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        parts = _lifted(context, builder, number, args[0], time)
        members = [_packed(context, builder, kind, each) for each in parts]
        return context.make_tuple(builder, result, members)

    return result(number, time), codegen


@intrinsic
def _moved(_typing: Any, given: Any, time: Any) -> Any:
    """Return a number, or a named tuple, after a time at its rate."""
    count, number = getattr(given, "count", 1), getattr(given, "dtype", given)
    kind, result = number.value, number.value
    if number != given:
        result = types.NamedUniTuple(kind, count, given.instance_class)

    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        step = _lifted(context, builder, time, args[1], kind)
        moved = []
        for each in [args[0]] if number == given else cgutils.unpack_tuple(builder, args[0]):
            value, rate = _parts(context, builder, number, each)
            parts = _add(builder, value, _multiply(builder, step, rate))
            moved.append(_packed(context, builder, kind, parts))
        return moved[0] if number == given else context.make_tuple(builder, result, moved)

    return result(given, time), codegen


@intrinsic
def _reals_at(_typing: Any, address: Any, length: Any) -> Any:
    def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
        return view(VECTOR, context, builder, args[0], [args[1]])

    return VECTOR(types.int64, types.int64), codegen


@overload(after, **_OPTIONS)
def _after(given, time):  # type: ignore[no-untyped-def]
    if not isinstance(given, VectorType):
        return lambda given, time: _moved(given, time)
    kind, size = given.kind.value, WORD * _doubles(given.kind)
    at = _vector_at(kind) if isinstance(kind, DualType) else _reals_at

    def numbers(given, time):  # type: ignore[no-untyped-def]
        result = at(_address(given) + size * len(given), len(given))
        for k in range(len(given)):
            result[k] = _moved(given[k], time)
        return result

    return numbers


@overload(with_rates, **_OPTIONS)
def _with_rates(values, rates, memory):  # type: ignore[no-untyped-def]
    is_dual = isinstance(memory, VectorType)
    start = _address if is_dual else data
    at = _vector_at(dual(1, memory.kind if is_dual else types.float64))

    def numbers(values, rates, memory):  # type: ignore[no-untyped-def]
        result = at(start(memory), len(values))
        for k in range(len(values)):
            result[k] = with_rate(values[k], rates[k])
        return result

    return numbers


@overload(along, **_OPTIONS)
def _along(function, step, mode, t, y, p):  # type: ignore[no-untyped-def]
    try:  # whether the function takes numbers with tangents
        function.get_call_type(cpu_target.typing_context, (mode, t, y, p), {})
    except Exception:  # numba raises various exceptions
        return by_differences
    return lambda function, step, mode, t, y, p: _value_and_rate(function(mode, t, y, p), t)
