"""Arrays for a page.

The same data as in `mems_impact.plotting.trajectories`, but without tables, which took two thirds
of the time from a slider to its picture.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

import mems_impact as mi
from mems_impact._util.arrays import Floats
from mems_impact._util.formatting import stability_name
from mems_impact._util.progress import Watch
from mems_impact._util.warning_scopes import collected_warnings, first_of_each
from mems_impact.actuator.automaton import slips
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.analysis.run import Run
from mems_impact.explorer.session import (
    TIME,
    PageSetting,
    SliderSpec,
    Subject,
    allowed_range,
    unit_of_time,
)
from mems_impact.hybrid.simulation import Events
from mems_impact.plotting.trajectories import MIN_DRAWN_JUMP, interleaved
from mems_impact.systems.base import HybridSystem
from mems_impact.tables import is_shown

# --- Bifurcation diagram: first coarse, then fine

COARSE, FINE = 41, 161  # values of the parameter
TRANSIENT, PERIODS = 60, 16  # forcing periods per value, or units of time
MAX_DRAWN_ROWS = 40_000


@dataclass(frozen=True, kw_only=True)
class DiagramSnapshot:
    """A sweep of a parameter, up and down."""

    request: DiagramRequest
    table: pd.DataFrame  # as `mems_impact.sweep` returns it
    state: str  # the shown column
    message: str  # which values failed or have not settled; empty if none
    # Label, parameter and state of the special points of the branch through the orbit of the run.
    special_points: pd.DataFrame
    continued: bool = False  # whether special points have been computed

    @property
    def range(self) -> tuple[float, float]:
        """Smallest and largest value of the parameter."""
        values = self.table[self.request.setting.parameter]
        return float(values.min()), float(values.max())

    def dots(self, direction: str) -> tuple[Any, Any]:
        """Return parameter and state of the crossings of one chain."""
        rows = self.table[self.table["direction"] == direction]
        rows = rows.iloc[:: max(1, len(rows) // MAX_DRAWN_ROWS)]
        return rows[self.request.setting.parameter].to_numpy(), rows[self.state].to_numpy()


@dataclass(frozen=True, kw_only=True)
class DiagramRequest:
    """A requested diagram, with a number of values of the parameter."""

    setting: PageSetting
    points: int

    @property
    def key(self) -> tuple[Any, ...]:
        """The data of the diagram, except the number of values."""
        setting = self.setting
        others = {**setting.values, setting.parameter: 0.0}
        return setting.parameter, tuple(others.items())

    def finer(self) -> DiagramRequest:
        """Return the same with more values."""
        return replace(self, points=FINE)


def sweep_arguments(
    system: HybridSystem, setting: PageSetting, spec: SliderSpec, points: int
) -> dict[str, Any]:
    """Return the arguments of `mems_impact.sweep` after the system."""
    low, high = allowed_range(system, setting.parameter, spec.low, spec.high)
    value = system.parameters[setting.parameter]
    low, high = min(low, value), max(high, value)
    spans: Mapping[str, Any] = {"transient": TRANSIENT, "periods": PERIODS}
    if not system.forced:
        unit = unit_of_time(system)
        spans = {"transient": TRANSIENT * unit, "duration": PERIODS * unit}
    values = np.linspace(low, high, points)
    return {"parameter": setting.parameter, "values": values, "direction": "both", **spans}


def diagram_of(
    subject: Subject, request: DiagramRequest, spec: SliderSpec, watch: Watch | None = None
) -> DiagramSnapshot:
    """Sweep the parameter of a setting over its slider, until an exception from `watch`."""
    system = request.setting.system(subject)
    arguments = sweep_arguments(system, request.setting, spec, request.points)
    with collected_warnings() as collected:
        sweep = mi.sweep(system, **arguments, options=subject.options, progress=watch or False)
    table = sweep.table
    reasons = table.loc[table["status"] != "ok", "status"]
    messages = [f"{len(reasons)} values failed: {reasons.iloc[0]}"] if len(reasons) else []
    messages += [each.message for each in first_of_each(collected)]
    states = [name for name in table.attrs.get("states", system.states) if name in table.columns]
    numbers = np.empty(0)
    empty = {"label": np.empty(0, str), request.setting.parameter: numbers, states[0]: numbers}
    return DiagramSnapshot(
        request=request,
        table=table,
        state=states[0],
        message="; ".join(messages),
        special_points=pd.DataFrame(empty),
    )


def with_special_points(
    subject: Subject, diagram: DiagramSnapshot, watch: Watch | None = None
) -> DiagramSnapshot:
    """Continue the orbit of the run over the range of a diagram; add its special points.

    A motion that is not periodic has no special points. An exception from `watch` ends the
    continuation.
    """
    setting = diagram.request.setting
    name, value = setting.parameter, setting.values[setting.parameter]
    low, high = diagram.range
    columns = list(diagram.special_points)
    tables = [diagram.special_points]
    try:
        with collected_warnings():  # the page shows those of the run
            orbit = mi.find_orbit(take_snapshot(subject, setting, watch).run)
            for stop, back in ((high, low), (low, high)):
                if stop != value:
                    branch = mi.continue_solution(
                        orbit, name, stop, back=back, progress=watch or False
                    )
                    tables.append(branch.special_table.reindex(columns=columns))
    except mi.MemsImpactError:
        pass  # the points found so far are shown
    special_points = pd.concat(tables, ignore_index=True).dropna()
    return replace(diagram, special_points=special_points, continued=True)


# --- Motion: exact at transitions, broken at jumps


@dataclass(frozen=True, kw_only=True)
class MotionSnapshot:
    """A part of a run, in the units of the system: ``t`` and states by name."""

    # Samples and transitions, with NaN between the two sides of a jump.
    curve: Mapping[str, Floats] = field(repr=False)
    frames: Mapping[str, Floats] = field(repr=False)  # at equal times
    # The impacts: ``t``, and each state ``before`` and ``after``.
    hits: Mapping[str, Floats] = field(repr=False)
    # Mode, start and end of each interval in one mode.
    stretches: tuple[tuple[str, float, float], ...] = field(repr=False)


def motion_of(run: Run, names: Sequence[str], per_period: int, first: float) -> MotionSnapshot:
    """Return the motion of some states from `first` to the end of a run.

    `first` and `per_period`, the number of samples, count periods of the numerics.
    """
    system, trajectory = run.system, run.trajectory
    indices = [system.states.index(name) for name in names]
    units = np.array([system.units.out(name, 1.0) for name in names])
    grid = trajectory.samples(per_period, first)
    time = times_of(run, grid.cycle, grid.time)
    y = grid.y[:, indices] * units
    log = trajectory.events
    log = log[is_shown(log)]
    instants = times_of(run, log.cycle, log.time)
    inside = (instants >= time[0]) & (instants <= time[-1])
    log, instants = log[inside], instants[inside]
    before, after = log.before[:, indices] * units, log.after[:, indices] * units
    jumps = (np.abs(after - before) > MIN_DRAWN_JUMP * np.abs(y).max(axis=0)).any(axis=1)
    hits = log.impacts(system.automaton)
    curve_t, curve = _joined(time, y, instants, before, after, jumps)
    sides = {"before": before, "after": after}
    return MotionSnapshot(
        curve=_named(names, curve_t, curve),
        frames=_named(names, time, y),
        hits={
            "t": instants[hits],
            **{
                f"{name} {side}": values[hits, column]
                for side, values in sides.items()
                for column, name in enumerate(names)
            },
        },
        stretches=_stretches(run, log, instants, time, int(grid.mode[0])),
    )


def times_of(run: Run, cycle: np.ndarray, time: Floats) -> Floats:
    """Return instants of the numerics as times from period 0, in the unit of the system."""
    times: Floats = run.system.units.out("time", cycle * run.trajectory.period + time)
    return times


def counts_of(run: Run, periods: int) -> tuple[Floats, str]:
    """Return the number of impacts in each of the first periods, and their name.

    For a system without impacts, the number of events.
    """
    log = run.trajectory.events
    strikes = any(guard.impact for guard in run.system.automaton.guards)
    rows = log[log.impacts(run.system.automaton) if strikes else is_shown(log)]
    cycle = rows.cycle[rows.cycle < periods]
    counts = np.bincount(cycle, minlength=periods).astype(float)
    return counts, "impacts" if strikes else "events"


def _joined(
    time: Floats, y: Floats, instants: Floats, before: Floats, after: Floats, jumps: np.ndarray
) -> tuple[Floats, Floats]:
    """Return samples and transitions as one line, in the order of time."""
    remaining, order = interleaved(time, instants, jumps)
    gaps = np.full((int(jumps.sum()), y.shape[1]), np.nan)
    t = np.concatenate([time[remaining], instants, instants[jumps], instants])
    return t[order], np.concatenate([y[remaining], before, gaps, after])[order]


def _named(names: Sequence[str], t: Floats, values: Floats) -> dict[str, Floats]:
    return {"t": t, **{name: values[:, column] for column, name in enumerate(names)}}


def _stretches(
    run: Run, log: Events, instants: Floats, time: Floats, first: int
) -> tuple[tuple[str, float, float], ...]:
    modes = run.system.modes
    changes = log.mode_before != log.mode_after
    begin = int(log.mode_before[changes][0]) if changes.any() else first
    numbers = [begin, *log.mode_after[changes].tolist()]
    borders = [float(time[0]), *instants[changes].tolist(), float(time[-1])]
    intervals = zip(numbers, borders[:-1], borders[1:], strict=True)
    return tuple((modes[mode], start, end) for mode, start, end in intervals if end > start)


# --- Snapshot of a run

DISPLAYED_PERIODS = 6.0  # forcing periods of the motion over time
UNFORCED_DURATION = 5.0  # units of time shown for an autonomous system
MIN_SAMPLES, MAX_SAMPLES = 1_200, 24_000  # of the motion that is shown
SAMPLES_PER_STEP = 6  # of the integrator: a free oscillation takes some ten steps
TRANSIENT_SHARE = 0.5  # part of a run without shown crossings


@dataclass(frozen=True, kw_only=True)
class Cycles:
    """Quantities per cycle: for an actuator, the step of the frame in each forcing period."""

    number: Floats  # of the forcing periods or of the crossings of the section, shape (n,)
    value: Floats  # shape (n,)
    quantity: str  # the name of the values
    name: str  # the state or column whose unit the values have
    speed: float  # divisor of a value for the speed; 0 if there is no speed
    # Number of impacts, or of events without impacts, in each forcing period; empty without
    # forcing.
    events: Floats
    counted: str  # name of `events`


@dataclass(frozen=True, kw_only=True)
class Headline:
    """A number that sums up a run; NaN where it is not defined."""

    name: str
    value: float
    quantity: str  # the state, column or parameter whose unit it has
    change: float = 0.0  # relative distance from its limit (see `Settling`)


@dataclass(frozen=True, kw_only=True)
class RunSnapshot:
    """Data of a run for a page."""

    setting: PageSetting
    run: Run = field(repr=False)
    motion: MotionSnapshot = field(repr=False)  # the last part of the run
    # Of an actuator, at the frames of the motion: right voltage, and left voltage if there is one.
    voltages: tuple[Floats, ...] = field(repr=False)
    # ``t`` and the states at crossings of the Poincaré section, or at starts of forcing periods,
    # after the transient.
    section: Mapping[str, Floats] = field(repr=False)
    cycles: Cycles = field(repr=False)
    headlines: tuple[Headline, ...]
    unit: float  # of the time axis
    seconds: float  # duration of the computation
    warnings: tuple[str, ...] = ()

    @property
    def system(self) -> HybridSystem:
        """The system of the run."""
        return self.run.system

    @property
    def slips(self) -> tuple[tuple[float, float], ...]:
        """Start and end of each interval of slip of an actuator's frame."""
        if not isinstance(self.system, ActuatorSystem):
            return ()
        stretches = self.motion.stretches
        return tuple((t0, t1) for mode, t0, t1 in stretches if slips(mode))


