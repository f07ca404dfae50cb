"""Verification of a run by an independent method."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import Events, Trajectory
from mems_impact.integrators.options import Options
from mems_impact.systems.result import Result
from mems_impact.tables import Labels, event_codes, event_names, is_shown, verification, with_units

if TYPE_CHECKING:
    import pandas as pd

TOLERANCE_FACTOR, MIN_RTOL, MIN_ATOL = 0.01, 1e-13, 1e-15
MORE_STEPS = 10  # times as many steps are allowed for the more precise run

# Bound on the accumulated local errors of `rtol` between two events, in the system's units; and the
# largest difference that counts as agreement.
EXPECTED_FACTOR, MAX_EXPECTED = 100.0, 1e-4
# The comparison ends where differences exceed those of the first periods by this factor and are
# larger than an agreement.
SENSITIVE, FIRST_PERIODS = 1e3, 3.0
# Between two events differences grow at most by this factor (a chaotic motion doubles them), times
# the number of periods between; an event whose guard is approached slower than `SLOW_RATE`
# multiplies its own difference by up to SLOW_RATE / speed in addition.
GROWTH, SLOW_RATE = 100.0, 0.1
GRADIENT_STEP = 1e-6  # of the states, of the differences of a margin
# A block that misses a stopper by a distance y would have struck it at speed sqrt(2 a y), with an
# acceleration a of order 1: one run alone may have such an event.
WEAK_ORDER = 3.0
MOST_SKIPPED = 60  # allowed difference of the numbers of impacts of two complete chatter sequences


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Verification(Result):
    """Comparison of a run with the same run by an independent method.

    Attributes
    ----------
    table : DataFrame
        One row per kind of event: the number of matched events, the number of (weak) events in one
        run only, and the largest differences of instants, impact speeds and each component of the
        state. The last row is the state at the end of the run, if the comparison reaches it.
    agrees : bool
        False if an event is missing, doubled or shifted in either run without growing differences
        before the event. A motion too sensitive for a comparison to its end agrees as far as the
        comparison reaches.
    horizon : float
        Forcing period up to which the runs were compared and agree.
    verdict : str
        The result in one line.

    See Also
    --------
    Run, simulate

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> run = mi.simulate(actuator, drive, periods=300)
    >>> verification = run.verify()
    >>> verification.agrees, verification.verdict
    (True, 'agree to the end, period 300')
    """

    table: pd.DataFrame = field(repr=False)
    agrees: bool
    horizon: float
    verdict: str

    def summary(self) -> dict[str, Any]:
        """Return the verdict."""
        return {"agrees": self.agrees, "horizon": self.horizon, "verdict": self.verdict}

    def __str__(self) -> str:
        table = with_units(self.table)
        table = table.to_string(index=False, na_rep="", float_format="{:.1e}".format)
        return f"{table}\n{self.verdict}"


def other_family(options: Options, *, stiff: bool = False) -> Options:
    """Return options of a more precise method of an independent family.

    Explicit methods are too slow for a stiff system: there BDF repeats the stiff arcs with smaller
    steps, and independent methods all others.
    """
    first, second = ("auto", "bdf") if stiff else ("dop853", "adams")
    return replace(
        options,
        method=second if options.method in ("dop853", "auto") else first,
        rtol=min(options.rtol, max(TOLERANCE_FACTOR * options.rtol, MIN_RTOL)),
        atol=min(options.atol, max(TOLERANCE_FACTOR * options.atol, MIN_ATOL)),
        max_steps=MORE_STEPS * options.max_steps,
    )


def compare(run: Trajectory, other: Trajectory, rtol: float, labels: Labels) -> Verification:
    """Compare two trajectories of the same motion, from the same initial state over the same time.

    `rtol` is that of the less precise run; the labels are for the table.
    """
    comparison = EventMatcher(EventLog(run), EventLog(other), rtol)
    agrees, horizon, verdict = comparison.walk()
    headings = ["time apart", "impact speed apart"]
    headings += [f"{name} apart" for name in run.automaton.states]
    table = verification(comparison.matched, comparison.alone, headings, labels)
    return Verification(table=table, agrees=agrees, horizon=horizon, verdict=verdict)


class EventLog:
    """The events of one run, followed by its end, as they are compared."""

    def __init__(self, trajectory: Trajectory) -> None:
        automaton = trajectory.automaton
        self.events = trajectory.events[is_shown(trajectory.events)]
        start, final, self.period = trajectory.start, trajectory.final, trajectory.period
        self.start = start.cycle + start.time / self.period
        self.names = event_names(automaton)
        self.codes = np.append(event_codes(self.events, automaton), len(self.names) - 1)
        self.cycle = np.append(self.events.cycle, final.cycle)
        self.time = np.append(self.events.time, final.time)
        self.after = np.vstack([self.events.after, final.y])
        speed = closing_speeds(self.events, trajectory.problem)
        self.speed = np.append(speed, math.nan)
        slow = approach_speeds(self.events, trajectory.problem, speed)
        self.approach = np.append(slow, math.inf)
        self.end = len(self.events)
        self.strength = np.append(self._strength(speed), math.inf)
        # Each event starts in the mode after the previous one; otherwise an event is missing or
        # doubled, however weak.
        modes = np.append(trajectory.start.mode, self.events.mode_after)
        self.broken = modes != np.append(self.events.mode_before, final.mode)
        self.strength[self.broken] = math.inf

    def _strength(self, speed: Floats) -> Floats:
        """Return the strength of each event, as a speed; infinity for a switch of the drive.

        The strength of an impact is its speed. The strength of a change of mode is the duration of
        the modes before and after it: within a time T, accelerations of order one produce a speed
        T. The strength of the start and end of a rest is its duration, whatever else changes before
        and during it.
        """
        events = self.events
        strength = np.where(np.isnan(speed), math.inf, speed)
        changes = np.flatnonzero((events.mode_before != events.mode_after) & np.isnan(speed))
        instants = events.cycle * self.period + events.time
        durations = np.concatenate([[math.inf], np.diff(instants[changes]), [math.inf]])
        strength[changes] = np.minimum(durations[:-1], durations[1:])
        for begins, ends in rests(events):
            lasted = instants[ends] - instants[begins[: ends.size]]
            strength[begins], strength[ends] = math.inf, lasted
            strength[begins[: ends.size]] = lasted
        strength[events.kind == workspace.SWITCH] = math.inf
        return strength

    def at(self, i: int) -> float:
        """Return the instant of event i in forcing periods."""
        return float(self.cycle[i] + self.time[i] / self.period)

    def describe(self, i: int) -> str:
        """Return the name and the instant of event i."""
        return f"'{self.names[self.codes[i]]}' (period {self.at(i):.9g})"


def rests(events: Events) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Yield, for each guard, the events that start rests and the events that end them.

    A rest follows a sequence of impacts and lasts until a mode in which the guard is active. The
    last rest may have no end.
    """
    accumulated = events.kind == workspace.ACCUMULATION
    for guard in np.unique(events.guard[accumulated]):
        selected = events.guard == guard
        striking = np.unique(events.mode_before[selected & (events.kind == workspace.TRANSITION)])
        free = np.flatnonzero(np.isin(events.mode_after, striking))
        begins = np.flatnonzero(accumulated & selected)
        following = np.searchsorted(free, begins, side="right")
        yield begins, free[following[following < free.size]]


