"""The way of an orbit through its segments, written over the engine's contract, for both forms.

One call takes all arcs and events of an orbit, with what they do to perturbations.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from mems_impact.engines import contract
from mems_impact.hybrid.columns import weight_of

FARTHEST_BACK = 1.0  # an arc of negative length beyond this is no arc near an orbit
NO_EVENT = -1  # as the code of what ends a segment
SCRATCH = 8  # rows of `work`
# Sixth differences of a smooth function are below this part of what it changes by. Where they are
# not, steps are taken finer by this factor, up to so many times.
ROUGH, FINER, REFINED = 1e-3, 0.125, 3


class Passage(NamedTuple):
    """N segments, and what is written of them. Arrays have a row for each segment.

    Attributes
    ----------
    n, m, parameters, directions, max_steps : int
        Components of the state, guards, parameters, directions in their space, steps that an arc
        may take.
    width : float
        Step of the differences.
    constrained : int array, shape (modes,)
        1 for a mode whose states lie on a manifold.
    segments : int array, shape (N, 3)
        Mode and code of what ends the segment (or NO_EVENT); gets the mode that this leads to.
    times : float array, shape (N, 4)
        Start, end, how far differences in time may go from the end, and when the margins at the
        end are looked at.
    motions : float array, shape (N, 2 directions)
        How instants move with each parameter: at the rate a + b t.
    states : float array, shape (N, n (1 + columns))
        State and columns at the start; gets those at the end.
    slopes : float array, shape (N, 2, n)
        Gets the flow at start and end.
    minima : float array, shape (N, 3, 2 m)
        Gets the smallest value that each margin has at a closest approach inside the arc (inf if it
        has none), and when; row 2 is scratch.
    touches : float array, shape (N, m, n (1 + columns))
        Gets state and columns there.
    margins : float array, shape (N, 2, 2 m)
        Gets margins and rates at start and end.
    margin, jump : float array, shapes (N, 2 m, 2 + n + directions), (N, n, ...)
        Get margins and rates before the event, and the state after it, with their derivatives: the
        value, then by each component of the state, by time, by each direction.
    after : float array, shape (N, n)
        Gets the state after the event.
    work : float array, shape (SCRATCH, 2 m + n or more)
    """

    n: int
    m: int
    parameters: int
    directions: int
    max_steps: int
    width: float
    constrained: Any
    segments: Any
    times: Any
    motions: Any
    states: Any
    slopes: Any
    minima: Any
    touches: Any
    margins: Any
    margin: Any
    jump: Any
    after: Any
    work: Any


def traverse(engine: Any, block: Any, way: Any) -> int:
    """Go through the segments of `way`, each from a state of its own, whatever the guards say.

    Parameters
    ----------
    engine
        Of the extended flow (see `mems_impact.hybrid.columns`).
    block : float array, shape (parameters * (1 + directions),)
        p and the directions in its space.
    way : Passage

    Returns
    -------
    int
        Number of the segment that cannot be integrated, or -1.
    """
    n, directions = way.n, way.directions
    free = way.states.shape[1] // n - 1 - directions
    slope = way.work[5]
    for i in range(block.size):
        contract.set_parameter(engine, i, block[i])
    for i in range(way.segments.shape[0]):
        mode, code = way.segments[i, 0], way.segments[i, 1]
        start, end = way.times[i, 0], way.times[i, 1]
        y, motions = way.states[i], way.motions[i]
        for j in range(2 * directions):
            contract.set_parameter(engine, block.size + j, motions[j])
        if way.constrained[mode] == 1:
            project(engine, mode, start, y, way, i)
        contract.margins(engine, mode, start, y, way.margins[i, 0])
        contract.flow(engine, mode, start, y, slope)
        for c in range(n):
            way.slopes[i, 0, c] = slope[c]
        for j in range(directions):
            moved = motions[2 * j] + motions[2 * j + 1] * start
            for c in range(n):
                y[n * (1 + free + j) + c] += slope[c] * moved
        if not integrate(engine, mode, y, start, end, way, i):
            return i
        # From the left, where a drive that switches at the end has not done so yet.
        contract.flow(engine, mode, end - 1e-15 * abs(end), y, slope)
        for c in range(n):
            way.slopes[i, 1, c] = slope[c]
        for j in range(directions):
            moved = motions[2 * j] + motions[2 * j + 1] * end
            for c in range(n):
                y[n * (1 + free + j) + c] -= slope[c] * moved
        contract.margins(engine, mode, way.times[i, 3], y, way.margins[i, 1])
        if code != NO_EVENT:
            differentiate_event(engine, mode, code, end, y, way.times[i, 2], way, i)
            for c in range(n):
                way.after[i, c] = y[c]
            way.segments[i, 2] = contract.transition(engine, mode, code, end, way.after[i])
    return -1


def project(engine: Any, mode: int, t: float, y: Any, into: Any, place: int) -> None:
    """Put a state onto what its mode holds, and its columns into the tangent space.

    Those of parameters, with which the manifold moves, come last. The row `place` of margin and
    jump of `into` is scratch.
    """
    n, directions = into.n, into.directions
    first = y.size // n - directions
    differentiate_event(engine, mode, 2 * into.m + 1, t, y, math.inf, into, place)
    jump, moved = into.jump[place], into.work[5]
    for c in range(1, y.size // n):
        for i in range(n):
            moved[i] = jump[i, n + 2 + c - first] if c >= first else 0.0
            for j in range(n):
                moved[i] += jump[i, 1 + j] * y[n * c + j]
        for i in range(n):
            y[n * c + i] = moved[i]
    contract.transition(engine, mode, 2 * into.m + 1, t, y)


def integrate(
    engine: Any, mode: int, y: Any, start: float, end: float, into: Any, place: int
) -> bool:
    """Integrate `mode` from `start` to `end`; `y` is overwritten. Return whether it went well.

    Closest approaches are written into the row `place` of the arrays of `into`, as of a `Passage`.
    """
    m, minima, touches = into.m, into.minima[place], into.touches[place]
    for i in range(m):
        minima[0, i] = math.inf
        minima[1, i] = math.nan
        # Only closest approaches are wanted. A margin and its rate that are zero together would
        # stop CVODE ("root found very near t").
        contract.set_bias(engine, i, 1e6)
    if start - end > FARTHEST_BACK:
        return False
    if end <= start:
        go_back(engine, mode, y, start, end, into.work)
        return True
    contract.restart(engine, mode, start, y, end)  # beyond it the drive may have switched
    for _ in range(into.max_steps):
        status = contract.step(engine)
        if status < 0:
            return False
        if status == contract.HANDOVER:
            contract.state(engine, y)
            contract.restart(engine, mode, contract.time(engine), y, end)
            continue
        t = contract.time(engine)
        if t >= end:
            contract.interpolate(engine, end, y)
            return True
        if status == contract.ROOT:
            contract.state(engine, y)
            contract.margins(engine, mode, t, y, minima[2])
            for i in range(m):
                if contract.fired(engine, m + i) > 0 and minima[2, i] < minima[0, i]:
                    minima[0, i] = minima[2, i]
                    minima[1, i] = t
                    for j in range(y.size):
                        touches[i, j] = y[j]
    return False


def go_back(engine: Any, mode: int, y: Any, start: float, end: float, work: Any) -> None:
    """Integrate from `start` back to an earlier `end`, by the classical Runge-Kutta method.

    An arc of negative length is met only where a guard is touched at zero speed and the equations
    are looked at from the other side; it is short, and at steps of 1e-3 the method is exact to
    rounding.
    """
    n = y.size
    steps = math.ceil((start - end) / 1e-3)
    k1, k2, k3, k4, x = work[0], work[1], work[2], work[3], work[4]
    for k in range(steps):
        h = (end - start) / steps
        t = start + k * h
        contract.flow(engine, mode, t, y, k1)
        for i in range(n):
            x[i] = y[i] + 0.5 * h * k1[i]
        contract.flow(engine, mode, t + 0.5 * h, x, k2)
        for i in range(n):
            x[i] = y[i] + 0.5 * h * k2[i]
        contract.flow(engine, mode, t + 0.5 * h, x, k3)
        for i in range(n):
            x[i] = y[i] + h * k3[i]
        contract.flow(engine, mode, t + h, x, k4)
        for i in range(n):
            y[i] += h * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]) / 6.0


def move_parameters(engine: Any, p: Any, count: int, direction: int, h: float) -> None:
    """Set the parameters to `p`, moved by `h` along a direction (kept behind them)."""
    for i in range(count):
        moved = h * contract.parameter(engine, count * (1 + direction) + i)
        contract.set_parameter(engine, i, p[i] + moved)


def differentiate_event(
    engine: Any, mode: int, code: int, t: float, y: Any, room: float, into: Any, place: int
) -> None:
    """Differentiate margin and transition `code` at (t, y) by state, time and parameters.

    Into the row `place` of margin and jump of `into`, as of a `Passage`. Differences in time stay
    within `room` of `t`. The engine's parameters are moved and put back.
    """
    n, m, count, directions = into.n, into.m, into.parameters, into.directions
    margin, jump, width, work = into.margin[place], into.jump[place], into.width, into.work
    shifted, g, p = work[0], work[6], work[7]
    for i in range(count):
        p[i] = contract.parameter(engine, i)
    for i in range(n):
        shifted[i] = y[i]
    contract.margins(engine, mode, t, shifted, g)
    contract.transition(engine, mode, code, t, shifted)
    for i in range(2 * m):
        margin[i, 0] = g[i]
    for i in range(n):
        jump[i, 0] = shifted[i]
    for c in range(1, 2 + n + directions):
        step = min(width, 0.3 * room) if c == n + 1 else width
        smooth = difference(engine, mode, code, t, y, c, step, into, place)
        # A function that jumps, or has a kink, beside (t, y), as an angle that is kept within one
        # turn: nearer to it nothing is seen of that, unless it is right there.
        for k in range(1, 1 + REFINED):
            if not smooth:
                near = step * FINER**k
                smooth = difference(engine, mode, code, t, y, c, near, into, place)
                if k == REFINED and not smooth:
                    difference(engine, mode, code, t, y, c, step, into, place)


def difference(
    engine: Any, mode: int, code: int, t: float, y: Any, c: int, step: float, into: Any, place: int
) -> bool:
    """Write the differences along one direction into column `c` (see `differentiate_event`).

    Returns whether they are those of smooth functions, whose sixth differences are far below what
    they change by.
    """
    n, m, count, work = into.n, into.m, into.parameters, into.work
    margin, jump = into.margin[place], into.jump[place]
    shifted, sixth, change, g, p = work[0], work[1], work[2], work[6], work[7]
    for i in range(2 * m):
        margin[i, c] = 0.0
    for i in range(n):
        jump[i, c] = 0.0
    for i in range(2 * m + n):
        value = margin[i, 0] if i < 2 * m else jump[i - 2 * m, 0]
        sixth[i] = -20.0 * value
        change[i] = 0.0
    for s in range(-3, 4):
        if s != 0:
            h = s * step
            weight = weight_of(s) / step
            bend = 15.0 if abs(s) == 1 else (-6.0 if abs(s) == 2 else 1.0)
            time = t
            for i in range(n):
                shifted[i] = y[i]
            if c <= n:
                shifted[c - 1] += h
            elif c == n + 1:
                time += h
            else:
                move_parameters(engine, p, count, c - n - 2, h)
            contract.margins(engine, mode, time, shifted, g)
            contract.transition(engine, mode, code, time, shifted)
            if c > n + 1:
                move_parameters(engine, p, count, c - n - 2, 0.0)
            for i in range(2 * m):
                margin[i, c] += weight * g[i]
                sixth[i] += bend * g[i]
                change[i] = max(change[i], abs(g[i] - margin[i, 0]))
            for i in range(n):
                jump[i, c] += weight * shifted[i]
                sixth[2 * m + i] += bend * shifted[i]
                change[2 * m + i] = max(change[2 * m + i], abs(shifted[i] - jump[i, 0]))
    smooth = True
    for i in range(2 * m + n):
        value = margin[i, 0] if i < 2 * m else jump[i - 2 * m, 0]
        if abs(sixth[i]) > ROUGH * change[i] + 1e-11 * (1.0 + abs(value)):
            smooth = False
    return smooth
