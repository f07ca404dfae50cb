"""Limit cycles of systems without forcing, against closed forms and SciPy."""

import math
import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, root

import mems_impact as mi
from mems_impact.continuation.special_points import is_double_cover
from tests.analysis.oscillators import (
    belt,
    belt_period,
    roessler,
    spiral,
    thermostat,
    van_der_pol,
)

PLAIN = mi.Options(engine="interpreted", method="dop853")


def find(system, **settings):
    return mi.find_orbit(system, **settings)


@pytest.fixture(scope="module")
def stick_slip():
    return find(belt())


def test_stick_slip_on_a_belt_has_the_period_of_the_closed_form(stick_slip):
    assert stick_slip.period == pytest.approx(belt_period(0.3, 0.4), abs=1e-12)
    assert stick_slip.stable
    assert stick_slip.admissible
    # All that is disturbed is gone where the block sticks.
    np.testing.assert_allclose(stick_slip.multipliers, [0.0], atol=1e-12)
    assert sorted(stick_slip.events["event"]) == ["break-away", "stick"]
    assert stick_slip.segments["ends with"].iloc[-1] == "period ends"


def test_a_run_finds_its_cycle(stick_slip):
    run = mi.simulate(belt(), duration=30.0)
    assert find(run).period == pytest.approx(stick_slip.period, abs=1e-12)


def test_a_run_along_a_cycle_closes(stick_slip):
    run = mi.simulate(
        belt(), duration=stick_slip.period, initial=stick_slip.state, options=stick_slip.options
    )
    assert run.final.x == pytest.approx(stick_slip.state.x, abs=1e-9)
    assert run.final.v == pytest.approx(stick_slip.state.v, abs=1e-9)


def test_samples_of_a_cycle_lie_on_its_circle_while_it_slips(stick_slip):
    samples = stick_slip.samples(40)
    assert np.diff(samples["t"]) == pytest.approx(stick_slip.period / 40)
    slipping = samples[samples["mode"] == "slip"]
    radius = np.hypot(slipping["x"] - 0.6, slipping["v"])
    assert radius.to_numpy() == pytest.approx(0.5, abs=1e-9)


def test_the_period_along_a_branch_is_that_of_the_closed_form(stick_slip):
    branch = mi.continue_solution(stick_slip, "v", 0.1, steps=mi.StepControl(max_step=0.2))
    assert branch.ended == "v reached its bound"
    for orbit in branch.orbits:
        expected = belt_period(orbit.system.parameters["v"], 0.4)
        assert orbit.period == pytest.approx(expected, abs=1e-9)
        assert orbit.admissible
    # Where it sticks for longer than it slips, the cycle is begun there.
    assert {branch.orbits[i].state.mode for i in (0, -1)} == {"slip", "stick"}


@pytest.mark.slow
def test_a_thermostat_has_the_period_of_the_closed_form():
    orbit = find(thermostat())
    assert orbit.period == pytest.approx(2.0 * math.log(2.0), abs=1e-12)
    np.testing.assert_array_equal(orbit.multipliers, [0.0])


