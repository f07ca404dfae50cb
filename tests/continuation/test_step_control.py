"""How far a step goes, which loss comes first, where a cycle is cut: each by numbers alone."""

from types import SimpleNamespace

import numpy as np
import pytest

from mems_impact.continuation import special_points
from mems_impact.continuation.arclength import PredictorStep, StepControl, budget_message
from mems_impact.continuation.test_functions import (
    ClosestApproach,
    ClosestApproachTest,
    ContactSpeedTest,
    NeimarkSackerTest,
    SegmentLengthTest,
)
from mems_impact.orbits.newton import Solution


@pytest.mark.parametrize("unknown", [0.6, -0.6])
@pytest.mark.parametrize(("rate", "bound"), [(0.8, 1.0), (-0.8, -1.0)])
def test_a_step_beyond_a_bound_ends_a_little_beyond_it(unknown, rate, bound):
    steps, point = StepControl(), SimpleNamespace(values=np.array([0.2]))
    direction = np.array([0.0, unknown, rate])
    length = steps.within(-1.0, 1.0, point, direction, 5.0)
    assert point.values[0] + length * rate == pytest.approx(bound + 1e-3 * (bound - 0.2))
    assert steps.within(-1.0, 1.0, point, direction, 0.5) == 0.5


def test_a_zero_within_a_step_is_located_to_rounding():
    """Of a function that jumps, which no interpolation sees coming; and the step's own length."""
    straight = SimpleNamespace(unknowns=np.array([0.0]), values=np.array([0.0]))

    def at(plane, direction, guess):
        return Solution(plane, SimpleNamespace(values=plane[1:]), 1)

    step = PredictorStep(at, straight, np.array([0.0, 1.0]))
    for place in (1.0 / 3.0, 1e-3, 1.9):
        found = step.zero(lambda point, place=place: np.sign(point.values[0] - place), 2.0)
        assert found == pytest.approx(place, rel=0.0, abs=1e-13)
    with pytest.raises(ValueError, match="sign"):
        step.zero(lambda point: 1.0, 2.0)


def test_order_of_losses_in_one_point(monkeypatch):
    """The rate, an approach inside a segment, what has neither, an approach at its end."""

    def rank(monitor, inside=False):
        touch = ClosestApproach(value=0.0, segment=0, time=0.0, inside=inside)
        monkeypatch.setattr(special_points, "closest_approach", lambda *_: touch)
        point = SimpleNamespace(starts=[0.0], ends=[1.0])
        orbit = SimpleNamespace(shooting=None, point=point)
        return special_points.priority(SimpleNamespace(monitor=monitor, orbit=orbit))

    approach = ClosestApproachTest("grazing", 0)
    ranks = [
        rank(ContactSpeedTest("grazing", 0, 0)),
        rank(approach, inside=True),
        rank(SegmentLengthTest("grazing", 0)),
        rank(approach),
    ]
    assert ranks == sorted(set(ranks))


@pytest.mark.parametrize("angle", [1e-7, 0.3, 3.0])
@pytest.mark.parametrize("size", [1.0, 1.1])
def test_a_neimark_sacker_point_has_a_pair_on_the_circle(monkeypatch, angle, size):
    pair = size * np.exp(1j * np.array([angle, -angle]))
    orbit = SimpleNamespace(multipliers=np.append(pair, 1.0))
    monkeypatch.setattr(special_points, "make_orbit", lambda *_: orbit)
    here = SimpleNamespace(values=np.array([0.7]))
    found = special_points.classify(NeimarkSackerTest(), None, here, np.ones(2))
    assert (found is not None) == (size == 1.0)


def test_what_is_said_where_the_points_are_used_up():
    steps = StepControl(max_points=7)
    assert "steps are down to a length of 1e-05: it turns" in budget_message(
        steps, 1e-5, "it turns", "A", 0.1
    )
    for length, held in ((steps.max_step, "it turns"), (1e-5, "")):
        assert "changes A by a fraction of 0.1" in budget_message(steps, length, held, "A", 0.1)
