"""Axis labels with SI prefixes, and placement of labels."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import product
from string import ascii_lowercase
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.units import si_prefixed

if TYPE_CHECKING:
    import pandas as pd

# --- Placement of labels and legends

Floats = NDArray[np.float64]
LABEL_DISTANCES = (
    0.5,
    1.2,
    2.2,
    3.4,
)  # distances of a label from its point, in heights of its text
SIDES = tuple(
    side for side in product((1, -1, 0, 0.5, -0.5), (1, -1, 0)) if abs(side[0]) + side[1] ** 2 >= 1
)
PAD = 1.5  # pt, about a label
DOT = 4.0  # pt, smallest visible dot in a legend
PANEL_LETTER = "panel letter"  # identifier of such texts
COMPACT_SPACES = {"handlelength": 1.4, "handletextpad": 0.4, "columnspacing": 0.8}
"""Spaces of a legend, in sizes of its text, that would have too many rows otherwise."""
ROW_HEIGHT = 1.05  # of a row of a legend, in sizes of its text
LEGEND_SHARE = 0.1  # height of a legend at most, as a part of the figure, where it can be
DOT_COST = 0.05  # of a dot of a cloud under a text, where a point of a line costs 1
OVERLAP_COST, OUTSIDE_COST = 1e4, 1e5  # costs of a place on another text, or outside the axes
NEARER_COST = 100.0  # cost of a place nearer to another point than to its own


class Mark(NamedTuple):
    """A point, its label, and the shape and colour of its marker."""

    text: str
    x: float
    y: float
    marker: str = "o"
    face: str = "white"


@lru_cache(1024)
def text_size(text: str, size: float) -> tuple[float, float]:
    """Return width and height of a text in points; both without a renderer."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextPath

    lines = text.split("\n")
    widths = [
        TextPath((0.0, 0.0), line, prop=FontProperties(size=size)).get_extents().width
        for line in lines if line.strip()
    ]  # fmt: skip
    return max(widths, default=0.0), 1.25 * size * len(lines)


MARKER_SIZE, MARKER_EDGE = 4.5, 0.7  # pt: of a special point
FAN_GAP = 0.8  # pt between markers of points that coincide
FAN_ANGLES = 12  # directions in which such markers are placed


def mark_points(ax: Any, marks: Sequence[Mark]) -> list[Any]:
    """Mark special points, coinciding ones side by side, and return their labels.

    All other artists are drawn before.
    """
    from matplotlib.lines import Line2D

    if not marks:
        return []
    root = _root(ax)
    ax.update_datalim([(mark.x, mark.y) for mark in marks])
    ax.autoscale_view()
    root.draw_without_rendering()  # the layout decides where points are
    points = ax.transData.transform([(mark.x, mark.y) for mark in marks])
    shifts = _fan(points * 72.0 / root.dpi, _dense(ax)[:, :2] * 72.0 / root.dpi)
    for mark, shift in zip(marks, shifts, strict=True):
        ax.add_artist(
            Line2D(
                [mark.x], [mark.y], marker=mark.marker, markersize=MARKER_SIZE, color=mark.face,
                linestyle="none", markeredgecolor="black", markeredgewidth=MARKER_EDGE, zorder=7,
                transform=_shifted(ax, shift),
            )
        )  # fmt: skip
    return label_points(ax, marks, shifts)


def _shifted(ax: Any, shift: Floats) -> Any:
    """Return the transformation of data by which artists are shifted [pt]."""
    from matplotlib.transforms import ScaledTranslation

    right, up = shift / 72.0
    return ax.transData + ScaledTranslation(right, up, _root(ax).dpi_scale_trans)


