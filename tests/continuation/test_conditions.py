"""Derivatives of test functions, against differences of the test functions."""

import numpy as np
import pytest

from mems_impact.continuation.test_functions import (
    ClosestApproachTest,
    DefiningSystem,
    FoldTest,
    SegmentLengthTest,
    orbit_tests,
)
from mems_impact.orbits.orbit_search import find_periodic_orbit
from mems_impact.orbits.shooting import Shooting
from tests.hybrid.systems import at
from tests.orbits.families import actuator_orbit, oscillator, silent_orbit


def _penetrating():
    """Under a square wave, whose switches move with omega; the arc starts at one."""
    family = oscillator(square=1.0, amplitude=0.2, omega=0.8, d=0.9)
    return find_periodic_orbit(family, at((0.0, 0.0)), transient=100)


ORBITS = {
    "free": lambda: silent_orbit(0.15, 0.5),
    "impacts": lambda: actuator_orbit(0.24, 0.5),
    "square wave": _penetrating,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ORBITS)
def test_gradients_of_guards_and_lengths(name):
    orbit = ORBITS[name]()
    active = ("amplitude", "omega")
    shooting = Shooting(orbit.family, orbit.segments, active, orbit.shooting.pinned)
    values = np.array([orbit.family.values[each] for each in active])
    point = shooting.evaluate(orbit.point.unknowns, values)
    looked = [each for each in orbit_tests(shooting, point, np.zeros(1)) if each.ends_orbits]
    assert {type(each) for each in looked} >= {ClosestApproachTest, SegmentLengthTest}
    for monitor in looked:
        condition = monitor.equation(shooting)
        differences = DefiningSystem.gradient(condition, point)
        scale = max(1.0, float(np.abs(differences).max()))
        np.testing.assert_allclose(
            condition.gradient(point), differences, atol=2e-5 * scale, err_msg=str(monitor)
        )


@pytest.mark.slow
def test_gradient_of_a_fold():
    """At any orbit: what is zero at a fold is smooth on the way there."""
    orbit = silent_orbit(0.15, 0.47)
    active = ("amplitude", "omega")
    shooting = Shooting(orbit.family, orbit.segments, active, orbit.shooting.pinned)
    point = shooting.evaluate(orbit.point.unknowns, np.array([0.15, 0.47]))
    condition = FoldTest().equation(shooting)
    derived = condition.gradient(point)
    differences = DefiningSystem.gradient(condition, point)
    scale = float(np.abs(differences).max())
    np.testing.assert_allclose(derived, differences, atol=1e-4 * scale)
