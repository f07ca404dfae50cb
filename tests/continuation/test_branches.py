"""Branches of the actuator: bounds, ends, special points from either side, parameters."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.actuator.drives import Square
from mems_impact.continuation.arclength import StepControl, correct
from mems_impact.continuation.branch import OrbitBranch, OrbitEvent
from mems_impact.continuation.branch_switching import double_cover
from mems_impact.continuation.grazing import change_signature
from mems_impact.continuation.orbit_branch import _BranchProblem, follow
from mems_impact.continuation.test_functions import FoldTest, SegmentLengthTest
from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.orbits.newton import solve
from mems_impact.orbits.orbit_search import find_periodic_orbit
from mems_impact.orbits.periodic_orbit import make_orbit
from tests.orbits.audit import check_closed
from tests.orbits.families import (
    DEVICE,
    FunctionFamily,
    actuator_orbit,
    at,
    silent_orbit,
    table,
)

# f of the special points at omega = 0.5 and 0.45, as computed from either side.
GRAZING_5, FOLD_5 = 0.2271775831, 0.176515440628


def values(branch, kind):
    return [special.value for special in branch.special_points if special.kind == kind]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("parameter", "low", "high"),
    [("omega", 0.47, 0.52), ("e", 0.5, 0.95), ("c", 0.01, 0.06), ("delta", 0.4, 0.6)],
)
def test_branches_in_other_parameters(parameter, low, high):
    start = actuator_orbit(0.24, 0.5)
    for direction, bound in ((-1.0, low), (1.0, high)):
        branch = follow(start, parameter, low=low, high=high, direction=direction)
        assert branch.ended == f"{parameter} reached its bound"
        last = branch.points[-1].solution
        assert last.family.values[parameter] == pytest.approx(bound, abs=1e-14)
        assert last.stable
        again = find_periodic_orbit(
            start.family.at(**{parameter: bound}), start.instant, transient=300
        )
        np.testing.assert_allclose(last.state[2:], again.state[2:], atol=1e-9)


@pytest.mark.nightly
def test_branch_of_orbits_with_rest_and_chatter():
    orbit = find_periodic_orbit(table(amplitude=1.5), at((0.0, 0.0), mode=1), transient=50)
    branch = follow(orbit, "amplitude", low=1.49, high=1.51, steps=StepControl(max_points=6))
    assert len(branch.points) > 2
    assert branch.ended
    for point in branch.points:
        if point.solution.admissible:
            assert check_closed(point.solution) < 1e-8


def test_without_reconnection_the_branch_continues_beyond_the_stopper():
    branch = follow(silent_orbit(0.2, 0.5), "amplitude", low=0.19, high=0.25, reconnecting=False)
    assert values(branch, "grazing")[0] == pytest.approx(GRAZING_5, abs=1e-10)
    assert branch.ended == "amplitude reached its bound"
    for point in branch.points:
        assert point.solution.admissible == (point.value < GRAZING_5 + 1e-9)


# Ends and refusals.


def test_budget_of_points():
    branch = follow(
        silent_orbit(0.16, 0.5), "amplitude", low=0.1, high=0.3, steps=StepControl(max_points=5)
    )
    assert len(branch.points) == 5
    assert "budget" in branch.ended
    assert "changes amplitude by a fraction of" in branch.ended


def test_a_branch_that_is_held_back_says_by_what():
    steps = StepControl(initial_step=3.0, max_step=3.0, max_points=2)
    branch = follow(silent_orbit(0.2355, 0.45), "amplitude", low=0.1, high=0.3, steps=steps)
    assert "steps are down to a length of" in branch.ended
    assert "degrees within a step" in branch.ended


# Steps.


def unknowns(point):
    return np.append(point.solution.point.unknowns, point.value)


def distance(one, other):
    return one.solution.shooting.norm(unknowns(other) - unknowns(one))


def test_an_orbit_and_its_double_cover_take_the_same_steps():
    once = actuator_orbit(0.24, 0.5)
    guess = double_cover(once)
    shooting = once.equations((), guess.segments)
    twice = make_orbit(shooting, solve(shooting, shooting.pack(guess), np.zeros(0)))
    assert len(twice.segments) == 2 * len(once.segments)
    first, second = (
        follow(orbit, "amplitude", low=0.2, high=0.3, steps=StepControl(max_points=12))
        for orbit in (once, twice)
    )
    steps = [np.diff([point.value for point in branch.points]) for branch in (first, second)]
    assert steps[0].sum() > 0.01
    # The planes of the corrections differ to second order of a step.
    assert steps[1] == pytest.approx(steps[0], rel=0.01)


@pytest.mark.slow
@pytest.mark.parametrize(
    "steps", [StepControl(), StepControl(initial_step=0.3, max_step=1.0)], ids=["short", "long"]
)
def test_a_branch_begins_with_its_first_step_and_never_turns_sharply(steps):
    branch = follow(silent_orbit(0.23, 0.45), "amplitude", low=0.2, high=0.3, steps=steps)
    free = [point for point in branch.points if point.piece == 0]
    assert len(free) >= 3
    apart = [distance(a, b) for a, b in pairwise(free)]
    assert apart[0] <= 1.01 * steps.initial_step
    assert max(apart) <= 1.1 * steps.max_step
    assert min(a.direction @ b.direction for a, b in pairwise(free)) >= 0.9


def test_noise_of_the_integration_counts_as_no_difficulty():
    """A tiny step is there at once; what the iteration then does is to rattle in the rounding."""
    branch = follow(actuator_orbit(0.24, 0.5), "amplitude", low=0.23, high=0.25)
    for point in branch.points[:-1]:
        shooting = point.solution.shooting
        here = np.append(point.solution.point.unknowns, point.value)
        ahead = correct(shooting, here + 1e-5 * point.direction, point.direction)
        assert ahead.iterations <= 1


def test_a_fold_next_to_a_grazing_is_listed():
    """The two meet at omega = 0.480271; at 0.4801 they are 5e-3 apart on the branch."""
    start, steps = silent_orbit(0.177, 0.4801), StepControl(initial_step=0.03, max_points=3)
    branch = follow(start, "amplitude", low=0.1, high=0.3, steps=steps)
    assert [s.kind for s in branch.special_points][:2] == ["fold", "grazing"]
    fold, grazing = branch.special_points[:2]
    apart = np.append(fold.solution.point.unknowns, fold.value)
    apart -= np.append(grazing.solution.point.unknowns, grazing.value)
    assert np.linalg.norm(apart) < 1e-2


def test_the_last_step_does_not_go_far_beyond_a_bound():
    """There the model may end."""
    start = silent_orbit(0.1999, 0.5)

    def build(values):
        if values["amplitude"] > 0.204:
            raise InvalidParameter("amplitude", values["amplitude"], "0.204 at most")
        return start.family.at(**values).problem()

    family = FunctionFamily(start.family.values, build)
    branch = follow(replace(start, family=family), "amplitude", low=0.1, high=0.2)
    assert branch.ended == "amplitude reached its bound"
    assert len(branch.points) == 2


@pytest.mark.slow
def test_multipliers_that_pass_through_infinity_are_no_period_doubling():
    """The impact loses its speed at the grazing, and beyond it is one backwards."""
    branch = follow(
        actuator_orbit(0.24, 0.5), "amplitude", low=0.1, high=0.3, direction=-1, reconnecting=False
    )
    assert "grazing" in [s.kind for s in branch.special_points]
    assert values(branch, "period-doubling") == []


@pytest.mark.parametrize("direction", [-1.0, 1.0])
def test_start_at_a_bound(direction):
    branch = follow(silent_orbit(0.16, 0.5), "amplitude", low=0.16, high=0.16, direction=direction)
    assert branch.ended == "amplitude reached its bound"
    assert all(point.value == pytest.approx(0.16, abs=1e-14) for point in branch.points)


def test_a_guard_beyond_which_nothing_is_found_ends_the_branch_with_the_reason(monkeypatch):
    def nothing(*_):
        raise OrbitError("there is nothing", "look elsewhere")

    for way in ("change_signature", "neighbour"):
        monkeypatch.setattr(f"mems_impact.continuation.orbit_branch.{way}", nothing)
    branch = follow(silent_orbit(0.2, 0.5), "amplitude", low=0.19, high=0.25)
    assert branch.ended == "grazing: there is nothing; look elsewhere"
    assert branch.points[-1].value == pytest.approx(GRAZING_5, abs=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("segment", "reason"), [(0, "at the start of a period"), (1, "depends on their order")]
)
def test_events_that_cannot_pass_each_other(segment, reason):
    """A switch begins the period; an impact is followed by a slip, not the other way round."""
    drive = Square(amplitude=0.4, omega=1.0)
    options = mi.Options(method="dop853", engine="interpreted")
    guess = mi.kicked_state(DEVICE)
    orbit = mi.find_orbit(DEVICE, drive, guess=guess, transient=40, options=options).numeric
    assert orbit.segments[-1].code == 2 * orbit.shooting.m
    meeting = SegmentLengthTest("simultaneous events", segment)
    with pytest.raises(OrbitError, match=reason):
        change_signature(orbit, meeting, "amplitude")


@pytest.mark.parametrize("listed", [False, True])
def test_what_changes_where_two_events_meet_is_listed_once(listed):
    """The meeting itself changes nothing; a fold in it is named, if it has not been already."""
    first = follow(silent_orbit(0.16, 0.5), "amplitude", low=0.16, high=0.16).points[0]
    meeting = SegmentLengthTest("simultaneous events", 0)
    met = OrbitEvent("fold", "CF", 0.16, first.solution, first.direction, meeting)
    fold = replace(met, monitor=FoldTest())
    special = [fold, met] if listed else [met]
    found = OrbitBranch("amplitude", special_points=list(special))
    orbit = first.solution
    problem = _BranchProblem(found, orbit.shooting, 0.1, 0.3, StepControl(), True)
    direction = first.direction if listed else -first.direction
    problem._reclassify_coincident(met, orbit.point, orbit.shooting, orbit.point, direction)
    assert [(s.kind, s.value, s.monitor) for s in found.special_points] == [
        ("fold", 0.16, fold.monitor)
    ]
