"""Monodromy matrices against differences of the simulated map, and against the normal form."""

import numpy as np
import pytest

from mems_impact.continuation.branch import follow
from mems_impact.errors import OrbitError
from mems_impact.orbits.audit import audit
from mems_impact.orbits.orbit import find_orbit
from tests.orbits.families import (
    actuator,
    actuator_orbit,
    at,
    oscillator,
    silent_orbit,
    table,
)


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
    return [p.orbit for p in branch.points if p.orbit.impacts and p.orbit.admissible]


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


def test_trace_grows_as_one_over_the_impact_speed(towards_grazing):
    """The factor of the grazing normal form: (1 + e_eff) a M_12, M and a without impact."""
    family = actuator(0.2, 0.5)
    branch = follow(silent_orbit(0.2, 0.5), "amplitude", low=0.19, high=0.24, reconnecting=False)
    grazing = next(s for s in branch.special_points if s.kind == "grazing")
    shooting, point = grazing.orbit.shooting, grazing.orbit.point
    shooting.move_to(point.values)
    time = float(point.arcs[0].minima_time[0])
    to_touch = shooting.variational.arc(0, grazing.orbit.state, 0.0, time)
    from_touch = shooting.variational.arc(0, to_touch.end, time, shooting.period)
    based = to_touch.by_state[2:, 1:] @ from_touch.by_state[2:, 1:]
    device = family.problem().parameters
    m1, m2, e = device[0], device[1], family.values["e"]
    share = e - (1.0 + e) * m2 / (m1 + m2)
    expected = (1.0 + share) * to_touch.slope_end[3] * based[0, 1]

    # v trace = expected + O(v): linear extrapolation from Newton at prescribed speeds.
    slow = [o for o in towards_grazing if speed(o) < 2e-2]
    speeds = np.array([speed(o) for o in slow])
    products = speeds * [np.trace(o.reduced_monodromy()) for o in slow]
    fit = np.polynomial.Polynomial.fit(speeds, products, 4)
    assert speeds.min() < 1e-3
    assert fit(0.0) == pytest.approx(expected, rel=1e-6)


def test_chatter_and_rest_forget_the_state():
    orbit = find_orbit(table(amplitude=1.5), at((0.0, 0.0), mode=1), transient=50)
    result = audit(orbit)
    assert result.worst < 1e-12
    assert np.abs(orbit.multipliers).max() < 1e-12


def test_audit_of_an_orbit_that_begins_at_rest_is_empty():
    result = audit(actuator_orbit(0.45, 0.1, transient=50))
    assert result.computed.size == 0
    assert result.worst == 0.0


def test_audit_names_the_worst_entry():
    result = audit(actuator_orbit(0.24, 0.5))
    row, column = result.entry
    difference = np.abs(result.computed - result.simulated)
    assert difference[row, column] == difference.max()


def test_audit_refuses_an_orbit_that_no_run_follows():
    family = oscillator(amplitude=0.5, omega=0.8)
    branch = follow(
        find_orbit(family.at(amplitude=0.3), at((0.0, 0.0)), transient=200),
        "amplitude",
        low=0.2,
        high=0.5,
        reconnecting=False,
    )
    penetrating = branch.points[-1].orbit
    assert not penetrating.admissible
    with pytest.raises(OrbitError, match="not admissible"):
        audit(penetrating)
