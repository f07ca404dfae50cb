"""Propagation of perturbations: arcs, saltation matrices, orthonormalization.

One call takes all arcs and events of an orbit, with what they do to perturbations.

Written over the interface of integrators, for both forms. Along a run perturbations follow its log
of events, and after each the state is the run's; nothing that is asked of them moves the run by a
rounding. The run has an integrator of its own, and the columns are carried through its events by
that of the extended flow.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from mems_impact.hybrid.differences import weight_of
from mems_impact.hybrid.event_loop import loop
from mems_impact.hybrid.event_loop.event_detection import (
    FADING,
    MIN_SUBSTEP_RATIO,
    ROUNDINGS,
    TOLERANCES,
    bisect_rate,
    certify_no_crossing,
)
from mems_impact.hybrid.event_loop.workspace import (
    ACCUMULATION,
    APPROACH,
    BUFFER_FULL,
    CYCLE,
    DONE,
    EPS,
    FAILED,
    GUARD,
    HANDOVER,
    HEAD,
    KIND,
    MODE_AFTER,
    MODE_BEFORE,
    NONE,
    PAUSED,
    REBASE,
    SECTION_CROSSING,
    SWITCH,
    TIME,
    TRANSITION,
    Y,
    event_at,
    table_row,
    whole_periods,
)
from mems_impact.hybrid.problem import Problem
from mems_impact.integrators import interface

# --- The way of an orbit through its segments, written over the engine's contract, for both
# forms.

FARTHEST_BACK = 1.0  # an arc of negative length beyond this is no arc near an orbit
NO_EVENT = -1  # as the code of what ends a segment
WORK_ROWS = 11  # rows of `work`
# Sixth differences of a smooth function are below this part of what it changes by. Where they are
# not, steps are taken finer by this factor, up to so many times.
ROUGH, FINER, REFINED = 1e-3, 0.125, 3


class VariationalWorkspace(NamedTuple):
    """Sizes, constants and arrays of arcs and events with derivatives. N is 1 along a run.

    Attributes
    ----------
    n, m, parameters, directions, max_steps : int
        Components of the state, guards, parameters, directions in their space, steps that an arc
        may take.
    width : float
        Step of the differences.
    constrained : int array, shape (modes,)
        1 for a mode whose states lie on a manifold.
    minima : float array, shape (N, 2, m)
        Gets the smallest value that each margin has at a closest approach inside the arc (inf if it
        has none), and when. Of approaches between which an engine sees no change of the rate's
        sign, only those are told that come near zero or below it.
    touches : float array, shape (N, m, n (1 + columns))
        Gets state and columns there.
    margin, jump : float array, shapes (N, 2 m, 2 + n + directions), (N, n, ...)
        Get margins and rates before the event, and the state after it, with their derivatives: the
        value, then by each component of the state, by time, by each direction.
    work : float array, shape (WORK_ROWS, 2 m + n or more)
    """

    n: int
    m: int
    parameters: int
    directions: int
    max_steps: int
    width: float
    constrained: Any
    minima: Any
    touches: Any
    margin: Any
    jump: Any
    work: Any

    def with_rows(self, count: int) -> VariationalWorkspace:
        """Return the workspace with new arrays for N = `count`."""
        return self._replace(
            minima=np.zeros((count, *self.minima.shape[1:])),
            touches=np.zeros((count, *self.touches.shape[1:])),
            margin=np.zeros((count, *self.margin.shape[1:])),
            jump=np.zeros((count, *self.jump.shape[1:])),
        )


def variational_workspace(problem: Problem, directions: int, size: int) -> VariationalWorkspace:
    """Return a workspace for one segment, with `size` components of state and columns."""
    automaton = problem.automaton
    n, m, parameters = len(automaton.states), len(automaton.guards), len(problem.parameters)
    modes = range(len(automaton.modes))
    return VariationalWorkspace(
        n=n,
        m=m,
        parameters=parameters,
        directions=directions,
        max_steps=problem.options.max_steps,
        width=automaton.step,
        constrained=np.array([int(mode in automaton.constrained) for mode in modes]),
        minima=np.zeros((1, 2, m)),
        touches=np.zeros((1, m, size)),
        margin=np.zeros((1, 2 * m, n + 2 + directions)),
        jump=np.zeros((1, n, n + 2 + directions)),
        work=np.zeros((WORK_ROWS, max(size, 2 * m + n, parameters))),
    )


class SegmentBatch(NamedTuple):
    """N segments, and what is written of them. Arrays have a row for each segment.

    Attributes
    ----------
    variational : VariationalWorkspace
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
    margins : float array, shape (N, 2, 2 m)
        Gets margins and rates at start and end.
    after : float array, shape (N, n)
        Gets the state after the event.
    """

    variational: VariationalWorkspace
    segments: Any
    times: Any
    motions: Any
    states: Any
    slopes: Any
    margins: Any
    after: Any


def propagate_segments(engine: Any, block: Any, way: Any) -> int:
    """Go through the segments of `way`, each from a state of its own, whatever the guards say.

    Parameters
    ----------
    engine
        Of the extended flow (see `mems_impact.hybrid.variational.flow`).
    block : float array, shape (parameters * (1 + directions),)
        p and the directions in its space.
    way : SegmentBatch

    Returns
    -------
    int
        Number of the segment that cannot be integrated, or -1.
    """
    into = way.variational
    n, directions = into.n, into.directions
    free = way.states.shape[1] // n - 1 - directions
    slope = into.work[5]
    for i in range(block.size):
        interface.set_parameter(engine, i, block[i])
    for i in range(way.segments.shape[0]):
        mode, code = way.segments[i, 0], way.segments[i, 1]
        start, end = way.times[i, 0], way.times[i, 1]
        y, motions = way.states[i], way.motions[i]
        for j in range(2 * directions):
            interface.set_parameter(engine, block.size + j, motions[j])
        if into.constrained[mode] == 1:
            project(engine, mode, start, y, into, i)
        interface.margins(engine, mode, start, y, way.margins[i, 0])
        interface.flow(engine, mode, start, y, slope)
        for c in range(n):
            way.slopes[i, 0, c] = slope[c]
        for j in range(directions):
            moved = motions[2 * j] + motions[2 * j + 1] * start
            for c in range(n):
                y[n * (1 + free + j) + c] += slope[c] * moved
        if not integrate(engine, mode, y, start, end, into, i, watched=True):
            return i
        # From the left, where a drive that switches at the end has not done so yet.
        interface.flow(engine, mode, end - 1e-15 * abs(end), y, slope)
        for c in range(n):
            way.slopes[i, 1, c] = slope[c]
        for j in range(directions):
            moved = motions[2 * j] + motions[2 * j + 1] * end
            for c in range(n):
                y[n * (1 + free + j) + c] -= slope[c] * moved
        interface.margins(engine, mode, way.times[i, 3], y, way.margins[i, 1])
        if code != NO_EVENT:
            differentiate_event(engine, mode, code, end, y, way.times[i, 2], into, i)
            for c in range(n):
                way.after[i, c] = y[c]
            way.segments[i, 2] = interface.transition(engine, mode, code, end, way.after[i])
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
    interface.transition(engine, mode, 2 * into.m + 1, t, y)


def integrate(
    engine: Any, mode: int, y: Any, start: float, end: float, into: Any, place: int, watched: bool
) -> bool:
    """Integrate `mode` from `start` to `end`; `y` is overwritten. Return whether it went well.

    If `watched`, closest approaches are written into the row `place` of the arrays of `into`, as of
    a `VariationalWorkspace`.
    """
    m = into.m
    for i in range(m):
        into.minima[place, 0, i] = math.inf
        into.minima[place, 1, i] = math.nan
        # Only closest approaches are wanted. A margin and its rate that are zero together would
        # stop CVODE ("root found very near t").
        interface.set_bias(engine, i, 1e6)
    if start - end > FARTHEST_BACK:
        return False
    if end <= start:
        integrate_backward(engine, mode, y, start, end, into.work)
        return True
    if watched:
        begin_watch(engine, mode, start, y, into)
    interface.restart(engine, mode, start, y, end)  # beyond it the drive may have switched
    t = start
    for _ in range(into.max_steps):
        status = interface.step(engine)
        if status < 0:
            return False
        if status == interface.HANDOVER:
            interface.state(engine, y)
            interface.restart(engine, mode, interface.time(engine), y, end)
            continue
        before, t = t, interface.time(engine)
        if watched:
            watch_step(engine, status, mode, before, t, y, into, place)
        if t >= end:
            interface.interpolate(engine, end, y)
            return True
    return False


def begin_watch(engine: Any, mode: int, t: float, y: Any, into: Any) -> None:
    """Take down margins and rates where an arc begins, at (t, y)."""
    now, curved, highest = into.work[2], into.work[3], into.work[6]
    interface.margins(engine, mode, t, y, now)
    for i in range(into.m):
        curved[i] = 0.0
        highest[i] = now[i]


def watch_step(
    engine: Any, status: int, mode: int, before: float, t: float, y: Any, into: Any, place: int
) -> None:
    """Note the closest approaches in the step from `before` to `t`, which the engine has taken.

    It tells one where the rate has another sign at the end of the step. Others are looked for as
    runs look for hidden crossings (`event_detection.find_hidden_crossing`). Overwrites `y`.
    """
    m, h = into.m, t - before
    then, now, curved, highest = into.work[1], into.work[2], into.work[3], into.work[6]
    for k in range(2 * m):
        then[k] = now[k]
    interface.end_margins(engine, now)
    for i in range(m):
        direction = 0
        if status == interface.ROOT:
            direction = interface.root_directions(engine, m + i)
        if direction != 0:
            now[m + i] = 0.0
        if h > 0.0 and (now[i] != then[i] or now[m + i] != then[m + i]):
            curved[i] = max(abs(now[m + i] - then[m + i]) / h, FADING * curved[i])
            if not certify_no_crossing(then[i], then[m + i], now[i], now[m + i], h, curved[i]):
                find_closest_approaches(engine, mode, i, before, t, y, into, place)
        if direction > 0:
            interface.state(engine, y)
            note_approach(i, t, now[i], y, into, place)
        highest[i] = max(highest[i], now[i])


def find_closest_approaches(
    engine: Any, mode: int, i: int, before: float, t: float, y: Any, into: Any, place: int
) -> None:
    """Note the closest approaches of margin `i` near zero or below it inside the last step.

    It is walked through in parts so short that the margin stays above zero, or rises or falls
    throughout, or turns once. Overwrites `y`.
    """
    m = into.m
    then, now, g, highest = into.work[1], into.work[2], into.work[4], into.work[6]
    a, g_a, r_a = before, then[i], then[m + i]
    curved = into.work[3][i]
    interface.interpolate(engine, t, y)
    rounding = margin_rounding(max(abs(then[i]), abs(now[i])), y, into.n)
    finest = max(MIN_SUBSTEP_RATIO * (t - before), 8.0 * EPS * abs(t))
    width = 0.5 * (t - before)
    while a < t:
        b = a + width if a + 1.5 * width < t else t
        g_b, r_b = now[i], now[m + i]
        if b < t:
            interface.interpolate(engine, b, y)
            interface.margins(engine, mode, b, y, g)
            g_b, r_b = g[i], g[m + i]
        h = b - a
        curved = max(curved, abs(r_b - r_a) / h)
        slowest, fastest = min(abs(r_a), abs(r_b)), max(abs(r_a), abs(r_b), curved * h)
        one_way = r_a * r_b > 0.0 and slowest > curved * h
        certain = (
            one_way or fastest * h <= rounding or certify_no_crossing(g_a, r_a, g_b, r_b, h, curved)
        )
        if h > finest and not certain:
            width *= 0.5
            continue
        if not certain and r_a < 0.0 < r_b:
            closest = bisect_rate(engine, mode, m + i, a, b, 1.0, y, g)
            interface.interpolate(engine, closest, y)
            interface.margins(engine, mode, closest, y, g)
            note_approach(i, closest, g[i], y, into, place)
        highest[i] = max(highest[i], g_b)
        a, g_a, r_a = b, g_b, r_b
        width *= 2.0


def note_approach(i: int, t: float, margin: float, y: Any, into: Any, place: int) -> None:
    """Write a closest approach of margin `i` at (t, y), if it is the closest one so far.

    Where an arc begins at a margin of zero with no speed, its rate may fall by rounding alone.
    """
    minima, highest = into.minima[place], into.work[6][i]
    fallen = highest - margin > margin_rounding(max(abs(highest), abs(margin)), y, into.n)
    if fallen and margin < minima[0, i]:
        minima[0, i] = margin
        minima[1, i] = t
        for j in range(y.size):
            into.touches[place, i, j] = y[j]


def margin_rounding(margin: float, y: Any, n: int) -> float:
    """Return what rounding may make of a margin of this size where the state is `y`."""
    size = margin
    for j in range(n):
        size = max(size, abs(y[j]))
    rounding: float = ROUNDINGS * EPS * size
    return rounding


def integrate_backward(engine: Any, mode: int, y: Any, start: float, end: float, work: Any) -> None:
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
        interface.flow(engine, mode, t, y, k1)
        for i in range(n):
            x[i] = y[i] + 0.5 * h * k1[i]
        interface.flow(engine, mode, t + 0.5 * h, x, k2)
        for i in range(n):
            x[i] = y[i] + 0.5 * h * k2[i]
        interface.flow(engine, mode, t + 0.5 * h, x, k3)
        for i in range(n):
            x[i] = y[i] + h * k3[i]
        interface.flow(engine, mode, t + h, x, k4)
        for i in range(n):
            y[i] += h * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]) / 6.0


def move_parameters(engine: Any, p: Any, count: int, direction: int, h: float) -> None:
    """Set the parameters to `p`, moved by `h` along a direction (kept behind them)."""
    for i in range(count):
        moved = h * interface.parameter(engine, count * (1 + direction) + i)
        interface.set_parameter(engine, i, p[i] + moved)


def differentiate_event(
    engine: Any, mode: int, code: int, t: float, y: Any, room: float, into: Any, place: int
) -> None:
    """Differentiate margin and transition `code` at (t, y) by state, time and parameters.

    Into the row `place` of margin and jump of `into`, a `VariationalWorkspace`. Differences in time
    stay within `room` of `t`. The engine's parameters are moved and put back.
    """
    n, m, count, directions = into.n, into.m, into.parameters, into.directions
    margin, jump, width, work = into.margin[place], into.jump[place], into.width, into.work
    shifted, g, p = work[0], work[6], work[7]
    for i in range(count):
        p[i] = interface.parameter(engine, i)
    for i in range(n):
        shifted[i] = y[i]
    interface.margins(engine, mode, t, shifted, g)
    interface.transition(engine, mode, code, t, shifted)
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
            interface.margins(engine, mode, time, shifted, g)
            interface.transition(engine, mode, code, time, shifted)
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


# --- Perturbations carried along a run that is known, over its arcs and through its events.

NEAREST = 1e-9  # room that is left to differences in time beside a switch of the drive
SLOWEST = 1e-14  # a guard is touched at this rate at least: beyond, perturbations know no bounds
# A column of which an event leaves less than this part has nothing left: differences are no better.
ZERO_COLUMN = 1e-11
# An event acts on a component that it changes by more, or its rate, or what of a column it keeps.
ACTS = 1e-9
# Columns that shrink, or turn into each other, by more than this between two orthonormalizations
# lose digits: then these come twice as often, until they are no longer needed.
REORTHONORMALIZE_BELOW = 1e-3


class PerturbationState(NamedTuple):
    """A state of the run and k columns, with what has become of these; changed in place.

    Attributes
    ----------
    y : float array, shape (n (1 + k),)
        The state, its cyclic components zero, then the columns: orthonormal but for their cyclic
        components.
    place : int array, shape (2,)
        Periods completed before the time base, and the mode.
    t : float array, shape (1,)
        Time since the time base.
    shifts : float array, shape (k,)
        How much sooner the events of this instant come for each column: the other way round, later.
    growth : float array, shape (k,)
        Logarithms of what each column has grown by.
    alive : int array, shape (k,)
        0 for a column that an event has left nothing of.
    changed : int array, shape (n,)
        1 for a component that an event has acted on.
    length : float array, shape (1,)
        Time after which columns are made orthonormal again at the latest, up to the time scale.
    """

    y: Any
    place: Any
    t: Any
    shifts: Any
    growth: Any
    alive: Any
    changed: Any
    length: Any


class PropagationProblem(NamedTuple):
    """What of a problem is asked on the way.

    Attributes
    ----------
    variational : VariationalWorkspace
    k : int
        Columns.
    period, scale, rtol, atol : float
        `scale` is the problem's time scale.
    cyclic : int array, shape (n,)
        1 for a component that is cyclic.
    records : int array, shape (m,)
        1 for a guard that only records.
    switches : float array, shape (s,)
    """

    variational: VariationalWorkspace
    k: int
    period: float
    scale: float
    rtol: float
    atol: float
    cyclic: Any
    records: Any
    switches: Any


def propagate_to_event(engine: Any, event: Any, at: Any, setup: Any) -> bool:
    """Carry the columns up to an event, and through it; return whether that went well."""
    into = setup.variational
    n, kind, guard = into.n, int(event[KIND]), int(event[GUARD])
    passes = kind == TRANSITION and setup.records[guard] == 1
    if passes or kind in (APPROACH, SECTION_CROSSING, HANDOVER):
        return True
    cycle, time = int(event[CYCLE]), event[TIME]
    if kind == ACCUMULATION:
        # What is left of a sequence is told from its last impact on.
        if not is_at(event, at, setup):
            if not propagate(engine, cycle, time, at, setup):
                return False
            load_state(event, HEAD, at, setup)
        apply_rest_saltation(engine, guard, at, setup)
        orthonormalize(ZERO_COLUMN, at, setup)
    if not propagate(engine, cycle, time, at, setup):
        return False
    load_state(event, HEAD, at, setup)
    if kind in (TRANSITION, SWITCH):
        apply_saltation(engine, event, at, setup)
    at.place[1] = int(event[MODE_AFTER])
    load_state(event, HEAD + n, at, setup)
    if kind != REBASE:
        constrain(engine, at, setup)
        orthonormalize(ZERO_COLUMN, at, setup)
    return True


def flow_at(engine: Any, mode: int, t: float, y: Any, dy: Any) -> None:
    """Write the derivative of state and columns into `dy`."""
    interface.flow(engine, mode, t, y, dy)


def load_state(numbers: Any, first: int, at: Any, setup: Any) -> None:
    """Put the state to `numbers` from `first` on, but for what its cyclic components gathered."""
    into = setup.variational
    for j in range(into.n):
        at.y[j] = 0.0 if setup.cyclic[j] == 1 else numbers[first + j]


def is_at(event: Any, at: Any, setup: Any) -> bool:
    """Return whether the columns stand at the state before an event: it completes a sequence."""
    into = setup.variational
    same = True
    for j in range(into.n):
        same = same and (setup.cyclic[j] == 1 or at.y[j] == event[HEAD + j])
    return same


def ahead_of(at: Any, cycle: int, time: float, setup: Any) -> float:
    """Return how far an instant lies ahead of state and columns."""
    return time + (cycle - at.place[0]) * setup.period - at.t[0]


def propagate(engine: Any, cycle: int, time: float, at: Any, setup: Any) -> bool:
    """Integrate state and columns up to an instant; return whether that went well.

    They are made orthonormal on the way and at the end. An instant that has come is left as it is.
    """
    into = setup.variational
    if ahead_of(at, cycle, time, setup) <= 0.0:
        return True
    while True:
        while at.t[0] >= setup.period:
            at.t[0] -= setup.period
            at.place[0] += 1
        left = ahead_of(at, cycle, time, setup)
        parts = math.ceil(left / at.length[0])
        end = at.t[0] + left / parts
        if parts <= 1:
            end = time + (cycle - at.place[0]) * setup.period
        mode = at.place[1]
        went = end <= at.t[0] or integrate(engine, mode, at.y, at.t[0], end, into, 0, watched=False)
        if not went:
            return False
        whole = 2.0 * (end - at.t[0]) >= at.length[0]  # of a short part nothing is learnt
        at.t[0] = end
        for j in range(setup.k):
            at.shifts[j] = 0.0
        constrain(engine, at, setup)
        least = orthonormalize(0.0, at, setup)
        if least < REORTHONORMALIZE_BELOW:
            at.length[0] *= 0.5
        elif whole and least > REORTHONORMALIZE_BELOW**0.25 and at.length[0] < setup.scale:
            at.length[0] *= 2.0
        if parts <= 1:
            return True


def constrain(engine: Any, at: Any, setup: Any) -> None:
    """Take from the columns what leads off the manifold on which the mode's states lie."""
    into = setup.variational
    if into.constrained[at.place[1]] == 1:
        project(engine, at.place[1], at.t[0], at.y, into, 0)


