"""Signs of normal forms that theory gives, or the stability of the branch that bifurcates."""

import math

import pytest

import mems_impact as mi

ABOVE, BELOW = "supercritical", "subcritical"


def lorenz(mode, t, y, p):
    return 10.0 * (y.y - y.x), y.x * (p.r - y.z) - y.y, y.x * y.y - 8.0 / 3.0 * y.z


def brusselator(mode, t, y, p):
    return 1.0 - (p.B + 1.0) * y.x + y.x**2 * y.y, p.B * y.x - y.x**2 * y.y


def fitzhugh(mode, t, y, p):
    return y.v - y.v**3 / 3.0 - y.w + p.I, 0.08 * (y.v + 0.7 - 0.8 * y.w)


def predators(mode, t, y, p):
    eaten = y.x * y.y / (1.0 + y.x)
    return y.x * (1.0 - y.x / p.K) - eaten, 2.0 * eaten - y.y


def decreasing_friction(mode, t, y, p):
    return y.v, -y.x - 0.1 * y.v + 0.3 + 0.5 * math.exp(y.v - p.belt)


def cubic_friction(mode, t, y, p):
    slip = (p.belt - y.v) / 0.5
    return y.v, -y.x - 0.05 * y.v + 0.4 - 0.225 * (slip - slip**3 / 3.0)


def takens(mode, t, y, p):
    return y.y, -1.0 + p.b * y.y + y.x**2 + y.x * y.y


def hoop(mode, t, y, p):
    return y.w, math.sin(y.q) * (p.turn**2 * math.cos(y.q) - 1.0) - 0.2 * y.w


def hardening(mode, t, y, p):
    return y.v, p.a * y.x - 0.1 * y.v + y.x**3 - y.x**5


@pytest.mark.quick(2)
@pytest.mark.parametrize(
    ("flow", "start", "parameter", "low", "high", "points"),
    [
        (lorenz, "xyz", "r", 0.5, 2.0, [(1.0, ABOVE)]),
        (brusselator, {"x": 1.0, "y": 1.0}, "B", 1.0, 3.0, [(2.0, ABOVE)]),
        # 2 b - b^2 epsilon - 1 is positive.
        (fitzhugh, {"v": -1.2, "w": -0.6}, "I", 0.0, 2.0, [(0.331281, BELOW), (1.418719, BELOW)]),
        (predators, {"x": 1.0, "y": 1.0}, "K", 2.0, 4.0, [(3.0, ABOVE)]),
        (decreasing_friction, "xv", "belt", 3.0, 1.0, [(math.log(5.0), BELOW)]),
        (cubic_friction, "xv", "belt", 0.6, 0.3, [(0.5 * math.sqrt(8.0 / 9.0), ABOVE)]),
        (takens, {"x": -1.0, "y": 0.0}, "b", 0.0, 2.0, [(1.0, BELOW)]),
        (hoop, "qw", "turn", 0.5, 1.5, [(1.0, ABOVE)]),
        (hardening, "xv", "a", -0.5, 0.5, [(0.0, BELOW)]),
    ],
)  # fmt: skip
def test_equilibria(flow, start, parameter, low, high, points):
    guess = start if isinstance(start, dict) else dict.fromkeys(start, 0.0)
    system = mi.System(states=tuple(guess), flow=flow, parameters={parameter: low})
    first = mi.find_equilibria(system, guess=guess)[0]
    found = mi.continue_solution(first, parameter, high).special_points
    assert [each.value for each in found] == pytest.approx([at for at, _ in points], abs=1e-6)
    assert [each.criticality for each in found] == [kind for _, kind in points]


@pytest.mark.slow
def test_the_hopf_point_of_the_lorenz_system():
    system = mi.System(states=("x", "y", "z"), flow=lorenz, parameters={"r": 15.0})
    first = mi.find_equilibria(system, guess={"x": 6.0, "y": 6.0, "z": 14.0})[0]
    (hopf,) = mi.continue_solution(first, "r", 30.0).special_points
    assert hopf.value == pytest.approx(470.0 / 19.0, abs=1e-9)
    assert hopf.criticality == BELOW


def logistic(y, p):
    return (p.r * y.x * (1.0 - y.x),)


def ricker(y, p):
    return (y.x * math.exp(p.r * (1.0 - y.x)),)


def henon(y, p):
    return 1.0 - p.r * y.x**2 + y.y, 0.3 * y.x


