"""Tornado charts."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

import mems_impact as mi

ZHAO = mi.load_actuator("zhao2004").under(mi.Sine(amplitude=0.24, omega=0.5))
MITA = mi.load_actuator("mita2003").under(mi.Sine(amplitude=42.0, omega=710.0))


def sensitivity_of(system):
    return mi.Sensitivity(
        orbit=SimpleNamespace(system=system),
        quantities=("mean speed", "closest approach"),
        parameters=("omega", "delta", "mu_s", "k"),
        units=("m/s", "m") if system.units else ("", ""),
        values=np.array([2e-5, 0.1]),
        derivatives=np.array([[1e-5, -4e-4, 1e-18, 1e-4], [0.0, 0.0, 0.0, 0.0]]),
    )


def widths(ax):
    return [bar.get_width() for bar in ax.containers[0]]


def test_the_longest_first():
    ax = mi.plot_sensitivity(sensitivity_of(ZHAO), "mean speed")
    names = [label.get_text() for label in ax.get_yticklabels()]
    assert names == [r"$\delta$", "$k$", r"$\omega$"]  # mu_s moves nothing
    expected = [0.01 * 0.5 * -4.0, 0.01 * 1.0, 0.01 * 0.5 * 0.1]
    power = 10.0 ** np.round(np.log10(abs(widths(ax)[0] / (expected[0] * 1e-4))))
    assert widths(ax) == pytest.approx([1e-4 * power * each for each in expected])
    assert [bar.get_width() for bar in ax.containers[1]] == pytest.approx(
        [-each for each in widths(ax)]
    )
    assert ax.yaxis_inverted()
    assert ax.get_xlabel().startswith("change of mean speed [$10^{-6}$]")


def test_tolerances_and_units(tmp_path):
    ax = Figure().subplots()
    given = {"delta": 1e-8, "k": 0.1}
    assert mi.plot_sensitivity(sensitivity_of(MITA), "mean speed", ax, tolerances=given) is ax
    names = [label.get_text() for label in ax.get_yticklabels()]
    assert names == ["$k$ ± 100 mN/m", r"$\delta$ ± 10 nm"]
    assert "m/s]" in ax.get_xlabel()
    assert ax.get_xlabel().endswith("from 20 µm/s")
    ax.figure.savefig(tmp_path / "tornado.png")


def test_bad_input():
    with pytest.raises(mi.InvalidParameter, match="speedy"):
        mi.plot_sensitivity(sensitivity_of(ZHAO), "speedy")
    with pytest.raises(mi.InvalidParameter, match="a parameter changes"):
        mi.plot_sensitivity(sensitivity_of(ZHAO), "closest approach")
    with pytest.raises(mi.InvalidParameter, match="alpha"):
        mi.plot_sensitivity(sensitivity_of(ZHAO), "mean speed", tolerances={"alpha": 1.0})
    with pytest.raises(mi.InvalidParameter, match="tolerance of k"):
        mi.plot_sensitivity(sensitivity_of(ZHAO), "mean speed", tolerances={"k": 0.0})


def test_a_table_says_all():
    table = sensitivity_of(MITA).table
    assert isinstance(table, pd.DataFrame)
    assert list(table.columns) == [
        "quantity", "value", "parameter", "at", "derivative", "elasticity", "per cent", "unit"
    ]  # fmt: skip
    row = table.iloc[1]
    assert row["elasticity"] == pytest.approx(row["derivative"] * row["at"] / row["value"])
    assert row["per cent"] == pytest.approx(0.01 * row["derivative"] * row["at"])
