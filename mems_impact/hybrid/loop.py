"""The event loop: the one text that both engines run.

Plain functions over arrays and one record, resumable at every return, so that a driver in Python
can drain the event buffer, show progress and hear Ctrl-C between two calls. Interpreted they run
as they stand; `hybrid.native` has numba compile them unchanged.

An arc is integrated step by step until a guard fires. What fires is found in three ways: CVODE's
own root finding (a margin changes sign over a step), the rate guards (a margin dipped below zero
and came back within a step, so its closest approach is a root too), and a look at all margins
after every transition (what fires in the same instant).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from mems_impact.engines import contract as arc

# What `advance` answers.
PAUSED, BUFFER_FULL, DONE, FAILED, STEP_BUDGET, EVENT_BUDGET, CYCLING = 0, 1, 2, 3, 4, 5, 6
INADMISSIBLE, WITHOUT_EFFECT = 7, 8

# Kinds of rows in the event buffer.
TRANSITION, ACCUMULATION, SWITCH, APPROACH, SECTION_CROSSING, REBASE = 0, 1, 2, 3, 4, 5

# Columns of the event buffer; the states before and after follow.
CYCLE, TIME, KIND, GUARD, MODE_BEFORE, MODE_AFTER, HEAD = 0, 1, 2, 3, 4, 5, 6

MAX_SIMULTANEOUS = 16
ROOM = 2 * MAX_SIMULTANEOUS + 8  # rows that one step may add at most, beside one a guard
REBASE_PERIODS = 16.0  # an arc without event is cut here, lest t lose digits
NONE = -1

# A flight this short, in units of time, is a sequence of impacts on its last legs: the closing
# acceleration is constant over it to the integration tolerance, while the gap still has digits
# (u^2/2a = 1e-11 at a = 0.1, where rounding of the position is 1e-16).
CHATTER_TIME = 2e-5

ABRUPT = 1e3  # flights this much shorter than the acceleration says are none
CLEARLY = 1e-6  # a margin below minus this is no rounding, and no error of the integration
FORWARD = 1e-8  # time over which the flow is followed to see whether a margin rises

# All that the loop remembers between two calls.
CLOCK = np.dtype(
    [
        ("cycle", np.int64),  # periods completed before the time base
        ("t", np.float64),  # time since the start of that period
        ("mode", np.int64),
        ("period", np.float64),
        ("end_cycle", np.int64),  # where the run ends
        ("end_phase", np.float64),
        ("fresh", np.int64),  # 1 before the first arc: guards may be violated at the start
        ("restart", np.int64),  # 1 if the next step begins an arc
        ("stop", np.float64),  # next switching time of the drive
        ("steps", np.int64),
        ("arc_steps", np.int64),
        ("arcs", np.int64),
        ("max_steps", np.int64),
        ("max_events", np.int64),
        ("cycle_events", np.int64),  # events since `events_from`, against the budget
        ("events_from", np.int64),
        ("rows", np.int64),  # rows in the event buffer
        ("failure", np.int64),  # the engine's code, after FAILED
        ("hit_guard", np.int64),  # the last impact, for accumulation
        ("hit_time", np.float64),
        ("hit_interval", np.float64),
        ("hit_speed", np.float64),
        ("arc_start", np.float64),
        ("lifted", np.int64),  # 1 while a margin that started clearly negative is lifted
        ("doubt", np.int64),  # 1 while a margin is negative by the integration error alone
        ("per_period", np.int64),  # samples per period, 0 for none
        ("sample_cycle", np.int64),
        ("sample", np.int64),
        ("samples", np.int64),  # rows in the sample buffer
    ]
)


class Layout(NamedTuple):
    """What the loop knows of the automaton and of the drive's jumps."""

    order: Any  # int array, shape (m,): guards of one instant are handled in ascending order
    impact: Any  # int array, shape (m,): 1 where the guard is an impact
    cyclic: Any  # int array, shape (n,): 1 where the component is cyclic
    switches: Any  # float array: switching times in (0, period], ascending


