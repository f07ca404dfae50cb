"""What is explored: a system at the numbers it starts with, and how Python makes it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path

from mems_impact.actuator.code import Wanted, run_code
from mems_impact.actuator.drive import Drive
from mems_impact.actuator.drives.sine import Sine
from mems_impact.actuator.parameters import Actuator, load_actuator
from mems_impact.actuator.system import ActuatorSystem, kicked
from mems_impact.analysis.simulate import simulate
from mems_impact.analysis.state import State
from mems_impact.analysis.system import System
from mems_impact.engines.options import Options
from mems_impact.errors import InvalidFile, InvalidParameter, RunError

__all__ = ["Subject", "of_code", "of_device", "usual_sine"]

CODE = Wanted(
    field="system",
    what='name in a Python file or module, "FILE.py:NAME" or "MODULE:NAME", of a System or of a '
    "function that makes one",
    kind="command line",
    reader="",
)
OPTIONS = Options(method="auto")
TRIED = 60  # forcing periods


@dataclass(frozen=True, kw_only=True)
class Subject:
    """What is explored.

    Attributes
    ----------
    system : System
        At the numbers with which the page opens.
    title : str
    imports : str
        Lines of Python besides ``import mems_impact as mi``.
    making : callable
        ``making(system)`` returns the lines of Python that make `system`, this one at other
        numbers, under the name ``system``.
    starts : mapping of str to callable
        Where runs may start, by name: ``start(system)`` is the state, None for the system's own.
    groups : mapping of str to tuple of str
        The parameters, by the heading under which their sliders stand.
    sizes : mapping of str to float
        How far the slider of a parameter goes that is 0, where 1 in the units of the numerics is
        not a good guess.
    options : Options
        How runs are integrated.
    """

    system: System
    title: str
    imports: str = ""
    making: Callable[[System], str] = field(repr=False)
    starts: Mapping[str, Callable[[System], State | None]] = field(repr=False)
    groups: Mapping[str, tuple[str, ...]]
    sizes: Mapping[str, float] = field(default_factory=dict)
    options: Options = OPTIONS


def usual_sine(actuator: Actuator) -> dict[str, float]:
    """Return amplitude and omega of a sine under which a device strikes, in its units.

    The paper's working point, f = 0.24 and omega = 0.5 where m2 = k = d = alpha = 1, to two digits;
    twice or four times the voltage where that is not enough.
    """
    scales = actuator.scales
    omega = float(f"{scales.out(0.5, 'rad/s'):.2g}")
    found = {}
    for amplitude in (0.24, 0.48, 0.96):
        found = {"amplitude": float(f"{scales.out(amplitude, 'V'):.2g}"), "omega": omega}
        system = actuator.under(Sine(**found))
        try:
            run = simulate(system, TRIED, initial=kicked(actuator), options=OPTIONS)
        except RunError:
            continue
        if run.statistics["impacts"] > 0:
            break
    return found


def of_device(
    name: str,
    actuator: Actuator,
    drive: Drive,
    *,
    drive_source: str = "",
    options: Options = OPTIONS,
) -> Subject:
    """Return an actuator under a drive, to be explored.

    Parameters
    ----------
    name : str
        Preset or path, from which `actuator` was loaded and then changed or not.
    actuator : Actuator
    drive : Drive
    drive_source : str, optional
        Python that makes the drive but for its numbers, ``mi.load_drive("wave.toml")``; the
        waveform's class by default.
    options : Options, optional
        How runs are integrated.
    """
    loaded = load_actuator(name)

    def making(system: System) -> str:
        assert isinstance(system, ActuatorSystem)
        lines = [
            f"actuator = mi.load_actuator({name!r}){_setting(loaded, system.actuator)}",
            f"drive = {_drive_source(system.drive, drive_source)}",
            "system = actuator.under(drive)",
        ]
        return "\n".join(lines)

    def kick(system: System) -> State:
        assert isinstance(system, ActuatorSystem)
        return kicked(system.actuator)

    system = actuator.under(drive)
    groups = {"drive": drive.names}
    for each in system.parameters:
        if each not in drive.names:
            owner = each.partition(".")[0] if "." in each else "device"
            groups[owner] = (*groups.get(owner, ()), each)
    volts = [abs(drive.number(each)) for each in drive.names if drive.unit(each) == "V"]
    amplitude = max(volts, default=0.0)
    return Subject(
        system=system,
        title=Path(name).stem,
        groups=groups,
        making=making,
        starts={"rest": lambda system: None, "kicked": kick},
        sizes={
            each: math.pi if each.endswith("phase") else amplitude
            for each in drive.names
            if each.endswith("phase") or drive.unit(each) == "V"
        },
        options=options,
    )


def of_code(
    source: str, changes: Mapping[str, float] | None = None, options: Options = OPTIONS
) -> Subject:
    """Return a system that Python code defines, to be explored.

    Parameters
    ----------
    source : str
        ``"FILE.py:NAME"`` or ``"MODULE:NAME"``: the name is that of a System, or of a function
        without arguments that makes one. The code is run.
    changes : mapping of str to float, optional
        Other values of some parameters.
    options : Options, optional
        How runs are integrated.

    Raises
    ------
    InvalidParameter
        If it is no such name.
    InvalidFile
        If the code fails, or holds no such system.
    """
    place, _, name = source.rpartition(":")
    if not place or not name.isidentifier():
        raise InvalidParameter("system", source, f"a {CODE.what}")
    in_file = place.endswith(".py")
    if in_file:
        path = Path(place).resolve()
        if not path.is_file():
            raise InvalidFile(place, "no such file", f"give a {CODE.what}")
        found = getattr(run_code(path, CODE), name, None)
    else:
        found = _imported(place, name)
    called = callable(found) and not isinstance(found, System)
    if callable(found) and called:
        try:
            found = found()
        except Exception as error:
            reason = f"{name}() fails ({type(error).__name__}: {error})"
            raise InvalidFile(place, reason, f"give a {CODE.what}") from None
    if not isinstance(found, System):
        raise InvalidFile(place, f"holds no system {name}", f"give a {CODE.what}")
    begin: System = found
    loading = f"runpy.run_path({place!r})[{name!r}]" if in_file else name
    made = f"system = {loading}{'()' if called else ''}"

    def making(system: System) -> str:
        changed = _differing(system.parameters, begin.parameters)
        return f"{made}.changed(**{changed!r})" if changed else made

    return Subject(
        system=begin.changed(**changes) if changes else begin,
        title=begin.name or name,
        imports="import runpy" if in_file else f"from {place} import {name}",
        making=making,
        starts={"given": lambda system: None},
        groups={"parameters": tuple(begin.parameters)},
        options=options,
    )


def _imported(module: str, name: str) -> object:
    """Return what a module defines, looking for it in the working directory too."""
    import sys

    here = str(Path.cwd())
    sys.path.insert(0, here)
    try:
        return getattr(import_module(module), name, None)
    except (Exception, SystemExit) as error:
        reason = f"cannot be imported ({type(error).__name__}: {error})"
        raise InvalidFile(module, reason, f"give a {CODE.what}") from None
    finally:
        sys.path.remove(here)


def _setting(loaded: Actuator, actuator: Actuator) -> str:
    """Return what Python calls to change the numbers of a loaded device to those of another."""
    changed = _differing(_numbers(actuator), _numbers(loaded))
    return f".setting({changed!r})" if changed else ""


def _numbers(actuator: Actuator) -> dict[str, float]:
    own = {name: value for name, value in dict(actuator).items() if isinstance(value, float)}
    of_terms = {
        f"{term.name()}.{name}": getattr(term, name)
        for term in actuator.terms
        for name in term.names
    }
    return {**own, **of_terms}


def _drive_source(drive: Drive, source: str) -> str:
    values = {name: drive.number(name) for name in drive.names}
    if source:
        return f"{source}.varied({values!r})"
    given = ", ".join(f"{name}={value!r}" for name, value in values.items())
    return f"mi.{type(drive).__name__}({given})"


def _differing(here: Mapping[str, float], there: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in here.items() if there.get(name) != value}
