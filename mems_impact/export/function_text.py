"""Source text of Python functions."""

from __future__ import annotations

import ast
import inspect
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from types import CodeType, FunctionType
from typing import Any, NoReturn

from mems_impact.errors import FunctionError
from mems_impact.hybrid.automaton import GENERATED


@dataclass(frozen=True)
class SourceText:
    """The syntax tree of a function, and the name of its file."""

    tree: ast.FunctionDef | ast.Lambda
    file: str = ""


def source_of(function: FunctionType, generated: Mapping[Any, str]) -> SourceText:
    """Return the source of a function; of a generated one, from the texts in `generated`."""
    code = function.__code__
    text = generated.get(code)
    if text is None and code.co_filename == GENERATED:
        text = function.__globals__.get("SOURCE")
    if text is not None:
        candidates = (node for node in _functions_of(text) if _name(node) == code.co_name)
        return SourceText(next(candidates))

    def refuse(problem: str, remedy: str, file: str = code.co_filename) -> NoReturn:
        line = code.co_firstlineno if file else 0
        problem = f"cannot be translated to C: {problem}"
        raise FunctionError(f"function {function.__name__!r}", problem, remedy, file, line)

    try:
        text = "".join(inspect.findsource(code)[0])  # that of a function may be one it wraps
    except (OSError, TypeError):
        refuse("it has no source text", "define it in a file", "")
    if code not in _codes_of(text):
        remedy = "import it again, in a new process or by importlib.reload"
        refuse("its file has changed since it was imported", remedy)
    arguments = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
    positions: list[Any] = [
        each for each in code.co_positions() if None not in each and any(each[2:])
    ]
    matching = [
        node
        for node in _functions_of(text)
        if _name(node) == code.co_name
        and _first_line(node) == code.co_firstlineno
        and tuple(arguments_of(node)) == arguments
        and all(_contains(node, *each) for each in positions)
    ]
    if len(matching) != 1:
        refuse("its source text is ambiguous", "define it by def, on lines of its own")
    return SourceText(matching[0], code.co_filename)


@lru_cache(maxsize=64)
def _functions_of(text: str) -> tuple[ast.FunctionDef | ast.Lambda, ...]:
    """Return all functions in the text of a file."""
    kinds = ast.FunctionDef | ast.Lambda
    return tuple(node for node in ast.walk(ast.parse(text)) if isinstance(node, kinds))


def _name(node: ast.FunctionDef | ast.Lambda) -> str:
    """Return the name of a function."""
    return getattr(node, "name", "<lambda>")


def _contains(node: Any, line: int, end_line: int, column: int, end_column: int) -> bool:
    """Return whether an instruction at this place is of a function."""
    begin, end = (node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset)
    return begin <= (line, column) and (end_line, end_column) <= end


def _first_line(node: ast.FunctionDef | ast.Lambda) -> int:
    """Return the first line of a function, the line of its first decorator."""
    return min(each.lineno for each in (node, *getattr(node, "decorator_list", ())))


def arguments_of(node: ast.FunctionDef | ast.Lambda) -> list[str]:
    """Return the names of the arguments except * and ** arguments."""
    arguments = node.args
    return [each.arg for each in (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs)]


@lru_cache(maxsize=64)
def _codes_of(text: str) -> frozenset[CodeType]:
    """Return the code of all functions in the text of a file; none if it cannot be compiled."""
    try:
        pending = [compile(text, "", "exec", dont_inherit=True)]
    except SyntaxError:
        return frozenset()
    codes = set()
    while pending:
        code = pending.pop()
        codes.add(code)
        pending += [each for each in code.co_consts if isinstance(each, CodeType)]
    return frozenset(codes)
