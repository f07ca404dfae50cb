"""Tables of any system, from columns of numbers."""

import numpy as np
import pandas as pd
import pytest

import mems_impact as mi
from mems_impact import tables
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.simulation import Events, Samples
from mems_impact.tables import event_names, sweep, unit_of, with_units, without_units

FREE, HELD = mi.modes("free", "held")
PERIOD = 2.0


def flow(mode, t, y, p):
    return y.v, -y.x


def margin(mode, t, y, p):
    return 1.0 - y.x


def system(**more):
    guards = [
        mi.Impact("wall", margin, margin, modes=(FREE,)),
        mi.Guard("release", margin, modes=(HELD,)),
    ]
    return mi.System(states=("x", "v"), flow=flow, guards=guards, **more)


FORCED = system(period=PERIOD)
UNITS = {"x": "m", "v": "m/s", "time": "s"}


def log(kind, guard):
    n = len(kind)
    zero = np.zeros(n, dtype=int)
    states = np.arange(2 * n, dtype=float).reshape(n, 2)
    return Events(
        np.arange(n), np.full(n, 0.5), np.array(kind), np.array(guard), zero, zero + 1,
        states, states + 0.25,
    )  # fmt: skip


def test_impacts():
    hits = log([workspace.TRANSITION] * 2, [0, 0])
    table = tables.impacts(hits, PERIOD, FORCED, {"lost": np.array([2.0, 3.0])})
    assert table["event"].tolist() == ["wall", "wall"]
    assert table["period"].tolist() == [0, 1]
    assert table["time"].tolist() == [0.5, 0.5]
    assert table["t"].tolist() == [0.5, 2.5]
    assert table["phase"].tolist() == [0.25, 0.25]
    assert table["x before"].tolist() == [0.0, 2.0]
    assert table["v after"].tolist() == [1.25, 3.25]
    assert table["lost"].tolist() == [2.0, 3.0]


def test_events_are_named():
    kinds = [workspace.TRANSITION, workspace.ACCUMULATION, workspace.APPROACH,
    workspace.SECTION_CROSSING, workspace.REBASE,
             workspace.SWITCH, workspace.TRANSITION]  # fmt: skip
    observed = {"told": np.arange(7.0)}
    table = tables.events(log(kinds, [0, 0, 0, 1, 0, 4, 1]), PERIOD, FORCED, observed)
    assert table["event"].tolist() == ["wall", "chatter ends", "drive switches", "release"]
    assert table["period"].tolist() == [0, 1, 5, 6]
    assert table["t"].tolist() == [0.5, 2.5, 10.5, 12.5]
    assert table["mode before"].tolist() == ["free"] * 4
    assert table["mode after"].tolist() == ["held"] * 4
    assert table["x"].tolist() == [0.25, 2.25, 10.25, 12.25]
    assert table["told"].tolist() == [0.0, 1.0, 5.0, 6.0]


def test_without_forcing_there_is_a_running_time_alone():
    table = tables.impacts(log([workspace.TRANSITION], [0]), PERIOD, system(), {})
    assert list(table.columns)[:2] == ["t", "event"]
    assert not {"period", "time", "phase"} & set(table)


def test_section():
    crossings = log([workspace.SECTION_CROSSING] * 3, [1, -1, 1])
    table = tables.section(crossings, PERIOD, FORCED)
    assert table["direction"].tolist() == [1, -1, 1]
    assert table["v"].tolist() == [1.25, 3.25, 5.25]


def test_samples():
    grid = Samples(np.array([0, 3]), np.array([0.5, 0.25]), np.array([0, 1]), np.zeros((2, 2)))
    table = tables.samples(grid, PERIOD, FORCED)
    assert table["t"].tolist() == [0.5, 6.25]
    assert table["mode"].tolist() == ["free", "held"]


def test_statistics():
    series = tables.statistics({"impacts per period": 1, "share held": 0.5}, FORCED)
    assert series.to_dict() == {"impacts per period": 1.0, "share held": 0.5}


def test_units_stand_beside_the_headings():
    table = tables.impacts(log([workspace.TRANSITION], [0]), PERIOD, system(units=UNITS), {})
    assert list(table.columns) == ["t", "event", "x before", "x after", "v before", "v after"]
    units = {"t": "s", "x before": "m", "x after": "m", "v before": "m/s", "v after": "m/s"}
    assert table.attrs["units"] == units
    shown = with_units(table)
    assert dict(zip(table, shown, strict=True))["v after"] == "v after [m/s]"
    assert dict(zip(table, shown, strict=True))["event"] == "event"
    pd.testing.assert_frame_equal(without_units(shown), table)
    assert without_units(shown).attrs["units"] == units
    assert without_units(table) is table


