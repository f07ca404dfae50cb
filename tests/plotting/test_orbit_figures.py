"""Diagrams of branches, orbits and charts hold what they should."""

from types import SimpleNamespace

import pandas as pd
import pytest
from matplotlib.figure import Figure

import mems_impact as mi


def diagram():
    table = pd.DataFrame(
        {
            "amplitude": [0.3, 0.2, 0.1, 0.2, 0.3],
            "stable": [True, True, False, False, False],
            "admissible": [True, True, True, True, False],
            "piece": [0, 0, 0, 1, 1],
            "v2": [0.1, 0.2, 0.3, 0.4, 0.5],
            "v2 2": [0.0, 0.1, 0.3, float("nan"), float("nan")],
        }
    )
    special = pd.DataFrame(
        {
            "label": ["CF", "G", "PD", "break-away"],
            "kind": ["fold", "grazing", "period-doubling", "break-away"],
            "amplitude": [0.1, 0.2, 0.3, 0.15],
            "admissible": [True, True, False, True],
            "v2": [0.3, 0.4, 0.5, 0.3],
        }
    )
    return SimpleNamespace(table=table, special_table=special)


def test_branch(tmp_path):
    ax = mi.plot_branch(diagram())
    solid = [line for line in ax.lines if line.get_label() == "stable orbit"]
    dashed = [line for line in ax.lines if line.get_label() == "unstable orbit"]
    assert len(solid) == len(dashed) == 1
    assert list(solid[0].get_xdata()) == [0.3, 0.2, 0.1]
    assert [text.get_text() for text in ax.texts] == ["CF", "G"]
    assert "inadmissible" not in {line.get_label() for line in ax.lines}
    ax.figure.savefig(tmp_path / "branch.png")


def test_branches_over_a_sweep_on_given_axes():
    sweep = pd.DataFrame({"amplitude": [0.1, 0.2], "v2": [0.3, 0.2]})
    ax = Figure().subplots()
    assert mi.plot_branch([diagram(), diagram()], sweep, ax) is ax
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels == ["brute force", "stable orbit", "unstable orbit"]
    assert len(ax.texts) == 2


def chart():
    table = pd.DataFrame(
        {
            "boundary": ["on", "on", "off", "off", "off"],
            "omega": [0.1, 0.3, 0.1, 0.2, 0.3],
            "amplitude": [2.0, 1.0, 1.5, 1.2, 0.9],
            "type": ["III", "I", "III", "III", "I"],
            "kind": ["fold", "grazing", "crisis", "crisis", "fold"],
        }
    )
    types = pd.DataFrame(
        {"type": ["III", "I"], "grazing": ["", ""], "omega from": [0.1, 0.2],
         "omega to": [0.2, 0.3], "on": ["", ""], "off": ["", ""]}
    )  # fmt: skip
    special = pd.DataFrame({"kind": ["grazing-fold"], "omega": [0.2], "amplitude": [1.2]})
    return SimpleNamespace(table=table, types=types, special_table=special)


def test_chart(tmp_path):
    ax = mi.plot_chart(chart())
    texts = [text.get_text() for text in ax.texts]
    assert texts[:2] == ["III", "I"]
    assert texts[2].startswith("grazing-fold")
    lines = {line.get_label(): line for line in ax.lines}
    assert lines["on"].get_linestyle() == "-"
    assert lines["off"].get_linestyle() != "-"
    assert list(lines["off, simulated (crisis)"].get_xdata()) == [0.1]
    assert ax.get_xlim() == pytest.approx((0.1, 0.3))
    ax.figure.savefig(tmp_path / "chart.png")


def test_orbit(tmp_path):
    orbit = mi.find_orbit(
        mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.24, omega=0.5), transient=300
    )
    ax = mi.plot_orbit(orbit)
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels == ["frame stuck", "frame slips", "impact"]
    ax.figure.savefig(tmp_path / "orbit.png")
