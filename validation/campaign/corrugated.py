"""Free flight over a corrugated floor, y = A sin(k x), counted in periods that mean nothing.

Reference: the height over the floor on a dense grid, its minima between the points of the grid, and
Brent's method.
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
from validation.campaign.comparing import ONE, Unit, Verdict

FLIGHT, STOPPED = 0, 1
PERIODS = (0.1, 1.0, 100.0)
LONGEST = 5.0
GRID = 40_000
TOLERANCES = (1e-12, 1e-9, 1e-6)  # the looser, the longer the steps that may hide an impact
CLOSE = 1e-9  # a floor passed this closely may be touched or not; or within the tolerance


# p = (g, A, k).


def _flow(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
    moves = 1.0 if mode == FLIGHT else 0.0
    dy[0] = moves * y[2]
    dy[1] = moves * y[3]
    dy[2] = 0.0
    dy[3] = -moves * p[0]


def _margins(mode, t, y, p, g, r):  # type: ignore[no-untyped-def]
    if mode == FLIGHT:
        g[0] = y[1] - p[1] * math.sin(p[2] * y[0])
        r[0] = y[3] - p[1] * p[2] * math.cos(p[2] * y[0]) * y[2]


def _transition(mode, code, t, y, p):  # type: ignore[no-untyped-def]
    y[2] = 0.0
    y[3] = 0.0
    return STOPPED


AUTOMATON = Automaton(
    states=("x", "y", "u", "v"),
    modes=("flight", "stopped"),
    guards=(Guard(name="floor", order=0, impact=True),),
    flow=_flow,
    margins=_margins,
    transition=_transition,
)


def first_impact(start: np.ndarray, amplitude: float, k: float) -> tuple[float, float, float]:
    """Return when the flight ends, how fast the height then falls, and how close it came before."""
    x, y, u, v = start

    def height(t):  # type: ignore[no-untyped-def]
        return y + v * t - 0.5 * t * t - amplitude * np.sin(k * (x + u * t))

    def rate(t):  # type: ignore[no-untyped-def]
        return v - t - amplitude * k * u * np.cos(k * (x + u * t))

    grid = np.linspace(0.0, LONGEST, GRID)
    heights, rates = height(grid), rate(grid)
    below = int(np.argmax(heights < 0.0))
    dips = np.flatnonzero((rates[:below] < 0.0) & (rates[1 : below + 1] > 0.0))
    closest = math.inf
    for i in dips[heights[dips] < 0.1 * amplitude]:
        lowest = brentq(rate, grid[i], grid[i + 1], xtol=1e-16, rtol=1e-15)
        closest = min(closest, float(abs(height(lowest))))
        if height(lowest) < 0.0:
            below = i + 1
            grid[below] = lowest
            break
    t = brentq(height, grid[below - 1], grid[below], xtol=1e-16, rtol=1e-15)
    return float(t), float(-rate(t)), closest


def check(seed: int, number: int, unit: Unit = ONE) -> Verdict:
    """Try one flight."""
    rng = np.random.default_rng([seed, 2, number])
    k = 10.0 ** rng.uniform(0.5, 2.0)
    amplitude = rng.uniform(0.2, 2.0) / k
    period, rtol = PERIODS[number % 3], TOLERANCES[number // 3 % 3]
    x, u, v = rng.uniform(0.0, 1.0), rng.uniform(0.5, 3.0), rng.uniform(-0.5, 0.5)
    start = np.array([x, amplitude + rng.uniform(0.05, 2.0), u, v])
    t, fall, closest = first_impact(start, amplitude, k)
    problem = Problem(
        automaton=AUTOMATON,
        parameters=[unit.acceleration, amplitude * unit.length, k / unit.length],
        period=period * unit.time,
        options=Options(**{**unit.options, "rtol": rtol}),
    )
    scale = np.repeat([unit.length, unit.speed], 2)
    mine = comparing.answer(problem, HybridState(0, 0.0, FLIGHT, start), LONGEST, scale, unit.time)
    verdict = Verdict("corrugated", number, 1)
    error = comparing.NOISE / comparing.RTOL * rtol
    allowed = comparing.FLOOR + error / fall
    hit = mine.rows[0].t if mine.rows else math.nan
    if closest < max(CLOSE, error):
        verdict.horizon = 0.0
    elif mine.failed:
        verdict.story = mine.failed
    elif not abs(hit - t) <= allowed:
        where = f"k = {k:.4g}, A = {amplitude:.4g}, period {period:g}, rtol {rtol:g}"
        verdict.story = f"first impact at t = {hit:.12g}, not {t:.12g} ({where})"
    elif len(mine.rows) != 2:
        verdict.story = f"{len(mine.rows) - 1} events, not 1"
    return verdict
