"""The plot of what the device sees."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import mems_impact as mi
from tests.actuator.waveforms import DRIVES

ZHAO = mi.load_actuator("zhao2004")


@pytest.mark.parametrize("name", DRIVES)
def test_every_drive_has_a_plot(name, tmp_path):
    drive = DRIVES[name]
    above, below = mi.plot_drive(drive, ZHAO)
    assert below.get_xlim() == (0.0, drive.period)
    assert (above.get_legend() is not None) == (drive.left_voltage is not None)
    above.figure.savefig(tmp_path / "drive.png")


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