def apply_saltation(engine: Any, event: Any, at: Any, setup: Any) -> None:
    """Carry the columns through the transition of an event, by its saltation matrix.

    A perturbed motion meets the guard sooner by w . grad h / (the rate of h). At a switch of the
    drive it does not; nor at a guard that a transition of this instant has put beyond its zero:
    that one fires when that transition comes.
    """
    into = setup.variational
    n, m, k = into.n, into.m, setup.k
    guard, switch = int(event[GUARD]), int(event[KIND]) == SWITCH
    mode, t = int(event[MODE_BEFORE]), at.t[0]
    before, after = into.work[8], into.work[9]
    # From the left, where a drive that switches now has not done so yet.
    interface.flow(engine, mode, t - 1e-15 * abs(t), at.y, before)
    differentiate(engine, mode, 2 * m if switch else guard, at, setup)
    rate, beyond = 0.0, True
    if not switch:
        size = gain = 0.0
        rate = into.margin[0, guard, n + 1]
        for j in range(n):
            slope = into.margin[0, guard, 1 + j]
            rate += slope * before[j]
            gain += abs(slope)
            size += abs(slope * at.y[j])
        error = setup.rtol * size + setup.atol * gain
        far = TOLERANCES * error + 1e-6 * abs(rate) * setup.scale
        beyond = into.margin[0, guard, 0] < -far
        rate = math.copysign(max(abs(rate), SLOWEST), rate)
    state = into.work[10]
    for j in range(n):
        state[j] = at.y[j]
        at.y[j] = event[HEAD + n + j]
    interface.flow(engine, int(event[MODE_AFTER]), t, at.y, after)
    for j in range(n):
        at.y[j] = state[j]
    for i in range(n):
        acts = abs(into.jump[0, i, n + 1] + before[i] - after[i])
        for j in range(n):
            acts = max(acts, abs(into.jump[0, i, 1 + j] - (1.0 if i == j else 0.0)))
        at.changed[i] |= int(acts > ACTS)
    for c in range(k):
        if not beyond:
            at.shifts[c] = 0.0
            for j in range(n):
                at.shifts[c] += into.margin[0, guard, 1 + j] * at.y[n * (1 + c) + j] / rate
        update_column(c, before, after, at, setup)


