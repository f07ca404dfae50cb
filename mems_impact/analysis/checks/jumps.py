"""Jumps of the flow that nothing declares: no step of a method is right across one."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence

from mems_impact.analysis.checks.times import Clock
from mems_impact.hybrid.tried import Place, Tried
from mems_impact.warnings import DiscontinuityWarning

__all__ = ["tell_of_jump"]

AHEAD = (1e-7, 1e-6, 1e-5)  # parts of the time scale within which a jump is looked for
CLEAR = 1e-3  # part of the slope by which it jumps at least
HALVINGS = 20  # of the stretch that encloses it
LASTS = 0.5  # part of the difference that is left of a jump then; of a steep slope, next to nothing


def tell_of_jump(
    tried: Tried, clock: Clock, at: Place, slope: Sequence[float], watching: Sequence[int]
) -> bool:
    """Warn if the flow jumps just ahead of a point, at which steps have become very short.

    A guard that fires there declares it.

    Parameters
    ----------
    tried : Tried
    clock : Clock
    at : Place
    slope : sequence of float
        The flow there.
    watching : sequence of int
        Guards.

    Returns
    -------
    bool
        Whether it jumps.
    """

    def ahead(s: float) -> Place:
        return Place(at.mode, at.t + s, [y + s * rate for y, rate in zip(at.y, slope, strict=True)])

    for part in AHEAD:
        high = part * clock.unit
        low, apart = 0.0, _difference(tried, ahead(0.0), ahead(high))
        if apart is None:
            continue
        beyond = ahead(8.0 * high)
        if any(tried.margin(i, at) * tried.margin(i, beyond) <= 0.0 for i in watching):
            return False
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            first = _size(tried, ahead(low), ahead(middle))
            low, high = (low, middle) if first >= 0.5 * apart else (middle, high)
        if _size(tried, ahead(low), ahead(high)) >= LASTS * apart:
            _tell(tried, ahead(low), ahead(high), LASTS * apart)
            return True
    return False


def _tell(tried: Tried, before: Place, after: Place, least: float) -> None:
    slopes = tried.flow(before), tried.flow(after)
    k = max(range(tried.n), key=lambda i: abs(slopes[1][i] - slopes[0][i]))
    jump = f"d{tried.states[k]}/dt jumps from {slopes[0][k]:.6g} to {slopes[1][k]:.6g}"

    def by(place: Callable[[int], Place]) -> list[str]:
        moved = [i for i in range(tried.n) if _size(tried, before, place(i)) >= least]
        return [f"{tried.states[i]} = {before.y[i]:.6g}" for i in moved]

    def one(i: int) -> Place:
        y = [*before.y[:i], after.y[i], *before.y[i + 1 :]]
        return Place(before.mode, before.t, y)

    if _size(tried, before, Place(before.mode, after.t, before.y)) >= least:
        where = f"t = {before.t:.6g}"
        remedy = "name the times at which it does in switches="
    else:
        where = " or ".join(by(one)) or tried.place(before).removeprefix("at ")
        remedy = "make it a Guard between two modes, or a part: Friction, Relay, Surface"
    warnings.warn(
        f"the flow is discontinuous: {jump} at {where}, where no step is accurate; {remedy}",
        DiscontinuityWarning,
        stacklevel=7,
    )


def _difference(tried: Tried, one: Place, other: Place) -> float | None:
    """Return by how much the flow differs, if clearly."""
    size = max(max(map(abs, tried.flow(each))) for each in (one, other))
    apart = _size(tried, one, other)
    return apart if apart > CLEAR * size else None


def _size(tried: Tried, one: Place, other: Place) -> float:
    pairs = zip(tried.flow(one), tried.flow(other), strict=True)
    return max(abs(b - a) for a, b in pairs)
