"""What happens at fixed times: a blow once a period, by a switch that settles; no guard can."""

import math
from functools import partial

import numpy as np
import pytest
from scipy.linalg import expm

import mems_impact as mi
from mems_impact.analysis.attractor import InitialCondition, map_attractors

PLAIN = mi.Options(method="dop853", rtol=1e-11, atol=1e-13, engine="interpreted")
PERIOD = 2.0 * math.pi


def swing(mode, t, y, p):
    return y.v, -y.x - 0.2 * y.v


def blow(mode, t, y, p):
    return mode, (y.x, y.v + p.J)


def clock(mode, t, y, p):
    return math.cos(t - 1.0)


def step(mode, t, y, p):
    return 1.0 if t < 30.0 else -1.0


def struck(**how):
    return mi.System(states=("x", "v"), flow=swing, period=PERIOD, parameters={"J": 1.0}, **how)


CONDITIONS = [partial(mi.Guard, condition=True), mi.Impact]


def test_a_blow_once_a_period_against_its_closed_form():
    """Just before the blow y = M (y + J), with the matrix M of the motion over a period."""
    system = struck(switches=[1.0], switch_transition=blow)
    run = mi.simulate(system, periods=4, options=PLAIN)
    assert run.events["time"].tolist() == [1.0] * 4
    orbit = mi.find_orbit(system, options=PLAIN)
    flow = np.array([[0.0, 1.0], [-1.0, -0.2]])
    around = expm(PERIOD * flow)
    kick = np.array([0.0, 1.0])
    before = np.linalg.solve(np.eye(2) - around, around @ kick)
    start = expm((PERIOD - 1.0) * flow) @ (before + kick)
    assert [orbit.state.x, orbit.state.v] == pytest.approx(start.tolist(), abs=1e-9)
    assert np.abs(orbit.multipliers) == pytest.approx(math.exp(-0.1 * PERIOD), abs=1e-8)


@pytest.mark.parametrize("kind", CONDITIONS)
def test_as_a_guard_it_is_reported_why_not(kind):
    with pytest.raises(
        mi.FunctionError, match=r"depends on time alone, .* switches= .* switch_transition="
    ):
        struck(guards=[kind("hammer", clock, blow)])


@pytest.mark.parametrize("kind", CONDITIONS)
def test_and_so_where_only_a_run_meets_it(kind):
    """A margin that falls through zero after the check of the system."""
    guards = [kind("hammer", step, blow)]
    system = mi.System(states=("x", "v"), flow=swing, parameters={"J": 1.0}, guards=guards)
    options = mi.Options(engine="interpreted", max_events=50)
    with pytest.raises(mi.RunError, match=r"the margin depends on time alone") as caught:
        mi.simulate(system, duration=40.0, options=options)
    assert "restitution" not in str(caught.value)


BLOWS = [(1.0,), (PERIOD,), (1.0, PERIOD)]  # a blow within a period, at its end, or both


@pytest.mark.parametrize("times", BLOWS)
def test_samples_of_a_window_are_those_of_the_run(times):
    """The arc that holds the start of the window begins at a blow, which has taken place."""
    run = mi.simulate(struck(switches=times, switch_transition=blow), periods=4, options=PLAIN)
    whole = run.samples(7).set_index(["period", "time"])
    part = run.samples(7, first=2.0, last=3.5).set_index(["period", "time"])
    assert len(part) == 11
    assert part["v"].to_numpy() == pytest.approx(whole.loc[part.index, "v"].to_numpy(), abs=1e-12)


@pytest.mark.parametrize("times", BLOWS)
def test_a_sample_at_a_switch_is_the_state_before_it(times):
    """As the initial and the final state of a run are."""
    start = {"x": 0.5, "v": 0.25}
    system = struck(switches=times, switch_transition=blow)
    run = mi.simulate(system, periods=3, initial=start, options=PLAIN)
    samples = run.samples(1)
    assert samples[["x", "v"]].iloc[0].tolist() == [0.5, 0.25]
    for k in (1, 2, 3):
        shorter = mi.simulate(system, periods=k, initial=start, options=PLAIN).final
        assert samples[["x", "v"]].iloc[k].tolist() == pytest.approx([shorter.x, shorter.v])


@pytest.mark.parametrize("method", ["adams", "dop853"])
def test_samples_at_many_switches(method):
    """Switches lie beside the samples by rounding errors, after which CVODE has no state."""
    times = tuple(k / 20 for k in range(300, 345))
    clock = mi.System(states=("x",), flow=lambda mode, t, y, p: (1.0,), switches=times)
    run = mi.simulate(clock, duration=17.6, options=mi.Options(method=method))
    for count in (20, 40, 1000):
        samples = run.samples(count)
        assert samples["x"].to_numpy() == pytest.approx(samples["t"].to_numpy(), abs=1e-11)


