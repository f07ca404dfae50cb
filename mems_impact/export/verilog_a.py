"""Verilog-A statements that compute what Python functions of numbers and arrays return.

The functions are those that numba compiles: plain arithmetic, `math`, conditions, and calls of such
functions, whose statements are inlined. A value is a number, known here, or an expression of the
module, as a syntax tree; an array is an `SymbolicArray` of both.
"""

from __future__ import annotations

import ast
import builtins
import inspect
import math
import operator
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import CodeType, FunctionType
from typing import Any, NoReturn

from mems_impact.errors import FunctionError
from mems_impact.export.function_text import arguments_of, source_of

NAMES = {
    abs: "abs", min: "min", max: "max", math.log: "ln",
    **{getattr(math, name): name
       for name in ("acos", "asin", "atan", "atan2", "atanh", "cos", "cosh", "exp", "hypot", "sin",
                    "sinh", "sqrt", "tan", "tanh")},
}  # fmt: skip
"""Functions of Verilog-A."""

OPERATORS: dict[type[ast.AST], Callable[..., Any]] = {
    ast.Add: operator.add, ast.Sub: operator.sub, ast.Mult: operator.mul, ast.Div: operator.truediv,
    ast.Pow: operator.pow,
    ast.USub: operator.neg, ast.UAdd: operator.pos, ast.Not: operator.not_,
    ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge,
    ast.Eq: operator.eq, ast.NotEq: operator.ne,
}  # fmt: skip
LARGEST_PRODUCT = 4  # power that is written as a product
NEUTRAL = {ast.Add: (0.0, 0.0), ast.Sub: (None, 0.0), ast.Mult: (1.0, 1.0), ast.Div: (None, 1.0)}
"""Numbers at the left and at the right of an operator that may be omitted."""


class SymbolicArray(list[Any]):
    """An array of numbers and expressions; as an argument of Python functions, of numbers alone."""

    def __getitem__(self, index: Any) -> Any:
        item = super().__getitem__(index)
        if isinstance(item, ast.expr):
            raise TypeError("not a number")
        return item

    def item(self, index: int) -> Any:
        """Return a number or an expression."""
        return super().__getitem__(index)


@dataclass(frozen=True)
class Index:
    """A variable with a whole number from 0 to `count` - 1, times a factor, plus an offset."""

    variable: ast.Name
    count: int
    factor: int = 1
    offset: int = 0

    def __add__(self, other: int) -> Index:
        return replace(self, offset=self.offset + other)

    def __mul__(self, other: int) -> Index:
        return replace(self, factor=self.factor * other, offset=self.offset * other)

    __radd__, __rmul__ = __add__, __mul__


def text_of(value: Any) -> str:
    """Return a value as Verilog-A."""
    return ast.unparse(tree_of(value))


def tree_of(value: Any) -> ast.expr:
    """Return a value as a syntax tree."""
    return value if isinstance(value, ast.expr) else ast.Constant(float(value))


class VerilogStatements:
    """Statements that assign to variables, whose names are not among those `taken`.

    `handlers` return the value of a call of functions that are not translated, by their code. If
    not `named`, results of functions without conditions remain expressions.
    """

    def __init__(
        self,
        taken: Iterable[str],
        handlers: Mapping[CodeType, Callable[..., Any]] | None = None,
        *,
        named: bool = True,
    ) -> None:
        self.lines: list[str] = []
        self.variables: list[str] = []
        self.depth = 0  # of conditions
        self.results: dict[Any, Any] = {}  # of calls
        self.taken, self.handlers, self.named = set(taken), dict(handlers or {}), named

    def add(self, *lines: str) -> None:
        """Append lines."""
        self.lines += ["  " * self.depth + line if line else "" for line in lines]

    def enclose(self, head: str, first: int) -> None:
        """Put the lines from `first` on under a condition."""
        lines = self.lines[first:]
        del self.lines[first:]
        if len(lines) == 1 and not lines[0].strip().startswith("if"):  # "else" is of the last "if"
            self.add(f"{head} {lines[0].strip()}")
        else:
            self.add(f"{head} begin")
            self.lines += lines
            self.add("end")

    def variable(self, name: str) -> ast.Name:
        """Return a new variable."""
        unused, count = name, 1
        while unused in self.taken:
            count += 1
            unused = f"{name}_{count}"
        self.taken.add(unused)
        self.variables.append(unused)
        return ast.Name(unused)

    def let(self, name: str, value: Any) -> ast.Name:
        """Append the assignment of a value to a new variable."""
        target = self.variable(name)
        self.add(f"{target.id} = {text_of(value)};")
        return target

    def kept(self, name: str, value: Any) -> Any:
        """Return a value as a number or a variable."""
        known = isinstance(value, ast.Name) or not isinstance(value, ast.expr)
        return value if known or not self.named else self.let(name, value)

    def call(self, function: Any, *arguments: Any) -> Any:
        """Append the statements of a call, and return its value."""
        if not any(isinstance(each, ast.expr) for each in arguments):
            try:
                return function(*arguments)
            except TypeError:  # of an array with expressions
                pass
        if not isinstance(function, FunctionType):
            raise _refusal(function)
        key = (function, *map(_key, arguments))
        if key not in self.results:
            handler = self.handlers.get(function.__code__)
            if handler is None:
                value = _Call(self, function, arguments).value()
            else:
                value = handler(self, function, *arguments)
            self.results[key] = self.kept(function.__name__, value)
        return self.results[key]