class Buffers(NamedTuple):
    """Where the loop writes."""

    offset: Any  # float array, shape (n,): what cyclic components gathered before this arc
    events: Any  # float array, shape (rows, HEAD + 2 n)
    samples: Any  # float array, shape (rows, 3 + n)
    work: Any  # float array, shape (6, max(n, 2 m)): scratch


def advance(
    engine: Any,
    s: Any,
    y: Any,
    order: Any,
    impact: Any,
    cyclic: Any,
    switches: Any,
    offset: Any,
    events: Any,
    samples: Any,
    work: Any,
    quota: int,
) -> int:
    """Integrate until the end, a full buffer, a spent quota of steps or a failure.

    Parameters
    ----------
    engine : an engine of the contract in `mems_impact.engines.contract`
    s : CLOCK record
    y : float array, shape (n,)
        The state at ``s.t``; cyclic components count from the start of the arc.
    order, impact, cyclic, switches
        The fields of `Layout`. They come one by one because numba's cache on disk must not name
        classes of ours, which a later version may rename.
    offset, events, samples, work
        The fields of `Buffers`.
    quota : int
        Steps that this call may take.

    Returns
    -------
    int
        PAUSED, BUFFER_FULL, DONE, FAILED, STEP_BUDGET, EVENT_BUDGET, CYCLING, INADMISSIBLE or
        WITHOUT_EFFECT. ``s.failure`` is the engine's code after FAILED, the guard after the last
        two.
    """
    layout = Layout(order, impact, cyclic, switches)
    buffers = Buffers(offset, events, samples, work)
    while True:
        if s.rows + ROOM + layout.order.size > buffers.events.shape[0]:
            return BUFFER_FULL
        if quota <= 0:
            return PAUSED
        if s.fresh == 1:
            s.fresh = 0
            s.restart = 1
            s.failure = inside(engine, s.mode, s.t, y, layout, buffers)
            if s.failure != NONE:
                return INADMISSIBLE
            guard = violated(engine, s.mode, s.t, y, layout, buffers)
            for i in range(layout.switches.size):
                # A run that ended here left the jump to this one.
                since = abs(s.t - layout.switches[i]) % s.period
                if min(since, s.period - since) <= 1e-14 * s.period:
                    guard = 2 * layout.order.size
            if guard != NONE:
                status = resolve(engine, s, s.t, y, guard, layout, buffers)
                if status != DONE:
                    return status
        if s.restart == 1:
            begin_arc(engine, s, y, layout, buffers)

        status = arc.step(engine)
        quota -= 1
        s.steps += 1
        s.arc_steps += 1
        if status == arc.CLOSE_ROOTS and s.arc_steps > 1 and s.t >= s.stop:
            status = arc.STOPPED  # the last step has ended at the switch already
        if status == arc.CLOSE_ROOTS and s.arc_steps > 1:
            arc.state(engine, y)
            note(s, s.t, REBASE, 0, s.mode, y, y, buffers)
            s.restart = 1
            s.fresh = s.doubt  # a margin in doubt is looked at again
            continue
        if status < 0 or s.arc_steps > s.max_steps:
            if s.arc_steps > 1:  # else y is where the arc, and its first step, began
                s.t = arc.time(engine)
                arc.state(engine, y)
            s.failure = min(status, 0)
            return FAILED if status < 0 else STEP_BUDGET
        before = s.t
        t = arc.time(engine)
        if s.lifted == 1:
            lower(engine, s, t, y, layout, buffers)

        guard = NONE
        t_event = t
        if status == arc.ROOT:
            guard, t_event = first_guard(engine, s, before, t, layout, buffers)
        if s.doubt == 1 and guard == NONE and status != arc.STOPPED:
            arc.state(engine, y)
            guard = violated(engine, s.mode, t, y, layout, buffers)

        end = (s.end_cycle - s.cycle) * s.period + s.end_phase
        take_samples(engine, s, min(t_event, end), t_event >= end, buffers)
        if t_event > end or (t_event == end and guard == NONE):
            arc.interpolate(engine, end, y)
            s.t = end
            return DONE

        s.t = t_event
        if status == arc.ROOT and t_event == t:
            arc.state(engine, y)
            note_passages(engine, s, t, y, layout, buffers)
        if guard != NONE:
            if t_event < t:
                arc.interpolate(engine, t_event, y)
            status = resolve(engine, s, t_event, y, guard, layout, buffers)
            if status != DONE:
                return status
        elif status == arc.STOPPED:
            arc.state(engine, y)
            if t > s.period:
                # The first switch of the next period, whatever its sum with the period rounds to.
                s.cycle += 1
                s.hit_time -= s.period
                s.t = t = layout.switches[0]
            status = resolve(engine, s, t, y, 2 * layout.order.size, layout, buffers)
            if status != DONE:
                return status
        elif t > REBASE_PERIODS * s.period:
            arc.state(engine, y)
            note(s, t, REBASE, 0, s.mode, y, y, buffers)
            s.restart = 1


