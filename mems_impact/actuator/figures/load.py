"""Mean speed over a load."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from mems_impact.plotting.labels import label_axis, label_of, prefixed
from mems_impact.plotting.placing import legend_above
from mems_impact.plotting.style import color, new_figure, styled, thickness

if TYPE_CHECKING:
    from mems_impact.actuator.design.load import LoadCurve

__all__ = ["plot_load"]

LINES = {
    "sliding_load": ("every slip ends", (0, (4, 3))),
    "walking_load": ("walks", (0, (4, 1.2, 1, 1.2))),
    "holding_load": ("holds without voltage", (0, (1, 1.5))),
}


@styled
def plot_load(curve: LoadCurve, ax: Any = None) -> Any:
    """Draw the mean speed over the load: orbits filled, runs hollow, crosses where it runs away.

    Parameters
    ----------
    curve : LoadCurve
    ax : matplotlib Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    See Also
    --------
    load_curve, LoadCurve

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> curve = mi.load_curve(actuator, drive, [0, 5, 10], transient=60, periods=10)
    >>> mi.plot_load(curve).figure.savefig("load.png")
    """
    if ax is None:
        ax = new_figure(1.25).subplots()
    table = curve.table
    motion, guide = color("motion"), color("guide")
    ax.plot(table["load"], table["mean speed"], color=motion, linewidth=thickness(0.8), zorder=2)
    for by, filled in (("orbit", "full"), ("run", "none")):
        rows = table[(table["by"] == by) & table["mean speed"].notna()]
        if len(rows):
            ax.plot(
                rows["load"], rows["mean speed"], linestyle="none", marker="o",
                color=motion, fillstyle=filled, label=by, zorder=3,
            )  # fmt: skip
    away = table.loc[table["does"] == "runs away", "load"]
    if len(away):
        ax.plot(
            away, [0.0] * len(away), linestyle="none", marker="x", markersize=4.5, color=guide,
            label="runs away", zorder=3,
        )  # fmt: skip
    label = label_of(table, "load")
    for name, (words, dashes) in LINES.items():
        value = getattr(curve, name)
        if math.isfinite(value):
            power, unit = prefixed(label.unit, abs(value))
            told = f"{words} up to {value / 10.0**power:.4g} {unit}".rstrip()
            ax.axvline(
                value, color=guide, linewidth=thickness(0.8), linestyle=dashes, zorder=1, label=told
            )
    ax.axhline(0.0, color=guide, linewidth=0.6, zorder=0)
    label_axis(ax.xaxis, label)
    label_axis(ax.yaxis, label_of(table, "mean speed"))
    legend_above(ax)
    return ax