def monodromy(flow, jacobian, guess, period):
    """Period and multipliers of a cycle by shooting on SciPy's DOP853, in the section of y0."""
    n = len(guess)

    def over(u):
        def columns(t, z):
            return np.concatenate([flow(z[:n]), (jacobian(z[:n]) @ z[n:].reshape(n, n)).ravel()])

        z = np.concatenate([u[:n], np.eye(n).ravel()])
        end = solve_ivp(columns, (0.0, u[n]), z, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
        return end[:n], end[n:].reshape(n, n)

    across = flow(np.asarray(guess))

    def equations(u):
        return [*(over(u)[0] - u[:n]), across @ (u[:n] - guess)]

    solution = root(equations, [*guess, period], tol=1e-13).x
    values = np.linalg.eigvals(over(solution)[1])
    return solution[n], values[np.argsort(np.abs(values - 1.0))][1:]


@pytest.fixture(scope="module")
def doubling():
    branch = mi.continue_solution(
        find(roessler(), transient=100.0), "c", 3.0, steps=mi.StepControl(max_step=0.1)
    )
    (special,) = branch.special_points
    return special


@pytest.mark.nightly
def test_a_period_doubling_against_scipy(doubling):
    def worst(c):
        def flow(y):
            return np.array([-y[1] - y[2], y[0] + 0.2 * y[1], 0.2 + y[2] * (y[0] - c)])

        def jacobian(y):
            return np.array([[0.0, -1.0, -1.0], [1.0, 0.2, 0.0], [y[2], 0.0, y[0] - c]])

        state = doubling.orbit.state
        guess = np.array([state.x, state.y, state.z])
        values = monodromy(flow, jacobian, guess, doubling.orbit.period)[1]
        return float(np.min(values.real)) + 1.0

    assert doubling.label == "PD"
    expected = brentq(worst, 2.83, 2.835, xtol=1e-12)
    assert doubling.value == pytest.approx(expected, abs=1e-9)


@pytest.mark.nightly
def test_folds_of_cycles_and_the_equilibrium_that_they_shrink_to():
    """mu + r^2 - r^4 = 0 turns where r^2 = 1/2 and mu = -1/4, and comes to r = 0 at mu = 0."""
    orbit = find(spiral(0.5))
    assert orbit.period == pytest.approx(2.0 * math.pi, abs=1e-11)
    square = orbit.state.x**2 + orbit.state.y**2
    rate = 2.0 * square - 4.0 * square**2  # of r, by r
    assert orbit.multipliers[0] == pytest.approx(math.exp(2.0 * math.pi * rate), abs=1e-10)
    branch = mi.continue_solution(orbit, "mu", -0.5, steps=mi.StepControl(max_step=0.1))
    (fold,) = branch.special_points
    assert fold.label == "CF"
    assert fold.value == pytest.approx(-0.25, abs=1e-10)
    assert fold.solution.multipliers[0] == pytest.approx(1.0, abs=1e-7)
    assert "shrinks to an equilibrium" in branch.ended
    last = branch.orbits[-1]
    assert not last.stable
    assert last.system.parameters["mu"] == pytest.approx(0.0, abs=1e-9)


def test_a_small_cycle_far_from_the_origin_is_no_double_cover():
    """A radius of 1e-3 around (10, 10): the states half a period apart are almost equal."""

    def flow(mode, t, y, p):
        x, v = y.x - 10.0, y.v - 10.0
        rate = p.mu - x * x - v * v
        return rate * x - v, rate * v + x

    system = mi.System(states=("x", "v"), flow=flow, parameters={"mu": 1e-6}, time_scale=1.0)
    orbit = find(system, guess={"x": 10.001, "v": 10.0}, transient=0.0)
    assert math.hypot(orbit.state.x - 10.0, orbit.state.v - 10.0) == pytest.approx(1e-3, rel=1e-4)
    assert not is_double_cover(orbit.numeric)


@pytest.mark.nightly
def test_a_curve_of_folds_of_cycles():
    """mu + k r^2 - r^4 = 0 turns where mu = -k^2/4."""
    steps = mi.StepControl(max_step=0.1)
    branch = mi.continue_solution(find(spiral(0.5)), "mu", -0.5, steps=steps)
    (fold,) = branch.special_points
    curve = mi.continue_curve(fold, "k", 2.0, steps=steps)
    for table in (branch.table, branch.special_table, curve.table):
        assert table["period"].to_numpy() == pytest.approx(2.0 * math.pi, abs=1e-9)
    assert curve.ended == "k reached its bound"
    np.testing.assert_allclose(curve.table["mu"], -0.25 * curve.table["k"] ** 2, atol=1e-9)


@pytest.mark.slow
def test_a_cycle_grazes_a_wall_and_continues_with_an_impact():
    free = find(van_der_pol(wall=2.2))
    branch = mi.continue_solution(free, "wall", 1.8, steps=mi.StepControl(max_step=0.1))
    (grazing,) = branch.special_points
    highest = find(van_der_pol()).samples(4000)["x"].max()
    assert grazing.label == "G"
    assert grazing.value == pytest.approx(highest, abs=1e-6)
    last = branch.orbits[-1]
    assert len(last.impacts) == 1
    assert last.admissible
    assert branch.table["x"].iloc[0] == pytest.approx(grazing.value, abs=1e-6)
    curve = mi.continue_curve(grazing, "mu", 1.5, steps=mi.StepControl(max_step=0.1))
    assert curve.ended == "mu reached its bound"
    assert not curve.special_points
    (tops,) = find(van_der_pol(mu=1.5)).shown_states["x"]
    assert curve.table["wall"].iloc[-1] == pytest.approx(tops, abs=1e-6)
    # The same orbit, found by itself.
    again = find(van_der_pol(wall=1.8))
    assert again.period == pytest.approx(last.period, abs=1e-9)
    np.testing.assert_allclose(again.multipliers, last.multipliers, atol=1e-8)


@pytest.mark.nightly
def test_what_comes_to_rest_or_does_not_return_is_reported():
    with pytest.raises(mi.OrbitError, match="an equilibrium was reached") as caught:
        find(spiral(-0.5))
    assert abs(caught.value.partial.x) < 1e-3
    with pytest.raises(mi.InvalidParameter, match="no forcing period"):
        find(belt(), periods=1)
    with pytest.raises(mi.InvalidParameter, match="a finite number > 0"):
        find(belt(), period=-1.0)


def test_a_period_that_is_not_there_is_reported():
    with pytest.raises(mi.InvalidParameter, match="no function of the system depends on t"):
        find(van_der_pol(period=3.0), options=PLAIN)


def test_a_cycle_is_stored_shown_and_drawn(stick_slip, tmp_path):
    stick_slip.save(tmp_path / "cycle.zip")
    assert mi.load(tmp_path / "cycle.zip", system=belt()) == stick_slip
    assert pickle.loads(pickle.dumps(stick_slip)) == stick_slip
    assert "period=7.09526" in repr(stick_slip)
    assert stick_slip.summary()["period [s]"] == stick_slip.period
    # The farthest that it comes: the right end of its circle, at the speed of the belt at most.
    shown = {name: values.tolist() for name, values in stick_slip.shown_states.items()}
    assert shown == {"x": pytest.approx([1.1], rel=1e-8), "v": pytest.approx([0.3], rel=1e-8)}
    axes = mi.plot_orbit(stick_slip)
    assert "cycle begins" in axes.get_legend_handles_labels()[1]


def test_a_period_that_is_given_is_where_newton_begins(stick_slip):
    start = stick_slip.state.replace(x=stick_slip.state.x + 1e-3)
    found = find(belt(), guess=start, period=7.0)
    assert found.period == pytest.approx(stick_slip.period, abs=1e-12)
    twice = find(belt(), guess=start, period=2.0 * stick_slip.period)
    assert twice.period == pytest.approx(stick_slip.period, abs=1e-12)
