"""Operating maps and basins of attraction."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from mems_impact.errors import InvalidParameter
from mems_impact.plotting.labels import label_axis, label_of, legend_above, parameter_label
from mems_impact.plotting.style import LINES, Axes, boundary_line, new_figure, styled, thickness
from mems_impact.studies.attractor_matching import ATTRACTOR, PartialBasins, label_partial
from mems_impact.studies.attractor_study import (
    MOTION,
    STATIONARY_STATUSES,
    in_order,
    motions,
    period_of,
)
from mems_impact.studies.engine.store import StoredStudy
from mems_impact.studies.operating_map import OperatingMap
from mems_impact.systems.statistics import CHAOTIC, FAILED, OFF, QUASI_PERIODIC, RESTING, UNSETTLED
from mems_impact.tables import without_units

if TYPE_CHECKING:
    from mems_impact.studies.basins import Basins

# --- Basins of attraction

# Colours of different lightness, distinct in grey and to the colour-blind (hues of Okabe and Ito).
# Further attractors, with small shares, have one grey.
MAP_COLORS = ("#a6d4f0", "#e07b00", "#008a62", "#f7ee9e", "#d894bb", "#00558f", "#d05a00")
TWO_ROWS = 5  # attractors whose legend has at most two rows
OTHER_COLOR, FAILED_COLOR = "0.6", "white"
MARKERS = "os^Dv<>"


@styled
def plot_basins(
    basins: Basins | StoredStudy, ax: Any = None, *, x: str | None = None, y: str | None = None
) -> Axes:
    """Draw basins of attraction, and the attractors over them.

    A grid is drawn as cells, a sample as dots. The legend gives shares; the marks are the states at
    the returns of each attractor. Failed points stay white.

    Parameters
    ----------
    basins : Basins or StoredStudy
        A running store shows kinds of motions; attractors of one kind are distinguished when all
        points are complete.
    ax : matplotlib Axes, optional
        Where to draw; a new figure of a column's width by default.
    x, y : str, optional
        Components of the state on the axes; by default the components in which starts differ. A
        single component gives a strip.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If `basins` is no result of `basins`, or all starts agree in a component.

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
    shown: Any = basins
    if isinstance(basins, StoredStudy) and basins.kind == "basins":
        shown = label_partial(basins.table)
    if not hasattr(shown, "returns"):
        allowed = "Basins, as mems_impact.basins returns them, or their store"
        raise InvalidParameter("basins", type(basins).__name__, allowed)
    table = shown.table
    starts = table.attrs["starts"]
    for field, name in (("x", x), ("y", y)):
        if name is not None and name not in starts:
            raise InvalidParameter(field, name, f"one of {', '.join(starts)}")
    across = x or next(name for name in starts if name != y)
    up = y or next((name for name in starts if name != across), None)
    if ax is None:
        # A legend of many attractors has three rows.
        many = len(shown.attractors) > TWO_ROWS
        ax = new_figure((1.6 if many else 1.4) if up else 0.6).subplots()
    styles = _styles(shown.attractors)
    codes = table[ATTRACTOR].map({name: i for i, name in enumerate(styles)}).to_numpy()
    look = _look([color for color, _ in styles.values()])
    if up is None:
        order = np.argsort(table[across].to_numpy(), kind="stable")
        positions, strip = table[across].to_numpy()[order], np.stack([codes[order]] * 2)
        ax.pcolormesh(positions, [0.0, 1.0], strip, shading="nearest", rasterized=True, **look)
        ax.set(ylim=(0.0, 1.0), yticks=[])
    else:
        _draw_plane(ax, table, (across, up), codes, look)
        _draw_returns(ax, shown.returns, (across, up), styles)
        label_axis(ax.yaxis, parameter_label(table, up))
    label_axis(ax.xaxis, parameter_label(table, across))
    _legend(ax, shown, styles, marked=up is not None)
    return ax


def _styles(attractors: pd.DataFrame) -> dict[str, tuple[str, str]]:
    """Return colour and marker of each attractor, and of failed points."""
    styles = {}
    for i, name in enumerate(attractors[ATTRACTOR]):
        distinct = i < len(MAP_COLORS)
        styles[name] = (
            MAP_COLORS[i] if distinct else OTHER_COLOR,
            MARKERS[i % len(MARKERS)] if distinct else ".",
        )
    return {**styles, FAILED: (FAILED_COLOR, "")}


