"""Mean speed over a load."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from mems_impact.plotting.style import BLUE, GREEN, GREY, ORANGE, new_figure, tidy
from mems_impact.tables.common import heading

if TYPE_CHECKING:
    from mems_impact.actuator.design.load import LoadCurve

__all__ = ["plot_load"]

LINES = {
    "sliding_load": ("every slip ends", GREEN),
    "walking_load": ("walks", BLUE),
    "holding_load": ("holds without voltage", GREY),
}


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
        ax = new_figure(6.4, 4.0).subplots()
    table = curve.table
    ax.plot(table["load"], table["mean speed"], color=BLUE, linewidth=1.2, zorder=2)
    for by, filled in (("orbit", "full"), ("run", "none")):
        rows = table[(table["by"] == by) & table["mean speed"].notna()]
        if len(rows):
            ax.plot(
                rows["load"], rows["mean speed"], linestyle="none", marker="o", markersize=5,
                color=BLUE, fillstyle=filled, label=by, zorder=3,
            )  # fmt: skip
    away = table.loc[table["does"] == "runs away", "load"]
    if len(away):
        ax.plot(
            away, [0.0] * len(away), linestyle="none", marker="x", markersize=6, color=ORANGE,
            label="runs away", zorder=3,
        )  # fmt: skip
    for name, (words, color) in LINES.items():
        value = getattr(curve, name)
        if math.isfinite(value):
            ax.axvline(
                value, color=color, linewidth=1.0, linestyle=(0, (4, 3)), zorder=1,
                label=f"{words} up to {value:.4g}",
            )  # fmt: skip
    ax.axhline(0.0, color=GREY, linewidth=0.8, zorder=0)
    ax.set_xlabel(heading(table, "load"))
    ax.set_ylabel(heading(table, "mean speed"))
    ax.legend(frameon=False, loc="lower left")
    tidy(ax)
    return ax
