"""Orbits of the linear impact oscillator (COCO's demo `impact`) in closed form."""

import math

import numpy as np
import pytest

from mems_impact.orbits.orbit_search import find_periodic_orbit
from tests.orbits.audit import check_closed
from tests.orbits.exact import Exact
from tests.orbits.families import at, oscillator

# The oscillator and the impact speed; stable and unstable orbits, one impact in n periods.
COSINE = {
    "stable": (Exact(omega=1.3), 1.5),
    "unstable": (Exact(omega=1.3), 0.4),
    "saddle past its period doubling": (Exact(omega=0.8), 0.3),
    "every second period": (Exact(omega=2.8, n=2), 1.7),
    "every third period": (Exact(omega=3.5, n=3), 0.6),
    "other damping, stiffness, stop, restitution": (
        Exact(omega=1.6, c=0.2, k=1.4, d=0.3, e=0.6),
        0.9,
    ),
}
# The oscillator and the time of impact.
SQUARE = {
    "before the switch": (Exact(omega=0.6, square=1.0), 1.80),
    "after the switch": (Exact(omega=1.8, square=1.0), 1.77),
    "saddle": (Exact(omega=2.4, square=1.0), 1.92),
}


def family(exact, amplitude):
    names = ("omega", "c", "k", "d", "e", "square")
    values = {name: getattr(exact, name) for name in names}
    return oscillator(amplitude=float(amplitude), **values)


def orbit_of(exact, expected):
    guess = at((exact.d, -exact.e * expected.speed), time=expected.time)
    return find_periodic_orbit(family(exact, expected.amplitude), guess, periods=exact.n)


def check(exact, expected):
    orbit = orbit_of(exact, expected)
    assert orbit.admissible
    assert orbit.periods == exact.n
    ((guard, time, before),) = orbit.impacts
    assert guard == 0
    assert time % exact.period == pytest.approx(expected.time, abs=1e-9)
    assert before[1] == pytest.approx(expected.speed, abs=1e-9, rel=1e-9)
    scale = max(1.0, float(np.abs(expected.multipliers).max()))
    np.testing.assert_allclose(orbit.multipliers, expected.multipliers, atol=3e-9 * scale)
    product = exact.e**2 * math.exp(-exact.c * exact.n * exact.period)
    assert np.prod(orbit.multipliers).real == pytest.approx(product, abs=1e-9 * scale)
    assert orbit.stable == bool(np.all(np.abs(expected.multipliers) < 1.0))
    assert orbit.residual < 1e-9
    assert check_closed(orbit) < 3e-9 * scale


@pytest.mark.parametrize("name", COSINE)
def test_orbit_under_a_cosine(name):
    exact, speed = COSINE[name]
    check(exact, exact.orbit(speed))


@pytest.mark.parametrize("name", SQUARE)
def test_orbit_under_a_square_wave(name):
    exact, time = SQUARE[name]
    check(exact, exact.orbit_at(time))


def test_closed_form_closes():
    """The closed form itself: from impact to impact, multipliers at fold and period doubling."""
    exact = Exact(omega=1.3)
    orbit = exact.orbit(1.5)
    steady = orbit.amplitude * exact.steady(orbit.time)
    after = np.array([exact.d, -exact.e * orbit.speed])
    np.testing.assert_allclose(
        exact.over @ (after - steady) + steady, [exact.d, orbit.speed], atol=1e-13
    )
    fold = exact.orbit(exact.fold_speed())
    assert fold.multipliers[0] == pytest.approx(1.0, abs=1e-12)
    doubling = Exact(omega=0.8)
    flip = doubling.orbit(doubling.doubling_speed())
    assert flip.multipliers[0] == pytest.approx(-1.0, abs=1e-12)


def test_derivative_by_the_frequency_of_a_square_wave():
    exact = Exact(omega=2.4, square=1.0)
    expected = exact.orbit_at(1.92)
    guess = at((exact.d, -exact.e * expected.speed), time=expected.time)
    start = family(exact, expected.amplitude)
    orbit = find_periodic_orbit(start, guess, active=("omega",))
    point = orbit.point
    derivative = -np.linalg.solve(point.jacobian, point.by_parameter)[:, 0]

    def unknowns(omega):
        return find_periodic_orbit(start.at(omega=omega), orbit.instant).point.unknowns

    h = 1e-5
    difference = (unknowns(2.4 + h) - unknowns(2.4 - h)) / (2.0 * h)
    np.testing.assert_allclose(derivative, difference, atol=1e-4)