def apply_rest_saltation(engine: Any, guard: int, at: Any, setup: Any) -> None:
    """Carry state and columns through the impact without rebound that ends a sequence at `guard`.

    Sooner or later it comes for all perturbed motions, and leaves none of them a gap: impulses that
    follow each other close it, and move the bodies by their masses, as they change velocities. The
    flights that are left out are so low that the instant at which it is taken does not matter.
    """
    into = setup.variational
    n, mode = into.n, at.place[1]
    none, after, closing = into.work[8], into.work[9], into.work[5]
    for j in range(n):
        none[j] = after[j] = 0.0
    differentiate(engine, mode, into.m + guard, at, setup)
    contact_response(engine, mode, guard, closing, at, setup)
    closed = 0.0
    for j in range(n):
        closed += into.margin[0, guard, 1 + j] * closing[j]
    for c in range(setup.k):
        at.shifts[c] = 0.0
        column = n * (1 + c)
        gap = 0.0
        for j in range(n):
            gap += into.margin[0, guard, 1 + j] * at.y[column + j]
        for j in range(n):
            at.y[column + j] -= gap / closed * closing[j] if closed != 0.0 else 0.0
        update_column(c, none, after, at, setup)
    at.place[1] = interface.transition(engine, mode, into.m + guard, at.t[0], at.y)


