"""Undeclared jumps of the flow are told once; steep slopes and declared jumps are not."""

import math
import warnings

import numpy as np
import pytest

import mems_impact as mi


def told(**given):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mi.System(states=("x", "v"), **given)
    return [str(w.message) for w in caught if w.category is mi.DiscontinuityWarning]


def square(mode, t, y, p):
    return y.v, -y.x + (1.0 if t % 3.0 < 1.0 else -1.0)


def rubbed(mode, t, y, p):
    return y.v, -y.x - 0.3 * ((y.v > 0.0) - (y.v < 0.0))


def stepped(mode, t, y, p):
    return y.v, -y.x - (10.0 if y.x < -1.0 else 0.0)


def fast(mode, t, y, p):
    return y.v, -1e12 * y.x - 0.3e6 * ((y.v > 0.0) - (y.v < 0.0))


@pytest.mark.parametrize(
    ("given", "where", "remedy"),
    [
        ({"flow": square, "period": 3.0}, "at t = 1,", "switches="),
        ({"flow": rubbed, "initial": {"x": 3.0}}, "at v = 0,", "Friction"),
        ({"flow": rubbed, "initial": {"x": 3.0, "v": 1.0}}, "at v = ", "Friction"),
        ({"flow": stepped, "initial": {"x": 3.0}}, "at x = -1,", "Guard"),
        ({"flow": fast, "initial": {"x": 3e-6}, "time_scale": 1e-6}, "at v = 0,", "Friction"),
    ],
    ids=["time", "rest", "velocity", "place", "microseconds"],
)
def test_a_jump_is_told_with_its_place(given, where, remedy):
    (message,) = told(**given)
    assert where in message
    assert remedy in message


def hold(mode, t, y, p):
    return mode, (y.x, y.v)


@pytest.mark.parametrize(
    "given",
    [
        {"flow": square, "period": 3.0, "switches": (1.0, 3.0)},
        {
            "flow": rubbed,
            "initial": {"x": 3.0, "v": -0.1},
            "guards": [mi.Guard("turn", lambda mode, t, y, p: -y.v, hold)],
        },
        {"flow": lambda mode, t, y, p: (y.v, -y.x - 5.0 * max(y.x, 0.0)), "initial": {"x": -1.0}},
        {"flow": lambda mode, t, y, p: (y.v, -y.x - 0.3 * math.tanh(1e7 * y.v))},
        {
            "flow": lambda mode, t, y, p: (y.v, -1e8 * (y.x - math.cos(t)) - 1e4 * y.v),
            "period": 2.0 * math.pi,
            "initial": {"x": 3.0},
        },
    ],
    ids=["switches", "guard", "kink", "steep", "stiff"],
)
def test_what_is_declared_or_steep_is_not_told(given):
    assert told(**{"initial": {"x": 3.0}, **given}) == []


def smooth(mode, t, y, p):
    bend = math.tanh(p.b * y.x) + math.sin(p.c * y.v) + abs(y.x - 0.1)
    return y.v, -p.a * y.x - y.v + bend + math.tanh(p.d * math.cos(t))


def test_smooth_systems_are_not_told():
    rng = np.random.default_rng(0)
    for _ in range(40):
        sizes = rng.uniform(0.1, 3.0, size=4) * 10.0 ** rng.uniform(-2.0, 3.0, size=4)
        parameters = dict(zip("abcd", sizes.tolist(), strict=True))
        start = dict(zip("xv", rng.normal(size=2).tolist(), strict=True))
        given = {"flow": smooth, "period": 2.0 * math.pi, "parameters": parameters}
        assert told(**given, initial=start) == []
