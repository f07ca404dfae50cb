"""Lyapunov exponents of systems of which they are known: the truth lies within twice the error."""

from __future__ import annotations

import math

import numpy as np
import pytest

import mems_impact as mi
from tests.analysis.oscillators import lorenz, roessler, van_der_pol

FAST = mi.Options(method="dop853")
PLAIN = mi.Options(method="dop853", engine="interpreted")
TURN = 2.0 * math.pi


def _still(mode, t, y, p):
    return (0.0,)


def _still_in_two(mode, t, y, p):
    return 0.0, 0.0


def mapped(switch_transition, **initial):
    """A map, once a period: nothing moves in between."""
    return mi.System(
        states=tuple(initial),
        flow=_still if len(initial) == 1 else _still_in_two,
        switch_transition=switch_transition,
        switches=(0.5,),
        period=1.0,
        parameters={"a": 1.0, "b": 1.0},
        initial=initial,
    )


def _logistic(mode, t, y, p):
    return mode, (p.a * y.x * (1.0 - y.x),)


def _tent(mode, t, y, p):
    return mode, (1.9 * min(y.x, 1.0 - y.x),)


def _skew(mode, t, y, p):
    return mode, (y.x / 0.3 if y.x < 0.3 else (1.0 - y.x) / 0.7,)


def _henon(mode, t, y, p):
    return mode, (1.0 - 1.4 * y.x * y.x + y.y, 0.3 * y.x)


def _cat(mode, t, y, p):
    return mode, ((2.0 * y.x + y.y) % 1.0, (y.x + y.y) % 1.0)


def _circle(mode, t, y, p):
    return mode, ((y.x + p.a - p.b / TURN * math.sin(TURN * y.x)) % 1.0,)


def _bounces(mode, t, y, p):
    v = 0.5 * y.v + 10.0 * math.cos(y.f)
    return mode, ((y.f + v) % TURN, v)


def _linear(mode, t, y, p):
    return y.v, -p.k * y.x - p.c * y.v + math.cos(t)


def linear(k, c):
    """A linear oscillator, forced."""
    return mi.System(
        states=("x", "v"),
        flow=_linear,
        period=TURN,
        parameters={"k": k, "c": c},
        initial={"x": 0.0},
    )


def _pair(mode, t, y, p):
    return y.v, -y.x - 0.1 * y.v + math.cos(0.7 * t), y.u, -2.0 * y.z - p.c * y.u


def pair(c):
    """Two linear oscillators that do not know of each other."""
    return mi.System(
        states=("x", "v", "z", "u"),
        flow=_pair,
        period=TURN / 0.7,
        parameters={"c": c},
        initial={"z": 1.0},
    )


def _hopf(mode, t, y, p):
    grows = p.mu - y.x * y.x - y.y * y.y
    return grows * y.x - p.w * y.y, p.w * y.x + grows * y.y


def hopf(mu, w, period=None):
    """The normal form of a Hopf bifurcation, or that with a period given from outside."""
    return mi.System(
        states=("x", "y"),
        flow=_hopf,
        period=period,
        parameters={"mu": mu, "w": w},
        initial={"x": 0.5},
    )


def _forced_van_der_pol(mode, t, y, p):
    return y.v, p.mu * (1.0 - y.x * y.x) * y.v - y.x + p.A * math.cos(p.w * t), 1.0 - y.x * y.x


def forced_van_der_pol(A, w):
    """Van der Pol's oscillator, forced; beside it a state that gathers its divergence."""
    return mi.System(
        states=("x", "v", "d"),
        flow=_forced_van_der_pol,
        period=TURN / w,
        parameters={"mu": 1.0, "A": A, "w": w},
        cyclic=("d",),
        initial={"x": 0.5},
    )


def _pendulum(mode, t, y, p):
    return y.v, -math.sin(y.x)


def _free(mode, t, y, p):
    return y.v, 0.0