def contact_response(engine: Any, mode: int, guard: int, moved: Any, at: Any, setup: Any) -> None:
    """Write into `moved` how the state changes, by and by, after an impulse of the contact `guard`.

    The impulse is what the impact makes of a state of another closing speed: the derivative of the
    transition along the gradient of the rate. MARGIN and JUMP are those of the contact.
    """
    into = setup.variational
    n, rate = into.n, into.m + guard
    x, behind = into.work[0], into.work[6]
    for i in range(n):
        moved[i] = -into.margin[0, rate, 1 + i]
        for j in range(n):
            moved[i] += into.jump[0, i, 1 + j] * into.margin[0, rate, 1 + j]
    length = length_of(moved, 0, n)
    h = into.width / length if length > 0.0 else 0.0
    for i in range(n, at.y.size):
        x[i] = 0.0  # no columns
    for i in range(n):
        x[i] = at.y[i] - h * moved[i]
    interface.flow(engine, mode, at.t[0], x, behind)
    for i in range(n):
        x[i] = at.y[i] + h * moved[i]
    interface.flow(engine, mode, at.t[0], x, moved)
    for i in range(n):
        moved[i] -= behind[i]


def differentiate(engine: Any, mode: int, code: int, at: Any, setup: Any) -> None:
    """Differentiate margins and the transition `code` here and now, into MARGIN and JUMP."""
    into = setup.variational
    t, room = at.t[0], math.inf
    for i in range(setup.switches.size):
        since = abs(t - setup.switches[i]) % setup.period
        room = max(min(room, since, setup.period - since), NEAREST)
    differentiate_event(engine, mode, code, t, at.y, room, into, 0)


