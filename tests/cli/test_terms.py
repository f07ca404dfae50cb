import pandas as pd
import pytest

import mems_impact as mi
from mems_impact.actuator.terms import TERM_CLASSES

RUN = ["simulate", "zhao2004", "--amplitude", "0.24", "--omega", "0.5", "--periods", "1"]
RUN += ["--engine", "interpreted", "--no-figure"]


def test_terms_are_listed(cli):
    done = cli("terms")
    assert done.status == 0
    for name in TERM_CLASSES:
        assert f"{name}: " in done.out
    assert "  tilt.angle\n" in done.out
    assert "  compliant_stopper.stiffness [N/m]\n" in done.out
    assert "  compliant_stopper.exponent [default 1.0]\n" in done.out


def test_terms_of_devices_are_listed(cli, monkeypatch):
    held = mi.load_actuator("mita2003").adding(mi.FrameSpring(k1=3.0))
    monkeypatch.setattr("mems_impact.actuator.device_files.load_actuator", lambda _: held)
    assert "frame_spring.k1 = 3 N/m" in cli("devices").out


def test_a_term_is_added_and_changed(cli, tmp_path):
    done = cli(*RUN, "--initial", "v2=1", "--set", "adhesion.force=0.1", "--set", "e=0.5")
    assert done.status == 0
    first = pd.read_csv(tmp_path / "out" / "simulate-impacts.csv").iloc[0]
    assert -first["v2 after"] / first["v2 before"] == pytest.approx(0.5)
    device = mi.load_actuator("zhao2004").changed(**{"tilt.angle": 0.1})
    changed = device.changed(e=0.7, **{"tilt.angle": 0.2, "frame_force.force": 0.3})
    assert changed == mi.load_actuator("zhao2004").replace(e=0.7).adding(
        mi.Tilt(angle=0.2), mi.FrameForce(force=0.3)
    )


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ("compliant_stopper.damping=0.3", ["compliant_stopper.stiffness", "missing"]),
        ("tilt.angel=0.3", ["tilt.angel", "did you mean angle?"]),
        ("tilt.angle=3", ["tilt.angle = 3", "< 1.57"]),
        ("tlit.angle=0.3", ["tlit", "one of", "tilt"]),
    ],
)
def test_bad_terms_are_one_line(cli, change, named):
    said = cli(*RUN, "--set", change).complaint()
    for word in named:
        assert word in said


def test_a_sweep_over_a_term(cli, tmp_path):
    vary = ["frame_force.force=0:2:2"]
    vary += ["--direction", "up", "--transient", "0", "--periods", "1", "--engine", "interpreted"]
    done = cli("sweep", "zhao2004", *vary, "--amplitude", "0.3", "--omega", "0.5", "--no-figure")
    assert done.status == 0
    summary = pd.read_csv(tmp_path / "out" / "sweep-summary.csv")
    assert list(summary["frame_force.force"]) == [0.0, 2.0]
