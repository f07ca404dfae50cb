"""Finding a periodic orbit near a state."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mems_impact.analysis.orbit import Orbit, orbit_of
from mems_impact.analysis.state import State, is_number, whole
from mems_impact.analysis.system import System
from mems_impact.analysis.verbs import takes_system
from mems_impact.engines.options import Options
from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.hybrid.trajectory import Instant
from mems_impact.orbits import orbit as orbits
from mems_impact.orbits.shooting import Point

__all__ = ["IF_STIFF", "ORBIT_OPTIONS", "find_orbit"]

ORBIT_OPTIONS = Options(method="dop853", rtol=1e-11, atol=1e-13)
"""Tighter than for runs, as special points are located to ten digits; arcs are short."""
IF_STIFF = "bdf"
"""The method that takes over from that of `ORBIT_OPTIONS`."""


@takes_system(start="guess")
def find_orbit(
    system: System,
    *,
    guess: State | Mapping[str, float] | None = None,
    periods: int = 1,
    transient: float = 0,
    options: Options | None = None,
) -> Orbit:
    """Find a periodic orbit near a state.

    Its modes and events are read off a run from `guess`; all its states and event times are then
    corrected together by Newton's method, which finds unstable orbits as well.

    Parameters
    ----------
    system : System, or Actuator and Drive, or Run
        A run stands for its system, and its last state for `guess`.
    guess : State or mapping of str to float, optional
        A state near the orbit, such as the last one of a run; the system's start by default.
    periods : int, optional
        Forcing periods after which the orbit closes, >= 1.
    transient : float, optional
        Forcing periods to run before that, >= 0: a stable orbit attracts.
    options : Options, optional
        How it is integrated; by default with method ``"dop853"``, or ``"bdf"`` if the run from
        the guess is found stiff, to 1e-11 relative and 1e-13 absolute. `Orbit.options` has what
        was taken.

    Returns
    -------
    Orbit

    Raises
    ------
    InvalidParameter
        If an argument is out of range.
    OrbitError
        If there is no orbit near the guess; its ``partial`` is the `State` that was reached.
    RunError
        If the run from the guess fails.
    """
    count = whole("periods", periods, 1)
    if not is_number(transient) or transient < 0.0:
        raise InvalidParameter("transient", transient, "a finite number >= 0")
    if not system.forced:
        problem = "the system has no forcing period, and so no orbit that repeats with it"
        raise InvalidParameter("period", None, "", problem=problem)
    chosen = ORBIT_OPTIONS if options is None else options
    if_stiff = IF_STIFF if options is None else None
    start = system.instant(guess, system.problem(chosen), field="guess")
    try:
        found = orbits.find_orbit(
            system.family(chosen),
            start,
            periods=count,
            transient=float(transient),
            if_stiff=if_stiff,
        )
    except OrbitError as error:
        if isinstance(error.partial, Point):
            error.partial = _reached(error.partial, system)
        raise
    return orbit_of(system, found)


def _reached(point: Point, system: System) -> State | None:
    """Return the first state of an iteration that did not converge."""
    free = [i for i in range(len(system.states)) if i not in system.automaton.cyclic]
    y = np.zeros(len(system.states))
    y[free] = point.unknowns[: len(free)]
    if not np.isfinite(y).all():
        return None
    return system.state_of(Instant(0, 0.0, 0, y)).replace(mode=None)
