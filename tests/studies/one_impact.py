"""Orbits of an impact oscillator with one impact in n periods, in closed form.

x'' + 2 zeta x' + x = A cos(omega t) below a wall, at which the velocity is reversed: v -> -e v.
From an impact at the phase t0 with the speed V the motion is known; it takes n periods back to the
wall for one V, and V is kept at the zeros of a function of t0 alone.
"""

import cmath
import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq


class Known(NamedTuple):
    """An orbit: the phase and the speed of its impact, its largest multiplier."""

    phase: float
    speed: float
    multiplier: float


class OneImpact:
    def __init__(self, A, omega, zeta, wall, e):
        self.e, self.wall, self.zeta, self.omega = e, wall, zeta, omega
        self.driven = A / complex(1.0 - omega**2, 2.0 * zeta * omega)
        self.root = math.sqrt(1.0 - zeta**2)
        self.period = 2.0 * math.pi / omega

    @property
    def swing(self):
        """The amplitude without impacts."""
        return abs(self.driven)

    def flight(self, start, velocity, time):
        """Return position and velocity a time after the wall is left."""
        turn = 1j * self.omega
        here, there = (
            self.driven * cmath.exp(turn * start),
            self.driven * np.exp(turn * (start + time)),
        )
        c, d = self.wall - here.real, velocity - (turn * here).real
        cos, sin = np.cos(self.root * time), np.sin(self.root * time)
        decay = np.exp(-self.zeta * time)
        x = decay * (c * cos + (d + self.zeta * c) / self.root * sin)
        v = decay * (d * cos - (self.zeta * d + c) / self.root * sin)
        return x + there.real, v + (turn * there).real

    def speed(self, start, n):
        """Return the speed of the impact after which the flight takes n periods."""
        (zero, _), (one, _) = (self.flight(start, v, n * self.period) for v in (0.0, 1.0))
        return -(self.wall - zero) / (one - zero) / self.e

    def excess(self, start, n):
        """Return by how much the next impact is faster."""
        speed = self.speed(start, n)
        return self.flight(start, -self.e * speed, n * self.period)[1] - speed

    def orbits(self, n):
        """Return the orbits with one impact in n periods that stay below the wall in between."""
        phases = np.linspace(0.0, self.period, 2001)
        values = [self.excess(phase, n) for phase in phases]
        times = np.linspace(0.0, n * self.period, 4001)[1:-1]
        found = []
        for (a, before), (b, after) in pairwise(zip(phases, values, strict=True)):
            if before * after < 0.0:
                phase = brentq(self.excess, a, b, args=(n,), xtol=1e-14)
                speed = self.speed(phase, n)
                below = self.flight(phase, -self.e * speed, times)[0] < self.wall
                if speed > 0.0 and below.all():
                    found.append(Known(phase, speed, self._multiplier(phase, speed, n)))
        return found

    def _multiplier(self, phase, speed, n):
        """Return the largest multiplier of the map from impact to impact."""
        time, h = n * self.period, 1e-5

        def flight(phase, speed):
            return np.array(self.flight(phase, -self.e * speed, time))

        by_phase = (flight(phase + h, speed) - flight(phase - h, speed)) / (2.0 * h)
        by_speed = (flight(phase, speed + h) - flight(phase, speed - h)) / (2.0 * h)
        x, v = flight(phase, speed)
        force = (self.driven * (1.0 - self.omega**2 + 2j * self.zeta * self.omega)).real
        slope = force * math.cos(self.omega * (phase + time)) - 2.0 * self.zeta * v - x
        columns = []
        for (off, faster), own in ((by_phase, 1.0), (by_speed, 0.0)):
            later = -off / v  # the wall is reached later by so much
            columns.append([own + later, faster + slope * later])
        return float(max(abs(np.linalg.eigvals(np.array(columns).T))))
