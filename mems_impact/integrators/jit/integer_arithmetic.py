"""Arithmetic of users' functions, with the values and the exceptions of Python.

A division by zero, the root of a negative number or an exponential beyond all numbers ends the call
of a function, with the status of StopIteration: the function is undefined there. numba alone would
continue with infinity or nan, which a comparison or a minimum may swallow.

Compiled integers have 64 bits, and numba continues beyond them with the last bits. In copies of
users' functions, whose module is `CHECKED`, an operation whose result needs more bits raises an
exception instead, which ends the run with an error.

A compiled function has one type for a value. numba takes that of a power of integers to be an
integer, so that 10**-1 is 0, where Python returns 0.1. In all copies such a power is a real number,
unless its exponent is a constant that is not negative. A constant beyond 64 bits is a real number
where it meets real numbers, and does not compile where it meets an integer.
"""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import reduce
from typing import Any

import numpy as np
from llvmlite import ir as llvm
from numba import types
from numba.core import ir
from numba.core.errors import NumbaTypeError
from numba.core.imputils import lower_constant
from numba.core.ir_utils import get_definition, guard
from numba.core.rewrites import Rewrite, register_rewrite
from numba.core.typeconv import Conversion
from numba.extending import (
    intrinsic,
    lower_cast,
    models,
    overload,
    register_model,
    typeof_impl,
)

from mems_impact.integrators.jit.numba_support import CHECKED, COPIES, FOR_C, INNER

TOO_LARGE = "an integer exceeds the 64 bits of compiled integers"
INEXACT = "an integer beyond 2**53 is compared with, or converted to, a real number"
BITS = 63  # of the size of a compiled integer
EXACT = 2**53  # up to which integers are real numbers
MAX_BITS = 1023  # of a constant that is a real number
LARGEST_EXPONENT = 16  # of powers by multiplication, as in exported C

WORD, DOUBLE = types.int64, types.float64
ZERO = llvm.Constant(llvm.DoubleType(), 0.0)
DIVISIONS = (operator.truediv, operator.mod, operator.floordiv)
# Functions of `math` of one argument that are undefined somewhere, or exceed all numbers.
UNDEFINED = (
    "acos", "acosh", "asin", "atanh", "cos", "cosh", "exp", "exp2", "expm1", "gamma", "lgamma",
    "log", "log10", "log1p", "log2", "sin", "sinh", "sqrt", "tan",
)  # fmt: skip
POWERS = (operator.pow, operator.ipow)
_OPTIONS: dict[str, Any] = {"jit_options": {**FOR_C, **INNER}}

# --- Checked operations


def _raise_if(context: Any, builder: Any, condition: Any, message: str) -> None:
    with builder.if_then(condition, likely=False):
        context.call_conv.return_user_exc(builder, OverflowError, (message,))


def _with_overflow(name: str) -> Any:
    """Return an intrinsic of an operation for which LLVM has an overflow bit."""

    @intrinsic
    def operation(_typing: Any, a: Any, b: Any) -> Any:
        def codegen(context: Any, builder: Any, _signature: Any, args: Any) -> Any:
            pair = getattr(builder, f"s{name}_with_overflow")(*args)
            _raise_if(context, builder, builder.extract_value(pair, 1), TOO_LARGE)
            return builder.extract_value(pair, 0)

        return WORD(WORD, WORD), codegen

    return operation


