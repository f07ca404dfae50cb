"""The operating chart."""

from types import SimpleNamespace

import pandas as pd
import pytest

import mems_impact as mi


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
