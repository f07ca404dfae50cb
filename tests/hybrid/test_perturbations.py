"""What arcs and events do to perturbations, against differences of whole runs."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.variational.lyapunov import (
    LyapunovIntegrator,
    largest,
    standard_errors,
)
from tests.analysis.systems import oscillator

FAST = mi.Options(method="dop853", rtol=1e-12, atol=1e-14)
PLAIN = mi.Options(method="dop853", rtol=1e-12, atol=1e-14, engine="interpreted")


def carried(problem, start, periods, column, h=1e-5):
    """Return what becomes of a perturbation, by differences of neighbouring runs (fourth order)."""
    ahead, far, back, behind = (
        run(problem, replace(start, y=start.y + shift * column), periods).final.y
        for shift in (h, 2.0 * h, -2.0 * h, -h)
    )
    return (8.0 * (ahead - behind) - (far - back)) / (12.0 * h)


def check_one(problem, start, periods, tolerance=1e-5, h=1e-5):
    """Compare what one perturbation grows by with neighbouring runs."""
    n = start.y.size
    free = [i for i in range(n) if i not in problem.automaton.cyclic]
    one = LyapunovIntegrator(problem, start, 1, chunk=periods)
    moved = carried(problem, start, periods, one._state.y[n:].copy(), h)[free]
    one.advance_exponents()
    assert one.growth[0][0] == pytest.approx(math.log(np.linalg.norm(moved)), abs=tolerance)
    assert one.final.y == pytest.approx(run(problem, start, periods).final.y, abs=1e-9)


def check(problem, start, periods, tolerance=1e-5):
    """Compare what one perturbation grows by, and the volume of all, with neighbouring runs."""
    check_one(problem, start, periods, tolerance)
    n = start.y.size
    free = [i for i in range(n) if i not in problem.automaton.cyclic]
    every = LyapunovIntegrator(problem, start, len(free), chunk=periods)
    columns = every._state.y[n:].reshape(n, -1).T[every._state.alive == 1]
    moved = [carried(problem, start, periods, column.copy())[free] for column in columns]
    every.advance_exponents()
    volume = 0.5 * math.log(np.linalg.det(np.array(moved) @ np.array(moved).T))
    # Differences of runs have errors of rtol/h, which a volume between columns that are nearly
    # parallel, as they are where the motion contracts, magnifies by the inverse of their angle.
    angle = math.exp(volume) / math.prod(np.linalg.norm(column) for column in moved)
    noise = 1e-12 / 1e-5 / angle
    found = every.growth[0][every._state.alive == 1].sum()
    assert found == pytest.approx(volume, abs=tolerance + noise)


FIRST, SECOND, THIRD = mi.modes("first", "second", "third")


def _turning(mode, t, y, p):
    push = 1.0 if mode == FIRST else (-0.4 if mode == SECOND else 0.2)
    return y.v + 0.3 * push * y.x, push - 0.2 * y.x + 0.3 * math.cos(t)


def _beyond_one(mode, t, y, p):
    return 1.0 - y.x - 0.1 * math.sin(t)


def _to_second(mode, t, y, p):
    return SECOND, (y.x - 0.3, 0.8 * y.v + 0.2 * y.x)


def _at_once(mode, t, y, p):  # negative wherever the second mode begins
    return y.x - 5.0


def _to_third(mode, t, y, p):
    return THIRD, (y.x, y.v - 0.5 * y.x + 0.1 * math.sin(t))


def _back(mode, t, y, p):
    return y.x + 0.2


def _to_first(mode, t, y, p):
    return FIRST, (y.x, 0.1 - 0.5 * y.v)


def _middle(mode, t, y, p):
    return y.v - 0.05 * y.x


def handed_on():
    """A state that one transition puts beyond the guard of the next; and a guard that records."""
    return mi.System(
        states=("x", "v"),
        flow=_turning,
        period=2.0 * math.pi,
        guards=[
            mi.Guard("one", _beyond_one, _to_second, modes=(FIRST,)),
            mi.Guard("at once", _at_once, _to_third, modes=(SECOND,), condition=True),
            mi.Guard("back", _back, _to_first, modes=(THIRD,)),
            mi.Guard("middle", _middle),
        ],
        initial={"x": 0.1, "v": 0.2},
    )


def test_a_transition_caused_by_another_has_its_time():
    system = handed_on()
    problem = system.problem(PLAIN)
    start = system.state_space.instant(None, problem)
    kinds = [problem.automaton.guards[i].name for i in run(problem, start, 3).events.guard]
    assert {"one", "at once", "back", "middle"} <= set(kinds)
    check(problem, start, 3)


@pytest.mark.slow
def test_impacts():
    system = oscillator(A=1.0, e=0.7)
    problem = system.problem(FAST)
    start = run(problem, system.state_space.instant(None, problem), 20.3).final
    assert run(problem, start, 4).events.impacts(problem.automaton).sum() >= 3
    check(problem, start, 4)


FLIES, RIDES = mi.modes("flies", "rides")


def _on_a_spring(mode, t, y, p):
    pull = -y.X - 0.1 * y.V + 0.2 * math.cos(t)
    if mode == FLIES:
        return y.V, pull, y.v, -1.0
    both = (2.0 * pull - 1.0) / 3.0  # the platform weighs twice as much as the ball
    return y.V, both, y.v, both


def _above(mode, t, y, p):
    return y.x - y.X


def _off_the_platform(mode, t, y, p):
    closing = y.v - y.V
    platform = y.V + (1.0 + p.e) / 3.0 * closing
    return FLIES, (y.X, platform, y.x, platform - p.e * closing)


def _ride(mode, t, y, p):
    both = (2.0 * y.V + y.v) / 3.0
    return RIDES, (y.X, both, y.x, both)


@pytest.mark.parametrize(
    ("options", "e", "height"),
    [
        pytest.param(PLAIN, 0.3, 0.5, id="interpreted"),
        pytest.param(FAST, 0.3, 0.5, id="compiled", marks=pytest.mark.slow),
        pytest.param(FAST, 0.97, 1e-3, id="long", marks=pytest.mark.slow),
    ],
)
def test_a_sequence_of_impacts_closes_the_gap_by_impulses(options, e, height):
    """A ball comes to rest on a platform that swings on: where they meet, nothing is set.

    What has made up for a gap moves both by their masses; and most of the flights are left out.
    """
    system = mi.System(
        states=("X", "V", "x", "v"),
        flow=_on_a_spring,
        period=2.0 * math.pi,
        parameters={"e": e},
        guards=[mi.Impact("platform", _above, _off_the_platform, rest=_ride, modes=(FLIES,))],
        initial={"V": 0.1, "x": height},
    )
    problem = system.problem(options)
    start = system.state_space.instant(None, problem)
    assert run(problem, start, 1).final.mode == RIDES
    check_one(problem, start, 1, tolerance=1e-6, h=1e-4 * math.sqrt(height))


def test_at_rest_nothing_is_left():
    system = oscillator(A=2.0, omega=0.2, e=0.5)
    problem = system.problem(FAST)
    start = system.state_space.instant(None, problem)
    stretching = LyapunovIntegrator(problem, start, 2, chunk=2)
    stretching.advance_exponents()
    assert stretching.result.per_period.tolist() == [-math.inf, -math.inf]
    assert stretching.result.errors.tolist() == [0.0, 0.0]


@pytest.mark.slow
@pytest.mark.parametrize("time_unit", [1e-3, 1e3])
def test_columns_of_a_badly_scaled_system_are_not_parallel(time_unit):
    """They would be orthonormalized after every small part of a period."""

    def flow(mode, t, y, p):
        return y.v, p.A * math.cos(p.omega * t) - p.k * y.x - p.c * y.v

    system = mi.System(
        states=("x", "v"),
        flow=flow,
        period=lambda p: 2.0 * math.pi / p.omega,
        parameters={
            "k": time_unit**-2,
            "c": 0.05 / time_unit,
            "A": time_unit**-2,
            "omega": 2.8 / time_unit,
        },
    )
    problem = system.problem(FAST)
    start = system.state_space.instant({"x": -0.1, "v": 0.0}, problem)
    one = LyapunovIntegrator(problem, start, 2, chunk=4, balanced=True)
    one.advance_exponents()
    assert one._state.length[0] == problem.period
    assert one.growth[0].sum() == pytest.approx(-0.05 * 4 * 2.0 * math.pi / 2.8, rel=1e-6)


@pytest.mark.slow
def test_the_same_to_the_last_bit():
    system = oscillator(A=0.5)
    problem = system.problem(FAST)
    start = run(problem, system.state_space.instant(None, problem), 300).final
    how = {"tolerance": 1e-2, "sure": 4.0, "periods": 1000}
    exponent, error, periods = largest(LyapunovIntegrator(problem, start, chunk=16), **how)
    other = oscillator(A=0.8).problem(FAST)
    again = LyapunovIntegrator(other, system.state_space.instant(None, other), chunk=16)
    again.advance_exponents()
    again.restart(problem, start)
    assert largest(again, **how) == (exponent, error, periods)
    orbit = mi.find_orbit(system, guess=system.state_space.state(start))
    expected = math.log(abs(orbit.multipliers[0])) / orbit.periods
    assert abs(exponent - expected) < 3.0 * error < 0.1
    assert periods == 256


def test_errors_of_parts_that_depend_on_each_other():
    random = np.random.default_rng(1)
    noise = random.normal(size=(4096, 1))
    told = standard_errors(noise, np.ones(4096))[0] * 64.0
    assert 0.95 < told < 2.0
    slow = np.zeros((4096, 1))
    for i in range(1, 4096):
        slow[i] = 0.95 * slow[i - 1] + noise[i]
    # The sum of what one kick leaves behind is 1/(1 - 0.95).
    assert 0.7 * 20.0 < standard_errors(slow, np.ones(4096))[0] * 64.0 < 2.0 * 20.0
    assert np.isnan(standard_errors(noise[:15], np.ones(15))).all()


def test_errors_of_what_has_not_settled():
    """Growth in proportion to time has a rate of log(t)/t; one that is the same throughout none."""
    ends = np.arange(1.0, 18.0) * 60.0
    grown = np.diff(np.log(ends))[:, None]
    told = standard_errors(grown, np.full(16, 60.0))[0]
    assert 0.5 * grown.sum() / 960.0 < told < 2.0 * grown.sum() / 960.0
    assert standard_errors(np.full((16, 1), -3.0), np.full(16, 60.0))[0] < 1e-9
