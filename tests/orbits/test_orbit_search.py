"""Finding orbits: of the actuator, with rest and chatter, and from hopeless input."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

import mems_impact as mi
from mems_impact.errors import InvalidParameter, OrbitError, RunError
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.integrators.options import Options
from mems_impact.orbits.orbit_search import find_cycle, find_periodic_orbit
from mems_impact.orbits.periodic_orbit import make_orbit
from mems_impact.orbits.shooting import Shooting
from mems_impact.orbits.signature import BOUNDARY, Segment, _transitions, read_guess
from tests.continuation import free_block
from tests.hybrid.systems import BALL, ball, problem
from tests.orbits.audit import check_closed
from tests.orbits.families import (
    FunctionFamily,
    actuator,
    actuator_orbit,
    at,
    oscillator,
    silent_orbit,
    table,
)


@pytest.mark.parametrize(
    ("amplitude", "omega"), [(0.24, 0.5), (0.177, 0.485), (0.29, 0.45)], ids=str
)
def test_period_one_orbits_of_the_paper(amplitude, omega):
    orbit = actuator_orbit(amplitude, omega)
    assert orbit.stable
    assert orbit.admissible
    assert orbit.residual < 1e-9
    assert check_closed(orbit) < 2e-9
    assert [segment.code for segment in orbit.segments] == [0, 3, -1]
    before = orbit.family.problem()
    step = run(before, orbit.instant, 1).final.y[0]
    assert orbit.advance == pytest.approx([step], abs=1e-11)


def test_orbit_without_impacts_agrees_with_dop853():
    orbit = silent_orbit(0.16, 0.5)
    state, monodromy = free_block.orbit(0.16, 0.5, orbit.state[2:])
    np.testing.assert_allclose(orbit.state[2:], state, atol=1e-10)
    np.testing.assert_allclose(orbit.reduced_monodromy(), monodromy, atol=1e-9)


def test_unstable_orbit_without_impacts_is_found_from_a_near_guess():
    # Beyond the fold at 0.1045, the middle one of three orbits.
    state, _ = free_block.orbit(0.23, 0.45, np.array([0.20, 0.05]))
    orbit = find_periodic_orbit(actuator(0.23, 0.45), at((0.0, 0.0, *state)))
    np.testing.assert_allclose(orbit.state[2:], state, atol=1e-9)


def test_a_segment_that_no_switch_ends_names_none():
    assert Segment(0, 0, BOUNDARY) == Segment(0, 0, BOUNDARY, -1)


@pytest.mark.nightly
@pytest.mark.parametrize("periods", [1, 2, 3])
def test_an_orbit_under_a_square_wave_is_cut_at_every_switch(periods):
    """Without impacts: half a period later it is its own negative."""
    omega, amplitude, c = 0.7, 0.3, 0.1
    half = expm(np.array([[0.0, 1.0], [-1.0, -c]]) * math.pi / omega)
    pulled = np.array([amplitude, 0.0])
    start = np.linalg.solve(np.eye(2) + half, (half - np.eye(2)) @ pulled)
    family = oscillator(c=c, square=1.0, amplitude=amplitude, omega=omega, d=10.0)
    orbit = find_periodic_orbit(family, at(start + 1e-4), periods=periods)
    assert [segment.switch for segment in orbit.segments] == [0, 1] * periods
    assert orbit.state == pytest.approx(start, abs=1e-10)
    expected = np.linalg.eigvals(np.linalg.matrix_power(half, 2 * periods))
    np.testing.assert_allclose(
        np.sort_complex(orbit.multipliers), np.sort_complex(expected), atol=1e-9
    )


@pytest.mark.parametrize("periods", [2, 3])
def test_an_orbit_is_one_of_more_periods_too(periods):
    once = actuator_orbit(0.24, 0.5)
    often = actuator_orbit(0.24, 0.5, periods=periods)
    assert often.periods == periods
    assert len(often.segments) == periods * len(once.segments)
    expected = once.multipliers**periods
    np.testing.assert_allclose(
        np.sort_complex(often.multipliers), np.sort_complex(expected), atol=1e-8
    )
    assert often.advance == pytest.approx(periods * once.advance, abs=1e-10)


def test_unstable_orbit_inside_a_chaotic_attractor():
    # What a chaotic run happens to be near to is no guess: the stable orbit beyond it is one.
    guess = actuator_orbit(0.29, 0.45).instant
    orbit = find_periodic_orbit(actuator(0.25, 0.45), guess, transient=0)
    assert not orbit.stable
    assert orbit.admissible
    assert check_closed(orbit) < 1e-9


# Rest and chatter.


@pytest.mark.slow
@pytest.mark.parametrize(
    ("amplitude", "omega", "e"), [(1.5, 1.0, 0.5), (1.5, 1.0, 0.3), (1.5, 2.0, 0.5)], ids=str
)
def test_ball_that_bounces_itself_to_rest(amplitude, omega, e):
    family = table(amplitude=amplitude, omega=omega, e=e)
    orbit = find_periodic_orbit(family, at((0.0, 0.0), mode=1), transient=50)
    codes = [segment.code for segment in orbit.segments]
    assert 2 in codes  # the last of a sequence of impacts
    assert 1 in codes  # release
    release = orbit.point.ends[codes.index(1)]
    assert -math.cos(omega * release) * amplitude == pytest.approx(1.0, abs=1e-9)
    assert orbit.admissible
    assert np.abs(orbit.multipliers).max() < 1e-12
    assert check_closed(orbit) < 1e-9


def test_oscillator_that_is_pressed_against_its_stop():
    orbit = find_periodic_orbit(
        oscillator(amplitude=1.3, omega=0.2, e=0.5), at((0.0, 0.0)), transient=50
    )
    assert {segment.mode for segment in orbit.segments} == {0, 1}
    assert orbit.admissible
    assert check_closed(orbit) < 1e-9


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("amplitude", "omega"),
    [(0.4, 0.1), pytest.param(0.4, 0.05, marks=pytest.mark.slow), (0.45, 0.1)],
    ids=str,
)
def test_actuator_whose_block_rests_on_the_stopper(amplitude, omega):
    # Between two of the last impacts the frame slips and stops: both are in the signature.
    orbit = actuator_orbit(amplitude, omega, transient=50)
    codes = [segment.code for segment in orbit.segments]
    assert 5 in codes
    assert {segment.mode for segment in orbit.segments} == {0, 1, 3, 4}
    assert orbit.admissible, orbit.defects
    assert orbit.residual < 1e-9
    assert check_closed(orbit) < 1e-9
    assert np.all(np.abs(orbit.multipliers) < 1e-9)


@pytest.mark.slow
def test_derivative_through_chatter_and_rest():
    start = actuator_orbit(0.4, 0.05, transient=50, active=("amplitude",))
    point = start.point
    derivative = -np.linalg.solve(point.jacobian, point.by_parameter)[:, 0]

    def unknowns(shift):
        family = start.family.at(amplitude=0.4 + shift)
        return find_periodic_orbit(family, start.instant, transient=3).point.unknowns

    h = 2e-6
    difference = (unknowns(h) - unknowns(-h)) / (2.0 * h)
    assert difference.shape == derivative.shape
    # States at the start of a period and after the rest; the time of release.
    places = [1, 2, -1]
    np.testing.assert_allclose(derivative[places], difference[places], rtol=3e-6, atol=1e-6)


# Systems without drive.


def test_equilibrium_of_a_system_without_drive():
    orbit = find_periodic_orbit(oscillator(amplitude=0.0), at((0.3, 0.0)))
    np.testing.assert_allclose(orbit.state, [0.0, 0.0], atol=1e-12)
    decay = math.exp(-0.05 * 2.0 * math.pi)
    np.testing.assert_allclose(np.abs(orbit.multipliers), decay, atol=1e-9)


def test_centre_has_multipliers_one():
    orbit = find_periodic_orbit(oscillator(amplitude=0.0, c=0.0), at((0.3, 0.0)))
    np.testing.assert_allclose(orbit.multipliers, [1.0, 1.0], atol=1e-9)


def test_ball_that_lies_still():
    orbit = find_periodic_orbit(table(), at((0.0, 0.0), mode=1))
    np.testing.assert_allclose(orbit.multipliers, 1.0)  # it may lie anywhere
    assert orbit.admissible


# Hopeless input.


def test_guess_far_from_any_orbit_keeps_what_was_computed():
    with pytest.raises(OrbitError, match="closer to an orbit") as caught:
        find_periodic_orbit(actuator(0.24, 0.5), at((0.0, 0.0, 0.0, 3.0)))
    assert caught.value.partial is not None
    assert caught.value.remedy


@pytest.mark.parametrize("e", [0.5, 0.8])
def test_fall_without_drive_is_no_orbit(e):
    with pytest.raises(OrbitError):
        find_periodic_orbit(table(e=e), at((1.0, 0.0)))


@pytest.mark.parametrize("periods", [0, -1])
def test_periods_are_one_or_more(periods):
    with pytest.raises(InvalidParameter, match="periods"):
        find_periodic_orbit(actuator(0.24, 0.5), at((0.0, 0.0, 0.0, 0.3)), periods=periods)


def test_unknown_parameter_is_named():
    with pytest.raises(InvalidParameter, match="voltage"):
        find_periodic_orbit(actuator(0.24, 0.5), at((0.0, 0.0, 0.0, 0.3)), active=("voltage",))


def test_guess_beyond_a_stopper_is_refused():
    with pytest.raises(RunError, match="beyond the guard 'right impact'"):
        find_periodic_orbit(actuator(0.24, 0.5), at((0.0, 0.0, 0.7, 0.1)))


@pytest.mark.parametrize("share", [0.05, 0.4, 0.5, 2.0, 2.5, 30.0])
def test_a_period_may_change_by_any_factor(share):
    orbit = find_periodic_orbit(
        oscillator(amplitude=0.1), at((0.0, 0.0)), transient=100, active=("omega",)
    )
    there = orbit.shooting.parameter_point(np.array([1.0 / share]))
    assert there.period == pytest.approx(share * 2.0 * math.pi)


@pytest.mark.parametrize("value", [0.301, 0.31, 0.5])
def test_a_period_that_jumps_is_refused(value):
    """A sine with a bias has twice the period of one without: that is no small change."""
    smooth = oscillator(amplitude=0.1, omega=1.0)

    def build(values):
        jumped = smooth.at(omega=values["omega"]).problem()
        whole = 2.0 if values["omega"] > 1.3 else 1.0
        return replace(jumped, period=whole * jumped.period)

    family = FunctionFamily(dict(smooth.values), build)
    orbit = find_periodic_orbit(family, at((0.0, 0.0)), transient=100, active=("omega",))
    there = orbit.shooting.parameter_point(np.array([1.299]))
    assert there.period == pytest.approx(2.0 * math.pi / 1.299)
    with pytest.raises(OrbitError, match="period jumps"):
        orbit.shooting.parameter_point(np.array([1.0 + value]))


def test_a_margin_that_rises_from_zero_is_no_defect_and_from_below_is_one():
    """s' = 1 from 0 to 1, and again: the margin s - low has its smallest value where s begins."""
    saw = mi.System(
        states=("s", "y"),
        flow=lambda mode, t, y, p: (1.0, -y.y),
        parameters={"low": -0.5, "high": 2.0},
        guards=[
            mi.Guard(
                "top", lambda mode, t, y, p: 1.0 - y.s, lambda m, t, y, p: (m, (0.0, y.y + 1))
            ),
            mi.Guard("low", lambda mode, t, y, p: y.s - p.low, lambda m, t, y, p: (m, (y.s, y.y))),
            mi.Guard("high", lambda m, t, y, p: p.high - y.s, lambda m, t, y, p: (m, (y.s, y.y))),
        ],
        initial={"s": 0.3},
    )
    options = Options(method="dop853", engine="interpreted", rtol=1e-11, atol=1e-13)
    start = saw.state_space.instant(None, saw.problem(options))
    orbit = find_cycle(saw.family(options), start, transient=5.0)
    np.testing.assert_allclose(orbit.multipliers, [math.exp(-1.0)], atol=1e-9)

    def defects(**changes):
        family, shooting = orbit.family.at(**changes), orbit.shooting
        other = Shooting(family, orbit.segments, (), shooting.pinned, shooting.phase)
        point = other.evaluate(orbit.point.unknowns, np.empty(0))
        return [(each.guard, each.kind, each.value) for each in make_orbit(other, point).defects]

    assert orbit.admissible
    assert defects(low=1e-8) == []  # an event leaves a margin at zero, but for rounding
    for low in (1e-5, 0.1):
        assert defects(low=low) == [("low", "missed", pytest.approx(-low, abs=1e-12))]
    assert defects(high=1.0 + 5e-10) == defects(high=1.0 - 5e-10) == []
    assert defects(high=1.0 - 1e-8) == [("high", "missed", pytest.approx(-1e-8, abs=1e-11))]


