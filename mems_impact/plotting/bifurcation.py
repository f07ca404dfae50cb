"""The sweep as in Fig. 4 of the paper: block speed on the section, step and speed of the frame."""

from __future__ import annotations

import math
from typing import Any

import pandas as pd

from mems_impact.errors import InvalidParameter
from mems_impact.plotting.style import BLUE, GREY, ORANGE, new_figure, symbol, tidy
from mems_impact.tables.common import bare, heading
from mems_impact.tables.sweep import sweep_summary

__all__ = ["plot_sweep"]

# Rings of the one around dots of the other: where both are the same, both are seen.
MARKS: dict[str, dict[str, Any]] = {
    "up": {"color": BLUE, "marker": "o", "markersize": 2.6, "zorder": 3},
    "down": {"color": ORANGE, "marker": "o", "markersize": 4.6, "fillstyle": "none", "zorder": 2},
}
WORDS = {"up": "increased", "down": "decreased"}
QUANTITIES = {
    "v2": ("v2", "$v_2$ at $x_2 = 0$"),
    "step": ("displacement per impact", "step per impact"),
    "speed": ("mean speed", "mean speed"),
}
"""What may be drawn: its column, and what the axis says."""


def plot_sweep(table: pd.DataFrame, ax: Any = None, *, quantity: str | None = None) -> Any:
    """Draw a sweep over its parameter: v2 on the section x2 = 0, step and speed of the frame.

    The first value at which a chain begins or ceases to impact is marked by a thin line. At the
    foot of v2 stand the values without: triangles where the block never crosses the section,
    crosses where the value failed. Where nothing strikes there is no step.

    Parameters
    ----------
    table : DataFrame
        From `mems_impact.sweep`, or read back from a file.
    ax : matplotlib Axes, optional
        Where to draw one quantity; a new figure by default.
    quantity : {"v2", "step", "speed"}, optional
        What to draw: v2 on the section, displacement of the frame per impact, or its mean speed. By
        default all of them, one below the other, on a new figure, and v2 on given axes.

    Returns
    -------
    Axes
        The uppermost; ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If `table` is none of a sweep, or there is no such quantity.

    Examples
    --------
    >>> plot_sweep(table).figure.savefig("sweep.png")
    >>> plot_sweep(table, quantity="speed").figure.savefig("speed.png")
    """
    if "v2" not in bare(table):
        problem = "not a table of mems_impact.sweep (a summary has no section)"
        raise InvalidParameter("table", None, "", problem=problem)
    drawn = [name for name, (column, _) in QUANTITIES.items() if column in bare(table)]
    if quantity is not None and quantity not in drawn:
        raise InvalidParameter("quantity", quantity, f"one of {', '.join(drawn)}")
    if quantity is not None or ax is not None:
        drawn = [quantity or "v2"]
    if ax is not None:
        panels = [ax]
    else:
        figure = new_figure(7.0, 4.2 if len(drawn) == 1 else 7.4)
        heights = [2.0 if name == "v2" and len(drawn) > 1 else 1.0 for name in drawn]
        grid = {"height_ratios": heights}
        panels = figure.subplots(len(drawn), sharex=True, squeeze=False, gridspec_kw=grid)[:, 0]
    first = panels[0]
    for panel, name in zip(panels, drawn, strict=True):
        size = _draw_dots(panel, table, name)
        _draw_switches(panel, table, named=panel is first)
        if panel is first and panel.get_legend_handles_labels()[0]:
            panel.legend(frameon=False, markerscale=1.0 / size)
        tidy(panel)
    parameter = bare(table).columns[0]
    name = symbol(parameter)
    panels[-1].set_xlabel(
        (name if name == parameter else f"{parameter} {name}")
        + _unit(heading(bare(table), parameter))
    )
    return first


