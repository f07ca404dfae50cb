"""Events of users on branches: located, continued in two parameters, refused."""

import math
import pickle

import numpy as np
import pytest

import mems_impact as mi

LONG = mi.StepControl(initial_step=0.05, max_step=0.2)
PLAIN = mi.Options(method="dop853", rtol=1e-11, atol=1e-13)


def _wave(mode, t, y, p):
    return 0.0, math.cos(2.0 * math.pi * t) - 3.0 * y.w


def _logistic(mode, t, y, p):
    return mode, (p.r * y.x * (1.0 - y.x) + p.q, y.w)


MAP = mi.System(
    states=("x", "w"), flow=_wave, switch_transition=_logistic, switches=(0.5,), period=1.0,
    parameters={"r": 2.0, "q": 0.0}, initial={"x": 0.5, "w": 0.0618834},
)  # fmt: skip


@pytest.fixture(scope="module")
def fixed_point():
    """The fixed point 1 - 1/r of the logistic map."""
    return mi.find_orbit(MAP, periods=1, options=PLAIN)


@pytest.fixture(scope="module")
def branch(fixed_point):
    events = {
        "x = 0.6": ("x", 0.6),
        "half a grain": lambda orbit: 1e-9 * (orbit.state.x - 0.62),
        "step": lambda orbit: math.copysign(1.0, orbit.state.x - 0.55),
        "domain": lambda orbit: (
            math.log(0.58 - orbit.state.x) if orbit.state.x < 0.57 else math.nan
        ),
        "r": ("r", 2.25),
    }
    return mi.continue_solution(fixed_point, "r", 3.2, steps=LONG, events=events)


@pytest.mark.slow
def test_events_are_zeros_of_functions_among_the_other_special_points(branch):
    expected = {"r": 2.25, "x = 0.6": 2.5, "half a grain": 1.0 / 0.38, "PD": 3.0}
    assert [special.label for special in branch.special_points] == list(expected)
    found = [special.value for special in branch.special_points]
    np.testing.assert_allclose(found, list(expected.values()), atol=1e-10)
    assert branch.special_table["kind"].tolist()[:3] == list(expected)[:3]
    assert branch.special_points[1].criticality == ""


@pytest.mark.nightly
def test_an_event_is_continued_in_a_second_parameter(branch):
    """The fixed point x = r x (1 - x) + q at x = 0.6."""
    curve = mi.continue_curve(branch.special_points[1], "q", 0.05)
    assert curve.ended == "q reached its bound"
    assert curve.label == "x = 0.6"
    q, r = (curve.table[name].to_numpy() for name in ("q", "r"))
    np.testing.assert_allclose(r, (0.6 - q) / 0.24, atol=1e-9)
    small = mi.continue_curve(branch.special_points[2], "q", 0.05)
    assert small.table["x"].to_numpy() == pytest.approx(0.62, abs=1e-9)


@pytest.mark.slow
def test_an_orbit_is_continued_at_a_fixed_value(fixed_point):
    curve = mi.continue_curve(fixed_point, "q", 0.05, fixed="x", free="r", steps=LONG)
    assert curve.kind == "x = 0.5"
    assert curve.table["x"].to_numpy() == pytest.approx(0.5, abs=1e-9)
    assert curve.table["r"].iloc[-1] == pytest.approx(1.8, abs=1e-9)
    with pytest.raises(mi.InvalidParameter, match="free = None: must be a parameter"):
        mi.continue_curve(fixed_point, "q", 0.05, fixed="x")
    with pytest.raises(mi.InvalidParameter, match="fixed = 'z': must be a column of the table: r,"):
        mi.continue_curve(fixed_point, "q", 0.05, fixed="z", free="r")
    with pytest.raises(mi.InvalidParameter, match="of this orbit, where it is nan"):
        mi.continue_curve(fixed_point, "q", 0.05, fixed="impact speed", free="r")


def test_a_branch_with_events_is_saved_and_pickled(branch, tmp_path):
    assert pickle.loads(pickle.dumps(branch)) == branch
    branch.save(tmp_path / "branch.zip")
    loaded = mi.load(tmp_path / "branch.zip", system=MAP)
    by_column, by_function = loaded.special_points[1:3]
    assert len(mi.continue_curve(by_column, "q", 0.001)) > 1
    ended = mi.continue_curve(by_function, "q", 0.001).ended
    assert "'half a grain' is not in the file" in ended


def fails(orbit):
    if orbit.state.x > 0.55:
        raise KeyError("v before")
    return orbit.state.x - 1.0


