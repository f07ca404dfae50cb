"""Balls that fell through floors and walls, each before its closed form."""

import math

import numpy as np
import pytest

import mems_impact as mi

FLYING, RESTING = mi.modes("flying", "resting")


def fall(mode, t, y, p):
    return (y.v, -p.g) if mode == FLYING else (0.0, 0.0)


def height(mode, t, y, p):
    return y.x


def bounce(mode, t, y, p):
    return FLYING, (0.0, -p.e * y.v)


def rest(mode, t, y, p):
    return RESTING, (0.0, 0.0)


def ball(h, e):
    return mi.System(
        states=("x", "v"),
        flow=fall,
        parameters={"g": 9.81, "e": e},
        guards=[mi.Impact("floor", height, bounce, rest=rest, modes=(FLYING,))],
        initial={"x": h},
        units={"x": "m", "v": "m/s", "time": "s"},
    )


def bounces(h, e, until):
    """Return when a ball that falls from the height h strikes."""
    first = math.sqrt(2.0 * h / 9.81)
    flights = 2.0 * first * e ** np.arange(1, 400)
    times = np.cumsum([first, *flights])
    return times[times < until]


# DifferentialEquations.jl #138: through the floor at the 6th bounce of 50 m, at the 2nd below 10 m.
@pytest.mark.parametrize("h", [50.0, 9.0])
def test_an_elastic_ball_bounces_for_fifty_seconds(h, options):
    run = mi.simulate(ball(h, 1.0), duration=50.0, options=options)
    expected = bounces(h, 1.0, 50.0)
    assert len(expected) == {50.0: 8, 9.0: 18}[h]
    assert run.impacts["t"].to_numpy() == pytest.approx(expected, rel=1e-9)
    assert run.samples(20)["x"].min() > -1e-9


# DifferentialEquations.jl #551: the ball is turned round where it has not yet reached the floor.
def test_a_ball_is_turned_round_at_the_floor(options):
    run = mi.simulate(ball(1.0, 0.8), duration=3.0, options=options)
    assert run.impacts["t"].to_numpy() == pytest.approx(bounces(1.0, 0.8, 3.0), rel=1e-9)
    assert len(run.impacts) == 6
    assert np.abs(run.impacts["x before"]).max() < 1e-12
    assert (run.impacts["v before"] < 0.0).all()


# OpenModelica PR 16009: after the last bounces it fell on, to -0.96 m.
def test_the_bouncing_ball_of_modelica_comes_to_rest(options):
    run = mi.simulate(ball(1.0, 0.7), duration=3.0, options=options)
    assert run.final == mi.State(x=0.0, v=0.0, mode="resting")
    (end,) = run.events.query("event == 'chatter ends'")["t"]
    assert end == pytest.approx(math.sqrt(2.0 / 9.81) * 1.7 / 0.3, abs=1e-10)
    struck = run.impacts["t"].to_numpy()
    assert len(struck) > 20
    assert struck[:20] == pytest.approx(bounces(1.0, 0.7, 3.0)[:20], rel=1e-8)


# DifferentialEquations.jl #696: a throw that ends on the floor, and slides on; e = 0 and 1/2.
def throw(mode, t, y, p):
    return y.vx, y.vy, 0.0, (-p.g if mode == FLYING else 0.0)


def above(mode, t, y, p):
    return y.y + 1.0


def drop(mode, t, y, p):
    return FLYING, (y.x, -1.0, y.vx, -p.e * y.vy)


def slide(mode, t, y, p):
    return RESTING, (y.x, -1.0, y.vx, 0.0)


@pytest.mark.parametrize(("e", "impacts"), [(0.0, 1), (0.5, 10)])
def test_a_throw_ends_on_the_floor(e, impacts, options):
    thrown = mi.System(
        states=("x", "y", "vx", "vy"),
        flow=throw,
        parameters={"g": 9.8, "e": e},
        guards=[mi.Impact("floor", above, drop, rest=slide, modes=(FLYING,))],
        initial={"vx": 1.0, "vy": 1.0},
    )
    run = mi.simulate(thrown, duration=2.0, options=options)
    speed = math.sqrt(1.0 + 2.0 * 9.8)
    first = (1.0 + speed) / 9.8
    assert run.impacts["t"].iloc[0] == pytest.approx(first, rel=1e-9)
    assert len(run.impacts) >= impacts
    (end,) = run.events.query("event == 'chatter ends'")["t"]
    assert end == pytest.approx(first + 2.0 * speed / 9.8 * e / (1.0 - e), abs=1e-10)
    assert run.final.as_dict() == pytest.approx({"x": 2.0, "y": -1.0, "vx": 1.0, "vy": 0.0})
    assert run.samples(50)["y"].min() > -1.0 - 1e-9


# DifferentialEquations.jl #677: a misspelt keyword was dropped without a word, and so the wall.
def test_a_guard_under_a_wrong_name_is_an_error():
    with pytest.raises(TypeError, match="guard"):
        mi.System(states=("x", "v"), flow=fall, guard=[mi.Impact("wall", height, bounce)])


def test_a_wall_throws_back(options):
    wall = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, 0.0),
        guards=[mi.Impact("wall", height, lambda mode, t, y, p: (mode, (0.0, -y.v)))],
        initial={"x": 0.75, "v": -1.0},
    )
    run = mi.simulate(wall, duration=10.0, options=options)
    assert run.impacts["t"].tolist() == pytest.approx([0.75], rel=1e-12)
    assert run.final.x == pytest.approx(9.25, rel=1e-12)


# DifferentialEquations.jl #516: the bounce turns the speed's sign, which turns gravity off.
def test_an_event_that_another_one_causes(options):
    up = mi.Guard("up", lambda mode, t, y, p: -y.v, lambda mode, t, y, p: (RESTING, y),
                  modes=(FLYING,))  # fmt: skip
    floor = mi.Impact("floor", height, bounce, modes=(FLYING,))
    chain = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, -p.g if mode == FLYING else 0.0),
        parameters={"g": 9.8, "e": 1.0},
        guards=[floor, up],
        initial={"x": 50.0},
    )
    run = mi.simulate(chain, duration=15.0, options=options)
    struck, speed = math.sqrt(100.0 / 9.8), math.sqrt(980.0)
    assert run.events["event"].tolist() == ["floor", "up"]
    assert run.events["t"].to_numpy() == pytest.approx([struck, struck], rel=1e-9)
    assert run.final.x == pytest.approx(speed * (15.0 - struck), rel=1e-9)
