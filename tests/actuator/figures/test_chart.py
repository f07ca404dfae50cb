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
    names = ("omega", "amplitude")
    return SimpleNamespace(parameters=names, table=table, types=types, special_table=special)


@pytest.mark.slow
def test_chart(tmp_path):
    ax = mi.plot_chart(chart())
    texts = [text.get_text() for text in ax.texts]
    assert texts[:2] == ["III", "I"]
    assert texts[2].startswith("grazing-fold")
    lines = {line.get_label(): line for line in ax.lines}
    assert lines["on"].get_linestyle() == "-"
    assert lines["off"].get_linestyle() != "-"
    # Where they run together, one is seen on either side of the other.
    assert lines["off"].get_zorder() > lines["on"].get_zorder()
    assert lines["on"].get_linewidth() > 1.5 * lines["off"].get_linewidth()
    assert (ax.get_xlabel().splitlines()[0], ax.get_ylabel()) == (r"$\omega$", "amplitude")
    assert list(lines["off, simulated (crisis)"].get_xdata()) == [0.1]
    assert ax.get_xlim() == pytest.approx((0.1, 0.3))
    ax.figure.savefig(tmp_path / "chart.png")


@pytest.mark.slow
def test_an_inset_magnifies_close_points_and_covers_no_axis(tmp_path):
    # As in the tutorial: on and off part at the right alone, and the line runs below.
    found = chart()
    omega = [0.475, 0.48, 0.485, 0.488, 0.491, 0.498, 0.505]
    on = [0.186, 0.177, 0.172, 0.171, 0.174, 0.21, 0.283]
    off = [0.1859, 0.1769, 0.172, 0.171, 0.1718, 0.176, 0.18]
    found.table = pd.concat(
        pd.DataFrame({"boundary": name, "omega": omega, "amplitude": values, "type": "I",
                      "kind": "fold"}) for name, values in (("on", on), ("off", off))
    )  # fmt: skip
    found.types = found.types.assign(**{"omega from": [0.475, 0.488], "omega to": [0.488, 0.505]})
    found.special_table = found.special_table.assign(omega=0.488, amplitude=0.171)
    ax = mi.plot_chart(found)
    ax.figure.savefig(tmp_path / "chart.png")
    (inset,) = ax.child_axes
    assert inset.get_title(loc="left") == r"on − off [$10^{-3}$]"
    assert inset.lines[0].get_ydata().max() == pytest.approx(0.0022)
    box = inset.get_tightbbox()
    assert box.x0 > ax.bbox.x0
    assert box.y1 < ax.bbox.y1


def test_points_that_no_curve_joins_are_marked():
    dense = [0.1 + 0.005 * i for i in range(21)]
    omega = [*dense, 0.25, 0.3]
    found = chart()
    found.table = pd.concat(
        pd.DataFrame({"boundary": name, "omega": omega, "amplitude": level, "kind": "fold"})
        for name, level in (("slip", 1.0), ("on", 2.0))
    )
    found.types = found.types.iloc[:0]
    found.special_table = found.special_table.iloc[:0]
    dots = [line for line in mi.plot_chart(found).lines if line.get_marker() == "o"]
    for line, level in zip(dots, (2.0, 1.0), strict=True):
        assert line.get_xdata() == pytest.approx([0.2, 0.25, 0.3])
        assert set(line.get_ydata()) == {level}


def test_a_boundary_that_is_not_computed_has_no_entry_in_the_legend():
    found = chart()
    found.table = found.table[found.table["boundary"] == "on"]
    labels = {line.get_label() for line in mi.plot_chart(found).lines}
    assert "on" in labels
    assert "off" not in labels