def _look(colors: list[str]) -> dict[str, Any]:
    """Return colour map and range of attractor numbers."""
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
    """Mark the returns of the attractors within the range of the starts."""
    limits = ax.get_xlim(), ax.get_ylim()
    for name, (color, marker) in styles.items():
        points = returns[returns[ATTRACTOR] == name]
        if not len(points) or color == OTHER_COLOR:
            continue
        many = len(points) > 20
        ax.plot(
            points[names[0]], points[names[1]], linestyle="none", marker="." if many else marker,
            markersize=1.6 if many else 4.5, color="black" if many else color,
            markeredgecolor="black", markeredgewidth=0.0 if many else 0.8, zorder=4,
        )  # fmt: skip
    ax.set(xlim=limits[0], ylim=limits[1])


def _legend(
    ax: Any, basins: Basins | PartialBasins, styles: dict[str, tuple[str, str]], marked: bool
) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    attractors = basins.attractors
    colored = attractors[: len(MAP_COLORS)]
    handles: list[Any] = []
    for name, share in zip(colored[ATTRACTOR], colored["share"], strict=True):
        color, marker = styles[name]
        handles.append(
            Line2D([], [], linestyle="none", marker=marker if marked else "s", color=color,
                   markeredgecolor="black", markersize=5.0, label=f"{name}  {share:.1%}")
        )  # fmt: skip
    if len(attractors) > len(colored):
        share = attractors["share"][len(colored) :].sum()
        handles.append(
            Patch(color=OTHER_COLOR, label=f"{len(attractors) - len(colored)} others  {share:.1%}")
        )
    failed_share = float((basins.table[ATTRACTOR] == FAILED).mean())
    if failed_share:
        label = f"failed  {failed_share:.1%}"
        handles.append(Patch(facecolor=FAILED_COLOR, edgecolor="black", label=label))
    legend_above(ax, handles)


# --- Operating maps


class Paint(NamedTuple):
    """Fill of the cells of one kind."""

    color: str
    hatch: str = ""
    ink: str = "0.4"  # of hatching and, in the legend, of the border


# Longer periods are darker; aperiodic motions are warm and hatched, so that they are distinct in
# grey and to the colour-blind.
PERIOD_COLORS = ("#b3d7ee", "#72b2dd", "#3584bf", "#125a94", "#083764")
MOTIONS = {
    OFF: Paint("0.93"),
    RESTING: Paint("0.93", "..."),
    QUASI_PERIODIC: Paint("#f0d24a", "////", "#8c6d00"),
    CHAOTIC: Paint("#e8874a", "xxxx", "#7a2e00"),
    UNSETTLED: Paint("#ecb0cc", "\\\\\\\\", "#94486d"),
    FAILED: Paint("black"),
}
SWITCHING = ("on", "off")
"""Boundaries of a chart that are drawn as in the chart."""
AND_MORE = " and more"
NO_IMPACTS = "no impacts"  # of a legend, for `OFF`, which may border on another attractor
OTHER_PAINT = Paint("#009e73", "++", "#004d38")


