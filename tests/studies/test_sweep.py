"""Sweeps: chains of runs, what fails in them and what interrupts them."""

import math
import threading

import numpy as np
import pandas as pd
import pytest

import mems_impact as mi
from mems_impact.studies import sweep
from mems_impact.systems.state import at_same_phase

ZHAO = mi.load_actuator("zhao2004")
DRIVE = mi.Sine(amplitude=0.24, omega=0.5)
SHORT = {"transient": 10, "periods": 4}
AUTO = mi.Options(method="auto")


def swept(values=(0.2, 0.22, 0.24), parameter="amplitude", **arguments):
    return sweep_over(values, parameter, **arguments).table


def sweep_over(values=(0.2, 0.22, 0.24), parameter="amplitude", **arguments):
    return mi.sweep(ZHAO, DRIVE, parameter, values, **(SHORT | arguments))


@pytest.fixture(scope="module")
def hysteresis():
    values = np.linspace(0.16, 0.24, 17)
    return mi.sweep(ZHAO, DRIVE, "amplitude", values, direction="both", transient=200, periods=20)


@pytest.mark.slow
def test_hysteresis_of_the_paper(hysteresis):
    summary = hysteresis.statistics
    up, down = (summary[summary["direction"] == name] for name in ("up", "down"))
    on = up.loc[up["impacting"], "amplitude"].min()
    off = down.loc[~down["impacting"], "amplitude"].max()
    # Between a cyclic fold near 0.18 and a graze near 0.23, both are stable.
    assert 0.22 < on <= 0.23
    assert 0.17 < off < 0.18
    assert not up["impacting"].iloc[0]
    assert up["impacting"].iloc[-1]
    assert (summary.loc[summary["impacting"], "impacts per period"] == 1.0).all()
    # Where one attractor is left, the chains agree.
    same = up.merge(down, on="amplitude")
    alone = same[(same["amplitude"] < 0.17) | (same["amplitude"] > 0.231)]
    np.testing.assert_allclose(alone["v2 max_x"], alone["v2 max_y"], atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize(("amplitude", "omega"), [(0.6, 0.4), (0.4, 0.3)])
def test_chaotic_values_have_errors_that_long_runs_confirm(amplitude, omega):
    drive, start = mi.Sine(amplitude=amplitude, omega=omega), mi.kicked_state(ZHAO)
    values = [amplitude]
    sweep = mi.sweep(ZHAO, drive, "amplitude", values, transient=50, periods=300, initial=start)
    row = sweep.statistics.iloc[0]
    long = mi.simulate(ZHAO, drive, 6_000, initial=start, keep="statistics").statistics
    for name in ("displacement per period", "impacts per period", "mean speed"):
        error = row[f"{name} error"]
        assert 1e-3 * abs(row[name]) < error < 0.5 * abs(row[name])
        assert abs(row[name] - long[name]) <= 1.5 * error
    assert sweep.table.attrs["units"] == {}


def test_table(hysteresis):
    table = hysteresis.table
    statistics = [
        "impacts per period", "blows per period", "displacement per period",
        "displacement per impact", "mean speed", "closest approach",
    ]  # fmt: skip
    pairs = [name for each in statistics for name in (each, f"{each} error")]
    first = ["amplitude", "direction", "period", "v2", "v1"]
    assert list(table.columns) == [*first, *pairs, "status"]
    assert len(table) == 2 * 17 * 20
    assert (table["status"] == "ok").all()
    assert (table["v2"] > 0).all()
    assert sorted(set(table["period"])) == list(range(20))
    down = table[table["direction"] == "down"]
    assert down["amplitude"].is_monotonic_decreasing


def test_step_and_speed_are_those_of_the_runs():
    table = swept((0.24,), initial=mi.State(v2=1.0))
    run = mi.simulate(ZHAO, DRIVE, 14, initial=mi.State(v2=1.0), window=(10, 14), options=AUTO)
    for name in ("displacement per period", "displacement per impact", "mean speed"):
        assert set(table[name]) == {run.statistics[name]}
    assert run.statistics["displacement per impact"] > 0.0


def test_both_is_up_and_down():
    both = swept(direction="both")
    apart = pd.concat([swept(direction="up"), swept(direction="down")], ignore_index=True)
    pd.testing.assert_frame_equal(both, apart, check_exact=True)


@pytest.mark.slow
def test_workers_do_not_matter():
    serial, threads = (swept(direction="both", workers=n) for n in (1, 2))
    pd.testing.assert_frame_equal(serial, threads, check_exact=True)


def test_interpreted():
    options = {"transient": 1, "periods": 2, "direction": "both"}
    tables = [
        swept((0.2, 0.24), options=mi.Options(engine=engine), **options)
        for engine in ("interpreted", "compiled")
    ]
    pd.testing.assert_frame_equal(*tables, check_exact=False, rtol=1e-6)


def test_every_value_starts_from_the_last_state():
    table = swept((0.22, 0.24), initial=mi.State(v2=1.0), section=0)
    start = mi.State(v2=1.0)
    first = mi.simulate(ZHAO, DRIVE.replace(amplitude=0.22), 14, initial=start, options=AUTO)
    second = mi.simulate(ZHAO, DRIVE, 14, initial=first.final, options=AUTO)
    expected = second.section()
    expected = expected[expected["period"] >= 10]
    rows = table[table["amplitude"] == 0.24]
    assert rows["v2"].tolist() == expected["v2"].tolist()
    assert (rows["period"] + 10).tolist() == expected["period"].tolist()


def test_values_in_any_order():
    pd.testing.assert_frame_equal(swept((0.24, 0.2, 0.22)), swept((0.2, 0.22, 0.24)))


@pytest.mark.parametrize(("section", "signs"), [(1, {1}), (-1, {-1}), (0, {1, -1})])
def test_section(section, signs):
    assert set(np.sign(swept(section=section)["v2"])) == signs


def test_frequency_keeps_the_phase():
    # A whole number of periods ends at phase 0 whatever the period, and so goes on from there.
    table = swept((0.48, 0.5, 0.52), "omega", initial=mi.State(time=1.0, v2=1.0))
    assert (table["status"] == "ok").all()
    assert table.groupby("omega").size().tolist() == [4, 4, 4]
    state = at_same_phase(mi.State(time=1.5, x2=0.1), 6.0, 4.0)
    assert state == mi.State(time=1.0, x2=0.1)


def test_bias_from_zero():
    # The forcing period doubles where the bias sets in; the phase is carried over.
    table = swept((0.0, 0.1), "bias", initial=mi.State(v2=1.0))
    assert (table["status"] == "ok").all()
    run = mi.simulate(ZHAO, DRIVE, 14, initial=mi.State(v2=1.0), options=AUTO)
    more = mi.simulate(ZHAO, DRIVE.replace(bias=0.1), 14, initial=run.final, options=AUTO)
    expected = more.section(1).query("period >= 10")["v2"]
    assert table.loc[table["bias"] == 0.1, "v2"].tolist() == expected.tolist()


@pytest.mark.slow
def test_initial():
    states = {"up": mi.State(v2=0.5), "down": mi.State(v2=0.9)}
    both = swept(direction="both", initial=states)
    up = swept(direction="up", initial=states["up"])
    down = swept(direction="down", initial=states["down"])
    pd.testing.assert_frame_equal(both, pd.concat([up, down], ignore_index=True))
    kicked = swept(direction="down", initial=mi.kicked_state(ZHAO))
    pd.testing.assert_frame_equal(swept(direction="down"), kicked)


def test_failed_values_are_rows(monkeypatch):
    simulate, starts = sweep.simulate, []

    def failing(system, *rest, **more):
        starts.append(more["initial"])
        if system.parameters["amplitude"] == 0.22:
            return simulate(system, *rest, **more | {"options": mi.Options(max_events=1)})
        return simulate(system, *rest, **more)

    monkeypatch.setattr(sweep, "simulate", failing)
    result = sweep_over(initial=mi.State(v2=1.0), workers=1)
    table = result.table
    failed = table[table["amplitude"] == 0.22]
    assert len(failed) == 1
    assert failed[["period", "v2", "v1", "impacts per period"]].isna().all(axis=None)
    assert "max_events = 1" in failed["status"].iloc[0]
    # The next value starts where the failed one did.
    assert starts[3] == starts[2] != starts[1]  # after one to compile
    assert (table.loc[table["amplitude"] != 0.22, "status"] == "ok").all()
    assert repr(result) == "Sweep(amplitude = 0.2 to 0.24, 3 values; direction up; failed 1)"
    summary = result.statistics
    assert summary["impacting"].tolist()[1] is False
    assert summary["crossings"].tolist() == [4, 0, 4]


def test_stopper_that_closes_in_on_the_block():
    # The state carried over may lie beyond a stopper that is nearer: such values fail, one by one.
    table = swept((0.3, 0.45, 0.5), "delta", direction="down", initial=mi.State(x2=0.4))
    assert table["status"].iloc[0] == "ok"
    assert len(table) >= 3


def test_value_without_crossing_is_a_row():
    held = mi.Sine(amplitude=0.1, omega=0.5, bias=2.0)
    table = mi.sweep(ZHAO, held, "amplitude", [0.1, 0.2], **SHORT).table
    assert len(table) == 2
    assert table["v2"].isna().all()
    assert (table["status"] == "ok").all()
    assert (table["impacts per period"] == 0).all()


def interrupting(monkeypatch, at):
    simulate, calls, lock = sweep.simulate, [], threading.Lock()

    def interrupted(*arguments, **more):
        with lock:
            calls.append(arguments)
            if len(calls) == at:
                raise KeyboardInterrupt
        return simulate(*arguments, **more)

    monkeypatch.setattr(sweep, "simulate", interrupted)


def test_interruption(monkeypatch):
    whole = swept()
    interrupting(monkeypatch, at=4)  # the third value, after one to compile
    with pytest.raises(mi.Interrupted) as caught:
        swept(workers=1)
    stop = caught.value
    assert isinstance(stop, KeyboardInterrupt)
    assert (stop.work, stop.after) == ("sweep", "2 of 3 points")
    pd.testing.assert_frame_equal(stop.partial, whole[whole["amplitude"] < 0.24])


@pytest.mark.parametrize(
    ("arguments", "field"),
    [
        ({"parameter": "voltage"}, "parameter"),
        ({"direction": "sideways"}, "direction"),
        ({"values": []}, "values"),
        ({"values": [0.1, math.nan]}, "values"),
        ({"values": "many"}, "values"),
        ({"values": [[0.1], [0.2]]}, "values"),
        ({"values": [-0.1, 0.1]}, "amplitude"),
        ({"values": [0.4, 1.0], "parameter": "delta"}, "delta"),
        ({"transient": -1}, "transient"),
        ({"transient": 1.5}, "transient"),
        ({"periods": 0}, "periods"),
        ({"section": 2}, "section"),
        ({"workers": 0}, "workers"),
        ({"initial": {"sideways": mi.State()}}, "initial"),
        ({"initial": 1.0}, "initial"),
    ],
)
def test_refused(arguments, field):
    with pytest.raises(mi.InvalidParameter) as caught:
        swept(**arguments)
    assert caught.value.field == field


def test_a_quantity_of_a_data_sheet_is_reported_with_its_symbol():
    system = mi.load_actuator("zhao2004").under(mi.Sine(amplitude=0.2, omega=0.5))
    with pytest.raises(mi.InvalidParameter, match=r"parameter = 'gap': must be d, the symbol"):
        mi.sweep(system, "gap", [0.9, 1.1])
