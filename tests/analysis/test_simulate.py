"""Runs of the actuator: what they keep, refuse and report."""

import math

import numpy as np
import pytest

import mems_impact as mi
from mems_impact._util import progress

ZHAO = mi.load_actuator("zhao2004")
DRIVE = mi.Sine(amplitude=0.24, omega=0.5)
KICK = mi.State(v2=1.0)
INTERPRETED = mi.Options(method="dop853", engine="interpreted")


@pytest.fixture(scope="module")
def walking():
    return mi.simulate(ZHAO, DRIVE, 300, initial=KICK)


def refused(**arguments):
    arguments = {"actuator": ZHAO, "drive": DRIVE, "periods": 2} | arguments
    with pytest.raises(mi.InvalidParameter) as caught:
        mi.simulate(**arguments)
    return caught.value


# The paper, Section 4, at omega = 0.5.


def test_paper_off():
    run = mi.simulate(ZHAO, DRIVE.replace(amplitude=0.16), 300)
    assert run.statistics["impacts"] == 0
    assert run.statistics["displacement per period"] == 0


def test_paper_one_impact_a_forcing_period(walking):
    assert walking.statistics["impacts per period"] == 1.0
    assert walking.statistics["displacement per impact std"] < 1e-9
    assert (walking.impacts["stopper"].iloc[100:] == "right").all()
    assert walking.statistics["displacement per period"] > 0


# Tables.


def test_impacts(walking):
    hits = walking.impacts
    assert list(hits.columns) == [
        "period", "time", "t", "phase", "stopper", "v1 before", "v1 after", "v2 before", "v2 after",
        "energy lost", "x1", "step",
    ]  # fmt: skip
    assert hits["phase"].between(0, 1, inclusive="left").all()
    np.testing.assert_allclose(hits["phase"] * DRIVE.period, hits["time"], rtol=1e-15)
    ratio = -hits["v2 after"] / hits["v2 before"]
    np.testing.assert_allclose(ratio, ZHAO.e, rtol=1e-14)
    # The frame is at rest whenever it is struck: its steps are all that moves it.
    assert hits["step"].iloc[:-1].sum() == pytest.approx(hits["x1"].iloc[-1], abs=1e-13)


def chatter():
    slippery = ZHAO.replace(mu_s=0.01, mu_d=0.01)
    drive = mi.Sine(amplitude=0.45, omega=0.1)
    return mi.simulate(slippery, drive, 6, initial=KICK)


def test_events(walking):
    events = walking.events
    assert set(events["event"]) == {"right impact", "left impact", "slip end"} & set(
        events["event"]
    )
    # Every transition begins in the mode in which the one before it ended.
    assert (
        events["mode before"].iloc[1:].astype(str).to_numpy()
        == events["mode after"].iloc[:-1].astype(str).to_numpy()
    ).all()
    assert set(chatter().events["event"]) >= {"right impact", "chatter ends", "release"}


def test_section(walking):
    both, up, down = (walking.section(direction) for direction in (0, 1, -1))
    assert len(both) == len(up) + len(down)
    assert (up["v2"] > 0).all()
    assert (down["v2"] < 0).all()
    assert refuses_section(walking).field == "direction"


def refuses_section(run):
    with pytest.raises(mi.InvalidParameter) as caught:
        run.section(2)
    return caught.value


def test_samples(walking):
    grid = walking.samples(50, 298)
    assert len(grid) == 101
    assert list(grid.columns) == ["period", "time", "t", "x1", "v1", "x2", "v2", "mode"]
    np.testing.assert_allclose(np.diff(grid["t"]), DRIVE.period / 50, rtol=1e-9)
    assert grid["x2"].abs().max() <= ZHAO.delta + 1e-9
    assert (grid["x2"].iloc[-1], grid["v2"].iloc[-1]) == pytest.approx(
        (walking.final.x2, walking.final.v2), abs=1e-12
    )


