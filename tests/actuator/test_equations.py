"""The impact law, and the force beyond the stopper."""

import math

import numpy as np
import pytest

from mems_impact.actuator import equations as eq
from mems_impact.actuator import impact_law
from tests.actuator.machine import ZHAO, parameters

P = parameters()


@pytest.mark.parametrize("e", [0.0, 0.35, 1.0])
@pytest.mark.parametrize(("v1", "v2"), [(0.0, 1.3), (-0.7, 0.9), (1.2, -0.4)])
def test_impacts_keep_momentum_and_restitution(v1, v2, e):
    after1, after2 = impact_law.frame_speed_after(v1, v2, e, P), impact_law.block_speed_after(v2, e)
    before = ZHAO.m1 * v1 + ZHAO.m2 * (v1 + v2)
    assert ZHAO.m1 * after1 + ZHAO.m2 * (after1 + after2) == pytest.approx(before, abs=1e-12)
    assert after2 == -e * v2
    loss = impact_law.impact_loss(ZHAO.m1, ZHAO.m2, v2, after2)
    moving = [
        0.5 * ZHAO.m1 * a**2 + 0.5 * ZHAO.m2 * (a + b) ** 2 for a, b in ((v1, v2), (after1, after2))
    ]
    assert loss == pytest.approx(moving[0] - moving[1], abs=1e-12)


def test_the_force_is_frozen_between_stopper_and_electrode():
    halfway = 0.5 * (ZHAO.delta + ZHAO.d)
    values = [eq.attraction(x, 0.3, P) for x in (halfway, 0.9, 1.0, 5.0)]
    assert np.ptp(values) == 0.0
    assert math.isfinite(values[0])
    assert eq.electrode_gap(math.nextafter(ZHAO.delta, 1.0), P) < ZHAO.d - ZHAO.delta
