"""Propagation of perturbations: arcs, saltation matrices, orthonormalization.

One call propagates perturbations through all arcs and events of an orbit.

Functions over `integrators.interface`, interpreted and compiled. Along a run one engine integrates
the state and its columns. The event loop leaves the columns at an instant in the row of the state,
behind it, where they are changed before the next arc begins.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

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
    BUFFER_FULL,
    CYCLE,
    DONE,
    EPS,
    FAILED,
    GUARD,
    HEAD,
    KIND,
    MODE_AFTER,
    MODE_BEFORE,
    NONE,
    PAUSED,
    SWITCH,
    TIME,
    TRANSITION,
    Y,
    event_at,
    table_row,
    whole_periods,
)
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.variational.tangents import event_sizes
from mems_impact.integrators import interface

# --- Segments of an orbit

MAX_BACKWARD_TIME = 1.0  # longest arc of negative length
NO_EVENT = -1  # code of a segment without transition at its end
WORK_ROWS = 11  # rows of `work`


class VariationalWorkspace(NamedTuple):
    """Sizes, constants and arrays of an arc and its event with derivatives.

    The arrays from `head` on are parts of `row`; those after `head` and `states` are output.
    """

    n: int  # number of state components, as the next three of guards, parameters, directions
    m: int
    parameters: int
    directions: int
    max_steps: int  # of an arc
    # Address of the compiled `mems_impact.hybrid.variational.flow.event_tangents`, or the function.
    tangents: Any
    width: int  # number of directions of a call of `tangents`
    memory: Any  # argument of `tangents`
    work: Any  # shape (WORK_ROWS, 2 m + n or more)
    constrained: Any  # shape (modes,), 1 for a mode whose states lie on a manifold
    row: Any  # the arrays below, one after another (`segment_fields`)
    # Shape (6,): mode, code of the transition at the end (or NO_EVENT), start, end, and the time at
    # which the margins at the end are evaluated. Output: the mode after the transition.
    head: Any
    states: Any  # state and columns at the start; output: at the end, shape (n (1 + columns),)
    slopes: Any  # the flow at start and end, shape (2, n)
    margins: Any  # margins and rates at start and end, shape (2, 2 m)
    after: Any  # the state after the event, shape (n,)
    # The smallest value of each margin at a closest approach inside the arc (inf if there is none),
    # and its time, shape (2, m). Approaches that the engine does not detect by a sign change of the
    # rate count only if they may be near zero or below.
    minima: Any
    touches: Any  # the state at that time, shape (m, n)
    # Margins and rates before the event and, next, the state after it, each with its derivatives:
    # value, by each state component, by time, by each direction; shapes (2 m, 2 + n + directions),
    # (n, ...).
    margin: Any
    jump: Any


def segment_fields(n: int, m: int, directions: int, size: int) -> np.dtype[Any]:
    """Return the fields of `VariationalWorkspace.row`, for `size` components of state, columns."""
    shapes = {
        "head": 6,
        "states": size,
        "slopes": (2, n),
        "margins": (2, 2 * m),
        "after": n,
        "minima": (2, m),
        "touches": (m, n),
        "margin": (2 * m, 2 + n + directions),
        "jump": (n, 2 + n + directions),
    }
    return np.dtype([(name, np.float64, shape) for name, shape in shapes.items()])


def variational_workspace(
    problem: Problem, directions: int, size: int, tangents: Any
) -> VariationalWorkspace:
    """Return a workspace for arcs with `size` components of state and columns."""
    automaton = problem.automaton
    n, m, parameters = len(automaton.states), len(automaton.guards), len(problem.parameters)
    modes, sizes = range(len(automaton.modes)), event_sizes(n, m, parameters, directions)
    segment = np.zeros(1, segment_fields(n, m, directions, size))
    return VariationalWorkspace(
        n=n,
        m=m,
        parameters=parameters,
        directions=directions,
        max_steps=problem.options.max_steps,
        tangents=tangents,
        width=sizes.width,
        memory=np.zeros(sizes.memory),
        work=np.zeros((WORK_ROWS, max(size, 2 * m + n, parameters))),
        constrained=np.array([int(mode in automaton.constrained) for mode in modes]),
        row=segment.view(np.float64),
        **{name: segment[name][0] for name in segment.dtype.names or ()},
    )


def propagate_segments(engine: Any, block: Any, workspace: Any, rows: Any) -> int:
    """Compute segments from their initial states, without event detection.

    `engine` is that of the extended flow (see `mems_impact.hybrid.variational.flow`), `block` its
    `extended_parameters`. The results are written into `rows`, each as `VariationalWorkspace.row`.
    Returns the number of a segment whose integration failed, or -1.
    """
    n, slope, head, y = workspace.n, workspace.work[5], workspace.head, workspace.states
    for i in range(block.size):
        interface.set_parameter(engine, i, block[i])
    for i in range(rows.shape[0]):
        copy(rows[i], workspace.row)
        mode, code, start, end = int(head[0]), int(head[1]), head[2], head[3]
        if workspace.constrained[mode] == 1:
            project(engine, mode, start, y, workspace)
        interface.margins(engine, mode, start, y, workspace.margins[0])
        interface.flow(engine, mode, start, y, slope)
        copy(slope[:n], workspace.slopes[0])
        if not integrate(engine, mode, y, start, end, workspace, approaches=True):
            return i
        # The limit from the left, before a switch of the drive at the end.
        interface.flow(engine, mode, end - 1e-15 * abs(end), y, slope)
        copy(slope[:n], workspace.slopes[1])
        interface.margins(engine, mode, head[4], y, workspace.margins[1])
        copy(y[:n], workspace.after)
        if code != NO_EVENT:
            differentiate_event(engine, mode, code, end, y, workspace)
            head[5] = interface.transition(engine, mode, code, end, workspace.after)
        else:
            leave_unchanged(workspace)
        copy(workspace.row, rows[i])
    return -1


def evaluate_shooting(
    engine: Any, block: Any, workspace: Any, rows: Any, layout: Any, states: Any, starts: Any,
    ends: Any, scales: Any, residual: Any, derivatives: Any, end_derivatives: Any,
) -> int:  # fmt: skip
    """Compute segments and the shooting equations; see `mems_impact.orbits.shooting`.

    The first four arguments and the result are those of `propagate_segments`. `layout`, an int
    array of shape (1 + N, 3 + free), has the free components, from the fourth number on; then for
    each segment the next one, the guard and its row of the equations (or -1), the rows of the
    components of the next state. `states` has the shape (N, n); `starts` and `ends`, shape (N, 1 +
    unknowns + k), are times with their derivatives; `scales`, shape (k,), are those of the
    directions.

    Output are the equations with their derivatives, but for a phase condition, shapes (unknowns,)
    and (unknowns, unknowns + k); and the derivatives of the states at the ends, before the events,
    shape (N, n, unknowns + k).
    """
    failure = propagate_segments(engine, block, workspace, rows)
    n, f, k, count = workspace.n, layout.shape[1] - 3, scales.size, derivatives.shape[1]
    margin, jump, slopes, y = workspace.margin, workspace.jump, workspace.slopes, workspace.states
    columns, change = y.size // n - 1, workspace.work[0]
    for i in range(rows.shape[0] if failure < 0 else 0):
        copy(rows[i], workspace.row)
        following, guard, guard_row, end = layout[1 + i, 0], layout[1 + i, 1], layout[1 + i, 2], 0.0
        if guard_row >= 0:
            residual[guard_row] = margin[guard, 0]
        for b in range(f):
            component = layout[0, 3 + b]
            residual[layout[1 + i, 3 + b]] = (
                states[following, component] - workspace.after[component]
            )
        for c in range(count):
            direction = c - count + k
            for b in range(f):  # a later start shortens the arc
                change[b] = -slopes[0, layout[0, 3 + b]] * starts[i, 1 + c]
            if f * i <= c < f * (i + 1):
                change[c - f * i] += 1.0
            for j in range(n):
                end = slopes[1, j] * ends[i, 1 + c]
                for b in range(f):
                    end += y[n + columns * j + b] * change[b]
                if direction >= 0:
                    end += y[n + columns * j + f + direction] * scales[direction]
                end_derivatives[i, j, c] = end
            for b in range(-1 if guard_row >= 0 else 0, f):
                values = margin[guard] if b < 0 else jump[layout[0, 3 + b]]
                total = values[n + 1] * ends[i, 1 + c]
                for j in range(n):
                    total += values[1 + j] * end_derivatives[i, j, c]
                if direction >= 0:
                    total += values[n + 2 + direction] * scales[direction]
                if b < 0:
                    derivatives[guard_row, c] = total
                else:
                    own = 1.0 if c == f * following + b else 0.0
                    derivatives[layout[1 + i, 3 + b], c] = own - total
    return failure


def copy(source: Any, target: Any) -> None:
    """Copy the values of an array to another one."""
    for i in range(source.size):
        target[i] = source[i]


def leave_unchanged(workspace: Any) -> None:
    """Write the derivatives without an event into margin and jump of the workspace."""
    for values in (workspace.margin, workspace.jump):
        values[:] = 0.0
    for i in range(workspace.n):
        workspace.jump[i, 1 + i] = 1.0


def project(engine: Any, mode: int, t: float, y: Any, workspace: Any) -> None:
    """Project a state onto the manifold of its mode, and its columns onto the tangent space.

    The columns of parameters, which may move the manifold, come last. Margin and jump of the
    workspace are scratch.
    """
    n, directions = workspace.n, workspace.directions
    columns = y.size // n - 1
    differentiate_event(engine, mode, 2 * workspace.m + 1, t, y, workspace)
    jump, projection = workspace.jump, workspace.work[5]
    for c in range(columns):
        direction = c - columns + directions
        for i in range(n):
            projection[i] = jump[i, n + 2 + direction] if direction >= 0 else 0.0
            for j in range(n):
                projection[i] += jump[i, 1 + j] * y[n + columns * j + c]
        for i in range(n):
            y[n + columns * i + c] = projection[i]
    interface.transition(engine, mode, 2 * workspace.m + 1, t, y)


def integrate(
    engine: Any,
    mode: int,
    y: Any,
    start: float,
    end: float,
    workspace: Any,
    approaches: bool,
) -> bool:
    """Integrate `mode` from `start` to `end` in place; return whether it succeeded.

    If `approaches`, write closest approaches into the workspace.
    """
    if approaches:
        for i in range(workspace.m):
            workspace.minima[0, i] = math.inf
            workspace.minima[1, i] = math.nan
            # The large bias leaves only roots of rates. A margin and its rate that are both zero
            # would stop CVODE ("root found very near t").
            interface.set_bias(engine, i, 1e300)
    if start - end > MAX_BACKWARD_TIME:
        return False
    if end <= start:
        integrate_backward(engine, mode, y, start, end, workspace.work)
        return True
    if approaches:
        start_approach_detection(engine, mode, start, y, workspace)
    interface.restart(engine, mode, start, y, end)  # the drive may switch there
    t = start
    for _ in range(workspace.max_steps):
        status = interface.step(engine)
        if status < 0:
            return False
        if status == interface.HANDOVER:
            interface.state(engine, y)
            interface.restart(engine, mode, interface.time(engine), y, end)
            continue
        t_start, t = t, interface.time(engine)
        if approaches:
            detect_approaches(engine, status, mode, t_start, t, y, workspace)
        if t >= end:
            interface.interpolate(engine, end, y)
            return True
    return False


def start_approach_detection(engine: Any, mode: int, t: float, y: Any, workspace: Any) -> None:
    """Store margins and rates at the start (t, y) of an arc."""
    margins, curvatures, maxima = workspace.work[2], workspace.work[3], workspace.work[6]
    interface.margins(engine, mode, t, y, margins)
    for i in range(workspace.m):
        curvatures[i] = 0.0
        maxima[i] = margins[i]


def detect_approaches(
    engine: Any, status: int, mode: int, t_start: float, t: float, y: Any, workspace: Any
) -> None:
    """Record the closest approaches in the last step, from `t_start` to `t`.

    The engine reports an approach if the rate changes sign over the step. Others are found as
    hidden crossings of runs are (`event_detection.find_hidden_crossing`). Overwrites `y`.
    """
    m, h, work = workspace.m, t - t_start, workspace.work
    margins_before, margins_after, curvatures, maxima = work[1], work[2], work[3], work[6]
    for k in range(2 * m):
        margins_before[k] = margins_after[k]
    interface.end_margins(engine, margins_after)
    for i in range(m):
        direction = 0
        if status == interface.ROOT:
            direction = interface.root_directions(engine, m + i)
        if direction != 0:
            margins_after[m + i] = 0.0
        if h > 0.0 and (
            margins_after[i] != margins_before[i] or margins_after[m + i] != margins_before[m + i]
        ):
            curvatures[i] = max(
                abs(margins_after[m + i] - margins_before[m + i]) / h,
                RATE_CHANGE_DECAY * curvatures[i],
            )
            if not certify_no_crossing(
                margins_before[i],
                margins_before[m + i],
                margins_after[i],
                margins_after[m + i],
                h,
                curvatures[i],
            ):
                find_closest_approaches(engine, mode, i, t_start, t, y, workspace)
        if direction > 0:
            interface.state(engine, y)
            record_approach(i, t, margins_after[i], y, workspace)
        maxima[i] = max(maxima[i], margins_after[i])


def find_closest_approaches(
    engine: Any, mode: int, i: int, t_start: float, t: float, y: Any, workspace: Any
) -> None:
    """Record the closest approaches of margin `i` near or below zero inside the last step.

    The step is scanned in parts so short that the margin remains positive, is monotonic, or has one
    extremum. Overwrites `y`.
    """
    m, work = workspace.m, workspace.work
    margins_before, margins_after, g, maxima = work[1], work[2], work[4], work[6]
    a, g_a, r_a = t_start, margins_before[i], margins_before[m + i]
    curvature = work[3][i]
    interface.interpolate(engine, t, y)
    rounding = margin_rounding(max(abs(margins_before[i]), abs(margins_after[i])), y, workspace.n)
    min_width = max(MIN_SUBSTEP_RATIO * (t - t_start), 8.0 * EPS * abs(t))
    width = 0.5 * (t - t_start)
    while a < t:
        b = a + width if a + 1.5 * width < t else t
        g_b, r_b = margins_after[i], margins_after[m + i]
        if b < t:
            interface.interpolate(engine, b, y)
            interface.margins(engine, mode, b, y, g)
            g_b, r_b = g[i], g[m + i]
        h = b - a
        curvature = max(curvature, abs(r_b - r_a) / h)
        min_rate, max_rate = min(abs(r_a), abs(r_b)), max(abs(r_a), abs(r_b), curvature * h)
        is_monotonic = r_a * r_b > 0.0 and min_rate > curvature * h
        is_certain = (
            is_monotonic
            or max_rate * h <= rounding
            or certify_no_crossing(g_a, r_a, g_b, r_b, h, curvature)
        )
        if h > min_width and not is_certain:
            width *= 0.5
            continue
        if not is_certain and r_a < 0.0 < r_b:
            t_closest = bisect_rate(engine, mode, m + i, a, b, 1.0, y, g)
            interface.interpolate(engine, t_closest, y)
            interface.margins(engine, mode, t_closest, y, g)
            record_approach(i, t_closest, g[i], y, workspace)
        maxima[i] = max(maxima[i], g_b)
        a, g_a, r_a = b, g_b, r_b
        width *= 2.0


def record_approach(i: int, t: float, margin: float, y: Any, workspace: Any) -> None:
    """Record a closest approach of margin `i` at (t, y) if it is the closest so far.

    At the start of an arc with margin and rate zero, the rate may be negative by rounding.
    """
    minima, maximum = workspace.minima, workspace.work[6][i]
    is_minimum = maximum - margin > margin_rounding(max(abs(maximum), abs(margin)), y, workspace.n)
    if is_minimum and margin < minima[0, i]:
        minima[0, i] = margin
        minima[1, i] = t
        for j in range(workspace.n):
            workspace.touches[i, j] = y[j]


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


def differentiate_event(
    engine: Any, mode: int, code: int, t: float, y: Any, workspace: Any
) -> None:
    """Differentiate margins and transition `code` at (t, y) by state, time and parameters.

    The results are in margin and jump of the workspace.
    """
    n, m, count = workspace.n, workspace.m, workspace.parameters
    width, memory = workspace.width, workspace.memory
    margin, jump = workspace.margin, workspace.jump
    record, columns = 1 + width, 1 + n + workspace.directions
    of_parameters, of_results = record * (1 + n), record * (1 + n + count)
    memory[0] = t
    for i in range(n):
        memory[record * (1 + i)] = y[i]
    for i in range(count):
        memory[of_parameters + record * i] = interface.parameter(engine, i)
    for first in range(0, columns, width):
        for k in range(width):
            c = first + k
            for i in range(1 + n):  # time is the column after the state
                memory[record * i + 1 + k] = 1.0 if c == (i - 1 if i > 0 else n) else 0.0
            for i in range(count):
                moved = n < c < columns
                place = count * (c - n) + i
                memory[of_parameters + record * i + 1 + k] = (
                    interface.parameter(engine, place) if moved else 0.0
                )
        event_tangents(engine, workspace, mode, code, t, y, memory)
        for i in range(2 * m + n):
            values = margin[i] if i < 2 * m else jump[i - 2 * m]
            place = of_results + record * i
            values[0] = memory[place]
            for k in range(min(width, columns - first)):
                values[1 + first + k] = memory[place + 1 + k]


def event_tangents(
    engine: Any, workspace: Any, mode: int, code: int, t: float, y: Any, memory: Any
) -> None:
    """Call `mems_impact.hybrid.variational.flow.event_tangents`."""
    workspace.tangents(mode, code, t, y, engine.parameters, memory)


# --- Perturbations along a run

SAME_TIME = 1e-6  # time between simultaneous events, in time scales
MIN_RATE = 1e-14  # lower bound of the rate of a margin at an event, which bounds perturbations
# An event that leaves a smaller part of a column makes it zero, within the error of differences.
ZERO_COLUMN = 1e-11
# An event affects a component if an entry of the saltation matrix differs by more from identity.
JUMP_TOLERANCE = 1e-9
# Below this ratio of lengths between two orthonormalizations columns lose accuracy, and
# orthonormalization becomes twice as frequent, until the ratio improves.
REORTHONORMALIZE_BELOW = 1e-3


class PerturbationState(NamedTuple):
    """A state of the run and k columns with their growth; changed in place."""

    # The state, its cyclic components zero, then the columns, as in
    # `mems_impact.hybrid.variational.flow.tangent_flow`: orthonormal, in weighted components, but
    # for their cyclic components. Shape (n (1 + k),).
    y: Any
    mode: Any  # shape (1,)
    t: Any  # time since the time base of the loop, shape (1,)
    # Time by which the events of this instant are earlier for each column, shape (k,); negative if
    # later.
    shifts: Any
    growth: Any  # logarithms of the growth of each column, shape (k,)
    alive: Any  # 0 for a column that an event has reduced to zero, shape (k,)
    jumps: Any  # 1 for a component that an event has affected, shape (n,)
    length: Any  # longest time between orthonormalizations, at most the time scale, shape (1,)


class PropagationProblem(NamedTuple):
    """Data of a problem for the propagation."""

    variational: VariationalWorkspace
    k: int  # number of columns
    period: float
    scale: float  # the problem's time scale
    rtol: float
    atol: float
    cyclic: Any  # 1 for a component that is cyclic, shape (n,)
    records: Any  # 1 for a guard that only records, shape (m,)
    switches: Any  # shape (s,)
    # Powers of two by which components of columns are multiplied in lengths and products, shape
    # (n,).
    weights: Any


def flow_at(engine: Any, mode: int, t: float, y: Any, dy: Any) -> None:
    """Write the derivative of state and columns into `dy`."""
    interface.flow(engine, mode, t, y, dy)


def load_state(values: Any, first: int, state: Any, problem: Any) -> None:
    """Set the state to the values from `first` on, with cyclic components zero."""
    workspace = problem.variational
    for j in range(workspace.n):
        state.y[j] = 0.0 if problem.cyclic[j] == 1 else values[first + j]


def constrain(engine: Any, state: Any, problem: Any) -> None:
    """Project the columns onto the tangent space of the mode's manifold."""
    workspace = problem.variational
    if workspace.constrained[state.mode[0]] == 1:
        project(engine, state.mode[0], state.t[0], state.y, workspace)


