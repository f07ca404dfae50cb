"""The event loop: the one text that all engines run.

Plain functions over arrays and one record, resumable at every return, so that a driver in Python
can drain the event buffer, show progress and hear Ctrl-C between two calls. Interpreted they run
as they stand; `hybrid.native` has numba compile them unchanged.

An arc is integrated step by step until a guard fires. What fires is found in four ways: the
engine's own root finding (a margin changes sign over a step), the rate guards (a margin dipped
below zero and came back within a step, so its closest approach is a root too), a look inside the
step where the margin may have done so twice, and a look at all margins after every transition
(what fires in the same instant). The first three are in `guards`, with the last; `chatter`
completes sequences of impacts; `record` holds what the loop remembers.
"""

from __future__ import annotations

import math
from typing import Any

from mems_impact.engines import contract as arc
from mems_impact.hybrid.chatter import complete_chatter
from mems_impact.hybrid.guards import (
    HAIR,
    clearly,
    first_guard,
    inside,
    look,
    resolution,
    rounding_of,
    surely_falling,
    violated,
)
from mems_impact.hybrid.record import (
    ACCUMULATION,
    APPROACH,
    BEND,
    BUFFER_FULL,
    CLOCK,
    CYCLE,
    CYCLING,
    DONE,
    EVENT_BUDGET,
    FAILED,
    GUARD,
    HEAD,
    HIT_TIME,
    INADMISSIBLE,
    KIND,
    LOOKED,
    MODE_AFTER,
    MODE_BEFORE,
    NO_SUCH_MODE,
    NONE,
    NOT_FINITE,
    NOW,
    PAST,
    PAUSED,
    REBASE,
    ROOM,
    SAMPLE,
    SECTION_CROSSING,
    STEP_BUDGET,
    SWITCH,
    TIME,
    TRANSITION,
    WITHOUT_EFFECT,
    Buffers,
    Layout,
    next_switch,
    note,
    whole_periods,
)

__all__ = [
    "ACCUMULATION", "APPROACH", "BUFFER_FULL", "CLOCK", "CYCLE", "CYCLING", "DONE",
    "EVENT_BUDGET", "FAILED", "GUARD", "HEAD", "INADMISSIBLE", "KIND", "MODE_AFTER",
    "MODE_BEFORE", "NONE", "NOT_FINITE", "NO_SUCH_MODE", "PAUSED", "REBASE", "ROOM",
    "SECTION_CROSSING", "STEP_BUDGET", "SWITCH", "TIME", "TRANSITION", "WITHOUT_EFFECT",
    "Buffers", "Layout", "advance",
]  # fmt: skip

