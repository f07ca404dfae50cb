"""Which of a user's functions numba cannot compile, and why."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from mems_impact.errors import FunctionError
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.blaming import Function, place_of
from mems_impact.hybrid.faults import definition_of
from mems_impact.hybrid.written import Definition, named, writes_into_arrays

__all__ = ["refused"]

PLAIN = "write it over numbers, tuples and math, or take Options(engine='interpreted')"


class _Case(NamedTuple):
    """A function, the types that it is called with, and how many numbers it shall return."""

    function: Function
    arguments: tuple[Any, ...]
    numbers: int | None = None  # None for any
    after_mode: bool = False


def refused(automaton: Automaton, error: BaseException) -> FunctionError | None:
    """Return the sentence about functions that could not be compiled together.

    Each of them is compiled by itself, to find the one. None if `error` is about something else.
    """
    from numba.core.errors import NumbaError

    from mems_impact.engines.refusing import compiling, told

    definition = definition_of(automaton)
    for case in _of_arrays(automaton) if definition is None else _of_names(definition):
        call = getattr(case.function.call, "py_func", case.function.call)
        found = compiling(call, case.arguments)
        if found.problem:
            file, line = place_of(call)
            problem = f"cannot be compiled by numba: {found.problem}"
            return FunctionError(case.function.role, problem, PLAIN, file, found.line or line)
        problem = _unlike(found.returned, case)
        if problem:
            remedy = "return the same kind of thing on every path"
            return case.function.error(f"returns {problem}", remedy)
    if not isinstance(error, NumbaError):
        return None
    problem = f"cannot be compiled by numba: {told(str(error))}"
    return FunctionError("a function of the system", problem, PLAIN)


def _of_names(definition: Definition) -> Iterator[_Case]:
    """Yield all functions of a definition with the types of their arguments."""
    from numba import typeof, types

    n, vector = len(definition.states), types.Array(types.float64, 1, "C")
    p = typeof(named("Parameters", definition.parameters)(*[0.0] * len(definition.parameters)))
    by_array = writes_into_arrays(definition.flow)
    y = vector if by_array else typeof(named("State", definition.states)(*[0.0] * n))
    plain = (types.int64, types.float64, y, p)
    out, size = ((*plain, vector), None) if by_array else (plain, n)
    yield _Case(Function("flow", definition.flow), out, size)
    for guard in definition.guards:
        for kind in ("margin", "rate"):
            if getattr(guard, kind) is not None:
                yield _Case(Function(kind, getattr(guard, kind), guard.name), plain, 1)
        for kind in ("transition", "rest"):
            if getattr(guard, kind) is not None:
                yield _Case(Function(kind, getattr(guard, kind), guard.name), out, size, True)
    if definition.settle is not None:
        yield _Case(Function("settle", definition.settle), out, size, True)
    if definition.jacobian is not None:
        matrix = types.Array(types.float64, 2, "F")
        yield _Case(Function("jacobian", definition.jacobian), (*plain, matrix))


def _of_arrays(automaton: Automaton) -> Iterator[_Case]:
    """Yield the functions of an automaton that was written over arrays."""
    from numba import types

    vector, matrix = types.Array(types.float64, 1, "C"), types.Array(types.float64, 2, "F")
    head, mode = (types.float64, vector, vector), types.int64
    yield _Case(Function("flow", automaton.flow), (mode, *head, vector))
    yield _Case(Function("margins", automaton.margins), (mode, *head, vector, vector))
    yield _Case(Function("transition", automaton.transition), (mode, mode, *head), None, True)
    if automaton.jacobian is not None:
        yield _Case(Function("jacobian", automaton.jacobian), (mode, *head, matrix))


def _unlike(returned: Any, case: _Case) -> str:
    """Return what a function returns where it should return something else."""
    from numba import types

    def is_number(kind: Any) -> bool:
        return isinstance(kind, types.Integer | types.Float | types.Boolean)

    def numbers(kind: Any, count: int | None) -> str:
        if count is None or (count == 1 and is_number(kind)):
            return ""
        if not (isinstance(kind, types.BaseTuple) and len(kind) == count):
            return f"{_name(kind)}, not {count} number{'s' * (count > 1)}"
        return "" if all(map(is_number, kind)) else _name(kind)

    if isinstance(returned, types.Optional):
        return "nothing on some path"
    if case.after_mode and case.numbers is not None:
        if not (isinstance(returned, types.BaseTuple) and len(returned) == 2):
            return f"{_name(returned)}, not a mode and a state"
        mode, state = returned
        one = isinstance(state, types.BaseTuple) or case.numbers > 1
        return ("" if is_number(mode) else f"{_name(mode)} for the mode") or (
            numbers(state, case.numbers) if one else f"{_name(state)} for the state"
        )
    if case.after_mode:
        return "" if is_number(returned) else f"{_name(returned)}, not the mode"
    return numbers(returned, case.numbers)


def _name(kind: Any) -> str:
    return "nothing" if str(kind) == "none" else f"what numba calls {kind}"
