"""One step of the method: stages, error estimate, dense output.

Like the loop, this is one text for both engines: `contract.flow` calls the automaton, and `row` and
`component` lead to lists in Python and to memory in compiled code.
"""

from __future__ import annotations

import math
from typing import Any

from mems_impact.engines import contract
from mems_impact.engines.onestep.tableau import ERROR_5, WEIGHTS_3, A, C, D

# What is kept of each component of the state, one after another: the slopes at the places C of the
# step, numbers 0 to 15, and seven coefficients of the dense output.
DENSE = 16
KEPT = 24

# Rows of numbers side by side, as the automaton's functions take them.
ARGUMENT, SLOPE = 0, 1  # state at which a stage is evaluated, and what comes of it
START, END = 2, 3  # states between which the step goes
STATE = 4  # what `state` answers
LOW, HIGH = 5, 6  # root functions where they are looked for from, and at the end of the step
SPARE = 7  # three rows of root functions while a root is closed in
ROWS = 10


def row(engine: Any, i: int) -> Any:
    """Return row `i`."""
    return engine.rows[i]


def component(engine: Any, j: int) -> Any:
    """Return what is kept of component `j`."""
    return engine.components[j]


def set_fired(engine: Any, i: int, direction: int) -> None:
    """Say that root function `i` has crossed zero in `direction`, or not (0)."""
    engine.crossings[i] = direction


def stages(engine: Any, t: float, h: float) -> float:
    """Evaluate slopes 1 to 11 and END of a step from (t, START); return its error in tolerances.

    Slope 0 must be known. The error estimate is that of DOP853, of order 7: it combines two
    embedded methods, of orders 5 and 3. It is not finite where a slope is not.
    """
    n, mode, limit = engine.n, engine.mode, engine.last_instant
    rtol, atol = engine.rtol, engine.atol
    y, slope = row(engine, ARGUMENT), row(engine, SLOPE)
    start, end = row(engine, START), row(engine, END)
    # fmt: off
    (a0,) = A[1]
    for j in range(n):
        k = component(engine, j)
        y[j] = start[j] + h * (a0 * k[0])
    contract.flow(engine, mode, min(t + C[1] * h, limit), y, slope)
    a0, a1 = A[2]
    for j in range(n):
        k = component(engine, j)
        k[1] = slope[j]
        y[j] = start[j] + h * (a0 * k[0] + a1 * k[1])
    contract.flow(engine, mode, min(t + C[2] * h, limit), y, slope)
    a0, a2 = A[3]
    for j in range(n):
        k = component(engine, j)
        k[2] = slope[j]
        y[j] = start[j] + h * (a0 * k[0] + a2 * k[2])
    contract.flow(engine, mode, min(t + C[3] * h, limit), y, slope)
    a0, a2, a3 = A[4]
    for j in range(n):
        k = component(engine, j)
        k[3] = slope[j]
        y[j] = start[j] + h * (a0 * k[0] + a2 * k[2] + a3 * k[3])
    contract.flow(engine, mode, min(t + C[4] * h, limit), y, slope)
    a0, a3, a4 = A[5]
    for j in range(n):
        k = component(engine, j)
        k[4] = slope[j]
        y[j] = start[j] + h * (a0 * k[0] + a3 * k[3] + a4 * k[4])
    contract.flow(engine, mode, min(t + C[5] * h, limit), y, slope)
    a0, a3, a4, a5 = A[6]
    for j in range(n):
        k = component(engine, j)
        k[5] = slope[j]
        y[j] = start[j] + h * (a0 * k[0] + a3 * k[3] + a4 * k[4] + a5 * k[5])
    contract.flow(engine, mode, min(t + C[6] * h, limit), y, slope)
    a0, a3, a4, a5, a6 = A[7]
    for j in range(n):
        k = component(engine, j)
        k[6] = slope[j]
        y[j] = start[j] + h * (a0 * k[0] + a3 * k[3] + a4 * k[4] + a5 * k[5] + a6 * k[6])
    contract.flow(engine, mode, min(t + C[7] * h, limit), y, slope)
    a0, a3, a4, a5, a6, a7 = A[8]
    for j in range(n):
        k = component(engine, j)
        k[7] = slope[j]
        y[j] = start[j] + h * (
            a0 * k[0] + a3 * k[3] + a4 * k[4] + a5 * k[5] + a6 * k[6] + a7 * k[7]
        )
    contract.flow(engine, mode, min(t + C[8] * h, limit), y, slope)
    a0, a3, a4, a5, a6, a7, a8 = A[9]
    for j in range(n):
        k = component(engine, j)
        k[8] = slope[j]
        y[j] = start[j] + h * (
            a0 * k[0] + a3 * k[3] + a4 * k[4] + a5 * k[5] + a6 * k[6] + a7 * k[7] + a8 * k[8]
        )
    contract.flow(engine, mode, min(t + C[9] * h, limit), y, slope)
    a0, a3, a4, a5, a6, a7, a8, a9 = A[10]
    for j in range(n):
        k = component(engine, j)
        k[9] = slope[j]
        y[j] = start[j] + h * (
            a0 * k[0] + a3 * k[3] + a4 * k[4] + a5 * k[5] + a6 * k[6] + a7 * k[7] + a8 * k[8]
            + a9 * k[9]
        )
    contract.flow(engine, mode, min(t + C[10] * h, limit), y, slope)
    a0, a3, a4, a5, a6, a7, a8, a9, a10 = A[11]
    for j in range(n):
        k = component(engine, j)
        k[10] = slope[j]
        y[j] = start[j] + h * (
            a0 * k[0] + a3 * k[3] + a4 * k[4] + a5 * k[5] + a6 * k[6] + a7 * k[7] + a8 * k[8]
            + a9 * k[9] + a10 * k[10]
        )
    contract.flow(engine, mode, min(t + C[11] * h, limit), y, slope)
    b0, b5, b6, b7, b8, b9, b10, b11 = A[12]
    e0, e5, e6, e7, e8, e9, e10, e11 = ERROR_5
    w0, w8, w11 = WEIGHTS_3
    error_5, error_3, probe = 0.0, 0.0, 0.0
    for j in range(n):
        k = component(engine, j)
        k[11] = slope[j]
        mean = (
            b0 * k[0] + b5 * k[5] + b6 * k[6] + b7 * k[7] + b8 * k[8] + b9 * k[9] + b10 * k[10]
            + b11 * k[11]
        )
        end[j] = start[j] + h * mean
        scale = atol + rtol * max(abs(start[j]), abs(end[j]))
        difference = (
            e0 * k[0] + e5 * k[5] + e6 * k[6] + e7 * k[7] + e8 * k[8] + e9 * k[9] + e10 * k[10]
            + e11 * k[11]
        ) / scale
        error_5 += difference * difference
        difference = (mean - (w0 * k[0] + w8 * k[8] + w11 * k[11])) / scale
        error_3 += difference * difference
        # Slopes that have no weight of their own.
        probe += k[1] + k[2] + k[3] + k[4]
    # fmt: on
    total = error_5 + 0.01 * error_3
    if total == 0.0:
        total = 1.0
    return abs(h) * error_5 / math.sqrt(n * total) + 0.0 * probe


