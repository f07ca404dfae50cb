"""Propagation of perturbations: arcs, saltation matrices, orthonormalization.

One call propagates perturbations through all arcs and events of an orbit.

Functions over `integrators.interface`, interpreted and compiled. Along a run perturbations follow
its event log, and after each event their base state is that of the run. The run has its own
integrator, so that perturbations do not change it even by rounding; a second integrator, of the
extended flow, propagates the columns.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from mems_impact.hybrid.differences import weight_of
from mems_impact.hybrid.event_loop import loop
from mems_impact.hybrid.event_loop.event_detection import (
    MIN_SUBSTEP_RATIO,
    RATE_CHANGE_DECAY,
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

# --- Segments of an orbit

MAX_BACKWARD_TIME = 1.0  # longest arc of negative length
NO_EVENT = -1  # code of a segment without transition at its end
WORK_ROWS = 11  # rows of `work`
# Sixth differences of a smooth function are below this part of its change. Otherwise the step is
# reduced by the second factor, up to so many times.
SMOOTHNESS_RTOL, STEP_REDUCTION, MAX_REDUCTIONS = 1e-3, 0.125, 3


class VariationalWorkspace(NamedTuple):
    """Sizes, constants and arrays of arcs and events with derivatives. N is 1 along a run.

    Attributes
    ----------
    n, m, parameters, directions, max_steps : int
        Numbers of state components, guards, parameters and directions; most steps per arc.
    width : float
        Step of the differences.
    constrained : int array, shape (modes,)
        1 for a mode whose states lie on a manifold.
    minima : float array, shape (N, 2, m)
        Output: the smallest value of each margin at a closest approach inside the arc (inf if there
        is none), and its time. Approaches that the engine does not detect by a sign change of the
        rate count only if they may be near zero or below.
    touches : float array, shape (N, m, n (1 + columns))
        Output: state and columns at that time.
    margin, jump : float array, shapes (N, 2 m, 2 + n + directions), (N, n, ...)
        Output: margins and rates before the event, and the state after it, each with its
        derivatives: value, by each state component, by time, by each direction.
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
    """Inputs and results of N segments. Arrays have a row for each segment.

    Attributes
    ----------
    variational : VariationalWorkspace
    segments : int array, shape (N, 3)
        Mode, code of the transition at the end (or NO_EVENT); output: mode after it.
    times : float array, shape (N, 4)
        Start, end, largest step of differences in time at the end, and the time at which the
        margins at the end are evaluated.
    motions : float array, shape (N, 2 directions)
        Rates a + b t at which instants move with each parameter.
    states : float array, shape (N, n (1 + columns))
        State and columns at the start; output: at the end.
    slopes : float array, shape (N, 2, n)
        Output: the flow at start and end.
    margins : float array, shape (N, 2, 2 m)
        Output: margins and rates at start and end.
    after : float array, shape (N, n)
        Output: the state after the event.
    """

    variational: VariationalWorkspace
    segments: Any
    times: Any
    motions: Any
    states: Any
    slopes: Any
    margins: Any
    after: Any


