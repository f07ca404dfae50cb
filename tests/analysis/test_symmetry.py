"""Symmetries that change signs of states, and symmetric partners."""

import math

import numpy as np
import pytest

import mems_impact as mi

INTERPRETED = mi.Options(method="dop853", engine="interpreted")


def duffing(mode, t, y, p):
    return y.v, p.a * y.x - y.x**3 - 0.1 * y.v + p.b * y.x**2


def lorenz(mode, t, y, p):
    return 10.0 * (y.y - y.x), y.x * (p.r - y.z) - y.y, y.x * y.y - 8.0 / 3.0 * y.z


def equilibrium(flow, states, guess, **values):
    system = mi.System(states=states, flow=flow, parameters=values)
    return mi.find_equilibria(system, guess=guess)[0]


def test_equilibria_and_their_partners():
    right = equilibrium(duffing, ("x", "v"), {"x": 0.9}, a=1.0, b=0.0)
    (mirror,) = mi.symmetries(right)
    assert mirror.signs == {"x": -1, "v": -1}
    assert not mirror.half_period
    assert repr(mirror) == "Symmetry((x, v) -> (-x, -v))"
    assert mirror.image(right).state.x == pytest.approx(-1.0, abs=1e-12)
    rest = equilibrium(duffing, ("x", "v"), {"x": 0.0}, a=1.0, b=0.0)
    assert mirror.keeps(rest)
    assert mirror.image(rest) is rest
    assert mi.symmetries(equilibrium(duffing, ("x", "v"), {"x": 0.9}, a=1.0, b=1e-6)) == ()


def test_the_halves_of_a_pitchfork_are_partners():
    states, steps = ("x", "y", "z"), mi.StepControl(max_step=2.0)
    rest = equilibrium(lorenz, states, {"x": 0.0}, r=0.5)
    branch = mi.continue_solution(rest, "r", 20.0, steps=steps)
    halves = mi.switch_branch(branch.special_points[0], steps=steps)
    assert halves.symmetry.signs == {"x": -1, "y": -1, "z": 1}
    first, last = halves.equilibria[0], halves.equilibria[-1]
    assert tuple(halves.symmetry.image(first).state) == pytest.approx(tuple(last.state), abs=1e-9)
    assert branch.symmetry is None  # its equilibria are symmetric


def test_a_transcritical_branch_has_no_symmetry():
    rest = equilibrium(lambda mode, t, y, p: (p.a * y.x - y.x**2,), ("x",), {"x": 0.0}, a=-1.0)
    (crossing,) = mi.continue_solution(rest, "a", 1.0).special_points
    assert mi.switch_branch(crossing).symmetry is None


LEFT, RIGHT = mi.modes("left", "right")


def rocking(mode, t, y, p):
    """A rocking block: in each mode it leans on one of its corners."""
    return y.v, y.x - (1.0 if mode == RIGHT else -1.0) + p.b * math.cos(3.0 * t) + p.c


def tilt(mode, t, y, p):
    return y.x if mode == RIGHT else -y.x


def strike(mode, t, y, p):
    return (LEFT if mode == RIGHT else RIGHT), (0.0, 0.8 * y.v)


@pytest.mark.slow
def test_modes_and_guards_change_places():
    block = mi.System(
        states=("x", "v"),
        flow=rocking,
        period=2.0 * math.pi / 3.0,
        parameters={"b": 2.0, "c": 0.0},
        guards=[mi.Impact("base", tilt, strike)],
        modes=("left", "right"),
        initial=mi.State(x=0.05, v=0.5, mode="right"),
    )
    orbit = mi.find_orbit(block, transient=60, options=INTERPRETED)
    (mirror,) = mi.symmetries(orbit)
    assert repr(mirror) == "Symmetry((x, v, t) -> (-x, -v, t + T/2))"
    assert mirror.numeric.modes == {LEFT: RIGHT, RIGHT: LEFT}
    assert mirror.keeps(orbit)
    leaning = mi.find_orbit(block.changed(c=1e-3), guess=orbit.state, options=INTERPRETED)
    assert mi.symmetries(leaning) == ()


def well(mode, t, y, p):
    return y.v, y.x - y.x**3 - 0.3 * y.v + p.A * math.cos(t)


@pytest.mark.nightly
def test_the_partner_of_an_orbit_in_a_well():
    system = mi.System(states=("x", "v"), flow=well, period=2.0 * math.pi, parameters={"A": 0.1})
    right = mi.find_orbit(system, guess={"x": 1.0}, transient=50, options=INTERPRETED)
    (mirror,) = mi.symmetries(right)
    left = mirror.image(right)
    assert left.multipliers == pytest.approx(right.multipliers, abs=1e-9)
    x = [orbit.samples(2)["x"].to_numpy() for orbit in (left, right)]
    assert x[0][:2] == pytest.approx(-x[1][1::-1], abs=1e-9)
    assert mirror.image(left).state.x == pytest.approx(right.state.x, abs=1e-9)
    with pytest.raises(mi.InvalidParameter, match="mapped to a solution"):
        mirror.image(tilted())


def tilted():
    """An orbit of a system without the symmetry."""

    def flow(mode, t, y, p):
        return y.v, y.x - y.x**3 - 0.3 * y.v + 0.1 * math.cos(t) + 0.05

    system = mi.System(states=("x", "v"), flow=flow, period=2.0 * math.pi)
    return mi.find_orbit(system, guess={"x": 1.0}, transient=50, options=INTERPRETED)


@pytest.mark.nightly
def test_cycles_of_the_lorenz_system():
    """The symmetric cycle loses its symmetry at r = 312.97 (Sparrow 1982)."""
    system = mi.System(
        states=("x", "y", "z"),
        flow=lorenz,
        parameters={"r": 330.0},
        section=("x", 0.0),
        initial={"x": 10.0, "y": 10.0, "z": 300.0},
    )
    cycle = mi.find_orbit(system, transient=40.0)
    (mirror,) = mi.symmetries(cycle)
    assert mirror.keeps(cycle)
    steps = mi.StepControl(initial_step=0.1, max_step=8.0)
    (fork,) = mi.continue_solution(cycle, "r", 305.0, steps=steps).special_points
    halves = mi.switch_branch(fork, bounds=(305.0, 330.0), steps=steps)
    assert halves.symmetry == mirror
    one, other = halves.orbits[0], halves.orbits[-1]
    partner = mirror.image(one)
    assert partner.period == pytest.approx(other.period, abs=1e-8)
    highest = [orbit.samples(4000)["x"].max() for orbit in (partner, one, other)]
    assert highest[0] == pytest.approx(highest[2], abs=1e-4)
    assert abs(highest[1] - highest[2]) > 0.1
    # The sum of exponents of both multipliers is the divergence of the flow.
    shrinking = np.exp(-(10.0 + 1.0 + 8.0 / 3.0) * one.period)
    assert np.prod(partner.multipliers).real == pytest.approx(shrinking, abs=1e-9)