def _key(value: Any) -> Any:
    """Return what distinguishes an argument from others."""
    if isinstance(value, list):
        return id(value)
    return text_of(value) if isinstance(value, ast.expr) else value


class _Call:
    """A call of a function, whose statements are appended."""

    def __init__(
        self, statements: VerilogStatements, function: FunctionType, arguments: Sequence[Any]
    ) -> None:
        self.statements, self.function, self.outside = statements, function, statements.depth
        self.tree = source_of(function, {}).tree
        names = inspect.getclosurevars(function)
        self.names = {**vars(builtins), **function.__globals__, **names.nonlocals}
        self.names |= zip(arguments_of(self.tree), arguments, strict=True)
        self.changing: dict[str, ast.Name] = {}  # variables that branches assign to
        self.result: Any = None

    def value(self) -> Any:
        """Return the value of the call."""
        body: Any = self.tree.body
        self.block(body if isinstance(body, list) else [ast.Return(body)])
        return self.result

    def refuse(self, node: ast.AST) -> NoReturn:
        raise _refusal(self.function, f": {type(node).__name__}")

    def block(self, statements: Sequence[ast.stmt]) -> None:
        for i, statement in enumerate(statements):
            following = list(statements[i + 1 :])
            match statement:
                case ast.Return(value=ast.IfExp(test=test, body=body, orelse=orelse)):
                    self.branch(self.expression(test), [ast.Return(body)], [ast.Return(orelse)])
                    return
                case ast.Return(value=ast.expr() as value):
                    self.give(self.expression(value))
                    return
                case ast.Assign(targets=[target], value=ast.IfExp(test=test) as value):
                    choices = ([ast.Assign([target], x)] for x in (value.body, value.orelse))
                    self.branch(self.expression(test), *choices)
                case ast.If(test=test, body=body, orelse=orelse):
                    ends = [
                        each[-1:] and isinstance(each[-1], ast.Return) for each in (body, orelse)
                    ]
                    if any(ends):  # the branch that continues takes the rest
                        body, orelse = (
                            each if end else each + following
                            for each, end in zip((body, orelse), ends, strict=True)
                        )
                    self.branch(self.expression(test), body, orelse)
                    if any(ends):
                        return
                case ast.Assign(targets=[ast.Name(id=name)], value=value):
                    self.store(name, self.expression(value))
                case ast.Assign(targets=[ast.Tuple(elts=targets)], value=value):
                    for target, item in zip(targets, self.expression(value), strict=True):
                        self.store(target.id, item)  # type: ignore[attr-defined]
                case ast.AugAssign(target=ast.Name(id=name), op=op, value=value):
                    self.store(name, self.expression(ast.BinOp(ast.Name(name), op, value)))
                case ast.For(target=ast.Name(id=name), iter=items, body=body):
                    for item in self.expression(items):
                        self.names[name] = item
                        self.block(body)
                case ast.Expr(value=ast.Constant()):  # a docstring
                    pass
                case _:
                    self.refuse(statement)

    def give(self, value: Any) -> None:
        """Return a value from the function."""
        if self.statements.depth > self.outside:
            self.store("return", value, self.function.__name__)
            value = self.names["return"]
        self.result = value

    def store(self, name: str, value: Any, title: str = "") -> None:
        """Assign to a name of the function."""
        code = self.statements
        if code.depth == self.outside:
            self.changing.pop(name, None)
            self.names[name] = code.kept(name, value)
            return
        if name not in self.changing:
            self.changing[name] = code.variable(title or name.partition("#")[0])
        code.add(f"{self.changing[name].id} = {text_of(value)};")
        code.results.clear()  # of the former value
        self.names[name] = self.changing[name]

    def branch(self, test: Any, body: Sequence[ast.stmt], orelse: Sequence[ast.stmt]) -> None:
        """Append a condition, unless its outcome is known."""
        if not isinstance(test, ast.expr):
            self.block(body if test else orelse)
            return
        code = self.statements
        stores = (node for each in (*body, *orelse) for node in ast.walk(each))
        for node in stores:
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                name, before = node.id, self.names.get(node.id)
                if isinstance(before, ast.expr | float) and name not in self.changing:
                    self.names[name] = self.changing[name] = code.let(name, before)
        results, outer = code.results, code.depth == 0
        for head, statements in ((f"if ({text_of(test)})", body), ("else", orelse)):
            if statements:
                first = len(code.lines)
                code.depth += 1
                code.results = dict(results)
                self.block(statements)
                code.depth -= 1
                code.enclose(head, first)
        code.results = results if outer else {}

    def expression(self, node: ast.expr) -> Any:
        """Return the value of an expression."""
        match node:
            case ast.Constant(value=value):
                return value
            case ast.Name(id=name):
                return self.names[name]
            case ast.Attribute(value=owner, attr=name):
                return getattr(self.expression(owner), name)
            case ast.Subscript(value=owner, slice=index):
                return self.item(self.expression(owner), self.expression(index))
            case ast.Call(func=called, args=arguments, keywords=[]):
                return self.call(self.expression(called), *map(self.expression, arguments))
            case ast.IfExp(test=test, body=body, orelse=orelse):
                name = f"value#{id(node)}"
                target = ast.Name(name, ast.Store())
                choices = ([ast.Assign([target], each)] for each in (body, orelse))
                self.branch(self.expression(test), *choices)
                return self.names[name]
            case ast.Tuple(elts=items):
                return tuple(map(self.expression, items))
            case ast.UnaryOp(op=op, operand=operand):
                value = self.expression(operand)
                if not isinstance(value, ast.expr):
                    return OPERATORS[type(op)](value)
                return (
                    ast.Name(f"!({text_of(value)})")
                    if isinstance(op, ast.Not)
                    else (ast.UnaryOp(op, value))
                )
            case ast.BinOp(left=left, op=op, right=right):
                return self.binary(op, self.expression(left), self.expression(right))
            case ast.Compare(left=left, ops=[op], comparators=[right]):
                pair = self.expression(left), self.expression(right)
                if not any(isinstance(each, ast.expr) for each in pair):
                    return OPERATORS[type(op)](*pair)
                return ast.Compare(tree_of(pair[0]), [op], [tree_of(pair[1])])
            case ast.BoolOp(op=op, values=values):
                sign = " && " if isinstance(op, ast.And) else " || "
                return ast.Name(f"({sign.join(text_of(self.expression(each)) for each in values)})")
        self.refuse(node)

    def call(self, function: Any, *arguments: Any) -> Any:
        if function in NAMES and any(isinstance(each, ast.expr) for each in arguments):
            return ast.Call(ast.Name(NAMES[function]), list(map(tree_of, arguments)), [])
        return self.statements.call(function, *arguments)

    def item(self, array: Any, index: Any) -> Any:
        if not isinstance(index, Index):
            return array.item(index) if isinstance(array, SymbolicArray) else array[index]
        code, key = self.statements, (id(array), index)
        if key not in code.results:
            values = [array.item(index.factor * i + index.offset) for i in range(index.count)]
            found = code.results[key] = code.let("item", values[0])
            for i, value in enumerate(values[1:]):
                condition = f"{index.variable.id} > {i + 0.5}"
                code.add(f"if ({condition}) {found.id} = {text_of(value)};")
        return code.results[key]

    def binary(self, op: ast.operator, left: Any, right: Any) -> Any:
        if not isinstance(left, ast.expr) and not isinstance(right, ast.expr):
            return OPERATORS[type(op)](left, right)
        if isinstance(op, ast.Pow):
            return self.power(left, right)
        if type(op) not in NEUTRAL:
            self.refuse(op)
        omitted = NEUTRAL[type(op)]
        if isinstance(op, ast.Mult) and 0.0 in (left, right):
            return 0.0
        if left == omitted[0]:
            return right
        if right == omitted[1]:
            return left
        if isinstance(op, ast.Mult) and left == -1:
            return ast.UnaryOp(ast.USub(), right)
        return ast.BinOp(tree_of(left), op, tree_of(right))

    def power(self, base: Any, exponent: Any) -> Any:
        code = self.statements
        if not isinstance(exponent, ast.expr) and exponent in range(1, LARGEST_PRODUCT + 1):
            factor = code.kept("factor", base)
            product: Any = factor
            for _ in range(int(exponent) - 1):
                product = ast.BinOp(product, ast.Mult(), factor)
            return product
        # Simulators differentiate a power of zero as a quotient by zero.
        base, result = code.kept("base", base), code.let("power", 0.0)
        power = ast.Call(ast.Name("pow"), [tree_of(base), tree_of(exponent)], [])
        code.add(f"if ({text_of(base)} > 0.0) {result.id} = {text_of(power)};")
        return result


def _refusal(function: Any, part: str = "") -> FunctionError:
    name = getattr(function, "__name__", repr(function))
    code = getattr(function, "__code__", None)
    place = (code.co_filename, code.co_firstlineno) if code else ("", 0)
    problem = f"cannot be translated to Verilog-A{part}"
    remedy = "use arithmetic, functions of math and conditions"
    return FunctionError(f"function {name!r}", problem, remedy, *place)