def propagate_segments(engine: Any, block: Any, batch: Any) -> int:
    """Compute the segments of a batch from their initial states, without event detection.

    Parameters
    ----------
    engine
        Engine of the extended flow (see `mems_impact.hybrid.variational.flow`).
    block : float array, shape (parameters * (1 + directions),)
        Parameters and directions.
    batch : SegmentBatch

    Returns
    -------
    int
        Number of a segment whose integration failed, or -1.
    """
    into = batch.variational
    n, directions = into.n, into.directions
    free = batch.states.shape[1] // n - 1 - directions
    slope = into.work[5]
    for i in range(block.size):
        interface.set_parameter(engine, i, block[i])
    for i in range(batch.segments.shape[0]):
        mode, code = batch.segments[i, 0], batch.segments[i, 1]
        start, end = batch.times[i, 0], batch.times[i, 1]
        y, motions = batch.states[i], batch.motions[i]
        for j in range(2 * directions):
            interface.set_parameter(engine, block.size + j, motions[j])
        if into.constrained[mode] == 1:
            project(engine, mode, start, y, into, i)
        interface.margins(engine, mode, start, y, batch.margins[i, 0])
        interface.flow(engine, mode, start, y, slope)
        for c in range(n):
            batch.slopes[i, 0, c] = slope[c]
        for j in range(directions):
            moved = motions[2 * j] + motions[2 * j + 1] * start
            for c in range(n):
                y[n * (1 + free + j) + c] += slope[c] * moved
        if not integrate(engine, mode, y, start, end, into, i, approaches=True):
            return i
        # The limit from the left, before a switch of the drive at the end.
        interface.flow(engine, mode, end - 1e-15 * abs(end), y, slope)
        for c in range(n):
            batch.slopes[i, 1, c] = slope[c]
        for j in range(directions):
            moved = motions[2 * j] + motions[2 * j + 1] * end
            for c in range(n):
                y[n * (1 + free + j) + c] -= slope[c] * moved
        interface.margins(engine, mode, batch.times[i, 3], y, batch.margins[i, 1])
        if code != NO_EVENT:
            differentiate_event(engine, mode, code, end, y, batch.times[i, 2], into, i)
            for c in range(n):
                batch.after[i, c] = y[c]
            batch.segments[i, 2] = interface.transition(engine, mode, code, end, batch.after[i])
    return -1


def project(engine: Any, mode: int, t: float, y: Any, into: Any, place: int) -> None:
    """Project a state onto the manifold of its mode, and its columns onto the tangent space.

    The columns of parameters, which may move the manifold, come last. Row `place` of margin and
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
    engine: Any,
    mode: int,
    y: Any,
    start: float,
    end: float,
    into: Any,
    place: int,
    approaches: bool,
) -> bool:
    """Integrate `mode` from `start` to `end` in place; return whether it succeeded.

    If `approaches`, write closest approaches into row `place` of `into`, a `VariationalWorkspace`.
    """
    if approaches:
        for i in range(into.m):
            into.minima[place, 0, i] = math.inf
            into.minima[place, 1, i] = math.nan
            # The large bias leaves only roots of rates. A margin and its rate that are both zero
            # would stop CVODE ("root found very near t").
            interface.set_bias(engine, i, 1e300)
    if start - end > MAX_BACKWARD_TIME:
        return False
    if end <= start:
        integrate_backward(engine, mode, y, start, end, into.work)
        return True
    if approaches:
        start_approach_detection(engine, mode, start, y, into)
    interface.restart(engine, mode, start, y, end)  # the drive may switch there
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
        if approaches:
            detect_approaches(engine, status, mode, before, t, y, into, place)
        if t >= end:
            interface.interpolate(engine, end, y)
            return True
    return False


def start_approach_detection(engine: Any, mode: int, t: float, y: Any, into: Any) -> None:
    """Store margins and rates at the start (t, y) of an arc."""
    now, curved, highest = into.work[2], into.work[3], into.work[6]
    interface.margins(engine, mode, t, y, now)
    for i in range(into.m):
        curved[i] = 0.0
        highest[i] = now[i]


def detect_approaches(
    engine: Any, status: int, mode: int, before: float, t: float, y: Any, into: Any, place: int
) -> None:
    """Record the closest approaches in the last step, from `before` to `t`.

    The engine reports an approach if the rate changes sign over the step. Others are found as
    hidden crossings of runs are (`event_detection.find_hidden_crossing`). Overwrites `y`.
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
            curved[i] = max(abs(now[m + i] - then[m + i]) / h, RATE_CHANGE_DECAY * curved[i])
            if not certify_no_crossing(then[i], then[m + i], now[i], now[m + i], h, curved[i]):
                find_closest_approaches(engine, mode, i, before, t, y, into, place)
        if direction > 0:
            interface.state(engine, y)
            record_approach(i, t, now[i], y, into, place)
        highest[i] = max(highest[i], now[i])


