"""Normal forms against those of maps and flows in closed form, and against nearby orbits."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

import mems_impact as mi
from mems_impact.continuation.codimension_two import codimension_two_form
from mems_impact.continuation.normal_forms import orbit_normal_form
from mems_impact.continuation.test_functions import NEIMARK_SACKER, PERIOD_DOUBLING

PLAIN = mi.Options(method="dop853", rtol=1e-11, atol=1e-13, engine="interpreted")
COMPILED = mi.Options(method="dop853", rtol=1e-11, atol=1e-13)
PHASE = 0.0618834  # of w at the start of a period


def _wave(t, w):
    return math.cos(2.0 * math.pi * t) - 3.0 * w


def _flip_flow(mode, t, y, p):
    return 0.0, _wave(t, y.w)


def _flip_map(mode, t, y, p):
    return mode, (-(1.0 + p.a) * y.x + p.c * y.x**2 + p.b * y.x**3, y.w)


def _flip(**parameters):
    """x -> -(1 + a) x + c x^2 + b x^3 once a period; the cubic coefficient of its flip: b + c^2."""
    return mi.System(
        states=("x", "w"), flow=_flip_flow, switch_transition=_flip_map, switches=(0.5,),
        period=1.0, parameters={"a": 0.0, "b": 0.3, "c": 0.5} | parameters,
        initial={"x": 0.0, "w": PHASE},
    )  # fmt: skip


def _turn_flow(mode, t, y, p):
    return 0.0, 0.0, _wave(t, y.w)


def _turn_map(mode, t, y, p):
    return mode, (y.y, -p.d * y.x + p.t * y.y + p.e * y.x**2 + p.f * y.x**2 * y.y, y.w)


def _turn(**parameters):
    """(x, y) -> (y, -d x + t y + e x^2 + f x^2 y): Neimark-Sacker at d = 1."""
    return mi.System(
        states=("x", "y", "w"), flow=_turn_flow, switch_transition=_turn_map, switches=(0.5,),
        period=1.0, parameters={"d": 1.0, "t": 0.5, "e": 0.3, "f": 0.2} | parameters,
        initial={"x": 0.0, "y": 0.0, "w": PHASE},
    )  # fmt: skip


def _turn_coefficient(t, e, f):
    """Kuznetsov's formula with the derivatives of that map."""
    matrix = np.array([[0.0, 1.0], [-1.0, t]])
    values, vectors = np.linalg.eig(matrix)
    i = int(np.argmax(values.imag))
    mu, q = values[i], vectors[:, i] / np.linalg.norm(vectors[:, i])
    others, left = np.linalg.eig(matrix.T)
    p = left[:, int(np.argmin(np.abs(others - np.conj(mu))))]
    p = p / np.conj(np.vdot(p, q))
    bar = np.conj(q)

    def B(u, v):
        return np.array([0.0, 2.0 * e * u[0] * v[0]])

    def C(u, v, w):
        pairs = u[0] * v[0] * w[1] + u[0] * v[1] * w[0] + u[1] * v[0] * w[0]
        return np.array([0.0, 2.0 * f * pairs])

    mean = np.linalg.solve(np.eye(2) - matrix, B(q, bar))
    double = np.linalg.solve(mu * mu * np.eye(2) - matrix, B(q, q))
    cubic = C(q, q, bar) + 2.0 * B(q, mean) + B(bar, double)
    return 0.5 * float((np.conj(mu) * np.vdot(p, cubic)).real)


def _form(system, kind):
    found = mi.find_orbit(system, periods=1, options=PLAIN).numeric
    return orbit_normal_form(kind, found.shooting, found.point)


@pytest.mark.quick(1)
@pytest.mark.parametrize(("c", "b"), [(0.5, 0.3), (0.5, -0.4), (2.0, 1.0), (0.0, -1.0)])
def test_period_doubling_of_a_map(c, b):
    form = _form(_flip(b=b, c=c), PERIOD_DOUBLING)
    assert form.coefficient == pytest.approx(b + c * c, abs=max(1e-8, form.error))
    assert form.error < 1e-6
    assert form.criticality == ("supercritical" if b + c * c > 0.0 else "subcritical")


def test_a_coefficient_that_is_zero_has_no_criticality():
    form = _form(_flip(b=-0.25, c=0.5), PERIOD_DOUBLING)
    assert abs(form.coefficient) <= form.error
    assert form.criticality == ""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("t", "e", "f"),
    [(1.0, 0.3, -0.4), (-0.7, 0.0, 0.5)]
    + [
        (t, e, f)
        for t, e, f in [
            (0.5, 0.3, 0.2),
            (1.0, 0.3, 0.2),
            (-0.7, 0.3, -0.4),
            (1.6, 0.3, -0.4),
            (1.6, 0.0, 0.5),
        ]
    ],
)
def test_neimark_sacker_of_a_map(t, e, f):
    exact = _turn_coefficient(t, e, f)
    form = _form(_turn(t=t, e=e, f=f), NEIMARK_SACKER)
    assert form.coefficient == pytest.approx(exact, abs=max(1e-8, form.error))
    assert form.error < 1e-5
    assert form.criticality == ("supercritical" if exact < 0.0 else "subcritical")


@pytest.mark.slow
def test_generalized_flip_on_a_curve():
    orbit = mi.find_orbit(_flip(a=-0.1, b=-0.1), periods=1, options=COMPILED)
    (doubling,) = mi.continue_solution(orbit, "a", stop=0.2).special_points
    assert doubling.criticality == "supercritical"
    (point,) = mi.continue_curve(doubling, "b", -0.4).special_points
    assert point.kind == "generalized flip"
    assert point.values == pytest.approx({"a": 0.0, "b": -0.25}, abs=1e-8)
    # From the derivatives of that map, d = (270 b c^2 + 30 c^4) / 120 = -2 c^4.
    assert point.normal_form.coefficient == pytest.approx(-0.125, abs=1e-4)
    assert point.criticality == "subcritical"