def just_before(t: float) -> float:
    """Return the instant before `t`, at which a switch of the drive at `t` has not happened."""
    return t - 1e-15 * abs(t)


def rate_along(row: Any, flow: Any, n: int) -> float:
    """Return the rate of a margin along a flow, from its value and derivatives."""
    rate: float = row[n + 1]
    for j in range(n):
        rate += row[1 + j] * flow[j]
    return rate


def margin_error(row: Any, y: Any, n: int, rtol: float, atol: float) -> float:
    """Return the error of a margin by that of the state, from its value and derivatives."""
    size = gain = 0.0
    for j in range(n):
        gain += abs(row[1 + j])
        size += abs(row[1 + j] * y[j])
    return rtol * size + atol * gain


def simultaneous_below(error: float, rate: float, scale: float) -> float:
    """Return the margin below which an event is at the same time as another one."""
    return TOLERANCES * error + SAME_TIME * abs(rate) * scale


def apply_saltation(engine: Any, event: Any, state: Any, problem: Any) -> None:
    """Propagate the columns through the transition of an event by its saltation matrix.

    A perturbed motion reaches the guard earlier by w . grad h / (the rate of h). This shift is zero
    at a switch of the drive. A guard that a transition of this instant has made negative fires with
    that transition, and has its shift.
    """
    workspace = problem.variational
    n, m, k = workspace.n, workspace.m, problem.k
    guard, is_switch = int(event[GUARD]), int(event[KIND]) == SWITCH
    mode, t = int(event[MODE_BEFORE]), state.t[0]
    flow_before, flow_after = workspace.work[8], workspace.work[9]
    # The limit from the left, before a switch of the drive.
    interface.flow(engine, mode, just_before(t), state.y, flow_before)
    differentiate(engine, mode, 2 * m if is_switch else guard, state, problem)
    rate, is_beyond = 0.0, True
    if not is_switch:
        row = workspace.margin[guard]
        rate = rate_along(row, flow_before, n)
        error = margin_error(row, state.y, n, problem.rtol, problem.atol)
        is_beyond = row[0] < -simultaneous_below(error, rate, problem.scale)
        rate = math.copysign(max(abs(rate), MIN_RATE), rate)
    y_before = workspace.work[10]
    for j in range(n):
        y_before[j] = state.y[j]
        state.y[j] = event[HEAD + n + j]
    interface.flow(engine, int(event[MODE_AFTER]), t, state.y, flow_after)
    for j in range(n):
        state.y[j] = y_before[j]
    for i in range(n):
        effect = abs(workspace.jump[i, n + 1] + flow_before[i] - flow_after[i])
        for j in range(n):
            effect = max(effect, abs(workspace.jump[i, 1 + j] - (1.0 if i == j else 0.0)))
        state.jumps[i] |= int(effect > JUMP_TOLERANCE)
    for c in range(k):
        if not is_beyond:
            state.shifts[c] = 0.0
            for j in range(n):
                state.shifts[c] += workspace.margin[guard, 1 + j] * state.y[n + k * j + c] / rate
        update_column(c, flow_before, flow_after, state, problem)


