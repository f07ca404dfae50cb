"""Branches that cannot go on: what there is of them is returned, with a reason."""

import math

import numpy as np
import pytest
from scipy.optimize import root

import mems_impact as mi

PLAIN = mi.Options(method="dop853", rtol=1e-11, atol=1e-13, engine="interpreted")


def flow(mode, t, y, p):
    return y.v, p.A * math.cos(t) - 0.2 * y.v - 2.0 * y.x


def gap(mode, t, y, p):
    return 1.0 - y.x


def undefined(mode, t, y, p):
    """An impact that takes a certain energy out: slower ones are not foreseen."""
    left = y.v * y.v - 0.1
    return mode, (1.0, -math.sqrt(left) if left > 0.0 else math.nan)


def out_of_range(mode, t, y, p):
    return mode, (1.0, -math.sqrt(y.v * y.v - 0.1))


GRAZING = math.hypot(1.0, 0.2)  # the amplitude at which x = A/|2 - 1 + 0.2 i| comes to 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rebound", "reason"),
    [
        (undefined, "not finite"),
        (out_of_range, "math domain error"),
    ],
)
def test_a_contact_that_fails_ends_the_branch_where_it_is_grazed(rebound, reason):
    system = mi.System(
        states=("x", "v"),
        flow=flow,
        period=2.0 * math.pi,
        parameters={"A": 1.0},
        guards=[mi.Impact("wall", gap, rebound)],
    )
    start = mi.State(x=1.0 / 1.04, v=0.2 / 1.04)
    orbit = mi.find_orbit(system, guess=start, options=PLAIN)
    branch = mi.continue_solution(orbit, "A", 1.1)
    assert len(branch) > 1
    (grazing,) = branch.special_points
    assert grazing.value == pytest.approx(GRAZING, abs=1e-9)
    assert branch.ended.startswith("grazing: ")
    assert reason in branch.ended
    assert branch.table["A"].iloc[-1] == pytest.approx(GRAZING, abs=1e-9)


def rattle(mode, t, y, p):
    drag = 0.05 * (y.v2 - y.v1) + p.c * (y.v2 - y.v1) ** 3
    return y.v1, p.A * math.cos(p.w * t) - y.x1 - 0.1 * y.v1 + 0.2 * drag, y.v2, -drag


def right(mode, t, y, p):
    return 0.5 - (y.x2 - y.x1)


def left(mode, t, y, p):
    return 0.5 + (y.x2 - y.x1)


def knock(mode, t, y, p):
    together = (y.v1 + 0.2 * y.v2) / 1.2
    apart = p.e * (y.v1 - y.v2)
    return mode, (y.x1, together - apart / 6.0, y.x2, together + apart / 1.2)


def rattler(c):
    return mi.System(
        states=("x1", "v1", "x2", "v2"),
        flow=rattle,
        period=lambda p: 2.0 * math.pi / p.w,
        parameters={"A": 0.05, "w": 1.3, "e": 0.9, "c": c},
        guards=[mi.Impact("right", right, knock), mi.Impact("left", left, knock)],
    )


@pytest.mark.nightly
def test_orbits_that_lie_side_by_side_are_reported():
    """A rattler that touches neither stop may swing about any place between them."""
    orbit = mi.find_orbit(mi.simulate(rattler(0.01), periods=300))
    assert np.abs(orbit.multipliers - 1.0).min() < 1e-9
    branch = mi.continue_solution(
        orbit, "w", 2.5, steps=mi.StepControl(max_step=0.05, max_points=20)
    )
    assert len(branch)
    assert "form a continuum" in branch.ended


@pytest.mark.nightly
def test_orbits_that_lie_side_by_side_are_followed_at_what_they_conserve():
    """With a linear drag v2 + 0.05 (x2 - x1) never changes, and tells one from the other."""
    orbit = mi.find_orbit(mi.simulate(rattler(0.0), periods=300))
    assert np.abs(orbit.multipliers - 1.0).min() > 0.1
    branch = mi.continue_solution(orbit, "w", 2.0)
    assert branch.ended == "w reached its bound"
    kept = [q.state.v2 + 0.05 * (q.state.x2 - q.state.x1) for q in branch.orbits]
    np.testing.assert_allclose(kept, kept[0], atol=1e-12)


def integrate(mode, t, y, p):
    return (p.I + p.A * math.cos(2.0 * math.pi * t) - y.v,)


def below_threshold(mode, t, y, p):
    return 1.0 - y.v


def reset(mode, t, y, p):
    return mode, (0.0,)


