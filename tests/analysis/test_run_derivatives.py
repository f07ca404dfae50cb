"""Derivatives of runs against closed forms, published numbers and differences."""

import math
from itertools import permutations

import numpy as np
import pytest

import mems_impact as mi
from mems_impact.hybrid.differences import sixth_order_difference

INTERPRETED = mi.Options(engine="interpreted")  # compilation takes longer than these runs
FINE = mi.Options(engine="interpreted", method="dop853", rtol=1e-12, atol=1e-14)


def falling(mode, t, y, p):
    return y.v, -p.g


def bouncing(e, **options):
    floor = mi.Stopper("floor", "x", "v", lower=0.0, restitution="e")
    return mi.System(
        states=("x", "v"), flow=falling, parameters={"g": 9.8, "e": e}, initial={"x": 1.0},
        parts=[floor], **options,
    )  # fmt: skip


@pytest.mark.parametrize(
    "engine", ["interpreted", pytest.param("compiled", marks=pytest.mark.slow(all=True))]
)
def test_bounces_and_their_end(engine):
    run = mi.simulate(bouncing(0.5), duration=3.0, options=mi.Options(engine=engine))
    found = run.derivatives(["e", "g", "x0.x"])
    first = math.sqrt(2.0 / 9.8)
    count = len(run.events) - 1
    by_e = [first * sum(2 * j * 0.5 ** (j - 1) for j in range(1, k + 1)) for k in range(count)]
    events = found.events
    assert np.abs(events["dt/de"][:count] - by_e).max() < 1e-9
    assert np.abs(events["dt/dg"] + run.events["t"] / (2 * 9.8)).max() < 1e-9
    assert np.abs(events["dt/dx0.x"] - run.events["t"] / 2).max() < 1e-9
    assert events["kind"].iloc[-1] == "chatter ends"
    assert events["dt/de"].iloc[-1] == pytest.approx(8 * first, abs=1e-8)  # T (1 + 2e/(1 - e))
    assert (found.final.abs() < 1e-9).all(axis=None)


def spiral(mode, t, y, p):
    if mode == 0:
        return y.a - 100.0 * y.b, 10.0 * y.a + y.b
    return y.a + 10.0 * y.b, -100.0 * y.a + y.b


def hiskens_and_pai():
    """IEEE Trans. Circuits Syst. I 47 (2000) 204; PETSc's hybrid example 1."""
    return mi.System(
        states=("a", "b"),
        modes=("one", "two"),
        flow=spiral,
        parameters={"l1": 2.75, "l2": 0.36},
        initial={"b": 1.0},
        guards=[
            mi.Guard("to two", lambda mode, t, y, p: y.b - p.l1 * y.a,
                     lambda mode, t, y, p: (1, (y.a, y.b)), modes=(0,)),
            mi.Guard("to one", lambda mode, t, y, p: p.l2 * y.a - y.b,
                     lambda mode, t, y, p: (0, (y.a, y.b)), modes=(1,)),
        ],
    )  # fmt: skip


def test_the_example_of_hiskens_and_pai():
    exact = {
        "l1": (-0.102723187869359, 0.0703041416260091),
        "x0.a": (-0.238144981943192, 0.0316126656996),
        "x0.b": (-0.3161266569964, -0.238144981943192),
    }
    for options, bound in (
        (INTERPRETED, 1e-9),
        (mi.Options(engine="interpreted", method="dop853"), 1e-9),
        (FINE, 1e-11),
    ):
        run = mi.simulate(hiskens_and_pai(), duration=0.125, options=options)
        found = run.derivatives(list(exact))
        differences = (found.final - np.array(list(exact.values())).T).abs()
        assert differences.max(axis=None) < bound
        assert differences.max(axis=None) < found.error.max(axis=None) < 200.0 * bound
    run = mi.simulate(hiskens_and_pai(), duration=0.2, options=FINE)
    assert len(run.events) == 6
    found = run.derivatives(["l1"]).final["l1"]
    assert found.tolist() == pytest.approx([-0.0155332395487168, 0.0120474048066989], abs=1e-11)


def constant(*slopes):
    return lambda mode, t, y, p: slopes