def _fan(points: Floats, lines: Floats) -> Floats:
    """Return the shifts in points (pt) by which markers that would overlap stand side by side.

    The markers of a group form a regular polygon about its middle, turned so that they cover as few
    lines as possible.
    """
    spacing = MARKER_SIZE + MARKER_EDGE + FAN_GAP
    shifts = np.zeros_like(points)
    groups: list[list[int]] = []
    for i, point in enumerate(points):
        near = [g for g in groups if min(np.hypot(*(points[g] - point).T)) < spacing]
        merged = [member for group in near for member in group]
        groups = [*(g for g in groups if g not in near), [*merged, i]]
    for group in groups:
        count = len(group)
        if count < 2:
            continue
        radius = 0.5 * spacing / math.sin(math.pi / count)
        middle = points[group].mean(axis=0)

        def corners(turn: float, count: int = count, radius: float = radius) -> Floats:
            angles = turn + 2.0 * np.pi * np.arange(count) / count
            return radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)

        def cost(turn: float, group: list[int] = group, middle: Floats = middle) -> float:
            centers = middle + corners(turn)
            covered = (np.abs(lines[:, None] - centers) < 0.5 * spacing).all(axis=2).sum()
            return float(covered) + float(np.hypot(*(centers - points[group]).T).sum())

        candidates = 2.0 * np.pi * np.arange(FAN_ANGLES) / FAN_ANGLES
        best = min(candidates, key=cost)
        shifts[group] = middle + corners(best) - points[group]
    return shifts


def label_points(
    ax: Any, marks: Sequence[Mark], shifts: Floats | None = None, **options: Any
) -> list[Any]:
    """Write labels beside points, so that they overlap neither each other nor, mostly, lines.

    All other artists are drawn before. `shifts` of markers from their points, shape (n, 2), are in
    pt; `options` are those of the texts. Returns the annotations.
    """
    from matplotlib import rcParams
    from matplotlib.font_manager import FontProperties

    if not marks:
        return []
    _root(ax).draw_without_rendering()  # the layout decides where points are
    scale = ax.figure.dpi / 72.0
    size = FontProperties(size=options.setdefault("fontsize", "small")).get_size_in_points()
    aside = np.zeros((len(marks), 2)) if shifts is None else shifts
    points = ax.transData.transform([(mark.x, mark.y) for mark in marks]) + scale * aside
    lines = _dense(ax)
    frame = np.array(ax.bbox.extents)
    radius = 0.8 * scale * float(rcParams["lines.markersize"]) + scale
    occupied = [np.array([*(point - radius), *(point + radius)]) for point in points]
    annotations = []
    for number, (mark, point, move) in enumerate(zip(marks, points, aside, strict=True)):
        extent = scale * (np.array(text_size(mark.text, size)) + PAD)
        best, cost, away = occupied[0], np.inf, np.zeros(2)
        for far, side in product(LABEL_DISTANCES, SIDES):
            shift = np.trunc(side) * (radius + (far - 0.5) * scale * size)
            low = point + shift + 0.5 * (np.array(side) - 1.0) * extent
            box = np.concatenate([low, low + extent])
            gaps = np.hypot(*np.maximum(np.maximum(low - points, points - low - extent), 0.0).T)
            nearer = np.delete(gaps, number).min(initial=np.inf) < gaps[number] + scale
            price = _price(box, occupied, lines, frame) + 3.0 * far + NEARER_COST * float(nearer)
            if price < cost:
                best, cost, away = box, price, shift
        occupied.append(best)
        middle = 0.5 * (best[:2] + best[2:]) - point
        leader = {"arrowstyle": "-", "linewidth": 0.4, "shrinkA": 0.0, "shrinkB": 2.0}
        annotations.append(
            ax.annotate(
                mark.text, (mark.x, mark.y), xycoords=_shifted(ax, move),
                xytext=tuple(middle / scale), textcoords="offset points", ha="center", va="center",
                zorder=8,
                arrowprops=leader if np.abs(away).max() > radius + scale * size else None,
                **options,
            )
        )  # fmt: skip
    return annotations


def _root(ax: Any) -> Any:
    """Return the figure of axes, which may be in a subfigure."""
    figure = ax.figure
    while getattr(figure, "_parent", None) is not None:
        figure = figure._parent
    return figure


