"""Dependence of functions on time, by analysis of their code.

Values cannot show that a function does not depend on time: a ramp or a pulse may begin late.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from dis import get_instructions
from functools import lru_cache
from types import CodeType, FunctionType, ModuleType
from typing import Any

from mems_impact.hybrid.automaton import GENERATED

TIME_POSITION = 1  # of t among the arguments (mode, t, y, p)
PASSING = ("binop", "inplace_binop", "unary", "cast", "phi")  # results that depend on time as well

TIME_RTOL = 1e-12  # error of a time at which an event was located

Argument = tuple[FunctionType, int]  # a function, and the position of one of its arguments


def time_error(t):  # type: ignore[no-untyped-def]
    """Return the error of a time; a motion that depends on it does not depend on time."""
    return TIME_RTOL * abs(t)


def reads_time(
    function: Any, visited: set[Argument] | None = None, position: int = TIME_POSITION
) -> bool:
    """Return whether a function, or one to which it passes an argument, reads the argument.

    The argument is that at `position`. Anything but a Python function counts as reading its
    arguments. Arguments in `visited` do not count as read; those to which the argument is passed
    are added.
    """
    visited = set() if visited is None else visited
    function = getattr(function, "py_func", function)  # of one that numba compiled
    if not isinstance(function, FunctionType):
        return True
    if function is time_error or (function, position) in visited:
        return False
    visited.add((function, position))
    code = function.__code__
    if position >= code.co_argcount:
        return True  # one of *args
    if not _mentions(code, code.co_varnames[position]):
        return False
    uses = _uses(function, position)
    if uses is None:
        return True
    reads = False
    for use in uses:  # all of them, so that `visited` becomes complete
        reads = use is None or reads_time(use[0], visited, use[1]) or reads
    return reads


@lru_cache(maxsize=512)
def _mentions(code: CodeType, name: str) -> bool:
    """Return whether code loads a variable, or an inner function closes over it."""
    loads = (step for step in get_instructions(code) if step.opname.startswith(("LOAD", "STORE")))
    return name in code.co_cellvars or any(
        name in (each.argval if isinstance(each.argval, tuple) else (each.argval,))
        for each in loads
    )


@lru_cache(maxsize=512)
def _uses(function: FunctionType, position: int) -> Sequence[tuple[Any, int] | None] | None:
    """Return the functions and positions to which an argument is passed; None for another use.

    Return None in place of all uses if numba does not understand the code.
    """
    if function.__code__.co_filename == GENERATED and "SOURCE" in function.__globals__:
        return list(_generated_uses(function, position))
    from numba.core import ir
    from numba.core.compiler import run_frontend
    from numba.core.errors import NumbaError

    try:
        blocks = run_frontend(function).blocks
    except (NumbaError, NotImplementedError, AssertionError):
        return None
    statements = [each for block in blocks.values() for each in block.body]
    known: dict[str, Any] = {}  # functions and modules
    timed = set[str]()  # variables that depend on the argument
    uses: list[tuple[Any, int] | None] = []

    def assignments() -> Iterator[tuple[str, Any]]:
        return ((s.target.name, s.value) for s in statements if isinstance(s, ir.Assign))

    for name, value in assignments():
        callee = None
        if isinstance(value, ir.Global | ir.FreeVar):
            callee = value.value
        elif isinstance(value, ir.Var):
            callee = known.get(value.name)
        elif isinstance(value, ir.Expr) and value.op == "getattr":
            owner = known.get(value.value.name)
            callee = getattr(owner, value.attr, None) if isinstance(owner, ModuleType) else None
        known[name] = callee if known.get(name, callee) is callee else None
    count = -1
    while count < len(timed):
        count = len(timed)
        for name, value in assignments():
            if isinstance(value, ir.Arg):
                depends = value.index == position
            elif isinstance(value, ir.Var):
                depends = value.name in timed
            else:
                is_passing = isinstance(value, ir.Expr) and value.op in PASSING
                depends = is_passing and any(each.name in timed for each in value.list_vars())
            if depends:
                timed.add(name)
    for statement in statements:
        is_passing = isinstance(statement, ir.Assign) and statement.target.name in timed
        if is_passing or isinstance(statement, ir.Del):
            continue
        if not any(each.name in timed for each in statement.list_vars()):
            continue
        value = getattr(statement, "value", None)
        if isinstance(value, ir.Expr) and value.op == "call" and value.vararg is None:
            uses += _passed(value, timed, known.get(value.func.name))
        else:
            uses.append(None)
    return uses


def _generated_uses(function: FunctionType, position: int) -> Iterator[tuple[Any, int]]:
    """Yield the functions and positions to which a generated function passes an argument.

    Generated code reads the time by calls only.
    """
    code, space = function.__code__, function.__globals__
    name = code.co_varnames[position]

    def mentions(node: ast.AST) -> bool:
        return (isinstance(node, ast.Name) and node.id == name) or any(
            mentions(part) for part in ast.iter_child_nodes(node) if not isinstance(part, ast.Call)
        )

    for node in ast.walk(_definitions(space["SOURCE"])[code.co_name]):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            if node.func.id == "along":  # which passes the time, with its rate, to a function
                yield space.get(ast.unparse(node.args[0])), TIME_POSITION
            for place, argument in enumerate(node.args if node.func.id != "with_rate" else ()):
                if not isinstance(argument, ast.Call) and mentions(argument):
                    yield space.get(node.func.id), place


@lru_cache(maxsize=16)
def _definitions(source: str) -> dict[str, ast.FunctionDef]:
    """Return the syntax trees of the functions of a generated source, by name."""
    body = ast.parse(source).body
    return {each.name: each for each in body if isinstance(each, ast.FunctionDef)}


def _passed(call: Any, timed: set[str], callee: Any) -> Iterator[tuple[Any, int] | None]:
    """Yield where a call passes variables: function and position; None if it is unknown."""
    for place, variable in enumerate(call.args):
        if variable.name in timed:
            yield callee, place
    for keyword, variable in call.kws:
        if variable.name in timed:
            function = getattr(callee, "py_func", callee)
            names = function.__code__.co_varnames if isinstance(function, FunctionType) else ()
            yield (callee, names.index(keyword)) if keyword in names else None