def _draw_dots(ax: Any, table: pd.DataFrame, quantity: str) -> float:
    """Draw one quantity, and below v2 the values that have none; return the size of its dots."""
    column, words = QUANTITIES[quantity]
    ax.set_ylabel(words + _unit(heading(bare(table), column)))
    rows = bare(table if quantity == "v2" else sweep_summary(table))
    parameter = rows.columns[0]
    # Many dots are drawn small, or the rings run into a band; those that coincide count once.
    spread = max(1e-300, rows[column].max() - rows[column].min())
    places = (rows[column] / spread * 300.0).round()
    dots = len(pd.DataFrame({"at": rows[parameter], "place": places}).drop_duplicates())
    scale = min(1.0, max(0.35, math.sqrt(150.0 / max(1, dots))))
    for direction, style in MARKS.items():
        mark = {**style, "markersize": scale * style["markersize"], "linestyle": "none"}
        chain = rows[rows["direction"] == direction]
        if len(chain):
            label = f"{symbol(parameter)} {WORDS[direction]}"
            ax.plot(
                chain[parameter], chain[column], label=label, markeredgewidth=0.7 * scale,
                rasterized=len(chain) > 20_000, **mark,
            )  # fmt: skip
    if quantity == "v2":
        _draw_feet(ax, rows, scale)
    else:
        ax.ticklabel_format(axis="y", scilimits=(-2, 4))
    return scale


def _draw_feet(ax: Any, rows: pd.DataFrame, scale: float) -> None:
    """Mark the values that have no v2 on the axis, as what lies below all that is drawn."""
    parameter, good = rows.columns[0], rows["status"] == "ok"
    foot = {"transform": ax.get_xaxis_transform(), "clip_on": False, "linestyle": "none"}
    label = "never crosses $x_2 = 0$"
    for direction, style in MARKS.items():
        here = good & rows["v2"].isna() & (rows["direction"] == direction)
        values = rows.loc[here, parameter]
        if len(values):
            mark = {**style, "marker": "v", "markersize": 2.0 * scale * style["markersize"]}
            mark["zorder"] += 3  # above the axis
            ax.plot(values, [0.0] * len(values), label=label, **foot, **mark)
            label = "_"  # one line of the legend is enough
    failed = rows.loc[~good, parameter].unique()
    if len(failed):
        cross = {"marker": "x", "color": GREY, "markersize": 4, "label": "failed"}
        ax.plot(failed, [0.02] * len(failed), **foot, **cross)


def _draw_switches(ax: Any, table: pd.DataFrame, *, named: bool) -> None:
    """Draw a line where each chain begins or ceases to impact, maybe with its value above it."""
    parameter = symbol(bare(table).columns[0])
    marks = sorted(switches(table), key=lambda mark: mark[1])
    for place, (direction, value, impacting) in enumerate(marks):
        color = MARKS[direction]["color"]
        ax.axvline(value, color=color, linewidth=0.8, linestyle=(0, (4, 3)), zorder=1)
        if not named:
            continue
        text = f"{'on' if impacting else 'off'} at {parameter} = {value:.5g}"
        # Two labels lean away from each other, however near the values are.
        side = "center" if len(marks) == 1 else ("right", "left")[place]
        ax.annotate(
            text, (value, 1.0), xycoords=ax.get_xaxis_transform(), xytext=(0, 3),
            textcoords="offset points", ha=side, va="bottom", color=color, fontsize="small",
        )  # fmt: skip


def _unit(name: str) -> str:
    """Return the unit of a heading, as an axis shows it."""
    return f" {name[name.index('[') :]}" if " [" in name else ""


def switches(table: pd.DataFrame) -> list[tuple[str, float, bool]]:
    """Return where each chain first begins or ceases to impact: direction, value, begins."""
    summary = sweep_summary(bare(table))
    summary = summary[summary["status"] == "ok"]
    found = []
    for direction, rows in summary.groupby("direction", sort=False):
        impacting = rows["impacting"].to_numpy()
        changes = (impacting[1:] != impacting[:-1]).nonzero()[0]
        if changes.size:
            row = rows.iloc[changes[0] + 1]
            found.append((str(direction), float(row.iloc[0]), bool(row["impacting"])))
    return found
