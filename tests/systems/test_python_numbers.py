"""On the interpreted engine functions of the user get numbers of Python, whoever calls them."""

import math

import pytest

import mems_impact as mi

METHODS = ("adams", "bdf", "dop853", "auto")
FORTH, BACK = mi.modes("forth", "back")


def plain(mode, t, y, p):
    """Raise if a number is NumPy's: those compare to booleans that do not subtract."""
    assert type(mode) is int
    assert {type(value) for value in (t, *y, *p)} == {float}


def sign(x):
    return (x > 0.0) - (x < 0.0)


def named(mode, t, y, p):
    plain(mode, t, y, p)
    return y.v, -p.k * y.x - 0.2 * y.v + math.cos(t) - p.mu * (1 - 2 * mode)


def speed(mode, t, y, p):
    plain(mode, t, y, p)
    return y.v if mode == FORTH else -y.v


def turn(mode, t, y, p):
    plain(mode, t, y, p)
    return 1 - mode, (y.x, y.v)


def in_array(mode, t, y, p, dy):
    plain(mode, t, y, p)
    dy[0] = y[1]
    dy[1] = -p.k * y[0] - 0.2 * y[1] + math.cos(t) - p.mu * (1 - 2 * mode)


def speed_of_array(mode, t, y, p):
    plain(mode, t, y, p)
    return y[1] if mode == FORTH else -y[1]


def turn_of_array(mode, t, y, p, new):
    plain(mode, t, y, p)
    return 1 - mode


FORMS = {
    "named": (named, speed, turn),
    "arrays": (in_array, speed_of_array, turn_of_array),
}


def rubbing(form, **given):
    flow, margin, transition = FORMS[form]
    return mi.System(
        states=("x", "v"),
        flow=flow,
        period=2.0 * math.pi,
        parameters={"k": 1.0, "mu": 0.2},
        guards=[mi.Guard("turn", margin, transition)],
        modes=(FORTH, BACK),
        initial={"x": -3.0, "v": 0.1},
        **given,
    )


@pytest.mark.quick(4)
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("given", [{}, {"typical": {"x": 3.0, "v": 2.0, "time": 0.5}}])
def test_runs(form, method, given):
    options = mi.Options(engine="interpreted", method=method, rtol=1e-6)
    run = mi.simulate(rubbing(form, **given), periods=2, options=options)
    assert list(run.events["event"]) == ["turn"] * 4


@pytest.mark.slow
@pytest.mark.parametrize("form", ["named", "arrays"])
def test_orbits_and_exponents(form):
    options = mi.Options(engine="interpreted", method="dop853", rtol=1e-6)
    assert mi.find_orbit(rubbing(form), transient=10, options=options).stable
    assert mi.lyapunov(rubbing(form), transient=3, periods=6, options=options).exponents[0] < 0.0


def damped(mode, t, y, p):
    plain(mode, 0.0, y, p)
    return y.v, -p.k * y.x - y.v - 0.1 * sign(y.x - 9.0)


def high(mode, t, y, p):
    plain(mode, 0.0, y, p)
    return 9.0 - y.x


def test_equilibria():
    system = mi.System(
        states=("x", "v"),
        flow=damped,
        parameters={"k": 1.0},
        guards=[mi.Guard("high", high)],
        initial={"x": 0.3, "v": 0.0},
    )
    (found,) = mi.find_equilibria(system)
    assert found.state.x == pytest.approx(0.1, abs=1e-12)


