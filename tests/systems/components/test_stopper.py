"""Stops: impacts, rest, release, and impacts of two bodies."""

from __future__ import annotations

import math

import numpy as np
import pytest

import mems_impact as mi

PLAIN = mi.Options(engine="interpreted", method="dop853")


def apart(mode, t, y, p):
    return y.v - y.w, 0.0, y.w, 0.0


def two(mode, t, y, p):
    return y.v, 0.0, y.w, 0.0


@pytest.mark.parametrize("turned", [False, True], ids=["lower", "upper"])
def test_a_ball_bounces_and_rests(turned):
    sign = -1.0 if turned else 1.0
    stop = {"upper": "floor"} if turned else {"lower": "floor"}
    ball = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, -p.g),
        parameters={"g": 9.81 * sign, "e": 0.5, "floor": 2.0},
        initial={"x": 2.0 + sign},
        parts=[mi.Stopper("stop", "x", "v", restitution="e", **stop)],
    )
    run = mi.simulate(ball, duration=2.0, options=PLAIN)
    fall = math.sqrt(2.0 / 9.81)
    assert run.impacts["t"].iloc[0] == pytest.approx(fall, rel=1e-9)
    ended = run.events.query("event == 'chatter ends'")["t"]
    assert ended.tolist() == pytest.approx([3.0 * fall], abs=1e-8)
    assert run.final == mi.State(x=2.0, v=0.0, mode="held")


def test_it_lets_go_when_nothing_presses_any_more():
    lifted = mi.System(
        states=("x", "v", "lift"),
        flow=lambda mode, t, y, p: (y.v, y.lift - 1.0, 0.5),
        initial={"x": 0.0},
        parts=[mi.Stopper("floor", "x", "v", lower=0.0, restitution=0.0)],
    )
    run = mi.simulate(lifted, duration=5.0, options=PLAIN)
    assert run.events["event"].tolist() == ["floor lets go"]
    assert run.events["t"].tolist() == pytest.approx([2.0], rel=1e-12)
    assert run.final.x == pytest.approx(0.5 / 6.0 * 27.0, rel=1e-9)


def test_without_restitution_it_is_held_at_once():
    dropped = mi.System(
        states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -1.0), initial={"x": 0.5},
        parts=[mi.Stopper("floor", "x", "v", lower=0.0, restitution=0.0)],
    )  # fmt: skip
    run = mi.simulate(dropped, duration=3.0, options=PLAIN)
    assert run.events["mode after"].tolist() == ["held"]
    assert run.events["t"].tolist() == pytest.approx([1.0], rel=1e-9)


@pytest.mark.parametrize("e", [1.0, 0.7, 0.0])
def test_two_bodies_keep_their_momentum(e):
    bodies = mi.System(
        states=("x", "v", "z", "w"),
        flow=two,
        parameters={"m": 1.0, "M": 3.0, "e": e},
        masses={"v": "m", "w": "M"},
        initial={"x": -1.0, "v": 2.0, "z": 1.0, "w": -0.5},
        parts=[mi.Stopper("collision", "x", "v", upper=0.0, restitution="e", against=("z", "w"))],
    )
    run = mi.simulate(bodies, duration=2.0, options=PLAIN)
    (hit,) = run.impacts.to_dict("records")
    assert hit["t"] == pytest.approx(2.0 / 2.5, rel=1e-12)
    v, w = run.final.v, run.final.w
    assert v + 3.0 * w == pytest.approx(2.0 - 1.5, abs=1e-12)
    assert w - v == pytest.approx(2.5 * e, abs=1e-12)
    assert run.final.mode == "free"  # nothing presses them together


@pytest.mark.quick(1)
@pytest.mark.parametrize("distance", [False, True])
def test_a_rattler_between_two_stops_loses_the_closed_form(distance):
    other = "w" if distance else ("z", "w")
    rattler = mi.System(
        states=("x", "v", "z", "w"),
        flow=apart if distance else two,
        masses={"v": 1.0, "w": 4.0},
        initial={"v": 1.0},
        time_scale=1.0,
        parts=[
            mi.Stopper("right", "x", "v", upper=0.5, restitution=0.9, against=other),
            mi.Stopper("left", "x", "v", lower=-0.5, restitution=0.9, against=other),
        ],
    )
    run = mi.simulate(rattler, duration=20.0, options=PLAIN)
    hits = run.impacts
    speeds = 0.9 ** np.arange(len(hits))
    times = 0.5 + np.concatenate([[0.0], np.cumsum(1.0 / speeds[1:])])
    assert len(hits) == 11
    assert hits["t"].to_numpy() == pytest.approx(times, rel=1e-10)
    assert np.abs(hits["v before"] - hits["w before"]).to_numpy() == pytest.approx(speeds)
    assert (hits["v after"] + 4.0 * hits["w after"]).to_numpy() == pytest.approx(1.0)


def test_a_wall_that_moves_as_the_flow_says_is_not_moved_by_impacts():
    racket = mi.System(
        states=("x", "v", "wall", "speed"),
        flow=lambda mode, t, y, p: (y.v, 0.0, y.speed, 0.0),
        initial={"x": 1.0, "v": -1.0, "speed": 0.5},
        parts=[
            mi.Stopper("racket", "x", "v", lower=0.0, restitution=0.5, against=("wall", "speed"))
        ],
    )
    run = mi.simulate(racket, duration=2.0, options=PLAIN)
    assert run.impacts["t"].tolist() == pytest.approx([1.0 / 1.5], rel=1e-12)
    assert run.final.v == pytest.approx(0.5 + 0.5 * 1.5, rel=1e-12)
    assert run.final.speed == 0.5


@pytest.mark.slow
def test_an_orbit_and_its_grazing_are_those_of_the_system_written_by_hand():
    def flow(mode, t, y, p):
        return y.v, p.A * math.cos(p.omega * t) - p.k * y.x - p.c * y.v

    oscillator = mi.System(
        states=("x", "v"),
        flow=flow,
        period=lambda p: 2.0 * math.pi / p.omega,
        parameters={"c": 0.1, "k": 1.0, "d": 1.0, "e": 0.8, "A": 0.6, "omega": 0.8},
        parts=[mi.Stopper("stop", "x", "v", upper="d", restitution="e")],
    )
    orbit = mi.find_orbit(mi.simulate(oscillator, periods=300), periods=1)
    branch = mi.continue_solution(orbit, "A", stop=0.3)
    labels = branch.special_table["label"].tolist()
    assert labels == ["PD", "G"]
    exact = math.sqrt((1.0 - 0.64) ** 2 + (0.1 * 0.8) ** 2)
    assert branch.special_points[-1].value == pytest.approx(exact, abs=1e-9)