def dense(engine: Any) -> None:
    """Compute the coefficients of the dense output of the last step, by three more slopes."""
    n, mode, limit = engine.n, engine.mode, engine.last_instant
    t, h = engine.t_start, engine.t_end - engine.t_start
    y, slope = row(engine, ARGUMENT), row(engine, SLOPE)
    start, end = row(engine, START), row(engine, END)
    # fmt: off
    a0, a6, a7, a8, a9, a10, a11, a12 = A[13]
    for j in range(n):
        k = component(engine, j)
        y[j] = start[j] + h * (
            a0 * k[0] + a6 * k[6] + a7 * k[7] + a8 * k[8] + a9 * k[9] + a10 * k[10] + a11 * k[11]
            + a12 * k[12]
        )
    contract.flow(engine, mode, min(t + C[13] * h, limit), y, slope)
    a0, a5, a6, a7, a10, a11, a12, a13 = A[14]
    for j in range(n):
        k = component(engine, j)
        k[13] = slope[j]
        y[j] = start[j] + h * (
            a0 * k[0] + a5 * k[5] + a6 * k[6] + a7 * k[7] + a10 * k[10] + a11 * k[11]
            + a12 * k[12] + a13 * k[13]
        )
    contract.flow(engine, mode, min(t + C[14] * h, limit), y, slope)
    a0, a5, a6, a7, a8, a12, a13, a14 = A[15]
    for j in range(n):
        k = component(engine, j)
        k[14] = slope[j]
        y[j] = start[j] + h * (
            a0 * k[0] + a5 * k[5] + a6 * k[6] + a7 * k[7] + a8 * k[8] + a12 * k[12] + a13 * k[13]
            + a14 * k[14]
        )
    contract.flow(engine, mode, min(t + C[15] * h, limit), y, slope)
    for j in range(n):
        k = component(engine, j)
        k[15] = slope[j]
        rise = end[j] - start[j]
        k[DENSE] = rise
        k[DENSE + 1] = h * k[0] - rise
        k[DENSE + 2] = 2.0 * rise - h * (k[12] + k[0])
    d0, d5, d6, d7, d8, d9, d10, d11, d12, d13, d14, d15 = D[0]
    for j in range(n):
        k = component(engine, j)
        k[DENSE + 3] = h * (
            d0 * k[0] + d5 * k[5] + d6 * k[6] + d7 * k[7] + d8 * k[8] + d9 * k[9] + d10 * k[10]
            + d11 * k[11] + d12 * k[12] + d13 * k[13] + d14 * k[14] + d15 * k[15]
        )
    d0, d5, d6, d7, d8, d9, d10, d11, d12, d13, d14, d15 = D[1]
    for j in range(n):
        k = component(engine, j)
        k[DENSE + 4] = h * (
            d0 * k[0] + d5 * k[5] + d6 * k[6] + d7 * k[7] + d8 * k[8] + d9 * k[9] + d10 * k[10]
            + d11 * k[11] + d12 * k[12] + d13 * k[13] + d14 * k[14] + d15 * k[15]
        )
    d0, d5, d6, d7, d8, d9, d10, d11, d12, d13, d14, d15 = D[2]
    for j in range(n):
        k = component(engine, j)
        k[DENSE + 5] = h * (
            d0 * k[0] + d5 * k[5] + d6 * k[6] + d7 * k[7] + d8 * k[8] + d9 * k[9] + d10 * k[10]
            + d11 * k[11] + d12 * k[12] + d13 * k[13] + d14 * k[14] + d15 * k[15]
        )
    d0, d5, d6, d7, d8, d9, d10, d11, d12, d13, d14, d15 = D[3]
    for j in range(n):
        k = component(engine, j)
        k[DENSE + 6] = h * (
            d0 * k[0] + d5 * k[5] + d6 * k[6] + d7 * k[7] + d8 * k[8] + d9 * k[9] + d10 * k[10]
            + d11 * k[11] + d12 * k[12] + d13 * k[13] + d14 * k[14] + d15 * k[15]
        )
    # fmt: on


