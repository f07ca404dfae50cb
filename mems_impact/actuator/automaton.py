"""The actuator as a hybrid automaton: friction x contact, guards and transitions.

A mode is a pair of friction (the frame stuck, sliding forward, sliding backward) and contact (the
block free, resting on the right stopper, resting on the left one).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

from mems_impact.actuator import equations as eq
from mems_impact.actuator import impact_law
from mems_impact.hybrid.automaton import Automaton, Guard

STUCK, FORWARD, BACKWARD = 0, 1, 2
FREE, RIGHT, LEFT = 0, 1, 2

FRICTION = ("stuck", "forward", "backward")
CONTACT = ("free", "right", "left")
MODES = tuple(f"{friction}-{contact}" for contact in CONTACT for friction in FRICTION)

X1, V1, X2, V2 = 0, 1, 2, 3
STATES = ("x1", "v1", "x2", "v2")

RIGHT_IMPACT, LEFT_IMPACT, RELEASE, SLIP_END, BREAK_AWAY = 0, 1, 2, 3, 4
# Order of simultaneous events: impacts first, since they change the velocities that the other
# margins depend on; release before slip end, since it changes the load on the frame.
GUARDS = (
    Guard(name="right impact", order=0, impact=True),
    Guard(name="left impact", order=1, impact=True),
    Guard(name="release", order=2, condition=True),
    Guard(name="slip end", order=3, condition=True),
    Guard(name="break-away", order=4, condition=True),
)
MARGIN_UNITS = {
    "right impact": "m", "left impact": "m", "release": "N", "slip end": "m/s", "break-away": "N",
    "current limit": "A", "left current limit": "A",
}  # fmt: skip
COUNT = len(GUARDS)


def mode_of(friction: int, contact: int) -> int:
    """Return the mode of a pair of friction and contact."""
    return 3 * contact + friction


def slips(mode: str) -> bool:
    """Return whether the frame slips in a mode, by its name."""
    return not mode.startswith(FRICTION[STUCK])


def direction_of(mode: int) -> int:
    """Return the sign of the slip velocity in `mode`, 0 where the frame is stuck."""
    friction = mode % 3
    return 1 if friction == FORWARD else (-1 if friction == BACKWARD else 0)


def side_of(mode: int) -> int:
    """Return +1 where the block rests on the right stopper, -1 on the left one, 0 if free."""
    contact = mode // 3 % 3
    return 1 if contact == RIGHT else (-1 if contact == LEFT else 0)


def friction_towards(speed: float) -> int:
    """Return the friction mode of a slip with the sign of `speed`; stuck at 0."""
    return FORWARD if speed > 0.0 else (BACKWARD if speed < 0.0 else STUCK)


def free_mode(load: float, v1: float, p: Any) -> int:
    """Return the mode with a free block; a frame at rest sticks or slips by Equation (4)."""
    if v1 != 0.0:
        return mode_of(friction_towards(v1), FREE)
    if abs(load) <= eq.static_limit(p):
        return mode_of(STUCK, FREE)
    return mode_of(friction_towards(load), FREE)


def mode_under(y: Any, pull: float, p: Any) -> int:
    """Return the mode of the state `y` under the force `pull` of the electrodes.

    A block at rest on a stopper stays in contact if the contact force is positive. A frame at rest
    sticks if the load on it is within static friction, Equation (4).
    """
    friction = friction_towards(y[V1])
    direction = direction_of(friction)
    if y[V2] == 0.0:
        if y[X2] >= p[eq.DELTA] and eq.contact_force(1, direction, pull, p) > 0.0:
            return mode_of(friction, RIGHT)
        if y[X2] <= -p[eq.DELTA] and eq.contact_force(-1, direction, pull, p) > 0.0:
            return mode_of(friction, LEFT)
    return free_mode(eq.load(y[X2], y[V2], pull, p), y[V1], p)


def impact(side: int, e: float, y: Any, p: Any) -> None:
    """Apply Equations (5) and (6) at the stopper on `side` and put the block on it exactly."""
    y[X2] = side * p[eq.DELTA]
    y[V1] = impact_law.frame_speed_after(y[V1], y[V2], e, p)
    y[V2] = impact_law.block_speed_after(y[V2], e)


class Pull(NamedTuple):
    """The force of the electrodes on the block, positive to the right, as functions for numba.

    Attributes
    ----------
    force : callable
        ``force(t, x2, p)``.
    with_rate : callable
        ``with_rate(t, x2, v2, p)``, the force and its time derivative.
    """

    force: Callable[..., float]
    with_rate: Callable[..., tuple[float, float]]


def one_sided(voltage: Callable[..., float], voltage_rate: Callable[..., float]) -> Pull:
    """Return the pull of the right electrode alone."""

    def force(t, x2, p):  # type: ignore[no-untyped-def]
        return eq.attraction(x2, voltage(t, p[eq.DRIVE :]), p)

    def with_rate(t, x2, v2, p):  # type: ignore[no-untyped-def]
        v = voltage(t, p[eq.DRIVE :])
        v_rate = voltage_rate(t, p[eq.DRIVE :])
        return eq.attraction(x2, v, p), eq.attraction_rate(x2, v2, v, v_rate, p)

    return Pull(force, with_rate)


def two_sided(right: Pull, left: Pull) -> Pull:
    """Return the pull of both electrodes; `left` is for the mirror image of the left electrode."""
    force_right, with_rate_right = right
    force_left, with_rate_left = left

    def force(t, x2, p):  # type: ignore[no-untyped-def]
        return force_right(t, x2, p) - force_left(t, -x2, p)

    def with_rate(t, x2, v2, p):  # type: ignore[no-untyped-def]
        right, right_rate = with_rate_right(t, x2, v2, p)
        left, left_rate = with_rate_left(t, -x2, -v2, p)
        return right - left, right_rate - left_rate

    return Pull(force, with_rate)


@cache
def actuator_automaton(
    voltage: Callable[..., float],
    voltage_rate: Callable[..., float],
    left: Callable[..., float] | None = None,
    left_rate: Callable[..., float] | None = None,
    bounds: bool = True,
) -> Automaton:
    """Return the automaton of the actuator under the waveform ``voltage(t, q)``.

    Parameters
    ----------
    voltage, voltage_rate : callable
        The waveform at the right electrode and its time derivative as scalar functions of time
        and the drive's parameters (see `mems_impact.actuator.drives.base.Drive`).
    left, left_rate : callable, optional
        Those at the left electrode; none by default.
    bounds : bool, optional
        Whether compiled functions check array bounds, as functions of users require.
    """
    pulls = one_sided(voltage, voltage_rate)
    if left is not None and left_rate is not None:
        pulls = two_sided(pulls, one_sided(left, left_rate))
    pull, pull_with_rate = pulls

    def flow(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
        direction = direction_of(mode)
        if side_of(mode) == 0:
            load = eq.load(y[X2], y[V2], pull(t, y[X2], p), p)
            dy[X2] = y[V2]
            dy[V1] = eq.frame_acceleration(direction, load, p)
            dy[V2] = eq.block_acceleration(direction, load, p)
        else:
            dy[X2] = 0.0
            dy[V1] = eq.resting_acceleration(direction, p)
            dy[V2] = 0.0
        dy[X1] = y[V1] if direction != 0 else 0.0

    def margins(mode, t, y, p, g, r):  # type: ignore[no-untyped-def]
        direction = direction_of(mode)
        side = side_of(mode)
        for i in range(COUNT):
            g[i] = 1.0
            r[i] = 1.0
        if side == 0:
            g[RIGHT_IMPACT] = p[eq.DELTA] - y[X2]
            r[RIGHT_IMPACT] = -y[V2]
            g[LEFT_IMPACT] = p[eq.DELTA] + y[X2]
            r[LEFT_IMPACT] = y[V2]
        else:
            x2 = side * p[eq.DELTA]
            force, force_rate = pull_with_rate(t, x2, 0.0, p)
            g[RELEASE] = eq.contact_force(side, direction, force, p)
            r[RELEASE] = eq.contact_force_rate(side, force_rate)
        if direction != 0:
            if side == 0:
                load = eq.load(y[X2], y[V2], pull(t, y[X2], p), p)
                a1 = eq.frame_acceleration(direction, load, p)
            else:
                a1 = eq.resting_acceleration(direction, p)
            g[SLIP_END] = direction * y[V1]
            r[SLIP_END] = direction * a1
        elif side == 0:
            force, force_rate = pull_with_rate(t, y[X2], y[V2], p)
            load = eq.load(y[X2], y[V2], force, p)
            a2 = eq.block_acceleration(direction, load, p)
            rate = eq.load_rate(y[V2], a2, force_rate, p)
            g[BREAK_AWAY] = eq.static_limit(p) - abs(load)
            r[BREAK_AWAY] = -math.copysign(1.0, load) * rate

    def transition(mode, code, t, y, p):  # type: ignore[no-untyped-def]
        if code in (RIGHT_IMPACT, LEFT_IMPACT):
            impact(1 if code == RIGHT_IMPACT else -1, p[eq.E], y, p)
        elif code in (COUNT + RIGHT_IMPACT, COUNT + LEFT_IMPACT):
            # A complete chatter sequence ends like an impact without rebound.
            impact(1 if code == COUNT + RIGHT_IMPACT else -1, 0.0, y, p)
        elif code == RELEASE:
            # The contact force is zero up to rounding: release for either sign.
            return free_mode(eq.load(y[X2], y[V2], pull(t, y[X2], p), p), y[V1], p)
        elif code == SLIP_END:
            y[V1] = 0.0
        elif code == BREAK_AWAY:
            # The load is at the static limit up to rounding: slip on either side of it.
            y[V1] = 0.0
            load = eq.load(y[X2], y[V2], pull(t, y[X2], p), p)
            return mode_of(friction_towards(load), FREE)
        return mode_under(y, pull(t, y[X2], p), p)

    return Automaton(
        states=STATES,
        modes=MODES,
        guards=GUARDS,
        flow=flow,
        margins=margins,
        transition=transition,
        cyclic=(X1,),
        bounds=bounds,
        recipe=(actuator_automaton, (voltage, voltage_rate, left, left_rate, bounds)),
    )
