"""A run of an actuator: block between its stoppers, and frame."""

import numpy as np
import pytest
from matplotlib.figure import Figure

import mems_impact as mi

ZHAO = mi.load_actuator("zhao2004")
DRIVE = mi.Sine(amplitude=0.24, omega=0.5)


@pytest.fixture(scope="module")
def run():
    return mi.simulate(ZHAO, DRIVE, 40, initial=mi.State(v2=1.0))


def test_run_shows_its_last_periods(run, tmp_path):
    block, frame = mi.plot_run(run).figure.axes
    assert block.figure is frame.figure
    assert frame.get_xlim() == pytest.approx((34, 40))
    hits = next(line for line in block.lines if line.get_marker() == "o")
    assert len(hits.get_xdata()) == 6
    assert set(hits.get_ydata()) == {ZHAO.delta}
    assert len(block.patches) == 6  # slips
    block.figure.savefig(tmp_path / "run.png")
    assert (tmp_path / "run.png").stat().st_size > 10_000


def test_run_on_given_axes(run):
    axes = Figure().subplots(2)
    block, frame = mi.plot_run(run, 10, 12, ax=axes).figure.axes
    assert block is axes[0]
    assert frame is axes[1]
    assert frame.get_xlim() == pytest.approx((10, 12))


@pytest.mark.parametrize("panels", [1, 3])
def test_run_on_too_many_axes_or_too_few(run, panels):
    with pytest.raises(mi.InvalidParameter, match=f"ax = {panels}: must be 2 axes, one for the"):
        mi.plot_run(run, ax=Figure().subplots(panels))


def test_run_without_impacts(tmp_path):
    block, frame = mi.plot_run(mi.simulate(ZHAO, DRIVE.replace(amplitude=0.1), 3)).figure.axes
    assert len(block.patches) == 0
    block.figure.savefig(tmp_path / "run.png")
    assert block.get_position().y0 > frame.get_position().y1


def test_run_that_kept_nothing():
    with pytest.raises(mi.InvalidParameter, match="keep='events'"):
        mi.plot_run(mi.simulate(ZHAO, DRIVE, 3, keep="statistics"))


def test_chosen_states_are_drawn_as_those_of_any_system(run):
    axes = mi.plot_run(run, states=("v1", "v2")).figure.axes
    assert [ax.get_ylabel() for ax in axes] == ["$v_1$", "$v_2$"]
    texts = [text.get_text() for text in axes[0].get_legend().get_texts()]
    assert texts == ["impact", "forward-free", "stuck-free"]


@pytest.mark.slow
def test_units_are_those_of_the_device():
    device = mi.load_actuator("mita2003")
    run = mi.simulate(device, mi.Sine(amplitude=100, omega=6.283), periods=2)
    assert mi.plot_run(run).figure.axes[1].get_ylabel() == "frame $x_1$ [nm]"
    (ax,) = mi.plot_run(run, states=["x2"]).figure.axes
    assert ax.get_ylabel() == "$x_2$ [µm]"
    low, high = ax.get_ylim()
    assert -1.3 * device.delta < low < high < 1.3 * device.delta


@pytest.mark.slow
def test_a_voltage_that_differs_from_the_drive_has_a_panel():
    device = ZHAO.adding(mi.SeriesResistance(resistance=0.1))
    options = mi.Options(engine="interpreted")
    run = mi.simulate(device, DRIVE, 1, options=options)
    _, frame, voltage = mi.plot_run(run).figure.axes
    drive, node = voltage.lines
    assert voltage.get_ylabel() == "voltage"
    assert [text.get_text() for text in voltage.get_legend().get_texts()] == ["drive", "electrode"]
    t = drive.get_xdata() * run.system.forcing_period
    assert drive.get_ydata() == pytest.approx(0.24 * np.cos(0.5 * t), abs=1e-12)
    assert node.get_ydata() == pytest.approx(run.samples(len(t) - 1)["node voltage"], abs=1e-12)
    # On two axes without it, on three with it.
    assert len(mi.plot_run(run, ax=Figure().subplots(2)).figure.axes[1].lines) == len(frame.lines)
    assert len(mi.plot_run(run, ax=Figure().subplots(3)).figure.axes[2].lines) == 2
    # The drive of a charge is no voltage.
    charged = ZHAO.adding(mi.ChargeDrive())
    run = mi.simulate(charged, DRIVE, 1, options=options)
    (node,) = mi.plot_run(run).figure.axes[2].lines
    assert node.get_ydata()[0] == pytest.approx(0.24 / 2.0, abs=1e-12)
