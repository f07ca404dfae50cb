"""Every line that shows a number of a device in SI shows its unit."""

import json
import math

import pandas as pd

import mems_impact as mi
from mems_impact.cli.output import with_unit_column

VOLTAGE = ["--frequency", "200", "--no-figure"]  # below pull-in nothing strikes


def test_drive(cli):
    lines = cli("drive", "mita2003", "--amplitude", "20", *VOLTAGE).out.splitlines()
    headings = [line[2:28].strip() for line in lines if line]
    assert headings == [
        "drive",
        "forcing period [s]",
        "angular frequency [rad/s]",
        "switches [s]",
        "force at x2 = 0 [N]",
    ]


def test_orbit(cli):
    out = cli("orbit", "mita2003", "--amplitude", "20", *VOLTAGE).out
    for heading in ("forcing period [s]", "x2 [m]", "v2 [m/s]", "v1 [m/s]", "step [m]"):
        assert f"  {heading} " in out


def test_branch(cli):
    branch = cli("continue", "mita2003", "amplitude=20:19.9", *VOLTAGE).out
    assert ", amplitude 19.9 to 20 V, " in branch


def test_sweep(cli, monkeypatch):
    drive = mi.Sine(amplitude=20.0, omega=1000.0)
    sweep = mi.sweep(
        mi.load_actuator("mita2003"), drive, "amplitude", [20, 50], transient=1, periods=1
    )
    sweep.table.loc[sweep.table["amplitude"] == 50, "status"] = "it broke"
    monkeypatch.setattr(mi, "sweep", lambda *_, **__: sweep, raising=False)
    out = cli("sweep", "mita2003", "amplitude=20:50:2", *VOLTAGE).out
    assert "increasing amplitude: impacts at 1 of 2 values, 1 failed" in out
    assert "  failed at 50 V: it broke" in out


def test_a_dimensionless_device_has_none(cli):
    out = cli("orbit", "zhao2004", "--amplitude", "0.1", "--omega", "0.5", "--no-figure").out
    assert "  forcing period " in out
    assert "[" not in out


def test_resonance_in_hertz(cli):
    mita = mi.load_actuator("mita2003")
    hertz = math.sqrt(mita.k / mita.m2) / (2.0 * math.pi)
    assert f"  resonance frequency [Hz]  {hertz:.9g}\n" in cli("pull-in", "mita2003").out
    assert "Hz" not in cli("pull-in", "zhao2004").out


def test_what_tolerances_make(cli, tmp_path):
    brief = ["--samples", "2", "--transient", "1", "--periods", "1", "--exponents", "none"]
    over = ["--over", "e=norm:0.8:0.01", "--specification", "mean speed=-1:1"]
    told = cli(
        "tolerances",
        "mita2003",
        "--amplitude",
        "20",
        *VOLTAGE,
        *brief,
        *over,
        "--json",
        "--output",
        "out",
    )
    rows = json.loads(told.out)["tables"]["quantiles"]["rows"]
    assert {row["quantity"]: row["unit"] for row in rows}["mean speed"] == "m/s"
    yields = pd.read_csv(tmp_path / "out" / "tolerances-yields.csv").set_index("quantity")
    assert yields.loc["mean speed", "unit"] == "m/s"


def test_what_a_column_names():
    table = pd.DataFrame({"parameter": ["k", "e"], "value": [1.0, 0.8]})
    told = with_unit_column(table, "parameter", {"k": "N/m"})
    assert told["unit"].tolist() == ["N/m", ""]
    assert with_unit_column(table, "parameter", {}) is table


def test_two_runs_beside_each_other(cli, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    out = cli(
        "simulate", "mita2003", "--amplitude", "20", *VOLTAGE, "--periods", "1", "--verify"
    ).out
    assert "time apart [s]" in out
    assert "v2 apart [m/s]" in out


def test_voltages_with_units_at_the_ends_of_a_range(cli, tmp_path):
    vary = "amplitude=20V:0.03kV:2"
    quick = ["--transient", "1", "--no-figure"]
    cli("sweep", "mita2003", vary, "--frequency", "0.1kHz", "--periods", "1", *quick)
    table = pd.read_csv(tmp_path / "out" / "sweep-summary.csv")
    assert set(table["amplitude [V]"]) == {20.0, 30.0}
    axes = ["--x", vary, "--y", "frequency=0.1kHz:110Hz:2"]
    cli("map", "mita2003", *axes, "--longest", "1", *quick)
    table = pd.read_csv(tmp_path / "out" / "map-table.csv")
    assert set(table["amplitude [V]"]) == {20.0, 30.0}
    assert set(table["frequency [Hz]"]) == {100.0, 110.0}
    done = cli("sweep", "mita2003", "amplitude=20V:3um:2", "--frequency", "100")
    assert "values = '3um': must be a number [V]" in done.err
