"""Small faults of a Python source: where they can be, and the source with one of them.

A mutant replaces one expression, statement or sign and leaves every other character alone, so that
its difference can be read. What is left out: docstrings, annotations, messages of errors, integers
that only name something (``PAUSED, BUFFER_FULL = 0, 1``), and sizes of arrays to write to, which
may be larger than they need be.
"""

from __future__ import annotations

import ast
import copy
import difflib
from collections.abc import Iterator
from dataclasses import dataclass

ROOMS = ("hybrid", "orbits", "continuation")  # of the package, whose sources are made wrong
LARGE = 1000.0  # factor by which a number is wrong

_REVERSED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.Gt,
    ast.LtE: ast.GtE,
    ast.Gt: ast.Lt,
    ast.GtE: ast.LtE,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
_WEAKENED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
}
_SWAPPED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.FloorDiv: ast.Mult,
    ast.Mod: ast.Mult,
    ast.Pow: ast.Mult,
}


@dataclass(frozen=True)
class Mutant:
    """One fault: bytes `start` to `end` of the source at `path` become `text`."""

    path: str
    line: int
    kind: str
    start: int
    end: int
    text: str

    def applied(self, source: str) -> str:
        """Return the source with the fault."""
        raw = source.encode()
        return (raw[: self.start] + self.text.encode() + raw[self.end :]).decode()

    def lines(self, source: str) -> tuple[str, str]:
        """Return what stood there and what stands there now, lines joined, without indentation."""
        raw, wrong = source.encode(), self.applied(source).encode()
        start = raw.rfind(b"\n", 0, self.start) + 1
        rest = len(raw[self.end :].partition(b"\n")[2])  # of the bytes, below the lines that differ
        texts = (text[start : len(text) - rest].decode() for text in (raw, wrong))
        changes = list(difflib.ndiff(*(text.splitlines() for text in texts)))
        sides = ([line[2:].strip() for line in changes if line[0] == sign] for sign in "-+")
        before, after = (" ".join(side) for side in sides)
        return before, after

    def difference(self, source: str) -> str:
        """Return the lines that changed."""
        before, after = source.splitlines(), self.applied(source).splitlines()
        lines = difflib.unified_diff(before, after, self.path, self.path, n=0, lineterm="")
        return "\n".join(list(lines)[2:])


def mutants(path: str, source: str) -> list[Mutant]:
    """Return every mutant of a source, in the order of the text."""
    starts = [0]
    for line in source.encode().splitlines(keepends=True):
        starts.append(starts[-1] + len(line))
    found = []
    for node, kind, text in _faults(ast.parse(source), False):
        start = starts[node.lineno - 1] + node.col_offset
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        end = starts[node.end_lineno - 1] + node.end_col_offset
        found.append(Mutant(path, node.lineno, kind, start, end, text))
    return sorted(found, key=lambda mutant: (mutant.start, mutant.end, mutant.text))


def _faults(node: ast.AST, truth: bool) -> Iterator[tuple[ast.expr | ast.stmt, str, str]]:
    """Yield what can be replaced below `node`, and by what.

    `truth`: within a function that answers yes or no.
    """
    if isinstance(node, ast.FunctionDef):
        truth = isinstance(node.returns, ast.Name) and node.returns.id == "bool"
    if isinstance(node, ast.expr | ast.stmt):
        for kind, wrong in _replacements(node, truth):
            text = ast.unparse(wrong)
            yield node, kind, text if isinstance(wrong, ast.stmt | ast.Constant) else f"({text})"
    for child in _children(node):
        yield from _faults(child, truth)


def _children(node: ast.AST) -> Iterator[ast.AST]:
    """Yield what may be mutated of the parts of `node`."""
    if isinstance(node, ast.Raise | ast.JoinedStr | ast.Import | ast.ImportFrom):
        return
    if isinstance(node, ast.Assign) and _only_names(node.value):
        return
    if isinstance(node, ast.Call) and ast.unparse(node.func) in ("np.zeros", "np.empty"):
        return
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "bases", "type_params"):
            continue
        for part in value if isinstance(value, list) else [value]:
            if isinstance(part, ast.AST):
                yield part


def _only_names(value: ast.expr) -> bool:
    """Return whether these are integers in a row, which tell things apart and mean nothing else."""
    if not isinstance(value, ast.Tuple):
        return False
    numbers = [part.value for part in value.elts if isinstance(part, ast.Constant)]
    return len(numbers) == len(value.elts) and all(type(number) is int for number in numbers)


def _replacements(
    node: ast.expr | ast.stmt, truth: bool
) -> Iterator[tuple[str, ast.expr | ast.stmt]]:
    wrong = copy.deepcopy(node)
    match wrong:
        case ast.Compare():
            operator = type(wrong.ops[0])
            wrong.ops[0] = _REVERSED[operator]()
            yield "comparison reversed", copy.deepcopy(wrong)
            if operator in _WEAKENED:
                # Numbers that are no integers are never equal: there the condition goes.
                wrong.ops[0] = _WEAKENED[operator]()
                counted = _counts(wrong.left) or _counts(wrong.comparators[0])
                yield "comparison weakened", wrong if counted else ast.Constant(True)
        case ast.BoolOp():
            wrong.op = ast.Or() if isinstance(wrong.op, ast.And) else ast.And()
            yield "and for or", wrong
        case ast.BinOp() if type(wrong.op) in _SWAPPED and not _is_text(wrong):
            wrong.op = _SWAPPED[type(wrong.op)]()
            yield "operator swapped", wrong
        case ast.AugAssign() if type(wrong.op) in _SWAPPED and not _is_text(wrong):
            wrong.op = _SWAPPED[type(wrong.op)]()
            yield "operator swapped", wrong
        case ast.UnaryOp(op=ast.USub()):
            yield "sign flipped", wrong.operand
        case ast.UnaryOp(op=ast.Not()):
            yield "negation dropped", wrong.operand
        case ast.Constant(value=bool()):
            yield "truth negated", ast.Constant(not wrong.value)
        case ast.Constant(value=int()):
            yield "off by one", ast.Constant(wrong.value + 1)
        case ast.Constant(value=float()):
            yield "number changed", ast.Constant(wrong.value * LARGE if wrong.value else 1.0)
        case ast.Return(value=ast.expr()) if truth:
            assert wrong.value is not None
            wrong.value = ast.UnaryOp(ast.Not(), wrong.value)
            yield "answer negated", wrong


def _counts(node: ast.expr) -> bool:
    """Return whether this is known to be an integer."""
    match node:
        case ast.Constant(value=int()) | ast.Attribute(attr="size" | "rows" | "samples"):
            return True
        case ast.Call(func=ast.Name(id="len")):
            return True
        case ast.Subscript(value=ast.Attribute(attr="shape")):
            return True
    return False


def _is_text(node: ast.BinOp | ast.AugAssign) -> bool:
    """Return whether strings, lists or tuples are joined, or types."""
    kinds = (ast.List, ast.ListComp, ast.Tuple, ast.JoinedStr)
    for part in ast.walk(node):
        if isinstance(part, kinds) or (
            isinstance(part, ast.Constant) and isinstance(part.value, str)
        ):
            return True
    return False
