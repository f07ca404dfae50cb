"""Branches of limit cycles whose period grows beyond bounds."""

import math

import numpy as np
import pytest

import mems_impact as mi

STEPS = mi.StepControl(largest=0.2)


def well(mode, t, y, p):
    """Strogatz, Nonlinear Dynamics and Chaos, example 8.4.1: homoclinic at m = -0.8645."""
    return y.y, p.m * y.y + y.x - y.x * y.x + y.x * y.y


def circle(mode, t, y, p):
    """On the unit circle the angle turns at m - cos(angle): the period is 2 pi/sqrt(m^2 - 1)."""
    inside, turn = 1.0 - y.x * y.x - y.y * y.y, p.m - y.x
    return y.x * inside - y.y * turn, y.y * inside + y.x * turn


def van_der_pol(mode, t, y, p):
    return y.y, p.m * (1.0 - y.x * y.x) * y.y - y.x


def followed(flow, start, m, stop, transient):
    system = mi.System(states=("x", "y"), flow=flow, parameters={"m": m}, initial={"x": start})
    return mi.continue_orbit(mi.find_orbit(system, transient=transient), "m", stop, steps=STEPS)


@pytest.mark.slow
def test_an_equilibrium_is_passed_ever_more_slowly():
    branch = followed(well, 1.2, -0.95, -0.5, 300.0)
    assert branch.ended.startswith("the period grows beyond bounds (from 6.998 to ")
    assert "an equilibrium (x = " in branch.ended
    assert "homoclinic" in branch.ended
    last = branch.orbits[-1]
    assert last.system.parameters["m"] == pytest.approx(-0.8645, abs=1e-4)
    # The multiplier is exp of the divergence over the cycle, which is negative at the saddle.
    assert branch.special_points == ()
    assert all(orbit.stable for orbit in branch.orbits)


def test_the_period_is_in_the_table():
    system = mi.System(states=("x", "y"), flow=circle, parameters={"m": 1.5}, initial={"x": 1.0})
    options = mi.Options(method="dop853", engine="interpreted")
    orbit = mi.find_orbit(system, transient=20.0, options=options)
    branch = mi.continue_orbit(orbit, "m", 1.2, steps=mi.StepControl(most=3))
    table = branch.table
    expected = 2.0 * math.pi / np.sqrt(table["m"].to_numpy() ** 2 - 1.0)
    assert table["period"].to_numpy() == pytest.approx(expected, rel=1e-8)
    drawn = mi.plot_branch(branch, quantity="period").lines[0].get_ydata()
    assert drawn.tolist() == table["period"].tolist()


@pytest.mark.slow
def test_slow_relaxation_is_not_taken_for_it():
    branch = followed(van_der_pol, 1.0, 1.0, 12.0, 50.0)
    assert branch.ended == "m reached its bound"  # slow, but no more so at twice the period
    assert branch.table["period"].tolist() == [orbit.period for orbit in branch.orbits]
    # (3 - 2 log 2) m + 7.0143 m^(-1/3), Dorodnitsyn 1947.
    expected = (3.0 - 2.0 * math.log(2.0)) * 12.0 + 7.0143 * 12.0 ** (-1.0 / 3.0)
    assert branch.table["period"].iloc[-1] == pytest.approx(expected, rel=0.02)


@pytest.mark.slow
def test_a_cycle_on_which_two_equilibria_are_about_to_be_born():
    branch = followed(circle, 1.0, 1.5, 0.5, 50.0)
    assert "beyond bounds" in branch.ended
    assert "saddle-node of equilibria" in branch.ended
    table = branch.table[branch.table["m"] > 1.001]
    assert table["period"].to_numpy() == pytest.approx(
        2.0 * math.pi / np.sqrt(table["m"].to_numpy() ** 2 - 1.0), rel=1e-7
    )
