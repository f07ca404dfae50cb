"""The sweep as in Fig. 4 of the paper: block speed on the Poincaré section over a parameter."""

from __future__ import annotations

import math
from typing import Any

import pandas as pd

from mems_impact.errors import InvalidParameter
from mems_impact.plotting.style import BLUE, GREY, ORANGE, new_figure, symbol, tidy
from mems_impact.tables import sweep_summary, symbols

__all__ = ["plot_sweep"]

# Rings of the one around dots of the other: where both are the same, both are seen.
MARKS: dict[str, dict[str, Any]] = {
    "up": {"color": BLUE, "marker": "o", "markersize": 2.6, "zorder": 3},
    "down": {"color": ORANGE, "marker": "o", "markersize": 4.6, "fillstyle": "none", "zorder": 2},
}
WORDS = {"up": "increased", "down": "decreased"}


def plot_sweep(table: pd.DataFrame, ax: Any = None) -> Any:
    """Draw v2 on the section x2 = 0 over the parameter of a sweep.

    The first value at which a chain begins or ceases to impact is marked by a thin line. Values
    that failed are crosses at the foot.

    Parameters
    ----------
    table : DataFrame
        From `mems_impact.sweep`, or read back from a file.
    ax : matplotlib Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.
    """
    if "v2" not in symbols(table):
        problem = "not a table of mems_impact.sweep (a summary has no section)"
        raise InvalidParameter("table", None, "", problem=problem)
    if ax is None:
        ax = new_figure(7.0, 4.2).subplots()
    units = [f" {name[name.index('[') :]}" if " [" in name else "" for name in table.columns]
    unit, speed = units[0], units[[*symbols(table).columns].index("v2")]
    table = symbols(table)
    parameter = table.columns[0]
    # Many dots are drawn small, or the rings run into a band; those that coincide count once.
    spread = max(table["v2"].max() - table["v2"].min(), 1e-300)
    places = (table["v2"] / spread * 300.0).round()
    dots = len(pd.DataFrame({"at": table[parameter], "v2": places}).drop_duplicates())
    scale = min(1.0, max(0.35, math.sqrt(150.0 / max(1, dots))))
    for direction, style in MARKS.items():
        mark = {**style, "markersize": scale * style["markersize"]}
        rows = table[table["direction"] == direction]
        if len(rows):
            label = f"{symbol(parameter)} {WORDS[direction]}"
            ax.plot(
                rows[parameter], rows["v2"], linestyle="none", label=label,
                markeredgewidth=0.7 * scale, rasterized=len(rows) > 20_000, **mark,
            )  # fmt: skip
    failed = table.loc[table["status"] != "ok", parameter].unique()
    foot = ax.get_xaxis_transform()
    if len(failed):
        crosses = {"linestyle": "none", "marker": "x", "color": GREY, "markersize": 4}
        ax.plot(failed, [0.02] * len(failed), transform=foot, label="failed", **crosses)
    marks = sorted(switches(table), key=lambda mark: mark[1])
    for place, (direction, value, impacting) in enumerate(marks):
        color = MARKS[direction]["color"]
        ax.axvline(value, color=color, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
        text = f"{'on' if impacting else 'off'} at {symbol(parameter)} = {value:.5g}"
        # Two labels lean away from each other, however near the values are.
        side = "center" if len(marks) == 1 else ("right", "left")[place]
        ax.annotate(
            text, (value, 1.0), xycoords=foot, xytext=(0, 3), textcoords="offset points",
            ha=side, va="bottom", color=color, fontsize="small",
        )  # fmt: skip
    name = symbol(parameter)
    ax.set_xlabel((name if name == parameter else f"{parameter} {name}") + unit)
    ax.set_ylabel("$v_2$ at $x_2 = 0$" + speed)
    if ax.get_legend_handles_labels()[0]:
        ax.legend(frameon=False, markerscale=1.0 / scale)
    tidy(ax)
    return ax


def switches(table: pd.DataFrame) -> list[tuple[str, float, bool]]:
    """Return where each chain first begins or ceases to impact: direction, value, begins."""
    summary = sweep_summary(symbols(table))
    summary = summary[summary["status"] == "ok"]
    found = []
    for direction, rows in summary.groupby("direction", sort=False):
        impacting = rows["impacting"].to_numpy()
        changes = (impacting[1:] != impacting[:-1]).nonzero()[0]
        if changes.size:
            row = rows.iloc[changes[0] + 1]
            found.append((str(direction), float(row.iloc[0]), bool(row["impacting"])))
    return found
