"""Workspace of the event loop: status codes, loop state, rows of the event log.

Compiled code compares plain integers; the enumerations give them their names.

All of it is reached through the one record that the functions of the loop pass on as ``s``: numba
would carry an array through every call as nine words, and compiles the longer for each of them.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any

import numpy as np

# --- Codes: what the event loop answers, and what its rows are.


class Status(IntEnum):
    """What the event loop answers."""

    PAUSED = 0  # its quota of steps is spent
    BUFFER_FULL = 1
    DONE = 2
    FAILED = 3  # the engine cannot go on
    STEP_BUDGET = 4
    EVENT_BUDGET = 5
    CYCLING = 6  # the same state comes back within an instant
    INADMISSIBLE = 7  # the start lies beyond a guard
    WITHOUT_EFFECT = 8  # an impact changes nothing
    NO_SUCH_MODE = 9
    NOT_FINITE = 10
    ENDED = 11  # by a transition


class Kind(IntEnum):
    """What a row of the event buffer tells."""

    TRANSITION = 0
    ACCUMULATION = 1  # a sequence of impacts has come to its end
    SWITCH = 2  # of the drive
    APPROACH = 3  # closest, of bodies that part without an impact
    SECTION_CROSSING = 4
    REBASE = 5  # nothing: the loop cuts a long arc
    HANDOVER = 6  # the engine goes on by another method; with what it remembers of the mode


# --- What the event loop knows, remembers and writes: codes, the clock, rows of numbers, events.

# What `loop.run_steps` answers, for compiled code: see `Status`.
PAUSED, BUFFER_FULL, DONE, FAILED, STEP_BUDGET, EVENT_BUDGET, CYCLING = map(int, list(Status)[:7])
INADMISSIBLE, WITHOUT_EFFECT, NO_SUCH_MODE, NOT_FINITE, ENDED = map(int, list(Status)[7:])

# What a transition returns in place of a mode: it ends the run; it does not say how a sequence of
# impacts goes on; no mode fits the state.
ENDS, NO_REST, NO_FIT = -3, -2, -4

# Kinds of rows in the event buffer: see `Kind`.
TRANSITION, ACCUMULATION, SWITCH, APPROACH, SECTION_CROSSING, REBASE, HANDOVER = map(int, Kind)

# Columns of the event buffer; the states before and after follow.
CYCLE, TIME, KIND, GUARD, MODE_BEFORE, MODE_AFTER, HEAD = 0, 1, 2, 3, 4, 5, 6

ROOM = 40  # rows that one step, or one transition, may add at most, beside one a guard
NONE = -1
EPS = 2.0**-52

# Rows of the table, with a number for each guard or component of the state. All are as long as the
# longest, so that a function counts to ``s.n`` or ``s.m``.
# What the loop knows: guards of one instant are handled in ascending ORDER; 1 where a guard is an
# IMPACT, or a component CYCLIC; the SWITCHES of the drive, ascending times in (0, period].
ORDER, IMPACT, CYCLIC, SWITCHES = 0, 1, 2, 3
# The state at ``s.t``, cyclic components counting from the start of the arc; what they gathered
# before it; and a state of this instant, to be known again.
Y, OFFSET, CYCLE_MARK = 4, 5, 6
# The last impact at each guard: when. Where impacts lead to one mode after the other, the last one
# that led into the MODE of the one before it, and how many OTHERS lay in between: where flights
# BEGIN with it, how long after that one, how fast the bodies separated, and how high the flights
# have been since they began to shrink.
HIT_TIME, HIT_INTERVAL, HIT_SPEED, HIT_REACH = 7, 8, 9, 10
# Margins and rates where the last step began and where it ended, how fast the rates change, and for
# a margin that may have been at zero in between the side of zero where it began, 1 or -1.
MARGINS_BEFORE, MARGINS_AFTER, RATE_CHANGE, SUSPECT_SIDE = 11, 12, 13, 14
# 1 for a guard that only records; and for such a one 1 from where its margin has fallen through
# zero until it is above again, 2 where a transition has taken it there and it is to be recorded.
RECORDS, BELOW_ZERO = 15, 16
# Scratch that is only good until the next call. A function says what it leaves there.
G, STATE, MARGINS_AT, STATE_SHIFTED, STATE_AHEAD, STAGE, SLOPE, SUM, PAST, ENTERED, LEFT, SAMPLE = (
    range(17, 29)
)
SIZE, GAIN, TIMED = 29, 30, 31
HIT_BEGIN, HIT_MODE, HIT_OTHERS = 32, 33, 34
# The state from which a step was taken that had become very short.
COLLAPSE_STATE, ROWS = 35, 36

# All that the loop remembers between two calls, and where it finds and writes the rest.
LOOP_STATE = np.dtype(
    [
        ("table", np.int64),  # address of the rows of numbers, ROWS of them
        ("width", np.int64),  # numbers in each
        ("events", np.int64),  # address of the event buffer
        ("event_rows", np.int64),  # how many it holds
        ("samples", np.int64),  # address of the sample buffer
        ("sample_rows", np.int64),
        ("n", np.int64),  # states
        ("m", np.int64),  # guards
        ("switches", np.int64),  # of the drive in a period
        ("cycle", np.int64),  # periods completed before the time base
        ("t", np.float64),  # time since the start of that period
        ("mode", np.int64),
        ("modes", np.int64),  # how many there are
        ("period", np.float64),
        ("scale", np.float64),  # no more than this is looked ahead, and no less far than its 1e-12
        ("rtol", np.float64),
        ("atol", np.float64),
        ("end_cycle", np.int64),  # where the run ends
        ("end_phase", np.float64),
        ("first_arc", np.int64),  # 1 before the first arc: guards may be violated at the start
        ("switched", np.int64),  # 1 after the switch of this instant
        ("restart", np.int64),  # 1 if the next step begins an arc
        ("transitions_now", np.int64),  # transitions of this instant so far, 0 where it has settled
        ("pending_guard", np.int64),  # the guard for which there was no room in the buffer, or NONE
        ("mark_mode", np.int64),  # with MARK: a state of this instant, to be known again
        ("stop", np.float64),  # next switching time of the drive
        ("steps", np.int64),
        ("arc_steps", np.int64),
        ("arcs", np.int64),
        ("max_steps", np.int64),
        ("max_events", np.int64),
        ("cycle_events", np.int64),  # events since `events_from`, against the budget
        ("events_from", np.int64),
        ("events_written", np.int64),  # rows written to the event buffer
        ("failure", np.int64),  # the engine's code, after FAILED; or a guard, or a mode
        ("arc_start", np.float64),
        ("section", np.int64),  # its component; NONE without a section
        ("level", np.float64),
        ("direction", np.int64),  # in which the section is crossed, 0 for both
        ("section_side", np.int64),  # of the section, 1 or -1; 0 where that is not known
        ("section_distance", np.float64),  # its component less the level, where the last step ended
        ("section_speed", np.float64),  # at which that changed over the last step
        ("section_step", np.float64),  # length of that step
        ("section_bend", np.float64),  # recent change of that speed in a unit of time
        ("starts_negative", np.int64),  # 1 in an arc with a margin that started clearly negative
        ("negative_by_error", np.int64),  # 1 while a margin is negative by the error of a step
        ("recent_step", np.float64),  # length of the steps of late, 0 where an arc begins
        ("step_cut", np.int64),  # 1 if the last step ended early: at a root, or at a switch
        ("collapses", np.int64),  # how often steps have become very short, with no event in reach
        ("collapse_length", np.float64),  # of such a step that is still to be reported, else 0
        ("collapse_cycle", np.int64),  # where that step begins
        ("collapse_time", np.float64),
        ("collapse_mode", np.int64),
        ("per_period", np.int64),  # samples per period, 0 for none
        ("sample_cycle", np.int64),
        ("sample", np.int64),
        ("samples_written", np.int64),  # rows written to the sample buffer
    ]
)


def table_row(s: Any, i: int) -> Any:
    """Return row `i` of the table: a list in Python, in compiled code a pointer."""
    return s.table[i]


def event_row(s: Any) -> Any:
    """Return the next row of the event buffer."""
    return s.events[s.events_written]


def sample_row(s: Any) -> Any:
    """Return the next row of the sample buffer."""
    return s.samples[s.samples_written]


def event_at(s: Any, i: int) -> Any:
    """Return row `i` of the event buffer."""
    return s.events[i]


def sample_at(s: Any, i: int) -> Any:
    """Return row `i` of the sample buffer."""
    return s.samples[i]


def whole_periods(t: float, period: float) -> int:
    """Return how many periods fit into `t`; the quotient alone may be rounded to the next."""
    whole = math.floor(t / period)
    if whole * period > t:
        whole -= 1
    elif (whole + 1) * period <= t:
        whole += 1
    return whole


def next_switch(s: Any, t: float) -> float:
    """Return the first switching time of the drive after `t`; infinity if it has none."""
    if s.switches == 0:
        return math.inf
    switches = table_row(s, SWITCHES)
    # After the last switch of a period comes the first one of the next.
    stop: float = s.period + switches[0]
    for i in range(s.switches - 1, -1, -1):
        if switches[i] > t:
            stop = switches[i]
    return stop


def log_event(s: Any, t: float, kind: int, guard: int, mode: int, past: Any, y: Any) -> None:
    """Write one row to the event buffer."""
    whole = whole_periods(t, s.period)
    event, offset, n = event_row(s), table_row(s, OFFSET), s.n
    event[CYCLE] = s.cycle + whole
    event[TIME] = t - whole * s.period
    event[KIND] = kind
    event[GUARD] = guard
    event[MODE_BEFORE] = mode
    event[MODE_AFTER] = s.mode
    for i in range(n):
        event[HEAD + i] = past[i] + offset[i]
        event[HEAD + n + i] = y[i] + offset[i]
    s.events_written += 1