@pytest.mark.parametrize(
    "arguments", [{"per_period": 0}, {"per_period": 2.5}, {"first": 301}, {"first": 5, "last": 4},
                  {"first": math.nan}, {"times": []}, {"times": [2.0, 1.0]}, {"times": [-1e-9]},
                  {"times": [math.nan]}, {"times": ["a"]}],
)  # fmt: skip
def test_samples_refused(walking, arguments):
    with pytest.raises(mi.InvalidParameter):
        walking.samples(**arguments)


def test_statistics_only_keeps_no_tables():
    run = mi.simulate(ZHAO, DRIVE, 5, keep="statistics")
    assert len(run.trajectory.events) == 0
    for table in ("impacts", "events"):
        with pytest.raises(mi.InvalidParameter, match="keep='events'"):
            getattr(run, table)
    for table in (run.section, run.samples):
        with pytest.raises(mi.InvalidParameter, match="keep='events'"):
            table()


# Going on, and the engines.


def test_going_on_from_the_final_state():
    whole = mi.simulate(ZHAO, DRIVE, 20, initial=KICK)
    half = mi.simulate(ZHAO, DRIVE, 9.3, initial=KICK)
    assert half.final.time == pytest.approx(0.3 * DRIVE.period, rel=1e-12)
    rest = mi.simulate(ZHAO, DRIVE, 10.7, initial=half.final)
    assert rest.extent == pytest.approx((0.3, 11.0))
    assert rest.periods == pytest.approx(10.7)
    for name in ("x1", "v1", "x2", "v2"):
        assert getattr(rest.final, name) == pytest.approx(getattr(whole.final, name), abs=1e-7)
    first = rest.statistics["window first"]
    assert first == pytest.approx(0.3 + 5.35)


@pytest.mark.parametrize("omega", [0.37, 0.45, 0.501, 0.6543])
@pytest.mark.parametrize("periods", [3, 7, 19])
def test_whole_periods_end_at_the_start_of_one(omega, periods):
    run = mi.simulate(ZHAO, DRIVE.replace(omega=omega), periods)
    assert run.final.time == 0.0
    assert run.extent == (0.0, periods)


def test_engines_agree():
    slow, fast = (
        mi.simulate(ZHAO, DRIVE, 8, initial=KICK, options=mi.Options(engine=engine))
        for engine in ("interpreted", "compiled")
    )
    assert len(slow.impacts) == len(fast.impacts)
    for column in ("time", "v2 before", "x1"):
        np.testing.assert_allclose(slow.impacts[column], fast.impacts[column], atol=1e-7)
    assert slow.statistics["impacts"] == fast.statistics["impacts"]
    assert slow.final.x2 == pytest.approx(fast.final.x2, abs=1e-7)


# Initial states.


@pytest.mark.parametrize("name", ["x1", "v1", "x2", "v2", "time"])
@pytest.mark.parametrize("value", [math.nan, math.inf, "0", None, True])
def test_state_refuses(name, value):
    with pytest.raises(mi.InvalidParameter) as caught:
        mi.State(**{name: value})
    assert caught.value.field == name


def test_state_refuses_a_time_before_the_period():
    with pytest.raises(mi.InvalidParameter):
        mi.State(time=-0.1)


def test_beyond_a_stopper():
    error = refused(initial=mi.State(x2=-0.51))
    assert error.field == "x2"
    assert "-0.5 and 0.5" in str(error)


def test_beyond_the_period():
    assert refused(initial=mi.State(time=7.0)).field == "time"


@pytest.mark.parametrize("options", [mi.Options(), INTERPRETED])
@pytest.mark.parametrize("side", [1, -1])
def test_on_the_stopper_and_moving_into_it(options, side):
    initial = mi.State(x2=side * ZHAO.delta, v2=side * 0.3)
    run = mi.simulate(ZHAO, DRIVE, 1, initial=initial, options=options)
    hit = run.impacts.iloc[0]
    assert (hit["period"], hit["time"]) == (0, 0.0)
    assert hit["stopper"] == ("right" if side == 1 else "left")
    assert hit["v2 before"] == side * 0.3
    assert hit["v1 after"] == pytest.approx(1.8 * 0.3 * side / 6, rel=1e-14)


# Limits of the parameters.


# Arguments.


@pytest.mark.parametrize("periods", [0, -1, math.nan, math.inf, "10"])
def test_periods_refused(periods):
    assert refused(periods=periods).field == "periods"


