"""Quantities of parts that add energy, or leave no mode that fits, are refused by name."""

import math

import pytest

import mems_impact as mi

PLAIN = mi.Options(engine="interpreted", method="dop853")


def fall(mode, t, y, p):
    return y.v, -1.0


def spring(mode, t, y, p):
    return y.v, -y.x


def ball(e, **parameters):
    floor = mi.Stopper("floor", "x", "v", lower=0.0, restitution=e)
    return mi.System(
        states=("x", "v"), flow=fall, parameters=parameters, initial={"x": 1.0}, parts=[floor]
    )


def block(parameters=None, masses=None, **friction):
    return mi.System(
        states=("x", "v"), flow=spring, parameters=parameters or {}, initial={"x": 1.0},
        masses=masses, parts=[mi.Friction("ground", "v", **friction)],
    )  # fmt: skip


def room(lower, upper, **parameters):
    return mi.System(
        states=("T",), flow=lambda mode, t, y, p: (2.0 - 2.0 * mode.heater - y.T,),
        parameters=parameters, parts=[mi.Relay("heater", "T", lower=lower, upper=upper)],
    )  # fmt: skip


def stribeck(**changes):
    return mi.Stribeck(**{"static": 0.3, "dynamic": 0.2, "speed": 0.1, **changes})


@pytest.mark.slow(all=True)
@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ball(1.5), "restitution of 'floor' = 1.5: must be between 0 and 1"),
        (lambda: ball("r", r=-0.5), "r = -0.5: must be between 0 and 1; it is restitution of"),
        (lambda: ball(lambda p: 3.0 * p.k, k=0.4), "1.2.*: must be .*function of k = 0.4"),
        (lambda: block(mu=-0.1), "mu of 'ground' = -0.1: must be >= 0"),
        (lambda: block({"m": -0.2}, mu="m"), "m = -0.2: must be >= 0; it is mu of 'ground'"),
        (lambda: block(mu=lambda u, p: u - 0.1), "mu of 'ground' = -0.1: must be >= 0"),
        (lambda: block({"N": -2.0}, mu=0.1, normal="N"), "N = -2.* it is normal of 'ground'"),
        (lambda: block(mu=0.3, static=0.2), "static of 'ground' = 0.2: must be >= 0.3"),
        (lambda: block({"s": 0.2}, mu=stribeck(), static="s"), r"s = 0.2: must be >= 0.3 \(mu of"),
        (lambda: block({"m": 0.3}, mu="m", static=0.2), r"= 0.2: must be >= 0.3 \(m, mu of 'gro"),
        (lambda: block(mu=stribeck(speed=-0.1)), "speed of mu of 'ground' = -0.1: must be > 0"),
        (lambda: block({"w": 0.0}, mu=stribeck(speed="w")), "w = 0: must be > 0; it is speed"),
        (lambda: block(mu=stribeck(dynamic=-0.1)), "dynamic of mu of 'ground' = -0.1: must be"),
        (lambda: block(mu=0.1, masses={"v": -2.0}), "mass of v = -2: must be > 0"),
        (lambda: room(1.2, 1.1), "upper of 'heater' = 1.1: must be >= 1.2"),
        (lambda: room("low", 1.0, low=1.5), r"= 1: must be >= 1.5 \(low, lower of 'heater'\)"),
    ],
)
def test_a_quantity_beyond_its_limit_is_refused_by_name(make, message):
    with pytest.raises(mi.InvalidParameter, match=message):
        make()


def test_a_parameter_that_moves_a_quantity_beyond_its_limit_is_refused():
    damped = mi.System(
        states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -y.x - 0.1 * y.v + math.cos(t)),
        period=2.0 * math.pi, parameters={"r": 0.8}, initial={"x": 0.5},
        parts=[mi.Stopper("wall", "x", "v", upper=20.0, restitution="r")],
    )  # fmt: skip
    orbit = mi.find_orbit(damped, options=PLAIN, transient=1)
    for refused in (
        lambda: damped.changed(r=1.1),
        lambda: mi.sweep(damped, "r", [0.8, 1.1], transient=1, periods=1, options=PLAIN),
        lambda: mi.continue_solution(orbit, "r", stop=1.1),
    ):
        with pytest.raises(mi.InvalidParameter, match=r"r = 1\.1: must be between 0 and 1"):
            refused()


@pytest.mark.parametrize(
    ("friction", "message"),
    [
        ({"mu": 0.1, "normal": lambda t, y, p: y.x}, "normal of 'ground' is -0.9"),
        ({"mu": lambda u, p: 0.1 - 0.2 * u, "surface": 0.5}, "mu of 'ground' is -0.0"),
    ],
)
def test_friction_that_adds_energy_during_a_run_is_warned_of(friction, message):
    with pytest.warns(mi.ValidityWarning, match=message):
        mi.simulate(block(**friction), duration=3.0, options=PLAIN)


@pytest.mark.slow
def test_limits_themselves_are_allowed():
    for e in (0.0, 1.0):
        ball(e)
    room(1.0, 1.0)
    for friction in ({"mu": 0.0}, {"mu": 0.2, "static": 0.2}, {"mu": 0.1, "normal": 0.0}):
        block(**friction)
