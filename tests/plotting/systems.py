"""Two systems of a user's own: a driven oscillator against a wall, and a ball without forcing."""

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


def oscillator(**given):
    """Return an oscillator before a wall, against which it may rest, where A > wall."""
    return mi.System(
        states=("x", "v"), flow=flow, period=lambda p: 2 * math.pi / p.omega,
        parameters={"A": 0.6, "omega": 0.8, "zeta": 0.05, "wall": 1.0, "e": 0.8},
        guards=[mi.Impact("wall", gap, rebound, rest=rest, modes=(FREE,)),
                mi.Guard("release", pressed, release, modes=(HELD,))],
        **given,
    )  # fmt: skip


def fall(mode, t, y, p):
    return y.v, -p.g


def height(mode, t, y, p):
    return y.x


def bounce(mode, t, y, p):
    return mode, (0.0, -p.e * y.v)


def ball():
    """Return a ball that falls from 1 m, with units."""
    return mi.System(
        states=("x", "v"), flow=fall, parameters={"g": 9.81, "e": 0.8},
        guards=[mi.Impact("floor", height, bounce)], initial={"x": 1.0},
        units={"x": "m", "v": "m/s", "time": "s", "g": "m/s2"},
    )  # fmt: skip