@pytest.mark.quick(1)
@pytest.mark.parametrize("times", BLOWS)
def test_a_run_from_the_state_of_an_orbit_follows_it(times):
    system = struck(switches=times, switch_transition=blow)
    orbit = mi.find_orbit(system, options=PLAIN)
    run = mi.simulate(system, periods=2, initial=orbit.state, options=PLAIN)
    both = [each.samples(5, last=1.0)[["x", "v"]].to_numpy()[:5] for each in (run,)]
    assert both[0] == pytest.approx(orbit.samples(5)[["x", "v"]].to_numpy()[:5], abs=1e-9)
    assert [run.final.x, run.final.v] == pytest.approx([orbit.state.x, orbit.state.v], abs=1e-9)


@pytest.mark.quick(1)
@pytest.mark.parametrize("times", BLOWS)
def test_a_run_from_the_last_state_of_an_attractor_stays_on_it(times):
    system = struck(switches=times, switch_transition=blow)
    orbit = mi.find_orbit(system, options=PLAIN)
    recurrence = mi.RecurrenceOptions(transient=60, periods=20)
    (found,) = map_attractors([InitialCondition(system)], recurrence, PLAIN)
    assert (found.motion, found.period) == ("periodic", 1)
    run = mi.simulate(system, periods=2, initial=found.final, options=PLAIN)
    for state in (found.final, run.final):
        assert [state.x, state.v] == pytest.approx([orbit.state.x, orbit.state.v], abs=1e-5)


@pytest.mark.parametrize("times", BLOWS)
@pytest.mark.parametrize("first", [1.0, 2.0, 2.3])
def test_statistics_of_a_window_begin_with_its_state(times, first):
    velocity = mi.Observable("velocity", lambda y, p: y.v)
    system = struck(switches=times, switch_transition=blow, observables=[velocity])
    run = mi.simulate(system, periods=4, window=(first, 4.0), options=PLAIN)
    begin = run.samples(10, first=first, last=first)["v"].iloc[0]
    assert run.statistics["velocity"] * (4.0 - first) == pytest.approx(run.final.v - begin)


def logistic(mode, t, y, p):
    return mode, (p.r * y.x * (1.0 - y.x), y.w)


def wave(mode, t, y, p):
    return 0.0, math.cos(2.0 * math.pi * t) - 3.0 * y.w


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("r", "period"),
    [
        (2.9999, 1),
        (3.0002, 2),
        (3.4496, 4),
        *(pytest.param(r, period, marks=pytest.mark.slow) for r, period in ((3.2, 2), (3.5, 4))),
    ],
)
def test_the_orbit_of_a_map_at_its_switch(r, period):
    """The guess is on the orbit to six digits; the orbit has the multiplier of the map."""
    system = mi.System(
        states=("x", "w"), flow=wave, switches=[0.5], switch_transition=logistic,
        period=1.0, parameters={"r": r},
    )  # fmt: skip
    x = 0.4
    for _ in range(1_000_000):
        x = r * x * (1.0 - x)
    orbit = mi.find_orbit(system, guess={"x": x + 1e-6, "w": 0.0618834}, options=PLAIN)
    assert orbit.periods == period
    assert orbit.state.x == pytest.approx(x, abs=1e-8)
    factor = 1.0
    for _ in range(period):
        factor *= r * (1.0 - 2.0 * x)
        x = r * x * (1.0 - x)
    assert orbit.multipliers[0] == pytest.approx(factor, abs=1e-6)


def wall(mode, t, y, p):
    return mode, (0.0, -y.v)


def glide(mode, t, y, p):
    return y.v, 0.0


@pytest.mark.parametrize("method", ["adams", "bdf", "dop853"])
@pytest.mark.parametrize("start", [0.5, 0.5 * (1.0 - 2.0**-53), 0.5 * (1.0 + 2.0**-52)])
def test_a_guard_that_fires_at_a_switch_fires_after_it(start, method):
    """Whatever rounding says, neither is lost and the order is the same."""
    system = mi.System(
        states=("x", "v"), flow=glide, switches=[0.5], switch_transition=blow, period=1.0,
        guards=[mi.Impact("wall", margin=lambda mode, t, y, p: y.x, transition=wall)],
        initial={"x": start, "v": -1.0}, parameters={"J": 0.25},
    )  # fmt: skip
    options = mi.Options(method=method, engine="interpreted")
    run = mi.simulate(system, periods=1.25, options=options)
    assert run.final.v == 0.75
    pieces = mi.simulate(system, periods=0.5, options=options)
    pieces = mi.simulate(system, periods=0.75, initial=pieces.final, options=options)
    assert pieces.final.v == 0.75
