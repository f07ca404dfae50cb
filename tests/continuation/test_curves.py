"""Curves in two parameters, and where they meet, against DOP853 (`free_block`)."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from mems_impact.continuation.arclength import StepControl
from mems_impact.continuation.orbit_branch import follow
from mems_impact.continuation.orbit_curve import follow_curve
from mems_impact.continuation.test_functions import MultiplierTest
from mems_impact.orbits.orbit_search import find_periodic_orbit
from tests.continuation import free_block
from tests.orbits.exact import Exact
from tests.orbits.families import FunctionFamily, at, oscillator, silent_orbit

LOW, HIGH = 0.43, 0.52


def special(found, kind):
    return [s for s in found.special_points if s.kind == kind]


@pytest.fixture(scope="module")
def at_half():
    return follow(silent_orbit(0.2, 0.5), "amplitude", low=0.1, high=0.3)


@pytest.fixture(scope="module")
def at_nine_twentieths():
    return follow(silent_orbit(0.16, 0.45), "amplitude", low=0.1, high=0.26)


@pytest.fixture(scope="module")
def grazing_curve(at_half):
    (start,) = special(at_half, "grazing")
    return follow_curve(start, "amplitude", "omega", low=0.47, high=HIGH, direction=-1)


# (t, f, omega): the orbit touches the stopper and has a multiplier +1; M_12 is zero there.
@pytest.fixture(scope="module")
def grazing_fold():
    guess = (1.195, 0.1768, 0.4803)
    return free_block.grazing_with(lambda m: np.linalg.det(m - np.eye(2)), guess)


@pytest.fixture(scope="module")
def degenerate_grazing():
    return free_block.grazing_with(lambda m: m[0, 1], (1.607, 0.1711, 0.4878))


def test_codimension_two_by_dop853(grazing_fold, degenerate_grazing):
    assert grazing_fold[1:] == pytest.approx([0.17679567, 0.48027113], abs=1e-8)
    assert degenerate_grazing[1:] == pytest.approx([0.17106669, 0.48780870], abs=1e-8)


@pytest.mark.slow
def test_grazing_curve_passes_both_points(grazing_curve, grazing_fold, degenerate_grazing):
    kinds = [s.kind for s in grazing_curve.special_points]
    assert kinds == ["degenerate grazing", "grazing-fold"]
    degenerate, fold = grazing_curve.special_points
    np.testing.assert_allclose(fold.values, grazing_fold[1:], atol=1e-8)
    np.testing.assert_allclose(degenerate.values, degenerate_grazing[1:], atol=1e-8)
    assert grazing_curve.ended == "omega reached its bound"
    assert grazing_curve.values(grazing_curve.points[-1])[1] == pytest.approx(0.47, abs=1e-12)


def test_a_step_of_a_curve_that_is_too_long_is_halved(at_half):
    """As often as it must be, and no more often."""
    (start,) = special(at_half, "grazing")
    steps = StepControl(initial_step=0.16, max_step=0.8)
    curve = follow_curve(start, "amplitude", "omega", low=LOW, high=HIGH, steps=steps)
    assert curve.ended == "omega reached its bound"
    assert len(curve.points) < 8
    first, second = (np.append(p.point.unknowns, curve.values(p)) for p in curve.points[:2])
    halvings = np.log2(steps.initial_step / np.linalg.norm(second - first))
    assert halvings > 0.98
    assert halvings == pytest.approx(round(halvings), abs=0.02)


def test_steps_of_a_curve_grow_by_a_half(at_half):
    (start,) = special(at_half, "grazing")
    steps = StepControl(initial_step=1e-3, max_step=0.8, max_points=4)
    curve = follow_curve(start, "amplitude", "omega", low=LOW, high=HIGH, steps=steps)
    points = [np.append(p.point.unknowns, curve.values(p)) for p in curve.points]
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert lengths == pytest.approx([1e-3, 1.5e-3, 2.25e-3], rel=0.02)


@pytest.mark.nightly
def test_fold_curve_of_impacting_orbits_ends_at_the_degenerate_grazing(at_half, degenerate_grazing):
    (start,) = special(at_half, "fold")
    curve = follow_curve(start, "amplitude", "omega", low=LOW, high=HIGH, direction=-1)
    assert "degenerate grazing" in curve.ended
    assert curve.values(curve.points[-1]) == pytest.approx(degenerate_grazing[1:], abs=1e-6)


def test_fold_curve_of_impacting_orbits_reaches_its_bound(at_half):
    (start,) = special(at_half, "fold")
    curve = follow_curve(start, "amplitude", "omega", low=LOW, high=HIGH, direction=1)
    assert curve.ended == "omega reached its bound"
    assert curve.values(curve.points[-1])[1] == pytest.approx(HIGH, abs=1e-12)


@pytest.mark.nightly
def test_fold_curve_of_silent_orbits_ends_at_the_grazing_fold(at_nine_twentieths, grazing_fold):
    (start,) = special(at_nine_twentieths, "fold")
    curve = follow_curve(start, "amplitude", "omega", low=LOW, high=HIGH, direction=1)
    (found,) = special(curve, "grazing-fold")
    np.testing.assert_allclose(found.values, grazing_fold[1:], atol=1e-8)
    assert "grazing-fold" in curve.ended
    for point in curve.points[:-1:4]:
        f, omega = curve.values(point)
        expected = free_block.fold(omega, (*point.state[2:], f))
        assert f == pytest.approx(expected[2], abs=1e-9)


# The linear oscillator, where the curves are in closed form.


def test_multipliers_of_plus_and_minus_one_in_closed_form():
    """Along a curve of the oscillator off its stop: det(M - 1), det(M + 1) in parts of one."""
    c, k, omega = 0.1, 9.0, 0.8
    compiled = oscillator(amplitude=0.1, omega=omega, c=c, k=k)

    def interpreted(values):
        made = compiled.at(**values).problem()
        return replace(made, options=replace(made.options, engine="interpreted", method="dop853"))

    family = FunctionFamily(compiled.values, interpreted)
    orbit = find_periodic_orbit(family, at((0.1, 0.0)), transient=10)
    shooting = orbit.equations(("amplitude", "omega"))
    point = shooting.evaluate(orbit.point.unknowns, np.array([0.1, omega]))
    matrix = expm(np.array([[0.0, 1.0], [-k, -c]]) * 2.0 * np.pi / omega)
    size = float(np.prod(1.0 + np.abs(np.linalg.eigvals(matrix))))
    for test, multiplier in (("multiplier +1", 1.0), ("multiplier -1", -1.0)):
        expected = np.linalg.det(matrix - multiplier * np.eye(2)) / size
        value = MultiplierTest("grazing", test).value(shooting, point, np.zeros(1))
        assert value == pytest.approx(expected, abs=1e-9)


@pytest.mark.slow
def test_fold_curve_in_closed_form():
    exact = Exact(omega=1.3)
    start = exact.orbit(1.2 * exact.fold_speed())
    family = oscillator(amplitude=start.amplitude, omega=1.3)
    orbit = find_periodic_orbit(family, at((1.0, -0.8 * start.speed), time=start.time))
    branch = follow(orbit, "amplitude", low=0.1, high=0.3, direction=-1)
    for direction, bound in ((-1.0, 1.15), (1.0, 1.5)):
        curve = follow_curve(
            special(branch, "fold")[0],
            "amplitude",
            "omega",
            low=1.15,
            high=1.5,
            direction=direction,
        )
        assert curve.ended == "omega reached its bound"
        assert curve.values(curve.points[-1])[1] == pytest.approx(bound, abs=1e-12)
        for point in curve.points:
            amplitude, omega = curve.values(point)
            assert amplitude == pytest.approx(Exact(omega=omega).fold(), abs=1e-9)


@pytest.mark.nightly
def test_curve_of_period_doublings_in_closed_form():
    exact = Exact(omega=2.1)
    start = exact.orbit(0.9 * exact.doubling_speed())
    family = oscillator(amplitude=start.amplitude, omega=2.1)
    orbit = find_periodic_orbit(family, at((1.0, -0.8 * start.speed), time=start.time))
    branch = follow(orbit, "amplitude", low=3.0, high=4.0)
    curve = follow_curve(
        special(branch, "period-doubling")[0], "amplitude", "omega", low=2.05, high=2.2
    )
    assert curve.ended == "omega reached its bound"
    for point in curve.points:
        amplitude, omega = curve.values(point)
        assert amplitude == pytest.approx(Exact(omega=omega).doubling(), abs=1e-8)


@pytest.mark.parametrize(("second", "bound"), [("omega", 1.7), ("c", 0.3), ("d", 1.4)])
@pytest.mark.nightly
def test_grazing_curve_in_closed_form(second, bound):
    exact = Exact(omega=1.3)
    orbit = find_periodic_orbit(oscillator(amplitude=0.3, omega=1.3), at((0.0, 0.0)), transient=300)
    branch = follow(orbit, "amplitude", low=0.2, high=0.72)
    curve = follow_curve(special(branch, "grazing")[0], "amplitude", second, low=0.01, high=bound)
    assert curve.values(curve.points[-1])[1] == pytest.approx(bound, abs=1e-12)
    for point in curve.points:
        amplitude, value = curve.values(point)
        values = {"omega": exact.omega, "c": exact.c, "d": exact.d, second: value}
        assert amplitude == pytest.approx(Exact(**values).graze, abs=1e-9)
