"""The search itself, on functions with known minima."""

import numpy as np
import pytest
from scipy.optimize import minimize

from mems_impact.errors import OrbitError
from mems_impact.studies.trust_region import LocalModel, search


def functions(x):
    """Rosenbrock's valley over [-2, 2]^2, within a circle."""
    a, b = 4.0 * x - 2.0
    gradient = 4.0 * np.array([-2.0 * (1.0 - a) - 400.0 * a * (b - a * a), 200.0 * (b - a * a)])
    value = (1.0 - a) ** 2 + 100.0 * (b - a * a) ** 2
    margins, by_margin = np.array([1.5 - a * a - b * b]), np.array([[-8.0 * a, -8.0 * b]])
    return LocalModel(value, gradient, margins, by_margin)


def searched(start, look=functions, move=lambda _, x: x, iterations=300):
    taken = []
    start = np.array(start)
    found = search(start, start, move=move, look=look, report=taken.append, iterations=iterations)
    return found, taken


@pytest.mark.parametrize("start", [[0.2, 0.8], [0.5, 0.5], [0.95, 0.95]])
def test_a_constrained_minimum(start):
    found, taken = searched(start)
    circle = {"type": "ineq", "fun": lambda v: 1.5 - v @ v}
    best = minimize(
        lambda v: (1.0 - v[0]) ** 2 + 100.0 * (v[1] - v[0] ** 2) ** 2,
        [0.9, 0.8],
        constraints=[circle],
        options={"ftol": 1e-14},
    )
    assert found.ended == "converged"
    assert 4.0 * found.x - 2.0 == pytest.approx(best.x, abs=1e-4)
    assert found.local.violation < 1e-8
    assert taken[-1].x == pytest.approx(found.x)


def test_a_minimum_at_a_side():
    slope = LocalModel(0.0, np.array([1.0, -2.0]), np.zeros(0), np.zeros((0, 2)))

    def look(x):
        return LocalModel(float(slope.gradient @ x), slope.gradient, slope.margins, slope.by_margin)

    found, _ = searched([0.5, 0.5], look)
    assert found.x.tolist() == [0.0, 1.0]
    assert found.ended == "converged"


@pytest.mark.parametrize("start", [[0.1, 0.9], [0.9, 0.05]])
def test_a_minimum_in_an_edge_between_two_pieces(start):
    def look(x):
        above = x[1] - 0.3 - 0.2 * x[0] ** 2
        sign = 1.0 if above > 0.0 else -1.0
        value = (x[0] - 0.6) ** 2 + sign * (2.0 + sign) * above
        gradient = np.array([2.0 * (x[0] - 0.6), 0.0])
        gradient += sign * (2.0 + sign) * np.array([-0.4 * x[0], 1.0])
        return LocalModel(value, gradient, np.zeros(0), np.zeros((0, 2)), sign)

    found, _ = searched(start, look)
    assert found.x == pytest.approx([0.6, 0.372], abs=1e-3)
    assert found.local.value == pytest.approx(0.0, abs=1e-6)
    assert len(found.edge) == 1
    assert look(found.edge[0]).piece == -found.local.piece


@pytest.mark.parametrize("start", [[0.8, 0.9], [0.7, 0.1], [0.4, 0.4]])
def test_the_bottom_of_a_bent_edge_is_reached(start):
    # As with a device whose slip ends at its impact: steep on both sides, nearly level along it.
    def look(x):
        bent = x[1] - 0.8 + 1.5 * (x[0] - 0.2) - 2.0 * (x[0] - 0.2) ** 2
        by_x = np.array([1.5 - 4.0 * (x[0] - 0.2), 1.0])
        side = 1.0 if bent > 0.0 else -1.0
        slope, bow = (3.0, 4.0) if bent > 0.0 else (-6.0, -9.0)
        value = 0.3 * (x[0] - 0.15) ** 2 + slope * bent + bow * bent * (x[0] - 0.5)
        gradient = np.array([0.6 * (x[0] - 0.15) + bow * bent, 0.0])
        gradient += (slope + bow * (x[0] - 0.5)) * by_x
        return LocalModel(value, gradient, np.zeros(0), np.zeros((0, 2)), side)

    found, _ = searched(start, look, iterations=100)
    assert found.ended == "converged"
    assert len(found.edge) == 1
    assert found.x[0] == pytest.approx(0.15, abs=3e-4)
    assert found.local.value == pytest.approx(0.0, abs=1e-7)


def test_points_that_do_not_exist():
    def move(_, x):
        if x[0] > 0.7:
            raise OrbitError("it ends there", "stay away")
        return x

    def look(x):
        return LocalModel(-float(x[0]), np.array([-1.0]), np.zeros(0), np.zeros((0, 1)))

    found, _ = searched([0.1], look, move)
    assert found.x[0] == pytest.approx(0.7, abs=1e-7)
    assert (found.ended, found.lost) == ("lost", "it ends there")


def test_no_point_meets_the_constraint():
    def look(x):
        return LocalModel(float(x[0]), np.array([1.0]), x[:1] - 2.0, np.array([[1.0]]))

    found, _ = searched([0.3], look)
    assert found.x[0] == 1.0  # where it is missed least
    assert found.local.violation == pytest.approx(1.0)
