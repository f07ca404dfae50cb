"""Orbits of period two and four, by branch switching and by simulation."""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.continuation.branch_switching import (
    switch_at_period_doubling,
)
from mems_impact.continuation.orbit_branch import follow
from mems_impact.hybrid.simulation import run
from mems_impact.orbits.orbit_search import find_periodic_orbit
from tests.orbits.exact import Exact
from tests.orbits.families import actuator_orbit, at, oscillator

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


def test_the_doubling_of_a_linear_map_is_neither_super_nor_subcritical():
    """Rounding errors of its derivatives may agree by chance."""
    boost = BOOST.changed(E=20.0, V=24.0, r=1.0)
    branch = mi.continue_solution(mi.find_orbit(boost, transient=100), "V", 60.0)
    (doubling,) = branch.special_points
    assert doubling.label == "PD"
    assert doubling.criticality == ""
