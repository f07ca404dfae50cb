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


def square(mode, t, y, p):
    return y.v, -y.x - 0.2 * y.v + (p.a if t % p.T < p.on * p.T else -p.a)


def wall(mode, t, y, p):
    return 0.9 - y.x


def rebound(mode, t, y, p):
    return mode, (0.9, -0.8 * y.v)


def switching_times(p):
    return p.on * p.T, p.T


def switched():
    """Return a mass on a spring at a wall, under a force that switches."""
    return mi.System(
        states=("x", "v"),
        flow=square,
        parameters={"a": 1.2, "T": 5.0, "on": 0.4},
        guards=[mi.Impact("wall", wall, rebound)],
        period=lambda p: p.T,
        switches=switching_times,
        initial={"x": 0.1},
    )


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
