"""DOP853: tableau, step, dense output, root finding and step size control.

As published with the code DOP853 of E. Hairer and G. Wanner (E. Hairer, S. P. Norsett, G. Wanner,
"Solving Ordinary Differential Equations I", second edition, Section II.5), rounded to doubles.
`tests/integrators/dop853/test_order.py` checks the order conditions of all coefficients.

Stages are numbered from zero. Stage 12 is the slope at the end of the step, the first stage of the
next step; 13 to 15 serve the dense output only. Only nonzero coefficients are listed.

The source is common to the interpreted and the compiled engine: `interface.flow` calls the
automaton, and `row` and `component` return lists in Python and pointers in compiled code.

A row of root functions has 2 m + 1 values at one instant: the margins without bias, their rates,
the section. A margin fires if it (with its bias) decreases to zero or below, a rate if it increases
to zero or above; a function that starts at zero and remains there does not fire. Rates are searched
where a closest approach is an event, or a bias hides the margin (`searches_rate`).

`step`, `restart`, `lengthen`, `reset` and `interpolate` implement `integrators.interface`.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mems_impact.integrators import interface
from mems_impact.integrators.interface import COLUMN_WEIGHT

# --- Coefficients of Dormand and Prince's method of order 8 with dense output of order 7

# fmt: off

# Nodes of the stages.
C = (
    0.0, 0.05260015195876773, 0.0789002279381516, 0.1183503419072274, 0.2816496580927726,
    0.3333333333333333, 0.25, 0.3076923076923077, 0.6512820512820513, 0.6, 0.8571428571428571, 1.0,
    1.0, 0.1, 0.2, 0.7777777777777778,
)

# Stages with nonzero weights in stage i, and the weights. Row 12 has the weights of the method.
STAGES = (
    (),
    (0,),
    (0, 1),
    (0, 2),
    (0, 2, 3),
    (0, 3, 4),
    (0, 3, 4, 5),
    (0, 3, 4, 5, 6),
    (0, 3, 4, 5, 6, 7),
    (0, 3, 4, 5, 6, 7, 8),
    (0, 3, 4, 5, 6, 7, 8, 9),
    (0, 3, 4, 5, 6, 7, 8, 9, 10),
    (0, 5, 6, 7, 8, 9, 10, 11),
    (0, 6, 7, 8, 9, 10, 11, 12),
    (0, 5, 6, 7, 10, 11, 12, 13),
    (0, 5, 6, 7, 8, 12, 13, 14),
)
A = (
    (),
    (0.05260015195876773,),
    (
        0.0197250569845379, 0.0591751709536137,
    ),
    (
        0.02958758547680685, 0.08876275643042054,
    ),
    (
        0.2413651341592667, -0.8845494793282861, 0.924834003261792,
    ),
    (
        0.037037037037037035, 0.17082860872947386, 0.12546768756682242,
    ),
    (
        0.037109375, 0.17025221101954405, 0.06021653898045596, -0.017578125,
    ),
    (
        0.03709200011850479, 0.17038392571223998, 0.10726203044637328, -0.015319437748624402,
        0.008273789163814023,
    ),
    (
        0.6241109587160757, -3.3608926294469414, -0.868219346841726, 27.59209969944671,
        20.154067550477894, -43.48988418106996,
    ),
    (
        0.47766253643826434, -2.4881146199716677, -0.590290826836843, 21.230051448181193,
        15.279233632882423, -33.28821096898486, -0.020331201708508627,
    ),
    (
        -0.9371424300859873, 5.186372428844064, 1.0914373489967295, -8.149787010746927,
        -18.52006565999696, 22.739487099350505, 2.4936055526796523, -3.0467644718982196,
    ),
    (
        2.273310147516538, -10.53449546673725, -2.0008720582248625, -17.9589318631188,
        27.94888452941996, -2.8589982771350235, -8.87285693353063, 12.360567175794303,
        0.6433927460157636,
    ),
    (
        0.054293734116568765, 4.450312892752409, 1.8915178993145003, -5.801203960010585,
        0.3111643669578199, -0.1521609496625161, 0.20136540080403034, 0.04471061572777259,
    ),
    (
        0.056167502283047954, 0.25350021021662483, -0.2462390374708025, -0.12419142326381637,
        0.15329179827876568, 0.00820105229563469, 0.007567897660545699, -0.008298,
    ),
    (
        0.03183464816350214, 0.028300909672366776, 0.053541988307438566, -0.05492374857139099,
        -0.00010834732869724932, 0.0003825710908356584, -0.00034046500868740456,
        0.1413124436746325,
    ),
    (
        -0.42889630158379194, -4.697621415361164, 7.683421196062599, 4.06898981839711,
        0.3567271874552811, -0.0013990241651590145, 2.9475147891527724, -9.15095847217987,
    ),
)

# The difference from the embedded method of order 5, on the stages of row 12.
ERROR_5 = (
    0.01312004499419488, -1.2251564463762044, -0.4957589496572502, 1.6643771824549864,
    -0.35032884874997366, 0.3341791187130175, 0.08192320648511571, -0.022355307863886294,
)
# Weights of the embedded method of order 3 on stages 0, 8 and 11.
WEIGHTS_3 = (0.2440944881889764, 0.7338466882816118, 0.022058823529411766)

# Coefficients 3 to 6 of the dense output.
DENSE_STAGES = (0, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15)
D = (
    (
        -8.428938276109013, 0.5667149535193777, -3.0689499459498917, 2.38466765651207,
        2.117034582445028, -0.871391583777973, 2.2404374302607883, 0.6315787787694688,
        -0.08899033645133331, 18.148505520854727, -9.194632392478356, -4.436036387594894,
    ),
    (
        10.427508642579134, 242.28349177525817, 165.20045171727028, -374.5467547226902,
        -22.113666853125306, 7.733432668472264, -30.674084731089398, -9.332130526430229,
        15.697238121770845, -31.139403219565178, -9.35292435884448, 35.81684148639408,
    ),
    (
        19.985053242002433, -387.0373087493518, -189.17813819516758, 527.8081592054236,
        -11.57390253995963, 6.8812326946963, -1.0006050966910838, 0.7777137798053443,
        -2.778205752353508, -60.19669523126412, 84.32040550667716, 11.99229113618279,
    ),
    (
        -25.69393346270375, -154.18974869023643, -231.5293791760455, 357.6391179106141,
        93.40532418362432, -37.45832313645163, 104.0996495089623, 29.8402934266605,
        -43.53345659001114, 96.32455395918828, -39.17726167561544, -149.72683625798564,
    ),
)

# --- Stages, error estimate, dense output

SMALLEST_TOTAL = 1e-300  # of the two error estimates, as a divisor

# Data of each component of the state: the slopes of stages 0 to 15, then seven coefficients of the
# dense output.
DENSE = 16
# The same numbers before: of a step, both error estimates and the sum of slopes without weights.
DIFFERENCE_5, DIFFERENCE_3, PROBE = DENSE, DENSE + 1, DENSE + 2
ENGINE_NUMBERS = 24

# Rows of values, the arguments and results of the automaton's functions.
ARGUMENT, SLOPE = 0, 1  # state of a stage of the step, and its slope
START, END = 2, 3  # states at both ends of the step
STATE = 4  # state at the present time
LOW, HIGH = 5, 6  # root functions at the present time, and at the end of the step
SPARE = 7  # two rows: root functions of the root search; state of a stage of the dense output
# Rows of the candidates of the root search: function, sign and bias; values at the ends of the
# bracket, at its former end, and at the next point.
INDEX, SIGN, BIAS, NEAR, FAR, LAST, TRIAL = range(9, 16)
FLOOR = 16  # absolute tolerances
ROWS = 17


def row(engine: Any, i: int) -> Any:
    """Return row `i`."""
    return engine.rows[i]


def component(engine: Any, j: int) -> Any:
    """Return the data of component `j`."""
    return engine.components[j]


def groups(engine: Any) -> int:
    """Return the number of groups of components; compiled code may compute a group at once."""
    return int(engine.n)


def group(engine: Any, j: int) -> Any:
    """Return the data of group `j`: vectors in place of numbers."""
    return engine.components[j]


def group_size(engine: Any) -> int:
    """Return the number of components of a group."""
    return 1


def grouped(engine: Any, i: int) -> Any:
    """Return row `i` as groups."""
    return engine.rows[i]


def adjacent(engine: Any, i: int) -> Any:
    """Return row `i`; at each component as the group of components from there on."""
    return engine.rows[i]


def sum_of(group: Any) -> float:
    """Return the sum of the numbers of a group."""
    return float(group)


def largest_of(group: Any) -> float:
    """Return the largest number of a group."""
    return float(group)


def set_fired(engine: Any, i: int, direction: int) -> None:
    """Set the direction in which root function `i` has crossed zero, or 0."""
    engine.crossings[i] = direction


def records_approaches(engine: Any, i: int) -> bool:
    """Return whether closest approaches of margin `i` are events, and are searched."""
    return bool(engine.approach_search == 1 and engine.approaches[i] == 1)


def stages(engine: Any, t: float, h: float) -> float:
    """Evaluate slopes 1 to 11 and END of a step from (t, START); return its error in tolerances.

    Slope 0 must be known.
    """
    mode, limit, rtol = engine.mode, engine.last_instant, engine.rtol
    y, slope = grouped(engine, ARGUMENT), grouped(engine, SLOPE)
    start, end, floor = grouped(engine, START), grouped(engine, END), grouped(engine, FLOOR)
    # fmt: off
    (a0,) = A[1]
    for j in range(groups(engine)):
        k = group(engine, j)
        y[j] = start[j] + h * (a0 * k[0])
    interface.flow(engine, mode, min(t + C[1] * h, limit), y, slope)
    a0, a1 = A[2]
    for j in range(groups(engine)):
        k = group(engine, j)
        k[1] = slope[j]
        y[j] = start[j] + h * (a0 * k[0] + a1 * k[1])
    interface.flow(engine, mode, min(t + C[2] * h, limit), y, slope)
    a0, a2 = A[3]
    for j in range(groups(engine)):
        k = group(engine, j)
        k[2] = slope[j]
        y[j] = start[j] + h * (a0 * k[0] + a2 * k[2])
    interface.flow(engine, mode, min(t + C[3] * h, limit), y, slope)
    a0, a2, a3 = A[4]
    for j in range(groups(engine)):
        k = group(engine, j)
        k[3] = slope[j]
        y[j] = start[j] + h * (a0 * k[0] + a2 * k[2] + a3 * k[3])
    interface.flow(engine, mode, min(t + C[4] * h, limit), y, slope)
    a0, a3, a4 = A[5]
    for j in range(groups(engine)):
        k = group(engine, j)
        k[4] = slope[j]
        y[j] = start[j] + h * (a0 * k[0] + a3 * k[3] + a4 * k[4])
    interface.flow(engine, mode, min(t + C[5] * h, limit), y, slope)
    a0, a3, a4, a5 = A[6]
    for j in range(groups(engine)):
        k = group(engine, j)
        k[5] = slope[j]
        y[j] = start[j] + h * (a0 * k[0] + a3 * k[3] + a4 * k[4] + a5 * k[5])
    interface.flow(engine, mode, min(t + C[6] * h, limit), y, slope)
    a0, a3, a4, a5, a6 = A[7]
    for j in range(groups(engine)):
        k = group(engine, j)
        k[6] = slope[j]
        y[j] = start[j] + h * (a0 * k[0] + a3 * k[3] + a4 * k[4] + a5 * k[5] + a6 * k[6])
    interface.flow(engine, mode, min(t + C[7] * h, limit), y, slope)
    a0, a3, a4, a5, a6, a7 = A[8]
    for j in range(groups(engine)):
        k = group(engine, j)
        k[7] = slope[j]
        y[j] = start[j] + h * (
            a0 * k[0] + a3 * k[3] + a4 * k[4] + a5 * k[5] + a6 * k[6] + a7 * k[7]
        )
    interface.flow(engine, mode, min(t + C[8] * h, limit), y, slope)
    a0, a3, a4, a5, a6, a7, a8 = A[9]
    for j in range(groups(engine)):
        k = group(engine, j)
        k[8] = slope[j]
        y[j] = start[j] + h * (
            a0 * k[0] + a3 * k[3] + a4 * k[4] + a5 * k[5] + a6 * k[6] + a7 * k[7] + a8 * k[8]
        )
    interface.flow(engine, mode, min(t + C[9] * h, limit), y, slope)
    a0, a3, a4, a5, a6, a7, a8, a9 = A[10]
    for j in range(groups(engine)):
        k = group(engine, j)
        k[9] = slope[j]
        y[j] = start[j] + h * (
            a0 * k[0] + a3 * k[3] + a4 * k[4] + a5 * k[5] + a6 * k[6] + a7 * k[7] + a8 * k[8]
            + a9 * k[9]
        )
    interface.flow(engine, mode, min(t + C[10] * h, limit), y, slope)
    a0, a3, a4, a5, a6, a7, a8, a9, a10 = A[11]
    for j in range(groups(engine)):
        k = group(engine, j)
        k[10] = slope[j]
        y[j] = start[j] + h * (
            a0 * k[0] + a3 * k[3] + a4 * k[4] + a5 * k[5] + a6 * k[6] + a7 * k[7] + a8 * k[8]
            + a9 * k[9] + a10 * k[10]
        )
    interface.flow(engine, mode, min(t + C[11] * h, limit), y, slope)
    b0, b5, b6, b7, b8, b9, b10, b11 = A[12]
    e0, e5, e6, e7, e8, e9, e10, e11 = ERROR_5
    w0, w8, w11 = WEIGHTS_3
    for j in range(groups(engine)):
        k = group(engine, j)
        k[11] = slope[j]
        mean = (
            b0 * k[0] + b5 * k[5] + b6 * k[6] + b7 * k[7] + b8 * k[8] + b9 * k[9] + b10 * k[10]
            + b11 * k[11]
        )
        end[j] = start[j] + h * mean
        scale = floor[j] + rtol * max(abs(start[j]), abs(end[j]))
        k[DIFFERENCE_5] = (
            e0 * k[0] + e5 * k[5] + e6 * k[6] + e7 * k[7] + e8 * k[8] + e9 * k[9] + e10 * k[10]
            + e11 * k[11]
        ) / scale
        k[DIFFERENCE_3] = (mean - (w0 * k[0] + w8 * k[8] + w11 * k[11])) / scale
        # Slopes without a weight in the error estimate.
        k[PROBE] = k[1] + k[2] + k[3] + k[4]
    # fmt: on
    error = state_error(engine, h)
    if engine.perturbations > 0:
        of_columns = COLUMN_WEIGHT * column_error(engine, h)
        error = of_columns if of_columns > error else error + 0.0 * of_columns
    return error


def state_error(engine: Any, h: float) -> float:
    """Return the error of the state, in tolerances.

    The error estimate of DOP853 is of order 7: it combines two embedded methods, of orders 5 and 3.
    It is not finite if a slope is not.
    """
    error_5, error_3, probe = 0.0, 0.0, 0.0
    for i in range(engine.states):
        k = component(engine, i)
        error_5 += k[DIFFERENCE_5] * k[DIFFERENCE_5]
        error_3 += k[DIFFERENCE_3] * k[DIFFERENCE_3]
        probe += k[PROBE]
    total = max(error_5 + 0.01 * error_3, SMALLEST_TOTAL)
    return abs(h) * error_5 / math.sqrt(engine.states * total) + 0.0 * probe


def column_error(engine: Any, h: float) -> float:
    """Return the largest error of a component, in tolerances, by the same estimate.

    A weighted error of a component of the state is below the error of the state.
    """
    worst = probe = 0.0 * grouped(engine, FLOOR)[0]
    for j in range(groups(engine)):
        k = group(engine, j)
        square = k[DIFFERENCE_5] * k[DIFFERENCE_5]
        total = square + 0.01 * k[DIFFERENCE_3] * k[DIFFERENCE_3] + SMALLEST_TOTAL
        worst = max(worst, square * square / total)
        probe += k[PROBE] + square
    return abs(h) * math.sqrt(largest_of(worst)) + 0.0 * sum_of(probe)


def dense(engine: Any, t: float, h: float) -> None:
    """Compute the coefficients of the dense output of the step from `t`, with three more stages.

    Of the first `interpolated` components.
    """
    count = -(-engine.interpolated // group_size(engine))
    mode, limit = engine.mode, engine.last_instant
    y, slope = grouped(engine, SPARE), grouped(engine, SLOPE)
    start, end = grouped(engine, START), grouped(engine, END)
    # fmt: off
    a0, a6, a7, a8, a9, a10, a11, a12 = A[13]
    for j in range(count):
        k = group(engine, j)
        y[j] = start[j] + h * (
            a0 * k[0] + a6 * k[6] + a7 * k[7] + a8 * k[8] + a9 * k[9] + a10 * k[10] + a11 * k[11]
            + a12 * k[12]
        )
    interface.flow(engine, mode, min(t + C[13] * h, limit), y, slope)
    a0, a5, a6, a7, a10, a11, a12, a13 = A[14]
    for j in range(count):
        k = group(engine, j)
        k[13] = slope[j]
        y[j] = start[j] + h * (
            a0 * k[0] + a5 * k[5] + a6 * k[6] + a7 * k[7] + a10 * k[10] + a11 * k[11]
            + a12 * k[12] + a13 * k[13]
        )
    interface.flow(engine, mode, min(t + C[14] * h, limit), y, slope)
    a0, a5, a6, a7, a8, a12, a13, a14 = A[15]
    for j in range(count):
        k = group(engine, j)
        k[14] = slope[j]
        y[j] = start[j] + h * (
            a0 * k[0] + a5 * k[5] + a6 * k[6] + a7 * k[7] + a8 * k[8] + a12 * k[12] + a13 * k[13]
            + a14 * k[14]
        )
    interface.flow(engine, mode, min(t + C[15] * h, limit), y, slope)
    for j in range(count):
        k = group(engine, j)
        k[15] = slope[j]
        rise = end[j] - start[j]
        k[DENSE] = rise
        k[DENSE + 1] = h * k[0] - rise
        k[DENSE + 2] = 2.0 * rise - h * (k[12] + k[0])
    d0, d5, d6, d7, d8, d9, d10, d11, d12, d13, d14, d15 = D[0]
    for j in range(count):
        k = group(engine, j)
        k[DENSE + 3] = h * (
            d0 * k[0] + d5 * k[5] + d6 * k[6] + d7 * k[7] + d8 * k[8] + d9 * k[9] + d10 * k[10]
            + d11 * k[11] + d12 * k[12] + d13 * k[13] + d14 * k[14] + d15 * k[15]
        )
    d0, d5, d6, d7, d8, d9, d10, d11, d12, d13, d14, d15 = D[1]
    for j in range(count):
        k = group(engine, j)
        k[DENSE + 4] = h * (
            d0 * k[0] + d5 * k[5] + d6 * k[6] + d7 * k[7] + d8 * k[8] + d9 * k[9] + d10 * k[10]
            + d11 * k[11] + d12 * k[12] + d13 * k[13] + d14 * k[14] + d15 * k[15]
        )
    d0, d5, d6, d7, d8, d9, d10, d11, d12, d13, d14, d15 = D[2]
    for j in range(count):
        k = group(engine, j)
        k[DENSE + 5] = h * (
            d0 * k[0] + d5 * k[5] + d6 * k[6] + d7 * k[7] + d8 * k[8] + d9 * k[9] + d10 * k[10]
            + d11 * k[11] + d12 * k[12] + d13 * k[13] + d14 * k[14] + d15 * k[15]
        )
    d0, d5, d6, d7, d8, d9, d10, d11, d12, d13, d14, d15 = D[3]
    for j in range(count):
        k = group(engine, j)
        k[DENSE + 6] = h * (
            d0 * k[0] + d5 * k[5] + d6 * k[6] + d7 * k[7] + d8 * k[8] + d9 * k[9] + d10 * k[10]
            + d11 * k[11] + d12 * k[12] + d13 * k[13] + d14 * k[14] + d15 * k[15]
        )
    # fmt: on


def try_step(engine: Any, t: float, h: float) -> float:
    """Call `stages`; compiled code calls a C function, as for `dense`."""
    return stages(engine, t, h)


def make_dense(engine: Any, t: float, h: float) -> None:
    """Call `dense`."""
    dense(engine, t, h)


def slope_at_end(engine: Any, t: float) -> bool:
    """Evaluate slope 12, that at END and time `t`; return whether it is finite."""
    end, slope = grouped(engine, END), grouped(engine, SLOPE)
    interface.flow(engine, engine.mode, min(t, engine.last_instant), end, slope)
    total = 0.0 * slope[0]
    for j in range(groups(engine)):
        group(engine, j)[12] = slope[j]
        total += abs(slope[j])
    return math.isfinite(sum_of(total))


def stiffness_ratio(engine: Any, h: float) -> float:
    """Return h times Hairer's estimate of the largest eigenvalue, from slopes 11 and 12.

    Both are at the end of the step, at the states ARGUMENT and END.
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
    h = engine.t_end - engine.t_start
    if engine.has_dense == 0:
        engine.has_dense = 1
        make_dense(engine, engine.t_start, h)
    u = (t - engine.t_start) / h
    v = 1.0 - u
    for j in range(engine.interpolated):
        k = component(engine, j)
        inner = k[DENSE + 3] + u * (k[DENSE + 4] + v * (k[DENSE + 5] + u * k[DENSE + 6]))
        y[j] = start[j] + u * (k[DENSE] + v * (k[DENSE + 1] + u * (k[DENSE + 2] + v * inner)))

