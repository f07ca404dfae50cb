"""Curves of special points over two parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import pandas as pd

from mems_impact.errors import InvalidParameter
from mems_impact.plotting.labels import label_axis, parameter_label
from mems_impact.plotting.placing import Mark, label_points, legend_above
from mems_impact.plotting.style import LINES, MODE_COLORS, color, new_figure, styled, thickness

__all__ = ["plot_curve"]

KINDS = {
    "grazing": "grazing", "fold": "fold", "period-doubling": "doubling", "Neimark-Sacker": "torus",
}  # fmt: skip
"""What the colours of kinds of special points mean."""

SOLID = (LINES[0], LINES[1], LINES[3], (0, (8, 2)))  # dots are those of what is inadmissible
SAME = 0.005  # of the width and height of the axes: points that are one


class Boundary(Protocol):
    """What `plot_curve` needs of a `mems_impact.analysis.branch.Curve`."""

    @property
    def kind(self) -> str:
        """Of the special point."""

    @property
    def table(self) -> pd.DataFrame:
        """One row an orbit, the two parameters first."""

    @property
    def special_table(self) -> pd.DataFrame:
        """One row a point of codimension two."""


@styled
def plot_curve(curve: Boundary | Sequence[Boundary], ax: Any = None) -> Any:
    """Draw the first parameter of one or more curves over the second; inadmissible orbits dotted.

    Points of codimension two are marked, with their kinds.

    Parameters
    ----------
    curve : Curve or sequence of Curve
    ax : matplotlib Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If `curve` is none, or the curves are over different parameters.

    See Also
    --------
    continue_curve, Curve, plot_chart

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked(actuator))
    >>> branch = mi.continue_orbit(orbit, "amplitude", stop=0.17)
    >>> curve = mi.continue_curve(branch.special_points[0], "omega", stop=0.505)
    >>> mi.plot_curve(curve).figure.savefig("curve.png")
    """
    curves = list(curve) if isinstance(curve, Sequence) else [curve]
    for each in curves:
        if not (hasattr(each, "special_table") and hasattr(each, "kind")):
            allowed = "a Curve, as mems_impact.continue_curve returns it"
            raise InvalidParameter("curve", type(each).__name__, allowed)
    first = curves[0].table
    x, y = first.columns[:2]
    for each in curves:
        if list(each.table.columns[:2]) != [x, y]:
            others = ", ".join(each.table.columns[:2])
            raise InvalidParameter("parameters", others, f"{x}, {y}, those of the first curve")
    if ax is None:
        ax = new_figure(1.1).subplots()
    kinds = list(dict.fromkeys(each.kind for each in curves))
    rest = iter(MODE_COLORS * len(kinds))
    colors = {k: color(KINDS[k]) if k in KINDS else next(rest) for k in kinds}
    for each in curves:
        table, own = each.table, colors[each.kind]
        good = table["admissible"].to_numpy(dtype=bool)
        # One orbit more on either side, so that the dots reach the line.
        bad = ~good | ~np.roll(good, 1) | ~np.roll(good, -1) if (~good).any() else ~good
        ax.plot(table[x], table[y].where(good), color=own, linewidth=thickness(1.2), zorder=3,
                linestyle=SOLID[kinds.index(each.kind) % len(SOLID)], label=each.kind)  # fmt: skip
        if bad.any():
            ax.plot(table[x], table[y].where(bad), color=own, linewidth=thickness(0.8),
                    linestyle=(0, (1, 1.5)), zorder=2, label="inadmissible")  # fmt: skip
    ax.margins(x=0.04, y=0.14)
    found = [each.special_table[["kind", x, y]] for each in curves if len(each.special_table)]
    marks = _mark(ax, pd.concat(found).drop_duplicates(), x, y) if found else []
    label_axis(ax.xaxis, parameter_label(first, x))
    label_axis(ax.yaxis, parameter_label(first, y))
    legend_above(ax)
    label_points(ax, marks)
    return ax


def _mark(ax: Any, points: pd.DataFrame, x: str, y: str) -> list[Mark]:
    """Mark points of codimension two; return their labels."""
    size = np.array([np.ptp(ax.get_xlim()), np.ptp(ax.get_ylim())])
    taken: list[Mark] = []
    for _, row in points.iterrows():
        # Two curves that meet have the point where they do in common.
        here = row[[x, y]].to_numpy(dtype=float)
        if any(
            row["kind"] == mark.text and np.abs((here - (mark.x, mark.y)) / size).max() < SAME
            for mark in taken
        ):
            continue
        taken.append(Mark(row["kind"], *here))
        ax.plot(
            *here, marker="o", markersize=4.5, color="white", linestyle="none",
            markeredgecolor="black", markeredgewidth=0.8, zorder=6,
        )  # fmt: skip
    return taken
