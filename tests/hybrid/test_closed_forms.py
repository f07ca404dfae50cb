"""Runs against answers in closed form."""

import itertools
import math

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import fsolve

from mems_impact.hybrid.event_loop import workspace
from tests.hybrid.systems import (
    BALL,
    COULOMB,
    ENGINES,
    RESTING,
    STOP,
    STUCK,
    TAU,
    at,
    ball,
    coulomb,
    problem,
    run,
    simulate,
    stop,
    times,
)

pytestmark = pytest.mark.usefixtures("each_method")


def accumulation(e, h=1.0, g=1.0):
    return math.sqrt(2.0 * h / g) * (1.0 + e) / (1.0 - e)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("e", [0.1, 0.3, 0.5, 0.8, 0.95])
def test_bouncing_ball_accumulates_and_rests(e, engine):
    expected = accumulation(e)
    run_ = simulate(
        BALL, ball(e), [1.0, 0.0], expected / TAU + 0.5, engine=engine, rtol=1e-10, atol=1e-12
    )
    assert times(run_, workspace.ACCUMULATION) == pytest.approx([expected], abs=1e-10 / (1.0 - e))
    assert run_.final.mode == RESTING
    assert run_.final.y.tolist() == [0.0, 0.0]
    impacts = run_.events[run_.events.kind == workspace.TRANSITION]
    assert np.all(impacts.before[:, 1] < 0.0)
    assert impacts.after[:, 1] == pytest.approx(-e * impacts.before[:, 1], rel=1e-15)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("rtol", [1e-4, 1e-6, 1e-8, 1e-10])
def test_a_ball_comes_to_rest_at_any_tolerance(rtol, engine):
    """Flights lower than the tolerance must not be taken for impacts from below."""
    run_ = simulate(BALL, ball(0.5), [1.0, 0.0], 1.0, rtol=rtol, atol=rtol / 100, engine=engine)
    assert run_.final.mode == RESTING
    assert len(run_.events) < 30
    assert times(run_, workspace.ACCUMULATION) == pytest.approx(accumulation(0.5), abs=10 * rtol)


@pytest.mark.quick(1)
@pytest.mark.parametrize("engine", ENGINES)
def test_impacts_that_lose_nothing_come_at_equal_times(engine):
    """A solver that stops some hundred roundings after a root adds them up: here to 2e-10."""
    impacts = times(simulate(BALL, ball(1.0), [0.5, 0.0], 200.0, period=1.0, engine=engine))
    assert impacts == pytest.approx(np.arange(1.0, 200.0, 2.0), rel=0.0, abs=2e-12)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_resting_ball_is_released_where_gravity_changes_sign(engine):
    """Weight 0.5 + cos t: rest until cos t = -0.5; then the exact flight."""
    run_ = simulate(BALL, ball(0.0, 0.5, 1.0), [0.0, 0.0], 0.5, mode=RESTING, engine=engine)
    released = TAU / 3.0
    assert times(run_, guard=1) == pytest.approx([released], abs=1e-12)
    t = 0.5 * TAU
    v = -(0.5 * (t - released) + math.sin(t) - math.sin(released))
    assert run_.final.y[1] == pytest.approx(v, abs=1e-9)


def test_the_ball_rests_and_is_released_once_every_period():
    run_ = simulate(BALL, ball(0.4, 0.9, 1.0), [0.0, 0.0], 50.0, mode=RESTING)
    assert np.count_nonzero(run_.events.guard == 1) == 50
    assert np.count_nonzero(run_.events.kind == workspace.ACCUMULATION) == 50


@pytest.mark.slow
@pytest.mark.parametrize("method", ["adams", "bdf"])
@pytest.mark.parametrize("engine", ENGINES)
def test_coulomb_oscillator_loses_twice_the_friction_each_half_cycle(engine, method):
    run_ = simulate(COULOMB, coulomb(1.0), [10.3, 0.0], 4.0, mode=2, engine=engine, method=method)
    x = run_.events.after[:, 0]
    assert x == pytest.approx([-8.3, 6.3, -4.3, 2.3, -0.3], abs=1e-7)
    assert times(run_) == pytest.approx(np.pi * np.arange(1, 6), abs=1e-7)
    assert run_.final.mode == STUCK
    assert run_.final.y[0] == x[-1]


def test_the_error_falls_with_the_tolerance():
    errors = []
    for rtol in (1e-5, 1e-7, 1e-9, 1e-11):
        # Under a longer period the tolerance alone limits the steps.
        run_ = simulate(
            COULOMB,
            coulomb(1.0),
            [10.3, 0.0],
            0.25,
            mode=2,
            period=16.0 * TAU,
            rtol=rtol,
            atol=rtol,
        )
        errors.append(abs(run_.final.y[0] + 0.3))
    # Steps add up their errors: some 700 of them, at x = 10.
    assert errors[0] < 3e-3
    assert errors[-1] < 1e-7
    assert all(fine < coarse / 2.0 for coarse, fine in itertools.pairwise(errors))


@pytest.mark.parametrize("ratio", [0.6, 0.7, 0.85, 1.2, 1.5])
def test_den_hartog(ratio):
    drive, friction = 1.0, 0.3
    v = 1.0 / (1.0 - ratio**2)
    u = math.sin(math.pi / ratio) / (ratio * (1.0 + math.cos(math.pi / ratio)))
    amplitude = drive * math.sqrt(v**2 - (friction / drive) ** 2 * u**2)
    run_ = simulate(
        COULOMB, coulomb(friction, drive, ratio), [0.0, 0.0], 400.0, mode=1, period=TAU / ratio
    )
    turns = run_.events[-4:]
    assert np.all((turns.mode_before != STUCK) & (turns.mode_after != STUCK))
    assert np.abs(turns.after[:, 0]) == pytest.approx(amplitude, abs=1e-8)