# --- First root within a step

NONE = -1
ULP = 2.0**-52


def root_functions(engine: Any, t: float, y: Any, out: Any) -> bool:
    """Write all root functions at (t, y) into `out`; return whether none is nan."""
    m = engine.m
    interface.margins(engine, engine.mode, min(t, engine.last_instant), y, out)
    out[2 * m] = y[engine.section] - engine.level if engine.section >= 0 else 1.0
    for i in range(2 * m):  # noqa: SIM110 - numba compiles no generator, here and below
        if math.isnan(out[i]):
            return False
    return True


def searches_rate(engine: Any, i: int) -> bool:
    """Return whether the root search includes the rate of margin `i`.

    The event loop finds a margin that is negative within a step from its values and rates at both
    ends, except for a margin with a bias.
    """
    return interface.bias(engine, i) != 0.0 or records_approaches(engine, i)


def any_crossed(engine: Any, low: Any, high: Any) -> bool:
    """Return whether any function crosses zero between rows."""
    m = engine.m
    for i in range(m):
        shift = interface.bias(engine, i)
        if low[i] + shift > 0.0 >= high[i] + shift:
            return True
        shift = interface.bias(engine, m + i)
        if low[m + i] + shift < 0.0 <= high[m + i] + shift and searches_rate(engine, i):
            return True
    before, after = low[2 * m], high[2 * m]
    falls, rises = before > 0.0 >= after, before < 0.0 <= after
    return bool((falls and engine.direction <= 0) or (rises and engine.direction >= 0))


