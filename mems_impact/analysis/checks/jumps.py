"""Jumps of the flow that nothing declares: no step of a method is right across one."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from mems_impact.errors import FunctionError
from mems_impact.hybrid.trajectory import Instant
from mems_impact.hybrid.tried import Place, Tried, Undefined
from mems_impact.telling import tell
from mems_impact.warnings import DiscontinuityWarning

if TYPE_CHECKING:
    from mems_impact.analysis.system import System

__all__ = ["AHEAD", "tell_of_fall", "tell_of_jump"]

AHEAD = (1e-7, 1e-6, 1e-5)  # parts of the time scale within which a jump is looked for
STEPS_AHEAD = (1.0, 8.0, 64.0)  # that in very short steps of a run
BEYOND = 8.0  # of the stretch, where a guard declares what jumps in it
CLEAR = 1e-6  # part of the slope by which it jumps at least
HALVINGS = 60  # of the stretch that encloses it, if rounding does not end them before
LASTS = 0.5  # part of the difference that is left of a jump then; of a steep slope, next to nothing
ROUNDING = 0.1  # part of the difference that rounding of state and time may make


def tell_of_fall(system: System, at: Instant, length: float) -> bool:
    """Warn if the flow jumps where the steps of a run have become very short.

    Parameters
    ----------
    system : System
        One that is written of functions.
    at : Instant
        Where such a step begins, in the units of the numerics; cyclic components mean nothing.
    length : float
        Of the step.

    Returns
    -------
    bool
        Whether it jumps.
    """
    definition, numbers = vars(system)["_definition"], system.numbers()
    tried = Tried(definition, [system.value(name) for name in definition.parameters])
    # Functions may depend on time where something forces the system, and switch within a period.
    time = math.fmod(at.time, numbers.period) if system.forced else 0.0
    switches = numbers.switches and (*numbers.switches, numbers.period + numbers.switches[0])
    stop = next((switch for switch in switches if switch > time), math.inf)
    stretches = [part * length for part in STEPS_AHEAD if time + BEYOND * part * length < stop]
    values = zip(system.states, at.y.tolist(), strict=True)
    y = [float(system.out(name, value)) for name, value in values]
    place = Place(at.mode, float(system.out("time", time)), y)
    watching = [i for i, g in enumerate(definition.guards) if g.modes is None or at.mode in g.modes]
    try:
        slope = tried.flow(place)
        units = [float(system.out("time", stretch)) for stretch in stretches]
        return tell_of_jump(tried, place, slope, watching, units)
    except (FunctionError, Undefined, ArithmeticError):
        return False  # what is wrong with a function is told elsewhere


def tell_of_jump(
    tried: Tried,
    at: Place,
    slope: Sequence[float],
    watching: Sequence[int],
    stretches: Sequence[float],
) -> bool:
    """Warn if the flow jumps just ahead of a point, at which steps have become very short.

    A guard that fires there declares it.

    Parameters
    ----------
    tried : Tried
    at : Place
    slope : sequence of float
        The flow there.
    watching : sequence of int
        Guards.
    stretches : sequence of float
        Times within which it is looked for, ascending.

    Returns
    -------
    bool
        Whether it jumps.
    """

    def ahead(s: float) -> Place:
        return Place(at.mode, at.t + s, [y + s * rate for y, rate in zip(at.y, slope, strict=True)])

    for whole in stretches:
        end, beyond = ahead(whole), ahead(BEYOND * whole)
        enclosed = _enclosed(tried, ahead, whole)
        if enclosed is None:
            continue
        if any(tried.margin(i, at) * tried.margin(i, beyond) <= 0.0 for i in watching):
            return False
        before, after, least = enclosed
        if min(_rounding(tried, at), _rounding(tried, end)) < ROUNDING * least:
            _tell(tried, before, after, least, end)
            return True
    return False


def _enclosed(
    tried: Tried, ahead: Callable[[float], Place], whole: float
) -> tuple[Place, Place, float] | None:
    """Return neighbouring places between which the flow jumps, and by how much at least.

    It is halved until a half has no more than its share of the difference, as where it is steep.
    """
    low, high = ahead(0.0), ahead(whole)
    before, after = tried.flow(low), tried.flow(high)
    least = LASTS * _size(before, after)
    if least <= CLEAR * max(map(abs, (*before, *after))):
        return None
    first, last = 0.0, whole
    for _ in range(HALVINGS):
        middle = 0.5 * (first + last)
        there = ahead(middle)
        if there in (low, high):
            break  # no number lies between
        between = tried.flow(there)
        parts = _size(before, between), _size(between, after)
        if max(parts) < least:
            return None
        if parts[0] >= parts[1]:
            last, high, after = middle, there, between
        else:
            first, low, before = middle, there, between
    return low, high, least


def _rounding(tried: Tried, at: Place) -> float:
    """Return how much the flow changes where state and time change in their last digit."""
    flow, most = tried.flow(at), 0.0
    for pattern in ((1.0,), (-1.0,), (1.0, -1.0)):
        signs = [pattern[i % len(pattern)] for i in range(tried.n + 1)]
        *y, t = (math.nextafter(a, s * math.inf) for a, s in zip((*at.y, at.t), signs, strict=True))
        most = max(most, _size(flow, tried.flow(Place(at.mode, t, y))))
    return most


def _tell(tried: Tried, before: Place, after: Place, least: float, end: Place) -> None:
    """Warn of a jump between two places, on a stretch with an end beyond them."""
    slopes = tried.flow(before), tried.flow(after)
    k = max(range(tried.n), key=lambda i: abs(slopes[1][i] - slopes[0][i]))
    jump = f"d{tried.states[k]}/dt jumps from {slopes[0][k]:.6g} to {slopes[1][k]:.6g}"

    def changes(place: Place) -> bool:
        return _size(slopes[0], tried.flow(place)) >= least

    def by(place: Callable[[int], Place]) -> list[str]:
        moved = [i for i in range(tried.n) if changes(place(i))]
        # A zero in reach is where it jumps, whatever rounding makes of it.
        at = [0.0 if abs(y) <= abs(y - far) else y for y, far in zip(before.y, end.y, strict=True)]
        return [f"{tried.states[i]} = {at[i]:.6g}" for i in moved]

    def one(i: int) -> Place:
        y = [*before.y[:i], after.y[i], *before.y[i + 1 :]]
        return Place(before.mode, before.t, y)

    if changes(Place(before.mode, after.t, before.y)):
        where = f"t = {before.t:.6g}"
        remedy = "name the times at which it does in switches="
    else:
        where = " or ".join(by(one)) or tried.place(before).removeprefix("at ")
        remedy = "make it a Guard between two modes, or a part: Friction, Relay, Surface"
    message = f"the flow is discontinuous: {jump} at {where}, where no step is accurate; {remedy}"
    tell(message, DiscontinuityWarning)


def _size(one: Sequence[float], other: Sequence[float]) -> float:
    """Return by how much two slopes differ."""
    return max(abs(b - a) for a, b in zip(one, other, strict=True))