def take_snapshot(
    subject: Subject, setting: PageSetting, watch: Watch | None = None
) -> RunSnapshot:
    """Run the system of a setting, and return the data for a page.

    An exception from `watch` ends the run. Raises InvalidParameter if the system does not allow the
    values, RunError if the run fails.
    """
    begin = time.perf_counter()
    with collected_warnings() as collected:
        system = setting.system(subject)
        unit = unit_of_time(system)
        run = mi.simulate(
            system,
            **run_length(system, setting, unit),
            initial=setting.initial(subject, system),
            options=subject.options,
            progress=watch or False,
        )
        headlines = _headlines(run)
    begin_of, end_of = run.extent
    displayed = DISPLAYED_PERIODS * (1.0 if system.forced else UNFORCED_DURATION)
    motion = motion_of(
        run,
        page_states(system, setting),
        _per_period(run, displayed),
        max(begin_of, end_of - displayed),
    )
    return RunSnapshot(
        setting=setting,
        run=run,
        motion=motion,
        voltages=_voltages(system, motion),
        section=_section(run),
        cycles=_cycles(run, unit),
        headlines=headlines,
        unit=unit if system.forced else 1.0,
        seconds=time.perf_counter() - begin,
        warnings=tuple(dict.fromkeys(each.message for each in collected)),
    )


