"""Margins that reach zero and come back unseen within one step of a flow that is a polynomial."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.event_loop import workspace
from tests.hybrid.systems import ENGINES, STOP, simulate, stop, times

# A free flight over two corrugated floors, the second one shifted; it stops where it strikes.
# y = x, height, speeds; p = (amplitude, wave number, phases of the two floors).


def _stuck(mode, code, t, y, p):
    return 1


# A floor of two wavelengths, through air: a margin may swing several times within a step, and look
# at both ends as if it did not; p = (amplitude, wave number, drag).


def _braked_flight(mode, t, y, p, dy):
    flies = 1.0 if mode == 0 else 0.0
    dy[0], dy[1] = flies * y[2], flies * y[3]
    dy[2], dy[3] = -flies * p[2] * y[2], -flies * (1.0 + p[2] * y[3])


def _two_waves(mode, t, y, p, g, r):
    if mode == 0:
        one, other = p[1] * y[0], 1.7 * p[1] * y[0] + 1.0
        g[0] = y[1] - p[0] * (math.sin(one) + 0.5 * math.sin(other))
        r[0] = y[3] - p[0] * p[1] * y[2] * (math.cos(one) + 0.85 * math.cos(other))


BRAKED = Automaton(
    states=("x", "y", "u", "v"),
    modes=("flies", "stands"),
    guards=(Guard(name="floor", order=0),),
    flow=_braked_flight,
    margins=_two_waves,
    transition=_stuck,
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wave", "method", "found"),
    [((0.02, 60.0, 0.1), "dop853", (93,)), ((0.05, 20.0, 0.1), "adams", (87, 176))],
)
def test_a_floor_of_two_wavelengths(wave, method, found):
    """The flights that an attack found, and some more: of 250 that are drawn."""
    amplitude, k, drag = wave
    period = 1.0 if method == "dop853" else 100.0
    rng = np.random.default_rng(11)
    for number in range(250):
        x, y = rng.uniform(0, 1), 1 + rng.uniform(0, 1)
        u, v = rng.uniform(1, 3), rng.uniform(-0.5, 0.5)
        if number not in found and number % 10:
            continue

        def height(t, x=x, y=y, u=u, v=v):
            slowed = (1.0 - np.exp(-drag * t)) / drag
            phase = k * (x + u * slowed)
            floor = amplitude * (np.sin(phase) + 0.5 * np.sin(1.7 * phase + 1.0))
            return y + (v + 1.0 / drag) * slowed - t / drag - floor

        t = np.linspace(1e-9, 4.0, 100_001)
        below = int(np.argmax(height(t) < 0.0))
        when = brentq(height, t[below - 1], t[below], xtol=1e-14)
        done = simulate(BRAKED, wave, [x, y, u, v], 4.0 / period, period=period, method=method,
                        rtol=1e-9, atol=1e-11)  # fmt: skip
        (strike,) = times(done, workspace.TRANSITION)
        assert strike == pytest.approx(when, abs=1e-6), number


# A thin obstacle on the way: the margin dips twice below zero, by `depth`, within 1/50 of the way.


def _drift(mode, t, y, p, dy):
    dy[0] = 1.0


def _two_dips(mode, t, y, p, g, r):
    if mode == 0:
        s = (y[0] - 0.5) / p[0]
        shape = (s * s - 1.0) * (s * s - 1.0)
        g[0] = shape - p[1]
        r[0] = 4.0 * s * (s * s - 1.0) / p[0]


DIPS = Automaton(
    states=("x",),
    modes=("goes", "stands"),
    guards=(Guard(name="obstacle", order=0),),
    flow=_drift,
    margins=_two_dips,
    transition=_stuck,
)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("depth", [1e-2, 1e-4, 1e-6])
@pytest.mark.parametrize("width", [0.3, 0.1, 0.03, 0.01])
def test_two_dips_within_a_step(width, depth, engine):
    done = simulate(DIPS, (width, depth), [0.0], 1.0, period=1.0, engine=engine)
    expected = 0.5 - width * math.sqrt(1.0 + math.sqrt(depth))
    assert done.events.time.tolist() == pytest.approx([expected], abs=1e-9)


# Two such obstacles, one behind the other's front: both are struck unseen within one step.


def _two_obstacles(mode, t, y, p, g, r):
    if mode == 0:
        for i in range(2):
            s = (y[0] - p[2 + i]) / p[0]
            g[i] = (s * s - 1.0) * (s * s - 1.0) - p[1]
            r[i] = 4.0 * s * (s * s - 1.0) / p[0]


def _struck(mode, code, t, y, p):
    return 1 + code


OBSTACLES = Automaton(
    states=("x",),
    modes=("goes", "stands at one", "stands at the other"),
    guards=(Guard(name="one", order=1), Guard(name="other", order=0)),
    flow=_drift,
    margins=_two_obstacles,
    transition=_struck,
)


@pytest.mark.quick(1)
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("ahead", [1e-3, -1e-3, 1e-6, -1e-6])
def test_the_first_of_two_obstacles_within_a_step_is_struck(ahead, engine):
    """Whichever of the guards, first or second in the list, first or second by order."""
    width, depth = 0.01, 1e-2
    for place in np.linspace(0.4, 0.6, 41 if engine == "compiled" else 3):
        p = (width, depth, place, place + ahead)
        done = simulate(OBSTACLES, p, [0.0], 1.0, period=1.0, engine=engine)
        expected = min(place, place + ahead) - width * math.sqrt(1.0 + math.sqrt(depth))
        assert done.events.time.tolist() == pytest.approx([expected], abs=1e-9)
        assert done.final.mode == (1 if ahead > 0.0 else 2)


# A ribbed obstacle, narrower than a step: p = (place, width, ribs, clearance, phase).


def _ribs(mode, t, y, p, g, r):
    if mode == 0:
        s = (y[0] - p[0]) / p[1]
        bump = math.exp(-s * s)
        angle = p[2] * s + p[4]
        g[0] = p[3] - bump * math.cos(angle)
        r[0] = bump * (2.0 * s * math.cos(angle) + p[2] * math.sin(angle)) / p[1]


RIBS = Automaton(
    states=("x",),
    modes=("goes", "stands"),
    guards=(Guard(name="ribs", order=0),),
    flow=_drift,
    margins=_ribs,
    transition=_stuck,
)


@pytest.mark.parametrize("method", ["adams", "dop853"])
@pytest.mark.parametrize(
    "p",
    [
        (0.4105, 0.0243, 7.2432, 0.8125, 2.874),
        (0.414, 0.030, 3.241, 0.777, 5.932),
        (0.512, 0.026, 3.097, 0.804, 0.064),
        (0.512, 0.047, 6.518, 0.662, 5.710),
        (0.537, 0.056, 7.836, 0.817, 5.975),
    ],
)
def test_ribs_that_values_and_rates_at_the_ends_of_a_step_hide(p, method):
    """What the rates have been seen to change by tells that more may lie in between."""
    x = np.linspace(0.0, 1.0, 10_001)
    for aside in (-1e-3, 0.0, 1e-3):
        ribs = (p[0] + aside, *p[1:])
        g, r = [0.0], [0.0]

        def height(x, ribs=ribs, g=g, r=r):
            _ribs(0, 0.0, [x], ribs, g, r)
            return g[0]

        below = next(i for i in range(x.size) if height(x[i]) < 0.0)
        expected = brentq(height, x[below - 1], x[below], xtol=1e-14)
        done = simulate(RIBS, ribs, [0.0], 1.0, period=1.0, method=method, engine="interpreted")
        assert done.events.time.tolist() == pytest.approx([expected], abs=1e-9)


@pytest.mark.parametrize("method", ["adams", "dop853"])
def test_steps_are_looked_into_only_where_a_margin_may_reach_zero(method):
    """A wall that is never struck costs hardly more than a margin that is constant."""

    def looks(wall, moves=True):
        count = 0

        def counting(mode, t, y, p, g, r):
            nonlocal count
            count += 1
            STOP.margins(mode, t, y if moves else np.zeros(2), p, g, r)

        watched = replace(STOP, margins=counting)
        simulate(watched, stop(d=wall), [0.0, 1.0], 3.0, method=method, engine="interpreted")
        return count

    still = looks(3.0, moves=False)
    assert looks(3.0) < 1.3 * still
    assert looks(1e6) < 1.3 * still
