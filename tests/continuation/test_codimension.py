"""Points of codimension two by their names, on the Henon map, where all are in closed form.

With x' = y, y' = a - b x - y^2 a fixed point has x^2 + (1 + b) x = a and the multipliers
m^2 + 2 x m + b = 0: folds where a = -(1 + b)^2 / 4, period doublings where a = 3 (1 + b)^2 / 4,
Neimark-Sacker points where b = 1, with the angle of cosine -x.
"""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.continuation.test_functions import (
    FOLD,
    MINUS,
    NEIMARK_SACKER,
    PAIR,
    PERIOD_DOUBLING,
    PLUS,
    MultiplierTest,
    curve_tests,
)

TURN = np.exp(2j)


def henon(mode, t, y, p):
    return mode, (y.y, p.a - p.b * y.x - y.y * y.y, -(0.6 + 0.2 * p.a) * y.w)


HENON = mi.System(
    states=("x", "y", "w"),
    flow=lambda mode, t, y, p: (0.0, 0.0, 0.0),
    switch_transition=henon,
    switches=(0.5,),
    period=1.0,
    parameters={"a": 1.0, "b": 0.5},
)


def followed(label, parameter, stop, second, start=0.5, **values):
    options = mi.Options(method="dop853")
    guess = {"x": start, "y": start, "w": 0.0}
    begin = mi.find_orbit(HENON.changed(**values), periods=1, options=options, guess=guess)
    branch = mi.continue_solution(begin, parameter, stop, steps=mi.StepControl(max_step=0.1))
    special = next(point for point in branch.special_points if point.label == label)
    return mi.continue_curve(special, *second, steps=mi.StepControl(max_step=0.2))


def special_points(curve):
    return [(point.kind, point.values["a"], point.values["b"]) for point in curve.special_points]


def check(curve, *expected):
    for (kind, a, b), (name, at, beside) in zip(special_points(curve), expected, strict=True):
        assert kind == name
        assert (a, b) == pytest.approx((at, beside), abs=1e-7)


@pytest.mark.slow
def test_strong_resonances_up_to_where_the_pair_is_real():
    curve = followed("NS", "b", 1.2, ("a", 4.0))
    check(
        curve,
        ("1:3 resonance", 1.25, 1.0),
        ("flip-Neimark-Sacker", 2.0, 1.0),
        ("1:2 resonance", 3.0, 1.0),
    )
    assert curve.ended.startswith("1:2 resonance: beyond")
    assert "as of a neutral saddle" in curve.ended


@pytest.mark.nightly
def test_strong_resonances_on_the_other_side():
    curve = followed("NS", "b", 1.2, ("a", -2.0))
    check(curve, ("1:4 resonance", 0.0, 1.0), ("1:1 resonance", -1.0, 1.0))
    assert curve.ended.startswith("1:1 resonance: beyond")


@pytest.mark.nightly
def test_on_a_curve_of_folds():
    curve = followed("CF", "a", -2.0, ("b", 1.5))
    check(curve, ("1:1 resonance", -1.0, 1.0))
    # With q0 = (1, 1) / sqrt(2), q1 = (0, 1) / sqrt(2), p0 = sqrt(2) (-1, 1), p1 = sqrt(2) (1, 0).
    exact = {"a": -math.sqrt(0.5), "b": -math.sqrt(2.0)}
    assert curve.special_points[0].normal_form.coefficients == pytest.approx(exact, abs=1e-6)


@pytest.mark.nightly
def test_on_a_curve_of_period_doublings():
    curve = followed("PD", "a", 3.0, ("b", 1.5), start=0.83, a=2.2, b=0.8)
    check(curve, ("1:2 resonance", 3.0, 1.0))


@pytest.mark.parametrize(
    ("kind", "test", "own", "crosses", "name"),
    [
        (FOLD, PLUS, [1.0], [1.0], "1:1 resonance"),
        (FOLD, MINUS, [1.0], [-1.0], "fold-flip"),
        (FOLD, PAIR, [1.0], [TURN, TURN.conjugate()], "fold-Neimark-Sacker"),
        (PERIOD_DOUBLING, PLUS, [-1.0], [1.0], "fold-flip"),
        (PERIOD_DOUBLING, MINUS, [-1.0], [-1.0], "1:2 resonance"),
        (PERIOD_DOUBLING, PAIR, [-1.0], [TURN, TURN.conjugate()], "flip-Neimark-Sacker"),
        (NEIMARK_SACKER, PLUS, [TURN**0.6, TURN**-0.6], [1.0], "fold-Neimark-Sacker"),
        (NEIMARK_SACKER, MINUS, [TURN**0.6, TURN**-0.6], [-1.0], "flip-Neimark-Sacker"),
        (
            NEIMARK_SACKER,
            PAIR,
            [TURN**0.6, TURN**-0.6],
            [TURN, TURN.conjugate()],
            "double Neimark-Sacker",
        ),
        ("grazing", PLUS, [], [1.0], "grazing-fold"),
        ("grazing", MINUS, [], [-1.0], "grazing-flip"),
        ("grazing", PAIR, [], [TURN, TURN.conjugate()], "grazing-Neimark-Sacker"),
        ("slip end", MINUS, [], [-1.0], "slip end-flip"),
    ],
)
def test_the_name_follows_from_what_is_followed_and_what_is_met(kind, test, own, crosses, name):
    met = MultiplierTest(kind, test)
    assert met.name == name
    others = [1e-200, 0.5, -0.3, 2.7, 1e9, *np.linspace(-0.4, 0.4, 20)]

    def multipliers(size):
        return np.array([*own, *(size * value for value in crosses), *others], dtype=complex)

    inside, outside = (met.of(multipliers(size)) for size in (0.999, 1.001))
    assert inside * outside < 0.0
    assert met.crosses(multipliers(1.0 + 1e-6))
    for other in curve_tests(kind):
        if isinstance(other, MultiplierTest) and other != met:
            same = other.of(multipliers(0.999)), other.of(multipliers(1.001))
            assert same[0] * same[1] > 0.0 or not other.crosses(multipliers(1.0))
