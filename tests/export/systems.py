"""Systems that the tests of exports share."""

import math

import mems_impact as mi

FLIGHT, REST = mi.modes("flight", "rest")


def fall(mode, t, y, p):
    if mode == REST:
        return 0.0, 0.0
    return y.v, -p.g


def height(mode, t, y, p):
    return y.x


def bounce(mode, t, y, p):
    return mode, (0.0, -p.e * y.v)


def stay(mode, t, y, p):
    return REST, (0.0, 0.0)


BALL = mi.System(
    states=("x", "v"),
    flow=fall,
    parameters={"g": 9.81, "e": 0.5},
    guards=[mi.Impact("floor", height, bounce, modes=(FLIGHT,), rest=stay)],
    modes=(FLIGHT, REST),
    initial={"x": 1.0},
    units={"x": "m", "v": "m/s", "time": "s", "g": "m/s^2"},
    name="ball",
)


def spring(mode, t, y, p):
    return y.v, -y.x + p.a * math.cos(p.w * t)


def forcing_period(p):
    return 2.0 * math.pi / p.w


def belt():
    """Return a mass on a belt, with a spring and a force."""
    return mi.System(
        states=("x", "v"),
        flow=spring,
        parameters={"a": 0.3, "w": 1.3, "mu": 0.4, "mu_s": 0.6, "v_belt": 0.2},
        parts=[mi.Friction("belt", "v", mu="mu", static="mu_s", surface="v_belt")],
        period=forcing_period,
        initial={"x": 0.5},
    )
