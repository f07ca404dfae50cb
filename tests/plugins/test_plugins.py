"""What another package adds, as it is when pip has installed it."""

import json
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
QUICK = ["--engine", "interpreted", "--no-figure"]
DRIVE = """
[drive]
kind = "sawtooth"
amplitude = 0.3
period = 12.0
"""
DEVICE = """
[parameters]
m1 = 5.0
m2 = 1.0
k = 1.0
c = 0.04
d = 1.0
delta = 0.5
e = 0.8
mu_s = 0.4
mu_d = 0.27
alpha = 1.0
g = 9.81

[wind]
force = 30.0
"""
STUDY = """
system = "pendulum"
[study]
kind = "basins"
x = ["angle", [0.1]]
recurrence = {transient = 0, periods = 1}
"""

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Return the folder that pip has installed the toy to."""
    folder = tmp_path_factory.mktemp("site")
    install = ["pip", "install", "-q", "--no-deps", "--target", str(folder), str(HERE / "toy")]
    subprocess.run([sys.executable, "-m", *install], check=True)
    return folder


@pytest.fixture
def python(site, tmp_path):
    def run(*arguments):
        paths = {"PYTHONPATH": f"{ROOT}{os.pathsep}{site}"}
        return subprocess.run(
            [sys.executable, *arguments], cwd=tmp_path,
            env={**os.environ, **paths}, capture_output=True, text=True,
        )  # fmt: skip

    return run


@pytest.fixture
def cli(python):
    return partial(python, "-m", "mems_impact")


def test_commands(cli):
    shown = cli("--help")
    assert "greet " in shown.stdout
    assert shown.returncode == 0
    # The help page needs each command's own words, so that the broken one shows here.
    assert "broken " not in shown.stdout
    assert shown.stderr.count("\n") == 1
    assert json.loads(cli("greet", "--json").stdout)["values"] == {"greeting": "hello"}


def test_a_broken_command_is_one_line_and_the_others_continue(cli):
    done = cli("broken")
    assert done.returncode == 2
    first, second = done.stderr.splitlines()
    assert first == (
        "mems-impact: warning: broken ('toy_mems.broken:command') of the package toy-mems fails "
        "(RuntimeError: no licence for today); it is ignored: repair or remove the package"
    )
    assert "no such command 'broken'" in second
    assert cli("devices").stderr == ""


def test_drives(cli, tmp_path):
    point = ["simulate", "zhao2004", "--periods", "2", *QUICK]
    by_options = cli(*point, "--drive", "sawtooth", "--amplitude", "0.3", "--drive-period", "12")
    (tmp_path / "wave.toml").write_text(DRIVE)
    by_file = cli(*point, "--drive", "wave.toml")
    assert by_options.returncode == 0, by_options.stderr
    assert by_options.stdout == by_file.stdout
    # What comes with the package goes first.
    assert (
        cli("drive", *point[1:2], "--amplitude", "0.1", "--omega", "1").stdout.split()[1] == "Sine"
    )


def test_a_broken_drive(cli):
    done = cli("simulate", "zhao2004", "--drive", "broken-drive", "--amplitude", "0.3")
    first, second = done.stderr.splitlines()
    assert "is not a subclass of Drive; it is ignored" in first
    assert "kind = 'broken-drive': must be one of sine, " in second


def test_terms(cli, tmp_path):
    (tmp_path / "device.toml").write_text(DEVICE)
    drive = ["--amplitude", "0", "--omega", "1", "--periods", "2", *QUICK, "--json"]
    blown = cli("simulate", "device.toml", *drive)
    assert blown.returncode == 0, blown.stderr
    told = json.loads(blown.stdout)["values"]
    assert told["displacement per period"] > 1.0
    listed = cli("terms")
    assert "wind: A wind from the left" in listed.stdout
    assert "wind.force [N]" in listed.stdout
    assert "misnamed" not in listed.stdout
    assert "is not a subclass of Term in a file misnamed.py" in listed.stderr
    assert listed.stderr.count("\n") == 1


def test_systems(cli, python, tmp_path):
    run = cli("simulate", "pendulum", "--duration", "3", *QUICK)
    assert run.returncode == 0, run.stderr
    assert "Statistics over times 1.5 to 3" in run.stdout
    broken = cli("simulate", "missing")
    assert "missing ('toy_mems.nowhere:system') of the package toy-mems fails" in broken.stderr
    assert broken.returncode == 2
    (tmp_path / "study.toml").write_text(STUDY)
    script = "import mems_impact as mi; print(mi.load('study.toml').system.states)"
    assert python("-c", script).stdout == "('angle', 'w')\n"
