"""Powers and large constants of integers in compiled code.

A compiled function has one type for a value. numba takes that of a power of integers to be an
integer, so that 10**-1 is 0, where Python returns 0.1. In copied functions such a power is a real
number, unless its exponent is a constant that is not negative.

Compiled integers have 64 bits, and larger ones lose their first bits. In copied functions sums and
products of constant integers beyond them are real numbers.
"""

from __future__ import annotations

import operator
from typing import Any

from numba import types
from numba.core import ir
from numba.core.ir_utils import get_definition, guard
from numba.core.rewrites import Rewrite, register_rewrite
from numba.extending import overload

from mems_impact.integrators.jit.numba_support import FOR_C, INNER

__all__ = ["COPIES", "power"]

POWERS = (operator.pow, operator.ipow)
OPERATIONS = (operator.add, operator.sub, operator.mul, operator.pow, operator.neg)
BITS = 63  # of the size of a compiled integer
MAX_BITS = 1000  # of a constant that is a real number
COPIES = "mems_impact.integrators.jit.closures"  # module of the copies of functions


def power(base: Any, exponent: Any) -> Any:
    """Return a power."""
    return base**exponent


@overload(power, jit_options={**FOR_C, **INNER}, prefer_literal=True)
def _power(base, exponent):  # type: ignore[no-untyped-def]
    if isinstance(base, types.Integer) and isinstance(exponent, types.Integer):
        return lambda base, exponent: float(base) ** float(exponent)
    return lambda base, exponent: base**exponent


@register_rewrite("before-inference")
class IntegerArithmetic(Rewrite):
    """Replaces these powers in copied functions by `power`, and large constants by real numbers."""

    def match(self, func_ir: Any, block: Any, typemap: Any, calltypes: Any) -> bool:
        """Return whether a block has some."""
        self._block, self._operands, self._large = block, {}, {}
        self._definitions = func_ir._definitions
        if func_ir.func_id.modname != COPIES:
            return False
        for statement in block.find_insts(ir.Assign):
            operands = _operands(func_ir, statement.value)
            exponent = _constant(func_ir, operands[1]) if operands else 0
            value = _constant(func_ir, statement.value)
            if exponent is None or exponent < 0:
                self._operands[statement] = operands
            elif isinstance(statement.value, ir.Expr) and value and value.bit_length() > BITS:
                self._large[statement] = float(value)
        return bool(self._operands or self._large)

    def apply(self) -> Any:
        """Return the block with calls of `power` and real constants."""
        block = self._block.copy()
        block.clear()
        for statement in self._block.body:
            loc = statement.loc
            if statement in self._operands:
                name = block.scope.redefine("$power", loc=loc)
                called = ir.Global("power", power, loc)
                call = ir.Expr.call(name, self._operands[statement], (), loc)
                self._definitions[name.name] = [called]
                block.append(ir.Assign(called, name, loc))
                statement = self._assignment(statement, call)
            elif statement in self._large:
                statement = self._assignment(statement, ir.Const(self._large[statement], loc))
            block.append(statement)
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
        return value.value if type(value.value) is int else None
    if not isinstance(value, ir.Expr) or value.op not in ("binop", "unary"):
        return None
    if value.fn not in OPERATIONS:
        return None
    operands: list[Any] = [_constant(func_ir, each) for each in value.list_vars()]
    if None in operands:
        return None
    if value.fn is operator.pow and not 0 <= operands[1] * operands[0].bit_length() < MAX_BITS:
        return None
    return int(value.fn(*operands))


def _operands(func_ir: Any, value: Any) -> list[Any] | None:
    """Return base and exponent of a power, or None."""
    if not isinstance(value, ir.Expr):
        return None
    if value.op in ("binop", "inplace_binop"):
        return [value.lhs, value.rhs] if value.fn in POWERS else None
    if value.op != "call" or value.kws or len(value.args) != 2:
        return None
    called = guard(get_definition, func_ir, value.func)
    return list(value.args) if isinstance(called, ir.Global) and called.value is pow else None
