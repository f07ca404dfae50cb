"""Branches of the linear impact oscillator against its closed forms: G, CF, PD to 1e-9."""

import numpy as np
import pytest
from scipy.optimize import brentq

from mems_impact.continuation.arclength import StepControl
from mems_impact.continuation.orbit_branch import follow
from mems_impact.orbits.orbit_search import find_periodic_orbit
from tests.orbits.exact import Exact
from tests.orbits.families import at, oscillator

pytestmark = pytest.mark.slow


def family(exact, amplitude):
    names = ("omega", "c", "k", "d", "e", "square")
    values = {name: getattr(exact, name) for name in names}
    return oscillator(amplitude=float(amplitude), **values)


def impacting(exact, expected):
    guess = at((exact.d, -exact.e * expected.speed), time=expected.time)
    return find_periodic_orbit(family(exact, expected.amplitude), guess, periods=exact.n)


def values(branch, kind):
    return [special.value for special in branch.special_points if special.kind == kind]


@pytest.mark.parametrize(
    "exact",
    [Exact(omega=0.8), Exact(omega=1.3), Exact(omega=2.1), Exact(omega=1.6, c=0.2, d=0.3, e=0.6)],
    ids=lambda exact: f"omega={exact.omega}",
)
def test_grazing_of_the_orbit_without_impacts(exact):
    expected = exact.graze
    orbit = find_periodic_orbit(family(exact, 0.5 * expected), at((0.0, 0.0)), transient=300)
    branch = follow(orbit, "amplitude", low=0.1 * expected, high=1.02 * expected)
    assert values(branch, "grazing")[0] == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("exact", [Exact(omega=1.3), Exact(omega=0.6)], ids=lambda x: f"{x.omega}")
def test_fold_in_the_amplitude(exact):
    start = exact.orbit(1.2 * exact.fold_speed())
    orbit = impacting(exact, start)
    low, high = 0.5 * exact.fold(), 1.01 * start.amplitude
    branch = follow(orbit, "amplitude", low=low, high=high, direction=-1)
    (fold,) = [s for s in branch.special_points if s.kind == "fold"]
    assert fold.value == pytest.approx(exact.fold(), abs=1e-9)
    assert fold.label == "CF"
    assert np.abs(fold.solution.multipliers - 1.0).min() < 1e-8
    assert fold.solution.impacts[0][2][1] == pytest.approx(exact.fold_speed(), abs=1e-6)
    stable = [p.solution.stable for p in branch.points if p.value > exact.fold() + 1e-6]
    assert stable[0]
    assert not stable[-1]


@pytest.mark.parametrize(
    "exact",
    [Exact(omega=0.8), Exact(omega=0.7), Exact(omega=2.1), Exact(omega=2.8, n=2)],
    ids=lambda exact: f"omega={exact.omega}, n={exact.n}",
)
def test_period_doubling_in_the_amplitude(exact):
    speed = exact.doubling_speed()
    for side in (0.9, 1.1):
        orbit = impacting(exact, exact.orbit(side * speed))
        branch = follow(
            orbit,
            "amplitude",
            low=0.3 * exact.doubling(),
            high=1.5 * exact.doubling(),
            direction=1.0 - side,
        )
        (doubling,) = [s for s in branch.special_points if s.kind == "period-doubling"]
        assert doubling.value == pytest.approx(exact.doubling(), abs=1e-9)
        assert doubling.label == "PD"
        assert np.abs(doubling.solution.multipliers + 1.0).min() < 1e-8


def test_from_the_grazing_to_the_fold_and_back_to_large_impacts():
    """One branch, without and with impacts: what a sweep shows as a jump with hysteresis."""
    exact = Exact(omega=1.3)
    orbit = find_periodic_orbit(family(exact, 0.3), at((0.0, 0.0)), transient=300)
    branch = follow(orbit, "amplitude", low=0.1, high=0.8)
    assert [s.kind for s in branch.special_points] == ["grazing", "fold"]
    assert branch.special_points[0].value == pytest.approx(exact.graze, abs=1e-9)
    assert branch.special_points[1].value == pytest.approx(exact.fold(), abs=1e-9)
    assert branch.ended == "amplitude reached its bound"
    assert branch.points[-1].value == pytest.approx(0.8, abs=1e-12)
    assert all(p.solution.admissible for p in branch.points)
    for point in branch.points:
        if point.solution.impacts and point.solution.impacts[0][2][1] > 1e-3:
            speed = point.solution.impacts[0][2][1]
            assert point.value == pytest.approx(exact.amplitude_at(speed), abs=1e-8)