def begin_arc(engine: Any, s: Any, y: Any, layout: Any, buffers: Any) -> None:
    """Move the time base, put the cyclic components aside and restart the engine at (s.t, y)."""
    if s.t >= s.period:
        whole = whole_periods(s.t, s.period)
        s.cycle += whole
        s.t -= whole * s.period
        s.hit_time -= whole * s.period
    if s.cycle != s.events_from:
        s.events_from = s.cycle
        s.cycle_events = 0
    for i in range(y.size):
        if layout.cyclic[i] == 1:
            buffers.offset[i] += y[i]
            y[i] = 0.0
    # After the last switch of a period comes the first one of the next.
    s.stop = s.period + layout.switches[0] if layout.switches.size > 0 else math.inf
    for i in range(layout.switches.size - 1, -1, -1):
        if layout.switches[i] > s.t:
            s.stop = layout.switches[i]

    # A margin that starts at zero is given a hair above it: CVODE would otherwise look for its
    # sign a tenth of a step ahead and overlook a re-impact that comes sooner.
    g = buffers.work[0]
    arc.margins(engine, s.mode, s.t, y, g)
    # One that still falls has had its transition, which changed nothing: it is left alone.
    m = layout.order.size
    s.lifted = 0
    for i in range(m):
        lift = g[i] <= 0.0 and g[m + i] >= 0.0
        if lift and g[i] < -CLEARLY:
            s.lifted = 1
        arc.set_bias(engine, i, -g[i] * (1.0 + 1e-9) + 1e-300 if lift else 0.0)
    arc.restart(engine, s.mode, s.t, y, s.stop)
    s.restart = 0
    s.doubt = 0
    s.arc_start = s.t
    s.arc_steps = 0
    s.arcs += 1


def lower(engine: Any, s: Any, t: float, y: Any, layout: Any, buffers: Any) -> None:
    """Take the lift from margins that have become positive: from now on zero is their limit."""
    g = buffers.work[0]
    arc.state(engine, y)
    arc.margins(engine, s.mode, t, y, g)
    s.lifted = 0
    for i in range(layout.order.size):
        if arc.bias(engine, i) > CLEARLY:
            if g[i] > 0.0:
                arc.set_bias(engine, i, 0.0)
            else:
                s.lifted = 1


def whole_periods(t: float, period: float) -> int:
    """Return how many periods fit into `t`; the quotient alone may be rounded to the next."""
    whole = math.floor(t / period)
    if whole * period > t:
        whole -= 1
    elif (whole + 1) * period <= t:
        whole += 1
    return whole


