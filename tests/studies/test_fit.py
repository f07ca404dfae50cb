"""Fits to records beside closed forms, and what records and arguments may not be."""

import math

import numpy as np
import pandas as pd
import pytest
from scipy import optimize

import mems_impact as mi

INTERPRETED = mi.Options(engine="interpreted")  # compilation takes longer than these runs


def oscillating(mode, t, y, p):
    return y.v, -p.k * y.x - p.c * y.v


def bouncing(**values):
    return mi.System(
        states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -p.g), initial={"x": 1.0},
        parameters={"g": 9.81, "e": 0.8, **values},
        parts=[mi.Stopper("floor", "x", "v", lower=0.0, restitution="e")],
    )  # fmt: skip


def impacts(count, **values):
    run = mi.simulate(bouncing(**values), duration=3.5, options=INTERPRETED)
    return run.events["t"].to_numpy()[:count]


def closed_form(t, k, c, x0, offset, delay=0.0):
    rate = math.sqrt(k - 0.25 * c * c)
    s = t - delay
    return offset + x0 * np.exp(-0.5 * c * s) * (
        np.cos(rate * s) + 0.5 * c / rate * np.sin(rate * s)
    )


def test_a_flight_beside_its_closed_form():
    generator, t = np.random.default_rng(3), np.linspace(0.0, 0.4, 15)

    def flight(t, x0, v0, g, zero):
        return x0 + v0 * t - 0.5 * g * t * t, v0 - g * t + zero

    noise = 0.01 * generator.standard_normal((2, t.size))
    x, v = np.array(flight(t, 1.0, 0.5, 9.81, 0.2)) + noise
    table = pd.DataFrame({"t": t, "x": x, "v": v})
    thrown = mi.System(
        states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -p.g), parameters={"g": 9.0}
    )
    record = mi.Record(samples=table, errors={"x": 0.01, "v": 0.01})
    found = mi.fit(thrown, record, ["x0.x", "x0.v", "g", "offset.v"], options=INTERPRETED)
    exact, covariance = optimize.curve_fit(
        lambda t, *p: np.concatenate(flight(t, *p)), t, np.append(x, v), [1.0, 0.0, 9.0, 0.0],
        sigma=np.full(2 * t.size, 0.01), absolute_sigma=True,
    )  # fmt: skip
    assert found.parameters["fitted"].to_numpy() == pytest.approx(exact, abs=1e-7)
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-5, atol=1e-9)
    assert list(found.noise) == []


@pytest.mark.slow
@pytest.mark.parametrize("known", [True, False])
def test_estimates_and_covariance_are_those_of_the_closed_form(known):
    generator, t = np.random.default_rng(2), np.linspace(0.1, 8.0, 40)
    noise = np.where(t < 3.0, 0.02, 0.05)
    x = closed_form(t, 2.0, 0.2, 1.0, 0.3) + noise * generator.standard_normal(t.size)
    system = mi.System(
        states=("x", "v"), flow=oscillating, parameters={"k": 1.8, "c": 0.3}, initial={"x": 1.0}
    )
    scatter = {"errors" if known else "weights": {"x": noise if known else 1.0 / noise}}
    record = mi.Record(samples=pd.DataFrame({"t": t, "x": x}), **scatter)
    found = mi.fit(system, record, ["k", "c", "x0.x", "offset.x"], options=INTERPRETED)
    values, covariance = optimize.curve_fit(
        closed_form, t, x, [1.8, 0.3, 1.0, 0.0], sigma=noise, absolute_sigma=known, xtol=1e-12
    )
    errors = np.sqrt(np.diag(covariance))
    assert found.verdict == "good"
    assert np.abs(found.parameters["fitted"] - values).max() < 1e-5 * errors.min()
    np.testing.assert_allclose(found.covariance, covariance, rtol=1e-4)
    profile = found.profile("c")
    near = profile[(profile["c"] - found.values["c"]).abs() < 1.1 * errors[1]]
    parabola = ((near["c"] - found.values["c"]) / errors[1]) ** 2
    np.testing.assert_allclose(near["rise"], parabola, atol=0.05)


