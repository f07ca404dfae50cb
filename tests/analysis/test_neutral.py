"""Motions with a multiplier on the unit circle, or an imaginary eigenvalue, within its error."""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.orbits.spectrum import eigenvalues_stable, multipliers_stable

PLAIN = mi.Options(engine="interpreted", method="dop853")


def oscillator(mode, t, y, p):
    return y.v, -p.k * y.x - p.c * y.v


def forced(mode, t, y, p):
    return y.v, -p.k * y.x - p.c * y.v + math.cos(t)


def test_an_undamped_resonator_under_force_is_neutral_and_a_damped_one_stable():
    """Multipliers exp(2 pi (-c/2 +- i sqrt(k - c^2/4)))."""
    for c, stable in ((0.0, None), (1e-5, True), (-1e-5, False)):
        system = mi.System(
            states=("x", "v"),
            flow=forced,
            period=2.0 * math.pi,
            parameters={"k": 2.0, "c": c},
            typical={"c": 1e-5},
        )
        orbit = mi.find_orbit(system, guess={"x": 1.0}, periods=1, options=PLAIN)
        exact = math.exp(-math.pi * c)
        np.testing.assert_allclose(np.abs(orbit.multipliers), exact, rtol=0, atol=1e-9)
        assert orbit.stable is stable
        assert {None: "neutral", True: "stable", False: "unstable"}[stable] in repr(orbit)


@pytest.mark.slow
@pytest.mark.parametrize(("method", "rtol"), [("bdf", 1e-6), ("adams", 1e-6), ("bdf", 1e-9)])
@pytest.mark.parametrize(("c", "stable"), [(0.0, None), (1e-3, True), (-1e-3, False)])
def test_the_width_of_neutral_is_the_error_of_the_multipliers(method, rtol, c, stable):
    """Twenty oscillations in a period: without damping moduli are wrong by up to 2.4e-4."""
    system = mi.System(
        states=("x", "v"), flow=forced, period=2.0 * math.pi, parameters={"k": 400.7, "c": c}
    )
    options = mi.Options(method=method, rtol=rtol, atol=0.01 * rtol, engine="interpreted")
    orbit = mi.find_orbit(system, guess={"x": 0.1}, periods=1, options=options)
    assert orbit.stable is stable


@pytest.mark.slow
def test_errors_of_multipliers_are_no_bifurcations_of_a_neutral_branch():
    system = mi.System(
        states=("x", "v"), flow=forced, period=2.0 * math.pi, parameters={"k": 2.0, "c": 0.0}
    )
    options = mi.Options(method="adams", rtol=1e-7, atol=1e-9)
    orbit = mi.find_orbit(system, guess={"x": 0.1}, periods=1, options=options)
    branch = mi.continue_solution(orbit, "k", stop=2.2)
    assert branch.table["stable"].isna().all()
    assert branch.special_points == ()


def test_a_ball_between_elastic_walls_is_neutral_where_it_is_elliptic_and_unstable_elsewhere():
    """Fermi and Ulam: trace 2 - 2 a T/V on the left, 2 + 2 a T/V on the right turning point."""
    period = 2.0 * math.pi
    walls = mi.System(
        states=("x", "v"), flow=lambda mode, t, y, p: (y.v, 0.0), period=period,
        parameters={"a": 0.2, "L": 2.0}, initial={"x": 1.0, "v": 1.0},
        guards=[
            mi.Impact(
                "moving", lambda mode, t, y, p: y.x - p.a * math.sin(t),
                lambda mode, t, y, p: (mode, (y.x, 2.0 * p.a * math.cos(t) - y.v)),
            ),
            mi.Impact(
                "fixed", lambda mode, t, y, p: p.L - y.x,
                lambda mode, t, y, p: (mode, (y.x, -y.v)),
            ),
        ],
    )  # fmt: skip
    for wall, part, stable in ((-0.2, 0.25, None), (0.2, 0.75, False)):
        speed = 2.0 * (2.0 - wall) / period
        guess = {"x": wall + speed * part * period, "v": speed}
        if guess["x"] > 2.0:
            guess = {"x": 4.0 - guess["x"], "v": -speed}
        orbit = mi.find_orbit(walls, guess=guess, periods=1, options=PLAIN)
        trace = 2.0 + 2.0 * wall * period / speed
        assert np.sum(orbit.multipliers).real == pytest.approx(trace, abs=1e-8)
        assert orbit.stable is stable


def test_equilibria_of_damping_one_part_in_1e15_are_neutral():
    for c, stable in ((1e-15, None), (-1e-15, None), (0.0, None), (1e-6, True), (-1e-6, False)):
        system = mi.System(states=("x", "v"), flow=oscillator, parameters={"k": 1e6, "c": 1e3 * c})
        (rest,) = mi.find_equilibria(system)
        assert rest.stable is stable


def test_a_branch_of_centers_is_neutral_in_tables_files_and_figures(tmp_path):
    system = mi.System(states=("x", "v"), flow=oscillator, parameters={"k": 1.0, "c": 0.0})
    (rest,) = mi.find_equilibria(system)
    branch = mi.continue_solution(rest, "k", stop=2.0)
    assert branch.table["stable"].isna().all()
    branch.save(tmp_path / "branch.zip")
    assert mi.load(tmp_path / "branch.zip").table["stable"].isna().all()
    label = mi.plot_branch(branch).get_lines()[0].get_label()
    assert label == "neutral equilibrium"


def test_the_stability_of_a_matrix_does_not_hang_on_rounding():
    shear = np.array([[1.0, 5.0], [1e-12, 1.0]])  # multipliers 1 +- 2e-6
    assert multipliers_stable(shear) is None
    sizes = np.array([1.0, 1e6])
    assert multipliers_stable(shear * sizes[:, None] / sizes, sizes) is None
    nilpotent = np.array([[0.0, 1e5], [0.0, 0.0]])
    assert multipliers_stable(nilpotent, np.array([1e5, 1.0])) is True
    assert multipliers_stable(np.array([[1.0, 0.0], [0.0, 2.0]])) is False
    assert eigenvalues_stable(np.array([[0.0, 1.0], [-1.0, 1e-15]]), 0) is None
    assert eigenvalues_stable(np.diag([0.0, -1.0]), 1) is True


@pytest.mark.slow
def test_neutral_cycles_at_a_hopf_point_are_no_line_of_a_figure():
    """Cycles m = c r^2 of the normal form, with the multiplier exp(-4 pi m)."""
    system = mi.System(
        states=("x", "y"),
        flow=lambda mode, t, y, p: (
            p.m * y.x - y.y - p.c * y.x * (y.x**2 + y.y**2),
            y.x + p.m * y.y - p.c * y.y * (y.x**2 + y.y**2),
        ),
        parameters={"m": -0.1, "c": 1e-3},
    )
    (rest,) = mi.find_equilibria(system)
    (hopf,) = mi.continue_solution(rest, "m", stop=0.1).special_points
    cycles = mi.switch_branch(hopf, bounds=(-0.1, 0.1), steps=mi.StepControl(initial_step=1e-3))
    assert cycles.table["stable"].isna().sum() > 1
    assert [line.get_label() for line in mi.plot_branch(cycles).get_lines()] == ["stable orbit"]