def delayed_logistic(y, p):
    return p.r * y.x * (1.0 - y.y), y.x


def odd(y, p):
    return (p.r * y.x - y.x**3,)


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["compiled", "interpreted"])
@pytest.mark.parametrize(
    ("function", "guess", "low", "high", "label", "value", "coefficient", "criticality"),
    [
        (logistic, {"x": 0.6}, 2.5, 3.3, "PD", 3.0, 9.0, ABOVE),
        (ricker, {"x": 1.0}, 1.5, 2.3, "PD", 2.0, 2.0 / 3.0, ABOVE),
        (henon, {"x": 0.9, "y": 0.27}, 0.2, 0.6, "PD", 0.3675, None, ABOVE),
        (delayed_logistic, {"x": 0.44, "y": 0.44}, 1.8, 2.2, "NS", 2.0, -1.0, ABOVE),
        (odd, {"x": 0.0}, 0.5, 1.5, "BP", 1.0, -1.0, ABOVE),
        (odd, {"x": 0.0}, -0.5, -1.5, "PD", -1.0, -1.0, BELOW),
    ],
)
def test_maps(function, guess, low, high, label, value, coefficient, criticality, engine):
    still = (0.0,) * len(guess)
    system = mi.System(
        states=tuple(guess),
        flow=lambda mode, t, y, p: still,
        switch_transition=lambda mode, t, y, p: (mode, function(y, p)),
        switches=(0.5,),
        period=1.0,
        parameters={"r": low},
    )
    options = mi.Options(method="dop853", rtol=1e-11, atol=1e-13, engine=engine)
    orbit = mi.find_orbit(system, periods=1, guess=guess, options=options)
    (point,) = mi.continue_solution(orbit, "r", high).special_points
    assert (point.label, point.value) == (label, pytest.approx(value, abs=1e-9))
    assert point.criticality == criticality
    if coefficient is not None:
        assert point.normal_form.coefficient == pytest.approx(coefficient, abs=1e-7)


def pendulum(mode, t, y, p):
    return y.w, -0.04 * y.w - (1.0 + p.depth * math.cos(p.turn * t)) * math.sin(y.q)


@pytest.mark.nightly
@pytest.mark.parametrize(("turn", "criticality"), [(1.9, BELOW), (2.15, ABOVE)])
def test_a_parametrically_excited_pendulum(turn, criticality):
    """It softens: below its resonance the doubled oscillation exists below the threshold."""
    system = mi.System(
        states=("q", "w"), flow=pendulum, period=lambda p: 2.0 * math.pi / p.turn,
        parameters={"turn": turn, "depth": 0.05},
    )  # fmt: skip
    orbit = mi.find_orbit(system, guess={"q": 0.0, "w": 0.0})
    (doubling,) = mi.continue_solution(orbit, "depth", 0.5).special_points
    assert (doubling.label, doubling.criticality) == ("PD", criticality)
    few = mi.StepControl(max_points=8)
    table = mi.switch_branch(doubling, bounds=(0.0, 1.0), steps=few).table.iloc[1:]
    above = criticality == ABOVE
    assert ((table["depth"] > doubling.value) == above).all()
    assert (table["stable"] == above).all()


def vanderpol(mode, t, y, p):
    return y.v, (p.mu - y.x**2) * y.v - y.x + 1.2 * math.cos(1.7 * t)


@pytest.mark.nightly
def test_a_torus_of_the_forced_van_der_pol_oscillator():
    """Runs approach a small torus beyond the point, from inside and outside, and none before."""
    system = mi.System(
        states=("x", "v"), flow=vanderpol, period=2.0 * math.pi / 1.7, parameters={"mu": -0.2}
    )
    orbit = mi.find_orbit(system, transient=100)
    (point,) = mi.continue_solution(orbit, "mu", 1.0).special_points
    assert (point.label, point.criticality) == ("NS", ABOVE)
    for change, low, high in ((-0.01, 0.0, 1e-6), (0.01, 0.40, 0.42)):
        beside = system.changed(mu=point.value + change)
        near = mi.find_orbit(beside, guess=point.orbit.state, periods=1)
        for distance in (0.02, 0.3):
            start = {"x": near.state.x + distance, "v": near.state.v}
            run = mi.simulate(beside, periods=1500, initial=start)
            x = run.trajectory.samples(1).y[-300:, 0]
            assert low <= x.max() - x.min() < high