def update_column(c: int, before: Any, after: Any, at: Any, setup: Any) -> None:
    """Apply the transition to column `c`, with the flow `before` and `after` it.

    For a motion that comes to it sooner by its shift, the flow after it acts for so much longer and
    the flow before it for so much less.
    """
    into = setup.variational
    n, column, shift = into.n, into.n * (1 + c), at.shifts[c]
    result = into.work[10]
    length = most = 0.0
    for i in range(n):
        most = max(most, abs(at.y[column + i]) if setup.cyclic[i] == 0 else 0.0)
        kick = after[i] - into.jump[0, i, n + 1]
        parts = abs(after[i]) + abs(into.jump[0, i, n + 1])
        for j in range(n):
            kick -= into.jump[0, i, 1 + j] * before[j]
            parts += abs(into.jump[0, i, 1 + j] * before[j])
        result[i] = kick * shift if shift != 0.0 else 0.0
        parts = parts * abs(shift) if shift != 0.0 else 0.0
        for j in range(n):
            moved = into.jump[0, i, 1 + j] * at.y[column + j]
            result[i] += moved
            parts += abs(moved)
        if setup.cyclic[i] == 0:
            length = max(length, abs(result[i]))
            most = max(most, parts)
    if length <= ZERO_COLUMN * most:
        at.alive[c] = 0
    for i in range(n):
        at.y[column + i] = result[i]


