"""Switching at branch points, against branches in closed form."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

import mems_impact as mi

INTERPRETED = mi.Options(method="dop853", engine="interpreted")


def forks(flow, stop=1.0, start=-1.0, states=("x",), longest=0.2, typical=None, **values):
    """Return the branch points of the equilibrium zero."""
    system = mi.System(states=states, flow=flow, parameters={"a": start, **values}, typical=typical)
    rest = mi.find_equilibria(system, guess={"x": values.get("k", 0.0) * start})[0]
    steps = mi.StepControl(max_step=longest)
    return mi.continue_solution(rest, "a", stop, steps=steps).special_points


@pytest.mark.quick(1)
@pytest.mark.parametrize("error", [0.0, 1e-10])
def test_both_halves_of_a_pitchfork(error):
    (fork,) = forks(lambda mode, t, y, p: (p.a * y.x - y.x**3 + p.error,), error=error)
    halves = mi.switch_branch(fork)
    assert [special.label for special in halves.special_points] == ["BP"]
    assert abs(halves.special_points[0].value) < 1e-12
    x, a = (halves.table[name].to_numpy() for name in ("x", "a"))
    assert np.allclose(x**3 - a * x, error, atol=1e-9)
    assert np.all(np.diff(x) < 0.0)  # in the order of the branch
    assert x[[0, -1]] == pytest.approx([1.0, -1.0], abs=1e-9)
    assert halves.ended == "a reached its bound"


def test_points_beyond_a_step_are_not_those_within():
    """The growth rate falls to the level from which its slope before leads to a zero at 10."""

    def rate(a):
        return 1.0 - 0.1 * a - math.tanh(25.0 * (a - 1.0)) + math.tanh(25.0 * (a - 3.0))

    found = forks(lambda mode, t, y, p: (rate(p.a) * y.x - y.x**3,), 4.0, 0.0, longest=0.5)
    exact = [brentq(rate, low, low + 1.0, xtol=1e-15) for low in (0.5, 2.5)]
    assert [fork.value for fork in found] == pytest.approx(exact, abs=1e-10)


def test_a_transcritical_branch_is_continued_on_both_sides():
    (crossing,) = forks(lambda mode, t, y, p: ((p.a - 0.3) * y.x - y.x**2,))
    assert crossing.value == pytest.approx(0.3, abs=1e-13)
    other = mi.switch_branch(crossing, bounds=(-0.5, 0.8))
    x, a = (other.table[name].to_numpy() for name in ("x", "a"))
    assert np.allclose(x, a - 0.3, atol=1e-12)
    assert a[[0, -1]].tolist() == [0.8, -0.5]
    assert other.table["stable"].iloc[[0, -1]].tolist() == [True, False]
    # The branch through it is the one of the start, from the side of the other branch.
    back = mi.switch_branch(other.special_points[0])
    assert np.abs(back.table["x"]).max() < 1e-12


def test_one_side_that_folds_back_and_one_that_does_not():
    def flow(mode, t, y, p):
        return (p.a * y.x - y.x**2 + y.x**3,)

    other = mi.switch_branch(forks(flow)[0])
    assert [special.label for special in other.special_points] == ["LP", "BP"]
    assert other.special_points[0].value == pytest.approx(0.25, abs=1e-12)  # a = x - x^2


@pytest.mark.nightly
def test_the_pitchfork_of_the_lorenz_system():
    def lorenz(mode, t, y, p):
        return 10.0 * (y.y - y.x), y.x * (p.a - y.z) - y.y, y.x * y.y - 8.0 / 3.0 * y.z

    (fork,) = forks(lorenz, start=0.5, stop=28.0, states=("x", "y", "z"), longest=2.0)
    assert fork.value == pytest.approx(1.0, abs=1e-10)
    halves = mi.switch_branch(fork, steps=mi.StepControl(max_step=2.0))
    hopf = 10.0 * (10.0 + 8.0 / 3.0 + 3.0) / (10.0 - 8.0 / 3.0 - 1.0)
    assert [special.label for special in halves.special_points] == ["H", "BP", "H"]
    found = [halves.special_points[i].value for i in (0, 2)]
    assert found == pytest.approx([hopf, hopf], abs=1e-8)
    x, r = (halves.table[name].to_numpy() for name in ("x", "a"))
    assert np.allclose(x**2, 8.0 / 3.0 * (r - 1.0), atol=1e-9)


def transcritical(mode, t, y, p):
    x = y.x - p.k * p.a
    return (p.s * x * (p.a - p.c * x),)


def fork(mode, t, y, p):
    x = y.x - p.k * p.a
    return (p.s * x * (p.a - p.c * x**2),)


ANGLES = [
    (1e-6, 0.0, 1e6), (1e-4, 0.4, 1.0), (0.02, 0.0, 1e-6), (40.0, 0.4, 1.0), (3e4, 0.4, 1.0),
    (3e5, 0.0, 1e-6), (1e6, 0.0, 1.0), (3e6, 0.0, 1e-6),
]  # fmt: skip


@pytest.mark.parametrize(("c", "k", "s"), ANGLES)
@pytest.mark.parametrize(("flow", "power"), [(transcritical, 1), (fork, 2)], ids=["TC", "PF"])
def test_branches_cross_at_any_angle(flow, power, c, k, s):
    """In other units of x and t, c and s are other numbers; the branch is a = c (x - k a)^power."""
    (crossing,) = forks(flow, c=c, k=k, s=s)
    other = mi.switch_branch(crossing, steps=mi.StepControl(max_points=8))
    x, a = (other.table[name].to_numpy() for name in ("x", "a"))
    apart = x - k * a
    assert np.allclose(a, c * apart**power, rtol=2e-10, atol=1e-14 + 1e-16 * c * k)
    assert min(apart.max(), -apart.min()) > 1e-10
    assert [special.label for special in other.special_points] == ["BP"]


@pytest.mark.parametrize("c", [1e-10, 1e10])
def test_a_pitchfork_in_other_units(c):
    """The typical size of x is that at a = 1."""
    size = 1.0 / math.sqrt(c)
    (crossing,) = forks(fork, c=c, k=0.0, s=1.0, typical={"x": size})
    table = mi.switch_branch(crossing, steps=mi.StepControl(max_points=30)).table
    assert table["a"].max() > 0.1
    assert np.allclose(table["a"], c * table["x"] ** 2, rtol=1e-10, atol=1e-15)


@pytest.mark.parametrize(("power", "c", "s"), [(1, 2e4, 3.0), (2, 3e5, 0.1), (2, 1e-6, 3.0)])
def test_branches_of_orbits_cross_at_any_angle(power, c, s):
    """Of Bernoulli's equation, whose periodic solution is an integral: x and a within 1e-10."""

    def flow(mode, t, y, p):
        return (y.x * (p.s * (p.a - p.c * y.x**power) + 0.3 * math.cos(t)),)

    def growth(t, a):
        return math.exp(power * (s * a * t + 0.3 * math.sin(t)))

    values = {"a": -0.4, "c": c, "s": s}
    system = mi.System(states=("x",), flow=flow, parameters=values, period=2.0 * math.pi)
    options = mi.Options(method="dop853", rtol=1e-12, atol=1e-14)
    rest = mi.find_orbit(system, guess={"x": 0.0}, periods=1, options=options)
    (crossing,) = mi.continue_solution(rest, "a", 0.2).special_points
    assert abs(crossing.value) < 1e-9
    other = mi.switch_branch(crossing, steps=mi.StepControl(max_points=5))
    assert [special.label for special in other.special_points] == ["BP"]
    x, a = (other.table[name].to_numpy() for name in ("x", "a"))
    for place, value in zip(x[a != crossing.value], a[a != crossing.value], strict=True):
        change = growth(2.0 * math.pi, value) - 1.0
        fed = power * s * c * quad(growth, 0.0, 2.0 * math.pi, (value,), epsabs=0.0)[0]
        slopes = 2.0 * math.pi * s, fed * abs(place) ** (power - 1)
        assert abs(fed * place**power - change) < 1e-10 * power * max(slopes)
    assert min(x.max(), -x.min()) > 1e-10


