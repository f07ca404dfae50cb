"""Working points over a parameter."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from mems_impact.errors import InvalidParameter
from mems_impact.plotting.labels import (
    amount,
    label_axis,
    label_of,
    legend_above,
    letter_panels,
    parameter_label,
    symbol,
)
from mems_impact.plotting.style import (
    Axes,
    color,
    given_axes,
    graded,
    new_figure,
    styled,
    thickness,
)
from mems_impact.tables import error_column

if TYPE_CHECKING:
    from mems_impact.actuator.design.characteristic import Characteristic


FILLS: dict[str, Any] = {"up": "full", "down": "none"}
WORDS = {
    "displacement per blow": "step per blow",
    "displacement per period": "step per period",
    "energy in per period": "energy per period",
    "energy in per blow": "energy per blow",
    "power in": "power",
}
"""Labels of axes that differ from the columns of the table."""
PANELS = ("displacement per blow", "mean speed", "energy in per blow", "stall force")
SHOWN_ERROR = 0.01  # relative error of a speed from which it is drawn


@styled
def plot_characteristic(
    curve: Characteristic, ax: Any = None, *, quantity: str | Sequence[str] | None = None
) -> Axes:
    """Draw working points over a parameter, one panel per quantity.

    Each curve has a colour and a marker, filled for ascending and hollow for descending values.
    Markers are the computed points; lines join them. Bars are errors of the mean speed above 1 %,
    and crosses mark speeds whose limit is unknown.

    Parameters
    ----------
    curve : Characteristic
    ax : matplotlib Axes or sequence of these, optional
        Axes to draw on, one per quantity; a new figure by default.
    quantity : str or sequence of str, optional
        Columns of the table; by default step per blow, mean speed and energy per blow, and the
        stall force if it was computed; for a device that never strikes its deflection.

    Returns
    -------
    Axes
        The uppermost; ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If a quantity is unknown.

    See Also
    --------
    characteristic, Characteristic, plot_force_curve

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> curve = mi.characteristic(actuator, drive, "amplitude", [0.2, 0.22, 0.24])
    >>> mi.plot_characteristic(curve).figure.savefig("characteristic.png")
    """
    table, first = curve.table, curve.curves
    names = _quantities(table, quantity)
    if ax is None:
        ax = new_figure(0.35 + 0.6 * len(names)).subplots(len(names), sharex=True, squeeze=False)
        ax = ax[:, 0]
        letter_panels(ax)
    axes = given_axes(ax, len(names), "one per quantity")
    keys = table[first].unique().tolist() if first else [None]
    looks = dict(zip(keys, graded(len(keys)), strict=True))
    if not first:
        looks = {None: {"color": color("motion"), "marker": "o"}}
    for key, look in looks.items():
        of_key = table if key is None else table[table[first] == key]
        for direction, group in of_key.groupby("direction", sort=False):
            for panel, name in zip(axes, names, strict=True):
                panel.plot(
                    group[curve.parameter], group[name], linewidth=thickness(0.6),
                    fillstyle=FILLS[str(direction)], **look,
                )  # fmt: skip
    handles = [*_keys(table, first, looks), *_directions(table)]
    if "mean speed" in names:
        handles += _errors(axes[names.index("mean speed")], table, curve.parameter)
    for panel, name in zip(axes, names, strict=True):
        label_axis(panel.yaxis, label_of(table, name, WORDS.get(name)))
    label_axis(axes[-1].xaxis, parameter_label(table, curve.parameter))
    legend_above(axes[0], handles)
    return axes[0]


def _quantities(table: pd.DataFrame, quantity: str | Sequence[str] | None) -> list[str]:
    """Return the columns to draw."""
    known = [str(name) for name in table.select_dtypes("float")]
    if quantity is None:
        found = [name for name in PANELS if name in table and table[name].notna().any()]
        return found if table["impacting"].any() else ["deflection", "mean speed"]
    names = [quantity] if isinstance(quantity, str) else list(quantity)
    for name in names:
        if name not in known:
            raise InvalidParameter("quantity", name, f"one of {', '.join(known)}")
    return names


def _keys(table: pd.DataFrame, first: str, looks: dict[Any, dict[str, Any]]) -> list[Any]:
    """Return the entries of the curves in the legend."""
    from matplotlib.lines import Line2D

    if not first:
        return []
    unit = label_of(table, first).unit
    sign = "" if unit else f"{symbol(first, table.attrs.get('symbols', {}))} = "
    return [
        Line2D([], [], linewidth=thickness(0.6), label=f"{sign}{amount(key, unit, 4)}", **look)
        for key, look in looks.items()
    ]


def _directions(table: pd.DataFrame) -> list[Any]:
    from matplotlib.lines import Line2D

    ways = [way for way in FILLS if (table["direction"] == way).any()]
    return [
        Line2D([], [], linestyle="none", marker="o", color=color("guide"), fillstyle=FILLS[way],
               label=way)
        for way in ways if len(ways) > 1
    ]  # fmt: skip


def _errors(ax: Any, table: pd.DataFrame, parameter: str) -> list[Any]:
    """Draw the errors of speeds that have not settled; return entries of the legend."""
    speed, error = table["mean speed"], table[error_column("mean speed")]
    doubtful = error > SHOWN_ERROR * speed.abs().max()
    known, look = doubtful & np.isfinite(error), {"color": color("impact"), "zorder": 4}
    found = []
    if known.any():
        rows = table[known]
        found.append(
            ax.errorbar(rows[parameter], rows["mean speed"], yerr=error[known], fmt="none",
                        elinewidth=thickness(0.7), capsize=1.5, label="error", **look)
        )  # fmt: skip
    if (rows := table[doubtful & ~known]).size:
        found += ax.plot(rows[parameter], rows["mean speed"], linestyle="none", marker="x",
                         label="limit unknown", **look)  # fmt: skip
    return found