def published():
    """Return systems with one event, duration, parameter, and the derivative of the last state."""
    level = mi.Guard("level", lambda mode, t, y, p: p.q - y.u,
                     lambda mode, t, y, p: (mode, (0.0,)))  # fmt: skip
    stops = mi.Guard("stops", lambda mode, t, y, p: y.x, lambda mode, t, y, p: (1, (y.x, y.y)),
                     modes=(0,))  # fmt: skip
    doses = mi.Guard("dose", lambda mode, t, y, p: y.u - p.q,
                     lambda mode, t, y, p: (mode, (y.u + p.d,)))  # fmt: skip
    drop = math.sqrt(2.0 / 9.8)
    yield pytest.param(  # x = e u (1 - T) - g (1 - T)^2/2 with u = g T
        bouncing(0.8), 1.0, "e", {"x": 9.8 * drop * (1.0 - drop), "v": 9.8 * drop},
        id="SciML, bouncing ball",
    )  # fmt: skip
    yield pytest.param(
        mi.System(states=("u",), flow=constant(1.0), parameters={"q": 0.7}, guards=[level]),
        1.0, "q", {"u": -1.0}, id="DiffEqGPU.jl 533",
    )  # fmt: skip
    yield pytest.param(
        mi.System(
            states=("x", "y"), modes=("moves", "stopped"), guards=[stops], initial={"x": 1.0},
            flow=lambda mode, t, y, p: (-p.a, 1.0 if mode == 0 else 0.0), parameters={"a": 2.0},
        ),
        1.0, "a", {"y": -0.25}, id="SciMLSensitivity.jl 4",
    )  # fmt: skip
    after = (0.3 + 0.5) * math.exp(-0.8 * (2.0 - math.log(1.0 / 0.3) / 0.8))  # (q + d)/q e^(-k t)
    yield pytest.param(
        mi.System(
            states=("u",), flow=lambda mode, t, y, p: (-p.k * y.u,), guards=[doses],
            parameters={"k": 0.8, "q": 0.3, "d": 0.5}, initial={"u": 1.0},
        ),
        2.0, "k", {"u": -2.0 * after}, id="cOde, doses",
    )  # fmt: skip


@pytest.mark.parametrize(("system", "duration", "name", "exact"), list(published()))
def test_published_examples(system, duration, name, exact):
    for method, bound in (("dop853", 1e-9), ("adams", 1e-7 if name == "k" else 1e-9)):
        options = mi.Options(engine="interpreted", method=method)
        found = mi.simulate(system, duration=duration, options=options).derivatives([name]).final
        for state, value in exact.items():
            assert found.loc[state, name] == pytest.approx(value, abs=bound)


def test_instants_of_events_that_end_a_run():
    """OrdinaryDiffEq.jl 4388: 1; `ev_sensitivity` of heyoka: pi/2 sqrt(1/k)."""
    ramp = mi.System(states=("u",), flow=constant(1.0), parameters={"q": 0.7})
    spring = mi.System(
        states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -p.k * y.x), parameters={"k": 2.0},
        initial={"x": 1.0},
    )  # fmt: skip
    for system, until, name, exact in (
        (ramp, lambda mode, t, y, p: p.q - y.u, "q", 1.0),
        (spring, lambda mode, t, y, p: y.x, "k", -math.pi / (4.0 * 2.0**1.5)),
    ):
        options = mi.Options(engine="interpreted", method="dop853")
        run = mi.simulate(system, until=until, options=options)
        found = run.derivatives([name]).events[f"dt/d{name}"]
        assert found.tolist() == pytest.approx([exact], abs=1e-9)


@pytest.mark.slow(all=True)
def test_a_forced_run_moves_with_its_period():
    actuator = mi.load_actuator("zhao2004")
    names = ["e", "omega", "x0.x2"]

    def run(omega, e=0.8, x2=0.1):
        drive = mi.Sine(amplitude=0.24, omega=omega)
        start = mi.State(x2=x2)
        return mi.simulate(actuator.replace(e=e), drive, periods=20, initial=start, options=FINE)

    found = run(0.5).derivatives(names)

    def last(run):
        return np.array([run.final.x1, run.final.v1, run.final.x2, run.final.v2])

    def displacement(run):
        return np.array([run.statistics["displacement per impact"]])

    for function in (last, displacement):
        exact = [
            sixth_order_difference(lambda h, f=function: f(run(0.5, e=0.8 + h)), 1e-4),
            sixth_order_difference(lambda h, f=function: f(run(0.5 + h)), 1e-4),
            sixth_order_difference(lambda h, f=function: f(run(0.5, x2=0.1 + h)), 1e-4),
        ]
        np.testing.assert_allclose(found.jacobian(function).T, exact, rtol=0, atol=1e-7)
    assert found.of(lambda run: run.final.x2).to_numpy() == pytest.approx(found.final.loc["x2"])


