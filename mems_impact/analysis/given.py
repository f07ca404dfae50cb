"""What a user gives of a system, checked; all raise InvalidParameter."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from mems_impact.analysis.modes import Mode
from mems_impact.analysis.state import is_number
from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.automaton import Guard
from mems_impact.hybrid.problem import Section

__all__ = ["alone_with_parts", "function", "guards", "mode_names", "numbers", "place", "section"]


def numbers(values: Mapping[str, float]) -> dict[str, float]:
    """Return finite numbers by name."""
    for name, value in values.items():
        if not is_number(value):
            raise InvalidParameter(name, value, "a finite number")
    return {name: float(value) for name, value in values.items()}


def function(field: str, value: Any) -> Any:
    """Return a function."""
    if not callable(value):
        raise InvalidParameter(field, value, "a function")
    return value


def guards(guards: Sequence[Guard]) -> tuple[Guard, ...]:
    """Return guards that each have a name and a margin."""
    for guard in guards:
        if not isinstance(guard, Guard):
            raise InvalidParameter("guards", guard, "each a Guard or an Impact")
        function(f"margin of {guard.name!r}", guard.margin)
    names = [guard.name for guard in guards]
    if len(set(names)) != len(names):
        raise InvalidParameter("guards", names, "a name of its own for each")
    return tuple(guards)


def mode_names(given: Sequence[Mode | str] | None, guards: Iterable[Guard]) -> tuple[str, ...]:
    """Return the names of all modes, from what is given or from what guards name."""
    if given is not None:
        return tuple(mode.name if isinstance(mode, Mode) else str(mode) for mode in given)
    found = {mode.names for guard in guards for mode in guard.modes or () if isinstance(mode, Mode)}
    if len(found) > 1:
        known = [", ".join(names) for names in found]
        raise InvalidParameter("modes", known, "those of one call of mems_impact.modes")
    return next(iter(found), ("free",))


def alone_with_parts(**others: Any) -> None:
    """Raise InvalidParameter if something is given that parts say."""
    for field, value in others.items():
        if value is not None:
            raise InvalidParameter(field, value, "left out where parts are given, which say it")


def place(field: str, state: str, states: tuple[str, ...]) -> int:
    """Return the number of a state."""
    if state not in states:
        raise InvalidParameter(field, state, f"one of {', '.join(states)}")
    return states.index(state)


def section(section: tuple[str, float] | None, states: tuple[str, ...]) -> Section | None:
    """Return a section with the number of its state; in either direction."""
    if section is None:
        return None
    state, level = section
    return place("section", state, states), float(level), 0
