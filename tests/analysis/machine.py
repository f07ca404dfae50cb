"""A driven impact oscillator and a chain of many states, whose functions can be imported."""

import math

import mems_impact as mi

FREE, HELD = mi.modes("free", "held")


def flow(mode, t, y, p):
    force = p.A * math.cos(p.omega * t) - 2 * p.zeta * y.v - y.x
    return (y.v, force) if mode == FREE else (0.0, 0.0)


def gap(mode, t, y, p):
    return p.wall - y.x


def rebound(mode, t, y, p):
    return FREE, (p.wall, -p.e * y.v)


def rest(mode, t, y, p):
    return HELD, (p.wall, 0.0)


def pressed(mode, t, y, p):
    return p.A * math.cos(p.omega * t) - p.wall


def release(mode, t, y, p):
    return FREE, (p.wall, 0.0)


def speed(mode, t, before, after, p):
    return before.v


def oscillator(**changes):
    """The oscillator; some of what it is made of changed."""
    made = {
        "states": ("x", "v"),
        "flow": flow,
        "period": lambda p: 2 * math.pi / p.omega,
        "parameters": {"A": 0.6, "omega": 0.8, "zeta": 0.05, "wall": 1.0, "e": 0.8},
        "guards": [
            mi.Impact("wall", gap, rebound, rest=rest, modes=(FREE,)),
            mi.Guard("release", pressed, release, modes=(HELD,)),
        ],
        "observables": [mi.Observable("impact speed", speed, at=("wall",), reduce="max")],
    }
    return mi.System(**{**made, **changes})


def relaxed(mode, t, y, p, dy):
    dy[0] = math.cos(p.omega * t) - y[0]
    for i in range(1, 6):
        dy[i] = p.k * (y[i - 1] - y[i])


def ceiling(mode, t, y, p):
    return 0.5 - y[0]


def pushed_back(mode, t, y, p, new):
    new[0] = 0.4
    return mode


def chain():
    """Six states, written by arrays."""
    return mi.System(
        states=6,
        flow=relaxed,
        period=lambda p: 2 * math.pi / p.omega,
        parameters={"omega": 1.0, "k": 0.5},
        guards=[mi.Guard("ceiling", ceiling, pushed_back)],
        units={"u0": "K", "time": "s"},
    )
