"""The signature of an orbit: its modes and events in order."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.errors import OrbitError
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.event_loop.workspace import NONE
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import Events, Trajectory, run
from mems_impact.hybrid.state import HybridState

BOUNDARY = -1  # code of a segment that ends with the period, not with an event


@dataclass(frozen=True)
class Segment:
    """A part of an orbit within one mode and one period."""

    mode: int
    cycle: int  # number of the period of the orbit that contains it
    # Code of its end: the number of a guard, that number + m (the last impact of a chatter
    # sequence), 2 m (the drive switches), or BOUNDARY.
    code: int
    switch: int = -1  # number of the switching time, for a switch of the drive

    def guard(self, m: int) -> int:
        """Return the guard, among `m`, that ends it; NONE for the period or a switch."""
        return self.code % m if 0 <= self.code < 2 * m else NONE


@dataclass(frozen=True)
class OrbitGuess:
    """N segments with approximate states at their starts and times at their ends."""

    segments: tuple[Segment, ...]
    states: Floats  # shape (N, n)
    times: Floats  # end of each segment, since the start of its period, shape (N,)
    stiff: bool = False  # whether method ``"auto"`` used BDF in the run
    # Of the segments, as of `Shooting`, whose states follow that of the segment's start.
    nodes: tuple[tuple[float, ...], ...] = ()


def read_guess(
    problem: Problem,
    start: HybridState,
    periods: int,
) -> OrbitGuess:
    """Return the signature of a run of `periods` periods from `start`.

    Raises OrbitError if two transitions are simultaneous, which segments cannot represent.
    """
    start = at_period_start(problem, start)
    trajectory = run(problem, start, periods)
    return read_signature(trajectory, periods, problem.switches)


def at_period_start(problem: Problem, start: HybridState) -> HybridState:
    """Return `start` if a period starts there, else the state at the start of the next period."""
    if start.time != 0.0:
        rest = 1.0 - start.time / problem.period
        start = run(problem, start, rest).final
    return replace(start, cycle=0, time=0.0)


def read_signature(
    trajectory: Trajectory, periods: int, switches: Sequence[float] = ()
) -> OrbitGuess:
    """Divide a trajectory that starts with a period into segments."""
    automaton, period = trajectory.automaton, trajectory.period
    m = len(automaton.guards)
    events = trajectory.events
    segments: list[Segment] = []
    states: list[Floats] = []
    times: list[float] = []
    mode, y, cycle = trajectory.start.mode, _without_cyclic(automaton, trajectory.start.y), 0
    last_events: dict[int, tuple[int, float]] = {}  # last event of each guard

    def close(code: int, time: float, switch: int = -1) -> None:
        segments.append(Segment(mode, cycle, code, switch))
        states.append(y)
        times.append(time)

    chosen = np.flatnonzero(
        np.isin(events.kind, (workspace.TRANSITION, workspace.ACCUMULATION, workspace.SWITCH))
    )
    for i in chosen:
        kind, guard, time = int(events.kind[i]), int(events.guard[i]), float(events.time[i])
        now = (int(events.cycle[i]), time)
        at_end = kind == workspace.SWITCH and time == 0.0  # the switch that closes a period
        if at_end and events.cycle[i] == 0:  # the one before the first
            mode, y = int(events.mode_after[i]), _without_cyclic(automaton, events.after[i])
            continue
        while cycle < events.cycle[i] - at_end:
            close(BOUNDARY, period)
            cycle += 1
            y = _without_cyclic(automaton, _at_boundary(trajectory, cycle))
        if kind == workspace.TRANSITION:
            close(guard, time)
            last_events[guard] = now
        elif kind == workspace.ACCUMULATION and (
            guard not in last_events
            or not completes_chatter(events, int(i))
            or last_events[guard] == now  # flights below rounding: no time for one more
        ):
            close(m + guard, time)
        elif kind == workspace.ACCUMULATION:
            # The event loop skips the remaining sequence after the last located impact. The
            # signature has one more flight, and an impact without rebound after it.
            cycle_of_event, since = last_events[guard]
            last_state = HybridState(cycle, (cycle_of_event - cycle) * period + since, mode, y)
            rest = int(events.mode_after[i])
            for step in completion(
                trajectory.problem, last_state, guard, time - last_state.time, rest
            ):
                close(step.code, step.time)
                mode, y = step.mode, step.after
        else:
            switch = int(np.argmin(np.abs(np.array(switches) - (period if at_end else time))))
            close(automaton.switch_code, period if at_end else time, switch)
        mode, y = int(events.mode_after[i]), _without_cyclic(automaton, events.after[i])
        if at_end:
            cycle += 1
    closing = np.flatnonzero(np.abs(np.array(switches) - period) <= 1e-12 * period)
    while cycle < periods:
        if closing.size:
            close(automaton.switch_code, period, int(closing[0]))
        else:
            close(BOUNDARY, period)
        cycle += 1
        if cycle < periods:
            y = _without_cyclic(automaton, _at_boundary(trajectory, cycle))
    for (one, earlier), (two, later) in pairwise(zip(segments, times, strict=True)):
        if two.cycle == one.cycle and later <= earlier:
            raise OrbitError(
                reason="two transitions coincide at "
                f"{later / period:.6g} of the period after its start",
                remedy="change the parameter slightly",
            )
    return OrbitGuess(tuple(segments), np.array(states), np.array(times), trajectory.stiff)


def completes_chatter(events: Events, i: int) -> bool:
    """Return whether row `i` completes a chatter sequence and is no impact itself.

    The event loop records two cases: a contact without closing speed is an impact without rebound;
    where it skips the rest of a sequence, the state before is the state after the last impact.
    """
    return i > 0 and bool(np.array_equal(events.before[i], events.after[i - 1]))


class TransitionRecord(NamedTuple):
    """A transition: code, time since the start of the orbit's period, new mode, and states."""

    code: int
    time: float
    mode: int
    before: Floats
    after: Floats