@pytest.mark.nightly
def test_where_the_branching_equation_is_degenerate():
    """Four lines through one point: the equations have no second derivatives there."""

    def flow(mode, t, y, p):
        return (y.x * (p.a - y.x) * (p.a + 2.0 * y.x) * (p.a - 4.0 * y.x),)

    other = mi.switch_branch(forks(flow)[0])
    x, a = (other.table[name].to_numpy() for name in ("x", "a"))
    ratios = x[np.abs(a) > 0.1] / a[np.abs(a) > 0.1]
    assert min(np.abs(ratios - ratio).max() for ratio in (1.0, -0.5, 0.25)) < 1e-4
    assert np.abs(a[[0, -1]]).tolist() == [1.0, 1.0]


def test_a_continuum_at_one_value_is_no_branch():
    (crossing,) = forks(lambda mode, t, y, p: (p.a * y.x,))
    with pytest.raises(mi.OrbitError, match="continuum"):
        mi.switch_branch(crossing)


@pytest.mark.slow
def test_cycles_begin_small_at_a_hopf_point():
    """Also where their amplitude sqrt(a - 100) is that of a relative change below 1e-7."""

    def flow(mode, t, y, p):
        grows = p.a - 100.0 - y.x**2 - y.v**2
        return grows * y.x - y.v, y.x + grows * y.v

    system = mi.System(states=("x", "v"), flow=flow, parameters={"a": 99.0})
    rest = mi.find_equilibria(system, guess={"x": 0.0})[0]
    (hopf,) = mi.continue_solution(rest, "a", 101.0).special_points
    cycles = mi.switch_branch(hopf, bounds=(99.0, 101.0), steps=mi.StepControl(max_points=2)).orbits
    radii = np.array([math.hypot(cycle.state.x, cycle.state.v) for cycle in cycles])
    values = np.array([cycle.system.parameters["a"] for cycle in cycles])
    assert values - 100.0 == pytest.approx(radii**2, abs=1e-9)
    assert 0.0 < radii[0] < 0.05


