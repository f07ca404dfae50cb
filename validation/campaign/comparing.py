"""A run of the package beside a reference, event by event, as far as the two can agree.

Two integrations of the same motion part in the end, and where an event nearly does not happen, or
two nearly coincide, they part at once. Where that is, the reference says by itself: it runs again
from a start that is `SHIFT` away. Up to where its own runs hold the same events, every event of the
package must be one of theirs, within a hundredth of what the shift makes of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mems_impact.errors import MemsImpactError, RunError
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.options import Options

Floats = NDArray[np.float64]

SHIFT = 1e-6  # of the start, between the runs of the reference
SHARE = 1e-2  # of what the shift makes of an event, that the package may be off
SHORT = 1e-3  # impacts this close before the end of their sequence are part of it
FLOOR = 1e-8  # of every comparison
RTOL, ATOL = 1e-12, 1e-14  # of the package
NOISE = 1e-11  # error of its states along an arc, with room
END = -1  # guard of the row that is the end of a run


@dataclass(frozen=True)
class Unit:
    """How the package gets a system that its reference sees in units of order one.

    Attributes
    ----------
    time, length : float
        The units.
    method : str
        By which it integrates.
    """

    time: float = 1.0
    length: float = 1.0
    method: str = Options.method

    @property
    def speed(self) -> float:
        return self.length / self.time

    @property
    def acceleration(self) -> float:
        return self.length / self.time**2

    @property
    def options(self) -> dict[str, Any]:
        """The method, with tolerances as tight in these units as in those of the reference."""
        atol = ATOL * min(self.length, self.speed)
        return {"method": self.method, "rtol": RTOL, "atol": atol}


ONE = Unit()


@dataclass(frozen=True)
class Row:
    """One event: the mode and the state are those after it."""

    t: float
    guard: int
    mode: int
    y: Floats
    fall: float = math.inf  # how fast the margin fell
    rest: bool = False  # the end of a sequence of impacts
    blur: float = 0.0  # of the state: a mode that stops all motion begins within the sequence


@dataclass
class Verdict:
    """What came of one case."""

    family: str
    number: int
    events: int = 0  # matched
    horizon: float = 1.0  # share of the run over which the reference agrees with itself
    story: str = ""  # what is wrong, in one line

    def __str__(self) -> str:
        return f"{self.family}:{self.number} " + (self.story or f"right, {self.events} events")


@dataclass(frozen=True)
class Answer:
    """What the package says."""

    rows: list[Row]  # the last one is the end
    failed: str


def answer(problem: Problem, start: HybridState, end: float, scale: Floats, time: float) -> Answer:
    """Run the package to `end`.

    The problem is in units of `time` and, for the components of the state, `scale`; `start`, `end`
    and the answer are in those of the reference.
    """
    if end <= 0.0:
        return Answer([], "")
    first = replace(start, y=start.y * scale)
    failed = ""
    try:
        done = run(problem, first, end * time / problem.period)
    except RunError as error:
        done, failed = error.partial, f"RunError: {error.reason}"
    except MemsImpactError as error:
        return Answer([Row(0.0, END, start.mode, start.y)], f"{type(error).__name__}: {error}")
    log = done.events[done.events.kind <= workspace.ACCUMULATION]
    times = (log.cycle * done.period + log.time) / time
    rows = [
        Row(
            float(times[i]),
            int(log.guard[i]),
            int(log.mode_after[i]),
            log.after[i] / scale,
            rest=bool(log.kind[i] == workspace.ACCUMULATION),
        )
        for i in range(len(log))
    ]
    final = done.final
    last = (final.cycle * done.period + final.time) / time
    return Answer([*rows, Row(last, END, final.mode, final.y / scale)], failed)


def without_tails(rows: Sequence[Row]) -> list[Row]:
    """Leave out the impacts of a sequence that its end stands for."""
    kept: list[Row] = []
    for row in rows:
        while row.rest and kept and kept[-1].guard == row.guard and row.t - kept[-1].t < SHORT:
            kept.pop()
        kept.append(row)
    return kept


@dataclass(frozen=True)
class Truth:
    """Events on which the reference agrees with itself, and how far each may be off."""

    rows: list[Row]
    late: list[float]
    off: list[float]
    quiet: float  # up to here no further event can come
    share: float


def truth(follow: Callable[[float], tuple[list[Row], float]], end: float) -> Truth:
    """Let the reference speak three times: ``follow(shift)`` gives rows, and where they end."""
    runs = [follow(shift) for shift in (0.0, SHIFT, -SHIFT)]
    quiet = min(end, *(last for _, last in runs))
    many = [without_tails(rows) for rows, _ in runs]
    rows, late, off = [], [], []
    spread = noise = blur = 0.0
    for i in range(max(map(len, many))):
        same = [some[i] for some in many if i < len(some)]
        one = same[0]
        alike = len(same) == 3 and all((r.guard, r.mode) == (one.guard, one.mode) for r in same)
        if alike:
            apart = [max(abs(r.t - one.t), float(np.abs(r.y - one.y).max())) for r in same[1:]]
            spread = max(spread, *apart)
        if not alike or spread > 1e-2 or (one.t >= quiet and one.guard != END):
            quiet = min(quiet, *(r.t for r in same))
            quiet -= 2.0 * spread
            break
        noise, blur = noise + NOISE / one.fall, blur + one.blur
        rows.append(one)
        late.append(FLOOR + SHARE * spread + noise)
        off.append(late[-1] * (1.0 + float(np.abs(one.y).max())) + blur)
    # What comes at once before an event that is uncertain is uncertain with it.
    while rows and rows[-1].guard != END and rows[-1].t + late[-1] >= quiet:
        quiet = rows.pop().t - late[-1]
    quiet = max(quiet, 0.0)
    return Truth(rows, late, off, quiet, quiet / end)


def compare(found: Truth, mine: Answer) -> str:
    """Return what is wrong with the package's events, or nothing."""
    rows = without_tails(mine.rows)
    for i, row in enumerate(found.rows):
        if i >= len(rows):
            return mine.failed or f"the event of guard {row.guard} at t = {row.t:.9g} is lost"
        my = rows[i]
        if my.guard == END and row.guard != END and mine.failed:
            return f"t = {my.t:.6g}: {mine.failed}"
        if (my.guard, my.mode) != (row.guard, row.mode) or abs(my.t - row.t) > found.late[i]:
            return (
                f"event {i} is guard {my.guard} to mode {my.mode} at t = {my.t:.12g}, "
                f"not guard {row.guard} to mode {row.mode} at {row.t:.12g} "
                f"(may be off by {found.late[i]:.1e})"
            )
        error = float(np.abs(my.y - row.y).max())
        if not error <= found.off[i]:
            return f"state after event {i} at t = {row.t:.9g} off by {error:.1e}"
    further = rows[len(found.rows)] if len(rows) > len(found.rows) else None
    slack = found.late[-1] if found.late else FLOOR
    if further is not None and further.t < found.quiet - slack:
        if further.guard == END:
            return f"t = {further.t:.6g}: {mine.failed or 'the run ends early'}"
        return f"an event of guard {further.guard} at t = {further.t:.12g} that is none"
    return ""
