"""Branches of any system, and curves of their special points."""

from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

import mems_impact as mi
from mems_impact.plotting.labels import Mark, label_points
from tests.analysis.systems import oscillator


def test_a_label_stays_at_a_marker_within_a_cloud_of_dots():
    random, distances = np.random.default_rng(0), []
    cloud = random.uniform(0.42, 0.58, (2, 900))
    for marker, style in ((",", "None"), ("", "-")):
        ax = Figure().subplots()
        ax.set(xlim=(0.0, 1.0), ylim=(0.0, 1.0))
        ax.plot(*cloud, marker=marker, linestyle=style)
        (label,) = label_points(ax, [Mark("PD", 0.5, 0.5)])
        distances.append(np.hypot(*label.get_position()))
    assert distances[0] < 20.0 < 30.0 < distances[1]  # points


def diagram():
    table = pd.DataFrame(
        {
            "amplitude": [0.3, 0.2, 0.1, 0.2, 0.3],
            "stable": [True, True, False, False, False],
            "admissible": [True, True, True, True, False],
            "piece": [0, 0, 0, 1, 1],
            "impact speed": [0.4, 0.2, 0.0, 0.1, 0.2],
            "v2": [0.1, 0.2, 0.3, 0.4, 0.5],
            "v2 2": [0.0, 0.1, 0.3, float("nan"), float("nan")],
        }
    )
    table.attrs = {"states": ["v2"], "section": ["x2", 0.0], "symbols": {"amplitude": "$f$"}}
    special = pd.DataFrame(
        {
            "label": ["CF", "G", "PD", "break-away"],
            "criticality": ["", "", "supercritical", ""],
            "kind": ["fold", "grazing", "period-doubling", "break-away"],
            "amplitude": [0.1, 0.2, 0.3, 0.15],
            "admissible": [True, True, False, True],
            "impact speed": [0.0, 0.1, 0.2, 0.1],
            "v2": [0.3, 0.4, 0.5, 0.3],
        }
    )
    return SimpleNamespace(table=table, special_table=special)


def lines(ax, label):
    return [line for line in ax.lines if line.get_label() == label]


def test_lines_and_labels(tmp_path):
    ax = mi.plot_branch(diagram())
    (solid,), (_,) = lines(ax, "stable orbit"), lines(ax, "unstable orbit")
    assert list(solid.get_xdata()) == [0.3, 0.2, 0.1]
    # What is named after a guard has its name.
    assert [text.get_text() for text in ax.texts] == ["CF", "G", "break-away"]
    assert "inadmissible" not in {line.get_label() for line in ax.lines}
    assert ax.get_xlabel() == "amplitude $f$"
    assert ax.get_ylabel() == "$v_2$ at $x_2 = 0$"
    ax.figure.savefig(tmp_path / "branch.png")


def test_branches_over_a_sweep_on_given_axes():
    sweep = pd.DataFrame({"amplitude": [0.1, 0.2], "v2": [0.3, 0.2]})
    ax = Figure().subplots()
    assert mi.plot_branch([diagram(), diagram()], sweep, ax) is ax
    labels = [text.get_text() for text in ax.get_legend().get_texts()]
    assert labels == ["brute force", "stable orbit", "unstable orbit"]
    assert len(ax.texts) == 3


def test_another_quantity():
    ax = mi.plot_branch(diagram(), quantity="impact speed")
    assert ax.get_ylabel() == "impact speed"
    assert list(lines(ax, "stable orbit")[0].get_ydata()) == [0.4, 0.2, 0.0]
    with pytest.raises(mi.InvalidParameter, match="one of impact speed, v2"):
        mi.plot_branch(diagram(), quantity="x1")


def test_branches_and_sweep_must_be_over_one_parameter():
    sweep = pd.DataFrame({"omega": [0.1, 0.2], "v2": [0.3, 0.2]})
    with pytest.raises(mi.InvalidParameter, match="amplitude, omega"):
        mi.plot_branch(diagram(), sweep)
    with pytest.raises(mi.InvalidParameter, match="one of the sweep's amplitude, v2"):
        mi.plot_branch(diagram(), sweep.rename(columns={"omega": "amplitude"}),
                       quantity="impact speed")  # fmt: skip
    with pytest.raises(mi.InvalidParameter, match="a Branch"):
        mi.plot_branch(sweep)


@pytest.mark.slow
def test_own_system_over_its_sweep(branch, tmp_path):
    sweep = mi.sweep(oscillator(), "A", np.linspace(0.36, 0.58, 5), transient=60, periods=4)
    ax = mi.plot_branch(branch, sweep)
    assert ax.get_xlabel() == "$A$"
    assert ax.get_ylabel() == "$x$ where periods begin"
    assert [text.get_text() for text in ax.texts] == ["PD", "G"]
    assert lines(ax, "stable orbit")
    assert lines(ax, "unstable orbit")
    values = lines(ax, "stable orbit")[0].get_xydata()
    assert values[0] == pytest.approx([0.6, branch.table["x"][0]])
    ax.figure.savefig(tmp_path / "branch.png")