@pytest.mark.parametrize(
    "window", [(1, 1), (1.5, 1), (-1, 2), (0, 3), (0, math.nan), (1,), "all", 5]
)
def test_window_refused(window):
    assert refused(window=window).field == "window"


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("actuator", "zhao2004"), ("actuator", None), ("drive", 0.24), ("drive", None),
        ("initial", (0, 1)), ("keep", "all"), ("duration", 3.0),
    ],
)  # fmt: skip
def test_arguments_refused(name, value):
    assert refused(**{name: value}).field == name


@pytest.mark.parametrize("duration", [0, -1, math.nan, "10"])
def test_duration_refused(duration):
    assert refused(periods=None, duration=duration).field == "duration"


def test_a_duration_is_so_many_periods():
    run = mi.simulate(ZHAO, DRIVE, duration=2.5 * DRIVE.period)
    assert run.extent == pytest.approx((0.0, 2.5), rel=1e-15)


def test_300_periods_where_nothing_is_said():
    assert mi.simulate(ZHAO, DRIVE).periods == 300


@pytest.mark.parametrize("name", ["x3", "v"])
def test_a_state_of_another_system_is_refused(name):
    error = refused(initial=mi.State(**{name: 0.0}))
    assert (error.field, error.value) == ("initial", name)
    assert "x1, v1, x2, v2" in str(error)


# What goes wrong on the way.


def test_run_error_holds_what_was_computed():
    options = mi.Options(max_events=3)
    slippery = ZHAO.replace(mu_s=0.01, mu_d=0.01)
    with pytest.raises(mi.RunError) as caught:
        mi.simulate(slippery, mi.Sine(amplitude=0.45, omega=0.1), 50, options=options)
    run = caught.value.partial
    assert isinstance(run, mi.Run)
    assert len(run.events) >= 3
    assert run.periods < 50
    assert math.isnan(run.statistics["impacts per period"])  # the window was never reached
    assert run.samples(10).notna().all(axis=None)


def test_run_error_within_the_window():
    options = mi.Options(max_events=3)
    slippery = ZHAO.replace(mu_s=0.01, mu_d=0.01)
    drive = mi.Sine(amplitude=0.45, omega=0.1)
    with pytest.raises(mi.RunError) as caught:
        mi.simulate(slippery, drive, 50, options=options, window=(0, 50), keep="statistics")
    run = caught.value.partial
    number = run.statistics
    assert number["window last"] == pytest.approx(run.extent[1])
    assert number["impacts"] >= 1
    assert 0 < number["share slipping"] < 1


def test_interruption_passes_through():
    def interrupt(_):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        mi.simulate(ZHAO, DRIVE, 5, progress=interrupt)


def test_progress():
    seen = []
    mi.simulate(ZHAO, DRIVE, 5, progress=seen.append)
    assert seen[-1] == pytest.approx(5)


def test_progress_without_a_terminal_is_lines(capsys, monkeypatch):
    monkeypatch.setattr(progress, "MIN_LINE_SECONDS", 0.0)
    mi.simulate(ZHAO, DRIVE, 5, progress=True)
    out, err = capsys.readouterr()
    assert out == ""
    assert err.splitlines()[-1].startswith("mems-impact: simulate: 5 of 5 periods (100%), ")


@pytest.mark.parametrize(("window", "impacts"), [((1.0, 3.0), 2), ((0.5, 1.0), 0), ((2.0, 5.5), 4)])
def test_an_impact_at_the_end_of_a_window_is_outside(window, impacts):
    wall = mi.Impact("wall", lambda mode, t, y, p: -y.x, lambda mode, t, y, p: (mode, (-1.0,)))
    system = mi.System(
        states=("x",), flow=lambda mode, t, y, p: (1.0,), period=1.0, guards=[wall],
        initial={"x": -1.0},
    )  # fmt: skip
    options = mi.Options(engine="interpreted", method="dop853")
    run = mi.simulate(system, periods=6, window=window, options=options)
    assert run.events["t"].tolist() == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    assert run.statistics["impacts"] == impacts
