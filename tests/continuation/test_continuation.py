"""The predictor-corrector loop, on the unit circle x^2 + p^2 = 1, followed from (x, p) = (1, 0)."""

from functools import partial
from itertools import islice
from types import SimpleNamespace

import numpy as np
import pytest

from mems_impact.continuation.arclength import (
    Continuation,
    ContinuationProblem,
    LocatedEvents,
    Restart,
    StepControl,
    correct,
    tangent,
)
from mems_impact.errors import OrbitError
from mems_impact.orbits.newton import solve_at


def evaluate(unknowns, values):
    (x,), (p,) = unknowns, values
    return SimpleNamespace(
        unknowns=unknowns, values=values, residual=np.array([x * x + p * p - 1.0]),
        jacobian=np.array([[2.0 * x]]), by_parameter=np.array([[2.0 * p]]),
    )  # fmt: skip


class Circle(ContinuationProblem):
    """It says where x is zero; there it is lost, if `beyond` says how it goes on."""

    parameters = ("p",)
    family = SimpleNamespace(
        amount=lambda name, value: f"{value:.3g}",
        at=lambda **values: SimpleNamespace(derivative=lambda name: (np.ones(1), 0.0)),
    )
    noun = "circle"

    def __init__(self, beyond=None, refused=2.0):
        self.branch = SimpleNamespace(points=[], special_points=[], ended="")
        self.beyond, self.refused, self.where = beyond, refused, ""

    def corrector(self, point):
        return partial(correct, SimpleNamespace(evaluate=evaluate))

    def solve(self, guess):
        equations = SimpleNamespace(evaluate=evaluate)
        return solve_at(equations, guess[:-1], guess[-1:], reason="missed", remedy="")

    def check(self, point, following):
        if following.values[0] > self.refused:
            raise OrbitError("it goes too far", "take a shorter step")

    def rates(self, point, name, value):
        return np.array([point.unknowns[0] ** 2 + value**2 - 1.0])

    def tests(self, point, direction):
        return {"top": point.unknowns[0]}

    def closing(self, step, length):
        first = np.array([1.0, 0.0])
        position = float((first - step.start) @ step.direction)
        if len(self.branch.points) < 4 or not 0.0 < position <= length:
            return None
        return position if np.allclose(step.at(position).unknowns, first, atol=1e-9) else None

    def locate(self, step, length, before, after):
        if before["top"] * after["top"] > 0.0:
            return LocatedEvents([])
        position = step.zero(lambda point: point.unknowns[0], length)
        top = step.at(position).unknowns
        if self.beyond is None:
            return LocatedEvents([top])
        return LocatedEvents([top], top, "nothing beyond")

    def pass_loss(self, located, length):
        return located.reason if self.beyond == "end" else self.beyond

    def record(self, point, direction):
        self.branch.points.append((*point.unknowns, *point.values))

    def stalled(self):
        self.where = self.branch.points[-1]


def continued(problem, low=-2.0, high=2.0, **steps):
    first = evaluate(np.array([1.0]), np.array([0.0]))
    control = StepControl(**{"initial_step": 0.1, "max_step": 0.2, **steps})
    return Continuation(problem, first, tangent(first), low=low, high=high, steps=control)


def test_once_round():
    problem = Circle()
    points = [*continued(problem)]
    assert points == problem.branch.points
    assert np.hypot(*np.transpose(points)) == pytest.approx(1.0, abs=1e-9)
    assert problem.branch.ended == "the circle closed upon itself"
    assert points[-1] == pytest.approx((1.0, 0.0), abs=1e-9)
    np.testing.assert_allclose(problem.branch.special_points, [[0.0, 1.0], [0.0, -1.0]], atol=1e-9)


def test_the_last_point_is_at_the_bound():
    problem = Circle()
    *_, last = continued(problem, high=0.6)
    assert last[0] == pytest.approx(0.8, abs=1e-9)
    assert last[1] == 0.6
    assert problem.branch.ended == "p reached its bound"


def test_points_come_as_they_are_asked_for():
    problem = Circle()
    assert len([*islice(continued(problem), 4)]) == 4
    assert len(problem.branch.points) == 4
    assert problem.branch.ended == ""


def test_steps_that_turn_too_sharply_are_halved():
    points = [*continued(Circle(), initial_step=0.8, max_step=0.8, max_points=10)]
    angles = np.arctan2(*np.transpose(points)[::-1])
    assert np.cos(np.diff(angles)).min() >= 0.9


def test_what_cannot_be_passed_is_reported():
    problem = Circle(refused=0.5)
    assert [*continued(problem)][-1] == problem.where
    assert problem.branch.ended == "no further step possible beyond p = 0.5: it goes too far"


def test_points_are_used_up():
    problem = Circle()
    assert len([*continued(problem, max_points=5)]) == 5
    assert problem.branch.ended.startswith("the budget of 5 points is used up; a step of length")
    assert problem.where == problem.branch.points[-1]


def test_a_loss_ends_it_or_leads_elsewhere():
    problem = Circle(beyond="end")
    [*continued(problem)]
    assert problem.branch.ended == "nothing beyond"
    assert len(problem.branch.special_points) == 1
    there = evaluate(np.array([-1.0]), np.array([0.0]))
    problem = Circle(beyond=Restart(there, np.array([0.0, -1.0]), 0.1))
    [*continued(problem, low=-0.5)]
    assert problem.branch.ended == "p reached its bound"
    assert problem.branch.points[-1] == pytest.approx((-np.sqrt(0.75), -0.5), abs=1e-9)
