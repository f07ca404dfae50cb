"""Newton's method by itself, and what its equations raise."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.orbits.newton import newton


@pytest.mark.parametrize(("power", "guess", "iterations"), [(2, 1.0, 4), (1, 5.0, 1), (1, 2.0, 0)])
def test_steps_are_counted_until_the_next_is_as_small_as_the_error(power, guess, iterations):
    """x^2 = 2 from 1: the steps are 0.5, 0.083, 0.0025, 2e-6 and 2e-12."""

    def equations(x):
        slope = power * x ** (power - 1)
        return SimpleNamespace(), x**power - 2.0, np.diag(slope)

    found = newton(equations, np.array([guess]), reason="no root", remedy="")
    assert found.unknowns == pytest.approx([2.0 ** (1.0 / power)], abs=1e-11)
    assert found.iterations == iterations


def test_a_residual_that_is_rounding_is_the_end_whatever_steps_it_makes():
    """Beside a branch point the matrix is nearly singular."""

    def equations(x):
        residual = np.array([0.3 * x[0] - 0.3, 1e-17 + 1e-18 * x[1]])
        return SimpleNamespace(), residual, np.diag([0.3, 1e-18])

    found = newton(equations, np.array([2.0, 10.0]), reason="no root", remedy="")
    assert found.unknowns[0] == pytest.approx(1.0, abs=1e-15)


UP, DOWN = mi.modes("up", "down")


def _there_and_back(mode, t, y, p):
    return (1.0 if mode == UP else -1.0), -y.y


def _top(mode, t, y, p):
    return 1.0 - y.s


def _bottom(mode, t, y, p):
    return y.s


def _turn_down(mode, t, y, p):
    if p.a < 0.2:
        raise ValueError("below the table")
    return DOWN, (1.0, y.y + math.sqrt(p.a))


def _turn_up(mode, t, y, p):
    return UP, (0.0, y.y)


@pytest.mark.slow
def test_a_function_that_fails_at_other_parameters_is_reported():
    """By what it does there, not where the equations were first set up."""
    there = mi.System(
        states=("s", "y"),
        flow=_there_and_back,
        parameters={"a": 1.0},
        guards=[
            mi.Guard("top", _top, _turn_down, modes=(UP,)),
            mi.Guard("bottom", _bottom, _turn_up, modes=(DOWN,)),
        ],
        initial=mi.State(s=0.3, mode="up"),
    )
    options = mi.Options(method="dop853", engine="interpreted")
    orbit = mi.find_orbit(there, transient=9.0, options=options)
    assert orbit.multipliers == pytest.approx([math.exp(-2.0)], abs=1e-8)
    branch = mi.continue_solution(orbit, "a", -1.0, steps=mi.StepControl(max_step=0.3))
    assert branch.table["a"].iloc[-1] == pytest.approx(0.2, abs=1e-6)
    assert "below the table" in branch.ended


def test_a_cycle_of_a_family_is_that_of_the_guess():
    """Where all cycles of a center have one period, no other than the guess is as near."""
    center = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, -y.x - (p.k * y.x if mode.c == 1 else 0.0)),
        parameters={"k": 15.0},
        parts=[mi.SwitchingSurface("c", "x")],
        initial={"x": -0.7},
    )
    orbit = mi.find_orbit(center, options=mi.Options(method="dop853", engine="interpreted"))
    assert orbit.period == pytest.approx(math.pi * (1.0 + 0.25), abs=1e-9)
    assert orbit.state.x == pytest.approx(-0.7, abs=1e-6)
    assert orbit.stable is None