def orthonormalize(nothing: float, at: Any, setup: Any) -> float:
    """Make the columns orthonormal, and take down what they have grown by.

    Each against those before it, twice, so that all digits are kept. Returns how much was left of
    the column of which least was. One of which no more than the part `nothing` was is zero from
    then on.
    """
    into = setup.variational
    n, least = into.n, 1.0
    for c in range(setup.k):
        column = n * (1 + c)
        for i in range(n):
            if setup.cyclic[i] == 1 or at.alive[c] == 0:
                at.y[column + i] = 0.0
        if at.alive[c] == 0:
            at.shifts[c] = 0.0
            continue
        whole = length_of(at.y, column, n)
        for _ in range(2):
            for other in range(c):
                former = n * (1 + other)
                part = 0.0
                for i in range(n):
                    part += at.y[column + i] * at.y[former + i]
                for i in range(n):
                    at.y[column + i] -= part * at.y[former + i]
                at.shifts[c] -= part * at.shifts[other]
        length = length_of(at.y, column, n)
        if not length > nothing * whole:
            at.alive[c] = 0
            at.shifts[c] = 0.0
            for i in range(n):
                at.y[column + i] = 0.0
            continue
        least = min(least, length, length / whole)
        at.growth[c] += math.log(length)
        at.shifts[c] /= length
        for i in range(n):
            at.y[column + i] /= length
    return least


