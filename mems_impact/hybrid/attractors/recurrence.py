"""Attractors by recurrence: detection of the period, statistics over it.

Written over the interface of integrators, for both forms: compiled, a whole batch of points goes by
without Python. Of a point the event loop computes a few steps at a time; what it has written is
read here, return by return, and gathered.

A *return* is the beginning of a forcing period, a crossing of the section where nothing forces the
system, or, without a section, an event of one guard. A motion is periodic once 2 n returns in a
row, and 16 or a fourth of all, are those of n returns ago to within a tolerance, and what is still
to come of the way there, as the last two differences tell it (a geometric sequence), is below it
too: a motion that passes an unstable orbit by chance does not pass for one that stays, nor one that
approaches an orbit slowly for one that has arrived. One of which differences fall, window by window
of its returns, is followed until it arrives, if it does in so many times its own time.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mems_impact.hybrid.event_loop import loop
from mems_impact.hybrid.event_loop.workspace import (
    ACCUMULATION,
    APPROACH,
    BUFFER_FULL,
    CYCLE,
    CYCLIC,
    DONE,
    EPS,
    GUARD,
    HEAD,
    HIT_BEGIN,
    HIT_TIME,
    IMPACT,
    KIND,
    MARGINS_AT,
    MODE_AFTER,
    MODE_BEFORE,
    NONE,
    OFFSET,
    ORDER,
    PAUSED,
    RECORDS,
    ROWS,
    SECTION_CROSSING,
    STATE,
    SWITCHES,
    TIME,
    TRANSITION,
    Y,
    event_at,
    sample_at,
    table_row,
)
from mems_impact.integrators import interface

# --- What is gathered of a motion from return to return: counts, times, observables.

# What is known of the point at work, and where a batch has come to.
WORK = np.dtype(
    [
        ("observe", np.int64),  # address of what gives the observables
        ("advance", np.int64),  # and of the event loop
        (
            "inputs",
            np.int64,
        ),  # addresses of rows of numbers, and how many are in each: a row a point
        ("input_width", np.int64),
        ("results", np.int64),
        ("result_width", np.int64),
        ("memory", np.int64),
        ("memory_width", np.int64),
        ("points", np.int64),
        ("point", np.int64),
        ("begun", np.int64),  # 1 while the point at work has begun
        ("outcome", np.int64),
        ("return_kind", np.int64),  # what a return is; and of which guard, or in which direction
        ("return_index", np.int64),
        ("longest", np.int64),  # returns after which a motion may repeat itself
        ("tolerance", np.float64),
        ("noise", np.float64),  # what differs by less does not differ
        ("smallest", np.float64),  # size below which a component is zero
        ("transient", np.float64),  # periods of the problem
        ("length", np.float64),  # that a motion is measured then, if it does not repeat itself
        ("gains", np.int64),  # observables of the state, and at events
        ("marks", np.int64),
        ("returns", np.int64),
        ("repeats", np.int64),  # after how many returns the motion repeats itself
        ("measured", np.int64),  # returns in the totals of a motion that wanders
        ("since", np.float64),  # when the mode began
        ("last", np.float64),  # when the last return was
        ("opened", np.int64),  # return at which the present window of distances began
        ("still", np.int64),  # 1 where nothing moves at the last return
        ("failed", np.int64),  # 1 where a function of an observable has failed
    ]
)

# What is gathered from return to return: its length in time, accumulations; then counts by guard,
# smallest margins at closest approaches, times by mode, gains, and for each observable at events
# the number, sum, smallest and largest of its values.
DURATION, ENDINGS, COUNTS = 0, 1, 2
NUMBER, TOTAL, LOW, HIGH, PARTS = range(5)
# Rows of the memory: what is gathered since the last return, and of a motion that wanders; the
# largest size of each component; states and observables at an event; observables at the last
# return; how often in a row each difference was small; means and squares of gains; the largest
# differences of the present window of returns and of the last three. Then the last
# returns (when, mode, state, differences), twice as many as a motion may take to repeat itself;
# and what was gathered up to each of the last so many.
NOW, ALL, SIZES, STATES, VALUES, GAINED, CONFIRMATIONS, MEANS, SQUARES = range(9)
LARGEST_DISTANCES, RING = 9, 13
WHEN, WHICH, WHERE = 0, 1, 2


def scratch_row(w: Any, i: int) -> Any:
    """Return row `i` of the memory."""
    return w.memory[i]


def return_row(w: Any, k: int) -> Any:
    """Return the row of return number `k`."""
    return scratch_row(w, RING + k % (2 * w.longest))


def return_statistics(w: Any, k: int) -> Any:
    """Return what was gathered up to return number `k`."""
    return scratch_row(w, RING + 2 * w.longest + k % w.longest)


def width_of(m: int, modes: int, gains: int, marks: int) -> int:
    """Return how many numbers are gathered from return to return."""
    return COUNTS + 2 * m + modes + gains + PARTS * marks


def observe(engine: Any, w: Any, mode: int, code: int, t: float, states: Any, out: Any) -> int:
    """Write observables into `out`: of a state, with `code` -1, or of an event.

    The code of an event is that of its transition, m + guard at the end of chatter.

    Returns 1 if one of their functions fails.
    """
    return int(w.observe(mode, code, t, states, engine.parameters, out))


def reset_row(s: Any, w: Any, gathered: Any) -> None:
    """Begin a row of what is gathered."""
    first = COUNTS + s.m
    for i in range(w.memory_width):
        gathered[i] = math.inf if first <= i < first + s.m else 0.0
    first += s.m + s.modes + w.gains
    for i in range(w.marks):
        gathered[first + PARTS * i + LOW] = math.inf
        gathered[first + PARTS * i + HIGH] = -math.inf


def accumulate_event(engine: Any, s: Any, w: Any, event: Any, when: float) -> None:
    """Take one event to what is gathered since the last return."""
    now, kind, guard, n = scratch_row(w, NOW), int(event[KIND]), int(event[GUARD]), s.n
    now[COUNTS + 2 * s.m + int(event[MODE_BEFORE])] += when - w.since
    w.since = when
    if kind == APPROACH:
        before, margins, place = table_row(s, STATE), table_row(s, MARGINS_AT), COUNTS + s.m + guard
        for j in range(n):
            before[j] = event[HEAD + j]
        interface.margins(engine, int(event[MODE_BEFORE]), event[TIME], before, margins)
        now[place] = min(now[place], margins[guard])
    if kind == TRANSITION:
        now[COUNTS + guard] += 1.0
    if kind == ACCUMULATION:
        now[ENDINGS] += 1.0
    if w.marks > 0 and kind in (TRANSITION, ACCUMULATION):
        states, values = scratch_row(w, STATES), scratch_row(w, VALUES)
        for j in range(2 * n):
            states[j] = event[HEAD + j]
        for i in range(w.marks):
            values[w.gains + i] = math.nan
        code = guard if kind == TRANSITION else s.m + guard
        w.failed |= observe(engine, w, int(event[MODE_BEFORE]), code, event[TIME], states, values)
        first = COUNTS + 2 * s.m + s.modes + w.gains
        for i in range(w.marks):
            accumulate_value(now, first + PARTS * i, values[w.gains + i])


def accumulate_value(gathered: Any, place: int, value: float) -> None:
    """Take a value of an observable, unless there is none."""
    if not math.isnan(value):
        gathered[place + NUMBER] += 1.0
        gathered[place + TOTAL] += value
        gathered[place + LOW] = min(gathered[place + LOW], value)
        gathered[place + HIGH] = max(gathered[place + HIGH], value)


def accumulate_aperiodic(s: Any, w: Any) -> None:
    """Take what was gathered up to this return to the totals of a motion that wanders."""
    now, means, squares = scratch_row(w, NOW), scratch_row(w, MEANS), scratch_row(w, SQUARES)
    add(s, w, scratch_row(w, ALL), now)
    w.measured += 1
    first = COUNTS + 2 * s.m + s.modes
    for i in range(w.gains):
        off = now[first + i] - means[i]
        means[i] += off / w.measured
        squares[i] += off * (now[first + i] - means[i])


def add(s: Any, w: Any, total: Any, part: Any) -> None:
    """Add what was gathered from one return to the next to a total."""
    first, last = COUNTS + s.m, COUNTS + 2 * s.m
    marks = last + s.modes + w.gains
    for i in range(marks):
        total[i] = min(total[i], part[i]) if first <= i < last else total[i] + part[i]
    for i in range(w.marks):
        place = marks + PARTS * i
        total[place + NUMBER] += part[place + NUMBER]
        total[place + TOTAL] += part[place + TOTAL]
        total[place + LOW] = min(total[place + LOW], part[place + LOW])
        total[place + HIGH] = max(total[place + HIGH], part[place + HIGH])


def sum_over_period(s: Any, w: Any) -> None:
    """Put together what was gathered while the motion went round once."""
    means, squares = scratch_row(w, MEANS), scratch_row(w, SQUARES)
    reset_row(s, w, scratch_row(w, ALL))
    first, count = COUNTS + 2 * s.m + s.modes, w.repeats
    for i in range(w.gains):
        means[i] = 0.0
        squares[i] = 0.0
    for k in range(w.returns - count, w.returns):
        part = return_statistics(w, k)
        add(s, w, scratch_row(w, ALL), part)
        for i in range(w.gains):
            means[i] += part[first + i] / count
    for k in range(w.returns - count, w.returns):
        part = return_statistics(w, k)
        for i in range(w.gains):
            off = part[first + i] - means[i]
            squares[i] += off * off
    w.measured = count


# --- Where motions come to: many points, each followed until it repeats itself, in one piece.

# What becomes of a point. One that wanders has not repeated itself within its time.
UNDECIDED, PERIODIC, APERIODIC, STATIONARY, FAILED = range(5)
# What a return is.
STROBOSCOPIC, AT_SECTION, AT_GUARD = range(3)
STEPS_PER_CALL = 32  # steps that the event loop takes before what it has written is read
SUBPERIOD_TOLERANCE = 10.0  # tolerances within which returns are one and the same
# Returns in a row, at least, that repeat, beside twice round: a motion which passes an unstable
# orbit by chance has left it by then. The longer it has gone on, the likelier is that: of few
# returns so large a share is enough.
FEWEST_CONFIRMATIONS, MIN_CONFIRMATIONS, CONFIRMATION_SHARE = 2, 16, 0.25
WINDOW_SHARE = 0.25  # length of a window, as a part of the returns before it
# Times the time of a motion, after which none is followed that still approaches an orbit.
LONGEST_EXTENSION = 64.0

# A row of the inputs: numbers of a point, before its switching times, state and parameters.
PERIOD, SCALE, LONGEST_STEP, PHASE, MODE, NUMBERS = range(6)
# A row of the results, before the state at the last return, what was gathered, the squares of what
# gains are off their means, and the last returns.
OUTCOME, REPEATS, RETURNS, MEASURED, END_CYCLE, END_TIME, END_MODE, STILL, RESULTS = range(9)


def memory_shape(n: int, m: int, modes: int, w: Any) -> tuple[int, int]:
    """Return the shape of the memory."""
    gathered = width_of(m, modes, w["gains"], w["marks"])
    width = max(gathered, WHERE + n + w["longest"], 2 * n, w["gains"] + w["marks"])
    return 3 * w["longest"] + RING, width


def result_width(n: int, m: int, modes: int, w: Any) -> int:
    """Return how long a row of the results is."""
    return RESULTS + n + width_of(m, modes, w["gains"], w["marks"]) + w["gains"] + w["longest"] * n


def numbers_of(w: Any) -> Any:
    """Return the inputs of the point at work."""
    return w.inputs[w.point]


def result_of(w: Any) -> Any:
    """Return the row in which the result of the point at work is written."""
    return w.results[w.point]


def advance(engine: Any, s: Any, w: Any) -> int:
    """Let the event loop take some steps."""
    return loop.run_steps(engine, s, STEPS_PER_CALL)


def map_points(engine: Any, s: Any, w: Any, quota: int) -> int:
    """Follow points until all are done, one fails, or a quota of steps is spent.

    Parameters
    ----------
    engine
    s, w : records
        LOOP_STATE and WORK.
    quota : int

    Returns
    -------
    int
        DONE, PAUSED, or FAILED: the point before ``w.point`` has failed; the next call goes on.
    """
    while w.point < w.points:
        if w.begun == 0:
            start_point(engine, s, w)
        while w.outcome == UNDECIDED:
            if quota <= 0:
                return PAUSED
            status = advance(engine, s, w)
            quota -= STEPS_PER_CALL
            process_events(engine, s, w)
            if w.outcome == UNDECIDED:
                if status == DONE and not extend_approach(s, w):
                    w.outcome = APERIODIC
                elif status not in (DONE, PAUSED, BUFFER_FULL):
                    w.outcome = FAILED
            if s.collapse_length > 0.0 and w.outcome != FAILED:
                return PAUSED
        if w.failed == 1:
            w.outcome = FAILED
        write_result(engine, s, w)
        w.point += 1
        w.begun = 0
        if w.outcome == FAILED:
            return FAILED
    return DONE


def start_point(engine: Any, s: Any, w: Any) -> None:
    """Start at a point, as if nothing had been before."""
    numbers = numbers_of(w)
    interface.reset(engine, numbers[LONGEST_STEP])
    for i in range(ROWS):
        if i != ORDER and i != IMPACT and i != RECORDS and i != CYCLIC:
            fill = -math.inf if i in (HIT_TIME, HIT_BEGIN) else 0.0
            for j in range(s.width):
                table_row(s, i)[j] = fill
    place = NUMBERS
    for i in range(s.switches):
        table_row(s, SWITCHES)[i] = numbers[place + i]
    place += s.switches
    for i in range(s.n):
        table_row(s, Y)[i] = numbers[place + i]
    place += s.n
    for i in range(w.input_width - place):
        interface.set_parameter(engine, i, numbers[place + i])
    s.period = numbers[PERIOD]
    s.scale = numbers[SCALE]
    s.t = numbers[PHASE]
    s.mode = int(numbers[MODE])
    whole = math.floor(w.transient + w.length)
    s.end_cycle = whole
    s.end_phase = s.t + (w.transient + w.length - whole) * s.period
    s.first_arc = 1
    s.switched = 0
    s.pending_guard = NONE
    s.stop = math.inf
    s.cycle = 0
    s.restart = 0
    s.transitions_now = 0
    s.steps = 0
    s.arc_steps = 0
    s.arcs = 0
    s.cycle_events = 0
    s.events_from = 0
    s.events_written = 0
    s.failure = 0
    s.mark_mode = 0
    s.section_side = 0
    s.section_distance = 0.0
    s.section_speed = 0.0
    s.section_step = 0.0
    s.section_bend = 0.0
    s.starts_negative = 0
    s.negative_by_error = 0
    s.recent_step = 0.0
    s.step_cut = 0
    s.collapse_length = 0.0
    s.arc_start = 0.0
    s.sample_cycle = 0
    s.sample = math.ceil(s.t / s.period - 1e-12)
    s.samples_written = 0
    w.begun = 1
    w.outcome = UNDECIDED
    w.returns = 0
    w.repeats = 0
    w.measured = 0
    w.still = 0
    w.failed = 0
    w.opened = 0
    w.since = s.t
    w.last = s.t
    reset_row(s, w, scratch_row(w, NOW))
    reset_row(s, w, scratch_row(w, ALL))
    for i in range(w.memory_width):
        scratch_row(w, SIZES)[i] = w.smallest
        scratch_row(w, CONFIRMATIONS)[i] = 0.0
        scratch_row(w, MEANS)[i] = 0.0
        scratch_row(w, SQUARES)[i] = 0.0
        scratch_row(w, GAINED)[i] = 0.0
        for k in range(4):
            scratch_row(w, LARGEST_DISTANCES + k)[i] = math.inf


def process_events(engine: Any, s: Any, w: Any) -> None:
    """Read what the event loop has written, in the order in which it happened."""
    taken, n, y, sizes = 0, s.n, table_row(s, STATE), scratch_row(w, SIZES)
    for i in range(s.events_written):
        event = event_at(s, i)
        when = event[CYCLE] * s.period + event[TIME]
        taken = close_periods(engine, s, w, taken, when - 8.0 * EPS * abs(when))
        if w.outcome != UNDECIDED:
            return
        accumulate_event(engine, s, w, event, when)
        kind, guard = int(event[KIND]), int(event[GUARD])
        crossed = (
            w.return_kind == AT_SECTION and kind == SECTION_CROSSING and guard == w.return_index
        )
        struck = w.return_kind == AT_GUARD and kind == TRANSITION and guard == w.return_index
        if crossed or struck:
            for j in range(n):
                y[j] = event[HEAD + n + j]
            close_return(engine, s, w, when, int(event[MODE_AFTER]), y)
    close_periods(engine, s, w, taken, math.inf)
    s.events_written = 0
    s.samples_written = 0
    for j in range(n):
        y[j] = table_row(s, Y)[j] + table_row(s, OFFSET)[j]
        if table_row(s, CYCLIC)[j] == 0.0:
            sizes[j] = max(sizes[j], abs(y[j]))
    looks = w.return_kind != STROBOSCOPIC and w.outcome == UNDECIDED
    if looks and stands_still(engine, s, w, s.mode, s.t, y):
        w.outcome = STATIONARY


def close_periods(engine: Any, s: Any, w: Any, taken: int, until: float) -> int:
    """End the forcing periods before an instant; return how many samples have been read."""
    y = table_row(s, STATE)
    while w.return_kind == STROBOSCOPIC and taken < s.samples_written and w.outcome == UNDECIDED:
        sample = sample_at(s, taken)
        when = sample[0] * s.period + sample[1]
        if when >= until:
            break
        for j in range(s.n):
            y[j] = sample[3 + j]
        close_return(engine, s, w, when, int(sample[2]), y)
        taken += 1
    return taken


def close_return(engine: Any, s: Any, w: Any, when: float, mode: int, y: Any) -> None:
    """End what is gathered at a return, and see whether the motion repeats itself."""
    now, n, k = scratch_row(w, NOW), s.n, w.returns
    modes = COUNTS + 2 * s.m
    now[modes + mode] += when - w.since
    w.since = when
    now[DURATION] = when - w.last
    w.last = when
    if w.gains > 0:
        states, values, gained = (
            scratch_row(w, STATES),
            scratch_row(w, VALUES),
            scratch_row(w, GAINED),
        )
        for j in range(n):
            states[j] = y[j]
            states[n + j] = y[j]
        w.failed |= observe(engine, w, mode, NONE, 0.0, states, values)
        for i in range(w.gains):
            now[modes + s.modes + i] = values[i] - gained[i]
            gained[i] = values[i]
    if k > 0:
        kept = return_statistics(w, k)
        for i in range(w.memory_width):
            kept[i] = now[i]
        if when - now[DURATION] >= w.transient * s.period * (1.0 - 1e-12):
            accumulate_aperiodic(s, w)
    reset_row(s, w, now)
    here = return_row(w, k)
    here[WHEN] = when
    here[WHICH] = mode
    for j in range(n):
        here[WHERE + j] = y[j]
    w.returns = k + 1
    if stands_still(engine, s, w, mode, when, y):
        w.still = 1
        if w.return_kind != STROBOSCOPIC:
            w.outcome = STATIONARY
            return
    else:
        w.still = 0
    if w.returns >= (1.0 + WINDOW_SHARE) * w.opened + 2 * w.longest * int(w.opened == 0):
        open_window(w)
    w.repeats = repeats_after(s, w)
    if w.repeats > 0:
        w.outcome = PERIODIC


def repeats_after(s: Any, w: Any) -> int:
    """Return after how many returns the motion repeats itself, as far as the last one tells."""
    k, n, sizes = w.returns - 1, s.n, scratch_row(w, SIZES)
    confirmations, largest = scratch_row(w, CONFIRMATIONS), scratch_row(w, LARGEST_DISTANCES)
    here = return_row(w, k)
    found = 0
    for after in range(1, w.longest + 1):
        distance = math.inf
        if k >= after:
            then = return_row(w, k - after)
            if then[WHICH] == here[WHICH]:
                distance = 0.0
                for j in range(n):
                    if table_row(s, CYCLIC)[j] == 0.0:
                        difference = abs(here[WHERE + j] - then[WHERE + j]) / sizes[j]
                        distance = max(distance, difference)
        before = return_row(w, k - after)[WHERE + n + after - 1] if k >= 2 * after else math.inf
        here[WHERE + n + after - 1] = distance
        largest[after - 1] = max(largest[after - 1], distance)
        near = distance <= w.tolerance and k >= 2 * after
        if near and distance > w.noise:  # what is still to come is distance q / (1 - q)
            gain = before - distance
            near = gain > 0.0 and distance * distance <= w.tolerance * gain
        confirmations[after - 1] = confirmations[after - 1] + 1.0 if near else 0.0
        needed = max(FEWEST_CONFIRMATIONS, min(MIN_CONFIRMATIONS, CONFIRMATION_SHARE * w.returns))
        if found == 0 and confirmations[after - 1] >= max(2 * after, needed):
            found = after
    # A multiplier that turns the differences round lets 2 n be told before n.
    for after in range(1, found):
        distance = here[WHERE + n + after - 1]
        if found % after == 0 and distance <= SUBPERIOD_TOLERANCE * w.tolerance:
            return after
    return found


def open_window(w: Any) -> None:
    """Begin a window of returns; the largest differences in the last three are kept."""
    for i in range(w.longest):
        for k in (3, 2, 1):
            scratch_row(w, LARGEST_DISTANCES + k)[i] = scratch_row(w, LARGEST_DISTANCES + k - 1)[i]
        scratch_row(w, LARGEST_DISTANCES)[i] = 0.0
    w.opened = w.returns


def extend_approach(s: Any, w: Any) -> bool:
    """Let a motion go on where it ends, if it comes to an orbit within a bounded time.

    The rate of the approach is that of the largest differences in windows, which hold the turns of
    a spiral too. What it arrives at is still seen by its returns alone (`repeats_after`).
    """
    length = w.transient + w.length
    done = s.end_cycle + (s.end_phase - numbers_of(w)[PHASE]) / s.period
    # Windows are as long as a part of the returns before them: so their beginnings are known.
    begun = w.opened / (1.0 + WINDOW_SHARE)
    span = begun * (1.0 - (1.0 + WINDOW_SHARE) ** -2)
    arrives = math.inf
    for after in range(1, w.longest + 1):
        latest, third = (
            scratch_row(w, LARGEST_DISTANCES + 1)[after - 1],
            scratch_row(w, LARGEST_DISTANCES + 3)[after - 1],
        )
        if 0.0 < latest < third < math.inf:
            rate = math.log(third / latest) / span
            left = -math.expm1(-rate * after)  # of a difference, from one to the next
            steps = math.log(latest / (w.tolerance * left)) / rate
            arrives = min(arrives, begun + steps + 2 * after + max(2 * after, MIN_CONFIRMATIONS))
    # A tenth more: rates are rough. What wanders may have come nearer by chance, but not again and
    # again: the next look comes no later than after as much time as before.
    needed = done * 1.1 * max(1.0, arrives / w.returns)
    if needed > LONGEST_EXTENSION * length:
        return False
    more = min(needed, 2.0 * done)
    ahead = math.ceil(more - done)
    s.end_cycle += ahead
    s.first_arc = 1
    return True


def stands_still(engine: Any, s: Any, w: Any, mode: int, when: float, y: Any) -> bool:
    """Return whether nothing moves but cyclic components."""
    slope, sizes = table_row(s, MARGINS_AT), scratch_row(w, SIZES)
    t = when - math.floor(when / s.period) * s.period
    interface.flow(engine, mode, t, y, slope)
    for j in range(s.n):
        moves = abs(slope[j]) * s.scale > w.noise * sizes[j]
        if table_row(s, CYCLIC)[j] == 0.0 and moves:
            return False
    return True


def write_result(engine: Any, s: Any, w: Any) -> None:
    """Write what has become of a point."""
    n, result = s.n, result_of(w)
    result[OUTCOME] = w.outcome
    result[REPEATS] = w.repeats
    result[RETURNS] = w.returns
    result[STILL] = w.still
    y, width = table_row(s, Y), width_of(s.m, s.modes, w.gains, w.marks)
    cycle, time, mode = s.cycle, s.t, s.mode
    if w.outcome == PERIODIC:
        last = return_row(w, w.returns - 1)
        whole = math.floor(last[WHEN] / s.period + 1e-12)
        cycle, time, mode = whole, max(0.0, last[WHEN] - whole * s.period), int(last[WHICH])
        for j in range(n):
            result[RESULTS + j] = last[WHERE + j]
        sum_over_period(s, w)
    else:
        whole = math.floor(time / s.period + 1e-12)  # where nothing happens the loop counts on
        cycle, time = cycle + whole, max(0.0, time - whole * s.period)
        for j in range(n):
            result[RESULTS + j] = y[j] + table_row(s, OFFSET)[j]
    result[MEASURED] = w.measured
    result[END_CYCLE] = cycle
    result[END_TIME] = time
    result[END_MODE] = mode
    place = RESULTS + n
    for i in range(width):
        result[place + i] = scratch_row(w, ALL)[i]
    place += width
    for i in range(w.gains):
        result[place + i] = scratch_row(w, SQUARES)[i]
    place += w.gains
    for k in range(w.longest):
        for j in range(n):
            state = return_row(w, w.returns - 1 - k)[WHERE + j] if k < w.returns else math.nan
            result[place + n * k + j] = state