def _between_walls(mode, t, y, p):
    return 1.0 - y.x * y.x


def _rebound(mode, t, y, p):
    return mode, (y.x, -y.v)


def _pushed(mode, t, y, p):
    return y.v, 0.5 if mode == 0 else -0.5


def _turned_round(mode, t, y, p):
    return 1 - mode, (y.x, -0.7 * y.v)


def free():
    """A body without forces between two walls: neighbours part in proportion to time."""
    return mi.System(
        states=("x", "v"),
        flow=_free,
        guards=[mi.Impact("wall", _between_walls, _rebound)],
        initial={"x": 0.1, "v": 1.3},
    )


def pushed():
    """Pushed to one wall and then to the other: u^2 becomes 0.49 u^2 + 2 in a flight."""
    return mi.System(
        states=("x", "v"),
        flow=_pushed,
        guards=[mi.Guard("wall", _between_walls, _turned_round)],
        modes=("right", "left"),
        initial=mi.State(x=0.1, v=1.3, mode="right"),
    )


def pushed_exponent():
    """ln 0.49 over the time of a flight, of the mean of the speeds at its ends 2."""
    hits = math.sqrt(2.0 / 0.51)
    return math.log(0.49) / (2.0 / (0.5 * (hits + 0.7 * hits)))


def check(spectrum, expected):
    """Compare with what is known: twice the error covers the truth, and errors say something."""
    expected = np.asarray(expected)
    off = np.abs(spectrum.exponents[: expected.size] - expected)
    assert (off <= 2.0 * spectrum.errors[: expected.size]).all()
    assert (spectrum.errors * spectrum.period < 0.06).all()


GOLDEN = math.log((3.0 + math.sqrt(5.0)) / 2.0)


def test_at_a_fixed_point_of_a_map():
    """No flow changes x, and at the fixed point no event does: its perturbations know better."""
    system = mapped(_logistic, x=1.0 - 1.0 / 2.8).changed(a=2.8)
    spectrum = mi.lyapunov(system, transient=0, periods=34, options=PLAIN)
    assert spectrum.exponents[0] == pytest.approx(math.log(0.8), abs=1e-8)


@pytest.mark.slow
def test_a_map_that_jumps_where_a_turn_ends():
    spectrum = mi.lyapunov(
        mapped(_cat, x=0.1234, y=0.4567), 2, transient=0, periods=136, options=PLAIN
    )
    assert spectrum.exponents == pytest.approx([GOLDEN, -GOLDEN], abs=1e-8)


@pytest.mark.nightly
def test_a_body_without_forces_between_two_walls():
    """Both exponents are zero, to which they come with log(t)/t: the error says so."""
    spectrum = mi.lyapunov(free(), transient=0.0, duration=170.0, options=PLAIN)
    check(spectrum, [0.0, 0.0])
    assert 1e-3 < spectrum.errors[0] < 2e-2


