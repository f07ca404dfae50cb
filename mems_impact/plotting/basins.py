"""Basins of attraction: which attractor is reached from where, and where the attractors are."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import pandas as pd

from mems_impact.analysis.kinds import FAILED
from mems_impact.errors import InvalidParameter
from mems_impact.plotting.labels import label_axis, parameter_label
from mems_impact.plotting.placing import legend_above
from mems_impact.plotting.style import new_figure, styled
from mems_impact.studies.census import ATTRACTOR, seen
from mems_impact.studies.stored_study import StoredStudy

__all__ = ["plot_basins"]

# Each of a lightness of its own: distinct in grey and to the colour-blind (hues of Okabe and Ito).
# Further attractors, with small shares, have one grey.
COLORS = ("#a6d4f0", "#e07b00", "#008a62", "#f7ee9e", "#d894bb", "#00558f", "#d05a00")
OTHERS, LOST = "0.6", "white"
MARKERS = "os^Dv<>"


class BasinsLike(Protocol):
    """What `plot_basins` needs of a `Basins`."""

    @property
    def table(self) -> pd.DataFrame:
        """One row a point."""

    @property
    def attractors(self) -> pd.DataFrame:
        """One row an attractor, the largest share first."""

    @property
    def returns(self) -> pd.DataFrame:
        """The states at the returns of each attractor."""


@styled
def plot_basins(
    basins: BasinsLike | StoredStudy, ax: Any = None, *, x: str | None = None, y: str | None = None
) -> Any:
    """Draw which attractor is reached from where, with the attractors over it.

    A grid is drawn as cells, a sample as dots. The legend gives shares; the marks are the states at
    the returns of each attractor. Points that failed stay white.

    Parameters
    ----------
    basins : Basins or StoredStudy
        Of the store of one, be it still running, kinds of motions: attractors of one kind are told
        apart once all points are done.
    ax : matplotlib Axes, optional
        Where to draw; a new figure of a column's width by default.
    x, y : str, optional
        Components of the state on the axes; those in which starts differ, in their order. Of one
        component alone a strip is drawn.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If `basins` is none, or starts do not differ in a component.

    See Also
    --------
    basins, Basins, plot_map

    Examples
    --------
    >>> import numpy as np
    >>> import mems_impact as mi
    >>> actuator, drive = mi.load_actuator("zhao2004"), mi.Sine(amplitude=0.2, omega=0.5)
    >>> v2 = np.linspace(-1.2, 1.2, 9)
    >>> found = mi.basins(actuator, drive, x=("x2", [-0.2, 0.0, 0.2]), y=("v2", v2))
    >>> mi.plot_basins(found).figure.savefig("basins.png")
    """
    if isinstance(basins, StoredStudy) and basins.kind == "basins":
        basins = seen(basins.table)
    if isinstance(basins, StoredStudy) or not hasattr(basins, "returns"):
        allowed = "Basins, as mems_impact.basins returns them, or their store"
        raise InvalidParameter("basins", type(basins).__name__, allowed)
    table = basins.table
    starts = table.attrs["starts"]
    for field, name in (("x", x), ("y", y)):
        if name is not None and name not in starts:
            raise InvalidParameter(field, name, f"one of {', '.join(starts)}")
    across = x or next(name for name in starts if name != y)
    up = y or next((name for name in starts if name != across), None)
    if ax is None:
        ax = new_figure(1.4 if up else 0.6).subplots()
    styles = _styles(basins.attractors)
    codes = table[ATTRACTOR].map({name: i for i, name in enumerate(styles)}).to_numpy()
    look = _look([color for color, _ in styles.values()])
    if up is None:
        order = np.argsort(table[across].to_numpy(), kind="stable")
        places, strip = table[across].to_numpy()[order], np.stack([codes[order]] * 2)
        ax.pcolormesh(places, [0.0, 1.0], strip, shading="nearest", rasterized=True, **look)
        ax.set(ylim=(0.0, 1.0), yticks=[])
    else:
        _draw_plane(ax, table, (across, up), codes, look)
        _draw_returns(ax, basins.returns, (across, up), styles)
        label_axis(ax.yaxis, parameter_label(table, up))
    label_axis(ax.xaxis, parameter_label(table, across))
    _legend(ax, basins, styles, marked=up is not None)
    return ax


def _styles(attractors: pd.DataFrame) -> dict[str, tuple[str, str]]:
    """Return colour and marker of each attractor, and of failed points."""
    styles = {}
    for i, name in enumerate(attractors[ATTRACTOR]):
        own = i < len(COLORS)
        styles[name] = (COLORS[i] if own else OTHERS, MARKERS[i % len(MARKERS)] if own else ".")
    return {**styles, FAILED: (LOST, "")}


def _look(colors: list[str]) -> dict[str, Any]:
    """Return how the numbers of attractors become colours."""
    from matplotlib.colors import ListedColormap

    return {"cmap": ListedColormap(colors), "vmin": -0.5, "vmax": len(colors) - 0.5}


def _draw_plane(
    ax: Any, table: pd.DataFrame, names: tuple[str, str], codes: Any, look: dict[str, Any]
) -> None:
    """Draw cells of a grid, or the dots of a sample."""
    x, y = (table[name].to_numpy() for name in names)
    xs, ys = np.unique(x), np.unique(y)
    if len(xs) * len(ys) == len(table) and min(len(xs), len(ys)) > 1:
        cells = np.empty((len(ys), len(xs)))
        cells[np.searchsorted(ys, y), np.searchsorted(xs, x)] = codes
        ax.pcolormesh(xs, ys, cells, shading="nearest", rasterized=True, **look)
        return
    size = float(np.clip(4000.0 / len(table), 1.5, 14.0))
    ax.scatter(x, y, c=codes, s=size, linewidths=0.0, rasterized=len(x) > 20_000, **look)


def _draw_returns(
    ax: Any, returns: pd.DataFrame, names: tuple[str, str], styles: dict[str, tuple[str, str]]
) -> None:
    """Mark where the attractors return, as far as that lies among the starts."""
    limits = ax.get_xlim(), ax.get_ylim()
    for name, (color, marker) in styles.items():
        seen = returns[returns[ATTRACTOR] == name]
        if not len(seen) or color == OTHERS:
            continue
        many = len(seen) > 20
        ax.plot(
            seen[names[0]], seen[names[1]], linestyle="none", marker="." if many else marker,
            markersize=1.6 if many else 4.5, color="black" if many else color,
            markeredgecolor="black", markeredgewidth=0.0 if many else 0.8, zorder=4,
        )  # fmt: skip
    ax.set_xlim(limits[0])
    ax.set_ylim(limits[1])


def _legend(ax: Any, basins: BasinsLike, styles: dict[str, tuple[str, str]], marked: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    found = basins.attractors
    named = found[: len(COLORS)]
    handles: list[Any] = []
    for name, share in zip(named[ATTRACTOR], named["share"], strict=True):
        color, marker = styles[name]
        handles.append(
            Line2D([], [], linestyle="none", marker=marker if marked else "s", color=color,
                   markeredgecolor="black", markersize=5.0, label=f"{name}  {share:.1%}")
        )  # fmt: skip
    if len(found) > len(named):
        share = found["share"][len(named) :].sum()
        handles.append(Patch(color=OTHERS, label=f"{len(found) - len(named)} others  {share:.1%}"))
    lost = float((basins.table[ATTRACTOR] == FAILED).mean())
    if lost:
        handles.append(Patch(facecolor=LOST, edgecolor="black", label=f"failed  {lost:.1%}"))
    legend_above(ax, handles)