def completion(
    problem: Problem, state: HybridState, guard: int, length: float, rest: int
) -> Iterator[TransitionRecord]:
    """Yield the transitions from `state`, after an impact at `guard`, until the mode `rest`.

    The next impact is one without rebound. Events that it causes (such as a slip) end within
    `length`, the remaining duration of the chatter sequence.
    """
    automaton, mode = problem.automaton, state.mode
    for step in _transitions(problem, state, length):
        if step.code != guard:
            yield step
            mode = step.mode
            continue
        code, time, p = len(automaton.guards) + guard, step.time, problem.parameters
        mode, y = automaton.state_after(mode, code, time, step.before, p)
        yield TransitionRecord(code, time, mode, step.before, y)
        for later in _transitions(problem, replace(state, time=time, mode=mode, y=y), length):
            if mode == rest:
                return
            yield later
            mode = later.mode
        return


def _transitions(problem: Problem, start: HybridState, length: float) -> Iterator[TransitionRecord]:
    events = run(problem, start, length / problem.period).events
    for i in np.flatnonzero(events.kind == workspace.TRANSITION):
        time = (events.cycle[i] - start.cycle) * problem.period + events.time[i]
        mode, before, after = int(events.mode_after[i]), events.before[i], events.after[i]
        yield TransitionRecord(int(events.guard[i]), float(time), mode, before, after)


def _at_boundary(trajectory: Trajectory, cycle: int) -> Floats:
    """Return the state at the start of period `cycle`."""
    samples = trajectory.samples(1, first=float(cycle), last=float(cycle))
    return np.asarray(samples.y[0])


def _without_cyclic(automaton: Automaton, y: Floats) -> Floats:
    result = np.array(y, dtype=float)
    result[list(automaton.cyclic)] = 0.0
    return result
