"""Simulation of an automaton: the run, its trajectory, events and samples."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact._util.ctrl_c import deferring_ctrl_c
from mems_impact._util.warning_scopes import warn
from mems_impact.errors import (
    FunctionError,
    Interrupted,
    InvalidParameter,
    RunError,
    StiffnessWarning,
)
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.diagnostics.failures import AT_TIMES, depends_on_time_only
from mems_impact.hybrid.engine import LoopMemory, create_engine
from mems_impact.hybrid.event_loop import loop, workspace
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators import interface

# --- Results of a run


INSTANT_RTOL = 1e-12  # part of the period within which two instants are one


@dataclass(frozen=True)
class Events:
    """Rows of the event log, as columns of shape (k,), states (k, n)."""

    cycle: NDArray[np.int64]  # periods completed before the event
    time: Floats  # since the start of that period, 0 <= time < period
    # TRANSITION, ACCUMULATION, SWITCH, APPROACH, SECTION_CROSSING, REBASE or HANDOVER of
    # `mems_impact.hybrid.event_loop.loop`.
    kind: NDArray[np.int64]
    # Number of the guard; for a crossing of the section the sign of the crossing; for a handover
    # the engine's memory of the mode (see `mems_impact.integrators.auto.stiffness`).
    guard: NDArray[np.int64]
    mode_before: NDArray[np.int64]
    mode_after: NDArray[np.int64]
    before: Floats  # the state just before the event
    after: Floats  # the state just after the event

    @classmethod
    def from_rows(cls, rows: Floats) -> Events:
        """Split the rows of the loop's event buffer into columns."""
        integers = rows[:, : workspace.HEAD].astype(np.int64)
        n = (rows.shape[1] - workspace.HEAD) // 2
        return cls(
            cycle=integers[:, workspace.CYCLE],
            time=rows[:, workspace.TIME].copy(),
            kind=integers[:, workspace.KIND],
            guard=integers[:, workspace.GUARD],
            mode_before=integers[:, workspace.MODE_BEFORE],
            mode_after=integers[:, workspace.MODE_AFTER],
            before=rows[:, workspace.HEAD : workspace.HEAD + n].copy(),
            after=rows[:, workspace.HEAD + n :].copy(),
        )

    @classmethod
    def joined(cls, chunks: Sequence[Events]) -> Events:
        """Join one or more chunks of events."""
        if len(chunks) == 1:
            return chunks[0]
        columns = ([getattr(chunk, column.name) for chunk in chunks] for column in fields(cls))
        return cls(*(np.concatenate(parts) for parts in columns))

    @property
    def starts_arc(self) -> NDArray[np.bool_]:
        """Whether each row begins an arc that can be integrated again.

        Approaches and section crossings lie inside an arc; a handover belongs to the arc before it.
        """
        return ~np.isin(
            self.kind, (workspace.APPROACH, workspace.SECTION_CROSSING, workspace.HANDOVER)
        )

    def arcs_until(self, since: Floats) -> NDArray[np.bool_]:
        """Return where the rows begin an arc that contains or precedes an instant.

        `since`, shape (k,), is the time of each row since the instant, in periods. The state at the
        time of a switch is the state before the switch, of the arc that the switch ends.
        """
        at_switch = bool((np.abs(since[self.kind == workspace.SWITCH]) <= INSTANT_RTOL).any())
        return self.starts_arc & (since <= (-INSTANT_RTOL if at_switch else 0.0))

    @property
    def handovers(self) -> Events:
        """Changes of the integration method."""
        return self[self.kind == workspace.HANDOVER]

    def remembered(self, initial: tuple[int, ...]) -> tuple[int, ...]:
        """Return the engine's memory of each mode after these rows, from the memory before."""
        rows = self.handovers
        memory = dict(enumerate(initial))
        memory |= zip(rows.mode_after.tolist(), rows.guard.tolist(), strict=True)
        return tuple(memory.get(mode, 0) for mode in range(max(memory, default=-1) + 1))

    def impacts(self, automaton: Automaton) -> NDArray[np.bool_]:
        """Return whether each row is an impact."""
        return self.impacts_among(automaton.guards)

    def impacts_among(self, guards: Sequence[Guard]) -> NDArray[np.bool_]:
        """Return whether each row is an impact, from the first guards of an automaton."""
        numbers = [i for i, guard in enumerate(guards) if guard.impact]
        return (self.kind == workspace.TRANSITION) & np.isin(self.guard, numbers)

    def crossings(self, direction: int) -> Events:
        """Return the crossings of the section in `direction` (0: both)."""
        is_crossing = self.kind == workspace.SECTION_CROSSING
        return self[is_crossing if direction == 0 else is_crossing & (self.guard == direction)]

    def instant(self, row: int) -> HybridState:
        """Return the instant just after an event."""
        return HybridState(
            int(self.cycle[row]),
            float(self.time[row]),
            int(self.mode_after[row]),
            self.after[row].copy(),
            switched=bool((self.kind[self.simultaneous(row)] == workspace.SWITCH).any()),
        )

    def simultaneous(self, row: int) -> slice:
        """Return the rows of the instant of an event, up to this event."""
        first = row
        while first > 0 and all(each[first - 1] == each[row] for each in (self.cycle, self.time)):
            first -= 1
        return slice(first, row + 1)

    def __len__(self) -> int:
        return self.cycle.size

    def __getitem__(self, rows: NDArray[np.bool_] | slice) -> Events:
        """Return the chosen rows."""
        return Events(
            self.cycle[rows],
            self.time[rows],
            self.kind[rows],
            self.guard[rows],
            self.mode_before[rows],
            self.mode_after[rows],
            self.before[rows],
            self.after[rows],
        )


