"""C source of Python functions of numbers and arrays.

The functions are those that numba compiles: they read and write arrays and records element by
element, and call only functions of this kind. Every function is translated once for each
combination of the kinds of its arguments. Globals, closure variables and functions passed as
arguments are constants; conditions on them are decided here.

A kind is a scalar (real, integer, boolean), an array of reals, a tuple, a record, or a constant.
A variable has one kind in a function, the least that holds all its values.
"""

from __future__ import annotations

import ast
import textwrap
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from mems_impact.errors import FunctionError
from mems_impact.export.c_expressions import (
    CFunction,
    ExpressionWriter,
    Handler,
    Iterable,
    has_array,
    is_number,
)
from mems_impact.export.c_kinds import (
    INTEGER,
    NOTHING,
    RANKS,
    REAL,
    Array,
    Expression,
    Fixed,
    Kind,
    Tuple,
    constant,
    identifier,
    literal,
)
from mems_impact.export.function_text import arguments_of

NESTING = 100  # most functions within each other


class CSource:
    """Functions translated to C, with the tables and structures that they use.

    `handlers` return the C expression of a call of a function that is not translated; `generated`
    has the source texts of functions that no file contains, by their code objects.
    """

    def __init__(
        self,
        handlers: Mapping[Any, Handler] | None = None,
        generated: Mapping[Any, str] | None = None,
    ) -> None:
        self.handlers, self.generated = dict(handlers or {}), dict(generated or {})
        self.translated: dict[Any, CFunction] = {}
        self.pending: list[Any] = []
        self.tables: dict[bytes, str] = {}
        self.names: set[str] = set()
        self.roots: list[CFunction] = []

    def function(self, function: Callable[..., Any], kinds: Sequence[Kind]) -> CFunction:
        """Translate a function for arguments of these kinds, and keep it in the source."""
        translated = self.translate(function, kinds)
        self.roots.append(translated)
        return translated

    def translate(self, function: Any, kinds: Sequence[Kind]) -> CFunction:
        """Translate a function, once."""
        function = getattr(function, "py_func", function)
        key = (function, *kinds)
        if key in self.translated:
            return self.translated[key]
        if key in self.pending or len(self.pending) > NESTING:
            raise FunctionError(
                f"function {function.__name__!r}",
                "cannot be translated to C: it is recursive",
                "write it as a loop",
                function.__code__.co_filename,
                function.__code__.co_firstlineno,
            )
        self.pending.append(key)
        try:
            translated = FunctionWriter(self, function, kinds).write()
        finally:
            self.pending.pop()
        self.translated[key] = translated
        return translated

    def name(self, stem: str) -> str:
        """Return an unused name."""
        name = stem = f"f_{identifier(stem)}"
        count = 1
        while name in self.names:
            count += 1
            name = f"{stem}_{count}"
        self.names.add(name)
        return name

    def table(self, values: Any) -> str:
        """Return the name of a constant table of reals."""
        numbers = np.ascontiguousarray(values, dtype=np.float64)
        key = numbers.tobytes()
        return self.tables.setdefault(key, f"table_{len(self.tables)}")

    def text(self) -> str:
        """Return the source: structures, tables, and functions in the order of calls."""
        order: list[CFunction] = []
        for root in self.roots:
            _ordered(root, order)
        body = "\n\n".join(each.text for each in order)
        sections = [self._structures(order)]
        for numbers, name in self.tables.items():
            if name in body:
                values = np.frombuffer(numbers, dtype=np.float64).tolist()
                rows = textwrap.fill(", ".join(map(literal, values)), 96)
                sections.append(
                    f"static const double {name}[{max(1, len(values))}] = {{\n{rows}\n}};"
                )
        return "\n\n".join(part for part in [*sections, body] if part) + "\n"

    def _structures(self, order: Sequence[CFunction]) -> str:
        structures: dict[str, Tuple] = {}

        def visit(kind: Any) -> None:
            if isinstance(kind, Tuple):
                for item in kind.items:
                    visit(item)
                structures.setdefault(kind.ctype, kind)

        for function in order:
            for kind in self.kinds_of.get(function.name, ()):
                visit(kind)
        return "\n\n".join(_structure(kind) for kind in structures.values())

    @property
    def kinds_of(self) -> dict[str, list[Any]]:
        """The kinds of tuples in each function."""
        return {each.name: getattr(each, "tuples", []) for each in self.translated.values()}


