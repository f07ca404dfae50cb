"""Undeclared jumps of the flow are told once; steep slopes and declared jumps are not."""

import math
import warnings

import numpy as np
import pytest

import mems_impact as mi


def warnings_of(**given):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mi.System(states=("x", "v"), **given)
    return [str(w.message) for w in caught if w.category is mi.DiscontinuityWarning]


def square(mode, t, y, p):
    return y.v, -y.x + (1.0 if t % 3.0 < 1.0 else -1.0)


def rubbed(mode, t, y, p):
    return y.v, -y.x - 0.3 * ((y.v > 0.0) - (y.v < 0.0))


def stepped(mode, t, y, p):
    return y.v, -y.x - (10.0 if y.x < -1.0 else 0.0)


def fast(mode, t, y, p):
    return y.v, -1e12 * y.x - 0.3e6 * ((y.v > 0.0) - (y.v < 0.0))


@pytest.mark.parametrize(
    ("given", "where", "remedy"),
    [
        ({"flow": square, "period": 3.0}, "at t = 1,", "switches="),
        ({"flow": rubbed, "initial": {"x": 3.0}}, "at v = 0,", "Friction"),
        ({"flow": rubbed, "initial": {"x": 3.0, "v": 1.0}}, "at v = ", "Friction"),
        ({"flow": stepped, "initial": {"x": 3.0}}, "at x = -1,", "Guard"),
        ({"flow": fast, "initial": {"x": 3e-6}, "time_scale": 1e-6}, "at v = 0,", "Friction"),
    ],
    ids=["time", "rest", "velocity", "place", "microseconds"],
)
def test_a_jump_is_reported_with_its_place(given, where, remedy):
    (message,) = warnings_of(**given)
    assert where in message
    assert remedy in message


def hold(mode, t, y, p):
    return mode, (y.x, y.v)


@pytest.mark.parametrize(
    "given",
    [
        {"flow": square, "period": 3.0, "switches": (1.0, 3.0)},
        {
            "flow": rubbed,
            "initial": {"x": 3.0, "v": -0.1},
            "guards": [mi.Guard("turn", lambda mode, t, y, p: -y.v, hold)],
        },
        {"flow": lambda mode, t, y, p: (y.v, -y.x - 5.0 * max(y.x, 0.0)), "initial": {"x": -1.0}},
        {"flow": lambda mode, t, y, p: (y.v, -y.x - 0.3 * math.tanh(1e7 * y.v))},
        {
            "flow": lambda mode, t, y, p: (y.v, -1e8 * (y.x - math.cos(t)) - 1e4 * y.v),
            "period": 2.0 * math.pi,
            "initial": {"x": 3.0},
        },
    ],
    ids=["switches", "guard", "kink", "steep", "stiff"],
)
def test_what_is_declared_or_steep_is_not_reported(given):
    assert warnings_of(**{"initial": {"x": 3.0}, **given}) == []


def smooth(mode, t, y, p):
    bend = math.tanh(p.b * y.x) + math.sin(p.c * y.v) + abs(y.x - 0.1)
    return y.v, -p.a * y.x - y.v + bend + math.tanh(p.d * math.cos(t))


def test_smooth_systems_are_not_reported():
    rng = np.random.default_rng(0)
    for _ in range(40):
        sizes = rng.uniform(0.1, 3.0, size=4) * 10.0 ** rng.uniform(-2.0, 3.0, size=4)
        parameters = dict(zip("abcd", sizes.tolist(), strict=True))
        start = dict(zip("xv", rng.normal(size=2).tolist(), strict=True))
        given = {"flow": smooth, "period": 2.0 * math.pi, "parameters": parameters}
        assert warnings_of(**given, initial=start) == []


def caught_by(call):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        call()
    return [w for w in caught if w.category is mi.DiscontinuityWarning]


def pushed(mode, t, y, p):
    return y.v, -y.x + 0.05 * y.v + math.cos(t) - (10.0 if y.x < -4.0 else 0.0)


def rubbing(mode, t, y, p):
    return y.v, -y.x - 0.2 * y.v + math.cos(t) - p.mu * ((y.v > 0.0) - (y.v < 0.0))


def switched(mode, t, y, p):
    return y.v, -y.x - 0.1 * y.v + (p.mu if t % 3.0 < 0.9 else -p.mu)


