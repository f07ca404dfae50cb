"""Every line that shows a number of a device in SI shows its unit."""

import mems_impact as mi

VOLTAGE = ["--frequency", "200", "--no-figure"]  # below pull-in nothing strikes


def test_drive(cli):
    lines = cli("drive", "mita2003", "--amplitude", "20", *VOLTAGE).out.splitlines()
    headings = [line[2:28].strip() for line in lines if line]
    assert headings == [
        "drive",
        "forcing period [s]",
        "angular frequency [rad/s]",
        "switches [s]",
        "force at x2 = 0 [N]",
    ]


def test_orbit(cli):
    out = cli("orbit", "mita2003", "--amplitude", "20", *VOLTAGE).out
    for heading in ("forcing period [s]", "x2 [m]", "v2 [m/s]", "v1 [m/s]", "step [m]"):
        assert f"  {heading} " in out


def test_branch(cli):
    vary = ["--parameter", "amplitude", "--start", "20", "--stop", "19.9"]
    assert ", amplitude 19.9 to 20 V, " in cli("continue", "mita2003", *vary, *VOLTAGE).out


def test_sweep(cli, monkeypatch):
    drive = mi.Sine(amplitude=20.0, omega=1000.0)
    table = mi.sweep(
        mi.load_actuator("mita2003"), drive, "amplitude", [20, 50], transient=1, periods=1
    )
    table.loc[table["amplitude"] == 50, "status"] = "it broke"
    monkeypatch.setattr(mi, "sweep", lambda *_, **__: table, raising=False)
    vary = ["--parameter", "amplitude", "--start", "20", "--stop", "50", "--points", "2"]
    out = cli("sweep", "mita2003", *vary, *VOLTAGE).out
    assert "amplitude increased, 2 values: " in out
    assert "  failed at 50 V: it broke" in out


def test_a_dimensionless_device_has_none(cli):
    out = cli("orbit", "zhao2004", "--amplitude", "0.1", "--omega", "0.5", "--no-figure").out
    assert "  forcing period " in out
    assert "[" not in out
