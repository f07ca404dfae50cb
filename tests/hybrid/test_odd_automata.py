"""Automata that a reviewer broke the loop with, each in a few lines."""

import math

import numpy as np
import pytest

from mems_impact.errors import InvalidParameter, RunError
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.event_loop import workspace
from tests.hybrid.systems import (
    BALL,
    COULOMB,
    STUCK,
    ball,
    coulomb,
    simulate,
    times,
)

pytestmark = pytest.mark.usefixtures("each_method")

# Each automaton is compiled for a second; that compiled code runs the loop alike, the files of
# closed forms, events and switches tell in the fast tests too.
both = pytest.mark.parametrize(
    "engine", ["interpreted", pytest.param("compiled", marks=pytest.mark.slow)]
)
FLOOR = Guard(name="floor", order=1, impact=True)


def automaton(states, guards, flow, margins, transition, modes=("a", "b")):
    return Automaton(
        states=states,
        modes=modes,
        guards=guards,
        flow=flow,
        margins=margins,
        transition=transition,
    )


def _fall(mode, t, y, p, dy):
    dy[0] = y[1]
    dy[1] = -1.0


def _sensor_and_floor(mode, t, y, p, g, r):
    if mode == 0:
        g[0] = y[0]  # its rate is left at a positive constant
    g[1], r[1] = y[0], y[1]


def _noted_or_thrown_back(mode, code, t, y, p):
    if code == 0:
        return 1
    y[0] = 0.0
    y[1] = -0.9 * y[1] if code == 1 else 0.0
    return mode


@both
def test_a_guard_without_a_rate_and_an_impact_in_one_instant(engine):
    guards = (Guard(name="sensor", order=0), FLOOR)
    system = automaton(("y", "v"), guards, _fall, _sensor_and_floor, _noted_or_thrown_back)
    events = simulate(system, (0.0,), [0.5, 0.0], 1.5, period=1.0, engine=engine).events
    assert events.guard.tolist() == [0, 1]
    assert events.cycle + events.time == pytest.approx(1.0, abs=1e-9)
    assert np.abs(events.before[:, 0]).max() < 1e-12


def _sink(mode, t, y, p, dy):
    dy[0] = -p[0]


def _level(mode, t, y, p, g, r):
    if mode == 0:
        g[0], r[0] = y[0], p[1]


def _next(mode, code, t, y, p):
    return 1


@pytest.mark.quick(1)
@both
@pytest.mark.parametrize(("speed", "rate"), [(1.0, 1.0), (5e-7, 1.0), (5e-7, 5e-7), (1.0, 0.0)])
def test_a_wrong_rate_does_not_lose_a_guard(rate, speed, engine):
    system = automaton(("y",), (Guard(name="end", order=0),), _sink, _level, _next)
    done = simulate(system, (speed, rate), [0.5 * speed], 3.0, period=1.0, engine=engine)
    assert times(done) == pytest.approx([0.5], abs=1e-9)


def _two_bodies(mode, t, y, p, dy):
    dy[0], dy[1], dy[2], dy[3] = y[1], 0.0, y[3], 0.0


def _gaps(mode, t, y, p, g, r):
    g[0], r[0] = y[0], y[1]
    g[1], r[1] = y[2] - y[0], y[3] - y[1]


def _elastic(mode, code, t, y, p):
    e = 1.0 if code < 2 else 0.0
    if code % 2 == 0:
        y[0] = 0.0
        y[1] *= -e
    else:
        middle, relative = (y[1] + p[0] * y[3]) / (1.0 + p[0]), y[3] - y[1]
        y[2] = y[0]
        y[1] = middle + e * p[0] * relative / (1.0 + p[0])
        y[3] = middle - e * relative / (1.0 + p[0])
    return mode


@both
@pytest.mark.parametrize("pair_is_impact", [True, False])
@pytest.mark.parametrize(("mass", "gap"), [(3.0, 0.0), (3.0, 1e-15), (3.0, 1e-6), (0.9, 1e-6)])
def test_two_impacts_in_no_time_are_no_chatter(mass, gap, pair_is_impact, engine):
    """A falls, is thrown back by the floor and again by B: strong impacts, and no energy lost."""
    guards = (
        Guard(name="floor", order=0, impact=True),
        Guard(name="pair", order=1, impact=pair_is_impact),
    )
    system = automaton(("a", "u", "b", "v"), guards, _two_bodies, _gaps, _elastic)
    start = [0.5, -1.0, 0.5 + gap, -1.0]
    done = simulate(system, (mass,), start, 1.0, period=1.0, engine=engine)
    y = done.final.y
    assert y[1] ** 2 + mass * y[3] ** 2 == pytest.approx(1.0 + mass, rel=1e-9)
    assert not np.any(done.events.kind == workspace.ACCUMULATION)


def _with_a_stranger(mode, t, y, p, dy):
    dy[0] = y[1]
    dy[1] = -1.0 if mode == 0 else 0.0
    dy[2] = 0.0


def _ground(mode, t, y, p, g, r):
    if mode == 0:
        g[0], r[0] = y[0], y[1]


def _bounce(mode, code, t, y, p):
    y[0] = 0.0
    y[1] = -0.9 * y[1] if code == 0 else 0.0
    return 0 if code == 0 else 1


