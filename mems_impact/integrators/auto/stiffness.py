"""Stiffness detection, and the choice between DOP853 and BDF.

One text for both engines, over an engine that holds two: the explicit one-step method and CVODE's
BDF. The explicit one is
under suspicion where its steps are too short for its order: a motion that is straight over many of
them is far smoother than they are. Where the flow's Jacobian has a fast eigenvalue, that is the
reason, and BDF takes over. (To wait for the border of stability would not do: at tight tolerances
what errs in the stages keeps steps well below it.) BDF hands back where its own steps are
short beside the inverse of the spectral radius, so that nothing but accuracy could limit others.
Between the two limits whichever method is at work goes on.

Of every mode is remembered how its last arc has ended, one whole number each:

- 0: by the explicit method, with which the next arc begins;
- k > 0: the same, BDF having been tried k times in vain, so that it is tried again only after
  2**k times as long under suspicion;
- below 0: by BDF, with which the next arc begins, after -1 - k trials in vain.

It changes at a hand-over only, which the event loop writes down, so that any arc of a run can be
integrated again as it was.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mems_impact.integrators import interface

EXPLICIT, IMPLICIT = 0, 1

# Explicit steps are looked at by so many. Their motion is straight if its middle is off the chord
# by less than that part of it, or by so many tolerances. BDF may take over if the spectral radius
# times the time of all of them exceeds a limit, and nothing but the error keeps them short.
WINDOW, STRAIGHT, NOTHING, ENTER = 16, 0.125, 50.0, 4.0
LONG = 0.5  # part of the longest step allowed, from which on one is not short
# So is BDF; it leaves where its steps times the spectral radius are below a limit.
LOOK, LEAVE = 32, 0.4
GROWN = 2.0  # steps that grow faster from look to look have not come to their length yet
MOST_DOUBLED = 10  # times the patience of the explicit method

# Steps of the power method: at the first look in an arc, and later, from where it has come to. The
# change of the state is so large a part of its size.
FIRST, LATER, NUDGE = 8, 2, 1e-7

# Rows of numbers: one for each component of the state, in MEMORY one for each mode.
STATE, SLOPE, AHEAD, CHANGED, DIRECTION, BEGIN, MIDDLE, MEMORY, ROWS = range(9)


def explicit(engine: Any) -> Any:
    """Return the engine of the one-step method."""
    return engine.explicit


def implicit(engine: Any) -> Any:
    """Return the engine of BDF."""
    return engine.implicit


def mirror_active(engine: Any, one: Any) -> None:
    """Let `engine` answer for `one`, which is at work."""
    engine.at_work = one


def row(engine: Any, i: int) -> Any:
    """Return row `i`."""
    return engine.rows[i]


def method_memory(engine: Any, mode: int) -> int:
    """Return what is remembered of `mode`."""
    return int(row(engine, MEMORY)[mode])


def reset(engine: Any, max_step: float) -> None:
    """Forget all that was before, of every mode; no step is longer than `max_step`."""
    interface.reset(explicit(engine), max_step)
    interface.reset(implicit(engine), max_step)
    for mode in range(engine.modes):
        row(engine, MEMORY)[mode] = 0.0
    engine.wanted = 0
    engine.handed = 0
    engine.begun = 0


def sharpen(engine: Any, share: float, lasts: float) -> None:
    """Let the next arc err by a `share` of the tolerances, by whichever method it begins."""
    interface.sharpen(explicit(engine), share, lasts)
    interface.sharpen(implicit(engine), share, lasts)


def restart(engine: Any, mode: int, t: float, y: Any, stop: float) -> None:
    """Begin an arc by the method with which the last one in its mode has ended."""
    known = method_memory(engine, mode)
    engine.mode = mode
    engine.last_instant = float(np.nextafter(stop, -math.inf))
    engine.wanted = 0
    engine.looks = 0
    engine.directed = 0
    # A first look in vain, in an arc that begins with a hand-over, makes a trial one in vain.
    engine.trial = engine.handed
    engine.handed = 0
    engine.taken = 0
    if known < 0:
        engine.now = IMPLICIT
        engine.begun += 1
        engine.longest = 0.0
        engine.longest_before = 0.0
        interface.restart(implicit(engine), mode, t, y, stop)
        mirror_active(engine, implicit(engine))
    else:
        engine.now = EXPLICIT
        engine.suspected = 0
        engine.patience = 2 ** min(known, MOST_DOUBLED)
        engine.t_begin = t
        for j in range(engine.n):
            row(engine, BEGIN)[j] = y[j]
        interface.restart(explicit(engine), mode, t, y, stop)
        mirror_active(engine, explicit(engine))


def step(engine: Any) -> int:
    """Take a step by the method at work, or hand over to the other."""
    if engine.wanted == 1:
        engine.wanted = 0
        hand_over(engine)
        return interface.HANDOVER
    if engine.now == IMPLICIT:
        return implicit_step(engine, implicit(engine))
    return step_explicit(engine, explicit(engine))


def hand_over(engine: Any) -> None:
    """Remember for the mode that the other method goes on from here."""
    memory, mode = row(engine, MEMORY), engine.mode
    if engine.now == EXPLICIT:
        memory[mode] = -1 - memory[mode]
        engine.handed = 1
    elif engine.trial == 1 and engine.looks == 1:
        memory[mode] = -memory[mode]
    else:
        memory[mode] = 0


def step_explicit(engine: Any, one: Any) -> int:
    """Take a step, and ask for BDF if steps have been too short for long, and the flow is stiff."""
    status = interface.step(one)
    mirror_active(engine, one)
    if status != interface.STEPPED:
        return status
    engine.taken += 1
    if engine.taken % WINDOW == WINDOW // 2:
        engine.t_middle = interface.time(one)
        interface.state(one, row(engine, MIDDLE))
    elif engine.taken % WINDOW == 0:
        t = interface.time(one)
        interface.state(one, row(engine, STATE))
        length = (t - engine.t_middle) / (WINDOW // 2)
        grown = t - engine.t_middle > GROWN * (engine.t_middle - engine.t_begin)
        if grown or length > LONG * one.longest or not straight(engine, t):
            engine.suspected = 0
        else:
            engine.suspected += 1
            if engine.suspected >= engine.patience:
                engine.suspected = 0
                if WINDOW * length * spectral_radius(engine, t) > ENTER:
                    engine.wanted = 1
        engine.t_begin = t
        for j in range(engine.n):
            row(engine, BEGIN)[j] = row(engine, STATE)[j]
    return status


def straight(engine: Any, t: float) -> bool:
    """Return whether the motion from BEGIN over MIDDLE to STATE, at `t`, is nearly straight."""
    begin, middle, y = row(engine, BEGIN), row(engine, MIDDLE), row(engine, STATE)
    share = (engine.t_middle - engine.t_begin) / (t - engine.t_begin)
    moved, bent = 0.0, 0.0
    for j in range(engine.n):
        scale = engine.atol + engine.rtol * abs(y[j])
        chord = (y[j] - begin[j]) / scale
        off = (middle[j] - begin[j]) / scale - share * chord
        moved += chord * chord
        bent += off * off
    return bent < max(STRAIGHT * STRAIGHT * moved, NOTHING * NOTHING * engine.n)


def implicit_step(engine: Any, one: Any) -> int:
    """Take a step, and ask for the explicit method if it could take far longer ones."""
    before = interface.time(one)
    status = interface.step(one)
    mirror_active(engine, one)
    if status != interface.STEPPED:
        return status
    t = interface.time(one)
    engine.longest = max(engine.longest, t - before)
    engine.taken += 1
    if engine.taken % LOOK == 0:
        if engine.longest <= GROWN * engine.longest_before:
            engine.looks += 1
            interface.state(one, row(engine, STATE))
            if engine.longest * spectral_radius(engine, t) < LEAVE:
                engine.wanted = 1
        engine.longest_before = engine.longest
        engine.longest = 0.0
    return status


def spectral_radius(engine: Any, t: float) -> float:
    """Return an estimate of the spectral radius of the flow's Jacobian, at `t` and row STATE.

    By the power method on differences of the flow, as in explicit stabilized methods (B. P.
    Sommeijer, L. F. Shampine, J. G. Verwer, J. Comput. Appl. Math. 88, 1998); the direction is
    kept for the next look in the arc. The mean of two growths is told: under a pair of complex
    eigenvalues the direction goes on turning. Not a number where the flow is none.
    """
    n, mode, now = engine.n, engine.mode, min(t, engine.last_instant)
    y, slope = row(engine, STATE), row(engine, SLOPE)
    ahead, changed, direction = row(engine, AHEAD), row(engine, CHANGED), row(engine, DIRECTION)
    count = LATER
    if engine.directed == 0:
        count = FIRST
        for j in range(n):  # any direction, but that of no component alone
            direction[j] = size_of(engine, y[j]) * (1.0 + 0.5 * math.cos(3.0 * j))
    engine.directed = 1
    interface.flow(engine, mode, now, y, slope)
    length = scaled_norm(engine, direction)
    before, growth = 0.0, 0.0
    for _ in range(count):
        if not length > 0.0:
            engine.directed = 0
            return length
        for j in range(n):
            direction[j] /= length
            ahead[j] = y[j] + NUDGE * direction[j]
        interface.flow(engine, mode, now, ahead, changed)
        for j in range(n):
            direction[j] = (changed[j] - slope[j]) / NUDGE
        length = scaled_norm(engine, direction)
        before, growth = growth, length
    return math.sqrt(before * growth)


def scaled_norm(engine: Any, direction: Any) -> float:
    """Return the length of a direction, each component in the size of the state's."""
    y, total = row(engine, STATE), 0.0
    for j in range(engine.n):
        part = direction[j] / size_of(engine, y[j])
        total += part * part
    return math.sqrt(total / engine.n)


def size_of(engine: Any, y: float) -> float:
    """Return how large a component counts: below it the absolute tolerance does."""
    return abs(y) + engine.atol / engine.rtol
