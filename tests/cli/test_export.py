"""`mems-impact export`."""

import zipfile
from pathlib import Path

import pytest

SMOOTH = (
    *("--set", "compliant_stopper.stiffness=500", "--set", "compliant_stopper.damping=100"),
    *("--set", "regularized_friction.width=1e-5"),
)


def test_verilog_a_module(cli, tmp_path):
    file = tmp_path / "dev.va"
    changes = (*SMOOTH, "--set", "tilt.angle=0.05", "--set", "e=0.7")
    done = cli("export", "mita2003", file, *changes)
    assert f"written: {file}, a Verilog-A module" in done.out
    text = file.read_text()
    assert "module dev(p, n, block, frame);" in text
    assert "parameter real e = 0.7 from [0.0:1.0];" in text
    assert "parameter real tilt_angle = 0.05" in text
    cli("export", "mita2003", file, *SMOOTH, "--electrodes", "2")
    assert "module dev(p, left, n, block, frame);" in file.read_text()


DRIVE = ("--amplitude", "0.24", "--omega", "0.5")


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (("mita2003", "dev.xyz"), "dev.xyz: no format has the extension '.xyz'; known: .fmu"),
        (("mita2003", "dev"), "no format has the extension ''"),
        (("zhao2004", "dev.va"), "units = 'dimensionless'"),
        (("mita2003", "dev.va"), "without compliant_stopper and regularized_friction"),
        (("mita2003", "dev.va", *SMOOTH, "--set", "slew_rate.rate=1"), "slew_rate"),
        (("mita2003", "no/dev.va", *SMOOTH), "no/dev.va"),
        (("mita2003", "dev.va", "--amplitude", "1"), "a Verilog-A module takes no --amplitude"),
        (("mita2003", "dev.va", "--fmi", "2.0"), "takes no --fmi"),
        (("mita2003", "dev.fmu", "--electrodes", "2"), "takes no --electrodes"),
        (("zhao2004", "dev.fmu", *DRIVE, "--input", "f"), "--input = 'f': must be among"),
        (("zhao2004", "dev.fmu", *DRIVE, "--input", "left_voltage"), "no electrode on the left"),
    ],
)
def test_wrong_input(cli, arguments, problem):
    assert problem in cli("export", *arguments).complaint()
    assert not list(Path().iterdir())


def test_functional_mock_up_unit(cli, tmp_path, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    done = cli(
        *("export", "mita2003", "dev.fmu", "--amplitude", "60 V", "--frequency", "100 Hz"),
        *("--input", "voltage", "--fmi", "2.0", "--initial", "x2=1e-6"),
    )
    assert done.status == 0
    assert "written: dev.fmu, a functional mock-up unit" in done.out
    assert "dev.fmu contains C sources without a binary: no-such-compiler" in done.err
    with zipfile.ZipFile("dev.fmu") as archive:
        description = archive.read("modelDescription.xml").decode()
    assert "fmiVersion='2.0'" in description
    assert 'name="voltage"' in description
    assert 'start="1e-06"' in description
