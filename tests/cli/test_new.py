"""Files to start from, and completion."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import mems_impact as mi
from mems_impact.cli.commands import main_group
from mems_impact.cli.new import TEMPLATES


def test_a_device_runs_as_it_is(cli, tmp_path):
    done = cli("new", "device", "mine.toml")
    assert done.out == "written: mine.toml; try it: mems-impact simulate mine.toml\n"
    first = done.out.partition("mems-impact ")[2].split()
    assert cli(*first, "--periods", "2", "--no-figure").status == 0
    assert mi.load_actuator("mine.toml").units == "SI"
    cli("new", "device", "comb 2 µm.toml")
    assert 'name = "comb 2 µm"' in (tmp_path / "comb 2 µm.toml").read_text("utf-8")
    assert mi.load_actuator("comb 2 µm.toml") == mi.load_actuator("mine.toml")
    text = (tmp_path / "mine.toml").read_text()
    assert "simulate mine.toml" in text


def test_a_drawing_is_a_device_under_a_voltage(cli):
    cli("new", "drawing", "mine.toml")
    system = mi.load("mine.toml")
    assert system.actuator.geometry is not None
    assert system.drive.amplitude == 50.0


def test_a_system_runs_as_it_is(cli):
    done = cli("new", "system", "mine.py")
    first = done.out.partition("mems-impact ")[2].split()
    assert first[1] == "mine.py:oscillator"
    walked = cli(*first, "--periods", "20", "--engine", "interpreted", "--no-figure")
    assert walked.status == 0
    assert "impacts per period" in walked.out


@pytest.mark.slow
def test_a_system_runs_as_a_script(cli, tmp_path):
    cli("new", "system")
    subprocess.run([sys.executable, "system.py"], cwd=tmp_path, check=True, capture_output=True)
    assert (tmp_path / "run.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize("kind", TEMPLATES)
def test_nothing_is_overwritten(cli, tmp_path, kind):
    name = TEMPLATES[kind][0]
    (tmp_path / name).write_text("my own")
    assert "already exists; choose another name" in cli("new", kind).complaint()
    assert (tmp_path / name).read_text() == "my own"
    assert "must end in" in cli("new", kind, "mine.txt").complaint()
    assert "cannot be written" in cli("new", kind, f"nowhere/{name}").complaint()


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion(cli, shell):
    script = cli("completion", shell).out
    assert "_MEMS_IMPACT_COMPLETE" in script
    assert "mems-impact" in script


def test_a_shell_completes_commands_options_and_devices():
    from click.shell_completion import BashComplete

    def offered(*before, begun):
        bash = BashComplete(main_group, {}, "mems-impact", "_MEMS_IMPACT_COMPLETE")
        found = bash.get_completions(list(before), begun)
        return [(each.type, each.value) for each in found]

    assert offered(begun="sim") == [("plain", "simulate")]
    assert offered("simulate", begun="zh") == [("plain", "zhao2004"), ("file", "zh")]
    assert ("plain", "--periods") in offered("simulate", begun="--per")


@pytest.mark.parametrize("option", ["--friction", "--pull-in"])
def test_quantities_are_those_of_a_device(cli, option):
    assert f"{option}: of a device only" in cli("new", "system", option, "1").complaint()


SHEET = [
    "--frequency", "1.2kHz", "--quality", "30", "--proof-mass", "0.2mg", "--frame-mass", "1mg",
    "--gap", "4um", "--travel", "2.5um", "--pull-in", "70V", "--restitution", "0.6",
]  # fmt: skip


@pytest.mark.parametrize("given", [("0.4", "0.3"), ("0.4, 0.3",)])
def test_friction_is_one_coefficient_or_two(cli, tmp_path, given):
    path = tmp_path / "two.toml"
    cli("new", "device", str(path), *SHEET, "--friction", *given)
    device = mi.load_actuator(path)
    assert (device.mu_s, device.mu_d) == (0.4, 0.3)
    again = (str(tmp_path / "none.toml"), *SHEET, "--friction", "0.4 0.3 0.2")
    assert "friction" in cli("new", "device", *again).complaint()


def test_the_first_run_of_a_device_walks(cli, tmp_path):
    made = cli("new", "device", "mine.toml", *SHEET, "--friction", "0.3")
    assert made.err == ""
    statistics = mi.simulate(mi.load("mine.toml")).statistics
    assert statistics["blows per period"] == 1.0
    told = re.search(
        r"one blow in a forcing period, (\S+) nm forward", Path("mine.toml").read_text()
    )
    assert 1e9 * statistics["displacement per period"] == pytest.approx(float(told[1]), rel=1e-3)


def test_a_device_that_cannot_walk_is_written_with_the_reason(cli):
    wide = ["--gap", "1um", "--travel", "0.6um", "--pull-in", "450V", "--friction", "0.3"]
    made = cli("new", "device", "mine.toml", *SHEET, *wide)
    assert "33 V, the breakdown of the narrowest gap" in made.err
    assert "it walks with stiffness k = " in made.err
    assert made.err.count("\n") == 2  # and that pull-in is above the breakdown
    assert mi.load("mine.toml").drive.amplitude == 450.0