def apply_rest_saltation(engine: Any, guard: int, state: Any, problem: Any) -> None:
    """Propagate state and columns through the impact without rebound at the end of chatter.

    The sequences of all perturbed motions end too, with a gap of zero: successive impulses close
    the gap, and displace the bodies in the same ratio as they change velocities. The remaining
    flights are so low that the instant of the transition is irrelevant.
    """
    workspace = problem.variational
    n, k, mode = workspace.n, problem.k, state.mode[0]
    flow_before, flow_after, response = workspace.work[8], workspace.work[9], workspace.work[5]
    for j in range(n):
        flow_before[j] = flow_after[j] = 0.0
    differentiate(engine, mode, workspace.m + guard, state, problem)
    contact_response(engine, mode, guard, response, state, problem)
    gap_response = 0.0
    for j in range(n):
        gap_response += workspace.margin[guard, 1 + j] * response[j]
    for c in range(problem.k):
        state.shifts[c] = 0.0
        gap = 0.0
        for j in range(n):
            gap += workspace.margin[guard, 1 + j] * state.y[n + k * j + c]
        for j in range(n):
            change = gap / gap_response * response[j] if gap_response != 0.0 else 0.0
            state.y[n + k * j + c] -= change
        update_column(c, flow_before, flow_after, state, problem)
    state.mode[0] = interface.transition(engine, mode, workspace.m + guard, state.t[0], state.y)


