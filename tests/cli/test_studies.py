"""Commands basins and tolerances, and the energy of a map."""

import pandas as pd
import pytest

import mems_impact as mi

DRIVE = ["--amplitude", "0.2", "--omega", "0.5"]
BRIEF = ["--transient", "60", "--periods", "5"]


def test_basins_of_a_grid(cli, tmp_path):
    grid = ["--x", "x2=-0.2:0.3:3", "--y", "v2=0:0.6:2"]
    done = cli("basins", "zhao2004", *grid, *DRIVE, *BRIEF)
    assert done.status == 0
    table = pd.read_csv(tmp_path / "out" / "basins-table.csv")
    attractors = pd.read_csv(tmp_path / "out" / "basins-attractors.csv")
    assert len(table) == 6
    assert attractors["points"].sum() == 6
    found = mi.basins(
        mi.load_actuator("zhao2004"),
        mi.Sine(amplitude=0.2, omega=0.5),
        x=("x2", [-0.2, 0.05, 0.3]),
        y=("v2", [0.0, 0.6]),
        recurrence=mi.RecurrenceOptions(transient=60, periods=5),
    )
    assert attractors["share"].tolist() == found.attractors["share"].tolist()
    assert "written: out/basins-table.csv" in done.out


def test_basins_tell_of_initial_states_that_cannot_be(cli):
    grid = ["--x", "x2=-0.6:0.6:3"]  # the stoppers are at -0.5 and 0.5
    done = cli("basins", "zhao2004", *grid, *DRIVE, *BRIEF, "--no-figure")
    assert done.status == 0
    assert "warning: 2 of 3 points failed, the first one: x2 = -0.6: must be between" in done.err


def test_tolerances_with_a_specification(cli, tmp_path):
    over = ["--over", "e=norm:0.8:0.01", "--over", "gap=uniform:1%"]
    wish = ["--specification", "displacement per period=1e-4:"]
    drive = ["--amplitude", "0.24", "--omega", "0.5"]
    done = cli(
        "tolerances",
        "zhao2004",
        *over,
        *wish,
        *drive,
        *BRIEF,
        "--samples",
        "4",
        "--initial",
        "kicked",
    )
    assert done.status == 0
    yields = pd.read_csv(tmp_path / "out" / "tolerances-yields.csv")
    assert yields["points"].iloc[-1] == 4
    assert len(pd.read_csv(tmp_path / "out" / "tolerances-table.csv")) == 4


def test_tolerances_tell_of_devices_that_cannot_be(cli, tmp_path):
    over = ["--over", "e=uniform:0.8:0.4"]  # half of the restitutions lie above 1
    drive = ["--amplitude", "0.24", "--omega", "0.5"]
    done = cli("tolerances", "zhao2004", *over, *drive, *BRIEF, "--samples", "4", "--no-figure")
    assert "warning: 2 of 4 points failed, the first one: e = 1." in done.err
    assert "all" not in done.out.split()
    yields = pd.read_csv(tmp_path / "out" / "tolerances-yields.csv")
    assert yields["points"].tolist() == [2]


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["tolerances", "zhao2004", *DRIVE], "missing option '--over'"),
        (
            ["tolerances", "zhao2004", *DRIVE, "--over", "e=norm"],
            "must be NAME=DISTRIBUTION:NUMBERS",
        ),
        (
            ["tolerances", "zhao2004", *DRIVE, "--over", "e=nromal:1"],
            "a distribution of scipy.stats",
        ),
        (["tolerances", "zhao2004", *DRIVE, "--over", "f=norm:1:1"], "f"),
        (["basins", "zhao2004", *DRIVE], "x"),
        (["basins", "zhao2004", *DRIVE, "--x", "x9=0:1:2"], "x9"),
    ],
)
def test_bad_input_is_one_line(cli, arguments, complaint):
    assert complaint in cli(*arguments).complaint()
