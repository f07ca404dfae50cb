"""Running an automaton: the driver around the event loop."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable

import numpy as np

from mems_impact.engines import contract
from mems_impact.errors import InvalidParameter, RunError, RunInterrupted
from mems_impact.hybrid import loop
from mems_impact.hybrid.problem import Problem, bind
from mems_impact.hybrid.record import buffers_for
from mems_impact.hybrid.trajectory import Events, Floats, Instant, Samples, Trajectory

__all__ = ["Problem", "run"]

EVENT_ROWS = 4096
MAX_CYCLE = 2**53  # beyond, events could not tell one period from the next
NAMED = (loop.INADMISSIBLE, loop.WITHOUT_EFFECT, loop.NOT_FINITE)  # failures at a guard


def run(
    problem: Problem,
    start: Instant,
    periods: float,
    *,
    consume: Callable[[Events], None] | None = None,
    progress: Callable[[float], None] | None = None,
) -> Trajectory:
    """Integrate `problem` from `start` over `periods`.

    Parameters
    ----------
    problem : Problem
    start : Instant
    periods : float
        Length of the run in periods, above 0.
    consume : callable, optional
        Called with every chunk of events as it comes. The chunks are then not kept: the memory of
        the run does not grow with its length.
    progress : callable, optional
        Called with the periods done so far, several times a second.

    Returns
    -------
    Trajectory

    Raises
    ------
    InvalidParameter
        If `start` does not fit the automaton, or `periods` is out of range.
    RunError
        If the run cannot go on; what was computed is in it.
    RunInterrupted
        On Ctrl-C, with what was computed.
    """
    if not (math.isfinite(periods) and periods > 0.0):
        raise InvalidParameter(field="periods", value=periods, allowed="finite and above 0")
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
    whole = math.floor(periods)
    phase = start.time + (periods - whole) * problem.period
    end = Instant(start.cycle + whole, phase, start.mode, start.y)
    return _Run(problem, start, end, 0, consume, progress).go()


def _sampler(problem: Problem) -> Callable[[Instant, Instant, int], Samples]:
    def sample(start: Instant, end: Instant, per_period: int) -> Samples:
        run_again = _Run(problem, start, end, per_period, lambda _: None, None)
        # A run that failed fails again in the same place: its samples end there.
        with contextlib.suppress(RunError):
            run_again.go()
        rows = run_again.buffers.samples[: run_again.clock.samples]
        integer = rows[:, :3].astype(np.int64)
        return Samples(integer[:, 0], rows[:, 1].copy(), integer[:, 2], rows[:, 3:].copy())

    return sample


class _Run:
    """One run in progress: the loop's memory, its buffers, and what has been drained from them."""

    def __init__(
        self,
        problem: Problem,
        start: Instant,
        end: Instant,
        per_period: int,
        consume: Callable[[Events], None] | None,
        progress: Callable[[float], None] | None,
    ) -> None:
        automaton = problem.automaton
        n, m = len(automaton.states), len(automaton.guards)
        self.problem, self.start = problem, start
        self.consume, self.progress = consume, progress
        self.kept: list[Floats] = []
        self.bound = bind(problem)
        self.y = np.array(start.y, dtype=float)
        self.layout = loop.Layout(
            order=np.array([guard.order for guard in automaton.guards], dtype=np.int64),
            impact=np.array([guard.impact for guard in automaton.guards], dtype=np.int64),
            cyclic=np.array([i in automaton.cyclic for i in range(n)], dtype=np.int64),
            switches=np.array(problem.switches, dtype=float),
        )
        # The epsilon keeps a sample that falls on the start itself.
        first = math.ceil((start.time / problem.period - 1e-12) * per_period)
        last = (end.cycle - start.cycle) * per_period
        last += math.floor(end.time / problem.period * per_period + 1e-9)
        rows = max(0, last - first + 1)
        self.buffers = buffers_for(n, m, EVENT_ROWS + m, rows)
        clock = self.bound.record(loop.CLOCK)
        clock.cycle, clock.t, clock.mode = start.cycle, start.time, start.mode
        clock.modes = len(automaton.modes)
        clock.period = problem.period
        clock.scale = problem.time_scale or problem.period
        clock.rtol, clock.atol = problem.options.rtol, problem.options.atol
        clock.end_cycle, clock.end_phase = end.cycle, end.time
        clock.fresh, clock.restart, clock.pending = 1, 1, loop.NONE
        clock.stop = math.inf
        clock.max_steps = problem.options.max_steps
        clock.max_events = problem.options.max_events
        clock.events_from = start.cycle
        clock.per_period, clock.sample_cycle, clock.sample = per_period, start.cycle, first
        self.clock = clock

    def go(self) -> Trajectory:
        """Call the loop until it is done, draining its events in between."""
        try:
            status = loop.PAUSED
            while status in (loop.PAUSED, loop.BUFFER_FULL):
                status = self.bound.call(
                    loop.advance,
                    self.clock,
                    self.y,
                    *self.layout,
                    *self.buffers,
                    self.bound.quota,
                )
                self._drain()
                if self.progress is not None:
                    self.progress(self._done())
        except KeyboardInterrupt:
            # The loop answers before Python hears of it, so that clock and buffers are whole.
            self._drain()
            raise RunInterrupted(self._trajectory(), self._done()) from None
        finally:
            self.bound.close()
        if status != loop.DONE:
            raise self._failure(status)
        return self._trajectory()

    def _done(self) -> float:
        """Return the periods done so far."""
        elapsed = self.clock.t / self.problem.period - self.start.cycle
        return float(self.clock.cycle + elapsed)

    def _drain(self) -> None:
        rows = self.buffers.events[: self.clock.rows]
        if self.consume is not None:
            self.consume(Events.from_rows(rows))
        else:
            self.kept.append(rows.copy())
        self.clock.rows = 0

    def _trajectory(self) -> Trajectory:
        width = self.buffers.events.shape[1]
        rows = np.concatenate(self.kept) if self.kept else np.zeros((0, width))
        clock, period = self.clock, self.problem.period
        cycle, phase = int(clock.cycle), float(clock.t)
        if phase == (clock.end_cycle - cycle) * period + clock.end_phase:
            # Dividing k periods by the period may round to just below k.
            cycle, phase = int(clock.end_cycle), float(clock.end_phase)
        ahead = math.floor(phase / period)
        return Trajectory(
            automaton=self.problem.automaton,
            period=period,
            start=self.start,
            final=Instant(
                cycle + ahead,
                phase - ahead * period,
                int(clock.mode),
                self.y + self.buffers.offset,
            ),
            events=Events.from_rows(rows),
            steps=int(clock.steps),
            arcs=int(clock.arcs),
            _sampler=_sampler(self.problem),
        )

    def _name_of(self, code: int) -> str:
        """Return the name of a guard, or of the switch of the drive."""
        guards = self.problem.automaton.guards
        return guards[code].name if code < len(guards) else "drive switch"

    def _failure(self, status: int) -> RunError:
        clock, options = self.clock, self.problem.options
        automaton = self.problem.automaton
        name = self._name_of(int(clock.failure)) if status in NAMED else ""
        reason, remedy = {
            loop.FAILED: (
                contract.FAILURES.get(int(clock.failure), f"CVODE failed ({clock.failure})"),
                "check parameters and drive at this time; loosen or tighten rtol and atol",
            ),
            loop.STEP_BUDGET: (
                f"one arc took more than max_steps = {options.max_steps} steps",
                "raise max_steps, loosen rtol, or use method 'bdf' if the system is stiff",
            ),
            loop.EVENT_BUDGET: (
                f"one period held more than max_events = {options.max_events} events"
                + (f", {clock.instant} of them in its last instant" if clock.instant > 1 else ""),
                "raise max_events if so many events are expected; a body that is pressed against a "
                "stop never rests if its impacts lose nothing (restitution 1)",
            ),
            loop.CYCLING: (
                f"the same state comes back after {clock.instant} transitions in one instant",
                "the transitions of the automaton undo each other: check guards and transition",
            ),
            loop.INADMISSIBLE: (
                f"the start lies beyond the guard {name!r}",
                "start where its margin is not negative",
            ),
            loop.WITHOUT_EFFECT: (
                f"the transition of the guard {name!r} changes nothing, and its margin falls on",
                "let the transition turn the closing speed round, or take it away",
            ),
            loop.NO_SUCH_MODE: (
                f"a transition returned the mode {clock.failure}; there are {len(automaton.modes)}",
                f"let it return 0 to {len(automaton.modes) - 1}",
            ),
            loop.NOT_FINITE: (
                f"the transition of {name!r} left a state that is not finite",
                "check the transition and the parameters",
            ),
        }[status]
        trajectory = self._trajectory()
        final = trajectory.final
        return RunError(
            reason=reason,
            remedy=remedy,
            cycle=final.cycle,
            phase_time=final.time,
            mode=automaton.modes[final.mode],
            state=dict(zip(automaton.states, final.y.tolist(), strict=True)),
            trajectory=trajectory,
        )
