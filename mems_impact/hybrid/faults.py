"""What is told of a function that failed while a run was going on."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from mems_impact.engines.faults import FLOW, JACOBIAN, MARGINS, TRANSITION, Fault
from mems_impact.errors import FunctionError
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.blaming import Function
from mems_impact.hybrid.guarded import GuardedMatrix, GuardedVector
from mems_impact.hybrid.tried import Place, Tried, Undefined
from mems_impact.hybrid.written import Definition, written

__all__ = ["definition_of", "explained", "searched"]


def definition_of(automaton: Automaton) -> Definition | None:
    """Return what a user wrote of an automaton, where that is how it was made."""
    if automaton.recipe is None or automaton.recipe[0] is not written:
        return None
    definition: Definition = automaton.recipe[1][0]
    return definition


def explained(automaton: Automaton, parameters: Sequence[float], fault: Fault) -> FunctionError:
    """Return the sentence about a call that failed, by making it once more, interpreted."""
    definition = definition_of(automaton)
    if definition is None:
        found = _by_array(automaton, parameters, fault)
    else:
        found = _by_name(automaton, definition, parameters, fault)
    if found is not None:
        return found
    time = fault.time * (definition.sizes[-1] if definition and definition.sizes else 1.0)
    problem = f"fails compiled at t = {time:.6g}, and does not where it is interpreted"
    remedy = 'let it run with Options(engine="interpreted")'
    function = _function(automaton, fault.role)
    if definition is None:
        return function.error(problem, remedy)
    return FunctionError(f"a {function.kind} of the system", problem, remedy)


def searched(
    automaton: Automaton, parameters: Sequence[float], point: Place
) -> FunctionError | None:
    """Return the sentence about flow or margins that are no numbers at a point, if they are not."""
    definition = definition_of(automaton)
    if definition is None:
        return None
    tried = Tried(definition, parameters[: len(definition.parameters)])
    return _first(
        lambda: tried.flow(point),
        *(_margin(tried, i, point) for i in range(len(definition.guards))),
    )


def _margin(tried: Tried, i: int, point: Place) -> Callable[[], Any]:
    guard = tried.definition.guards[i]

    def call() -> None:
        if guard.modes is None or point.mode in guard.modes:
            tried.margin(i, point)
            if guard.rate is not None:
                tried.rate(i, point)

    return call


def _by_name(
    automaton: Automaton, definition: Definition, parameters: Sequence[float], fault: Fault
) -> FunctionError | None:
    tried = Tried(definition, parameters[: len(definition.parameters)])
    point = Place(fault.mode, fault.time, fault.y.tolist())
    if fault.role == JACOBIAN:
        return _first(lambda: tried.jacobian(point))
    if fault.role != TRANSITION:
        return searched(automaton, parameters, point)
    m = len(automaton.guards)
    if fault.code == 2 * m:
        return _first(lambda: tried.transition("settle", None, point))
    kind = "transition" if fault.code < m else "rest"
    return _first(lambda: tried.transition(kind, fault.code % m, point))


def _by_array(
    automaton: Automaton, parameters: Sequence[float], fault: Fault
) -> FunctionError | None:
    n, m = len(automaton.states), len(automaton.guards)
    mode, code, t, values = fault.mode, fault.code, fault.time, fault.y.tolist()
    y, p = (
        GuardedVector("y", values, fixed=fault.role != TRANSITION),
        GuardedVector("p", parameters),
    )
    arguments: dict[int, tuple[Any, ...]] = {
        FLOW: (mode, t, y, p, GuardedVector("dy", [None] * n)),
        MARGINS: (mode, t, y, p, GuardedVector("g", [1.0] * m), GuardedVector("r", [1.0] * m)),
        TRANSITION: (mode, code, t, y, p),
        JACOBIAN: (mode, t, y, p, GuardedMatrix("J", n)),
    }
    function = _function(automaton, fault.role)
    try:
        function.call(*arguments[fault.role])
    except Exception as error:
        return function.blamed(error)[0]
    return None


def _function(automaton: Automaton, role: int) -> Function:
    kind = {FLOW: "flow", MARGINS: "margins", TRANSITION: "transition", JACOBIAN: "jacobian"}[role]
    return Function(kind, getattr(automaton, kind))


def _first(*calls: Callable[[], Any]) -> FunctionError | None:
    """Return the first sentence that a call comes to."""
    for call in calls:
        try:
            call()
        except FunctionError as error:
            return error
        except Undefined as found:
            return found.error
    return None
