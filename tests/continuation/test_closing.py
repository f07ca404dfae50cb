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


def pushed(mode, t, y, p):
    force = p.A * math.cos(p.omega * t) + p.B * math.sin(p.omega * t)
    return y.v, force - p.c * y.v - y.x


def gap(mode, t, y, p):
    return 1.0 - y.x


def strike(mode, t, y, p):
    return mode, (1.0, -p.e * y.v)


OSCILLATOR = mi.System(
    states=("x", "v"),
    flow=pushed,
    period=lambda p: 2.0 * math.pi / p.omega,
    parameters={"A": 24.0, "B": 0.0, "omega": 4.5, "c": 2.5, "e": 0.8},
    guards=[mi.Impact("stop", gap, strike)],
)
GRAZING = math.hypot(1.0 - 4.5**2, 2.5 * 4.5)


@pytest.mark.nightly
def test_orbits_that_come_back_in_another_of_their_periods():
    """From one impact in five periods over two and back, where the other one is left out.

    Where all their impacts come to no speed, orbits of one and of two meet. Of the two impacts it
    is the first that is left out, so that where the orbit begins decides whether it is shifted.
    """
    shifts = []
    for shift, steps in ((0, mi.StepControl(max_step=0.1)), (1, mi.StepControl(max_step=0.2))):
        orbit = mi.find_orbit(OSCILLATOR, transient=300 + shift, periods=5)
        branch = mi.continue_solution(orbit, "A", stop=27.0, back=20.0, steps=steps)
        assert branch.ended == "the branch closed upon itself"
        assert [s.label for s in branch.special_points] == ["G", "G", "PD"]
        assert branch.special_points[1].value == pytest.approx(GRAZING, rel=1e-9)
        assert branch.table["impacts"].iloc[[0, -1]].tolist() == [1, 1]
        first, last = branch.orbits[0], branch.orbits[-1]
        assert last.system.parameters["A"] == pytest.approx(24.0, abs=1e-12)
        speeds = [orbit.impacts["v before"].iloc[0] for orbit in (first, last)]
        assert speeds[1] == pytest.approx(speeds[0], abs=1e-9)
        periods = [orbit.impacts["period"].iloc[0] for orbit in (first, last)]
        shifts.append(int(periods[1] - periods[0]))
    assert 0 in shifts
    assert any(shifts)


@pytest.mark.nightly
def test_a_curve_of_grazings():
    silent = mi.find_orbit(OSCILLATOR.changed(A=21.0, B=3.0), transient=100)
    (grazing, *_) = mi.continue_solution(silent, "A", stop=23.0).special_points
    curve = mi.continue_curve(grazing, "B", 30.0, back=-30.0, steps=mi.StepControl(max_step=2.0))
    assert curve.ended == "the curve closed upon itself"
    radii = np.hypot(curve.table["A"], curve.table["B"]).to_numpy()
    assert radii == pytest.approx(GRAZING, rel=1e-9)
    check_once_round(curve.table["A"], curve.table["B"])