@pytest.mark.parametrize(
    ("events", "error", "message"),
    [
        ({"fold": ("x", 1.0)}, mi.InvalidParameter, "'fold': is another kind of special point"),
        ({"PD": ("x", 1.0)}, mi.InvalidParameter, "'PD': is another kind of special point"),
        ({"e": ("z", 1.0)}, mi.InvalidParameter, "'z': must be a column of the table: r, largest"),
        ({"e": ("x", "1")}, mi.InvalidParameter, "must be a function of the orbit, or a column"),
        ({1: ("x", 1.0)}, mi.InvalidParameter, "events = 1: must be named by text"),
        ([("x", 1.0)], mi.InvalidParameter, "must be a mapping of names to events"),
        ({"e": lambda orbit: 1 / 0}, mi.FunctionError, "event 'e' raises ZeroDivisionError"),
        ({"e": lambda orbit: "1"}, mi.FunctionError, "event 'e' returns '1', not a number"),
        ({"e": lambda orbit: orbit.stable}, mi.FunctionError, "returns True, not a number"),
    ],
)
def test_what_is_no_event_is_refused(fixed_point, events, error, message):
    with pytest.raises(error, match=message):
        mi.continue_solution(fixed_point, "r", 2.1, events=events)


def test_a_branch_stops_at_the_first_of_some_points(fixed_point):
    events = {"low": ("x", 0.55), "high": ("x", 0.6)}
    branch = mi.continue_solution(fixed_point, "r", 3.2, steps=LONG, events=events, stop_at="high")
    assert branch.ended == "the branch stops at high"
    assert [special.label for special in branch.special_points] == ["low", "high"]
    assert branch.table["r"].iloc[-1] == pytest.approx(2.5, abs=1e-10)
    assert branch.orbits[-1] is branch.special_points[-1].orbit
    labels = ("NS", "period-doubling")
    doubled = mi.continue_solution(fixed_point, "r", 3.2, steps=LONG, stop_at=labels)
    assert doubled.ended == "the branch stops at period-doubling"
    assert doubled.table["r"].iloc[-1] == pytest.approx(3.0, abs=1e-10)
    allowed = "'high': must be one of .*PD.*, low, .*period-doubling"
    with pytest.raises(mi.InvalidParameter, match=allowed):
        mi.continue_solution(fixed_point, "r", 3.2, events={"low": ("x", 0.55)}, stop_at=["high"])
    with pytest.raises(mi.InvalidParameter, match="stop_at = 1: must be labels of special points"):
        mi.continue_solution(fixed_point, "r", 3.2, stop_at=1)


def test_events_of_a_branch_of_twice_the_period(fixed_point):
    """Its larger x is 0.7 where 0.84 r^2 - 1.2 r - 4 = 0."""
    branch = mi.continue_solution(fixed_point, "r", 3.1, steps=LONG, stop_at="PD")
    events = {"x = 0.7": ("x", 0.7)}
    twice = mi.switch_branch(
        branch.special_points[0],
        bounds=(2.9, 3.5),
        steps=LONG,
        events=events,
        stop_at="x = 0.7",
    )
    assert twice.ended == "the branch stops at x = 0.7"
    assert twice.special_points[-1].value == pytest.approx(
        (1.2 + math.sqrt(14.88)) / 1.68, abs=1e-9
    )
    with pytest.raises(mi.InvalidParameter, match="'PD': is another kind of special point"):
        mi.switch_branch(branch.special_points[0], bounds=(2.9, 3.5), events={"PD": ("x", 1.0)})


def test_a_function_that_raises_later_ends_the_branch(fixed_point):
    branch = mi.continue_solution(fixed_point, "r", 3.2, steps=LONG, events={"late": fails})
    assert "event 'late' raises KeyError: 'v before'" in branch.ended
    assert branch.table["x"].iloc[-1] == pytest.approx(0.55, abs=1e-6)


@pytest.mark.slow
def test_events_of_equilibria():
    def well(mode, t, y, p):
        return y.v, p.a * y.x - y.x**3 - 0.1 * y.v

    (found,) = mi.find_equilibria(
        mi.System(states=("x", "v"), flow=well, parameters={"a": 1.0}), guess={"x": 0.9}
    )
    events = {"near": ("x", 0.5), "square": lambda rest: rest.state.x**2 - 0.64}
    branch = mi.continue_solution(found, "a", 0.1, events=events)
    assert [special.label for special in branch.special_points] == ["square", "near"]
    assert branch.special_points[0].value == pytest.approx(0.64, abs=1e-10)
    assert branch.special_points[1].value == pytest.approx(0.25, abs=1e-10)
    with pytest.raises(mi.InvalidParameter, match="'Hopf': is another kind"):
        mi.continue_solution(found, "a", 0.1, events={"Hopf": ("x", 0.5)})
    stopped = mi.continue_solution(found, "a", 0.1, events=events, stop_at="square")
    assert stopped.table["a"].iloc[-1] == pytest.approx(0.64, abs=1e-10)
    through = mi.continue_solution(found, "a", -0.5, stop_at="BP")
    assert through.ended == "the branch stops at branch point"
    (rest,) = mi.find_equilibria(found.system.changed(a=-1.0), guess={"x": 0.0})
    (fork,) = mi.continue_solution(rest, "a", 1.0).special_points
    halves = mi.switch_branch(
        fork, events={"edge": ("x", 0.5), "other": ("x", -0.5)}, stop_at=["edge", "other"]
    )
    assert sorted(halves.table["a"].iloc[[0, -1]]) == pytest.approx([0.25, 0.25], abs=1e-10)
    assert "at its beginning, the branch stops at" in halves.ended
