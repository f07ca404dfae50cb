"""What keeps a figure from being read: texts or markers over each other, cut off or too small."""

from itertools import combinations
from string import ascii_lowercase

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from mems_impact.plotting.labels import PANEL_LETTER

SMALLEST = 7.0  # pt
DOT = 3.5  # pt
SLACK = 1.0  # px by which boxes may touch
HIGHEST_LEGEND = 0.1  # of the figure


def texts_of(figure):
    """Return all texts that are seen, the numbers at ticks within the axes among them."""
    found = list(figure.texts)
    for ax in all_axes(figure):
        found += ax.texts
        if ax.axison:
            found += [ax.title, ax._left_title, ax._right_title]
            for axis in (ax.xaxis, ax.yaxis):
                low, high = sorted(axis.get_view_interval())
                room = 1e-9 * (high - low)
                ticks = [
                    t for t in axis.get_major_ticks() if low - room <= t.get_loc() <= high + room
                ]
                found += [axis.label, *(t.label1 for t in ticks), *(t.label2 for t in ticks)]
                found.append(axis.get_offset_text())
        legend = ax.get_legend()
        if legend is not None:
            found += [*legend.get_texts(), legend.get_title()]
    return [text for text in found if text.get_visible() and text.get_text().strip()]


def all_axes(figure):
    return [each for ax in figure.axes for each in (ax, *ax.child_axes)]


def letters(figure):
    """Return what is wrong with the letters of panels, in words."""
    panels = [ax for ax in figure.axes if ax.get_subplotspec() is not None and ax.axison]
    panels = [ax for i, ax in enumerate(panels)
              if all(ax.get_position().bounds != other.get_position().bounds
                     for other in panels[:i])]  # fmt: skip
    texts = [text.get_text() for text in texts_of(figure) if text.get_gid() == PANEL_LETTER]
    known = [f"({letter})" for letter in ascii_lowercase[: len(panels)]]
    expected = known if len(panels) > 1 else []
    return [] if texts == expected else [f"panels have letters {texts}, not {expected}"]


def overlaps(ax):
    """Return the special points whose markers lie over each other, in words."""
    markers = [line for line in ax.lines if line.get_zorder() == 7]
    sizes = [line.get_markersize() * ax.figure.dpi / 72.0 for line in markers]
    places = [line.get_transform().transform(line.get_xydata())[0] for line in markers]
    return [
        "special points lie over each other"
        for (a, size), (b, other) in combinations(zip(places, sizes, strict=True), 2)
        if ((a - b) ** 2).sum() ** 0.5 < 0.5 * (size + other)
    ]


def astray(ax):
    """Return the labels of special points that are nearer to another marker, in words."""
    labels = [text for text in ax.texts if text.get_zorder() == 8]
    markers = [line for line in ax.lines if line.get_zorder() == 7]
    if len(labels) != len(markers):
        return []
    places = np.array([line.get_transform().transform(line.get_xydata())[0] for line in markers])
    found = []
    for own, label in enumerate(labels):
        box = Text.get_window_extent(label)
        gaps = np.hypot(*(places - np.clip(places, box.min, box.max)).T)
        if gaps.argmin() != own:
            found.append(f"{label.get_text()!r} is beside the marker of another point")
    return found


def flaws(figure):
    """Return what is wrong with a figure, in words."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    found = []
    boxes = [(text, text.get_window_extent()) for text in texts_of(figure)]
    for text, box in boxes:
        words = repr(text.get_text())
        if (
            box.x0 < -SLACK
            or box.y0 < -SLACK
            or box.x1 > figure.bbox.x1 + SLACK
            or box.y1 > figure.bbox.y1 + SLACK
        ):
            found.append(f"{words} is cut off")
        if text.get_fontsize() < SMALLEST:
            found.append(f"{words} has {text.get_fontsize():.2g} pt")
    for (one, a), (other, b) in combinations(boxes, 2):
        wide = min(a.x1, b.x1) - max(a.x0, b.x0)
        high = min(a.y1, b.y1) - max(a.y0, b.y0)
        if wide > SLACK and high > SLACK:
            found.append(f"{one.get_text()!r} lies over {other.get_text()!r}")
    found += letters(figure)
    for ax in all_axes(figure):
        found += overlaps(ax) + astray(ax)
        if ax.get_legend() is None:
            continue
        box = ax.get_legend().get_window_extent()
        if box.x0 < 0.0 or box.x1 > figure.bbox.x1 or box.y1 > figure.bbox.y1:
            found.append("a legend is cut off")
        if box.height > HIGHEST_LEGEND * figure.bbox.height:
            share = box.height / figure.bbox.height
            found.append(f"a legend takes {share:.0%} of the height")
        for other in all_axes(figure):
            if other.bbox.overlaps(box.padded(-SLACK)):
                found.append("a legend lies over what is drawn")
        for handle in ax.get_legend().legend_handles:
            marker = getattr(handle, "get_marker", lambda: "None")()
            if marker not in ("None", None, "") and handle.get_markersize() < DOT:
                found.append(f"the dot of {handle.get_label()!r} is not seen")
    return found
