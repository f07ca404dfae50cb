"""Tolerance analysis: histograms with their specification, bars of indices."""

import math

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

import mems_impact as mi
from tests.analysis.systems import oscillator

STEPS = [0.0, 1.0, 1.0, 2.0, 2.0, 2.0, 3.0, 3.0, 4.0, 5.0]


def analysis_of(indices=True):
    """Return ten devices, of which seven are as specified."""
    table = pd.DataFrame(
        {
            "A": 1.0,
            "wall": 2.0,
            "sample": "A" if indices else "",
            "motion": "periodic",
            "period": 1,
            "step": STEPS,
            "rate": 1.0,
            "status": "ok",
        }
    )
    table.attrs = {"drawn": ["A", "wall"], "units": {"step": "m"}}
    told = None
    if indices:
        told = pd.DataFrame(
            {
                "quantity": ["step"] * 2 + ["rate"] * 2,
                "parameter": ["A", "wall"] * 2,
                "first": [0.7, 0.1, math.nan, math.nan],
                "first low": [0.6, 0.0, math.nan, math.nan],
                "first high": [0.8, 0.2, math.nan, math.nan],
                "total": [0.9, 0.3, math.nan, math.nan],
                "total low": [0.8, 0.2, math.nan, math.nan],
                "total high": [1.0, 0.4, math.nan, math.nan],
                "missing": [0, 0, 3, 3],
            }
        )
        told.attrs = dict(table.attrs)
    wanted = {"step": (1.0, 3.0)}
    return mi.ToleranceAnalysis(
        system=oscillator(), drawn=("A", "wall"), specification=wanted, table=table, indices=told
    )


def test_points_are_counted_in_whole_numbers():
    table = analysis_of(indices=False).table.iloc[:3]
    few = mi.ToleranceAnalysis(system=oscillator(), drawn=("A",), table=table)
    assert all(
        tick == int(tick) for tick in mi.plot_tolerance_analysis(few, quantity="step").get_yticks()
    )


def test_what_is_specified_is_drawn_with_its_indices(tmp_path):
    ax = mi.plot_tolerance_analysis(analysis_of())
    spread, bars = ax.figure.axes
    assert spread is ax
    inside, outside = ax.containers
    assert sum(bar.get_height() for bar in inside) == 7
    assert sum(bar.get_height() for bar in outside) == 3
    dashed = [line.get_xdata()[0] for line in ax.lines if line.get_linestyle() == "--"]
    assert dashed == [1.0, 3.0]
    assert ax.lines[-1].get_xdata()[0] == 2.0  # the median
    assert ax.get_xlabel() == "step [m]\nyield 70.0% (39.7% to 89.2%)"
    assert ax.get_ylabel() == "number of devices"
    legend = [text.get_text() for text in ax.get_legend().get_texts()]
    assert set(legend) == {"as specified", "out of specification", "bound", "median"}
    edges = sorted(
        {bar.get_x() for bar in inside} | {bar.get_x() + bar.get_width() for bar in inside}
    )
    assert edges == pytest.approx(np.histogram_bin_edges(STEPS, "auto"))
    assert ax.get_xlim()[0] == 0.0  # no step is below
    assert [text.get_text() for text in bars.get_yticklabels()] == ["$A$", "wall"]
    widths = sorted(bar.get_width() for bar in bars.patches)
    assert widths == [0.1, 0.3, 0.7, 0.9]
    ax.figure.savefig(tmp_path / "tolerances.png")


@pytest.mark.slow
def test_chosen_quantities(tmp_path):
    ax = mi.plot_tolerance_analysis(analysis_of(), quantity=["rate", "step"])
    # A quantity without a number at some points has no indices, and no panel for them.
    assert [each.get_xlabel() for each in ax.figure.axes] == [
        "rate\nno indices: 3 points have no number",
        "step [m]\nyield 70.0% (39.7% to 89.2%)",
        "first-order (filled) and total index",
    ]
    ax.figure.savefig(tmp_path / "tolerances.png")
    given = Figure().subplots()
    assert (
        mi.plot_tolerance_analysis(analysis_of(indices=False), quantity="step", ax=given) is given
    )
    alone = mi.plot_tolerance_analysis(analysis_of(indices=False))
    assert alone.figure.axes == [alone]


def test_numbers_that_are_missing(tmp_path):
    few = analysis_of(indices=False)
    few.table["step"] = np.nan
    ax = mi.plot_tolerance_analysis(few)
    assert "yield 0.0%" in ax.get_xlabel()
    ax.figure.savefig(tmp_path / "tolerances.png")


def test_what_is_wrong_is_named():
    with pytest.raises(mi.InvalidParameter, match=r"as mems_impact\.tolerance_analysis returns"):
        mi.plot_tolerance_analysis(pd.DataFrame())
    with pytest.raises(mi.InvalidParameter, match="one of step, rate"):
        mi.plot_tolerance_analysis(analysis_of(), quantity="speed")