def test_where_a_table_comes_from():
    table = tables.impacts(log([workspace.TRANSITION], [0]), PERIOD, FORCED, {})
    assert table.attrs["units"] == {}
    assert table.attrs["system"] == repr(FORCED)
    assert "mems_impact" in table.attrs


@pytest.mark.parametrize(
    ("name", "unit"),
    [("x", "m"), ("x 3", "m"), ("v before", "m/s"), ("v max", "m/s"), ("start", "s"), ("t", "s"),
     ("x of it", ""), ("period", "")],
)  # fmt: skip
def test_unit_of(name, unit):
    assert unit_of(name, UNITS) == unit


STATISTICS = ("impacts per period", "speed")


def point(value, direction="up", crossings=2, status="ok"):
    speeds = 3.25 + 4.0 * np.arange(crossings)
    section = {"period": np.arange(float(crossings)), "v": speeds, "x": 0.0 * speeds}
    return {
        "value": value,
        "direction": direction,
        "section": section if crossings else {},
        "statistics": {"impacts per period": 1.0, "speed": 0.5} if status == "ok" else {},
        "status": status,
    }


def swept(points):
    return sweep("omega", points, ("v", "x"), STATISTICS, FORCED)


def statistics_of(table):
    return mi.Sweep(system=FORCED, parameter="omega", table=table).statistics


def test_sweep():
    table = swept([point(0.1), point(0.2, crossings=0, status="lost"), point(0.3)])
    assert table["omega"].tolist() == [0.1, 0.1, 0.2, 0.3, 0.3]
    assert table["period"].tolist()[:2] == [0.0, 1.0]
    assert table["v"].isna().tolist() == [False, False, True, False, False]
    assert table["status"].tolist() == ["ok", "ok", "lost", "ok", "ok"]
    assert table["speed"].isna().tolist() == [False, False, True, False, False]


def test_sweep_of_nothing():
    table = swept([])
    assert len(table) == 0
    assert len(statistics_of(table)) == 0


def test_statistics_of_a_sweep(tmp_path):
    points = [point(0.1), point(0.1), point(0.2, crossings=0, status="lost"), point(0.2, "down")]
    table = swept(points)
    summary = statistics_of(table)
    assert summary["omega"].tolist() == [0.1, 0.1, 0.2, 0.2]
    assert summary["direction"].tolist() == ["up", "up", "up", "down"]
    assert summary["crossings"].tolist() == [2, 2, 0, 2]
    assert summary["impacting"].tolist() == [True, True, False, True]
    assert summary["v min"].tolist()[0] == 3.25
    assert summary["v max"].tolist()[0] == 7.25
    assert summary["speed"].isna().tolist() == [False, False, True, False]
    table.to_csv(tmp_path / "sweep.csv", index=False)
    again = statistics_of(pd.read_csv(tmp_path / "sweep.csv"))
    pd.testing.assert_frame_equal(again, summary, check_dtype=False)
    # Another system may have fewer statistics.
    fewer = statistics_of(table.drop(columns="speed"))
    assert list(fewer.columns) == [name for name in summary.columns if name != "speed"]


def test_verification_counts_and_takes_the_largest():
    words = event_names(FORCED.automaton)
    wall, release, chatter = (words.index(name) for name in ("wall", "release", "chatter ends"))
    headings = ["time apart", "impact speed apart", "x apart", "v apart"]
    matched = [
        (wall, np.array([1e-8, 3e-8, 0.0, 1e-9])),
        (release, np.array([2e-8, np.nan, 4e-9, 0.0])),
        (wall, np.array([5e-9, 4e-8, 1e-9, 0.0])),
    ]
    table = tables.verification(matched, [release, chatter], headings, FORCED).set_index("event")
    assert list(table.index) == ["wall", "release", "chatter ends"]
    assert table["matched"].tolist() == [2, 1, 0]
    assert table["in one run only"].tolist() == [0, 1, 1]
    assert table.loc["wall"].tolist() == [2, 0, 1e-8, 4e-8, 1e-9, 1e-9]
    assert np.isnan(table.loc["release", "impact speed apart"])
    assert table.loc["chatter ends"].isna().sum() == 4
    assert tables.verification([], [], headings, FORCED).empty
