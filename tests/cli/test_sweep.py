import pandas as pd
import pytest

import mems_impact as mi

BRIEF = ["--omega", "0.5", "--transient", "100", "--periods", "10"]
ARGUMENTS = ["sweep", "zhao2004", "amplitude=0.16:0.24:3", *BRIEF]


@pytest.mark.slow
def test_summary_table_and_figure(cli, tmp_path):
    done = cli(*ARGUMENTS)
    assert done.status == 0
    headline = "amplitude: on at 0.2 to 0.24 (increasing), off at 0.2 to 0.16 (decreasing)"
    assert done.out.splitlines()[0] == headline
    assert "increasing amplitude: impacts at 1 of 3 values" in done.out
    assert "decreasing amplitude: impacts at 2 of 3 values" in done.out
    written = "written: out/sweep-table.csv, out/sweep-summary.csv, out/sweep.png"
    assert done.out.splitlines()[-1] == written
    table = pd.read_csv(tmp_path / "out" / "sweep-table.csv")
    assert set(table["direction"]) == {"up", "down"}
    summary = pd.read_csv(tmp_path / "out" / "sweep-summary.csv")
    system = mi.load_actuator("zhao2004").under(mi.Sine(amplitude=0.2, omega=0.5))
    statistics = mi.Sweep(system=system, parameter="amplitude", table=table).statistics
    pd.testing.assert_frame_equal(summary, statistics, rtol=1e-15)
    assert (tmp_path / "out" / "sweep.png").read_bytes().startswith(b"\x89PNG")


def test_the_screen_shows_one_row_per_value(cli):
    lines = cli(*ARGUMENTS, "--no-figure").out.splitlines()
    assert lines[2].split()[:2] == ["amplitude", "direction"]
    rows = [tuple(line.split()[:2]) for line in lines[3:9]]
    assert rows == [
        *(("0.16", "up"), ("0.2", "up"), ("0.24", "up")),
        *(("0.24", "down"), ("0.2", "down"), ("0.16", "down")),
    ]
    assert lines[9] == ""


@pytest.mark.slow
@pytest.mark.parametrize("device", ["zhao2004", "mita2003"])
def test_ten_rows_with_ends_and_switches_fit_80_columns(cli, monkeypatch, device):
    monkeypatch.setenv("COLUMNS", "80")
    scale = mi.load_actuator(device).scales
    low, high = (f"{scale.out(f, 'V'):.6g}" for f in (0.16, 0.24))
    omega = f"{scale.out(0.5, 'rad/s'):.6g}"
    done = cli(
        "sweep", device, f"amplitude={low}:{high}:17", "--omega", omega,
        "--transient", "60", "--periods", "5", "--no-figure",
    )  # fmt: skip
    lines = done.out.splitlines()
    assert max(map(len, lines)) <= 80
    assert "10 of 34 rows; all rows and columns: out/sweep-summary.csv" in lines
    rows = [line.split() for line in lines if "up" in line.split() or "down" in line.split()]
    ups = [float(row[0]) for row in rows if row[1] == "up"]
    downs = [float(row[0]) for row in rows if row[1] == "down"]
    assert (len(ups), len(downs)) == (5, 5)
    assert ups == sorted(ups)
    assert downs == sorted(downs, reverse=True)
    for end in (low, high):
        assert float(end) in ups
        assert float(end) in downs
    for word, values in (("on", ups), ("off", downs)):
        if f"{word} at " in lines[0]:
            assert float(lines[0].split(f"{word} at ")[1].split()[0]) in values


def test_a_parameter_of_the_device(cli, tmp_path):
    done = cli(
        "sweep", "zhao2004", "restitution=0.7:0.8:3", *BRIEF, "--amplitude", "0.24",
        "--direction", "up", "--no-figure",
    )  # fmt: skip
    assert done.status == 0
    table = pd.read_csv(tmp_path / "out" / "sweep-table.csv")
    assert sorted(set(table["e"])) == [0.7, 0.75, 0.8]


@pytest.mark.slow
def test_failed_values_are_said(cli, monkeypatch):
    sweep = mi.sweep(
        mi.load_actuator("zhao2004"),
        mi.Sine(amplitude=0.2, omega=0.5),
        "amplitude",
        [0.2, 0.24],
        transient=1,
        periods=1,
    )
    sweep.table.loc[sweep.table["amplitude"] == 0.24, "status"] = "it broke"
    monkeypatch.setattr(mi, "sweep", lambda *_, **__: sweep, raising=False)
    done = cli(*ARGUMENTS)
    assert done.status == 0
    assert "1 failed" in done.out
    assert "failed at 0.24: it broke" in done.out
