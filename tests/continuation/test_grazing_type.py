"""What leaves a grazing: the paper's types, and the sequence that decides, by DOP853."""

import numpy as np
import pytest
from scipy import linalg

import mems_impact as mi
from mems_impact.continuation.grazing import contact_coefficients, grazing_type
from mems_impact.continuation.orbit_branch import follow
from mems_impact.errors import OrbitError
from mems_impact.orbits.orbit_search import find_periodic_orbit
from tests.continuation import free_block
from tests.orbits.families import at, oscillator, silent_orbit

pytestmark = pytest.mark.slow


def grazing(omega, **changes):
    orbit = silent_orbit(0.14, omega, changes=changes)
    branch = follow(orbit, "amplitude", low=0.1, high=0.35)
    return next(s for s in branch.special_points if s.kind == "grazing")


# Types I, II, III of the paper.
@pytest.mark.parametrize(
    ("omega", "expected"), [(0.5, "jump"), (0.485, "continuous"), (0.45, "after a fold")]
)
def test_types_of_the_paper(omega, expected):
    found = grazing(omega)
    assert grazing_type(found.solution, found.monitor) == expected


@pytest.mark.parametrize("e", [0.8, 0.05])
def test_sequence_is_that_of_the_monodromy_matrix(e):
    """xi_k is proportional to (M^k)_12, and positive multiples of it, whatever the rebound.

    The block leaves the stopper with e_eff = e - (1 + e) m2/(m1 + m2) of its speed, once the slip
    is over; below e = 0.2 that is none or less, and the kick is -(1 + e_eff) all the same.
    """
    found = grazing(0.5, e=e)
    orbit = found.solution
    xi = contact_coefficients(orbit.shooting, orbit.point, found.monitor, 12)
    f = orbit.family.values["amplitude"]

    def touching(u):
        end, _ = free_block.over_period(np.array([0.5, 0.0]), u[0], u[1], 0.5)
        return end - [0.5, 0.0]

    t, f = free_block.root(touching, [2.546, f], tol=1e-13).x
    assert f == pytest.approx(found.value, abs=1e-10)
    _, monodromy = free_block.over_period(np.array([0.5, 0.0]), t, f, 0.5)
    powers = [np.linalg.matrix_power(monodromy, k)[0, 1] for k in range(1, 13)]
    np.testing.assert_allclose(xi / xi[0], np.array(powers) / powers[0], atol=1e-4)
    assert xi[0] * powers[0] > 0.0


def test_linear_oscillator_grazes_continuously_at_real_multipliers():
    """c = 2.5 > 2: multipliers real and positive, (M^k)_12 all of one sign."""
    orbit = find_periodic_orbit(
        oscillator(amplitude=0.5, c=2.5, omega=1.0), at((0.0, 0.0)), transient=50
    )
    branch = follow(orbit, "amplitude", low=0.4, high=4.0)
    found = next(s for s in branch.special_points if s.kind == "grazing")
    assert grazing_type(found.solution, found.monitor) == "continuous"


def test_linear_oscillator_jumps():
    """c = 0.1, omega = 1.3: exp(-c T/2) sin(T) < 0 is the sign of M_12."""
    orbit = find_periodic_orbit(oscillator(amplitude=0.3, omega=1.3), at((0.0, 0.0)), transient=300)
    branch = follow(orbit, "amplitude", low=0.2, high=0.72)
    found = next(s for s in branch.special_points if s.kind == "grazing")
    assert grazing_type(found.solution, found.monitor) == "jump"


@pytest.mark.parametrize(("c", "expected"), [(2.5, "continuous"), (0.1, "jump")])
def test_a_linear_oscillator_under_a_voltage_that_switches(c, expected):
    """xi_k is proportional to (M^k)_12 with M = exp(A T), whatever the switches."""

    def flow(mode, t, y, p):
        return y.v, (p.f if t % 8.0 < 5.0 else -p.f) - y.x - p.c * y.v

    def rebound(mode, t, y, p):
        return mode, (y.x, -0.5 * y.v)

    system = mi.System(
        states=("x", "v"), flow=flow, period=8.0, switches=(5.0,),
        parameters={"f": 0.5, "c": c},
        guards=[mi.Impact("stop", lambda mode, t, y, p: 2.0 - y.x, rebound)],
    )  # fmt: skip
    branch = mi.continue_solution(mi.find_orbit(system, transient=100), "f", stop=9.0)
    special = next(each for each in branch.special_points if each.label == "G")
    assert special.type == expected
    found = special.without_impact
    xi = contact_coefficients(found.solution.shooting, found.solution.point, found.monitor, 8)
    monodromy = linalg.expm(8.0 * np.array([[0.0, 1.0], [-1.0, -c]]))
    powers = np.array([np.linalg.matrix_power(monodromy, k)[0, 1] for k in range(1, 9)])
    np.testing.assert_allclose(xi / xi[0], powers / powers[0], atol=1e-6)
    assert xi[0] * powers[0] > 0.0


@pytest.mark.parametrize(
    ("heat", "expected"), [(1e-4, "jump"), (-1e-4, "continuous"), (-0.1, "continuous")]
)
def test_a_limit_cycle_that_impacts_heat(heat, expected):
    """Its amplitude grows with a temperature that decays slowly: only an impact that cools is weak.

    However little it does: the change of the velocity itself is along the flow.
    """

    def flow(mode, t, y, p):
        return y.v, 0.5 * (1.0 + y.T - y.x**2) * y.v - y.x, -0.05 * y.T

    def rebound(mode, t, y, p):
        return mode, (y.x, -0.5 * y.v, y.T + p.heat * y.v)

    system = mi.System(
        states=("x", "v", "T"), flow=flow, parameters={"d": 2.1, "heat": heat}, initial={"x": 1.9},
        guards=[mi.Impact("wall", lambda mode, t, y, p: p.d - y.x, rebound)],
    )  # fmt: skip
    branch = mi.continue_solution(mi.find_orbit(system, transient=50), "d", 1.95, stop_at="G")
    assert branch.special_points[-1].type == expected


def test_only_grazings_have_a_type():
    branch = follow(silent_orbit(0.16, 0.45), "amplitude", low=0.1, high=0.26)
    fold = next(s for s in branch.special_points if s.kind == "fold")
    with pytest.raises(OrbitError, match="has no type"):
        grazing_type(fold.solution, fold.monitor)
