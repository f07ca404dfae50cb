"""Branch points: where a branch of orbits that break a symmetry crosses the symmetric one."""

import math

import pytest

import mems_impact as mi


def pitchfork(mode, t, y, p):
    return ((p.a + p.b * math.cos(t)) * y.x - y.x**3,)


SYMMETRIC = mi.System(
    states=("x",),
    flow=pitchfork,
    period=2.0 * math.pi,
    parameters={"a": -0.1, "b": 1.0},
    initial={"x": 0.5},
)


@pytest.mark.slow
def test_another_branch_crosses():
    """The multiplier of the orbit at rest is exp(2 pi a)."""
    rest = mi.find_orbit(SYMMETRIC, guess={"x": 0.0}, periods=1)
    branch = mi.continue_orbit(rest, "a", 0.5)
    (crossing,) = branch.special_points
    assert crossing.label == "BP"
    assert abs(crossing.value) < 1e-9
    with pytest.raises(mi.InvalidParameter, match="branch point"):
        mi.continue_curve(crossing, "b", 1.0)


@pytest.mark.slow
def test_the_branch_that_crosses_turns_round_there_in_no_fold():
    off = mi.find_orbit(SYMMETRIC.changed(a=0.5), periods=1)
    assert off.state.x > 0.1
    branch = mi.continue_orbit(off, "a", -0.5, back=0.5)
    assert [special.label for special in branch.special_points] == ["BP"]
    assert abs(branch.special_points[0].value) < 1e-9
    assert branch.orbits[-1].state.x == pytest.approx(-off.state.x, abs=1e-9)