class Cells(NamedTuple):
    """The points of a map on their grid; `row` is -1 for missing points."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    row: NDArray[np.int64]  # of the table, shape (len(y), len(x))


@styled
def plot_map(
    operating_map: OperatingMap | StoredStudy | pd.DataFrame,
    column: str | None = None,
    ax: Any = None,
    *,
    boundaries: Any = (),
) -> Axes:
    """Draw a two-parameter map: kinds of motions, or one column of the table.

    Parameters
    ----------
    operating_map : OperatingMap, StoredStudy or DataFrame
        A map, its running or finished store, or a table of either. Missing points stay white.
    column : str, optional
        A column of numbers; kinds of motions by default. Cells without a number, or without impacts
        in a system with impacts, are grey. From the fifth on, longer periods share a colour.
    ax : matplotlib Axes, optional
        Where to draw; a new figure by default, as wide as a column of a journal.
    boundaries : Curve, OperatingChart, DataFrame, or a sequence of these, optional
        Curves over the same two parameters, or their tables, drawn over the map; inadmissible parts
        are omitted. A chart has two boundaries: switching on and off.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If `operating_map` is not a map, the column is unknown or not numeric, or a boundary is over
        other parameters.

    See Also
    --------
    operating_map, OperatingMap, plot_basins

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> x, y = ("amplitude", [0.2, 0.24]), ("omega", [0.49, 0.5])
    >>> found = mi.operating_map(actuator, drive, x=x, y=y)
    >>> mi.plot_map(found).figure.savefig("map.png")
    """
    table, cells = _table_and_cells(operating_map)
    x, y = table.columns[:2]
    curves = list(_curves(boundaries, x, y))  # before the figure is created
    if ax is None:
        ax = new_figure(1.3).subplots()
    edges = _edges(cells.x), _edges(cells.y)
    if column is None:
        handles = _draw_motions(ax, edges, table, cells)
    else:
        handles = _draw_column(ax, edges, table, cells, column)
    handles += _draw_curves(ax, curves)
    ax.set_xlim(edges[0][0], edges[0][-1])
    ax.set_ylim(edges[1][0], edges[1][-1])
    label_axis(ax.xaxis, parameter_label(table, x))
    label_axis(ax.yaxis, parameter_label(table, y))
    legend_above(ax, handles, by_row=True, handleheight=1.0)
    return ax


def _table_and_cells(subject: Any) -> tuple[pd.DataFrame, Cells]:
    """Return the table of a map and its cells."""
    values: list[Any] = [None, None]
    table = subject
    if isinstance(subject, OperatingMap):
        table, values = subject.table, [subject.x.values, subject.y.values]
    elif isinstance(subject, StoredStudy):
        table = subject.table
        values = [subject.identity.get(name, {}).get("values") for name in ("x", "y")]
    if not isinstance(table, pd.DataFrame) or MOTION not in tuple(without_units(table).columns)[2:]:
        allowed = "an OperatingMap, as mems_impact.operating_map returns it, or its table or store"
        raise InvalidParameter("operating_map", type(subject).__name__, allowed)
    table = without_units(table)
    indices = []
    for i, axis_values in enumerate(values):
        coordinates = table.iloc[:, i].to_numpy(dtype=float)
        values[i] = np.unique(
            coordinates if axis_values is None else np.asarray(axis_values, dtype=float)
        )
        indices.append(np.searchsorted(values[i], coordinates))
    if not all(map(len, values)):
        raise InvalidParameter("operating_map", None, "", problem="no finished points to draw")
    row = np.full((len(values[1]), len(values[0])), -1)
    row[indices[1], indices[0]] = np.arange(len(table))
    return table, Cells(values[0], values[1], row)


def _edges(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the borders of cells about ascending values: halfway between neighbours."""
    if len(values) == 1:
        half = 0.05 * (abs(values[0]) or 1.0)
        return np.array([values[0] - half, values[0] + half])
    middles = 0.5 * (values[1:] + values[:-1])
    first, last = 2.0 * values[0] - middles[0], 2.0 * values[-1] - middles[-1]
    return np.concatenate([[first], middles, [last]])


def _draw_motions(ax: Any, edges: Any, table: pd.DataFrame, cells: Cells) -> list[Any]:
    """Draw the kinds of motions; return the legend entries."""
    kinds = _shared(motions(table))
    ordered = in_order(kinds)
    first = next((kind for kind in ordered if period_of(kind)), "")
    return [
        _fill(
            ax, edges, _cell_mask(cells, kinds == kind), _entry(kind, kind == first), _paint(kind)
        )
        for kind in ordered
    ]


def _entry(kind: str, first: bool) -> str:
    """Return the legend text of a kind of motion; after the `first` period numbers are enough."""
    if kind == OFF:
        return NO_IMPACTS
    if not period_of(kind):
        return kind
    number = kind.removeprefix("period ")
    if number.endswith(AND_MORE):
        number = f"\N{GREATER-THAN OR EQUAL TO} {number.removesuffix(AND_MORE)}"
    return f"period {number}" if first else number


def _shared(kinds: pd.Series) -> pd.Series:
    """Return the kinds of motions, with one kind for all periods of the last colour."""
    long = sorted(
        period for period in map(period_of, kinds.unique()) if period >= len(PERIOD_COLORS)
    )
    if len(long) < 2:
        return kinds
    return kinds.mask(kinds.map(period_of) >= long[0], f"period {long[0]}{AND_MORE}")


def _paint(kind: str) -> Paint:
    period = period_of(kind)
    if period:
        return Paint(PERIOD_COLORS[min(period, len(PERIOD_COLORS)) - 1])
    return MOTIONS.get(kind, OTHER_PAINT)


def _cell_mask(cells: Cells, chosen: pd.Series) -> NDArray[np.bool_]:
    """Return the cells of the selected rows."""
    return (cells.row >= 0) & chosen.to_numpy(dtype=bool)[cells.row]


def _fill(ax: Any, edges: Any, mask: NDArray[np.bool_], label: str, paint: Paint) -> Any:
    """Fill cells; return their legend entry."""
    from matplotlib.colors import ListedColormap
    from matplotlib.patches import Patch, PathPatch

    field = np.ma.masked_where(~mask, np.zeros(mask.shape))
    ax.pcolormesh(*edges, field, cmap=ListedColormap([paint.color]), rasterized=True)
    if paint.hatch:
        # A mesh has no hatching, and contours of cell centres do not end at cell edges.
        hatched = PathPatch(_region(edges, mask), facecolor="none", edgecolor=paint.ink,
                            hatch=paint.hatch, linewidth=0.0, rasterized=True)  # fmt: skip
        ax.add_artist(hatched)  # `add_patch` computes limits from each vertex in Python
    return Patch(facecolor=paint.color, hatch=paint.hatch, edgecolor=paint.ink, linewidth=0.4,
                 label=label)  # fmt: skip