def contact_response(
    engine: Any, mode: int, guard: int, response: Any, state: Any, problem: Any
) -> None:
    """Write into `response` the rate of change of the state after a unit impulse at a contact.

    The impulse is the derivative of the transition along the gradient of the rate (the closing
    speed). Requires `differentiate` at the contact of `guard`.
    """
    workspace = problem.variational
    n, k, rate = workspace.n, problem.k, workspace.m + guard
    x, slope = workspace.work[0], workspace.work[6]
    for i in range(state.y.size):
        x[i] = state.y[i]
    for i in range(n):
        x[n + k * i] = -workspace.margin[rate, 1 + i]
        for j in range(n):
            x[n + k * i] += workspace.jump[i, 1 + j] * workspace.margin[rate, 1 + j]
    interface.flow(engine, mode, state.t[0], x[: state.y.size], slope[: state.y.size])
    for i in range(n):
        response[i] = slope[n + k * i]


def differentiate(engine: Any, mode: int, code: int, state: Any, problem: Any) -> None:
    """Differentiate margins and transition `code` at the present state, into margin and jump."""
    differentiate_event(engine, mode, code, state.t[0], state.y, problem.variational)


def update_column(c: int, flow_before: Any, flow_after: Any, state: Any, problem: Any) -> None:
    """Apply the saltation matrix to column `c`, with the flow before and after the event.

    For a motion whose event is earlier by the shift, the flow after it acts longer by the shift,
    and the flow before it shorter.
    """
    workspace = problem.variational
    n, k, column, shift = workspace.n, problem.k, workspace.n + c, state.shifts[c]
    result = workspace.work[10]
    length = max_size = 0.0
    for i in range(n):
        weight, change = problem.weights[i], abs(state.y[column + k * i])
        max_size = max(max_size, weight * change if problem.cyclic[i] == 0 else 0.0)
        kick = flow_after[i] - workspace.jump[i, n + 1]
        size = abs(flow_after[i]) + abs(workspace.jump[i, n + 1])
        for j in range(n):
            kick -= workspace.jump[i, 1 + j] * flow_before[j]
            size += abs(workspace.jump[i, 1 + j] * flow_before[j])
        result[i] = kick * shift if shift != 0.0 else 0.0
        size = size * abs(shift) if shift != 0.0 else 0.0
        for j in range(n):
            term = workspace.jump[i, 1 + j] * state.y[column + k * j]
            result[i] += term
            size += abs(term)
        if problem.cyclic[i] == 0:
            length = max(length, weight * abs(result[i]))
            max_size = max(max_size, weight * size)
    if length <= ZERO_COLUMN * max_size:
        state.alive[c] = 0
    for i in range(n):
        state.y[column + k * i] = result[i]


