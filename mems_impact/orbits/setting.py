"""Where in the space of parameters the equations of an orbit are looked at."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mems_impact.errors import OrbitError
from mems_impact.hybrid.trajectory import Floats
from mems_impact.orbits.family import Family

NEAREST = 1e-9  # room that is left to differences in time beside a switch
FACTOR = 4.0 / 3.0  # a period that jumps changes by more: a sine without bias has half the period
HALVINGS = 40  # of the way between two values, after which a period that differs has jumped


@dataclass(frozen=True, eq=False)
class Setting:
    """A problem's numbers at some values of k parameters, with their derivatives by these.

    Attributes
    ----------
    values : float array, shape (k,)
    parameters : float array, shape (count,)
    directions : float array, shape (max(1, k), count)
        Derivatives of the parameter array, each divided by its scale: differences want directions
        of length one.
    scales : float array, shape (k,)
    period : float
    period_rates : float array, shape (k,)
    switches : float array, shape (s,)
    switch_rates : float array, shape (k, s)
    time_scale : float
        Within which whatever acts on the system shows all that it does.
    """

    values: Floats
    parameters: Floats
    directions: Floats
    scales: Floats
    period: float
    period_rates: Floats
    switches: Floats
    switch_rates: Floats
    time_scale: float

    @classmethod
    def of(cls, family: Family, active: tuple[str, ...], values: Floats) -> Setting:
        """Return the setting at `values` of the parameters `active`."""
        there = family.at(**dict(zip(active, values.tolist(), strict=True)))
        numbers = there.numbers()
        p, switches = np.asarray(numbers.parameters, dtype=float), np.array(numbers.switches)
        k = len(active)
        directions = np.zeros((max(1, k), p.size))
        scales, period_rates, switch_rates = np.ones(k), np.zeros(k), np.zeros((k, switches.size))
        for j, name in enumerate(active):
            p_rate, period_rates[j], rates = there.derivative(name)
            switch_rates[j] = rates[: switches.size]
            scales[j] = float(np.abs(p_rate).max()) or 1.0
            directions[j] = p_rate / scales[j]
        scale = numbers.time_scale or numbers.period
        return cls(
            values, p, directions, scales, numbers.period, period_rates, switches, switch_rates,
            scale,
        )  # fmt: skip

    def check_period(self, family: Family, active: tuple[str, ...], near: Setting) -> None:
        """Check that the forcing period changes continuously on the way from `near`.

        Raises
        ------
        OrbitError
            If it jumps on the way.
        """
        if _alike(near.period, self.period):
            return
        (begin, first), (end, last) = (near.values, near.period), (self.values, self.period)
        for _ in range(HALVINGS):
            middle = 0.5 * (begin + end)
            between = dict(zip(active, middle.tolist(), strict=True))
            period = family.numbers(**between).period
            if not _alike(first, period):
                end, last = middle, period
            elif not _alike(period, last):
                begin, first = middle, period
            else:
                return
        raise OrbitError(
            reason=f"the period jumps from {family.amount('period', first)} to "
            f"{family.amount('period', last)} here",
            remedy="stay on this side (a sine without bias has half the period)",
        )

    def lasting(self, period: float) -> Setting:
        """Return the setting of a cycle with a period of its own."""
        return replace(self, period=period, period_rates=np.zeros_like(self.period_rates))

    def room(self, time: float) -> float:
        """Return the time from an event to the nearest switch of the drive."""
        if not self.switches.size:
            return math.inf
        since = np.abs(time - self.switches) % self.period
        return float(max(np.minimum(since, self.period - since).min(), NEAREST))

    def motion(self, start: float, end: float) -> Floats:
        """Return how instants between the switches around an arc move with the parameters.

        Linear in time from switch to switch (or the ends of the period); shape (max(1, k), 2).
        """
        still = np.zeros((len(self.directions), 2))
        if not (self.switches.size and self.values.size):
            return still
        times = np.array([0.0, *self.switches, self.period])
        rates = np.column_stack([0.0 * self.period_rates, self.switch_rates, self.period_rates])
        first = int(np.flatnonzero(times[:-1] <= max(start, 0.0))[-1])
        later = np.flatnonzero((times >= end) & (times > times[first]))
        last = int(later[0]) if later.size else times.size - 1
        if times[last] <= times[first]:
            return still
        slope = (rates[:, last] - rates[:, first]) / (times[last] - times[first])
        offset = rates[:, first] - slope * times[first]
        return np.column_stack([offset, slope]) / self.scales[:, None]


def _alike(one: float, other: float) -> bool:
    return 1.0 / FACTOR < other / one < FACTOR