def test_markers_of_points_that_coincide_stand_side_by_side():
    found = diagram()
    rows = found.special_table.iloc[[1]]
    found.special_table = pd.concat([rows, rows.assign(label="PD"), rows.assign(label="CF")])
    ax = mi.plot_branch(found)
    ax.figure.draw_without_rendering()
    markers = [line for line in ax.lines if line.get_marker() in ("o", "^", "s")]
    assert {tuple(line.get_xydata()[0]) for line in markers} == {(0.2, 0.4)}
    seen = [line.get_transform().transform(line.get_xydata())[0] for line in markers]
    diameter = markers[0].get_markersize() * ax.figure.dpi / 72.0
    apart = [np.hypot(*(a - b)) for a, b in combinations(seen, 2)]
    assert len(apart) == 3
    assert diameter < min(apart) <= max(apart) < 2.0 * diameter
    # Their middle is where they are.
    here = ax.transData.transform((0.2, 0.4))
    assert np.mean(seen, axis=0) == pytest.approx(here, abs=0.1)


def test_dashes_have_no_rim_over_dots():
    sweep = pd.DataFrame({"amplitude": [0.1, 0.2], "v2": [0.3, 0.2]})
    ax = mi.plot_branch(diagram(), sweep)
    assert all(not line.get_path_effects() for line in ax.lines if line.is_dashed())
    assert any(line.is_dashed() for line in ax.lines)


def test_a_branch_without_special_points(orbit):
    ax = mi.plot_branch(mi.continue_solution(orbit, "A", 0.62))
    assert len(ax.texts) == 0
    assert lines(ax, "stable orbit")


def curve(kind, values, admissible, points):
    table = pd.DataFrame({"omega": [0.1, 0.2, 0.3, 0.4], "A": values, "admissible": admissible})
    return SimpleNamespace(
        kind=kind, table=table, special_table=pd.DataFrame(points, columns=["kind", "omega", "A"])
    )


def test_inadmissible_parts_and_points_in_common(tmp_path):
    cusp = ("cusp", 0.3, 0.7)
    ax = mi.plot_curve(
        [
            curve("fold", [1.0, 0.9, 0.7, 0.4], [True, True, False, False], [cusp]),
            curve("touching", [0.2, 0.4, 0.7, 0.9], [True] * 4, [cusp, ("fold-flip", 0.1, 0.2)]),
        ]
    )
    (dotted,) = lines(ax, "inadmissible")
    assert list(dotted.get_ydata()[1:]) == [0.9, 0.7, 0.4]
    assert list(lines(ax, "fold")[0].get_ydata()[:2]) == [1.0, 0.9]
    assert [text.get_text() for text in ax.texts] == ["cusp", "fold-flip"]
    legend = [text.get_text() for text in ax.get_legend().get_texts()]
    assert legend == ["fold", "inadmissible", "touching"]
    ax.figure.savefig(tmp_path / "curve.png")


def test_curves_over_the_parameters_in_either_order():
    one = curve("fold", [1.0, 0.9, 0.7, 0.4], [True] * 4, [("fold-flip", 0.1, 1.0)])
    other = curve("period-doubling", [1.0, 0.8, 0.6, 0.5], [True] * 4, [("fold-flip", 0.1, 1.0)])
    other.table = other.table[["A", "omega", "admissible"]]
    ax = mi.plot_curve([one, other])
    (line,) = lines(ax, "period-doubling")
    assert list(line.get_ydata()) == [1.0, 0.8, 0.6, 0.5]
    assert [text.get_text() for text in ax.texts] == ["fold-flip"]


def test_what_is_no_curve(branch):
    with pytest.raises(mi.InvalidParameter, match="a Curve"):
        mi.plot_curve(branch)
    one = curve("fold", [1.0, 0.9, 0.7, 0.4], [True] * 4, [])
    other = curve("fold", [1.0, 0.9, 0.7, 0.4], [True] * 4, [])
    other.table = other.table.rename(columns={"A": "e"})
    with pytest.raises(mi.InvalidParameter, match="omega, A, as of the first"):
        mi.plot_curve([one, other])


@pytest.mark.slow
def test_the_mark_of_a_subcritical_point_is_open():
    found = diagram()
    rows = found.special_table.iloc[[1]].assign(label="PD")
    faces = {}
    for criticality in ("supercritical", "subcritical"):
        found.special_table = rows.assign(criticality=criticality)
        ax = mi.plot_branch(found)
        (mark,) = (line for line in ax.lines if line.get_marker() == "^")
        faces[criticality] = mark.get_markerfacecolor()
    assert faces["subcritical"] == "white" != faces["supercritical"]