def quiet(flow, period=2.0 * math.pi, **given):
    """Return a system of which the short check tells nothing."""
    given = {"initial": {"x": 0.1}, "parameters": {"mu": 0.0}, "typical": {"time": 1.0}, **given}
    with warnings.catch_warnings():
        warnings.simplefilter("error", mi.DiscontinuityWarning)
        return mi.System(states=("x", "v"), flow=flow, period=period, **given)


PLAIN = mi.Options(engine="interpreted", method="dop853")
ENGINES = [(e, m) for e in ("interpreted", "compiled") for m in ("adams", "bdf", "dop853", "auto")]


@pytest.mark.quick(3)
@pytest.mark.parametrize(("engine", "method"), ENGINES)
@pytest.mark.parametrize(
    ("flow", "period", "mu", "where", "remedy"),
    [
        (pushed, 2.0 * math.pi, 0.0, "at x = -4,", "use a Guard"),
        (rubbing, 2.0 * math.pi, 0.2, "at v = 0,", "Friction"),
        (switched, 3.0, 1.0, "at t = 0.9,", "switches="),
    ],
    ids=["later", "parameters", "time"],
)
def test_a_jump_that_a_run_meets_is_reported_once(flow, period, mu, where, remedy, engine, method):
    system = quiet(flow, period).changed(mu=mu)
    options = mi.Options(engine=engine, method=method, rtol=1e-8)
    (one,) = caught_by(lambda: mi.simulate(system, periods=8, options=options))
    assert where in str(one.message)
    assert remedy in str(one.message)
    assert one.filename == __file__


def test_a_jump_is_reported_in_the_units_of_the_system():
    sized = quiet(
        lambda mode, t, y, p: (y.v, -1e12 * y.x + 1e6 * math.cos(1e6 * t)
                               - (1e7 if y.x < -4e-6 else 0.0)),
        2e-6 * math.pi,
        initial={"x": 1e-7},
        typical={"x": 1e-6, "v": 1.0, "time": 1e-6},
        units={"x": "m", "v": "m/s", "time": "s"},
    )  # fmt: skip
    (one,) = caught_by(lambda: mi.simulate(sized, periods=8, options=PLAIN))
    assert "at x = -4e-06," in str(one.message)


@pytest.mark.nightly
def test_orbits_and_exponents_tell_of_a_jump_that_their_runs_meet():
    system = quiet(rubbing).changed(mu=0.2)
    assert len(caught_by(lambda: mi.find_orbit(system, transient=10, options=PLAIN))) == 1
    few = {"transient": 2, "periods": 4}
    assert len(caught_by(lambda: mi.lyapunov(system, options=PLAIN, **few))) == 1


@pytest.mark.quick(5)
@pytest.mark.parametrize(
    "given",
    [
        {"flow": switched, "period": 3.0, "switches": (0.9, 3.0), "parameters": {"mu": 1.0}},
        {
            "flow": rubbing,
            "parameters": {"mu": 0.2},
            "guards": [
                mi.Guard("turn", lambda mode, t, y, p: y.v if mode == 0 else -y.v,
                         lambda mode, t, y, p: (1 - mode, (y.x, y.v))),
            ],
            "modes": mi.modes("forth", "back"),
            "initial": {"x": -3.0, "v": 0.1},
        },
        {"flow": lambda mode, t, y, p: (y.v, -y.x - 50.0 * max(y.x, 0.0) + math.cos(0.7 * t)),
         "period": 2.0 * math.pi / 0.7},
        {"flow": lambda mode, t, y, p: (y.v, -y.x + math.cos(t) - 0.3 * math.tanh(1e7 * y.v))},
        {"flow": lambda mode, t, y, p: (300.0 * (y.v + y.x - y.x**3 / 3.0), -y.x / 300.0)},
        {"flow": lambda mode, t, y, p: (y.v, -1e8 * (y.x - math.cos(t)) - 1e4 * y.v)},
        {"flow": lambda mode, t, y, p: (-1e13 * (y.x - math.cos(t)), -y.v)},
        {"flow": lambda mode, t, y, p: (y.v, -y.x + math.exp(-(100.0 * math.sin(0.5 * t)) ** 2))},
    ],
    ids=["switches", "guard", "kink", "steep", "relaxation", "stiff", "rounding", "pulses"],
)  # fmt: skip
def test_runs_tell_of_nothing_declared_or_smooth(given):
    given = {"period": 2.0 * math.pi, "initial": {"x": 0.5}, **given}
    system = mi.System(states=("x", "v"), **given)
    options = mi.Options(engine="interpreted", method="auto")
    assert caught_by(lambda: mi.simulate(system, periods=4, options=options)) == []