@pytest.mark.slow
def test_a_prior_and_an_observable_of_the_state():
    """Beside least squares with the prior as one more residual."""
    t = np.linspace(0.0, 3.0, 12)
    data = closed_form(t, 2.0, 0.2, 1.0, 0.0) ** 2
    square = mi.Observable("square", lambda y, p: p.gain * y.x**2)
    system = mi.System(
        states=("x", "v"), flow=oscillating, parameters={"k": 2.2, "c": 0.2, "gain": 1.0},
        initial={"x": 1.0}, observables=[square],
    )  # fmt: skip
    record = mi.Record(samples=pd.DataFrame({"t": t, "square": data}), errors={"square": 0.01})
    found = mi.fit(system, record, ["k", "gain"], priors={"gain": (1.1, 0.02)}, options=INTERPRETED)

    def residuals(x):
        form = x[1] * closed_form(t, x[0], 0.2, 1.0, 0.0) ** 2
        return np.append((form - data) / 0.01, (x[1] - 1.1) / 0.02)

    solved = optimize.least_squares(residuals, [2.2, 1.0], jac="3-point", xtol=1e-12)
    assert found.parameters["fitted"].to_numpy() == pytest.approx(solved.x, abs=1e-6)
    inverse = np.linalg.inv(solved.jac.T @ solved.jac)
    np.testing.assert_allclose(found.covariance, inverse, rtol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("e", [0.6, 0.7, 0.9])
def test_impacts_are_matched_that_the_record_lacks_or_the_ball_has_not(e):
    times = impacts(9)
    heard = np.sort(np.append(np.delete(times, 3), 1.5))
    found = mi.fit(
        bouncing(e=e), mi.Record(events=pd.DataFrame({"t": heard}), errors={"t": 1e-3}),
        ["e", "x0.x"], options=INTERPRETED,
    )  # fmt: skip
    assert found.values == pytest.approx({"e": 0.8, "x0.x": 1.0}, abs=1e-6)
    assert "1 of 9 recorded events floor have no event of the system" in found.note
    assert "1 events floor of the system are not in the record" in found.note
    assert found.verdict == "good"
    assert found.residuals["computed"].isna().sum() == 1


@pytest.mark.slow
def test_records_with_clocks_of_their_own_and_the_file_of_a_fit(tmp_path):
    times = impacts(6)
    records = [
        mi.Record(
            events=pd.DataFrame({"t": times + delay}), errors={"t": 1e-3}, free=["delay"], name=name
        )
        for name, delay in (("left", 0.02), ("right", -0.03))
    ]
    found = mi.fit(bouncing(e=0.75), records, ["e"], options=INTERPRETED)
    exact = {"e": 0.8, "delay left": 0.02, "delay right": -0.03}
    assert found.values == pytest.approx(exact, abs=1e-7)
    assert found.system.parameters["e"] == found.values["e"]
    found.save(tmp_path / "found.zip")
    again = mi.load(tmp_path / "found.zip", system=bouncing())
    assert again == found
    assert str(again) == str(found)
    assert len(found.profile("e")) > 4
    with pytest.raises(mi.InvalidParameter, match="fit: from a file"):
        again.profile("e")


@pytest.mark.slow
def test_what_the_data_cannot_separate_is_named():
    """Impacts tell the ratio of height and gravity alone."""
    record = mi.Record(events=pd.DataFrame({"t": impacts(5)}), errors={"t": 1e-3})
    with pytest.warns(mi.FitWarning, match=r"cannot separate g, x0\.x: .* along g\^1 x0\.x\^1"):
        found = mi.fit(bouncing(e=0.79), record, ["e", "g", "x0.x"], options=INTERPRETED)
    errors = found.parameters["standard error"]
    assert np.isfinite(errors[0])
    assert np.isinf(errors[1:]).all()
    with pytest.raises(mi.InvalidParameter, match="'idle': must be one that the equations read"):
        mi.fit(bouncing(e=0.79, idle=1.0), record, ["e", "idle"], options=INTERPRETED)


@pytest.mark.slow
def test_a_sample_beside_an_impact_bounds_the_estimates():
    """Beside constrained least squares of the closed form: no impact before 0.4515."""
    t, noise = np.array([0.1, 0.2, 0.3, 0.4, 0.4515, 0.5, 0.6]), [0.04, -0.02, 0.02, 0.06, 0.04]

    def motion(p, before=slice(5)):
        x0, g, e = p
        instant = math.sqrt(2.0 * x0 / g)
        x = e * g * instant * (t - instant) - 0.5 * g * (t - instant) ** 2
        v = (1.0 + e) * g * instant - g * t
        x[before], v[before] = x0 - 0.5 * g * t[before] ** 2, -g * t[before]
        return x, v

    x, v = motion((1.0, 9.81, 0.8))
    v[:5] -= noise
    errors = {"x": 2e-3, "v": 0.02}
    record = mi.Record(samples=pd.DataFrame({"t": t, "x": x, "v": v}), errors=errors)

    def chi_square(p):
        one, other = motion(p)
        return np.sum(((one - x) / 2e-3) ** 2 + ((other - v) / 0.02) ** 2)

    bound = {"type": "ineq", "fun": lambda p: 2.0 * p[0] - p[1] * t[4] ** 2}
    exact = optimize.minimize(chi_square, (1.0, 9.81, 0.8), constraints=bound, method="SLSQP")
    free = optimize.minimize(chi_square, (1.0, 9.81, 0.8), method="SLSQP")
    found = mi.fit(bouncing(e=0.75), record, ["x0.x", "g", "e"], options=INTERPRETED)
    assert exact.fun > free.fun + 1.0
    assert found.chi_square == pytest.approx(exact.fun, abs=0.03)
    far = (found.parameters["fitted"] - exact.x) / found.parameters["standard error"]
    assert np.abs(far).max() < 0.03
    assert "the sequence of events changes next to the fitted values" in found.note


@pytest.mark.slow
def test_further_starts_find_another_minimum():
    """The slope a^3 - a is 2 at a = 1.5214, and largest for a < 0 at a = -1/sqrt(3)."""
    t = np.linspace(0.1, 1.0, 5)
    system = mi.System(
        states=("x",), flow=lambda mode, t, y, p: (p.a**3 - p.a,), parameters={"a": -1.0}
    )
    line = pd.DataFrame({"t": t, "x": 2.0 * t})
    given = {"bounds": {"a": (-2.0, 2.0)}, "options": INTERPRETED}
    with pytest.warns(mi.FitWarning, match="misfit"):
        one = mi.fit(system, line, ["a"], **given)
    assert one.values["a"] == pytest.approx(-math.sqrt(1.0 / 3.0), abs=1e-5)
    found = mi.fit(system, line, ["a"], starts=4, **given)
    assert found.values["a"] == pytest.approx(1.52137970680457, abs=1e-7)
    assert found.starts["a"].min() < 0.0 < found.starts["a"].iloc[0]


@pytest.mark.slow
def test_a_record_of_a_steady_state():
    """The motion before it is computed, or its state is free; otherwise the fit is a misfit."""
    period = device().forcing_period
    t = np.linspace(60.1, 63.9, 100) * period
    times = t.tolist()
    v = mi.simulate(device(), 64).derivatives(["k"]).samples(times)["v"]
    trace = pd.DataFrame({"t": t - 60.0 * period, "v": v + 0.02 * np.cos(80.0 * t)})
    start = device().changed(c=0.022, A=0.49)
    settled = mi.fit(start, mi.Record(samples=trace, transient=60), ["c", "A", "e"])
    free = mi.fit(start, trace, ["c", "A", "e", "x0.x", "x0.v"])
    for found in (settled, free):
        assert found.verdict == "good"
        assert found.values["e"] == pytest.approx(0.7, abs=0.01)
    with pytest.warns(mi.FitWarning, match="a record of a steady state needs transient"):
        mi.fit(start, trace, ["c", "A", "e"])


TIMES = pd.DataFrame({"t": [0.1, 0.2, 0.3], "x": [0.9, 0.8, 0.5]})


@pytest.mark.parametrize(
    ("table", "changes", "message"),
    [
        (TIMES.assign(x=[0.9, math.nan, 0.5]), {}, "column x is nan in row 1"),
        (TIMES.assign(t=[0.1, 0.3, 0.2]), {}, "t = 0.2 in row 2 is not in order"),
        (TIMES.assign(t=[0.1, 0.2, 0.2]), {}, "t = 0.2 in row 2 is given twice"),
        (TIMES[:0], {}, "samples: without rows"),
        (TIMES.rename(columns={"x": "height"}), {}, "must be t, event or one of x, v"),
        (TIMES.rename(columns={"t": "time"}), {}, "a table with a column t"),
        (TIMES.assign(x="high"), {}, "column x has texts"),
        (TIMES.assign(t=[-0.1, 0.2, 0.3]), {}, "where the motion begins"),
        (TIMES, {"weights": {"x": [1.0, 0.0, 1.0]}}, "weights of x = 0: must be > 0"),
        (TIMES, {"errors": {"x": -1.0}}, "errors of x = -1: must be > 0"),
        (TIMES, {"errors": {"v": 1.0}}, "errors = 'v': must be one of x"),
    ],
)
def test_records_that_are_refused(table, changes, message):
    with pytest.raises(mi.InvalidParameter) as caught:
        mi.fit(bouncing(), mi.Record(samples=table, **changes), ["g"], options=INTERPRETED)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("free", "changes", "message"),
    [
        (["mass"], {}, "free = 'mass': must be one of g, e, x0.x, x0.v, delay, offset.x"),
        ([], {}, "one or more different names"),
        (["g", "g"], {}, "one or more different names"),
        (["g"], {"bounds": {"g": (1.0, 2.0)}}, "low <= 9.81 <= high, where the search begins"),
        (["g"], {"bounds": {"e": (0.0, 1.0)}}, "for one of g"),
        (["g"], {"priors": {"g": (9.8, 0.0)}}, "standard error > 0"),
        (["g"], {"starts": 0}, "starts = 0"),
    ],
)
def test_arguments_that_are_refused(free, changes, message):
    with pytest.raises(mi.InvalidParameter) as caught:
        mi.fit(bouncing(), TIMES, free, options=INTERPRETED, **changes)
    assert message in str(caught.value)


