"""Search for a periodic orbit near a state, and drift where there is none."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.errors import InvalidParameter, OrbitError, RunError
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import Samples, Trajectory, run
from mems_impact.hybrid.state import HybridState
from mems_impact.hybrid.variational.derivatives import free_components
from mems_impact.orbits.division import divided
from mems_impact.orbits.family import Family
from mems_impact.orbits.limit_cycle import limit_cycle_guess, phase_is_clear, rebase_phase
from mems_impact.orbits.newton import solve
from mems_impact.orbits.period_detection import (
    MAX_FORCING_PERIODS,
    SHIFT_RATIOS,
    check_bounded,
    detect_forcing_periods,
    flow_at,
    state_enters,
)
from mems_impact.orbits.periodic_orbit import PeriodicOrbit, make_orbit
from mems_impact.orbits.shooting import Shooting
from mems_impact.orbits.signature import OrbitGuess, at_period_start, read_guess, read_signature

# --- Drift

DRIFT_PERIODS = 96  # forcing periods of the run
MIN_DRIFT_RUN, MAX_DRIFT_STEPS = (
    1e-6,
    4000,
)  # autonomous systems: length of the first run; maximum of steps
GROWTH_RTOL = 0.1  # relative change of a rate below which growth is steady
COMPARED_INSTANTS = 8  # instants of the run at which the functions are evaluated

_Kind = Literal["unread", "angle", "together"]


MAX_DIVISIONS = 4  # of an orbit, whose perturbations grow more than those of its guess


class Drift(NamedTuple):
    """Components of the state that grow without bound and without effect on the functions."""

    places: tuple[int, ...]
    rates: Floats  # gain of each per period of the problem
    # Whether functions are independent of the components ("unread"), 2 pi-periodic in each
    # ("angle"), or depend on their differences only ("together").
    kind: _Kind


def drift_of(problem: Problem, start: HybridState, units: Floats, *, forced: bool) -> Drift | None:
    """Return the drift of a motion; None if there is none.

    `units`, shape (n,), are the user's units of the components, in those of the numerics; `forced`
    says that the period of the problem is a forcing period.
    """
    try:
        longer = _drift_run(problem, replace(start, cycle=0, time=0.0), forced)
    except RunError:
        return None
    length = longer.final.cycle + longer.final.time / problem.period
    each = max(1, math.ceil(DRIFT_PERIODS / length))
    grid = longer.samples(each)
    rates = _rates(grid.y, each, problem.options.atol)
    grows = [i for i in free_components(problem.automaton) if rates[i] != 0.0]
    unit = np.diag(units)

    def unaffected(shifts: Iterable[Floats], exactly: bool = False) -> bool:
        return not any(_affects(problem, grid, shift, exactly) for shift in shifts)

    alone = [
        i
        for i in grows
        if unaffected((f * rates[i] / units[i] * unit[i] for f in SHIFT_RATIOS), True)
    ]
    if alone:
        return Drift(tuple(alone), rates[alone], "unread")
    turning = [i for i in grows if unaffected([2.0 * math.pi * unit[i]])]
    if turning:
        return Drift(tuple(turning), rates[turning], "angle")
    if len(grows) > 1:
        largest = np.abs(rates / units)[grows].max()
        if unaffected(f * largest * unit[grows].sum(axis=0) for f in SHIFT_RATIOS):
            return Drift(tuple(grows), rates[grows], "together")
    return None


def _drift_run(problem: Problem, start: HybridState, forced: bool) -> Trajectory:
    """Return a run long enough to distinguish drift from oscillation."""
    if forced:
        return run(problem, start, DRIFT_PERIODS)
    length = MIN_DRIFT_RUN
    while True:
        piece = run(problem, start, length)
        if piece.steps > MAX_DRIFT_STEPS or length > DRIFT_PERIODS:
            return piece
        length *= 4.0


def _rates(y: Floats, each: int, atol: float) -> Floats:
    """Return the gain of components per period; 0 without steady growth above rounding errors."""
    window = len(y) // 4
    pieces = [y[len(y) - (k + 1) * window : len(y) - k * window] for k in range(3)]
    last, middle, first = (piece.mean(axis=0) for piece in pieces)
    gained, before = last - middle, middle - first
    straight = np.outer(np.arange(window) / window, gained)
    swing = np.ptp(pieces[0] - straight, axis=0)
    steady = np.abs(gained - before) <= GROWTH_RTOL * np.abs(gained)
    steady &= np.abs(gained) > atol  # at rest a rounding error may persist
    return np.where(steady & (swing < np.abs(gained)), gained * each / window, 0.0)


def _affects(problem: Problem, grid: Samples, shift: Floats, exactly: bool) -> bool:
    rows = np.linspace(1, len(grid.y) - 1, COMPARED_INSTANTS).astype(int)
    return any(
        state_enters(problem, HybridState(0, grid.time[i], int(grid.mode[i]), grid.y[i]), shift,
                     exactly=exactly)
        for i in rows
    )  # fmt: skip


# --- Search for periodic orbits near a state

SAME_STATE_RATIO = 1e-6  # difference of equal states, relative to the size of the orbit
COLLAPSE_RATIO = (
    1e-6  # ratio of the speeds after and before correction that indicates an equilibrium
)
PERIOD_DIVISORS = range(2, 9)  # numbers of repeats of a shorter cycle that are detected


def find_periodic_orbit(
    family: Family,
    guess: HybridState,
    *,
    periods: int | None = 1,
    transient: float = 0.0,
    active: tuple[str, ...] = (),
) -> PeriodicOrbit:
    """Find a periodic orbit of a forced system near a state.

    A run over `periods` periods of the problem, detected if None, and after a `transient`, provides
    the signature, then Newton's method corrects all states and event times. With method ``"auto"``,
    the orbit uses the method selected by that run. The orbit is to be continued in the parameters
    `active` afterwards. Raises OrbitError if no orbit is found near the guess.
    """
    if periods is not None and periods < 1:
        raise InvalidParameter(field="periods", value=periods, allowed="1 or more")

    def closed(read: OrbitGuess) -> PeriodicOrbit:
        return _corrected(Shooting(family.suited(read.stiff), read.segments, active), read)

    problem, start = family.problem(), guess
    if transient > 0.0:
        start = run(problem, start, transient, consume=_drop).final
    check_bounded(problem, start)
    start = at_period_start(problem, start)
    if periods is not None:
        return closed(read_guess(problem, start, periods))
    recognized = detect_forcing_periods(problem, start)
    if recognized.start_periods <= 1:
        try:
            solution = closed(read_signature(recognized.first_period, 1, problem.switches))
            if solution.admissible or recognized.start_periods or not recognized.end_periods:
                return solution
        except OrbitError as error:
            if recognized.start_periods:
                raise
            check_bounded(problem, replace(recognized.end, cycle=3 * MAX_FORCING_PERIODS))
            if not recognized.end_periods:
                raise OrbitError(
                    f"{error.reason}, and the motion does not converge to an orbit in "
                    f"{3 * MAX_FORCING_PERIODS} periods",
                    "raise transient, for example to 300, or set periods; a chaotic motion does "
                    "not converge",
                    error.partial,
                ) from error
        solution = closed(read_guess(problem, recognized.end, recognized.end_periods))
    else:
        solution = closed(read_guess(problem, start, recognized.start_periods))
    again = _passes(solution)
    if again == 1:
        return solution
    return closed(read_guess(problem, solution.instant, solution.periods // again))


def find_cycle(
    family: Family,
    guess: HybridState,
    *,
    period: float | None = None,
    transient: float = 0.0,
) -> PeriodicOrbit:
    """Find a limit cycle, a periodic orbit of an autonomous system, near a state.

    The guess is near the cycle, or in its basin of attraction if a run over the time `transient`
    comes first. The approximate `period` is detected in a run by default. Raises OrbitError if the
    motion does not return or reaches an equilibrium, or if no cycle is found.
    """
    shooting, read = limit_cycle_guess(family, guess, transient=transient, period=period)
    solution = _corrected(shooting, read)
    lasted = float(read.times[-1])
    if solution.point.period > 0.0:
        speed = np.linalg.norm(flow_at(solution.problem, solution.instant)[shooting.free])
        first = HybridState(0, 0.0, read.segments[0].mode, read.states[0])
        before = np.linalg.norm(flow_at(solution.problem, first)[shooting.free])
        if not speed > COLLAPSE_RATIO * before:
            raise OrbitError(
                reason="an equilibrium was reached, not a cycle",
                remedy="take a guess farther away, or other parameters",
                partial=solution.point,
            )
    if not 0.5 < solution.point.period / lasted < 2.0:
        raise OrbitError(
            reason=f"the motion returns after {family.amount('period', lasted)}, but no cycle with "
            "such a period was found near it",
            remedy="raise transient (in units of time), or give a guess closer to a cycle",
            partial=solution.point,
        )
    again = _passes(solution)
    if again > 1:
        once = solution.point.period / again
        shooting, read = limit_cycle_guess(solution.family, solution.instant, period=once)
        solution = _corrected(shooting, read)
    if phase_is_clear(solution.shooting, solution.point):
        return solution
    shooting, unknowns, _ = rebase_phase(solution.shooting, solution.point)
    return make_orbit(shooting, solve(shooting, unknowns, solution.point.values))


def _corrected(shooting: Shooting, guess: OrbitGuess) -> PeriodicOrbit:
    unknowns = shooting.pack(guess)
    values = np.array([shooting.family.value(a) for a in shooting.active])
    point = shooting.evaluate(unknowns, values)
    shooting.pin(point)
    for _ in range(MAX_DIVISIONS):
        shooting, unknowns, _ = divided(shooting, point) or (shooting, unknowns, 0)
        point = solve(shooting, unknowns, values)
        if divided(shooting, point) is None:
            break
    return make_orbit(shooting, point)


def _passes(orbit: PeriodicOrbit) -> int:
    """Return the number of repeats of a shorter orbit in an orbit."""
    shooting, free = orbit.shooting, orbit.shooting.free
    states, _ = shooting.unpack(orbit.point.unknowns)
    size = np.abs(states[:, free]).max()
    if shooting.phase is None:
        cycles = [segment.cycle for segment in orbit.segments]
        begins = states[[cycles.index(c) for c in range(orbit.periods)]]
        divisors = [k for k in range(1, orbit.periods) if orbit.periods % k == 0]
        for k in divisors:
            if np.abs(begins - np.roll(begins, k, axis=0))[:, free].max() < SAME_STATE_RATIO * size:
                return orbit.periods // k
        return 1
    for k in reversed(PERIOD_DIVISORS):
        later = run(orbit.problem, orbit.instant, 1.0 / k).final
        if np.abs(later.y - orbit.state)[free].max() < SAME_STATE_RATIO * size:
            return k
    return 1


def _drop(_: object) -> None:
    """Discard events."""