def _of_reals(
    function: Callable[..., Any],
    result: Any = DOUBLE,
    count: int = 2,
    exact: bool = False,
    exponent: int | None = None,
) -> Any:
    """Return an intrinsic of a real function, or of a power, which converts integer operands.

    If `exact`, an integer operand that is no real number raises an exception. Where Python raises
    an exception, the call ends with the status of StopIteration: the function is undefined there.
    """

    def codegen(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        operands = []
        for kind, value in zip(signature.args, args, strict=True):
            if exact and kind == WORD:
                shifted = builder.add(value, llvm.Constant(value.type, EXACT))
                bound = llvm.Constant(value.type, 2 * EXACT)
                _raise_if(context, builder, builder.icmp_unsigned(">", shifted, bound), INEXACT)
            operands.append(context.cast(builder, value, kind, DOUBLE))
        signature = result(*[DOUBLE] * count)
        if exponent is None:
            kind = context.typing_context.resolve_value_type(function)
            kind.get_call_type(context.typing_context, signature.args, {})
            value = context.get_function(kind, signature)(builder, operands)
        else:
            value = multiplied(builder, operands[0], exponent)
        if result == DOUBLE:
            end_where_undefined(context, builder, function, value, operands)
        return value

    if count == 1:

        @intrinsic
        def operation(_typing: Any, a: Any) -> Any:
            return result(a), codegen

    else:

        @intrinsic
        def operation(_typing: Any, a: Any, b: Any) -> Any:
            return result(a, b), codegen

    return operation


def end_where_undefined(
    context: Any, builder: Any, function: Any, value: Any, operands: list[Any]
) -> None:
    """End the call, with the status of StopIteration, where Python raises an exception."""
    with _where_undefined(builder, function, value, operands):
        context.call_conv.return_stop_iteration(builder)


@contextmanager
def _where_undefined(
    builder: Any, function: Any, value: Any, operands: list[Any]
) -> Iterator[None]:
    """Execute the instructions of the ``with`` where Python raises an exception.

    A division does so by zero, a square root of a negative number. Powers and other functions of
    ``math`` do so if the result is nan and no argument is, or if the result is infinite and all
    arguments are finite.
    """
    if function in DIVISIONS or function is math.sqrt:
        relation = "<" if function is math.sqrt else "=="
        undefined = builder.fcmp_ordered(relation, operands[-1], ZERO)
        with builder.if_then(undefined, likely=False):
            yield
        return
    with builder.if_then(_any_differ(builder, (_excess(builder, value), ZERO)), likely=False):
        nan_from_nan = _any_differ(builder, *((each, each) for each in operands))
        infinite_too = _any_differ(builder, *((_excess(builder, each), ZERO) for each in operands))
        is_nan = _any_differ(builder, (value, value))
        defined = builder.select(is_nan, nan_from_nan, infinite_too)
        with builder.if_then(builder.not_(defined)):
            yield


def multiplied(builder: Any, base: Any, exponent: int) -> Any:
    """Return a power by multiplication, with the bits of numba's."""
    value = llvm.Constant(base.type, 1.0)
    while exponent:
        if exponent & 1:
            value = builder.fmul(value, base)
        exponent >>= 1
        base = builder.fmul(base, base)
    return value


def _excess(builder: Any, value: Any) -> Any:
    """Return zero for a finite number, and nan for another."""
    return builder.fsub(value, value)


def _any_differ(builder: Any, *pairs: Any) -> Any:
    return reduce(builder.or_, [builder.fcmp_unordered("!=", *pair) for pair in pairs])


_add, _subtract, _multiply = map(_with_overflow, ("add", "sub", "mul"))
_divide = _of_reals(operator.truediv)  # ends a call, by zero


def _python(function: Callable[..., Any]) -> Callable[..., Any]:
    """Let compiled code call a function of integers."""
    overload(function, strict=False, **_OPTIONS)(lambda *_: function)
    return function


@_python
def _negative(a):  # type: ignore[no-untyped-def]
    return _subtract(0, a)


@_python
def _absolute(a):  # type: ignore[no-untyped-def]
    return _subtract(0, a) if a < 0 else a


@_python
def _floor_divide(a, b):  # type: ignore[no-untyped-def]
    if b == 0:
        return int(_divide(a, b))
    return _subtract(0, a) if b == -1 else a // b


@_python
def _modulo(a, b):  # type: ignore[no-untyped-def]
    if b == 0:
        return int(_divide(a, b))
    return 0 if b == -1 else a % b


@_python
def _shift_left(a, b):  # type: ignore[no-untyped-def]
    if b < 0:
        raise ValueError("negative shift count")
    result = a << min(b, BITS)
    if result >> min(b, BITS) != a or (b > BITS and a != 0):
        raise OverflowError(TOO_LARGE)
    return result


@_python
def _shift_right(a, b):  # type: ignore[no-untyped-def]
    if b < 0:
        raise ValueError("negative shift count")
    return a >> min(b, BITS)


@_python
def _integer_power(base, exponent):  # type: ignore[no-untyped-def]
    result = 1
    while exponent > 0:
        if exponent & 1:
            result = _multiply(result, base)
        exponent >>= 1
        if exponent > 0:
            base = _multiply(base, base)
    return result


@_python
def _real_power(base, exponent):  # type: ignore[no-untyped-def]
    return base ** float(exponent)


@_python
def _same(a):  # type: ignore[no-untyped-def]
    return a


def _conversion(function: Callable[..., Any]) -> Callable[..., Any]:
    """Return the integer of a real number by `function`."""

    def convert(x):  # type: ignore[no-untyped-def]
        if not -(2.0**63) <= x < 2.0**63:
            if not math.isfinite(x):
                return int(_divide(x, 0.0))
            raise OverflowError(TOO_LARGE)
        return function(x)

    return _python(convert)


CONVERSIONS: dict[Any, Any] = {
    function: _conversion(function)
    for function in (int, round, math.floor, math.ceil, math.trunc, np.int64)
}
OPERATIONS: dict[Any, Any] = {
    operator.add: _add,
    operator.sub: _subtract,
    operator.mul: _multiply,
    operator.neg: _negative,
    operator.floordiv: _floor_divide,
    operator.mod: _modulo,
    operator.lshift: _shift_left,
    operator.rshift: _shift_right,
    operator.pow: _integer_power,
    abs: _absolute,
}
COMPARISONS = (operator.lt, operator.le, operator.gt, operator.ge, operator.eq, operator.ne)
FOLDED = {*OPERATIONS, operator.and_, operator.or_, operator.xor, operator.invert} - {abs}
OF_REALS: dict[Any, Any] = {
    **{each: _of_reals(each, types.boolean, exact=True) for each in COMPARISONS},
    **{getattr(math, name): _of_reals(getattr(math, name), count=1) for name in UNDEFINED},
    **{each: _of_reals(each) for each in (operator.pow, pow, math.pow)},
    **{each: _of_reals(each, exact=True) for each in DIVISIONS},
}
SMALL_POWERS = [
    _of_reals(operator.pow, count=1, exponent=each) for each in range(LARGEST_EXPONENT + 1)
]


@register_rewrite("after-inference")
class CheckedArithmetic(Rewrite):
    """Replaces operations with integer operands in copies of users' functions."""

    def __init__(self, state: Any) -> None:
        self._context = state.typingctx

    def match(self, func_ir: Any, block: Any, typemap: Any, calltypes: Any) -> bool:
        """Return whether a block has some."""
        self._block, self._kinds, self._calltypes, self._checked = block, typemap, calltypes, {}
        if func_ir.func_id.modname != CHECKED:
            return False
        for statement in block.find_insts(ir.Assign):
            if isinstance(statement.value, ir.Expr) and statement.value in calltypes:
                operation = self._operation(statement.value, typemap)
                if operation is not None:
                    self._checked[statement] = operation
        return bool(self._checked)

    def _operation(self, expression: Any, typemap: Any) -> tuple[Any, list[Any]] | None:
        """Return the checked function of an expression and its operands, or None."""
        if expression.op == "call":
            operands, called = list(expression.args), typemap[expression.func.name]
            function = getattr(called, "typing_key", None)
            function = np.int64 if called == types.NumberClass(WORD) else function
        elif expression.op in ("binop", "inplace_binop", "unary"):
            operands = expression.list_vars()
            is_in_place = expression.op == "inplace_binop"
            function = expression.immutable_fn if is_in_place else expression.fn
        else:
            return None
        declared = [typemap[operand.name] for operand in operands]
        kinds, result = [_kind(each) for each in declared], self._calltypes[expression].return_type
        is_of_reals = types.Float in kinds and function not in (operator.mod, operator.floordiv)
        if not {*kinds} <= {types.Float, types.Integer, LARGE}:
            return None
        if LARGE in kinds and len(kinds) > 1 and not is_of_reals:
            raise NumbaTypeError("it has an integer beyond 64 bits among integers")
        if function in CONVERSIONS and len(kinds) == 1 and _kind(result) is types.Integer:
            return CONVERSIONS[function] if kinds == [types.Float] else _same, operands
        if function is power and types.Float in kinds:
            function = operator.pow
        if function in POWERS and kinds == [types.Float, types.Integer]:
            exponent: Any = getattr(declared[1], "literal_value", math.inf)
            if expression.op != "call" and 0 <= exponent <= LARGEST_EXPONENT:
                return SMALL_POWERS[exponent], operands[:1]
        is_real = function in OF_REALS and _kind(result) in (types.Float, types.Boolean)
        if is_real or (function in COMPARISONS and types.Float in kinds and kinds[0] != kinds[1]):
            return OF_REALS[function], operands
        if types.Float in kinds or types.Integer not in kinds:
            return None
        return (OPERATIONS[function], operands) if function in OPERATIONS else None

    def apply(self) -> Any:
        """Return the block with the checked operations."""
        block = self._block.copy()
        block.clear()
        for statement in self._block.body:
            if statement in self._checked:
                statement = self._replaced(statement, *self._checked[statement])
            block.append(statement)
        return block

    def _replaced(self, statement: Any, function: Any, operands: list[Any]) -> Any:
        """Return an assignment of an operation by a function."""
        loc, kinds = statement.loc, [self._kinds[operand.name] for operand in operands]
        names = ("value",) if len(operands) == 1 else ("lhs", "rhs")
        values = dict(zip(names, operands, strict=True))
        values |= {f"static_{name}": ir.UNDEFINED for name in values}
        operation = "unary" if len(operands) == 1 else "binop"
        expression = ir.Expr(operation, loc, fn=function, **values)
        called = self._context.resolve_value_type(function)
        kinds = [DOUBLE if _kind(kind) in (types.Float, LARGE) else WORD for kind in kinds]
        self._calltypes[expression] = called.get_call_type(self._context, kinds, {})
        return ir.Assign(expression, statement.target, loc)


def _kind(kind: Any) -> Any:
    """Return the class of a number, booleans among the integers."""
    if isinstance(kind, types.Integer | types.Boolean):
        return types.Integer
    return types.Float if isinstance(kind, types.Float) else kind


# --- Powers and large constants


class LargeInteger(int):
    """A constant beyond 64 bits."""


class _LargeType(types.Number):
    """The type of such a constant, which is converted to real numbers only."""

    def can_convert_to(self, _context: Any, other: Any) -> Any:
        """Return the conversion to a type, or None."""
        return Conversion.safe if other == DOUBLE else None


class _LargeModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, llvm.DoubleType())


