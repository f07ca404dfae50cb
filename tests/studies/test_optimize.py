"""Optima of orbits: in closed form, and the drive that beats the paper's operating point."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

import mems_impact as mi
from mems_impact.studies.sensitivity import continue_to
from tests.analysis.oscillators import thermostat

ZHAO = mi.load_actuator("zhao2004")
NEAR = mi.State(x2=0.3294504916736363, v2=0.33758229380729476)


@pytest.fixture(scope="module")
def heated():
    return mi.find_orbit(thermostat())


@pytest.fixture(scope="module")
def orbit():
    return mi.find_orbit(ZHAO, mi.Sine(amplitude=0.24, omega=0.5), guess=NEAR, periods=1)


COST = mi.Quantity("cost", lambda orbit: orbit.period + (orbit.system.parameters["q"] - 4.0) ** 2)


@pytest.mark.slow
def test_in_closed_form(heated):
    best = mi.optimize(heated, minimize=COST, over={"q": (2.5, 6.0)})
    # The period is ln((q - 1)/(q - 2)) + ln 2.
    exact = brentq(lambda q: 1.0 / (q - 1.0) - 1.0 / (q - 2.0) + 2.0 * (q - 4.0), 3.0, 6.0)
    assert best.values["q"] == pytest.approx(exact, abs=1e-4)
    assert best.value == pytest.approx(
        math.log(2.0 * (exact - 1.0) / (exact - 2.0)) + (exact - 4.0) ** 2
    )
    assert best.converged
    assert best.active == ()


def test_at_a_limit(heated):
    best = mi.optimize(
        heated, minimize=COST, over={"q": (2.5, 6.0)}, subject_to={"period": (1.3, None)}
    )
    # (q - 1)/(q - 2) = exp(1.3)/2
    ratio = 0.5 * math.exp(1.3)
    assert best.values["q"] == pytest.approx((2.0 * ratio - 1.0) / (ratio - 1.0), rel=1e-6)
    assert best.active == ("period at least 1.3",)
    assert list(best.history.columns) == ["q", "cost", "largest multiplier", "period"]


def test_at_a_bound(heated):
    best = mi.optimize(heated, maximize="period", over={"q": (2.5, 6.0), "low": (0.5, 1.5)})
    assert best.values == {"q": 2.5, "low": 0.5}
    assert best.active == ("q at its lowest value", "low at its lowest value")
    assert best.value == pytest.approx(math.log(2.0 / 0.5) + math.log(4.0))


def test_what_cannot_be(heated):
    with pytest.raises(mi.OrbitError, match="period at least 9") as error:
        mi.optimize(heated, minimize=COST, over={"q": (2.5, 6.0)}, subject_to={"period": (9, None)})
    assert error.value.partial.values["q"] == 2.5


def test_interrupted(heated):
    def stop(points):
        if points == 3:
            raise KeyboardInterrupt

    with pytest.raises(mi.Interrupted, match="3 points") as error:
        mi.optimize(heated, minimize=COST, over={"q": (2.5, 6.0)}, progress=stop)
    best = error.value.partial
    assert best.ended == "interrupted"
    assert best.value < COST(heated)


def test_an_orbit_moves_while_events_pass_the_beginning_of_a_period(orbit):
    # The voltage shifted in time shifts all; so far, that the impact lies in the period before.
    there = continue_to(orbit, {"phase": 1.0})
    assert there.impacts["phase"][0] == pytest.approx(
        (orbit.impacts["phase"][0] - 1.0 / math.pi) % 1.0
    )
    assert there.step == pytest.approx(orbit.step, rel=1e-8)


@pytest.mark.nightly
def test_a_drive_beats_the_papers_operating_point(orbit):
    over = {"amplitude": (0.2, 0.3), "omega": (0.45, 0.6)}
    best = mi.optimize(orbit, maximize="mean speed", over=over)
    paper = orbit.step / orbit.period
    assert best.converged
    assert best.value > 5.0 * paper
    assert best.orbit.stable
    assert best.active == ("amplitude at its highest value",)
    # It walks so, whoever finds it; and beside it, it walks more slowly.
    drive = mi.Sine(**best.values)
    run = mi.simulate(ZHAO, drive, 400, window=(300, 400), initial=best.orbit.state)
    assert run.statistics["mean speed"] == pytest.approx(best.value, rel=1e-6)
    for omega in (best.values["omega"] - 1e-3, best.values["omega"] + 1e-3):
        beside = continue_to(best.orbit, {"omega": omega})
        assert beside.step / beside.period < best.value
    # With its margin to the next bifurcation, which is the fold beyond.
    margins = best.margins.set_index(["parameter", "direction"])
    fold = margins.loc[("omega", "up")]
    assert fold["what"] == "fold"
    branch = mi.continue_solution(best.orbit, "omega", 0.6)
    assert fold["at"] == pytest.approx(branch.special_points[0].value, rel=1e-8)
    assert margins.loc[("omega", "down"), "what"] == "period-doubling"


@pytest.mark.slow
def test_standard_deviation_under_tolerances(orbit):
    tolerances = {"delta": 0.005, "k": 0.01}
    best = mi.optimize(
        orbit,
        minimize="standard deviation of mean speed",
        tolerances=tolerances,
        over={"omega": (0.45, 0.55)},
        subject_to={"mean speed": (5e-5, None)},
        iterations=15,
    )
    first, last = (
        mi.sensitivity(each, list(tolerances)).standard_deviations(tolerances).set_index("quantity")
        for each in (orbit, best.orbit)
    )
    deviation = last.loc["mean speed", "standard deviation"]
    assert best.value == pytest.approx(deviation)
    assert deviation < first.loc["mean speed", "standard deviation"]
    assert best.active == ("mean speed at least 5e-05",)


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        ({}, "maximize"),
        ({"maximize": "period", "minimize": "period"}, "maximize"),
        ({"maximize": "speed"}, "one of"),
        ({"maximize": "period", "over": {}}, "over"),
        ({"maximize": "period", "over": {"q": (5.0, 6.0)}}, "between"),
        ({"maximize": "period", "over": {"q": 5.0}}, "lowest"),
        ({"maximize": "period", "over": {"x": (5.0, 6.0)}}, "x"),
        ({"maximize": "period", "subject_to": {"period": 2.0}}, "subject_to period"),
        ({"maximize": "period", "subject_to": {"period": (2.0, 1.0)}}, "in this order"),
        ({"maximize": "period", "subject_to": {"speed": (2.0, 3.0)}}, "one of"),
        ({"maximize": "period", "subject_to": {"speed": ("2 m/s", None)}}, "one of"),
        ({"maximize": "period", "iterations": 0}, "iterations"),
        ({"minimize": "standard deviation of period"}, "tolerances"),
        ({"minimize": "standard deviation of period", "tolerances": {"x": 1.0}}, "tolerances"),
    ],
)
def test_bad_input(heated, arguments, named):
    with pytest.raises(mi.InvalidParameter, match=named):
        mi.optimize(heated, **{"over": {"q": (2.5, 6.0)}, **arguments})


def test_margins_of_what_ends_nowhere(heated):
    found = mi.bifurcation_margins(heated, ["low"], reach=0.2)
    assert found["what"].tolist() == ["", ""]
    np.testing.assert_allclose(found["margin"], 0.2)
    with pytest.raises(mi.InvalidParameter, match="reach"):
        mi.bifurcation_margins(heated, ["low"], reach=0.0)
    with pytest.raises(mi.InvalidParameter, match="parameter"):
        mi.bifurcation_margins(heated, ["x"])
