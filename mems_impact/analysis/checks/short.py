"""A short interpreted run of a system, on which its functions are tried.

Steps of Bogacki and Shampine's pair of order 3, whose points lie on a trajectory to a
thousandth of a step; guards are tried where the run meets them, found by bisection.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

from mems_impact.analysis.checks.jumps import AHEAD, tell_of_jump
from mems_impact.analysis.checks.met import compare
from mems_impact.analysis.checks.rates import check_jacobian, rate_of
from mems_impact.analysis.checks.times import Clock
from mems_impact.errors import FunctionError, InvalidParameter
from mems_impact.hybrid.blaming import Function
from mems_impact.hybrid.clocks import AT_TIMES, is_clock
from mems_impact.hybrid.problem import STEPS_PER_PERIOD
from mems_impact.hybrid.tried import Place, Tried, Undefined

__all__ = ["Short"]

CALLS = 300  # of the flow, of a system of few states
FEW = 8  # states
UNITS = 8.0  # length of the run, in its time scale
CLOSE = 1e-3  # error of a step, of its length
LOOKED = 6  # points at which times and rates are compared, a mode
INSTANT = 100  # times that one guard may fire in one instant
WEAK = 1e-2  # flights of this part of the time scale, each shorter than the last, end a sequence
SEQUENCE = 3  # flights
ZERO = 1e-9  # a margin that is none, of what it changes by within the time scale
FALLING = 1e-3  # a rate that falls after a transition, of that before it
BISECTIONS = 50
SHORT = 1e-6  # steps, of the time scale, before which the flow may jump
PROBES = 4  # places at which that is looked for

Met = Callable[[int, Place, Place], None]


class Lost(Exception):
    """From here on the short run says nothing about the system."""


class Short:
    """The short run.

    Parameters
    ----------
    tried : Tried
    clock : Clock
    met : callable
        Called with guard, point before and point after at every transition.
    """

    def __init__(self, tried: Tried, clock: Clock, met: Met) -> None:
        self.tried, self.clock, self.met = tried, clock, met
        self.guards = tried.definition.guards
        self.calls = CALLS * FEW // max(FEW, tried.n)
        self.looked: dict[int, int] = {}
        self.probes = PROBES
        self.hits: dict[int, list[float]] = {}

    def go(self, start: Place, *, meant: bool) -> None:
        """Run from `start`.

        Parameters
        ----------
        start : Place
        meant : bool
            Whether the user says that runs start there; else a function need have no value there.

        Raises
        ------
        FunctionError
            About the first function that does not do what it must.
        InvalidParameter
            If the start is meant and lies beyond an impact.
        """
        try:
            slope = self.tried.flow(start)
            now = self.margins(start)
            self.look(start, slope)
            if self.tried.definition.jacobian is not None:
                check_jacobian(self.tried, start, self.clock.unit)
            if self.inside(start, slope, now, meant=meant):
                return
        except Undefined as found:
            if meant:
                raise found.error from None
            return
        try:
            self.follow(start, slope, now)
        except (Lost, Undefined):
            return  # at a point of these checks' own

    def watching(self, mode: int) -> list[int]:
        """Return the guards that watch in a mode."""
        return [i for i, g in enumerate(self.guards) if g.modes is None or mode in g.modes]

    def margins(self, at: Place) -> dict[int, float]:
        """Return the margins of the guards that watch."""
        return {i: self.tried.margin(i, at) for i in self.watching(at.mode)}

    def rate(self, i: int, at: Place, slope: Sequence[float]) -> float:
        """Return the rate of a margin, given or not."""
        if self.guards[i].rate is not None:
            return self.tried.rate(i, at)
        return rate_of(self.tried, i, at, slope, self.clock.unit)[0]

    def inside(
        self, start: Place, slope: Sequence[float], now: dict[int, float], *, meant: bool
    ) -> bool:
        """Return whether the start lies beyond an impact, on its way further in."""
        for i, margin in now.items():
            if not (self.guards[i].impact and margin < 0.0):
                continue
            rate = self.rate(i, start, slope)
            beyond = margin < -1e-6 * (abs(margin - rate * self.clock.unit) + 1e-3)
            if beyond and rate <= 0.0:
                if not meant:
                    return True
                name, place = self.guards[i].name, self.tried.place(start)
                problem = f"lies beyond the guard {name!r}, whose margin is {margin:.6g} {place}"
                raise InvalidParameter("initial", None, "", problem=problem)
        return False

    def look(self, at: Place, slope: Sequence[float]) -> None:
        """Compare rates with differences, and times with later ones, at the first few points."""
        seen = self.looked[at.mode] = self.looked.get(at.mode, 0) + 1
        if seen <= LOOKED:
            compare(self.tried, self.clock, at, slope)

    def follow(self, at: Place, slope: list[float], now: dict[int, float]) -> None:
        """Follow the flow and its events until the budget is spent."""
        unit, end = self.clock.unit, at.t + UNITS * self.clock.unit
        longest, h = unit / STEPS_PER_PERIOD, 1e-4 * unit
        while self.calls > 0 and at.t < end:
            stop = self.clock.stop(at.t)
            h = min(h, longest, stop - at.t)
            step = self.step(at, slope, h, stop)
            if step is None or step[2] > 1.0:
                h *= 0.25 if step is None else max(0.2, 0.9 * step[2] ** (-1.0 / 3.0))
                stuck = h < 1e-9 * unit
                if stuck or (h < SHORT * unit and self.probes > 0):
                    self.probes -= 1
                    stretches = [part * unit for part in AHEAD]
                    if tell_of_jump(self.tried, at, slope, list(now), stretches) or stuck:
                        return
                continue
            there, ahead, error = step
            later = self.margins(there)
            fallen = [i for i in now if later[i] <= 0.0 and self.above(i, now[i], at, slope)]
            if fallen:
                i, there = self.crossing(fallen, at, slope, there, ahead)
                there = self.resolve(i, there)
            elif there.t >= stop:
                mode, y = self.tried.transition("settle", None, there)
                period = self.clock.period
                shift = period if period is not None and there.t >= period else 0.0
                there, end = Place(mode, there.t - shift, y), end - shift
            if fallen or there.t != at.t + h:
                ahead = self.tried.flow(there)
                later = self.margins(there)
            at, slope, now = there, ahead, later
            self.look(at, slope)
            h *= min(4.0, 0.9 * max(error, 1e-3) ** (-1.0 / 3.0))

    def above(self, i: int, margin: float, at: Place, slope: list[float]) -> bool:
        """Return whether a margin is positive, or about to be."""
        return margin > 0.0 or self.rate(i, at, slope) > 0.0

    def step(
        self, at: Place, k1: list[float], h: float, stop: float
    ) -> tuple[Place, list[float], float] | None:
        """Return point and slope after a step and its error; None if it leaves the domain."""
        last = math.nextafter(stop, 0.0) if stop < math.inf else math.inf
        mode, t, y = at

        def slope_at(part: float, *terms: tuple[float, list[float]]) -> list[float]:
            self.calls -= 1
            return self.tried.flow(Place(mode, min(t + part * h, last), moved(y, h, *terms)))

        try:
            k2 = slope_at(0.5, (0.5, k1))
            k3 = slope_at(0.75, (0.75, k2))
            new = moved(y, h, (2.0 / 9.0, k1), (1.0 / 3.0, k2), (4.0 / 9.0, k3))
            there = Place(mode, min(t + h, stop), new)
            k4 = slope_at(1.0, (2.0 / 9.0, k1), (1.0 / 3.0, k2), (4.0 / 9.0, k3))
        except (Undefined, FunctionError):
            return None
        wrong = moved([0.0] * len(y), h, (-5 / 72, k1), (1 / 12, k2), (1 / 9, k3), (-1 / 8, k4))
        error = 0.0
        for i, value in enumerate(wrong):
            size = max(abs(h * k1[i]), abs(h * k4[i]), 1e-6 * abs(y[i]))
            error = max(error, abs(value) / (CLOSE * size)) if size > 0.0 else error
        return (there, k4, error) if math.isfinite(error) else None

    def crossing(
        self,
        fallen: list[int],
        at: Place,
        slope: list[float],
        there: Place,
        ahead: list[float],
    ) -> tuple[int, Place]:
        """Return the guard whose margin falls through zero first within a step, and where."""
        h = there.t - at.t

        def between(part: float) -> Place:
            # Hermite's cubic.
            b = part * part * (3.0 - 2.0 * part)
            c, d = part * (1.0 - part) ** 2 * h, part * part * (part - 1.0) * h
            parts = zip(at.y, slope, there.y, ahead, strict=True)
            y = [(1.0 - b) * y0 + b * y1 + c * d0 + d * d1 for y0, d0, y1, d1 in parts]
            return Place(at.mode, at.t + part * h, y)

        found = []
        for i in fallen:
            low, high = 0.0, 1.0
            for _ in range(BISECTIONS):
                middle = 0.5 * (low + high)
                if self.tried.margin(i, between(middle)) > 0.0:
                    low = middle
                else:
                    high = middle
            found.append((low, self.guards[i].order or 0, i))
        part, _, i = min(found)
        return i, between(part)

    def resolve(self, i: int, at: Place) -> Place:
        """Carry out the transitions of an instant, beginning with guard `i`."""
        guard, fired = self.guards[i], 0
        kind = "transition"
        if guard.impact and self.accumulates(i, at):
            kind = "rest"
            if guard.rest is None:
                raise Lost
        while guard.transition is not None:
            before = self.rate(i, at, self.tried.flow(at))
            if before >= 0.0:
                raise Lost  # rounding, rather than the flow, has led through zero
            mode, y = self.tried.transition(kind, i, at)
            after = Place(mode, at.t, y)
            self.met(i, at, after)
            if not self.falls(i, after, before):
                return after
            fired += 1
            if guard.impact or fired >= INSTANT:
                raise self.still_falling(i, kind, after)
            at = after
        return at

    def accumulates(self, i: int, at: Place) -> bool:
        """Note an impact; return whether it is the last but infinitely many of a sequence."""
        hits = self.hits[i] = [*self.hits.get(i, []), at.t][-SEQUENCE - 1 :]
        flights = [later - earlier for earlier, later in pairwise(hits)]
        shrinking = all(0.0 < short < long for long, short in pairwise(flights))
        return len(flights) == SEQUENCE and shrinking and flights[-1] < WEAK * self.clock.unit

    def falls(self, i: int, at: Place, before: float) -> bool:
        """Return whether a guard fires again after its transition."""
        if i not in self.watching(at.mode):
            return False
        slope = self.tried.flow(at)
        rate, error = rate_of(self.tried, i, at, slope, self.clock.unit)
        low = self.tried.margin(i, at) <= ZERO * abs(before) * self.clock.unit
        return low and rate < -FALLING * abs(before) - error

    def still_falling(self, i: int, kind: str, at: Place) -> FunctionError:
        """Return the sentence about a transition that leads nowhere."""
        guard = self.guards[i]
        assert guard.transition is not None
        rate = self.rate(i, at, self.tried.flow(at))
        problem = f"leaves its margin at zero and falling, at the rate {rate:.6g}"
        problem += ", so that it fires again in the same instant"
        remedy = "turn the rate round, or lead to a mode in which the guard does not watch"
        if is_clock(lambda y: self.tried.margin(i, Place(at.mode, at.t, list(y))), at.y):
            remedy = AT_TIMES
        return Function(kind, guard.transition, guard.name).error(problem, remedy)


def moved(y: Sequence[float], h: float, *terms: tuple[float, list[float]]) -> list[float]:
    """Return ``y`` moved by `h` times a weighted sum of slopes."""
    return [
        value + h * sum(weight * slope[i] for weight, slope in terms) for i, value in enumerate(y)
    ]