def _dense(ax: Any) -> Floats:
    """Return points along all lines of axes, dense enough to detect overlaps, and their costs.

    Their coordinates in pixels are the first two columns, their costs under a text the third.
    """
    samples = [np.empty((0, 3))]
    for line in ax.lines:
        if line.get_transform() != ax.transData:
            continue
        xy = ax.transData.transform(np.column_stack(line.get_data(orig=False)).astype(float))
        cost = 1.0 if line.get_linestyle() != "None" else DOT_COST
        if cost == 1.0 and len(xy) > 1:
            step = np.hypot(*np.diff(xy, axis=0).T) / 6.0
            counts = np.clip(np.nan_to_num(step, nan=0.0), 1, 200).astype(int)
            weights = [np.linspace(0.0, 1.0, n, endpoint=False)[:, None] for n in counts]
            pairs = zip(xy[:-1], xy[1:], weights, strict=True)
            xy = np.concatenate([a + (b - a) * w for a, b, w in pairs])
        xy = xy[np.isfinite(xy).all(axis=1)]
        samples.append(np.column_stack([xy, np.full(len(xy), cost)]))
    return np.concatenate(samples)


def _price(box: Floats, occupied: Sequence[Floats], lines: Floats, frame: Floats) -> float:
    """Return the cost of a text in `box`."""
    price = OUTSIDE_COST * float((box[:2] < frame[:2]).any() or (box[2:] > frame[2:]).any())
    for other in occupied:
        price += OVERLAP_COST * float((box[:2] < other[2:]).all() and (box[2:] > other[:2]).all())
    points = lines[:, :2]
    return price + float(lines[((points > box[:2]) & (points < box[2:])).all(axis=1), 2].sum())


def label_verticals(ax: Any, lines: Sequence[tuple[float, str]]) -> list[Any]:
    """Write labels along vertical lines, where they overlap neither each other nor curves.

    All other artists are drawn before. A label is broken at a newline only if it is free of
    overlaps there and not in one row. Returns the annotations.
    """
    from matplotlib.font_manager import FontProperties

    if not lines:
        return []
    _root(ax).draw_without_rendering()
    scale = ax.figure.dpi / 72.0
    size = FontProperties(size="small").get_size_in_points()
    curves, frame = _dense(ax), np.array(ax.bbox.extents)
    abscissas = [float(ax.transData.transform((value, 0.0))[0]) for value, _ in lines]
    occupied = [np.array([x - scale, frame[1], x + scale, frame[3]]) for x in abscissas]
    annotations = []
    for (value, text), x in zip(lines, abscissas, strict=True):
        best, cost, chosen = np.zeros(4), np.inf, (text, 1.0)
        rows = (text.replace("\n", " "), text)
        for wrapped, side, share in product(rows, (-1.0, 1.0), np.linspace(1.0, 0.0, 9)):
            length, width = text_size(wrapped, size)
            length, width = scale * (length + 4.0 * PAD), scale * (width + PAD)
            left = x + side * scale - (width if side < 0.0 else 0.0)
            low = frame[1] + share * (frame[3] - frame[1] - length)
            box = np.array([left, low, left + width, low + length])
            price = _price(box, occupied, curves, frame)
            if price < cost:
                best, cost, chosen = box, price, (wrapped, side)
        occupied.append(best)
        wrapped, side = chosen
        middle, width = 0.5 * (best[1] + best[3]), best[2] - best[0]
        annotations.append(
            ax.annotate(
                wrapped, (value, (middle - frame[1]) / (frame[3] - frame[1])),
                xycoords=ax.get_xaxis_transform(), xytext=(side * (1.0 + 0.5 * width / scale), 0.0),
                textcoords="offset points", rotation=90.0, ha="center", va="center",
                fontsize="small", zorder=8,
            )
        )  # fmt: skip
    return annotations


def free_corner(
    ax: Any, width: float, height: float, top: float = 0.97
) -> tuple[float, float] | None:
    """Return the lower left corner of a box that covers neither a line nor a text.

    The box is below `top`; None if there is no place.
    """
    _root(ax).draw_without_rendering()
    to_axes = ax.transAxes.inverted()
    lines = to_axes.transform(_dense(ax)[:, :2])
    texts = [to_axes.transform(text.get_window_extent()) for text in ax.texts]
    left, below = 0.1, 0.1  # for its tick labels
    for y, x in product(np.linspace(top - height, below, 12), np.linspace(left, 0.98 - width, 12)):
        low, high = np.array([x - left, y - below]), np.array([x + width, y + height])
        covered = [((start < high) & (end > low)).all() for start, end in texts]
        if not any(covered) and not ((lines > low) & (lines < high)).all(axis=1).any():
            return float(x), float(y)
    return None