@pytest.mark.slow(all=True)
def test_switches_of_a_drive():
    """Abrupt switches, one of them at the end of the period; 10 impacts."""
    actuator = mi.load_actuator("zhao2004")

    def run(duty=0.4, omega=0.5):
        drive = mi.Square(amplitude=0.24, omega=omega, duty=duty)
        return mi.simulate(actuator, drive, periods=2.3, initial={"x2": 0.1}, options=FINE)

    def last(run):
        return np.array([run.final.x1, run.final.v1, run.final.x2, run.final.v2])

    found = run().derivatives(["duty", "omega"]).final
    for name, value in (("duty", 0.4), ("omega", 0.5)):
        exact = sixth_order_difference(lambda h, n=name, v=value: last(run(**{n: v + h})), 1e-5)
        np.testing.assert_allclose(found.loc[["x1", "v1", "x2", "v2"], name], exact, atol=1e-7)


def pair(gap, order=1):
    """Two balls that strike their floors in one instant, or `gap` apart."""
    floors = [
        mi.Stopper("one", "x", "v", lower=0.0, restitution="e"),
        mi.Stopper("other", "z", "w", lower=0.0, restitution="f"),
    ]
    return mi.System(
        states=("x", "v", "z", "w"),
        flow=lambda mode, t, y, p: (y.v, -1.0, y.w, -1.0),
        parameters={"e": 0.5, "f": 0.8},
        initial={"x": 1.0, "z": 1.0 + gap},
        parts=floors[::order],
    )


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("gap", [0.0, 2.0**-52, -(2.0**-53), 1e-12])
def test_two_balls_in_one_instant(gap, order):
    names = ["e", "f", "x0.x", "x0.z"]
    found = mi.simulate(pair(gap, order), duration=2.0, options=INTERPRETED).derivatives(names)
    t, fall = 2.0, math.sqrt(2.0)
    events = found.run.events.set_index("event")
    instant = events.loc["one", "t"]
    before, after = (found.samples([instant], side).loc[0] for side in ("before", "after"))
    assert [before["dv/de"], after["dv/de"]] == pytest.approx([0.0, fall], abs=1e-11)
    assert found.final.loc["v", "e"] == pytest.approx(fall, abs=1e-11)
    assert found.final.loc["w", "f"] == pytest.approx(fall, abs=1e-11)
    assert abs(found.final.loc[["w", "v"], ["e", "f"]].to_numpy()).min(axis=0) == pytest.approx(0.0)
    # x = e u (t - T) - (t - T)^2/2 with u = T = sqrt(2 h)
    by_height = (0.5 * (t - fall) - 0.5 * fall + (t - fall)) / fall
    assert found.final.loc["x", "x0.x"] == pytest.approx(by_height, abs=1e-11)
    assert found.final.loc["z", "x0.x"] == pytest.approx(0.0, abs=1e-14)


