"""Multipliers over many orders of magnitude, and orbits near which perturbations grow as much."""

import cmath
import math

import mpmath
import numpy as np
import pytest

import mems_impact as mi
from mems_impact.orbits.periodic_schur import product_eigenvalues


def largest_error(factors):
    """Return the largest relative error of the eigenvalues of a product, with 120 digits."""
    with mpmath.workdps(120):
        product = mpmath.eye(factors.shape[1])
        for factor in factors:
            product = mpmath.matrix(factor.tolist()) * product
        exact = mpmath.eig(product, left=False, right=False)
        found = product_eigenvalues(factors)[0].tolist()
        return max(min(float(abs(z / w - 1)) for z in found) for w in exact)


@pytest.mark.parametrize(("size", "count", "orders"), [(2, 10, 30), (4, 30, 60), (7, 25, 45)])
def test_eigenvalues_of_a_product_are_right_over_many_orders(size, count, orders):
    rng = np.random.default_rng(size)
    growth = np.diag(10.0 ** (orders / count * np.linspace(0.5, -0.5, size)))
    bases = [rng.standard_normal((size, size)) + 2.0 * np.eye(size) for _ in range(count)]
    after = bases[1:] + bases[:1]
    pairs = zip(bases, after, strict=True)
    assert largest_error(np.array([b @ growth @ np.linalg.inv(a) for a, b in pairs])) < 1e-10


def test_pairs_of_a_product_are_conjugate_and_right_over_30_orders():
    rng, turns = np.random.default_rng(3), np.zeros((15, 4, 4))
    for rows, rate, angle in ((slice(0, 2), 10.0, 0.3), (slice(2, 4), 0.1, 0.7)):
        c, s = math.cos(angle), math.sin(angle)
        turns[:, rows, rows] = rate * np.array([[c, -s], [s, c]])
    bases = [np.eye(4) + 0.3 * rng.standard_normal((4, 4)) for _ in turns]
    after = bases[1:] + bases[:1]
    factors = np.array(
        [b @ turn @ np.linalg.inv(a) for a, b, turn in zip(bases, after, turns, strict=True)]
    )
    values = product_eigenvalues(factors)[0]
    assert values[0] == values[1].conjugate()
    assert values[2] == values[3].conjugate()
    assert largest_error(factors) < 1e-10


def test_a_singular_factor_has_no_effect_on_the_other_eigenvalues():
    rng = np.random.default_rng(8)
    factors = rng.standard_normal((6, 3, 3))
    factors[2, :, 0] = 0.0
    values = product_eigenvalues(factors)[0]
    exact = np.linalg.eigvals(np.linalg.multi_dot(factors[::-1]))
    exact = exact[np.argsort(-np.abs(exact))]
    np.testing.assert_allclose(values[:2], exact[:2], rtol=1e-12)
    assert abs(values[2]) < 1e-14 * abs(values[0])


@pytest.mark.slow
def test_multipliers_of_a_rotating_frame_are_right_to_1e_8_over_30_orders():
    """Rates 5 and -5 in a frame that turns once a period: multipliers exp(±5 T), exp(-T)."""

    def flow(mode, t, y, p):
        c, s = math.cos(t * p.w), math.sin(t * p.w)
        da = 5.0 * (c * y.x + s * y.y)
        db = -5.0 * (c * y.y - s * y.x) + 0.2 * da
        return c * da - s * db - p.w * y.y + c, s * da + c * db + p.w * y.x, da - y.z

    system = mi.System(
        states=("x", "y", "z"),
        flow=flow,
        period=lambda p: 2.0 * math.pi / p.w,
        parameters={"w": 2.0 * math.pi},
    )
    first = mi.find_orbit(system, guess={"x": 0.0, "y": 0.0, "z": 0.0}, periods=1)
    orbit = mi.continue_solution(first, "w", stop=2.0 * math.pi / 7.0).orbits[-1]
    exact = np.exp([35.0, -7.0, -35.0])
    np.testing.assert_allclose(orbit.multipliers, exact, rtol=1e-8)


