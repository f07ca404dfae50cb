"""A reference for any automaton: SciPy's DOP853, its dense output searched for every event.

Nothing of the package is used. Within a step all margins and their rates are looked at on a dense
grid, so that a margin that dips below zero and comes back is seen; the state at an event is
integrated to it. Where the reference cannot tell what happens, it ends: at tangential and at
simultaneous events, and where a reset puts a margin next to zero.
"""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import DOP853
from scipy.optimize import brentq

from validation.campaign.comparing import END, SHORT, Row

Floats = NDArray[np.float64]

GRID = np.linspace(0.0, 1.0, 25)  # of a step
NEAR = 1e-9  # a margin that is zero
CLEAR = 1e-4  # one that is not, below zero
STEEP = 1e-3  # a rate that is none
SLOW = 1e-6  # one of a gap, which closes slowly at the end of a sequence of impacts
IN_AN_INSTANT = 8  # transitions, at most
FLIGHT = 3e-5  # flights shorter than this are the end of a sequence of impacts
WEAKEST = 1e-5  # speed down to which the package, which has no closed form, measures impacts


class System(Protocol):
    """What is followed. Functions take one time and state, or many: (k,) and (k, n)."""

    order: Floats  # of the guards within one instant
    impact: NDArray[np.bool_]
    condition: NDArray[np.bool_]  # guards that fire at once where a mode begins below their zero
    stopped: int  # the mode after a sequence of impacts, in which nothing moves

    def flow(self, mode: int, t: Any, y: Floats) -> Floats:
        """Return the time derivative of the state."""

    def margins(self, mode: int, t: Any, y: Floats) -> tuple[Floats, Floats]:
        """Return margins and rates, infinite and zero where they do not apply."""

    def fire(self, mode: int, guard: int, t: float, y: Floats) -> tuple[int, Floats]:
        """Return mode and state after the transition."""

    def contact(self, mode: int, guard: int, t: float, y: Floats) -> Floats:
        """Return the state after an impact without rebound."""

    def restitution(self, guard: int) -> float:
        """Return the restitution of an impact."""


class Undecided(Exception):
    """What happens at this time, the reference cannot tell."""


