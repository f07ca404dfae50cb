"""Drives from the command line."""

import click
import pytest

import mems_impact as mi
from mems_impact.actuator import drives
from mems_impact.actuator.drives import WAVEFORMS
from mems_impact.cli.commands import COMMAND_NAMES, main_group
from mems_impact.cli.options import NUMBERS, described_by_options, drive_from

SQUARE = ["--drive", "square", "--amplitude", "0.3", "--omega", "0.5", "--duty", "0.3"]
BURST = '[drive]\nkind = "burst"\non = 3\noff = 2\n[drive.wave]\nkind = "sine"\n'
BURST += "amplitude = 0.2\nomega = 1\n"


def test_the_options_are_the_fields():
    described = {kind: described_by_options(kind) for kind in WAVEFORMS}
    nested = {"sampled", "burst", "voltages", "custom"}
    assert {kind for kind in described if not described[kind]} == nested
    assert set(NUMBERS) == {name for names in described.values() for name in names}


RAMP = """
from mems_impact.actuator.parameter_base import NonNegative, Positive
from mems_impact.actuator.drives.sine import Sine


class Ramp(Sine):
    amplitude: NonNegative
    omega: Positive
"""


def test_a_new_waveform_is_one_file_and_one_line(cli, tmp_path, monkeypatch):
    (tmp_path / "ramp.py").write_text(RAMP)
    monkeypatch.setattr(drives, "__path__", [*drives.__path__, str(tmp_path)])
    monkeypatch.setitem(WAVEFORMS, "ramp", "Ramp")
    (tmp_path / "ramp.toml").write_text('[drive]\nkind = "ramp"\namplitude = 1\nomega = 1\n')
    assert type(mi.load("ramp.toml")).__name__ == "Ramp"
    for options in (["ramp.toml"], ["ramp", "--amplitude", "1", "--omega", "1"]):
        assert "Ramp" in cli("drive", "zhao2004", "--drive", *options, "--no-figure").out


def test_show_a_drive(cli, tmp_path):
    done = cli("drive", "zhao2004", *SQUARE)
    assert done.status == 0
    assert "forcing period     12.5663706" in done.out
    assert "3.76991118, 12.5663706" in done.out
    assert "0 to 0.09" in done.out
    assert (tmp_path / "out" / "drive.png").exists()


def test_files(cli, tmp_path):
    (tmp_path / "burst.toml").write_text(BURST)
    (tmp_path / "wave.csv").write_text("0 0\n1 1\n2 0.5\n")
    done = cli("drive", "zhao2004", "--drive", "burst.toml", "--no-figure")
    assert "Burst" in done.out
    done = cli("drive", "zhao2004", "--drive", "wave.csv", "--drive-period", "4", "--no-figure")
    assert "forcing period     4" in done.out


@pytest.fixture
def own(tmp_path):
    """The file of a device with a voltage of its own."""
    told = mi.load_actuator("zhao2004").model_dump(exclude={"units", "terms", "geometry"})
    text = "[parameters]\n" + "".join(f"{name} = {value}\n" for name, value in told.items())
    drive = '[drive]\nkind = "square"\namplitude = 0.3\nomega = 0.5\nduty = 0.3\n'
    (tmp_path / "own.toml").write_text(text + drive)
    return "own.toml"


def test_every_command_with_a_drive_takes_that_of_the_device(cli, own):
    """All make it in one place, of the argument that they call DEVICE."""
    for name in COMMAND_NAMES:
        command = main_group.get_command(None, name)
        if any(each.name == "drive_choice" for each in command.params):
            with click.Context(command) as context:
                context.params["device"] = own
                assert drive_from() == mi.load(own).drive, name
                assert any(each.name == "device" for each in command.params), name


def test_numbers_change_the_drive_of_the_device(cli, own):
    assert "0 to 0.16" in cli("drive", own, "--amplitude", "0.4", "--no-figure").out
    done = cli("drive", own, "--width", "0.4", "--no-figure")
    assert "not a parameter of the drive in own.toml" in done.err
    assert "--drive KIND selects others" in done.err
    sine = ["--drive", "sine", "--amplitude", "0.2", "--omega", "1"]
    assert "Sine" in cli("drive", own, *sine, "--no-figure").out


