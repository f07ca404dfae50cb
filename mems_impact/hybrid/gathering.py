"""What is gathered of a motion from return to return: counts, times, observables.

Written over the engine's contract, as `mems_impact.hybrid.settling` is, which calls it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mems_impact.engines import contract
from mems_impact.hybrid.record import (
    ACCUMULATION,
    APPROACH,
    GUARD,
    HEAD,
    KIND,
    LOOKED,
    MODE_BEFORE,
    STATE,
    TIME,
    TRANSITION,
    row,
)

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
        ("returned", np.int64),  # what a return is; and of which guard, or in which direction
        ("at", np.int64),
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
NOW, ALL, SIZES, STATES, VALUES, GAINED, HELD, MEANS, SQUARES, LARGEST, RING = *range(10), 13
WHEN, WHICH, WHERE = 0, 1, 2


def memo(w: Any, i: int) -> Any:
    """Return row `i` of the memory."""
    return w.memory[i]


def ring(w: Any, k: int) -> Any:
    """Return the row of return number `k`."""
    return memo(w, RING + k % (2 * w.longest))


def gathered_at(w: Any, k: int) -> Any:
    """Return what was gathered up to return number `k`."""
    return memo(w, RING + 2 * w.longest + k % w.longest)


def width_of(m: int, modes: int, gains: int, marks: int) -> int:
    """Return how many numbers are gathered from return to return."""
    return COUNTS + 2 * m + modes + gains + PARTS * marks


def observe(engine: Any, w: Any, mode: int, code: int, t: float, states: Any, out: Any) -> int:
    """Write observables into `out`: of a state, with `code` -1, or of an event at a guard.

    Returns 1 if one of their functions fails.
    """
    return int(w.observe(mode, code, t, states, engine.parameters, out))


def clear(s: Any, w: Any, gathered: Any) -> None:
    """Begin a row of what is gathered."""
    first = COUNTS + s.m
    for i in range(w.memory_width):
        gathered[i] = math.inf if first <= i < first + s.m else 0.0
    first += s.m + s.modes + w.gains
    for i in range(w.marks):
        gathered[first + PARTS * i + LOW] = math.inf
        gathered[first + PARTS * i + HIGH] = -math.inf


def gather(engine: Any, s: Any, w: Any, event: Any, when: float) -> None:
    """Take one event to what is gathered since the last return."""
    now, kind, guard, n = memo(w, NOW), int(event[KIND]), int(event[GUARD]), s.n
    now[COUNTS + 2 * s.m + int(event[MODE_BEFORE])] += when - w.since
    w.since = when
    if kind == APPROACH:
        before, margins, place = row(s, STATE), row(s, LOOKED), COUNTS + s.m + guard
        for j in range(n):
            before[j] = event[HEAD + j]
        contract.margins(engine, int(event[MODE_BEFORE]), event[TIME], before, margins)
        now[place] = min(now[place], margins[guard])
    if kind == TRANSITION:
        now[COUNTS + guard] += 1.0
    if kind == ACCUMULATION:
        now[ENDINGS] += 1.0
    if w.marks > 0 and kind in (TRANSITION, ACCUMULATION):
        states, values = memo(w, STATES), memo(w, VALUES)
        for j in range(2 * n):
            states[j] = event[HEAD + j]
        for i in range(w.marks):
            values[w.gains + i] = math.nan
        w.failed |= observe(engine, w, int(event[MODE_BEFORE]), guard, event[TIME], states, values)
        first = COUNTS + 2 * s.m + s.modes + w.gains
        for i in range(w.marks):
            take_value(now, first + PARTS * i, values[w.gains + i])


def take_value(gathered: Any, place: int, value: float) -> None:
    """Take a value of an observable, unless there is none."""
    if not math.isnan(value):
        gathered[place + NUMBER] += 1.0
        gathered[place + TOTAL] += value
        gathered[place + LOW] = min(gathered[place + LOW], value)
        gathered[place + HIGH] = max(gathered[place + HIGH], value)


def wander(s: Any, w: Any) -> None:
    """Take what was gathered up to this return to the totals of a motion that wanders."""
    now, means, squares = memo(w, NOW), memo(w, MEANS), memo(w, SQUARES)
    add(s, w, memo(w, ALL), now)
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


def total(s: Any, w: Any) -> None:
    """Put together what was gathered while the motion went round once."""
    means, squares = memo(w, MEANS), memo(w, SQUARES)
    clear(s, w, memo(w, ALL))
    first, count = COUNTS + 2 * s.m + s.modes, w.repeats
    for i in range(w.gains):
        means[i] = 0.0
        squares[i] = 0.0
    for k in range(w.returns - count, w.returns):
        part = gathered_at(w, k)
        add(s, w, memo(w, ALL), part)
        for i in range(w.gains):
            means[i] += part[first + i] / count
    for k in range(w.returns - count, w.returns):
        part = gathered_at(w, k)
        for i in range(w.gains):
            off = part[first + i] - means[i]
            squares[i] += off * off
    w.measured = count
