"""Mean speed over the load."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import mems_impact as mi
from tests.plotting.test_print import load


def test_a_speed_that_was_not_computed_is_no_point():
    ax = mi.plot_force_curve(load())
    points = np.concatenate([line.get_xydata() for line in ax.lines if line.get_marker() != "None"])
    assert sorted(points[:, 0]) == [-2e-5, 0.0, 1e-5, 2e-5]
    # The device runs away at the last load, beyond the stall force.
    (shade,) = ax.patches
    left, right = shade.get_x(), shade.get_x() + shade.get_width()
    assert left == pytest.approx(2.4e-5)
    assert right >= ax.get_xlim()[1] - 1e-12
    legend = [text.get_text() for text in ax.get_legend().get_texts()]
    assert legend == ["computed", "runs away"]


def narrow():
    """Return a load curve with two limits that are near each other, and one on the curve."""
    speeds = [40e-9, 31.2e-9, 25.5e-9, 21.6e-9, 18.8e-9, np.nan]
    table = pd.DataFrame({
        "load": [0.0, 1e-5, 2e-5, 3e-5, 4e-5, 4.8e-5], "mean speed": speeds,
        "does": ["walks"] * 5 + ["runs away"]})  # fmt: skip
    table.attrs = load().table.attrs
    return SimpleNamespace(
        table=table, sliding_force=3.331e-5, stall_force=4.667e-5, holding_force=4.935e-5
    )


@pytest.mark.quick(1)
@pytest.mark.parametrize(
    ("found", "sliding", "walking", "holding"),
    [(load(), "27.8", "24", "41.2"), (narrow(), "33.31", "46.67", "49.35")],
    ids=["apart", "narrow"],
)
def test_limits_are_labelled_on_their_lines(found, sliding, walking, holding):
    ax = mi.plot_force_curve(found)
    ax.figure.draw_without_rendering()
    places = {text.get_text().replace("\n", " "): text.get_window_extent() for text in ax.texts}
    lines = {
        f"every slip ends up to {sliding} µN": found.sliding_force,
        f"walks up to {walking} µN": found.stall_force,
        f"holds without voltage up to {holding} µN": found.holding_force,
    }
    assert set(places) == set(lines)
    table = found.table.dropna()
    loads = np.linspace(table["load"].min(), table["load"].max(), 500)
    speeds = np.interp(loads, table["load"], table["mean speed"])
    curve = ax.transData.transform(np.column_stack([loads, speeds]))
    for text, value in lines.items():
        x = ax.transData.transform((value, 0.0))[0]
        box = places[text]
        assert min(abs(box.x0 - x), abs(box.x1 - x)) < 0.02 * ax.bbox.width
        assert ax.bbox.y0 <= box.y0 < box.y1 <= ax.bbox.y1
        for other in lines.values():
            assert not box.x0 < ax.transData.transform((other, 0.0))[0] < box.x1
        assert not any(box.contains(*point) for point in curve)


def test_a_limit_far_beyond_the_loads_is_told_below():
    found = load()
    found.holding_force = 9e-5
    ax = mi.plot_force_curve(found)
    assert "holds without voltage up to 90 µN" in ax.get_xlabel()
    assert len(ax.texts) == 2
