"""Warnings name the line of the caller, whatever way they come."""

from pathlib import Path

import pytest

import mems_impact as mi


@pytest.fixture
def study(tmp_path):
    """A study of a device in kilograms, whose file does not say so."""
    numbers = mi.load_actuator("mita2003").model_dump(exclude={"units", "terms", "geometry"})
    lines = [f"{name} = {value}" for name, value in numbers.items()]
    (tmp_path / "device.toml").write_text("\n".join(["[parameters]", *lines]))
    path = tmp_path / "study.toml"
    path.write_text(
        'device = "device.toml"\n[drive]\nkind = "sine"\n[study]\nkind = "map"\n'
        'x = ["amplitude", [1.0]]\ny = ["omega", [1.0]]\n'
    )
    return path


def test_a_device_of_a_study(study):
    with pytest.warns(mi.UnitsWarning) as caught:
        mi.load(study)
    assert caught[0].filename == __file__


@pytest.mark.slow
def test_a_device_without_a_compiler(tmp_path, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    device, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.2, omega=0.5)
    with pytest.warns(UserWarning, match="without a binary") as caught:
        device.to_fmu(tmp_path / "device.fmu", drive)
    assert caught[0].filename == __file__


def test_a_caller_beside_the_package(study):
    script = f"{Path(mi.__file__).parent}_scripts/script.py"
    call = compile("mi.load(study)", script, "exec")
    with pytest.warns(mi.UnitsWarning) as caught:
        exec(call, {"mi": mi, "study": study})
    assert caught[0].filename == script