MAPS = {
    "logistic, chaotic": (_logistic, {"x": 0.3}, {"a": 4.0}, [math.log(2.0)]),
    "logistic, period 2": (_logistic, {"x": 0.3}, {"a": 3.2}, [math.log(0.16) / 2.0]),
    "logistic, doubling": (_logistic, {"x": 0.3}, {"a": 3.0}, [0.0]),
    "tent": (_tent, {"x": 0.3}, {}, [math.log(1.9)]),
    "skew tent": (_skew, {"x": 0.123}, {}, [-0.3 * math.log(0.3) - 0.7 * math.log(0.7)]),
    "Henon": (_henon, {"x": 0.1, "y": 0.1}, {}, [0.41922, math.log(0.3) - 0.41922]),
    "cat": (_cat, {"x": 0.1234, "y": 0.4567}, {}, [GOLDEN, -GOLDEN]),
    "circle": (_circle, {"x": 0.1}, {"a": 0.37, "b": 0.8}, [0.0]),
    "circle, nearly in step with chunks": (_circle, {"x": 0.1}, {"a": 0.2501, "b": 0.8}, [0.0]),
    "circle, golden": (_circle, {"x": 0.1}, {"a": 0.6180339887, "b": 0.8}, [0.0]),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", MAPS)
def test_maps(name):
    switch_transition, initial, values, expected = MAPS[name]
    system = mapped(switch_transition, **initial).changed(**values)
    check(mi.lyapunov(system, len(expected), options=FAST), expected)


FLOWS = {
    "damped": (linear(1.0, 0.1), [-0.05, -0.05]),
    "damped, in step with chunks": (linear(4.0, 0.2), [-0.1, -0.1]),
    "critical": (linear(1.0, 2.0), [-1.0, -1.0]),
    "overdamped": (
        linear(1.0, 5.0),
        [-2.5 + math.sqrt(5.25), -2.5 - math.sqrt(5.25)],
    ),
    "without a spring": (linear(0.0, 0.1), [0.0, -0.1]),
    "two alike": (pair(0.1), [-0.05] * 4),
    "two nearly alike": (pair(0.101), [-0.05, -0.05, -0.0505, -0.0505]),
    "van der Pol": (van_der_pol(), [0.0]),
    "van der Pol, relaxing": (van_der_pol(mu=10.0), [0.0]),
    "Hopf": (hopf(1.0, 1.0), [0.0, -2.0]),
    "Hopf, slow": (hopf(0.01, 0.3), [0.0, -0.02]),
    "torus": (hopf(1.0, 0.3, TURN), [0.0, -2.0]),
    "torus, nearly in step": (hopf(1.0, 1.0 / 3.0 + 1e-3, TURN), [0.0, -2.0]),
    "Lorenz": (lorenz(), [0.90563, 0.0, -14.57230]),
    "Roessler": (roessler(c=5.7), [0.0714, 0.0, -5.3943]),
    "pendulum": (
        mi.System(states=("x", "v"), flow=_pendulum, initial={"x": 1.5}),
        [0.0, 0.0],
    ),
    "between two walls": (free(), [0.0, 0.0]),
    "pushed between two walls": (pushed(), [0.0, pushed_exponent()]),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FLOWS)
def test_flows(name):
    system, expected = FLOWS[name]
    check(mi.lyapunov(system, len(expected), options=FAST), expected)


@pytest.mark.nightly
@pytest.mark.parametrize("scale", [None, 0.3])
def test_the_exponent_along_the_flow_of_lorenz(scale):
    """It is zero, as the state that carries perturbations follows the run."""
    spectrum = mi.lyapunov(lorenz(scale), 3, duration=2e4, tolerance=1e-5, options=FAST)
    check(spectrum, [0.90563, 0.0, -14.57230])
    assert abs(spectrum.exponents[1]) < 2e-4
    assert spectrum.exponents.sum() == pytest.approx(-41.0 / 3.0, abs=1e-6)


@pytest.mark.nightly
@pytest.mark.parametrize(("A", "w"), [(0.5, 1.1), (1.2, 0.45), (5.0, 2.463)])
def test_the_sum_is_the_mean_divergence(A, w):
    system = forced_van_der_pol(A, w)
    spectrum = mi.lyapunov(system, 2, options=FAST)
    begin = mi.simulate(system, periods=360, options=FAST)
    end = mi.simulate(system, periods=360 + spectrum.periods, options=FAST)
    gathered = end.final["d"] - begin.final["d"]
    length = spectrum.periods * spectrum.period
    assert spectrum.exponents.sum() == pytest.approx(gathered / length, abs=1e-6)


@pytest.mark.nightly
def test_a_map_of_bounces_contracts_by_its_loss():
    system = mapped(_bounces, f=0.5, v=2.0)
    spectrum = mi.lyapunov(system, 2, options=FAST)
    assert spectrum.kind == "chaotic"
    assert spectrum.exponents.sum() == pytest.approx(math.log(0.5), abs=1e-7)
