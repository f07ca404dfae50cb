"""Diagnosis of failures: which function failed, where, and why."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dis import get_instructions
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mems_impact.errors import FunctionError
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.definition import Definition, automaton_of, named_tuple, writes_into_arrays
from mems_impact.hybrid.diagnostics.user_functions import (
    CheckedFunctions,
    CheckedVector,
    DomainError,
    EvaluationPoint,
    UserFunction,
    is_own,
    place_of,
)
from mems_impact.integrators.python_functions import FLOW, MARGINS, TRANSITION, Fault

# --- Margins that depend on time alone

AT_TIMES = (
    "the margin depends on time alone, which no transition changes: give the times as switches= "
    "of the System, and the change of mode and state as switch_transition="
)


def depends_on_time_only(margin: Callable[[Sequence[float]], float], y: Sequence[float]) -> bool:
    """Return whether a margin is independent of all components of the state."""
    try:
        reference = margin(y)
        for c, value in enumerate(y):
            for shift in (-1.0 - abs(value), 1.0 + abs(value)):
                if margin([*y[:c], value + shift, *y[c + 1 :]]) != reference:
                    return False
    except (FunctionError, ArithmeticError, ValueError):
        return False
    return True


# --- Functions that fail in a run


def definition_of(automaton: Automaton) -> Definition | None:
    """Return the user's definition of an automaton, or None if it has none."""
    if automaton.recipe is None or automaton.recipe[0] is not automaton_of:
        return None
    definition: Definition = automaton.recipe[1][0]
    return definition


def explain_fault(automaton: Automaton, parameters: Sequence[float], fault: Fault) -> FunctionError:
    """Return the error of a failed call, diagnosed by a repeated, checked call."""
    definition, clock = definition_of(automaton), automaton.clock
    if clock is not None and (fault.role == TRANSITION or not automaton.forced):
        fault = fault._replace(time=parameters[clock] + fault.time)
    if definition is None:
        error = _array_error(automaton, parameters, fault)
    else:
        error = _named_error(automaton, definition, parameters, fault)
    if error is not None:
        return error
    function = _function(automaton, fault.role)
    if fault.error is not None:
        return _exception_error(automaton, fault.role, fault.error)
    time = fault.time * (definition.sizes[-1] if definition and definition.sizes else 1.0)
    for case in _named_cases(definition) if definition is not None else ():
        exception = _compiled_error(definition, case, parameters, fault)
        if exception is not None:
            problem = f"fails compiled at t = {time:.6g}: {exception}"
            return case.function.error(problem, REAL_REMEDY)
    problem = f"fails compiled at t = {time:.6g}, but not interpreted"
    return function.error(problem, "use engine 'interpreted'")


REAL_REMEDY = "use real numbers, such as 1.0 in place of 1, or engine 'interpreted'"


def _compiled_error(
    definition: Any, case: _Case, parameters: Sequence[float], fault: Fault
) -> Exception | None:
    """Return the exception that a function of the failed role raises compiled, or None."""
    from mems_impact.integrators.jit.closures import compiled_exception

    roles = {FLOW: ("flow",), MARGINS: ("margin", "flow")}
    guards, m = definition.guards, max(1, len(definition.guards))
    owner = guards[fault.code % m].name if fault.role == TRANSITION and fault.code < 2 * m else ""
    kinds = roles.get(fault.role, ("transition", "rest") if owner else ("switch_transition",))
    if case.function.kind not in kinds or (owner and case.function.guard != owner):
        return None
    n, count = len(definition.states), len(definition.parameters)
    p = named_tuple("Parameters", definition.parameters)(*parameters[:count])
    y: Any = fault.y
    if not writes_into_arrays(definition.flow):
        y = named_tuple("State", definition.states)(*fault.y.tolist())
    outputs = [np.zeros(n) for _ in case.arguments[4:]]
    return compiled_exception(case.function.call, (fault.mode, fault.time, y, p, *outputs))


def find_invalid_value(
    automaton: Automaton, parameters: Sequence[float], point: EvaluationPoint
) -> FunctionError | None:
    """Return the error of flow or margins that are invalid at a point, or None."""
    definition = definition_of(automaton)
    if definition is None:
        return None
    functions = CheckedFunctions(definition, parameters[: len(definition.parameters)])
    return _first(
        lambda: functions.flow(point),
        *(_margin(functions, i, point) for i in range(len(definition.guards))),
    )


