"""Thresholds of impacts and slip at one frequency, by simulation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mems_impact._util.bisection import bisect
from mems_impact._util.progress import Watch
from mems_impact.actuator.actuator import Actuator
from mems_impact.actuator.design.operating_chart import STEADY_FROM, STEADY_TO
from mems_impact.actuator.design.period_one_window import STABILITY_LOSS_LABELS, end_of, lasts_until
from mems_impact.actuator.drives.base import Drive
from mems_impact.actuator.state_space import kicked_state
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.analysis.attractor import (
    STUDY_OPTIONS,
    InitialCondition,
    RecurrenceOptions,
    map_attractors,
)
from mems_impact.analysis.branch import continue_solution
from mems_impact.analysis.orbit import find_orbit
from mems_impact.analysis.simulate import simulate
from mems_impact.analysis.special_points import SpecialPoint
from mems_impact.errors import OrbitError
from mems_impact.integrators.options import Options
from mems_impact.systems.state import State

RAMP = 21  # number of amplitudes from the start of the search to the on-boundary
TRIALS = 6  # states of the attractor from which the next amplitude is tried


def settled(
    system: ActuatorSystem, start: State, periods: int, options: Options, watch: Watch | None
) -> tuple[bool, float, State]:
    """Return whether a motion has impacts in the end, its closest approach, and its last state.

    The end is its orbit if it becomes periodic, else the last quarter of `periods`.
    """
    recurrence = RecurrenceOptions(
        transient=0.75 * periods, periods=0.25 * periods, exponents="none", chaos_persistence=1.0
    )
    case = InitialCondition(system, start)
    (attractor,) = map_attractors([case], recurrence, options, watch)
    if attractor.final is None:
        raise OrbitError(f"the motion cannot be computed: {attractor.status}", "take another range")
    strikes = attractor.measures["impacts per period"] > 0.0
    return strikes, attractor.measures["closest approach"], attractor.final


def locate_crisis(
    actuator: Actuator,
    drive: Drive,
    *,
    amplitude: float,
    begin: float | None = None,
    width: float | None = None,
    start: State | None = None,
    tolerance: float = 1e-6,
    periods: int = 2000,
    options: Options = STUDY_OPTIONS,
    watch: Watch | None = None,
) -> float:
    """Locate by simulation the amplitude at which an attractor with impacts ceases to exist.

    The amplitude is lowered in increasing steps, each from states of the previous attractor, until
    the impacts cease from all of them; the last step is then bisected. The result is the smallest
    amplitude at which the attractor was found.

    There is such an attractor at `amplitude`, such as the on-boundary. The search begins from
    `start` (a kick by default) at the amplitude `begin`: just beyond a fold a run lingers where the
    orbit has vanished, so `begin` slightly above `amplitude` is better. It covers the range
    `width`, by default down to zero; `tolerance` is the width of its last step, as a part of
    `amplitude`. The attractor must persist for `periods` forcing periods. Just below the crisis a
    transient may last as long, so that the result is slightly low; it rises with `periods`. `watch`
    is called several times a second with the completed periods of the current run; an exception
    that it raises ends the search.

    Raises OrbitError if the motion from `start` ends without impacts at `begin`, or the attractor
    is still there `width` lower.
    """

    def attractor(amplitude: float, starts: list[State]) -> list[State]:
        """Return states of the attractor at `amplitude`; none if all `starts` leave it."""
        trial_drive = drive.replace(amplitude=amplitude)
        for start in starts:
            strikes, _, final = settled(actuator.under(trial_drive), start, periods, options, watch)
            if strikes:
                states = [final]
                for _ in range(TRIALS - 1):
                    more = simulate(actuator, trial_drive, 7, initial=states[-1], options=options)
                    states.append(more.final)
                return states
        return []

    top, begin = amplitude, amplitude if begin is None else begin
    states = attractor(begin, [kicked_state(actuator) if start is None else start])
    if not states:
        reason = f"at amplitude {begin:.9g} the motion from the initial state ends without impacts"
        raise OrbitError(reason, "begin higher, or take another initial state")
    ramp = np.linspace(begin, amplitude, RAMP)[1:].tolist() if begin != amplitude else []
    for value in ramp:
        ramp_drive = drive.replace(amplitude=value)
        states = [
            simulate(actuator, ramp_drive, 50, initial=s, options=options).final for s in states
        ]
    step, bottom = tolerance * amplitude, 0.0
    lowest = amplitude - (amplitude if width is None else width)
    while True:
        trial = top - step
        if trial <= lowest:
            reason = f"the attractor with impacts is still there at amplitude {top:.9g}"
            raise OrbitError(reason, "look further down", top)
        reached = attractor(trial, states)
        if not reached:
            bottom = trial
            break
        top, states, step = trial, reached, 2.0 * step

    def persists(amplitude: float) -> bool:
        nonlocal states
        reached = attractor(amplitude, states)
        states = reached or states
        return bool(reached)

    return bisect(persists, top, bottom, tolerance * amplitude)[0]


TRANSIENT_PERIODS = 400  # least transient of a run without impacts, in forcing periods
MAX_AMPLITUDE_STEP = 0.02  # relative to the amplitude, close to the stopper
MAX_SEARCH_STEP = 0.25  # and far from it, where a strike is confirmed by steps of the former
CLEARANCE_RATIO = 0.5  # part of the clearance that a step leaves, if the deflection is quadratic
THRESHOLD_RTOL = 1e-5  # relative accuracy of a simulated threshold
IMPACT_OFFSET_RATIO = 1e-3  # relative offset above an onset for the motion with impacts
AMPLITUDE_FACTOR = 1.05  # between trials for an orbit with impacts
MIN_AMPLITUDE_RATIO = 0.1  # amplitude without impacts, relative to that of the first impact
GRAZING, FOLD, JUMP = "grazing", "fold", "jump"


def onset(
    system: ActuatorSystem, lowest: float, highest: float, watch: Watch | None
) -> tuple[float, str, SpecialPoint | None, State]:
    """Return the amplitude above `lowest` at which impacts begin with rising amplitude.

    The second result is the end of the orbit without impacts: "grazing" or "fold" with its special
    point, or "jump" without one, if it is unknown (from rest, or without such an orbit). The last
    result is a state of the motion with impacts. Runs call `watch`; an exception that it raises
    ends the search. Raises OrbitError if the block does not strike up to `highest`.
    """

    def trial(amplitude: float, state: State) -> tuple[bool, float, State]:
        trial_system = system.changed(amplitude=amplitude)
        return settled(trial_system, state, TRANSIENT_PERIODS, STUDY_OPTIONS, watch)

    low, state, step = (1.0 - THRESHOLD_RTOL) * lowest, State(), THRESHOLD_RTOL * lowest
    while True:
        strikes, clearance, final_state = trial(low + step, state)
        if not strikes:
            low, state = low + step, final_state
            if low >= (1.0 - THRESHOLD_RTOL) * highest:
                reason = f"no impacts up to amplitude = {highest:.9g}"
                raise OrbitError(reason, "take another frequency")
            far = _search_step(clearance / system.actuator.delta) * low
            step = min(2.0 * step, far, highest - low)
        elif step > MAX_AMPLITUDE_STEP * low:
            step = MAX_AMPLITUDE_STEP * low  # the strike may be due to the size of the step
        else:
            break
    high = low + step
    special = _ending(system.changed(amplitude=low), state, high, watch)
    if special is not None:
        above = (1.0 + IMPACT_OFFSET_RATIO) * special.value
        strikes, _, beyond = trial(above, special.orbit.state)
        if strikes:
            return special.value, special.kind, special, beyond

    def rests(amplitude: float) -> bool:
        nonlocal state, final_state
        strikes, _, final = trial(amplitude, state)
        state, final_state = (state, final) if strikes else (final, final_state)
        return not strikes

    low, high = bisect(rests, low, high, THRESHOLD_RTOL * low)
    special = _ending(system.changed(amplitude=low), state, high, watch)
    if special is not None:
        return special.value, special.kind, special, final_state
    return high, JUMP, None, final_state


def _search_step(clearance: float) -> float:
    """Return the relative step of the amplitude at a clearance relative to `delta`.

    The force is proportional to the square of the voltage, and so is a small deflection.
    """
    deflection = max(1.0 - clearance, 0.0)
    if deflection * (1.0 + MAX_SEARCH_STEP) ** 2 < 1.0 - CLEARANCE_RATIO * clearance:
        return MAX_SEARCH_STEP
    step = math.sqrt((1.0 - CLEARANCE_RATIO * clearance) / deflection) - 1.0
    return max(step, MAX_AMPLITUDE_STEP)


def _ending(
    system: ActuatorSystem, state: State, high: float, watch: Watch | None
) -> SpecialPoint | None:
    """Return the grazing or fold below `high` in which the orbit without impacts ends, if any."""
    try:
        orbit: Any = find_orbit(system, guess=state)
        if orbit.stable and orbit.admissible:
            branch = continue_solution(
                orbit, "amplitude", high, stop_at=STABILITY_LOSS_LABELS, progress=watch or False
            )
            amplitude, kind = end_of(branch, high)
            if kind in (GRAZING, FOLD):
                return next(each for each in branch.special_points if each.value == amplitude)
    except OrbitError:
        pass
    return None


def steady(
    system: ActuatorSystem, on: float, highest: float, state: State, watch: Watch | None
) -> list[tuple[str, float, str, SpecialPoint | None]]:
    """Return the ends of the window of a period-1 orbit with impacts: boundary, amplitude.

    Each with its kind and special point; none without such an orbit, or without an end up to
    `highest`. `state` is of the motion with impacts, which begins at the amplitude `on`; `watch` as
    for `onset`.
    """
    amplitude, orbit = on * (1.0 + IMPACT_OFFSET_RATIO), None
    while orbit is None and amplitude < highest:
        try:
            candidate: Any = find_orbit(
                system.changed(amplitude=amplitude),
                guess=state,
                periods=1,
                transient=TRANSIENT_PERIODS,
            )
            if candidate.stable and candidate.admissible and len(candidate.impacts):
                orbit = candidate
        except OrbitError:
            pass
        amplitude *= AMPLITUDE_FACTOR
    if orbit is None:
        return []
    ends = []
    for boundary, stop in ((STEADY_FROM, MIN_AMPLITUDE_RATIO * on), (STEADY_TO, highest)):
        value, kind, special = lasts_until(orbit, stop, TRANSIENT_PERIODS, watch)
        if kind != "bound":
            ends.append((boundary, value, kind if special is not None else JUMP, special))
    return ends


def switching_off(
    system: ActuatorSystem, on: float, state: State, periods: int, watch: Watch | None
) -> float:
    """Return the amplitude below which the motion with impacts that starts at `on` ceases."""
    return locate_crisis(
        system.actuator,
        system.drive,
        amplitude=on * (1.0 + IMPACT_OFFSET_RATIO),
        width=0.95 * on,
        start=state,
        tolerance=THRESHOLD_RTOL,
        periods=periods,
        watch=watch,
    )
