"""A sweep over its parameter: the state on the Poincaré section, and statistics below it."""

from __future__ import annotations

import math
from typing import Any

import pandas as pd

from mems_impact.errors import InvalidParameter
from mems_impact.plotting.labels import (
    Label,
    crosses,
    label_axis,
    label_of,
    on_section,
    parameter_label,
    symbol,
)
from mems_impact.plotting.placing import legend_above
from mems_impact.plotting.style import DASHES, DOTS, color, new_figure, styled
from mems_impact.studies.stored_study import StoredStudy
from mems_impact.tables.common import bare
from mems_impact.tables.sweep import NUMBER, PERIOD, sweep_summary, switches

__all__ = ["plot_sweep"]

# Rings of the one around dots of the other: where both are the same, both are seen.
MARKS: dict[str, dict[str, Any]] = {
    "up": {"marker": "o", "markersize": 1.9, "zorder": 3},
    "down": {"marker": "o", "markersize": 3.6, "fillstyle": "none", "zorder": 2},
}
WORDS = {"up": "increased", "down": "decreased"}
COLUMNS = ("direction", "status")
"""What a table of a sweep has beside the parameter, what is counted, states and statistics."""


@styled
def plot_sweep(
    table: pd.DataFrame | StoredStudy, ax: Any = None, *, quantity: str | None = None
) -> Any:
    """Draw a sweep over its parameter: the first state where the section cuts it, and statistics.

    Of an actuator v2 on the section x2 = 0, step and speed of the frame; of any system its first
    shown state and its observables. The first value at which a chain begins or ceases to impact is
    marked by a thin line. At the foot of the state stand the values without: triangles where the
    motion never crosses the section, crosses where the value failed. Where nothing strikes there
    is no step.

    Parameters
    ----------
    table : DataFrame or StoredStudy
        From `mems_impact.sweep`, or read back from a file; then with the state alone by default.
        Or the store of a sweep, be it still running.
    ax : matplotlib Axes, optional
        Where to draw one quantity; a new figure by default.
    quantity : str, optional
        What to draw: a column of the table, or a short name such as an actuator's "step" and
        "speed". By default all that the system shows, one below the other, on a new figure, and
        the first state on given axes.

    Returns
    -------
    Axes
        The uppermost; ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If `table` is none of a sweep, or there is no such quantity.

    See Also
    --------
    sweep, sweep_summary, plot_branch

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> table = mi.sweep(actuator, drive, "amplitude", [0.2, 0.24], transient=100, periods=10)
    >>> mi.plot_sweep(table, quantity="speed").figure.savefig("sweep.png")
    """
    table = bare(table.table if isinstance(table, StoredStudy) else table)
    if not set(COLUMNS) <= set(table.columns) or table.columns[2] not in (PERIOD, NUMBER):
        problem = "not a table of mems_impact.sweep (a summary has no section)"
        raise InvalidParameter("table", None, "", problem=problem)
    quantities = _quantities(table)
    if quantity is not None and quantity not in quantities:
        raise InvalidParameter("quantity", quantity, f"one of {', '.join(quantities)}")
    first = next(iter(quantities))
    shown = [name for name in table.attrs.get("quantities", {}) if name in quantities]
    drawn = [first, *shown] if quantity is None and ax is None else [quantity or first]
    if ax is not None:
        panels = [ax]
    else:
        figure = new_figure(1.1 + 0.55 * (len(drawn) - 1))
        heights = [2.0 if name == first and len(drawn) > 1 else 1.0 for name in drawn]
        grid = {"height_ratios": heights}
        panels = figure.subplots(len(drawn), sharex=True, squeeze=False, gridspec_kw=grid)[:, 0]
    for panel, name in zip(panels, drawn, strict=True):
        _draw_dots(panel, table, *quantities[name])
        _draw_switches(panel, table)
    legend_above(panels[0])
    label_axis(panels[-1].xaxis, parameter_label(table, table.columns[0]))
    return panels[0]


