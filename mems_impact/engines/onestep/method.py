"""One step of the method: stages, error estimate, dense output.

Like the loop, this is one text for both engines: `arc.flow` calls the automaton, and the rows of
the engine's table are lists in Python and pointers in compiled code.
"""

from __future__ import annotations

import math
from typing import Any

from mems_impact.engines import contract as arc
from mems_impact.engines.onestep.tableau import ERROR_5, WEIGHTS_3, A, C, D

# Rows of the table. The first 16 are the stages, slopes at the places C of the step.
STAGES = 16
ARGUMENT = 16  # state at which a stage is evaluated
START, END = 17, 18  # states between which the step goes
DENSE = 19  # seven rows of coefficients
STATE = 26  # what `state` answers
LOW, HIGH = 27, 28  # root functions where they are looked for from, and at the end of the step
SPARE = 29  # three rows of root functions while a root is closed in
ROWS = 32


def row(engine: Any, i: int) -> Any:
    """Return row `i` of the table."""
    return engine.rows[i]


def set_fired(engine: Any, i: int, direction: int) -> None:
    """Say that root function `i` has crossed zero in `direction`, or not (0)."""
    engine.crossings[i] = direction


def stages(engine: Any, t: float, h: float) -> float:
    """Fill rows 1 to 11 and END by a step from (t, START); return its error in tolerances.

    Row 0 must hold the slope there. The error estimate is that of DOP853, of order 7: it combines
    two embedded methods, of orders 5 and 3. It is not finite where a stage was not.
    """
    n, mode, limit = engine.n, engine.mode, engine.last_instant
    rtol, atol = engine.rtol, engine.atol
    y, start, end = row(engine, ARGUMENT), row(engine, START), row(engine, END)
    k0, k1, k2, k3, k4, k5 = (
        row(engine, 0),
        row(engine, 1),
        row(engine, 2),
        row(engine, 3),
        row(engine, 4),
        row(engine, 5),
    )
    k6, k7, k8, k9, k10, k11 = (
        row(engine, 6),
        row(engine, 7),
        row(engine, 8),
        row(engine, 9),
        row(engine, 10),
        row(engine, 11),
    )
    (a0,) = A[1]
    for j in range(n):
        y[j] = start[j] + h * a0 * k0[j]
    arc.flow(engine, mode, min(t + C[1] * h, limit), y, k1)
    a0, a1 = A[2]
    for j in range(n):
        y[j] = start[j] + h * (a0 * k0[j] + a1 * k1[j])
    arc.flow(engine, mode, min(t + C[2] * h, limit), y, k2)
    a0, a2 = A[3]
    for j in range(n):
        y[j] = start[j] + h * (a0 * k0[j] + a2 * k2[j])
    arc.flow(engine, mode, min(t + C[3] * h, limit), y, k3)
    a0, a2, a3 = A[4]
    for j in range(n):
        y[j] = start[j] + h * (a0 * k0[j] + a2 * k2[j] + a3 * k3[j])
    arc.flow(engine, mode, min(t + C[4] * h, limit), y, k4)
    a0, a3, a4 = A[5]
    for j in range(n):
        y[j] = start[j] + h * (a0 * k0[j] + a3 * k3[j] + a4 * k4[j])
    arc.flow(engine, mode, min(t + C[5] * h, limit), y, k5)
    a0, a3, a4, a5 = A[6]
    for j in range(n):
        y[j] = start[j] + h * (a0 * k0[j] + a3 * k3[j] + a4 * k4[j] + a5 * k5[j])
    arc.flow(engine, mode, min(t + C[6] * h, limit), y, k6)
    a0, a3, a4, a5, a6 = A[7]
    for j in range(n):
        y[j] = start[j] + h * (a0 * k0[j] + a3 * k3[j] + a4 * k4[j] + a5 * k5[j] + a6 * k6[j])
    arc.flow(engine, mode, min(t + C[7] * h, limit), y, k7)
    a0, a3, a4, a5, a6, a7 = A[8]
    for j in range(n):
        y[j] = start[j] + h * (
            a0 * k0[j] + a3 * k3[j] + a4 * k4[j] + a5 * k5[j] + a6 * k6[j] + a7 * k7[j]
        )
    arc.flow(engine, mode, min(t + C[8] * h, limit), y, k8)
    a0, a3, a4, a5, a6, a7, a8 = A[9]
    for j in range(n):
        y[j] = start[j] + h * (
            a0 * k0[j] + a3 * k3[j] + a4 * k4[j] + a5 * k5[j] + a6 * k6[j] + a7 * k7[j] + a8 * k8[j]
        )
    arc.flow(engine, mode, min(t + C[9] * h, limit), y, k9)
    a0, a3, a4, a5, a6, a7, a8, a9 = A[10]
    for j in range(n):
        y[j] = start[j] + h * (
            a0 * k0[j]
            + a3 * k3[j]
            + a4 * k4[j]
            + a5 * k5[j]
            + a6 * k6[j]
            + a7 * k7[j]
            + a8 * k8[j]
            + a9 * k9[j]
        )
    arc.flow(engine, mode, min(t + C[10] * h, limit), y, k10)
    a0, a3, a4, a5, a6, a7, a8, a9, a10 = A[11]
    for j in range(n):
        y[j] = start[j] + h * (
            a0 * k0[j]
            + a3 * k3[j]
            + a4 * k4[j]
            + a5 * k5[j]
            + a6 * k6[j]
            + a7 * k7[j]
            + a8 * k8[j]
            + a9 * k9[j]
            + a10 * k10[j]
        )
    arc.flow(engine, mode, min(t + C[11] * h, limit), y, k11)
    b0, b5, b6, b7, b8, b9, b10, b11 = A[12]
    e0, e5, e6, e7, e8, e9, e10, e11 = ERROR_5
    w0, w8, w11 = WEIGHTS_3
    error_5, error_3, probe = 0.0, 0.0, 0.0
    for j in range(n):
        slope = (
            b0 * k0[j]
            + b5 * k5[j]
            + b6 * k6[j]
            + b7 * k7[j]
            + b8 * k8[j]
            + b9 * k9[j]
            + b10 * k10[j]
            + b11 * k11[j]
        )
        end[j] = start[j] + h * slope
        scale = atol + rtol * max(abs(start[j]), abs(end[j]))
        difference = (
            e0 * k0[j]
            + e5 * k5[j]
            + e6 * k6[j]
            + e7 * k7[j]
            + e8 * k8[j]
            + e9 * k9[j]
            + e10 * k10[j]
            + e11 * k11[j]
        ) / scale
        error_5 += difference * difference
        difference = (slope - (w0 * k0[j] + w8 * k8[j] + w11 * k11[j])) / scale
        error_3 += difference * difference
        # Stages that have no weight of their own.
        probe += k1[j] + k2[j] + k3[j] + k4[j]
    total = error_5 + 0.01 * error_3
    if total == 0.0:
        total = 1.0
    return abs(h) * error_5 / math.sqrt(n * total) + 0.0 * probe