def closing_speeds(events: Events, problem: Problem) -> Floats:
    """Return the closing speed before each impact, NaN at other events."""
    automaton = problem.automaton
    impact = events.impacts(automaton)
    speeds = np.full(len(events), math.nan)
    for i in np.flatnonzero(impact):
        mode, time = int(events.mode_before[i]), float(events.time[i])
        p = problem.parameters_at(int(events.cycle[i]))
        _, rates = automaton.margins_at(mode, time, events.before[i], p)
        speeds[i] = abs(rates[int(events.guard[i])])
    return speeds


def approach_speeds(events: Events, problem: Problem, speeds: Floats) -> Floats:
    """Return the speed at which the state approaches the surface of each event's guard.

    The speed of an impact, or of another guard the rate of the margin over the length of its
    gradient. Infinity for events without a guard.
    """
    automaton = problem.automaton
    approach = np.where(np.isnan(speeds), math.inf, speeds)
    others = np.isnan(speeds) & (events.kind == workspace.TRANSITION)
    for i in np.flatnonzero(others):
        mode, time, guard = int(events.mode_before[i]), float(events.time[i]), int(events.guard[i])
        state, p = events.before[i], problem.parameters_at(int(events.cycle[i]))
        margins, rates = automaton.margins_at(mode, time, state, p)
        moved = state + GRADIENT_STEP * np.eye(state.size)
        slopes = [automaton.margins_at(mode, time, y, p)[0][guard] for y in moved]
        length = float(np.linalg.norm((np.array(slopes) - margins[guard]) / GRADIENT_STEP))
        if length > 0.0:
            approach[i] = abs(rates[guard]) / length
    return approach


