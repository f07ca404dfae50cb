"""The plot of what the device sees."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import mems_impact as mi
from tests.actuator.waveforms import DRIVES

ZHAO = mi.load_actuator("zhao2004")


@pytest.mark.parametrize("name", DRIVES)
def test_every_drive_has_a_plot(name):
    drive = DRIVES[name]
    above, below = mi.plot_drive(drive, ZHAO)
    assert below.get_xlim() == (0.0, drive.period)
    assert (above.get_legend() is not None) == (drive.left_voltage is not None)


def test_a_jump_is_a_gap_and_the_force_that_of_the_device():
    device = ZHAO.replace(alpha=2.0)
    drive = DRIVES["square"]
    _, below = mi.plot_drive(drive, device, ax=Figure().subplots(2))
    time, force = below.lines[0].get_data()
    assert np.isnan(force).sum() == 1
    assert set(np.round(force[~np.isnan(force)], 12)) == {0.0, 0.18}
    assert np.nanmax(time) < drive.period
    _, below = mi.plot_drive(drive)
    assert np.nanmax(below.lines[0].get_ydata()) == pytest.approx(0.09)


def test_the_output_of_the_source_and_a_charge(tmp_path):
    square = mi.Square(amplitude=0.3, omega=1.0)
    above, below = mi.plot_drive(square, ZHAO.adding(mi.SlewRate(rate=0.3)))
    drive, source = (line.get_data() for line in above.lines[:2])
    assert set(drive[1][~np.isnan(drive[1])]) == {0.0, 0.3}
    ramp = source[0] < 1.0
    np.testing.assert_allclose(source[1][ramp], 0.3 * source[0][ramp], atol=1e-12)
    np.testing.assert_allclose(below.lines[0].get_ydata(), source[1] ** 2, atol=1e-12)
    # The force of a charge q is q^2 alpha/(2 alpha + Cp d)^2 at x2 = 0.
    device = mi.load_actuator("mita2003").adding(mi.ChargeDrive(parasitic_capacitance=1e-14))
    above, below = mi.plot_drive(mi.Sine(amplitude="2 pC", frequency=200.0), device)
    assert above.get_ylabel() == "charge [pC]"
    total = 2.0 * device.alpha + 1e-14 * device.d
    force = below.lines[0].get_ydata()[0]
    assert force == pytest.approx((2e-12 / total) ** 2 * device.alpha, rel=1e-9)
    above.figure.savefig(tmp_path / "drive.png")
