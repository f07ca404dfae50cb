"""`mems-impact characteristic` and `mems-impact force-curve`."""

import json

import pandas as pd
import pytest

import mems_impact as mi

PAPER = mi.load_actuator("zhao2004")
BRIEF = ("--omega", "0.5", "--transient", "100", "--periods", "10")


@pytest.mark.slow
def test_working_points_on_the_screen_and_in_files(cli, tmp_path):
    done = cli("characteristic", "zhao2004", "amplitude=0.2:0.24:2", *BRIEF)
    assert done.status == 0
    assert {"amplitude", "blows", "displacement", "speed", "energy"} <= set(done.out.split())
    written = "written: out/characteristic-table.csv, out/characteristic-impacts.csv,"
    assert written in " ".join(done.out.split())
    table = pd.read_csv(tmp_path / "out" / "characteristic-table.csv")
    drive = mi.Sine(amplitude=0.2, omega=0.5)
    found = mi.characteristic(PAPER, drive, "amplitude", [0.2, 0.24], transient=100, periods=10)
    pd.testing.assert_frame_equal(table, found.table, rtol=1e-12, check_dtype=False)
    assert (tmp_path / "out" / "characteristic.png").read_bytes().startswith(b"\x89PNG")


def test_json_of_curves_over_the_frequency(cli, tmp_path):
    done = cli(
        "characteristic", "mita2003", "frequency=0.11 kHz:120 Hz:2", "--curves",
        "amplitude=20 V:24 V:2", "--direction", "down", "--transient", "20", "--periods", "5",
        "--json",
    )  # fmt: skip
    told = json.loads(done.out)
    rows = told["tables"]["table"]["rows"]
    assert [(row["amplitude"], row["frequency"]) for row in rows] == [
        (20, 120), (20, 110), (24, 120), (24, 110)]  # fmt: skip
    assert told["tables"]["table"]["units"]["energy in per blow"] == "J"
    assert list(tmp_path.iterdir()) == []


def test_a_load_curve(cli, tmp_path):
    done = cli("force-curve", "zhao2004", "--amplitude", "0.24", *BRIEF, "--loads", "0:10:3")
    assert "holding force  23.544" in done.out
    table = pd.read_csv(tmp_path / "out" / "force-curve-table.csv")
    assert table["load"].tolist() == [0.0, 5.0, 10.0]
    assert table["mean speed"].is_monotonic_decreasing
    assert (tmp_path / "out" / "force-curve.png").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("characteristic", "mita2003", "omga=1:2:3", "--amplitude", "30"), "omga"),
        (("characteristic", "mita2003", "amplitude=1 Hz:2 Hz:3"), "must be a number [V]"),
        (("characteristic", "mita2003", "amplitude=1:2"), "must be NAME=START:STOP:POINTS"),
        (("characteristic", "mita2003", "amplitude=20:30:2", "--wear", "1e-13"),
         "a life needs wear, area and depth"),
        (("characteristic", "mita2003", "amplitude=20:30:2", "--curves", "volts=1:2:2"), "volts"),
        (("force-curve", "mita2003", "--amplitude", "30", "--loads", "0 V:1 V:2"),
         "must be a number [N]"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line(cli, arguments, message):
    assert message in cli(*arguments, "--frequency", "110").complaint()