def find_closest_approaches(
    engine: Any, mode: int, i: int, before: float, t: float, y: Any, into: Any, place: int
) -> None:
    """Record the closest approaches of margin `i` near or below zero inside the last step.

    The step is scanned in parts so short that the margin remains positive, is monotonic, or has one
    extremum. Overwrites `y`.
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
        monotonic = r_a * r_b > 0.0 and slowest > curved * h
        certain = (
            monotonic
            or fastest * h <= rounding
            or certify_no_crossing(g_a, r_a, g_b, r_b, h, curved)
        )
        if h > finest and not certain:
            width *= 0.5
            continue
        if not certain and r_a < 0.0 < r_b:
            closest = bisect_rate(engine, mode, m + i, a, b, 1.0, y, g)
            interface.interpolate(engine, closest, y)
            interface.margins(engine, mode, closest, y, g)
            record_approach(i, closest, g[i], y, into, place)
        highest[i] = max(highest[i], g_b)
        a, g_a, r_a = b, g_b, r_b
        width *= 2.0


def record_approach(i: int, t: float, margin: float, y: Any, into: Any, place: int) -> None:
    """Record a closest approach of margin `i` at (t, y) if it is the closest so far.

    At the start of an arc with margin and rate zero, the rate may be negative by rounding.
    """
    minima, highest = into.minima[place], into.work[6][i]
    fallen = highest - margin > margin_rounding(max(abs(highest), abs(margin)), y, into.n)
    if fallen and margin < minima[0, i]:
        minima[0, i] = margin
        minima[1, i] = t
        for j in range(y.size):
            into.touches[place, i, j] = y[j]


def margin_rounding(margin: float, y: Any, n: int) -> float:
    """Return the rounding error of a margin of this size at the state `y`."""
    size = margin
    for j in range(n):
        size = max(size, abs(y[j]))
    rounding: float = ROUNDINGS * EPS * size
    return rounding


def integrate_backward(engine: Any, mode: int, y: Any, start: float, end: float, work: Any) -> None:
    """Integrate from `start` back to an earlier `end`, by the classical Runge-Kutta method.

    Arcs of negative length occur only when the shooting equations are evaluated beyond a grazing;
    they are short, and with steps of 1e-3 the method is exact to rounding.
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
    """Set the parameters to `p`, moved by `h` along a direction (stored after them)."""
    for i in range(count):
        moved = h * interface.parameter(engine, count * (1 + direction) + i)
        interface.set_parameter(engine, i, p[i] + moved)


def differentiate_event(
    engine: Any, mode: int, code: int, t: float, y: Any, room: float, into: Any, place: int
) -> None:
    """Differentiate margin and transition `code` at (t, y) by state, time and parameters.

    The results are in row `place` of margin and jump of `into`, a `VariationalWorkspace`.
    Differences in time stay within `room` of `t`. The engine's parameters are moved and restored.
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
        # A function may be discontinuous near (t, y), as an angle modulo one turn: a smaller step
        # avoids the discontinuity, unless it is at (t, y).
        for k in range(1, 1 + MAX_REDUCTIONS):
            if not smooth:
                near = step * STEP_REDUCTION**k
                smooth = difference(engine, mode, code, t, y, c, near, into, place)
                if k == MAX_REDUCTIONS and not smooth:
                    difference(engine, mode, code, t, y, c, step, into, place)


def difference(
    engine: Any, mode: int, code: int, t: float, y: Any, c: int, step: float, into: Any, place: int
) -> bool:
    """Write the differences along one direction into column `c` (see `differentiate_event`).

    Returns whether the functions are smooth: their sixth differences are far below their changes.
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
        if abs(sixth[i]) > SMOOTHNESS_RTOL * change[i] + 1e-11 * (1.0 + abs(value)):
            smooth = False
    return smooth


# --- Perturbations along a run

