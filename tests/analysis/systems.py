"""Own systems for tests, written as the documentation shows it."""

from __future__ import annotations

import math

import mems_impact as mi

FREE, HELD = mi.modes("free", "held")


def flow(mode, t, y, p):
    force = p.A * math.cos(p.omega * t) - 2.0 * p.zeta * y.v - y.x
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


def impact_speed(mode, t, before, after, p):
    return before.v


def energy(y, p):
    return 0.5 * (y.v * y.v + y.x * y.x)


OSCILLATOR = {
    "states": ("x", "v"),
    "flow": flow,
    "period": lambda p: 2.0 * math.pi / p.omega,
    "parameters": {"A": 0.6, "omega": 0.8, "zeta": 0.05, "wall": 1.0, "e": 0.8},
    "guards": [
        mi.Impact("wall", gap, rebound, rest=rest, modes=(FREE,)),
        mi.Guard("release", pressed, release, modes=(HELD,)),
    ],
    "observables": [
        mi.Observable("speed", impact_speed, at=("wall",), reduce="max"),
        mi.Observable("energy", energy),
    ],
}


def oscillator_with(**changes) -> mi.System:
    """A driven oscillator with a stop, on which it may rest; some of its elements changed."""
    return mi.System(**{**OSCILLATOR, **changes})


def oscillator(*, section=None, units=None, **parameters: float) -> mi.System:
    parameters = {**OSCILLATOR["parameters"], **parameters}
    return oscillator_with(section=section, units=units, parameters=parameters)


def _fall(mode, t, y, p):
    return (y.v, -p.g) if mode == FREE else (0.0, 0.0)


def _height(mode, t, y, p):
    return y.x


def _bounce(mode, t, y, p):
    return FREE, (0.0, -p.e * y.v)


def _lie(mode, t, y, p):
    return HELD, (0.0, 0.0)


def _fall_into(mode, t, y, p, dy):
    dy[0] = y[1] if mode == FREE else 0.0
    dy[1] = -p.g if mode == FREE else 0.0


def _height_of(mode, t, y, p):
    return y[0]


def _bounce_into(mode, t, y, p, new):
    new[0] = 0.0
    new[1] = -p.e * y[1]
    return FREE


def _lie_in(mode, t, y, p, new):
    new[0] = 0.0
    new[1] = 0.0
    return HELD


def ball(*, arrays: bool = False, **changes) -> mi.System:
    """A ball that falls from the height 1."""
    named = (_fall, _height, _bounce, _lie)
    written = (_fall_into, _height_of, _bounce_into, _lie_in)
    flow, height, bounce, lie = written if arrays else named
    given = {
        "states": ("x", "v"),
        "flow": flow,
        "parameters": {"g": 9.81, "e": 0.5},
        "guards": [mi.Impact("floor", height, bounce, rest=lie, modes=(FREE,))],
        "initial": {"x": 1.0},
        "units": {"x": "m", "v": "m/s", "time": "s"},
    }
    return mi.System(**{**given, **changes})


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