def test_a_tie_with_one_sided_derivatives():
    """Each of two events slows the approach to the other; z gains the same by both orders."""
    system = mi.System(
        states=("x", "y", "r", "z"),
        flow=lambda mode, t, y, p: (-y.r, -y.r, 0.0, y.r),
        initial={"x": 1.0, "y": 1.0, "r": 1.0},
        guards=[
            mi.Guard("first", lambda mode, t, y, p: y.x,
                     lambda mode, t, y, p: (mode, (y.x, y.y, 0.5 * y.r, y.z))),
            mi.Guard("second", lambda mode, t, y, p: y.y,
                     lambda mode, t, y, p: (mode, (y.x, y.y, 0.8 * y.r, y.z))),
        ],
    )  # fmt: skip
    found = mi.simulate(system, duration=3.0, options=INTERPRETED).derivatives(["x0.x", "x0.y"])
    assert found.events["kind"].tolist() == ["tie", "tie"]
    assert found.final.loc["z"].isna().all()
    # x first: z = 1 + b + 0.4 (T - 1 + a - 2 b); y first: z = 1 + a + 0.4 (T - 1 + b/4 - 5/4 a).
    for direction, value in (
        ({"x0.x": 1.0}, 0.5),
        ({"x0.x": -1.0}, -0.4),
        ({"x0.y": 1.0}, 0.2),
        ({"x0.y": -1.0}, -0.1),
        ({"x0.x": 1.0, "x0.y": 1.0}, 0.6),
    ):
        along = found.directional(direction).final.loc["z", "direction"]
        assert along == pytest.approx(value, abs=1e-9), direction


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_three_events_in_one_instant_in_every_order(order):
    """Events at distances s = 1 + d reduce the rate of s and z by factors: z by all six orders."""
    factors = {"first": 0.5, "second": 0.8, "third": 0.9}
    system = mi.System(
        states=("x", "y", "w", "r", "z"),
        flow=lambda mode, t, y, p: (-y.r, -y.r, -y.r, 0.0, y.r),
        initial={"x": 1.0, "y": 1.0, "w": 1.0, "r": 1.0},
        guards=[
            mi.Guard("first", lambda mode, t, y, p: y.x,
                     lambda mode, t, y, p: (mode, (y.x, y.y, y.w, 0.5 * y.r, y.z))),
            mi.Guard("second", lambda mode, t, y, p: y.y,
                     lambda mode, t, y, p: (mode, (y.x, y.y, y.w, 0.8 * y.r, y.z))),
            mi.Guard("third", lambda mode, t, y, p: y.w,
                     lambda mode, t, y, p: (mode, (y.x, y.y, y.w, 0.9 * y.r, y.z))),
        ],
    )  # fmt: skip
    found = mi.simulate(system, duration=3.0, options=INTERPRETED)
    steps = dict(zip(("x0.x", "x0.y", "x0.w"), order, strict=True))
    along = found.derivatives(list(steps)).directional(steps).final.loc["z", "direction"]
    one, other, last = (list(factors.values())[order.index(place)] for place in range(3))
    exact = 2.0 - one * other * last * (1.0 / one + 1.0 / (one * other))  # s = 0, 1, 2
    assert along == pytest.approx(exact, abs=1e-9)


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_three_resets_in_one_instant_that_do_not_commute(order):
    """They happen in the order of the guards; a direction has derivatives if it keeps the order."""
    resets = [lambda r: 0.5 * r, lambda r: r + 0.3, lambda r: r * r]
    guards = [
        mi.Guard(
            f"guard {i}",
            lambda mode, t, y, p, i=i: (y.x, y.y, y.w)[i],
            lambda mode, t, y, p, reset=resets[i]: (mode, (y.x, y.y, y.w, reset(y.r), y.z)),
        )
        for i in order
    ]
    system = mi.System(
        states=("x", "y", "w", "r", "z"), flow=lambda mode, t, y, p: (-1.0, -1.0, -1.0, 0.0, y.r),
        initial={"x": 1.0, "y": 1.0, "w": 1.0, "r": 2.0}, guards=guards,
    )  # fmt: skip
    run = mi.simulate(system, duration=3.0, options=INTERPRETED)
    levels = [2.0]
    for i in order:
        levels.append(resets[i](levels[-1]))
    assert [run.final.r, run.final.z] == pytest.approx([levels[-1], 2.0 + 2.0 * levels[-1]])
    names = ["x0.x", "x0.y", "x0.w"]
    found = run.derivatives(names)
    assert found.final.loc[["r", "z"]].isna().all(axis=None)
    for times in permutations((0.0, 1.0, 2.0)):  # of guard 0, 1, 2
        along = found.directional(dict(zip(names, times, strict=True))).final.loc["z", "direction"]
        if sorted(range(3), key=times.__getitem__) == list(order):
            first, second, third = (times[i] for i in order)
            exact = levels[0] * first + levels[1] * (second - first)
            exact += levels[2] * (third - second) - levels[3] * third
            assert along == pytest.approx(exact, abs=1e-9)
        else:
            assert math.isnan(along)


def test_a_graze_is_refused():
    def run(depth, options=FINE):
        level = 1.0 - depth
        hit = mi.Guard("hit", lambda mode, t, y, p: p.level - y.x,
                       lambda mode, t, y, p: (1, (y.x, -0.5 * y.v)), modes=(0,))  # fmt: skip
        system = mi.System(
            states=("x", "v"),
            modes=("free", "after"),
            flow=lambda mode, t, y, p: (y.v, -y.x),
            parameters={"level": level},
            initial={"v": 1.0},
            guards=[hit],
        )
        return mi.simulate(system, duration=3.0, options=options)

    for depth in (1e-2, 1e-4, 1e-6):
        found = run(depth).derivatives(["level"]).events
        exact = 1.0 / math.sqrt(1.0 - (1.0 - depth) ** 2)  # t = arcsin(level)
        assert found["dt/dlevel"].iloc[0] == pytest.approx(exact, rel=1e-6 + 1e-11 / depth)
    for depth in 10.0 ** -np.arange(2.0, 13.0):
        found = run(depth, INTERPRETED).derivatives(["level"])
        error = 1e-9 * (2.0 - depth) + 1e-11  # of the margin
        if found.events["kind"].iloc[0] == "graze":
            assert depth <= 10.0 * error
            continue
        exact = 1.0 / math.sqrt(1.0 - (1.0 - depth) ** 2)
        bound = max(1e-6, 10.0 * error / (2.0 * depth))
        assert found.events["dt/dlevel"].iloc[0] == pytest.approx(exact, rel=bound)
        # x = L cos(T - t) - v/2 sin(T - t) with t = arcsin L, v = sqrt(1 - L^2)
        level, rest = 1.0 - depth, 3.0 - math.asin(1.0 - depth)
        by_level = (1.0 + 0.5) * math.cos(rest) + 1.5 * level * exact * math.sin(rest)
        off = abs(found.final.loc["x", "level"] - by_level)
        assert not off > found.error.loc["x", "level"]  # nan if looser tolerances find no event
    refused = run(1e-10, INTERPRETED).derivatives(["level"])  # below the error of the run
    assert refused.events["kind"].tolist() == ["graze"]
    assert refused.final.isna().all(axis=None)


