"""Powers of integers in compiled code.

A compiled function has one type for a value. numba takes that of a power of integers to be an
integer, so that 10**-1 is 0, where Python returns 0.1. In copied functions such a power is a real
number, unless its exponent is a constant that is not negative.
"""

from __future__ import annotations

import operator
from typing import Any

from numba import types
from numba.core import ir
from numba.core.ir_utils import find_const, guard
from numba.core.rewrites import Rewrite, register_rewrite
from numba.extending import overload

from mems_impact.integrators.jit.numba_support import FOR_C, INNER

__all__ = ["COPIES", "power"]

POWERS = (operator.pow, operator.ipow)
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
class IntegerPowers(Rewrite):
    """Replaces powers in copied functions by `power`, unless the exponent is such a constant."""

    def match(self, func_ir: Any, block: Any, typemap: Any, calltypes: Any) -> bool:
        """Return whether a block has such powers."""
        self._block, self._operands = block, {}
        self._definitions = func_ir._definitions
        if func_ir.func_id.modname != COPIES:
            return False
        for statement in block.find_insts(ir.Assign):
            operands = _operands(func_ir, statement.value)
            exponent = guard(find_const, func_ir, operands[1]) if operands else 0
            if not isinstance(exponent, int) or exponent < 0:
                self._operands[statement] = operands
        return bool(self._operands)

    def apply(self) -> Any:
        """Return the block with calls of `power`."""
        block = self._block.copy()
        block.clear()
        for statement in self._block.body:
            if statement in self._operands:
                loc, target = statement.loc, statement.target
                name = block.scope.redefine("$power", loc=loc)
                called = ir.Global("power", power, loc)
                call = ir.Expr.call(name, self._operands[statement], (), loc)
                self._definitions[name.name] = [called]
                values = self._definitions[target.name]
                values[values.index(statement.value)] = call
                block.append(ir.Assign(called, name, loc))
                statement = ir.Assign(call, target, loc)
            block.append(statement)
        return block


def _operands(func_ir: Any, value: Any) -> list[Any] | None:
    """Return base and exponent of a power, or None."""
    if not isinstance(value, ir.Expr):
        return None
    if value.op in ("binop", "inplace_binop"):
        return [value.lhs, value.rhs] if value.fn in POWERS else None
    if value.op != "call" or value.kws or len(value.args) != 2:
        return None
    called = guard(func_ir.get_definition, value.func)
    return list(value.args) if isinstance(called, ir.Global) and called.value is pow else None
