"""Curves of folds and period doublings that end on a curve of grazings, in closed form.

The orbit of x'' + c x' + x = A cos(w t) without impact grazes the stop at A = G(w). At resonances,
where T nu = j pi with the damped frequency nu, the return map over a period T is m times the unit
matrix there, m = (-1)^j exp(-c T / 2), so that a weak impact does not change the position at the
next one. With w at a distance h from the resonance and s = (1 + e) m T h, the conditions
tr = 1 + det and tr = -1 - det on the monodromy give the impact speeds s w / (1 + e m)^2 of the fold
and -s w / (1 - e m)^2 of the period doubling to first order. In the square of the amplitude,
(A / G)^2 = 1 - 2 s v / (w (1 - m)^2) + ((1 + e m) v / (w (1 - m)))^2, this is A / G = 1 + k h^2.
That the curves are tangent is a theorem of Simpson and Ghosh (arXiv 2602.22797, 2026).
"""

import math

import numpy as np
import pytest

import mems_impact as mi
from tests.orbits.exact import Exact

C, E = 0.3, 0.8


def resonance(j):
    """Return the frequency, and the coefficients k of the fold and of the period doubling."""
    w = 2.0 * math.sqrt(1.0 - 0.25 * C * C) / j
    period = 2.0 * math.pi / w
    m = (-1.0) ** j * math.exp(-0.5 * C * period)
    square = 0.5 * ((1.0 + E) * m * period / (1.0 - m)) ** 2
    plus, minus = (1.0 + E * m) ** 2, (1.0 - E * m) ** 2
    return w, -square / plus, square * (2.0 * minus + plus) / minus**2


def flow(mode, t, y, p):
    return y.v, p.A * math.cos(p.w * t) - C * y.v - y.x


def strike(mode, t, y, p):
    return mode, (1.0, -E * y.v)


OSCILLATOR = mi.System(
    states=("x", "v"),
    flow=flow,
    period=lambda p: 2.0 * math.pi / p.w,
    parameters={"A": 3.0, "w": 2.0},
    guards=[mi.Impact("stop", lambda mode, t, y, p: 1.0 - y.x, strike)],
)


@pytest.mark.parametrize("j", [1, 2, 3])
def test_the_coefficients_are_those_of_the_closed_form(j):
    w, fold, doubling = resonance(j)
    h = math.copysign(2e-5, -1.0 if j % 2 else 1.0)
    folded, doubled = Exact(omega=w + h, c=C, e=E), Exact(omega=w - h, c=C, e=E)
    assert (folded.fold() / folded.graze - 1.0) / h**2 == pytest.approx(fold, rel=2e-3)
    assert (doubled.doubling() / doubled.graze - 1.0) / h**2 == pytest.approx(doubling, rel=2e-3)


@pytest.mark.nightly
@pytest.mark.parametrize("j", [1, 2])
@pytest.mark.parametrize("label", ["CF", "PD"])
def test_curves_are_tangent_to_the_curve_of_grazings(j, label):
    w, *coefficients = resonance(j)
    expected = coefficients[label == "PD"]
    side = 0.02 if (label == "CF") == (j == 2) else -0.02
    exact = Exact(omega=w + side, c=C, e=E)
    speed = exact.fold_speed() if label == "CF" else exact.doubling_speed()
    start = exact.orbit(1.2 * speed)
    system = OSCILLATOR.changed(A=start.amplitude, w=exact.omega)
    guess = mi.State(x=1.0, v=-E * start.speed, time=start.time)
    orbit = mi.find_orbit(system, guess=guess, periods=1)
    special = mi.continue_solution(orbit, "A", 0.99 * exact.amplitude_at(speed)).special_points[0]
    assert special.label == label
    assert special.value == pytest.approx(exact.amplitude_at(speed), abs=1e-9)
    curve = mi.continue_curve(special, "w", w - side)
    (end,) = curve.special_points
    assert end.kind == ("degenerate grazing" if label == "CF" else "grazing-flip")
    graze = Exact(omega=w, c=C, e=E).graze
    assert (end.values["w"], end.values["A"]) == pytest.approx((w, graze), abs=1e-8)
    h = curve.table["w"].to_numpy() - w
    ratio = curve.table["A"].to_numpy() / np.hypot(1.0 - (w + h) ** 2, C * (w + h)) - 1.0
    apart = np.abs(h) > 5e-4
    found = np.polynomial.polynomial.polyfit(h[apart], (ratio / h**2)[apart], 4)
    assert found[0] == pytest.approx(expected, rel=1e-4)