def _margin(functions: CheckedFunctions, i: int, point: EvaluationPoint) -> Callable[[], Any]:
    guard = functions.definition.guards[i]

    def call() -> None:
        if guard.modes is None or point.mode in guard.modes:
            functions.margin(i, point)

    return call


def _named_error(
    automaton: Automaton, definition: Definition, parameters: Sequence[float], fault: Fault
) -> FunctionError | None:
    functions = CheckedFunctions(definition, parameters[: len(definition.parameters)])
    point = EvaluationPoint(fault.mode, fault.time, fault.y.tolist())
    if fault.role != TRANSITION:
        return find_invalid_value(automaton, parameters, point)
    m = len(automaton.guards)
    if fault.code == 2 * m:
        return _first(lambda: functions.transition("switch_transition", None, point))
    kind = "transition" if fault.code < m else "rest"
    return _first(lambda: functions.transition(kind, fault.code % m, point))


def _array_error(
    automaton: Automaton, parameters: Sequence[float], fault: Fault
) -> FunctionError | None:
    n, m = len(automaton.states), len(automaton.guards)
    mode, code, t, values = fault.mode, fault.code, fault.time, fault.y.tolist()
    y, p = (
        CheckedVector("y", values, fixed=fault.role != TRANSITION),
        CheckedVector("p", parameters),
    )
    arguments: dict[int, tuple[Any, ...]] = {
        FLOW: (mode, t, y, p, CheckedVector("dy", [None] * n)),
        MARGINS: (mode, t, y, p, CheckedVector("g", [1.0] * m), CheckedVector("r", [1.0] * m)),
        TRANSITION: (mode, code, t, y, p),
    }
    try:
        _function(automaton, fault.role).call(*arguments[fault.role])
    except Exception as error:
        return _exception_error(automaton, fault.role, error)
    return None


def _exception_error(automaton: Automaton, role: int, error: Exception) -> FunctionError:
    function = _function(automaton, role)
    cause = function.explain_exception(error)[0]
    if not is_own(function.call):
        return cause
    # The package's wrapper of a user function has no name that the user knows.
    description = f"a {function.kind} of the system"
    return FunctionError(description, cause.problem, cause.remedy, cause.file, cause.line)


def _function(automaton: Automaton, role: int) -> UserFunction:
    kind = {FLOW: "flow", MARGINS: "margins", TRANSITION: "transition"}[role]
    return UserFunction(kind, getattr(automaton, kind))


def _first(*calls: Callable[[], Any]) -> FunctionError | None:
    """Return the first error that a call raises."""
    for call in calls:
        try:
            call()
        except FunctionError as error:
            return error
        except DomainError as found:
            return found.error
    return None


# --- Functions that numba cannot compile

INTERPRETED_REMEDY = "write it over numbers, tuples and math, or use engine 'interpreted'"


class _Case(NamedTuple):
    """A function, the types of its arguments, and the number of values that it must return."""

    function: UserFunction
    arguments: tuple[Any, ...]
    numbers: int | None = None  # None for any
    after_mode: bool = False


def explain_compile_error(automaton: Automaton, error: BaseException) -> FunctionError | None:
    """Return the error of an automaton that could not be compiled.

    Each function is compiled by itself. None if `error` has another cause.
    """
    from numba.core.errors import NumbaError

    from mems_impact.integrators.jit.closures import summarize_numba_error, try_compile

    definition = definition_of(automaton)
    for case in _array_cases(automaton) if definition is None else _named_cases(definition):
        call = getattr(case.function.call, "py_func", case.function.call)
        attempt = try_compile(call, case.arguments)
        if attempt.problem:
            file, line = place_of(call)
            problem = f"cannot be compiled by numba: {attempt.problem}"
            return FunctionError(
                case.function.role, problem, INTERPRETED_REMEDY, file, attempt.line or line
            )
        problem = _mismatch(attempt.returned, case)
        if problem and not _returns(call):
            return case.function.explain_exception(_raised(call, case.arguments))[0]
        if problem:
            remedy = "return the same type on every path"
            return case.function.error(f"returns {problem}", remedy)
    if not isinstance(error, NumbaError):
        return None
    problem = f"cannot be compiled by numba: {summarize_numba_error(str(error))}"
    return FunctionError("a function of the system", problem, INTERPRETED_REMEDY)