LARGE = _LargeType("integer beyond 64 bits")
register_model(_LargeType)(_LargeModel)
typeof_impl.register(LargeInteger)(lambda _value, _context: LARGE)
lower_cast(_LargeType, DOUBLE)(lambda _context, _builder, _from, _to, value: value)
lower_constant(_LargeType)(
    lambda _context, _builder, _kind, value: llvm.Constant(llvm.DoubleType(), float(value))
)


def power(base: Any, exponent: Any) -> Any:
    """Return a power whose exponent is a variable, or negative."""
    return base**exponent


@overload(power, **_OPTIONS)
def _power(base, exponent):  # type: ignore[no-untyped-def]
    if not isinstance(exponent, types.Integer):
        return lambda base, exponent: base**exponent
    if not isinstance(base, types.Number):
        return lambda base, exponent: base ** float(exponent)
    return _power_of_integers if isinstance(base, types.Integer) else _real_power


def _power_of_integers(base, exponent):  # type: ignore[no-untyped-def]
    result = float(base) ** float(exponent)
    if exponent < 0 and base == 0:
        return _divide(1, base)
    if exponent > 0 and not abs(result) <= EXACT:
        raise OverflowError(INEXACT)
    return result


@register_rewrite("before-inference")
class IntegerPowers(Rewrite):
    """Replaces these powers in copied functions by `power`, and evaluates large constants."""

    def match(self, func_ir: Any, block: Any, typemap: Any, calltypes: Any) -> bool:
        """Return whether a block has some."""
        self._block, self._new = block, {}
        self._definitions = func_ir._definitions
        if func_ir.func_id.modname not in (COPIES, CHECKED):
            return False
        for statement in block.find_insts(ir.Assign):
            if _is_large(statement.value):
                continue
            value, has_large = (find(func_ir, statement.value) for find in (_constant, _has_large))
            operands = _operands(func_ir, statement.value)
            if value is not None and BITS < value.bit_length() < MAX_BITS:
                self._new[statement] = ir.Const(LargeInteger(value), statement.loc)
            elif value is not None and has_large:
                self._new[statement] = ir.Const(value, statement.loc)
            elif has_large and _called(func_ir, statement.value) is float:
                number: Any = _constant(func_ir, statement.value.args[0])
                self._new[statement] = ir.Const(float(number), statement.loc)
            elif operands:
                exponent = _constant(func_ir, operands[1])
                if exponent is None or exponent < 0:
                    self._new[statement] = operands
                elif statement.value.op == "call":
                    self._new[statement] = ir.Expr.binop(operator.pow, *operands, statement.loc)
        return bool(self._new)

    def apply(self) -> Any:
        """Return the block with calls of `power` and evaluated constants."""
        block = self._block.copy()
        block.clear()
        for statement in self._block.body:
            new, loc = self._new.get(statement), statement.loc
            if isinstance(new, list):
                name = block.scope.redefine("$power", loc=loc)
                called = ir.Global("power", power, loc)
                self._definitions[name.name] = [called]
                block.append(ir.Assign(called, name, loc))
                new = ir.Expr.call(name, new, (), loc)
            block.append(self._assignment(statement, new) if new else statement)
        return block

    def _assignment(self, statement: Any, value: Any) -> Any:
        """Return an assignment of another value."""
        values = self._definitions[statement.target.name]
        values[values.index(statement.value)] = value
        return ir.Assign(value, statement.target, statement.loc)


