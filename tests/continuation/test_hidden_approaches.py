"""Closest approaches that come and go within one integration step, on branches."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq, minimize_scalar

import mems_impact as mi

WAVE, PHASE, DAMPING, STIFFNESS, GAP, RIPPLE = 23.0, 0.7, 0.2, 1.3, 1.0, 0.05


def _steady(amplitude):
    """Return the least gap of the oscillator that does not strike the wall, in closed form."""
    reply = amplitude / (STIFFNESS - 1.0 + 1j * DAMPING)
    size, angle = abs(reply), float(np.angle(reply))

    def gap(t):
        return GAP - size * np.cos(t + angle) - RIPPLE * np.cos(WAVE * t + PHASE)

    times = np.linspace(0.0, 2.0 * math.pi, 20_001)
    nearest = times[int(np.argmin(gap(times)))]
    found = minimize_scalar(
        gap, bounds=(nearest - 1e-3, nearest + 1e-3), method="bounded", options={"xatol": 1e-13}
    )
    return float(found.fun)


def _swing(mode, t, y, p):
    push = p.amplitude * math.cos(p.rate * t)
    return y.v, push - STIFFNESS * p.rate**2 * y.x - DAMPING * p.rate * y.v


def _gap(mode, t, y, p):
    return p.unit * (GAP - RIPPLE * math.cos(WAVE * p.rate * t + PHASE)) - y.x


def _strike(mode, t, y, p):
    wall = p.unit * RIPPLE * WAVE * p.rate * math.sin(WAVE * p.rate * t + PHASE)
    return mode, (y.x, wall - 0.5 * (y.v - wall))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "unit", "rate"),
    [
        ("adams", 1.0, 1.0),
        ("dop853", 1.0, 1.0),
        ("dop853", 1e-6, 1e3),
    ],
    ids=str,
)
def test_grazing_of_a_wall_that_moves_faster_than_the_steps(method, unit, rate):
    """The oscillator is slow, so that steps are longer than the waves of the wall."""
    scale = unit * rate**2
    system = mi.System(
        states=("x", "v"),
        flow=_swing,
        parameters={"amplitude": 0.25 * scale, "unit": unit, "rate": rate},
        period=2.0 * math.pi / rate,
        guards=[mi.Impact("wall", _gap, _strike)],
        typical={"x": unit, "v": unit * rate, "amplitude": scale, "unit": unit, "rate": rate},
    )
    orbit = mi.find_orbit(system, transient=40, options=mi.Options(method=method))
    steps = mi.StepControl(max_points=60)
    branch = mi.continue_solution(orbit, "amplitude", stop=0.5 * scale, steps=steps)
    expected = brentq(_steady, 0.1, 1.0, xtol=1e-13)
    first = branch.special_points[0]
    assert first.kind == "grazing"
    assert first.value / scale == pytest.approx(expected, abs=1e-8)
    free = branch.table[branch.table["impacts"] == 0]
    assert free["admissible"].all()
    assert min(_steady(value / scale) for value in free["amplitude"]) > -1e-8