def test_sliding_and_rest():
    """The block of the belt sticks to it, and rests until the spring breaks it away."""
    system = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, -p.k * y.x),
        parameters={"k": 1.0, "mu": 0.3, "mu_s": 0.6, "belt": 0.2},
        initial={"x": 0.01, "v": 0.2},
        parts=[mi.Friction("belt", "v", mu="mu", static="mu_s", surface="belt")],
    )
    run = mi.simulate(system, duration=4.0, options=INTERPRETED)
    found = run.derivatives(["k", "mu", "mu_s", "belt"])
    release = found.events.iloc[0]  # x = 0.01 + belt t = mu_s/k
    exact = {"k": -3.0, "mu": 0.0, "mu_s": 5.0, "belt": -0.59 / 0.04}
    for name, value in exact.items():
        assert release[f"dt/d{name}"] == pytest.approx(value, abs=1e-8)


def test_the_period_of_stick_and_slip():
    """P = 2 D/b + 2 pi - 2 arctan(D/b), D = mu_s - mu, for a mass and a spring of 1."""
    system = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, -y.x),
        parameters={"mu": 0.3, "mu_s": 0.6, "belt": 0.2},
        initial={"x": 0.1, "v": 0.2},
        parts=[mi.Friction("belt", "v", mu="mu", static="mu_s", surface="belt")],
    )
    options = mi.Options(engine="interpreted", method="dop853")
    events = mi.simulate(system, duration=20.0, options=options).derivatives(
        ["mu", "mu_s", "belt"]
    ).events  # fmt: skip
    one, other = events[events["event"] == events["event"].iloc[0]].index[:2]
    period = events.loc[other] - events.loc[one, ["t", "dt/dmu", "dt/dmu_s", "dt/dbelt"]]
    by_ratio = 2.0 - 2.0 / (1.0 + 1.5**2)  # D/b = 1.5
    assert period["t"] == pytest.approx(3.0 + 2.0 * math.pi - 2.0 * math.atan(1.5), abs=1e-9)
    assert period["dt/dmu_s"] == pytest.approx(by_ratio / 0.2, abs=1e-9)
    assert period["dt/dmu"] == pytest.approx(-by_ratio / 0.2, abs=1e-9)
    assert period["dt/dbelt"] == pytest.approx(-by_ratio * 1.5 / 0.2, abs=1e-9)


def test_sliding_on_a_surface():
    """On y = 0 the share of the flow above is (c + a)/(2 a): x' = (b - d) (c + a)/(2 a) + d."""
    system = mi.System(
        states=("x", "y"),
        flow=lambda mode, t, y, p: (
            p.b if mode.line > 0 else p.d, p.c - p.a * mode.line
        ),
        parameters={"a": 1.0, "b": 2.0, "c": 0.25, "d": -1.0},
        initial={"y": 1.5},
        parts=[mi.SwitchingSurface("line", "y")],
    )  # fmt: skip
    found = mi.simulate(system, duration=5.0, options=INTERPRETED).derivatives(["a", "c", "x0.y"])
    instant, speed = 2.0, 3.0 * 0.625 - 1.0  # reached at y0/(a - c)
    by_a = (2.0 - speed) * -instant / 0.75 + 3.0 * 3.0 * -0.25 / 2.0
    by_c = (2.0 - speed) * instant / 0.75 + 3.0 * 3.0 / 2.0
    exact = [by_a, by_c, (2.0 - speed) / 0.75]
    assert found.final.loc["x"].tolist() == pytest.approx(exact, abs=1e-9)
    assert found.final.loc["y"].tolist() == pytest.approx([0.0] * 3, abs=1e-12)


def test_an_undeclared_jump_warns():
    def flow(mode, t, y, p):
        return (1.0 if y.x < p.level else 3.0,)

    with pytest.warns(mi.DiscontinuityWarning):
        system = mi.System(states=("x",), flow=flow, parameters={"level": 0.5}, initial={"x": 0.4})
    run = mi.simulate(system, duration=2.0, options=INTERPRETED)
    with pytest.raises(mi.InvalidParameter, match="the threshold of an if, has no derivative"):
        run.derivatives(["level"]).final  # noqa: B018


