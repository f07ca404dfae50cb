"""The Neimark-Sacker curve of a body on a spring that carries another body, and strikes a wall.

Between impacts the system is linear, and with a wall at the position of rest the multipliers do not
depend on the amplitude of the drive: they are those of a matrix in closed form.
"""

import math
from itertools import combinations

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import root

import mems_impact as mi

E = 0.8


def matrices(w, k):
    """Return the linear system, of positions and velocities, and the response to exp(i w t)."""
    stiffness = np.array([[1.0 + k, -k], [-k, k]])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-stiffness, -0.1 * stiffness]])
    drive = np.array([0.0, 0.0, 1.0, 0.0])
    return A, drive, np.linalg.solve(1j * w * np.eye(4) - A, drive)


def multipliers_polynomial(w, k):
    """Return the characteristic polynomial of the orbit with one impact in a period."""
    A, drive, response = matrices(w, k)
    impact, flow = np.diag([1.0, 1.0, -E, 1.0]), expm(2.0 * math.pi / w * A)
    free = np.linalg.solve(impact @ flow - np.eye(4), (np.eye(4) - impact) @ response)
    # The phase of the drive at which the first body is at the wall, moving away from it
    turn = np.exp(1j * (0.5 * math.pi - np.angle((free + response)[0])))
    turn *= np.sign(((free + response)[2] * turn).real)
    before, after = ((flow @ free + response) * turn).real, ((free + response) * turn).real
    force = turn.real * drive
    saltation = impact.copy()
    saltation[:, 0] += (A @ after + force - impact @ (A @ before + force)) / before[2]
    return np.poly(saltation @ flow)


def double_minus(point):
    """Zero where -1 is a double multiplier."""
    polynomial = multipliers_polynomial(*point)
    return np.polyval(polynomial, -1.0), np.polyval(np.polyder(polynomial), -1.0)


def flow(mode, t, y, p):
    between = p.k * (y.x2 - y.x1) + 0.1 * p.k * (y.v2 - y.v1)
    return y.v1, math.cos(p.w * t) - y.x1 - 0.1 * y.v1 + between, y.v2, -between


def rebound(mode, t, y, p):
    return mode, (y.x1, -E * y.v1, y.x2, y.v2)


@pytest.mark.nightly
def test_a_curve_of_neimark_sacker_points_up_to_its_1_2_resonance():
    system = mi.System(
        states=("x1", "v1", "x2", "v2"),
        flow=flow,
        period=lambda p: 2.0 * math.pi / p.w,
        parameters={"w": 2.25, "k": 0.5},
        guards=[mi.Impact("wall", lambda mode, t, y, p: y.x1, rebound)],
        initial={"v1": 1.0},
    )
    orbit = mi.find_orbit(system, transient=200)
    branch = mi.continue_solution(orbit, "w", 2.35)
    (special,) = branch.special_points
    assert special.label == "NS"
    curve = mi.continue_curve(special, "k", 2.0)
    for w, k in zip(curve.table["w"], curve.table["k"], strict=True):
        products = combinations(np.roots(multipliers_polynomial(w, k)), 2)
        assert min(abs(one * other - 1.0) for one, other in products) < 1e-8
    resonance = root(double_minus, (2.7, 1.5), tol=1e-14).x
    assert resonance == pytest.approx((2.68194296, 1.45866251), abs=1e-8)
    last = curve.special_points[-1]
    assert last.kind == "1:2 resonance"
    assert (last.values["w"], last.values["k"]) == pytest.approx(tuple(resonance), abs=1e-7)
    assert curve.ended.startswith("1:2 resonance: beyond it, the pair of multipliers is real")
