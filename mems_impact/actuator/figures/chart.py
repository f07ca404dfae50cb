"""The chart of Fig. 7: on- and off-boundaries over the frequency, and the three types."""

from __future__ import annotations

from typing import Any, Protocol

import pandas as pd

from mems_impact.actuator.tables import SYMBOLS
from mems_impact.plotting.style import BLUE, GREEN, GREY, ORANGE, new_figure, symbol, tidy
from mems_impact.tables.common import heading

__all__ = ["plot_chart"]

SHADES = {"I": GREEN, "II": GREY, "III": ORANGE}


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


def plot_chart(chart: Charted, ax: Any = None) -> Any:
    """Draw the amplitudes of switching on (solid) and off (dotted) over the frequency.

    Crosses are values that were simulated, not followed. The types of the paper are shaded, and
    the points of codimension two between them marked.

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
        ax = new_figure(7.0, 4.4).subplots()
    table = chart.table
    omega, amplitude = "omega", "amplitude"
    styles: dict[str, dict[str, Any]] = {
        "on": {"color": BLUE, "linewidth": 1.8, "label": "on", "zorder": 3},
        "off": {
            "color": ORANGE, "linewidth": 1.8, "linestyle": (0, (1, 1.5)), "label": "off",
            "zorder": 4,
        },
    }  # fmt: skip
    for boundary, style in styles.items():
        rows = table[table["boundary"] == boundary].sort_values(omega)
        ax.plot(rows[omega], rows[amplitude], **style)
    simulated = table[table["kind"] == "crisis"]
    # Where the boundaries meet is known from the curves.
    simulated = simulated[~simulated[omega].isin(chart.special_table[omega])]
    if len(simulated):
        ax.plot(
            simulated[omega], simulated[amplitude], linestyle="none", marker="x", markersize=5,
            color=ORANGE, label="off, simulated (crisis)", zorder=5, clip_on=False,
        )  # fmt: skip
    top = ax.get_xaxis_transform()
    for _, row in chart.types.iterrows():
        low, high = row[f"{omega} from"], row[f"{omega} to"]
        ax.axvspan(low, high, color=SHADES[row["type"]], alpha=0.1, linewidth=0.0, zorder=0)
        ax.annotate(
            row["type"], (0.5 * (low + high), 0.95), xycoords=top, ha="center", va="top",
            color="0.25",
        )  # fmt: skip
    first, last = chart.types[f"{omega} from"].min(), chart.types[f"{omega} to"].max()
    for place, (_, row) in enumerate(chart.special_table.iterrows()):
        ax.plot(
            row[omega], row[amplitude], marker="o", markersize=6, color="white", linestyle="none",
            markeredgecolor="black", markeredgewidth=1.0, zorder=6,
        )  # fmt: skip
        # On alternate sides, where the curves leave room; next to the axis above a falling one.
        near = place % 2 == 0 and row[omega] - first < 0.3 * (last - first)
        left, above = place % 2 == 0 and not near, near
        ax.annotate(
            f"{row['kind']}\n({row[omega]:.5g}, {row[amplitude]:.5g})",
            (row[omega], row[amplitude]), xytext=(-8 if left else 8, 6 if above else -6),
            textcoords="offset points", ha="right" if left else "left",
            va="bottom" if above else "top", fontsize="small", zorder=6,
        )  # fmt: skip
    ax.set_xlim(first, last)
    ax.margins(y=0.14)
    units = {name: heading(table, name).removeprefix(name) for name in (omega, amplitude)}
    ax.set_xlabel(f"omega {symbol(omega)}{units[omega]}")
    ax.set_ylabel(f"amplitude {symbol(amplitude, SYMBOLS)}{units[amplitude]}")
    ax.legend(frameon=False, loc="lower left")
    tidy(ax)
    return ax
