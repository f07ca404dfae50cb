"""Points of codimension two where the curves of independent maps cross, all in closed form.

x -> x + a - x^2 has its fold at a = 0, y -> -(1 + b) y + y^3 its period doubling at b = 0, and the
pairs (u, v), (r, s) their Neimark-Sacker points at a + b = 0.3 and a = 0.15. The oscillator grazes
its wall where its amplitude is one.
"""

import math

import pytest

import mems_impact as mi

PRECISE = mi.Options(method="dop853", rtol=1e-10, atol=1e-12)
STEPS = mi.StepControl(max_step=0.2)


def at_rest(mode, t, y, p):
    return (0.0,) * 6


def product(mode, t, y, p):
    return mode, (
        y.x + p.a - y.x**2,
        -(1.0 + p.b) * y.y + y.y**3,
        y.v,
        -(0.7 + p.a + p.b) * y.u + 0.5 * y.v - 0.1 * y.v**3,
        y.s,
        -(0.85 + p.a) * y.r + 1.2 * y.s - 0.1 * y.s**3,
    )


PRODUCT = mi.System(
    states=("x", "y", "u", "v", "r", "s"),
    flow=at_rest,
    switch_transition=product,
    switches=(0.5,),
    period=1.0,
    parameters={"a": 0.05, "b": -0.2},
)


def special(label, parameter, stop):
    guess = dict.fromkeys("yuvrs", 0.0) | {"x": math.sqrt(0.05)}
    orbit = mi.find_orbit(PRODUCT, periods=1, options=PRECISE, guess=guess)
    found = mi.continue_solution(orbit, parameter, stop, steps=STEPS).special_points
    return next(point for point in found if point.label == label)


def check(curve, *expected):
    found = [(s.kind, s.values["a"], s.values["b"]) for s in curve.special_points]
    for (kind, a, b), (name, at, beside) in zip(found, expected, strict=True):
        assert kind == name
        assert (a, b) == pytest.approx((at, beside), abs=1e-7)


@pytest.mark.nightly
def test_on_a_curve_of_folds():
    curve = mi.continue_curve(special("CF", "a", -0.1), "b", 0.35, steps=STEPS)
    check(curve, ("fold-flip", 0.0, 0.0), ("fold-Neimark-Sacker", 0.0, 0.3))
    first, second = (point.normal_form.coefficients for point in curve.special_points)
    exact = dict.fromkeys("bcdef", 0.0) | {"a": -1.0, "g": 1.0}
    assert first == pytest.approx(exact, abs=1e-5)
    assert second["a"] == pytest.approx(-1.0, abs=1e-6)


@pytest.mark.nightly
def test_on_a_curve_of_period_doublings():
    start = special("PD", "b", 0.1)
    name = "flip-Neimark-Sacker"
    check(mi.continue_curve(start, "a", 0.4, steps=STEPS), (name, 0.15, 0.0), (name, 0.3, 0.0))
    check(mi.continue_curve(start, "a", -0.1, steps=STEPS), ("fold-flip", 0.0, 0.0))


@pytest.mark.nightly
def test_on_a_curve_of_neimark_sacker_points():
    start = special("NS", "b", 0.4)
    onward = mi.continue_curve(start, "a", 0.4, steps=STEPS)
    check(onward, ("double Neimark-Sacker", 0.15, 0.15), ("flip-Neimark-Sacker", 0.3, 0.0))
    back = mi.continue_curve(start, "a", -0.1, steps=STEPS)
    check(back, ("fold-Neimark-Sacker", 0.0, 0.3))


def oscillator(mode, t, y, p):
    return y.v, p.A * math.cos(t) - 3.0 * y.x - 0.5 * y.v, 0.0, 0.0, 0.0


def gap(mode, t, y, p):
    return p.wall - y.x


def depth(mode, t, y, p):
    return y.x + 1.0


def bounce(mode, t, y, p):
    return mode, (y.x, -0.7 * y.v, y.y, y.r, y.s)


def bifurcations(mode, t, y, p):
    doubled = -(0.05 + p.wall) * y.y + y.y**3
    return mode, (y.x, y.v, doubled, y.s, -(0.02 + p.wall) * y.r + 1.2 * y.s - 0.1 * y.s**3)


@pytest.mark.nightly
def test_on_a_curve_of_grazings():
    """The amplitude of the linear oscillator is A / sqrt(4.25).

    y doubles where wall is 0.95, and the pair (r, s) crosses the unit circle where it is 0.98.
    """
    system = mi.System(
        states=("x", "v", "y", "r", "s"),
        flow=oscillator,
        guards=[
            mi.Guard("wall", gap, bounce, impact=True),
            mi.Guard("floor", depth, bounce, impact=True),
        ],
        switch_transition=bifurcations,
        switches=(0.5,),
        period=2.0 * math.pi,
        parameters={"A": 1.0, "wall": 0.93},
    )
    orbit = mi.find_orbit(system, periods=1, options=PRECISE, guess={"x": 0.2, "v": 0.2})
    grazing = mi.continue_solution(orbit, "A", 2.2, steps=STEPS).special_points[0]
    assert grazing.value == pytest.approx(0.93 * math.sqrt(4.25), rel=1e-9)
    flip, pair, double = mi.continue_curve(grazing, "wall", 1.03, steps=STEPS).special_points
    assert flip.kind == "grazing-flip"
    assert flip.values == pytest.approx({"A": 0.95 * math.sqrt(4.25), "wall": 0.95}, rel=1e-8)
    assert pair.kind == "grazing-Neimark-Sacker"
    assert pair.values == pytest.approx({"A": 0.98 * math.sqrt(4.25), "wall": 0.98}, rel=1e-8)
    assert double.kind == "double grazing (floor)"
    assert double.values == pytest.approx({"A": math.sqrt(4.25), "wall": 1.0}, rel=1e-8)
    assert double.normal_form is None