MIN_TIME_STEP = 1e-9  # smallest range of differences in time near a switch of the drive
MIN_RATE = 1e-14  # lower bound of the rate of a margin at an event, which bounds perturbations
# An event that leaves a smaller part of a column makes it zero, within the error of differences.
ZERO_COLUMN = 1e-11
# An event affects a component if an entry of the saltation matrix differs by more from identity.
JUMP_TOLERANCE = 1e-9
# Below this ratio of lengths between two orthonormalizations columns lose accuracy, and
# orthonormalization becomes twice as frequent, until the ratio improves.
REORTHONORMALIZE_BELOW = 1e-3


class PerturbationState(NamedTuple):
    """A state of the run and k columns with their growth; changed in place.

    Attributes
    ----------
    y : float array, shape (n (1 + k),)
        The state, its cyclic components zero, then the columns: orthonormal but for their cyclic
        components.
    place : int array, shape (2,)
        Completed periods before the time base, and the mode.
    t : float array, shape (1,)
        Time since the time base.
    shifts : float array, shape (k,)
        Time by which the events of this instant are earlier for each column; negative if later.
    growth : float array, shape (k,)
        Logarithms of the growth of each column.
    alive : int array, shape (k,)
        0 for a column that an event has reduced to zero.
    changed : int array, shape (n,)
        1 for a component that an event has affected.
    length : float array, shape (1,)
        Longest time between orthonormalizations, at most the time scale.
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
    """Data of a problem for the propagation.

    Attributes
    ----------
    variational : VariationalWorkspace
    k : int
        Number of columns.
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


def propagate_to_event(engine: Any, extended: Any, event: Any, at: Any, setup: Any) -> bool:
    """Propagate the columns up to an event and through it; return whether it succeeded."""
    into = setup.variational
    n, kind, guard = into.n, int(event[KIND]), int(event[GUARD])
    no_transition = kind == TRANSITION and setup.records[guard] == 1
    if no_transition or kind in (APPROACH, SECTION_CROSSING, HANDOVER):
        return True
    cycle, time = int(event[CYCLE]), event[TIME]
    if kind == ACCUMULATION:
        # The state before an accumulation is that at the last impact of its sequence.
        if not is_at(event, at, setup):
            if not propagate(engine, extended, cycle, time, at, setup):
                return False
            load_state(event, HEAD, at, setup)
        apply_rest_saltation(engine, guard, at, setup)
        orthonormalize(ZERO_COLUMN, at, setup)
    if not propagate(engine, extended, cycle, time, at, setup):
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


def load_state(values: Any, first: int, at: Any, setup: Any) -> None:
    """Set the state to the values from `first` on, with cyclic components zero."""
    into = setup.variational
    for j in range(into.n):
        at.y[j] = 0.0 if setup.cyclic[j] == 1 else values[first + j]


def is_at(event: Any, at: Any, setup: Any) -> bool:
    """Return whether the columns are at the state before an event."""
    into = setup.variational
    same = True
    for j in range(into.n):
        same = same and (setup.cyclic[j] == 1 or at.y[j] == event[HEAD + j])
    return same


def ahead_of(at: Any, cycle: int, time: float, setup: Any) -> float:
    """Return the time from state and columns to an instant."""
    return time + (cycle - at.place[0]) * setup.period - at.t[0]


def propagate(engine: Any, extended: Any, cycle: int, time: float, at: Any, setup: Any) -> bool:
    """Integrate state and columns up to an instant; return whether it succeeded.

    The columns are orthonormalized at intervals and at the end. A past instant has no effect.
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
        succeeded = end <= at.t[0] or integrate(
            extended, mode, at.y, at.t[0], end, into, 0, approaches=False
        )
        if not succeeded:
            return False
        whole = 2.0 * (end - at.t[0]) >= at.length[0]  # a shorter part is not representative
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
    """Project the columns onto the tangent space of the mode's manifold."""
    into = setup.variational
    if into.constrained[at.place[1]] == 1:
        project(engine, at.place[1], at.t[0], at.y, into, 0)


