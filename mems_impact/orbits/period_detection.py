"""Detection of the period of a run from which an orbit is sought, and of divergence.

`hybrid.attractors.recurrence` decides whether the attractors of studies are periodic.
"""

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
from mems_impact.orbits.shooting import RESIDUAL_TOLERANCE

# --- Divergence

MAX_STATE_RATIO = RESIDUAL_TOLERANCE / float(np.finfo(float).eps)
"""Magnitude of a state beyond which rounding exceeds the allowed residual."""
DIVERGED = "the motion has diverged"
UNBOUNDED_REMEDY = (
    "give a guess near an orbit without a transient, or parameters at which motions stay bounded"
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


# --- Dependence of functions on time and on components of the state

INSTANTS = 64  # evaluation times of a function
INSTANT_SPACING = 0.6180339887498949  # in periods; irrational, so that no times coincide
SHIFT_RATIOS = (-0.618034, 0.381966, 7.23607)  # relative shifts of a state
EQUAL_RTOL = 1e-9  # difference of equal values by rounding, relative to the largest

_Function = Callable[[int, float, Floats], Any]  # of mode, time and state


def is_time_dependent(problem: Problem, y: Floats) -> bool:
    """Return whether flow, margins or transitions at a state depend on time, in any mode.

    A function of the state alone returns bitwise equal values at all times.
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
            value, shifted = each(at.mode, at.time, at.y), each(at.mode, at.time, at.y + shift)
            size = 0.0 if exactly else float(np.abs(np.nan_to_num(value)).max(initial=0.0))
            if not np.allclose(shifted, value, rtol=0.0, atol=EQUAL_RTOL * size, equal_nan=True):
                return True
    except (ArithmeticError, ValueError, IndexError):
        return True
    return False


def unread(problem: Problem, at: HybridState, component: int) -> bool:
    """Return whether all functions are independent of a component of the state at an instant."""
    shift = np.zeros(at.y.size)
    shift[component] = 1.0 + abs(at.y[component])
    return not any(state_enters(problem, at, f * shift, exactly=True) for f in SHIFT_RATIOS)


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
    times = (INSTANT_SPACING * i % 1.0 * period for i in range(INSTANTS))
    try:
        first = function(mode, 0.0, y)
        return not all(np.array_equal(function(mode, t, y), first, equal_nan=True) for t in times)
    except (ArithmeticError, ValueError, IndexError):
        return False  # the state is outside the domain of the mode


# --- Detection of the period in a run

RETURN_DISTANCE_RATIO = 1e-3  # distance of a return, relative to the extent of the motion
CONVERGENCE_RTOL = 1e-8  # change over one period, relative to the state, of a converged motion
CLOSER_RETURN_RATIO = 1e-2  # ratio of distances at which a multiple of a return replaces it
MULTIPLES = 4  # of the first return that are compared with it
MAX_FORCING_PERIODS = 16  # largest number of forcing periods of a detected orbit
RETURN_RTOL = 1e-7  # distance of an exact return, relative to the extent of the motion
ROUNDING_ATOLS = 1e2  # difference of equal states, in absolute tolerances
EXTENT_SAMPLES = 256  # samples for the extent of a motion
MIN_RETURNS, RENEWAL_RETURNS = (
    4,
    16,
)  # returns to a section: least number; number after which it is renewed
MIN_RUN_LENGTH = 1e-6  # of a run, in units of the problem's time
MIN_RETURN_TIME = 1e-12  # of the first crossing of the section
MIN_EXTENT_RATIO = 1e-7  # extent, relative to the largest, below which the motion is at rest
MAX_STEPS, RENEWAL_STEPS = (
    300_000,
    20_000,
)  # maximum of steps; to renew the section


def first_return(
    states: Floats, modes: NDArray[np.int64], extent: Floats, *, from_last: bool = False
) -> int:
    """Return the number of states after which the first (or last) one recurs; 0 for none.

    `states` has the shape (k, f), `extent` of the motion in each component (f,). For a sequence
    that converges (`from_last`), the recurrence must have occurred at least twice.
    """
    if from_last:
        states, modes = states[::-1], modes[::-1]
    size = np.where(extent > 0.0, extent, 1.0)
    distances = np.abs((states - states[0]) / size).max(axis=1)
    distances[modes != modes[0]] = np.inf
    last = (len(states) - 1) // 3 if from_last else len(states) - 1
    for k in range(1, last + 1):
        if distances[k] < RETURN_DISTANCE_RATIO and (
            not from_last or distances[2 * k] < 2.0 * RETURN_DISTANCE_RATIO
        ):
            multiples = [j * k for j in range(1, MULTIPLES + 1) if j * k <= last]
            # Near a period doubling every second return is much closer.
            return next(
                (j for j in multiples[1:] if distances[j] < CLOSER_RETURN_RATIO * distances[k]), k
            )
    return 0


def amplitude_of(trajectory: Trajectory, free: list[int]) -> Floats:
    """Return the extent of the second half of a run in each free component."""
    first, last = (
        at.cycle + at.time / trajectory.period for at in (trajectory.start, trajectory.final)
    )
    each = math.ceil(EXTENT_SAMPLES / (last - first))
    grid = trajectory.samples(each, 0.5 * (first + last), last)
    return np.asarray(np.ptp(grid.y[:, free], axis=0))


class PeriodEstimate(NamedTuple):
    """Number of forcing periods after which a motion returns."""

    first_period: Trajectory
    start_periods: int  # until a return to its start; 0 without one
    end: HybridState  # state after many periods
    end_periods: int  # between returns to that state; 0 without one, or if not computed


def detect_forcing_periods(problem: Problem, start: HybridState) -> PeriodEstimate:
    """Detect the number of forcing periods after which a motion returns."""
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
        return PeriodEstimate(once, 0, start, 0)  # the orbit may be unstable
    grid = longer.samples(1)
    near = first_return(
        grid.y[: MAX_FORCING_PERIODS + 1, free], grid.mode[: MAX_FORCING_PERIODS + 1], extent
    )
    settled = first_return(grid.y[:, free], grid.mode, amplitude_of(longer, free), from_last=True)
    return PeriodEstimate(once, near, replace(longer.final, cycle=0, time=0.0), settled)


def detect_period(
    problem: Problem, start: HybridState, amount: Callable[[str, float], str] | None = None
) -> tuple[HybridState, float]:
    """Detect the period of a motion of an autonomous system.

    Runs of increasing length continue until the motion returns to its first or to its last crossing
    of a section: the plane through the start of a run normal to its fastest component. The result
    is a state near the cycle, and the time after which the motion returns to it. ``amount(heading,
    value)`` gives a number in the units of the user. Raises OrbitError if the motion does not
    return, or reaches an equilibrium; `partial` is the last state.
    """
    free = [i for i in free_components(problem.automaton) if not unread(problem, start, i)]
    free = free or list(free_components(problem.automaton))
    largest = np.zeros(len(free))
    length, steps, elapsed = _first_length(problem, start), 0, 0.0
    while steps < MAX_STEPS:
        section = _section(problem, start, largest, free)
        piece = run(replace(problem, section=section), start, length)
        steps, elapsed = steps + piece.steps, elapsed + length * problem.period
        check_bounded(problem, replace(piece.final, cycle=0, time=elapsed))
        extent = amplitude_of(piece, free)
        largest = np.maximum(largest, extent)
        if not (extent > MIN_EXTENT_RATIO * largest).any():
            raise OrbitError(
                reason="an equilibrium was reached, not a cycle",
                remedy="take a guess farther away, or other parameters",
                partial=piece.final,
            )
        returns = SectionReturns.of(piece, start, int(np.sign(flow_at(problem, start)[section[0]])))
        recognized = returns.recognized(free, extent)
        if recognized is not None:
            return recognized
        # A run without returns is repeated with twice the length; with enough returns, or after
        # too many steps, the section is renewed at its end.
        if len(returns.times) > RENEWAL_RETURNS or steps > RENEWAL_STEPS:
            start = replace(piece.final, cycle=0, time=0.0)
        length *= 2.0
    lasted = f"{elapsed:.9g}" if amount is None else amount("time", elapsed)
    raise OrbitError(
        reason=f"no return to a previous state was found within a time of {lasted}",
        remedy="raise transient (in units of time), give a guess closer to a cycle, or set "
        "time_scale= for a slow system; a chaotic motion does not converge",
        partial=start,
    )


@dataclass(frozen=True)
class SectionReturns:
    """Start of a motion in a section, and its k crossings of the section."""

    times: Floats  # shape (k,)
    states: Floats  # shape (k, n)
    modes: NDArray[np.int64]  # shape (k,)

    @classmethod
    def of(cls, piece: Trajectory, start: HybridState, direction: int) -> SectionReturns:
        """Return the crossings in a direction of a run that starts in its section."""
        log = piece.events.crossings(direction)
        times = log.cycle * piece.period + log.time - start.time
        later = times > MIN_RETURN_TIME * piece.period  # excludes the start itself
        return cls(
            np.append(0.0, times[later]),
            np.vstack([start.y, log.before[later]]),
            np.append(start.mode, log.mode_before[later]),
        )

    def recognized(self, free: list[int], extent: Floats) -> tuple[HybridState, float] | None:
        """Return the state and time of a return to the first or to the last crossing, or None."""
        if len(self.times) <= MIN_RETURNS:
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
    """Return the length of the first run, in periods: at most a time scale of the flow."""
    size, rate = np.abs(start.y).max(), np.abs(flow_at(problem, start)).max()
    if not rate > 0.0:
        return 1.0
    return float(min(1.0, max(size / rate / problem.period, MIN_RUN_LENGTH)))


def _section(
    problem: Problem, start: HybridState, extent: Floats, free: list[int]
) -> tuple[int, float, int]:
    """Return the plane through a state normal to the component that changes fastest there.

    Rates are relative to the `extent` of each component so far, if positive.
    """
    slope = flow_at(problem, start)[free] / np.where(extent > 0.0, extent, 1.0)
    component = int(np.argmax(np.abs(slope)))
    return free[component], float(start.y[free[component]]), 0


def returns(problem: Problem, start: HybridState, *, forced: bool) -> bool:
    """Return whether a motion returns to its state within `RETURN_RTOL` after some periods."""
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
    distances = np.abs(states[1:, free] - states[0, free])
    nothing = ROUNDING_ATOLS * problem.options.atol
    return bool(
        ((distances <= RETURN_RTOL * size + nothing).all(axis=1) & (modes[1:] == modes[0])).any()
    )


def flow_at(problem: Problem, instant: HybridState) -> Floats:
    """Return the flow at an instant, shape (n,)."""
    p = np.array(problem.parameters, dtype=float)
    return problem.automaton.slope_at(instant.mode, instant.time, instant.y, p)
