"""Diagrams of the paper: the automaton (Fig. 2), displacement (Fig. 3), switching (Figs 4 to 6)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from mems_impact.actuator.automaton import CONTACT, FRICTION
from mems_impact.plotting.bifurcation import draw_switches, plot_branch
from mems_impact.plotting.labels import Label, label_axis, label_of, legend_above, letter_panels
from mems_impact.plotting.style import DASHES, color, graded, new_figure, styled, thickness

if TYPE_CHECKING:
    from mems_impact.actuator.results import ActuatorRun
    from mems_impact.analysis.branch import Branch

__all__ = ["MEASURED", "plot_automaton", "plot_displacement", "plot_switching"]

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
PHASE_OF_PAPER = {"facecolor": "0.9", "linewidth": 1.0}
"""How the two phases of the paper's flow chart stand out."""
BOX = (0.72, 0.45)  # half width and half height of a mode
SAMPLES_PER_PERIOD = 2000
MEASURED = (100.0, 20e-9)
"""Amplitude [V] and displacement per blow [m] at 1 Hz that the paper measured."""


@styled
def plot_automaton(table: pd.DataFrame, ax: Any = None) -> Any:
    """Draw the modes as boxes and the transitions as arrows.

    Parameters
    ----------
    table : DataFrame
        One row a transition: mode before, event, mode after, and how often it was seen.
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
    legend_above(ax, handles)
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
        zorder=3, **{**_border(reached), **(PHASE_OF_PAPER if paper else {})},
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


@styled
def plot_displacement(
    table: pd.DataFrame, run: ActuatorRun, pull_in: float, ax: Any = None
) -> tuple[Any, Any, Any]:
    """Draw displacement per blow over the amplitude, and the motion over one voltage cycle.

    Parameters
    ----------
    table : DataFrame
        Frequency, amplitude, displacement per blow.
    run : ActuatorRun
        Of at least two forcing periods after the transient, in SI.
    pull_in : float
        [V]
    ax : three matplotlib Axes, optional
        For displacement, block and frame; a new figure by default.

    Returns
    -------
    tuple of Axes
    """
    if ax is None:
        ax = new_figure(2.2).subplots(3, height_ratios=(5, 3, 2))
        letter_panels(ax)
        ax[1].sharex(ax[2])
    response, block, frame = ax
    frequency, amplitude, displacement = table.columns[:3]
    groups = table.groupby(frequency)
    for look, (hertz, rows) in zip(graded(groups.ngroups), groups, strict=True):
        response.plot(rows[amplitude], rows[displacement], markersize=3.0,
                      label=f"{hertz:g} Hz", **look)  # fmt: skip
    guide = color("guide")
    response.axvline(pull_in, color=guide, label="pull-in", **DASHES)
    cross: dict[str, Any] = {"marker": "x", "markersize": 6, "linestyle": "none", "zorder": 5}
    response.plot(*MEASURED, color="black", label="measured, 1 Hz", **cross)
    label_axis(response.xaxis, Label("amplitude", "V"))
    label_axis(response.yaxis, Label("displacement per blow", "m"))
    legend_above(response)

    begin = run.extent[1] - 2.0
    samples = run.samples(SAMPLES_PER_PERIOD, begin, None)
    time = samples["t"] - samples["t"].iloc[0]
    (motion,) = block.plot(time, samples["x2"], color=color("motion"), linewidth=thickness(0.8),
                           label="block")  # fmt: skip
    voltage = block.twinx()
    period = run.drive.period
    volts = run.drive.value(np.remainder(samples["t"].to_numpy(), 2.0 * period))
    (driven,) = voltage.plot(time, volts, color=color("voltage"), linewidth=thickness(0.8),
                             linestyle=(0, (4, 1.5)), label="voltage")  # fmt: skip
    voltage.spines["right"].set_visible(True)
    stopper = block.axhline(run.actuator.delta, color=guide, label="stopper", **DASHES)
    frame.plot(time, samples["x1"] - samples["x1"].iloc[0], color=color("motion"))
    block.tick_params(labelbottom=False)
    frame.set_xlim(0.0, math.ceil(1e6 * time.iloc[-1]) / 1e6)
    label_axis(voltage.yaxis, Label("voltage", "V"))
    label_axis(block.yaxis, label_of(samples, "x2", "$x_2$"))
    label_axis(frame.yaxis, label_of(samples, "x1", "$x_1$"))
    label_axis(frame.xaxis, Label("time", "s"))
    legend_above(block, [motion, driven, stopper])
    return response, block, frame


@styled
def plot_switching(table: pd.DataFrame, branches: Sequence[Branch]) -> Any:
    """Draw a sweep as dots, branches as lines, and where the device switches on and off.

    Parameters
    ----------
    table : DataFrame
        From `sweep`, over the amplitude.
    branches : sequence of Branch

    Returns
    -------
    Axes
    """
    ax = new_figure(1.2).subplots()
    draw_switches(ax, table)
    lines: list[Any] = [_Lines(branch) for branch in branches]  # what is drawn of a branch
    plot_branch(lines, table, ax)
    return ax


class _Lines:
    """A branch to draw, with its folds and period doublings among the orbits.

    A line then changes its style at the special point, not at the next orbit behind it.
    """

    def __init__(self, branch: Branch) -> None:
        # An orbit that grazes is on the border of what is admissible: rounding decides.
        grazes = branch.special_table["label"] == "G"
        admissible = branch.special_table["admissible"] | grazes
        self.special_table = branch.special_table.assign(admissible=admissible)
        self.table = branch.table
        for _, point in branch.special_table.iterrows():
            if point["label"] in ("CF", "PD"):
                self.table = _inserted(self.table, point)


def _inserted(table: pd.DataFrame, point: pd.Series) -> pd.DataFrame:
    """Return the orbits of a branch with a special point where it lies nearest to the line."""
    names = [table.columns[0], "v2"]
    line, here = table[names].to_numpy(), point[names].to_numpy(dtype=float)
    size = np.nanmax(line, axis=0) - np.nanmin(line, axis=0)
    line, here = line / size, here / size
    along = np.diff(line, axis=0)
    length = np.maximum((along**2).sum(axis=1), 1e-300)
    share = np.clip(((here - line[:-1]) * along).sum(axis=1) / length, 0.0, 1.0)
    away = ((line[:-1] + share[:, None] * along - here) ** 2).sum(axis=1)
    # Only where the stability changes: two parts of a branch may cross.
    stable = table["stable"].fillna(False).to_numpy(dtype=bool)
    changes = stable[1:] != stable[:-1]
    if not changes.any():
        return table
    i = int(np.nanargmin(np.where(changes, away, np.inf)))
    pair = table.iloc[[i, i + 1]].copy()
    for name in table.columns:
        if name == names[0] or name.startswith("v2"):
            pair[name] = float(point[name])
    return pd.concat([table.iloc[: i + 1], pair, table.iloc[i + 1 :]], ignore_index=True)