@pytest.mark.parametrize("verb", [mi.find_orbit, mi.lyapunov])
def test_an_explanation_names_what_the_function_raised(verb):
    """No engine is advised that is at work, and no function that is the package's own."""

    def failing(mode, t, y, p):
        if y.v > p.limit:
            raise TypeError("beyond the table")
        return y.v, -y.x - y.v + math.cos(t)  # in the end sin t

    system = mi.System(
        states=("x", "v"),
        flow=failing,
        period=2.0 * math.pi,
        parameters={"limit": 1e9},  # of which the checks at the start tell nothing
        initial={"x": 0.0, "v": 1.0},
    ).changed(limit=0.5)
    options = mi.Options(engine="interpreted", method="dop853", rtol=1e-8)
    with pytest.raises((mi.RunError, mi.FunctionError, mi.OrbitError)) as caught:
        verb(system, transient=3, options=options)
    message = str(caught.value)
    assert message.startswith(("flow 'failing'", "a flow of the system"))
    assert f"line {failing.__code__.co_firstlineno + 2}) raises TypeError: beyond the" in message
    assert "engine" not in message


FALLING = {"states": ("x", "v"), "initial": {"x": 1.0, "v": -1.0}}
# Each raises an exception below some x, where a comparison or a minimum swallows inf and nan.
SWALLOWED = {
    "root": lambda mode, t, y, p: (y.v, 1.0 if math.sqrt(y.x) > 2.0 else 0.0),
    "power": lambda mode, t, y, p: (y.v, min(0.0, max(0.0, y.x) ** -0.5)),
    "logarithm": lambda mode, t, y, p: (y.v, min(0.0, math.log(y.x) + 9.0)),
    "arc": lambda mode, t, y, p: (y.v, min(0.0, math.acos(1.0 - y.x))),
    "division": lambda mode, t, y, p: (y.v, 0.0 * math.atan(1 / max(0.0, y.x))),
    "floor": lambda mode, t, y, p: (y.v, 1.0 if 1.0 // max(0.0, y.x) < 0.0 else 0.0),
    "exponential": lambda mode, t, y, p: (y.v, 0.0 * math.exp(-math.exp(1e4 * (0.3 - y.x)))),
    "square": lambda mode, t, y, p: (y.v, 0.0 * math.atan((1e200 * min(0.0, y.x)) ** 2)),
    "base": lambda mode, t, y, p: (y.v, min(0.0, math.log(0.5, 0.9 * y.x))),
    "remainder": lambda mode, t, y, p: (y.v, min(0.0, math.fmod(1.0, max(0.0, y.x)))),
    "sine": lambda mode, t, y, p: (y.v, min(0.0, math.sin(1e308 * max(1.0, 11.0 - 30.0 * y.x)))),
    "integers": lambda mode, t, y, p: (y.v, 0.0 * (1 // int(3.0 * y.x + 1.0 - 1e-9))),
}


@pytest.mark.parametrize("engine", ["compiled", "interpreted"])
@pytest.mark.parametrize("name", SWALLOWED)
def test_a_flow_that_python_cannot_evaluate_ends_the_run(name, engine):
    system = mi.System(flow=SWALLOWED[name], **FALLING)
    with pytest.raises(mi.RunError) as caught:
        mi.simulate(system, duration=3.0, options=mi.Options(engine=engine))
    assert 0.0 < caught.value.partial.final.x < 0.6


@pytest.mark.parametrize("engine", ["compiled", "interpreted"])
@pytest.mark.parametrize(
    ("speed", "raised"),
    [
        (lambda x: math.atan(1.0 / (0.0 * x)), "ZeroDivisionError"),
        (lambda x: max(0.5, math.log(-1.0 - x * x)), "ValueError"),
        (lambda x: min(0.5, math.exp(800.0 + x * x)), "OverflowError"),
    ],
)
def test_a_transition_that_python_cannot_evaluate_ends_the_run(speed, raised, engine):
    def bounce(mode, t, y, p):
        return mode, (y.x, speed(y.x))

    floor = mi.Guard("floor", lambda mode, t, y, p: y.x, bounce)
    system = mi.System(flow=lambda mode, t, y, p: (y.v, -1.0), guards=[floor], **FALLING)
    with pytest.raises(mi.RunError, match=f"transition of 'floor'.* raises {raised}"):
        mi.simulate(system, duration=3.0, options=mi.Options(engine=engine))