def fork_map(mode, t, y, p):
    return mode, ((1.0 + p.a) * y.x - y.x**3 + 0.5 * y.w, 0.3 * y.w + 0.2 * y.x**3)


@pytest.mark.slow
def test_the_pitchfork_of_a_map():
    system = mi.System(
        states=("x", "w"),
        flow=lambda mode, t, y, p: (0.0, 0.0),
        switch_transition=fork_map,
        switches=(0.5,),
        period=1.0,
        parameters={"a": -0.3},
    )
    start = mi.find_orbit(system, periods=1, options=INTERPRETED, guess=mi.State(x=0.0, w=0.0))
    steps = mi.StepControl(max_step=0.1)
    (fork,) = mi.continue_solution(start, "a", 0.4, steps=steps).special_points
    assert abs(fork.value) < 1e-11
    halves = mi.switch_branch(fork, steps=steps)
    assert [special.label for special in halves.special_points] == ["BP"]
    x, a = (halves.table[name].to_numpy() for name in ("x", "a"))
    assert np.allclose(x**3 - a * x, 0.5 * 0.2 / 0.7 * x**3, atol=1e-10)
    assert x[0] == pytest.approx(math.sqrt(0.4 / (1.0 - 0.1 / 0.7)), abs=1e-9)
    assert x[-1] == pytest.approx(-x[0], abs=1e-9)


def stops(mode, t, y, p):
    return y.v, p.A * math.cos(p.w * t) - 2.0 * p.z * y.v - y.x


def rebound(mode, t, y, p):
    return mode, (y.x, -p.e * y.v)


@pytest.mark.nightly
def test_symmetry_breaking_of_an_impact_pair():
    """A ball between the walls of a box of width 1 that moves by A sin t, in the frame of the box.

    The linearized half period of the orbit with one impact on each wall, mirrored, has the
    determinant e^2 and the trace 2 e - (1 + e)^2 pi A sin(phi) / (2 w), with the ball's speed w and
    the phase phi of impacts. A multiplier is -1 where 2 w = pi A sin(phi).
    """
    pair = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, p.A * math.sin(t)),
        period=2.0 * math.pi,
        parameters={"A": 0.34, "e": 0.6},
        guards=[
            mi.Impact("right wall", lambda mode, t, y, p: 0.5 - y.x, rebound),
            mi.Impact("left wall", lambda mode, t, y, p: 0.5 + y.x, rebound),
        ],
        initial={"v": 1.0},
    )

    def amplitude(e):
        sine = 2.0 / (math.pi**2 - 4.0)
        return math.hypot(sine, 0.5 * math.pi * sine * (1.0 - e) / (1.0 + e))

    assert amplitude(0.6) == pytest.approx(0.36606993622, abs=1e-11)
    branch = mi.continue_solution(mi.find_orbit(pair, transient=100), "A", 0.45)
    (fork,) = (special for special in branch.special_points if special.label == "BP")
    assert fork.value == pytest.approx(amplitude(0.6), abs=1e-10)
    curve = mi.continue_curve(fork, "e", 0.7)
    for e, A in zip(curve.table["e"], curve.table["A"], strict=True):
        assert amplitude(e) == pytest.approx(A, abs=1e-10)
    halves = mi.switch_branch(fork)
    first, last = halves.orbits[0], halves.orbits[-1]
    flights = [np.ptp(orbit.impacts["t"]) for orbit in (first, last)]
    assert sum(flights) == pytest.approx(2.0 * math.pi, abs=1e-8)
    assert abs(flights[0] - math.pi) > 0.1
