"""Pseudo-arclength continuation on a circle: the equilibria of x' = x^2 + p^2 - 1."""

import math

import numpy as np
import pytest

import mems_impact as mi


def circle(mode, t, y, p):
    return (y.x * y.x + p.p * p.p - 1.0,)


def continued(stop=2.0, *, flow=circle, states=("x",), length=0.1, **arguments):
    system = mi.System(states=states, flow=flow, parameters={"p": 0.0})
    (start,) = mi.find_equilibria(system, guess=dict.fromkeys(states, 1.0))
    steps = {"initial_step": length, "max_step": 2.0 * length, "max_points": 200}
    steps |= arguments.pop("steps", {})
    return mi.continue_solution(start, "p", stop, steps=mi.StepControl(**steps), **arguments)


def points(branch):
    return branch.table[["x", "p"]].to_numpy()


def test_a_closed_branch_with_its_folds():
    branch = continued(back=-2.0)
    assert branch.ended == "the branch closed upon itself"
    assert np.hypot(*points(branch).T) == pytest.approx(1.0, abs=1e-9)
    assert points(branch)[-1] == pytest.approx([1.0, 0.0], abs=1e-9)
    assert [point.label for point in branch.special_points] == ["LP", "LP"]
    found = [(point.equilibrium.state.x, point.value) for point in branch.special_points]
    np.testing.assert_allclose(found, [[0.0, 1.0], [0.0, -1.0]], atol=1e-9)


def test_the_last_point_is_at_the_bound():
    branch = continued(0.6)
    assert branch.ended == "p reached its bound"
    assert points(branch)[-1] == pytest.approx([0.8, 0.6], abs=1e-9)


@pytest.mark.parametrize("stop", [0.28, -0.28])
def test_a_step_beyond_a_bound_ends_a_little_beyond_it(stop):
    """A flow that is undefined farther out is not evaluated there."""

    def bounded(mode, t, y, p):
        return (y.x * y.x + p.p * p.p - 1.0 + 0.0 * math.sqrt(0.35 - abs(p.p)),)

    branch = continued(stop, flow=bounded, length=2.0)
    assert branch.ended == "p reached its bound"
    assert points(branch) == pytest.approx(np.array([[1.0, 0.0], [0.96, stop]]), abs=1e-9)


def test_steps_that_turn_too_sharply_are_halved():
    angles = np.arctan2(*points(continued(length=0.4, steps={"max_points": 10})).T[::-1])
    assert 0.2 < np.abs(np.diff(angles)).max() < math.acos(0.9)


def test_a_point_beyond_which_no_step_succeeds_is_named():
    def bounded(mode, t, y, p):
        return (y.x * y.x + p.p * p.p - 1.0 + 0.0 * math.sqrt(0.5 - p.p),)

    branch = continued(flow=bounded)
    x, p = points(branch)[-1]
    assert 0.45 < p < 0.5  # its derivative by p is a difference
    assert x * x + p * p == pytest.approx(1.0, abs=1e-9)
    assert branch.ended.startswith(f"no further step possible beyond p = {p:.9g}: the flow is not")


def test_a_budget_of_points():
    branch = continued(steps={"max_points": 5})
    assert len(branch.table) == 5
    assert branch.ended.startswith("the budget of 5 points is used up; a step of length")
    assert "changes p by a fraction of" in branch.ended
    branch = continued(length=5.0, steps={"max_points": 2})
    assert "used up; steps are down to a length of" in branch.ended
    assert "degrees within a step" in branch.ended


def test_points_are_reported_as_they_are_found():
    values = []
    branch = continued(0.6, progress=values.append)
    assert len(values) == len(branch.table)
