"""Working points over a parameter: a panel for each quantity."""

import numpy as np
import pytest

import mems_impact as mi
from tests.plotting.test_print import characteristic


def words(ax):
    return [text.get_text() for text in ax.get_legend().get_texts()]


def test_curves_have_units_directions_and_errors():
    above = mi.plot_characteristic(characteristic())
    keys = ["20 V", "40 V", "60 V", "up", "down", "error", "limit unknown"]
    assert sorted(words(above)) == sorted(keys)
    step, speed, energy, stall = above.figure.axes
    assert [ax.get_ylabel().replace("\n", " ") for ax in (step, energy, stall)] == [
        "step per blow [nm]", "energy per blow [nJ]", "stall force [µN]"]  # fmt: skip
    assert stall.get_xlabel() == "frequency [Hz]"
    (cross,) = (line for line in speed.lines if line.get_marker() == "x")
    assert list(cross.get_xdata()) == [700.0]
    fills = {line.get_fillstyle() for line in step.lines}
    assert fills == {"full", "none"}


def test_amplitudes_without_units_are_the_f_of_the_paper():
    curve = characteristic()
    curve.table.attrs = {"symbols": {"amplitude": "$f$"}}
    assert "$f$ = 20" in words(mi.plot_characteristic(curve))


def test_one_curve_needs_no_name_and_a_quantity_no_other():
    curve = characteristic((20.0,))
    ax = mi.plot_characteristic(curve, quantity="mean speed")
    assert ax.figure.axes == [ax]
    assert "20 V" not in words(ax)
    with pytest.raises(mi.InvalidParameter, match="one of amplitude, "):
        mi.plot_characteristic(curve, quantity="speed")


def test_a_block_that_never_strikes_shows_its_deflection():
    curve = characteristic()
    curve.table["impacting"] = False
    curve.table["deflection"] = np.linspace(0.0, 1e-6, len(curve.table))
    figure = mi.plot_characteristic(curve).figure
    assert [ax.get_ylabel().split(" [")[0] for ax in figure.axes] == ["deflection", "mean speed"]