def try_step(engine: Any, t: float, h: float) -> float:
    """Call `stages`, which compiled code has as a C function, as it has `dense`."""
    return stages(engine, t, h)


def make_dense(engine: Any) -> None:
    """Call `dense`."""
    dense(engine)


def slope_at_end(engine: Any, t: float) -> bool:
    """Evaluate slope 12, that at END and time `t`; return whether it is finite."""
    slope = row(engine, SLOPE)
    contract.flow(engine, engine.mode, min(t, engine.last_instant), row(engine, END), slope)
    total = 0.0
    for j in range(engine.n):
        component(engine, j)[12] = slope[j]
        total += abs(slope[j])
    return math.isfinite(total)


def stretched(engine: Any, h: float) -> float:
    """Return h times Hairer's estimate of the largest eigenvalue, from slopes 11 and 12.

    Both belong to the end of the step, to the state of ARGUMENT and to END.
    """
    y, end = row(engine, ARGUMENT), row(engine, END)
    slopes, states = 0.0, 0.0
    for j in range(engine.n):
        k = component(engine, j)
        slopes += (k[12] - k[11]) * (k[12] - k[11])
        states += (end[j] - y[j]) * (end[j] - y[j])
    return abs(h) * math.sqrt(slopes / states) if states > 0.0 else 0.0


def dense_at(engine: Any, t: float, y: Any) -> None:
    """Write the state at `t` within the last step into `y`; beyond the step its ends."""
    start, end = row(engine, START), row(engine, END)
    inside = engine.t_start < t < engine.t_end
    if not inside:
        for j in range(engine.n):
            y[j] = start[j] if t <= engine.t_start else end[j]
        return
    if engine.has_dense == 0:
        engine.has_dense = 1
        make_dense(engine)
    u = (t - engine.t_start) / (engine.t_end - engine.t_start)
    v = 1.0 - u
    for j in range(engine.n):
        k = component(engine, j)
        inner = k[DENSE + 3] + u * (k[DENSE + 4] + v * (k[DENSE + 5] + u * k[DENSE + 6]))
        y[j] = start[j] + u * (k[DENSE] + v * (k[DENSE + 1] + u * (k[DENSE + 2] + v * inner)))
