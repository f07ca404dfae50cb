"""Finding periodic orbits near a state, of systems with forcing and without."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.hybrid.run import run
from mems_impact.hybrid.trajectory import Instant
from mems_impact.orbits.bounded import check_bounded
from mems_impact.orbits.cycles import begun_anew, cycle_near, well_begun
from mems_impact.orbits.family import Family
from mems_impact.orbits.newton import solve
from mems_impact.orbits.orbit import PeriodicOrbit, make_orbit
from mems_impact.orbits.returning import MOST, flow_at, forcing_periods
from mems_impact.orbits.shooting import Shooting
from mems_impact.orbits.signature import Guess, at_period_start, guess_from, read_guess

SAME = 1e-6  # part of the size of an orbit by which two of its states differ that are one
COLLAPSED = 1e-6  # part of its first speed at which a cycle has come to rest
PARTS = range(2, 9)  # into which an orbit may fall that was taken for several passes


def find_orbit(
    family: Family,
    guess: Instant,
    *,
    periods: int | None = 1,
    transient: float = 0.0,
    active: tuple[str, ...] = (),
) -> PeriodicOrbit:
    """Find a periodic orbit of a forced system near a state.

    The signature is read off a run over `periods` periods, then all states and event times are
    corrected by Newton's method. Where the method is ``"auto"``, the orbit takes the one that suits
    that run.

    Parameters
    ----------
    family : Family
    guess : Instant
        A state near the orbit.
    periods : int, optional
        Periods of the problem after which the orbit closes; None: recognised from a run.
    transient : float
        Periods to run before the signature is read.
    active : tuple of str
        Parameters in which the orbit is to be continued afterwards.

    Raises
    ------
    OrbitError
        If no orbit is found near the guess.
    """
    if periods is not None and periods < 1:
        raise InvalidParameter(field="periods", value=periods, allowed="1 or more")

    def closed(read: Guess) -> PeriodicOrbit:
        return _corrected(Shooting(family.suited(read.stiff), read.segments, active), read)

    problem, start = family.problem(), guess
    if transient > 0.0:
        start = run(problem, start, transient, consume=_drop).final
    check_bounded(problem, start)
    start = at_period_start(problem, start)
    if periods is not None:
        return closed(read_guess(problem, start, periods))
    recognised = forcing_periods(problem, start)
    if recognised.near <= 1:
        try:
            found = closed(guess_from(recognised.once, 1, problem.switches))
            if found.admissible or recognised.near or not recognised.settled:
                return found
        except OrbitError as error:
            if recognised.near:
                raise
            check_bounded(problem, replace(recognised.later, cycle=3 * MOST))
            if not recognised.settled:
                raise OrbitError(
                    f"{error.reason}, and none on which the motion settles in {3 * MOST} periods",
                    "let transients die out (transient=300), or say periods=; a chaotic motion "
                    "does not settle at all",
                    error.partial,
                ) from error
        found = closed(read_guess(problem, recognised.later, recognised.settled))
    else:
        found = closed(read_guess(problem, start, recognised.near))
    again = _passes(found)
    if again == 1:
        return found
    return closed(read_guess(problem, found.instant, found.periods // again))


def find_cycle(
    family: Family,
    guess: Instant,
    *,
    period: float | None = None,
    transient: float = 0.0,
    active: tuple[str, ...] = (),
) -> PeriodicOrbit:
    """Find a limit cycle, a periodic orbit of a system that nothing forces, near a state.

    Parameters
    ----------
    family : Family
    guess : Instant
        A state near the cycle, or one from which a run comes there.
    period : float, optional
        That of the cycle, roughly, where `guess` lies near it; recognised from a run by default.
    transient : float
        Time to run first.
    active
        As for `find_orbit`.

    Raises
    ------
    OrbitError
        If the motion does not return, or comes to rest, or no cycle is found where it returns.
    """
    shooting, read = cycle_near(family, guess, transient=transient, period=period, active=active)
    found = _corrected(shooting, read)
    lasted = float(read.times[-1])
    if found.point.period > 0.0:
        speed = np.linalg.norm(flow_at(found.problem, found.instant)[shooting.free])
        first = Instant(0, 0.0, read.segments[0].mode, read.states[0])
        before = np.linalg.norm(flow_at(found.problem, first)[shooting.free])
        if not speed > COLLAPSED * before:
            raise OrbitError(
                reason="an equilibrium was reached, not a cycle",
                remedy="take a guess farther away, or other parameters",
                partial=found.point,
            )
    if not 0.5 < found.point.period / lasted < 2.0:
        raise OrbitError(
            reason=f"the motion returns after {family.amount('period', lasted)}, but no cycle of "
            "such a period is near",
            remedy="let transients die out (transient=…, in units of time), or give a guess nearer "
            "to a cycle",
            partial=found.point,
        )
    again = _passes(found)
    if again > 1:
        once = found.point.period / again
        shooting, read = cycle_near(found.family, found.instant, period=once, active=active)
        found = _corrected(shooting, read)
    if well_begun(found.shooting, found.point):
        return found
    shooting, unknowns, _ = begun_anew(found.shooting, found.point)
    return make_orbit(shooting, solve(shooting, unknowns, found.point.values))


def _corrected(shooting: Shooting, guess: Guess) -> PeriodicOrbit:
    unknowns = shooting.pack(guess)
    values = np.array([shooting.family.value(a) for a in shooting.active])
    shooting.pin(shooting.evaluate(unknowns, values))
    return make_orbit(shooting, solve(shooting, unknowns, values))


def _passes(orbit: PeriodicOrbit) -> int:
    """Return how often an orbit repeats itself: it is one of a part of the period then."""
    shooting, free = orbit.shooting, orbit.shooting.free
    states, _ = shooting.unpack(orbit.point.unknowns)
    size = np.abs(states[:, free]).max()
    if shooting.phase is None:
        cycles = [segment.cycle for segment in orbit.segments]
        begins = states[[cycles.index(c) for c in range(orbit.periods)]]
        parts = [k for k in range(1, orbit.periods) if orbit.periods % k == 0]
        for k in parts:
            if np.abs(begins - np.roll(begins, k, axis=0))[:, free].max() < SAME * size:
                return orbit.periods // k
        return 1
    for k in reversed(PARTS):
        later = run(orbit.problem, orbit.instant, 1.0 / k).final
        if np.abs(later.y - orbit.state)[free].max() < SAME * size:
            return k
    return 1


def _drop(_: object) -> None:
    """Keep no events."""