def first_guard(
    engine: Any, s: Any, before: float, t: float, layout: Any, buffers: Any
) -> tuple[int, float]:
    """Return the guard that fires first up to the root at `t`, and when; NONE if none does."""
    m = layout.order.size
    order = layout.order
    guard = NONE
    for i in range(m):
        if arc.fired(engine, i) < 0 and (guard == NONE or order[i] < order[guard]):
            if rising(engine, s, i, t, layout, buffers):
                s.doubt = 1
            else:
                guard = i
    t_event = t
    g, y = buffers.work[0], buffers.work[1]
    for i in range(m):
        if arc.fired(engine, m + i) > 0:
            arc.state(engine, y)
            arc.margins(engine, s.mode, t, y, g)
            # Zero as well: CVODE stops where a margin and its rate are zero together.
            if g[i] + arc.bias(engine, i) <= 0.0:
                t_crossing = crossing(engine, s, i, before, t, buffers)
                if rising(engine, s, i, t_crossing, layout, buffers):
                    s.doubt = 1
                elif (
                    guard == NONE
                    or t_crossing < t_event
                    or (t_crossing == t_event and order[i] < order[guard])
                ):
                    guard = i
                    t_event = t_crossing
    return guard, t_event


def rising(engine: Any, s: Any, guard: int, t: float, layout: Any, buffers: Any) -> bool:
    """Return whether `guard`, no impact, seems to fire while the flow makes its margin rise.

    The polynomial of a step has the integration error, below which a slip may lie as a whole. Its
    margin then seems to fall through zero where it does not, again and again. It is left alone
    until a step ends where it falls.
    """
    if layout.impact[guard] == 1:
        return False
    g, y = buffers.work[0], buffers.work[1]
    arc.interpolate(engine, t, y)
    arc.margins(engine, s.mode, t, y, g)
    if g[layout.order.size + guard] <= 0.0:
        return False
    # The rate says so; but it may have been left at a constant (see `Automaton`).
    margin = g[guard]
    h = look_ahead(engine, s, t, y, buffers)
    return bool((g[guard] - margin) * h > 0.0)


def look_ahead(engine: Any, s: Any, t: float, y: Any, buffers: Any) -> float:
    """Follow the flow from `y` by a short time, which is returned; the margins are in work[0].

    It is negative, the way back, where the drive is about to switch.
    """
    slope, ahead = buffers.work[3], buffers.work[4]
    h = FORWARD if t + FORWARD < s.stop else -FORWARD
    arc.flow(engine, s.mode, t, y, slope)
    for i in range(y.size):
        ahead[i] = y[i] + h * slope[i]
    arc.margins(engine, s.mode, t + h, ahead, buffers.work[0])
    return h


def crossing(engine: Any, s: Any, i: int, inside: float, outside: float, buffers: Any) -> float:
    """Bisect margin `i` on the last step: positive at `inside`, negative at `outside`."""
    g, y = buffers.work[0], buffers.work[1]
    bias = arc.bias(engine, i)
    for _ in range(80):
        middle = 0.5 * (inside + outside)
        if middle <= inside or middle >= outside:
            break
        arc.interpolate(engine, middle, y)
        arc.margins(engine, s.mode, middle, y, g)
        if g[i] + bias > 0.0:
            inside = middle
        else:
            outside = middle
    return outside


def violated(engine: Any, mode: int, t: float, y: Any, layout: Any, buffers: Any) -> int:
    """Return the first guard, by order, that fires where the state is put; or NONE.

    Its margin is zero or below and falls; or it is clearly negative, and no gap.
    """
    g = buffers.work[0]
    m = layout.order.size
    order = layout.order
    arc.margins(engine, mode, t, y, g)
    guard = NONE
    for i in range(m):
        fires = g[i] <= 0.0 and g[m + i] < 0.0
        fires = fires or (g[i] < -CLEARLY and layout.impact[i] == 0)
        if fires and (guard == NONE or order[i] < order[guard]):
            guard = i
    return guard


def inside(engine: Any, mode: int, t: float, y: Any, layout: Any, buffers: Any) -> int:
    """Return a gap that is clearly negative and does not open, as a start may be; or NONE."""
    g = buffers.work[0]
    m = layout.order.size
    arc.margins(engine, mode, t, y, g)
    for i in range(m):
        if g[i] < -CLEARLY and g[m + i] <= 0.0 and layout.impact[i] == 1:
            return i
    return NONE


