"""What is explored: a system at the numbers it starts with, and how Python makes it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from mems_impact.actuator.drives import Drive
from mems_impact.actuator.drives.sine import Sine
from mems_impact.actuator.own_system import load_system
from mems_impact.actuator.parameters import Actuator, load_actuator
from mems_impact.actuator.system import ActuatorSystem, kicked
from mems_impact.analysis.simulate import simulate
from mems_impact.analysis.state import State
from mems_impact.analysis.system import System
from mems_impact.engines.options import Options
from mems_impact.errors import RunError

__all__ = ["Subject", "of_code", "of_device", "usual_sine"]

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
            *_imports(system.drive, drive_source),
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
    name: str, changes: Mapping[str, float] | None = None, options: Options = OPTIONS
) -> Subject:
    """Return a system that Python code defines, to be explored.

    Parameters
    ----------
    name : str
        As `mems_impact.load_system` takes it: "FILE.py:NAME", for example. The code is run.
    changes : mapping of str to float, optional
        Other values of some parameters.
    options : Options, optional
        How runs are integrated.
    """
    begin = load_system(name)

    def making(system: System) -> str:
        changed = _differing(system.parameters, begin.parameters)
        changing = f".changed(**{changed!r})" if changed else ""
        return f"system = mi.load_system({name!r}){changing}"

    return Subject(
        system=begin.changed(**changes) if changes else begin,
        title=begin.name or name.rpartition(":")[2],
        making=making,
        starts={"given": lambda system: None},
        groups={"parameters": tuple(begin.parameters)},
        options=options,
    )


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
    owner = "" if _imports(drive, source) else "mi."
    return f"{owner}{type(drive).__name__}({given})"


def _imports(drive: Drive, source: str) -> list[str]:
    """Return what is to be imported of a waveform that another package adds."""
    kind = type(drive)
    if source or kind.__module__.partition(".")[0] == "mems_impact":
        return []
    return [f"from {kind.__module__} import {kind.__name__}"]


def _differing(here: Mapping[str, float], there: Mapping[str, float]) -> dict[str, float]:
    return {name: value for name, value in here.items() if there.get(name) != value}
