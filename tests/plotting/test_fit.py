"""Figures of fits on given axes."""

import pandas as pd
import pytest
from matplotlib.figure import Figure

import mems_impact as mi


@pytest.fixture(scope="module")
def found():
    thrown = mi.System(
        states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -p.g), parameters={"g": 9.8}
    )
    seen = pd.DataFrame({"t": [0.1, 0.2, 0.3], "x": [0.25, 0.41, 0.46], "v": [2.0, 1.1, 0.1]})
    return mi.fit(thrown, seen, free=["g", "x0.v"], options=mi.Options(engine="interpreted"))


def test_data_need_two_axes_a_column(found):
    axes = Figure().subplots(4)
    assert mi.plot_fit(found, axes) is axes[0]
    for upper, lower, name in zip(axes[::2], axes[1::2], ("x", "v"), strict=True):
        rows = found.residuals[found.residuals["quantity"] == name]
        drawn = {line.get_label(): line.get_ydata().tolist() for line in upper.lines}
        assert drawn == {"measured": [*rows["measured"]], "fitted": [*rows["computed"]]}
        assert lower.lines[0].get_ydata().tolist() == rows["in standard errors"].tolist()
    with pytest.raises(mi.InvalidParameter, match="two per recorded column"):
        mi.plot_fit(found, axes[:3])


def test_an_ellipse_about_the_estimates(found):
    ax = Figure().subplots()
    assert mi.plot_fit(found, ax, kind="ellipses") is ax
    x, y = ax.lines[0].get_data()
    size = 5.991**0.5 * found.parameters["standard error"]
    assert 0.5 * (x.max() - x.min()) == pytest.approx(size[0], rel=1e-3)
    assert 0.5 * (y.max() + y.min()) == pytest.approx(found.values["x0.v"], rel=1e-3)