def resolve(engine: Any, s: Any, t: float, y: Any, guard: int, layout: Any, buffers: Any) -> int:
    """Carry out all transitions of the instant `t`, beginning with `guard`; DONE if it settles.

    `guard` is ``2 m`` for a switch of the drive. `y` and ``s.mode`` are left as they are after it.
    """
    m = layout.order.size
    g, past = buffers.work[0], buffers.work[2]
    s.restart = 1
    for _ in range(MAX_SIMULTANEOUS):
        if guard == NONE:
            return DONE
        for i in range(y.size):
            past[i] = y[i]
        mode = s.mode
        code, kind = guard, SWITCH if guard == 2 * m else TRANSITION
        if guard < m and layout.impact[guard] == 1:
            arc.margins(engine, mode, t, y, g)
            if g[m + guard] >= 0.0:
                # A contact that is not closing: the flight was lower than the integration error,
                # and a rebound would throw the body through the wall.
                code, kind = m + guard, ACCUMULATION
        s.mode = arc.transition(engine, mode, code, t, y)
        note(s, t, kind, guard, mode, past, y, buffers)
        s.cycle_events += 1
        if s.cycle_events > s.max_events:
            return EVENT_BUDGET
        changed = mode != s.mode
        for i in range(y.size):
            changed = changed or past[i] != y[i]
        if kind == TRANSITION and guard < m and layout.impact[guard] == 1:
            t = complete_chatter(engine, s, t, y, guard, layout, buffers)
        following = violated(engine, s.mode, t, y, layout, buffers)
        if not changed and kind != SWITCH:
            # Nothing moved: looking again would find the same.
            if following != NONE and layout.impact[following] == 1:
                s.failure = following
                return WITHOUT_EFFECT
            return DONE
        guard = following
    return CYCLING


def complete_chatter(
    engine: Any, s: Any, t: float, y: Any, guard: int, layout: Any, buffers: Any
) -> float:
    """Complete a sequence of impacts at `guard` once its flights are short; return the new time.

    Under a constant closing acceleration the speeds of separation, and with them the flights,
    shrink by a constant ratio. What remains after a flight of length T is T ratio/(1 - ratio);
    then the body rests, which is an impact without rebound.
    """
    m = layout.order.size
    g = buffers.work[0]
    arc.margins(engine, s.mode, t, y, g)
    speed = g[m + guard]
    interval = t - s.hit_time if s.hit_guard == guard else math.inf
    ratio = speed / s.hit_speed if s.hit_guard == guard and s.hit_speed > 0.0 else 1.0
    shrinking = interval < s.hit_interval and 0.0 <= ratio < 1.0
    s.hit_guard = guard
    s.hit_time = t
    s.hit_interval = interval
    s.hit_speed = speed
    if not (interval < CHATTER_TIME and ballistic(engine, s, t, y, guard, layout, buffers)):
        return t
    if shrinking:
        remaining = interval * ratio / (1.0 - ratio)
    elif speed * interval < 64.0 * rounding_of(engine, s.mode, t, y, guard, buffers):
        remaining = 0.0  # a flight that drowns in the rounding of the gap need not shrink
    else:
        return t
    end = (s.end_cycle - s.cycle) * s.period + s.end_phase
    if remaining > 10.0 * CHATTER_TIME or t + remaining >= min(end, s.stop):
        return t
    past, slope, middle = buffers.work[2], buffers.work[3], buffers.work[4]
    for i in range(y.size):
        past[i] = y[i]
    mode = s.mode
    s.mode = arc.transition(engine, mode, m + guard, t, y)
    # The midpoint rule over the remaining time leaves an error of its third power.
    arc.flow(engine, s.mode, t, y, slope)
    for i in range(y.size):
        middle[i] = y[i] + 0.5 * remaining * slope[i]
    arc.flow(engine, s.mode, t + 0.5 * remaining, middle, slope)
    for i in range(y.size):
        middle[i] = y[i]
        y[i] += remaining * slope[i]
    if violated(engine, s.mode, t + remaining, y, layout, buffers) != NONE:
        # The arc would have ended before, as the slip of a frame that friction stops: this mode's
        # flow must not carry the state beyond. What it moves in so short a time is left to the arc.
        for i in range(y.size):
            y[i] = middle[i]
    s.t = t + remaining
    s.hit_guard = NONE
    note(s, s.t, ACCUMULATION, guard, mode, past, y, buffers)
    return s.t