def sprung(mode, t, y, p):
    return y.v, -p.k * y.x - p.c * y.v + p.A * math.cos(0.9 * t)


def device():
    return mi.System(
        states=("x", "v"), flow=sprung, parameters={"k": 1.0, "c": 0.02, "A": 0.5, "e": 0.7},
        period=2.0 * math.pi / 0.9,
        parts=[mi.Stopper("wall", "x", "v", upper=1.0, restitution="e")],
    )  # fmt: skip


def belt():
    return mi.System(
        states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -p.k * y.x),
        parameters={"k": 1.0, "belt": 0.2, "mu_s": 1.0, "mu_d": 0.6}, initial={"x": 0.1, "v": 0.2},
        parts=[mi.Friction("belt", "v", mu="mu_d", static="mu_s", surface="belt")],
    )  # fmt: skip


def trials(kind, count):
    """Return how often each quantity is inside its 95 % interval, and the number of fits."""
    generator = np.random.default_rng(5)
    if kind == "ball":
        system, free, truth = (
            bouncing(),
            ["e", "x0.x", "delay"],
            {"e": 0.8, "x0.x": 1.0, "delay": 0.0},
        )
        times = mi.simulate(system, duration=3.5).events["t"].to_numpy()[:8]
        start = system.changed(e=0.75)
    elif kind == "device":
        system, free = device(), ["k", "c", "A", "e"]
        truth, times = system.parameters, np.linspace(0.5, 60.0, 250)
        exact = mi.simulate(system, 9).derivatives(["k"]).samples(times)["v"].to_numpy()
        start = system.changed(k=1.05, c=0.03, A=0.48, e=0.65)
    else:
        system, free = belt(), ["k", "mu_s", "mu_d"]
        truth, times = system.parameters, np.linspace(0.3, 25.0, 120)
        exact = mi.simulate(system, duration=25.5).derivatives(["k"]).samples(times)["x"].to_numpy()
        start = system.changed(k=1.05, mu_s=1.05, mu_d=0.57)
    inside = dict.fromkeys(free, 0)
    for _ in range(count):
        noise = generator.standard_normal(times.size)
        if kind == "ball":
            table = pd.DataFrame({"t": times + 0.001 * noise})
            record = mi.Record(events=table, errors={"t": 0.001})
        else:
            name = "v" if kind == "device" else "x"
            record = mi.Record(samples=pd.DataFrame({"t": times, name: exact + 0.02 * noise}))
        rows = mi.fit(start, record, free).parameters.set_index("parameter")
        for name in free:
            inside[name] += rows.loc[name, "95 % low"] <= truth[name] <= rows.loc[name, "95 % high"]
    return inside


@pytest.mark.nightly
@pytest.mark.parametrize("kind", ["ball", "device", "belt"])
def test_truth_is_in_95_percent_of_the_intervals(kind):
    inside = trials(kind, 200)
    assert min(inside.values()) > 0.95 * 200 - 3.0 * math.sqrt(0.95 * 0.05 * 200)
