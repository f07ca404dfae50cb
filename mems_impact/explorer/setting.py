"""The state of a page, and its address: what a link has to say so that it shows the same."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any
from urllib.parse import urlencode

from mems_impact.analysis.state import State
from mems_impact.analysis.system import System
from mems_impact.errors import InvalidParameter
from mems_impact.explorer.subject import Subject
from mems_impact.wording import label

__all__ = ["LONGEST", "SHORTEST", "PageSetting", "address_of", "first_setting", "setting_at"]

SHORTEST, LONGEST = 1.0, 1000.0  # of a run, in forcing periods or units of time
USUAL = 100.0
PREFIX = "show."  # of the page's own words, lest a parameter has the same name
TIME = "t"


@dataclass(frozen=True, kw_only=True)
class PageSetting:
    """What a page shows.

    Attributes
    ----------
    values : mapping of str to float
        All parameters of the system.
    length : float
        Of the run, in forcing periods, or in the system's `unit_of_time` where nothing forces it.
    start : str
        Where it starts: a name among those of the subject.
    parameter : str
        Over which the bifurcation diagram is drawn.
    x, y : str
        States that span the phase plane, or "t".
    """

    values: Mapping[str, float]
    length: float
    start: str
    parameter: str
    x: str
    y: str

    def with_value(self, name: str, value: float) -> PageSetting:
        """Return the setting with another value of a parameter."""
        return replace(self, values={**self.values, name: value})

    def system(self, subject: Subject) -> System:
        """Return the system at these values; InvalidParameter if it does not allow them."""
        return subject.system.changed(**self.values)

    def initial(self, subject: Subject, system: System) -> State | None:
        """Return where the run starts."""
        return subject.starts[self.start](system)


def unit_of_time(system: System) -> float:
    """Return what the length of a run counts in: the forcing period, or a typical time."""
    period = system.forcing_period
    return period if period is not None else float(system.out("time", system.numbers().period))


def first_setting(subject: Subject) -> PageSetting:
    """Return what a page shows whose address says nothing."""
    system = subject.system
    x, y = _plane(system)
    names = tuple(system.parameters)
    return PageSetting(
        values=system.parameters,
        length=USUAL,
        # Of a device that rests there is nothing to see.
        start=tuple(subject.starts)[-1],
        parameter=names[0] if names else "",
        x=x,
        y=y,
    )


def address_of(subject: Subject, setting: PageSetting) -> str:
    """Return the query of a page's address: every number to the last digit."""
    words = {f"{PREFIX}{name}": text for name, text in _words(subject, setting).items()}
    return urlencode({**{name: repr(value) for name, value in setting.values.items()}, **words})


def setting_at(subject: Subject, query: Mapping[str, Iterable[str]]) -> PageSetting:
    """Return the setting that the query of an address tells; what it leaves out is as at first.

    Raises
    ------
    InvalidParameter
        If it names what there is not, or the system does not allow a value.
    """
    first = first_setting(subject)
    values = dict(first.values)
    changes: dict[str, Any] = {}
    choices = _choices(subject)
    for name, given in query.items():
        text = _one(name, tuple(given))
        word = name.removeprefix(PREFIX)
        if name in values:
            values[name] = _number(name, text)
        elif name.startswith(PREFIX) and word in choices:
            field, known = choices[word]
            changes[field] = _chosen(name, text, known) if known else _length(name, text)
        else:
            known = (*values, *(f"{PREFIX}{each}" for each in choices))
            raise InvalidParameter(label(name), None, "", problem=f"none of {', '.join(known)}")
    found = replace(first, values=values, **changes)
    found.system(subject)
    return found


def length_word(system: System) -> str:
    """Return what the length of a run is called."""
    return "periods" if system.forced else "duration"


def planes(system: System) -> tuple[str, ...]:
    """Return what a phase plane may be spanned by."""
    return (*system.states, TIME)


def _words(subject: Subject, setting: PageSetting) -> dict[str, str]:
    """Return the page's own words and what they are set to."""
    return {
        word: str(getattr(setting, field)).removesuffix(".0")
        for word, (field, _) in _choices(subject).items()
    }


def _choices(subject: Subject) -> dict[str, tuple[str, tuple[str, ...]]]:
    """Return by word the field of a setting, and what it may be; nothing for the length."""
    system = subject.system
    found = {
        length_word(system): ("length", ()),
        "start": ("start", tuple(subject.starts)),
        "x": ("x", planes(system)),
        "y": ("y", planes(system)),
    }
    names = tuple(system.parameters)
    return {**found, "parameter": ("parameter", names)} if names else found


def _plane(system: System) -> tuple[str, str]:
    """Return the two states by which a motion is shown at first."""
    shown = system.shown[0] if system.shown else system.states[0]
    if system.section is not None and system.states[system.section[0]] != shown:
        return system.states[system.section[0]], shown
    cyclic = {system.states[i] for i in system.automaton.cyclic}
    free = [name for name in system.states if name not in cyclic] or list(system.states)
    return (free[0], free[1]) if len(free) > 1 else (TIME, free[0])


def _one(name: str, given: tuple[str, ...]) -> str:
    if len(given) != 1:
        raise InvalidParameter(label(name), None, "", problem=f"given {len(given)} times, not once")
    return given[0]


def _number(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise InvalidParameter(name, text, "a finite number")
    return value


def _length(name: str, text: str) -> float:
    value = _number(name, text)
    if not SHORTEST <= value <= LONGEST:
        raise InvalidParameter(name, value, f"between {SHORTEST:g} and {LONGEST:g}")
    return value


def _chosen(name: str, text: Any, known: tuple[str, ...]) -> str:
    if text not in known:
        raise InvalidParameter(name, text, f"one of {', '.join(known)}")
    return str(text)
