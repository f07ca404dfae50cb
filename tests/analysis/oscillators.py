"""Systems that nothing forces, for tests of limit cycles."""

from __future__ import annotations

import math
from collections.abc import Sequence

import mems_impact as mi

STICK, SLIP = mi.modes("stick", "slip")
ON, OFF = mi.modes("on", "off")


def _dragged(mode, t, y, p):
    return (p.v, 0.0) if mode == STICK else (y.v, p.Fd - y.x)


def _held(mode, t, y, p):
    return p.Fs - y.x


def _slip(mode, t, y, p):
    return SLIP, (y.x, p.v)


def _slower(mode, t, y, p):
    return p.v - y.v


def _stick(mode, t, y, p):
    return STICK, (y.x, p.v)


def belt(**changes: float) -> mi.System:
    """A block of mass and stiffness 1 on a belt; it slips against less friction than it sticks."""
    return mi.System(
        states=("x", "v"),
        flow=_dragged,
        parameters={"v": 0.3, "Fs": 1.0, "Fd": 0.6, **changes},
        guards=[
            mi.Guard("break-away", _held, _slip, modes=(STICK,)),
            mi.Guard("stick", _slower, _stick, modes=(SLIP,)),
        ],
        initial=mi.State(x=0.0, v=0.1, mode="slip"),
        units={"x": "m", "v": "m/s", "time": "s", "Fs": "", "Fd": ""},
    )


def belt_period(v: float, drop: float) -> float:
    """The period of the block on the belt: once round the circle but for the part that sticks.

    While it slips, (x - Fd, v) goes round a circle, from (D, v) to (-D, v); the angle that it
    leaves out is 2 atan(D/v). Then it is carried from -D to D.
    """
    return 2.0 * math.pi - 2.0 * math.atan2(drop, v) + 2.0 * drop / v


def _stribeck(mode, t, y, p):
    friction = p.Fd + (p.Fs - p.Fd) * math.exp(-(p.v - y.v) / p.vs)
    return (p.v, 0.0) if mode == STICK else (y.v, friction - y.x)


def stribeck_belt(**changes: float) -> mi.System:
    """The block on the belt, with friction that falls gradually as it slips faster."""
    return mi.System(
        states=("x", "v"),
        flow=_stribeck,
        parameters={"v": 0.3, "Fs": 1.0, "Fd": 0.6, "vs": 0.2, **changes},
        guards=[
            mi.Guard("break-away", _held, _slip, modes=(STICK,)),
            mi.Guard("stick", _slower, _stick, modes=(SLIP,)),
        ],
        initial=mi.State(x=0.0, v=0.1, mode="slip"),
    )


def _heated(mode, t, y, p):
    return (p.q - y.T if mode == ON else -y.T,)


def _hot(mode, t, y, p):
    return p.high - y.T


def _cold(mode, t, y, p):
    return y.T - p.low


def _switch_off(mode, t, y, p):
    return OFF, (y.T,)


def _switch_on(mode, t, y, p):
    return ON, (y.T,)


def thermostat(observables: Sequence[mi.Observable] = (), **changes: float) -> mi.System:
    """A heater with hysteresis: one state, two modes."""
    return mi.System(
        states=("T",),
        flow=_heated,
        parameters={"q": 3.0, "high": 2.0, "low": 1.0, **changes},
        guards=[
            mi.Guard("hot", _hot, _switch_off, modes=(ON,)),
            mi.Guard("cold", _cold, _switch_on, modes=(OFF,)),
        ],
        observables=observables,
    )


def _van_der_pol(mode, t, y, p):
    return y.v, p.mu * (1.0 - y.x * y.x) * y.v - y.x


def _room(mode, t, y, p):
    return p.wall - y.x


def _rebound(mode, t, y, p):
    return mode, (p.wall, -p.e * y.v)


def van_der_pol(
    *, wall: float | None = None, period: float | None = None, **changes: float
) -> mi.System:
    """Van der Pol's oscillator, beside a wall if that is given."""
    given = {"mu": 1.0, **({} if wall is None else {"wall": wall, "e": 0.8}), **changes}
    guards = [] if wall is None else [mi.Impact("wall", _room, _rebound)]
    return mi.System(
        states=("x", "v"),
        flow=_van_der_pol,
        parameters=given,
        period=period,
        guards=guards,
        initial={"x": 0.1},
    )


def _roessler(mode, t, y, p):
    return -y.y - y.z, y.x + p.a * y.y, p.b + y.z * (y.x - p.c)


def roessler(**changes: float) -> mi.System:
    """Roessler's system, whose cycle doubles its period again and again."""
    return mi.System(
        states=("x", "y", "z"),
        flow=_roessler,
        parameters={"a": 0.2, "b": 0.2, "c": 2.5, **changes},
        initial={"x": 1.0, "y": 1.0},
    )


def _lorenz(mode, t, y, p):
    return p.s * (y.y - y.x), y.x * (p.r - y.z) - y.y, y.x * y.y - p.b * y.z


def lorenz(time_scale: float | None = None) -> mi.System:
    """Lorenz's system, with a chaotic attractor full of unstable cycles."""
    return mi.System(
        states=("x", "y", "z"),
        flow=_lorenz,
        parameters={"s": 10.0, "r": 28.0, "b": 8.0 / 3.0},
        initial={"x": 1.0, "y": 1.0, "z": 1.0},
        time_scale=time_scale,
    )


def _spiral(mode, t, y, p):
    square = y.x * y.x + y.y * y.y
    grows = p.mu + p.k * square - square * square
    return grows * y.x - y.y, y.x + grows * y.y


def spiral(mu: float) -> mi.System:
    """Circles of the radius r with mu + k r^2 - r^4 = 0, passed at the angular speed one."""
    return mi.System(
        states=("x", "y"), flow=_spiral, parameters={"mu": mu, "k": 1.0}, initial={"x": 1.0}
    )
