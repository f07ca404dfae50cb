"""One step of the method: stages, error estimate, dense output.

Like the loop, this is one text for both engines: `arc.flow` calls the automaton, and the rows of
the table `w` are lists in Python and arrays in compiled code.
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


def set_fired(engine: Any, i: int, direction: int) -> None:
    """Say that root function `i` has crossed zero in `direction`, or not (0)."""
    engine.crossings[i] = direction


def try_step(engine: Any, w: Any, t: float, h: float) -> float:
    """Fill rows 1 to 11 and END by a step from (t, START); return its error in tolerances.

    Row 0 must hold the slope there. The error estimate is that of DOP853, of order 7: it combines
    two embedded methods, of orders 5 and 3. It is not finite where a stage was not.
    """
    n, mode, limit = engine.n, engine.mode, engine.last_instant
    rtol, atol = engine.rtol, engine.atol
    y, start, end = w[ARGUMENT], w[START], w[END]
    k0, k1, k2, k3, k4, k5 = w[0], w[1], w[2], w[3], w[4], w[5]
    k6, k7, k8, k9, k10, k11 = w[6], w[7], w[8], w[9], w[10], w[11]
    for j in range(n):
        y[j] = start[j] + h * A[1][0] * k0[j]
    arc.flow(engine, mode, min(t + C[1] * h, limit), y, k1)
    for j in range(n):
        y[j] = start[j] + h * (A[2][0] * k0[j] + A[2][1] * k1[j])
    arc.flow(engine, mode, min(t + C[2] * h, limit), y, k2)
    for j in range(n):
        y[j] = start[j] + h * (A[3][0] * k0[j] + A[3][2] * k2[j])
    arc.flow(engine, mode, min(t + C[3] * h, limit), y, k3)
    for j in range(n):
        y[j] = start[j] + h * (A[4][0] * k0[j] + A[4][2] * k2[j] + A[4][3] * k3[j])
    arc.flow(engine, mode, min(t + C[4] * h, limit), y, k4)
    for j in range(n):
        y[j] = start[j] + h * (A[5][0] * k0[j] + A[5][3] * k3[j] + A[5][4] * k4[j])
    arc.flow(engine, mode, min(t + C[5] * h, limit), y, k5)
    for j in range(n):
        y[j] = start[j] + h * (
            A[6][0] * k0[j] + A[6][3] * k3[j] + A[6][4] * k4[j] + A[6][5] * k5[j]
        )
    arc.flow(engine, mode, min(t + C[6] * h, limit), y, k6)
    for j in range(n):
        y[j] = start[j] + h * (
            A[7][0] * k0[j] + A[7][3] * k3[j] + A[7][4] * k4[j] + A[7][5] * k5[j] + A[7][6] * k6[j]
        )
    arc.flow(engine, mode, min(t + C[7] * h, limit), y, k7)
    for j in range(n):
        y[j] = start[j] + h * (
            A[8][0] * k0[j]
            + A[8][3] * k3[j]
            + A[8][4] * k4[j]
            + A[8][5] * k5[j]
            + A[8][6] * k6[j]
            + A[8][7] * k7[j]
        )
    arc.flow(engine, mode, min(t + C[8] * h, limit), y, k8)
    for j in range(n):
        y[j] = start[j] + h * (
            A[9][0] * k0[j]
            + A[9][3] * k3[j]
            + A[9][4] * k4[j]
            + A[9][5] * k5[j]
            + A[9][6] * k6[j]
            + A[9][7] * k7[j]
            + A[9][8] * k8[j]
        )
    arc.flow(engine, mode, min(t + C[9] * h, limit), y, k9)
    for j in range(n):
        y[j] = start[j] + h * (
            A[10][0] * k0[j]
            + A[10][3] * k3[j]
            + A[10][4] * k4[j]
            + A[10][5] * k5[j]
            + A[10][6] * k6[j]
            + A[10][7] * k7[j]
            + A[10][8] * k8[j]
            + A[10][9] * k9[j]
        )
    arc.flow(engine, mode, min(t + C[10] * h, limit), y, k10)
    for j in range(n):
        y[j] = start[j] + h * (
            A[11][0] * k0[j]
            + A[11][3] * k3[j]
            + A[11][4] * k4[j]
            + A[11][5] * k5[j]
            + A[11][6] * k6[j]
            + A[11][7] * k7[j]
            + A[11][8] * k8[j]
            + A[11][9] * k9[j]
            + A[11][10] * k10[j]
        )
    arc.flow(engine, mode, min(t + C[11] * h, limit), y, k11)
    error_5, error_3, probe = 0.0, 0.0, 0.0
    for j in range(n):
        slope = (
            A[12][0] * k0[j]
            + A[12][5] * k5[j]
            + A[12][6] * k6[j]
            + A[12][7] * k7[j]
            + A[12][8] * k8[j]
            + A[12][9] * k9[j]
            + A[12][10] * k10[j]
            + A[12][11] * k11[j]
        )
        end[j] = start[j] + h * slope
        scale = atol + rtol * max(abs(start[j]), abs(end[j]))
        difference = (
            ERROR_5[0] * k0[j]
            + ERROR_5[5] * k5[j]
            + ERROR_5[6] * k6[j]
            + ERROR_5[7] * k7[j]
            + ERROR_5[8] * k8[j]
            + ERROR_5[9] * k9[j]
            + ERROR_5[10] * k10[j]
            + ERROR_5[11] * k11[j]
        )
        error_5 += (difference / scale) * (difference / scale)
        difference = slope - (WEIGHTS_3[0] * k0[j] + WEIGHTS_3[1] * k8[j] + WEIGHTS_3[2] * k11[j])
        error_3 += (difference / scale) * (difference / scale)
        # Stages that have no weight of their own.
        probe += k1[j] + k2[j] + k3[j] + k4[j]
    total = error_5 + 0.01 * error_3
    if total == 0.0:
        total = 1.0
    return abs(h) * error_5 / math.sqrt(n * total) + 0.0 * probe


def slope_at_end(engine: Any, w: Any, t: float) -> bool:
    """Evaluate stage 12, the slope at END and time `t`; return whether it is finite."""
    k12 = w[12]
    arc.flow(engine, engine.mode, min(t, engine.last_instant), w[END], k12)
    total = 0.0
    for j in range(engine.n):
        total += abs(k12[j])
    return math.isfinite(total)


def stretched(engine: Any, w: Any, h: float) -> float:
    """Return h times Hairer's estimate of the largest eigenvalue, from stages 11 and 12.

    Both are slopes at the end of the step, at the state of ARGUMENT and at END.
    """
    k11, k12, y, end = w[11], w[12], w[ARGUMENT], w[END]
    slopes, states = 0.0, 0.0
    for j in range(engine.n):
        slopes += (k12[j] - k11[j]) * (k12[j] - k11[j])
        states += (end[j] - y[j]) * (end[j] - y[j])
    return abs(h) * math.sqrt(slopes / states) if states > 0.0 else 0.0


def make_dense(engine: Any, w: Any) -> None:
    """Compute the dense output of the last step, once."""
    if engine.dense == 1:
        return
    engine.dense = 1
    n, mode, limit = engine.n, engine.mode, engine.last_instant
    t, h = engine.t_start, engine.t_end - engine.t_start
    y, start, end = w[ARGUMENT], w[START], w[END]
    k0, k5, k6, k7, k8, k9 = w[0], w[5], w[6], w[7], w[8], w[9]
    k10, k11, k12, k13, k14, k15 = w[10], w[11], w[12], w[13], w[14], w[15]
    f0, f1, f2, f3 = w[DENSE], w[DENSE + 1], w[DENSE + 2], w[DENSE + 3]
    f4, f5, f6 = w[DENSE + 4], w[DENSE + 5], w[DENSE + 6]
    for j in range(n):
        y[j] = start[j] + h * (
            A[13][0] * k0[j]
            + A[13][6] * k6[j]
            + A[13][7] * k7[j]
            + A[13][8] * k8[j]
            + A[13][9] * k9[j]
            + A[13][10] * k10[j]
            + A[13][11] * k11[j]
            + A[13][12] * k12[j]
        )
    arc.flow(engine, mode, min(t + C[13] * h, limit), y, k13)
    for j in range(n):
        y[j] = start[j] + h * (
            A[14][0] * k0[j]
            + A[14][5] * k5[j]
            + A[14][6] * k6[j]
            + A[14][7] * k7[j]
            + A[14][10] * k10[j]
            + A[14][11] * k11[j]
            + A[14][12] * k12[j]
            + A[14][13] * k13[j]
        )
    arc.flow(engine, mode, min(t + C[14] * h, limit), y, k14)
    for j in range(n):
        y[j] = start[j] + h * (
            A[15][0] * k0[j]
            + A[15][5] * k5[j]
            + A[15][6] * k6[j]
            + A[15][7] * k7[j]
            + A[15][8] * k8[j]
            + A[15][12] * k12[j]
            + A[15][13] * k13[j]
            + A[15][14] * k14[j]
        )
    arc.flow(engine, mode, min(t + C[15] * h, limit), y, k15)
    for j in range(n):
        rise = end[j] - start[j]
        f0[j] = rise
        f1[j] = h * k0[j] - rise
        f2[j] = 2.0 * rise - h * (k12[j] + k0[j])
        f3[j] = h * (
            D[0][0] * k0[j]
            + D[0][5] * k5[j]
            + D[0][6] * k6[j]
            + D[0][7] * k7[j]
            + D[0][8] * k8[j]
            + D[0][9] * k9[j]
            + D[0][10] * k10[j]
            + D[0][11] * k11[j]
            + D[0][12] * k12[j]
            + D[0][13] * k13[j]
            + D[0][14] * k14[j]
            + D[0][15] * k15[j]
        )
        f4[j] = h * (
            D[1][0] * k0[j]
            + D[1][5] * k5[j]
            + D[1][6] * k6[j]
            + D[1][7] * k7[j]
            + D[1][8] * k8[j]
            + D[1][9] * k9[j]
            + D[1][10] * k10[j]
            + D[1][11] * k11[j]
            + D[1][12] * k12[j]
            + D[1][13] * k13[j]
            + D[1][14] * k14[j]
            + D[1][15] * k15[j]
        )
        f5[j] = h * (
            D[2][0] * k0[j]
            + D[2][5] * k5[j]
            + D[2][6] * k6[j]
            + D[2][7] * k7[j]
            + D[2][8] * k8[j]
            + D[2][9] * k9[j]
            + D[2][10] * k10[j]
            + D[2][11] * k11[j]
            + D[2][12] * k12[j]
            + D[2][13] * k13[j]
            + D[2][14] * k14[j]
            + D[2][15] * k15[j]
        )
        f6[j] = h * (
            D[3][0] * k0[j]
            + D[3][5] * k5[j]
            + D[3][6] * k6[j]
            + D[3][7] * k7[j]
            + D[3][8] * k8[j]
            + D[3][9] * k9[j]
            + D[3][10] * k10[j]
            + D[3][11] * k11[j]
            + D[3][12] * k12[j]
            + D[3][13] * k13[j]
            + D[3][14] * k14[j]
            + D[3][15] * k15[j]
        )


def dense_at(engine: Any, w: Any, t: float, y: Any) -> None:
    """Write the state at `t` within the last step into `y`; beyond the step its ends."""
    start, end = w[START], w[END]
    inside = engine.t_start < t < engine.t_end
    if not inside:
        for j in range(engine.n):
            y[j] = start[j] if t <= engine.t_start else end[j]
        return
    make_dense(engine, w)
    f0, f1, f2, f3 = w[DENSE], w[DENSE + 1], w[DENSE + 2], w[DENSE + 3]
    f4, f5, f6 = w[DENSE + 4], w[DENSE + 5], w[DENSE + 6]
    u = (t - engine.t_start) / (engine.t_end - engine.t_start)
    v = 1.0 - u
    for j in range(engine.n):
        inner = f3[j] + u * (f4[j] + v * (f5[j] + u * f6[j]))
        y[j] = start[j] + u * (f0[j] + v * (f1[j] + u * (f2[j] + v * inner)))