def explain_refusal(automaton: Automaton) -> str:
    """Return which function does not take numbers with tangents, and why."""
    from numba import types

    from mems_impact.integrators.jit.closures import try_compile
    from mems_impact.integrators.jit.dual_numbers import dual, vector

    def with_tangents(kind: Any) -> Any:
        if isinstance(kind, types.Float):
            return dual(1)
        if isinstance(kind, types.NamedUniTuple):
            return types.NamedUniTuple(dual(1), kind.count, kind.instance_class)
        return vector(1) if isinstance(kind, types.Array) else kind

    definition = definition_of(automaton)
    for case in _array_cases(automaton) if definition is None else _named_cases(definition):
        attempt = try_compile(case.function.call, tuple(map(with_tangents, case.arguments)))
        if attempt.problem:
            file, line = place_of(case.function.call)
            place = f"{case.function.role} ({Path(file).name}, line {attempt.line or line})"
            return f"{place}: {attempt.problem}"
    return "a function of the system cannot be compiled for numbers with tangents"


def _named_cases(definition: Definition) -> Iterator[_Case]:
    """Yield all functions of a definition with the types of their arguments."""
    from numba import typeof, types

    n, vector = len(definition.states), types.Array(types.float64, 1, "C")
    p = typeof(
        named_tuple("Parameters", definition.parameters)(*[0.0] * len(definition.parameters))
    )
    by_array = writes_into_arrays(definition.flow)
    y = vector if by_array else typeof(named_tuple("State", definition.states)(*[0.0] * n))
    inputs = (types.int64, types.float64, y, p)
    arguments, size = ((*inputs, vector), None) if by_array else (inputs, n)
    yield _Case(UserFunction("flow", definition.flow), arguments, size)
    for guard in definition.guards:
        assert guard.margin is not None
        yield _Case(UserFunction("margin", guard.margin, guard.name), inputs, 1)
        for kind in ("transition", "rest"):
            if getattr(guard, kind) is not None:
                yield _Case(
                    UserFunction(kind, getattr(guard, kind), guard.name), arguments, size, True
                )
    if definition.switch_transition is not None:
        yield _Case(
            UserFunction("switch_transition", definition.switch_transition), arguments, size, True
        )


def _array_cases(automaton: Automaton) -> Iterator[_Case]:
    """Yield the functions of an automaton over arrays."""
    from numba import types

    vector = types.Array(types.float64, 1, "C")
    head, mode = (types.float64, vector, vector), types.int64
    yield _Case(UserFunction("flow", automaton.flow), (mode, *head, vector))
    yield _Case(UserFunction("margins", automaton.margins), (mode, *head, vector, vector))
    yield _Case(UserFunction("transition", automaton.transition), (mode, mode, *head), None, True)


def _mismatch(returned: Any, case: _Case) -> str:
    """Return a description of a return type that differs from the required one, or ""."""
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
        has_numbers = isinstance(state, types.BaseTuple) or case.numbers > 1
        return ("" if is_number(mode) else f"{_name(mode)} for the mode") or (
            numbers(state, case.numbers) if has_numbers else f"{_name(state)} for the state"
        )
    if case.after_mode:
        return "" if is_number(returned) else f"{_name(returned)}, not the mode"
    return numbers(returned, case.numbers)


def _returns(call: Callable[..., Any]) -> bool:
    """Return whether a function has an instruction to return, so does not raise on every path."""
    return any(each.opname.startswith("RETURN") for each in get_instructions(call))


def _raised(call: Callable[..., Any], kinds: Sequence[Any]) -> Exception:
    """Return the exception of a function that raises on every path."""
    named = (getattr(kind, "instance_class", None) for kind in kinds)
    try:
        call(*(make(*[0.0] * len(make._fields)) if make else 0.0 for make in named))
    except Exception as error:
        return error
    raise AssertionError("a function without a return instruction returned")


def _name(kind: Any) -> str:
    return "nothing" if str(kind) == "none" else f"what numba calls {kind}"
