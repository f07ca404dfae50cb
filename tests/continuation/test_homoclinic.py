"""Branches of limit cycles whose period grows beyond bounds."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mems_impact as mi
from mems_impact.analysis.orbit import ORBIT_OPTIONS
from mems_impact.continuation.homoclinic import (
    cycles_beside,
    homoclinic_value,
    saddle_quantity,
)

STEPS = mi.StepControl(max_step=0.2)


def well(mode, t, y, p):
    """Strogatz, Nonlinear Dynamics and Chaos, example 8.4.1: homoclinic at m = -0.8645."""
    return y.y, p.m * y.y + y.x - y.x * y.x + y.x * y.y


def circle(mode, t, y, p):
    """On the unit circle the angle turns at m - cos(angle): the period is 2 pi/sqrt(m^2 - 1)."""
    inside, turn = 1.0 - y.x * y.x - y.y * y.y, p.m - y.x
    return y.x * inside - y.y * turn, y.y * inside + y.x * turn


def van_der_pol(mode, t, y, p):
    return y.y, p.m * (1.0 - y.x * y.x) * y.y - y.x


def followed(flow, start, m, stop, transient, options=ORBIT_OPTIONS, steps=STEPS):
    system = mi.System(states=("x", "y"), flow=flow, parameters={"m": m}, initial={"x": start})
    cycle = mi.find_orbit(system, transient=transient, options=options)
    return mi.continue_solution(cycle, "m", stop, steps=steps)


@pytest.mark.nightly
def test_an_equilibrium_is_passed_ever_more_slowly():
    branch = followed(well, 1.2, -0.95, -0.5, 300.0)
    assert branch.ended.startswith("the period grows beyond bounds (from 6.998 to ")
    assert "a saddle (x = 0, y = 0)" in branch.ended
    assert "homoclinic orbit at m = -0.8645" in branch.ended
    # The eigenvalues at the origin are those of x' = y, y' = x + m y: their sum is m.
    assert branch.homoclinic.saddle_quantity == pytest.approx(-0.8645, abs=1e-4)
    assert branch.homoclinic.cycles == "one stable cycle"
    last = branch.orbits[-1]
    assert last.system.parameters["m"] == pytest.approx(-0.8645, abs=1e-4)
    # The multiplier is exp of the divergence over the cycle, which is negative at the saddle.
    assert branch.special_points == ()
    assert all(orbit.stable for orbit in branch.orbits)


@pytest.mark.slow
def test_the_period_is_in_the_table():
    system = mi.System(states=("x", "y"), flow=circle, parameters={"m": 1.5}, initial={"x": 1.0})
    options = mi.Options(method="dop853", engine="interpreted")
    orbit = mi.find_orbit(system, transient=20.0, options=options)
    branch = mi.continue_solution(orbit, "m", 1.2, steps=mi.StepControl(max_points=3))
    table = branch.table
    expected = 2.0 * math.pi / np.sqrt(table["m"].to_numpy() ** 2 - 1.0)
    assert table["period"].to_numpy() == pytest.approx(expected, rel=1e-8)
    drawn = mi.plot_branch(branch, quantity="period").lines[0].get_ydata()
    assert drawn.tolist() == table["period"].tolist()


@pytest.mark.nightly
def test_slow_relaxation_is_not_taken_for_it():
    branch = followed(van_der_pol, 1.0, 1.0, 12.0, 50.0)
    assert branch.ended == "m reached its bound"  # slow, but no more so at twice the period
    assert branch.table["period"].tolist() == [orbit.period for orbit in branch.orbits]
    # (3 - 2 log 2) m + 7.0143 m^(-1/3), Dorodnitsyn 1947.
    expected = (3.0 - 2.0 * math.log(2.0)) * 12.0 + 7.0143 * 12.0 ** (-1.0 / 3.0)
    assert branch.table["period"].iloc[-1] == pytest.approx(expected, rel=0.02)


@pytest.mark.nightly
def test_a_cycle_on_which_two_equilibria_are_about_to_be_born():
    # Its last periods are 700 times the first, and hardly anything moves in most of them.
    options = mi.Options(method="bdf", rtol=1e-10, atol=1e-12)
    branch = followed(circle, 1.0, 1.5, 0.5, 50.0, options, mi.StepControl(max_step=1.0))
    assert "beyond bounds" in branch.ended
    assert "saddle-node of equilibria" in branch.ended
    table = branch.table[branch.table["m"] > 1.001]
    assert table["period"].to_numpy() == pytest.approx(
        2.0 * math.pi / np.sqrt(table["m"].to_numpy() ** 2 - 1.0), rel=1e-7
    )


def kuznetsov(mode, t, y, p):
    """Elements of Applied Bifurcation Theory, example 6.1: at a = 0, on the Cartesian leaf."""
    x, y = y.x, y.y
    return -x + 2.0 * y + x * x, (2.0 - p.a) * x - y - 3.0 * x * x + 1.5 * x * y


@pytest.mark.slow
def test_a_homoclinic_orbit_in_closed_form(tmp_path):
    """At a = 0 the eigenvalues at the origin are 1 and -3."""
    system = mi.System(states=("x", "y"), flow=kuznetsov, parameters={"a": 0.2})
    start = mi.find_equilibria(system, guess={"x": 0.63, "y": 0.11})[0]
    (hopf,) = mi.continue_solution(start, "a", 0.5, back=0.1).special_points
    cycles = mi.switch_branch(hopf, bounds=(-0.5, 0.5), steps=STEPS)
    assert "period" in cycles.table
    end = cycles.homoclinic
    assert abs(end.value) < 1e-9
    assert abs(end.value) < 10.0 * end.error + 1e-10
    assert end.saddle_quantity == pytest.approx(-2.0, abs=1e-5)
    assert end.cycles == "one stable cycle"
    assert cycles.orbits[-1].stable
    assert "saddle quantity -2: one stable cycle near it" in cycles.ended
    cycles.save(tmp_path / "cycles")
    assert mi.load(tmp_path / "cycles").homoclinic.value == end.value


def lorenz(mode, t, y, p):
    return 10.0 * (y.y - y.x), y.x * (p.r - y.z) - y.y, y.x * y.y - 8.0 / 3.0 * y.z


def crosses(r):
    """Return whether the unstable manifold of the origin comes to the other side after one turn."""

    def flow(t, y):
        x, y, z = y
        return [10.0 * (y - x), x * (r - z) - y, x * y - 8.0 / 3.0 * z]

    rate = 0.5 * (-11.0 + math.sqrt(81.0 + 40.0 * r))
    start = 1e-7 * np.array([1.0, 1.0 + rate / 10.0, 0.0])
    run = solve_ivp(flow, (0.0, 12.0), start, method="DOP853", rtol=1e-12, atol=1e-14)
    return bool(run.y[0].min() < -1.0)


@pytest.mark.nightly
def test_the_homoclinic_orbit_of_the_lorenz_system():
    """Against the unstable manifold of the origin, bisected with another integrator."""
    low, high = 13.5, 14.5
    while high - low > 1e-8:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if crosses(middle) else (middle, high)
    assert low == pytest.approx(13.92655741, abs=2e-8)
    system = mi.System(states=("x", "y", "z"), flow=lorenz, parameters={"r": 20.0})
    guess = {"x": 7.1, "y": 7.1, "z": 19.0}
    steady = mi.find_equilibria(system, guess=guess)[0]
    steps = mi.StepControl(max_step=2.0)
    (hopf,) = mi.continue_solution(steady, "r", stop=30.0, steps=steps).special_points
    cycles = mi.switch_branch(hopf, bounds=(10.0, 30.0), steps=steps)
    end = cycles.homoclinic
    assert end.value == pytest.approx(low, abs=2e-5)
    assert abs(end.value - low) < 3.0 * end.error
    # Eigenvalues at the origin: -8/3 and (-11 + sqrt(81 + 40 r))/2.
    quantity = -8.0 / 3.0 + 0.5 * (-11.0 + math.sqrt(81.0 + 40.0 * cycles.table["r"].iloc[-1]))
    assert end.saddle_quantity == pytest.approx(quantity, abs=1e-8)
    assert end.cycles == "one unstable cycle"
    assert not cycles.orbits[-1].stable


@pytest.mark.parametrize(
    ("eigenvalues", "quantity", "cycles"),
    [
        ([1.0, -3.0], -2.0, "one stable cycle"),
        ([3.0, -1.0, -7.0], 2.0, "one unstable cycle"),
        ([1.0, 2.0, -3.0], -2.0, "one unstable cycle"),  # a saddle cycle
        ([1.0, -0.5 + 2j, -0.5 - 2j], 0.5, "infinitely many cycles"),  # Shilnikov
        ([1.0, -1.5 + 2j, -1.5 - 2j], -0.5, "one stable cycle"),
        ([0.5 + 1j, 0.5 - 1j, -1.0], -0.5, "infinitely many cycles"),
        ([0.5 + 1j, 0.5 - 1j, -1.0 + 1j, -1.0 - 1j], -0.5, "infinitely many cycles"),
        ([1.0, -1.0], 0.0, ""),
        ([-1.0, -2.0], math.nan, ""),
    ],
)
def test_the_cycles_that_bifurcate(eigenvalues, quantity, cycles):
    values = np.array(eigenvalues, dtype=complex)
    assert saddle_quantity(values) == pytest.approx(quantity, nan_ok=True)
    assert cycles_beside(values) == cycles


def test_the_parameter_is_extrapolated_to_an_infinite_period():
    periods = np.array([3.0, 4.0, 5.0, 5.5, 6.0])
    values = 1.25 + 0.3 * np.exp(-0.8 * periods)
    found, error = homoclinic_value(values, periods, 0.8)
    assert found == pytest.approx(1.25, abs=1e-12)
    assert error < 1e-12
