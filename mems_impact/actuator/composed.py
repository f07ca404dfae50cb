"""The hybrid automaton of an actuator with terms: the modes, guards and rules of `modes`.

With stoppers that yield, the modes "right" and "left" are those in which block and stopper touch,
and forces between them grow with the depth; nothing is reset there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

from mems_impact.actuator import equations as eq
from mems_impact.actuator.composing import Model, compose
from mems_impact.actuator.modes import (
    BREAK_AWAY,
    COUNT,
    FREE,
    GUARDS,
    LEFT,
    LEFT_IMPACT,
    MODES,
    RELEASE,
    RIGHT,
    RIGHT_IMPACT,
    SLIP_END,
    STUCK,
    V1,
    V2,
    X1,
    X2,
    direction_of,
    friction_towards,
    mode_of,
    side_of,
)
from mems_impact.actuator.terms.base import Function, Kind
from mems_impact.hybrid.automaton import Automaton

__all__ = ["composed_automaton"]

STEP = 1e-3  # of the differences that give the rate of a load, in units of sqrt(m2/k)


def forces_of(model: Model) -> tuple[Function, Function, Function, Function]:
    """Return the forces on which modes and margins hang.

    Returns
    -------
    load : callable
        ``load(side, v, w, y, p)``, what a block that moves exerts on the frame; `side` tells the
        stopper that yields to it, 0 for none.
    moved : callable
        ``moved(mode, v, w, y, p)``, all that would set the frame in motion but for friction.
    pressing : callable
        ``pressing(side, direction, v, w, y, p)``, the force of a rigid stopper on the block that
        rests on it, where friction acts in `direction`.
    resting_acceleration : callable
        ``resting_acceleration(direction, y, p)`` of frame and block together.
    """
    pull, force, stopper = model.pull, model.force, model.stopper
    on_frame, on_block = model.on_frame, model.on_block
    sliding_friction, adhesion = model.sliding_friction, model.adhesion
    rigid = stopper is None

    def inner(v, w, y, p):  # type: ignore[no-untyped-def]
        return eq.load(y[X2], y[V2], pull(v, w, y, p) + force(y, p), p)

    if stopper is None:
        load_free = inner

        def load(side, v, w, y, p):  # type: ignore[no-untyped-def]
            return load_free(v, w, y, p)

    else:

        def load(side, v, w, y, p):  # type: ignore[no-untyped-def]
            found = inner(v, w, y, p)
            if side != 0:
                depth = side * y[X2] - p[eq.DELTA]
                found += side * (stopper(depth, side * y[V2], p) - adhesion(p))
            return found

    def moved(mode, v, w, y, p):  # type: ignore[no-untyped-def]
        side = side_of(mode)
        if rigid and side != 0:
            return on_frame(y, p) + on_block(y, p)
        return load(side, v, w, y, p) + on_frame(y, p)

    def resting_acceleration(direction, y, p):  # type: ignore[no-untyped-def]
        if direction == 0:
            return 0.0
        outside = on_frame(y, p) + on_block(y, p)
        return (outside - sliding_friction(direction, y[V1], p)) / (p[eq.M1] + p[eq.M2])

    def pressing(side, direction, v, w, y, p):  # type: ignore[no-untyped-def]
        carried = p[eq.M2] * resting_acceleration(direction, y, p)
        held = eq.load(side * p[eq.DELTA], 0.0, pull(v, w, y, p) + force(y, p), p)
        return side * (on_block(y, p) - held - carried) + adhesion(p)

    return load, moved, pressing, resting_acceleration


@cache
def composed_automaton(
    kinds: tuple[Kind, ...],
    voltage: Callable[..., float],
    voltage_rate: Callable[..., float],
    left: Callable[..., float] | None = None,
    left_rate: Callable[..., float] | None = None,
    bounds: bool = True,
) -> Automaton:
    """Return the automaton of an actuator with terms under the waveform ``voltage(t, q)``.

    Parameters
    ----------
    kinds : tuple of Kind
        Of the terms.
    voltage, voltage_rate, left, left_rate, bounds
        As of `mems_impact.actuator.modes.actuator_automaton`.
    """
    model = compose(kinds, 1 if left is None else 2)
    load, moved, pressing, resting_acceleration = forces_of(model)
    static_limit, sliding_friction = model.static_limit, model.sliding_friction
    on_frame, on_block, rates = model.on_frame, model.on_block, model.rates
    restitution = model.restitution
    rigid, sticks = model.stopper is None, model.sticks
    n, scratch, begin = len(model.layout.states), model.layout.scratch, model.layout.drive
    volts = voltages(voltage, left, begin)
    volt_rates = voltages(voltage_rate, left_rate, begin)

    def flow(mode, t, y, p, dy):  # type: ignore[no-untyped-def]
        v, w = volts(t, p)
        direction, side = direction_of(mode), side_of(mode)
        if rigid and side != 0:
            dy[X2] = 0.0
            dy[V1] = resting_acceleration(direction, y, p)
            dy[V2] = 0.0
        else:
            own = load(side, v, w, y, p)
            a1 = 0.0
            if direction != 0:
                friction = sliding_friction(direction, y[V1], p)
                a1 = (own + on_frame(y, p) - friction) / p[eq.M1]
            dy[X2] = y[V2]
            dy[V1] = a1
            dy[V2] = (on_block(y, p) - own) / p[eq.M2] - a1
        dy[X1] = y[V1] if direction != 0 else 0.0
        rates(v, w, y, p, dy)

    def friction_mode(mode, v, w, y, p):  # type: ignore[no-untyped-def]
        # The frame slips on; at rest, Equation (4) holds it, or it slips where it is pushed.
        if y[V1] != 0.0:
            return friction_towards(y[V1])
        own = moved(mode, v, w, y, p)
        if sticks and abs(own) <= static_limit(p):
            return STUCK
        return friction_towards(own if own != 0.0 else 1.0)

    def touched(y, p):  # type: ignore[no-untyped-def]
        # The stopper that yields to the block, told at its face by the way that the block goes.
        for contact in (RIGHT, LEFT):
            side = 1 if contact == RIGHT else -1
            depth = side * y[X2] - p[eq.DELTA]
            if depth > 0.0 or (depth == 0.0 and side * y[V2] > 0.0):
                return contact
        return FREE

    def mode_under(v, w, y, p):  # type: ignore[no-untyped-def]
        contact = FREE
        if rigid:
            if y[V2] == 0.0 and abs(y[X2]) >= p[eq.DELTA]:
                side = 1 if y[X2] > 0.0 else -1
                contact = RIGHT if side == 1 else LEFT
                friction = friction_mode(mode_of(STUCK, contact), v, w, y, p)
                direction = direction_of(friction)
                if pressing(side, direction, v, w, y, p) > 0.0:
                    return mode_of(friction, contact)
                contact = FREE
        else:
            contact = touched(y, p)
        return mode_of(friction_mode(mode_of(STUCK, contact), v, w, y, p), contact)

    def push(code, mode, v, w, y, p):  # type: ignore[no-untyped-def]
        # The force on which the two guards hang whose rates are taken by differences.
        if code == RELEASE:
            return pressing(side_of(mode), direction_of(mode), v, w, y, p)
        return moved(mode, v, w, y, p)

    def push_rate(code, mode, t, y, p):  # type: ignore[no-untyped-def]
        # Along the flow, and along the voltages' own rates: these jump where a drive switches.
        # Without the corner of a margin: where a charge follows fast, the points lie far apart.
        v, w = volts(t, p)
        dv, dw = volt_rates(t, p)
        h = STEP * (p[eq.M2] / p[eq.K]) ** 0.5
        slope = p[scratch : scratch + n]
        x = p[scratch + n : scratch + 2 * n]
        flow(mode, t, y, p, slope)
        total = 0.0
        for point in range(6):
            size = 1 + point // 2
            sign = 1.0 - 2.0 * (point % 2)
            weight = 45.0 if size == 1 else (-9.0 if size == 2 else 1.0)
            s = sign * size * h
            for k in range(n):
                x[k] = y[k] + s * slope[k]
            total += sign * weight * push(code, mode, v + s * dv, w + s * dw, x, p)
        return total / (60.0 * h)

    def margins(mode, t, y, p, g, r):  # type: ignore[no-untyped-def]
        v, w = volts(t, p)
        direction, side = direction_of(mode), side_of(mode)
        for i in range(COUNT):
            g[i] = 1.0
            r[i] = 1.0
        if side == 0:
            g[RIGHT_IMPACT] = p[eq.DELTA] - y[X2]
            r[RIGHT_IMPACT] = -y[V2]
            g[LEFT_IMPACT] = p[eq.DELTA] + y[X2]
            r[LEFT_IMPACT] = y[V2]
        elif rigid:
            g[RELEASE] = push(RELEASE, mode, v, w, y, p)
            r[RELEASE] = push_rate(RELEASE, mode, t, y, p)
        else:
            g[RELEASE] = side * y[X2] - p[eq.DELTA]
            r[RELEASE] = side * y[V2]
        if direction != 0:
            force = moved(mode, v, w, y, p) - sliding_friction(direction, y[V1], p)
            mass = p[eq.M1] + p[eq.M2] if rigid and side != 0 else p[eq.M1]
            g[SLIP_END] = direction * y[V1]
            r[SLIP_END] = direction * force / mass
        else:
            load_rate = push_rate(BREAK_AWAY, mode, t, y, p)
            own = moved(mode, v, w, y, p)
            g[BREAK_AWAY] = static_limit(p) - abs(own)
            r[BREAK_AWAY] = -load_rate if own > 0.0 else load_rate

    def strike(side, resting, y, p):  # type: ignore[no-untyped-def]
        y[X2] = side * p[eq.DELTA]
        if rigid:
            e = 0.0 if resting else restitution(abs(y[V2]), p)
            y[V1] = eq.frame_speed_after(y[V1], y[V2], e, p)
            y[V2] = eq.block_speed_after(y[V2], e)

    def transition(mode, code, t, y, p):  # type: ignore[no-untyped-def]
        v, w = volts(t, p)
        if code in (RIGHT_IMPACT, LEFT_IMPACT):
            strike(1 if code == RIGHT_IMPACT else -1, False, y, p)
        elif code in (COUNT + RIGHT_IMPACT, COUNT + LEFT_IMPACT):
            # An accumulated sequence of impacts is one without rebound.
            strike(1 if code == COUNT + RIGHT_IMPACT else -1, True, y, p)
        elif code == RELEASE:
            # Depth, or force, is zero to rounding: let go whatever its sign.
            y[X2] = side_of(mode) * p[eq.DELTA]
            return mode_of(friction_mode(mode_of(STUCK, FREE), v, w, y, p), FREE)
        elif code == SLIP_END:
            y[V1] = 0.0
        elif code == BREAK_AWAY:
            # The push is at the static limit to rounding: slip whichever side it is on.
            y[V1] = 0.0
            return mode_of(friction_towards(moved(mode, v, w, y, p)), mode // 3)
        return mode_under(v, w, y, p)

    return Automaton(
        states=model.layout.states,
        modes=MODES,
        guards=GUARDS if rigid else tuple(replace(guard, impact=False) for guard in GUARDS),
        flow=flow,
        margins=margins,
        transition=transition,
        cyclic=() if model.places_frame else (X1,),
        bounds=bounds,
        recipe=(composed_automaton, (kinds, voltage, voltage_rate, left, left_rate, bounds)),
    )


def voltages(right: Function, left: Function | None, begin: int) -> Any:
    """Return the voltages of both electrodes as a function of time; 0 where there is none."""
    if left is None:

        def one(t, p):  # type: ignore[no-untyped-def]
            return right(t, p[begin:]), 0.0

        return one

    def both(t, p):  # type: ignore[no-untyped-def]
        q = p[begin:]
        return right(t, q), left(t, q)

    return both
