"""Drives in hertz: parameters, tables and figures have the frequency in place of omega."""

from __future__ import annotations

import copy
import math
import pickle

import pytest

import mems_impact as mi

MITA = mi.load_actuator("mita2003")
DRIVES = [
    mi.Sine(amplitude=40.0, frequency=110.0),
    mi.Square(amplitude=40.0, frequency=110.0, duty=0.3),
    mi.Trapezoid(amplitude=40.0, frequency=110.0, bias=5.0),
]


@pytest.mark.parametrize("drive", DRIVES)
def test_a_frequency_is_a_parameter(drive):
    assert drive.omega == 2.0 * math.pi * 110.0
    assert "frequency" in drive.names
    assert "omega" not in drive.names
    other = type(drive)(**{**dict(drive), "frequency": None, "omega": drive.omega})
    assert other.omega == drive.omega
    assert other.period == drive.period
    assert "frequency" not in other.names
    assert MITA.under(drive).units["frequency"] == "Hz"
    numbers, others = (MITA.under(each).numbers() for each in (drive, other))
    assert numbers.period == pytest.approx(others.period, rel=1e-15)
    assert numbers.parameters == pytest.approx(others.parameters, rel=1e-15)


@pytest.mark.parametrize("drive", DRIVES)
def test_the_one_that_is_changed_replaces_both(drive):
    assert drive.replace(frequency=220.0).omega == 2.0 * drive.omega
    assert drive.replace(omega=5.0).names[1] == "omega"
    assert drive.replace(omega=5.0).replace(frequency=1.0).omega == 2.0 * math.pi
    assert drive.replace(amplitude=30.0).frequency == 110.0
    assert drive.varied({"frequency": 55.0}, checked=False).omega == pytest.approx(
        0.5 * drive.omega
    )
    assert drive.scaled(2.0, 1e-3).frequency == pytest.approx(0.11)
    for copied in (pickle.loads(pickle.dumps(drive)), copy.deepcopy(drive)):
        assert copied == drive


def test_both_are_refused():
    with pytest.raises(mi.InvalidParameter, match="omitted if omega is given"):
        mi.Sine(amplitude=1.0, omega=1.0, frequency=1.0)
    with pytest.raises(mi.InvalidParameter, match="frequency = 0: must be a finite number > 0"):
        mi.Sine(amplitude=1.0, frequency=0)


def test_a_curve_in_hertz(tmp_path):
    drive = mi.Sine(amplitude=20.0, frequency=100.0)
    curve = mi.characteristic(
        MITA, drive, "frequency", ["110 Hz", "0.12 kHz"], transient=20, periods=5
    )
    assert curve.table["frequency"].tolist() == [110.0, 120.0, 120.0, 110.0]
    assert curve.table.attrs["units"]["frequency"] == "Hz"
    assert curve.impact_onset.columns.tolist()[1:3] == ["frequency from", "frequency to"]
    assert "[Hz]" in mi.plot_characteristic(curve).figure.axes[-1].get_xlabel()
    curve.save(tmp_path / "curve.zip")
    assert mi.load(tmp_path / "curve.zip") == curve