def list_candidates(engine: Any) -> int:
    """List the root functions whose zeros between LOW and HIGH are searched; return their number.

    A candidate is a function with a bias and a sign, so that it falls from above zero to zero or
    below. A margin or rate that rises instead is excluded: close to its zero, rounding may show
    the other direction. NEAR and FAR have the values at LOW and HIGH.
    """
    m, count = engine.m, 0
    low, high = row(engine, LOW), row(engine, HIGH)
    index, sign, bias = row(engine, INDEX), row(engine, SIGN), row(engine, BIAS)
    near, far = row(engine, NEAR), row(engine, FAR)
    for i in range(2 * m + 2):
        if i < m:
            direction, shift = 1.0, interface.bias(engine, i)
        elif i < 2 * m:
            direction, shift = -1.0, interface.bias(engine, i)
            if not searches_rate(engine, i - m):
                continue
        else:
            # Falling and rising crossings of the section.
            direction, shift = (1.0, 0.0) if i == 2 * m else (-1.0, 0.0)
            if engine.section < 0 or engine.direction * direction > 0.0:
                continue
        k = min(i, 2 * m)
        before, after = direction * (low[k] + shift), direction * (high[k] + shift)
        if i >= 2 * m or not before < 0.0 < after:
            index[count], sign[count], bias[count] = k, direction, shift
            near[count], far[count] = before, after
            count += 1
    return count