def test_a_segment_that_ends_before_it_starts_is_a_defect_of_this_length():
    orbit = actuator_orbit(0.24, 0.5)
    unknowns = orbit.point.unknowns.copy()
    unknowns[unknowns == orbit.point.ends[1]] = orbit.point.starts[1] - 0.01
    point = orbit.shooting.evaluate(unknowns, np.empty(0))
    (defect,) = make_orbit(orbit.shooting, point).defects
    assert (defect.segment, defect.kind) == (1, "order")
    assert defect.value == pytest.approx(-0.01, abs=1e-12)


@pytest.mark.parametrize("period", [0.5, 1.0, 4.0])
def test_transitions_are_timed_from_the_start_across_periods(period):
    """A ball that falls from 1: after sqrt 2, and twice that after an impact with e = 1."""
    falls = problem(BALL, ball(1.0), period=period, engine="interpreted")
    start = at((1.0, 0.0), time=0.25 * period, cycle=3)
    times = [each.time - start.time for each in _transitions(falls, start, 5.0)]
    assert times == pytest.approx([math.sqrt(2.0), 3.0 * math.sqrt(2.0)], rel=1e-9)


def test_two_transitions_in_one_instant_are_no_signature():
    """The second guard of a mode that the first leads to fires where it does."""

    def flow(mode, t, y, p, dy):
        dy[0] = 1.0

    def margins(mode, t, y, p, g, r):
        if mode < 2:
            g[mode], r[mode] = 0.5 - y[0], -1.0

    automaton = Automaton(
        states=("x",),
        modes=("first", "second", "third"),
        guards=(Guard("one", order=0), Guard("two", order=1)),
        flow=flow,
        margins=margins,
        transition=lambda mode, code, t, y, p: code + 1,
    )
    options = Options(method="dop853", engine="interpreted")
    problem = Problem(automaton=automaton, parameters=np.zeros(1), period=1.0, options=options)
    with pytest.raises(OrbitError, match=r"coincide at 0\.5 of"):
        read_guess(problem, at((0.0,)), 1)
