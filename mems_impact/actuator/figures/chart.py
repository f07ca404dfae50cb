"""The chart of Fig. 7: on- and off-boundaries over the frequency, and the three types."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import pandas as pd

from mems_impact.actuator.tables import SYMBOLS
from mems_impact.plotting.labels import Label, label_axis, label_of, symbol
from mems_impact.plotting.placing import Mark, free_corner, label_points, legend_above
from mems_impact.plotting.style import DASHES, DOTS, color, new_figure, styled, thickness

__all__ = ["plot_chart"]

SHADES = {"I": "0.95", "II": "0.87", "III": "1.0"}
NEAR = 0.03  # of the height of the axes: boundaries that the eye does not part
INSET = (0.42, 0.28)  # width and height, of the axes
TITLE = 0.07  # height of its title


class Charted(Protocol):
    """What `plot_chart` needs of a `mems_impact.actuator.design.chart.Chart`."""

    @property
    def table(self) -> pd.DataFrame:
        """One row a point of a boundary."""

    @property
    def types(self) -> pd.DataFrame:
        """One row a type."""

    @property
    def special_table(self) -> pd.DataFrame:
        """One row a point of codimension two."""


@styled
def plot_chart(chart: Charted, ax: Any = None) -> Any:
    """Draw the amplitudes of switching on (solid) and off (dotted) over the frequency.

    Crosses are values that were simulated, not followed. The types of the paper are shaded, and
    the points of codimension two between them marked; of a device whose frame slips before the
    block strikes, a line shows where it begins to, and dashes between which voltages the block
    strikes alike in every forcing period. Where the boundaries lie so near each other that they
    are not told apart, an inset shows by how much they differ.

    Parameters
    ----------
    chart : Chart
    ax : matplotlib Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    See Also
    --------
    operating_chart, Chart, plot_curve

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
    omega, amplitude = "omega", "amplitude"
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
        ax.plot(rows[omega], rows[amplitude], label=name, **_line(name))
    simulated = table[table["kind"] == "crisis"]
    # Where the boundaries meet is known from the curves.
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
    ax.set_ylim(low - 0.22 * (high - low), high + 0.08 * (high - low))  # for labels
    for _, row in types.iterrows():
        low, high = row[f"{omega} from"], row[f"{omega} to"]
        ax.axvspan(low, high, color=SHADES[row["type"]], linewidth=0.0, zorder=0)
        ax.annotate(
            row["type"], (0.5 * (low + high), 0.98), xycoords=ax.get_xaxis_transform(),
            ha="center", va="top", color="0.25",
        )  # fmt: skip
    for _, row in chart.special_table.iterrows():
        ax.plot(
            row[omega], row[amplitude], marker="o", markersize=4.5, color="white",
            linestyle="none", markeredgecolor="black", markeredgewidth=0.8, zorder=6,
        )  # fmt: skip
    label_axis(ax.xaxis, label_of(table, omega, symbol(omega)))
    label_axis(ax.yaxis, label_of(table, amplitude, f"amplitude {symbol(amplitude, SYMBOLS)}"))
    legend_above(ax)
    marks = [
        Mark(f"{row['kind']}\n({row[omega]:.5g}, {row[amplitude]:.5g})", row[omega], row[amplitude])
        for _, row in chart.special_table.iterrows()
    ]
    label_points(ax, marks)
    _inset(ax, boundaries)
    return ax


def _line(boundary: str) -> dict[str, Any]:
    """Return how a boundary is drawn."""
    if boundary == "on":
        return {"color": color("up"), "linewidth": thickness(1.2), "zorder": 3}
    return {
        "color": color("down"), "linewidth": thickness(1.2), "linestyle": DOTS, "zorder": 4,
    }  # fmt: skip


def _inset(ax: Any, boundaries: dict[str, pd.DataFrame]) -> None:
    """Draw by how much the boundaries differ where the eye does not part them."""
    on, off = (
        rows.drop_duplicates("omega")[["omega", "amplitude"]].to_numpy(dtype=float)
        for rows in boundaries.values()
    )
    if min(len(on), len(off)) < 2:
        return
    # At the frequencies of the boundary with fewer points.
    own = on if len(on) < len(off) else off
    gap = np.interp(own[:, 0], *on.T) - np.interp(own[:, 0], *off.T)
    near = np.abs(gap) < NEAR * np.ptp(ax.get_ylim())
    place = free_corner(ax, INSET[0], INSET[1] + TITLE, top=0.88)
    if near.sum() < 3 or place is None:
        return
    inset = ax.inset_axes((*place, *INSET))
    inset.plot(own[near, 0], gap[near], color="black", marker=".", linewidth=thickness(0.8))
    inset.axhline(0.0, color=color("guide"), linewidth=0.5, zorder=0)
    inset.tick_params(labelsize="small", pad=1.5)
    inset.margins(y=0.1)
    unit = label_of(boundaries["on"], "amplitude").unit
    label_axis(inset.yaxis, Label("", unit))
    label_axis(inset.xaxis, Label(""))
    # Beside the inset the words might lie on an axis.
    words = f"on \N{MINUS SIGN} off {inset.get_ylabel()}".strip()
    inset.set_title(words, fontsize="small", pad=2.0)
    inset.set_ylabel("")
