"""The coefficients and the orders of the method, its error estimates and its dense output."""

import math
from functools import cache

import numpy as np
import pytest

from mems_impact.integrators.dop853 import stepper
from mems_impact.integrators.dop853.interpreted import InterpretedDop853
from mems_impact.integrators.dop853.stepper import DENSE_STAGES, ERROR_5, STAGES, WEIGHTS_3, A, C, D
from mems_impact.integrators.interface import Equations
from mems_impact.integrators.options import Options

S = 16
METHOD = 12  # stages of the method; the next one is the slope at the end


def matrix():
    a = np.zeros((S, S))
    for i in range(S):
        assert len(STAGES[i]) == len(A[i])
        a[i, list(STAGES[i])] = A[i]
    return a


FULL = matrix()
PLACES = np.array(C)
WEIGHTS = FULL[METHOD, :METHOD]


def test_every_row_sums_to_its_place():
    assert FULL.sum(axis=1) == pytest.approx(PLACES, abs=5e-15)


@cache
def trees(order, stages=METHOD):
    """The elementary weights of all rooted trees up to `order`, as vectors over the stages.

    A tree of order q is a multiset of trees whose orders sum to q - 1; its vector of weights is
    the product of A times those of its branches, and its density q times the product of theirs.
    """
    known = {1: [(np.ones(stages), 1.0)]}
    a = FULL[:stages, :stages]

    def forests(total, largest):
        if total == 0:
            yield []
            return
        for q in range(min(total, largest[0]), 0, -1):
            start = largest[1] if q == largest[0] else len(known[q]) - 1
            for i in range(start, -1, -1):
                for rest in forests(total - q, (q, i)):
                    yield [(q, i), *rest]

    for q in range(2, order + 1):
        known[q] = []
        for forest in forests(q - 1, (q - 1, len(known[q - 1]) - 1)):
            vector, density = np.ones(stages), float(q)
            for branch in forest:
                weights, its_density = known[branch[0]][branch[1]]
                vector = vector * (a @ weights)
                density *= its_density
            known[q].append((vector, density))
    return known


def test_number_of_trees():
    assert [len(known) for known in trees(8).values()] == [1, 1, 2, 4, 9, 20, 48, 115]


def defects(weights, order, u=1.0):
    """Return how far the conditions of exactly `order` are from holding at part `u` of a step."""
    known = trees(order, weights.size)[order]
    return max(abs(weights @ vector - u**order / density) for vector, density in known)


@pytest.mark.parametrize("order", range(1, 9))
def test_the_method_fulfils_all_conditions_of_order_8(order):
    assert defects(WEIGHTS, order) < 2e-14


def test_the_method_is_not_of_order_9():
    assert defects(WEIGHTS, 9) > 1e-7


def embedded_5():
    weights = WEIGHTS.copy()
    weights[list(STAGES[METHOD])] -= ERROR_5
    return weights


def embedded_3():
    weights = np.zeros(METHOD)
    weights[[0, 8, 11]] = WEIGHTS_3
    return weights


@pytest.mark.parametrize(("weights", "order"), [(embedded_5(), 5), (embedded_3(), 3)])
def test_orders_of_the_embedded_methods(weights, order):
    assert max(defects(weights, q) for q in range(1, order + 1)) < 2e-14
    assert defects(weights, order + 1) > 1e-5


def dense_weights(u):
    """Return the weights of all stages in the dense output at the part `u` of a step."""
    v = 1.0 - u
    ends = np.zeros((2, S))
    ends[0, 0] = ends[1, METHOD] = 1.0
    rise = np.append(WEIGHTS, np.zeros(S - METHOD))
    d = np.zeros((4, S))
    d[:, list(DENSE_STAGES)] = D
    inner = d[0] + u * (d[1] + v * (d[2] + u * d[3]))
    f1, f2 = ends[0] - rise, 2.0 * rise - ends[0] - ends[1]
    return u * (rise + v * (f1 + u * (f2 + v * inner)))


@pytest.mark.parametrize("u", [0.1, 0.37, 0.5, 0.9, 1.0])
def test_the_dense_output_fulfils_all_conditions_of_order_7(u):
    assert max(defects(dense_weights(u), q, u) for q in range(1, 8)) < 5e-14


def test_the_dense_output_is_not_of_order_8():
    assert defects(dense_weights(0.37), 8, 0.37) > 1e-7


# Slopes of the errors on a closed form: y' = cos(t) y, and a point on a circle, ever faster.


def _flow(mode, t, y, p, dy):
    dy[0] = math.cos(t) * y[0]
    dy[1] = -(1.0 + t) * y[2]
    dy[2] = (1.0 + t) * y[1]


def _margins(mode, t, y, p, g, r):
    g[0] = r[0] = 1.0


def _transition(mode, code, t, y, p):
    return mode


def exact(t):
    angle = t + 0.5 * t * t
    return np.array([math.exp(math.sin(t)), math.cos(angle), math.sin(angle)])


def engine(tolerance=1e-9):
    equations = Equations(
        flow=_flow,
        margins=_margins,
        transition=_transition,
        n=3,
        m=1,
        parameters=(),
        approaches=[False],
    )
    return InterpretedDop853(
        equations, Options(method="dop853", rtol=tolerance, atol=tolerance), 1.0
    )


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


def test_the_error_of_many_steps_is_of_order_8():
    counts = np.array([6, 8, 11, 15])
    errors = [fixed_steps(2.0 / count, count)[0] for count in counts]
    assert slope(errors, 2.0 / counts) == pytest.approx(8.0, abs=0.4)


def test_errors_of_the_dense_output_are_of_order_7():
    """Over many steps; within one, whose start is exact, its error is of the order above."""
    counts = np.array([6, 8, 11, 15])
    errors = [fixed_steps(2.0 / count, count)[1] for count in counts]
    assert 6.9 < slope(errors, 2.0 / counts) < 8.6
    steps = np.array([0.25, 0.2, 0.15, 0.1])
    assert slope([fixed_steps(h, 1)[1] for h in steps], steps) == pytest.approx(8.0, abs=0.4)


def test_the_dense_output_meets_the_step_at_both_ends():
    solver = engine()
    solver.restart(0, 0.0, exact(0.0), math.inf)
    solver.step()
    y, end = [0.0] * 3, np.zeros(3)
    solver.interpolate(solver.t_end, y)
    solver.state(end)
    assert y == end.tolist()
    h = solver.t_end
    for t, state in ((0.0, exact(0.0)), (h, end)):
        inside = [0.0] * 3
        solver.interpolate(t + (1e-9 * h if t == 0.0 else -1e-9 * h), inside)
        assert inside == pytest.approx(state, abs=1e-8)


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
