"""Bad input ends in one line that says what is wrong and how to mend it, and in status 2."""

import os
import subprocess
import sys

import pytest

SIMULATE = ["simulate", "zhao2004", "--amplitude", "0.24", "--omega", "0.5", "--periods", "3"]
SWEEP = ["sweep", "zhao2004", "--parameter", "amplitude", "--start", "0.2", "--stop", "0.24"]
SWEEP += ["--omega", "0.5", "--points", "2", "--transient", "1", "--periods", "1"]

# What is typed, and what the line must name: the culprit and the remedy.
WRONG = [
    ([], ["command", "--help"]),
    (["simluate"], ["simluate", "--help"]),
    (["simulate"], ["DEVICE", "--help"]),
    (["simulate", "zhao2004", "--omega", "0.5"], ["--amplitude"]),
    (["simulate", "nothing", *SIMULATE[2:]], ["nothing", "zhao2004", "TOML"]),
    (["simulate", "mine.py", *SIMULATE[2:]], ["name of a system in it", "mine.py:oscillator"]),
    (["orbit", "mine.py:mine", *SIMULATE[2:6]], ["mine.py:mine: a system", "device"]),
    (["continue", "mine.py:mine", *SWEEP[2:8]], ["mine.py:mine: a system", "device"]),
    (["simulate", "truncated.toml", *SIMULATE[2:]], ["truncated.toml", "not valid TOML"]),
    (["simulate", "directory", *SIMULATE[2:]], ["directory", "is a directory"]),
    (["simulate", "bad.toml", *SIMULATE[2:]], ["bad.toml", "m1"]),
    ([*SIMULATE, "--amplitude", "nan"], ["amplitude = nan", "finite"]),
    ([*SIMULATE, "--amplitude", "much"], ["--amplitude", "much"]),
    ([*SIMULATE, "--omega", "0"], ["omega = 0", "> 0"]),
    ([*SIMULATE, "--omega", "-1"], ["omega = -1", "> 0"]),
    ([*SIMULATE, "--bias", "inf"], ["bias = inf", "finite"]),
    ([*SIMULATE, "--periods", "0"], ["periods = 0", "> 0"]),
    ([*SIMULATE, "--set", "e=1.5"], ["e = 1.5", "<= 1"]),
    ([*SIMULATE, "--set", "delta=2"], ["delta = 2", "d = 1"]),
    ([*SIMULATE, "--set", "mu=1"], ["mu = 1", "mu_s"]),
    ([*SIMULATE, "--set", "e"], ["NAME=NUMBER"]),
    ([*SIMULATE, "--set", "e=x"], ["NAME=NUMBER"]),
    ([*SIMULATE, "--set", "=1"], ["NAME=NUMBER"]),
    ([*SIMULATE, "--initial", "x2=0.7"], ["x2 = 0.7", "0.5"]),
    ([*SIMULATE, "--initial", "v1=inf"], ["v1 = inf", "finite"]),
    ([*SIMULATE, "--initial", "x3=1"], ["--initial x3", "x1, v1, x2, v2, time"]),
    ([*SIMULATE, "--initial", "x2"], ["--initial", "'x2'", "NAME=NUMBER"]),
    ([*SIMULATE, "--rtol", "0"], ["rtol = 0", "between"]),
    ([*SIMULATE, "--atol", "-1"], ["atol = -1"]),
    ([*SIMULATE, "--method", "rk4"], ["rk4", "adams"]),
    ([*SIMULATE, "--engine", "steam"], ["steam", "compiled"]),
    ([*SIMULATE, "--window", "2", "1"], ["window", "first < last"]),
    ([*SIMULATE, "--window", "1"], ["--window"]),
    ([*SIMULATE, "--output", "file"], ["file", "not a directory", "--output"]),
    ([*SIMULATE, "--output", "file/below"], ["file/below", "--output"]),
    ([*SIMULATE, "--figure", "figure.gif"], ["figure.gif", ".png"]),
    ([*SIMULATE, "--figure", "directory"], ["--figure", "directory"]),
    ([*SIMULATE, "--figure", "f.png", "--no-figure"], ["--no-figure", "leave one out"]),
    ([*SIMULATE, "extra"], ["extra"]),
    ([*SIMULATE, "--frobnicate"], ["--frobnicate", "--help"]),
    ([*SWEEP, "--parameter", "amp", "--amplitude", "0.2"], ["amp", "amplitude, omega"]),
    ([*SWEEP, "--amplitude", "0.2"], ["--amplitude", "omit the option"]),
    ([*SWEEP, "--parameter", "omega", "--amplitude", "0.2"], ["--omega", "omit the option"]),
    (["sweep", "zhao2004", "--parameter", "omega", "--start", "0.4", "--stop", "0.5", "--amplitude",
      "0.2", "--frequency", "0.1"], ["--frequency", "omit the option"]),
    (["sweep", "mita2003", "--parameter", "frequency", "--start", "10 V", "--stop", "20",
      "--amplitude", "50"], ["'10 V' must be a number [Hz]"]),
    (["simulate", "zhao2004", "--amplitude", "240 mV", "--omega", "0.5"],
     ["'240 mV': zhao2004 is dimensionless"]),
    ([*SIMULATE, "--amplitude", "0.2 um"], ["'0.2 um' must be a number [V]"]),
    ([*SWEEP, "--parameter", "e"], ["--amplitude"]),
    ([*SWEEP, "--parameter", "e", "--amplitude", "0.2", "--stop", "2"], ["e = 2", "<= 1"]),
    ([*SWEEP, "--stop", "nan"], ["nan", "finite"]),
    ([*SWEEP, "--start", "-0.1"], ["amplitude = -0.1", ">= 0"]),
    ([*SWEEP, "--points", "1"], ["--points", "2"]),
    ([*SWEEP, "--transient", "-1"], ["transient = -1", ">= 0"]),
    ([*SWEEP, "--transient", "1.5"], ["--transient", "1.5"]),
    ([*SWEEP, "--periods", "0"], ["periods = 0", ">= 1"]),
    ([*SWEEP, "--workers", "0"], ["--workers", "1"]),
    ([*SWEEP, "--direction", "left"], ["left", "both"]),
]  # fmt: skip


