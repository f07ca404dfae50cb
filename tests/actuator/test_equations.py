"""The scalar functions of Equations (1) to (6)."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mems_impact.actuator import equations as eq
from mems_impact.actuator import impact_law
from tests.actuator.machine import ZHAO, parameters

P = parameters()
positions = st.floats(-0.5, 0.5)
speeds = st.floats(-2.0, 2.0)
volts = st.floats(-0.5, 0.5)
directions = st.sampled_from([-1, 0, 1])


@given(positions, speeds, volts, directions)
def test_the_equations_of_motion_are_those_of_the_paper(x2, v2, v, direction):
    """Equation (2) holds, and the two bodies feel ground friction alone: momentum."""
    load = eq.load(x2, v2, eq.attraction(x2, v, P), P)
    a1 = eq.frame_acceleration(direction, load, P)
    a2 = eq.block_acceleration(direction, load, P)
    force = ZHAO.alpha * v**2 / (ZHAO.d - x2) ** 2
    assert ZHAO.m2 * (a1 + a2) + ZHAO.c * v2 + ZHAO.k * x2 == pytest.approx(force, abs=1e-12)
    if direction:
        friction = direction * ZHAO.mu_d * (ZHAO.m1 + ZHAO.m2) * ZHAO.g
        momentum_rate = ZHAO.m1 * a1 + ZHAO.m2 * (a1 + a2)
        assert momentum_rate == pytest.approx(-friction, rel=1e-13)
    else:
        assert a1 == 0.0


@given(speeds, speeds, st.floats(0.0, 1.0))
def test_impacts_keep_momentum_and_restitution(v1, v2, e):
    after1, after2 = impact_law.frame_speed_after(v1, v2, e, P), impact_law.block_speed_after(v2, e)
    before = ZHAO.m1 * v1 + ZHAO.m2 * (v1 + v2)
    assert ZHAO.m1 * after1 + ZHAO.m2 * (after1 + after2) == pytest.approx(before, abs=1e-12)
    assert after2 == -e * v2
    energy = [
        0.5 * ZHAO.m1 * a**2 + 0.5 * ZHAO.m2 * (a + b) ** 2 for a, b in ((v1, v2), (after1, after2))
    ]
    reduced = ZHAO.m1 * ZHAO.m2 / (ZHAO.m1 + ZHAO.m2)
    assert energy[0] - energy[1] == pytest.approx(0.5 * reduced * (1 - e**2) * v2**2, abs=1e-12)


@given(volts, directions, st.sampled_from([1, -1]))
def test_contact_force_holds_the_block_on_the_stopper(v, direction, side):
    """With the force on both bodies they share one acceleration."""
    x2 = side * ZHAO.delta
    pressing = side * eq.contact_force(
        side, direction, eq.attraction(x2, v, P), P
    )  # on the frame, along the axis
    load = eq.load(x2, 0.0, eq.attraction(x2, v, P), P)
    friction = direction * ZHAO.mu_d * (ZHAO.m1 + ZHAO.m2) * ZHAO.g
    frame = (load + pressing - friction) / ZHAO.m1 if direction else 0.0
    block = (-load - pressing) / ZHAO.m2
    shared = eq.resting_acceleration(direction, P)
    assert block == pytest.approx(shared, abs=1e-11)
    if direction:
        assert frame == pytest.approx(shared, abs=1e-11)


def test_the_force_is_frozen_between_stopper_and_electrode():
    halfway = 0.5 * (ZHAO.delta + ZHAO.d)
    values = [eq.attraction(x, 0.3, P) for x in (halfway, 0.9, 1.0, 5.0)]
    assert np.ptp(values) == 0.0
    assert math.isfinite(values[0])
    x = np.nextafter(ZHAO.delta, 1.0)
    assert eq.electrode_gap(x, P) == ZHAO.d - x