def first_crossed(count: int, near: Any, far: Any) -> tuple[int, float]:
    """Return the candidate with the first zero by linear interpolation, and its relative position.

    Return NONE if no candidate falls to zero between the rows.
    """
    first, place = NONE, 1.0
    for j in range(count):
        if near[j] > 0.0 and far[j] <= 0.0:
            there = near[j] / (near[j] - far[j])
            if first == NONE or there < place:
                first, place = j, there
    return first, place


def first_root(engine: Any, begin: float, end: float) -> float:
    """Return the first root after `begin`, the time of LOW; nan if a function is nan.

    HIGH is at `end`, and some function crosses zero between the two. The result is on the far side
    of the root, within two units in the last place. LOW then has the functions there, and all
    functions that cross zero with it have fired.

    The method treats all functions at once: at the far end of the bracket any of them has crossed
    zero. The next point is the root of inverse quadratic interpolation (or linear interpolation, if
    that is not monotonic), shifted slightly towards the midpoint, so that both ends converge. The
    projection of ITP (Oliveira and Takahashi, ACM Trans. Math. Softw. 47, 2020) bounds the distance
    from the midpoint, so that the search needs at most one step more than bisection.
    """
    count = list_candidates(engine)
    index, sign, bias = row(engine, INDEX), row(engine, SIGN), row(engine, BIAS)
    near, far, last, trial = NEAR, FAR, LAST, TRIAL  # rows of candidates
    functions, spare = HIGH, SPARE  # rows of all functions, at the far end and at the next point
    a, b, c = begin, end, end
    moved_far, points = False, 2
    radius = b - a
    shift = 0.2 / radius
    i, place = first_crossed(count, row(engine, near), row(engine, far))
    while True:
        limit = ULP * max(abs(b), 1e-3 * (end - begin))
        width = b - a
        if width <= 2.0 * limit:
            break
        middle = a + 0.5 * width
        t = a + width * place
        side = 1.0 if middle >= t else -1.0
        push = shift * width * width
        if points == 3:
            f_a, f_b, f_c = row(engine, near)[i], row(engine, far)[i], row(engine, last)[i]
            new, old = (b, a) if moved_far else (a, b)
            f_new, f_old = (f_b, f_a) if moved_far else (f_a, f_b)
            if (f_new - f_old) * (f_c - f_old) > 0.0:
                x, f = (new - old) / (c - old), (f_new - f_old) / (f_c - f_old)
                if f * f < x and (1.0 - f) * (1.0 - f) < 1.0 - x:
                    straight = t
                    t = a + f_a / (f_b - f_a) * f_c / (f_b - f_c) * width
                    t += f_a / (f_c - f_a) * f_b / (f_c - f_b) * (c - a)
                    side = 1.0 if middle >= t else -1.0
                    push = 0.01 * abs(t - straight)
        t = t + side * push if push <= abs(middle - t) else middle
        slack = radius - 0.5 * width
        if abs(t - middle) > slack:
            t = middle - side * slack
        t = min(max(t, a + limit), b - limit)
        if t <= a or t >= b:
            break
        dense_at(engine, t, row(engine, ARGUMENT))
        values, signed = row(engine, spare), row(engine, trial)
        if not root_functions(engine, t, row(engine, ARGUMENT), values):
            return math.nan
        for j in range(count):
            signed[j] = sign[j] * (values[int(index[j])] + bias[j])
        i, place = first_crossed(count, row(engine, near), signed)
        moved_far = i != NONE
        if moved_far:
            c, b = b, t
            last, far, trial = far, trial, last
            functions, spare = spare, SPARE if spare != SPARE else SPARE + 1
        else:
            c, a = a, t
            last, near, trial = near, trial, last
            i, place = first_crossed(count, row(engine, near), row(engine, far))
        points = 3
        radius *= 0.5
    for k in range(2 * engine.m + 1):
        set_fired(engine, k, 0)
        row(engine, LOW)[k] = row(engine, functions)[k]
    for j in range(count):
        if row(engine, near)[j] > 0.0 and row(engine, far)[j] <= 0.0:
            set_fired(engine, int(index[j]), -int(sign[j]))
    return b