def _quantities(table: pd.DataFrame) -> dict[str, tuple[str, Label]]:
    """Return what may be drawn, the first state first: the column and what the axis says."""
    columns = [name for name in table.columns[3:] if name not in COLUMNS]
    states: list[str] = table.attrs.get("states", [table.columns[3]])
    found = {states[0]: (states[0], on_section(table, states[0]))}
    for name, (column, words) in table.attrs.get("quantities", {}).items():
        if column in columns:
            found[name] = (column, label_of(table, column, words))
    for name in columns:
        label = on_section(table, name) if name in states else label_of(table, name)
        found.setdefault(name, (name, label))
    return found


def _draw_dots(ax: Any, table: pd.DataFrame, column: str, label: Label) -> None:
    """Draw one quantity, and below a state the values without."""
    summary = sweep_summary(table)
    of_crossings = column not in summary
    rows = table if of_crossings else summary
    parameter = rows.columns[0]
    sign = _symbol(table)
    # Many dots are drawn small, or the rings run into a band; those that coincide count once.
    spread = max(1e-300, rows[column].max() - rows[column].min())
    places = (rows[column] / spread * 300.0).round()
    dots = len(pd.DataFrame({"at": rows[parameter], "place": places}).drop_duplicates())
    scale = min(1.0, max(0.35, math.sqrt(150.0 / max(1, dots))))
    for direction, style in MARKS.items():
        mark = {**style, "markersize": scale * style["markersize"], "linestyle": "none"}
        mark["color"] = color(direction)
        chain = rows[rows["direction"] == direction]
        if len(chain):
            ax.plot(
                chain[parameter], chain[column], label=f"{sign} {WORDS[direction]}",
                markeredgewidth=0.7 * scale, rasterized=len(chain) > 20_000, **mark,
            )  # fmt: skip
    if of_crossings:
        _draw_feet(ax, rows, column, scale)
    label_axis(ax.yaxis, label)


def _draw_feet(ax: Any, rows: pd.DataFrame, state: str, scale: float) -> None:
    """Mark the values without a crossing on the axis, as what lies below all that is drawn."""
    parameter, good = rows.columns[0], rows["status"] == "ok"
    foot = {"transform": ax.get_xaxis_transform(), "clip_on": False, "linestyle": "none"}
    label = f"never crosses {crosses(rows.attrs) or 'the section'}"
    if rows.attrs.get("maxima"):
        label = "no maximum"
    # Another state may have more maxima than this one.
    none = rows.groupby([parameter, "direction"])[state].transform("count") == 0
    for direction, style in MARKS.items():
        here = good & none & (rows["direction"] == direction)
        values = rows.loc[here, parameter]
        if len(values):
            mark = {**style, "marker": "v", "markersize": 2.0 * scale * style["markersize"]}
            mark |= {"zorder": style["zorder"] + 3, "color": color(direction)}  # above the axis
            ax.plot(values, [0.0] * len(values), label=label, **foot, **mark)
            label = "_"  # one line of the legend is enough
    failed = rows.loc[~good, parameter].unique()
    if len(failed):
        cross = {"marker": "x", "color": color("guide"), "markersize": 4, "label": "failed"}
        ax.plot(failed, [0.02] * len(failed), **foot, **cross)


def _symbol(table: pd.DataFrame) -> str:
    return symbol(table.columns[0], table.attrs.get("symbols", {}))


def _draw_switches(ax: Any, table: pd.DataFrame) -> None:
    """Draw a line where each chain begins or ceases to impact; the legend has the value."""
    parameter = _symbol(table)
    for direction, value, impacting in sorted(switches(table), key=lambda mark: mark[1]):
        text = f"{'on' if impacting else 'off'} at {parameter} = {value:.5g}"
        look = DASHES if impacting else {**DASHES, "linestyle": DOTS}
        ax.axvline(value, color=color(direction), zorder=1, label=text, **look)
