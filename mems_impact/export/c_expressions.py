"""Translation of Python expressions to C."""

from __future__ import annotations

import ast
import builtins
import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import IntEnum
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import Any, NoReturn, Protocol

import numpy as np

from mems_impact.errors import FunctionError
from mems_impact.export.c_functions import (
    BINARY,
    CASTS,
    CHECKED,
    COMPARISONS,
    INTEGER_FUNCTIONS,
    LARGEST_POWER,
    OF_TWO,
    REAL_FUNCTIONS,
    SIGNS,
    TESTS,
    UNARY,
)
from mems_impact.export.c_kinds import (
    BOOLEAN,
    INTEGER,
    NOTHING,
    RANKS,
    REAL,
    Array,
    Expression,
    Fixed,
    Kind,
    Structure,
    Tuple,
    constant,
    identifier,
    literal,
)
from mems_impact.export.function_text import source_of
from mems_impact.integrators import library

Handler = Callable[["ExpressionWriter", Sequence[Expression]], Expression]


@dataclass
class CFunction:
    """A translated function: its name, the kind of its result, its text and its calls."""

    name: str
    result: Any
    text: str = ""
    calls: list[CFunction] = field(default_factory=list)
    signature: str = ""


class TranslatedFunctions(Protocol):
    """Functions translated so far, their tables, and functions with C expressions of their own."""

    handlers: dict[Any, Handler]
    generated: dict[Any, str]

    def translate(self, function: Any, kinds: Sequence[Kind]) -> CFunction:
        """Translate a function, once."""

    def table(self, values: Any) -> str:
        """Return the name of a constant table of reals."""

    def name(self, stem: str) -> str:
        """Return an unused name."""


@dataclass(frozen=True)
class Iterable:
    """A sequence: its length if known, its length as code, and its items by index."""

    length: int | None
    count: str
    item: Callable[[str, int | None], Expression]
    unrolled: bool = False


