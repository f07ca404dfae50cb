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
        ("smallest", np.float64),  # size of a component that counts as zero
        ("transient", np.float64),  # periods of the problem
        ("length", np.float64),  # of the statistics of an aperiodic motion, in periods
        ("gains", np.int64),  # numbers of observables of the state, and at events
        ("marks", np.int64),
        ("returns", np.int64),
        ("repeats", np.int64),  # period in returns, or 0
        ("measured", np.int64),  # returns in the statistics
        ("since", np.float64),  # start of the present mode
        ("last", np.float64),  # time of the last return
        ("rest_check", np.int64),  # number of the step after which rest is checked
        ("opened", np.int64),  # first return of the present window
        ("at_rest", np.int64),  # 1 if all non-cyclic components are at rest
        ("failed", np.int64),  # 1 if an observable has failed
        ("covered", np.int64),  # first return whose closest approaches were searched, or NONE
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
NOW, ALL, SIZES, STATES, VALUES, GAINED, CONFIRMATIONS, MEANS, SQUARES = range(9)
LARGEST_DISTANCES, RING = 9, 13
WHEN, WHICH, WHERE = 0, 1, 2
# Of the differences since a return: 1 if the last series did not accumulate; their number, 0 if the
# last one exceeds the tolerance; the largest of them; the state at the return.
STATIONARY_DIFFERENCES, SERIES, LARGEST, SINCE = range(4)


def scratch_row(w: Any, i: int) -> Any:
    """Return row `i` of the memory."""
    return w.memory[i]


def return_row(w: Any, k: int) -> Any:
    """Return the row of return `k`."""
    return scratch_row(w, RING + k % (2 * w.longest))


def return_statistics(w: Any, k: int) -> Any:
    """Return the statistics of return `k`."""
    return scratch_row(w, RING + 2 * w.longest + k % w.longest)


def series_row(w: Any, after: int) -> Any:
    """Return the row of the differences from the return `after` returns earlier."""
    return scratch_row(w, RING + 3 * w.longest + after - 1)


def width_of(m: int, modes: int, gains: int, marks: int) -> int:
    """Return the number of statistics per return."""
    return COUNTS + 2 * m + modes + gains + PARTS * marks


def observe(engine: Any, w: Any, mode: int, code: int, t: float, states: Any, out: Any) -> int:
    """Write observables into `out`: of a state if `code` is -1, else of an event.

    The code of an event is that of its transition, m + guard at the end of chatter.

    Returns 1 if one of their functions fails.
    """
    return int(w.observe(mode, code, t, states, engine.parameters, out))


def reset_row(s: Any, w: Any, statistics: Any) -> None:
    """Initialize a row of statistics."""
    first = COUNTS + s.m
    for i in range(w.memory_width):
        statistics[i] = math.inf if first <= i < first + s.m else 0.0
    first += s.m + s.modes + w.gains
    for i in range(w.marks):
        statistics[first + PARTS * i + LOW] = math.inf
        statistics[first + PARTS * i + HIGH] = -math.inf


def accumulate_event(engine: Any, s: Any, w: Any, event: Any, when: float) -> None:
    """Add one event to the statistics since the last return."""
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


def accumulate_value(statistics: Any, place: int, value: float) -> None:
    """Add a value of an observable, unless it is nan."""
    if not math.isnan(value):
        statistics[place + NUMBER] += 1.0
        statistics[place + TOTAL] += value
        statistics[place + LOW] = min(statistics[place + LOW], value)
        statistics[place + HIGH] = max(statistics[place + HIGH], value)


def accumulate_aperiodic(s: Any, w: Any) -> None:
    """Add the statistics of this return to those of an aperiodic motion."""
    now, means, squares = scratch_row(w, NOW), scratch_row(w, MEANS), scratch_row(w, SQUARES)
    add(s, w, scratch_row(w, ALL), now)
    w.measured += 1
    first = COUNTS + 2 * s.m + s.modes
    for i in range(w.gains):
        off = now[first + i] - means[i]
        means[i] += off / w.measured
        squares[i] += off * (now[first + i] - means[i])


