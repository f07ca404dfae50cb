"""What a page shows of one run: arrays, ready to be drawn."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

import mems_impact as mi
from mems_impact.actuator.modes import slips
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.analysis.run import Run
from mems_impact.analysis.system import System
from mems_impact.explorer.latest import Watch
from mems_impact.explorer.motion import Motion, counts_of, motion_of, times_of
from mems_impact.explorer.setting import TIME, PageSetting, unit_of_time
from mems_impact.explorer.subject import Subject
from mems_impact.explorer.warned import gathered
from mems_impact.hybrid.trajectory import Floats

__all__ = ["Cycles", "Picture", "picture_of"]

SHOWN = 6.0  # forcing periods of the motion over time
PER_PERIOD = 200
UNFORCED = 5.0  # units of time that are shown like a forcing period, where nothing forces
PER_UNIT = round(PER_PERIOD / UNFORCED)
SETTLED = 0.5  # part of a run after which its crossings of the section are shown


@dataclass(frozen=True, kw_only=True)
class Cycles:
    """What comes cycle by cycle: of an actuator, how far the frame gets in each forcing period.

    Attributes
    ----------
    number : ndarray
        Of the forcing periods or of the crossings of the section, shape (n,).
    value : ndarray
        Shape (n,).
    what : str
        The name of the values.
    name : str
        The state or column whose unit they have.
    speed : float
        What a value is to be divided by for the speed; 0 where that has no meaning.
    events : ndarray
        Impacts, or events where nothing strikes, in each forcing period; empty without forcing.
    counted : str
        What `events` are.
    """

    number: Floats
    value: Floats
    what: str
    name: str
    speed: float
    events: Floats
    counted: str


@dataclass(frozen=True, kw_only=True)
class Picture:
    """What a page shows of a run.

    Attributes
    ----------
    setting : PageSetting
    run : Run
    motion : Motion
        The last part of the run.
    voltages : tuple of ndarray
        Of an actuator, at the frames of the motion: to the right, and to the left if there is one.
    section : mapping of str to ndarray
        ``t`` and the states at crossings of the Poincaré section, or where forcing periods begin,
        in the settled part of the run.
    cycles : Cycles
    unit : float
        What the axis of time counts in.
    seconds : float
        How long it took to compute.
    warnings : tuple of str
        What the run warned of.
    """

    setting: PageSetting
    run: Run = field(repr=False)
    motion: Motion = field(repr=False)
    voltages: tuple[Floats, ...] = field(repr=False)
    section: Mapping[str, Floats] = field(repr=False)
    cycles: Cycles = field(repr=False)
    unit: float
    seconds: float
    warnings: tuple[str, ...] = ()

    @property
    def system(self) -> System:
        """The system that was run."""
        return self.run.system

    @property
    def slips(self) -> tuple[tuple[float, float], ...]:
        """Start and end of each stretch in which the frame of an actuator slips."""
        if not isinstance(self.system, ActuatorSystem):
            return ()
        stretches = self.motion.stretches
        return tuple((t0, t1) for mode, t0, t1 in stretches if slips(mode))


def picture_of(subject: Subject, setting: PageSetting, watch: Watch | None = None) -> Picture:
    """Run the system of a setting and gather what is shown of it.

    Parameters
    ----------
    subject : Subject
    setting : PageSetting
    watch : callable, optional
        Called while the run goes on; what it raises ends it.

    Raises
    ------
    InvalidParameter
        If the system does not allow the values.
    RunError
        If the run fails.
    """
    begin = time.perf_counter()
    system = setting.system(subject)
    unit = unit_of_time(system)
    with gathered() as warned:
        run = mi.simulate(
            system,
            **run_length(system, setting, unit),
            initial=setting.initial(subject, system),
            options=subject.options,
            progress=watch or False,
        )
    begin_of, end_of = run.extent
    shown, samples = (SHOWN, PER_PERIOD) if system.forced else (SHOWN * UNFORCED, PER_UNIT)
    motion = motion_of(run, states_shown(system, setting), samples, max(begin_of, end_of - shown))
    return Picture(
        setting=setting,
        run=run,
        motion=motion,
        voltages=_voltages(system, motion),
        section=_section(run),
        cycles=_cycles(run, unit),
        unit=unit if system.forced else 1.0,
        seconds=time.perf_counter() - begin,
        warnings=tuple(dict.fromkeys(warned)),
    )


def run_length(system: System, setting: PageSetting, unit: float) -> dict[str, Any]:
    """Return the length of the run as `simulate` takes it."""
    if system.forced:
        return {"periods": setting.length}
    return {"duration": setting.length * unit}


def states_shown(system: System, setting: PageSetting) -> tuple[str, ...]:
    """Return the states that any part of the page shows, those over time first."""
    over_time = ("x2", "x1") if isinstance(system, ActuatorSystem) else (setting.x, setting.y)
    names = (*over_time, setting.x, setting.y, *system.shown[:1])
    return tuple(name for name in dict.fromkeys(names) if name != TIME)


def series_shown(system: System, setting: PageSetting) -> tuple[str, ...]:
    """Return the states that are shown over time."""
    return states_shown(system, setting)[:2]


def _section(run: Run) -> dict[str, Floats]:
    """Return the states on the section in the settled part of a run."""
    system, log = run.system, run.trajectory.events
    begin, end = run.extent
    if system.section is None and system.forced:
        rows = run.trajectory.samples(1, begin + SETTLED * (end - begin))
        cycle, time, y = rows.cycle, rows.time, rows.y
    else:
        crossings = log.crossings(1)
        cycle, time, y = crossings.cycle, crossings.time, crossings.after
    found = {"t": times_of(run, cycle, time)}
    found |= {name: system.out(name, y[:, place]) for place, name in enumerate(system.states)}
    settled = cycle + time / run.trajectory.period >= begin + SETTLED * (end - begin)
    return {name: values[settled] for name, values in found.items()}


def _voltages(system: System, motion: Motion) -> tuple[Floats, ...]:
    if not isinstance(system, ActuatorSystem):
        return ()
    phase = np.remainder(motion.frames["t"], system.forcing_period)
    sides = (False, True) if system.drive.left_voltage is not None else (False,)
    return tuple(system.drive.value(phase, left=left) for left in sides)


def _cycles(run: Run, unit: float) -> Cycles:
    system = run.system
    state = system.shown[0] if system.shown else system.states[0]
    place = system.states.index(state)
    if not system.forced:
        y = run.trajectory.events.crossings(1).after
        return Cycles(
            number=np.arange(float(len(y))), value=system.out(state, y[:, place]),
            what=f"{state} on the section", name=state, speed=0.0,
            events=np.empty(0), counted="",
        )  # fmt: skip
    starts = run.trajectory.samples(1).y
    steps = isinstance(system, ActuatorSystem)
    if steps:
        value = np.diff(system.out("x1", starts[:, system.states.index("x1")]))
    else:
        value = system.out(state, starts[:-1, place])
    events, counted = counts_of(run, len(value))
    return Cycles(
        number=np.arange(float(len(value))),
        value=value,
        what="step of the frame" if steps else f"{state} where the period begins",
        name="x1" if steps else state,
        speed=unit if steps else 0.0,
        events=events,
        counted=counted,
    )