def _constant(func_ir: Any, value: Any) -> int | None:
    """Return a constant integer, or None."""
    if isinstance(value, ir.Var):
        value = guard(get_definition, func_ir, value)
    if isinstance(value, ir.Const | ir.Global | ir.FreeVar):
        return value.value if type(value.value) in (int, LargeInteger) else None
    if not isinstance(value, ir.Expr) or value.op not in ("binop", "unary"):
        return None
    operands: list[Any] = [_constant(func_ir, each) for each in value.list_vars()]
    if None in operands or value.fn not in FOLDED:
        return None
    size = operands[0].bit_length()
    if value.fn is operator.pow and not 0 <= operands[1] * size < MAX_BITS:
        return None
    if value.fn is operator.lshift and not 0 <= operands[1] < MAX_BITS:
        return None
    try:
        return int(value.fn(*operands))
    except (ArithmeticError, ValueError):
        return None


def _is_large(value: Any) -> bool:
    return isinstance(value, ir.Const) and type(value.value) is LargeInteger


def _has_large(func_ir: Any, expression: Any) -> bool:
    """Return whether an expression of constants has one beyond 64 bits."""
    operands = expression.list_vars() if isinstance(expression, ir.Expr) else ()
    return any(_is_large(guard(get_definition, func_ir, operand)) for operand in operands)


def _called(func_ir: Any, value: Any) -> Any:
    """Return the function that an expression calls by its name, or None."""
    if not isinstance(value, ir.Expr) or value.op != "call" or value.kws:
        return None
    called = guard(get_definition, func_ir, value.func)
    return called.value if isinstance(called, ir.Global) else None


def _operands(func_ir: Any, value: Any) -> list[Any] | None:
    """Return base and exponent of a power, or None."""
    if _called(func_ir, value) is pow:
        return list(value.args) if len(value.args) == 2 else None
    is_power = isinstance(value, ir.Expr) and value.op in ("binop", "inplace_binop")
    return [value.lhs, value.rhs] if is_power and value.fn in POWERS else None