REBASE_PERIODS = 16.0  # an arc without event is cut here, lest t lose digits


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
    hits: Any,
    edge: Any,
    mark: Any,
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
    offset, events, samples, hits, edge, mark, work
        The fields of `Buffers`.
    quota : int
        Steps that this call may take.

    Returns
    -------
    int
        PAUSED, BUFFER_FULL, DONE, or what ended the run (see `record`). ``s.failure`` is the
        engine's code after FAILED, the guard after INADMISSIBLE, WITHOUT_EFFECT and NOT_FINITE, the
        mode after NO_SUCH_MODE.
    """
    layout = Layout(order, impact, cyclic, switches)
    buffers = Buffers(offset, events, samples, hits, edge, mark, work)
    while True:
        if s.rows + ROOM + layout.order.size > buffers.events.shape[0]:
            return BUFFER_FULL
        if quota <= 0:
            return PAUSED
        if s.fresh == 1:
            s.fresh = 0
            s.restart = 1
            s.failure = inside(engine, s, s.t, y, layout, buffers)
            if s.failure != NONE:
                return INADMISSIBLE
            guard = violated(engine, s, s.mode, s.t, y, layout, buffers, NONE, NONE)
            for i in range(layout.switches.size):
                # A run that ended here left the jump to this one.
                since = abs(s.t - layout.switches[i]) % s.period
                if min(since, s.period - since) <= 1e-14 * s.period:
                    guard = 2 * layout.order.size
            status = resolve(engine, s, y, guard, layout, buffers)
            if status != DONE:
                return status
        elif s.pending != NONE:
            status = resolve(engine, s, y, s.pending, layout, buffers)
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
        something = look(engine, status, before, t, buffers.edge)
        if s.lifted == 1:
            lower(engine, layout, buffers)

        guard, t_event = NONE, t
        if something:
            guard, t_event = first_guard(engine, s, status, before, t, layout, buffers)
        if s.doubt == 1 and guard == NONE and status != arc.STOPPED:
            arc.state(engine, y)
            guard = violated(engine, s, s.mode, t, y, layout, buffers, NONE, NONE)
            s.doubt = still_below(layout, buffers)

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
            status = resolve(engine, s, y, guard, layout, buffers)
            if status != DONE:
                return status
        elif status == arc.STOPPED:
            arc.state(engine, y)
            if t > s.period:
                # The first switch of the next period, whatever its sum with the period rounds to.
                shift(s, 1, buffers)
                s.t = layout.switches[0]
            status = resolve(engine, s, y, 2 * layout.order.size, layout, buffers)
            if status != DONE:
                return status
        elif t > REBASE_PERIODS * s.period:
            arc.state(engine, y)
            note(s, t, REBASE, 0, s.mode, y, y, buffers)
            s.restart = 1


def begin_arc(engine: Any, s: Any, y: Any, layout: Any, buffers: Any) -> None:
    """Move the time base, put the cyclic components aside and restart the engine at (s.t, y)."""
    if s.t >= s.period:
        shift(s, whole_periods(s.t, s.period), buffers)
    if s.cycle != s.events_from:
        s.events_from = s.cycle
        s.cycle_events = 0
    for i in range(y.size):
        if layout.cyclic[i] == 1:
            buffers.offset[i] += y[i]
            y[i] = 0.0
    s.stop = next_switch(s, s.t, layout)

    # A margin that starts at zero is given a hair above it: CVODE would otherwise look for its
    # sign a tenth of a step ahead and overlook a re-impact that comes sooner.
    now, bend = buffers.edge[NOW], buffers.edge[BEND]
    arc.margins(engine, s.mode, s.t, y, now)
    # One that still falls has had its transition, which changed nothing: it is left alone.
    m = layout.order.size
    s.lifted = 0
    for i in range(m):
        bend[i] = 0.0
        lift = now[i] <= 0.0 and now[m + i] >= 0.0
        arc.set_bias(engine, i, -now[i] * (1.0 + 1e-9) + HAIR if lift else 0.0)
        if now[i] < 0.0:
            resolution(engine, s, s.mode, s.t, y, layout, buffers)
            if now[i] < -clearly(s, i, layout, buffers):
                s.lifted = 1
    arc.restart(engine, s.mode, s.t, y, s.stop)
    s.restart = 0
    s.doubt = 0
    s.arc_start = s.t
    s.arc_steps = 0
    s.arcs += 1


def shift(s: Any, periods: int, buffers: Any) -> None:
    """Count time from the start of a later period."""
    s.cycle += periods
    s.t -= periods * s.period
    for i in range(buffers.hits.shape[0]):
        buffers.hits[i, HIT_TIME] -= periods * s.period


def lower(engine: Any, layout: Any, buffers: Any) -> None:
    """Take the lift from margins that have become positive: from now on zero is their limit."""
    now = buffers.edge[NOW]
    for i in range(layout.order.size):
        if arc.bias(engine, i) > HAIR and now[i] > rounding_of(buffers, i):
            arc.set_bias(engine, i, 0.0)


def still_below(layout: Any, buffers: Any) -> int:
    """Return 1 if a margin was not positive where the last step ended."""
    for i in range(layout.order.size):
        if buffers.edge[NOW][i] <= 0.0:
            return 1
    return 0


def resolve(engine: Any, s: Any, y: Any, guard: int, layout: Any, buffers: Any) -> int:
    """Carry out all transitions of the instant ``s.t``, beginning with `guard`.

    `guard` is ``2 m`` for a switch of the drive. Returns DONE if the instant settles, BUFFER_FULL
    to be called again, or what ends the run. `y`, ``s.mode`` and ``s.t`` are left as they are after
    it, which is later where a sequence of impacts is completed.
    """
    m = layout.order.size
    looked, past = buffers.work[LOOKED], buffers.work[PAST]
    s.restart = 1
    while guard != NONE:
        s.pending = guard
        if s.rows + ROOM > buffers.events.shape[0]:
            return BUFFER_FULL
        s.pending = NONE
        for i in range(y.size):
            past[i] = y[i]
        mode = s.mode
        impact = guard < m and layout.impact[guard] == 1
        code, kind = guard, SWITCH if guard == 2 * m else TRANSITION
        if impact:
            arc.margins(engine, mode, s.t, y, looked)
            closing = surely_falling(s, m + guard, looked[m + guard], buffers)
            if not closing:
                resolution(engine, s, mode, s.t, y, layout, buffers)
                closing = looked[m + guard] < -rounding_of(buffers, m + guard)
            if not closing:
                # A contact that is not closing: a rebound would throw the body through the wall.
                code, kind = m + guard, ACCUMULATION
        s.mode = arc.transition(engine, mode, code, s.t, y)
        s.failure = guard
        if not 0 <= s.mode < s.modes:
            s.failure, s.mode = s.mode, mode
            return NO_SUCH_MODE
        changed = mode != s.mode
        for i in range(y.size):
            if not math.isfinite(y[i]):
                return NOT_FINITE
            changed = changed or past[i] != y[i]
        note(s, s.t, kind, guard, mode, past, y, buffers)
        s.instant += 1
        s.cycle_events += 1
        if s.cycle_events > s.max_events:
            return EVENT_BUDGET
        if comes_back(s, y, buffers) and changed and kind != SWITCH:
            if kind == TRANSITION:
                return CYCLING
            break  # a collapse has come down to rounding: bodies in contact, handed on in a ring
        if kind == TRANSITION and impact:
            t = complete_chatter(engine, s, s.t, y, guard, layout, buffers)
            if t > s.t:
                s.instant = 0
            s.t = t
        # Impacts of bodies in a row go through it from end to end, again and again: if one end
        # always came first, they would grow beyond all bounds with the length of the row.
        after = guard if impact else NONE
        guard = violated(engine, s, s.mode, s.t, y, layout, buffers, NONE, after)
        if not changed and kind != SWITCH:
            # Nothing moved: looking again would find the same.
            if kind == TRANSITION and guard != NONE and layout.impact[guard] == 1:
                s.failure = guard
                return WITHOUT_EFFECT
            guard = NONE
    s.instant = 0
    return DONE


def comes_back(s: Any, y: Any, buffers: Any) -> bool:
    """Return whether mode and state of this instant have been there before.

    One of them is remembered, and replaced whenever their number has doubled.
    """
    same = s.instant > 1 and s.mode == s.mark_mode
    for i in range(y.size):
        same = same and y[i] == buffers.mark[i]
    if s.instant & (s.instant - 1) == 0:
        s.mark_mode = s.mode
        for i in range(y.size):
            buffers.mark[i] = y[i]
    return same


def note_passages(engine: Any, s: Any, t: float, y: Any, layout: Any, buffers: Any) -> None:
    """Record closest approaches and crossings of the section: roots that end no arc."""
    m = layout.order.size
    now = buffers.edge[NOW]
    for i in range(m):
        # What approaches a wall without leaving it by more than rounding is in contact.
        if layout.impact[i] == 1 and arc.fired(engine, m + i) > 0 and now[i] > 0.0:
            note(s, t, APPROACH, i, s.mode, y, y, buffers)
    side = arc.fired(engine, 2 * m)
    if side != 0:
        note(s, t, SECTION_CROSSING, side, s.mode, y, y, buffers)


def take_samples(engine: Any, s: Any, limit: float, last: bool, buffers: Any) -> None:
    """Write the samples due before `limit` (at it too, if it is the `last` instant)."""
    if s.per_period == 0:
        return
    y = buffers.work[SAMPLE]
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
