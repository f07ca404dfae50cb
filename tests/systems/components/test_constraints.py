"""Orbits, exponents and equilibria of what contacts hold and surfaces keep for good."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mems_impact as mi

PLAIN = mi.Options(engine="interpreted", method="dop853")
TIGHT = mi.Options(engine="interpreted", method="dop853", rtol=1e-10, atol=1e-12)
TURN = 2.0 * math.pi
SIZES = {"x": 1e-3, "z": 1e-3, "v": 20.0, "w": 20.0, "time": 0.1}


def shaken(mode, t, y, p):
    return y.v, -y.x - 0.2 * y.v + 0.3 * math.cos(t) - p.F, y.w, p.F


def pressed(typical=None):
    """Return two bodies of mass 1 that a force presses together, one on a damped spring."""
    return mi.System(
        states=("x", "v", "z", "w"), flow=shaken, period=TURN, parameters={"F": 2.0},
        masses={"v": 1.0, "w": 1.0}, initial={"x": -0.2, "z": -0.2}, typical=typical,
        parts=[mi.Stopper("touch", "x", "v", lower=0.0, restitution=0.3, against=("z", "w"))],
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("typical", [None, SIZES], ids=["plain", "typical"])
def test_bodies_that_stay_together_have_the_multipliers_of_one_body(typical):
    orbit = mi.find_orbit(pressed(typical), options=TIGHT)
    # (1 + 1) x'' + 0.2 x' + x = 0.3 cos t
    matrix = np.array([[-1.0, 0.2], [-0.2, -1.0]])
    place, speed = np.linalg.solve(matrix, [0.3, 0.0]) * [1.0, 1.0]
    assert [orbit.state.x, orbit.state.z] == pytest.approx([place, place], rel=1e-8)
    assert [orbit.state.v, orbit.state.w] == pytest.approx([speed, speed], rel=1e-7)
    size = math.exp(-0.05 * TURN)
    assert orbit.stable
    assert np.abs(orbit.multipliers) == pytest.approx([size, size, 0.0, 0.0], abs=1e-8)


def test_three_bodies_are_put_together_with_their_distances_and_one_speed():
    def flow(mode, t, y, p):
        return y.a, -2.0, y.b, -3.0, y.c, 0.0

    system = mi.System(
        states=("x", "a", "y", "b", "z", "c"), flow=flow, masses={"a": 1.0, "b": 2.0, "c": 3.0},
        initial={"x": 1.0, "y": 0.5}, parameters={"d": 0.3},
        parts=[mi.Stopper("one", "x", "a", lower="d", restitution=0.3, against=("y", "b")),
               mi.Stopper("two", "y", "b", lower=0.2, restitution=0.2, against=("z", "c"))],
    )  # fmt: skip
    automaton, p = system.automaton, np.array(system.problem(PLAIN).parameters)
    assert [system.modes[mode] for mode in automaton.constrained] == [
        "held-free", "free-held", "held-held",
    ]  # fmt: skip
    code = automaton.projection_code
    for name, ties in (("held-free", 2), ("free-held", 2), ("held-held", 4)):
        mode, y = system.modes.index(name), np.array([1.0, 0.3, 0.5, -0.2, 0.1, 0.7])
        before = y.copy()
        assert automaton.transition(mode, code, 0.0, y, p) == mode
        one, two = name.split("-")
        gaps = [y[0] - y[2] - 0.3, y[1] - y[3]] if one == "held" else []
        gaps += [y[2] - y[4] - 0.2, y[3] - y[5]] if two == "held" else []
        assert len(gaps) == ties
        assert gaps == pytest.approx([0.0] * ties, abs=1e-15)
        assert y[::2].sum() == pytest.approx(before[::2].sum())  # the nearest such state
        once = y.copy()
        automaton.transition(mode, code, 0.0, y, p)
        assert y == pytest.approx(once, abs=1e-15)


@pytest.mark.nightly
def test_sliding_along_a_curved_surface_has_one_multiplier():
    def flow(mode, t, y, p):
        return y.v, -4.0 * mode.line - y.x + 0.3 * math.cos(t)

    def height(t, y, p):
        return y.x + 0.2 * y.x**2 + y.v + 0.1 * math.cos(t)

    system = mi.System(
        states=("x", "v"), flow=flow, period=TURN, parameters={"level": 0.3}, initial={"x": 0.2},
        parts=[mi.SwitchingSurface("line", height, level="level")],
    )  # fmt: skip

    def slides(t, u):
        x = u[0]
        return [0.3 - x - 0.2 * x**2 - 0.1 * math.cos(t), -(1.0 + 0.4 * x)]

    exact = {"rtol": 1e-12, "atol": 1e-13}
    settled = solve_ivp(slides, (0.0, 6.0 * TURN), [0.2, 0.0], **exact).y[0, -1]
    growth = solve_ivp(slides, (0.0, TURN), [settled, 0.0], **exact).y[1, -1]
    run = mi.simulate(system, periods=2, options=PLAIN)
    orbit = mi.find_orbit(run, options=TIGHT)
    assert orbit.state.mode == "sliding"
    assert orbit.state.x == pytest.approx(settled, rel=1e-8)
    assert orbit.multipliers == pytest.approx([math.exp(growth), 0.0], abs=1e-9)
    assert height(0.0, orbit.state, None) == pytest.approx(0.3, abs=1e-10)
    spectrum = mi.lyapunov(run, 2, transient=0, periods=40, options=PLAIN)
    assert spectrum.exponents == pytest.approx([growth / TURN, -math.inf], rel=1e-5)
    assert spectrum.kind == "periodic"


def damped(mode, t, y, p):
    return y.y - 0.3 * y.x + 0.1 * mode.line, -y.x - 0.5 * y.y - mode.line + p.q


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("h", "slope"),
    [({"y": 1.0}, (0.0, 1.0)), ({"x": 0.3, "y": 0.7}, (0.3, 0.7)),
     ({"x": "c", "y": 1.0}, (0.5, 1.0))],
    ids=["state", "slanted", "parameter"],
)  # fmt: skip
def test_an_equilibrium_on_a_surface_is_one_and_has_the_eigenvalues_along_it(h, slope):
    system = mi.System(
        states=("x", "y"), flow=damped, parameters={"q": 0.3, "c": 0.5},
        initial={"x": 0.1, "y": 0.5}, parts=[mi.SwitchingSurface("line", h, level=0.2)],
    )  # fmt: skip
    bounds = {"x": (-2.0, 2.0), "y": (-2.0, 2.0)}
    (found,) = mi.find_equilibria(system, box=bounds, samples=8, modes=["sliding"])
    # Filippov's method: the share u of both flows makes h' zero.
    flow, switched, gradient = np.array([[-0.3, 1.0], [-1.0, -0.5]]), [0.1, -1.0], np.array(slope)
    whole = np.block([[flow, np.array([switched]).T], [gradient, 0.0]])
    x, y, _ = np.linalg.solve(whole, [0.0, -0.3, 0.2])
    kept = flow - np.outer(switched, gradient @ flow) / (gradient @ switched)
    along = np.array([slope[1], -slope[0]])
    assert [found.state.x, found.state.y] == pytest.approx([x, y], rel=1e-12)
    assert found.eigenvalues == pytest.approx([along @ kept @ along / (along @ along)], rel=1e-9)
    assert (found.stable, found.admissible, found.nullity) == (True, True, 0)


def test_an_equilibrium_leaves_its_surface_where_one_flow_reverses():
    system = mi.System(
        states=("x", "y"), flow=damped, parameters={"q": 0.3},
        initial={"x": 0.25, "y": 0.075},
        parts=[mi.SwitchingSurface("line", {"x": 0.5, "y": 1.0}, level=0.2)],
    )  # fmt: skip
    (found,) = mi.find_equilibria(system, modes=["sliding"])
    branch = mi.continue_solution(found, "q", stop=1.5)
    (point,) = branch.special_points
    assert (point.label, point.value) == ("BE", pytest.approx(1.38125, rel=1e-10))
    assert point.guard == "line leaves up"


def test_bodies_at_rest_on_each_other_stand_still_as_one():
    def flow(mode, t, y, p):
        return y.v, -y.x - 0.2 * y.v - 2.0, y.w, 2.0

    system = mi.System(
        states=("x", "v", "z", "w"), flow=flow, masses={"v": 1.0, "w": 1.0},
        initial={"x": 0.1, "z": -0.1},
        parts=[mi.Stopper("touch", "x", "v", lower=0.4, restitution=0.3, against=("z", "w"))],
    )  # fmt: skip
    (found,) = mi.find_equilibria(system)
    assert found.state.as_dict() == pytest.approx({"x": 0.0, "v": 0.0, "z": -0.4, "w": 0.0})
    assert (found.stable, found.admissible, found.nullity) == (True, True, 0)
    roots = np.roots([2.0, 0.2, 1.0])
    assert found.eigenvalues == pytest.approx(sorted(roots, key=lambda root: -root.imag), rel=1e-9)


@pytest.mark.quick(2)
@pytest.mark.parametrize("stiffness", [0.5, 2.9e3, 5.2e3, 2.4e4, 3e5])
def test_bodies_that_rest_on_each_other_anywhere_are_a_continuum(stiffness):
    """Rounding errors of a stiff spring, whose force the contact cancels, leave no eigenvalue."""

    def flow(mode, t, y, p):
        near = p.k * (y.x - y.z)
        return y.v, -near - 0.1 * y.v - 2.0, y.w, (near - 0.3 * y.w + 2.0) / 3.0

    system = mi.System(
        states=("x", "v", "z", "w"), flow=flow, masses={"v": 1.0, "w": 3.0},
        parameters={"k": stiffness}, initial={"x": 0.1, "z": -0.2},
        parts=[mi.Stopper("touch", "x", "v", lower=1.0 / 3.0, restitution=0.3, against=("z", "w"))],
    )  # fmt: skip
    (found,) = mi.find_equilibria(system, modes=["held"])
    assert (found.stable, found.nullity) == (True, 1)
    assert found.eigenvalues == pytest.approx([-0.1], rel=2e-12 * stiffness + 1e-9)


def carried(mode, t, y, p):
    near = y.x - y.z
    return y.v, -(y.x**3) - 0.2 * y.v + 0.3 * math.cos(t) - near, y.w, -0.5 * y.z + near


@pytest.mark.nightly
def test_a_body_stuck_to_another_one_anywhere_has_a_stable_orbit_for_each_place():
    system = mi.System(
        states=("x", "v", "z", "w"), flow=carried, period=TURN, masses={"v": 1.0, "w": 1.0},
        initial={"x": 0.1, "z": -0.4}, parts=[mi.Friction("rub", "v", mu=5.0, surface="w")],
    )  # fmt: skip
    orbit = mi.find_orbit(system, options=TIGHT)
    assert orbit.state.x - orbit.state.z == pytest.approx(0.5, abs=1e-12)
    # 2 x'' + 0.2 x' + x^3 + (x - 0.5)/2 = 0.3 cos t: volumes shrink with exp(-0.1 t).
    assert np.prod(orbit.multipliers[:2]).real == pytest.approx(math.exp(-0.1 * TURN), rel=1e-8)
    assert orbit.multipliers[2] == pytest.approx(0.0, abs=1e-12)
    assert orbit.stable
    other = mi.find_orbit(system, guess={"x": 0.1, "z": 0.0}, options=TIGHT)
    assert other.state.x - other.state.z == pytest.approx(0.1, abs=1e-12)


@pytest.mark.slow
def test_a_motion_that_repeats_at_any_place_is_periodic():
    def flow(mode, t, y, p):
        return y.v, -y.x - 0.2 * y.v + 0.3 * math.cos(t)

    block = mi.System(
        states=("x", "v"), flow=flow, period=TURN, initial={"x": 0.5},
        parts=[mi.Friction("ground", "v", mu=5.0)],
    )  # fmt: skip
    spectrum = mi.lyapunov(block, 2, transient=0, periods=40, options=PLAIN)
    assert spectrum.exponents == pytest.approx([0.0, -math.inf], abs=1e-9)
    assert spectrum.kind == "periodic"