def try_step(engine: Any, t: float, h: float) -> float:
    """Call `stages`, which compiled code has as a C function, as it has `dense`."""
    return stages(engine, t, h)


def make_dense(engine: Any) -> None:
    """Call `dense`."""
    dense(engine)


def slope_at_end(engine: Any, t: float) -> bool:
    """Evaluate stage 12, the slope at END and time `t`; return whether it is finite."""
    k12 = row(engine, 12)
    arc.flow(engine, engine.mode, min(t, engine.last_instant), row(engine, END), k12)
    total = 0.0
    for j in range(engine.n):
        total += abs(k12[j])
    return math.isfinite(total)


def stretched(engine: Any, h: float) -> float:
    """Return h times Hairer's estimate of the largest eigenvalue, from stages 11 and 12.

    Both are slopes at the end of the step, at the state of ARGUMENT and at END.
    """
    k11, k12, y, end = row(engine, 11), row(engine, 12), row(engine, ARGUMENT), row(engine, END)
    slopes, states = 0.0, 0.0
    for j in range(engine.n):
        slopes += (k12[j] - k11[j]) * (k12[j] - k11[j])
        states += (end[j] - y[j]) * (end[j] - y[j])
    return abs(h) * math.sqrt(slopes / states) if states > 0.0 else 0.0


