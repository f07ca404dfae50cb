"""Sliding bifurcations, corner and border collisions: types and places, against closed forms."""

import math
import pickle

import numpy as np
import pytest

import mems_impact as mi

# --- A cycle that touches a wall


def spiral(mode, t, y, p):
    """The normal form of a Hopf bifurcation, whose cycle has the radius sqrt(mu), or a wall."""
    if mode.wall == 1:
        return -1.0, 0.0
    grows = p.mu - y.x**2 - y.y**2
    return grows * y.x - p.w * y.y, p.w * y.x + grows * y.y


@pytest.fixture(scope="module")
def growth():
    system = mi.System(
        states=("x", "y"), flow=spiral, parameters={"mu": 0.8, "w": 1.5}, initial={"x": 0.5},
        parts=[mi.SwitchingSurface("wall", "x", level=1.0)],
    )  # fmt: skip
    return mi.continue_orbit(mi.find_orbit(system, transient=50), "mu", stop=1.3)


def test_a_cycle_grazes_its_sliding_region_from_either_side(growth):
    shrinks = mi.continue_orbit(growth.orbits[-1], "mu", stop=0.8)
    for branch in (growth, shrinks):
        assert branch.ended == "mu reached its bound"
        assert branch.table.admissible.all()
        assert branch.table.stable.all()
        (point,) = branch.special_points
        assert point.value == pytest.approx(1.0, abs=1e-12)
        found = mi.sliding_type(point)
        assert found == "grazing-sliding"
        assert found.modes == ("below", "below")
        assert (found.tangent, found.other, found.sliding) == ("below", "above", "sliding")
        assert found.tangency == "visible"
        # At (1, 0) the height 1 - x has the second derivative w^2.
        assert found.second == pytest.approx(1.5**2, rel=1e-8)
        assert found.rates == pytest.approx((0.0, 1.0), abs=1e-9)
        assert (found.state.x, found.state.y) == pytest.approx((1.0, 0.0), abs=1e-9)
        assert branch.special_table["type"].tolist() == ["grazing-sliding"]
    sides = [growth.orbits[i].segments["mode"].tolist() for i in (0, -1)]
    assert sides[0] == ["below"]
    assert "sliding" in sides[1]


def test_grazing_sliding_is_a_curve(growth):
    curve = mi.continue_curve(growth.special_points[0], "w", stop=2.0)
    assert curve.ended == "w reached its bound"
    assert np.abs(curve.table.mu - 1.0).max() < 1e-11


def test_a_type_is_a_string_with_the_numbers_of_its_criterion(growth):
    found = mi.sliding_type(growth.special_points[0])
    again = pickle.loads(pickle.dumps(found))
    assert again == found
    assert again.second == found.second
    assert (f"{found}", found.label) == ("grazing-sliding", "GS")
    assert [text.get_text() for text in mi.plot_branch(growth).texts] == ["GS"]


@pytest.mark.slow
def test_points_without_a_discontinuity_have_no_type():
    def bent(mode, t, y, p):
        return y.v, -0.05 * y.v - y.x - y.x**3 + p.A * math.cos(1.6 * t)

    system = mi.System(
        states=("x", "v"), flow=bent, period=2.0 * math.pi / 1.6, parameters={"A": 0.4}
    )
    branch = mi.continue_orbit(mi.find_orbit(system, transient=200), "A", stop=3.0)
    fold = next(point for point in branch.special_points if point.label == "CF")
    with pytest.raises(mi.InvalidParameter, match="a guard is touched, or events coincide"):
        mi.sliding_type(fold)
    assert set(branch.special_table["type"]) == {""}
