"""Scatter: how quantities are spread, what of it is as specified, and what it is due to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from mems_impact.errors import InvalidParameter
from mems_impact.plotting.labels import Label, label_axis, symbol
from mems_impact.plotting.style import color, inches, new_figure, styled
from mems_impact.studies.spread import Spread
from mems_impact.studies.stored_study import StoredStudy

__all__ = ["plot_scatter"]

OUTSIDE = "0.85"  # what is out of specification
PALE = "#72b2dd"  # a blue on which lines are seen
MOST = 4  # quantities that are shown where nobody says which


@styled
def plot_scatter(
    scatter: Spread | StoredStudy,
    *,
    quantity: str | Sequence[str] | None = None,
    ax: Any = None,
) -> Any:
    """Draw how quantities are spread, with their specification, and Sobol's indices beside them.

    A panel a quantity: a histogram, blue where it is as specified, grey and hatched where it is
    not, dashed lines at the bounds and a line at the median, and the yield. Where indices were
    asked for, a panel below has a bar for each of what was drawn: the index of first order,
    filled, within the total index, open; lines are their intervals.

    Parameters
    ----------
    scatter : Scatter or StoredStudy
        The store of one, be it still running, tells neither specification nor indices.
    quantity : str or sequence of str, optional
        Columns of the table; what is specified by default, or the first that vary.
    ax : matplotlib Axes, optional
        Where to draw the histogram of one quantity; a new figure of a column's width by default.

    Returns
    -------
    Axes
        The uppermost; ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If `scatter` is none, or has no such quantity.

    See Also
    --------
    scatter, Scatter, plot_sensitivity

    Examples
    --------
    >>> from scipy import stats
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> found = mi.scatter(
    ...     actuator, mi.Sine(amplitude=0.24, omega=0.5), over={"e": stats.norm(0.8, 0.02)},
    ...     specification={"displacement per period": (1e-4, None)}, samples=16,
    ...     initial=mi.kicked(actuator),
    ... )
    >>> mi.plot_scatter(found, quantity="displacement per period").figure.savefig("scatter.png")
    """
    if isinstance(scatter, StoredStudy) and scatter.kind == "scatter":
        scatter = Spread(drawn=tuple(scatter.attrs["drawn"]), table=scatter.table)
    if isinstance(scatter, StoredStudy) or not hasattr(scatter, "yields"):
        allowed = "a Scatter, as mems_impact.scatter returns it, or its store"
        raise InvalidParameter("scatter", type(scatter).__name__, allowed)
    shown = _shown(scatter, quantity)
    if ax is not None:
        _histogram(ax, scatter, shown[0])
        return ax
    rows = [kind for _ in shown for kind in _panels(scatter)]
    bars = 2.6 + len(scatter.points.attrs.get("drawn", ()))
    figure = new_figure(0.8 * len(shown), bars * rows.count("indices"))
    ratios = [inches(0.8) if kind == "spread" else inches(0.0, bars) for kind in rows]
    panels = figure.subplots(len(rows), squeeze=False, gridspec_kw={"height_ratios": ratios})[:, 0]
    for i, panel in enumerate(panels):
        name = shown[i // len(_panels(scatter))]
        if rows[i] == "spread":
            _histogram(panel, scatter, name)
        else:
            _bars(panel, scatter, name)
    return panels[0]


def _panels(scatter: Spread) -> tuple[str, ...]:
    return ("spread",) if scatter.indices is None else ("spread", "indices")


def _shown(scatter: Spread, quantity: str | Sequence[str] | None) -> list[str]:
    """Return the quantities to draw."""
    known = [*scatter.quantities, *(n for n in scatter.specification if n in scatter.points)]
    if quantity is not None:
        names = [quantity] if isinstance(quantity, str) else list(quantity)
        for name in names:
            if name not in known:
                raise InvalidParameter("quantity", name, f"one of {', '.join(known)}")
        return names
    spreads = scatter.points[scatter.quantities].agg(np.ptp)
    size = scatter.points[scatter.quantities].abs().max()
    varying = [name for name in scatter.quantities if spreads[name] > 1e-9 * size[name]]
    return list(scatter.specification) or varying[:MOST] or scatter.quantities[:1]


def _histogram(ax: Any, scatter: Spread, name: str) -> None:
    """Draw how a quantity is spread."""
    points = scatter.points
    values = points[name].dropna().to_numpy()
    low, high = scatter.specification.get(name, (-math.inf, math.inf))
    ends = _ends(values, low, high)
    count = int(np.clip(2.0 * len(values) ** (1.0 / 3.0), 8, 40))
    bins = np.linspace(*ends, count + 1)
    fine = (values >= low) & (values <= high)
    _, _, (_, outside) = ax.hist(
        [values[fine], values[~fine]], bins, color=[color("motion"), OUTSIDE], stacked=True
    )
    for bar in outside:
        bar.set(hatch="////", edgecolor="0.5", linewidth=0.0)
    for bound in (low, high):
        if math.isfinite(bound):
            ax.axvline(bound, color="black", linewidth=0.9, linestyle=(0, (4, 2)))
    if len(values):
        ax.axvline(float(np.median(values)), color="black", linewidth=1.0)
    if name in scatter.specification:
        row = scatter.yields.set_index("quantity").loc[name]
        ax.set_title(
            f"{row['share']:.1%} as specified ({row['low']:.1%} to {row['high']:.1%})",
        )  # fmt: skip
    ax.set_xlim(ends)
    unit = points.attrs.get("units", {}).get(name, "")
    label_axis(ax.xaxis, Label(name, unit))
    label_axis(ax.yaxis, Label("points"))
    ax.yaxis.get_major_locator().set_params(integer=True)


def _ends(values: Any, low: float, high: float) -> tuple[float, float]:
    """Return the ends of the axis: all values, and bounds that lie near them."""
    if not len(values):
        return 0.0, 1.0
    first, last = float(values.min()), float(values.max())
    width = last - first
    first = low if first - width < low < first else first
    last = high if last < high < last + width else last
    margin = 0.04 * (last - first) or 0.5 * abs(first) or 0.5
    return first - margin, last + margin


def _bars(ax: Any, scatter: Spread, name: str) -> None:
    """Draw indices of one quantity."""
    assert scatter.indices is not None
    table = scatter.indices
    rows = table[table["quantity"] == name]
    symbols = table.attrs.get("symbols", {})
    places = np.arange(len(rows))[::-1]
    style, guide = {"capsize": 0.0, "elinewidth": 1.0}, color("guide")
    for what, face, edge, shift in (
        ("total", "none", guide, 0.13),
        ("first", PALE, PALE, -0.13),
    ):
        middle = rows[what].to_numpy()
        ax.barh(places, middle, height=0.62, color=face, edgecolor=edge, linewidth=0.9)
        reach = np.stack([middle - rows[f"{what} low"], rows[f"{what} high"] - middle])
        ax.errorbar(
            middle, places + shift, xerr=np.maximum(reach, 0.0), fmt="none",
            ecolor="black" if what == "first" else guide, **style,
        )  # fmt: skip
    if rows["missing"].any():
        ax.text(0.5, 0.5, f"{rows['missing'].iloc[0]} points have no number", fontsize="small",
                ha="center", va="center", transform=ax.transAxes)  # fmt: skip
    ax.set_yticks(places, [symbol(each, symbols) for each in rows["parameter"]])
    ax.set_xlim(min(0.0, *ax.get_xlim()), max(1.0, ax.get_xlim()[1]))
    label_axis(ax.xaxis, Label("first-order (filled) and total index"))