def apply_saltation(engine: Any, event: Any, at: Any, setup: Any) -> None:
    """Propagate the columns through the transition of an event by its saltation matrix.

    A perturbed motion reaches the guard earlier by w . grad h / (the rate of h). This shift is zero
    at a switch of the drive. A guard that a transition of this instant has made negative fires with
    that transition, and has its shift.
    """
    into = setup.variational
    n, m, k = into.n, into.m, setup.k
    guard, switch = int(event[GUARD]), int(event[KIND]) == SWITCH
    mode, t = int(event[MODE_BEFORE]), at.t[0]
    before, after = into.work[8], into.work[9]
    # The limit from the left, before a switch of the drive.
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
        rate = math.copysign(max(abs(rate), MIN_RATE), rate)
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
        at.changed[i] |= int(acts > JUMP_TOLERANCE)
    for c in range(k):
        if not beyond:
            at.shifts[c] = 0.0
            for j in range(n):
                at.shifts[c] += into.margin[0, guard, 1 + j] * at.y[n * (1 + c) + j] / rate
        update_column(c, before, after, at, setup)


def apply_rest_saltation(engine: Any, guard: int, at: Any, setup: Any) -> None:
    """Propagate state and columns through the impact without rebound at the end of chatter.

    The sequences of all perturbed motions end too, with a gap of zero: successive impulses close
    the gap, and displace the bodies in the same ratio as they change velocities. The remaining
    flights are so low that the instant of the transition is irrelevant.
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
    """Write into `moved` the rate of change of the state after a unit impulse at contact `guard`.

    The impulse is the derivative of the transition along the gradient of the rate (the closing
    speed). Requires `differentiate` at the contact.
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
    for i in range(n):
        x[i] = at.y[i] - h * moved[i]
    interface.flow(engine, mode, at.t[0], x, behind)
    for i in range(n):
        x[i] = at.y[i] + h * moved[i]
    interface.flow(engine, mode, at.t[0], x, moved)
    for i in range(n):
        moved[i] -= behind[i]


def differentiate(engine: Any, mode: int, code: int, at: Any, setup: Any) -> None:
    """Differentiate margins and transition `code` at the present state, into margin and jump."""
    into = setup.variational
    t, room = at.t[0], math.inf
    for i in range(setup.switches.size):
        since = abs(t - setup.switches[i]) % setup.period
        room = max(min(room, since, setup.period - since), MIN_TIME_STEP)
    differentiate_event(engine, mode, code, t, at.y, room, into, 0)


def update_column(c: int, before: Any, after: Any, at: Any, setup: Any) -> None:
    """Apply the saltation matrix to column `c`, with the flow `before` and `after` the event.

    For a motion whose event is earlier by the shift, the flow after it acts longer by the shift,
    and the flow before it shorter.
    """
    into = setup.variational
    n, column, shift = into.n, into.n * (1 + c), at.shifts[c]
    result = into.work[10]
    length = largest = 0.0
    for i in range(n):
        largest = max(largest, abs(at.y[column + i]) if setup.cyclic[i] == 0 else 0.0)
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
            largest = max(largest, parts)
    if length <= ZERO_COLUMN * largest:
        at.alive[c] = 0
    for i in range(n):
        at.y[column + i] = result[i]


