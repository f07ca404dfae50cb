"""Curves of special points over two parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from mems_impact.errors import InvalidParameter
from mems_impact.plotting.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    new_figure,
    parameter_label,
    tidy,
)

__all__ = ["plot_curve"]

COLORS = {"grazing": BLUE, "fold": ORANGE, "period-doubling": GREEN, "Neimark-Sacker": GREY}
SIDES = ((1, 1), (1, -1), (-1, 1), (-1, -1))  # of a point, where its text may stand
LETTER = 0.017  # width of a letter of a label, as a part of the axes
SAME = 0.005  # of the width and height of the axes: points that are one
OTHERS = ("#cc79a7", "#56b4e9", "#e69f00")


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
        ax = new_figure(7.0, 4.4).subplots()
    kinds = dict.fromkeys(each.kind for each in curves)
    rest = iter(OTHERS * len(kinds))
    colors = {kind: COLORS.get(kind) or next(rest) for kind in kinds}
    for each in curves:
        table, color = each.table, colors[each.kind]
        good = table["admissible"].to_numpy(dtype=bool)
        # One orbit more on either side, so that the dots reach the line.
        bad = ~good | ~np.roll(good, 1) | ~np.roll(good, -1) if (~good).any() else ~good
        ax.plot(table[x], table[y].where(good), color=color, linewidth=1.8, zorder=3,
                label=each.kind)  # fmt: skip
        if bad.any():
            ax.plot(table[x], table[y].where(bad), color=color, linewidth=1.2,
                    linestyle=(0, (1, 1.5)), zorder=2, label="inadmissible")  # fmt: skip
    ax.margins(x=0.02, y=0.14)
    found = [each.special_table[["kind", x, y]] for each in curves if len(each.special_table)]
    if found:
        _mark(ax, pd.concat(found).drop_duplicates(), x, y)
    ax.set_xlabel(parameter_label(first, x))
    ax.set_ylabel(parameter_label(first, y))
    labels = dict(zip(*ax.get_legend_handles_labels()[::-1], strict=True))
    ax.legend(labels.values(), labels.keys(), frameon=False)
    tidy(ax)
    return ax


def _mark(ax: Any, points: pd.DataFrame, x: str, y: str) -> None:
    """Mark points of codimension two, their kinds where the fewest lines are."""
    corner = np.array([ax.get_xlim()[0], ax.get_ylim()[0]])
    size = np.array([np.ptp(ax.get_xlim()), np.ptp(ax.get_ylim())])
    lines = [_dense((line.get_xydata() - corner) / size) for line in ax.lines]
    taken: list[tuple[str, NDArray[np.float64]]] = []
    for _, row in points.iterrows():
        # Two curves that meet have the point where they do in common.
        here = (row[[x, y]].to_numpy(dtype=float) - corner) / size
        if any(row["kind"] == kind and np.abs(here - at).max() < SAME for kind, at in taken):
            continue
        taken.append((row["kind"], here))
        ax.plot(
            row[x], row[y], marker="o", markersize=6, color="white", linestyle="none",
            markeredgecolor="black", markeredgewidth=1.0, zorder=6,
        )  # fmt: skip
        extent = LETTER * np.array([len(row["kind"]), 4.0])
        crowd = {side: _crowd(here, np.multiply(side, extent), lines) for side in SIDES}
        right, above = min(SIDES, key=lambda side: crowd[side])
        ax.annotate(
            row["kind"], (row[x], row[y]), xytext=(7 * right, 7 * above),
            textcoords="offset points", ha="left" if right > 0 else "right",
            va="bottom" if above > 0 else "top", fontsize="small", zorder=6,
        )  # fmt: skip


def _dense(line: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a line, in parts of the axes, with points so near each other that none hides text."""
    line = line[~np.isnan(line).any(axis=1)]
    parts = np.linspace(0.0, len(line) - 1.0, 40 * len(line))
    at = np.arange(len(line))
    return np.column_stack([np.interp(parts, at, column) for column in line.T])


def _crowd(
    here: NDArray[np.float64], extent: NDArray[np.float64], lines: list[NDArray[np.float64]]
) -> int:
    """Return how many points of lines a text covers; more than any if it leaves the axes."""
    low, high = np.sort([here, here + extent], axis=0)
    if (low < 0.0).any() or (high > 1.0).any():
        return sum(len(line) for line in lines) + 1
    return sum(int(((line > low) & (line < high)).all(axis=1).sum()) for line in lines)