def length_of(y: Any, column: int, n: int) -> float:
    """Return the length of the n numbers of `y` from `column` on."""
    square = 0.0
    for i in range(n):
        square += y[column + i] * y[column + i]
    return math.sqrt(square)


# --- A run that goes on chunk by chunk, with perturbations carried along: one call for many
# chunks.

# How far `stretch` has come.
STRETCHING = np.dtype(
    [
        ("advance", np.int64),  # address of the event loop
        ("plain", np.int64),  # and of the run's own engine
        ("chunk", np.int64),
        ("begun", np.int64),  # 1 while that one has begun
        ("lost", np.int64),  # 1 where the columns cannot be carried on
    ]
)
BITE = 4  # steps that the event loop takes before what it has written is read
MAX_LEAD_RATIO = (
    0.75  # part of the time between two orthonormalizations by which the run may be ahead
)


def stretch(engine: Any, s: Any, w: Any, at: Any, setup: Any, lengths: Any, grown: Any,
            quota: int) -> int:  # fmt: skip
    """Let the run go on chunk by chunk, and carry the columns along.

    Parameters
    ----------
    engine
        Of the extended flow (see `mems_impact.hybrid.variational.flow`).
    s : LOOP_STATE
        Of the run.
    w : STRETCHING
    at : PerturbationState
    setup : PropagationProblem
    lengths : float array, shape (N,)
        Periods in each chunk.
    grown : float array, shape (N, k)
        Gets the logarithms of what columns have grown by in each.
    quota : int
        Steps of the run that this call may take.

    Returns
    -------
    int
        DONE, PAUSED, FAILED if the columns cannot be carried on, or what ended the run.
    """
    while w.chunk < lengths.size:
        if w.begun == 0:
            begin(s, lengths[w.chunk])
            for c in range(setup.k):
                at.growth[c] = 0.0
            w.begun = 1
        while w.begun == 1:
            if quota <= 0:
                return PAUSED
            status = run_loop(s, w)
            quota -= BITE
            for i in range(s.events_written):
                if not propagate_to_event(engine, event_at(s, i), at, setup):
                    w.lost = 1
                    return FAILED
            s.events_written = 0
            if status == DONE:
                w.begun = 0
            elif status not in (PAUSED, BUFFER_FULL):
                return status
            elif not follow(engine, s, at, setup):
                w.lost = 1
                return FAILED
        if not propagate(engine, s.end_cycle, s.end_phase, at, setup):
            w.lost = 1
            return FAILED
        load_state(table_row(s, Y), 0, at, setup)
        for c in range(setup.k):
            grown[w.chunk, c] = at.growth[c]
        w.chunk += 1
    return DONE


def begin(s: Any, length: float) -> None:
    """Let the run go on for so many periods from where it was to end."""
    whole = math.floor(length)
    s.end_phase += (length - whole) * s.period
    ahead = whole_periods(s.end_phase, s.period)
    s.end_phase -= ahead * s.period
    s.end_cycle += whole + ahead
    s.first_arc = 1


def follow(engine: Any, s: Any, at: Any, setup: Any) -> bool:
    """Carry the columns to where the run has come, if it is far enough ahead; False on failure.

    The state that carries them is integrated on its own, and parts from the run as neighbouring
    motions do. Put back too late, it would jump, and columns along the flow would no longer be.
    """
    far = ahead_of(at, s.cycle, s.t, setup) >= MAX_LEAD_RATIO * at.length[0]
    if s.pending_guard != NONE or not far:
        return True
    went = propagate(engine, s.cycle, s.t, at, setup)
    load_state(table_row(s, Y), 0, at, setup)
    return went


def run_loop(s: Any, w: Any) -> int:
    """Let the event loop of the run take some steps."""
    return loop.run_steps(w.plain, s, BITE)
