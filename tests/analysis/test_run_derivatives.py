"""Derivatives of runs against closed forms, published numbers and differences."""

import math

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


def test_the_example_of_hiskens_and_pai():
    """IEEE Trans. Circuits Syst. I 47 (2000) 204; PETSc's hybrid example 1."""
    system = mi.System(
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
        found = mi.simulate(system, duration=0.125, options=options).derivatives(list(exact))
        differences = (found.final - np.array(list(exact.values())).T).abs()
        assert differences.max(axis=None) < bound
        assert differences.max(axis=None) < found.error.max(axis=None) < 200.0 * bound


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


def pair(gap):
    """Two balls that strike their floors in one instant, or `gap` apart."""
    return mi.System(
        states=("x", "v", "z", "w"),
        flow=lambda mode, t, y, p: (y.v, -1.0, y.w, -1.0),
        parameters={"e": 0.5, "f": 0.8},
        initial={"x": 1.0, "z": 1.0 + gap},
        parts=[
            mi.Stopper("one", "x", "v", lower=0.0, restitution="e"),
            mi.Stopper("other", "z", "w", lower=0.0, restitution="f"),
        ],
    )


@pytest.mark.parametrize("gap", [0.0, 1e-16, -1e-16, 1e-12])
def test_two_balls_in_one_instant(gap):
    names = ["e", "f", "x0.x", "x0.z"]
    found = mi.simulate(pair(gap), duration=2.0, options=INTERPRETED).derivatives(names)
    t, fall = 2.0, math.sqrt(2.0)
    assert found.final.loc["v", "e"] == pytest.approx(fall, abs=1e-9)
    assert found.final.loc["w", "f"] == pytest.approx(fall, abs=1e-9)
    assert abs(found.final.loc[["w", "v"], ["e", "f"]].to_numpy()).min(axis=0) == pytest.approx(0.0)
    # x = e u (t - T) - (t - T)^2/2 with u = T = sqrt(2 h)
    by_height = (0.5 * (t - fall) - 0.5 * fall + (t - fall)) / fall
    assert found.final.loc["x", "x0.x"] == pytest.approx(by_height, abs=1e-9)
    assert found.final.loc["z", "x0.x"] == pytest.approx(0.0)


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
    assert run.derivatives(names).final.equals(found.final)


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
