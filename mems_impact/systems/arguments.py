"""Validation of the arguments of `System`."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from numbers import Integral
from types import FunctionType
from typing import Any

from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.automaton import Guard
from mems_impact.hybrid.definition import named_tuple, writes_into_arrays
from mems_impact.hybrid.diagnostics.user_functions import UserFunction
from mems_impact.hybrid.problem import Section
from mems_impact.integrators.dual_numbers import Dual
from mems_impact.systems.observables import Observable
from mems_impact.systems.state import Mode, State, is_number, positive, state_from

FUNCTION_KIND = "a function, written with def or lambda"
ARGUMENTS = ("mode", "t", "y", "p")
FORMULAS = "=+-@"  # first characters of formulas in spreadsheets
MATH = "$"  # around formulas in figures
RUN_COLUMNS = ("period", "time", "t", "mode")  # in tables of runs, beside the states


def check_names(**names: Iterable[Any]) -> None:
    """Raise InvalidParameter for a name or unit that a table, model or figure cannot hold."""
    for field, values in names.items():
        for value in values:
            plain = isinstance(value, str) and value.isprintable() and MATH not in value
            if not plain or value.startswith(tuple(FORMULAS)):
                allowed = (
                    f"a text of printable characters other than {MATH} that begins with none of "
                    f"{FORMULAS}"
                )
                raise InvalidParameter(field, value, allowed)


def states(names_or_count: Sequence[str] | int) -> tuple[str, ...]:
    """Return the names of the states; u0, u1, … for a number of states."""
    count: Any = names_or_count
    if _is_integer(count) and count > 0:
        return tuple(f"u{i}" for i in range(count))
    names = as_tuple("states", names_or_count, 'a list of names such as ["x"], or their number')
    if not names:
        raise InvalidParameter("states", names_or_count, "one or more")
    for name in names:
        if not isinstance(name, str):
            raise InvalidParameter("states", name, "each a name")
        if name in RUN_COLUMNS:
            allowed = f"names other than {', '.join(RUN_COLUMNS)}, which are columns of runs"
            raise InvalidParameter("states", name, allowed)
    named_tuple("State", names)
    return names


def numbers(values: Mapping[str, float]) -> dict[str, float]:
    """Return finite numbers by name."""
    if not isinstance(values, Mapping):
        raise InvalidParameter("parameters", values, "numbers by name: {'g': 9.81}")
    for name, value in values.items():
        if not isinstance(name, str):
            raise InvalidParameter("parameters", name, "each with a name")
        if not is_number(value):
            raise InvalidParameter(name, value, "a finite number")
    return {name: float(value) for name, value in values.items()}


def function(field: str, value: Any, *arguments: str) -> Any:
    """Return a Python function that takes these arguments."""
    if not isinstance(getattr(value, "py_func", value), FunctionType):
        raise InvalidParameter(field, value, FUNCTION_KIND)
    if arguments and not _takes(value, len(arguments)):
        count = len(inspect.signature(value).parameters)
        problem = f"takes {count} arguments; it is called with ({', '.join(arguments)})"
        raise InvalidParameter(field, getattr(value, "__name__", value), "", problem=problem)
    return value


def check_flow(value: Any) -> Any:
    """Return the flow, in either of its forms."""
    writes_into_arrays(function("flow", value))
    return value


def transition_arguments(flow: Callable[..., Any]) -> tuple[str, ...]:
    """Return the arguments of transitions that match such a flow."""
    return (*ARGUMENTS, "new") if writes_into_arrays(flow) else ARGUMENTS


def check_optional(field: str, value: Any, *arguments: str) -> Any:
    """Return a Python function that takes these arguments, or None."""
    return None if value is None else function(field, value, *arguments)


def guards(values: Sequence[Guard], changing: Sequence[str]) -> tuple[Guard, ...]:
    """Return guards with unique names, and functions with the right arguments.

    `changing` are the arguments of transitions.
    """
    result = as_tuple("guards", values, "a list of Guard and Impact")
    for guard in result:
        if not isinstance(guard, Guard):
            raise InvalidParameter("guards", guard, "each a Guard or an Impact")
        if not (isinstance(guard.name, str) and guard.name):
            raise InvalidParameter("name of a guard", guard.name, "a text")
        for kind in ("margin", "transition", "rest"):
            value = getattr(guard, kind)
            if kind == "margin" or value is not None:
                arguments = changing if kind in ("transition", "rest") else ARGUMENTS
                function(f"{kind} of {guard.name!r}", value, *arguments)
        if guard.rest is not None and not guard.impact:
            raise InvalidParameter(f"rest of {guard.name!r}", guard.rest, "of an Impact")
        if guard.order is not None and not _is_integer(guard.order):
            raise InvalidParameter(f"order of {guard.name!r}", guard.order, "a whole number")
    names = [guard.name for guard in result]
    if len(set(names)) != len(names):
        raise InvalidParameter("guards", names, "unique names")
    return result


def mode_names(modes: Sequence[Mode | str] | None, guards: Iterable[Guard]) -> tuple[str, ...]:
    """Return the names of all modes, as given or as named by guards."""
    if modes is None:
        watched = [(guard, _modes_of(guard)) for guard in guards]
        name_tuples = {
            mode.names for _, active in watched for mode in active if isinstance(mode, Mode)
        }
        if len(name_tuples) > 1:
            listed = [", ".join(names) for names in name_tuples]
            raise InvalidParameter("modes", listed, "modes of one call of mems_impact.modes")
        names = next(iter(name_tuples), ("free",))
    else:
        names = _mode_names(modes)
    for guard in guards:
        for mode in _modes_of(guard):
            if not 0 <= mode < len(names):
                allowed = f"one of the {len(names)} modes, {', '.join(names)}, from 0"
                raise InvalidParameter(f"modes of {guard.name!r}", int(mode), allowed)
            if isinstance(mode, Mode) and mode.name != names[mode]:
                allowed = f"called {names[mode]}, as in the modes of the system"
                raise InvalidParameter(f"modes of {guard.name!r}", mode.name, allowed)
    return names


def constraints(
    by_mode: Mapping[Any, Any] | None, flow: Callable[..., Any], modes: tuple[str, ...]
) -> tuple[tuple[int, Callable[..., Any]], ...]:
    """Return the constraints of modes: pairs of a mode and a function."""
    if not by_mode:
        return ()
    if not isinstance(by_mode, Mapping):
        raise InvalidParameter("constraints", by_mode, "a mapping of modes to functions")
    if writes_into_arrays(flow):
        allowed = "omitted if the flow writes into an array"
        raise InvalidParameter("constraints", list(by_mode), allowed)
    result = []
    for mode, functions in by_mode.items():
        number = modes.index(mode) if mode in modes else mode
        if not (_is_integer(number) and 0 <= number < len(modes)):
            raise InvalidParameter("constraints", mode, f"of modes among {', '.join(modes)}")
        several = functions if isinstance(functions, tuple | list) else [functions]
        label = f"constraints of {modes[number]!r}"
        result += [(int(number), function(label, each, *ARGUMENTS)) for each in several]
    return tuple(result)


def state_indices(field: str, names: Sequence[str], states: tuple[str, ...]) -> tuple[int, ...]:
    """Return the numbers of states."""
    selected = as_tuple(field, names, f"a list of names among {', '.join(states)}")
    if len(set(selected)) != len(selected):
        raise InvalidParameter(field, list(selected), "names that differ")
    return tuple(_state_index(field, state, states) for state in selected)


def sizes(typical: Mapping[str, float] | None) -> dict[str, float]:
    """Return typical sizes."""
    if typical is not None and not isinstance(typical, Mapping):
        raise InvalidParameter("typical", typical, "sizes by the names of states, units, or 'time'")
    return {name: positive(f"typical {name}", size) for name, size in (typical or {}).items()}


def reject_with_components(**others: Any) -> None:
    """Raise InvalidParameter for an argument that parts determine."""
    for field, value in others.items():
        if value is not None:
            raise InvalidParameter(field, value, "omitted if parts are given, which determine it")


def section(section: tuple[str, float] | None, states: tuple[str, ...]) -> Section | None:
    """Return a section with the number of its state, for both directions."""
    if section is None:
        return None
    pair = isinstance(section, Sequence) and not isinstance(section, str) and len(section) == 2
    if not (pair and is_number(section[1])):
        raise InvalidParameter("section", section, f"a state and its value: ({states[0]!r}, 0.0)")
    return _state_index("section", section[0], states), float(section[1]), 0


def units(by_name: Mapping[str, str] | None, names: Sequence[str]) -> dict[str, str]:
    """Return units by the names of states and parameters and "time"."""
    if by_name is not None and not isinstance(by_name, Mapping):
        raise InvalidParameter("units", by_name, f"units by name: {{{names[0]!r}: 'm'}}")
    for name in by_name or {}:
        if name not in (*names, "time"):
            raise InvalidParameter("units", name, f"names among {', '.join(names)}, time")
    return dict(by_name or {})


def observables(
    values: Sequence[Observable], states: Sequence[str], guards: Sequence[Guard]
) -> tuple[Observable, ...]:
    """Return observables with unique names, at existing guards."""
    result = as_tuple("observables", values, "a list of Observable")
    used_names = set(states)
    events = [guard.name for guard in guards]
    for each in result:
        if not isinstance(each, Observable):
            raise InvalidParameter("observables", each, "each an Observable")
        if not isinstance(each.name, str) or each.name in used_names:
            raise InvalidParameter("observables", each.name, "unique names")
        used_names.add(each.name)
        field = f"at of {each.name!r}"
        for name in as_tuple(field, each.at, "a list of names of guards"):
            if name not in events:
                raise InvalidParameter(field, name, f"one of {', '.join(events) or 'no guards'}")
        arguments = ("mode", "t", "before", "after", "p") if each.at else ("y", "p")
        if not callable(each.function) or not _takes(each.function, len(arguments)):
            allowed = f"a function ({', '.join(arguments)})"
            raise InvalidParameter(f"function of {each.name!r}", each.function, allowed)
    return result


def initial(state: Mapping[str, float] | State | None) -> State:
    """Return the initial state of runs."""
    if state is None or isinstance(state, State):
        return state or state_from({})
    if not isinstance(state, Mapping):
        raise InvalidParameter("initial", state, 'a State, or numbers by name, {"x": …}')
    return state_from(state)


def number(field: str, quantity: Any, p: Any) -> Any:
    """Return a number, or the value of a function of the parameters."""
    value = _evaluated(field, quantity, p) if callable(quantity) else quantity
    if quantity is None:
        return None
    if isinstance(value, Dual):
        return value
    if not is_number(value):
        raise InvalidParameter(field, value, "a finite number, or a function of the parameters")
    return float(value)


def times(field: str, quantity: Any, p: Any) -> tuple[Any, ...]:
    """Return times, or the values of a function of the parameters."""
    value = _evaluated(field, quantity, p) if callable(quantity) else quantity
    numbers = isinstance(value, Iterable) and not isinstance(value, str | Mapping)
    result = tuple(value) if numbers else (None,)
    if not all(isinstance(each, Dual) or is_number(each) for each in result):
        raise InvalidParameter(field, value, "times, or a function of the parameters")
    return tuple(each if isinstance(each, Dual) else float(each) for each in result)


def _evaluated(field: str, function: Callable[..., Any], p: Any) -> Any:
    try:
        return function(p)
    except Exception as error:
        raise UserFunction(field, function).explain_exception(error)[0] from error


def as_tuple(field: str, value: Any, allowed: str) -> tuple[Any, ...]:
    """Return a sequence as a tuple; a string is rejected."""
    if isinstance(value, str | Mapping) or not isinstance(value, Iterable):
        raise InvalidParameter(field, value, allowed)
    return tuple(value)


def _takes(function: Callable[..., Any], count: int) -> bool:
    try:
        inspect.signature(function).bind(*range(count))
    except (TypeError, ValueError):
        return False
    return True


def _is_integer(value: Any) -> bool:
    return isinstance(value, Integral) and not isinstance(value, bool)


def _modes_of(guard: Guard) -> tuple[Any, ...]:
    """Return the modes in which a guard is active, empty for all."""
    if guard.modes is None:
        return ()
    field, allowed = (
        f"modes of {guard.name!r}",
        "a tuple of modes as mems_impact.modes gives them, or None for all of them",
    )
    modes = as_tuple(field, guard.modes, allowed)
    if not modes or not all(map(_is_integer, modes)) or len(set(modes)) != len(modes):
        raise InvalidParameter(field, guard.modes, allowed)
    return modes


def _mode_names(modes: Any) -> tuple[str, ...]:
    allowed = "the modes of the system: mems_impact.modes('free', 'held')"
    values = as_tuple("modes", modes, allowed)
    names = tuple(mode.name if isinstance(mode, Mode) else mode for mode in values)
    if not names or not all(isinstance(name, str) and name for name in names):
        raise InvalidParameter("modes", modes, allowed)
    if len(set(names)) != len(names):
        raise InvalidParameter("modes", list(names), "unique names")
    for i, mode in enumerate(values):
        if isinstance(mode, Mode) and mode != i:
            raise InvalidParameter("modes", list(names), "in the order of their numbers")
    return names


def _state_index(field: str, state: Any, states: tuple[str, ...]) -> int:
    """Return the number of a state."""
    if state not in states:
        raise InvalidParameter(field, state, f"one of {', '.join(states)}")
    return states.index(state)