class EventMatcher:
    """Matches the events of two logs and tracks their recent differences."""

    def __init__(self, run: EventLog, other: EventLog, rtol: float) -> None:
        self.run, self.other, self.until = run, other, run.start
        self.expected = min(EXPECTED_FACTOR * rtol, MAX_EXPECTED)
        self.difference = self.first = self.expected
        self.matched: list[tuple[int, Floats]] = []  # the name of the event, and its `_differences`
        self.alone: list[int] = []  # events that only one run has

    def walk(self) -> tuple[bool, float, str]:
        """Return whether the runs agree, up to which instant, and the verdict."""
        run, other = self.run, self.other
        i, j = 0, 0
        while True:
            match = self._next_match(i, j)
            if match is None and (
                (self._cut_off(run, i) and j == other.end)
                or (self._cut_off(other, j) and i == run.end)
            ):
                self._leave_out((i, j), (run.end, other.end))
                return True, run.at(run.end), self._to_the_end()
            if match is None:
                return False, self.until, (
                    f"do not agree: {run.describe(i)} against {other.describe(j)}, which the "
                    f"differences before, {self.difference:.0e} at most, do not explain"
                )  # fmt: skip
            i, j = self._leave_out((i, j), match)
            differences = self._differences(i, j)
            size = self._size(differences, i, j)
            if size > max(SENSITIVE * self.first, MAX_EXPECTED):
                return True, self.until, (
                    f"agree until period {self.until:.4g}; beyond, the motion is too sensitive: "
                    f"event by event, differences have grown from {self.first:.0e} to {size:.0e}"
                )  # fmt: skip
            self.matched.append((int(run.codes[i]), differences))
            self.until = run.at(i)
            if i == run.end:
                return True, self.until, self._to_the_end()
            largest = float(np.nanmax(differences))
            # It rises at once and decays slowly: the next event does not undo the effect of an
            # impact.
            self.difference = max(largest, 0.5 * self.difference, self.expected)
            if self.until < run.start + FIRST_PERIODS:
                self.first = max(self.first, size)
            i, j = i + 1, j + 1

    def _to_the_end(self) -> str:
        number = len(self.alone)
        weak = f"; weak events in one run only: {number}" if number else ""
        return f"agree to the end, period {self.run.at(self.run.end):.9g}{weak}"

    def _cut_off(self, log: EventLog, i: int) -> bool:
        """Return whether event i is so near the end that the other run may end before it."""
        left = (log.cycle[log.end] - log.cycle[i]) * log.period + log.time[log.end] - log.time[i]
        return bool(i < log.end and left <= GROWTH * self.difference)

    def _next_match(self, i: int, j: int) -> tuple[int, int] | None:
        """Return the next matching events from i and j on, with only weak events between."""
        for skipped in range(MOST_SKIPPED + 1):
            for k in range(i, i + skipped + 1):
                m = j + skipped - (k - i)
                if k > self.run.end or m > self.other.end:
                    continue
                if self._same(k, m) and self._weak(self.run, i, k) and self._weak(self.other, j, m):
                    return k, m
        return None

    def _same(self, i: int, j: int) -> bool:
        if self.run.codes[i] != self.other.codes[j] or self.run.broken[i] or self.other.broken[j]:
            return False
        return self._size(self._differences(i, j), i, j) <= GROWTH * self._grown(self.run, i)

    def _weak(self, log: EventLog, first: int, end: int) -> bool:
        """Return whether the events from `first` up to `end` may be missing in the other run."""
        limit = WEAK_ORDER * math.sqrt(self._grown(log, first))
        return bool((log.strength[first:end] <= limit).all())

    def _grown(self, log: EventLog, i: int) -> float:
        """Return the bound of the last difference at event i, after periods without events."""
        return self.difference * max(1.0, log.at(i) - self.until)

    def _leave_out(self, begins: tuple[int, int], ends: tuple[int, int]) -> tuple[int, int]:
        for log, first, end in zip((self.run, self.other), begins, ends, strict=True):
            self.alone += log.codes[first:end].tolist()
            # From here on the motions differ by the effect of this event.
            self.difference = max(self.difference, float(log.strength[first:end].max(initial=0.0)))
        return ends

    def _differences(self, i: int, j: int) -> Floats:
        """Return the differences of instants, impact speeds and components of the state."""
        run, other = self.run, self.other
        # Subtract whole periods as integers first, so that late instants lose no digits.
        late = (run.cycle[i] - other.cycle[j]) * run.period + (run.time[i] - other.time[j])
        state = np.abs(run.after[i] - other.after[j])
        return np.array([abs(late), abs(run.speed[i] - other.speed[j]), *state])

    def _size(self, differences: Floats, i: int, j: int) -> float:
        """Return the largest of `differences`, without the amplification by a slow approach."""
        speed = max(self.run.approach[i], self.other.approach[j])
        # The instant of a graze differs by the square root of a difference.
        speed = min(SLOW_RATE, max(speed, math.sqrt(self.difference)))
        return speed / SLOW_RATE * float(np.nanmax(differences))