@pytest.mark.parametrize("direction", [-1.0, 1.0])
def test_impact_that_wanders_across_the_start_of_the_period(direction):
    """At omega = 0.7 the impact falls on the start of the period where A = 0.5553364531."""
    exact = Exact(omega=0.7)
    start = exact.orbit(0.5 if direction < 0.0 else 0.2)
    orbit = impacting(exact, start)
    branch = follow(orbit, "amplitude", low=0.45, high=0.62, direction=direction)
    reached = [point.value for point in branch.points]
    assert min(reached) < 0.55 < 0.56 < max(reached)
    for point in branch.points:
        if point.solution.impacts and point.solution.impacts[0][2][1] > 1e-3:
            speed = point.solution.impacts[0][2][1]
            assert point.value == pytest.approx(exact.amplitude_at(speed), abs=1e-8)
            assert point.solution.admissible
    assert branch.ended == "amplitude reached its bound"


def test_closed_branch():
    """At A = 1 the orbits with one impact in two periods are a closed curve over omega."""

    def folds(omega):
        return Exact(omega=omega, n=2).fold() - 1.0

    expected = [brentq(folds, 2.1, 2.4, xtol=1e-14), brentq(folds, 2.5, 3.0, xtol=1e-14)]
    exact = Exact(omega=2.4, n=2)
    orbit = impacting(exact, exact.orbit(exact.speeds(1.0)[1]))
    for direction in (-1.0, 1.0):
        branch = follow(
            orbit,
            "omega",
            low=1.9,
            high=3.2,
            direction=direction,
            steps=StepControl(max_points=150),
        )
        found = values(branch, "fold")
        np.testing.assert_allclose(sorted(set(np.round(found, 8))), np.round(expected, 8))
        for value in found:
            assert np.abs(np.array(expected) - value).min() < 1e-9
        assert branch.ended == "the branch closed upon itself"
        ends = [np.append(p.solution.point.unknowns, p.value) for p in branch.points]
        assert np.linalg.norm(ends[-1] - ends[0]) <= StepControl().max_step
        assert len(found) == 2


# Square waves: where the drive switches, the amplitude is no smooth function of the impact's time.


@pytest.mark.parametrize(
    ("exact", "between", "kind"),
    [
        (Exact(omega=0.6, square=1.0), (1.71, 1.83), "fold"),
        (Exact(omega=0.8, square=1.0), (1.97, 2.06), "period-doubling"),
        (Exact(omega=2.4, square=1.0), (1.866, 1.898), "period-doubling"),
    ],
    ids=["CF 0.6", "PD 0.8", "PD 2.4"],
)
def test_special_points_under_a_square_wave(exact, between, kind):
    time = (exact.fold_time if kind == "fold" else exact.doubling_time)(*between)
    expected = exact.orbit_at(time).amplitude
    for shift in (-0.005, 0.005):
        start = exact.orbit_at(time + shift)
        orbit = impacting(exact, start)
        found = []
        for direction in (-1.0, 1.0):
            branch = follow(
                orbit,
                "amplitude",
                low=0.98 * min(expected, start.amplitude),
                high=1.02 * max(expected, start.amplitude),
                direction=direction,
            )
            found += values(branch, kind)
        assert len(found) == 1
        assert found[0] == pytest.approx(expected, abs=1e-9)


def test_grazing_under_a_square_wave():
    exact = Exact(omega=0.8, square=1.0)
    turn = brentq(lambda t: exact.steady(t)[1], 2.0, 0.5 * exact.period - 0.1, xtol=1e-15)
    expected = 1.0 / exact.steady(turn)[0]
    orbit = find_periodic_orbit(family(exact, 0.2), at((0.0, 0.0)), transient=300)
    branch = follow(orbit, "amplitude", low=0.1, high=0.3)
    assert values(branch, "grazing")[0] == pytest.approx(expected, abs=1e-10)


def test_period_doubling_in_the_frequency_of_a_square_wave():
    there = Exact(omega=2.4, square=1.0)
    amplitude = there.orbit_at(there.doubling_time(1.866, 1.898)).amplitude
    beside = Exact(omega=2.42, square=1.0)

    def difference(t):
        return beside.orbit_at(t).amplitude - amplitude

    start = beside.orbit_at(brentq(difference, 1.85, 1.95, xtol=1e-15))
    branch = follow(impacting(beside, start), "omega", low=2.37, high=2.43, direction=-1)
    assert branch.ended == "omega reached its bound"
    assert values(branch, "period-doubling") == pytest.approx([2.4], abs=1e-9)


def test_a_branch_crosses_octaves_of_the_period():
    """The amplitude of an oscillator without a wall, from a tenth of the resonance to thrice it."""
    far = {"amplitude": 0.3, "c": 0.1, "d": 100.0}
    orbit = find_periodic_orbit(oscillator(omega=0.8, **far), at((0.0, 0.0)), transient=300)
    for low, high, direction in ((0.8, 3.0, 1), (0.1, 0.8, -1)):
        branch = follow(orbit, "omega", low=low, high=high, direction=direction)
        assert branch.ended == "omega reached its bound"
        for point in branch.points[:: max(1, len(branch.points) // 20)]:
            w = point.value
            exact = 0.3 / np.hypot(1.0 - w * w, 0.1 * w)
            x, v = point.solution.state
            assert np.hypot(x, v / w) == pytest.approx(exact, rel=1e-9)