def orthonormalize(zero_part: float, state: Any, problem: Any) -> float:
    """Orthonormalize the columns, and accumulate their growth.

    Gram-Schmidt, applied twice for full accuracy. Returns the smallest remaining part of a column.
    A column with a remaining part of at most `zero_part` is zero from then on.
    """
    workspace = problem.variational
    n, k, min_ratio = workspace.n, problem.k, 1.0
    for c in range(k):
        column = n + c
        for i in range(n):
            if problem.cyclic[i] == 1 or state.alive[c] == 0:
                state.y[column + k * i] = 0.0
            state.y[column + k * i] *= problem.weights[i]
        if state.alive[c] == 0:
            state.shifts[c] = 0.0
            continue
        initial_length = length_of(state.y, column, k, n)
        for _ in range(2):
            for other in range(c):
                previous = n + other
                projection = 0.0
                for i in range(n):
                    projection += state.y[column + k * i] * state.y[previous + k * i]
                for i in range(n):
                    state.y[column + k * i] -= projection * state.y[previous + k * i]
                state.shifts[c] -= projection * state.shifts[other]
        length = length_of(state.y, column, k, n)
        if not length > zero_part * initial_length:
            state.alive[c] = 0
            state.shifts[c] = 0.0
            for i in range(n):
                state.y[column + k * i] = 0.0
            continue
        min_ratio = min(min_ratio, length, length / initial_length)
        state.growth[c] += math.log(length)
        state.shifts[c] /= length
        for i in range(n):
            state.y[column + k * i] /= length
    for i in range(n):
        for c in range(k):
            state.y[n + k * i + c] /= problem.weights[i]
    return min_ratio


