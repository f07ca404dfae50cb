"""Where motions come to: many points, each followed until it repeats itself, in one piece.

Written over the engine's contract, for both forms: compiled, a whole batch of points goes by
without Python. Of a point the event loop computes a few steps at a time; what it has written is
read here, return by return, and gathered.

A *return* is the beginning of a forcing period, a crossing of the section where nothing forces the
system, or, without a section, an event of one guard. A motion is periodic once 2 n returns in a
row, and 16 or a fourth of all, are those of n returns ago to within a tolerance, and what is still
to come of the way there, as the last two differences tell it (a geometric sequence), is below it
too: a motion that passes an unstable orbit by chance does not pass for one that stays, nor one that
creeps towards an orbit for one that has arrived. One of which differences fall, window by window of
its returns, is followed until it arrives, if it does in so many times its own time.
"""

from __future__ import annotations

import math
from typing import Any

from mems_impact.engines import contract
from mems_impact.hybrid import loop
from mems_impact.hybrid.gathering import (
    ALL,
    COUNTS,
    DURATION,
    GAINED,
    HELD,
    LARGEST,
    MEANS,
    NOW,
    RING,
    SIZES,
    SQUARES,
    STATES,
    VALUES,
    WHEN,
    WHERE,
    WHICH,
    clear,
    gather,
    gathered_at,
    memo,
    observe,
    ring,
    total,
    wander,
    width_of,
)  # fmt: skip
from mems_impact.hybrid.record import (
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
    LOOKED,
    MODE_AFTER,
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
    row,
    sample_at,
)

# What becomes of a point. One that wanders has not repeated itself within its time.
UNDECIDED, PERIODIC, WANDERS, REST, FAILED = range(5)
# What a return is.
AT_PERIODS, AT_SECTION, AT_GUARD = range(3)
BITE = 32  # steps that the event loop takes before what it has written is read
SAME = 10.0  # tolerances within which returns are one and the same
# Returns in a row, at least, that repeat, beside twice round: a motion which passes an unstable
# orbit by chance has left it by then. The longer it has gone on, the likelier is that: of few
# returns so large a share is enough.
FEWEST, SEEN, SHARE = 2, 16, 0.25
WINDOW = 0.25  # length of a window, as a part of the returns before it
FOLLOWED = 64.0  # times the time of a motion, after which none is followed that still creeps

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
    return loop.advance(engine, s, BITE)


def settle(engine: Any, s: Any, w: Any, quota: int) -> int:
    """Follow points until all are done, one fails, or a quota of steps is spent.

    Parameters
    ----------
    engine
    s, w : records
        CLOCK and WORK.
    quota : int

    Returns
    -------
    int
        DONE, PAUSED, or FAILED: the point before ``w.point`` has failed; the next call goes on.
    """
    while w.point < w.points:
        if w.begun == 0:
            begin(engine, s, w)
        while w.outcome == UNDECIDED:
            if quota <= 0:
                return PAUSED
            status = advance(engine, s, w)
            quota -= BITE
            read(engine, s, w)
            if w.outcome == UNDECIDED:
                if status == DONE and not creeps(s, w):
                    w.outcome = WANDERS
                elif status not in (DONE, PAUSED, BUFFER_FULL):
                    w.outcome = FAILED
            if s.fallen > 0.0 and w.outcome != FAILED:
                return PAUSED
        if w.failed == 1:
            w.outcome = FAILED
        end(engine, s, w)
        w.point += 1
        w.begun = 0
        if w.outcome == FAILED:
            return FAILED
    return DONE


def begin(engine: Any, s: Any, w: Any) -> None:
    """Start at a point, as if nothing had been before."""
    numbers = numbers_of(w)
    contract.renew(engine, numbers[LONGEST_STEP])
    for i in range(ROWS):
        if i != ORDER and i != IMPACT and i != RECORDS and i != CYCLIC:
            fill = -math.inf if i in (HIT_TIME, HIT_BEGIN) else 0.0
            for j in range(s.width):
                row(s, i)[j] = fill
    place = NUMBERS
    for i in range(s.switches):
        row(s, SWITCHES)[i] = numbers[place + i]
    place += s.switches
    for i in range(s.n):
        row(s, Y)[i] = numbers[place + i]
    place += s.n
    for i in range(w.input_width - place):
        contract.set_parameter(engine, i, numbers[place + i])
    s.period = numbers[PERIOD]
    s.scale = numbers[SCALE]
    s.t = numbers[PHASE]
    s.mode = int(numbers[MODE])
    whole = math.floor(w.transient + w.length)
    s.end_cycle = whole
    s.end_phase = s.t + (w.transient + w.length - whole) * s.period
    s.fresh = 1
    s.pending = NONE
    s.stop = math.inf
    s.cycle = 0
    s.restart = 0
    s.instant = 0
    s.steps = 0
    s.arc_steps = 0
    s.arcs = 0
    s.cycle_events = 0
    s.events_from = 0
    s.rows = 0
    s.failure = 0
    s.mark_mode = 0
    s.side = 0
    s.apart = 0.0
    s.pace = 0.0
    s.paced = 0.0
    s.turning = 0.0
    s.lifted = 0
    s.doubt = 0
    s.stride = 0.0
    s.cut = 0
    s.fallen = 0.0
    s.arc_start = 0.0
    s.sample_cycle = 0
    s.sample = math.ceil(s.t / s.period - 1e-12)
    s.taken = 0
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
    clear(s, w, memo(w, NOW))
    clear(s, w, memo(w, ALL))
    for i in range(w.memory_width):
        memo(w, SIZES)[i] = w.smallest
        memo(w, HELD)[i] = 0.0
        memo(w, MEANS)[i] = 0.0
        memo(w, SQUARES)[i] = 0.0
        memo(w, GAINED)[i] = 0.0
        for k in range(4):
            memo(w, LARGEST + k)[i] = math.inf


