"""Rest on stoppers that yield, told by how long contacts last."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mems_impact.actuator.design.impacts import is_impact, is_release, yields
from mems_impact.actuator.modes import V2
from mems_impact.actuator.parameters import Actuator
from mems_impact.hybrid import loop
from mems_impact.hybrid.trajectory import Events, Floats

__all__ = ["Rests", "contact_time"]

LONGEST = 2.0  # a force that presses makes a bounce last up to so many times as long (exponent 1)


class Rests:
    """Tells bounces off stoppers that yield from rest on them, while events come in portions.

    A bounce lasts for up to two of its `contact_time`; what lasts longer has come to rest. The
    event that ends it is then told like the end of a sequence of impacts at a rigid stopper.

    Parameters
    ----------
    actuator : Actuator
        In the units of the numerics.
    period : float
        Forcing period.
    """

    def __init__(self, actuator: Actuator, period: float) -> None:
        self._actuator, self._period = actuator, period
        self._yields = yields(actuator)
        self._hits = np.zeros((0, 3))  # the last impact so far: time, speed, guard

    def __call__(self, events: Events) -> Events:
        """Return the next events, the ends of rests told as such."""
        if not self._yields:
            return events
        time = events.cycle * self._period + events.time
        impact = is_impact(events)
        new = np.stack([time, np.abs(events.before[:, V2]), events.guard], axis=1)[impact]
        hits = np.concatenate([self._hits, new])
        known = np.cumsum(impact) + len(self._hits)  # hits until each event
        ends = np.flatnonzero(is_release(events) & (known > 0))
        begun = hits[known[ends] - 1]
        lasted = time[ends] - begun[:, 0]
        rests = lasted > LONGEST * contact_time(self._actuator, begun[:, 1])
        self._hits = hits[-1:]
        kind, guard = events.kind.copy(), events.guard.copy()
        kind[ends[rests]] = loop.ACCUMULATION
        guard[ends[rests]] = begun[rests, 2].astype(np.int64)
        return replace(events, kind=kind, guard=guard)


def contact_time(actuator: Actuator, speed: Floats) -> Floats:
    """Return how long the block is in contact with a stopper that yields at impacts with `speed`.

    Of a frame at rest, without damping and force: quadrature of the energy,
    m2 s'^2/2 + K s^(n+1)/(n+1) = m2 speed^2/2 at the depth s (Johnson, Contact Mechanics, 1985,
    Section 11.4).

    Parameters
    ----------
    actuator : Actuator
        With a `CompliantStopper`.
    speed : float array

    Returns
    -------
    float array
    """
    (stopper,) = (dict(term) for term in actuator.terms if term.instead == "stopper")
    power = stopper["exponent"] + 1.0
    factor = stopper["stiffness"] / stopper["depth"] ** (power - 2.0)
    deepest = (0.5 * power * actuator.m2 * speed * speed / factor) ** (1.0 / power)
    shape = math.sqrt(math.pi) * math.gamma(1.0 + 1.0 / power) / math.gamma(0.5 + 1.0 / power)
    still: NDArray[np.bool_] = speed == 0.0
    time: Floats = 2.0 * shape * deepest / np.where(still, 1.0, speed)
    return np.where(still, 0.0, time)
