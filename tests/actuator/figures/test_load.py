"""Mean speed over the load."""

import numpy as np
import pytest

import mems_impact as mi
from tests.plotting.test_print import load


def test_a_speed_that_was_not_computed_is_no_point():
    ax = mi.plot_load(load())
    points = np.concatenate([line.get_xydata() for line in ax.lines if line.get_marker() != "None"])
    assert sorted(points[:, 0]) == [-2e-5, 0.0, 1e-5, 2e-5]
    # The device runs away at the last load alone, halfway from the one before.
    (shade,) = ax.patches
    left, right = shade.get_x(), shade.get_x() + shade.get_width()
    assert left == pytest.approx(2.5e-5)
    assert right >= ax.get_xlim()[1] - 1e-12
    legend = [text.get_text() for text in ax.get_legend().get_texts()]
    assert legend == ["orbit", "run", "runs away"]


def test_limits_are_labelled_on_their_lines():
    found = load()
    ax = mi.plot_load(found)
    ax.figure.draw_without_rendering()
    places = {text.get_text(): text.get_window_extent() for text in ax.texts}
    lines = {
        "every slip ends up to 27.8 µN": found.sliding_load,
        "walks up to 19.3 µN": found.walking_load,
        "holds without voltage up to 41.2 µN": found.holding_load,
    }
    assert set(places) == set(lines)
    for text, value in lines.items():
        x = ax.transData.transform((value, 0.0))[0]
        box = places[text]
        assert min(abs(box.x0 - x), abs(box.x1 - x)) < 0.02 * ax.bbox.width
        assert not box.x0 < x < box.x1
