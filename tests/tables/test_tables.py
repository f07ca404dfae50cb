"""Tables from columns of numbers."""

import numpy as np
import pandas as pd

import mems_impact as mi
from mems_impact import tables
from mems_impact.hybrid import loop
from mems_impact.hybrid.trajectory import Events, Samples


def log(kind, guard):
    n = len(kind)
    zero = np.zeros(n, dtype=int)
    states = np.arange(4 * n, dtype=float).reshape(n, 4)
    return Events(
        np.arange(n), np.full(n, 0.5), np.array(kind), np.array(guard), zero, zero + 1,
        states, states + 0.25,
    )  # fmt: skip


def test_impacts():
    table = tables.impacts(log([0, 0], [0, 1]), np.array([0.1, np.nan]), np.array([2.0, 3.0]), 2.0)
    assert table["stopper"].tolist() == ["right", "left"]
    assert table["phase"].tolist() == [0.25, 0.25]
    assert table["v1 before"].tolist() == [1.0, 5.0]
    assert table["v2 after"].tolist() == [3.25, 7.25]
    assert table["energy lost"].tolist() == [2.0, 3.0]


def test_events_are_named():
    kinds = [loop.TRANSITION, loop.ACCUMULATION, loop.APPROACH, loop.SECTION_CROSSING, loop.REBASE,
             loop.SWITCH, loop.TRANSITION]  # fmt: skip
    table = tables.events(log(kinds, [0, 1, 0, 1, 0, 10, 4]))
    names = ["right impact", "chatter ends", "drive switches", "break-away"]
    assert table["event"].tolist() == names
    assert table["period"].tolist() == [0, 1, 5, 6]
    assert table["mode before"].tolist() == ["stuck-free"] * 4
    assert table["mode after"].tolist() == ["forward-free"] * 4
    assert table["x2"].tolist() == [2.25, 6.25, 22.25, 26.25]


def test_section_by_direction():
    events = log([loop.SECTION_CROSSING] * 3 + [loop.TRANSITION], [1, -1, 1, 1])
    assert tables.section(events, 0)["direction"].tolist() == [1, -1, 1]
    assert tables.section(events, 1)["period"].tolist() == [0, 2]
    assert tables.section(events, -1)["period"].tolist() == [1]


def test_samples():
    grid = Samples(np.array([0, 3]), np.array([0.5, 0.25]), np.array([0, 3]), np.zeros((2, 4)))
    table = tables.samples(grid, 2.0)
    assert table["t"].tolist() == [0.5, 6.25]
    assert table["mode"].tolist() == ["stuck-free", "stuck-right"]


def test_statistics():
    series = tables.statistics({"impacts_per_period": 1, "periods": 2.0})
    assert series.to_dict() == {"impacts per period": 1.0, "periods": 2.0}


def point(value, direction="up", crossings=2, status="ok"):
    speeds = 3.25 + 4.0 * np.arange(crossings)
    section = {"period": np.arange(float(crossings)), "v2": speeds, "v1": 0.0 * speeds}
    return {
        "value": value,
        "direction": direction,
        "section": section if crossings else {},
        **dict.fromkeys(tables.SWEEP_COLUMNS, 0.5),
        "impacts per period": 1.0 if status == "ok" else np.nan,
        "blows per period": 0.5 if status == "ok" else np.nan,
        "status": status,
    }


def test_sweep():
    table = tables.sweep("omega", [point(0.1), point(0.2, crossings=0, status="lost"), point(0.3)])
    assert table["omega"].tolist() == [0.1, 0.1, 0.2, 0.3, 0.3]
    assert table["period"].tolist()[:2] == [0.0, 1.0]
    assert table["v2"].isna().tolist() == [False, False, True, False, False]
    assert table["status"].tolist() == ["ok", "ok", "lost", "ok", "ok"]
    assert table["blows per period"].isna().tolist() == [False, False, True, False, False]


def test_sweep_of_nothing():
    table = tables.sweep("omega", [])
    assert len(table) == 0
    assert len(tables.sweep_summary(table)) == 0


def test_sweep_summary(tmp_path):
    points = [point(0.1), point(0.1), point(0.2, crossings=0, status="lost"), point(0.2, "down")]
    table = tables.sweep("omega", points)
    summary = mi.sweep_summary(table)
    assert summary["omega"].tolist() == [0.1, 0.1, 0.2, 0.2]
    assert summary["direction"].tolist() == ["up", "up", "up", "down"]
    assert summary["crossings"].tolist() == [2, 2, 0, 2]
    assert summary["impacting"].tolist() == [True, True, False, True]
    assert summary["v2 min"].tolist()[0] == 3.25
    assert summary["blows per period"].tolist()[0] == 0.5
    table.to_csv(tmp_path / "sweep.csv", index=False)
    again = mi.sweep_summary(pd.read_csv(tmp_path / "sweep.csv"))
    pd.testing.assert_frame_equal(again, summary, check_dtype=False)
    assert (
        summary["mean speed"].tolist() == summary["displacement per impact"].tolist() == 4 * [0.5]
    )
    # A file of an earlier version has neither.
    older = mi.sweep_summary(table.drop(columns=["mean speed", "displacement per impact"]))
    assert list(older.columns) == [
        name for name in summary.columns if name not in ("mean speed", "displacement per impact")
    ]


def test_verification_counts_and_takes_the_largest():
    impact, slip_end = tables.EVENTS.index("right impact"), tables.EVENTS.index("slip end")
    matched = [
        (impact, np.array([1e-8, 3e-8, 0.0, 1e-9])),
        (slip_end, np.array([2e-8, np.nan, 4e-9, 0.0])),
        (impact, np.array([5e-9, 4e-8, 1e-9, 0.0])),
    ]
    chatter = tables.EVENTS.index("chatter ends")
    table = tables.verification(matched, [slip_end, chatter]).set_index("event")
    assert list(table.index) == ["right impact", "slip end", "chatter ends"]
    assert table["matched"].tolist() == [2, 1, 0]
    assert table["in one run only"].tolist() == [0, 1, 1]
    assert table.loc["right impact"].tolist() == [2, 0, 1e-8, 4e-8, 1e-9, 1e-9]
    assert np.isnan(table.loc["slip end", "impact speed apart"])
    assert table.loc["chatter ends"].isna().sum() == 4
    assert tables.verification([], []).empty