# --- Step size control

ERROR_TEST = -3  # of interface.FAILURES

# Step size control of DOP853 with its default beta = 0: with beta = 0.04 the paper's set takes 4 to
# 9 % more steps, with 0.08 28 to 38 %.
SAFETY, SHRINK, GROW = 0.9, 1.0 / 3.0, 6.0

# Factor on the first step of the textbook, which is short at order 8: on smooth arcs of this
# package the error estimate allows a first step 4 to 28 times as long, mostly 6 to 10.
FIRST_STEP_FACTOR = 6.0
# Least number of steps in an arc up to a stop: between two switches a drive may change much faster
# than its period suggests, and margins are evaluated only at the ends of steps.
MIN_STEPS_TO_STOP = 4.0
RETREAT = 0.25  # factor on a step with non-finite functions

# Hairer's test of stiffness: the product of step and eigenvalue exceeds a limit in many successive
# checks, with few exceptions. Number of steps between checks; after a positive check every step is
# checked.
STABILITY_LIMIT, STIFF_CHECKS, NONSTIFF_CHECKS, CHECK_INTERVAL = 6.1, 15, 6, 64


def reset(engine: Any, max_step: float) -> None:
    """Restore the initial state, with the longest step `max_step`."""
    engine.max_step = max_step
    engine.h_next = 0.0
    engine.at_border = 0
    engine.off_border = 0
    engine.stiff = 0
    engine.steps = 0


