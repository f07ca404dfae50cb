"""Operating charts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from mems_impact.plotting.labels import (
    Label,
    Mark,
    free_corner,
    label_axis,
    label_of,
    legend_above,
    mark_points,
    parameter_label,
)
from mems_impact.plotting.style import (
    DASHES,
    Axes,
    boundary_line,
    color,
    new_figure,
    styled,
    thickness,
)

if TYPE_CHECKING:
    from mems_impact.actuator.design.operating_chart import OperatingChart


SHADES = {"I": "0.95", "II": "0.87", "III": "1.0"}
MEANINGS = {
    "I": "I: on by a jump, off at a lower voltage",
    "II": "II: on and off at the same voltage",
    "III": "III: on by a jump, off where irregular motion ends",
}
"""What the types of the paper mean."""
MIN_GAP = 0.11  # distance of points that no curve joins, relative to the range of frequencies
MIN_BOUNDARY_GAP = 0.03  # visible distance of boundaries, relative to the height of the axes
INSET = (0.42, 0.28)  # width and height, relative to the axes
TITLE = 0.07  # height of its title


@styled
def plot_chart(chart: OperatingChart, ax: Any = None) -> Axes:
    """Draw the on (wide) and off (dashed) boundaries of an operating chart over the frequency.

    Crosses are simulated values, other points are continued. The types of the paper are shaded,
    explained below the axis, and the points of codimension two between them marked. Without types,
    a solid line is the onset of slip, and dashed lines bound the lowest voltages with equal impacts
    in every forcing period; straight lines join dots, the computed voltages. An inset shows the
    difference of boundaries that are too close to be distinguished.

    Parameters
    ----------
    chart : OperatingChart
    ax : matplotlib Axes, optional
        Axes to draw on; a new figure by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    See Also
    --------
    operating_chart, OperatingChart, plot_curve

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> chart = mi.operating_chart(actuator, drive, omega=(0.478, 0.495), crises=0)
    >>> mi.plot_chart(chart).figure.savefig("chart.png")
    """
    if ax is None:
        ax = new_figure(1.2).subplots()
    table = chart.table
    omega, amplitude = chart.parameters
    boundaries = {
        name: table[table["boundary"] == name].sort_values(omega) for name in ("on", "off")
    }
    slips = table[table["boundary"] == "slip"].sort_values(omega)
    if len(slips):
        ax.plot(
            slips[omega], slips[amplitude], color=color("guide"), linewidth=thickness(1.0),
            label="the frame slips", zorder=2,
        )  # fmt: skip
    for name in ("steady from", "steady to"):
        rows = table[table["boundary"] == name].sort_values(omega)
        if len(rows):
            ax.plot(
                rows[omega], rows[amplitude], color=color("guide"), label=name, zorder=2, **DASHES,
            )  # fmt: skip
    for name, rows in boundaries.items():
        if len(rows):
            ax.plot(rows[omega], rows[amplitude], label=name, **boundary_line(name))
    if not len(chart.types):
        _mark_isolated(ax, table[table["boundary"] != "off"], omega, amplitude)
    simulated = table[table["kind"] == "crisis"]
    # The curves already end at the special points.
    simulated = simulated[~simulated[omega].isin(chart.special_table[omega])]
    if len(simulated):
        ax.plot(
            simulated[omega], simulated[amplitude], linestyle="none", marker="x", markersize=3.5,
            color=color("down"), label="off, simulated (crisis)", zorder=5, clip_on=False,
        )  # fmt: skip
    types = chart.types
    edges = types[[f"{omega} from", f"{omega} to"]] if len(types) else table[omega]
    ax.set_xlim(edges.to_numpy().min(), edges.to_numpy().max())
    low, high = ax.get_ylim()
    room = high - low  # for labels; voltages are not negative
    ax.set_ylim(max(low - 0.22 * room, min(low, 0.0)), high + 0.08 * room)
    for _, row in types.iterrows():
        low, high = row[f"{omega} from"], row[f"{omega} to"]
        ax.axvspan(low, high, color=SHADES[row["type"]], linewidth=0.0, zorder=0)
        ax.annotate(
            row["type"], (0.5 * (low + high), 0.98), xycoords=ax.get_xaxis_transform(),
            ha="center", va="top", color="0.25",
        )  # fmt: skip
    meanings = "".join(f"\n{MEANINGS[each]}" for each in sorted(set(types["type"])))
    label_axis(ax.xaxis, parameter_label(table, omega)._replace(suffix=meanings))
    label_axis(ax.yaxis, parameter_label(table, amplitude))
    legend_above(ax)
    marks = [
        Mark(f"{row['kind']}\n({row[omega]:.5g}, {row[amplitude]:.5g})", row[omega], row[amplitude])
        for _, row in chart.special_table.iterrows()
    ]
    mark_points(ax, marks)
    _inset(ax, boundaries)
    return ax


def _mark_isolated(ax: Any, table: pd.DataFrame, omega: str, amplitude: str) -> None:
    """Mark the points between which no curve was computed, so that the line is straight."""
    min_gap = MIN_GAP * np.ptp(table[omega])
    for _, rows in table.sort_values(omega).groupby("boundary"):
        separated = np.diff(rows[omega]) > min_gap
        isolated = rows[np.append(separated, False) | np.append(False, separated)]
        ax.plot(
            isolated[omega], isolated[amplitude], linestyle="none", marker="o", markersize=2.5,
            color=color("guide"), zorder=3, clip_on=False, label="computed, coarse",
        )  # fmt: skip


def _inset(ax: Any, boundaries: dict[str, pd.DataFrame]) -> None:
    """Draw the difference of the boundaries where they are visually indistinguishable."""
    on, off = (
        rows.drop_duplicates(rows.columns[1])[list(rows.columns[1:3])].to_numpy(dtype=float)
        for rows in boundaries.values()
    )
    if min(len(on), len(off)) < 2:
        return
    # At the frequencies of the boundary with fewer points.
    fewer = on if len(on) < len(off) else off
    gap = np.interp(fewer[:, 0], *on.T) - np.interp(fewer[:, 0], *off.T)
    near = np.abs(gap) < MIN_BOUNDARY_GAP * np.ptp(ax.get_ylim())
    corner = free_corner(ax, INSET[0], INSET[1] + TITLE, top=0.88)
    if near.sum() < 3 or corner is None:
        return
    inset = ax.inset_axes((*corner, *INSET))
    inset.plot(fewer[near, 0], gap[near], color="black", marker=".", linewidth=thickness(0.8))
    inset.axhline(0.0, color=color("guide"), linewidth=0.5, zorder=0)
    inset.tick_params(labelsize="small", pad=1.5)
    inset.margins(y=0.1)
    unit = label_of(boundaries["on"], "amplitude").unit
    label_axis(inset.yaxis, Label("", unit))
    label_axis(inset.xaxis, Label(""))
    # An axis label beside the inset might overlap an axis.
    label = f"on \N{MINUS SIGN} off {inset.get_ylabel()}".strip()
    inset.set_title(label, fontsize="small", pad=2.0)
    inset.set_ylabel("")
