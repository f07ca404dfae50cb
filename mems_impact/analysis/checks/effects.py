"""Whether functions keep what they do to themselves: none changes a variable from elsewhere."""

from __future__ import annotations

from collections.abc import Iterator
from dis import get_instructions
from types import CodeType, FunctionType, ModuleType
from typing import Any

from mems_impact.errors import FunctionError
from mems_impact.hybrid.blaming import Function
from mems_impact.hybrid.written import Definition

__all__ = ["check_effects"]

_LIBRARIES = ("numba", "numpy")  # compiled code never runs their text


def check_effects(definition: Definition) -> None:
    """Raise FunctionError if a function, or one that it calls, changes a variable of elsewhere."""
    for function in _functions(definition):
        for called in _called(function.call, set()):
            _check(function, called)


def _check(function: Function, called: FunctionType) -> None:
    for name in _changed(called.__code__, set(called.__code__.co_freevars)):
        problem = f"changes {name}, which lives outside of it"
        remedy = "let it only read: what changes along a run is a state"
        file, line = called.__code__.co_filename, called.__code__.co_firstlineno
        raise FunctionError(function.role, problem, remedy, file, line)


def _changed(code: CodeType, outside: set[str]) -> Iterator[str]:
    """Yield the names of what code, or a function within, changes of elsewhere.

    `outside` are those of the variables that it closes over and does not share with its own.
    """
    for step in get_instructions(code):
        shared = step.opname in ("STORE_DEREF", "DELETE_DEREF") and step.argval in outside
        if shared or step.opname in ("STORE_GLOBAL", "DELETE_GLOBAL"):
            yield step.argval
    for inner in _within(code):
        yield from _changed(inner, outside & set(inner.co_freevars))


def _called(value: Any, seen: set[FunctionType]) -> Iterator[FunctionType]:
    """Yield a function and those that it may call: globals and what it closes over."""
    function = getattr(value, "py_func", value)  # of one that numba compiled
    if not isinstance(function, FunctionType) or function in seen:
        return
    if (function.__module__ or "").partition(".")[0] in _LIBRARIES:
        return
    seen.add(function)
    yield function
    for each in _loaded(function.__code__, function.__globals__):
        yield from _called(each, seen)
    for cell in function.__closure__ or ():
        try:
            yield from _called(cell.cell_contents, seen)
        except ValueError:  # not set yet
            continue


def _loaded(code: CodeType, scope: dict[str, Any]) -> Iterator[Any]:
    """Yield the globals that code reads, and of modules the attributes that it reads.

    Other attributes are no globals: ``p.k`` has nothing to do with a function ``k``.
    """
    value: Any = None
    for step in get_instructions(code):
        if step.opname in ("LOAD_GLOBAL", "LOAD_NAME"):
            value = scope.get(step.argval)
        elif step.opname in ("LOAD_ATTR", "LOAD_METHOD") and isinstance(value, ModuleType):
            value = getattr(value, step.argval, None)
        else:
            value = None
        yield value
    for inner in _within(code):
        yield from _loaded(inner, scope)


def _within(code: CodeType) -> Iterator[CodeType]:
    return (part for part in code.co_consts if isinstance(part, CodeType))


def _functions(definition: Definition) -> Iterator[Function]:
    for kind in ("flow", "settle", "jacobian"):
        if getattr(definition, kind) is not None:
            yield Function(kind, getattr(definition, kind))
    for guard in definition.guards:
        for kind in ("margin", "rate", "transition", "rest"):
            if getattr(guard, kind) is not None:
                yield Function(kind, getattr(guard, kind), guard.name)
