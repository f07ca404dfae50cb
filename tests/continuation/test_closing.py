"""Branches and curves that close upon themselves: circles, followed once round."""

import math

import numpy as np
import pytest

import mems_impact as mi

UPPER, LOWER = mi.modes("upper", "lower")


def check_once_round(x, y):
    """The last point is the first one, and no angle is passed twice."""
    angles = np.unwrap(np.arctan2(y, x))
    assert abs(angles[-1] - angles[0]) == pytest.approx(2.0 * math.pi, abs=1e-8)
    turns = np.diff(angles)
    assert (turns > 0.0).all() or (turns < 0.0).all()


def stands(mode, t, y, p):
    return (p.size * p.size - (y.x - 2.0) ** 2 - p.m * p.m,)


@pytest.mark.quick(1)
@pytest.mark.parametrize("steps", [mi.StepControl(max_step=0.2), mi.StepControl(max_step=1.0)])
@pytest.mark.parametrize("stop", [1.0, -1.0])
def test_equilibria(steps, stop):
    parameters = {"m": 0.1, "size": 0.5}
    system = mi.System(states=("x",), flow=stands, parameters=parameters, initial={"x": 2.4})
    (upper,) = [e for e in mi.find_equilibria(system) if e.state.x > 2.0]
    branch = mi.continue_solution(upper, "m", stop=stop, back=-stop, steps=steps)
    assert branch.ended == "the branch closed upon itself"
    folds = [(s.label, s.value) for s in branch.special_points]
    way = math.copysign(0.5, stop)
    assert folds == [("LP", pytest.approx(way)), ("LP", pytest.approx(-way))]
    check_once_round(branch.table["x"] - 2.0, branch.table["m"])


def spins(mode, t, y, p):
    r = math.hypot(y.x, y.y)
    growth = p.size * p.size - (r - 2.0) ** 2 - p.m * p.m
    return y.x * growth - (1.0 + p.m) * y.y, y.y * growth + (1.0 + p.m) * y.x


def above(mode, t, y, p):
    return y.y


def below(mode, t, y, p):
    return -y.y


def dive(mode, t, y, p):
    return LOWER, (y.x, y.y)


def rise(mode, t, y, p):
    return UPPER, (y.x, y.y)


CROSSINGS = [
    mi.Guard("dive", above, dive, modes=(UPPER,)),
    mi.Guard("rise", below, rise, modes=(LOWER,)),
]


@pytest.mark.slow
@pytest.mark.parametrize("guards", [[], CROSSINGS], ids=["smooth", "with events"])
def test_limit_cycles(guards):
    """Of the radius r, (r - 2)^2 + m^2 = size^2, restarted at other points of the branch."""
    system = mi.System(
        states=("x", "y"),
        flow=spins,
        parameters={"m": 0.1, "size": 0.5},
        guards=guards,
        initial={"x": 2.5},
    )
    cycle = mi.find_orbit(system)
    for stop, steps in ((1.0, mi.StepControl(max_step=0.1)), (-1.0, mi.StepControl(max_step=0.2))):
        branch = mi.continue_solution(cycle, "m", stop=stop, back=-stop, steps=steps)
        assert branch.ended == "the branch closed upon itself"
        assert [s.label for s in branch.special_points] == ["CF", "CF"]
        radii = np.array([math.hypot(orbit.state.x, orbit.state.y) for orbit in branch.orbits])
        check_once_round(radii - 2.0, [orbit.system.parameters["m"] for orbit in branch.orbits])
