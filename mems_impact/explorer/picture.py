"""What a page shows of one run: arrays, ready to be drawn."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd

import mems_impact as mi
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.analysis.run import Run
from mems_impact.analysis.system import System
from mems_impact.explorer.latest import Watch
from mems_impact.explorer.setting import TIME, Setting, unit_of_time
from mems_impact.explorer.subject import Subject
from mems_impact.hybrid.trajectory import Floats
from mems_impact.plotting.motion import between, line, spans

__all__ = ["Cycles", "Picture", "picture_of"]

SHOWN = 6.0  # forcing periods, or units of time times `UNFORCED`, of the motion over time
UNFORCED = 5.0
PER_PERIOD = 200
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
    setting : Setting
    run : Run
    curve : mapping of str to ndarray
        The last part of the motion, exact at transitions and broken where it jumps: ``t`` and each
        state that is shown.
    frames : mapping of str to ndarray
        The same at equal times, to be played.
    impacts : DataFrame
        The impacts in it, with the states before and after.
    stretches : DataFrame
        Mode, start and end of each stretch of it.
    section : DataFrame
        Crossings of the Poincaré section, or where forcing periods begin, of the settled part.
    cycles : Cycles
    unit : float
        What the axis of time counts in.
    seconds : float
        How long it took to compute.
    """

    setting: Setting
    run: Run = field(repr=False)
    curve: Mapping[str, Floats] = field(repr=False)
    frames: Mapping[str, Floats] = field(repr=False)
    impacts: pd.DataFrame = field(repr=False)
    stretches: pd.DataFrame = field(repr=False)
    section: pd.DataFrame = field(repr=False)
    cycles: Cycles = field(repr=False)
    unit: float
    seconds: float

    @property
    def system(self) -> System:
        """The system that was run."""
        return self.run.system

    @property
    def slips(self) -> pd.DataFrame:
        """The stretches in which the frame of an actuator slips; none of another system."""
        if not isinstance(self.system, ActuatorSystem):
            return self.stretches.iloc[:0]
        return self.stretches[~self.stretches["mode"].str.startswith("stuck")]


def picture_of(subject: Subject, setting: Setting, watch: Watch | None = None) -> Picture:
    """Run the system of a setting and gather what is shown of it.

    Parameters
    ----------
    subject : Subject
    setting : Setting
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
    run = mi.simulate(
        system,
        **run_length(system, setting, unit),
        initial=setting.initial(subject, system),
        options=subject.options,
        progress=watch or False,
    )
    shown = states_shown(system, setting)
    samples = _last_samples(run, unit)
    corners = between(run.corners, samples)
    whole = line(samples, corners, shown)
    curve = {name: whole[name].to_numpy() for name in ("t", *shown)}
    frames = {name: samples[name].to_numpy() for name in ("t", *shown)}
    if isinstance(system, ActuatorSystem):
        drive, period = system.drive, system.forcing_period
        phase = np.remainder(frames["t"], period)
        frames["voltage"] = drive.value(phase)
        if drive.left_voltage is not None:
            frames["left voltage"] = drive.value(phase, left=True)
    return Picture(
        setting=setting,
        run=run,
        curve=curve,
        frames=frames,
        impacts=corners[corners["impact"]],
        stretches=spans(samples, corners),
        section=section_of(run),
        cycles=_cycles(run, unit),
        unit=unit if system.forced else 1.0,
        seconds=time.perf_counter() - begin,
    )


def run_length(system: System, setting: Setting, unit: float) -> dict[str, float]:
    """Return the length of the run as `simulate` takes it."""
    if system.forced:
        return {"periods": setting.length}
    return {"duration": setting.length * unit}


def states_shown(system: System, setting: Setting) -> tuple[str, ...]:
    """Return the states that any part of the page shows, those over time first."""
    over_time = ("x2", "x1") if isinstance(system, ActuatorSystem) else (setting.x, setting.y)
    names = (*over_time, setting.x, setting.y, *system.shown[:1])
    return tuple(name for name in dict.fromkeys(names) if name != TIME)


def series_shown(system: System, setting: Setting) -> tuple[str, ...]:
    """Return the states that are shown over time."""
    return states_shown(system, setting)[:2]


def section_of(run: Run) -> pd.DataFrame:
    """Return the crossings of the section in the settled part of a run."""
    rows = run.section(1 if run.system.section is not None else 0)
    begin, end = (border * run.trajectory.period for border in run.extent)
    settled = float(run.system.out("time", begin + SETTLED * (end - begin)))
    return rows[rows["t"] >= settled]


def _last_samples(run: Run, unit: float) -> pd.DataFrame:
    """Return the motion at equal times, at the end of a run."""
    begin, end = run.extent
    if run.system.forced:
        return run.samples(PER_PERIOD, max(begin, end - SHOWN))
    last, length = end * unit, SHOWN * UNFORCED * unit
    return run.samples(math.ceil(PER_PERIOD / UNFORCED), max(begin * unit, last - length))


def _cycles(run: Run, unit: float) -> Cycles:
    system = run.system
    state = system.shown[0] if system.shown else system.states[0]
    if not system.forced:
        rows = run.section(1)
        number = np.arange(float(len(rows)))
        return Cycles(
            number=number, value=rows[state].to_numpy() if len(rows) else number,
            what=f"{state} on the section", name=state, speed=0.0,
            events=np.empty(0), counted="",
        )  # fmt: skip
    starts = run.samples(per_period=1)
    steps = isinstance(system, ActuatorSystem)
    value: Any = np.diff(starts["x1"]) if steps else starts[state].to_numpy()[:-1]
    struck = len(run.impacts) > 0 or any(guard.impact for guard in system.automaton.guards)
    rows = run.impacts if struck else run.events
    periods = rows["period"].to_numpy(dtype=int)
    return Cycles(
        number=np.arange(float(len(value))),
        value=value,
        what="step of the frame" if steps else f"{state} where the period begins",
        name="x1" if steps else state,
        speed=unit if steps else 0.0,
        events=np.bincount(periods[periods < len(value)], minlength=len(value)).astype(float),
        counted="impacts" if struck else "events",
    )
