"""Figures of fits."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np

from mems_impact.errors import InvalidParameter
from mems_impact.plotting.labels import Label, label_axis, legend_above, letter_panels, symbol
from mems_impact.plotting.style import Axes, color, given_axes, new_figure, styled
from mems_impact.studies.fit import Fit
from mems_impact.systems.result import check_kind

MAX_PANELS = 6  # of recorded columns
MAX_ELLIPSES = 5  # free quantities
QUANTILE = 5.991  # of chi-square with two degrees of freedom, at 95 %


@styled
def plot_fit(fit: Fit, ax: Any = None, *, kind: Literal["data", "ellipses"] = "data") -> Axes:
    """Draw a fit: data over the fitted motion with residuals, or confidence ellipses.

    Parameters
    ----------
    fit : Fit
    ax : matplotlib Axes or sequence of these, optional
        Axes to draw on: of data two per recorded column, of ellipses one for the first two
        quantities; a new figure by default.
    kind : {"data", "ellipses"}, optional
        Data and residuals in standard errors of at most six recorded columns; or for each pair of
        at most five free quantities the region of 95 % probability, of normal errors.

    Returns
    -------
    Axes
        The uppermost; ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If an argument is wrong.

    See Also
    --------
    fit, Fit

    Examples
    --------
    >>> import pandas as pd
    >>> import mems_impact as mi
    >>> ball = mi.System(
    ...     states=("x", "v"), flow=lambda mode, t, y, p: (y.v, -p.g), parameters={"g": 9.8},
    ... )
    >>> seen = pd.DataFrame({"t": [0.1, 0.2, 0.3], "x": [0.25, 0.41, 0.46]})
    >>> found = mi.fit(ball, seen, free=["x0.v"])
    >>> mi.plot_fit(found).figure.savefig("fit.png")
    """
    check_kind(fit, "fit", Fit, "a Fit, as mems_impact.fit returns it")
    if kind not in ("data", "ellipses"):
        raise InvalidParameter("kind", kind, "'data' or 'ellipses'")
    return _ellipses(fit, ax) if kind == "ellipses" else _data(fit, ax)


def _data(fit: Fit, ax: Any) -> Any:
    groups = list(fit.residuals.groupby(["record", "quantity"], sort=False))[:MAX_PANELS]
    if ax is None:
        figure = new_figure(0.75 * len(groups), 3.0)
        ratios = {"height_ratios": [2.0, 1.0] * len(groups)}
        panels = list(figure.subplots(2 * len(groups), gridspec_kw=ratios))
        letter_panels(panels)
    else:
        panels = given_axes(ax, 2 * len(groups), "two per recorded column")
    for i, ((record, quantity), rows) in enumerate(groups):
        upper, lower = panels[2 * i], panels[2 * i + 1]
        numbers = np.arange(1, len(rows) + 1)
        x, label = rows["t"].to_numpy(), Label("t", fit.units["t"])
        if not np.isfinite(x).all():
            x, label = numbers, Label("datum")
        if quantity == "t":
            text = Label(f"event of record {record}" if record else "event")
            upper.plot(
                rows["measured"], numbers, "|", color=color("guide"), markersize=9,
                label="measured",
            )  # fmt: skip
            upper.plot(rows["computed"], numbers, ".", color=color("motion"), label="fitted")
            upper.margins(y=0.15)
        else:
            name = f"{symbol(quantity)}{f' of {record}' if record else ''}"
            text = Label(name, fit.units.get(quantity, ""))
            upper.plot(x, rows["measured"], ".", color=color("guide"), label="measured", zorder=2)
            upper.plot(x, rows["computed"], color=color("motion"), label="fitted", zorder=3)
        label_axis(upper.yaxis, text)
        upper.tick_params(labelbottom=False)
        lower.sharex(upper)
        lower.axhspan(-2.0, 2.0, color=color("guide"), alpha=0.15, linewidth=0.0)
        lower.plot(x, rows["in standard errors"], ".", color=color("motion"))
        lower.axhline(0.0, color=color("guide"), linewidth=0.6)
        label_axis(lower.yaxis, Label("residual /\nstandard error"))
        label_axis(lower.xaxis, label)
    legend_above(panels[0])
    return panels[0]


def _ellipses(fit: Fit, ax: Any) -> Any:
    finite = np.isfinite(np.diag(fit.covariance))
    names = [name for name, known in zip(fit.covariance.index, finite, strict=True) if known]
    names = names[:MAX_ELLIPSES]
    if len(names) < 2:
        problem = f"determines {len(names)} free quantities, must determine two for an ellipse"
        raise InvalidParameter("fit", None, "", problem=problem)
    count = len(names) - 1
    if ax is not None:
        _ellipse(ax, fit, names[0], names[1])
        return ax
    figure = new_figure(0.8 * count)
    panels = figure.subplots(count, count, squeeze=False)
    for row in range(count):
        for column in range(count):
            panel = panels[row, column]
            if column > row:
                panel.set_visible(False)
                continue
            _ellipse(panel, fit, names[column], names[row + 1])
            if row < count - 1:
                panel.set_xlabel("")
                panel.tick_params(labelbottom=False)
            if column > 0:
                panel.set_ylabel("")
                panel.tick_params(labelleft=False)
    return panels[0, 0]


def _ellipse(ax: Any, fit: Fit, first: str, second: str) -> None:
    """Draw the region of 95 % probability of two quantities."""
    block = fit.covariance.loc[[first, second], [first, second]].to_numpy()
    center = np.array([fit.values[first], fit.values[second]])
    sizes = np.sqrt(np.diag(block))
    angle = np.linspace(0.0, 2.0 * np.pi, 200)
    correlation = block[0, 1] / sizes.prod()
    root = np.sqrt(QUANTILE)
    x = np.cos(angle)
    y = correlation * x + np.sqrt(max(0.0, 1.0 - correlation**2)) * np.sin(angle)
    curve = center + root * sizes * np.stack([x, y], axis=1)
    ax.fill(*curve.T, color=color("motion"), alpha=0.2, linewidth=0.0)
    ax.plot(*curve.T, color=color("motion"))
    ax.plot(*center, "+", color=color("guide"))
    ax.locator_params(axis="x", nbins=2)
    ax.locator_params(axis="y", nbins=3)
    for axis, name in ((ax.xaxis, first), (ax.yaxis, second)):
        label_axis(axis, Label(symbol(name), fit.units.get(name, "")))
