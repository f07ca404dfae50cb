"""Neimark-Sacker points, where Liouville's formula tells them.

The product of the two multipliers of a planar oscillator is e^2 per impact times the exponential of
the integral of the divergence over a period. Where they are complex, they cross the unit circle
where that is one. For the linear impact oscillator that is a closed form, c = 2 n log(e)/T with n
impacts; for the forced van der Pol oscillator x'' = (mu - x^2) x' - x + A cos(omega t) the integral
is SciPy's.
"""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mems_impact as mi
from mems_impact.continuation.orbit_branch import follow
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.orbits.orbit_search import find_periodic_orbit
from tests.hybrid.systems import TAU, problem
from tests.orbits.families import FunctionFamily, at, oscillator

OMEGA, AMPLITUDE = 1.7, 1.2


def _flow(mode, t, y, p, dy):
    dy[0] = y[1]
    dy[1] = (p[0] - y[0] * y[0]) * y[1] - y[0] + p[1] * math.cos(p[2] * t)


def _margins(mode, t, y, p, g, r):
    g[0], r[0] = p[3] - y[0], -y[1]


def _transition(mode, code, t, y, p):
    if code < 2:
        y[0] = p[3]
        y[1] *= -p[4] if code == 0 else 0.0
    return 0


AUTOMATON = Automaton(
    states=("x", "v"),
    modes=("free",),
    guards=(Guard(name="stop", order=0, impact=True),),
    flow=_flow,
    margins=_margins,
    transition=_transition,
)


def _problem(values):
    p = [values[name] for name in ("mu", "amplitude", "omega", "d", "e")]
    return problem(AUTOMATON, p, period=TAU / values["omega"], rtol=1e-11, atol=1e-13)


def divergence(orbit, mu):
    """The integral of mu - x^2 over the period, by DOP853."""

    def flow(t, z):
        x, v, _ = z
        return v, (mu - x * x) * v - x + AMPLITUDE * math.cos(OMEGA * t), mu - x * x

    start = [*orbit.state, 0.0]
    done = solve_ivp(flow, (0.0, TAU / OMEGA), start, method="DOP853", rtol=1e-13, atol=1e-14)
    assert np.abs(done.y[:2, -1] - orbit.state).max() < 1e-8
    return done.y[2, -1]


def check(branch, special):
    """A pair on the unit circle off the real axis; stability is lost there and nowhere else."""
    assert special.label == "NS"
    assert np.abs(special.solution.multipliers) == pytest.approx(1.0, abs=1e-8)
    assert np.abs(special.solution.multipliers.imag).min() > 0.1
    for point in branch.points:
        if abs(point.value - special.value) > 1e-6:
            before = (point.value - special.value) * (branch.points[0].value - special.value) > 0.0
            assert point.solution.stable == before


@pytest.mark.nightly
def test_van_der_pol():
    values = {"mu": -0.3, "amplitude": AMPLITUDE, "omega": OMEGA, "d": 10.0, "e": 0.9}
    orbit = find_periodic_orbit(FunctionFamily(values, _problem), at((0.0, 0.0)), transient=100)
    branch = follow(orbit, "mu", low=-0.3, high=0.6)
    (special,) = branch.special_points
    assert divergence(special.solution, special.value) == pytest.approx(0.0, abs=1e-8)
    check(branch, special)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("omega", "d", "impacts"), [(1.3, 0.0, 1), (1.7, 0.3, 1), (2.4, 0.0, 1), (0.8, 0.3, 2)]
)
def test_linear_impact_oscillator(omega, d, impacts):
    family = oscillator(omega=omega, c=0.1, d=d, e=0.8, amplitude=1.0)
    orbit = find_periodic_orbit(family, at((0.0, 0.0)), transient=300)
    assert len(orbit.impacts) == impacts
    branch = follow(orbit, "c", low=-0.3, high=0.1, direction=-1)
    (special,) = branch.special_points
    assert special.value == pytest.approx(impacts * math.log(0.8) * omega / math.pi, abs=1e-9)
    check(branch, special)


def linear_map(transition, size):
    """Return the branch of the fixed point 0 of a map over its parameter, from `size`."""
    system = mi.System(
        states=("x", "y"),
        flow=lambda mode, t, y, p: (0.0, 0.0),
        switch_transition=transition,
        switches=(0.5,),
        parameters={"size": size},
        period=1.0,
    )
    options = mi.Options(engine="interpreted", method="dop853")
    orbit, steps = mi.find_orbit(system, options=options), mi.StepControl(max_step=0.2)
    return mi.continue_solution(orbit, "size", size + 0.5, steps=steps)


@pytest.mark.parametrize("angle", [1e-3, 3.0])
def test_a_pair_on_the_unit_circle(angle):
    c, s = np.cos(angle), np.sin(angle)

    def rotation(mode, t, y, p):
        return mode, (p.size * (c * y.x - s * y.y), p.size * (s * y.x + c * y.y))

    (point,) = linear_map(rotation, 0.8).special_points
    assert point.kind == "Neimark-Sacker"
    assert point.value == pytest.approx(1.0, abs=1e-9)


def test_two_real_multipliers_whose_product_is_one_are_no_neimark_sacker_point():
    branch = linear_map(lambda mode, t, y, p: (mode, (p.size * y.x, 0.4 * y.y)), 2.3)
    assert branch.ended == "size reached its bound"
    assert not branch.special_points