def test_a_study_file_takes_the_drive_of_its_device(own, tmp_path):
    study = 'device = "own.toml"\n[study]\nkind = "map"\nx = ["e", [0.8]]\ny = ["duty", [0.3]]\n'
    (tmp_path / "map.toml").write_text(study)
    assert mi.load(tmp_path / "map.toml").system.drive == mi.load(tmp_path / own).drive


def test_a_frequency_is_omega_over_two_pi(cli, tmp_path):
    period = "forcing period [s]         0.5\n"  # half of that of the voltage
    sine = ["drive", "mita2003", "--amplitude", "100", "--no-figure"]
    assert period in cli(*sine, "--frequency", "1").out
    (tmp_path / "sine.toml").write_text('[drive]\nkind = "sine"\namplitude = 9\nomega = 5\n')
    of_file = cli("drive", "mita2003", "--drive", "sine.toml", "--frequency", "1", "--no-figure")
    assert period in of_file.out


def test_si_without_units_is_one_line(cli, tmp_path):
    values = mi.load_actuator("mita2003").model_dump(exclude={"units", "terms", "geometry"})
    lines = "".join(f"{name} = {value}\n" for name, value in values.items())
    (tmp_path / "mine.toml").write_text(f"[parameters]\n{lines}")
    done = cli("drive", "mine.toml", "--amplitude", "1", "--omega", "1", "--no-figure")
    assert done.status == 0
    assert done.err.startswith("mems-impact: warning: mine.toml: m1 = 1.0485e-05")
    assert done.err.count("\n") == 1


def test_every_command_with_a_drive_takes_a_frequency(cli):
    for command in COMMAND_NAMES:
        if command == "new":  # whose frequency is the resonance
            continue
        page = cli(command, "--help").out
        assert ("--omega" in page) == ("--frequency" in page), command


def test_code_runs_only_when_asked_for(cli, tmp_path):
    wave = "import math\ndef voltage(t, q):\n    return math.cos(t)\n"
    wave += "def voltage_rate(t, q):\n    return -math.sin(t)\nopen('it-ran', 'w').close()\n"
    (tmp_path / "wave.py").write_text(wave)
    (tmp_path / "own.toml").write_text(
        '[drive]\nkind = "custom"\nsource = "wave.py"\nperiod = 3.141592653589793\n'
    )
    show = ["drive", "zhao2004", "--drive", "own.toml", "--no-figure"]
    assert "--allow-code" in cli(*show).complaint()
    assert not (tmp_path / "it-ran").exists()
    assert "Custom" in cli(*show, "--allow-code").out
    assert (tmp_path / "it-ran").exists()


WRONG = [
    (["--drive", "sqare"], ["sqare", "neither a file"]),
    (["--drive", "burst"], ["burst", "TOML"]),
    (["--drive", "none.toml"], ["none.toml", "no such file"]),
    (["--drive", "square", "--omega", "1"], ["missing option '--amplitude'"]),
    ([*SQUARE, "--duty", "1"], ["duty = 1", "< 1"]),
    ([*SQUARE, "--duty", "x"], ["--duty", "x"]),
    ([*SQUARE, "--flat", "0.5"], ["--flat is not an option of a square"]),
    ([*SQUARE, "--rise", "9"], ["rise = 9"]),
    ([*SQUARE, "--frequency", "1"], ["--frequency and --omega exclude each other"]),
    (["--amplitude", "1", "--frequency", "0"], ["frequency = 0", "> 0"]),
    (["--amplitude", "1", "--frequency", "nan"], ["frequency = nan", "finite"]),
    (["--amplitude", "1"], ["'--omega' or '--frequency'"]),
    (["--drive", "pulse", "--amplitude", "1", "--drive-period", "5", "--width", "1",
      "--frequency", "1"],
     ["--frequency is not an option of a pulse"]),
    (["--drive", "burst.toml", "--frequency", "1"], ["--frequency is not a parameter"]),
    (["--drive", "burst.toml", "--duty", "0.3"], ["--duty", "wave.amplitude"]),
]  # fmt: skip


@pytest.mark.parametrize(("arguments", "named"), WRONG)
def test_one_line_and_status_2(cli, tmp_path, arguments, named):
    (tmp_path / "burst.toml").write_text(BURST)
    done = cli("drive", "zhao2004", *arguments, "--no-figure")
    assert done.status == 2
    assert done.err.count("\n") == 1
    for word in named:
        assert word in done.err