def letter_panels(axes: Sequence[Any]) -> None:
    """Write (a), (b), … at the upper left of panels; nothing at a single panel."""
    for letter, ax in zip(ascii_lowercase, axes if len(axes) > 1 else (), strict=False):
        # Above the numbers at the axis, so that neither a curve nor a title is covered.
        ax.annotate(
            f"({letter})", (0.0, 1.0), xycoords="axes fraction", xytext=(-4.0, 4.0),
            textcoords="offset points", ha="right", va="bottom", annotation_clip=False,
            gid=PANEL_LETTER,
        )  # fmt: skip


def legend_above(
    ax: Any, handles: Sequence[Any] | None = None, *, by_row: bool = False, **options: Any
) -> Any:
    """Put a legend above axes, in as many columns as fit, with visible dots; None without entries.

    Spaces shrink where it would be higher than a tenth of the figure. Entries are all artists with
    labels unless `handles` are given, in rows one after the other if `by_row`.
    """
    from matplotlib import rcParams
    from matplotlib.font_manager import FontProperties

    entries: dict[str, Any] = {}
    for artist in ax.get_legend_handles_labels()[0] if handles is None else handles:
        entries.setdefault(artist.get_label(), artist)
    if not entries:
        return None
    artists = list(entries.values())
    size = FontProperties(size=rcParams["legend.fontsize"]).get_size_in_points()
    text_widths = [text_size(artist.get_label(), size)[0] + PAD for artist in artists]
    _root(ax).draw_without_rendering()  # the layout decides how much room there is
    room, rows = _room(ax), _legend_rows(ax, size)
    regular = {
        "handlelength": float(rcParams["legend.handlelength"]),
        "handletextpad": float(rcParams["legend.handletextpad"]),
        "columnspacing": float(rcParams["legend.columnspacing"]),
    }
    compact = {name: min(regular[name], COMPACT_SPACES[name]) for name in regular}
    if not any(_has_line(artist) for artist in artists):
        compact["handlelength"] = 1.0
    for look in (regular, compact):
        beside = size * (look["handlelength"] + look["handletextpad"])
        widths, gap = np.array(text_widths) + beside, size * look["columnspacing"]
        for columns in range(len(artists), 0, -1):
            order = _filled(len(artists), columns, by_row)
            width = sum(max(widths[column]) for column in order) + gap * (columns - 1)
            if width <= room:
                break
        if math.ceil(len(artists) / columns) <= rows:
            break
    legend = ax.legend(
        handles=[artists[i] for column in order for i in column], ncols=columns,
        loc="lower right", bbox_to_anchor=(1.0, 1.0),
        **{**look, **options},
    )  # fmt: skip
    for handle in legend.legend_handles:
        if hasattr(handle, "set_markersize"):
            handle.set_markersize(max(DOT, handle.get_markersize()))
            if handle.get_fillstyle() == "none":
                handle.set_markeredgewidth(max(0.7, handle.get_markeredgewidth()))
    return legend


def _has_line(artist: Any) -> bool:
    """Return whether a legend shows a line of an artist, not a marker or a patch alone."""
    return hasattr(artist, "get_marker") and artist.get_linestyle() not in ("None", "none", "")


def _legend_rows(ax: Any, size: float) -> int:
    """Return how many rows a legend may have."""
    from matplotlib import rcParams

    height = LEGEND_SHARE * 72.0 * _root(ax).get_figheight()
    gap = size * rcParams["legend.labelspacing"]
    return max(1, math.floor((height - 2.0 * size * rcParams["legend.borderpad"] + gap)
                             / (ROW_HEIGHT * size + gap)))  # fmt: skip