def test_the_derivatives_of_an_orbit_close():
    """dx0/dp = (1 - dx/dx0)^-1 dx/dp, by the derivatives of a run of one period."""
    system = mi.System(
        states=("x", "v"),
        flow=lambda mode, t, y, p: (y.v, -p.k * y.x - p.c * y.v + p.A * math.cos(0.9 * t)),
        parameters={"k": 1.0, "c": 0.02, "A": 0.5, "e": 0.7},
        period=2.0 * math.pi / 0.9,
        parts=[mi.Stopper("wall", "x", "v", upper=1.0, restitution="e")],
    )
    names = ["k", "c", "A", "e"]
    orbit = mi.find_orbit(mi.simulate(system, 60, options=FINE))
    quantities = [mi.Quantity("x", lambda orbit: orbit.state.x),
                  mi.Quantity("v", lambda orbit: orbit.state.v)]  # fmt: skip
    table = mi.sensitivity(orbit, names, quantities=quantities).table
    rates = table.pivot(index="quantity", columns="parameter", values="derivative")
    run = mi.simulate(system, orbit.periods, initial=orbit.state, options=FINE)
    map_rates = run.derivatives(["x0.x", "x0.v", *names]).final.to_numpy()
    closed = np.linalg.solve(np.eye(2) - map_rates[:, :2], map_rates[:, 2:])
    np.testing.assert_allclose(rates.loc[["x", "v"], names], closed, rtol=0, atol=1e-10)


def test_a_fit_by_least_squares():
    from scipy import optimize

    system = bouncing(0.7)
    record = mi.simulate(system, duration=2.5, options=FINE).events["t"].to_numpy()[:4]

    def misses(run):
        return run.events["t"].to_numpy()[:4] - record

    near = mi.value_and_jacobian(
        system, misses, ["e", "g", "x0.x"], duration=2.5, initial={"x": 1.0}, options=INTERPRETED
    )
    found = optimize.least_squares(
        lambda x: near([*x, 1.0])[0], [0.75, 10.0], jac=lambda x: near([*x, 1.0])[1][:, :2],
        xtol=1e-14,
    )  # fmt: skip
    assert found.x == pytest.approx([0.7, 9.8], abs=1e-7)
    _, by_gravity, by_height = near([*found.x, 1.0])[1].T
    assert found.x[1] * by_gravity == pytest.approx(-by_height, abs=1e-9)  # only the ratio shows


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["f"], "parameter = 'f': must be one of g, e, x0.x, x0.v"),
        ([], "parameters = (): must be one or more different names"),
        (["e", "e"], "parameters = ('e', 'e'): must be one or more different names"),
    ],
)
def test_names_that_are_refused(names, message):
    run = mi.simulate(bouncing(0.5), duration=0.2, options=INTERPRETED)
    with pytest.raises(mi.InvalidParameter) as caught:
        run.derivatives(names)
    assert str(caught.value).startswith(message)


def test_a_switch_at_once_after_another_one_in_a_later_period():
    """At the end u = b + r (t - T), with the instant T = c/b of both switches."""
    system = mi.System(
        states=("u",),
        modes=("first", "passed", "last"),
        flow=lambda mode, t, y, p: (p.b if mode < 2 else p.r,),
        parameters={"b": 0.7, "c": 2.0, "r": 0.2, "omega": 2.0 * math.pi},
        period=lambda p: 2.0 * math.pi / p.omega,
        guards=[
            mi.Guard("level", lambda mode, t, y, p: p.c - y.u,
                     lambda mode, t, y, p: (1, (y.u,)), modes=(0,)),
            mi.Guard("at once", lambda mode, t, y, p: p.r - y.u,
                     lambda mode, t, y, p: (2, (p.b,)), modes=(1,), condition=True),
        ],
    )  # fmt: skip
    run = mi.simulate(system, periods=5, options=INTERPRETED)
    found = run.derivatives(["b", "c", "omega"])
    t, instant = 5.0, 2.0 / 0.7
    rates = {"b": 1.0 + 0.2 * instant / 0.7, "c": -0.2 / 0.7, "omega": -0.2 * t / (2.0 * math.pi)}
    for name, rate in rates.items():
        assert found.final.loc["u", name] == pytest.approx(rate, abs=1e-9)
    instants = found.events[["dt/db", "dt/dc", "dt/domega"]].to_numpy()
    assert instants == pytest.approx(np.array([[-instant / 0.7, 1.0 / 0.7, 0.0]] * 2), abs=1e-9)


