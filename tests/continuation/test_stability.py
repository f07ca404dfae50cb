"""Changes of stability along branches, with eigenvalues and multipliers in closed form."""

import itertools
import math

import numpy as np
import pytest
from scipy.linalg import block_diag
from scipy.optimize import brentq

import mems_impact as mi
from mems_impact.continuation.stability import CIRCLE, IMAGINARY_AXIS, Crossings

QUICK = mi.Options(method="dop853", engine="interpreted")


def pair(growth, turn):
    return np.array([[growth, -turn], [turn, growth]])


def places(border, matrix, length=1.0, behind=None):
    return [each.begin for each in Crossings(border, matrix, behind).within(length)]


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
def test_pairs_that_cross_both_ways_in_one_step(unit):
    def matrix(s):
        return unit * block_diag(
            pair(s - 0.03, 1.0), pair(0.031 - s, 1.1), -np.diag(np.linspace(1e-3, 1e3, 30))
        )

    assert places(IMAGINARY_AXIS, matrix, 0.06) == pytest.approx([0.03, 0.031], abs=1e-12)


def test_a_step_that_is_lost_at_its_start_has_no_crossing():
    assert places(IMAGINARY_AXIS, lambda s: pair(s, 1.0), 0.0) == []


def test_a_pair_that_crosses_and_comes_back():
    def matrix(s):
        return pair(0.01 - (s - 0.5) ** 2, 1.0)

    behind = -1.0, IMAGINARY_AXIS.spectrum(matrix(-1.0))
    for known in (None, behind):
        assert places(IMAGINARY_AXIS, matrix, behind=known) == pytest.approx([0.4, 0.6], abs=1e-12)


def test_a_pair_that_is_real_before_one_of_it_crosses():
    def matrix(s):  # x'' = (s - 0.9) x' - (0.6 - s) x
        return np.array([[0.0, 1.0], [s - 0.6, s - 0.9]])

    (found,) = Crossings(IMAGINARY_AXIS, matrix).within(1.0)
    assert found.begin < 0.6 < found.end  # for a fold or a branch point to be found within
    assert found.value == 0.0


def test_equal_parts_cross_in_one_place():
    def matrix(s):
        return block_diag(pair(s - 0.3, 1.0), pair(s - 0.3, 1.0))

    assert places(IMAGINARY_AXIS, matrix) == pytest.approx([0.3], abs=1e-8)


def test_multipliers_pass_through_infinity_and_minus_one():
    def matrix(s):
        return np.diag([30.0 / (s - 0.3), -0.5 - s, 1e-200])

    assert places(CIRCLE, matrix) == pytest.approx([0.5], abs=1e-12)


def test_what_is_neutral_but_for_rounding_is_no_crossing():
    def matrix(s):
        return pair(1e-12 * math.copysign(1.0, s - 0.5), 1.0)

    assert places(IMAGINARY_AXIS, matrix) == []


def chain(size, unit):
    """Masses in a row, the first of which is driven: x'' = w^2 L x + d(q) x' - x^2 x'."""

    def flow(mode, t, y, p, dy):
        for i in range(size):
            left = y[2 * i - 2] if i > 0 else 0.0
            right = y[2 * i + 2] if i < size - 1 else 0.0
            damping = p.q * unit if i == 0 else -0.2 * unit
            dy[2 * i] = y[2 * i + 1]
            dy[2 * i + 1] = unit * unit * (left - 2.0 * y[2 * i] + right)
            dy[2 * i + 1] += (damping - y[2 * i] * y[2 * i]) * y[2 * i + 1]

    return mi.System(states=2 * size, flow=flow, parameters={"q": -0.1}, time_scale=1.0 / unit)


def changes_of_a_chain(size):
    """Where a pair of it is imaginary, by its matrix at unit frequency."""

    def growth(q):
        stiffness = np.diag(np.full(size, -2.0)) + np.eye(size, k=1) + np.eye(size, k=-1)
        damping = np.diag([q, *[-0.2] * (size - 1)])
        whole = np.block([[np.zeros((size, size)), np.eye(size)], [stiffness, damping]])
        return np.sort(np.linalg.eigvals(whole).real)[::-2]

    found, grid = [], np.linspace(-0.1, 1.0, 441)
    for a, b in itertools.pairwise(grid):
        for k in np.flatnonzero(growth(a) * growth(b) < 0.0):
            found.append(brentq(lambda q, k=k: growth(q)[k], a, b, xtol=1e-14))
    return sorted(found)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "unit"),
    [(7, 1e6), (10, 1.0), (20, 1e-5)],
)
def test_hopf_points_of_many_states_far_from_order_one(size, unit):
    rest = mi.find_equilibria(chain(size, unit))[0]
    branch = mi.continue_solution(rest, "q", 1.0)
    assert {point.label for point in branch.special_points} == {"H"}
    values = [point.value for point in branch.special_points]
    assert values == pytest.approx(changes_of_a_chain(size), abs=1e-8)


def test_what_is_not_found_is_reported():
    """Two equal pitchforks in one place, of which the equations of branch points know nothing."""
    system = mi.System(
        states=("x", "y"),
        flow=lambda mode, t, y, p: (p.a * y.x - y.x**3, p.a * y.y - y.y**3),
        parameters={"a": -0.33},
    )
    rest = mi.find_equilibria(system, guess={"x": 0.0})[0]
    branch = mi.continue_solution(rest, "a", 1.0)
    (told,) = branch.special_points
    assert (told.label, told.kind) == ("?", "unexplained")
    assert abs(told.value) < 2e-3
    assert branch.ended == "a reached its bound"


def turns(mode, t, y, p):
    """Two pairs of multipliers, one of which grows, and a negative one."""
    c, s = 0.5, math.sqrt(0.75)
    a, b = 0.8 + 0.5 * p.q, 1.3005 - 0.75 * p.q
    return mode, (
        a * (c * y.x - s * y.y),
        a * (s * y.x + c * y.y),
        b * (s * y.u - c * y.v),
        b * (c * y.u + s * y.v),
        -(0.7 + 0.5 * p.q) * y.w,
    )


@pytest.mark.nightly
def test_multipliers_of_a_map():
    system = mi.System(
        states=tuple("xyuvw"),
        flow=lambda mode, t, y, p: (0.0, 0.0, 0.0, 0.0, 0.0),
        switch_transition=turns,
        switches=(0.5,),
        period=1.0,
        parameters={"q": 0.1},
    )
    rest = mi.find_orbit(system, periods=1, guess={"x": 0.0}, options=QUICK)
    branch = mi.continue_solution(rest, "q", 0.9)
    found = [(point.label, point.value) for point in branch.special_points]
    assert [label for label, _ in found] == ["NS", "NS", "PD"]
    assert [value for _, value in found] == pytest.approx([0.4, 0.3005 / 0.75, 0.6], abs=1e-11)
