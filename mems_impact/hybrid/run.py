"""Running an automaton: the driver around the event loop."""

from __future__ import annotations

import contextlib
import math
import warnings
from collections.abc import Callable, Sequence

import numpy as np

from mems_impact.engines import contract
from mems_impact.errors import FunctionError, InvalidParameter, RunError
from mems_impact.hybrid import loop, record
from mems_impact.hybrid.clocks import AT_TIMES, is_clock
from mems_impact.hybrid.memory import LoopMemory
from mems_impact.hybrid.opposed import LOOKED_AT, SLIDE, opposed
from mems_impact.hybrid.problem import Problem, bind
from mems_impact.hybrid.trajectory import Events, Floats, Instant, Samples, Trajectory
from mems_impact.interruptions import RunInterrupted
from mems_impact.warnings import StiffnessWarning

__all__ = ["Problem", "run", "sample"]

MAX_CYCLE = 2**53  # beyond, events could not tell one period from the next
STIFF = (
    "the system is stiff: stability, not accuracy, limits the steps of method 'dop853'; "
    "method='auto', or method='bdf', may be faster"
)
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
    whole = math.floor(periods)
    phase = start.time + (periods - whole) * problem.period
    end = Instant(start.cycle + whole, phase, start.mode, start.y)
    return _Run(problem, start, end, 0, consume, progress).go()