@pytest.mark.nightly
def test_chenciner_on_a_curve():
    """The root of the coefficient in closed form. At 1:3 the coefficient is not defined."""
    orbit = mi.find_orbit(_turn(d=0.9, t=-0.9), periods=1, options=COMPILED)
    (start,) = mi.continue_solution(orbit, "d", stop=1.2).special_points
    curve = mi.continue_curve(start, "t", -1.3)
    found = {special.kind: special.values["t"] for special in curve.special_points}
    exact = brentq(lambda t: _turn_coefficient(t, 0.3, 0.2), -1.3, -1.05)
    assert found == pytest.approx({"1:3 resonance": -1.0, "Chenciner": exact}, abs=1e-8)


def _sheared_map(mode, t, y, p):
    """z -> exp(i theta) z (1 + i a |z|^2 + (b + i h) |z|^4), in coordinates that are sheared."""
    x = y.x - p.s * y.y * y.y
    v = y.y - p.t * x * x
    size = x * x + v * v
    real, imaginary = 1.0 + p.b * size * size, p.a * size + p.h * size * size
    c, s = math.cos(p.theta), math.sin(p.theta)
    x, v = (
        (c * real - s * imaginary) * x - (s * real + c * imaginary) * v,
        (s * real + c * imaginary) * x + (c * real - s * imaginary) * v,
    )
    v = v + p.t * x * x
    return mode, (x + p.s * v * v, v, y.w)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("theta", "a", "b", "s", "t"),
    [(1.1, 0.7, -0.3, 0.4, -0.3), (1.1, 0.2, 0.5, 0.0, 0.0), (2.4, -1.1, -0.3, 0.4, -0.3)],
)
def test_fifth_order_of_a_chenciner_point(theta, a, b, s, t):
    system = mi.System(
        states=("x", "y", "w"), flow=_turn_flow, switch_transition=_sheared_map, switches=(0.5,),
        period=1.0, parameters={"theta": theta, "a": a, "b": b, "h": 0.4, "s": s, "t": t},
        initial={"x": 0.0, "y": 0.0, "w": PHASE},
    )  # fmt: skip
    found = mi.find_orbit(system, periods=1, options=COMPILED).numeric
    form = codimension_two_form("Chenciner", found.shooting, found.point)
    # Along eigenvectors of length one |z|^2 has twice the value; of |z| -> |z| (1 + d |z|^4), d is
    # b + a^2/2 (Kuznetsov 2004, section 9.4).
    exact = 4.0 * (b + 0.5 * a * a)
    assert form.coefficient == pytest.approx(exact, rel=5e-7)
    assert abs(form.coefficient - exact) < 3.0 * form.error
    assert form.coefficients["c"] == pytest.approx(2.0 * a, abs=1e-8)
    assert form.criticality == ("supercritical" if exact < 0.0 else "subcritical")


@pytest.mark.nightly
def test_criticality_of_the_actuator_by_the_doubled_orbits():
    """Through impacts and slips: doubled orbits are stable where the doubling is supercritical."""
    actuator, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.29, omega=0.45)
    start = mi.kicked_state(actuator)
    orbit = mi.find_orbit(actuator, drive, guess=start, transient=300)
    (special,) = mi.continue_solution(orbit, "amplitude", stop=0.25).special_points
    assert (special.label, special.criticality) == ("PD", "supercritical")
    doubled = mi.switch_branch(special, bounds=(0.26, 0.29)).table
    assert doubled["stable"].iloc[:4].all()


def _normal(mode, t, y, p):
    square = y.x * y.x + y.y * y.y
    return p.m * y.x - 2.0 * y.y + p.l * y.x * square, 2.0 * y.x + p.m * y.y + p.l * y.y * square


@pytest.mark.parametrize("cubic", [-0.7, 0.4])
def test_hopf_normal_form(cubic):
    """The state is z q + its conjugate with |q| = 1, so that its square is 2 |z|^2."""
    system = mi.System(states=("x", "y"), flow=_normal, parameters={"m": -0.3, "l": cubic})
    (start,) = mi.find_equilibria(system, guess={"x": 0.0, "y": 0.0})
    branch = mi.continue_solution(start, "m", stop=0.3)
    (hopf,) = branch.special_points
    assert hopf.normal_form.coefficient == pytest.approx(2.0 * cubic, abs=1e-8)
    expected = "supercritical" if cubic < 0.0 else "subcritical"
    assert branch.special_table["criticality"].tolist() == [expected]


def _well(mode, t, y, p):
    return y.v, p.a * y.x + p.b * y.x**2 + p.c * y.x**3 - 0.1 * y.v


@pytest.mark.parametrize(
    ("b", "c", "equation", "criticality"),
    [
        (0.0, -1.0, "x' = c x^3", "supercritical"),
        (0.0, 1.0, "x' = c x^3", "subcritical"),
        (0.5, -1.0, "x' = a x^2", ""),
    ],
)
def test_branch_points_of_equilibria(b, c, equation, criticality):
    """On the center manifold 0.1 x' = a x + b x^2 + c x^3 to leading order."""
    system = mi.System(states=("x", "v"), flow=_well, parameters={"a": -0.5, "b": b, "c": c})
    (start,) = mi.find_equilibria(system, guess={"x": 0.0})
    (point,) = mi.continue_solution(start, "a", stop=0.3).special_points
    assert (point.normal_form.equation, point.criticality) == (equation, criticality)
    assert point.normal_form.coefficient == pytest.approx(10.0 * (b or c), rel=1e-7)
