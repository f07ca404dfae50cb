"""The Duffing oscillator's period in closed form, and a static deflection."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.special import ellipk

import mems_impact as mi

SLOW = mi.Options(method="dop853", engine="interpreted", rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize("k3", [3.0, -1.0])
def test_free_oscillation(k3):
    device = mi.load_actuator("zhao2004").replace(c=0.0).adding(mi.CubicStiffness(k3=k3))
    amplitude = 0.4
    # J. J. Stoker, Nonlinear Vibrations (1950), Chapter II: the period by a complete elliptic
    # integral of the first kind.
    stiffness = 1.0 + k3 * amplitude**2
    period = 4.0 * ellipk(0.5 * k3 * amplitude**2 / stiffness) / math.sqrt(stiffness)
    drive = mi.Sine(amplitude=0.0, omega=math.pi / period)
    run = mi.simulate(device, drive, periods=3, initial={"x2": amplitude}, options=SLOW)
    assert math.isclose(run.final["x2"], amplitude, rel_tol=1e-9)
    assert abs(run.final["v2"]) < 1e-8
    half = run.samples(per_period=2)["x2"].to_numpy()
    assert np.allclose(half, amplitude * np.array([1.0, -1.0] * 3 + [1.0]), rtol=1e-8)