def length_of(y: Any, column: int, k: int, n: int) -> float:
    """Return the length of n values of `y`, every k-th from `column` on."""
    square = 0.0
    for i in range(n):
        square += y[column + k * i] * y[column + k * i]
    return math.sqrt(square)


# --- Run and perturbations, chunk by chunk

# Progress of `stretch`.
STRETCHING = np.dtype(
    [
        ("advance", np.int64),  # address of the event loop
        ("chunk", np.int64),
        ("begun", np.int64),  # 1 during a chunk
        ("steps", np.int64),  # of the run, up to the last orthonormalization
    ]
)


def reset(engine: Any, parameters: Any, longest_step: float) -> None:
    """Restore the initial state of an engine, with other parameters."""
    interface.reset(engine, longest_step)
    for i in range(parameters.size):
        interface.set_parameter(engine, i, parameters[i])


def stretch(engine: Any, s: Any, w: Any, state: Any, problem: Any, lengths: Any, growth: Any,
            quota: int) -> int:  # fmt: skip
    """Continue the run and its columns chunk by chunk.

    `engine` is that of the extended flow, with events (see `mems_impact.hybrid.variational.flow`);
    `s` and `w` are records LOOP_STATE and STRETCHING. `lengths`, shape (N,), are the periods of
    each chunk, `quota` the most steps of the run in this call. Output `growth`, shape (N, k), are
    logarithms of the growth of columns in each chunk. Returns DONE, PAUSED, or the reason why the
    run ended; FAILED if columns failed, too.
    """
    while w.chunk < lengths.size:
        if w.begun == 0:
            begin(s, lengths[w.chunk])
            for c in range(problem.k):
                state.growth[c] = 0.0
            w.begun = 1
        while w.begun == 1:
            if quota <= 0:
                return PAUSED
            # The transitions of an instant change columns before the next arc begins.
            is_instant = s.first_arc == 1 or s.pending_guard != NONE
            status = loop.advance(engine, s, w, 0 if is_instant else 1)
            quota = 0 if s.collapse_length > 0.0 else quota - 1  # report it before the next one
            if status not in (PAUSED, BUFFER_FULL, DONE):
                return status
            w.begun = int(status != DONE)
            if s.restart == 0 and s.t - s.arc_start >= state.length[0]:
                s.restart = 1
                s.first_arc = s.negative_by_error
            is_passed = s.restart == 1 or status == DONE
            if is_passed and not pass_instant(engine, s, w, state, problem):
                return FAILED
            s.events_written = 0
        for c in range(problem.k):
            growth[w.chunk, c] = state.growth[c]
        w.chunk += 1
    return DONE


