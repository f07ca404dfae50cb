"""DOP853 in lanes: one step of several trajectories at once, in vectors.

The stages are those of `stepper`, over a record with vectors in place of numbers. A step is *plain*
if it passes the error test, ends before the next stop or sample, and contains no event by its
margins and rates at both ends. A lane takes plain steps here; `hybrid.attractors.lanes` hands any
other step, with its dense output, to the engine of its trajectory, which continues with the same
bits.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import types
from numba.extending import overload

from mems_impact.integrators import interface
from mems_impact.integrators.dop853 import stepper
from mems_impact.integrators.dop853.compiled import CONTRACTED
from mems_impact.integrators.dop853.stepper import (
    END,
    ENGINE_NUMBERS,
    GROW,
    HIGH,
    LOW,
    SAFETY,
    SHRINK,
    SLOPE,
    START,
    ULP,
    component,
    dense,
    eighth_root,
    make_dense,
    row,
    stages,
    try_step,
)
from mems_impact.integrators.jit.closures import take_snapshot
from mems_impact.integrators.jit.lane_kernels import call_lane_kernel
from mems_impact.integrators.jit.lanes import STRIDE, bits, lane_pointer, mask_of, select
from mems_impact.integrators.jit.numba_support import INNER, JIT, data, pointer

# Rows of vectors beside those of `stepper`: biases, the recent change of the rates before and after
# a step, and the largest sizes of the components.
BIAS, RATE_CHANGE, CHANGE_AHEAD, SIZES = 8, 9, 10, 11
ROWS = 12
# Numbers of each lane: time; step to be tried, and that planned by the last step; longest step and
# size of the largest; next stop; time at which another step is not plain; recent step length; 1
# after a rejection; plain steps that may follow, that were taken, and until the next check of
# `auto`; error and end of the step that was tried; 1 if closest approaches are searched.
(
    T, TRIAL, NEXT, LONGEST, MAX_STEP, STOP, LIMIT, RECENT, REJECTED, LEFT, TAKEN, UNCHECKED, ERROR,
    AHEAD, SEARCH, NUMBERS,
) = range(16)  # fmt: skip

INFINITY = np.inf

LANE_ENGINE = np.dtype(
    [
        ("rows", np.int64),  # addresses of vectors
        ("components", np.int64),
        ("numbers", np.int64),
        ("parameters", np.int64),
        ("argument_time", np.int64),
        ("flow", np.int64),  # addresses of functions
        ("margins", np.int64),
        ("approaches", np.int64),  # address of numbers
        ("width", np.int64),
        ("n", np.int64),
        ("m", np.int64),
        ("parameter_count", np.int64),
        ("mode", np.int64),
        ("rtol", np.float64),
        ("atol", np.float64),
        ("last_instant", np.float64),  # infinity: no lane reaches its stop
        ("collapse_ratio", np.float64),  # constants of the event loop
        ("recent_step_decay", np.float64),
        ("rate_change_decay", np.float64),
        ("plain", np.int64),  # lanes by bits, after `attempt_step`
        ("complete", np.int64),
        ("rejected", np.int64),
        ("due", np.int64),
    ],
    align=True,
)


def numbers(engine: Any) -> Any:
    """Return the numbers of the lanes."""
    return lane_pointer(engine.numbers)


def attempt_step(engine: Any, active: int) -> None:
    """Attempt a step in all lanes, and advance those of `active`, by bits, in which it is plain.

    ``engine.plain`` has the lanes that were advanced, ``engine.complete`` others with a step that
    passes the error test, ``engine.rejected`` those whose next attempt will be shorter,
    ``engine.due`` those that were advanced to a check of `auto`.
    """
    n, m, mode = engine.n, engine.m, engine.mode
    x, end, slope = numbers(engine), row(engine, END), row(engine, SLOPE)
    low, high = row(engine, LOW), row(engine, HIGH)
    bias, sizes = row(engine, BIAS), row(engine, SIZES)
    rate_change, change_ahead = row(engine, RATE_CHANGE), row(engine, CHANGE_AHEAD)
    t, trial = x[T], x[TRIAL]
    ahead = t + trial
    h = ahead - t
    error = try_step(engine, t, h)
    interface.flow(engine, mode, ahead, end, slope)
    finite = error <= INFINITY
    for j in range(n):
        component(engine, j)[12] = slope[j]
        finite = finite & (abs(slope[j]) < INFINITY)
    interface.margins(engine, mode, ahead, end, high)
    for i in range(2 * m):
        finite = finite & (high[i] == high[i])
    before_stop = (ahead < x[STOP]) & (x[STOP] - t > min(1.01 * trial, x[MAX_STEP]))
    passed = finite & before_stop & (error <= 1.0)
    plain = passed & (ahead < x[LIMIT]) & (x[LEFT] > 0.5) & (h >= engine.collapse_ratio * x[RECENT])
    for i in range(m):
        rate, rate_ahead = low[m + i], high[m + i]
        changes = (high[i] != low[i]) | (rate_ahead != rate)
        change = max(abs(rate_ahead - rate) / h, engine.rate_change_decay * rate_change[i])
        change_ahead[i] = select(changes, change, rate_change[i])
        begin, finish = low[i] + bias[i], high[i] + bias[i]
        # As `event_detection.certify_no_crossing`.
        defect = abs(finish - begin - 0.5 * h * (rate + rate_ahead))
        drop = 0.25 * change * h * h + 3.0 * defect
        certain = (begin + 0.5 * h * rate > drop) & (finish - 0.5 * h * rate_ahead > drop)
        plain = plain & (certain | ~changes) & ((begin <= 0.0) | (finish > 0.0))
        unsearched = bias[i] == 0.0
        if pointer(engine.approaches)[i] == 1.0:
            unsearched = unsearched & (x[SEARCH] < 0.5)
        plain = plain & (unsearched | (rate >= 0.0) | (rate_ahead < 0.0))
    mask = mask_of(active)
    plain = plain & mask
    factor = SAFETY / max(eighth_root(error), 1e-3)
    longer = h * min(GROW, factor)
    longer = select(x[REJECTED] > 0.5, min(longer, h), longer)
    following = select(h < trial, max(longer, trial), longer)
    smallest = 4.0 * ULP * max(abs(select(plain, ahead, t)), x[MAX_STEP])
    shorter = h * max(SHRINK, SAFETY / eighth_root(error))
    rejected = mask & before_stop & (error > 1.0) & (error < INFINITY) & (shorter >= smallest)
    for i in range(m):
        rate_change[i] = select(plain, change_ahead[i], rate_change[i])
    for j in range(n):
        sizes[j] = select(plain, max(sizes[j], abs(end[j])), sizes[j])
    advance_lanes(engine, bits(plain))
    x[ERROR] = error
    x[AHEAD] = ahead
    x[T] = select(plain, ahead, t)
    x[NEXT] = select(plain, following, x[NEXT])
    x[RECENT] = select(plain, max(h, engine.recent_step_decay * x[RECENT]), x[RECENT])
    steps = select(plain, 1.0, 0.0)
    x[TAKEN] = x[TAKEN] + steps
    x[LEFT] = x[LEFT] - steps
    x[UNCHECKED] = x[UNCHECKED] - steps
    tried = max(min(x[NEXT], x[LONGEST]), smallest)
    x[TRIAL] = select(plain, tried, select(rejected, shorter, trial))
    x[REJECTED] = select(plain, 0.0, select(rejected, 1.0, x[REJECTED]))
    engine.plain = bits(plain)
    engine.complete = bits(passed & mask & ~plain)
    engine.rejected = bits(rejected)
    engine.due = bits(plain & (x[UNCHECKED] < 0.5))
    if engine.complete != 0:
        make_dense(engine, t, h)


def advance_lanes(engine: Any, chosen: int) -> None:
    """Let the next step begin at the end of the last one, in lanes by bits."""
    mask = mask_of(chosen)
    start, end = row(engine, START), row(engine, END)
    low, high = row(engine, LOW), row(engine, HIGH)
    for j in range(engine.n):
        k = component(engine, j)
        start[j] = select(mask, end[j], start[j])
        k[0] = select(mask, k[12], k[0])
    for i in range(2 * engine.m):
        low[i] = select(mask, high[i], low[i])


def is_lane_engine(kind: Any) -> bool:
    """Return whether a numba type is the record of LANE_ENGINE."""
    return isinstance(kind, types.Record) and "argument_time" in kind.fields


@overload(stepper.row, jit_options={**JIT, **INNER})
def _row(engine, i):  # type: ignore[no-untyped-def]
    if is_lane_engine(engine):
        return lambda engine, i: lane_pointer(engine.rows + STRIDE * engine.width * i)


@overload(stepper.component, jit_options={**JIT, **INNER})
def _component(engine, j):  # type: ignore[no-untyped-def]
    if is_lane_engine(engine):
        return lambda engine, j: lane_pointer(engine.components + STRIDE * ENGINE_NUMBERS * j)


@overload(interface.flow, jit_options={**JIT, **INNER})
def _flow(engine, mode, t, y, dy):  # type: ignore[no-untyped-def]
    if is_lane_engine(engine):

        def implementation(engine, mode, t, y, dy):  # type: ignore[no-untyped-def]
            time, size, p = engine.argument_time, engine.parameter_count, engine.parameters
            lane_pointer(time)[0] = t
            call_lane_kernel(engine.flow, (mode, time, data(y), p, size, data(dy)))

        return implementation


@overload(interface.margins, jit_options={**JIT, **INNER})
def _margins(engine, mode, t, y, out):  # type: ignore[no-untyped-def]
    if is_lane_engine(engine):

        def implementation(engine, mode, t, y, out):  # type: ignore[no-untyped-def]
            time, size, p = engine.argument_time, engine.parameter_count, engine.parameters
            lane_pointer(time)[0] = t
            call_lane_kernel(engine.margins, (mode, time, data(y), p, size, data(out)))

        return implementation


# The arithmetic of the engine for numbers.
_contracted_stages, _contracted_dense = take_snapshot(stages, dense).frozen(**CONTRACTED)


@overload(stepper.try_step, jit_options={**JIT, **INNER})
def _try_step(engine, t, h):  # type: ignore[no-untyped-def]
    if is_lane_engine(engine):
        return lambda engine, t, h: _contracted_stages(engine, t, h)


@overload(stepper.make_dense, jit_options={**JIT, **INNER})
def _make_dense(engine, t, h):  # type: ignore[no-untyped-def]
    if is_lane_engine(engine):
        return lambda engine, t, h: _contracted_dense(engine, t, h)