def read(engine: Any, s: Any, w: Any) -> None:
    """Read what the event loop has written, in the order in which it happened."""
    taken, n, y, sizes = 0, s.n, row(s, STATE), memo(w, SIZES)
    for i in range(s.rows):
        event = event_at(s, i)
        when = event[CYCLE] * s.period + event[TIME]
        taken = close_periods(engine, s, w, taken, when - 8.0 * EPS * abs(when))
        if w.outcome != UNDECIDED:
            return
        gather(engine, s, w, event, when)
        kind, guard = int(event[KIND]), int(event[GUARD])
        crossed = w.returned == AT_SECTION and kind == SECTION_CROSSING and guard == w.at
        struck = w.returned == AT_GUARD and kind == TRANSITION and guard == w.at
        if crossed or struck:
            for j in range(n):
                y[j] = event[HEAD + n + j]
            close(engine, s, w, when, int(event[MODE_AFTER]), y)
    close_periods(engine, s, w, taken, math.inf)
    s.rows = 0
    s.taken = 0
    for j in range(n):
        y[j] = row(s, Y)[j] + row(s, OFFSET)[j]
        if row(s, CYCLIC)[j] == 0.0:
            sizes[j] = max(sizes[j], abs(y[j]))
    looks = w.returned != AT_PERIODS and w.outcome == UNDECIDED
    if looks and stands_still(engine, s, w, s.mode, s.t, y):
        w.outcome = REST


def close_periods(engine: Any, s: Any, w: Any, taken: int, until: float) -> int:
    """End the forcing periods before an instant; return how many samples have been read."""
    y = row(s, STATE)
    while w.returned == AT_PERIODS and taken < s.taken and w.outcome == UNDECIDED:
        sample = sample_at(s, taken)
        when = sample[0] * s.period + sample[1]
        if when >= until:
            break
        for j in range(s.n):
            y[j] = sample[3 + j]
        close(engine, s, w, when, int(sample[2]), y)
        taken += 1
    return taken


def close(engine: Any, s: Any, w: Any, when: float, mode: int, y: Any) -> None:
    """End what is gathered at a return, and see whether the motion repeats itself."""
    now, n, k = memo(w, NOW), s.n, w.returns
    modes = COUNTS + 2 * s.m
    now[modes + mode] += when - w.since
    w.since = when
    now[DURATION] = when - w.last
    w.last = when
    if w.gains > 0:
        states, values, gained = memo(w, STATES), memo(w, VALUES), memo(w, GAINED)
        for j in range(n):
            states[j] = y[j]
            states[n + j] = y[j]
        w.failed |= observe(engine, w, mode, NONE, 0.0, states, values)
        for i in range(w.gains):
            now[modes + s.modes + i] = values[i] - gained[i]
            gained[i] = values[i]
    if k > 0:
        kept = gathered_at(w, k)
        for i in range(w.memory_width):
            kept[i] = now[i]
        if when - now[DURATION] >= w.transient * s.period * (1.0 - 1e-12):
            wander(s, w)
    clear(s, w, now)
    here = ring(w, k)
    here[WHEN] = when
    here[WHICH] = mode
    for j in range(n):
        here[WHERE + j] = y[j]
    w.returns = k + 1
    if stands_still(engine, s, w, mode, when, y):
        w.still = 1
        if w.returned != AT_PERIODS:
            w.outcome = REST
            return
    else:
        w.still = 0
    if w.returns >= (1.0 + WINDOW) * w.opened + 2 * w.longest * int(w.opened == 0):
        open_window(w)
    w.repeats = repeats_after(s, w)
    if w.repeats > 0:
        w.outcome = PERIODIC


