"""Whether functions keep what they do to themselves: none changes a variable from elsewhere."""

from __future__ import annotations

from collections.abc import Iterator
from dis import get_instructions
from types import FunctionType
from typing import Any

from mems_impact.errors import FunctionError
from mems_impact.hybrid.blaming import Function
from mems_impact.hybrid.written import Definition

__all__ = ["check_effects"]


def check_effects(definition: Definition) -> None:
    """Raise FunctionError if a function, or one that it calls, changes a variable of elsewhere."""
    for function in _functions(definition):
        for called in _called(getattr(function.call, "py_func", function.call), set()):
            _check(function, called)


def _check(function: Function, called: FunctionType) -> None:
    code = called.__code__
    for step in get_instructions(code):
        outside = step.opname in ("STORE_GLOBAL", "DELETE_GLOBAL")
        outside = outside or (step.opname == "STORE_DEREF" and step.argval in code.co_freevars)
        if outside:
            problem = f"changes {step.argval}, which lives outside of it"
            remedy = "let it only read: what changes along a run is a state"
            file, line = code.co_filename, code.co_firstlineno
            raise FunctionError(function.role, problem, remedy, file, line)


def _called(function: Any, seen: set[Any]) -> Iterator[FunctionType]:
    """Yield a function and those that it may call: globals and what it closes over."""
    if not isinstance(function, FunctionType) or function in seen:
        return
    seen.add(function)
    yield function
    scope = function.__globals__
    for name in function.__code__.co_names:
        yield from _called(scope.get(name), seen)
    for cell in function.__closure__ or ():
        try:
            yield from _called(cell.cell_contents, seen)
        except ValueError:  # not set yet
            continue


def _functions(definition: Definition) -> Iterator[Function]:
    for kind in ("flow", "settle", "jacobian"):
        if getattr(definition, kind) is not None:
            yield Function(kind, getattr(definition, kind))
    for guard in definition.guards:
        for kind in ("margin", "rate", "transition", "rest"):
            if getattr(guard, kind) is not None:
                yield Function(kind, getattr(guard, kind), guard.name)