def begin(s: Any, length: float) -> None:
    """Extend the run by a number of periods."""
    periods = math.floor(length)
    s.end_phase += (length - periods) * s.period
    carry = whole_periods(s.end_phase, s.period)
    s.end_phase -= carry * s.period
    s.end_cycle += periods + carry
    s.first_arc = 1


def pass_instant(engine: Any, s: Any, w: Any, state: Any, problem: Any) -> bool:
    """Orthonormalize the columns at the end of an arc, and propagate them through its events.

    Return False on failure.
    """
    n, k, y = s.n, problem.k, table_row(s, Y)
    for j in range(n, n + n * k):
        state.y[j] = y[j]
    state.t[0], state.mode[0] = s.t, s.mode
    load_state(y, 0, state, problem)
    first = 0
    while first < s.events_written and not is_transition(event_at(s, first)):
        first += 1
    if first < s.events_written:
        state.t[0], state.mode[0] = event_time(s, first), int(event_at(s, first)[MODE_BEFORE])
        load_state(event_at(s, first), HEAD, state, problem)
    if s.steps > w.steps:
        w.steps = s.steps
        for c in range(k):
            state.shifts[c] = 0.0
        constrain(engine, state, problem)
        adapt_length(orthonormalize(0.0, state, problem), state.t[0] - s.arc_start, state, problem)
    for i in range(first, s.events_written):
        if not pass_event(engine, event_at(s, i), event_time(s, i), state, problem):
            return False
    for j in range(n, n + n * k):
        y[j] = state.y[j]
    return True