def _per_period(run: Run, displayed: float) -> int:
    """Return how many samples of a period show a smooth curve, however fast the motion is."""
    begin, end = run.extent
    steps = run.trajectory.steps / (end - begin)
    samples = min(max(MIN_SAMPLES, SAMPLES_PER_STEP * steps * displayed), MAX_SAMPLES)
    return math.ceil(samples / displayed)


def run_length(system: HybridSystem, setting: PageSetting, unit: float) -> dict[str, Any]:
    """Return the length of the run for `simulate`."""
    if system.forced:
        return {"periods": setting.length}
    return {"duration": setting.length * unit}


def page_states(system: HybridSystem, setting: PageSetting) -> tuple[str, ...]:
    """Return all displayed states, states over time first."""
    over_time = ("x2", "x1") if isinstance(system, ActuatorSystem) else (setting.x, setting.y)
    names = (*over_time, setting.x, setting.y, *system.state_space.displayed[:1])
    return tuple(name for name in dict.fromkeys(names) if name != TIME)


def series_states(system: HybridSystem, setting: PageSetting) -> tuple[str, ...]:
    """Return the states displayed over time."""
    return page_states(system, setting)[:2]


def _section(run: Run) -> dict[str, Floats]:
    """Return the states on the section after the transient."""
    system, log = run.system, run.trajectory.events
    begin, end = run.extent
    if system.section is None and system.forced:
        rows = run.trajectory.samples(1, begin + TRANSIENT_SHARE * (end - begin))
        cycle, time, y = rows.cycle, rows.time, rows.y
    else:
        crossings = log.crossings(1)
        cycle, time, y = crossings.cycle, crossings.time, crossings.after
    columns = {"t": times_of(run, cycle, time)}
    columns |= {
        name: system.units.out(name, y[:, column]) for column, name in enumerate(system.states)
    }
    settled = cycle + time / run.trajectory.period >= begin + TRANSIENT_SHARE * (end - begin)
    return {name: values[settled] for name, values in columns.items()}


