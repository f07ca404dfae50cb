"""The automaton as a diagram: modes in a grid, transitions between them (Fig. 2 of the paper)."""

from __future__ import annotations

from typing import Any

import pandas as pd

from mems_impact.actuator.automaton import CONTACT, FRICTION
from mems_impact.plotting.labels import legend_above
from mems_impact.plotting.style import color, new_figure, styled

__all__ = ["plot_automaton"]

# Kinds of transitions: meaning of the colour, line and how far the arrow bends, also over two rows.
KINDS: dict[str, dict[str, Any]] = {
    "impact": {"color": "impact", "linestyle": "-", "bend": 0.12, "long": 0.42},
    "chatter ends": {"color": "impact", "linestyle": (0, (1, 1.5)), "bend": 0.22, "long": 0.5},
    "release": {"color": "motion", "linestyle": (0, (6, 1.5, 1, 1.5)), "bend": 0.14, "long": 0.5},
    "slip end": {"color": "frame", "linestyle": "-", "bend": 0.12, "long": 0.6},
    "break-away": {"color": "frame", "linestyle": (0, (4, 2)), "bend": 0.24, "long": 0.5},
}
COLUMNS = ("left", "free", "right")  # where the block is, as seen
ROWS = ("forward", "stuck", "backward")
WIDTH, HEIGHT = 3.4, 2.2  # between the middles of two modes
PAPER = {"facecolor": "0.9", "linewidth": 1.0}
"""How the two phases of the paper's flow chart stand out."""
BOX = (0.72, 0.45)  # half width and half height of a mode


@styled
def plot_automaton(table: pd.DataFrame, ax: Any = None) -> Any:
    """Draw the modes as boxes and the transitions as arrows.

    Parameters
    ----------
    table : DataFrame
        One row a transition: mode before, event, mode after (see `tables.transitions`).
    ax : matplotlib Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.
    """
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    if ax is None:
        ax = new_figure(1.35).subplots()
    places = {
        f"{friction}-{contact}": (COLUMNS.index(contact) * WIDTH, -ROWS.index(friction) * HEIGHT)
        for contact in CONTACT
        for friction in FRICTION
    }
    reached = set(table["mode before"]) | set(table["mode after"])
    boxes = {name: _box(ax, name, x, y, name in reached) for name, (x, y) in places.items()}
    arrows = {
        (_kind(row["event"]), row["mode before"], row["mode after"]) for _, row in table.iterrows()
    }
    loops: dict[str, int] = {}
    for kind, before, after in sorted(arrows):
        if before == after:
            loops[before] = loops.get(before, 0) + 1
            _loop(ax, *places[before], loops[before] - 1, KINDS[kind])
        else:
            _arrow(ax, places, boxes, before, after, KINDS[kind])
    drawn = {kind for kind, _, _ in arrows}
    handles: list[Any] = [
        Line2D([], [], color=color(style["color"]), linestyle=style["linestyle"], label=kind)
        for kind, style in KINDS.items()
        if kind in drawn
    ]
    if len(reached) < len(places):
        handles.append(Patch(label="never occurs", **_border(False)))
    legend_above(ax, handles)
    texts = ("block on the\nleft stopper", "block free", "block on the\nright stopper")
    aside: dict[str, Any] = {"color": "0.3", "fontsize": "small"}
    for i, text in enumerate(texts):
        ax.text(i * WIDTH, -2.35 * HEIGHT, text, ha="center", va="top", **aside)
    for i, text in enumerate(("frame slides\nforward", "frame\nstuck", "frame slides\nbackward")):
        ax.text(-0.34 * WIDTH, -i * HEIGHT, text, ha="right", va="center", rotation=90, ma="center",
                **aside)  # fmt: skip
    ax.set_xlim(-0.62 * WIDTH, 2.35 * WIDTH)
    ax.set_ylim(-2.75 * HEIGHT, 0.45 * HEIGHT)
    ax.set_aspect("equal")
    ax.set_axis_off()
    return ax


def _kind(event: str) -> str:
    return next(kind for kind in KINDS if kind in event)


def _border(reached: bool) -> dict[str, Any]:
    """Return how the box of a mode looks."""
    return {
        "facecolor": "white", "edgecolor": "black" if reached else "0.7", "linewidth": 0.6,
        "linestyle": "-" if reached else (0, (3, 2)),
    }  # fmt: skip


def _box(ax: Any, name: str, x: float, y: float, reached: bool) -> Any:
    from matplotlib.patches import FancyBboxPatch

    # A mode that never occurs is faint.
    paper = name in ("stuck-free", "forward-free", "backward-free")
    patch = FancyBboxPatch(
        (x - BOX[0], y - BOX[1]), 2 * BOX[0], 2 * BOX[1], boxstyle="round,pad=0.06",
        zorder=3, **{**_border(reached), **(PAPER if paper else {})},
    )  # fmt: skip
    ax.add_patch(patch)
    text = name.replace("-", "\n")
    color = "black" if reached else "0.55"
    ax.text(x, y, text, ha="center", va="center", fontsize="small", color=color, zorder=4)
    return patch


def _arrow(
    ax: Any, places: Any, boxes: Any, before: str, after: str, style: dict[str, Any]
) -> None:
    from matplotlib.patches import FancyArrowPatch

    # From top to bottom of a column the arrow goes round the box in the middle.
    rows = abs(places[before][1] - places[after][1]) / HEIGHT
    bend = style["long"] if rows > 1.5 else style["bend"]
    ax.add_patch(
        FancyArrowPatch(
            places[before],
            places[after],
            connectionstyle=f"arc3,rad={bend}",
            arrowstyle="-|>",
            mutation_scale=6,
            color=color(style["color"]),
            linestyle=style["linestyle"],
            linewidth=0.9,
            patchA=boxes[before],
            patchB=boxes[after],
            shrinkA=1,
            shrinkB=2,
            zorder=2,
        )
    )


def _loop(ax: Any, x: float, y: float, number: int, style: dict[str, Any]) -> None:
    from matplotlib.patches import FancyArrowPatch

    # At the upper corners of the box, where no other arrow begins or ends.
    side = -1.0 if number % 2 == 0 else 1.0
    start = (x + side * (BOX[0] - 0.28), y + BOX[1] + 0.08)
    end = (x + side * (BOX[0] + 0.08), y + BOX[1] - 0.16)
    ax.add_patch(
        FancyArrowPatch(
            start,
            end,
            connectionstyle=f"arc3,rad={-side * 1.6}",
            arrowstyle="-|>",
            mutation_scale=6,
            color=color(style["color"]),
            linestyle=style["linestyle"],
            linewidth=0.9,
            zorder=2,
        )
    )