def is_transition(event: Any) -> bool:
    """Return whether an event has changed mode or state."""
    return int(event[KIND]) in (TRANSITION, SWITCH, ACCUMULATION)


def event_time(s: Any, i: int) -> float:
    """Return the time of event `i` since the time base."""
    event = event_at(s, i)
    time: float = event[TIME] + (event[CYCLE] - s.cycle) * s.period
    return time


def adapt_length(min_ratio: float, time: float, state: Any, problem: Any) -> None:
    """Adapt the time between orthonormalizations to the smallest remaining part after `time`."""
    is_whole = 2.0 * time >= state.length[0]  # a shorter time is not representative
    if min_ratio < REORTHONORMALIZE_BELOW:
        state.length[0] *= 0.5
    elif is_whole and min_ratio > REORTHONORMALIZE_BELOW**0.25 and state.length[0] < problem.scale:
        state.length[0] *= 2.0


def pass_event(engine: Any, event: Any, time: float, state: Any, problem: Any) -> bool:
    """Propagate the columns through an event at `time`; return whether it succeeded."""
    n, kind, guard = problem.variational.n, int(event[KIND]), int(event[GUARD])
    is_record = kind == TRANSITION and problem.records[guard] == 1
    if is_record or not is_transition(event):
        return True
    load_state(event, HEAD, state, problem)
    if kind == ACCUMULATION:
        apply_rest_saltation(engine, guard, state, problem)
        orthonormalize(ZERO_COLUMN, state, problem)
        if time > state.t[0] and not integrate_contact(engine, time, state, problem):
            return False
    else:
        apply_saltation(engine, event, state, problem)
    state.mode[0] = int(event[MODE_AFTER])
    load_state(event, HEAD + n, state, problem)
    constrain(engine, state, problem)
    orthonormalize(ZERO_COLUMN, state, problem)
    return True


def integrate_contact(engine: Any, time: float, state: Any, problem: Any) -> bool:
    """Integrate state and columns in the mode of contact to the end of a chatter sequence.

    The loop begins an arc afterwards, with other biases.
    """
    for i in range(2 * problem.variational.m):
        interface.set_bias(engine, i, 1e300)  # no root stops the engine
    mode, t = state.mode[0], state.t[0]
    state.t[0] = time
    for c in range(problem.k):
        state.shifts[c] = 0.0
    return integrate(engine, mode, state.y, t, time, problem.variational, approaches=False)