@dataclass(frozen=True)
class Samples:
    """The state at k times."""

    cycle: NDArray[np.int64]
    time: Floats  # since the start of the period `cycle`, shape (k,)
    mode: NDArray[np.int64]
    y: Floats  # shape (k, n)


@dataclass(frozen=True)
class Trajectory:
    """A run: first and last state, and the recorded events."""

    problem: Problem = field(repr=False, compare=False)
    start: HybridState
    final: HybridState
    events: Events
    steps: int  # of the method
    arcs: int  # restarts of the method
    ended: bool  # whether a transition ended the run
    # States at equal intervals, recorded during the run; by default none.
    checkpoints: Samples = field(repr=False)
    implicit_arcs: int = 0  # number of arcs that method ``"auto"`` began with BDF

    @property
    def automaton(self) -> Automaton:
        """The automaton of the run."""
        return self.problem.automaton

    @property
    def period(self) -> float:
        """Unit of run lengths."""
        return self.problem.period

    @property
    def stiff(self) -> bool:
        """Whether method ``"auto"`` preferred BDF in any visited mode.

        Only recorded events are known.
        """
        if (self.events.handovers.guard == 0).any():
            return True
        memory, visited = self.final.remembered, {self.start.mode, *self.events.mode_after.tolist()}
        return any(memory[mode] < 0 for mode in visited) if memory else False

    def with_events(self, events: Events) -> Trajectory:
        """Return the trajectory with other recorded events."""
        return replace(self, events=events)

    def samples(
        self, per_period: int, first: float | None = None, last: float | None = None
    ) -> Samples:
        """Return the state at `per_period` equal intervals of every period.

        `first` and `last` bound a window in periods; the whole run by default. The arcs concerned
        are integrated again. Steps do not depend on output times, so the samples lie exactly on the
        trajectory of the run.
        """
        end = self.final
        if last is not None:
            cycle = math.floor(last)
            end = self._end_at(cycle, (last - cycle) * self.period)
        samples = resample(self.problem, self._arc_before(first), end, CheckpointGrid(per_period))
        if first is None:
            return samples
        rows = samples.cycle + samples.time / self.period >= first - INSTANT_RTOL
        return Samples(samples.cycle[rows], samples.time[rows], samples.mode[rows], samples.y[rows])

    def at(self, instants: Floats) -> Samples:
        """Return the state at ascending instants: periods and times in them, shape (k, 2)."""
        cycle, time = instants[0]
        start, (last, phase) = self._arc_before(cycle + time / self.period), instants[-1]
        return resample(self.problem, start, self._end_at(int(last), float(phase)), instants)

    def _end_at(self, cycle: int, time: float) -> HybridState:
        """Return an instant, at most the end of the run, as the end of another run."""
        final = self.final
        if (cycle, time) < (final.cycle, final.time):
            return HybridState(cycle, time, final.mode, final.y)
        return final

    def _arc_before(self, first: float | None) -> HybridState:
        """Return the start of the last recorded arc that begins before `first` periods."""
        if first is None:
            return self.start
        events, cycles = self.events, math.floor(first)
        is_start = events.arcs_until(
            events.cycle - cycles + (events.time / self.period - (first - cycles))
        )
        # The loop completes a chatter sequence from its memory of earlier impacts, so an arc within
        # one can only be integrated again from the start of the sequence.
        instants = events.cycle * self.period + events.time
        count = np.count_nonzero(events.cycle + events.time / self.period <= first)
        for guard in range(len(self.automaton.guards)):
            is_own = events.guard == guard
            ends = np.flatnonzero(is_own & (events.kind == workspace.ACCUMULATION))
            later_ends = ends[ends >= count]
            if later_ends.size:
                previous = ends[ends < count][-1] if later_ends.size < ends.size else -1
                impacts = np.flatnonzero(is_own & (events.kind == workspace.TRANSITION))
                impacts = impacts[(impacts > previous) & (impacts < later_ends[0])]
                flights = np.diff(instants[impacts])
                breaks = np.flatnonzero(flights[1:] >= flights[:-1])
                sequence = impacts[breaks[-1] + 1 :] if breaks.size else impacts
                if sequence.size:
                    is_start[sequence[0] : later_ends[0]] = False
        rows = np.flatnonzero(is_start)
        if rows.size == 0:
            return self.start
        i = int(rows[-1])
        memory = events[:i].remembered(self.start.remembered)
        now, guards = events[events.simultaneous(i)], self.automaton.guards
        fired = set(now.guard[now.kind == workspace.TRANSITION].tolist())
        waiting = tuple(j for j in sorted(fired) if not (guards[j].condition or guards[j].impact))
        return replace(events.instant(i), remembered=memory, waiting=waiting)


