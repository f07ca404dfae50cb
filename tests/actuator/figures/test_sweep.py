"""A sweep and a branch of an actuator, as the generic figures draw them."""

import numpy as np
import pytest

import mems_impact as mi


@pytest.mark.slow
def test_the_table_says_what_the_figure_shows(tmp_path):
    zhao, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5)
    sweep = mi.sweep(zhao, drive, "amplitude", np.linspace(0.2, 0.24, 3), transient=40, periods=4,
                     direction="down")  # fmt: skip
    axes = mi.plot_sweep(sweep).figure.axes
    assert [ax.get_ylabel() for ax in axes] == [
        "$v_2$ at $x_2 = 0$", "step per impact\n[$10^{-4}$]",
        "mean speed\n[$10^{-5}$]"]  # fmt: skip
    assert axes[-1].get_xlabel() == "amplitude $f$"
    assert mi.plot_sweep(sweep, quantity="speed").get_ylabel() == "mean speed [$10^{-5}$]"
    axes[0].figure.savefig(tmp_path / "sweep.png")


def test_units_of_the_device():
    mita, drive = mi.load_actuator("mita2003"), mi.Sine(amplitude=100.0, omega=6.283)
    sweep = mi.sweep(mita, drive, "amplitude", [90.0, 100.0], transient=1, periods=1)
    axes = mi.plot_sweep(sweep).figure.axes
    assert [ax.get_ylabel() for ax in axes] == [
        "$v_2$ [µm/s] at $x_2 = 0$", "step per impact\n[nm]", "mean speed\n[nm/s]"]  # fmt: skip
    assert axes[-1].get_xlabel() == "amplitude [V]"