def dense(engine: Any) -> None:
    """Compute the coefficients of the dense output of the last step, by three more stages."""
    n, mode, limit = engine.n, engine.mode, engine.last_instant
    t, h = engine.t_start, engine.t_end - engine.t_start
    y, start, end = row(engine, ARGUMENT), row(engine, START), row(engine, END)
    k0, k5, k6, k7, k8, k9 = (
        row(engine, 0),
        row(engine, 5),
        row(engine, 6),
        row(engine, 7),
        row(engine, 8),
        row(engine, 9),
    )
    k10, k11, k12, k13, k14, k15 = (
        row(engine, 10),
        row(engine, 11),
        row(engine, 12),
        row(engine, 13),
        row(engine, 14),
        row(engine, 15),
    )
    f0, f1, f2, f3 = (
        row(engine, DENSE),
        row(engine, DENSE + 1),
        row(engine, DENSE + 2),
        row(engine, DENSE + 3),
    )
    f4, f5, f6 = row(engine, DENSE + 4), row(engine, DENSE + 5), row(engine, DENSE + 6)
    a0, a6, a7, a8, a9, a10, a11, a12 = A[13]
    for j in range(n):
        y[j] = start[j] + h * (
            a0 * k0[j]
            + a6 * k6[j]
            + a7 * k7[j]
            + a8 * k8[j]
            + a9 * k9[j]
            + a10 * k10[j]
            + a11 * k11[j]
            + a12 * k12[j]
        )
    arc.flow(engine, mode, min(t + C[13] * h, limit), y, k13)
    a0, a5, a6, a7, a10, a11, a12, a13 = A[14]
    for j in range(n):
        y[j] = start[j] + h * (
            a0 * k0[j]
            + a5 * k5[j]
            + a6 * k6[j]
            + a7 * k7[j]
            + a10 * k10[j]
            + a11 * k11[j]
            + a12 * k12[j]
            + a13 * k13[j]
        )
    arc.flow(engine, mode, min(t + C[14] * h, limit), y, k14)
    a0, a5, a6, a7, a8, a12, a13, a14 = A[15]
    for j in range(n):
        y[j] = start[j] + h * (
            a0 * k0[j]
            + a5 * k5[j]
            + a6 * k6[j]
            + a7 * k7[j]
            + a8 * k8[j]
            + a12 * k12[j]
            + a13 * k13[j]
            + a14 * k14[j]
        )
    arc.flow(engine, mode, min(t + C[15] * h, limit), y, k15)
    for j in range(n):
        rise = end[j] - start[j]
        f0[j] = rise
        f1[j] = h * k0[j] - rise
        f2[j] = 2.0 * rise - h * (k12[j] + k0[j])
    d0, d5, d6, d7, d8, d9, d10, d11, d12, d13, d14, d15 = D[0]
    for j in range(n):
        f3[j] = h * (
            d0 * k0[j]
            + d5 * k5[j]
            + d6 * k6[j]
            + d7 * k7[j]
            + d8 * k8[j]
            + d9 * k9[j]
            + d10 * k10[j]
            + d11 * k11[j]
            + d12 * k12[j]
            + d13 * k13[j]
            + d14 * k14[j]
            + d15 * k15[j]
        )
    d0, d5, d6, d7, d8, d9, d10, d11, d12, d13, d14, d15 = D[1]
    for j in range(n):
        f4[j] = h * (
            d0 * k0[j]
            + d5 * k5[j]
            + d6 * k6[j]
            + d7 * k7[j]
            + d8 * k8[j]
            + d9 * k9[j]
            + d10 * k10[j]
            + d11 * k11[j]
            + d12 * k12[j]
            + d13 * k13[j]
            + d14 * k14[j]
            + d15 * k15[j]
        )
    d0, d5, d6, d7, d8, d9, d10, d11, d12, d13, d14, d15 = D[2]
    for j in range(n):
        f5[j] = h * (
            d0 * k0[j]
            + d5 * k5[j]
            + d6 * k6[j]
            + d7 * k7[j]
            + d8 * k8[j]
            + d9 * k9[j]
            + d10 * k10[j]
            + d11 * k11[j]
            + d12 * k12[j]
            + d13 * k13[j]
            + d14 * k14[j]
            + d15 * k15[j]
        )
    d0, d5, d6, d7, d8, d9, d10, d11, d12, d13, d14, d15 = D[3]
    for j in range(n):
        f6[j] = h * (
            d0 * k0[j]
            + d5 * k5[j]
            + d6 * k6[j]
            + d7 * k7[j]
            + d8 * k8[j]
            + d9 * k9[j]
            + d10 * k10[j]
            + d11 * k11[j]
            + d12 * k12[j]
            + d13 * k13[j]
            + d14 * k14[j]
            + d15 * k15[j]
        )


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
    f0, f1, f2, f3 = (
        row(engine, DENSE),
        row(engine, DENSE + 1),
        row(engine, DENSE + 2),
        row(engine, DENSE + 3),
    )
    f4, f5, f6 = row(engine, DENSE + 4), row(engine, DENSE + 5), row(engine, DENSE + 6)
    u = (t - engine.t_start) / (engine.t_end - engine.t_start)
    v = 1.0 - u
    for j in range(engine.n):
        inner = f3[j] + u * (f4[j] + v * (f5[j] + u * f6[j]))
        y[j] = start[j] + u * (f0[j] + v * (f1[j] + u * (f2[j] + v * inner)))