# --- Missing sliding mode

LAST_EVENTS = 4  # events examined at the end of a run
OFFSET_PERIODS = 1e-3  # time by which a state is moved back to find the side of a mode
SIMULTANEITY_PERIODS = 1e-6  # time within which these events lie

SLIDING_REMEDY = (
    "say how the state slides between them, in a mode of its own "
    "(mems_impact.SwitchingSurface does), or give the switching a hysteresis"
)


def missing_sliding_mode(events: Events, problem: Problem) -> str:
    """Return a description of two opposed modes at the end of a run, or "".

    The flow of each mode leads back to the switching surface, so that their events alternate
    without end at one instant.
    """
    automaton, period = problem.automaton, problem.period
    tail = slice(-LAST_EVENTS, None)
    modes, targets = events.mode_before[tail], events.mode_after[tail]
    if len(modes) < LAST_EVENTS or not (events.kind[tail] == workspace.TRANSITION).all():
        return ""
    times = events.cycle[tail] * period + events.time[tail]
    is_alternating = (modes[1:] == targets[:-1]).all() and (modes[2:] == modes[:-2]).all()
    if not is_alternating or modes[0] == modes[1] or np.ptp(times) > SIMULTANEITY_PERIODS * period:
        return ""
    guards = [automaton.guards[i] for i in sorted(set(events.guard[tail].tolist()))]
    if any(guard.impact for guard in guards):
        return ""
    if len(guards) == 1 and _share_side(problem, events):
        return ""
    first, second = (repr(automaton.modes[mode]) for mode in sorted(modes[:2].tolist()))
    names = " and ".join(repr(guard.name) for guard in guards)
    return f"the modes {first} and {second} push against each other at {names}: neither can last"