def _ordered(function: CFunction, order: list[CFunction]) -> None:
    if function in order:
        return
    for each in function.calls:
        _ordered(each, order)
    order.append(function)


def _structure(kind: Tuple) -> str:
    fields = "".join(
        f" {item.ctype} f{i};" for i, item in enumerate(kind.items) if not isinstance(item, Fixed)
    )
    lines = [f"typedef struct {{{fields} }} {kind.ctype};"]
    if kind.items and all(item == kind.items[0] for item in kind.items):
        item = kind.items[0]
        if not isinstance(item, Fixed):
            cases = " ".join(f"case {i}: return x.f{i};" for i in range(len(kind.items) - 1))
            lines.append(
                f"static inline {item.ctype} {kind.ctype}_at({kind.ctype} x, int64_t i)\n"
                f"{{ switch (i < 0 ? i + {len(kind.items)} : i) {{ {cases} "
                f"default: return x.f{len(kind.items) - 1}; }} }}"
            )
    return "\n".join(lines)


class FunctionWriter(ExpressionWriter):
    """Translates one function for arguments of given kinds."""

    def write(self) -> CFunction:
        """Return the translated function."""
        tree = self.text.tree
        arguments = arguments_of(tree)
        if tree.args.vararg or tree.args.kwarg:
            self.refuse("arguments by * or **", "name all arguments")
        if len(arguments) != len(self.kinds):
            self.refuse(f"a call with {len(self.kinds)} arguments", "give each argument")
        self.arguments = dict(zip(arguments, self.kinds, strict=True))
        self.variables = dict(self.arguments)
        body = (
            [ast.copy_location(ast.Return(tree.body), tree)]
            if isinstance(tree, ast.Lambda)
            else tree.body
        )
        before: Any = None
        while before != (self.variables, self.result):  # it ends, since kinds only become wider
            before = dict(self.variables), self.result
            self.begin()
            self.block(body)
        return self.finish(arguments)

    def finish(self, arguments: Sequence[str]) -> CFunction:
        result = NOTHING if self.result is None else self.result
        if isinstance(result, Fixed):
            ctype = "void"
        else:
            ctype = result.ctype
            self.note(result)
        parameters, copies = [], []
        for name in arguments:
            kind, target = self.arguments[name], self.variables[name]
            if isinstance(kind, Fixed):
                if not isinstance(target, Fixed):
                    value = self.runtime(Expression(kind))
                    copies.append(
                        f"{target.ctype} v_{identifier(name)} = {self.converted(value, target)};"
                    )
                continue
            self.note(kind)
            if target == kind:
                parameters.append(f"{kind.ctype} v_{identifier(name)}")
            else:
                parameters.append(f"{kind.ctype} a_{identifier(name)}")
                value = Expression(kind, f"a_{identifier(name)}")
                copies.append(
                    f"{target.ctype} v_{identifier(name)} = {self.converted(value, target)};"
                )
        for name, kind in self.variables.items():
            if name not in self.arguments and not isinstance(kind, Fixed):
                self.note(kind)
                start = " = {0}" if isinstance(kind, Tuple) else " = 0"
                copies.append(f"{kind.ctype} v_{identifier(name)}{start};")
        translated = CFunction(self.source.name(self.function.__name__), result)
        signature = f"static {ctype} {translated.name}({', '.join(parameters) or 'void'})"
        lines = [*copies, *self.temporaries]
        body = ["    " + line for line in lines] + self.lines
        if ctype != "void":
            body.append(f"    return {_no_value(result)};")
        translated.text = "\n".join([signature, "{", *body, "}"])
        translated.calls = list(self.calls)
        translated.signature = signature
        translated.tuples = self.tuples  # type: ignore[attr-defined]
        return translated

    # --- Statements

    def block(self, statements: Sequence[ast.stmt]) -> bool:
        """Translate statements; return whether the end can be reached."""
        for statement in statements:
            self.node = statement
            name = f"do_{type(statement).__name__}"
            handler = getattr(self, name, None)
            if handler is None:
                self.refuse(f"the statement {type(statement).__name__}", "use plain statements")
            if handler(statement) is False:
                return False
        return True

    def inner(self, statements: Sequence[ast.stmt]) -> bool:
        self.depth += 1
        falls_through = self.block(statements)
        self.depth -= 1
        return falls_through

    def do_Raise(self, node: ast.Raise) -> bool:
        """Translate an exception to a fault, which ends the run."""
        self.emit("(void)faulty();")
        is_void = self.result is None or self.result == NOTHING or isinstance(self.result, Fixed)
        self.emit("return;" if is_void else f"return {_no_value(self.result)};")
        return False

    def do_Pass(self, node: ast.Pass) -> None:
        """Translate nothing."""

    def do_Assert(self, node: ast.Assert) -> None:
        """Omit an assertion, as python -O does."""

    def do_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant):
            return
        value = self.value(node.value)
        if not value.fixed and value.code:
            self.emit(f"{value.code};" if value.kind == NOTHING else f"(void)({value.code});")

    def do_Return(self, node: ast.Return) -> bool:
        value = Expression(NOTHING) if node.value is None else self.value(node.value)
        if value.fixed and value.kind.value is None:
            value = Expression(NOTHING)
        if value.kind == NOTHING:
            if value.code:
                self.emit(f"{value.code};")
            if self.result not in (None, NOTHING):
                self.refuse("results with and without a value", "return as many values everywhere")
            self.result = NOTHING
            self.emit("return;")
            return False
        if self.result == NOTHING:
            self.refuse("results with and without a value", "return as many values everywhere")
        kind = self.runtime(value).kind
        if value.items is not None:
            kind = Tuple(tuple(self.runtime(item).kind for item in value.items), value.kind.names)
        self.result = self.joined(self.result, kind)
        if has_array(self.result):  # it may be a variable of this function
            self.refuse("an array as a result", "return its elements, or write to an argument")
        code = self.converted(value, self.result)
        self.emit(f"return {code};" if code else "return;")
        return False

    def do_Assign(self, node: ast.Assign) -> None:
        value = self.value(node.value)
        if len(node.targets) > 1:
            value = self.temporary(self.runtime(value))
        for target in node.targets:
            self.assign(target, value)

    def do_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.assign(node.target, self.value(node.value))

    def do_AugAssign(self, node: ast.AugAssign) -> None:
        expression: Any = ast.copy_location(
            ast.BinOp(_as_read(node.target), node.op, node.value), node
        )
        self.assign(node.target, self.value(expression))

    def assign(self, target: ast.expr, value: Expression) -> None:
        """Assign a value to a target."""
        if isinstance(target, ast.Name):
            if value.kind == NOTHING:
                self.refuse("a call without a result as a value", "return a value")
            if target.id in self.overlay:
                self.refuse("an assignment to the variable of a loop", "use another name")
            variable_kind = self.variables.get(target.id)
            kind = value.kind
            if value.fixed and (target.id in self.variables or is_number(value.kind.value)):
                runtime_value = self.runtime(value)
                kind = variable_kind if variable_kind == value.kind else runtime_value.kind
            if value.items is not None:
                kind = Tuple(
                    tuple(self.runtime(item).kind for item in value.items), value.kind.names
                )
            kind = self.joined(variable_kind, kind)
            self.variables[target.id] = kind
            code = self.converted(value, kind)
            if code:
                self.emit(f"v_{identifier(target.id)} = {code};")
            return
        if isinstance(target, ast.Tuple | ast.List):
            self.unpack(target.elts, value)
            return
        if isinstance(target, ast.Subscript):
            if self.value(target.value).fixed:
                self.refuse("an assignment to an item of a constant", "make an array by np.zeros")
            element = self.subscript(target)
            if element.kind == Array() or isinstance(element.kind, Array):
                self.copy(element, value)
                return
            if element.kind not in RANKS:
                self.refuse("an assignment to an item of a tuple", "make a new tuple")
            self.emit(f"{element.code} = {self.number(value, 'an item').code};")
            return
        if isinstance(target, ast.Attribute):
            element = self.value(_as_read(target))
            if element.kind in RANKS and "->" in element.code:
                self.emit(f"{element.code} = {self.number(value, 'a field').code};")
                return
        self.refuse("an assignment to this target", "assign to names and elements of arrays")

    def copy(self, target: Expression, value: Expression) -> None:
        """Assign to all elements of a slice."""
        runtime_value, length = self.runtime(value), target.kind.length
        if length is None:
            self.refuse("an assignment to a slice of unknown length", "write a loop")
        source = self.iterable(runtime_value) if runtime_value.kind not in RANKS else None
        if source is not None and source.length != length:
            self.refuse("an assignment between different lengths", "write a loop")
        if source is None:
            runtime_value = self.temporary(runtime_value)
        variable = self.temporary(target)
        items = [runtime_value if source is None else source.item(str(i), i) for i in range(length)]
        # All values are read before the first element changes: both slices may be of one array.
        items = [self.temporary(self.number(each, "an item")) for each in items]
        for i, each in enumerate(items):
            self.emit(f"{variable.code}[{i}] = {each.code};")

    def unpack(self, targets: Sequence[ast.expr], value: Expression) -> None:
        if value.fixed:
            try:
                items = tuple(constant(each) for each in value.kind.value)
            except TypeError:
                self.refuse("a number in place of a tuple", "unpack a tuple")
        elif value.items is not None:
            items = value.items
        elif isinstance(value.kind, Tuple):
            variable = self.temporary(value)
            items = tuple(self.item(variable, i) for i in range(len(value.kind.items)))
        elif isinstance(value.kind, Array) and value.kind.length is not None:
            items = tuple(Expression(REAL, f"{value.code}[{i}]") for i in range(value.kind.length))
        else:
            self.refuse("the unpacking of this value", "unpack a tuple")
        if len(items) != len(targets) or any(isinstance(each, ast.Starred) for each in targets):
            self.refuse(f"the unpacking of {len(items)} values", "name each of them")
        if len(items) > 1:
            # All values are computed before the first target changes.
            items = tuple(
                item if item.fixed else self.temporary(self.runtime(item)) for item in items
            )
        for target, item in zip(targets, items, strict=True):
            self.assign(target, item)

    def do_If(self, node: ast.If) -> bool | None:
        outcome, code = self.truth(node.test)
        if outcome is not None:
            return self.block(node.body if outcome else node.orelse)
        self.emit(f"if ({code}) {{")
        first = self.inner(node.body)
        second = True
        if node.orelse:
            self.emit("} else {")
            second = self.inner(node.orelse)
        self.emit("}")
        return None if first or second else False

    def do_While(self, node: ast.While) -> None:
        if node.orelse:
            self.refuse("else of a loop", "use a flag")
        outcome, _ = self.peek(node.test)
        if outcome is False:
            return
        self.emit("for (;;) {")
        self.depth += 1
        if outcome is None:
            _, code = self.truth(node.test)
            self.emit(f"if (!({code})) break;")
        self.loops.append(("continue;", "break;"))
        self.block(node.body)
        self.loops.pop()
        self.depth -= 1
        self.emit("}")

    def peek(self, test: ast.expr) -> tuple[bool | None, str]:
        """Return the value of a test without its lines."""
        lines, temporaries = list(self.lines), list(self.temporaries)
        result = self.truth(test)
        self.lines, self.temporaries = lines, temporaries
        return result

    def do_Break(self, node: ast.Break) -> bool:
        self.emit(self.loops[-1][1])
        return False

    def do_Continue(self, node: ast.Continue) -> bool:
        self.emit(self.loops[-1][0])
        return False

    def do_For(self, node: ast.For) -> None:
        if node.orelse:
            self.refuse("else of a loop", "use a flag")
        call = node.iter
        if isinstance(call, ast.Call):
            callee = self.value(call.func)
            if callee.fixed and callee.kind.value is range:
                self.count(node, [self.value(each) for each in call.args])
                return
        each = self.iterable_of(call)
        if each.length is not None and each.unrolled:
            self.unroll(node, each)
            return
        index = f"i{self.label()}"
        self.emit(f"for (int64_t {index} = 0; {index} < {each.count}; {index}++) {{")
        self.depth += 1
        self.assign(node.target, each.item(index, None))
        self.loops.append(("continue;", "break;"))
        self.block(node.body)
        self.loops.pop()
        self.depth -= 1
        self.emit("}")

    def count(self, node: ast.For, bounds: Sequence[Expression]) -> None:
        """Translate a loop over a range."""
        if not 1 <= len(bounds) <= 3:
            self.refuse("this range", "give one to three integers")
        step = bounds[2].kind.value if len(bounds) == 3 and bounds[2].fixed else 1
        if len(bounds) == 3 and not bounds[2].fixed:
            self.refuse("a range with a variable step", "write a while loop")
        start = constant(0) if len(bounds) == 1 else bounds[0]
        stop = bounds[0] if len(bounds) == 1 else bounds[1]
        index = f"i{self.label()}"
        first, last = self.number(start, "a range"), self.temporary(self.number(stop, "a range"))
        self.emit(
            f"for (int64_t {index} = {first.code}; "
            f"{index} {'<' if step > 0 else '>'} {last.code}; {index} += {step}) {{"
        )
        self.depth += 1
        self.assign(node.target, Expression(INTEGER, index))
        self.loops.append(("continue;", "break;"))
        self.block(node.body)
        self.loops.pop()
        self.depth -= 1
        self.emit("}")

    def unroll(self, node: ast.For, each: Iterable) -> None:
        """Translate a loop over constants of several kinds, once for each."""
        assert each.length is not None
        end_label = self.label()
        overlay = dict(self.overlay)
        for i in range(each.length):
            next_label = self.label()
            self.emit("{")
            self.depth += 1
            self.bind(node.target, each.item(str(i), i))
            self.loops.append((f"goto {next_label};", f"goto {end_label};"))
            self.block(node.body)
            self.loops.pop()
            self.depth -= 1
            self.emit(f"}} {next_label}:;")
        self.overlay = overlay
        self.emit(f"{end_label}:;")

    def bind(self, target: ast.expr, value: Expression) -> None:
        """Assign an item of an unrolled loop; a constant keeps its value."""
        if isinstance(target, ast.Tuple) and value.items is not None:
            for each, item in zip(target.elts, value.items, strict=True):
                self.bind(each, item)
        elif isinstance(target, ast.Tuple) and value.fixed:
            for each, item in zip(target.elts, value.kind.value, strict=True):
                self.bind(each, constant(item))
        elif isinstance(target, ast.Name) and value.fixed and not is_number(value.kind.value):
            self.overlay[target.id] = value
        else:
            self.assign(target, value)


def _no_value(kind: Any) -> str:
    """Return the C value of a function that returns None in Python.

    The event loop fails there, as in Python: it finds no finite number, or no such mode.
    """
    if isinstance(kind, Tuple):
        items = (_no_value(item) for item in kind.items if not isinstance(item, Fixed))
        return f"({kind.ctype}){{{', '.join(items)}}}"
    return {REAL: "NAN", INTEGER: "INT64_MIN"}.get(kind, "0")


def _as_read(target: ast.expr) -> Any:
    """Return a target as an expression that is read."""
    result = type(target)(**{name: getattr(target, name) for name in target._fields})
    result.ctx = ast.Load()  # type: ignore[attr-defined]
    return ast.copy_location(result, target)