@both
def test_the_end_of_a_sequence_does_not_depend_on_strangers(engine):
    guards = (Guard(name="floor", order=0, impact=True),)
    system = automaton(("h", "u", "z"), guards, _with_a_stranger, _ground, _bounce)
    done = simulate(system, (0.0,), [0.5, 0.0, 1e6], 20.0, period=1.0, atol=1e-14, engine=engine)
    assert times(done, workspace.ACCUMULATION) == pytest.approx([19.0], abs=1e-9)


def _sticking(mode, t, y, p, dy):
    dy[0] = 1.0 if mode == 0 else -y[0]


def _stretched(mode, t, y, p, g, r):
    if mode == 0:
        g[0], r[0] = 1.0 - abs(y[0]), -1.0
    else:
        g[1], r[1] = y[0] - 0.5, -y[0]


def _looks_again(mode, code, t, y, p):
    return 0 if abs(y[0]) < (1.0 if mode == 0 else 0.5 + 1e-9) else 1


@both
@pytest.mark.parametrize("time", [0.0, 1.0])
def test_a_transition_may_look_at_the_state_again(time, engine):
    """A start a rounding before the guard: at the event the margin is really zero or below."""
    guards = (Guard(name="break-away", order=0, condition=True), Guard(name="stick", order=1))
    system = automaton(("x",), guards, _sticking, _stretched, _looks_again)
    done = simulate(system, (0.0,), [1.0 - 1e-14], 2.0, time=time, period=3.0, engine=engine)
    assert 3 < len(done.events) < 30


def _root(mode, t, y, p, dy):
    dy[0] = -math.sqrt(y[0]) - 0.1


def _quotient(mode, t, y, p, dy):
    dy[0] = -1.0 / (0.0 * y[0])


def _power(mode, t, y, p, dy):
    dy[0] = -(y[0] ** 0.5) - 0.1


def _far(mode, t, y, p, g, r):
    g[0], r[0] = y[0] + 2.0, -0.1


def _margin_of_a_root(mode, t, y, p, g, r):
    g[0], r[0] = math.sqrt(y[0] - 0.5), -0.1


@both
@pytest.mark.parametrize(
    ("flow", "margins", "reason"),
    [
        (_root, _far, "right-hand side is not finite"),
        (_power, _far, "right-hand side is not finite"),
        (_quotient, _far, "right-hand side is not finite"),
        (_sink, _margin_of_a_root, "margin of a guard is not a number"),
    ],
)
def test_leaving_the_domain_of_a_function_is_a_typed_error(flow, margins, reason, engine):
    system = automaton(("y",), (Guard(name="end", order=0),), flow, margins, _next)
    with pytest.raises(RunError, match=reason) as caught:
        simulate(system, (1.0,), [1.0], 12.0, period=1.0, engine=engine)
    assert caught.value.partial is not None


def _forgotten(mode, code, t, y, p):
    return mode


@both
def test_a_forgotten_rebound_is_reported(engine):
    guards = (Guard(name="floor", order=0, impact=True),)
    system = automaton(("y", "v"), guards, _fall, _ground, _forgotten)
    with pytest.raises(RunError, match="'floor' changes nothing"):
        simulate(system, (0.0,), [0.5, 0.0], 3.0, period=1.0, engine=engine)


@both
def test_a_start_inside_a_wall(engine):
    with pytest.raises(RunError, match="beyond the guard 'floor'"):
        simulate(BALL, ball(0.5), [-0.3, -1.0], 1.0, engine=engine)
    # On its way out it is let out; the floor is then where it is.
    hits = simulate(BALL, ball(0.5), [-0.3, 1.0], 1.0, engine=engine).events
    assert np.abs(hits.before[:, 0]).max() < 1e-9


@both
def test_a_start_beyond_the_static_limit_slips(engine):
    done = simulate(COULOMB, coulomb(0.5, 0.9, 1.0), [0.0, 0.0], 1.0, mode=STUCK, engine=engine)
    assert done.events.time[0] == 0.0


def test_starts_that_fit_no_automaton():
    with pytest.raises(InvalidParameter, match="y"):
        simulate(BALL, ball(0.5), [1.0], 1.0)
    with pytest.raises(InvalidParameter, match="mode"):
        simulate(BALL, ball(0.5), [1.0, 0.0], 1.0, mode=7)


def _fall_to_half(mode, t, y, p, g, r):
    if mode == 0:
        g[0], r[0] = y[0] - 0.5, -p[0]


def _to_another_mode(mode, code, t, y, p):
    return int(p[1])


def _to_infinity(mode, code, t, y, p):
    y[0] = p[1]
    return 1


def odd(transition, value, engine):
    system = automaton(("y",), (Guard(name="half", order=0),), _sink, _fall_to_half, transition)
    return simulate(system, (1.0, value), [1.0], 2.0, period=1.0, engine=engine)


@both
@pytest.mark.parametrize("mode", [2, 7, -1])
def test_a_transition_to_a_mode_that_does_not_exist(mode, engine):
    with pytest.raises(
        RunError, match=rf"returned the mode {mode}; there are 2 .*0 to 1"
    ) as caught:
        odd(_to_another_mode, mode, engine)
    assert caught.value.mode == "a"
    assert caught.value.state == {"y": pytest.approx(0.5)}


@both
@pytest.mark.parametrize("value", [math.inf, -math.inf, math.nan])
def test_a_transition_to_a_state_that_is_not_finite(value, engine):
    with pytest.raises(RunError, match="'half' left a state that is not finite"):
        odd(_to_infinity, value, engine)