def _share_side(problem: Problem, events: Events) -> bool:
    """Return whether both modes lie on the same side of their common guard.

    Both flows then cross it in the same direction, and the modes are not opposed.
    """
    automaton, p = problem.automaton, problem.parameters_at(int(events.cycle[-1]))
    mode, other_mode = events.mode_before[-2:].tolist()
    time, y, guard = float(events.time[-1]), events.before[-1], int(events.guard[-1])
    y_behind = y - OFFSET_PERIODS * problem.period * automaton.slope_at(mode, time, y, p)

    def is_above(candidate: int) -> bool:
        return bool(automaton.margins_at(candidate, time, y_behind, p)[0][guard] > 0.0)

    return is_above(mode) == is_above(other_mode)


# --- Driver of the event loop


class CheckpointGrid(NamedTuple):
    """Times of samples: every `interval` of `per_period` equal parts of a period."""

    per_period: int
    interval: int = 1

    def instants(self, start: HybridState, end: HybridState, period: float) -> Floats:
        """Return the periods and the times in them from `start` to `end`, shape (k, 2)."""
        per_period, interval = self
        if per_period == 0:
            return np.empty((0, 2))
        # The tolerance includes a sample at the start itself.
        first = math.ceil((start.time / period - INSTANT_RTOL) * per_period)
        last = (end.cycle - start.cycle) * per_period
        last += math.floor(end.time / period * per_period + 1e-9)
        shift = last % interval if per_period == 1 else 0  # the last checkpoint is at the end
        first, last = -(-(first - shift) // interval), (last - shift) // interval
        if last - first >= MAX_SAMPLES:
            allowed = (
                f"at most {MAX_SAMPLES:,}: take a shorter part of the run, or fewer per period"
            )
            raise InvalidParameter(
                field="number of samples", value=last - first + 1, allowed=allowed
            )
        cycle, part = np.divmod(np.arange(first, last + 1) * interval, per_period)
        return np.column_stack([start.cycle + shift + cycle, part * period / per_period])


MAX_SAMPLES = 2**25  # 1.6 GB for a motion of three states
NO_CHECKPOINTS = CheckpointGrid(0)
MAX_CYCLE = 2**53  # larger integers are not exact in the columns of events
STIFF = (
    "the system is stiff: stability, not accuracy, limits the steps of method 'dop853'; "
    "method 'auto' or 'bdf' may be faster"
)
GUARD_FAILURES = (
    workspace.INADMISSIBLE,
    workspace.WITHOUT_EFFECT,
    workspace.NOT_FINITE,
)  # failures at a guard


def run(
    problem: Problem,
    start: HybridState,
    periods: float,
    *,
    consume: Callable[[Events], None] | None = None,
    progress: Callable[[float], None] | None = None,
    checkpoints: CheckpointGrid = NO_CHECKPOINTS,
) -> Trajectory:
    """Integrate `problem` from `start` over `periods`, above 0.

    `consume` is called with every chunk of events. The chunks are then discarded, and memory does
    not grow with the length of the run. `progress` is called several times a second with the
    completed periods. Raises InvalidParameter if `start` does not fit the automaton or `periods` is
    out of range; RunError if the run cannot continue, and Interrupted on Ctrl-C, both with the
    partial result.
    """
    end = _end(problem, start, periods)
    return Simulation(problem, start, end, checkpoints, consume, progress).go()


def _end(problem: Problem, start: HybridState, periods: float) -> HybridState:
    """Return the end time of a run; raise InvalidParameter if an argument is invalid."""
    if not 0.0 < periods <= MAX_CYCLE:
        allowed = f"above 0 and up to {MAX_CYCLE:g}"
        raise InvalidParameter(field="periods", value=periods, allowed=allowed)
    automaton = problem.automaton
    if np.shape(start.y) != (len(automaton.states),):
        allowed = f"one number for each of {', '.join(automaton.states)}"
        raise InvalidParameter(field="start.y", value=start.y, allowed=allowed)
    if start.mode not in range(len(automaton.modes)):
        allowed = f"0 to {len(automaton.modes) - 1}"
        raise InvalidParameter(field="start.mode", value=start.mode, allowed=allowed)
    if not (math.isfinite(start.time) and start.time >= 0.0):
        allowed = "finite and not negative: time since the start of a period"
        raise InvalidParameter(field="start.time", value=start.time, allowed=allowed)
    if not (abs(start.cycle) <= MAX_CYCLE and start.cycle == int(start.cycle)):
        allowed = f"a whole number of periods, up to {MAX_CYCLE:g}"
        raise InvalidParameter(field="start.cycle", value=start.cycle, allowed=allowed)
    cycles = math.floor(periods)
    phase = start.time + (periods - cycles) * problem.period
    return HybridState(start.cycle + cycles, phase, start.mode, start.y)


def resample(
    problem: Problem, start: HybridState, end: HybridState, times: CheckpointGrid | Floats
) -> Samples:
    """Repeat the run from `start` to `end`, and return the state at some times."""
    # Quiet, since the run itself has warned that the system is stiff.
    simulation = Simulation(problem, start, end, times, lambda _: None, None, quiet=True)
    # A run that failed fails again at the same place, and its samples end there.
    with contextlib.suppress(RunError):
        simulation.go()
    return simulation.samples


class Position(NamedTuple):
    """Progress of a run; `steps`, `arcs` and `implicit_arcs` as in `Trajectory`."""

    final: HybridState
    steps: int
    arcs: int
    implicit_arcs: int
    events: int  # recorded events that have not been handed over


class Simulation:
    """A run in progress: the loop's memory and the events drained from its buffers."""

    def __init__(
        self,
        problem: Problem,
        start: HybridState,
        end: HybridState,
        checkpoints: CheckpointGrid | Floats,
        consume: Callable[[Events], None] | None,
        progress: Callable[[float], None] | None,
        quiet: bool = False,
    ) -> None:
        self.problem, self.start = problem, start
        self.consume, self.progress, self.quiet = consume, progress, quiet
        self.chunks: list[Floats] = []
        self.binding = create_engine(problem)
        self.binding.engine.import_memory(start.remembered)
        if isinstance(checkpoints, CheckpointGrid):
            checkpoints = checkpoints.instants(start, end, problem.period)
        self.memory = LoopMemory(
            problem,
            self.binding,
            len(checkpoints),
            cycle=start.cycle,
            t=start.time,
            mode=start.mode,
            switched=int(start.switched),
            initial=int(start.initial),
            end_cycle=end.cycle,
            end_phase=end.time,
            events_from=start.cycle,
        )
        self.memory.samples[:, :2] = checkpoints
        self.memory.put(start)
        self.clock, self.events = self.memory.clock, self.memory.events
        self.last_rows = self.events[:0]  # the last events, even if `consume` takes them
        self.reached = self._position()

    def go(self) -> Trajectory:
        """Call the loop until the end, and drain its events between calls."""
        check = None if self.quiet else self.problem.discontinuity_check
        try:
            status = workspace.PAUSED
            while status in (workspace.PAUSED, workspace.BUFFER_FULL):
                status = self.binding.quota.call(self.binding.call, loop.run_steps, self.clock)
                # A pause depends on the speed of the machine, chunks of events must not: the
                # rounding errors of statistics depend on them.
                self._note_progress(drain=status != workspace.PAUSED)
                collapse = self.memory.take_step_collapse()
                if collapse is not None and check is not None and check(*collapse):
                    check = None  # at most one warning per run
                if self.progress is not None:
                    self.progress(self._elapsed_periods())
        except KeyboardInterrupt:
            # Interpreted code may be anywhere: the rest after the last return is discarded.
            self.clock["events_written"] = self.reached.events
            with deferring_ctrl_c():
                self._drain()
            after = f"{self._elapsed_periods():g} periods"
            raise Interrupted("run", after, self._trajectory()) from None
        except FunctionError as error:
            self._note_progress(drain=True)
            raise self._run_error(error.reason, error.remedy) from error
        finally:
            if self.binding.engine.is_stiff() and not self.quiet:
                warn(STIFF, StiffnessWarning)
            self.binding.engine.close()
        if status not in (workspace.DONE, workspace.ENDED):
            raise self._failure(status)
        return self._trajectory(ended=status == workspace.ENDED)

    @property
    def samples(self) -> Samples:
        """The samples taken so far."""
        rows = self.memory.samples[: self.clock["samples_written"]]
        integers = rows[:, :3].astype(np.int64)
        return Samples(integers[:, 0], rows[:, 1].copy(), integers[:, 2], rows[:, 3:].copy())

    def _elapsed_periods(self) -> float:
        """Return the completed periods."""
        final = self.reached.final
        return float(final.cycle + (final.time / self.problem.period - self.start.cycle))

    def _drain(self) -> None:
        rows = self.events[: self.clock["events_written"]]
        self.last_rows = np.concatenate([self.last_rows, rows[-LAST_EVENTS:]])[-LAST_EVENTS:]
        if self.consume is not None:
            self.consume(Events.from_rows(rows))
        else:
            self.chunks.append(rows.copy())
        self.clock["events_written"] = 0

    def _note_progress(self, *, drain: bool) -> None:
        """Note how far the run has come; with `drain`, hand over the recorded events first."""
        with deferring_ctrl_c():  # which would count events twice
            if drain:
                self._drain()
            self.reached = self._position()

    def _position(self) -> Position:
        clock, period = self.clock, self.problem.period
        cycle, phase = int(clock["cycle"]), float(clock["t"])
        if phase == (clock["end_cycle"] - cycle) * period + clock["end_phase"]:
            # Dividing k periods by the period may round to just below k.
            cycle, phase = int(clock["end_cycle"]), float(clock["end_phase"])
        carry = math.floor(phase / period)
        final = HybridState(
            cycle + carry,
            phase - carry * period,
            int(clock["mode"]),
            self.memory.state,
            self.binding.engine.export_memory(),
            bool(clock["switched"]),
            waiting=self.memory.waiting,
        )
        return Position(
            final,
            int(clock["steps"]),
            int(clock["arcs"]),
            self.binding.engine.implicit_arcs,
            int(clock["events_written"]),
        )

    def _trajectory(self, *, ended: bool = False) -> Trajectory:
        width = self.events.shape[1]
        rows = np.concatenate(self.chunks) if self.chunks else np.zeros((0, width))
        final, steps, arcs, implicit_arcs, _ = self.reached
        return Trajectory(
            problem=self.problem,
            start=self.start,
            final=final,
            events=Events.from_rows(rows),
            steps=steps,
            arcs=arcs,
            ended=ended,
            implicit_arcs=implicit_arcs,
            checkpoints=self.samples,
        )

    def _name_of(self, code: int) -> str:
        """Return the name of a guard, or "drive switch"."""
        guards = self.problem.automaton.guards
        return guards[code].name if code < len(guards) else "drive switch"

    def _failure(self, status: int) -> RunError:
        clock, options = self.clock, self.problem.options
        failure, transitions = int(clock["failure"]), int(clock["transitions_now"])
        automaton = self.problem.automaton
        name = self._name_of(failure) if status in GUARD_FAILURES else ""
        reason, remedy = {
            workspace.FAILED: (
                interface.FAILURES.get(failure, f"CVODE failed ({failure})"),
                "check parameters and drive at this time; loosen or tighten rtol and atol",
            ),
            workspace.STEP_BUDGET: (
                f"one arc took more than max_steps = {options.max_steps} steps",
                "raise max_steps, loosen rtol, or use method 'auto' if the system is stiff",
            ),
            workspace.EVENT_BUDGET: (
                f"one period held more than max_events = {options.max_events} events"
                + (f", {transitions} of them in its last instant" if transitions > 1 else ""),
                "raise max_events if so many events are expected; a body that is pressed against a "
                "stop never rests if its impacts lose nothing (restitution 1)",
            ),
            workspace.CYCLING: (
                f"the same state comes back after {transitions} transitions in one instant",
                "the transitions of the automaton undo each other: check guards and transition",
            ),
            workspace.INADMISSIBLE: (
                f"the start lies beyond the guard {name!r}",
                "start where its margin is not negative, or turn the margin's sign",
            ),
            workspace.WITHOUT_EFFECT: (
                f"the transition of the guard {name!r} changes nothing, but its margin falls",
                "let the transition reverse the closing speed, or set it to zero",
            ),
            workspace.NO_SUCH_MODE: (
                f"a transition returned the mode {failure}; there are {len(automaton.modes)}",
                f"let it return 0 to {len(automaton.modes) - 1}",
            ),
            workspace.NOT_FINITE: (
                f"the transition of {name!r} left a state that is not finite",
                "check the transition and the parameters",
            ),
        }[status]
        guards = automaton.guards
        is_at_guard = status == workspace.EVENT_BUDGET and failure < len(guards)
        if is_at_guard and transitions > 1 and not guards[failure].impact:
            remedy = (
                f"let the transition of {guards[failure].name!r} reverse the rate of its margin, "
                "or lead to a mode in which the guard is not active: a falling margin fires again"
            )
        elif is_at_guard and 2 * transitions > options.max_events:
            remedy = (
                "raise max_events: bodies that touch in a row strike each other very often within "
                "one instant, the more often the longer the row"
            )
        y = self.memory.local.tolist()
        fires_again = is_at_guard and transitions > 1
        if (fires_again or status == workspace.INADMISSIBLE) and depends_on_time_only(
            self._margin_of(failure), y
        ):
            remedy = AT_TIMES
        if status == workspace.NO_SUCH_MODE and failure == workspace.NO_REST:
            reason = "a chatter sequence has ended"
            remedy = "give mode and state of the sticking contact as rest= of the Impact"
        if status == workspace.NO_SUCH_MODE and failure == workspace.NO_ZERO:
            name = automaton.guards[int(Events.from_rows(self.last_rows).guard[-1])].name
            reason = f"rounding errors hide the zero of the margin of {name!r}, which is flat there"
            remedy = "give the gap itself as the margin, such as h in place of h - sin(h)"
        mode_failure = self.problem.mode_failure
        if status == workspace.NO_SUCH_MODE and failure <= workspace.NO_FIT and mode_failure:
            at = HybridState(
                int(clock["cycle"]), float(clock["t"]), int(clock["mode"]), np.array(y)
            )
            reason, remedy = mode_failure(failure, at)
        if status in (workspace.CYCLING, workspace.EVENT_BUDGET):
            events = Events.from_rows(self.last_rows)
            description = missing_sliding_mode(events, self.problem)
            reason, remedy = (description, SLIDING_REMEDY) if description else (reason, remedy)
        if (
            failure in (interface.NON_FINITE, interface.ROOT_FUNCTION_FAILED)
            and status == workspace.FAILED
        ):
            error = self._invalid_value()
            if error is not None:
                reason, remedy = f"{reason}: {error.reason}", error.remedy
        return self._run_error(reason, remedy)

    def _margin_of(self, guard: int) -> Callable[[Sequence[float]], float]:
        """Return the margin of a guard as a function of the state, in the present mode and time."""
        clock, problem = self.clock, self.problem
        p = problem.parameters_at(int(clock["cycle"]))

        def margin(y: Sequence[float]) -> float:
            margins, _ = problem.automaton.margins_at(clock["mode"], clock["t"], np.array(y), p)
            return float(margins[guard])

        return margin

    def _invalid_value(self) -> FunctionError | None:
        """Return an error of flow or margins at the present state, or None."""
        from mems_impact.hybrid.diagnostics.failures import find_invalid_value
        from mems_impact.hybrid.diagnostics.user_functions import EvaluationPoint

        clock, problem = self.clock, self.problem
        time = float(clock["t"])
        if not problem.automaton.forced:
            time += int(clock["cycle"]) * problem.period
        point = EvaluationPoint(int(clock["mode"]), time, self.memory.local.tolist())
        return find_invalid_value(problem.automaton, np.asarray(problem.parameters).tolist(), point)

    def _run_error(self, reason: str, remedy: str) -> RunError:
        """Return the error that ends the run, with the partial result."""
        automaton = self.problem.automaton
        trajectory = self._trajectory()
        final = trajectory.final
        return RunError(
            reason=reason,
            remedy=remedy,
            cycle=final.cycle,
            phase_time=final.time,
            mode=automaton.modes[final.mode],
            state=dict(zip(automaton.states, final.y.tolist(), strict=True)),
            partial=trajectory,
            period=self.problem.period,
        )