def _region(edges: Any, mask: NDArray[np.bool_]) -> Any:
    """Return the region of cells as one path: a rectangle per run of neighbours in a row.

    Hatching of a path of its own for each cell takes a millisecond per cell.
    """
    from matplotlib.path import Path

    across, up = edges
    ends = np.diff(np.pad(mask, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    (row, first), (_, last) = np.nonzero(ends == 1), np.nonzero(ends == -1)
    left, right, low, high = across[first], across[last], up[row], up[row + 1]
    x, y = [left, right, right, left, left], [low, low, high, high, low]
    codes = [Path.MOVETO, Path.LINETO, Path.LINETO, Path.LINETO, Path.CLOSEPOLY]
    return Path(np.stack([np.ravel(x, "F"), np.ravel(y, "F")], axis=1), codes * len(row))


def _draw_column(ax: Any, edges: Any, table: pd.DataFrame, cells: Cells, column: str) -> list[Any]:
    """Draw a numeric column, grey for missing values; return the legend entries."""
    numbers = [str(name) for name in table.columns[2:] if table[name].dtype.kind in "fiub"]
    if column not in numbers:
        raise InvalidParameter("column", column, f"one of {', '.join(numbers)}")
    values = table[column].astype(float)
    silent = table[MOTION].isin(STATIONARY_STATUSES)
    without = values.isna() | (silent & (values == 0.0))
    field = np.ma.masked_where(~_cell_mask(cells, ~without), values.to_numpy()[cells.row])
    handles = []
    if without.any():
        silent_kinds = in_order(table[MOTION][without].astype(str))
        label = ", ".join(_entry(kind, first=True) for kind in silent_kinds)
        handles.append(_fill(ax, edges, _cell_mask(cells, without), label, MOTIONS["off"]))
    if field.count():
        mesh = ax.pcolormesh(*edges, field, cmap="viridis", rasterized=True)
        bar = ax.figure.colorbar(mesh, ax=ax)
        label_axis(bar.ax.yaxis, label_of(table, column))
    return handles


class Line(NamedTuple):
    """A boundary: its kind, and points along it, NaN where it is broken."""

    kind: str
    points: NDArray[np.float64]  # shape (n, 2)


def _curves(boundaries: Any, x: str, y: str) -> Iterator[Line]:
    """Yield the lines of all boundaries in the parameters of the map."""
    single = isinstance(boundaries, pd.DataFrame) or hasattr(boundaries, "table")
    curves: Iterable[Any] = [boundaries] if single else boundaries
    if not isinstance(curves, Sequence):
        raise _no_boundary(boundaries, x, y)
    for each in curves:
        table = each if isinstance(each, pd.DataFrame) else getattr(each, "table", None)
        table = without_units(table) if isinstance(table, pd.DataFrame) else None
        if table is None or not {x, y} <= set(table.columns):
            raise _no_boundary(each, x, y)
        if "boundary" in table:  # of a chart, whose first parameter is the abscissa
            abscissa = next(name for name in table.columns if name in (x, y))
            for name, rows in table.groupby("boundary", sort=False):
                along = rows.sort_values(abscissa)
                yield Line(str(name), along[[x, y]].to_numpy(dtype=float))
        else:
            points = table[[x, y]].astype(float)
            if "admissible" in table:
                points = points.where(table["admissible"].astype(bool))
            yield Line(getattr(each, "kind", "boundary"), points.to_numpy())


def _no_boundary(value: Any, x: str, y: str) -> InvalidParameter:
    allowed = f"curves over {x} and {y}: of continue_curve or operating_chart, or their tables"
    return InvalidParameter("boundaries", type(value).__name__, allowed)


def _draw_curves(ax: Any, curves: Sequence[Line]) -> list[Any]:
    """Draw boundaries above white lines; return the entries of the legend."""
    styles: dict[str, dict[str, Any]] = {}
    for kind, _ in curves:
        look = {"color": "black", "linestyle": LINES[len(styles) % len(LINES)], "zorder": 4}
        styles.setdefault(kind, boundary_line(kind) if kind in SWITCHING else look)
    handles = {}
    for kind, points in curves:
        look = styles[kind]
        # A white line below sets dashes off without rims of their own.
        ax.plot(*points.T, color="white", linewidth=thickness(1.0) + 1.4, zorder=3)
        (handles[kind],) = ax.plot(*points.T, label=kind, **look)
    return list(handles.values())
