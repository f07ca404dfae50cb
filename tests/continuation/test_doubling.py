"""Orbits of period two and four, by branch switching and by simulation."""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.continuation.branch_switching import (
    first_orbit_on_branch,
    switch_at_period_doubling,
)
from mems_impact.continuation.orbit_branch import follow
from mems_impact.errors import OrbitError
from mems_impact.hybrid.simulation import run
from mems_impact.orbits.orbit_search import find_periodic_orbit
from tests.orbits.audit import check_closed
from tests.orbits.exact import Exact
from tests.orbits.families import actuator, actuator_orbit, at, oscillator, silent_orbit

pytestmark = pytest.mark.nightly

DOUBLING = 0.176318773  # at omega = 0.485


def special(branch, kind):
    return [s for s in branch.special_points if s.kind == kind]


@pytest.fixture(scope="module")
def doubling():
    branch = follow(actuator_orbit(0.177, 0.485), "amplitude", low=0.172, high=0.18, direction=-1)
    (found,) = special(branch, "period-doubling")
    assert found.value == pytest.approx(DOUBLING, abs=1e-9)
    return found


@pytest.fixture(scope="module")
def period_two(doubling):
    orbit = switch_at_period_doubling(doubling.solution, "amplitude")[0]
    return follow(orbit, "amplitude", low=0.1755, high=0.177)


def test_the_period_doubles(doubling):
    orbit, away = switch_at_period_doubling(doubling.solution, "amplitude")
    assert orbit.periods == 2
    assert orbit.admissible
    assert check_closed(orbit) < 1e-8
    speeds = [before[3] for _, _, before in orbit.impacts]
    assert len(speeds) == 2
    assert abs(speeds[0] - speeds[1]) > 1e-5
    assert np.abs(orbit.multipliers - 1.0).min() < 1e-3  # (-1)^2, hardly moved
    assert away[-1] == orbit.family.values["amplitude"] - doubling.value