def sample(problem: Problem, start: Instant, end: Instant, per_period: int) -> Samples:
    """Run again from `start` to `end` and return the state at equal intervals of every period."""
    # That the system is stiff, the run itself has said.
    run_again = _Run(problem, start, end, per_period, lambda _: None, None, quiet=True)
    # A run that failed fails again in the same place: its samples end there.
    with contextlib.suppress(RunError):
        run_again.go()
    rows = run_again.memory.samples[: run_again.clock["taken"]]
    integer = rows[:, :3].astype(np.int64)
    return Samples(integer[:, 0], rows[:, 1].copy(), integer[:, 2], rows[:, 3:].copy())


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
        quiet: bool = False,
    ) -> None:
        self.problem, self.start = problem, start
        self.consume, self.progress, self.quiet = consume, progress, quiet
        self.kept: list[Floats] = []
        self.bound = bind(problem)
        self.bound.engine.learn(start.remembered)
        # The epsilon keeps a sample that falls on the start itself.
        first = math.ceil((start.time / problem.period - 1e-12) * per_period)
        last = (end.cycle - start.cycle) * per_period
        last += math.floor(end.time / problem.period * per_period + 1e-9)
        self.memory = LoopMemory(
            problem,
            self.bound,
            max(0, last - first + 1),
            cycle=start.cycle,
            t=start.time,
            mode=start.mode,
            end_cycle=end.cycle,
            end_phase=end.time,
            events_from=start.cycle,
            per_period=per_period,
            sample_cycle=start.cycle,
            sample=first,
        )
        self.memory.put(start.y)
        self.clock, self.events = self.memory.clock, self.memory.events
        self.latest = self.events[:0]  # the last events, whoever consumes them

    def go(self) -> Trajectory:
        """Call the loop until it is done, draining its events in between."""
        falls = None if self.quiet else self.problem.falls
        try:
            status = loop.PAUSED
            while status in (loop.PAUSED, loop.BUFFER_FULL):
                status = self.bound.call(loop.advance, self.clock, self.bound.quota)
                self._drain()
                fall = self.memory.take_fall()
                if fall is not None and falls is not None and falls(*fall):
                    falls = None  # once in a run
                if self.progress is not None:
                    self.progress(self._done())
        except KeyboardInterrupt:
            # The loop answers before Python hears of it, so that clock and buffers are whole.
            self._drain()
            raise RunInterrupted(self._trajectory(), self._done()) from None
        except FunctionError as error:
            self._drain()
            raise self._ended_by(error.reason, error.remedy) from error
        finally:
            if self.bound.engine.is_stiff() and not self.quiet:
                warnings.warn(STIFF, StiffnessWarning, stacklevel=4)
            self.bound.engine.close()
        if status not in (loop.DONE, loop.ENDED):
            raise self._failure(status)
        return self._trajectory(ended=status == loop.ENDED)

    def _done(self) -> float:
        """Return the periods done so far."""
        elapsed = self.clock["t"] / self.problem.period - self.start.cycle
        return float(self.clock["cycle"] + elapsed)

    def _drain(self) -> None:
        rows = self.events[: self.clock["rows"]]
        self.latest = np.concatenate([self.latest, rows[-LOOKED_AT:]])[-LOOKED_AT:]
        if self.consume is not None:
            self.consume(Events.from_rows(rows))
        else:
            self.kept.append(rows.copy())
        self.clock["rows"] = 0

    def _trajectory(self, *, ended: bool = False) -> Trajectory:
        width = self.events.shape[1]
        rows = np.concatenate(self.kept) if self.kept else np.zeros((0, width))
        clock, period = self.clock, self.problem.period
        cycle, phase = int(clock["cycle"]), float(clock["t"])
        if phase == (clock["end_cycle"] - cycle) * period + clock["end_phase"]:
            # Dividing k periods by the period may round to just below k.
            cycle, phase = int(clock["end_cycle"]), float(clock["end_phase"])
        ahead = math.floor(phase / period)
        return Trajectory(
            problem=self.problem,
            start=self.start,
            final=Instant(
                cycle + ahead,
                phase - ahead * period,
                int(clock["mode"]),
                self.memory.state,
                self.bound.engine.learnt(),
            ),
            events=Events.from_rows(rows),
            steps=int(clock["steps"]),
            arcs=int(clock["arcs"]),
            ended=ended,
            implicit_arcs=self.bound.engine.implicit_arcs,
        )

    def _name_of(self, code: int) -> str:
        """Return the name of a guard, or of the switch of the drive."""
        guards = self.problem.automaton.guards
        return guards[code].name if code < len(guards) else "drive switch"

    def _failure(self, status: int) -> RunError:
        clock, options = self.clock, self.problem.options
        failure, instant = int(clock["failure"]), int(clock["instant"])
        automaton = self.problem.automaton
        name = self._name_of(failure) if status in NAMED else ""
        reason, remedy = {
            loop.FAILED: (
                contract.FAILURES.get(failure, f"CVODE failed ({failure})"),
                "check parameters and drive at this time; loosen or tighten rtol and atol",
            ),
            loop.STEP_BUDGET: (
                f"one arc took more than max_steps = {options.max_steps} steps",
                "raise max_steps, loosen rtol, or use method 'auto' if the system is stiff",
            ),
            loop.EVENT_BUDGET: (
                f"one period held more than max_events = {options.max_events} events"
                + (f", {instant} of them in its last instant" if instant > 1 else ""),
                "raise max_events if so many events are expected; a body that is pressed against a "
                "stop never rests if its impacts lose nothing (restitution 1)",
            ),
            loop.CYCLING: (
                f"the same state comes back after {instant} transitions in one instant",
                "the transitions of the automaton undo each other: check guards and transition",
            ),
            loop.INADMISSIBLE: (
                f"the start lies beyond the guard {name!r}",
                "start where its margin is not negative, or turn the margin's sign",
            ),
            loop.WITHOUT_EFFECT: (
                f"the transition of the guard {name!r} changes nothing, and its margin falls on",
                "let the transition turn the closing speed round, or take it away",
            ),
            loop.NO_SUCH_MODE: (
                f"a transition returned the mode {failure}; there are {len(automaton.modes)}",
                f"let it return 0 to {len(automaton.modes) - 1}",
            ),
            loop.NOT_FINITE: (
                f"the transition of {name!r} left a state that is not finite",
                "check the transition and the parameters",
            ),
        }[status]
        guards = automaton.guards
        at_guard = status == loop.EVENT_BUDGET and failure < len(guards)
        if at_guard and instant > 1 and not guards[failure].impact:
            remedy = (
                f"let the transition of {guards[failure].name!r} turn the rate of its margin, or "
                "lead to a mode in which it does not watch: while its margin falls it fires again"
            )
        elif at_guard and 2 * instant > options.max_events:
            remedy = (
                "raise max_events: bodies that touch in a row strike each other very often within "
                "one instant, and the more often the more of them there are"
            )
        here = self.memory.local.tolist()
        if at_guard and instant > 1 and is_clock(self._margin_of(failure), here):
            remedy = AT_TIMES
        if status == loop.NO_SUCH_MODE and failure == loop.NO_REST:
            reason = "a sequence of ever weaker impacts has come to its end"
            remedy = "say with rest= of the Impact in which mode and state the bodies stay together"
        if status == loop.NO_SUCH_MODE and failure == record.NO_FIT:
            reason = "two switching surfaces attract the state at once: no mode says how it slides"
            remedy = "write modes of your own for where they meet, or make the two one Surface"
        if status in (loop.CYCLING, loop.EVENT_BUDGET):
            latest = Events.from_rows(self.latest)
            opposite = opposed(latest, self.problem)
            reason, remedy = (opposite, SLIDE) if opposite else (reason, remedy)
        if failure in (contract.NON_FINITE, contract.NO_GUARD) and status == loop.FAILED:
            found = self._searched()
            if found is not None:
                reason, remedy = f"{reason}: {found.reason}", found.remedy
        return self._ended_by(reason, remedy)

    def _margin_of(self, guard: int) -> Callable[[Sequence[float]], float]:
        """Return the margin of a guard, by the state, in the mode and at the time of now."""
        clock, problem = self.clock, self.problem
        margins, rates = np.zeros((2, len(problem.automaton.guards)))
        p = np.array(problem.parameters, dtype=float)

        def margin(y: Sequence[float]) -> float:
            problem.automaton.margins(
                int(clock["mode"]), float(clock["t"]), np.array(y), p, margins, rates
            )
            return float(margins[guard])

        return margin

    def _searched(self) -> FunctionError | None:
        """Return what is wrong with flow or margins where the run has come to."""
        from mems_impact.hybrid.faults import searched
        from mems_impact.hybrid.tried import Place

        clock, problem = self.clock, self.problem
        point = Place(int(clock["mode"]), float(clock["t"]), self.memory.local.tolist())
        return searched(problem.automaton, np.asarray(problem.parameters).tolist(), point)

    def _ended_by(self, reason: str, remedy: str) -> RunError:
        """Return the error that ends the run, with what was computed."""
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
            trajectory=trajectory,
        )