def repeats_after(s: Any, w: Any) -> int:
    """Return after how many returns the motion repeats itself, as far as the last one tells."""
    k, n, held, sizes = w.returns - 1, s.n, memo(w, HELD), memo(w, SIZES)
    here = ring(w, k)
    found = 0
    for after in range(1, w.longest + 1):
        apart = math.inf
        if k >= after:
            then = ring(w, k - after)
            if then[WHICH] == here[WHICH]:
                apart = 0.0
                for j in range(n):
                    if row(s, CYCLIC)[j] == 0.0:
                        off = abs(here[WHERE + j] - then[WHERE + j]) / sizes[j]
                        apart = max(apart, off)
        before = ring(w, k - after)[WHERE + n + after - 1] if k >= 2 * after else math.inf
        here[WHERE + n + after - 1] = apart
        memo(w, LARGEST)[after - 1] = max(memo(w, LARGEST)[after - 1], apart)
        near = apart <= w.tolerance and k >= 2 * after
        if near and apart > w.noise:  # what is still to come is apart q / (1 - q)
            near = apart < before and apart * apart <= w.tolerance * (before - apart)
        held[after - 1] = held[after - 1] + 1.0 if near else 0.0
        seen = max(FEWEST, min(SEEN, SHARE * w.returns))
        if found == 0 and held[after - 1] >= max(2 * after, seen):
            found = after
    # A multiplier that turns the differences round lets 2 n be told before n.
    for after in range(1, found):
        apart = here[WHERE + n + after - 1]
        if found % after == 0 and apart <= SAME * w.tolerance:
            return after
    return found


def open_window(w: Any) -> None:
    """Begin a window of returns; the largest differences in the last three are kept."""
    for i in range(w.longest):
        for k in (3, 2, 1):
            memo(w, LARGEST + k)[i] = memo(w, LARGEST + k - 1)[i]
        memo(w, LARGEST)[i] = 0.0
    w.opened = w.returns


def creeps(s: Any, w: Any) -> bool:
    """Let a motion go on where it ends, if it comes to an orbit within a bounded time.

    The rate of the approach is that of the largest differences in windows, which hold the turns of
    a spiral too. What it arrives at is still seen by its returns alone (`repeats_after`).
    """
    length = w.transient + w.length
    done = s.end_cycle + (s.end_phase - numbers_of(w)[PHASE]) / s.period
    # Windows are as long as a part of the returns before them: so their beginnings are known.
    begun = w.opened / (1.0 + WINDOW)
    apart = begun * (1.0 - (1.0 + WINDOW) ** -2)
    arrives = math.inf
    for after in range(1, w.longest + 1):
        latest, third = memo(w, LARGEST + 1)[after - 1], memo(w, LARGEST + 3)[after - 1]
        if 0.0 < latest < third < math.inf:
            rate = math.log(third / latest) / apart
            left = -math.expm1(-rate * after)  # of a difference, from one to the next
            steps = math.log(latest / (w.tolerance * left)) / rate
            arrives = min(arrives, begun + steps + 2 * after + max(2 * after, SEEN))
    # A tenth more: rates are rough. What wanders may have come nearer by chance, but not again and
    # again: the next look comes no later than after as much time as before.
    needed = done * 1.1 * max(1.0, arrives / w.returns)
    if needed > FOLLOWED * length:
        return False
    more = min(needed, 2.0 * done)
    ahead = math.ceil(more - done)
    s.end_cycle += ahead
    s.fresh = 1
    return True


def stands_still(engine: Any, s: Any, w: Any, mode: int, when: float, y: Any) -> bool:
    """Return whether nothing moves but cyclic components."""
    slope, sizes = row(s, LOOKED), memo(w, SIZES)
    t = when - math.floor(when / s.period) * s.period
    contract.flow(engine, mode, t, y, slope)
    for j in range(s.n):
        moves = abs(slope[j]) * s.scale > w.noise * sizes[j]
        if row(s, CYCLIC)[j] == 0.0 and moves:
            return False
    return True


def end(engine: Any, s: Any, w: Any) -> None:
    """Write what has become of a point."""
    n, result = s.n, result_of(w)
    result[OUTCOME] = w.outcome
    result[REPEATS] = w.repeats
    result[RETURNS] = w.returns
    result[STILL] = w.still
    y, width = row(s, Y), width_of(s.m, s.modes, w.gains, w.marks)
    cycle, time, mode = s.cycle, s.t, s.mode
    if w.outcome == PERIODIC:
        last = ring(w, w.returns - 1)
        whole = math.floor(last[WHEN] / s.period + 1e-12)
        cycle, time, mode = whole, max(0.0, last[WHEN] - whole * s.period), int(last[WHICH])
        for j in range(n):
            result[RESULTS + j] = last[WHERE + j]
        total(s, w)
    else:
        whole = math.floor(time / s.period + 1e-12)  # where nothing happens the loop counts on
        cycle, time = cycle + whole, max(0.0, time - whole * s.period)
        for j in range(n):
            result[RESULTS + j] = y[j] + row(s, OFFSET)[j]
    result[MEASURED] = w.measured
    result[END_CYCLE] = cycle
    result[END_TIME] = time
    result[END_MODE] = mode
    place = RESULTS + n
    for i in range(width):
        result[place + i] = memo(w, ALL)[i]
    place += width
    for i in range(w.gains):
        result[place + i] = memo(w, SQUARES)[i]
    place += w.gains
    for k in range(w.longest):
        for j in range(n):
            state = ring(w, w.returns - 1 - k)[WHERE + j] if k < w.returns else math.nan
            result[place + n * k + j] = state