def ballistic(engine: Any, s: Any, t: float, y: Any, guard: int, layout: Any, buffers: Any) -> bool:
    """Return whether the last flight was one that acceleration turned round.

    It lasts 2 u/a. A body that another one throws back arrives far too soon for its speed. The
    acceleration is that after the impact; with friction it changes during the flight.
    """
    m = layout.order.size
    g = buffers.work[0]
    arc.margins(engine, s.mode, t, y, g)
    rate = g[m + guard]
    h = look_ahead(engine, s, t, y, buffers)
    acceleration = (rate - g[m + guard]) / h
    return bool(2.0 * s.hit_speed <= ABRUPT * abs(acceleration) * s.hit_interval)


def rounding_of(engine: Any, mode: int, t: float, y: Any, guard: int, buffers: Any) -> float:
    """Return what roundings of the state amount to in the margin of `guard`."""
    g, moved = buffers.work[0], buffers.work[4]
    arc.margins(engine, mode, t, y, g)
    margin = g[guard]
    total = 0.0
    for i in range(y.size):
        moved[i] = y[i]
    for i in range(y.size):
        moved[i] = y[i] * (1.0 + 2.0**-26)
        arc.margins(engine, mode, t, moved, g)
        total += abs(g[guard] - margin) * 2.0**-26
        moved[i] = y[i]
    return total


def note_passages(engine: Any, s: Any, t: float, y: Any, layout: Any, buffers: Any) -> None:
    """Record closest approaches and crossings of the section: roots that end no arc."""
    m = layout.order.size
    for i in range(m):
        if layout.impact[i] == 1 and arc.fired(engine, m + i) > 0:
            note(s, t, APPROACH, i, s.mode, y, y, buffers)
    side = arc.fired(engine, 2 * m)
    if side != 0:
        note(s, t, SECTION_CROSSING, side, s.mode, y, y, buffers)


def note(
    s: Any, t: float, kind: int, guard: int, mode: int, past: Any, y: Any, buffers: Any
) -> None:
    """Write one row to the event buffer."""
    whole = whole_periods(t, s.period)
    row = buffers.events[s.rows]
    row[CYCLE] = s.cycle + whole
    row[TIME] = t - whole * s.period
    row[KIND] = kind
    row[GUARD] = guard
    row[MODE_BEFORE] = mode
    row[MODE_AFTER] = s.mode
    for i in range(y.size):
        row[HEAD + i] = past[i] + buffers.offset[i]
        row[HEAD + y.size + i] = y[i] + buffers.offset[i]
    s.rows += 1


def take_samples(engine: Any, s: Any, limit: float, last: bool, buffers: Any) -> None:
    """Write the samples due before `limit` (at it too, if it is the `last` instant)."""
    if s.per_period == 0:
        return
    y = buffers.work[5]
    while s.samples < buffers.samples.shape[0]:
        phase = (s.sample % s.per_period) * s.period / s.per_period
        cycle = s.sample_cycle + s.sample // s.per_period
        t = (cycle - s.cycle) * s.period + phase
        if t > limit or (t == limit and not last):
            return
        arc.interpolate(engine, max(t, s.arc_start), y)
        row = buffers.samples[s.samples]
        row[0] = cycle
        row[1] = phase
        row[2] = s.mode
        for i in range(buffers.offset.size):
            row[3 + i] = y[i] + buffers.offset[i]
        s.samples += 1
        s.sample += 1
