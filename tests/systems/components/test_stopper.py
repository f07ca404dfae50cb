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


def free(mode, t, y, p):
    return y.v, 0.0


def test_restitution_may_depend_on_the_impact_speed():
    ball = mi.System(
        states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -1.0), initial={"x": 2.0},
        parameters={"c": 4.0},
        parts=[mi.Stopper("floor", "x", "v", lower=0.0, restitution=lambda u, p: p.c / (p.c + u))],
    )  # fmt: skip
    run = mi.simulate(ball, duration=6.0, options=PLAIN)
    speeds = [2.0, 2.0 / 1.5]  # of the first two impacts: a rebound with the speed u lasts 2 u
    assert run.impacts["v after"].iloc[0] == pytest.approx(speeds[1], rel=1e-9)
    assert run.impacts["t"].diff().iloc[1] == pytest.approx(2.0 * speeds[1], rel=1e-9)
    assert run.impacts["v after"].iloc[1] == pytest.approx(
        speeds[1] / (1.0 + speeds[1] / 4.0), rel=1e-9
    )


def test_adhesion_holds_a_body_up_to_the_pull_off_force():
    lifted = mi.System(
        states=("x", "v", "lift"),
        flow=lambda mode, t, y, p: (y.v, y.lift - 1.0, 0.5),
        initial={"x": 0.0},
        parameters={"sticky": 0.75},
        parts=[mi.Stopper("floor", "x", "v", lower=0.0, restitution=0.5, adhesion="sticky")],
    )
    run = mi.simulate(lifted, duration=4.0, options=PLAIN)
    assert run.events["event"].tolist() == ["floor lets go"]
    assert run.events["t"].tolist() == pytest.approx([1.75 / 0.5], rel=1e-12)
    # A body at rest under less than the pull-off force stays.
    resting = mi.simulate(lifted, duration=0.4, initial={"x": 0.0, "lift": 1.5}, options=PLAIN)
    assert resting.final == mi.State(x=0.0, v=0.0, lift=1.7, mode="held")


def test_a_body_between_two_stops_loses_speed_at_both():
    rattling = mi.System(
        states=("x", "v"), flow=free, initial={"x": 0.0, "v": 3.0},
        parts=[mi.Stopper("clearance", "x", "v", lower=-1.0, upper=0.5, restitution=0.8)],
    )  # fmt: skip
    run = mi.simulate(rattling, duration=2.5, options=PLAIN)
    first = 0.5 / 3.0
    times = [first, first + 1.5 / 2.4, first + 1.5 / 2.4 + 1.5 / 1.92]
    assert run.impacts["t"].tolist() == pytest.approx(times, rel=1e-9)
    sides = [f"clearance {side}" for side in ("upper", "lower", "upper")]
    assert run.impacts["event"].tolist() == sides


def test_a_body_rests_on_either_of_two_stops():
    shaken = mi.System(
        states=("x", "v"), initial={"x": 0.0}, period=10.0, switches=(5.0, 10.0),
        flow=lambda mode, t, y, p: (y.v, 1.0 if t < 5.0 else -2.0),
        parts=[mi.Stopper("box", "x", "v", lower=-1.0, upper=1.0, restitution=0.0)],
    )  # fmt: skip
    run = mi.simulate(shaken, duration=9.0, options=PLAIN)
    crossing = math.sqrt(2.0)  # over the distance 2 at the acceleration 2
    assert run.events["t"].tolist() == pytest.approx([0.0, math.sqrt(2.0), 5.0, 5.0 + crossing])
    assert run.events["mode after"].tolist() == ["free", "upper", "free", "lower"]


@pytest.mark.parametrize("damping", [0.0, 0.3])
def test_a_compliant_stopper_pushes_and_does_not_pull(damping):
    k, c, speed = 25.0, 2.0 * damping * 5.0, 1.5
    bumper = mi.System(
        states=("x", "v"), flow=free, initial={"x": 0.0, "v": speed},
        parameters={"k": k, "c": c},
        parts=[mi.Stopper("pad", "x", "v", upper=1.0, law=lambda s, u, p: p.k * s + p.c * u)],
    )  # fmt: skip
    run = mi.simulate(bumper, duration=5.0, options=PLAIN)
    # Until the force k s + c s' is zero, s is that of a damped oscillator.
    decay, swing = damping * 5.0, 5.0 * math.sqrt(1.0 - damping**2)
    end = (math.pi - math.atan2(c * swing, k - c * decay)) / swing
    depth = speed / swing * math.exp(-decay * end) * math.sin(swing * end)
    leaving = -k / c * depth if c else -speed
    assert run.final.v == pytest.approx(leaving, rel=1e-6)
    start, stop = run.events["t"]
    assert start == pytest.approx(1.0 / speed, rel=1e-9)
    assert stop == pytest.approx(start + end + depth / -leaving, rel=1e-6)
    assert run.events["mode after"].tolist() == ["contact", "free"]


