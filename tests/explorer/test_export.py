import contextlib
import io

import numpy as np
import pandas as pd
import pytest

import mems_impact as mi
from mems_impact.actuator.state_space import kicked_state
from mems_impact.explorer.export import device_file, python_of, run_picture
from mems_impact.explorer.session import first_setting, subject_of_code, subject_of_device
from mems_impact.explorer.snapshot import take_snapshot
from tests.explorer.subjects import mita, slider_spec, zhao

OWN = """
import math

import mems_impact as mi


def flow(mode, t, y, p):
    return y.v, -p.k * y.x


def made():
    return mi.System(states=("x", "v"), flow=flow, parameters={"k": 1.0}, initial={"x": 1.0})


system = made()
"""


def run_of(script):
    """Return the run of a script, without its diagram and its files."""
    lines = [line for line in script.splitlines() if "savefig" not in line]
    names = {}
    with contextlib.redirect_stdout(io.StringIO()):
        exec("\n".join(line for line in lines if "mi.sweep" not in line), names)
    return names["run"]


def assert_same_runs(run, other):
    assert run.system == other.system
    assert run.final == other.final
    pd.testing.assert_frame_equal(run.events, other.events, check_exact=True)


@pytest.mark.quick(1)
@pytest.mark.parametrize(("subject", "start"), [(zhao, "kicked"), (zhao, "rest"), (mita, "kicked")])
def test_the_python_makes_the_same_run(subject, start):
    subject = subject()
    first = first_setting(subject)
    value = first.values["amplitude"] * 0.971
    setting = first.with_value("amplitude", value).with_value("e", 0.71)
    setting = type(setting)(**{**vars(setting), "start": start, "length": 30.0})
    script = python_of(subject, setting, slider_spec(subject, "amplitude"))
    assert_same_runs(run_of(script), take_snapshot(subject, setting).run)


def test_the_python_has_terms_and_files_of_drives(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    wave = tmp_path / "wave.toml"
    wave.write_text('[drive]\nkind = "sine"\namplitude = 0.2\nomega = 0.5\n')
    device = mi.load_actuator("zhao2004").changed(e=0.7, **{"tilt.angle": 0.01})
    subject = subject_of_device(
        "zhao2004", device, mi.load("wave.toml").varied({"omega": 0.45}),
        drive_source='mi.load("wave.toml")',
    )  # fmt: skip
    names = {"mi": mi}
    exec(subject.source(subject.system), names)
    assert names["system"] == subject.system


@pytest.mark.parametrize("source", ["own.py:system", "own.py:made", "own:made"])
def test_the_python_of_an_own_system(source, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "own.py").write_text(OWN)
    subject = subject_of_code(source, {"k": 2.0})
    assert subject.system.parameters == {"k": 2.0}
    setting = first_setting(subject).with_value("k", 3.0)
    script = python_of(subject, setting, None)
    assert "duration=100.0" in script
    names = {"mi": mi}
    exec(script.split("run = ")[0], names)
    assert names["system"].parameters == {"k": 3.0}


def test_the_file_of_the_device_is_read_back(tmp_path):
    device = mi.load_actuator("mita2003").adding(mi.Tilt(angle=0.05))
    wave = mi.Burst(wave=mi.Sine(amplitude=30.0, omega=700.0), on=3, off=2)
    saved = tmp_path / "saved.toml"
    for drive in (mi.Sine(amplitude=1.0 / 3.0, omega=750.0, phase=0.1), wave):
        system = device.under(drive)
        subject = subject_of_device("mita2003", device, drive)
        saved.write_text(device_file(subject, system))
        assert mi.load_actuator(saved) == device
        assert mi.load(saved).drive == drive


def test_a_measured_voltage_is_in_the_file(tmp_path):
    times = np.linspace(0.0, 10.0, 50, endpoint=False)
    drive = mi.Sampled(times=times.tolist(), voltages=np.sin(times).tolist(), period=10.0)
    device = mi.load_actuator("zhao2004")
    saved = tmp_path / "saved.toml"
    saved.write_text(device_file(subject_of_device("zhao2004", device, drive), device.under(drive)))
    assert mi.load(saved).drive == drive


def test_the_picture_is_a_png():
    run = mi.simulate(zhao().system, 10, initial=kicked_state(zhao().system.actuator),
                      options=zhao().options)  # fmt: skip
    assert run_picture(run).startswith(b"\x89PNG")
