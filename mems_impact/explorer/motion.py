"""The last part of a run as arrays: exact at transitions, broken where it jumps.

What `mems_impact.plotting.motion` makes of tables for figures, without tables: those took two
thirds of the time from a slider to its picture.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mems_impact.analysis.run import Run
from mems_impact.hybrid.trajectory import Events, Floats
from mems_impact.plotting.motion import SMALL, interleaved
from mems_impact.tables.common import is_shown

__all__ = ["Motion", "counts_of", "motion_of", "times_of"]


@dataclass(frozen=True, kw_only=True)
class Motion:
    """A stretch of a run, in the units of the system.

    Attributes
    ----------
    curve : mapping of str to ndarray
        ``t`` and states: samples and transitions, with NaN between the two sides of a jump.
    frames : mapping of str to ndarray
        ``t`` and states at equal times.
    hits : mapping of str to ndarray
        The impacts: ``t``, and each state ``before`` and ``after``.
    stretches : tuple of tuple
        Mode, start and end of each stretch of time in one mode.
    """

    curve: Mapping[str, Floats] = field(repr=False)
    frames: Mapping[str, Floats] = field(repr=False)
    hits: Mapping[str, Floats] = field(repr=False)
    stretches: tuple[tuple[str, float, float], ...] = field(repr=False)


def motion_of(run: Run, names: Sequence[str], per_period: int, first: float) -> Motion:
    """Return the motion of some states to the end of a run.

    Parameters
    ----------
    run : Run
    names : sequence of str
        The states.
    per_period : int
        Samples in a period of the numerics.
    first : float
        Where it begins, in such periods.
    """
    system, trajectory = run.system, run.trajectory
    places = [system.states.index(name) for name in names]
    units = np.array([system.out(name, 1.0) for name in names])
    grid = trajectory.samples(per_period, first)
    time = times_of(run, grid.cycle, grid.time)
    y = grid.y[:, places] * units
    log = trajectory.events
    log = log[is_shown(log)]
    instants = times_of(run, log.cycle, log.time)
    inside = (instants >= time[0]) & (instants <= time[-1])
    log, instants = log[inside], instants[inside]
    before, after = log.before[:, places] * units, log.after[:, places] * units
    jumps = (np.abs(after - before) > SMALL * np.abs(y).max(axis=0)).any(axis=1)
    hits = log.impacts(system.automaton)
    curve_t, curve = _joined(time, y, instants, before, after, jumps)
    sides = {"before": before, "after": after}
    return Motion(
        curve=_named(names, curve_t, curve),
        frames=_named(names, time, y),
        hits={
            "t": instants[hits],
            **{
                f"{name} {side}": values[hits, place]
                for side, values in sides.items()
                for place, name in enumerate(names)
            },
        },
        stretches=_stretches(run, log, instants, time, int(grid.mode[0])),
    )


def times_of(run: Run, cycle: np.ndarray, time: Floats) -> Floats:
    """Return instants of the numerics as times since the run began to count, in its own unit."""
    found: Floats = run.system.out("time", cycle * run.trajectory.period + time)
    return found


def counts_of(run: Run, periods: int) -> tuple[Floats, str]:
    """Return how many impacts there were in each of the first periods, and the word for them.

    Where nothing strikes, events.
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
    kept, order = interleaved(time, instants, jumps)
    gaps = np.full((int(jumps.sum()), y.shape[1]), np.nan)
    t = np.concatenate([time[kept], instants, instants[jumps], instants])
    return t[order], np.concatenate([y[kept], before, gaps, after])[order]


def _named(names: Sequence[str], t: Floats, values: Floats) -> dict[str, Floats]:
    return {"t": t, **{name: values[:, place] for place, name in enumerate(names)}}


def _stretches(
    run: Run, log: Events, instants: Floats, time: Floats, first: int
) -> tuple[tuple[str, float, float], ...]:
    modes = run.system.modes
    changes = log.mode_before != log.mode_after
    begin = int(log.mode_before[changes][0]) if changes.any() else first
    numbers = [begin, *log.mode_after[changes].tolist()]
    borders = [float(time[0]), *instants[changes].tolist(), float(time[-1])]
    found = zip(numbers, borders[:-1], borders[1:], strict=True)
    return tuple((modes[mode], start, end) for mode, start, end in found if end > start)