@pytest.mark.parametrize("e", [0.8, 0.0])
def test_velocities_may_be_relative(e):
    """A block in a frame that friction holds, by its velocity in the frame and on the ground."""

    def absolute(mode, t, y, p):
        force = math.cos(t) - y.u
        return y.v - y.w, force / 2.0, y.w, -force / 5.0

    def relative(mode, t, y, p):
        force = math.cos(t) - y.u
        return y.r, force / 2.0 + force / 5.0, y.w, -force / 5.0

    common = {"period": 2.0 * math.pi, "parameters": {"mu": 0.1}}
    stops = {"upper": 0.4, "lower": -0.5, "restitution": e, "against": "w"}
    ground = mi.Friction("ground", "w", mu="mu")
    one = mi.System(
        states=("u", "v", "z", "w"), flow=absolute, masses={"v": 2.0, "w": 5.0},
        parts=[mi.Stopper("stops", "u", "v", **stops), ground], **common,
    )  # fmt: skip
    other = mi.System(
        states=("u", "r", "z", "w"), flow=relative, masses={"w + r": 2.0, "w": 5.0},
        parts=[mi.Stopper("stops", "u", "r", **stops), ground], **common,
    )  # fmt: skip
    runs = [mi.simulate(system, periods=4, options=PLAIN) for system in (one, other)]
    events = [run.events for run in runs]
    assert len(events[0]) > 8
    assert events[0]["event"].tolist() == events[1]["event"].tolist()
    assert events[0]["t"].tolist() == pytest.approx(events[1]["t"].tolist(), abs=1e-7)
    assert runs[0].final.z == pytest.approx(runs[1].final.z, abs=1e-7)
    assert runs[0].final.v == pytest.approx(runs[1].final.r + runs[1].final.w, abs=1e-7)


def test_forces_of_contacts_are_those_of_statics():
    """A pressed block of mass 2 on a plate of mass 3 under a stop, on rough ground."""

    def pressed(mode, t, y, p):
        return y.v, (p.push - y.x) / 2.0, y.w, 1.0 / 3.0

    system = mi.System(
        states=("x", "v", "z", "w"),
        flow=pressed,
        parameters={"push": 5.0},
        masses={"v": 2.0, "w": 3.0},
        initial={"x": 1.0, "v": 0.0, "z": 0.0, "w": 0.0},
        parts=[
            mi.Stopper("stop", "x", "v", upper=1.0, restitution=0.5),
            mi.Friction("ground", "w", mu=0.1, normal=6.0, static=0.5),
        ],
    )
    samples = mi.simulate(system, duration=1.0, options=PLAIN).samples(10, forces=True)
    assert samples["force of stop"].to_numpy() == pytest.approx(-4.0)  # 5 - 1 pushes outwards
    assert samples["force of ground"].to_numpy() == pytest.approx(-1.0)
    slipping = mi.simulate(system, duration=1.0, initial={"w": 1.0}, options=PLAIN)
    assert slipping.samples(10, forces=True)["force of ground"].iloc[0] == pytest.approx(-0.6)


def test_a_chain_of_held_bodies_bears_the_sum_of_forces():
    def pushed(mode, t, y, p):
        return y.v, 2.0 / 1.0, y.w, 3.0 / 4.0

    system = mi.System(
        states=("x", "v", "z", "w"),
        flow=pushed,
        masses={"v": 1.0, "w": 4.0},
        parts=[
            mi.Friction("between", "v", surface="w", mu=0.5, normal=10.0),
            mi.Friction("ground", "w", mu=0.5, normal=20.0),
        ],
    )
    samples = mi.simulate(system, duration=0.1, options=PLAIN).samples(10, forces=True)
    assert samples["force of between"].to_numpy() == pytest.approx(-2.0)
    assert samples["force of ground"].to_numpy() == pytest.approx(-5.0)