@pytest.mark.slow
def test_functions_of_statistics_and_directions():
    run = mi.simulate(bouncing(0.5), duration=1.2, keep="statistics", options=INTERPRETED)
    full = mi.simulate(bouncing(0.5), duration=1.2, options=INTERPRETED)
    names = ["e", "x0.x"]
    found = full.derivatives(names)

    def speed(run):
        return run.impacts["v after"].iloc[-1]

    by_name = found.of(speed)
    along = found.directional({"e": 2.0, "x0.x": 0.5}).of(speed).loc["direction"]
    assert along == pytest.approx(2.0 * by_name["e"] + 0.5 * by_name["x0.x"], rel=1e-9)
    assert by_name["e"] == pytest.approx(3.0 * 0.25 * math.sqrt(2.0 * 9.8), rel=1e-9)
    kept = run.derivatives(names)
    assert kept.final.equals(found.final)
    assert kept.error.equals(found.error)
    with pytest.raises(mi.InvalidParameter, match="simulate again with keep='events'"):
        kept.events  # noqa: B018

    def share(run):
        return [run.statistics["share free"], run.final.v]

    np.testing.assert_array_equal(kept.jacobian(share), found.jacobian(share))
    both = kept.directional({"e": 2.0, "x0.x": 0.5}).jacobian(share)
    np.testing.assert_allclose(both[:, 0], kept.jacobian(share) @ [2.0, 0.5], rtol=1e-9, atol=1e-10)


def test_the_state_at_the_end_of_bounces_moves_with_its_instant():
    """Beside the ball u falls freely: at the instant of rest du/de = -u T', T' = 8 sqrt(2/g)."""
    floor = mi.Stopper("floor", "x", "v", lower=0.0, restitution="e")
    system = mi.System(
        states=("x", "v", "u"), flow=lambda mode, t, y, p: (y.v, -p.g, -y.u),
        parameters={"g": 9.8, "e": 0.5}, initial={"x": 1.0, "u": 1.0}, parts=[floor],
    )  # fmt: skip
    run = mi.simulate(system, duration=3.0, options=INTERPRETED)
    rest = run.derivatives(["e"]).events.iloc[-1]
    u = run.events["u"].iloc[-1]
    assert rest["du/de"] == pytest.approx(-u * 8.0 * math.sqrt(2.0 / 9.8), abs=1e-8)
    assert abs(run.derivatives(["e"]).final.loc["u", "e"]) < 1e-11


def test_two_bodies_at_rest_on_each_other_move_as_their_centre():
    """Both have the frequency 1: the centre follows x'' = -x + f/M, whatever the impacts are."""
    system = mi.System(
        states=("x", "z", "v", "w"),
        flow=lambda mode, t, y, p: (y.v, y.w, p.f - y.x, 0.5 - y.z),
        parameters={"e": 0.5, "f": -0.5},
        initial={"x": 0.1, "v": 1.0},
        masses={"v": 1.0, "w": 2.0},
        parts=[mi.Stopper("stop", "x", "v", lower=0.0, restitution="e", against=("z", "w"))],
    )
    run = mi.simulate(system, duration=5.0, options=INTERPRETED)
    found = run.derivatives(["e", "f", "x0.x", "x0.z", "x0.v"])
    rest = found.events.iloc[-1]
    assert rest["kind"] == "chatter ends"
    part = np.array([[0.0, 1.0 / 3.0, 1.0 / 3.0, 2.0 / 3.0, 1.0 / 3.0]])
    position = part * [0.0, 1.0 - math.cos(5.0), math.cos(5.0), math.cos(5.0), math.sin(5.0)]
    speed = part * [0.0, math.sin(5.0), -math.sin(5.0), -math.sin(5.0), math.cos(5.0)]
    exact = np.vstack([position, position, speed, speed])
    np.testing.assert_allclose(found.final, exact, rtol=0, atol=1e-9)
    later = run.events["v"].iloc[-1] * rest["dt/de"]
    assert rest["dx/de"] == pytest.approx(later, abs=1e-9)


def test_a_stop_by_friction_between_the_last_impact_and_the_end_of_chatter():
    def run(e):
        system = mi.System(
            states=("x", "v", "z", "w"),
            flow=lambda mode, t, y, p: (y.v, -0.3 * y.x, y.w, 1.0),
            parameters={"e": e},
            initial={"x": 0.1},
            masses={"v": 1.0, "w": 0.5},
            parts=[
                mi.Friction("ground", "v", mu=2.0),
                mi.Stopper("stop", "z", "w", upper=0.0, restitution="e", against=("x", "v")),
            ],
        )
        return mi.simulate(system, duration=1.0, options=FINE)

    log = run(0.5).events.iloc[-2:]
    assert log["mode after"].tolist() == ["forward-free", "stuck-held"]
    exact = sixth_order_difference(lambda h: np.array(run(0.5 + h).final.x), 1e-5)
    found = run(0.5).derivatives(["e"]).final["e"]
    assert found.tolist() == pytest.approx([exact, 0.0, exact, 0.0], abs=1e-10)


