"""Systems that are written as Python code: in a file, a module, or another package."""

from __future__ import annotations

import sys
from importlib import import_module
from os import PathLike
from pathlib import Path
from typing import Any

from mems_impact import plugins
from mems_impact.actuator.code import Wanted, run_code
from mems_impact.analysis.system import System
from mems_impact.errors import InvalidFile, InvalidParameter

__all__ = ["is_system_name", "load_system", "made_system", "system_names"]

WHAT = (
    'name in Python code, "FILE.py:NAME" or "MODULE:NAME", of a System or of a function that makes '
    "one"
)
CODE = Wanted(field="system", what=WHAT, kind="command line", reader="load_system")


def load_system(name: str) -> System:
    """Load a system that Python code defines.

    Parameters
    ----------
    name : str
        ``"FILE.py:NAME"`` or ``"MODULE:NAME"``: the name in a file, or in a module that can be
        imported from the working directory or is installed, of a `System` or of a function without
        arguments that makes one. Or the name of a system that another package adds by an entry
        point of the group ``mems_impact.systems``. The code is run, and can do all that you can.

    Returns
    -------
    System

    Raises
    ------
    InvalidParameter
        If it is no such name.
    InvalidFile
        If the code fails, or holds no such system.

    See Also
    --------
    load_actuator, load_drive, load_study

    Examples
    --------
    >>> from pathlib import Path
    >>> import mems_impact as mi
    >>> _ = Path("decay.py").write_text('''
    ... import mems_impact as mi
    ... def flow(mode, t, y, p):
    ...     return (-y.x,)
    ... decay = mi.System(states=("x",), flow=flow, initial={"x": 1.0})
    ... ''')
    >>> mi.load_system("decay.py:decay").states
    ('x',)
    """
    place, colon, attribute = name.rpartition(":") if isinstance(name, str) else ("", "", "")
    if isinstance(name, str) and not colon:
        return _added(name)
    if not place or not attribute.isidentifier():
        raise InvalidParameter("system", name, f"a {WHAT}")
    if place.endswith(".py"):
        path = Path(place)
        if not path.is_file():
            raise InvalidFile(place, "no such file", f"give a {WHAT}")
        module = run_code(path, CODE)
    else:
        module = _imported(place)
    return made_system(getattr(module, attribute, None), place, attribute)


def is_system_name(name: str) -> bool:
    """Return whether that may be the name of a system, rather than of a device."""
    place, colon, attribute = name.rpartition(":")
    return name in system_names() or bool(colon and place and attribute.isidentifier())


def system_names() -> tuple[str, ...]:
    """Return the names of the systems that other packages add."""
    return plugins.names(plugins.SYSTEMS)


def made_system(found: Any, place: str | PathLike[str], name: str) -> System:
    """Return the system that code holds, or that its function makes; InvalidFile if it is none."""
    if callable(found) and not isinstance(found, System):
        try:
            found = found()
        except Exception as error:
            reason = f"{name}() fails ({type(error).__name__}: {error})"
            raise InvalidFile(place, reason, f"give a {WHAT}") from None
    if not isinstance(found, System):
        raise InvalidFile(place, f"holds no system {name}", f"give a {WHAT}")
    return found


def _added(name: str) -> System:
    found = plugins.plugin(plugins.SYSTEMS, name, _may_be_system, "a System or a function")
    if found is None:
        known = ", ".join(system_names())
        raise InvalidParameter("system", name, f"{f'one of {known}, or ' if known else ''}a {WHAT}")
    return made_system(found, name, name)


def _may_be_system(found: Any) -> bool:
    return isinstance(found, System) or callable(found)


def _imported(name: str) -> Any:
    """Return a module, looked for in the working directory too."""
    here = str(Path.cwd())
    sys.path.insert(0, here)
    try:
        return import_module(name)
    except (Exception, SystemExit) as error:
        reason = f"cannot be imported ({type(error).__name__}: {error})"
        raise InvalidFile(name, reason, f"give a {WHAT}") from None
    finally:
        sys.path.remove(here)