@pytest.mark.slow
def test_multipliers_of_pairs_are_right_over_45_orders():
    """Constant coefficients, in other states: multipliers exp(T (4 ± i)), exp(T (-4 ± 2 i))."""

    def flow(mode, t, y, p):
        a, b, c, d = y.a, y.b - 0.5 * y.a, y.c - y.b, y.d + y.a
        da, db = 4.0 * a - b + math.cos(2.0 * math.pi * t / p.T), a + 4.0 * b
        dc, dd = -4.0 * c - 2.0 * d + a, 2.0 * c - 4.0 * d
        dy = db + 0.5 * da
        return da, dy, dc + dy, dd - da

    system = mi.System(
        states=("a", "b", "c", "d"), flow=flow, period=lambda p: p.T, parameters={"T": 1.0}
    )
    start = dict.fromkeys("abcd", 0.0)
    first = mi.find_orbit(system, guess=start, periods=1)
    orbit = mi.continue_solution(first, "T", stop=13.0).orbits[-1]
    for rate in (4.0 + 1.0j, -4.0 + 2.0j):
        exact = cmath.exp(13.0 * rate)
        for value in (exact, exact.conjugate()):
            assert np.abs(orbit.multipliers / value - 1.0).min() < 1e-8


def turned(slow, fast):
    """Return a flow with these rates along two axes that turn once in 2 pi, pushed by cos(2 t)."""

    def flow(mode, t, y, p):
        c, s = math.cos(t), math.sin(t)
        a, b = slow * (c * y.x + s * y.y), fast * (c * y.y - s * y.x)
        return c * a - s * b - y.y + p.push * math.cos(2.0 * t), s * a + c * b + y.x

    return flow


def halved(mode, t, y, p):
    return mode, (0.5 * y.x + 0.25 * y.y + 0.1, y.x - 0.75 * y.y)


@pytest.mark.parametrize(
    ("push", "jumps", "decay"),
    [(1.0, False, 69.0), (0.0, False, 69.0), (1.0, True, 69.0), (1.0, False, 300.0)],
)
def test_small_multipliers_beside_one_of_order_one(push, jumps, decay):
    """30 orders of magnitude, of a motion and of rest; the jump at t = 1 has determinant -5/8.

    Over 130 orders the rounded derivatives of a longer piece may be singular.
    """
    slow, fast = -0.5 / (2.0 * math.pi), -decay / (2.0 * math.pi)
    system = mi.System(
        states=("x", "y"),
        flow=turned(slow, fast),
        period=2.0 * math.pi,
        parameters={"push": push},
        guards=[mi.Guard("clock", lambda mode, t, y, p: math.sin(1.0 - t), halved)] * jumps,
    )
    # By default tolerances the instant of the jump is known to 1e-10, and the multiplier to 1e-8.
    options = mi.Options(method="auto", rtol=1e-12, atol=1e-14)
    orbit = mi.find_orbit(system, guess={"x": 0.0, "y": 0.0}, periods=1, options=options)
    exact = [math.exp(-0.5), math.exp(-decay)]
    if jumps:  # the fast rate leaves one row of the jump, along the turned axes at t = 1
        c, s = math.cos(1.0), math.sin(1.0)
        along = np.array([c, s]) @ [[0.5, 0.25], [1.0, -0.75]] @ [c, s]
        exact = [along * exact[0], -0.625 / along * exact[1]]
    np.testing.assert_allclose(orbit.multipliers, exact, rtol=1e-8)


def test_small_multipliers_of_a_cycle():
    """A circle with the radial rate -46 / (2 pi), z with -69 / (2 pi)."""

    def flow(mode, t, y, p):
        growth = 46.0 / (4.0 * math.pi) * (1.0 - y.x * y.x - y.y * y.y)
        return growth * y.x - y.y, growth * y.y + y.x, y.x - 69.0 / (2.0 * math.pi) * y.z

    system = mi.System(states=("x", "y", "z"), flow=flow, parameters={})
    cycle = mi.find_orbit(system, guess={"x": 1.0, "y": 0.0, "z": 0.0})
    np.testing.assert_allclose(cycle.multipliers, np.exp([-46.0, -69.0]), rtol=1e-8)