class Follower:
    """One motion of a system."""

    def __init__(self, system: System, mode: int, t: float, y: Floats, rtol: float = 1e-12):
        self.system, self.mode, self.t, self.y = system, mode, t, y
        self.rtol = rtol
        self.steep = np.where(system.impact, SLOW, STEEP)
        self.waiting = np.zeros(system.impact.size, dtype=bool)  # for a positive margin
        self.rows: list[Row] = []

    def follow(self, end: float, most: int = 60) -> tuple[list[Row], float]:
        """Return the events up to `end`, and how far they are known."""
        try:
            while len(self.rows) < most:
                if self.mode == self.system.stopped or not self._arc(end):
                    self.rows.append(Row(end, END, self.mode, self.y))
                    return self.rows, end
        except Undecided:
            pass
        return self.rows, self.t

    def carry(self, time: float) -> Floats:
        """Return the state after `time` in which nothing can happen."""
        return self._integrate(self.t, self.y, self.t + time)

    def _integrate(self, t: float, y: Floats, end: float) -> Floats:
        solver = self._solver(t, y, end)
        while solver.status == "running":
            solver.step()
        return solver.y

    def _solver(self, t: float, y: Floats, end: float) -> DOP853:
        system, mode = self.system, self.mode

        def fun(t: float, y: Floats) -> Floats:
            return system.flow(mode, t, y)

        return DOP853(fun, t, y, end, rtol=self.rtol, atol=0.01 * self.rtol, max_step=0.5)

    def _arc(self, end: float) -> bool:
        """Integrate to the next event and carry it out; False if `end` came first."""
        solver = self._solver(self.t, self.y, end)
        first = True
        while solver.status == "running":
            t, y = solver.t, solver.y.copy()
            solver.step()
            if solver.status == "failed":
                raise Undecided
            event = self._search(solver.dense_output(), t, solver.t, first)
            if event is not None:
                self._refine(t, y, *event)
                return True
            first = False
        self.t, self.y = float(solver.t), solver.y
        return False

    def _search(self, dense: Any, t: float, last: float, first: bool) -> tuple[int, float] | None:
        """Return the guard that fires first within a step, and about when."""
        system, mode = self.system, self.mode
        times = t + (last - t) * GRID
        values, rates = system.margins(mode, times, dense(times).T)
        below = values < 0.0
        if first:
            below[0] = False  # margins are zero or above where an arc begins, or wait
        step = times[1] - times[0]
        down, up = rates[:-1] < 0.0, rates[1:] > 0.0
        # A margin that waits may rise above zero and fall again between two points.
        higher, fastest = np.maximum(values[:-1], values[1:]), np.maximum(rates[:-1], -rates[1:])
        peaks = ~down & ~up & (higher < NEAR) & (higher > -2.0 * step * fastest)
        rises = np.logical_or.accumulate(values > NEAR, axis=0)
        waits = self.waiting & ~rises
        if (peaks & waits[1:]).any():
            raise Undecided
        below &= ~waits
        dips = down & up & ~below[:-1] & ~below[1:] & (values[:-1] < -2.0 * step * rates[:-1])
        dips &= ~waits[:-1]
        found = below[1:] | dips

        def margin(time: float, guard: int) -> float:
            return float(system.margins(mode, time, dense(time))[0][guard])

        def rate(time: float, guard: int) -> float:
            return float(system.margins(mode, time, dense(time))[1][guard])

        for k in np.flatnonzero(found.any(axis=1)):
            events = []
            for guard in np.flatnonzero(found[k]):
                low, high = times[k], times[k + 1]
                if dips[k, guard]:
                    high = brentq(rate, low, high, args=(guard,), xtol=1e-15)
                    if margin(high, guard) >= 0.0:
                        continue
                if first and k == 0 and values[0, guard] < NEAR:
                    if not rates[0, guard] > 0.0 > rates[1, guard]:
                        raise Undecided
                    low = brentq(rate, low, high, args=(guard,), xtol=1e-15)
                if margin(low, guard) <= 0.0:
                    raise Undecided
                time = brentq(margin, low, high, args=(guard,), xtol=1e-15, rtol=1e-15)
                events.append((time, int(guard)))
            if events:
                time, guard = min(events)
                self.waiting = waits[k]
                return guard, time
        self.waiting = waits[-1]
        return None

    def _refine(self, t: float, y: Floats, guard: int, about: float) -> None:
        """Integrate from a step's beginning to the event and carry out what it brings."""
        if about > t:
            y = self._integrate(t, y, about)
        self.t = about
        values, rates = self.system.margins(self.mode, about, y)
        if rates[guard] > -self.steep[guard]:
            raise Undecided
        late = -values[guard] / rates[guard]
        y = y + late * self.system.flow(self.mode, about, y)
        self.t = about + float(late)
        others = np.delete(values + late * rates, guard)
        if np.any(np.abs(others) < 1e-7):
            raise Undecided
        self._carry_out(guard, y, -float(rates[guard]))

    def _carry_out(self, guard: int, y: Floats, fall: float) -> None:
        """Carry out all transitions of this instant."""
        system = self.system
        for _ in range(IN_AN_INSTANT):
            last, before = self.mode, y
            mode, y = system.fire(last, guard, self.t, y)
            self.waiting[guard] = not system.condition[guard]
            self.rows.append(Row(self.t, guard, mode, y, fall))
            self.mode, self.y = mode, y
            if system.impact[guard] and self._rests(guard, last):
                return
            values, rates = system.margins(mode, self.t, y)
            zero = np.abs(values) < NEAR
            self._wait(last, before, y, values)
            if np.any((values < NEAR) & (values > -CLEAR) & ~(zero & (np.abs(rates) > self.steep))):
                raise Undecided
            if np.any((values < -NEAR) & system.impact):
                raise Undecided  # put into a wall
            fires = ((values < -CLEAR) | (zero & (rates < 0.0))) & ~self.waiting
            if not fires.any():
                return
            first = int(np.argmin(np.where(fires, system.order, math.inf)))
            # Impacts go round: after one of them, those behind it come before those in front.
            behind = fires & system.impact & (system.order > system.order[guard])
            if system.impact[guard] and system.impact[first] and behind.any():
                first = int(np.argmin(np.where(behind, system.order, math.inf)))
            guard = first
            fall = math.inf
        raise Undecided

    def _wait(self, last: int, before: Floats, y: Floats, values: Floats) -> None:
        """Let guards wait that did not watch in the mode `last`, and do not fall through zero."""
        system, mode = self.system, self.mode
        earlier, _ = system.margins(last, self.t, before)
        crossed, _ = system.margins(mode, self.t, before)
        entered = ~np.isfinite(earlier)
        free = ~system.condition & (values < NEAR)
        if np.any(free & entered & (np.abs(crossed) < 1e-7)):
            raise Undecided
        # A reset, or the other margin of the new mode, may put a margin next to zero by chance.
        changed = (crossed != earlier) | (before != y).any()
        near = ~system.condition & (np.abs(values) < CLEAR)
        if np.any(near & ~entered & self.waiting & changed):
            raise Undecided
        self.waiting = free & np.where(entered & (values < -CLEAR), crossed < 0.0, self.waiting)

    def _rests(self, guard: int, last: int) -> bool:
        """Complete a sequence of impacts, if this is one on its last legs.

        `last` is the mode before the impact.
        """
        system, mode, t, y = self.system, self.mode, self.t, self.y
        h = 1e-6
        rate = system.margins(mode, t, y)[1][guard]
        ahead = system.margins(mode, t + h, y + h * system.flow(mode, t, y))[1][guard]
        pressure = -(ahead - rate) / h
        if pressure <= 0.0 or 2.0 * rate > FLIGHT * pressure:
            return False
        if mode != last:
            raise Undecided  # flights under different forces take turns
        e = system.restitution(guard)
        rest = float(2.0 * rate / pressure / (1.0 - e))
        y = system.contact(mode, guard, t, y)
        slope = system.flow(mode, t, y)
        self.t = t + rest
        self.y = system.contact(mode, guard, self.t, y + rest * slope)
        self.mode = system.stopped
        weakest, blur = WEAKEST * (1.0 - e), SHORT * float(np.abs(slope).max())
        self.rows.append(Row(self.t, guard, self.mode, self.y, weakest, True, blur))
        return True
