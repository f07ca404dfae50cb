"""The coefficients of the method are those of SciPy, and its errors fall with their orders."""

import math

import numpy as np
import pytest
from scipy.integrate import DOP853

from mems_impact.integrators.dop853 import stepper
from mems_impact.integrators.dop853.interpreted import InterpretedDop853
from mems_impact.integrators.dop853.stepper import DENSE_STAGES, ERROR_5, STAGES, WEIGHTS_3, A, C, D
from mems_impact.integrators.interface import Equations
from mems_impact.integrators.options import Options

METHOD = 12  # stages of the method; the next one is the slope at the end


def test_coefficients_are_those_of_scipy():
    """Stages, weights, both error estimates and the dense output."""
    full = np.zeros((16, 16))
    for i, (stages, row) in enumerate(zip(STAGES, A, strict=True)):
        full[i, list(stages)] = row
    expected = np.zeros((16, 16))
    expected[:METHOD, :METHOD] = DOP853.A
    expected[METHOD, :METHOD] = DOP853.B
    expected[METHOD + 1 :] = DOP853.A_EXTRA
    assert full == pytest.approx(expected, rel=1e-14, abs=0.0)
    assert np.array(C) == pytest.approx(expected.sum(axis=1), abs=5e-15)
    error_5, weights_3, dense = np.zeros(METHOD), np.zeros(METHOD), np.zeros((4, 16))
    error_5[list(STAGES[METHOD])] = ERROR_5
    weights_3[[0, 8, 11]] = WEIGHTS_3
    dense[:, list(DENSE_STAGES)] = D
    assert error_5 == pytest.approx(DOP853.E5[:METHOD], rel=1e-13, abs=0.0)
    assert DOP853.B - weights_3 == pytest.approx(DOP853.E3[:METHOD], abs=1e-15)
    assert dense == pytest.approx(DOP853.D, rel=1e-14, abs=0.0)


# Slopes of the errors on a closed form: y' = cos(t) y, and a point on a circle, ever faster.


def _flow(mode, t, y, p, dy):
    dy[0] = math.cos(t) * y[0]
    dy[1] = -(1.0 + t) * y[2]
    dy[2] = (1.0 + t) * y[1]


def exact(t):
    angle = t + 0.5 * t * t
    return np.array([math.exp(math.sin(t)), math.cos(angle), math.sin(angle)])


def engine():
    equations = Equations(
        flow=_flow,
        margins=lambda mode, t, y, p, g, r: None,
        transition=lambda mode, code, t, y, p: mode,
        n=3,
        m=1,
        parameters=(),
        approaches=[False],
    )
    return InterpretedDop853(equations, Options(method="dop853", rtol=1e-9, atol=1e-9), 1.0)


def slope_at_start(solver, t):
    slope = [0.0] * solver.n
    solver.flow(0, t, solver.rows[stepper.START], slope)
    for j in range(solver.n):
        solver.components[j][0] = slope[j]


def fixed_steps(h, count):
    """Take `count` steps of length `h`; return the errors at the end and inside the last step."""
    solver = engine()
    n = solver.n
    solver.rows[stepper.START][:n] = exact(0.0).tolist()
    for k in range(count):
        t = k * h
        solver.t_start, solver.t_end, solver.has_dense = t, t + h, 0
        slope_at_start(solver, t)
        stepper.try_step(solver, t, h)
        assert stepper.slope_at_end(solver, t + h)
        inside = 0.0
        y = [0.0] * n
        for u in (0.2, 0.5, 0.8):
            stepper.dense_at(solver, t + u * h, y)
            inside = max(inside, np.abs(np.array(y) - exact(t + u * h)).max())
        end = np.array(solver.rows[stepper.END][:n])
        solver.rows[stepper.START][:n] = end.tolist()
    return np.abs(end - exact(count * h)).max(), inside


def slope(errors, steps):
    return np.polyfit(np.log(steps), np.log(errors), 1)[0]


def test_orders_of_step_and_dense_output():
    """Over many steps; within one, whose start is exact, the dense output has the order above."""
    counts = np.array([6, 8, 11, 15])
    ends, inside = np.array([fixed_steps(2.0 / count, count) for count in counts]).T
    assert slope(ends, 2.0 / counts) == pytest.approx(8.0, abs=0.4)
    assert 6.9 < slope(inside, 2.0 / counts) < 8.6
    steps = np.array([0.25, 0.2, 0.15, 0.1])
    assert slope([fixed_steps(h, 1)[1] for h in steps], steps) == pytest.approx(8.0, abs=0.4)


def test_the_error_estimate_is_of_order_8():
    """As it bounds the error of a step, it must vanish like the step's: h times h^7."""
    estimates = []
    steps = np.array([0.3, 0.2, 0.15, 0.1])
    for h in steps:
        solver = engine()
        solver.restart(0, 0.0, exact(0.0), math.inf)
        slope_at_start(solver, 0.0)
        estimates.append(stepper.try_step(solver, 0.0, h))
    assert slope(estimates, steps) == pytest.approx(8.0, abs=0.4)
