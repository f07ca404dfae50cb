"""Mean speed over load."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from mems_impact.plotting.labels import (
    amount,
    label_axis,
    label_of,
    label_verticals,
    legend_above,
)
from mems_impact.plotting.style import Axes, color, new_figure, styled, thickness

if TYPE_CHECKING:
    from mems_impact.actuator.design.force_curve import ForceCurve


AWAY = "runs away"
LOAD_LINES = {
    "sliding_force": ("every slip ends", (0, (4, 3))),
    "stall_force": ("walks", (0, (4, 1.2, 1, 1.2))),
    "holding_force": ("holds without voltage", (0, (1, 1.5))),
}
FARTHEST = 1.5  # a limit is drawn up to here, relative to the largest load


@styled
def plot_force_curve(curve: ForceCurve, ax: Any = None) -> Axes:
    """Draw the mean speed over the load.

    Markers are the computed loads. Loads at which the frame runs away, so that it has no mean
    speed, are shaded. Vertical lines are the limits of the curve; limits far beyond the loads are
    below the axis.

    Parameters
    ----------
    curve : ForceCurve
    ax : matplotlib Axes, optional
        Axes to draw on; a new figure by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    See Also
    --------
    force_curve, ForceCurve

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> curve = mi.force_curve(actuator, drive, [0, 5, 10], transient=60, periods=10)
    >>> mi.plot_force_curve(curve).figure.savefig("load.png")
    """
    if ax is None:
        ax = new_figure(1.25).subplots()
    table = curve.table
    motion, guide = color("motion"), color("guide")
    known = table[table["mean speed"].notna()]
    ax.plot(
        known["load"], known["mean speed"], color=motion, linewidth=thickness(0.8), marker="o",
        label="computed", zorder=3,
    )  # fmt: skip
    ax.margins(x=0.08)  # room for the label of the last limit
    label, largest = label_of(table, "load"), float(table["load"].abs().max())
    limits, beyond = [], []
    for name, (title, dashes) in LOAD_LINES.items():
        value = getattr(curve, name)
        if math.isfinite(value):
            words = f"{title}\nup to {amount(value, label.unit, 4)}"
            if abs(value) > FARTHEST * largest:
                beyond.append(words.replace("\n", " "))
                continue
            limits.append((value, words))
            ax.axvline(value, color=guide, linewidth=thickness(0.8), linestyle=dashes, zorder=1)
    ax.axhline(0.0, color=guide, linewidth=0.6, zorder=0)
    ax.autoscale_view(scaley=False)
    _shade_runaway(ax, table, curve.stall_force)
    label_axis(ax.xaxis, label._replace(suffix="".join(f"\n{words}" for words in beyond)))
    label_axis(ax.yaxis, label_of(table, "mean speed"))
    legend_above(ax)
    label_verticals(ax, limits)
    return ax


def _shade_runaway(ax: Any, table: pd.DataFrame, stall: float) -> None:
    """Shade the loads at which the device runs away: from the stall force, or halfway."""
    loads, away = table["load"].to_numpy(), (table["does"] == AWAY).to_numpy()
    limits = ax.get_xlim()
    between = [stall if a < stall <= b else 0.5 * (a + b) for a, b in pairwise(loads.tolist())]
    edges = [min(limits[0], loads[0]), *between, max(limits[1], loads[-1])]
    look = {"facecolor": "0.9", "linewidth": 0.0, "zorder": 0}
    for index in np.flatnonzero(away):
        ax.axvspan(edges[index], edges[index + 1], label=AWAY, **look)
    ax.set_xlim(limits)
