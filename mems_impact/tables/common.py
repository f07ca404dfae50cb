"""What all tables share: headings, units, provenance, running time, words for numbers.

Headings are symbols and plain words, the same whatever the units: these stand in
``table.attrs["units"]`` by heading, and beside the headings where a table is printed or written
(`with_units`). ``period`` and ``time`` say when within the forcing, ``t`` counts from the start of
period 0.
"""

from __future__ import annotations

import re
from collections.abc import Container, Mapping, Sequence
from functools import cache
from importlib.metadata import version
from types import MappingProxyType
from typing import Any, Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from mems_impact.hybrid import loop
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.problem import Section
from mems_impact.hybrid.trajectory import Events, Floats

__all__ = [
    "CHATTER_ENDS",
    "DRIVE_SWITCHES",
    "END",
    "Labels",
    "bare",
    "captions",
    "event_codes",
    "event_words",
    "is_shown",
    "name_of",
    "states",
    "table",
    "unit_of",
    "when",
    "with_units",
    "words",
]

CHATTER_ENDS = "chatter ends"
DRIVE_SWITCHES = "drive switches"
END = "end of the run"
SUFFIXES = (
    "before", "after", "min", "max", "mean", "std", "apart", "from", "to", "gain", "final",
)  # fmt: skip
TIMES = ("time", "t", "start", "end")


class Labels(Protocol):
    """What tables need of a system: its names, and its units."""

    @property
    def automaton(self) -> Automaton:
        """Names of states, modes and guards."""

    @property
    def units(self) -> Mapping[str, str]:
        """Units by heading; none for a pure number."""

    def out(self, heading: str, value: Any) -> Any:
        """From the units of the numerics to these, by heading."""

    @property
    def forced(self) -> bool:
        """Whether there are forcing periods to be counted."""

    @property
    def shown(self) -> tuple[str, ...]:
        """The states by which orbits are shown."""

    @property
    def section(self) -> Section | None:
        """The Poincaré section: component, level, direction."""

    @property
    def symbols(self) -> Mapping[str, str]:
        """Symbols of parameters, where they are not to be read off the names."""


def table(
    columns: Mapping[str, Any],
    labels: Labels,
    *,
    given: Mapping[str, Any] = MappingProxyType({}),
    **attributes: Any,
) -> pd.DataFrame:
    """Return a table of columns in the units of the numerics, in the units of the system.

    Parameters
    ----------
    columns : mapping of str to array
    labels : Labels
    given : mapping of str to array, optional
        Columns that are in the units of the system already; they come first.
    **attributes
        For ``table.attrs``, beside units and versions.
    """
    units = {name: unit_of(name, labels.units) for name in (*given, *columns)}
    shown = {name: labels.out(name, values) for name, values in columns.items()}
    result = pd.DataFrame({**given, **shown})
    result.attrs = {
        "units": {name: unit for name, unit in units.items() if unit},
        "system": repr(labels),
        "mems_impact": _version(),
        **attributes,
    }
    return result


def captions(labels: Labels) -> dict[str, Any]:
    """Return what figures say of a table of orbits or sweeps, for its ``attrs``."""
    section = labels.section
    equation: list[Any] = []
    if section is not None:
        name = labels.automaton.states[section[0]]
        equation = [name, float(labels.out(name, section[1]))]
    forced = {} if labels.forced else {"forced": False}
    told = {"states": list(labels.shown), "section": equation, "symbols": dict(labels.symbols)}
    return {**told, **forced}


@cache
def _version() -> str:
    return version("mems_impact")


def unit_of(heading: str, units: Mapping[str, str]) -> str:
    """Return the unit of a column: of ``v2 before`` and ``v2 3`` that of ``v2``."""
    return units.get(name_of(heading, units), "")


def name_of(heading: str, names: Container[str]) -> str:
    """Return what a column is about: ``v2 before`` and ``v2 3`` about ``v2``; empty if nothing."""
    if heading in TIMES:
        return "time"
    while heading not in names:
        first, _, last = heading.rpartition(" ")
        if not first or not (last in SUFFIXES or last.isdigit()):
            return ""
        heading = first
    return heading


def with_units(shown: pd.DataFrame) -> pd.DataFrame:
    """Return a table whose headings carry their units, ``x1 [m]``: to be printed or written."""
    units = shown.attrs.get("units", {})
    return shown.rename(
        columns={name: f"{name} [{unit}]" for name, unit in units.items() if name in shown}
    )


def bare(shown: pd.DataFrame) -> pd.DataFrame:
    """Return a table with units in ``attrs`` alone, be it read from a file that `with_units` wrote.

    Others are returned as they are.
    """
    pairs = {name: re.fullmatch(r"(.+) \[(.+)\]", str(name)) for name in shown.columns}
    found = {name: (match[1], match[2]) for name, match in pairs.items() if match}
    if not found:
        return shown
    result = shown.rename(columns={name: plain for name, (plain, _) in found.items()})
    result.attrs = {**shown.attrs, "units": dict(found.values())}
    return result


def when(cycle: NDArray[np.int64], time: Floats, period: float, labels: Labels) -> dict[str, Any]:
    """Return the columns that say when: period, time within it, and running time.

    The running time alone where nothing forces the system.
    """
    running = {"t": cycle * period + time}
    return {"period": cycle, "time": time, **running} if labels.forced else running


def states(names: Sequence[str], y: Floats, suffix: str = "") -> dict[str, Any]:
    """Return one column a component of the state."""
    return {f"{name}{suffix}": y[:, i] for i, name in enumerate(names)}


def words(names: Sequence[str], numbers: NDArray[np.int64]) -> Any:
    """Return names for numbers, as categories: a mode is one of nine words, a million times."""
    return pd.Categorical.from_codes(numbers, categories=list(names))


def event_words(automaton: Automaton) -> tuple[str, ...]:
    """Return what rows of the event log are called, by `event_codes`; and what comes after."""
    return (*(guard.name for guard in automaton.guards), CHATTER_ENDS, DRIVE_SWITCHES, END)


def event_codes(log: Events, automaton: Automaton) -> NDArray[np.int64]:
    """Return what happened in each row that is shown: places in `event_words`."""
    m = len(automaton.guards)
    codes = np.where(log.kind == loop.ACCUMULATION, m, log.guard)
    return np.where(log.kind == loop.SWITCH, m + 1, codes)


def is_shown(log: Events) -> NDArray[np.bool_]:
    """Return where the rows of the log are events to a user: what ends an arc."""
    shown: NDArray[np.bool_] = np.isin(log.kind, (loop.TRANSITION, loop.ACCUMULATION, loop.SWITCH))
    return shown
