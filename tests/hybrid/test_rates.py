"""Rates of margins, and their derivatives, against arithmetic of 50 digits."""

import math
from types import SimpleNamespace

import mpmath
import numpy as np
import pytest

import mems_impact as mi
from mems_impact.hybrid.variational.derivatives import Variational

ENGINES = ["compiled", "interpreted"]
SIZES = {"x": 3e-6, "v": 0.2}
LIMIT = 0.4


SOURCE = """
def slopes(t, y, p):
    return y[1], p.a * lib.cos(3 * t) - lib.sin(y[0]) / (1 + y[1] * y[1])

def height(t, y, p):
    return lib.exp(y[0]) * lib.cos(t) ** 2 - y[1] ** 3 / lib.hypot(y[0], 2) - p.a * y[0]
"""


def functions(lib):
    """Return flow and margin by the functions of a library."""
    space = {"lib": lib}
    exec(SOURCE, space)
    return space["slopes"], space["height"]


def pendulum(arrays, typical):
    """A driven system, whose functions return numbers or write into arrays."""
    slopes, height = functions(math)

    def flow(mode, t, y, p):
        return slopes(t, y, p)

    def flow_of_array(mode, t, y, p, dy):
        dy[0], dy[1] = slopes(t, y, p)

    def margin(mode, t, y, p):
        return height(t, y, p)

    return mi.System(
        states=("x", "v"), flow=flow_of_array if arrays else flow, parameters={"a": 0.7},
        guards=[mi.Guard("h", margin)], period=2.0 * math.pi, typical=typical,
    )  # fmt: skip


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(("arrays", "typical"), [(False, None), (True, None), (False, SIZES)])
def test_rates_and_their_derivatives(engine, arrays, typical):
    system = pendulum(arrays, typical)
    problem = system.problem(mi.Options(engine=engine, method="dop853"))
    units = np.array([system.units.factor(name) for name in system.states])
    t, y, p = 0.9, np.array([0.3, -0.8]), SimpleNamespace(a=0.7)
    time, unit = system.units.factor("time"), system.units.margin_factor("h")
    variational = Variational(problem, np.zeros((1, len(problem.parameters))))
    event = variational.event(0, 0, t / time, y / units)

    slopes, height = functions(mpmath)

    def along(k, *by):
        """Return the derivative of order k along the motion, and by components of the state."""

        def value(s, *moved):
            x = [mpmath.mpf(each) + d for each, d in zip(y.tolist(), moved, strict=True)]
            f = slopes(mpmath.mpf(t), x, p)
            ahead = [each + s * d for each, d in zip(x, f, strict=True)]
            return height(mpmath.mpf(t) + s, ahead, p)

        return float(mpmath.diff(value, (0, 0, 0), (k, *by)))

    with mpmath.workdps(50):
        assert unit * event.margins[0] == pytest.approx(along(0, 0, 0), rel=1e-15)
        assert unit / time * event.rates[0] == pytest.approx(along(1, 0, 0), rel=1e-14)
        gradient = [along(1, 1, 0), along(1, 0, 1)]
    assert unit / time * event.margin_by_state[1] / units == pytest.approx(gradient, rel=1e-13)


@pytest.mark.parametrize(
    "engine", ["interpreted", pytest.param("compiled", marks=pytest.mark.slow(all=True))]
)
def test_a_margin_that_takes_numbers_alone(engine):
    """Its rate is a difference along the motion."""

    def rounded(mode, t, y, p):
        return math.sin(y.x) - 0.5 + 0.0 * math.nextafter(y.v, 1.0)

    turning = mi.System(
        states=("x", "v"), flow=lambda mode, t, y, p: (y.v, 0.0), initial={"v": -2.0, "x": 1.0},
        guards=[mi.Guard("falls", rounded)], time_scale=1.0,
    )  # fmt: skip
    problem = turning.problem(mi.Options(engine=engine, method="dop853"))
    variational = Variational(problem, np.zeros((1, len(problem.parameters))))
    at = variational.event(0, 0, 0.0, np.array([0.3, -2.0]))
    assert at.rates[0] == pytest.approx(-2.0 * math.cos(0.3), rel=1e-12)
    run = mi.simulate(turning, duration=1.0, options=problem.options)
    assert run.events["t"].tolist() == pytest.approx([0.5 - math.pi / 12.0], rel=1e-9)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_margin_with_a_cone_where_a_run_starts(engine):
    leaving = mi.System(
        states=("x", "z"), flow=lambda mode, t, y, p: (3.0, 4.0), time_scale=1.0,
        guards=[mi.Guard("leaves", lambda mode, t, y, p: 1.0 - math.hypot(y.x, y.z))],
    )  # fmt: skip
    options = mi.Options(engine=engine, method="dop853")
    run = mi.simulate(leaving, duration=1.0, options=options)
    assert run.events["t"].tolist() == pytest.approx([0.2], rel=1e-12)


def test_an_interpreted_run_follows_a_change_of_a_global():
    global LIMIT
    ramp = mi.System(
        states=("x",), flow=lambda mode, t, y, p: (1.0,), time_scale=1.0,
        guards=[mi.Guard("ends", lambda mode, t, y, p: math.sin(LIMIT) - y.x)],
    )  # fmt: skip
    options = mi.Options(engine="interpreted", method="dop853")
    for LIMIT in (0.4, 0.7):
        run = mi.simulate(ramp, duration=1.0, options=options)
        assert run.events["t"].tolist() == pytest.approx([math.sin(LIMIT)], rel=1e-9)