# The linear impact oscillator. (x, v, cos, sin) obeys one linear equation.


def arc(p, y, t0, t):
    """Return the exact free motion over `t` from `y` at `t0`."""
    c, k, amplitude, omega = p[:4]
    system = np.array(
        [[0, 1, 0, 0], [-k, -c, amplitude, 0], [0, 0, 0, -omega], [0, 0, omega, 0]], dtype=float
    )
    start = [*y, math.cos(omega * t0), math.sin(omega * t0)]
    return (expm(system * t) @ start)[:2]


def steady(p, t):
    """Return the steady motion without stop."""
    c, k, amplitude, omega = p[:4]
    z = amplitude / (k - omega**2 + 1j * c * omega) * np.exp(1j * omega * t)
    return np.array([z.real, (1j * omega * z).real])


def graze(c=0.1, k=1.0, omega=0.8, d=1.0):
    return d * math.hypot(k - omega**2, c * omega)


@pytest.mark.quick(1)
@pytest.mark.parametrize("omega", [0.7, 0.75, 1.2])
def test_one_impact_orbit_of_the_linear_oscillator(omega):
    p = stop(c=0.1, amplitude=1.6 * graze(omega=omega), omega=omega, e=0.8)
    period = TAU / omega
    run_ = simulate(STOP, p, [0.0, 0.0], 400.0, period=period)
    hits = run_.events[run_.events.kind == workspace.TRANSITION]
    t, v = hits.time[-1], hits.before[-1, 1]
    assert np.array_equal(hits.cycle[-20:], np.arange(380, 400))  # one impact a period

    def closes(unknown):
        return arc(p, [p[5], -p[6] * unknown[1]], unknown[0], period) - [p[5], unknown[1]]

    exact = fsolve(closes, [t, v], xtol=1e-12)
    assert [t, v] == pytest.approx(exact, abs=1e-8)


@pytest.mark.parametrize("engine", ENGINES)
def test_an_arc_after_an_impact_is_the_exact_linear_solution(engine):
    p = stop(c=0.1, amplitude=0.7, omega=0.8, e=0.8)
    run_ = simulate(STOP, p, [0.2, 1.5], 1.0, period=TAU / 0.8, engine=engine)
    hits = run_.events[run_.events.kind == workspace.TRANSITION]
    instants = [0.0, *hits.time, run_.period]
    starts = [[0.2, 1.5], *hits.after]
    ends = [*hits.before, run_.final.y]
    assert len(hits) >= 2
    for t0, t1, y0, y1 in zip(instants, instants[1:], starts, ends, strict=False):
        assert arc(p, y0, t0, t1 - t0) == pytest.approx(y1, abs=1e-9)


@pytest.mark.parametrize("offset", [1e-3, 1e-5, 1e-7])
def test_grazing_amplitude(offset):
    for sign in (1.0, -1.0):
        p = stop(c=0.1, amplitude=graze() * (1.0 + sign * offset), omega=0.8)
        run_ = simulate(STOP, p, steady(p, 0.0), 1.0, period=TAU / 0.8, rtol=1e-12, atol=1e-13)
        kinds = run_.events.kind
        assert (workspace.TRANSITION in kinds) == (sign > 0.0)
        if sign < 0.0:
            closest = run_.events[kinds == workspace.APPROACH].before[0, 0]
            assert 1.0 - closest == pytest.approx(offset, abs=1e-9)


@pytest.mark.parametrize("depth", [1e-1, 1e-3, 1e-5, 1e-7, 1e-9])
def test_square_root_law(depth):
    p = stop(c=0.1, amplitude=graze() * (1.0 + depth), omega=0.8)
    phase = float(np.angle(steady(p, 0.0) @ [1.0, -1j / 0.8]))
    start = (math.pi - phase) % TAU / 0.8  # at the lowest point
    run_ = simulate(
        STOP, p, steady(p, start), 1.0, period=TAU / 0.8, time=start, rtol=1e-12, atol=1e-13
    )
    speed = run_.events[run_.events.kind == workspace.TRANSITION].before[0, 1]
    # The position is known to the tolerance; the speed at the stop is the root of it.
    assert speed**2 == pytest.approx(0.64 * ((1.0 + depth) ** 2 - 1.0), abs=1e-10)


def test_area_contraction_of_the_period_map():
    """det of the period map is e^2 exp(-c T) for one impact."""
    omega = 0.85
    p = stop(c=0.1, amplitude=1.6 * graze(omega=omega), omega=omega, e=0.8)
    setup = problem(STOP, p, period=TAU / omega, rtol=1e-12, atol=1e-13)
    y0 = run(setup, at([0.0, 0.0]), 400.0).final.y
    h = 1e-5
    columns = [
        (run(setup, at(y0 + step), 1.0).final.y - run(setup, at(y0 - step), 1.0).final.y) / (2 * h)
        for step in (np.array([h, 0.0]), np.array([0.0, h]))
    ]
    expected = p[6] ** 2 * math.exp(-p[0] * TAU / omega)
    assert np.linalg.det(np.array(columns).T) == pytest.approx(expected, rel=1e-5)