def add(s: Any, w: Any, total: Any, part: Any) -> None:
    """Add the statistics of one return to a total."""
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
    """Compute the statistics of one period of a periodic motion."""
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

# Columns of the inputs; switching times, state and parameters follow.
PERIOD, SCALE, LONGEST_STEP, PHASE, MODE, NUMBERS = range(6)
# Columns of the results; the state at the last return, statistics, squared deviations of gains, and
# the last returns follow.
OUTCOME, REPEATS, RETURNS, MEASURED, END_CYCLE, END_TIME, END_MODE, AT_REST, RESULTS = range(9)


def memory_shape(n: int, m: int, modes: int, w: Any) -> tuple[int, int]:
    """Return the shape of the memory."""
    statistics = width_of(m, modes, w["gains"], w["marks"])
    width = max(statistics, WHERE + n + w["longest"], 2 * n, w["gains"] + w["marks"])
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


def advance(engine: Any, s: Any, w: Any) -> int:
    """Run the event loop for one step."""
    return loop.run_steps(engine, s, 1)


def map_points(engine: Any, s: Any, w: Any, quota: int) -> int:
    """Compute points until all are complete, one fails, or the quota of steps is used up.

    Parameters
    ----------
    engine
    s, w : records
        LOOP_STATE and WORK.
    quota : int

    Returns
    -------
    int
        DONE, PAUSED, or FAILED: the point before ``w.point`` has failed; the next call continues.
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
    status = advance(engine, s, w)
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
    s.section_curvature = 0.0
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
    w.at_rest = 0
    w.failed = 0
    w.opened = 0
    w.since = s.t
    w.last = s.t
    w.rest_check = REST_CHECK_STEPS
    w.covered = NONE
    impacts = False
    for i in range(s.m):
        impacts = impacts or table_row(s, IMPACT)[i] == 1
    if w.transient <= 1.0 or not impacts:
        w.covered = 0
    interface.search_approaches(engine, int(w.covered == 0))
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
    for after in range(1, w.longest + 1):
        series_row(w, after)[STATIONARY_DIFFERENCES] = 0.0
        series_row(w, after)[SERIES] = 0.0


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
    processed, n, y = 0, s.n, table_row(s, STATE)
    for i in range(s.events_written):
        event = event_at(s, i)
        when = event[CYCLE] * s.period + event[TIME]
        processed = close_periods(engine, s, w, processed, when - 8.0 * EPS * abs(when))
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
    close_periods(engine, s, w, processed, math.inf)
    s.events_written = 0
    s.samples_written = 0


def close_periods(engine: Any, s: Any, w: Any, processed: int, until: float) -> int:
    """Process the returns before an instant; return the number of processed samples."""
    y = table_row(s, STATE)
    while (
        w.return_kind == STROBOSCOPIC and processed < s.samples_written and w.outcome == UNDECIDED
    ):
        sample = sample_at(s, processed)
        when = sample[0] * s.period + sample[1]
        if when >= until:
            break
        for j in range(s.n):
            y[j] = sample[3 + j]
        close_return(engine, s, w, when, int(sample[2]), y)
        processed += 1
    return processed


def close_return(engine: Any, s: Any, w: Any, when: float, mode: int, y: Any) -> None:
    """Process a return: complete its statistics, and test for periodicity."""
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
        begin = w.transient * s.period * (1.0 - 1e-12)
        if when - now[DURATION] >= begin and NONE < w.covered <= k:
            accumulate_aperiodic(s, w)
        elif when + now[DURATION] >= begin:
            cover_returns(engine, w, k)
    reset_row(s, w, now)
    here = return_row(w, k)
    here[WHEN] = when
    here[WHICH] = mode
    for j in range(n):
        here[WHERE + j] = y[j]
    w.returns = k + 1
    if is_at_rest(engine, s, w, mode, when, y):
        w.at_rest = 1
        if w.return_kind != STROBOSCOPIC:
            w.outcome = STATIONARY
            return
    else:
        w.at_rest = 0
    if w.returns >= (1.0 + WINDOW_SHARE) * w.opened + 2 * w.longest * int(w.opened == 0):
        open_window(w)
    w.repeats = repeats_after(s, w)
    if w.repeats > 0:
        cover_returns(engine, w, k)
        if w.returns - w.repeats >= w.covered:
            w.outcome = PERIODIC


def cover_returns(engine: Any, w: Any, k: int) -> None:
    """Search closest approaches from now on, unless they are, after return `k`.

    They take a third of the time of a motion between stoppers, and only the statistics contain
    them. The step in which a return lies may extend beyond an approach that follows it.
    """
    if w.covered == NONE:
        w.covered = k + 2
        interface.search_approaches(engine, 1)


def repeats_after(s: Any, w: Any) -> int:
    """Return the period of the motion in returns, 0 if it is not periodic yet."""
    k, n = w.returns - 1, s.n
    confirmations, largest = scratch_row(w, CONFIRMATIONS), scratch_row(w, LARGEST_DISTANCES)
    here = return_row(w, k)
    found = 0
    for after in range(1, w.longest + 1):
        distance = math.inf
        if k >= after:
            then = return_row(w, k - after)
            if then[WHICH] == here[WHICH]:
                distance = difference(s, w, here, then, WHERE)
        before = return_row(w, k - after)[WHERE + n + after - 1] if k >= 2 * after else math.inf
        here[WHERE + n + after - 1] = distance
        largest[after - 1] = max(largest[after - 1], distance)
        extend_series(s, w, after, distance)
        near = distance <= w.tolerance and k >= 2 * after
        if near and distance > w.noise:  # the remaining distance is distance q / (1 - q)
            gain = before - distance
            near = gain > 0.0 and distance * distance <= w.tolerance * gain
            near = near or series_row(w, after)[STATIONARY_DIFFERENCES] == 1.0
        confirmations[after - 1] = confirmations[after - 1] + 1.0 if near else 0.0
        needed = max(FEWEST_CONFIRMATIONS, min(MIN_CONFIRMATIONS, CONFIRMATION_SHARE * w.returns))
        if found == 0 and confirmations[after - 1] >= max(2 * after, needed):
            found = after
    # With a negative multiplier the period 2 n may be confirmed before n.
    for after in range(1, found):
        distance = here[WHERE + n + after - 1]
        if found % after == 0 and distance <= SUBPERIOD_TOLERANCE * w.tolerance:
            return after
    return found


def difference(s: Any, w: Any, here: Any, there: Any, first: int) -> float:
    """Return the largest relative difference of two states, that in `there` from column `first`."""
    largest = 0.0
    for j in range(s.n):
        if table_row(s, CYCLIC)[j] == 0.0:
            change = abs(here[WHERE + j] - there[first + j])
            largest = max(largest, change / scratch_row(w, SIZES)[j])
    return largest


def extend_series(s: Any, w: Any, after: int, distance: float) -> None:
    """Add a difference to those since an earlier return; decide whether they accumulate.

    Errors of a method whose steps are not periodic do not: the distance from the earlier return is
    no larger than one of them. In a slow approach it is nearly their sum. Along an unstable orbit
    the last difference is the largest, whatever its direction.
    """
    series, here = series_row(w, after), return_row(w, w.returns - 1)
    if distance > w.tolerance:
        series[STATIONARY_DIFFERENCES] = 0.0
        series[SERIES] = 0.0
        return
    series[SERIES] += 1.0
    series[LARGEST] = max(series[LARGEST], distance)
    if series[SERIES] > MIN_CONFIRMATIONS * after:
        total = difference(s, w, here, series, SINCE)
        stationary = total <= series[LARGEST] and distance < series[LARGEST]
        series[STATIONARY_DIFFERENCES] = 1.0 if stationary else 0.0
        series[SERIES] = 1.0
    if series[SERIES] == 1.0:
        series[LARGEST] = 0.0
        for j in range(s.n):
            series[SINCE + j] = here[WHERE + j]


def open_window(w: Any) -> None:
    """Begin a window of returns; keep the largest differences of the last three."""
    for i in range(w.longest):
        for k in (3, 2, 1):
            scratch_row(w, LARGEST_DISTANCES + k)[i] = scratch_row(w, LARGEST_DISTANCES + k - 1)[i]
        scratch_row(w, LARGEST_DISTANCES)[i] = 0.0
    w.opened = w.returns


def extend_approach(s: Any, w: Any) -> bool:
    """Extend a motion that approaches an orbit, if it will converge within a bounded time.

    The rate of the approach is that of the largest differences in windows, which also contain the
    turns of a spiral. Those of chaotic motions vary, and decrease over two windows in most cases.
    So they must decrease twice, at similar rates. A motion that comes near the orbit later has far
    smaller latest differences. Only `repeats_after` decides whether the motion is periodic.
    """
    length = w.transient + w.length
    done = s.end_cycle + (s.end_phase - numbers_of(w)[PHASE]) / s.period
    if w.repeats > 0:  # periodic, but the statistics of its period are not complete
        duration = return_statistics(w, w.returns - 1)[DURATION] / s.period
        s.end_cycle += max(1, math.ceil((w.covered + w.repeats - w.returns + 1) * duration))
        s.first_arc = 1
        return bool(done < LONGEST_EXTENSION * length)
    # The length of a window is a fixed part of the returns before it, which gives their starts.
    begun = w.opened / (1.0 + WINDOW_SHARE)
    span = begun * (1.0 - (1.0 + WINDOW_SHARE) ** -2)
    arrives = math.inf
    for after in range(1, w.longest + 1):
        latest, second, third = (
            scratch_row(w, LARGEST_DISTANCES + 1)[after - 1],
            scratch_row(w, LARGEST_DISTANCES + 2)[after - 1],
            scratch_row(w, LARGEST_DISTANCES + 3)[after - 1],
        )
        recent, rate = 0.0, 0.0
        for k in range(max(0, w.returns - 2 * w.longest), w.returns):
            recent = max(recent, return_row(w, k)[WHERE + s.n + after - 1])
        if 0.0 < LATE_FALL * recent < min(latest, 1.0):
            rate = math.log(min(latest, 1.0) / recent) / (w.returns - begun)
        elif 0.0 < latest < second < third < math.inf:
            recent, fall = latest, math.log(third / latest)
            if MIN_FALL_SHARE < math.log(third / second) / fall < MAX_FALL_SHARE:
                rate = fall / span
        if rate > 0.0:
            left = -math.expm1(-rate * after)  # relative decrease from one difference to the next
            steps = math.log(recent / (w.tolerance * left)) / rate
            arrives = min(arrives, begun + steps + 2 * after + max(2 * after, MIN_CONFIRMATIONS))
    if math.isinf(arrives):
        return False
    # Add a tenth, since the rate is approximate. An aperiodic motion may approach by chance, but
    # not repeatedly: extend by at most the length so far, then check again.
    needed = done * 1.1 * max(1.0, arrives / w.returns)
    if needed > LONGEST_EXTENSION * length:
        return False
    more = min(needed, 2.0 * done)
    ahead = math.ceil(more - done)
    s.end_cycle += ahead
    s.first_arc = 1
    return True


def is_at_rest(engine: Any, s: Any, w: Any, mode: int, when: float, y: Any) -> bool:
    """Return whether all non-cyclic components are at rest."""
    slope, sizes = table_row(s, MARGINS_AT), scratch_row(w, SIZES)
    t = when - math.floor(when / s.period) * s.period
    interface.flow(engine, mode, t, y, slope)
    for j in range(s.n):
        moves = abs(slope[j]) * s.scale > w.noise * sizes[j]
        if table_row(s, CYCLIC)[j] == 0.0 and moves:
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
        last = return_row(w, w.returns - 1)
        whole = math.floor(last[WHEN] / s.period + 1e-12)
        cycle, time, mode = whole, max(0.0, last[WHEN] - whole * s.period), int(last[WHICH])
        for j in range(n):
            result[RESULTS + j] = last[WHERE + j]
        sum_over_period(s, w)
    else:
        whole = math.floor(time / s.period + 1e-12)  # without events the time base does not move
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