def restart(engine: Any, mode: int, t: float, y: Any, stop: float) -> None:
    """Begin an arc at (t, y) in `mode` with evaluations before `stop` only."""
    for j in range(engine.n):
        row(engine, START)[j] = y[j]
        row(engine, END)[j] = y[j]
        row(engine, STATE)[j] = y[j]
    for j in range(groups(engine) * group_size(engine)):
        row(engine, FLOOR)[j] = engine.atol
    engine.mode = mode
    engine.t = t
    engine.t_start = t
    engine.t_end = t
    engine.stop = stop
    engine.last_instant = float(np.nextafter(stop, -math.inf))
    engine.longest = engine.max_step
    if engine.interpolated == engine.n:  # otherwise the motion is known
        engine.longest = min(engine.max_step, (stop - t) / MIN_STEPS_TO_STOP)
    engine.begun = 0
    engine.rest = 0


def lengthen(engine: Any, longest: float) -> None:
    """Allow steps of up to `longest` until the next restart, but no fewer steps to a stop."""
    engine.longest = min(longest, (engine.stop - engine.t) / MIN_STEPS_TO_STOP)


def step(engine: Any) -> int:
    """Take one step, or stop at the first root in it or in the remainder of the last one."""
    if engine.rest == 0:
        if engine.begun == 0:
            status = begin(engine)
            if status < 0:
                return status
        status = take_step(engine)
        if status < 0:
            return status
    return advance_to_root(engine)