def test_cycles_begin_at_a_hopf_point_with_a_strongly_unstable_direction():
    """Circles of radius sqrt(m) and period 2 pi, z a linear response: multiplier exp(2 pi 17)."""

    def flow(mode, t, y, p):
        r = y.x * y.x + y.y * y.y
        return p.m * y.x - y.y - r * y.x, y.x + p.m * y.y - r * y.y, 17.0 * (y.z - y.x)

    system = mi.System(states=("x", "y", "z"), flow=flow, parameters={"m": -0.2}, time_scale=1.0)
    (rest,) = mi.find_equilibria(system, guess={"x": 0.0, "y": 0.0, "z": 0.0})
    (hopf,) = mi.continue_solution(rest, "m", stop=0.5).special_points
    branch = mi.switch_branch(hopf, bounds=(-0.1, 0.4))
    cycle = branch.orbits[-1]
    assert cycle.system.parameters["m"] == pytest.approx(0.4)
    assert cycle.period == pytest.approx(2.0 * math.pi, rel=1e-9)
    assert math.hypot(cycle.state.x, cycle.state.y) == pytest.approx(math.sqrt(0.4), rel=1e-9)
    exact = np.exp(2.0 * math.pi * np.array([17.0, -0.8]))
    np.testing.assert_allclose(cycle.multipliers, exact, rtol=1e-8)


def axon(mode, t, y, p):
    """Hodgkin and Huxley 1952, in mV and ms, the potential relative to that at rest."""
    a, b = (25.0 - y.v) / 10.0, (10.0 - y.v) / 10.0
    opening = 1.0 if a == 0.0 else a / math.expm1(a)
    slow = 0.1 * (1.0 if b == 0.0 else b / math.expm1(b))
    current = 120.0 * y.m**3 * y.h * (y.v - 115.0) + 36.0 * y.n**4 * (y.v + 12.0)
    return (
        p.I - current - 0.3 * (y.v - 10.599),
        opening * (1.0 - y.m) - 4.0 * math.exp(-y.v / 18.0) * y.m,
        0.07 * math.exp(-y.v / 20.0) * (1.0 - y.h) - y.h / (math.exp((30.0 - y.v) / 10.0) + 1.0),
        slow * (1.0 - y.n) - 0.125 * math.exp(-y.v / 80.0) * y.n,
    )


@pytest.mark.nightly
@pytest.mark.parametrize("begin", [0, 1])
def test_cycles_of_an_axon_connect_its_hopf_points(begin):
    """The Hopf points are at 9.78 and 154.5 uA/cm^2; cycles between them have multipliers 1e8."""
    system = mi.System(
        states=("v", "m", "h", "n"),
        flow=axon,
        initial={"v": 0.0, "m": 0.053, "h": 0.596, "n": 0.318},
        time_scale=1.0,
        parameters={"I": 0.0},
        typical={"v": 100.0},
    )
    (rest,) = mi.find_equilibria(system, guess={"v": 0.0, "m": 0.053, "h": 0.596, "n": 0.318})
    steps = mi.StepControl(max_step=2.0, max_points=600)
    hopf = mi.continue_solution(rest, "I", stop=200.0, steps=steps).special_points
    branch = mi.switch_branch(hopf[begin], bounds=(0.0, 200.0), steps=steps)
    assert {each.label for each in branch.special_points} == {"CF", "PD"}
    forms = [each.normal_form for each in branch.special_points if each.label == "CF"]
    # Differences of a map that expands 3,000 times; at one fold from the second end they fail.
    assert sum(form.error < 1e-2 * abs(form.coefficient) for form in forms) >= 2
    last = branch.orbits[-1]
    assert last.system.parameters["I"] == pytest.approx(hopf[1 - begin].value, rel=1e-5)
    assert max(abs(orbit.multipliers[0]) for orbit in branch.orbits) > 1e8
