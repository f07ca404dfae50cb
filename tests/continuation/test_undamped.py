"""Bifurcations without damping, where multipliers meet in pairs at -1 and at 1."""

import math

import pytest
from scipy.special import mathieu_a, mathieu_b

import mems_impact as mi

Q = 0.1


def parametric(mode, t, y, p):
    return y.v, -(p.d + Q * math.cos(t)) * y.x - y.x**3 - p.c * y.v


def bead(mode, t, y, p):
    return y.v, math.sin(y.x) * (p.w * math.cos(y.x) - 1.0) - p.c * y.v


@pytest.mark.slow
def test_both_sides_of_a_mathieu_tongue_are_period_doublings():
    system = mi.System(
        states=("x", "v"), flow=parametric, parameters={"d": 0.15, "c": 0.0}, period=2.0 * math.pi
    )
    rest = mi.find_orbit(system, guess={"x": 0.0}, periods=1)
    branch = mi.continue_solution(rest, "d", stop=1.2)
    assert [special.label for special in branch.special_points] == ["PD", "PD", "BP", "BP"]
    characteristic = (
        mathieu_b(1, 2 * Q),
        mathieu_a(1, 2 * Q),
        mathieu_b(2, 2 * Q),
        mathieu_a(2, 2 * Q),
    )
    assert [special.value for special in branch.special_points] == pytest.approx(
        [0.25 * value for value in characteristic], abs=1e-8
    )
    # The sign of a coefficient along one of two equal multipliers is arbitrary.
    assert all(special.criticality == "" for special in branch.special_points)


@pytest.mark.parametrize(("damping", "criticality"), [(0.0, ""), (1e-5, "supercritical")])
def test_a_double_eigenvalue_has_no_criticality(damping, criticality):
    system = mi.System(states=("x", "v"), flow=bead, parameters={"w": 0.5, "c": damping})
    (rest,) = mi.find_equilibria(system)
    (pitchfork,) = mi.continue_solution(rest, "w", stop=2.0).special_points
    assert (pitchfork.label, pitchfork.criticality) == ("BP", criticality)
    assert pitchfork.value == pytest.approx(1.0, abs=1e-9)