def test_the_doubling_at_this_frequency_is_subcritical(doubling, period_two):
    """Period two leaves towards larger f, unstable, and turns stable where an impact is lost."""
    first = period_two.points[0]
    assert first.value > doubling.value
    assert not first.solution.stable
    grazing = special(period_two, "grazing")[0]
    assert grazing.value > doubling.value
    stable = [p.solution for p in period_two.points if p.piece == 1 and p.solution.stable]
    assert stable
    for orbit in stable[:: max(1, len(stable) // 4)]:
        assert len(orbit.impacts) == 1
        assert orbit.admissible
        simulated = run(orbit.family.problem(), orbit.instant, 400).final.y
        np.testing.assert_allclose(simulated[1:], orbit.state[1:], atol=1e-8)


def test_period_four(period_two):
    second = special(period_two, "period-doubling")[0]
    orbit = switch_at_period_doubling(second.solution, "amplitude")[0]
    assert orbit.periods == 4
    assert check_closed(orbit) < 1e-7


@pytest.mark.parametrize("omega", [0.7, 0.8, 2.1])
def test_supercritical_doublings_of_the_linear_oscillator(omega):
    exact = Exact(omega=omega)
    start = exact.orbit(1.1 * exact.doubling_speed())
    family = oscillator(amplitude=start.amplitude, omega=omega)
    guess = at((1.0, -0.8 * start.speed), time=start.time)
    far = 0.9 * exact.doubling(), 1.1 * exact.doubling()
    branch = follow(
        find_periodic_orbit(family, guess), "amplitude", low=far[0], high=far[1], direction=-1
    )
    (found,) = special(branch, "period-doubling")
    orbit, towards = switch_at_period_doubling(found.solution, "amplitude")
    near = found.value * (1.0 - 1e-2), found.value * (1.0 + 1e-2)
    beyond = follow(orbit, "amplitude", low=near[0], high=near[1], direction=towards)
    stable = [
        p.solution
        for p in beyond.points
        if p.solution.admissible and np.abs(p.solution.multipliers).max() < 0.9
    ]
    assert stable
    assert beyond.ended == "amplitude reached its bound"
    for last in stable[1 :: max(1, len(stable) // 4)]:
        simulated = run(last.family.problem(), last.instant, 200).final.y
        np.testing.assert_allclose(simulated, last.state, atol=1e-8)


def test_an_orbit_that_does_not_double_is_refused():
    with pytest.raises(OrbitError, match="no multiplier -1"):
        switch_at_period_doubling(actuator_orbit(0.24, 0.5), "amplitude")


def test_a_doubled_branch_ends_in_the_doubling(doubling, period_two):
    """Followed back, it is not a fold, and it does not run back upon itself in the other phase."""
    start = period_two.points[min(5, len(period_two.points) - 1)].solution
    back = follow(start, "amplitude", low=0.17, high=0.18, direction=-1)
    (found,) = special(back, "period-doubling")
    assert found.label == "PD"
    assert found.value == pytest.approx(doubling.value, abs=1e-8)
    assert back.points[-1].value == found.value
    assert "half the period" in back.ended


def test_the_fold_of_an_orbit_of_half_the_period_is_a_fold():
    """The orbit without impacts, traversed twice: +1 over half the period, not -1."""
    twice = silent_orbit(0.23, 0.45, periods=2)
    assert twice.periods == 2
    branch = follow(twice, "amplitude", low=0.225, high=0.24)
    fold = branch.special_points[0]
    assert (fold.kind, fold.label) == ("fold", "CF")
    assert fold.value == pytest.approx(0.235565433578, abs=1e-9)
    assert "half the period" not in branch.ended


def test_what_is_listed_as_a_doubling_can_be_switched(doubling):
    """A multiplier within 1e-3 of -1 is one that is -1, for the list and for the switch."""
    beside = actuator(doubling.value - 1e-6, 0.485)
    near = find_periodic_orbit(beside, doubling.solution.instant, active=("amplitude",))
    assert 1e-4 < np.abs(near.multipliers + 1.0).min() < 1e-3
    assert switch_at_period_doubling(near, "amplitude")[0].periods == 2


def _double_well(mode, t, y, p):
    return y.v, p.A * math.cos(1.2 * t) - 0.3 * y.v + y.x - y.x**3


def test_a_branch_between_two_doublings_of_another_ends_at_either():
    """Its own period doubles so close to one end that a step contains both points.

    At each fold, where a multiplier is 1, another step contains a period doubling too: the product
    of the multipliers is that of Liouville, so that one of 5 becomes -3 only by way of 1 and -1.
    """
    system = mi.System(
        states=("x", "v"), flow=_double_well, period=2.0 * math.pi / 1.2,
        parameters={"A": 0.28}, initial={"x": 1.0},
    )  # fmt: skip
    orbit = mi.find_orbit(system, transient=200)
    assert orbit.periods == 2
    branch = mi.continue_solution(orbit, "A", 0.4757)
    ends = [special for special in branch.special_points if special.label == "PD"]
    assert ends[1].value - ends[0].value == pytest.approx(0.1889, abs=1e-4)
    labels = []
    for end in ends:
        doubled = mi.switch_branch(end, bounds=(0.25, 0.5))
        assert doubled.ended.startswith("the orbit of half the period")
        other = next(each for each in ends if each is not end)
        assert doubled.special_points[-1].value == pytest.approx(other.value, abs=1e-8)
        labels.append([(s.label, s.value) for s in doubled.special_points[:-1]])
    assert len(labels[0]) == 6
    values = [[value for _, value in each] for each in labels]
    assert values[0] == pytest.approx(values[1][::-1], abs=1e-8)
    doublings = [value for label, value in labels[0] if label == "PD"]
    for fold in (value for label, value in labels[0] if label == "CF"):
        assert min(abs(fold - each) for each in doublings) < 1e-6


ON, OFF = mi.modes("on", "off")


def _current(mode, t, y, p):
    return (p.E - p.r * y.i,) if mode == ON else (p.E - p.V - p.r * y.i,)


def _below_peak(mode, t, y, p):
    return 2.0 - y.i


def _switch_off(mode, t, y, p):
    return OFF, (y.i,)


def _clock(mode, t, y, p):
    return ON, (y.i,)


# A boost converter with a fixed output voltage and controlled peak current: a linear map.
BOOST = mi.System(
    states=("i",),
    flow=_current,
    period=0.1,
    switches=(0.1,),
    switch_transition=_clock,
    parameters={"E": 10.0, "V": 15.0, "r": 0.3},
    guards=[mi.Guard("peak", _below_peak, _switch_off, modes=(ON,))],
    initial=mi.State(i=1.0, mode=ON),
)


def test_orbits_of_twice_the_period_at_one_value_of_the_parameter_lead_to_others():
    """The orbits that double share one voltage, up to one with its peak current at the clock."""
    branch = mi.continue_solution(mi.find_orbit(BOOST, transient=100), "V", 25.0)
    (doubling,) = branch.special_points
    rise, decay = 10.0 - 0.3 * 2.0, math.exp(0.3 * 0.1)
    assert doubling.value == pytest.approx(rise * (1.0 + decay), abs=1e-9)
    twice = mi.switch_branch(doubling, bounds=(12.0, 25.0))
    collision, again = twice.special_points
    assert collision.kind == "peak"
    assert collision.value == pytest.approx(doubling.value, abs=1e-8)
    # Beyond it the current reaches its peak in every second period only.
    assert again.label == "PD"
    assert again.value == pytest.approx(rise * (1.0 + decay**2), abs=1e-8)
    assert twice.ended == "V reached its bound"


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_peak_at_the_start_of_either_period_is_passed(sign):
    """The two senses of the null vector at a doubling give one orbit, begun a period apart."""
    branch = mi.continue_solution(mi.find_orbit(BOOST, transient=100), "V", 25.0)
    special = branch.special_points[0].numeric
    orbit, away = switch_at_period_doubling(special.solution, "V")
    doubled = np.append(orbit.point.unknowns, special.value) - away
    orbit, away = first_orbit_on_branch(orbit.shooting, doubled, sign * away, (1.0,))
    twice = follow(orbit, "V", low=12.0, high=19.2, direction=away)
    assert [each.kind for each in twice.special_points] == ["peak"]
    assert twice.ended == "V reached its bound"


def test_the_doubling_of_a_linear_map_is_neither_super_nor_subcritical():
    """Rounding errors of its derivatives may agree by chance."""
    boost = BOOST.changed(E=20.0, V=24.0, r=1.0)
    branch = mi.continue_solution(mi.find_orbit(boost, transient=100), "V", 60.0)
    (doubling,) = branch.special_points
    assert doubling.label == "PD"
    assert doubling.criticality == ""