class ExpressionWriter:
    """Translates expressions of one function for arguments of given kinds."""

    def __init__(self, source: TranslatedFunctions, function: Any, kinds: Sequence[Kind]) -> None:
        if not isinstance(function, FunctionType):
            raise FunctionError(
                f"{function!r}", "cannot be translated to C", "give a plain Python function"
            )
        self.source, self.function, self.kinds = source, function, tuple(kinds)
        self.text = source_of(function, source.generated)
        self.node: ast.AST = self.text.tree
        self.variables: dict[str, Any] = {}
        self.result: Any = None
        # Integers of the package are small.
        module = function.__module__ or ""
        self.checks = module.partition(".")[0] != "mems_impact" or module == library.__name__
        self.closure = inspect.getclosurevars(function).nonlocals if function.__closure__ else {}

    def begin(self) -> None:
        """Forget the text, but not the kinds of variables."""
        self.lines: list[str] = []
        self.depth = 1
        self.temporaries: list[str] = []
        self.calls: list[CFunction] = []
        self.tuples: list[Any] = []
        self.loops: list[tuple[str, str]] = []
        self.labels = 0
        self.overlay: dict[str, Any] = {}

    # --- Errors, lines and names

    def refuse(self, problem: str, remedy: str, node: ast.AST | None = None) -> NoReturn:
        """Raise FunctionError for something without a translation."""
        line = getattr(node or self.node, "lineno", 1)
        raise FunctionError(
            f"function {self.function.__name__!r}",
            f"cannot be translated to C: {problem}",
            remedy,
            self.text.file,
            line if self.text.file else 0,
        )

    def emit(self, line: str) -> None:
        self.lines.append("    " * self.depth + line)

    def note(self, kind: Any) -> None:
        """Keep the kind of a tuple, whose structure has to be declared."""
        if isinstance(kind, Tuple) and kind not in self.tuples:
            for item in kind.items:
                self.note(item)
            self.tuples.append(kind)

    def label(self) -> str:
        self.labels += 1
        return f"l{self.labels}"

    def temporary(self, expression: Expression) -> Expression:
        """Return the value of an expression in a variable."""
        if expression.fixed or expression.kind == NOTHING:
            return expression
        if expression.items is not None:
            items = tuple(self.temporary(item) for item in expression.items)
            return replace(expression, items=items)
        if expression.code.isidentifier() and not expression.code.startswith("v_"):
            return expression
        name = f"t{len(self.temporaries)}"
        self.note(expression.kind)
        start = "{0}" if isinstance(expression.kind, Tuple) else "0"
        self.temporaries.append(f"{expression.kind.ctype} {name} = {start};")
        self.emit(f"{name} = {expression.code};")
        return Expression(expression.kind, name)

    def lookup(self, name: str) -> Expression:
        """Return the value of a name."""
        if name in self.overlay:
            return self.overlay[name]
        if name in self.variables:
            kind = self.variables[name]
            return Expression(kind, "" if isinstance(kind, Fixed) else f"v_{identifier(name)}")
        if name in self.closure:
            return constant(self.closure[name])
        if name in self.function.__code__.co_freevars:
            cells = dict(
                zip(
                    self.function.__code__.co_freevars, self.function.__closure__ or (), strict=True
                )
            )
            return constant(cells[name].cell_contents)
        if name in self.function.__globals__:
            return constant(self.function.__globals__[name])
        if hasattr(builtins, name):
            return constant(getattr(builtins, name))
        self.refuse(f"{name!r} has no value here", "assign it before")

    # --- Kinds

    def runtime(self, expression: Expression) -> Expression:
        """Return a constant as a C expression."""
        if not expression.fixed:
            return expression
        value = expression.kind.value
        if isinstance(value, bool | np.bool_):
            return Expression(BOOLEAN, literal(value))
        if isinstance(value, int | np.integer) and abs(int(value)) < 2**63:
            return Expression(INTEGER, literal(value))
        if isinstance(value, int | float | np.integer | np.floating):  # also beyond int64_t
            return Expression(REAL, literal(value))
        if isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
            if value.ndim == 0:
                return self.runtime(constant(value.item()))
            return Expression(Array(value.shape), f"((double *)({self.source.table(value)}))")
        if isinstance(value, tuple | list):
            items = tuple(self.runtime(constant(each)) for each in value)
            names = tuple(getattr(value, "_fields", ()))
            return Expression(Tuple(tuple(item.kind for item in items), names), "", items)
        return expression

    def number(self, expression: Expression, role: str) -> Expression:
        """Return a scalar expression, or raise FunctionError."""
        runtime_value = self.runtime(expression)
        if runtime_value.kind not in RANKS:
            kind_text = "an array" if isinstance(runtime_value.kind, Array) else "no number"
            self.refuse(f"{role} of {kind_text}", "use numbers; write a loop over an array")
        return runtime_value

    def joined(self, a: Any, b: Any) -> Any:
        """Return the least kind that holds the values of two kinds."""
        if a is None or a == b:
            return b
        if isinstance(a, Fixed) or isinstance(b, Fixed):
            first, second = (self.runtime(Expression(kind)).kind for kind in (a, b))
            if isinstance(first, Fixed) or isinstance(second, Fixed):
                self.refuse("a variable or result with several constants", "use numbers")
            return self.joined(first, second)
        if a in RANKS and b in RANKS:
            return max(a, b, key=RANKS.__getitem__)
        if isinstance(a, Array) and isinstance(b, Array):
            return a if a.shape == b.shape else Array()
        if isinstance(a, Tuple) and isinstance(b, Tuple) and len(a.items) == len(b.items):
            items = tuple(map(self.joined, a.items, b.items))
            return Tuple(items, a.names if a.names == b.names else a.names or b.names)
        self.refuse("a variable or result of several types", "use one name for each")

    def converted(self, expression: Expression, kind: Any) -> str:
        """Return an expression as C source of a kind that holds it."""
        if isinstance(kind, Fixed):
            return ""
        runtime_value = self.runtime(expression)
        if isinstance(kind, Tuple):
            self.note(kind)
            if runtime_value.items is None and isinstance(runtime_value.kind, Tuple):
                if runtime_value.kind.ctype == kind.ctype:
                    return runtime_value.code
                variable = self.temporary(runtime_value)
                runtime_value = replace(
                    variable, items=tuple(self.item(variable, i) for i in range(len(kind.items)))
                )
            if runtime_value.items is None:
                self.refuse("a number in place of a tuple", "return as many values everywhere")
            items = ", ".join(
                self.converted(item, item_kind)
                for item, item_kind in zip(runtime_value.items, kind.items, strict=True)
                if not isinstance(item_kind, Fixed)
            )
            return f"({kind.ctype}){{{items}}}"
        if runtime_value.fixed:
            self.refuse(f"the value {runtime_value.kind.value!r}", "use numbers")
        if runtime_value.kind == REAL and kind == INTEGER:
            return f"(int64_t)({runtime_value.code})"
        if runtime_value.kind in RANKS and kind not in RANKS:
            self.refuse("a number in place of an array or tuple", "use one name for each")
        return runtime_value.code

    def item(self, expression: Expression, i: int) -> Expression:
        """Return an item of a tuple by its number."""
        if expression.fixed:
            return constant(expression.kind.value[i])
        if expression.items is not None:
            return expression.items[i]
        kind = expression.kind.items[i]
        i = i + len(expression.kind.items) if i < 0 else i
        return Expression(kind, "" if isinstance(kind, Fixed) else f"{expression.code}.f{i}")

    # --- Iteration

    def iterable_of(self, node: ast.expr) -> Iterable:
        """Return the iterable of a loop."""
        if isinstance(node, ast.Call) and not node.keywords:
            callee = self.value(node.func)
            if callee.fixed and callee.kind.value is enumerate and len(node.args) == 1:
                nested = self.iterable_of(node.args[0])

                def numbered_item(code: str, i: int | None) -> Expression:
                    number = Expression(INTEGER, code) if i is None else constant(i)
                    items = number, nested.item(code, i)
                    return Expression(Tuple(tuple(each.kind for each in items)), "", items)

                return replace(nested, item=numbered_item)
            if callee.fixed and callee.kind.value is zip:
                iterables = [self.iterable_of(each) for each in node.args]
                lengths = [part.length for part in iterables]
                if any(length is None for length in lengths):
                    self.refuse("zip of arrays of unknown length", "write a loop over an index")

                def zipped_item(code: str, i: int | None) -> Expression:
                    items = tuple(part.item(code, i) for part in iterables)
                    return Expression(Tuple(tuple(each.kind for each in items)), "", items)

                length = min(each for each in lengths if each is not None)
                return Iterable(
                    length, str(length), zipped_item, any(part.unrolled for part in iterables)
                )
            if callee.fixed and callee.kind.value is range and len(node.args) == 1:
                stop = self.value(node.args[0])
                end = int(stop.kind.value) if stop.fixed else None
                count = self.temporary(self.number(stop, "a range")).code
                return Iterable(
                    end,
                    count,
                    lambda code, i: Expression(INTEGER, code) if i is None else constant(i),
                )
        return self.iterable(self.value(node))

    def iterable(self, value: Expression) -> Iterable:
        """Return a value as something to iterate over."""
        if value.fixed:
            constants = value.kind.value
            if isinstance(constants, np.ndarray):
                return self.iterable(self.runtime(value))
            if not isinstance(constants, tuple | list):
                self.refuse("a loop over this value", "loop over a range, an array or a tuple")
            length = len(constants)
            if length and all(isinstance(each, float | int) for each in constants):
                name = f"((double *)({self.source.table(constants)}))"
                integers = all(isinstance(each, int) for each in constants)
                kind = INTEGER if integers else REAL

                def table_item(code: str, i: int | None) -> Expression:
                    if i is not None:
                        return constant(constants[i])
                    cast = "(int64_t)" if integers else ""
                    return Expression(kind, f"({cast}{name}[{code}])")

                return Iterable(length, str(length), table_item)
            return Iterable(length, str(length), lambda code, i: constant(constants[i or 0]), True)
        if value.items is not None or isinstance(value.kind, Tuple):
            variable = self.temporary(value)
            items = tuple(self.item(variable, i) for i in range(len(value.kind.items)))
            return Iterable(len(items), str(len(items)), lambda code, i: items[i or 0], True)
        if isinstance(value.kind, Array) and value.kind.length is not None:
            variable = self.temporary(value)
            length = value.kind.length
            return Iterable(length, str(length), lambda code, i: self.element(variable, code))
        self.refuse("a loop over this value", "loop over a range, an array or a tuple")

    # --- Tests

    def truth(self, node: ast.expr) -> tuple[bool | None, str]:
        """Return the value of a test if it is known, and its code."""
        if isinstance(node, ast.BoolOp):
            is_and = isinstance(node.op, ast.And)
            mark, codes = " && " if is_and else " || ", list[str]()
            for each in node.values:
                before = len(self.lines)
                outcome, code = self.truth(each)
                if outcome is None:
                    if codes and len(self.lines) > before:
                        codes = [self.guarded(mark.join(codes), is_and, before, code)]
                    else:
                        codes.append(code)
                elif outcome is not is_and:
                    # A later operand decides only if no earlier one has side effects: none has.
                    return outcome, literal(outcome)
            if not codes:
                return is_and, literal(is_and)
            return None, f"({mark.join(codes)})"
        if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not):
            outcome, code = self.truth(node.operand)
            return (None if outcome is None else not outcome), f"!({code})"
        value = self.value(node)
        if value.fixed:
            outcome = bool(value.kind.value)
            return outcome, literal(outcome)
        if isinstance(value.kind, Tuple):
            return bool(value.kind.items), literal(bool(value.kind.items))
        return None, self.number(value, "a condition").code

    def guarded(self, first: str, is_and: bool, begin: int, second: str) -> str:
        """Return a variable with ``first and second``, or with ``first or second``.

        The lines from `begin` on belong to `second`, which may be invalid unless `first` holds.
        """
        inner_lines = ["    " + line for line in self.lines[begin:]]
        del self.lines[begin:]
        variable = self.temporary(Expression(BOOLEAN, f"({first})")).code
        self.emit(f"if ({variable if is_and else f'!{variable}'}) {{")
        self.lines += inner_lines
        self.emit(f"    {variable} = {second};")
        self.emit("}")
        return variable

    # --- Expressions

    def value(self, node: ast.expr) -> Expression:
        """Translate an expression."""
        handler = getattr(self, f"of_{type(node).__name__}", None)
        if handler is None:
            self.refuse(f"the expression {type(node).__name__}", "use plain expressions", node)
        expression: Expression = handler(node)
        return expression

    def of_Constant(self, node: ast.Constant) -> Expression:
        return constant(node.value)

    def of_Name(self, node: ast.Name) -> Expression:
        return self.lookup(node.id)

    def of_Tuple(self, node: ast.Tuple | ast.List) -> Expression:
        items = tuple(self.value(each) for each in node.elts)
        if items and all(item.fixed for item in items):
            return constant(tuple(item.kind.value for item in items))
        return Expression(Tuple(tuple(item.kind for item in items)), "", items)

    of_List = of_Tuple

    def of_Attribute(self, node: ast.Attribute) -> Expression:
        owner, name = self.value(node.value), node.attr
        if owner.fixed:
            try:
                return constant(getattr(owner.kind.value, name))
            except AttributeError:
                self.refuse(f"the attribute {name!r}", "use attributes that exist", node)
        if isinstance(owner.kind, Tuple) and name in owner.kind.names:
            return self.item(owner, owner.kind.names.index(name))
        if isinstance(owner.kind, Structure):
            fields = dict(owner.kind.fields)
            if name in fields:
                return Expression(fields[name], f"{owner.code}->{name}")
        if isinstance(owner.kind, Array) and owner.kind.shape is not None:
            if name == "size":
                return constant(math.prod(owner.kind.shape))
            if name == "shape":
                return constant(owner.kind.shape)
        self.refuse(f"the attribute {name!r}", "use names of states and parameters", node)

    def of_Subscript(self, node: ast.Subscript) -> Expression:
        return self.subscript(node)

    def subscript(self, node: ast.Subscript) -> Expression:
        """Return an element, an item or a slice."""
        owner = self.value(node.value)
        if isinstance(node.slice, ast.Slice):
            return self.cut(owner, node.slice)
        index = self.value(node.slice)
        if owner.fixed and index.fixed:
            try:
                return constant(owner.kind.value[index.kind.value])
            except (IndexError, KeyError, TypeError):
                self.refuse("an index out of range", "use an index that exists", node)
        if owner.fixed:
            constants = owner.kind.value
            if isinstance(constants, tuple | list) and constants:
                try:
                    owner = self.runtime(constant(np.array(constants, dtype=np.float64)))
                except (TypeError, ValueError):
                    self.refuse("a variable index of this constant", "use a constant index", node)
                if all(isinstance(each, int) for each in constants):
                    element = self.element(owner, self.number(index, "an index").code)
                    return Expression(INTEGER, f"((int64_t){element.code})")
            else:
                owner = self.runtime(owner)
        if isinstance(owner.kind, Tuple):
            if index.fixed:
                return self.item(owner, self.within(index.kind.value, len(owner.kind.items), node))
            kinds = set(owner.kind.items)
            if len(kinds) > 1:
                self.refuse("a variable index of a tuple of several types", "use an array", node)
            tuple_code = self.converted(owner, owner.kind)
            (kind,) = kinds
            code = f"{owner.kind.ctype}_at({tuple_code}, {self.number(index, 'an index').code})"
            return Expression(kind, code)
        if not isinstance(owner.kind, Array):
            self.refuse("an index of this value", "index arrays and tuples", node)
        shape = owner.kind.shape
        if index.items is not None or (index.fixed and isinstance(index.kind.value, tuple)):
            count = len(index.items) if index.items is not None else len(index.kind.value)
            for i in range(count):
                owner = self.element(owner, self.index(self.item(index, i), owner, node))
            return owner
        if shape is not None and index.fixed:
            self.within(index.kind.value, shape[0], node)
        return self.element(owner, self.index(index, owner, node))

    def within(self, index: Any, length: int, node: ast.AST) -> int:
        """Return a constant index, checked."""
        if not -length <= int(index) < length:
            self.refuse(f"the index {index} of {length} elements", "use an index that exists", node)
        return int(index)

    def index(self, index: Expression, owner: Expression, node: ast.AST) -> str:
        """Return the code of an index; a negative one counts from the end."""
        length = owner.kind.length
        if index.fixed:
            number = int(index.kind.value)
            if number < 0 and length is None:
                self.refuse("a negative index of unknown length", "use an index from zero", node)
            return str(number + length if number < 0 and length is not None else number)
        index_number = self.number(index, "an index")
        if index_number.kind == REAL:
            self.refuse("an index that is no integer", "use int()", node)
        code = index_number.code
        if length is not None and not code.startswith("il") and owner.kind.shape is not None:
            return f"wrapped({code}, {length})"
        return code

    def element(self, owner: Expression, index: str) -> Expression:
        """Return an element of an array, or a row of a table."""
        shape = owner.kind.shape
        if shape is None or len(shape) == 1:
            return Expression(REAL, f"{owner.code}[{index}]")
        row = math.prod(shape[1:])
        return Expression(Array(shape[1:]), f"({owner.code} + {row} * ({index}))")

    def cut(self, owner: Expression, node: ast.Slice) -> Expression:
        """Return a slice."""
        bounds = [None if each is None else self.value(each) for each in (node.lower, node.upper)]
        if node.step is not None:
            self.refuse("a slice with a step", "write a loop", node)
        is_fixed = all(bound is None or bound.fixed for bound in bounds)
        first, last = (
            None if bound is None or not is_fixed else bound.kind.value for bound in bounds
        )
        if owner.fixed:
            if not is_fixed:
                owner = self.runtime(constant(np.array(owner.kind.value, dtype=float)))
            else:
                return constant(owner.kind.value[first:last])
        if isinstance(owner.kind, Tuple) and is_fixed:
            indices = range(len(owner.kind.items))[first:last]
            variable = owner if owner.items is not None else self.temporary(owner)
            items = tuple(self.item(variable, i) for i in indices)
            return Expression(Tuple(tuple(item.kind for item in items)), "", items)
        if not isinstance(owner.kind, Array) or (owner.kind.shape and len(owner.kind.shape) > 1):
            self.refuse("a slice of this value", "slice arrays of one dimension", node)
        length = owner.kind.length
        if is_fixed and length is not None:
            indices = range(length)[first:last]
            return Expression(Array((len(indices),)), f"({owner.code} + {indices.start})")
        if bounds[0] is None:
            return Expression(Array(), owner.code)
        begin = self.number(bounds[0], "a slice").code
        if bounds[0].fixed and bounds[0].kind.value < 0:
            self.refuse("a negative index of unknown length", "use an index from zero", node)
        return Expression(Array(), f"({owner.code} + {begin})")

    def of_UnaryOp(self, node: ast.UnaryOp) -> Expression:
        if isinstance(node.op, ast.Not):
            outcome, code = self.truth(node)
            return Expression(BOOLEAN, code) if outcome is None else constant(outcome)
        operand = self.value(node.operand)
        if operand.fixed and is_number(operand.kind.value):
            return constant(UNARY[type(node.op)](operand.kind.value))
        number = self.number(operand, "a sign")
        if self.checks and isinstance(node.op, ast.USub) and number.kind != REAL:
            return Expression(INTEGER, f"difference_i(0, {number.code})")
        kind = INTEGER if number.kind == BOOLEAN else number.kind
        mark = {ast.USub: "-", ast.UAdd: "+", ast.Invert: "~"}[type(node.op)]
        return Expression(kind, f"({mark}{number.code})")

    def of_BinOp(self, node: ast.BinOp) -> Expression:
        return self.binary(node.op, self.value(node.left), self.value(node.right), node)

    def binary(
        self, sign: ast.operator, left: Expression, right: Expression, node: ast.AST
    ) -> Expression:
        """Return the result of an operator."""
        kind = type(sign)
        if left.fixed and right.fixed:
            try:
                return constant(BINARY[kind](left.kind.value, right.kind.value))
            except (ArithmeticError, KeyError, TypeError):
                pass
        is_sum = kind is ast.Add
        if is_sum and all(isinstance(self.runtime(each).kind, Tuple) for each in (left, right)):
            operands = [self.runtime(each) for each in (left, right)]
            items = tuple(
                self.item(part, i) for part in operands for i in range(len(part.kind.items))
            )
            return Expression(Tuple(tuple(item.kind for item in items)), "", items)
        role = f"the operator {kind.__name__}"
        a, b = self.number(left, role), self.number(right, role)
        result = max(a.kind, b.kind, INTEGER, key=RANKS.__getitem__)
        if kind is ast.Div:
            return Expression(
                REAL, f"((double){self.exact(a).code} / (double){self.exact(b).code})"
            )
        if kind is ast.Pow:
            return self.power(a, b, right, result)
        if kind in (ast.FloorDiv, ast.Mod):
            name = "floor_divide" if kind is ast.FloorDiv else "floor_modulo"
            suffix = "_i" if result == INTEGER else ""
            return Expression(result, f"{name}{suffix}({a.code}, {b.code})")
        if kind not in SIGNS:
            self.refuse(role, "use arithmetic of numbers", node)
        if result == INTEGER and self.checks and kind in CHECKED:
            return Expression(INTEGER, f"{CHECKED[kind]}({a.code}, {b.code})")
        if result == INTEGER:
            codes = [f"(int64_t){each.code}" for each in (a, b)]
        else:
            codes = [a.code, b.code]
        if result == REAL and SIGNS[kind] not in "+-*":
            self.refuse(f"{role} of real numbers", "use integers", node)
        if kind in (ast.BitAnd, ast.BitOr, ast.BitXor) and a.kind == b.kind == BOOLEAN:
            result = BOOLEAN
        return Expression(result, f"({codes[0]} {SIGNS[kind]} {codes[1]})")

    def power(
        self, base: Expression, exponent: Expression, original: Expression, result: Any
    ) -> Expression:
        """Return a power; one with a small integer exponent is multiplied out."""
        if original.fixed and isinstance(original.kind.value, int):
            n = original.kind.value
            if 0 <= n <= LARGEST_POWER:
                suffix = "_i" if result == INTEGER else ""
                return Expression(result, f"integer_power{suffix}({base.code}, {n})")
            return Expression(
                REAL,
                f"(1.0 / integer_power({base.code}, {-n}))"
                if n < 0
                else f"pow({base.code}, {exponent.code})",
            )
        if result == INTEGER:
            self.refuse(
                "a power of integers with a variable exponent",
                "make the base a real number, such as 10.0: the power may be no integer",
            )
        return Expression(REAL, f"pow({base.code}, {exponent.code})")

    def of_BoolOp(self, node: ast.BoolOp) -> Expression:
        lines, temporaries = list(self.lines), list(self.temporaries)
        operands = [self.value(each) for each in node.values]
        kinds = {self.runtime(part).kind for part in operands}
        if kinds <= {BOOLEAN} or all(part.fixed for part in operands):
            self.lines, self.temporaries = lines, temporaries
            outcome, code = self.truth(node)
            return Expression(BOOLEAN, code) if outcome is None else constant(outcome)
        if len(self.lines) > len(lines):
            self.refuse("the value of and or or", "use if and else", node)
        is_and = isinstance(node.op, ast.And)
        result = operands[-1]
        for part in reversed(operands[:-1]):
            if part.fixed:
                result = result if bool(part.kind.value) is is_and else part
                continue
            if not part.code.isidentifier():
                self.refuse("the value of and or or", "use if and else", node)
            kind = self.joined(part.kind, self.runtime(result).kind)
            pair = (result, part) if is_and else (part, result)
            a, b = (self.converted(each, kind) for each in pair)
            result = Expression(kind, f"({part.code} ? {a} : {b})")
        return result

    def of_IfExp(self, node: ast.IfExp) -> Expression:
        outcome, code = self.truth(node.test)
        if outcome is not None:
            return self.value(node.body if outcome else node.orelse)
        line_count = len(self.lines)
        a, b = self.value(node.body), self.value(node.orelse)
        if a.fixed and b.fixed and a.kind == b.kind:
            return a
        kinds = [self.literal_kind(each) for each in (a, b)]
        kind = self.joined(*kinds)
        codes = [self.converted(each, kind) for each in (a, b)]
        if len(self.lines) != line_count:
            self.refuse("this value of if and else", "use statements if and else", node)
        return Expression(kind, f"({code} ? {codes[0]} : {codes[1]})")

    def literal_kind(self, expression: Expression) -> Any:
        """Return the kind of a value at run time."""
        runtime_value = self.runtime(expression)
        if runtime_value.items is not None:
            return Tuple(
                tuple(self.literal_kind(item) for item in runtime_value.items),
                runtime_value.kind.names,
            )
        return runtime_value.kind

    def of_Compare(self, node: ast.Compare) -> Expression:
        operands = [self.value(each) for each in (node.left, *node.comparators)]
        middle = operands[1:-1]
        for i, each in enumerate(middle, 1):
            if not each.fixed and "(" in each.code:
                operands[i] = self.temporary(each)
        codes: list[str] = []
        for sign, a, b in zip(node.ops, operands, operands[1:], strict=False):
            comparison = self.comparison(sign, a, b, node)
            if comparison.fixed:
                if not comparison.kind.value:
                    return constant(False)
                continue
            codes.append(comparison.code)
        if not codes:
            return constant(True)
        return Expression(BOOLEAN, codes[0] if len(codes) == 1 else f"({' && '.join(codes)})")

    def comparison(
        self, sign: ast.cmpop, a: Expression, b: Expression, node: ast.AST
    ) -> Expression:
        """Return a comparison of two values."""
        if isinstance(sign, ast.Is | ast.IsNot):
            numbers = [self.runtime(each).kind in RANKS for each in (a, b)]
            if all(numbers) and not (a.fixed and b.fixed):
                self.refuse("is between numbers", "compare them by ==", node)
            is_same = a.fixed and b.fixed and a.kind.value is b.kind.value
            return constant(is_same is isinstance(sign, ast.Is))
        if isinstance(sign, ast.In | ast.NotIn):
            if b.fixed:
                choices = [constant(each) for each in b.kind.value]
            elif isinstance(b.kind, Tuple):
                choices = [self.item(b, i) for i in range(len(b.kind.items))]
            else:
                self.refuse("in of this value", "use a tuple of numbers", node)
            if a.fixed and b.fixed:
                is_member = a.kind.value in b.kind.value
                return constant(is_member is isinstance(sign, ast.In))
            member = a if a.fixed or "(" not in a.code else self.temporary(a)
            tests = [self.comparison(ast.Eq(), member, each, node) for each in choices]
            code = " || ".join(self.runtime(test).code for test in tests) or "false"
            return Expression(BOOLEAN, f"({'!' if isinstance(sign, ast.NotIn) else ''}({code}))")
        compare, mark = COMPARISONS[type(sign)]
        if a.fixed and b.fixed:
            return constant(bool(compare(a.kind.value, b.kind.value)))
        left, right = self.number(a, "a comparison"), self.number(b, "a comparison")
        if REAL in (left.kind, right.kind):
            left, right = self.exact(left), self.exact(right)
        return Expression(BOOLEAN, f"({left.code} {mark} {right.code})")

    # --- Calls

    def of_Call(self, node: ast.Call) -> Expression:
        callee = self.value(node.func)
        if any(isinstance(each, ast.Starred) for each in node.args):
            arguments = []
            for each in node.args:
                if isinstance(each, ast.Starred):
                    sequence = self.iterable(self.value(each.value))
                    assert sequence.length is not None
                    arguments += [sequence.item(str(i), i) for i in range(sequence.length)]
                else:
                    arguments.append(self.value(each))
        else:
            arguments = [self.value(each) for each in node.args]
        if any(each.arg is None for each in node.keywords):
            self.refuse("arguments by **", "name all arguments", node)
        keywords = {str(each.arg): self.value(each.value) for each in node.keywords}
        if not callee.fixed:
            self.refuse("a call of a variable", "call a function by its name", node)
        return self.call(callee.kind.value, arguments, keywords, node)

    def call(
        self,
        function: Any,
        arguments: Sequence[Expression],
        keywords: Mapping[str, Expression],
        node: ast.AST,
    ) -> Expression:
        """Return a call of a function."""
        if isinstance(function, MethodType):
            return self.call(
                function.__func__, [constant(function.__self__), *arguments], keywords, node
            )
        function = getattr(function, "py_func", function)
        handler = self.source.handlers.get(function) if _hashable(function) else None
        if handler is not None:
            return handler(self, arguments)
        result = self.library(function, arguments, keywords, node)
        if result is not None:
            return result
        if isinstance(function, type) and issubclass(function, tuple):
            names: tuple[str, ...] | None = getattr(function, "_fields", None)
            if names is not None:
                defaults = {
                    name: constant(value)
                    for name, value in getattr(function, "_field_defaults", {}).items()
                }
                values = {**defaults, **dict(zip(names, arguments, strict=False)), **keywords}
                if set(values) != set(names):
                    self.refuse(f"{function.__name__} without all its items", "give each", node)
                items = tuple(values[name] for name in names)
                kinds = tuple(item.kind for item in items)
                return Expression(Tuple(kinds, names), "", items)
            if len(arguments) == 1:
                iterable = self.iterable(arguments[0])
                assert iterable.length is not None
                items = tuple(iterable.item(str(i), i) for i in range(iterable.length))
                return Expression(Tuple(tuple(item.kind for item in items)), "", items)
        if not isinstance(function, FunctionType):
            function_name = getattr(function, "__qualname__", repr(function))
            module = getattr(function, "__module__", "") or ""
            title = f"{module}.{function_name}" if module not in ("", "builtins") else function_name
            self.refuse(f"the function {title}", "use math, and functions of your own", node)
        return self.user_call(function, arguments, keywords, node)

    def user_call(
        self,
        function: FunctionType,
        arguments: Sequence[Expression],
        keywords: Mapping[str, Expression],
        node: ast.AST,
    ) -> Expression:
        """Return a call of a Python function, which is translated too."""
        code = function.__code__
        names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        values_by_name = dict(zip(names, arguments, strict=False))
        values_by_name.update(keywords)
        values = function.__defaults__ or ()
        positional = code.co_varnames[: code.co_argcount]
        defaults = dict(zip(positional[len(positional) - len(values) :], values, strict=True))
        for name, value in {**defaults, **(function.__kwdefaults__ or {})}.items():
            values_by_name.setdefault(name, constant(value))
        if set(values_by_name) != set(names) or len(arguments) > len(positional):
            self.refuse(f"a call of {function.__name__!r}", "give each of its arguments", node)
        expressions = []
        for name in names:
            each = values_by_name[name]
            if each.fixed and is_number(each.kind.value):
                each = self.runtime(each)
            if each.items is not None:
                kind = self.literal_kind(each)
                each = Expression(kind, self.converted(each, kind))
            elif each.fixed and isinstance(each.kind.value, np.ndarray):
                each = self.runtime(each)
            expressions.append(each)
        translated = self.source.translate(function, [each.kind for each in expressions])
        if translated not in self.calls:
            self.calls.append(translated)
        for each in expressions:
            self.note(each.kind)
        self.note(translated.result)
        text = ", ".join(each.code for each in expressions if not each.fixed)
        return Expression(translated.result, f"{translated.name}({text})")

    def library(
        self,
        function: Any,
        arguments: Sequence[Expression],
        keywords: Mapping[str, Expression],
        node: ast.AST,
    ) -> Expression | None:
        """Return a call of a function of Python, math or numpy; None for any other."""
        if not _hashable(function):
            return None
        tables = (
            *(REAL_FUNCTIONS, INTEGER_FUNCTIONS, TESTS, CASTS),
            *((abs, min, max, len, sum, pow, math.log, divmod),),
        )
        is_pure = any(function in each for each in tables)
        if is_pure and not keywords and arguments and all(each.fixed for each in arguments):
            try:
                return constant(function(*(each.kind.value for each in arguments)))
            except (ArithmeticError, TypeError, ValueError):
                pass
        if keywords and is_pure:
            self.refuse("arguments by name", "give them by position", node)
        name = REAL_FUNCTIONS.get(function, "")
        count = 2 if name in OF_TWO else 1
        if name and (len(arguments) == count or function not in library.FUNCTIONS):
            if len(arguments) != count:
                self.refuse(f"{function.__name__} of {len(arguments)} numbers", f"give {count}")
            codes = ", ".join(self.number(each, "a function").code for each in arguments)
            if function is np.abs and self.number(arguments[0], "a function").kind != REAL:
                return Expression(INTEGER, f"integer_abs({codes})")
            return Expression(REAL, f"{name}({codes})")
        if function in INTEGER_FUNCTIONS and len(arguments) == 1:
            code = self.number(arguments[0], "a function").code
            return Expression(INTEGER, self.integer(f"{INTEGER_FUNCTIONS[function]}({code})"))
        if function in TESTS:
            result = self.number(arguments[0], "a test")
            return Expression(BOOLEAN, f"({TESTS[function]}((double){result.code}) != 0)")
        if function in CASTS and len(arguments) == 1:
            result = self.number(arguments[0], "a conversion")
            if result.kind == CASTS[function]:
                return result
            if CASTS[function] == INTEGER and result.kind == REAL:
                return Expression(INTEGER, self.integer(result.code))
            if function in (bool, np.bool_):
                return Expression(BOOLEAN, f"({result.code} != 0)")
            return Expression(CASTS[function], f"(({CASTS[function].ctype}){result.code})")
        if function is abs and len(arguments) == 1:
            result = self.number(arguments[0], "abs")
            name = "fabs" if result.kind == REAL else "integer_abs"
            return Expression(REAL if result.kind == REAL else INTEGER, f"{name}({result.code})")
        if function in (min, max):
            return self.extreme(function, arguments, node)
        if function is math.log and len(arguments) == 1:
            return Expression(REAL, f"log({self.number(arguments[0], 'log').code})")
        if function is pow and len(arguments) == 2:
            return self.binary(ast.Pow(), arguments[0], arguments[1], node)
        if function is len:
            kind = arguments[0].kind
            length = len(kind.items) if isinstance(kind, Tuple) else getattr(kind, "length", None)
            if length is None:
                self.refuse("len of an array of unknown length", "give the length", node)
            return constant(length)
        if function in (sum, np.sum) and len(arguments) == 1:
            iterable = self.iterable(arguments[0])
            assert iterable.length is not None
            total: Expression = constant(0)
            for i in range(iterable.length):
                total = self.binary(ast.Add(), total, iterable.item(str(i), i), node)
            return total
        if function in (np.array, np.zeros, np.empty, np.ones):
            types = [*arguments[1:], *keywords.values()]
            if len(arguments) != 1 or set(keywords) - {"dtype"} or len(types) > 1:
                self.refuse(f"these arguments of {function.__name__}", "give the first", node)
            if any(each.kind not in (Fixed(float), Fixed(np.float64)) for each in types):
                self.refuse("an array of a type", "make arrays of real numbers", node)
            if function is not np.array:
                return self.new_array(function, arguments[0], node)
            iterable = self.iterable(arguments[0])
            assert iterable.length is not None
            items = [
                self.number(iterable.item(str(i), i), "an array") for i in range(iterable.length)
            ]
            if not types and items and all(item.kind != REAL for item in items):
                self.refuse("an array of integers", "make arrays of real numbers: 1.0", node)
            result = self.new_array(np.empty, constant(iterable.length), node)
            for i, item in enumerate(items):
                self.emit(f"{result.code}[{i}] = {item.code};")
            return result
        other = library.FUNCTIONS.get(function)
        return None if other is None else self.call(other, arguments, keywords, node)

    def exact(self, expression: Expression) -> Expression:
        """Return an integer as a real number."""
        if not self.checks or expression.kind != INTEGER:
            return expression
        return Expression(REAL, f"exact_real({expression.code})")

    def integer(self, code: str) -> str:
        """Return the integer of a real number."""
        return f"integer_of({code})" if self.checks else f"((int64_t){code})"

    def new_array(self, function: Any, length: Expression, node: ast.AST) -> Expression:
        """Return a new local array of constant length."""
        if not length.fixed or not isinstance(length.kind.value, int) or length.kind.value < 1:
            self.refuse("an array of variable length", "use a constant length", node)
        n = length.kind.value
        name = f"t{len(self.temporaries)}"
        self.temporaries.append(f"double {name}[{n}];")
        start = "1.0" if function is np.ones else "0.0"
        index = f"i{self.label()}"
        self.emit(f"for (int64_t {index} = 0; {index} < {n}; {index}++) {name}[{index}] = {start};")
        return Expression(Array((n,)), name)

    def extreme(self, function: Any, arguments: Sequence[Expression], node: ast.AST) -> Expression:
        """Return min or max."""
        if len(arguments) == 1:
            iterable = self.iterable(arguments[0])
            assert iterable.length is not None
            arguments = [iterable.item(str(i), i) for i in range(iterable.length)]
        parts = [self.number(each, function.__name__) for each in arguments]
        kind = parts[0].kind
        for part in parts[1:]:
            kind = self.joined(kind, part.kind)
        name = "least" if function is min else "most"
        suffix = "" if kind == REAL else "_i"
        code = parts[0].code
        for part in parts[1:]:
            code = f"{name}{suffix}({code}, {part.code})"
        return Expression(INTEGER if suffix else REAL, code)


def has_array(kind: Any) -> bool:
    """Return whether a value of this kind contains an array."""
    if isinstance(kind, Tuple):
        return any(map(has_array, kind.items))
    return isinstance(kind, Array)


def is_number(value: Any) -> bool:
    """Return whether a value is a number, logical values included."""
    return isinstance(value, bool | int | float | np.number | np.bool_ | IntEnum)


def _hashable(value: Any) -> bool:
    return isinstance(value, FunctionType | BuiltinFunctionType | type | np.ufunc | ModuleType) or (
        callable(value) and getattr(type(value), "__hash__", None) is not None
    )
