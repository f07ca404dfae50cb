"""Detection of the period of a motion, and of divergence."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact.errors import OrbitError, RunError
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import Trajectory, run
from mems_impact.hybrid.state import HybridState
from mems_impact.hybrid.variational.derivatives import free_components
from mems_impact.orbits.shooting import ACCEPTED

# --- Divergence of a motion.

MAX_STATE_RATIO = ACCEPTED / float(np.finfo(float).eps)
"""Magnitude of a state beyond which rounding exceeds the allowed residual."""
DIVERGED = "the motion has diverged"
UNBOUNDED_REMEDY = (
    "give a guess near an orbit, without a transient that leads away from it, or parameters at "
    "which motions stay bounded"
)


def diverged_component(problem: Problem, at: HybridState) -> int | None:
    """Return the largest component of a diverged state; None if it has not diverged."""
    free = list(free_components(problem.automaton))
    sizes = np.nan_to_num(np.abs(at.y[free]), nan=np.inf)
    return free[int(np.argmax(sizes))] if sizes.size and sizes.max() > MAX_STATE_RATIO else None


def check_bounded(problem: Problem, at: HybridState) -> None:
    """Raise OrbitError, with the instant, if a motion has diverged."""
    if diverged_component(problem, at) is not None:
        raise OrbitError(DIVERGED, UNBOUNDED_REMEDY, at)


# --- Dependence of functions on time and on components of the state.

INSTANTS = 64  # at which the functions are looked at: few enough to be quick, a pulse may be short
UNEVEN = 0.6180339887498949  # part of the period from one to the next, so that none coincide
FAR = (-0.618034, 0.381966, 7.23607)  # parts of a size by which a state is shifted
EQUAL_RTOL = 1e-9  # difference, relative to the largest, of what is the same but for rounding

_Function = Callable[[int, float, Floats], Any]  # of mode, time and state


def is_time_dependent(problem: Problem, y: Floats) -> bool:
    """Return whether flow, margins or transitions at a state depend on time, in any mode.

    A function without it returns the same to the last bit, whenever it is called.
    """
    if problem.switches:
        return True
    return any(
        _varies(each, mode, y, problem.period)
        for mode in range(len(problem.automaton.modes))
        for each in _functions(problem)
    )


def state_enters(problem: Problem, at: HybridState, shift: Floats, *, exactly: bool) -> bool:
    """Return whether flow, margins or transitions change if the state is shifted.

    With `exactly`, a difference of the order of rounding counts as well.
    """
    try:
        for each in _functions(problem, shift):
            here, there = each(at.mode, at.time, at.y), each(at.mode, at.time, at.y + shift)
            size = 0.0 if exactly else float(np.abs(np.nan_to_num(here)).max(initial=0.0))
            if not np.allclose(there, here, rtol=0.0, atol=EQUAL_RTOL * size, equal_nan=True):
                return True
    except (ArithmeticError, ValueError, IndexError):
        return True
    return False


def unread(problem: Problem, at: HybridState, component: int) -> bool:
    """Return whether no function depends on a component of the state at an instant."""
    shift = np.zeros(at.y.size)
    shift[component] = 1.0 + abs(at.y[component])
    return not any(state_enters(problem, at, f * shift, exactly=True) for f in FAR)


def _functions(problem: Problem, shift: Floats | None = None) -> Iterator[_Function]:
    """Yield flow, margins and transitions; for a shifted state the change by a transition."""
    automaton = problem.automaton
    p = np.array(problem.parameters, dtype=float)

    def flow(mode: int, t: float, y: Floats) -> Any:
        return automaton.slope_at(mode, t, y, p)

    def margins(mode: int, t: float, y: Floats) -> Any:
        return automaton.margins_at(mode, t, y, p)[0]

    def transition(code: int) -> _Function:
        def after(mode: int, t: float, y: Floats) -> Any:
            into, new = automaton.state_after(mode, code, t, y, p)
            return [into, *(new if shift is None else np.where(shift == 0.0, new, new - y))]

        return after

    yield flow
    yield margins
    yield from (transition(code) for code in range(2 * len(automaton.guards)))


def _varies(function: _Function, mode: int, y: Floats, period: float) -> bool:
    times = (UNEVEN * i % 1.0 * period for i in range(INSTANTS))
    try:
        first = function(mode, 0.0, y)
        return not all(np.array_equal(function(mode, t, y), first, equal_nan=True) for t in times)
    except (ArithmeticError, ValueError, IndexError):
        return False  # a state that does not belong to the mode


# --- Detection of the period in a run.

RETURN_DISTANCE_RATIO = 1e-3  # distance of a return, relative to the extent of the motion
CONVERGENCE_RTOL = (
    1e-8  # distance, as a part of the state, at which nothing more is to be looked at
)
FAR_CLOSER = 1e-2  # ratio of distances at which a later return is the true one
MULTIPLES = 4  # of the first return that are looked at for a closer one
MAX_FORCING_PERIODS = 16  # largest number of forcing periods of a detected orbit
RETURN_RTOL = 1e-7  # distance, as a part of the motion, of what comes back and not just near
ROUNDING_ATOLS = 1e2  # absolute tolerances by which states differ that are one
EXTENT_SAMPLES = 256  # by which the extent of a motion is measured
LEAST, ENOUGH = 4, 16  # returns to a section that are looked at, at least; to the first of them
MIN_RUN_LENGTH = 1e-6  # piece of a run, in units of the problem's time
MIN_RETURN_TIME = 1e-12  # time after which a motion is no longer where it began
MIN_EXTENT_RATIO = 1e-7  # extent, relative to the largest, below which the motion is at rest
STEPS, LOST = 300_000, 20_000  # of a motion that does not return; at its first state


def first_return(
    states: Floats, modes: NDArray[np.int64], extent: Floats, *, from_last: bool = False
) -> int:
    """Return after how many states of a sequence the first (or last) one repeats; 0 for never.

    Parameters
    ----------
    states : float array, shape (k, f)
    modes : int array, shape (k,)
    extent : float array, shape (f,)
        Of the motion in each component; 0 where it has none.
    from_last : bool, optional
        Whether the sequence is to have settled at its end, not to begin near the orbit. The return
        must then have happened three times.
    """
    if from_last:
        states, modes = states[::-1], modes[::-1]
    size = np.where(extent > 0.0, extent, 1.0)
    apart = np.abs((states - states[0]) / size).max(axis=1)
    apart[modes != modes[0]] = np.inf
    last = (len(states) - 1) // 3 if from_last else len(states) - 1
    for k in range(1, last + 1):
        if apart[k] < RETURN_DISTANCE_RATIO and (
            not from_last or apart[2 * k] < 2.0 * RETURN_DISTANCE_RATIO
        ):
            multiples = [j * k for j in range(1, MULTIPLES + 1) if j * k <= last]
            # Near a period doubling every second return is far closer.
            return next((j for j in multiples[1:] if apart[j] < FAR_CLOSER * apart[k]), k)
    return 0


def amplitude_of(trajectory: Trajectory, free: list[int]) -> Floats:
    """Return the extent of a run in each free component, over its last half."""
    first, last = (
        at.cycle + at.time / trajectory.period for at in (trajectory.start, trajectory.final)
    )
    each = math.ceil(EXTENT_SAMPLES / (last - first))
    grid = trajectory.samples(each, 0.5 * (first + last), last)
    return np.asarray(np.ptp(grid.y[:, free], axis=0))


class PeriodEstimate(NamedTuple):
    """After how many forcing periods a motion returns.

    Attributes
    ----------
    once : Trajectory
        Its first period.
    near : int
        To its beginning; 0 if it does not.
    later : HybridState
        Where it has come after many periods.
    settled : int
        To that; 0 if it does not, or that was not looked at.
    """

    once: Trajectory
    near: int
    later: HybridState
    settled: int


def detect_forcing_periods(problem: Problem, start: HybridState) -> PeriodEstimate:
    """Recognise after how many forcing periods the motion from the start of a period returns."""
    free = list(free_components(problem.automaton))
    once = run(problem, start, 1)
    change = np.abs(once.final.y - start.y)[free].max(initial=0.0)
    if once.final.mode == start.mode and change <= CONVERGENCE_RTOL * np.abs(start.y[free]).max(
        initial=0.0
    ):
        return PeriodEstimate(once, 1, start, 0)
    extent = amplitude_of(once, free)
    try:
        longer = run(problem, start, 3 * MAX_FORCING_PERIODS)
    except RunError:
        return PeriodEstimate(once, 0, start, 0)  # the orbit may lie where no run stays
    grid = longer.samples(1)
    near = first_return(
        grid.y[: MAX_FORCING_PERIODS + 1, free], grid.mode[: MAX_FORCING_PERIODS + 1], extent
    )
    settled = first_return(grid.y[:, free], grid.mode, amplitude_of(longer, free), from_last=True)
    return PeriodEstimate(once, near, replace(longer.final, cycle=0, time=0.0), settled)


def detect_period(
    problem: Problem, start: HybridState, told: Callable[[str, float], str] | None = None
) -> tuple[HybridState, float]:
    """Recognise after which time the motion of a system without forcing returns.

    The run goes on, for ever longer, until it comes back to where it began or where it last came
    through a section: the plane, through where this piece of the run began, of the component that
    changes fastest there. ``told(heading, value)`` gives a number in the units of the user.

    Returns
    -------
    instant, period
        A state near the cycle, and the time after which the motion returns to it.

    Raises
    ------
    OrbitError
        If it does not, or comes to rest; the last `HybridState` is in it.
    """
    free = [i for i in free_components(problem.automaton) if not unread(problem, start, i)]
    free = free or list(free_components(problem.automaton))
    largest = np.zeros(len(free))
    length, steps, elapsed = _first_length(problem, start), 0, 0.0
    while steps < STEPS:
        section = _section(problem, start, largest, free)
        piece = run(replace(problem, section=section), start, length)
        steps, elapsed = steps + piece.steps, elapsed + length * problem.period
        check_bounded(problem, replace(piece.final, cycle=0, time=elapsed))
        extent = amplitude_of(piece, free)
        largest = np.maximum(largest, extent)
        if not (extent > MIN_EXTENT_RATIO * largest).any():
            raise OrbitError(
                reason="the motion comes to rest: an equilibrium was reached, not a cycle",
                remedy="take a guess farther away, or other parameters",
                partial=piece.final,
            )
        returns = SectionReturns.of(piece, start, int(np.sign(flow_at(problem, start)[section[0]])))
        found = returns.recognised(free, extent)
        if found is not None:
            return found
        # A piece that is too short to come back is run again, longer, unless it never does.
        if len(returns.times) > ENOUGH or steps > LOST:
            start = replace(piece.final, cycle=0, time=0.0)
        length *= 2.0
    lasted = f"{elapsed:.9g}" if told is None else told("time", elapsed)
    raise OrbitError(
        reason=f"the motion does not come back to where it was within a time of {lasted}",
        remedy="let transients die out (transient=…, in units of time), give a guess nearer to a "
        "cycle, or say with time_scale= that it is slow; a chaotic motion does not settle at all",
        partial=start,
    )


@dataclass(frozen=True)
class SectionReturns:
    """Where a motion is in a section: first where it begins.

    Attributes
    ----------
    times : float array, shape (k,)
    states : float array, shape (k, n)
    modes : int array, shape (k,)
    """

    times: Floats
    states: Floats
    modes: NDArray[np.int64]

    @classmethod
    def of(cls, piece: Trajectory, start: HybridState, direction: int) -> SectionReturns:
        """Return where a run that begins in its section comes through it in a direction."""
        log = piece.events.crossings(direction)
        times = log.cycle * piece.period + log.time - start.time
        later = times > MIN_RETURN_TIME * piece.period  # it may be seen to leave the section
        return cls(
            np.append(0.0, times[later]),
            np.vstack([start.y, log.before[later]]),
            np.append(start.mode, log.mode_before[later]),
        )

    def recognised(self, free: list[int], extent: Floats) -> tuple[HybridState, float] | None:
        """Return where and after how long the motion returns, to its beginning or to its end."""
        if len(self.times) <= LEAST:
            return None
        states = self.states[:, free]
        k = first_return(states, self.modes, extent)
        if k:
            return self._instant(0), float(self.times[k])
        k = first_return(states, self.modes, extent, from_last=True)
        if k:
            return self._instant(-1), float(self.times[-1] - self.times[-1 - k])
        return None

    def _instant(self, i: int) -> HybridState:
        return HybridState(0, 0.0, int(self.modes[i]), self.states[i])


def _first_length(problem: Problem, start: HybridState) -> float:
    """Return the length of the first piece, in periods of the problem: within it little happens."""
    size, rate = np.abs(start.y).max(), np.abs(flow_at(problem, start)).max()
    if not rate > 0.0:
        return 1.0
    return float(min(1.0, max(size / rate / problem.period, MIN_RUN_LENGTH)))


def _section(
    problem: Problem, start: HybridState, extent: Floats, free: list[int]
) -> tuple[int, float, int]:
    """Return the plane through a state of the component that changes fastest there.

    Against its `extent` so far, where there has been one.
    """
    slope = flow_at(problem, start)[free] / np.where(extent > 0.0, extent, 1.0)
    place = int(np.argmax(np.abs(slope)))
    return free[place], float(start.y[free[place]]), 0


def returns(problem: Problem, start: HybridState, *, forced: bool) -> bool:
    """Return whether a motion comes back to where it is, after some periods, to many digits."""
    free = list(free_components(problem.automaton))
    try:
        if forced:
            longer = run(problem, start, MAX_FORCING_PERIODS)
            grid = longer.samples(1, start.cycle + start.time / problem.period)
            states, modes = grid.y, grid.mode
        else:
            start, length = detect_period(problem, replace(start, cycle=0, time=0.0))
            longer = run(problem, start, length / problem.period)
            states, modes = (
                np.stack([start.y, longer.final.y]),
                np.array([start.mode, longer.final.mode]),
            )
    except (OrbitError, RunError):
        return False
    size = np.maximum(amplitude_of(longer, free), np.abs(states[0, free]))
    apart = np.abs(states[1:, free] - states[0, free])
    nothing = ROUNDING_ATOLS * problem.options.atol
    return bool(
        ((apart <= RETURN_RTOL * size + nothing).all(axis=1) & (modes[1:] == modes[0])).any()
    )


def flow_at(problem: Problem, instant: HybridState) -> Floats:
    """Return the flow at an instant, shape (n,)."""
    p = np.array(problem.parameters, dtype=float)
    return problem.automaton.slope_at(instant.mode, instant.time, instant.y, p)