def thrown(count, g, e, c, d, x):
    """Instants at which a ball falls to a floor that throws it from a depth d below it."""
    t, speed, times = 0.0, (2.0 * g * x) ** 0.5, []
    up = 0.0
    for _ in range(count):
        t = t + (up + speed) / g
        times.append(t)
        up = c + e * speed
        speed = (up**2 - 2.0 * g * d) ** 0.5
    return np.array(times)


@pytest.mark.parametrize("depth", [0.0, 3e-7])
def test_a_reset_that_leaves_the_margin_slightly_below_zero(depth):
    values = {"g": 1.0, "e": 0.5, "c": 0.4, "d": depth}
    floor = mi.Guard(
        "floor", lambda mode, t, y, p: y.x, lambda mode, t, y, p: (mode, (-p.d, p.c - p.e * y.v))
    )
    system = mi.System(
        states=("x", "v"), flow=falling, parameters=values, initial={"x": 0.5}, guards=[floor]
    )
    run = mi.simulate(system, duration=8.0, options=INTERPRETED)
    found, count, values = run.derivatives([*values, "x0.x"]), len(run.events), {**values, "x": 0.5}
    assert np.abs(run.events["t"] - thrown(count, **values)).max() < 1e-13
    for name, value in values.items():
        exact = thrown(count, **{**values, name: value + 1e-30j}).imag / 1e-30
        rate = found.events[f"dt/d{'x0.x' if name == 'x' else name}"]
        assert rate.to_numpy() == pytest.approx(exact, rel=1e-11, abs=1e-11)
    orbit = mi.find_orbit(mi.simulate(system, duration=60.0, options=FINE))
    speed = (0.2 + math.sqrt(0.04 + 0.75 * (0.16 - 2.0 * depth))) / 0.75  # (c + e u)^2 - 2 g d
    up = 0.4 + 0.5 * speed
    assert orbit.period == pytest.approx(up + speed, rel=1e-11)
    assert orbit.multipliers[0].real == pytest.approx(0.5 * up / speed, rel=1e-10)


def test_a_margin_that_begins_below_zero_and_stays_there():
    """A ball that is thrown wherever it is below a ceiling and falls."""
    ceiling = mi.Guard(
        "throw", lambda mode, t, y, p: y.x - p.ceiling,
        lambda mode, t, y, p: (mode, (y.x, p.c)), condition=True,
    )  # fmt: skip
    system = mi.System(
        states=("x", "v"), flow=falling, parameters={"g": 1.0, "c": 1.0, "ceiling": 1.0},
        initial={"x": 0.25, "v": 1.0}, guards=[ceiling],
    )  # fmt: skip
    run = mi.simulate(system, duration=7.0, options=INTERPRETED)
    events = run.derivatives(["g", "c", "ceiling", "x0.x"]).events
    times = 2.0 * np.repeat(range(4), (1, 2, 2, 2))
    for name, exact in (("t", times), ("dt/dg", -times), ("dt/dc", times),
                        ("dt/dceiling", 0.0), ("dt/dx0.x", 0.0)):  # fmt: skip
        assert events[name].to_numpy() == pytest.approx(exact, abs=1e-8), name


@pytest.mark.parametrize("name", ["threshold", "count", "spare"])
def test_what_has_no_derivative_is_refused(name):
    def flow(mode, t, y, p):
        return (-p.k * y.x ** int(p.count), 1.0 if y.x < p.threshold else 0.0)

    values = {"k": 1.0, "threshold": -9.0, "count": 1.0, "spare": 0.0}
    system = mi.System(states=("x", "z"), flow=flow, parameters=values, initial={"x": 1.0})
    run = mi.simulate(system, duration=1.0, options=INTERPRETED)
    assert run.derivatives(["k"]).final.loc["x", "k"] == pytest.approx(-math.exp(-1.0), abs=1e-8)
    with pytest.raises(mi.InvalidParameter, match=f"'{name}': must be one that the equations read"):
        run.derivatives([name]).final  # noqa: B018


def test_times_outside_the_run():
    found = mi.simulate(bouncing(0.5), duration=0.2, options=INTERPRETED).derivatives(["e"])
    with pytest.raises(mi.InvalidParameter, match=r"times from 0 to 0\.2"):
        found.samples([0.3])
