"""The linear impact oscillator in closed form: orbits with one impact, folds, period doublings.

x'' + c x' + k x = A u(t) with a stop at x = d, u of period T; one impact, at speed v, every n T.
From one impact to the next (d, v) = P (d, -e v) + (I - P) s(t0), where s is the steady response
without the stop and P = exp(n T [[0, 1], [-k, -c]]). For a cosine s is A (R cos, -R omega sin), so
that A and t0 follow from v, and the fold from dA/dv = 0; for a square wave A and v follow from t0.
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.optimize import brentq

TAU = 2.0 * math.pi


@dataclass(frozen=True)
class Orbit:
    """One orbit: amplitude, time of impact in [0, T), speed before it, exact monodromy."""

    amplitude: float
    time: float
    speed: float
    monodromy: np.ndarray

    @property
    def multipliers(self):
        values = np.linalg.eigvals(self.monodromy).astype(complex)
        return values[np.argsort(-np.abs(values))]


@dataclass(frozen=True, kw_only=True)
class Exact:
    """The oscillator at one frequency; `square` for the square wave instead of the cosine."""

    omega: float
    c: float = 0.1
    k: float = 1.0
    d: float = 1.0
    e: float = 0.8
    n: int = 1
    square: float = 0.0

    @property
    def generator(self):
        return np.array([[0.0, 1.0], [-self.k, -self.c]])

    @property
    def period(self):
        return TAU / self.omega

    @property
    def over(self):
        """P."""
        return expm(self.n * self.period * self.generator)

    @property
    def gain(self):
        """R: amplitude of the steady response to a cosine of amplitude one."""
        return 1.0 / math.hypot(self.k - self.omega**2, self.c * self.omega)

    @property
    def graze(self):
        """The amplitude at which the orbit without impact touches (cosine)."""
        return self.d / self.gain

    def steady(self, t):
        """The response to the wave of amplitude one, without the stop: position and speed."""
        if not self.square:
            lag = math.atan2(self.c * self.omega, self.k - self.omega**2)
            angle = self.omega * t - lag
            return self.gain * np.array([math.cos(angle), -self.omega * math.sin(angle)])
        half = 0.5 * self.period
        turns, t = divmod(t, half)
        rest = np.array([1.0 / self.k, 0.0])
        start = np.linalg.solve(np.eye(2) + expm(half * self.generator), -rest)
        start = start + expm(half * self.generator) @ np.linalg.solve(
            np.eye(2) + expm(half * self.generator), rest
        )
        z = rest + expm(t * self.generator) @ (start - rest)
        return z if turns % 2 == 0 else -z

    def wave(self, t):
        if not self.square:
            return math.cos(self.omega * t)
        return 1.0 if (t / self.period) % 1.0 < 0.5 else -1.0

    def response(self):
        """(w0, w1): A s(t0) = w0 + v w1."""
        resolvent = np.linalg.inv(np.eye(2) - self.over)
        w0 = resolvent @ (np.eye(2) - self.over) @ np.array([self.d, 0.0])
        w1 = resolvent @ (np.array([0.0, 1.0]) + self.e * self.over @ np.array([0.0, 1.0]))
        return w0, w1

    def monodromy(self, amplitude, t0, speed):
        """P S, based just after the impact."""
        pull = (1.0 + self.e) * (amplitude * self.wave(t0) - self.k * self.d)
        # a_after + e a_before; the parts with c cancel.
        saltation = np.array([[-self.e, 0.0], [pull / speed, -self.e]])
        return saltation @ self.over

    # The cosine, parametrized by the speed.

    def squares(self):
        """(a, b, q) of (A R)^2 = a + 2 b v + q v^2."""
        w0, w1 = self.response()
        w0, w1 = w0 * [1.0, 1.0 / self.omega], w1 * [1.0, 1.0 / self.omega]
        return w0 @ w0, w0 @ w1, w1 @ w1

    def amplitude_at(self, speed):
        a, b, q = self.squares()
        return math.sqrt(a + 2.0 * b * speed + q * speed**2) / self.gain

    def speeds(self, amplitude):
        """Impact speeds of the two orbits, ascending; empty if there is none."""
        a, b, q = self.squares()
        under = b * b - q * (a - (amplitude * self.gain) ** 2)
        return [] if under < 0.0 else [(-b + sign * math.sqrt(under)) / q for sign in (-1.0, 1.0)]

    def orbit(self, speed):
        amplitude = self.amplitude_at(speed)
        w0, w1 = self.response()
        x, v = (w0 + speed * w1) / (amplitude * self.gain)
        lag = math.atan2(self.c * self.omega, self.k - self.omega**2)
        t0 = ((math.atan2(-v / self.omega, x) + lag) / self.omega) % self.period
        return Orbit(amplitude, t0, speed, self.monodromy(amplitude, t0, speed))

    def fold_speed(self):
        _, b, q = self.squares()
        return -b / q

    def fold(self):
        """The amplitude of the fold."""
        return self.amplitude_at(self.fold_speed())

    def doubling_speed(self):
        # 1 + tr + det = 0, and the force at the impact is linear in v by the two w.
        w0, w1 = self.response()
        p = self.over
        force = np.array([self.k - self.omega**2, self.c])
        slope = (1.0 + self.e) * (force @ w1)
        offset = (1.0 + self.e) * (force @ w0 - self.k * self.d)
        constant = 1.0 - self.e * np.trace(p) + self.e**2 * np.linalg.det(p) + p[0, 1] * slope
        return -p[0, 1] * offset / constant

    def doubling(self):
        """The amplitude of the period doubling."""
        return self.amplitude_at(self.doubling_speed())

    # Any wave, parametrized by the time of impact.

    def orbit_at(self, t0):
        w0, w1 = self.response()
        amplitude, speed = np.linalg.solve(np.stack([self.steady(t0), -w1], axis=1), w0)
        return Orbit(amplitude, t0, speed, self.monodromy(amplitude, t0, speed))

    def doubling_time(self, low, high):
        def test(t0):
            return np.linalg.det(self.orbit_at(t0).monodromy + np.eye(2))

        return brentq(test, low, high, xtol=1e-15, rtol=1e-15)

    def fold_time(self, low, high):
        def test(t0):
            return np.linalg.det(self.orbit_at(t0).monodromy - np.eye(2))

        return brentq(test, low, high, xtol=1e-15, rtol=1e-15)
