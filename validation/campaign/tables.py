"""A ball on a table that moves as A sin(w t), its position in the laboratory.

Reference: every flight is a parabola against a sine, in a form that keeps its digits however short
the flight is; impacts by bracketing and Brent's method, rest and release in closed form.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import brentq

from mems_impact import Options
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.state import HybridState
from validation.campaign import comparing
from validation.campaign.comparing import ONE, Row, Unit, Verdict

FLYING, RESTING = 0, 1
TABLE, RELEASE = 0, 1
PERIODS = 12.0


# The automaton; p = (g, e, A, w).


def _lift(t, p):  # type: ignore[no-untyped-def]
    return p[2] * math.sin(p[3] * t)


def _speed(t, p):  # type: ignore[no-untyped-def]
    return p[2] * p[3] * math.cos(p[3] * t)


def _pressure(t, p):  # type: ignore[no-untyped-def]
    return p[0] - p[2] * p[3] * p[3] * math.sin(p[3] * t)


def _flow(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
    if mode == FLYING:
        dy[0] = y[1]
        dy[1] = -p[0]
    else:
        dy[0] = _speed(t, p)
        dy[1] = -p[2] * p[3] * p[3] * math.sin(p[3] * t)


def _margins(mode, t, y, p, g, r):  # type: ignore[no-untyped-def]
    if mode == FLYING:
        g[0] = y[0] - _lift(t, p)
        r[0] = y[1] - _speed(t, p)
    else:
        g[1] = _pressure(t, p)
        r[1] = -p[2] * p[3] ** 3 * math.cos(p[3] * t)


def _transition(mode, code, t, y, p):  # type: ignore[no-untyped-def]
    v = _speed(t, p)
    y[0] = _lift(t, p)
    if code == TABLE:
        y[1] = v - p[1] * (y[1] - v)
        return FLYING
    y[1] = v
    # Accumulated (code 2): it rests if it is pressed. Or it is let go.
    return RESTING if code == 2 and _pressure(t, p) > 0.0 else FLYING


AUTOMATON = Automaton(
    states=("y", "v"),
    modes=("flying", "resting"),
    guards=(Guard(name="table", order=0, impact=True), Guard(name="release", order=1)),
    flow=_flow,
    margins=_margins,
    transition=_transition,
)


class Ball:
    """The reference, in units of order one."""

    def __init__(self, g: float, e: float, amplitude: float, w: float) -> None:
        self.g, self.e, self.amplitude, self.w = g, e, amplitude, w

    def on_table(self, t: float, relative: float = 0.0) -> np.ndarray:
        turn = self.w * t
        speed = self.amplitude * self.w * math.cos(turn)
        return np.array([self.amplitude * math.sin(turn), speed + relative])

    def pressure(self, t: float) -> float:
        return self.g - self.amplitude * self.w**2 * math.sin(self.w * t)

    def flight(self, t: float, h: float, u: float, longest: float) -> tuple[float, float]:
        """Return how long a flight from the height `h` at the speed `u` lasts, and the last speed.

        Both are relative to the table. The differences of sines are written out, so that nothing
        cancels where the flight is short. No impact within `longest` is an infinite flight.
        """
        sine, cosine = math.sin(self.w * t), math.cos(self.w * t)
        a, w, g = self.amplitude, self.w, self.g

        def lag(x):  # type: ignore[no-untyped-def]
            """Return x - sin x; the series where it cancels."""
            series = x**3 / 6.0 * (1.0 - x * x / 20.0 * (1.0 - x * x / 42.0 * (1.0 - x * x / 72.0)))
            return np.where(np.abs(x) < 0.3, series, x - np.sin(x))

        def height(s):  # type: ignore[no-untyped-def]
            rise = 2.0 * sine * np.sin(0.5 * w * s) ** 2 + cosine * lag(w * s)
            return h + u * s - 0.5 * g * s * s + a * rise

        def speed(s):  # type: ignore[no-untyped-def]
            rise = sine * np.sin(w * s) + cosine * 2.0 * np.sin(0.5 * w * s) ** 2
            return u - g * s + a * w * rise

        step = 2.0 * math.pi / w / 400.0
        begin, grid = 0.0, np.geomspace(1e-8 * step, step, 400)
        while begin < longest:
            heights, speeds = height(grid), speed(grid)
            inside = 0.0 if begin == 0.0 else begin
            for i in range(grid.size):
                outside = grid[i]
                if heights[i] > 0.0 and i > 0 and speeds[i - 1] < 0.0 < speeds[i]:
                    outside = brentq(speed, grid[i - 1], grid[i], xtol=1e-16, rtol=1e-15)
                if height(outside) < 0.0:
                    if inside == 0.0:
                        inside = 0.5e-8 * step
                    s = brentq(height, inside, outside, xtol=1e-300, rtol=1e-15)
                    return float(s), float(speed(s))
                inside = grid[i]
            begin = float(grid[-1])
            grid = begin + step * np.arange(1, 401)
        return math.inf, 0.0

    def follow(self, h: float, u: float, end: float) -> tuple[list[Row], float]:
        """Return all events up to `end`, from a height and a speed above the table at t = 0."""
        rows: list[Row] = []
        t = 0.0
        while True:
            duration, speed = self.flight(t, h, u, end - t)
            if t + duration >= end:
                return rows, end
            t, h, u = t + duration, 0.0, -self.e * speed
            pressure = self.pressure(t)
            if self.e > 0.0:
                rows.append(Row(t, TABLE, FLYING, self.on_table(t, u), fall=-speed))
                if pressure <= 0.0 or 2.0 * u > 1e-6 * pressure:
                    continue
            if abs(pressure) < 1e-2 * self.g:
                return rows, t  # whether it rests or flies on, rounding decides
            if pressure < 0.0:  # thrown up by the table at once
                rows.append(Row(t, TABLE, FLYING, self.on_table(t), fall=-speed, rest=True))
                continue
            t += 2.0 * u / pressure / (1.0 - self.e)
            # The package, which has no closed form, measures impacts down to some 1e-5.
            weakest = 1e-5 * (1.0 - self.e) if self.e > 0.0 else -speed
            rows.append(Row(t, TABLE, RESTING, self.on_table(t), fall=weakest, rest=True))
            excess = self.amplitude * self.w**2 / self.g
            if excess <= 1.0:
                return rows, end
            turn, released = self.w * t, math.asin(1.0 / excess)
            released += 2.0 * math.pi * math.ceil((turn - released) / (2.0 * math.pi))
            t, u = released / self.w, 0.0
            if t >= end:
                return rows, end
            rows.append(Row(t, RELEASE, FLYING, self.on_table(t)))


def check(seed: int, number: int, unit: Unit = ONE) -> Verdict:
    """Try one table."""
    rng = np.random.default_rng([seed, 1, number])
    w, excess = rng.uniform(0.5, 3.0), rng.uniform(0.6, 3.0)
    e = 0.0 if number % 4 == 0 else rng.uniform(0.05, 0.9)
    amplitude = excess / w**2
    ball = Ball(1.0, e, amplitude, w)
    height, up = rng.uniform(0.05, 1.0), rng.uniform(-0.3, 0.5)
    period = 2.0 * math.pi / w
    end = PERIODS * period
    found = comparing.truth(lambda shift: ball.follow(height + shift, up + 0.7 * shift, end), end)
    problem = Problem(
        automaton=AUTOMATON,
        parameters=[unit.acceleration, e, amplitude * unit.length, w / unit.time],
        period=period * unit.time,
        options=Options(**unit.options),
    )
    start = HybridState(0, 0.0, FLYING, ball.on_table(0.0, up) + np.array([height, 0.0]))
    scale = np.array([unit.length, unit.speed])
    mine = comparing.answer(problem, start, found.quiet, scale, unit.time)
    return Verdict("tables", number, len(found.rows), found.share, comparing.compare(found, mine))
