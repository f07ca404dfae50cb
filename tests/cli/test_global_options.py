"""Options that every command has: one JSON document, silence, and no colours."""

import json
import math
import warnings
from pathlib import Path

import pandas as pd
import pytest

import mems_impact as mi
from mems_impact.cli.commands import COMMAND_NAMES
from mems_impact.errors import UnitsWarning

POINT = ["zhao2004", "--amplitude", "0.24", "--omega", "0.5"]
SIMULATE = ["simulate", *POINT, "--periods", "12", "--no-figure"]
SWEEP = ["sweep", "zhao2004", "amplitude=0.2:0.24:2", "--omega", "0.5", "--transient", "2"]
SWEEP += ["--periods", "2", "--no-figure"]
QUICK = [
    SIMULATE,
    SWEEP,
    ["devices"],
    ["terms"],
    ["pull-in", "mita2003"],
    ["drive", *POINT, "--no-figure"],
    ["orbit", *POINT, "--no-figure"],
    ["fit", "mita2003", "--target", "resonance=1500", "--free", "k"],
]
KEYS = ["command", "values", "units", "tables", "files"]
CLI = Path(mi.__file__).parent / "cli"


def document(done):
    def refuse(constant):
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(done.out, parse_constant=refuse)


@pytest.mark.parametrize("command", COMMAND_NAMES)
def test_every_command_has_both(cli, command):
    page = cli(command, "--help").out
    assert " --json " in page
    assert " --quiet " in page
    assert page.count(" --json ") == 1


def test_every_command_shows_through_one_place():
    # What is shown by other means would stand beside the document.
    shown = {path.name for path in CLI.glob("*.py") if "click.echo(" in path.read_text("utf-8")}
    assert shown == {"commands.py", "completion.py", "output.py", "runtime.py"}


@pytest.mark.parametrize("arguments", QUICK, ids=lambda each: each[0])
def test_json_is_one_document(cli, arguments):
    done = cli(*arguments, "--json")
    told = document(done)
    assert list(told) == KEYS
    assert told["command"] == arguments[0]
    assert told["values"] or told["tables"]


@pytest.mark.quick(2)
@pytest.mark.parametrize("place", [["--json"], ["--output", "-"], ["--output", "-", "--json"]])
def test_results_on_standard_output_only(cli, tmp_path, place):
    sweep = [word for word in SWEEP if word != "--no-figure"]
    assert cli(*sweep, *place).status == 0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_json_with_files_names_them(cli, tmp_path):
    told = document(cli(*SWEEP, "--json", "--output", "here"))
    assert told["files"] == ["here/sweep-table.csv", "here/sweep-summary.csv"]
    assert len(pd.read_csv(tmp_path / told["files"][0])) == len(told["tables"]["table"]["rows"])
    assert document(cli(*SWEEP[:-1], "--json", "--figure", "a.png"))["files"] == ["a.png"]


def test_keys_are_the_columns_of_tables_and_nan_is_null(cli):
    told = document(cli(*SIMULATE, "--json"))
    actuator, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5)
    run = mi.simulate(actuator, drive, 12)
    rows = told["tables"]["impacts"]["rows"]
    assert [list(row) for row in rows] == [list(run.impacts.columns)] * len(run.impacts)
    assert [row["x1"] for row in rows] == run.impacts["x1"].tolist()  # to the last bit
    for name, value in run.statistics.items():
        assert told["values"][name] == (None if math.isnan(value) else value)
    still = document(cli(*SIMULATE, "--amplitude", "0", "--json"))
    assert still["values"]["impact speed mean"] is None
    assert still["tables"]["impacts"]["rows"] == []


def test_units_are_reported(cli):
    told = document(cli("pull-in", "mita2003", "--json"))
    units = {"pull-in voltage": "V", "resting voltage": "V", "resonance": "rad/s"}
    assert told["units"] == {**units, "resonance frequency": "Hz"}
    assert document(cli("pull-in", "zhao2004", "--json"))["units"] == {}
    orbit = cli(
        "orbit", "mita2003", "--amplitude", "20", "--frequency", "200", "--no-figure", "--json"
    )
    assert document(orbit)["units"]["v2"] == "m/s"
    assert document(orbit)["tables"]["samples"]["units"]["x1"] == "m"


def test_an_error_leaves_standard_output_empty(cli):
    done = cli("simulate", "nothing", "--json")
    assert done.status == 2
    assert done.out == ""
    assert done.err.count("\n") == 1


def test_a_verdict_that_is_not_wanted_is_reported_too(cli):
    arguments = ["--target", "resonance=1500", "--target", "pull-in voltage=1", "--free", "k"]
    done = cli("fit", "mita2003", *arguments, "--json")
    assert done.status == 1
    assert document(done)["values"]["verdict"] == "misfit"


@pytest.mark.parametrize("arguments", QUICK, ids=lambda each: each[0])
def test_quiet_says_nothing(cli, arguments):
    done = cli(*arguments, "--quiet")
    assert done == (0, "", "")


def test_quiet_leaves_errors_and_the_document(cli):
    assert cli("simulate", "nothing", "--quiet").complaint()
    assert document(cli("pull-in", "mita2003", "--json", "--quiet"))["values"]


def test_quiet_leaves_out_warnings(cli, tmp_path, monkeypatch):
    def warned(*_arguments):
        warnings.warn("these look like kilograms", UnitsWarning, stacklevel=2)
        return mi.load_actuator("zhao2004")

    monkeypatch.setattr("mems_impact.cli.pull_in.actuator_from", warned)
    assert "look like kilograms" in cli("pull-in", "mine.toml").err
    assert cli("pull-in", "mine.toml", "--quiet").err == ""
