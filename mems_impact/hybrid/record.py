"""What the event loop remembers and writes: codes, the clock, layout, buffers, rows of events."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

# What `loop.advance` answers.
PAUSED, BUFFER_FULL, DONE, FAILED, STEP_BUDGET, EVENT_BUDGET, CYCLING = 0, 1, 2, 3, 4, 5, 6
INADMISSIBLE, WITHOUT_EFFECT, NO_SUCH_MODE, NOT_FINITE = 7, 8, 9, 10

# Kinds of rows in the event buffer.
TRANSITION, ACCUMULATION, SWITCH, APPROACH, SECTION_CROSSING, REBASE = 0, 1, 2, 3, 4, 5

# Columns of the event buffer; the states before and after follow.
CYCLE, TIME, KIND, GUARD, MODE_BEFORE, MODE_AFTER, HEAD = 0, 1, 2, 3, 4, 5, 6

ROOM = 40  # rows that one step, or one transition, may add at most, beside one a guard
NONE = -1
EPS = 2.0**-52

# Columns of `Buffers.hits`: when, how long after the one before, how fast the bodies separated, and
# how high the flights have been since they began to shrink.
HIT_TIME, HIT_INTERVAL, HIT_SPEED, HIT_REACH, HITS = 0, 1, 2, 3, 4

# Rows of `Buffers.edge`: margins and rates where the last step began and where it ended, how fast
# the rates change, and 1 for a margin that may have been at zero in between.
THEN, NOW, BEND, SUSPECT, EDGES = 0, 1, 2, 3, 4

# Rows of `Buffers.work`, scratch that is only good until the next call. A function says what it
# leaves there.
G, STATE, LOOKED, MOVED, AHEAD, STAGE, SLOPE, SUM, PAST, ENTERED, LEFT, SAMPLE = range(12)
SIZE, GAIN, TIMED, ROWS = 12, 13, 14, 15

# All that the loop remembers between two calls, beside the buffers.
CLOCK = np.dtype(
    [
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
        ("fresh", np.int64),  # 1 before the first arc: guards may be violated at the start
        ("restart", np.int64),  # 1 if the next step begins an arc
        ("instant", np.int64),  # transitions of this instant so far, 0 where it has settled
        ("pending", np.int64),  # the guard for which there was no room in the buffer, or NONE
        ("mark_mode", np.int64),  # with `Buffers.mark`: a state of this instant, to be known again
        ("stop", np.float64),  # next switching time of the drive
        ("steps", np.int64),
        ("arc_steps", np.int64),
        ("arcs", np.int64),
        ("max_steps", np.int64),
        ("max_events", np.int64),
        ("cycle_events", np.int64),  # events since `events_from`, against the budget
        ("events_from", np.int64),
        ("rows", np.int64),  # rows in the event buffer
        ("failure", np.int64),  # the engine's code, after FAILED; or a guard, or a mode
        ("arc_start", np.float64),
        ("lifted", np.int64),  # 1 in an arc with a margin that started clearly negative
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
    hits: Any  # float array, shape (m, HITS): the last impact at each guard
    edge: Any  # float array, shape (EDGES, 2 m)
    mark: Any  # float array, shape (n,)
    work: Any  # float array, shape (ROWS, max(n, 2 m))


def buffers_for(n: int, m: int, events: int, samples: int) -> Buffers:
    """Return empty buffers for `n` states and `m` guards, with rows for events and samples."""
    hits = np.zeros((m, HITS))
    hits[:, HIT_TIME] = -math.inf
    return Buffers(
        offset=np.zeros(n),
        events=np.zeros((events, HEAD + 2 * n)),
        samples=np.zeros((samples, 3 + n)),
        hits=hits,
        edge=np.zeros((EDGES, 2 * m)),
        mark=np.zeros(n),
        work=np.zeros((ROWS, max(n, 2 * m))),
    )


def whole_periods(t: float, period: float) -> int:
    """Return how many periods fit into `t`; the quotient alone may be rounded to the next."""
    whole = math.floor(t / period)
    if whole * period > t:
        whole -= 1
    elif (whole + 1) * period <= t:
        whole += 1
    return whole


def next_switch(s: Any, t: float, layout: Any) -> float:
    """Return the first switching time of the drive after `t`; infinity if it has none."""
    if layout.switches.size == 0:
        return math.inf
    # After the last switch of a period comes the first one of the next.
    stop: float = s.period + layout.switches[0]
    for i in range(layout.switches.size - 1, -1, -1):
        if layout.switches[i] > t:
            stop = layout.switches[i]
    return stop


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
    n = buffers.offset.size  # `past` and `y` may be rows of scratch, which are longer
    for i in range(n):
        row[HEAD + i] = past[i] + buffers.offset[i]
        row[HEAD + n + i] = y[i] + buffers.offset[i]
    s.rows += 1