def _voltages(system: HybridSystem, motion: MotionSnapshot) -> tuple[Floats, ...]:
    if not isinstance(system, ActuatorSystem):
        return ()
    phase = np.remainder(motion.frames["t"], system.forcing_period)
    return tuple(system.source.value(phase, channel=side) for side in system.drive.sides)


def _cycles(run: Run, unit: float) -> Cycles:
    system = run.system
    state = (*system.state_space.displayed, system.states[0])[0]
    column = system.states.index(state)
    if not system.forced:
        y = run.trajectory.events.crossings(1).after
        return Cycles(
            number=np.arange(float(len(y))), value=system.units.out(state, y[:, column]),
            quantity=f"{state} on the section", name=state, speed=0.0,
            events=np.empty(0), counted="",
        )  # fmt: skip
    starts = run.trajectory.samples(1).y
    steps = isinstance(system, ActuatorSystem)
    if steps:
        value = np.diff(system.units.out("x1", starts[:, system.states.index("x1")]))
    else:
        value = system.units.out(state, starts[:-1, column])
    events, counted = counts_of(run, len(value))
    return Cycles(
        number=np.arange(float(len(value))),
        value=value,
        quantity="step of the frame" if steps else f"{state} where the period begins",
        name="x1" if steps else state,
        speed=unit if steps else 0.0,
        events=events,
        counted=counted,
    )