def begin(engine: Any) -> int:
    """Evaluate slope and root functions at the start of an arc, and choose its first step."""
    t = engine.t
    if not slope_at_end(engine, t):
        return interface.NON_FINITE
    if not root_functions(engine, t, row(engine, END), row(engine, LOW)):
        return interface.ROOT_FUNCTION_FAILED
    leave_section(engine, row(engine, LOW), 0)
    engine.h_next = first_step(engine)
    engine.begun = 1
    return interface.STEPPED


def first_step(engine: Any) -> float:
    """Return a first step from slope and curvature (Hairer, Norsett, Wanner I, Section II.4).

    The first step must not depend on the previous arc, so that a run can be resumed at any of its
    events.
    """
    n, y, changed = engine.states, row(engine, END), row(engine, SLOPE)
    size, speed = 0.0, 0.0
    for j in range(n):
        scale = engine.atol + engine.rtol * abs(y[j])
        size += (y[j] / scale) * (y[j] / scale)
        speed += (component(engine, j)[12] / scale) * (component(engine, j)[12] / scale)
    longest = engine.longest
    # A state within the tolerance of zero, or a tiny slope, defines no time scale.
    scaled = size > 1.0 and speed > 1e-10
    h = min(0.01 * math.sqrt(size / speed) if scaled else 1e-3 * engine.max_step, longest)
    end, ahead = grouped(engine, END), grouped(engine, ARGUMENT)
    for j in range(groups(engine)):
        ahead[j] = end[j] + h * group(engine, j)[12]
    interface.flow(engine, engine.mode, min(engine.t + h, engine.last_instant), ahead, changed)
    bend = 0.0
    for j in range(n):
        scale = engine.atol + engine.rtol * abs(y[j])
        change = (changed[j] - component(engine, j)[12]) / scale
        bend += change * change
    if not math.isfinite(bend):
        return h
    steepest = max(math.sqrt(bend) / h, math.sqrt(speed))
    if steepest <= 1e-15:
        return longest
    return min(100.0 * h, FIRST_STEP_FACTOR * eighth_root(0.01 / steepest), longest)