@pytest.fixture
def files(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "directory").mkdir()
    (tmp_path / "truncated.toml").write_text("[parameters]\nm1 = ")
    (tmp_path / "bad.toml").write_text("[parameters]\nm1 = -5\n")


@pytest.mark.usefixtures("files")
@pytest.mark.parametrize(("arguments", "named"), WRONG, ids=lambda x: " ".join(map(str, x))[-60:])
def test_one_line_and_status_2(cli, arguments, named):
    said = cli(*arguments).complaint()
    for word in named:
        assert word in said


@pytest.mark.skipif(os.name == "nt", reason="directories are not write-protected by a mode there")
@pytest.mark.skipif(hasattr(os, "geteuid") and os.geteuid() == 0, reason="root may write anywhere")
def test_a_protected_directory(cli, tmp_path):
    (tmp_path / "protected").mkdir(mode=0o500)
    done = cli(*SIMULATE, "--output", "protected")
    assert done.status == 2
    assert "protected" in done.err


def test_a_table_that_cannot_be_written(cli, tmp_path):
    (tmp_path / "out" / "simulate-impacts.csv").mkdir(parents=True)
    done = cli(*SIMULATE, "--no-figure")
    assert done.status == 2
    # A progress bar may stand before it, if the loop had to be compiled.
    assert "simulate-impacts.csv: cannot be written" in done.err.splitlines()[-1]


def test_bad_input_leaves_nothing_behind(cli, tmp_path):
    cli(*SIMULATE, "--set", "e=2")
    assert list(tmp_path.iterdir()) == []


def test_a_reader_that_goes_away_is_no_failure_to_report():
    program = f"{sys.executable} -m mems_impact devices | true"
    done = subprocess.run(["sh", "-c", program], capture_output=True, text=True)
    assert "Traceback" not in done.stderr