@pytest.mark.nightly
def test_a_reset_that_is_grazed_ends_the_branch_and_no_distant_orbit_continues_it():
    """A neuron that fires every second period: v = I + forced(t) - (I + forced(s)) exp(s - t)."""
    neuron = mi.System(
        states=("v",),
        flow=integrate,
        period=1.0,
        parameters={"I": 1.1, "A": 0.5},
        guards=[mi.Guard("spike", below_threshold, reset)],
    )
    w = 2.0 * math.pi

    def equations(unknowns):
        level, s = unknowns
        forced = 0.5 * (math.cos(w * s) + w * math.sin(w * s)) / (1.0 + w * w)
        reached = (level + forced) * (1.0 - math.exp(-2.0))
        return reached - 1.0, level + 0.5 * math.cos(w * s) - 1.0

    exact = root(equations, (1.08, 0.28), tol=1e-14).x[0]
    branch = mi.continue_solution(mi.find_orbit(neuron, transient=50), "I", 0.8, back=1.2)
    grazing = branch.special_points[-1]
    assert grazing.label == "spike"
    assert grazing.value == pytest.approx(exact, abs=1e-9)
    assert "the motion may jump" in branch.ended
    assert branch.table["admissible"].all()
    assert len({len(orbit.events) for orbit in branch.orbits}) == 1


def swing(mode, t, y, p):
    return y.v, (1.0 - y.x * y.x) * y.v - y.x


def room(mode, t, y, p):
    return p.d - y.x


def rebound(mode, t, y, p):
    return mode, (p.d, -0.8 * y.v)


@pytest.mark.nightly
def test_a_cycle_with_impacts_shrinks_to_a_boundary_equilibrium_not_to_a_hopf_point():
    """The unstable focus of van der Pol's oscillator meets a wall."""
    system = mi.System(
        states=("x", "v"),
        flow=swing,
        parameters={"d": -0.6},
        guards=[mi.Impact("wall", room, rebound)],
        initial={"x": -1.0},
    )
    cycle = mi.find_orbit(system)
    assert len(cycle.impacts) == 1
    branch = mi.continue_solution(cycle, "d", -1.0, back=0.5)  # beyond a fold
    assert branch.orbits[-1].system.parameters["d"] == pytest.approx(0.0, abs=1e-3)
    assert "shrinks to a point on the boundary of wall: no Hopf point" in branch.ended


def stiffening(mode, t, y, p):
    k = 1.0 if p.a < 0.5 else 2.0
    return y.v, p.a * math.cos(t) - 0.3 * y.v - 1.7 * k * y.x


def weakening(mode, t, y, p):
    return mode, (0.1, (-0.8 if p.a < 0.5 else -0.5) * y.v)


def bounded(mode, t, y, p):
    return 0.1 - y.x


def linear(mode, t, y, p):
    return y.v, p.a * math.cos(t) - 0.3 * y.v - 1.7 * y.x


JUMP = "the equations are discontinuous in a near a = 0.5"


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("flow", "guards"),
    [
        (stiffening, []),  # long arcs beside the jump
        (linear, [mi.Impact("wall", bounded, weakening)]),
    ],
)
def test_a_branch_of_orbits_ends_where_the_equations_jump(flow, guards):
    system = mi.System(
        states=("x", "v"), flow=flow, period=2 * math.pi, parameters={"a": 0.48}, guards=guards
    )
    orbit = mi.find_orbit(mi.simulate(system, periods=100, options=PLAIN))
    branch = mi.continue_solution(orbit, "a", 0.6)
    assert branch.ended.endswith(JUMP)
    assert branch.table["a"].iloc[-1] == pytest.approx(0.5, abs=5e-3)


def test_a_branch_of_equilibria_ends_where_the_equations_jump():
    def flow(mode, t, y, p):
        return (p.a - (1.0 if p.a < 0.5 else 2.0) * y.x,)

    system = mi.System(states=("x",), flow=flow, parameters={"a": 0.2})
    (rest,) = mi.find_equilibria(system)
    branch = mi.continue_solution(rest, "a", 1.0)
    assert branch.ended.endswith(JUMP)
    assert branch.table["a"].iloc[-1] == pytest.approx(0.5, abs=1e-3)


def test_other_ends_are_not_blamed_on_a_jump():
    """A function with a vertical tangent at zero is continuous; the flow is not defined beyond."""

    def flow(mode, t, y, p):
        return (math.sqrt(p.a) - y.x,)

    system = mi.System(states=("x",), flow=flow, parameters={"a": 0.2})
    (rest,) = mi.find_equilibria(system)
    assert "discontinuous" not in mi.continue_solution(rest, "a", -1.0).ended


CURVE_JUMP = "the equations are discontinuous in b near b = 0.5"


@pytest.mark.slow
def test_a_curve_of_equilibria_ends_where_the_equations_jump():
    def flow(mode, t, y, p):
        return (p.a + (1.0 if p.b < 0.5 else 1.3) * y.x - y.x**3,)

    system = mi.System(states=("x",), flow=flow, parameters={"a": 0.0, "b": 0.1})
    branch = mi.continue_solution(mi.find_equilibria(system)[-1], "a", 1.0, back=-1.0)
    curve = mi.continue_curve(branch.special_points[0], "b", 1.0)
    assert curve.ended.endswith(CURVE_JUMP)
    assert curve.table["b"].iloc[-1] == pytest.approx(0.5, abs=1e-3)
