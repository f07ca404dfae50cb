"""Entry points of other packages.

A package declares its plugins in its ``pyproject.toml``, for example::

    [project.entry-points."mems_impact.drives"]
    chirp = "their_package.chirp:Chirp"

Names are read from metadata; objects are imported on first use. Names of this package take
precedence. A plugin that fails is ignored, with a `PluginWarning`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from mems_impact._util.formatting import shown
from mems_impact._util.warning_scopes import warn
from mems_impact.errors import PluginWarning

SYSTEM_GROUP = "mems_impact.systems"
DRIVE_GROUP = "mems_impact.drives"
TERM_GROUP = "mems_impact.terms"
COMMAND_GROUP = "mems_impact.commands"


def names(group: str, own_names: Iterable[str] = ()) -> tuple[str, ...]:
    """Return the names of a group: those of this package, then those of other packages, sorted."""
    first = tuple(own_names)
    return (*first, *sorted(_found(group).keys() - first))


def plugin(group: str, name: str, is_one: Callable[[Any], bool], description: str) -> Any:
    """Return the plugin of another package by name; None if there is none, or it fails.

    `group` is an entry point group; `is_one` judges an object, and `description` says what is
    valid: "a subclass of Drive".
    """
    entry = _found(group).get(name)
    if entry is None:
        return None
    try:
        found = entry.load()
    except (Exception, SystemExit) as error:
        return _failed(entry, f"fails ({type(error).__name__}: {error})")
    return found if is_one(found) else _failed(entry, f"is not {description}")


@cache
def _found(group: str) -> dict[str, EntryPoint]:
    return {entry.name: entry for entry in entry_points(group=group)}


def _failed(entry: EntryPoint, reason: str) -> None:
    package = entry.dist.name if entry.dist is not None else entry.module
    problem = f"{entry.name} ({shown(entry.value)}) of the package {package} {reason}"
    message = f"{problem}; it is ignored: repair or remove the package"
    warn(" ".join(message.split()), PluginWarning, entry.name)
