"""Workspace of the event loop: status codes, loop state, rows of the event log.

Compiled code uses plain integers, named by the enumerations.

Functions of the loop receive one record ``s`` with the addresses of all arrays: numba passes an
array as nine words through every call, which increases compile time.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any

import numpy as np

# --- Status codes and kinds of events


class Status(IntEnum):
    """Return values of the event loop."""

    PAUSED = 0  # the quota of steps is used up
    BUFFER_FULL = 1
    DONE = 2
    FAILED = 3  # the engine cannot continue
    STEP_BUDGET = 4
    EVENT_BUDGET = 5
    CYCLING = 6  # a state recurs within one instant
    INADMISSIBLE = 7  # the start lies beyond a guard
    WITHOUT_EFFECT = 8  # an impact changes nothing
    NO_SUCH_MODE = 9
    NOT_FINITE = 10
    ENDED = 11  # by a transition


class Kind(IntEnum):
    """Kind of a row of the event buffer."""

    TRANSITION = 0
    ACCUMULATION = 1  # a chatter sequence has ended
    SWITCH = 2  # of the drive
    APPROACH = 3  # closest approach without impact
    SECTION_CROSSING = 4
    REBASE = 5  # no event: the loop divides a long arc
    HANDOVER = 6  # the engine changes its method; GUARD is its memory of the mode


# --- Memory of the event loop

# Return values of `loop.run_steps`: see `Status`.
PAUSED, BUFFER_FULL, DONE, FAILED, STEP_BUDGET, EVENT_BUDGET, CYCLING = map(int, list(Status)[:7])
INADMISSIBLE, WITHOUT_EFFECT, NO_SUCH_MODE, NOT_FINITE, ENDED = map(int, list(Status)[7:])

# Special return values of a transition: the run ends; a chatter sequence has no rest transition, or
# the zero of its margin is hidden by rounding errors; no mode fits the state, for a reason that the
# last number or a lower one encodes.
ENDS, NO_REST, NO_ZERO, NO_FIT = -3, -2, -4, -5

# Kinds of rows in the event buffer: see `Kind`.
TRANSITION, ACCUMULATION, SWITCH, APPROACH, SECTION_CROSSING, REBASE, HANDOVER = map(int, Kind)

# Columns of the event buffer; the states before and after follow.
CYCLE, TIME, KIND, GUARD, MODE_BEFORE, MODE_AFTER, HEAD = 0, 1, 2, 3, 4, 5, 6

ROOM = 40  # most rows that one step, or one transition, can add, and one per guard
NONE = -1
EPS = 2.0**-52

# Rows of the table, with a value for each guard or component of the state; only the first ``s.n``
# or ``s.m`` values are used. Constants: simultaneous guards are handled in ascending ORDER; IMPACT
# is 1 for an impact, CYCLIC is 1 for a cyclic component; SWITCHES of the drive are ascending times
# in (0, period], without forcing any times since the start of the run.
ORDER, IMPACT, CYCLIC, SWITCHES = 0, 1, 2, 3
# The state at ``s.t``, with cyclic components relative to the start of the arc; their offsets; and
# an earlier state of this instant, which detects cycling, as does WAITING_MARK with its guards.
Y, OFFSET, CYCLE_MARK = 4, 5, 6
# Chatter at each guard: HIT_TIME of the last impact; and of the last impact that led to HIT_MODE:
# its time HIT_BEGIN, the interval before it, the speed of separation, the largest height of the
# shrinking flights, and the number of impacts since then that led to other modes. At a flat zero
# HIT_HEIGHT is the longest of these flights, HIT_SPEED the ratio of the last two, HIT_REMAINING the
# predicted time from HIT_BEGIN to the end of the sequence (infinite before it, elsewhere 0).
HIT_TIME, HIT_INTERVAL, HIT_SPEED, HIT_HEIGHT = 7, 8, 9, 10
# Margins and rates at the start and end of the last step, the recent change of the rates, and for a
# margin that may have an undetected zero the side of zero on which it began, 1 or -1.
MARGINS_BEFORE, MARGINS_AFTER, RATE_CHANGE, SUSPECT_SIDE = 11, 12, 13, 14
# RECORDS is 1 for a guard that only records, CONDITION for one whose margin is a condition of the
# mode. Any other guard is WAITING (1) after its event, or where a mode begins below its zero, until
# its margin is positive.
RECORDS, WAITING = 15, 16
# Scratch, valid until the next call; docstrings list the results that functions leave there.
(
    G,
    STATE,
    MARGINS_AT,
    STATE_SHIFTED,
    STATE_AHEAD,
    STAGE,
    SLOPE,
    SUM,
    STATE_BEFORE,
    CONTACT_STATE,
    ACCUMULATION_STATE,
    SAMPLE,
) = range(17, 29)
SIZE, GAIN, TIME_SIZE = 29, 30, 31
HIT_BEGIN, HIT_MODE, HIT_OTHERS = 32, 33, 34
# The state at the start of a collapsed step.
COLLAPSE_STATE, CONDITION, WAITING_MARK = 35, 36, 37
# TIMED is 1 for a guard whose margin receives the time since the start of the run.
TIMED, HIT_REMAINING, ROWS = 38, 39, 40

# State of the loop between two calls, with the addresses of its arrays.
LOOP_STATE = np.dtype(
    [
        ("table", np.int64),  # address of the rows of numbers, ROWS of them
        ("width", np.int64),  # numbers in each
        ("events", np.int64),  # address of the event buffer
        ("event_rows", np.int64),  # its capacity
        ("samples", np.int64),  # address of the sample buffer
        ("sample_rows", np.int64),
        ("n", np.int64),  # states
        ("m", np.int64),  # guards
        ("switches", np.int64),  # of the drive in a period
        ("forced", np.int64),  # 1 if they recur in each period
        ("clock", np.int64),  # index of the time base in the parameters; NONE if none reads it
        ("cycle", np.int64),  # periods completed before the time base
        ("t", np.float64),  # time since the start of that period
        ("mode", np.int64),
        ("mode_before", np.int64),  # the latest transition, and from the next arc on the same mode
        ("modes", np.int64),  # number of modes
        ("period", np.float64),
        ("scale", np.float64),  # time scale of the problem
        ("longest", np.float64),  # longest step in this arc if it is longer than that, or 0
        ("limited_steps", np.int64),  # successive steps at the limit
        ("rtol", np.float64),
        ("atol", np.float64),
        ("end_cycle", np.int64),  # where the run ends
        ("end_phase", np.float64),
        ("first_arc", np.int64),  # 1 before the first arc: guards may be violated at the start
        ("initial", np.int64),  # 1 if no other run has led to the start
        ("switched", np.int64),  # 1 after the switch of this instant
        ("restart", np.int64),  # 1 if the next step begins an arc
        ("transitions_now", np.int64),  # transitions in this instant so far, 0 between instants
        ("pending_guard", np.int64),  # a guard to be handled after BUFFER_FULL, or NONE
        ("mark_mode", np.int64),  # mode of CYCLE_MARK
        ("stop", np.float64),  # next switching time of the drive
        ("steps", np.int64),
        ("arc_steps", np.int64),
        ("arcs", np.int64),
        ("max_steps", np.int64),
        ("max_events", np.int64),
        ("cycle_events", np.int64),  # events since `events_from`, against the budget
        ("events_from", np.int64),
        ("events_written", np.int64),  # rows written to the event buffer
        ("failure", np.int64),  # code of the engine, guard or mode, depending on the status
        ("arc_start", np.float64),
        ("section", np.int64),  # its component; NONE without a section
        ("level", np.float64),
        ("direction", np.int64),  # direction of recorded crossings, 0 for both
        ("section_side", np.int64),  # side of the section, 1 or -1; 0 if unknown
        ("section_distance", np.float64),  # component minus level at the end of the last step
        ("section_speed", np.float64),  # mean rate of that distance over the last step
        ("section_step", np.float64),  # length of that step
        ("section_curvature", np.float64),  # recent rate of change of that speed
        ("biased", np.int64),  # 1 in an arc with margins whose bias ends where they are positive
        ("negative_by_error", np.int64),  # 1 while a margin is negative by the error of a step
        ("recent_step", np.float64),  # recent step length, 0 at the start of an arc
        ("step_cut", np.int64),  # 1 if the last step ended at a root or a switch
        ("collapses", np.int64),  # number of step collapses without an event nearby
        ("collapse_length", np.float64),  # length of an unreported collapsed step, else 0
        ("collapse_cycle", np.int64),  # start of that step
        ("collapse_time", np.float64),
        ("collapse_mode", np.int64),
        ("samples_written", np.int64),  # rows of the sample buffer that have a state
    ]
)


def table_row(s: Any, i: int) -> Any:
    """Return row `i` of the table: a list, in compiled code a pointer."""
    return s.table[i]


def event_at(s: Any, i: int) -> Any:
    """Return row `i` of the event buffer."""
    return s.events[i]


def sample_at(s: Any, i: int) -> Any:
    """Return row `i` of the sample buffer: the period, the time in it, the mode, the state."""
    return s.samples[i]


def whole_periods(t: float, period: float) -> int:
    """Return the number of whole periods in `t`, exact despite the rounding of the quotient."""
    count = math.floor(t / period)
    if count * period > t:
        count -= 1
    elif (count + 1) * period <= t:
        count += 1
    return count


def next_switch(s: Any, t: float) -> float:
    """Return the first switching time of the drive after `t`; infinity if it has none.

    Without forcing return the last time before it at which functions of the time since the start of
    the run receive an earlier time: after long runs it is coarser than `t`.
    """
    if s.switches == 0:
        return math.inf
    switches = table_row(s, SWITCHES)
    if s.forced == 0:
        switch = absolute_switch(s, time_base(s) + t)
        if switch == math.inf:
            return math.inf
        before = float(np.nextafter(switch, 0.0)) - time_base(s)
        return before if time_base(s) + before < switch else float(np.nextafter(before, 0.0))
    # The last switch of a period is followed by the first one of the next period.
    stop: float = s.period + switches[0]
    for i in range(s.switches - 1, -1, -1):
        if switches[i] > t:
            stop = switches[i]
    return stop


def absolute_switch(s: Any, time: float) -> float:
    """Return the first switching time after a time since the start of the run, or infinity."""
    for i in range(s.switches):
        if table_row(s, SWITCHES)[i] > time:
            return float(table_row(s, SWITCHES)[i])
    return math.inf


def time_base(s: Any) -> float:
    """Return the time from the start of the run to the start of the current period."""
    base: float = s.cycle * s.period
    return base


def log_event(s: Any, t: float, kind: int, guard: int, mode: int, y_before: Any, y: Any) -> None:
    """Write one row to the event buffer."""
    periods = whole_periods(t, s.period)
    event, offset, n = event_at(s, s.events_written), table_row(s, OFFSET), s.n
    event[CYCLE] = s.cycle + periods
    event[TIME] = t - periods * s.period
    event[KIND] = kind
    event[GUARD] = guard
    event[MODE_BEFORE] = mode
    event[MODE_AFTER] = s.mode
    for i in range(n):
        event[HEAD + i] = y_before[i] + offset[i]
        event[HEAD + n + i] = y[i] + offset[i]
    s.events_written += 1