def _room(ax: Any) -> float:
    """Return the available width of a legend above axes, in points."""
    box, figure = ax.get_position(), ax.figure
    spec = ax.get_subplotspec()
    first = spec is None or spec.is_first_col()
    if any(text.get_gid() == PANEL_LETTER for text in ax.texts):
        first = False
    share = box.x1 - (0.0 if first else box.x0)
    return float(share * 72.0 * figure.bbox.width / figure.dpi) - 5.0 * PAD


def _filled(count: int, columns: int, by_row: bool) -> list[list[int]]:
    """Return which entries of a legend stand in each of its columns."""
    if by_row:
        return [list(range(column, count, columns)) for column in range(columns)]
    return [[int(i) for i in part] for part in np.array_split(np.arange(count), columns)]


# --- Axis labels and ticks

GREEK = [
    "alpha", "beta", "gamma", "delta", "epsilon", "zeta", "eta", "theta", "iota", "kappa",
    "lambda", "mu", "nu", "xi", "pi", "rho", "sigma", "tau", "upsilon", "phi", "chi", "psi",
    "omega", "Gamma", "Delta", "Theta", "Lambda", "Xi", "Pi", "Sigma", "Phi", "Psi", "Omega",
]  # fmt: skip


class Label(NamedTuple):
    """Label of an axis: text, a unit in brackets, and text after it."""

    text: str
    unit: str = ""
    suffix: str = ""


def symbol(name: str, symbols: Mapping[str, str] = MappingProxyType({})) -> str:
    r"""Return the symbol of a state or a parameter for labels; the name if it is a word.

    `symbols` do not follow from names.

    >>> symbol("x2"), symbol("v_max"), symbol("wall")
    ('$x_2$', '$v_{\\mathrm{max}}$', 'wall')
    """
    if name in symbols:
        return symbols[name]
    match = re.fullmatch(rf"({'|'.join(GREEK)}|[A-Za-z])(?:_?(\d+)|_([A-Za-z0-9]+))?", name)
    if not match:
        return name
    letter, index = match[1], match[2] or match[3] or ""
    if len(letter) > 1:
        letter = f"\\{letter}"
    if len(index) > 1:
        index = rf"{{\mathrm{{{index}}}}}"
    return f"${letter}_{index}$" if index else f"${letter}$"


def label_of(table: pd.DataFrame, name: str, text: str | None = None) -> Label:
    """Return the label of a column of a table, by its name or in other words."""
    return Label(name if text is None else text, table.attrs.get("units", {}).get(name, ""))


def parameter_label(table: pd.DataFrame, name: str) -> Label:
    """Return the label of an axis for a parameter: its symbol, or its name if it is a word.

    The label has both if the symbol does not follow from the name.
    """
    symbols = table.attrs.get("symbols", {})
    sign, derived = symbol(name, symbols), name not in symbols
    return label_of(table, name, sign if derived else f"{name} {sign}")


def crosses(captions: Mapping[str, Any]) -> str:
    """Return the equation of the Poincaré section from a table's ``attrs``; empty without one."""
    if not captions.get("section"):
        return ""
    name, level = captions["section"]
    sign = symbol(name)
    word = name.replace("_", r"\_")
    sign = sign.strip("$") if sign != name else rf"\mathrm{{{word}}}"
    return f"${sign} = {level:g}$"


def on_section(table: pd.DataFrame, state: str) -> Label:
    """Return the axis label of a state on the section of a table."""
    label = label_of(table, state, symbol(state))
    if table.attrs.get("equilibria"):
        return label
    equation = crosses(table.attrs)
    default = " where periods begin" if table.attrs.get("forced", True) else ", largest value"
    suffix = f" at {equation}" if equation else default
    if table.attrs.get("maxima"):
        suffix = ", maxima"
    if "section" not in table.attrs:  # read back from a file
        suffix = " on the section"
    return label._replace(suffix=suffix)