ACTUATOR_HEADLINES = {
    "speed": ("mean speed", "mean speed"),
    "step": ("displacement per period", "displacement per period"),
    "impact speed": ("impact speed mean", "impact speed"),
}
"""Statistic and quantity of each headline of an actuator's run."""


def _headlines(run: Run) -> tuple[Headline, ...]:
    """Return speed, step, impact speed and pull-in of an actuator; of others rate and observables.

    The values belong to the second half of the run, as its statistics do.
    """
    system, statistics = run.system, run.statistics
    if not isinstance(system, ActuatorSystem):
        rates = [f"impacts per {each}" for each in ("period", "time")]
        names = [*rates, *(each.name for each in system.observables)]
        return tuple(_headline(run, name, name, name) for name in names if name in statistics)
    headlines = [
        _headline(run, name, statistic, quantity)
        for name, (statistic, quantity) in ACTUATOR_HEADLINES.items()
    ]
    try:
        if system.drive_unit == "C":
            pull_in = mi.pull_in_charge(system.actuator)
            return (
                *headlines,
                Headline(name="pull-in charge", value=pull_in, quantity="amplitude"),
            )
        pull_in = mi.pull_in_voltage(system.actuator)
    except mi.InvalidParameter:
        pull_in = math.nan
    return (*headlines, Headline(name="pull-in voltage", value=pull_in, quantity="voltage"))


def _headline(run: Run, name: str, statistic: str, quantity: str) -> Headline:
    row = run.settling.rows.get(statistic)
    value = float(run.statistics[statistic])
    return Headline(name=name, value=value, quantity=quantity, change=row.change if row else 0.0)


# --- Floquet multipliers of the orbit near the end of a run


@dataclass(frozen=True, kw_only=True)
class Floquet:
    """The periodic orbit near the end of a run."""

    multipliers: NDArray[np.complex128]  # empty if no orbit was found
    stable: bool | None  # None if neutral, or if no orbit was found
    description: str  # of the orbit, or why none was found


def floquet_of(picture: RunSnapshot, watch: Watch | None = None) -> Floquet:
    """Find the periodic orbit near the end of a run; describe a failure rather than raise it."""
    try:
        orbit = mi.find_orbit(picture.run)
    except (mi.OrbitError, mi.RunError, mi.InvalidParameter) as error:
        reason = getattr(error, "reason", str(error))
        none = np.empty(0, dtype=complex)
        return Floquet(multipliers=none, stable=None, description=reason)
    hits, periods = len(orbit.impacts), orbit.periods
    if picture.system.forced:
        length = f"{periods} forcing period{'s' if periods > 1 else ''}"
    else:
        length = f"{picture.system.units.label('period')} {orbit.period:.6g}"
    description = (
        f"{stability_name(orbit.stable)}, {length}, {hits or 'no'} impact{'' if hits == 1 else 's'}"
    )
    return Floquet(multipliers=orbit.multipliers, stable=orbit.stable, description=description)
