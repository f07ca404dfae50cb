"""Attractors by recurrence: detection of the period, statistics over it.

Functions over `integrators.interface`, interpreted and compiled; compiled, a whole batch of points
runs without Python. The event loop computes one step of a point at a time; this module reads its
buffers, return by return, and accumulates statistics. So the result of a point does not depend on
the number of steps per call.

A *return* is the beginning of a forcing period; in an autonomous system a crossing of the section
or, without a section, an event of one guard. A motion has period n if 2 n successive returns, and
at least 16 or a fourth of all (the smaller number), agree with those n returns earlier within a
tolerance, and if the remaining distance to the orbit, extrapolated from the last two differences as
a geometric sequence, is below the tolerance too. The first condition excludes motions that pass
close to an unstable orbit, the second slow approaches to an orbit. Differences that have ceased to
decrease are errors of the method, and fulfil the second condition, if they do not accumulate over
16 n returns. A motion with differences that decrease from window to window of its returns is
continued until it converges, within a bounded multiple of its length.
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
    CONDITION,
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
    TIMED,
    TRANSITION,
    WAITING,
    Y,
    event_at,
    sample_at,
    table_row,
)
from mems_impact.integrators import interface

# --- Statistics per return

# State of a batch and of its current point.
WORK = np.dtype(
    [
        ("observe", np.int64),  # address of the function of observables
        ("advance", np.int64),  # address of the event loop
        ("inputs", np.int64),  # addresses and widths of arrays, with one row per point
        ("input_width", np.int64),
        ("results", np.int64),
        ("result_width", np.int64),
        ("memory", np.int64),
        ("memory_width", np.int64),
        ("points", np.int64),
        ("point", np.int64),
        ("begun", np.int64),  # 1 during a point
        ("outcome", np.int64),
        ("return_kind", np.int64),  # kind of return; direction of the section, or guard
        ("return_index", np.int64),
        ("longest", np.int64),  # longest period in returns
        ("tolerance", np.float64),
        ("noise", np.float64),  # relative differences below this are rounding
        ("min_size", np.float64),  # size of a component that counts as zero
        ("transient", np.float64),  # periods of the problem
        ("length", np.float64),  # of the statistics of an aperiodic motion, in periods
        ("gains", np.int64),  # numbers of observables of the state, and at events
        ("marks", np.int64),
        ("returns", np.int64),
        ("repeats", np.int64),  # period in returns, or 0
        ("measured", np.int64),  # returns in the statistics
        ("mode_start", np.float64),  # start of the present mode
        ("last_return", np.float64),  # time of the last return
        ("rest_check", np.int64),  # number of the step after which rest is checked
        ("window_start", np.int64),  # first return of the present window
        ("at_rest", np.int64),  # 1 if all non-cyclic components are at rest
        ("failed", np.int64),  # 1 if an observable has failed
        ("search_start", np.int64),  # first return whose closest approaches were searched, or NONE
    ]
)

# Statistics per return: duration, accumulations; then counts by guard, smallest margins at closest
# approaches, times by mode, gains, and number, sum, minimum and maximum of each observable at
# events.
DURATION, ENDINGS, COUNTS = 0, 1, 2
NUMBER, TOTAL, LOW, HIGH, PARTS = range(5)
# Rows of the memory: statistics since the last return, and in total; largest size of each
# component; states and observables at an event; observables at the last return; number of
# successive small differences for each period; means and squares of gains; largest differences of
# the present window of returns and of the last three. Then a ring of the last 2 `longest` returns
# (time, mode, state, differences), the statistics of the last `longest` returns, and a series of
# differences for each period.
RETURN_SUMS, TOTAL_SUMS, SIZES, STATES, VALUES, LAST_VALUES, CONFIRMATIONS = range(7)
MEANS, SQUARES, LARGEST_DISTANCES, RING = 7, 8, 9, 13
RETURN_TIME, RETURN_MODE, RETURN_STATE = 0, 1, 2
# Of the differences since a return: 1 if the last series did not accumulate; their number, 0 if the
# last one exceeds the tolerance; the largest of them; the state at the return.
STATIONARY_DIFFERENCES, SERIES_LENGTH, SERIES_MAXIMUM, SERIES_STATE = range(4)


def scratch_row(w: Any, i: int) -> Any:
    """Return row `i` of the memory."""
    return w.memory[i]


def return_row(w: Any, k: int) -> Any:
    """Return the row of return `k`."""
    return scratch_row(w, RING + k % (2 * w.longest))


def return_statistics(w: Any, k: int) -> Any:
    """Return the statistics of return `k`."""
    return scratch_row(w, RING + 2 * w.longest + k % w.longest)


def series_row(w: Any, lag: int) -> Any:
    """Return the row of the differences from the return `lag` returns earlier."""
    return scratch_row(w, RING + 3 * w.longest + lag - 1)


def width_of(m: int, modes: int, gains: int, marks: int) -> int:
    """Return the number of statistics per return."""
    return COUNTS + 2 * m + modes + gains + PARTS * marks


def observe(engine: Any, w: Any, mode: int, code: int, t: float, states: Any, out: Any) -> int:
    """Write observables into `out`: of a state if `code` is -1, else of an event.

    The code of an event is the code of its transition, m + guard at the end of chatter.

    Returns 1 if one of their functions fails.
    """
    return int(w.observe(mode, code, t, states, engine.parameters, out))


def reset_row(s: Any, w: Any, statistics: Any) -> None:
    """Initialize a row of statistics."""
    offset = COUNTS + s.m
    for i in range(w.memory_width):
        statistics[i] = math.inf if offset <= i < offset + s.m else 0.0
    offset += s.m + s.modes + w.gains
    for i in range(w.marks):
        statistics[offset + PARTS * i + LOW] = math.inf
        statistics[offset + PARTS * i + HIGH] = -math.inf


def accumulate_event(engine: Any, s: Any, w: Any, event: Any, t: float) -> None:
    """Add one event to the statistics since the last return."""
    kind, guard, n = int(event[KIND]), int(event[GUARD]), s.n
    statistics = scratch_row(w, RETURN_SUMS)
    statistics[COUNTS + 2 * s.m + int(event[MODE_BEFORE])] += t - w.mode_start
    w.mode_start = t
    if kind == APPROACH:
        state, margins, column = table_row(s, STATE), table_row(s, MARGINS_AT), COUNTS + s.m + guard
        for j in range(n):
            state[j] = event[HEAD + j]
        interface.margins(engine, int(event[MODE_BEFORE]), event[TIME], state, margins)
        statistics[column] = min(statistics[column], margins[guard])
    if kind == TRANSITION:
        statistics[COUNTS + guard] += 1.0
    if kind == ACCUMULATION:
        statistics[ENDINGS] += 1.0
    if w.marks > 0 and kind in (TRANSITION, ACCUMULATION):
        states, values = scratch_row(w, STATES), scratch_row(w, VALUES)
        for j in range(2 * n):
            states[j] = event[HEAD + j]
        for i in range(w.marks):
            values[w.gains + i] = math.nan
        code = guard if kind == TRANSITION else s.m + guard
        t = event[CYCLE] * s.period + event[TIME]
        w.failed |= observe(engine, w, int(event[MODE_BEFORE]), code, t, states, values)
        offset = COUNTS + 2 * s.m + s.modes + w.gains
        for i in range(w.marks):
            accumulate_value(statistics, offset + PARTS * i, values[w.gains + i])


def accumulate_value(statistics: Any, column: int, value: float) -> None:
    """Add a value of an observable, unless it is nan."""
    if not math.isnan(value):
        statistics[column + NUMBER] += 1.0
        statistics[column + TOTAL] += value
        statistics[column + LOW] = min(statistics[column + LOW], value)
        statistics[column + HIGH] = max(statistics[column + HIGH], value)


def accumulate_aperiodic(s: Any, w: Any) -> None:
    """Add the statistics of this return to the statistics of an aperiodic motion."""
    statistics = scratch_row(w, RETURN_SUMS)
    means, squares = scratch_row(w, MEANS), scratch_row(w, SQUARES)
    add(s, w, scratch_row(w, TOTAL_SUMS), statistics)
    w.measured += 1
    offset = COUNTS + 2 * s.m + s.modes
    for i in range(w.gains):
        deviation = statistics[offset + i] - means[i]
        means[i] += deviation / w.measured
        squares[i] += deviation * (statistics[offset + i] - means[i])


def add(s: Any, w: Any, total: Any, part: Any) -> None:
    """Add the statistics of one return to a total."""
    margin_start, margin_end = COUNTS + s.m, COUNTS + 2 * s.m
    mark_start = margin_end + s.modes + w.gains
    for i in range(mark_start):
        total[i] = min(total[i], part[i]) if margin_start <= i < margin_end else total[i] + part[i]
    for i in range(w.marks):
        column = mark_start + PARTS * i
        total[column + NUMBER] += part[column + NUMBER]
        total[column + TOTAL] += part[column + TOTAL]
        total[column + LOW] = min(total[column + LOW], part[column + LOW])
        total[column + HIGH] = max(total[column + HIGH], part[column + HIGH])


def sum_over_period(s: Any, w: Any) -> None:
    """Compute the statistics of one period of a periodic motion."""
    means, squares = scratch_row(w, MEANS), scratch_row(w, SQUARES)
    reset_row(s, w, scratch_row(w, TOTAL_SUMS))
    offset, count = COUNTS + 2 * s.m + s.modes, w.repeats
    for i in range(w.gains):
        means[i] = 0.0
        squares[i] = 0.0
    for k in range(w.returns - count, w.returns):
        statistics = return_statistics(w, k)
        add(s, w, scratch_row(w, TOTAL_SUMS), statistics)
        for i in range(w.gains):
            means[i] += statistics[offset + i] / count
    for k in range(w.returns - count, w.returns):
        statistics = return_statistics(w, k)
        for i in range(w.gains):
            deviation = statistics[offset + i] - means[i]
            squares[i] += deviation * deviation
    w.measured = count


# --- Recurrence

# Outcomes of a point.
UNDECIDED, PERIODIC, APERIODIC, STATIONARY, FAILED = range(5)
# Kinds of return.
STROBOSCOPIC, AT_SECTION, AT_GUARD = range(3)
REST_CHECK_STEPS = 32  # steps between two checks for rest of an autonomous system
SUBPERIOD_TOLERANCE = 10.0  # tolerances within which a divisor of the period is accepted
# Least number of successive small differences, beside two periods: a motion that passes an unstable
# orbit has left it by then. A close passage is the likelier, the longer the motion; for few returns
# a share of their number suffices.
FEWEST_CONFIRMATIONS, MIN_CONFIRMATIONS, CONFIRMATION_SHARE = 2, 16, 0.25
WINDOW_SHARE = 0.25  # length of a window relative to the number of returns before it
# Share of the first window in the logarithm of the decrease over two windows. It is 4/9 for a
# geometric sequence, 1/2 for a power of time; the turns of a spiral disturb it.
MIN_FALL_SHARE, MAX_FALL_SHARE = 0.2, 0.7
LATE_FALL = 8.0  # factor of a decrease to the latest returns that chaotic motions rarely have
# Longest duration of an approach, in multiples of the planned length of the motion.
LONGEST_EXTENSION = 64.0

# Columns of the inputs; flags of guards that wait, switching times, state and parameters follow.
PERIOD, SCALE, LONGEST_STEP, PHASE, MODE, INITIAL, NUMBERS = range(7)
# Columns of the results; the state at the last return, statistics, squared deviations of gains, and
# the last returns follow.
OUTCOME, REPEATS, RETURNS, MEASURED, END_CYCLE, END_TIME, END_MODE, AT_REST, RESULTS = range(9)


def memory_shape(n: int, m: int, modes: int, w: Any) -> tuple[int, int]:
    """Return the shape of the memory."""
    statistics = width_of(m, modes, w["gains"], w["marks"])
    width = max(statistics, RETURN_STATE + n + w["longest"], 2 * n, w["gains"] + w["marks"])
    return RING + 4 * w["longest"], width


def result_width(n: int, m: int, modes: int, w: Any) -> int:
    """Return the width of the results."""
    return RESULTS + n + width_of(m, modes, w["gains"], w["marks"]) + w["gains"] + w["longest"] * n


def numbers_of(w: Any) -> Any:
    """Return the inputs of the current point."""
    return w.inputs[w.point]


def result_of(w: Any) -> Any:
    """Return the row for the result of the current point."""
    return w.results[w.point]


def map_points(engine: Any, s: Any, w: Any, quota: int) -> int:
    """Compute points until all are complete, one fails, or the quota of steps is used up.

    `s` and `w` are records LOOP_STATE and WORK. The result is DONE, PAUSED, or FAILED: the point
    before ``w.point`` has failed; the next call continues.
    """
    while w.point < w.points:
        if w.begun == 0:
            start_point(engine, s, w)
        while w.outcome == UNDECIDED:
            if quota <= 0:
                return PAUSED
            advance_point(engine, s, w)
            quota -= 1
            if s.collapse_length > 0.0 and w.outcome != FAILED:
                return PAUSED
        write_result(engine, s, w)
        w.point += 1
        w.begun = 0
        if w.outcome == FAILED:
            return FAILED
    return DONE


def advance_point(engine: Any, s: Any, w: Any) -> None:
    """Take one step of a point, and decide about its outcome."""
    status = loop.advance(engine, s, w, 1)
    update_sizes(s, w)
    if s.events_written + s.samples_written > 0:
        process_events(engine, s, w)
    if w.outcome == UNDECIDED and s.steps >= w.rest_check:
        check_rest(engine, s, w)
    if w.outcome == UNDECIDED:
        if status == DONE and not extend_approach(s, w):
            w.outcome = APERIODIC
        elif status not in (DONE, PAUSED, BUFFER_FULL):
            w.outcome = FAILED
    if w.failed == 1 and w.outcome != UNDECIDED:
        w.outcome = FAILED


def start_point(engine: Any, s: Any, w: Any) -> None:
    """Initialize loop and statistics for a point."""
    numbers = numbers_of(w)
    interface.reset(engine, numbers[LONGEST_STEP])
    for i in range(ROWS):
        is_constant = i in (ORDER, IMPACT, RECORDS, CONDITION, CYCLIC, TIMED)
        if not is_constant:
            fill = -math.inf if i in (HIT_TIME, HIT_BEGIN) else 0.0
            for j in range(s.width):
                table_row(s, i)[j] = fill
    column = NUMBERS
    for i in range(s.m):
        table_row(s, WAITING)[i] = numbers[column + i]
    column += s.m
    for i in range(s.switches):
        table_row(s, SWITCHES)[i] = numbers[column + i]
    column += s.switches
    for i in range(s.n):
        table_row(s, Y)[i] = numbers[column + i]
    column += s.n
    for i in range(w.input_width - column):
        interface.set_parameter(engine, i, numbers[column + i])
    s.period = numbers[PERIOD]
    s.scale = numbers[SCALE]
    s.t = numbers[PHASE]
    s.mode = int(numbers[MODE])
    periods = math.floor(w.transient + w.length)
    s.end_cycle = periods
    s.end_phase = s.t + (w.transient + w.length - periods) * s.period
    s.first_arc = 1
    s.initial = int(numbers[INITIAL])
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
    s.section_curvature = 0.0
    s.biased = 0
    s.negative_by_error = 0
    s.recent_step = 0.0
    s.step_cut = 0
    s.collapse_length = 0.0
    s.arc_start = 0.0
    expect_starts(s, math.ceil(s.t / s.period - 1e-12))
    w.begun = 1
    w.outcome = UNDECIDED
    w.returns = 0
    w.repeats = 0
    w.measured = 0
    w.at_rest = 0
    w.failed = 0
    w.window_start = 0
    w.mode_start = s.t
    w.last_return = s.t
    w.rest_check = REST_CHECK_STEPS
    w.search_start = NONE
    has_impacts = False
    for i in range(s.m):
        has_impacts = has_impacts or table_row(s, IMPACT)[i] == 1
    if w.transient <= 1.0 or not has_impacts:
        w.search_start = 0
    interface.search_approaches(engine, int(w.search_start == 0))
    reset_row(s, w, scratch_row(w, RETURN_SUMS))
    reset_row(s, w, scratch_row(w, TOTAL_SUMS))
    for i in range(w.memory_width):
        scratch_row(w, SIZES)[i] = w.min_size
        scratch_row(w, CONFIRMATIONS)[i] = 0.0
        scratch_row(w, MEANS)[i] = 0.0
        scratch_row(w, SQUARES)[i] = 0.0
        scratch_row(w, LAST_VALUES)[i] = 0.0
        for k in range(4):
            scratch_row(w, LARGEST_DISTANCES + k)[i] = math.inf
    for lag in range(1, w.longest + 1):
        series_row(w, lag)[STATIONARY_DIFFERENCES] = 0.0
        series_row(w, lag)[SERIES_LENGTH] = 0.0


def update_sizes(s: Any, w: Any) -> None:
    """Update the largest size of each component."""
    sizes = scratch_row(w, SIZES)
    for j in range(s.n):
        if table_row(s, CYCLIC)[j] == 0.0:
            sizes[j] = max(sizes[j], abs(table_row(s, Y)[j]))


def check_rest(engine: Any, s: Any, w: Any) -> None:
    """Detect rest between two returns of an autonomous system."""
    w.rest_check += REST_CHECK_STEPS
    y = table_row(s, STATE)
    for j in range(s.n):
        y[j] = table_row(s, Y)[j] + table_row(s, OFFSET)[j]
    if w.return_kind != STROBOSCOPIC and is_at_rest(engine, s, w, s.mode, s.t, y):
        w.outcome = STATIONARY


def process_events(engine: Any, s: Any, w: Any) -> None:
    """Read the buffers of the event loop in the order of time."""
    sample_count, n, y = 0, s.n, table_row(s, STATE)
    for i in range(s.events_written):
        event = event_at(s, i)
        t = event[CYCLE] * s.period + event[TIME]
        sample_count = close_periods(engine, s, w, sample_count, t - 8.0 * EPS * abs(t))
        if w.outcome != UNDECIDED:
            return
        accumulate_event(engine, s, w, event, t)
        kind, guard = int(event[KIND]), int(event[GUARD])
        is_crossing = (
            w.return_kind == AT_SECTION and kind == SECTION_CROSSING and guard == w.return_index
        )
        is_guard_event = (
            w.return_kind == AT_GUARD and kind == TRANSITION and guard == w.return_index
        )
        if is_crossing or is_guard_event:
            for j in range(n):
                y[j] = event[HEAD + n + j]
            close_return(engine, s, w, t, int(event[MODE_AFTER]), y)
    close_periods(engine, s, w, sample_count, math.inf)
    s.events_written = 0
    if s.samples_written > 0:
        expect_starts(s, int(sample_at(s, s.samples_written - 1)[0]) + 1)


def expect_starts(s: Any, cycle: int) -> None:
    """Empty the sample buffer for the starts of periods from `cycle` on."""
    for i in range(s.sample_rows):
        sample_at(s, i)[0] = cycle + i
        sample_at(s, i)[1] = 0.0
    s.samples_written = 0


def close_periods(engine: Any, s: Any, w: Any, sample_count: int, limit: float) -> int:
    """Process the returns before an instant; return the number of processed samples."""
    y = table_row(s, STATE)
    while (
        w.return_kind == STROBOSCOPIC
        and sample_count < s.samples_written
        and w.outcome == UNDECIDED
    ):
        sample = sample_at(s, sample_count)
        t = sample[0] * s.period + sample[1]
        if t >= limit:
            break
        for j in range(s.n):
            y[j] = sample[3 + j]
        close_return(engine, s, w, t, int(sample[2]), y)
        sample_count += 1
    return sample_count


def close_return(engine: Any, s: Any, w: Any, t: float, mode: int, y: Any) -> None:
    """Process a return: complete its statistics, and test for periodicity."""
    statistics, n, k = scratch_row(w, RETURN_SUMS), s.n, w.returns
    modes = COUNTS + 2 * s.m
    statistics[modes + mode] += t - w.mode_start
    w.mode_start = t
    statistics[DURATION] = t - w.last_return
    w.last_return = t
    if w.gains > 0:
        states, values, last_values = (
            scratch_row(w, STATES),
            scratch_row(w, VALUES),
            scratch_row(w, LAST_VALUES),
        )
        for j in range(n):
            states[j] = y[j]
            states[n + j] = y[j]
        w.failed |= observe(engine, w, mode, NONE, 0.0, states, values)
        for i in range(w.gains):
            statistics[modes + s.modes + i] = values[i] - last_values[i]
            last_values[i] = values[i]
    if k > 0:
        history = return_statistics(w, k)
        for i in range(w.memory_width):
            history[i] = statistics[i]
        transient_end = w.transient * s.period * (1.0 - 1e-12)
        if t - statistics[DURATION] >= transient_end and NONE < w.search_start <= k:
            accumulate_aperiodic(s, w)
        elif t + statistics[DURATION] >= transient_end:
            begin_search(engine, w, k)
    reset_row(s, w, statistics)
    row = return_row(w, k)
    row[RETURN_TIME] = t
    row[RETURN_MODE] = mode
    for j in range(n):
        row[RETURN_STATE + j] = y[j]
    w.returns = k + 1
    if is_at_rest(engine, s, w, mode, t, y):
        w.at_rest = 1
        if w.return_kind != STROBOSCOPIC:
            w.outcome = STATIONARY
            return
    else:
        w.at_rest = 0
    if w.returns >= (1.0 + WINDOW_SHARE) * w.window_start + 2 * w.longest * int(
        w.window_start == 0
    ):
        open_window(w)
    w.repeats = recurrence_period(s, w)
    if w.repeats > 0:
        begin_search(engine, w, k)
        if w.returns - w.repeats >= w.search_start:
            w.outcome = PERIODIC


def begin_search(engine: Any, w: Any, k: int) -> None:
    """Search closest approaches from now on, unless they are, after return `k`.

    They take a third of the time of a motion between stoppers, and only the statistics contain
    them. The step in which a return lies may extend beyond an approach that follows it.
    """
    if w.search_start == NONE:
        w.search_start = k + 2
        interface.search_approaches(engine, 1)


def recurrence_period(s: Any, w: Any) -> int:
    """Return the period of the motion in returns, 0 if it is not periodic yet."""
    k, n = w.returns - 1, s.n
    confirmations, maxima = scratch_row(w, CONFIRMATIONS), scratch_row(w, LARGEST_DISTANCES)
    row = return_row(w, k)
    period = 0
    for lag in range(1, w.longest + 1):
        distance = math.inf
        if k >= lag:
            earlier_row = return_row(w, k - lag)
            if earlier_row[RETURN_MODE] == row[RETURN_MODE]:
                distance = difference(s, w, row, earlier_row, RETURN_STATE)
        previous_distance = (
            return_row(w, k - lag)[RETURN_STATE + n + lag - 1] if k >= 2 * lag else math.inf
        )
        row[RETURN_STATE + n + lag - 1] = distance
        maxima[lag - 1] = max(maxima[lag - 1], distance)
        extend_series(s, w, lag, distance)
        is_small = distance <= w.tolerance and k >= 2 * lag
        if is_small and distance > w.noise:  # the remaining distance is distance q / (1 - q)
            gain = previous_distance - distance
            is_small = gain > 0.0 and distance * distance <= w.tolerance * gain
            is_small = is_small or series_row(w, lag)[STATIONARY_DIFFERENCES] == 1.0
        confirmations[lag - 1] = confirmations[lag - 1] + 1.0 if is_small else 0.0
        min_count = max(
            FEWEST_CONFIRMATIONS, min(MIN_CONFIRMATIONS, CONFIRMATION_SHARE * w.returns)
        )
        if period == 0 and confirmations[lag - 1] >= max(2 * lag, min_count):
            period = lag
    # With a negative multiplier the period 2 n may be confirmed before n.
    for lag in range(1, period):
        distance = row[RETURN_STATE + n + lag - 1]
        if period % lag == 0 and distance <= SUBPERIOD_TOLERANCE * w.tolerance:
            return lag
    return period


def difference(s: Any, w: Any, row: Any, other: Any, column: int) -> float:
    """Return the largest relative difference of two states, that in `other` from `column`."""
    result = 0.0
    for j in range(s.n):
        if table_row(s, CYCLIC)[j] == 0.0:
            change = abs(row[RETURN_STATE + j] - other[column + j])
            result = max(result, change / scratch_row(w, SIZES)[j])
    return result


def extend_series(s: Any, w: Any, lag: int, distance: float) -> None:
    """Add a difference to the differences since an earlier return; decide whether they accumulate.

    Errors of a method whose steps are not periodic do not: the distance from the earlier return is
    no larger than one of them. In a slow approach it is nearly their sum. Along an unstable orbit
    the last difference is the largest, whatever its direction.
    """
    series, row = series_row(w, lag), return_row(w, w.returns - 1)
    if distance > w.tolerance:
        series[STATIONARY_DIFFERENCES] = 0.0
        series[SERIES_LENGTH] = 0.0
        return
    series[SERIES_LENGTH] += 1.0
    series[SERIES_MAXIMUM] = max(series[SERIES_MAXIMUM], distance)
    if series[SERIES_LENGTH] > MIN_CONFIRMATIONS * lag:
        total = difference(s, w, row, series, SERIES_STATE)
        is_stationary = total <= series[SERIES_MAXIMUM] and distance < series[SERIES_MAXIMUM]
        series[STATIONARY_DIFFERENCES] = 1.0 if is_stationary else 0.0
        series[SERIES_LENGTH] = 1.0
    if series[SERIES_LENGTH] == 1.0:
        series[SERIES_MAXIMUM] = 0.0
        for j in range(s.n):
            series[SERIES_STATE + j] = row[RETURN_STATE + j]


def open_window(w: Any) -> None:
    """Begin a window of returns; keep the largest differences of the last three."""
    for i in range(w.longest):
        for k in (3, 2, 1):
            scratch_row(w, LARGEST_DISTANCES + k)[i] = scratch_row(w, LARGEST_DISTANCES + k - 1)[i]
        scratch_row(w, LARGEST_DISTANCES)[i] = 0.0
    w.window_start = w.returns


def extend_approach(s: Any, w: Any) -> bool:
    """Extend a motion that approaches an orbit, if it will converge within a bounded time.

    The largest differences in windows give the rate of the approach, since a window also contains
    the turns of a spiral. The differences of chaotic motions vary, and decrease over two windows in
    most cases. So differences must decrease twice, at similar rates. A motion that comes near the
    orbit later has far smaller latest differences. Only `recurrence_period` decides whether the
    motion is periodic.
    """
    length = w.transient + w.length
    elapsed = s.end_cycle + (s.end_phase - numbers_of(w)[PHASE]) / s.period
    if w.repeats > 0:  # periodic, but the statistics of its period are not complete
        duration = return_statistics(w, w.returns - 1)[DURATION] / s.period
        s.end_cycle += max(1, math.ceil((w.search_start + w.repeats - w.returns + 1) * duration))
        s.first_arc = 1
        return bool(elapsed < LONGEST_EXTENSION * length)
    # The length of a window is a fixed part of the returns before it, which gives their starts.
    first_return = w.window_start / (1.0 + WINDOW_SHARE)
    span = first_return * (1.0 - (1.0 + WINDOW_SHARE) ** -2)
    arrival = math.inf
    for lag in range(1, w.longest + 1):
        latest, second, third = (
            scratch_row(w, LARGEST_DISTANCES + 1)[lag - 1],
            scratch_row(w, LARGEST_DISTANCES + 2)[lag - 1],
            scratch_row(w, LARGEST_DISTANCES + 3)[lag - 1],
        )
        last_maximum, rate = 0.0, 0.0
        for k in range(max(0, w.returns - 2 * w.longest), w.returns):
            last_maximum = max(last_maximum, return_row(w, k)[RETURN_STATE + s.n + lag - 1])
        if 0.0 < LATE_FALL * last_maximum < min(latest, 1.0):
            rate = math.log(min(latest, 1.0) / last_maximum) / (w.returns - first_return)
        elif 0.0 < latest < second < third < math.inf:
            last_maximum, fall = latest, math.log(third / latest)
            if MIN_FALL_SHARE < math.log(third / second) / fall < MAX_FALL_SHARE:
                rate = fall / span
        if rate > 0.0:
            decrease = -math.expm1(-rate * lag)  # relative decrease from one difference to the next
            steps = math.log(last_maximum / (w.tolerance * decrease)) / rate
            arrival = min(arrival, first_return + steps + 2 * lag + max(2 * lag, MIN_CONFIRMATIONS))
    if math.isinf(arrival):
        return False
    # Add a tenth, since the rate is approximate. An aperiodic motion may approach by chance, but
    # not repeatedly: extend by at most the length so far, then check again.
    arrival_time = elapsed * 1.1 * max(1.0, arrival / w.returns)
    if arrival_time > LONGEST_EXTENSION * length:
        return False
    new_length = min(arrival_time, 2.0 * elapsed)
    extension = math.ceil(new_length - elapsed)
    s.end_cycle += extension
    s.first_arc = 1
    return True


def is_at_rest(engine: Any, s: Any, w: Any, mode: int, time: float, y: Any) -> bool:
    """Return whether all non-cyclic components are at rest."""
    slope, sizes = table_row(s, MARGINS_AT), scratch_row(w, SIZES)
    t = time - math.floor(time / s.period) * s.period
    interface.flow(engine, mode, t, y, slope)
    for j in range(s.n):
        is_moving = abs(slope[j]) * s.scale > w.noise * sizes[j]
        if table_row(s, CYCLIC)[j] == 0.0 and is_moving:
            return False
    return True


def write_result(engine: Any, s: Any, w: Any) -> None:
    """Write the result of a point."""
    n, result = s.n, result_of(w)
    result[OUTCOME] = w.outcome
    result[REPEATS] = w.repeats if w.outcome == PERIODIC else 0
    result[RETURNS] = w.returns
    result[AT_REST] = w.at_rest
    y, width = table_row(s, Y), width_of(s.m, s.modes, w.gains, w.marks)
    cycle, time, mode = s.cycle, s.t, s.mode
    if w.outcome == PERIODIC:
        row = return_row(w, w.returns - 1)
        periods = math.floor(row[RETURN_TIME] / s.period + 1e-12)
        cycle, time, mode = (
            periods,
            max(0.0, row[RETURN_TIME] - periods * s.period),
            int(row[RETURN_MODE]),
        )
        for j in range(n):
            result[RESULTS + j] = row[RETURN_STATE + j]
        sum_over_period(s, w)
    else:
        periods = math.floor(time / s.period + 1e-12)  # without events the time base does not move
        cycle, time = cycle + periods, max(0.0, time - periods * s.period)
        for j in range(n):
            result[RESULTS + j] = y[j] + table_row(s, OFFSET)[j]
    result[MEASURED] = w.measured
    result[END_CYCLE] = cycle
    result[END_TIME] = time
    result[END_MODE] = mode
    column = RESULTS + n
    for i in range(width):
        result[column + i] = scratch_row(w, TOTAL_SUMS)[i]
    column += width
    for i in range(w.gains):
        result[column + i] = scratch_row(w, SQUARES)[i]
    column += w.gains
    for k in range(w.longest):
        for j in range(n):
            state = (
                return_row(w, w.returns - 1 - k)[RETURN_STATE + j] if k < w.returns else math.nan
            )
            result[column + n * k + j] = state