def eighth_root(x: float) -> float:
    """Return the eighth root, the dependence of the step on the error."""
    return math.sqrt(math.sqrt(math.sqrt(x)))


def take_step(engine: Any) -> int:
    """Take one step that passes the error test."""
    for j in range(groups(engine)):
        grouped(engine, START)[j] = grouped(engine, END)[j]
        group(engine, j)[0] = group(engine, j)[12]
    if engine.perturbations > 0:
        scale_columns(engine)
    engine.has_dense = 0
    t = engine.t_end
    smallest = 4.0 * ULP * max(abs(t), engine.max_step)
    h = max(min(engine.h_next, engine.longest), smallest)
    failure = ERROR_TEST
    rejected = False
    while True:
        planned = h
        ahead = t + h
        # Slightly longer if that avoids a tiny last step.
        if ahead >= engine.stop or engine.stop - t <= min(1.01 * h, engine.max_step):
            ahead = engine.stop
        h = ahead - t  # the exact difference of times
        error = try_step(engine, t, h)
        if not math.isfinite(error):
            failure = interface.NON_FINITE
            h *= RETREAT
        elif error > 1.0:
            h *= max(SHRINK, SAFETY / eighth_root(error))
        elif not slope_at_end(engine, ahead):
            failure = interface.NON_FINITE
            h *= RETREAT
        elif not root_functions(engine, ahead, row(engine, END), row(engine, HIGH)):
            failure = interface.ROOT_FUNCTION_FAILED
            h *= RETREAT
        else:
            break
        rejected = True
        if h < smallest:
            return failure
    leave_section(engine, row(engine, HIGH), 0)
    engine.steps += 1
    engine.t_start = t
    engine.t_end = ahead
    longer = h * min(GROW, SAFETY / max(eighth_root(error), 1e-3))
    if rejected:
        longer = min(longer, h)
    # A step shortened by the stop does not limit the next one.
    engine.h_next = max(longer, planned) if h < planned else longer
    check_stability(engine, h)
    return interface.STEPPED


def scale_columns(engine: Any) -> None:
    """Set the absolute tolerances of columns, which are relative to long columns."""
    start, floor, n = adjacent(engine, START), adjacent(engine, FLOOR), engine.states
    columns, size = engine.perturbations, group_size(engine)
    # Groups beyond the last column overlap the first columns of the next component.
    for last in range(columns - (columns - 1) % size - 1, -1, -size):
        longest = 0.0 * start[0] + 1.0
        for i in range(n):
            longest = max(longest, abs(start[n + columns * i + last]))
        for i in range(n):
            floor[n + columns * i + last] = engine.atol * longest


def check_stability(engine: Any, h: float) -> None:
    """Count steps at the stability limit; mark the run as stiff after many successive ones."""
    if engine.at_border == 0 and engine.steps % CHECK_INTERVAL != 0:
        return
    if stiffness_ratio(engine, h) > STABILITY_LIMIT:
        engine.off_border = 0
        engine.at_border += 1
        if engine.at_border >= STIFF_CHECKS:
            engine.stiff = 1
    else:
        engine.off_border += 1
        if engine.off_border >= NONSTIFF_CHECKS:
            engine.at_border = 0


def advance_to_root(engine: Any) -> int:
    """Advance to the first root before the end of the step, or to the end."""
    low, high = row(engine, LOW), row(engine, HIGH)
    last = 2 * engine.m
    if any_crossed(engine, low, high):
        t = first_root(engine, engine.t, engine.t_end)
        if math.isnan(t):
            return interface.ROOT_FUNCTION_FAILED
        # A root at the stop is ignored: the loop checks all margins after a switch.
        if t < engine.stop:
            leave_section(engine, low, interface.root_directions(engine, last))
            dense_at(engine, t, row(engine, STATE))
            engine.t = t
            engine.rest = 1 if t < engine.t_end else 0
            return interface.ROOT
    for i in range(last + 1):
        low[i] = high[i]
    for j in range(groups(engine)):
        grouped(engine, STATE)[j] = grouped(engine, END)[j]
    engine.t = engine.t_end
    engine.rest = 0
    return interface.STOPPED if engine.t_end >= engine.stop else interface.STEPPED


def leave_section(engine: Any, values: Any, side: int) -> None:
    """Set the sign of a section value of zero, so that the section is crossed exactly once.

    `side` is 0 at the start or end of a step, where the slope determines the sign. Without a slope,
    as at rest on the section, its side remains the side of LOW.
    """
    last = 2 * engine.m
    if values[last] == 0.0:
        slope = component(engine, engine.section)[12]
        if side == 0:
            before = row(engine, LOW)[last]
            leads = slope if slope != 0.0 else before
            side = 1 if leads > 0.0 else (-1 if leads < 0.0 else 0)
        values[last] = 1e-300 * side


def interpolate(engine: Any, t: float, y: Any) -> None:
    """Write the state at `t`, within the last step, into `y`."""
    dense_at(engine, t, y)
