"""Step by step through an arc: control of the step, and roots within it.

The text of `step`, `restart`, `renew` and `interpolate` of the engine's contract, for both engines.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mems_impact.engines import contract
from mems_impact.engines.onestep.method import (
    ARGUMENT,
    END,
    HIGH,
    LOW,
    SLOPE,
    START,
    STATE,
    component,
    dense_at,
    row,
    slope_at_end,
    stretched,
    try_step,
)
from mems_impact.engines.onestep.roots import any_crossed, close_in, root_functions

ERROR_TEST = -3  # of contract.FAILURES

# Step control of DOP853. The part of the last step's error that it leaves to choose (beta) stays
# out, as by default there: at 0.04 the paper's set takes 4 to 9 % more steps, at 0.08 28 to 38 %.
SAFETY, SHRINK, GROW = 0.9, 1.0 / 3.0, 6.0

# The textbook's first step is cautious at order 8: on smooth arcs of this package the error
# estimate then allows one that is 4 to 28 times as long, mostly 6 to 10.
BOLD = 6.0
# Steps that an arc up to a stop takes at least: between two switches a drive may do in a moment
# what it else does in a period, such as swing from one sign to the other, and margins are looked
# at only where steps end.
LOOKS = 4.0
RETREAT = 0.25  # a step into where the functions are not finite is cut to this
ULP = 2.0**-52

# Hairer's test of stiffness: the product of step and eigenvalue at the border of stability, often
# in a row. It is made every so many steps, and at every step once it has been met.
BORDER, IN_A_ROW, FAR_FROM_IT, EVERY = 6.1, 15, 6, 64


def renew(engine: Any, max_step: float) -> None:
    """Forget all that was before; no step is longer than `max_step`."""
    engine.max_step = max_step
    engine.h_next = 0.0
    engine.at_border = 0
    engine.off_border = 0
    engine.stiff = 0
    engine.steps = 0


def restart(engine: Any, mode: int, t: float, y: Any, stop: float) -> None:
    """Begin an arc at (t, y) in `mode`, of which nothing is evaluated from `stop` on."""
    for j in range(engine.n):
        row(engine, START)[j] = y[j]
        row(engine, END)[j] = y[j]
        row(engine, STATE)[j] = y[j]
    engine.mode = mode
    engine.t = t
    engine.t_start = t
    engine.t_end = t
    engine.stop = stop
    engine.last_instant = float(np.nextafter(stop, -math.inf))
    engine.longest = min(engine.max_step, (stop - t) / LOOKS)
    engine.begun = 0
    engine.rest = 0


def step(engine: Any) -> int:
    """Take one step, or go to the first root in it or in what is left of the last one."""
    if engine.rest == 0:
        if engine.begun == 0:
            status = begin(engine)
            if status < 0:
                return status
        status = take_step(engine)
        if status < 0:
            return status
    return look(engine)


def begin(engine: Any) -> int:
    """Evaluate slope and root functions at the start of an arc, and choose its first step."""
    t = engine.t
    if not slope_at_end(engine, t):
        return contract.NON_FINITE
    if not root_functions(engine, t, row(engine, END), row(engine, LOW)):
        return contract.NO_GUARD
    leave_section(engine, row(engine, LOW), 0)
    engine.h_next = first_step(engine)
    engine.begun = 1
    return contract.STEPPED


def first_step(engine: Any) -> float:
    """Return a first step by slope and curvature (Hairer, Norsett, Wanner I, Section II.4).

    The length of the last arc's steps is no guide: an arc must not depend on what was before it,
    or a run could not be taken up at any of its events.
    """
    n = engine.n
    y, ahead, changed = row(engine, END), row(engine, ARGUMENT), row(engine, SLOPE)
    size, speed = 0.0, 0.0
    for j in range(n):
        scale = engine.atol + engine.rtol * abs(y[j])
        size += (y[j] / scale) * (y[j] / scale)
        speed += (component(engine, j)[12] / scale) * (component(engine, j)[12] / scale)
    longest = engine.longest
    # A state within the tolerance of zero, or a slope that is, has no scale of its own.
    scaled = size > 1.0 and speed > 1e-10
    h = min(0.01 * math.sqrt(size / speed) if scaled else 1e-3 * engine.max_step, longest)
    for j in range(n):
        ahead[j] = y[j] + h * component(engine, j)[12]
    contract.flow(engine, engine.mode, min(engine.t + h, engine.last_instant), ahead, changed)
    bend = 0.0
    for j in range(n):
        scale = engine.atol + engine.rtol * abs(y[j])
        change = (changed[j] - component(engine, j)[12]) / scale
        bend += change * change
    if not math.isfinite(bend):
        return h
    steepest = max(math.sqrt(bend) / h, math.sqrt(speed))
    if steepest <= 1e-15:
        return longest
    return min(100.0 * h, BOLD * eighth_root(0.01 / steepest), longest)


def eighth_root(x: float) -> float:
    """Return the eighth root, which is how the step goes with the error."""
    return math.sqrt(math.sqrt(math.sqrt(x)))


def take_step(engine: Any) -> int:
    """Take one step that the error estimate allows, from where the last one ended."""
    start, end = row(engine, START), row(engine, END)
    for j in range(engine.n):
        start[j] = end[j]
        component(engine, j)[0] = component(engine, j)[12]
    engine.has_dense = 0
    t = engine.t_end
    smallest = 4.0 * ULP * max(abs(t), engine.max_step)
    h = max(min(engine.h_next, engine.longest), smallest)
    failure = ERROR_TEST
    rejected = False
    while True:
        planned = h
        ahead = t + h
        # A little longer, where that spares a tiny last step.
        if ahead >= engine.stop or engine.stop - t <= min(1.01 * h, engine.max_step):
            ahead = engine.stop
        h = ahead - t  # exactly the time that goes by
        error = try_step(engine, t, h)
        if not math.isfinite(error):
            failure = contract.NON_FINITE
            h *= RETREAT
        elif error > 1.0:
            h *= max(SHRINK, SAFETY / eighth_root(error))
        elif not slope_at_end(engine, ahead):
            failure = contract.NON_FINITE
            h *= RETREAT
        elif not root_functions(engine, ahead, end, row(engine, HIGH)):
            failure = contract.NO_GUARD
            h *= RETREAT
        else:
            break
        rejected = True
        if h < smallest:
            return failure
    engine.steps += 1
    engine.t_start = t
    engine.t_end = ahead
    longer = h * min(GROW, SAFETY / max(eighth_root(error), 1e-3))
    if rejected:
        longer = min(longer, h)
    # A step that was cut at the stop does not say that a longer one would fail.
    engine.h_next = max(longer, planned) if h < planned else longer
    watch_stability(engine, h)
    return contract.STEPPED


def watch_stability(engine: Any, h: float) -> None:
    """Count steps at the border of stability; mark the run as stiff after many in a row."""
    if engine.at_border == 0 and engine.steps % EVERY != 0:
        return
    if stretched(engine, h) > BORDER:
        engine.off_border = 0
        engine.at_border += 1
        if engine.at_border >= IN_A_ROW:
            engine.stiff = 1
    else:
        engine.off_border += 1
        if engine.off_border >= FAR_FROM_IT:
            engine.at_border = 0


def look(engine: Any) -> int:
    """Go to the first root between the time last told and the end of the step, or to that end."""
    low, high = row(engine, LOW), row(engine, HIGH)
    count = 2 * engine.m + 1
    if any_crossed(engine, low, high):
        t = close_in(engine, engine.t, engine.t_end)
        if math.isnan(t):
            return contract.NO_GUARD
        # A root at the stop is not told: the loop looks at all margins after a switch.
        if t < engine.stop:
            leave_section(engine, low, contract.fired(engine, count - 1))
            dense_at(engine, t, row(engine, STATE))
            engine.t = t
            engine.rest = 1 if t < engine.t_end else 0
            return contract.ROOT
    leave_section(engine, high, 0)
    for i in range(count):
        low[i] = high[i]
    for j in range(engine.n):
        row(engine, STATE)[j] = row(engine, END)[j]
    engine.t = engine.t_end
    engine.rest = 0
    return contract.STOPPED if engine.t_end >= engine.stop else contract.STEPPED


def leave_section(engine: Any, values: Any, side: int) -> None:
    """Put a state on the section to the side that it goes to, lest it cross it twice or never.

    `side` is 0 at the start or end of a step, where the slope tells.
    """
    last = 2 * engine.m
    if values[last] == 0.0:
        slope = component(engine, engine.section)[12]
        if side == 0:
            side = 1 if slope > 0.0 else (-1 if slope < 0.0 else 0)
        values[last] = 1e-300 * side


def interpolate(engine: Any, t: float, y: Any) -> None:
    """Write the state at `t`, within the last step, into `y`."""
    dense_at(engine, t, y)
