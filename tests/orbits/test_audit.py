"""Monodromy matrices against differences of the simulated map, and against the normal form."""

import math

import numpy as np
import pytest

from mems_impact.continuation.orbit_branch import follow
from mems_impact.orbits.orbit_search import find_periodic_orbit
from tests.continuation.free_block import flow, over_period
from tests.orbits.audit import audit
from tests.orbits.families import (
    DEVICE,
    actuator_orbit,
    at,
    silent_orbit,
    table,
    table_in_the_room,
)

pytestmark = pytest.mark.nightly


@pytest.mark.parametrize(
    ("amplitude", "omega"), [(0.24, 0.5), (0.177, 0.485), (0.29, 0.45), (0.384, 0.1), (0.4, 0.05)]
)
def test_monodromy_agrees_with_simulation(amplitude, omega):
    result = audit(actuator_orbit(amplitude, omega))
    assert result.worst < 1e-7
    np.testing.assert_allclose(result.computed, result.simulated, atol=1e-6)


def test_monodromy_of_orbits_without_impacts_agrees_with_simulation():
    assert audit(silent_orbit(0.16, 0.5)).worst < 1e-8


@pytest.fixture(scope="module")
def towards_grazing():
    """The orbits with an impact at omega = 0.5, from f = 0.24 through the fold to the grazing."""
    branch = follow(actuator_orbit(0.24, 0.5), "amplitude", low=0.17, high=0.25, direction=-1)
    return [p.solution for p in branch.points if p.solution.impacts and p.solution.admissible]


def speed(orbit):
    return float(orbit.impacts[0][2][3])


def test_multipliers_agree_with_simulation_down_to_slow_impacts(towards_grazing):
    chosen = [orbit for orbit in towards_grazing if speed(orbit) > 1e-2]
    assert min(speed(orbit) for orbit in chosen) < 1.5e-2
    for orbit in chosen[::4] + chosen[-1:]:
        result = audit(orbit)
        assert result.worst < 1e-6
        differences = np.linalg.eigvals(result.simulated)
        differences = differences[np.argsort(-np.abs(differences))]
        scale = np.abs(differences[0])
        np.testing.assert_allclose(orbit.multipliers / scale, differences / scale, atol=1e-6)


def test_trace_grows_as_one_over_the_impact_speed():
    """The factor of the grazing normal form: (1 + e_eff) a M_12, M and a without impact."""
    branch = follow(silent_orbit(0.2, 0.5), "amplitude", low=0.19, high=0.23)
    grazing = next(s for s in branch.special_points if s.kind == "grazing").solution
    slow = [p.solution for p in branch.points if p.solution.impacts and speed(p.solution) < 5e-3]
    speeds = np.array([speed(orbit) for orbit in slow])
    products = speeds * [np.trace(orbit.reduced_monodromy()) for orbit in slow]
    assert 0.0 < speeds.min() < 2e-4

    t, touch = grazing_instant(grazing)
    amplitude = grazing.family.values["amplitude"]
    _, monodromy = over_period(touch, t, amplitude, 0.5)
    acceleration = flow(t, np.array([*touch, 1, 0, 0, 1]), amplitude, 0.5)[1]
    rebound = DEVICE.e - (1.0 + DEVICE.e) * DEVICE.m2 / (DEVICE.m1 + DEVICE.m2)
    expected = (1.0 + rebound) * acceleration * monodromy[0, 1]
    fit = np.polynomial.Polynomial.fit(speeds, products, 3)
    assert fit(0.0) == pytest.approx(expected, rel=1e-6)
    assert products[np.argmin(speeds)] == pytest.approx(expected, rel=1e-2)


def grazing_instant(orbit):
    shooting, point = orbit.shooting, orbit.point
    time = float(point.arcs[0].minima_time[0])
    return time, shooting.variational(point.parameter_point).arc(0, orbit.state, 0.0, time).end[2:]


def test_chatter_and_rest_forget_the_state():
    orbit = find_periodic_orbit(table(amplitude=1.5), at((0.0, 0.0), mode=1), transient=50)
    result = audit(orbit)
    assert result.worst < 1e-12
    assert np.abs(orbit.multipliers).max() < 1e-12


def test_an_impact_whose_outcome_depends_on_its_instant():
    """One impact a period at which the table moves at pi (1 - e)/(1 + e) upwards."""
    speed = math.pi * 0.5 / 1.5
    time = -math.asin(speed / 1.2)
    fall = np.array([1.2 * math.cos(time) - math.pi * time - time**2 / 2.0, math.pi + time])
    orbit = find_periodic_orbit(table_in_the_room(), at(fall))
    np.testing.assert_allclose(orbit.state, fall, atol=1e-10)
    result = audit(orbit)
    assert result.worst < 1e-8
    assert np.linalg.det(result.computed) == pytest.approx(0.25, abs=1e-9)  # e squared
