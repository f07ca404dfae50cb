"""Stiffness detection, and the choice between DOP853 and BDF.

Common source of the interpreted and the compiled engine, which contain two engines: the explicit
one-step method and CVODE's BDF. Stiffness is suspected if explicit steps are too short for their
order, that is, if the motion is nearly straight over many of them. If the Jacobian of the flow then
has a fast eigenvalue, BDF takes over. (The stability limit is no useful criterion: at tight
tolerances errors in the stages keep steps well below it.) The explicit method takes over again if
the steps of BDF are short compared with the inverse of the spectral radius, so that accuracy alone
would limit explicit steps. Between the two limits the present method continues.

The memory of every mode is one integer, which describes the end of its last arc:

- 0: the explicit method, with which the next arc begins;
- k > 0: the same, after k unsuccessful trials of BDF; the next trial requires 2**k times as many
  suspicious checks;
- below 0: BDF, with which the next arc begins, after -1 - k unsuccessful trials.

The memory changes at a handover only, which the event loop records, so that any arc of a run can be
integrated again.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mems_impact.integrators import interface

EXPLICIT, IMPLICIT = 0, 1

# Explicit steps per check. The motion is straight if its midpoint differs from the chord by less
# than a part of the chord, or by so many tolerances. BDF takes over if the spectral radius times
# the time of all steps exceeds a limit.
WINDOW, STRAIGHTNESS_RTOL, STRAIGHTNESS_TOLERANCES, ENTER_LIMIT = 16, 0.125, 50.0, 4.0
CHECK_INTERVAL = WINDOW // 2
LONG_STEP_RATIO = 0.5  # part of the longest allowed step above which a step is not short
# BDF steps per check; the explicit method takes over below a limit of step times spectral radius.
IMPLICIT_WINDOW, LEAVE_LIMIT = 32, 0.4
MAX_STEP_GROWTH = 2.0  # largest growth of steps between checks; above it steps are still adapting
MAX_DOUBLINGS = 10  # of the number of suspicious checks before a trial of BDF

# Iterations of the power method at the first check in an arc, and at later ones, which continue
# from its direction; step of its differences relative to the state.
FIRST_ITERATIONS, LATER_ITERATIONS, DIFFERENCE_STEP = 8, 2, 1e-7

# Rows with a value for each component of the state, in MEMORY for each mode.
STATE, SLOPE, AHEAD, CHANGED, DIRECTION, BEGIN, MIDDLE, MEMORY, ROWS = range(9)


def explicit(engine: Any) -> Any:
    """Return the engine of the one-step method."""
    return engine.explicit


def implicit(engine: Any) -> Any:
    """Return the engine of BDF."""
    return engine.implicit


def mirror_active(engine: Any, one: Any) -> None:
    """Make `one` the active engine."""
    engine.at_work = one


def row(engine: Any, i: int) -> Any:
    """Return row `i`."""
    return engine.rows[i]


def method_memory(engine: Any, mode: int) -> int:
    """Return the memory of `mode`."""
    return int(row(engine, MEMORY)[mode])


def reset(engine: Any, max_step: float) -> None:
    """Restore the initial state and clear all memory; no step is longer than `max_step`."""
    interface.reset(explicit(engine), max_step)
    interface.reset(implicit(engine), max_step)
    for mode in range(engine.modes):
        row(engine, MEMORY)[mode] = 0.0
    engine.wanted = 0
    engine.handed_over = 0
    engine.begun = 0


def sharpen(engine: Any, share: float, flight_time: float) -> None:
    """Reduce the tolerances of the next arc by the factor `share`, for both methods."""
    interface.sharpen(explicit(engine), share, flight_time)
    interface.sharpen(implicit(engine), share, flight_time)


def lengthen(engine: Any, longest: float) -> None:
    """Allow steps of up to `longest` until the next restart, for the active method."""
    if engine.now == IMPLICIT:
        interface.lengthen(implicit(engine), longest)
    else:
        interface.lengthen(explicit(engine), longest)


def restart(engine: Any, mode: int, t: float, y: Any, stop: float) -> None:
    """Begin an arc with the last method of its mode."""
    known = method_memory(engine, mode)
    engine.mode = mode
    engine.last_instant = float(np.nextafter(stop, -math.inf))
    engine.wanted = 0
    engine.checks = 0
    engine.directed = 0
    # If the first check after a handover returns to the explicit method, the trial was
    # unsuccessful.
    engine.trial = engine.handed_over
    engine.handed_over = 0
    engine.steps = 0
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
        engine.patience = 2 ** min(known, MAX_DOUBLINGS)
        engine.t_begin = t
        for j in range(engine.n):
            row(engine, BEGIN)[j] = y[j]
        interface.restart(explicit(engine), mode, t, y, stop)
        mirror_active(engine, explicit(engine))


def step(engine: Any) -> int:
    """Take a step with the active method, or hand over to the other."""
    if engine.wanted == 1:
        engine.wanted = 0
        hand_over(engine)
        return interface.HANDOVER
    if engine.now == IMPLICIT:
        return implicit_step(engine, implicit(engine))
    return step_explicit(engine, explicit(engine))


def hand_over(engine: Any) -> None:
    """Store in the memory of the mode that the other method continues."""
    memory, mode = row(engine, MEMORY), engine.mode
    if engine.now == EXPLICIT:
        memory[mode] = -1 - memory[mode]
        engine.handed_over = 1
    elif engine.trial == 1 and engine.checks == 1:
        memory[mode] = -memory[mode]
    else:
        memory[mode] = 0


def step_explicit(engine: Any, one: Any) -> int:
    """Take a step; request BDF if steps have been too short repeatedly and the flow is stiff."""
    interface.search_approaches(one, engine.approach_search)
    status = interface.step(one)
    mirror_active(engine, one)
    if status != interface.STEPPED:
        return status
    engine.steps += 1
    if engine.steps % CHECK_INTERVAL == 0:
        interface.state(one, row(engine, STATE))
        check_stiffness(engine, interface.time(one), one.longest)
    return status


def check_stiffness(engine: Any, t: float, longest: float) -> None:
    """Record STATE, at `t`, after half a window of steps; check them after the whole window."""
    y, begin, middle = row(engine, STATE), row(engine, BEGIN), row(engine, MIDDLE)
    if engine.steps % WINDOW != 0:
        engine.t_middle = t
        for j in range(engine.n):
            middle[j] = y[j]
        return
    length = (t - engine.t_middle) / CHECK_INTERVAL
    grown = t - engine.t_middle > MAX_STEP_GROWTH * (engine.t_middle - engine.t_begin)
    if grown or length > LONG_STEP_RATIO * longest or not straight(engine, t):
        engine.suspected = 0
    else:
        engine.suspected += 1
        if engine.suspected >= engine.patience:
            engine.suspected = 0
            if WINDOW * length * spectral_radius(engine, t) > ENTER_LIMIT:
                engine.wanted = 1
    engine.t_begin = t
    for j in range(engine.n):
        begin[j] = y[j]


def straight(engine: Any, t: float) -> bool:
    """Return whether the motion from BEGIN over MIDDLE to STATE, at `t`, is nearly straight."""
    begin, middle, y = row(engine, BEGIN), row(engine, MIDDLE), row(engine, STATE)
    share = (engine.t_middle - engine.t_begin) / (t - engine.t_begin)
    moved, bent = 0.0, 0.0
    for j in range(engine.states):
        scale = engine.atol + engine.rtol * abs(y[j])
        chord = (y[j] - begin[j]) / scale
        off = (middle[j] - begin[j]) / scale - share * chord
        moved += chord * chord
        bent += off * off
    return bent < max(
        STRAIGHTNESS_RTOL * STRAIGHTNESS_RTOL * moved,
        STRAIGHTNESS_TOLERANCES * STRAIGHTNESS_TOLERANCES * engine.states,
    )


def implicit_step(engine: Any, one: Any) -> int:
    """Take a step; request the explicit method if stability would not limit its steps."""
    before = interface.time(one)
    status = interface.step(one)
    mirror_active(engine, one)
    if status != interface.STEPPED:
        return status
    t = interface.time(one)
    engine.longest = max(engine.longest, t - before)
    engine.steps += 1
    if engine.steps % IMPLICIT_WINDOW == 0:
        if engine.longest <= MAX_STEP_GROWTH * engine.longest_before:
            engine.checks += 1
            interface.state(one, row(engine, STATE))
            if engine.longest * spectral_radius(engine, t) < LEAVE_LIMIT:
                engine.wanted = 1
        engine.longest_before = engine.longest
        engine.longest = 0.0
    return status


def spectral_radius(engine: Any, t: float) -> float:
    """Return an estimate of the spectral radius of the flow's Jacobian, at `t` and row STATE.

    By the power method on differences of the flow, as in explicit stabilized methods (B. P.
    Sommeijer, L. F. Shampine, J. G. Verwer, J. Comput. Appl. Math. 88, 1998); the direction is kept
    for the next check in the arc. The result is the mean of two growth factors, since under a pair
    of complex eigenvalues the direction rotates. It is nan if the flow is.
    """
    n, mode, now = engine.states, engine.mode, min(t, engine.last_instant)
    y, slope = row(engine, STATE), row(engine, SLOPE)
    ahead, changed, direction = row(engine, AHEAD), row(engine, CHANGED), row(engine, DIRECTION)
    count = LATER_ITERATIONS
    if engine.directed == 0:
        count = FIRST_ITERATIONS
        for j in range(n):  # a generic direction
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
            ahead[j] = y[j] + DIFFERENCE_STEP * direction[j]
        interface.flow(engine, mode, now, ahead, changed)
        for j in range(n):
            direction[j] = (changed[j] - slope[j]) / DIFFERENCE_STEP
        length = scaled_norm(engine, direction)
        before, growth = growth, length
    return math.sqrt(before * growth)


def scaled_norm(engine: Any, direction: Any) -> float:
    """Return the norm of a direction, with components relative to the state."""
    y, total = row(engine, STATE), 0.0
    for j in range(engine.states):
        part = direction[j] / size_of(engine, y[j])
        total += part * part
    return math.sqrt(total / engine.states)


def size_of(engine: Any, y: float) -> float:
    """Return the scale of a component, bounded below by the absolute tolerance."""
    return abs(y) + engine.atol / engine.rtol