def orthonormalize(zero_part: float, at: Any, setup: Any) -> float:
    """Orthonormalize the columns, and accumulate their growth.

    Gram-Schmidt, applied twice for full accuracy. Returns the smallest remaining part of a column.
    A column with a remaining part of at most `zero_part` is zero from then on.
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
                previous = n * (1 + other)
                part = 0.0
                for i in range(n):
                    part += at.y[column + i] * at.y[previous + i]
                for i in range(n):
                    at.y[column + i] -= part * at.y[previous + i]
                at.shifts[c] -= part * at.shifts[other]
        length = length_of(at.y, column, n)
        if not length > zero_part * whole:
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
    """Return the length of the n values of `y` from `column` on."""
    square = 0.0
    for i in range(n):
        square += y[column + i] * y[column + i]
    return math.sqrt(square)


# --- Run and perturbations, chunk by chunk

# Progress of `stretch`.
STRETCHING = np.dtype(
    [
        ("advance", np.int64),  # address of the event loop
        ("extended", np.int64),  # address of the engine of the columns
        ("chunk", np.int64),
        ("begun", np.int64),  # 1 during a chunk
        ("lost", np.int64),  # 1 if the propagation of the columns failed
    ]
)
MAX_LEAD_RATIO = 0.75  # lead of the run, relative to the time between orthonormalizations


def reset(engine: Any, parameters: Any, longest_step: float) -> None:
    """Restore the initial state of an engine, with other parameters."""
    interface.reset(engine, longest_step)
    for i in range(parameters.size):
        interface.set_parameter(engine, i, parameters[i])


def stretch(engine: Any, s: Any, w: Any, at: Any, setup: Any, lengths: Any, grown: Any,
            quota: int) -> int:  # fmt: skip
    """Continue the run chunk by chunk, and propagate the columns.

    Parameters
    ----------
    engine
        Of the run. It evaluates margins and transitions for the columns too.
    s : LOOP_STATE
        State of the event loop of the run.
    w : STRETCHING
    at : PerturbationState
    setup : PropagationProblem
    lengths : float array, shape (N,)
        Periods of each chunk.
    grown : float array, shape (N, k)
        Output: logarithms of the growth of columns in each chunk.
    quota : int
        Most steps of the run in this call.

    Returns
    -------
    int
        DONE, PAUSED, FAILED if the propagation failed, or the reason why the run ended.
    """
    extended = extended_engine(w)
    while w.chunk < lengths.size:
        if w.begun == 0:
            begin(s, lengths[w.chunk])
            for c in range(setup.k):
                at.growth[c] = 0.0
            w.begun = 1
        while w.begun == 1:
            if quota <= 0:
                return PAUSED
            status = run_loop(engine, s, w)
            quota -= 1
            for i in range(s.events_written):
                if not propagate_to_event(engine, extended, event_at(s, i), at, setup):
                    w.lost = 1
                    return FAILED
            s.events_written = 0
            if status == DONE:
                w.begun = 0
            elif status not in (PAUSED, BUFFER_FULL):
                return status
            elif not follow(engine, extended, s, at, setup):
                w.lost = 1
                return FAILED
        if not propagate(engine, extended, s.end_cycle, s.end_phase, at, setup):
            w.lost = 1
            return FAILED
        load_state(table_row(s, Y), 0, at, setup)
        for c in range(setup.k):
            grown[w.chunk, c] = at.growth[c]
        w.chunk += 1
    return DONE


def begin(s: Any, length: float) -> None:
    """Extend the run by a number of periods."""
    whole = math.floor(length)
    s.end_phase += (length - whole) * s.period
    ahead = whole_periods(s.end_phase, s.period)
    s.end_phase -= ahead * s.period
    s.end_cycle += whole + ahead
    s.first_arc = 1


def follow(engine: Any, extended: Any, s: Any, at: Any, setup: Any) -> bool:
    """Propagate the columns to the state of the run if it is far enough ahead; False on failure.

    The base state of the columns is integrated separately, and diverges from the run as
    neighbouring motions do. A late correction would be a jump, after which columns along the flow
    are no longer tangent to it.
    """
    far = ahead_of(at, s.cycle, s.t, setup) >= MAX_LEAD_RATIO * at.length[0]
    if s.pending_guard != NONE or not far:
        return True
    succeeded = propagate(engine, extended, s.cycle, s.t, at, setup)
    load_state(table_row(s, Y), 0, at, setup)
    return succeeded


def run_loop(engine: Any, s: Any, w: Any) -> int:
    """Run the event loop for one step."""
    return loop.run_steps(engine, s, 1)


def extended_engine(w: Any) -> Any:
    """Return the engine of the extended flow (see `mems_impact.hybrid.variational.flow`)."""
    return w.extended
