"""The voltages at which block and frame begin to move, one frequency after the other.

Where the spring moves the frame before the block strikes, friction falls from its static to its
dynamic value at once, and the motion jumps: no curve leads from rest to slip. So impacts are looked
for by runs, each a little higher than the one before, and the orbit without impacts is followed
through the last step alone.
"""

from __future__ import annotations

from typing import Any

from mems_impact.actuator.design.chart import STEADY_FROM, STEADY_TO
from mems_impact.actuator.design.crisis import crisis
from mems_impact.actuator.design.window import end_of, lasts_until
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.analysis.branch import continue_orbit
from mems_impact.analysis.finding import find_orbit
from mems_impact.analysis.simulate import simulate
from mems_impact.analysis.special import SpecialPoint
from mems_impact.analysis.state import State
from mems_impact.analysis.threads import Watch
from mems_impact.errors import OrbitError

__all__ = ["onset", "steady", "switching_off"]

SETTLED = 400  # forcing periods after which a run without impacts has settled, or more if asked
LARGEST = 0.02  # part of the amplitude by which it rises at once
PRECISE = 1e-5  # part of the amplitude to which a simulated threshold is found
ABOVE = 1e-3  # part of the amplitude by which the motion with impacts is looked for above it
RISES = 1.05  # steps in which an orbit with impacts is looked for
LOWEST = 0.1  # part of the amplitude of the first impact at which none comes
GRAZING, FOLD, JUMP = "grazing", "fold", "jump"


def onset(
    system: ActuatorSystem, first: float, most: float, watch: Watch | None
) -> tuple[float, str, SpecialPoint | None, State]:
    """Return the amplitude above `first` at which the block begins to strike, on the way up.

    Parameters
    ----------
    system : ActuatorSystem
        At one frequency.
    first, most : float
        Amplitudes between which it is looked for.
    watch : callable or None
        Called by runs; an exception that it raises ends the search.

    Returns
    -------
    amplitude : float
    kind : str
        How the orbit without impacts ends there: "grazing", "fold", …; "jump" where it is not known
        (from rest, or where there is no such orbit).
    special : SpecialPoint or None
        The grazing or fold.
    state : State
        Of the motion with impacts.

    Raises
    ------
    OrbitError
        If it does not strike up to `most`.
    """

    def settled(amplitude: float, start: State) -> tuple[bool, State]:
        run = simulate(
            system.changed(amplitude=amplitude), SETTLED, initial=start, keep="statistics",
            window=(0.75 * SETTLED, SETTLED), progress=watch or False,
        )  # fmt: skip
        return bool(run.statistics["impacts"] > 0.0), run.final

    low, state, step, struck = (1.0 - PRECISE) * first, State(), PRECISE * first, None
    while struck is None or step > PRECISE * low:
        strikes, there = settled(low + step, state)
        if strikes:
            struck, step = (low + step, there), 0.5 * step
            continue
        low, state = low + step, there
        if struck is None:
            step = min(2.0 * step, LARGEST * low)
        elif low + step >= struck[0]:
            step = 0.5 * (struck[0] - low)
        if low > most:
            raise OrbitError(f"no impacts up to amplitude = {most:.9g}", "take another frequency")
    return *_ending(system.changed(amplitude=low), state, struck[0]), struck[1]


def _ending(
    system: ActuatorSystem, state: State, high: float
) -> tuple[float, str, SpecialPoint | None]:
    """Return where and how the orbit without impacts at a state ends, below `high`."""
    try:
        orbit: Any = find_orbit(system, guess=state)
        if orbit.stable and orbit.admissible:
            branch = continue_orbit(orbit, "amplitude", high)
            amplitude, kind = end_of(branch, high)
            if kind in (GRAZING, FOLD):
                ends = [each for each in branch.special_points if each.value == amplitude]
                return amplitude, kind, ends[0]
    except OrbitError:
        pass
    return high, JUMP, None


def steady(
    system: ActuatorSystem, on: float, most: float, state: State
) -> list[tuple[str, float, str, SpecialPoint | None]]:
    """Return the ends of the window in which an orbit of one period strikes: boundary, amplitude.

    Each with what happens there; none where there is no such orbit, or no end up to `most`.

    Parameters
    ----------
    system : ActuatorSystem
        At one frequency.
    on, most : float
        Amplitudes: above the first of them it is looked for.
    state : State
        Of the motion with impacts.
    """
    amplitude, orbit = on * (1.0 + ABOVE), None
    while orbit is None and amplitude < most:
        try:
            there: Any = find_orbit(
                system.changed(amplitude=amplitude), guess=state, periods=1, transient=SETTLED
            )
            if there.stable and there.admissible and len(there.impacts):
                orbit = there
        except OrbitError:
            pass
        amplitude *= RISES
    if orbit is None:
        return []
    found = []
    for boundary, stop in ((STEADY_FROM, LOWEST * on), (STEADY_TO, most)):
        value, kind, special = lasts_until(orbit, stop, SETTLED)
        if kind != "bound":
            found.append((boundary, value, kind if special is not None else JUMP, special))
    return found


def switching_off(
    system: ActuatorSystem, on: float, state: State, periods: int, watch: Watch | None
) -> float:
    """Return the amplitude below which the motion with impacts that begins at `on` is gone."""
    return crisis(
        system.actuator,
        system.drive,
        below=on * (1.0 + ABOVE),
        width=0.95 * on,
        start=state,
        tolerance=PRECISE,
        periods=periods,
        watch=watch,
    )
