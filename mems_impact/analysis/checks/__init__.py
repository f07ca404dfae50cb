"""What is tried of a system before it runs: its functions, interpreted, along a short run.

A point that the checks made up themselves refuses nothing. What is wrong whatever the values, a
component that is never written or a mode that there is not, is told wherever it is met; that a
function has no value is told where the user says that runs start, and nowhere else.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Any

from mems_impact.analysis.checks.effects import check_effects
from mems_impact.analysis.checks.jumps import tell_of_fall
from mems_impact.analysis.checks.met import meeting, met
from mems_impact.analysis.checks.short import Short
from mems_impact.analysis.checks.times import Clock
from mems_impact.analysis.observable import Observable
from mems_impact.analysis.terms import Terms
from mems_impact.hybrid.blaming import Function, told
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.tried import Place, Tried, Undefined
from mems_impact.hybrid.written import Definition

__all__ = ["check", "check_end", "meeting", "tell_of_fall"]


def check(
    system: Terms,
    definition: Definition,
    problem: Problem,
    *,
    time: float | None,
    meant: bool,
) -> None:
    """Try the functions of a system along a short run.

    Parameters
    ----------
    system : Terms
        Its names, times and observables.
    definition : Definition
        Its functions.
    problem : Problem
        Its numbers.
    time : float or None
        Typical of it, where the user says so.
    meant : bool
        Whether the user says where runs start.

    Raises
    ------
    FunctionError
        About the first function that does not do what it must.
    InvalidParameter
        If the start is not one of the system's, or is meant and lies beyond an impact.
    """
    check_effects(definition)
    tried, start = _tried(definition, problem), _start(system, problem)
    observables: Sequence[Observable] = vars(system)["observables"]
    seen: set[int] = set()

    def noted(i: int, before: Place, after: Place) -> None:
        for each in observables:
            if definition.guards[i].name in each.at and id(each) not in seen:
                seen.add(id(each))
                both = tried.state(before.y), tried.state(after.y)
                _measured(each, before.mode, before.t, *both, tried.p)

    for each in observables:
        if not each.at:
            _measured(each, tried.state(start.y), tried.p)
    unit = time or problem.time_scale or problem.period
    clock = Clock(system.forcing_period, unit, problem.switches)
    short = Short(tried, clock, noted)
    short.go(start, meant=meant)
    met(system).update(short.looked)


def check_end(system: Terms, definition: Definition, problem: Problem) -> None:
    """Try the margin of the last guard of a definition, that which ends a run, at the start."""
    with contextlib.suppress(Undefined):
        tried = _tried(definition, problem)
        tried.margin(len(definition.guards) - 1, _start(system, problem))


def _tried(definition: Definition, problem: Problem) -> Tried:
    return Tried(definition, problem.parameters[: len(definition.parameters)].tolist())


def _start(system: Terms, problem: Problem) -> Place:
    start = system.instant(None, problem)
    return Place(start.mode, start.time, start.y.tolist())


def _measured(observable: Observable, *arguments: Any) -> None:
    """Raise FunctionError if an observable fails whatever the values, or is no number."""
    function = Function("observable", observable.function, observable.name)
    try:
        value = observable.function(*arguments)
    except Exception as error:
        found, always = function.blamed(error)
        if always:
            raise found from error
        return
    try:
        float(value)
    except (TypeError, ValueError):
        raise function.error(f"returns {told(value)}", "return one number on every path") from None