def prefixed(unit: str, largest: float) -> tuple[int, str]:
    """Return the power of ten for values up to `largest`, and its label.

    >>> prefixed("m", 2.3e-6), prefixed("", 2.3e-4), prefixed("V", 40.0)
    ((-6, 'µm'), (-4, '$10^{-4}$'), (0, 'V'))
    >>> prefixed("Hz", 5200.0), prefixed("s", 0.03), prefixed("", 0.03)
    ((3, 'kHz'), (-3, 'ms'), (0, ''))
    """
    if not (largest > 0.0 and math.isfinite(largest)):
        return 0, unit
    thousands, name = si_prefixed(unit, largest)
    if thousands:
        return thousands, name
    power = math.floor(math.log10(largest))
    if -2 <= power <= 3 or name != unit:
        return 0, unit
    return power, " ".join(filter(None, (f"$10^{{{power}}}$", unit)))


def amount(value: float, unit: str, digits: int) -> str:
    """Return a value with its unit, as an axis shows it: "60 nm".

    >>> amount(6e-8, "m", 3), amount(-3.43e-5, "", 3)
    ('60 nm', '-3.43e-05')
    """
    power, name = prefixed(unit, abs(value)) if unit else (0, unit)
    if "$" in name:  # a unit without prefixes
        power, name = 0, unit
    return f"{value / 10.0**power:.{digits}g} {name}".rstrip()


def label_axis(axis: Any, label: Label) -> None:
    """Label an axis and its ticks: plain numbers, with their power of ten in the unit.

    The drawn data stay in the units of their tables.
    """
    limits = getattr(axis.axes, f"get_{axis.axis_name}lim")()
    power, unit = prefixed(label.unit, float(np.max(np.abs(limits))))
    axis.set_major_formatter(_plain(power))
    # The number of ticks depends on the font size: use that of the style, wherever the figure is
    # saved.
    axis.set_tick_params(labelsize=axis.get_ticklabels()[0].get_fontsize())
    if axis.axis_name == "x":
        _thin(axis)
    bracketed_unit = f"[{unit}]" if unit else ""
    text = " ".join(filter(None, (label.text, bracketed_unit))) + label.suffix
    if axis.axis_name == "y" and bracketed_unit and label.text:
        length = 72.0 * axis.axes.bbox.height / axis.axes.figure.dpi
        if text_size(text, axis.label.get_fontsize())[0] > 0.95 * length:
            text = f"{label.text}\n{bracketed_unit}{label.suffix}"
    axis.set_label_text(text)


def _plain(power: int) -> Any:
    """Return a formatter in units of a power of ten, with the necessary decimals."""
    from matplotlib.ticker import Formatter

    class Plain(Formatter):
        def __call__(self, value: float, pos: int | None = None) -> str:
            return self.format_ticks([value])[0] if pos is not None else f"{value:.6g}"

        def format_ticks(self, values: Sequence[float]) -> list[str]:
            scaled = np.asarray(values, dtype=float) / 10.0**power
            step = float(np.min(np.diff(scaled))) if len(scaled) > 1 else 0.0
            close = 1e-3 * abs(step) or 1e-6 * float(np.max(np.abs(scaled), initial=1.0))
            digits = next((n for n in range(9) if np.all(abs(scaled - scaled.round(n)) < close)), 9)
            return [f"{n + 0.0:.{digits}f}".replace("-", "\N{MINUS SIGN}")
                    for n in scaled.round(digits)]  # fmt: skip

    return Plain()


def _thin(axis: Any) -> None:
    """Reduce the ticks of a horizontal axis until their labels fit."""
    from matplotlib.ticker import AutoLocator, MaxNLocator

    if not isinstance(axis.get_major_locator(), AutoLocator):
        return
    size = axis.get_ticklabels()[0].get_fontsize()
    low, high = sorted(axis.axes.get_xlim())
    inside = [value for value in axis.get_majorticklocs() if low <= value <= high]
    numbers = axis.get_major_formatter().format_ticks(inside)
    widest = max((text_size(number, size)[0] for number in numbers), default=0.0)
    # Estimate before the final layout, which has slightly more room.
    room = 72.0 * axis.axes.bbox.width / axis.axes.figure.dpi
    max_ticks = max(2, math.floor(room / (1.3 * widest + 1.0)))
    if len(inside) > max_ticks:
        axis.set_major_locator(MaxNLocator(max_ticks, steps=[1, 2, 2.5, 5, 10]))
