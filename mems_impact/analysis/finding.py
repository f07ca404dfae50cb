"""Finding a periodic orbit near a state."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mems_impact.analysis.checks import meeting
from mems_impact.analysis.checks.side import tell_of_side
from mems_impact.analysis.orbit import Orbit, orbit_of
from mems_impact.analysis.state import State, is_number, whole
from mems_impact.analysis.system import System
from mems_impact.analysis.verbs import takes_system
from mems_impact.engines.options import Options
from mems_impact.errors import InvalidParameter, OrbitError, RunError
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.run import run
from mems_impact.hybrid.trajectory import Instant, Trajectory
from mems_impact.orbits import finding
from mems_impact.orbits.bounded import BOUNDED, DIVERGED, farthest
from mems_impact.orbits.drift import drift_of
from mems_impact.orbits.shooting import Point
from mems_impact.orbits.timing import time_enters

__all__ = ["ORBIT_OPTIONS", "find_orbit"]

ORBIT_OPTIONS = Options(method="auto", rtol=1e-11, atol=1e-13)
"""Tighter than for runs, as special points are located to ten digits."""
DEFECTS = 3  # of a solution that is no orbit, that a message tells
UNFORCED = (
    "nothing in the system depends on t, and its motion does not repeat with this period: leave "
    "period= out of the System, and its own cycle is found"
)


@takes_system(start="guess")
def find_orbit(
    system: System,
    *,
    guess: State | Mapping[str, float] | None = None,
    periods: int | None = None,
    period: float | None = None,
    transient: float = 0,
    options: Options | None = None,
) -> Orbit:
    """Find a periodic orbit near a state.

    Its modes and events are read off a run from `guess`; all its states and event times are then
    corrected together by Newton's method, which finds unstable orbits as well. Where nothing forces
    the system the orbit is a limit cycle, whose period is found with it.

    Parameters
    ----------
    system : System, or Actuator and Drive, or Run
        A run stands for its system, and its last state for `guess`.
    guess : State or mapping of str to float, optional
        A state near the orbit, such as the last one of a run; the system's start by default.
    periods : int, optional
        Forcing periods after which the orbit closes, >= 1; recognised from a run by default.
    period : float, optional
        Of a cycle near `guess`, roughly; recognised from a run by default. Of a system without
        forcing.
    transient : float, optional
        Forcing periods to run before that, >= 0: a stable orbit attracts. A time, where nothing
        forces the system.
    options : Options, optional
        How it is integrated; by default to 1e-11 relative and 1e-13 absolute, with method
        ``"auto"``: the run from the guess tells whether the orbit takes ``"dop853"``, or ``"bdf"``
        because it is stiff. `Orbit.options` has what was taken.

    Returns
    -------
    Orbit

    Raises
    ------
    InvalidParameter
        If an argument is out of range, or the system has a period though none of its functions
        depends on time.
    OrbitError
        If there is no orbit near the guess, or the motion does not return, diverges, comes to
        rest, or grows for ever in a state that is to be `cyclic`; its ``partial`` is the `State`
        that was reached. If the equations have a solution that is no orbit of the system: then that
        is the `Orbit`, whose ``defects`` say why not.
    RunError
        If the run from the guess fails.
    FunctionError
        If a function does not do what it must in a mode of the orbit that no run has come to.

    See Also
    --------
    Orbit, continue_orbit, simulate, lyapunov

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked(actuator))
    >>> orbit.stable, len(orbit.impacts)
    (True, 1)
    >>> f"{orbit.step:.4e}"
    '3.6665e-04'
    """
    if periods is not None:
        periods = whole("periods", periods, 1)
    if period is not None and not (is_number(period) and period > 0.0):
        raise InvalidParameter("period", period, "a finite number > 0")
    if not is_number(transient) or transient < 0.0:
        raise InvalidParameter("transient", transient, "a finite number >= 0")
    if not system.forced and periods is not None:
        refusal = "the system has no forcing period that an orbit could take several of"
        raise InvalidParameter("periods", periods, "", problem=refusal)
    if system.forced and period is not None:
        refusal = "an orbit of this system takes whole forcing periods: give periods="
        raise InvalidParameter("period", period, "", problem=refusal)
    chosen = ORBIT_OPTIONS if options is None else options
    problem = system.problem(chosen)
    start = system.instant(guess, problem, field="guess")
    tell_of_side(system, problem, start)
    try:
        if system.forced:
            found = finding.find_orbit(
                system.family(chosen),
                start,
                periods=periods,
                transient=float(transient),
            )
        else:
            found = finding.find_cycle(
                system.family(chosen),
                start,
                period=None if period is None else float(system.into("time", period)),
                transient=float(system.into("time", transient)),
            )
    except (OrbitError, RunError) as error:
        told = _diverged(error, system, problem)
        if told is None and isinstance(error, OrbitError):
            told = _drifting(system, problem, start, float(transient))
        if told is not None:
            raise told from error
        if isinstance(error, RunError):
            raise
        if system.forced and not time_enters(problem, start.y):
            raise _unforced(system) from error
        if isinstance(error.partial, Point):
            error.partial = _reached(error.partial, system)
        elif isinstance(error.partial, Instant):
            error.partial = system.state_of(error.partial)
        raise
    # At rest all repeats with any period; but a motion that leaves it does not.
    if system.forced and not found.stable and not time_enters(problem, start.y):
        raise _unforced(system)
    meets = meeting(system, problem)
    if meets is not None:
        segments = zip(found.segments, found.point.ends, found.point.arcs, strict=True)
        for segment, end, arc in segments:
            meets.put(Instant(segment.cycle, float(end), segment.mode, arc.end))
        meets.check()
    orbit = orbit_of(system, found)
    if not orbit.admissible:
        raise OrbitError(
            f"what solves the equations here is no orbit: {'; '.join(orbit.defects[:DEFECTS])}",
            "let transients die out (transient=…) or give a guess with the events of an orbit; "
            "what was found is in .partial",
            orbit,
        )
    return orbit


def _diverged(error: OrbitError | RunError, system: System, problem: Problem) -> OrbitError | None:
    """Return what tells where a motion has diverged; None if that is not why none was found."""
    if isinstance(error, RunError):
        at = error.trajectory.final if isinstance(error.trajectory, Trajectory) else None
    else:
        at = error.partial if isinstance(error.partial, Instant) else None
    place = None if at is None else farthest(problem, at)
    if at is None or place is None:
        return None
    name, state = system.states[place], system.state_of(at)
    elapsed = at.cycle * problem.period + at.time
    where = f"{name} = {system.amount(name, at.y[place])}"
    when = f" at t = {system.amount('time', elapsed)}" if elapsed > 0.0 else " in the guess"
    return OrbitError(f"{DIVERGED}: {where}{when}", BOUNDED, state)


def _drifting(
    system: System, problem: Problem, start: Instant, transient: float
) -> OrbitError | None:
    """Return what tells which states grow for ever; None if that is not why none was found."""
    names = system.states
    units = np.array([float(system.into(name, 1.0)) for name in names])
    try:
        if transient > 0.0:
            start = run(problem, start, transient if system.forced else
                        float(system.into("time", transient)) / problem.period).final  # fmt: skip
        drift = drift_of(problem, start, units, forced=system.forced)
    except RunError:
        return None
    if drift is None:
        return None
    each = 1.0 if system.forced else float(system.out("time", problem.period))
    grows = []
    for place, rate in zip(drift.places, drift.rates, strict=True):
        name = names[place]
        gain = f"{abs(system.out(name, rate)) / each:.4g} {system.unit(name)}".rstrip()
        grows.append(f"{name} {'grows' if rate > 0.0 else 'falls'} by {gain}")
    found = [names[place] for place in drift.places]
    them, together = "it" if len(found) == 1 else "them", " and ".join(found)
    why, remedy = {
        "unread": (
            f"no function reads {them}",
            f"name {them} in cyclic=[{', '.join(map(repr, found))}], and an orbit need not close "
            f"in {them}",
        ),
        "angle": (
            f"functions repeat every 2 pi of {them}",
            f"bring {together} back by guards at pi and -pi, whose transitions subtract and add "
            "2 pi",
        ),
        "together": (
            "functions read only how far apart they are",
            f"take the distances between {together} as states, and of their places only one, in "
            "cyclic=",
        ),
    }[drift.kind]
    per = "a period" if system.forced else "in a unit of time"
    reached = system.state_of(replace(start, cycle=0, time=0.0))
    return OrbitError(f"{' and '.join(grows)} {per}, and {why}", remedy, reached)


def _unforced(system: System) -> InvalidParameter:
    return InvalidParameter("period", system.forcing_period, "", problem=UNFORCED)


def _reached(point: Point, system: System) -> State | None:
    """Return the first state of an iteration that did not converge."""
    free = [i for i in range(len(system.states)) if i not in system.automaton.cyclic]
    y = np.zeros(len(system.states))
    y[free] = point.unknowns[: len(free)]
    if not np.isfinite(y).all():
        return None
    return system.state_of(Instant(0, 0.0, 0, y)).replace(mode=None)
