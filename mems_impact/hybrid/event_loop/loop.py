"""The event loop.

Plain functions over arrays and one record. The loop can be resumed after every return, so that a
driver in Python can drain the event buffer, show progress and handle Ctrl-C between two calls.
`hybrid.event_loop.compiled` compiles the functions with numba.

An arc is integrated step by step until a guard fires. Events are detected in four ways: roots of
margins that the engine finds (a sign change over a step); roots of their rates (a closest approach,
where the margin may be negative); a scan of a step that may contain several minima; and a check of
all margins after every transition (simultaneous events). All are in `event_detection`; `chatter`
completes sequences of impacts; `workspace` defines the memory of the loop.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mems_impact.hybrid.event_loop.chatter import (
    complete_chatter,
    is_finite,
    is_flat_zero,
    is_hidden,
)
from mems_impact.hybrid.event_loop.event_detection import (
    TINY_BIAS,
    bisect_margin,
    certainly_decreasing,
    changes_ahead,
    detect_crossings,
    first_event_in_step,
    first_violated_guard,
    hide_rounding,
    inadmissible_gap,
    init_section,
    is_decreasing,
    margin_error_scales,
    rounding_error,
    update_margins,
    violation_threshold,
)
from mems_impact.hybrid.event_loop.flights import sharpen
from mems_impact.hybrid.event_loop.long_steps import (
    STEPS_PER_PERIOD,
    is_long,
    is_resolved,
    lengthen_steps,
)
from mems_impact.hybrid.event_loop.workspace import (
    ACCUMULATION,
    APPROACH,
    BUFFER_FULL,
    COLLAPSE_STATE,
    CONDITION,
    CONTACT_STATE,
    CYCLE_MARK,
    CYCLIC,
    CYCLING,
    DONE,
    ENDED,
    ENDS,
    EPS,
    EVENT_BUDGET,
    FAILED,
    HANDOVER,
    HIT_BEGIN,
    HIT_TIME,
    IMPACT,
    INADMISSIBLE,
    MARGINS_AFTER,
    MARGINS_AT,
    NO_SUCH_MODE,
    NONE,
    NOT_FINITE,
    OFFSET,
    PAUSED,
    RATE_CHANGE,
    REBASE,
    ROOM,
    SAMPLE,
    SECTION_CROSSING,
    STATE_BEFORE,
    STEP_BUDGET,
    SWITCH,
    SWITCHES,
    TIMED,
    TRANSITION,
    WAITING,
    WAITING_MARK,
    WITHOUT_EFFECT,
    Y,
    absolute_switch,
    log_event,
    next_switch,
    sample_at,
    table_row,
    time_base,
    whole_periods,
)
from mems_impact.integrators import interface

REBASE_PERIODS = 16.0  # longest arc, which preserves the accuracy of t
SWITCH_RTOL = 1e-14  # part of the period within which an instant is that of a switch
# A step collapses if it is shorter than recent steps by the first factor; the recent length decays
# by the second factor per step. Steps shrink faster than that towards a jump of the flow.
COLLAPSE_RATIO, RECENT_STEP_DECAY = 1e-2, 0.7
MAX_COLLAPSES = 4  # all reported; then the 8th, 16th, 32nd …, since a stiff system has many


def run_steps(engine: Any, s: Any, quota: int) -> int:
    """Integrate until the end, a full buffer, the quota of steps or a failure.

    `engine` has the interface `mems_impact.integrators.interface`, `s` is a record LOOP_STATE.
    Without any quota the call performs the transitions of the present instant. Returns PAUSED,
    BUFFER_FULL, DONE, or the reason why the run ended (see `workspace`). ``s.collapse_length`` is
    above zero where the last step was so short that the flow may jump. ``s.failure`` is the
    engine's code after FAILED, the guard after INADMISSIBLE, WITHOUT_EFFECT and NOT_FINITE, the
    mode after NO_SUCH_MODE.
    """
    y = table_row(s, Y)
    while True:
        if s.events_written + ROOM + s.m > s.event_rows:
            return BUFFER_FULL
        if s.first_arc == 1:
            s.first_arc = 0
            set_clock(engine, s)
            s.failure = inadmissible_gap(engine, s, s.t, y)
            if s.failure != NONE:
                return INADMISSIBLE
            guard = first_violated_guard(engine, s, s.mode, s.t, y, NONE, NONE)
            if s.switched == 0 and is_switch(s):
                guard = 2 * s.m  # a run that ended here left the switch to this one
            if guard == 2 * s.m and sample_due(s) and sample_time(s) <= s.t:
                write_sample(s, y)
            status = resolve_instant(engine, s, y, guard)
            if status != DONE:
                return status
        elif s.pending_guard != NONE:
            status = resolve_instant(engine, s, y, s.pending_guard)
            if status != DONE:
                return status
        if quota <= 0:
            return PAUSED
        if s.restart == 1:
            begin_arc(engine, s, y)

        status = interface.step(engine)
        quota -= 1
        if status == interface.HANDOVER:
            log_event(s, s.t, HANDOVER, interface.method_memory(engine, s.mode), s.mode, y, y)
            s.restart = 1
            s.first_arc = s.negative_by_error  # check uncertain margins again
            continue
        s.steps += 1
        s.arc_steps += 1
        if status == interface.CLOSE_ROOTS and s.arc_steps > 1 and s.t >= s.stop:
            status = interface.STOPPED  # the last step ended at the switch
        if status == interface.CLOSE_ROOTS and s.arc_steps > 1:
            interface.state(engine, y)
            log_event(s, s.t, REBASE, 0, s.mode, y, y)
            s.restart = 1
            s.first_arc = s.negative_by_error
            continue
        if status < 0 or s.arc_steps > s.max_steps:
            if s.arc_steps > 1:  # otherwise y is the start of the arc
                s.t = interface.time(engine)
                interface.state(engine, y)
            s.failure = min(status, 0)
            return FAILED if status < 0 else STEP_BUDGET
        t_start = s.t
        t = interface.time(engine)
        if is_long(s, t_start, t) and not is_resolved(engine, s, t_start, t):
            interface.interpolate(engine, t_start, y)
            log_event(s, t_start, REBASE, 0, s.mode, y, y)
            s.restart = 1
            s.first_arc = s.negative_by_error
            continue
        is_suspect = update_margins(engine, s, status, t_start, t)
        if s.biased == 1:
            clear_bias(engine, s)

        guard, t_event = NONE, t
        if is_suspect:
            guard, t_event = first_event_in_step(engine, s, status, t_start, t)
        if s.negative_by_error == 1 and guard == NONE and status != interface.STOPPED:
            interface.state(engine, y)
            guard = first_violated_guard(engine, s, s.mode, t, y, NONE, NONE)
            s.negative_by_error = any_margin_below(s)
            if guard != NONE and table_row(s, MARGINS_AFTER)[guard] < -violation_threshold(
                s, guard
            ):
                # The step ends far below the zero, so that its uncertain crossing was one.
                t_event = bisect_margin(engine, s, guard, t_start, t)

        t_end = (s.end_cycle - s.cycle) * s.period + s.end_phase
        at_switch = status == interface.STOPPED and guard == NONE
        if s.stop - t_event <= SWITCH_RTOL * s.period:
            # A guard that fires at a switch fires after it.
            at_switch, t_event = True, switch_instant(s, t_end)
        write_samples(engine, s, min(t_event, t_end), at_switch or t_event >= t_end)
        at_end = t_event > t_end or (t_event == t_end and (guard == NONE or at_switch))
        s.t = t_end if at_end else t_event
        if s.t > t_start:
            s.switched = 0
        at_root = status == interface.ROOT and s.t == t
        if at_end or t_event < t:
            interface.interpolate(engine, min(s.t, t), y)
        else:
            interface.state(engine, y)
        detect_crossings(
            engine, s, t_start, y, interface.root_directions(engine, 2 * s.m) if at_root else 0
        )
        if at_end:
            return DONE
        if at_root:
            log_root_events(engine, s, t, y)
        if guard == NONE and status == interface.STEPPED and step_collapsed(s, t - t_start):
            interface.interpolate(engine, t_start, table_row(s, COLLAPSE_STATE))
            s.collapse_length = t - t_start
            s.collapse_cycle = s.cycle
            s.collapse_time = t_start
            s.collapse_mode = s.mode
            quota = 0  # report this collapse before the next one
        s.step_cut = int(status != interface.STEPPED)
        lengthen_steps(engine, s, t - t_start)
        if at_switch:
            guard = 2 * s.m
            begin_period(engine, s)
        if guard != NONE:
            status = resolve_instant(engine, s, y, guard)
            if status != DONE:
                return status
        elif t > REBASE_PERIODS * max(s.period, STEPS_PER_PERIOD * s.longest):
            log_event(s, t, REBASE, 0, s.mode, y, y)
            s.restart = 1


def advance(engine: Any, s: Any, w: Any, quota: int) -> int:
    """Call `run_steps`; compiled code calls it by its address, ``w.advance``."""
    return run_steps(engine, s, quota)


def begin_arc(engine: Any, s: Any, y: Any) -> None:
    """Move the time base, store the cyclic offsets and restart the engine at (s.t, y)."""
    if s.t >= s.period:
        rebase_time(engine, s, whole_periods(s.t, s.period))
    if s.cycle != s.events_from:
        s.events_from = s.cycle
        s.cycle_events = 0
    for i in range(s.n):
        if table_row(s, CYCLIC)[i] == 1:
            table_row(s, OFFSET)[i] += y[i]
            y[i] = 0.0
    s.stop = next_switch(s, s.t)

    # A margin that starts at zero gets a tiny positive bias: otherwise CVODE determines its sign a
    # tenth of a step ahead and misses an earlier re-impact.
    margins, rate_changes = table_row(s, MARGINS_AFTER), table_row(s, RATE_CHANGE)
    interface.margins(engine, s.mode, s.t, y, margins)
    # A negative margin that still decreases has had its transition, without effect; it gets no
    # bias. A guard that waits does not fire again, even if rounding left its margin positive; such
    # a margin may stay negative.
    m, waiting = s.m, table_row(s, WAITING)
    s.biased = 0
    s.mode_before = s.mode
    for i in range(m):
        rate_changes[i] = 0.0
        interface.set_bias(engine, m + i, 0.0)
        is_waiting, is_falling = waiting[i] == 1, margins[m + i] < 0.0
        is_violated = False
        if margins[i] < 0.0 or is_waiting or (margins[i] == 0.0 and is_falling):
            margin_error_scales(engine, s, s.mode, s.t, y)
            is_violated = margins[i] < -violation_threshold(s, i)
            if is_waiting or is_falling:
                is_falling = is_decreasing(engine, s, s.mode, i, s.t, y)
        noise = 0.0  # of the time that the margin receives
        if is_waiting:
            noise = rounding_error(s, i) if table_row(s, TIMED)[i] == 1 else 0.0
        stays_below = is_violated and is_waiting
        is_lifted = margins[i] <= 0.0 and not is_falling and not stays_below
        has_fallen = is_waiting and margins[i] > -noise and is_falling
        if is_lifted:
            waiting[i] = 0.0
        tiny_bias = TINY_BIAS if is_lifted else -TINY_BIAS - noise
        interface.set_bias(
            engine, i, -margins[i] * (1.0 + 1e-9) + tiny_bias if is_lifted or has_fallen else 0.0
        )
        starts_below = margins[i] < 0.0 and margins[i] < -rounding_error(s, i)
        if (starts_below and not stays_below) or noise > 0.0:
            s.biased = 1
    sharpen(engine, s, y)
    interface.restart(engine, s.mode, s.t, y, s.stop)
    init_section(engine, s, y)
    s.restart = 0
    s.negative_by_error = 0
    s.recent_step = 0.0
    s.step_cut = 0
    s.longest = 0.0
    s.limited_steps = 0
    s.arc_start = s.t
    s.arc_steps = 0
    s.arcs += 1


def rebase_time(engine: Any, s: Any, periods: int) -> None:
    """Measure time from the start of a later period."""
    now = time_base(s) + s.t
    s.cycle += periods
    set_clock(engine, s)
    s.t -= periods * s.period
    # Functions of the time since the start of the run must not receive an earlier one.
    if s.forced == 0 and (s.clock != NONE or s.switches > 0) and time_base(s) + s.t < now:
        s.t = since_base(s, now)
    for i in range(s.m):
        table_row(s, HIT_TIME)[i] -= periods * s.period
        table_row(s, HIT_BEGIN)[i] -= periods * s.period


def set_clock(engine: Any, s: Any) -> None:
    """Give the time base to functions that read the time since the start of the run."""
    if s.clock != NONE:
        interface.set_parameter(engine, s.clock, time_base(s))


def is_switch(s: Any) -> bool:
    """Return whether ``s.t`` is a switching time but for rounding."""
    found, base = False, time_base(s)
    for i in range(s.switches):
        if s.forced == 1:
            distance = abs(s.t - table_row(s, SWITCHES)[i]) % s.period
            distance = min(distance, s.period - distance)
        else:
            distance = abs(base + s.t - table_row(s, SWITCHES)[i]) - 2.0 * EPS * abs(base)
        found = found or distance <= SWITCH_RTOL * s.period
    return found


def switch_instant(s: Any, t_end: float) -> float:
    """Return the time of the switch at which the arc stops; the end `t_end` if equal.

    At an absolute time, functions receive no earlier one there.
    """
    if s.forced == 1:
        return float(s.stop)
    base = time_base(s)
    switch = absolute_switch(s, base + s.stop)
    return t_end if base + t_end == switch else since_base(s, switch)


def since_base(s: Any, time: float) -> float:
    """Return a time since the start of the run as one since the time base, not rounded down."""
    t: float = time - time_base(s)
    return float(np.nextafter(t, math.inf)) if time_base(s) + t < time else t


def begin_period(engine: Any, s: Any) -> None:
    """Set the first switch of the next period exactly, if ``s.t`` is that one."""
    if s.forced == 1 and s.t > s.period:
        rebase_time(engine, s, 1)
        s.t = table_row(s, SWITCHES)[0]


def clear_bias(engine: Any, s: Any) -> None:
    """Remove the bias of margins that have become positive."""
    margins = table_row(s, MARGINS_AFTER)
    for i in range(s.m):
        if abs(interface.bias(engine, i)) > TINY_BIAS and margins[i] > rounding_error(s, i):
            interface.set_bias(engine, i, 0.0)


def step_collapsed(s: Any, h: float) -> bool:
    """Return whether a step that the method chose has collapsed and should be reported."""
    if s.step_cut == 1:
        return False
    is_short = h < COLLAPSE_RATIO * s.recent_step
    s.recent_step = h if is_short else max(h, RECENT_STEP_DECAY * s.recent_step)
    if not is_short:
        return False
    s.collapses += 1
    return bool(s.collapses <= MAX_COLLAPSES or s.collapses & (s.collapses - 1) == 0)


def any_margin_below(s: Any) -> int:
    """Return 1 if a margin was not positive where the last step ended."""
    for i in range(s.m):
        if table_row(s, MARGINS_AFTER)[i] <= 0.0:
            return 1
    return 0


def resolve_instant(engine: Any, s: Any, y: Any, guard: int) -> int:
    """Perform all transitions of the instant ``s.t``, beginning with `guard`.

    `guard` is ``2 m`` for a switch of the drive. Returns DONE if no guard fires any more,
    BUFFER_FULL to be called again, or the reason why the run ends. Updates `y`, ``s.mode`` and
    ``s.t``, which is later if a chatter sequence is completed.
    """
    m = s.m
    margins, y_before = table_row(s, MARGINS_AT), table_row(s, STATE_BEFORE)
    condition = table_row(s, CONDITION)
    s.restart = 1
    while guard != NONE:
        s.pending_guard = guard
        if s.events_written + ROOM > s.event_rows:
            return BUFFER_FULL
        s.pending_guard = NONE
        for i in range(s.n):
            y_before[i] = y[i]
        mode = s.mode
        is_impact = guard < m and table_row(s, IMPACT)[guard] == 1
        code, kind = guard, TRANSITION
        if guard == 2 * m:
            kind = SWITCH
            s.switched = 1
        if is_impact:
            interface.margins(engine, mode, s.t, y, margins)
            is_closing = certainly_decreasing(s, m + guard, margins[m + guard])
            if not is_closing:
                margin_error_scales(engine, s, mode, s.t, y)
                is_closing = margins[m + guard] < -rounding_error(s, m + guard)
            if not is_closing and not is_lifted_by_rebound(engine, s, y, guard):
                # The contact is not closing: a rebound would move the body into the wall.
                code, kind = m + guard, ACCUMULATION
        s.mode = interface.transition(engine, mode, code, s.t, y)
        s.failure = guard
        if s.mode == ENDS:
            s.mode = mode
            log_event(s, s.t, kind, guard, mode, y_before, y)
            return ENDED
        if not 0 <= s.mode < s.modes:
            s.failure, s.mode = s.mode, mode
            return NO_SUCH_MODE
        if not is_finite(s, y):
            return NOT_FINITE
        has_effect = mode != s.mode
        for i in range(s.n):
            has_effect = has_effect or y_before[i] != y[i]
        log_event(s, s.t, kind, guard, mode, y_before, y)
        s.mode_before = mode
        if kind == TRANSITION:
            table_row(s, WAITING)[guard] = 1.0 - condition[guard]
        s.transitions_now += 1
        s.cycle_events += 1
        if s.cycle_events > s.max_events:
            return EVENT_BUDGET
        if is_cycling(s, y) and has_effect and kind != SWITCH:
            if kind == TRANSITION:
                return CYCLING
            break  # the cycle consists of rounding errors of bodies in contact
        # Impacts of a row of bodies travel from end to end repeatedly: if one end always had
        # priority, their number would grow without bound with the length of the row.
        last_guard, last_impact = guard, guard if is_impact else NONE
        guard, mode = first_violated_guard(engine, s, s.mode, s.t, y, NONE, last_impact), s.mode
        if kind == TRANSITION and is_impact and complete_chatter(engine, s, y, last_guard):
            if not 0 <= s.mode < s.modes:
                s.events_written -= 1  # remove the accumulation without a valid mode
                s.failure, s.mode = s.mode, mode
                return ENDED if s.failure == ENDS else NO_SUCH_MODE
            if not is_finite(s, y):
                return NOT_FINITE
            guard = first_violated_guard(engine, s, s.mode, s.t, y, NONE, last_impact)
        if not has_effect and kind != SWITCH and condition[last_guard] == 1:
            # Without a change the same guard would fire again.
            if kind == TRANSITION and guard != NONE and table_row(s, IMPACT)[guard] == 1:
                s.failure = guard
                return WITHOUT_EFFECT
            guard = NONE
    s.transitions_now = 0
    return DONE


def is_lifted_by_rebound(engine: Any, s: Any, y: Any, guard: int) -> bool:
    """Return whether a margin increases after an impact, although it has no rate before it.

    At a flat zero, as of a cube, the rate does not show the speed. `complete_chatter` refuses a
    margin that rounding errors hide. Overwrites CONTACT_STATE and the rows of `changes_ahead`.
    """
    y_after = table_row(s, CONTACT_STATE)
    for i in range(s.n):
        y_after[i] = y[i]
    mode = interface.transition(engine, s.mode, guard, s.t, y_after)
    if not (0 <= mode < s.modes and is_finite(s, y_after)):
        return False
    margin_error_scales(engine, s, mode, s.t, y_after)
    if changes_ahead(engine, s, mode, guard, s.t, y_after) > 0:
        return True
    mode_before, s.mode = s.mode, mode
    h = min(s.scale / STEPS_PER_PERIOD, 0.5 * (next_switch(s, s.t) - s.t))
    result = is_flat_zero(engine, s, s.t, y_after, guard, h)
    result = result and is_hidden(engine, s, s.t, y_after, guard, h)
    s.mode = mode_before
    return bool(result)


def is_cycling(s: Any, y: Any) -> bool:
    """Return whether mode, state and guards that wait have occurred before in this instant.

    One state is stored, and replaced whenever the number of transitions has doubled.
    """
    is_same = s.transitions_now > 1 and s.mode == s.mark_mode
    for i in range(s.n):
        is_same = is_same and y[i] == table_row(s, CYCLE_MARK)[i]
    for i in range(s.m):
        is_same = is_same and table_row(s, WAITING)[i] == table_row(s, WAITING_MARK)[i]
    if s.transitions_now & (s.transitions_now - 1) == 0:
        s.mark_mode = s.mode
        for i in range(s.n):
            table_row(s, CYCLE_MARK)[i] = y[i]
        for i in range(s.m):
            table_row(s, WAITING_MARK)[i] = table_row(s, WAITING)[i]
    return is_same


def log_root_events(engine: Any, s: Any, t: float, y: Any) -> None:
    """Record closest approaches and crossings of the section, which do not end an arc."""
    m = s.m
    margins = table_row(s, MARGINS_AFTER)
    for i in range(m):
        # A closest approach at a margin of zero is a contact.
        is_approach = interface.root_directions(engine, m + i) > 0 and margins[i] > 0.0
        is_hidden = is_approach and hide_rounding(engine, s, i, t, y)
        if is_approach and not is_hidden and table_row(s, IMPACT)[i] == 1:
            log_event(s, t, APPROACH, i, s.mode, y, y)
    side = interface.root_directions(engine, 2 * m)
    if side != 0:
        log_event(s, t, SECTION_CROSSING, side, s.mode, y, y)


def write_samples(engine: Any, s: Any, limit: float, includes_limit: bool) -> None:
    """Write the samples due before `limit`; at it too if the run or its arc ends there.

    A sample at a switch is the state before it, as at the end of a run.
    """
    y = table_row(s, SAMPLE)
    while sample_due(s):
        t = sample_time(s)
        if includes_limit and limit < t <= limit * (1.0 + 4.0 * EPS):
            t = limit  # equal to the end of the run except for rounding
        if t > limit or (t == limit and not includes_limit):
            return
        # The step may end before a switch by rounding.
        interface.interpolate(engine, min(max(t, s.arc_start), interface.time(engine)), y)
        write_sample(s, y)


def sample_due(s: Any) -> bool:
    """Return whether samples remain to be written."""
    return bool(s.samples_written < s.sample_rows)


def sample_time(s: Any) -> float:
    """Return the time of the next sample since the start of the current period."""
    sample = sample_at(s, s.samples_written)
    return float((sample[0] - s.cycle) * s.period + sample[1])


def write_sample(s: Any, y: Any) -> None:
    """Write the next sample."""
    sample = sample_at(s, s.samples_written)
    sample[2] = s.mode
    for i in range(s.n):
        sample[3 + i] = y[i] + table_row(s, OFFSET)[i]
    s.samples_written += 1
