"""Bifurcation diagrams: branches of orbits, stable and unstable, over what brute force shows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import pandas as pd

from mems_impact.errors import InvalidParameter
from mems_impact.plotting.style import BLUE, GREY, ORANGE, new_figure, symbol, tidy
from mems_impact.tables.common import bare, heading

__all__ = ["plot_branch"]

DOTS = "0.62"
MARKED = ("G", "CF", "PD", "NS")
FACES = {"G": "white", "CF": BLUE, "PD": ORANGE, "NS": GREY}


class Diagram(Protocol):
    """What `plot_branch` needs of a `mems_impact.analysis.branch.Branch`."""

    @property
    def table(self) -> pd.DataFrame:
        """One row an orbit, the parameter first."""

    @property
    def special_table(self) -> pd.DataFrame:
        """One row a special point."""


def plot_branch(
    branch: Diagram | Sequence[Diagram], sweep: pd.DataFrame | None = None, ax: Any = None
) -> Any:
    """Draw v2 on the section x2 = 0 over the parameter of one or more branches.

    Stable orbits are solid lines, unstable ones dashed, inadmissible ones left out. Special points
    are labelled as in the paper: G, CF, PD.

    Parameters
    ----------
    branch : Branch or sequence of Branch
    sweep : DataFrame, optional
        From `mems_impact.sweep` over the same parameter, drawn as dots below.
    ax : matplotlib Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.
    """
    if ax is None:
        ax = new_figure(7.0, 4.2).subplots()
    diagrams = list(branch) if isinstance(branch, Sequence) else [branch]
    for diagram in diagrams:
        if not hasattr(diagram, "special_table"):
            allowed = "a Branch, as mems_impact.continue_orbit returns it"
            raise InvalidParameter("branch", type(diagram).__name__, allowed)
    first = diagrams[0].table
    label, ordinate = heading(first, first.columns[0]), heading(first, "v2")
    if sweep is not None:
        dots = bare(sweep)
        ax.plot(
            dots.iloc[:, 0], dots["v2"], linestyle="none", marker="o", color=DOTS,
            markersize=1.8 if len(dots) > 2000 else 3.2,
            markeredgewidth=0.0, label="brute force", rasterized=len(dots) > 20_000, zorder=1,
        )  # fmt: skip
    drawn: set[str] = set()
    for diagram in diagrams:
        _lines(ax, diagram.table, drawn)
    marks = pd.concat([_marks(diagram.special_table) for diagram in diagrams])
    _points(ax, marks)
    parameter = label.partition(" [")[0]
    unit = label[len(parameter) :]
    name = symbol(parameter)
    ax.set_xlabel((name if name == parameter else f"{parameter} {name}") + unit)
    ax.set_ylabel(f"$v_2${ordinate[2:]} at $x_2 = 0$")
    ax.margins(x=0.02, y=0.08)
    ax.legend(frameon=False)
    tidy(ax)
    return ax


def _lines(ax: Any, table: pd.DataFrame, drawn: set[str]) -> None:
    """Draw each run of orbits of one stability; it ends where the next one begins."""
    values = table.iloc[:, 0].to_numpy()
    kind = np.where(table["stable"], "stable", "unstable")
    kind = np.where(table["admissible"], kind, "")
    plain = bare(table)
    columns = [name for name in plain.columns if name == "v2" or name.startswith("v2 ")]
    pieces = table["piece"].to_numpy()
    edges = [0, *(np.flatnonzero((kind[1:] != kind[:-1]) | (pieces[1:] != pieces[:-1])) + 1)]
    for begin, end in zip(edges, [*edges[1:], len(table)], strict=True):
        if not kind[begin]:
            continue
        stable = kind[begin] == "stable"
        # One orbit more closes the gap to the next line.
        more = end < len(table) and kind[end] != ""
        rows = slice(begin, end + more)
        style: dict[str, Any] = {"color": BLUE, "linewidth": 1.6, "zorder": 3}
        if not stable:
            style = {"color": ORANGE, "linewidth": 1.2, "linestyle": (0, (4, 2)), "zorder": 2}
        before = np.full(end + more - begin, np.nan)
        for column in columns:
            v2 = plain[column].to_numpy()[rows]
            # An orbit that repeats itself within the period of its branch is drawn once.
            if np.isnan(v2).all() or np.allclose(v2, before, rtol=1e-9):
                continue
            before = v2
            text = None if kind[begin] in drawn else f"{kind[begin]} orbit"
            drawn.add(str(kind[begin]))
            ax.plot(values[rows], v2, label=text, **style)


def _marks(table: pd.DataFrame) -> pd.DataFrame:
    plain = bare(table)
    plain = plain[plain["label"].isin(MARKED) & plain["admissible"].astype(bool)]
    return pd.DataFrame({"label": plain["label"], "value": plain.iloc[:, 2], "v2": plain["v2"]})


def _points(ax: Any, marks: pd.DataFrame) -> None:
    """Mark special points; of several at one place, one stands for all."""
    x, y = (np.diff(ax.get_xlim())[0] or 1.0), (np.diff(ax.get_ylim())[0] or 1.0)
    taken: list[tuple[str, float, float]] = []
    for row in marks.itertuples():
        here = (row.value / x, row.v2 / y)
        if any(t[0] == row.label and _within(0.01, t, here) for t in taken):
            continue
        near = [t for t in taken if _within(0.05, t, here)]
        ax.plot(
            row.value, row.v2, marker="o", markersize=5.5, color=FACES[row.label],
            markeredgecolor="black", markeredgewidth=0.8, linestyle="none", zorder=4,
        )  # fmt: skip
        # Labels of points near each other stand on different sides.
        dx, dy = ((5, 5), (-5, -13), (-6, 5), (6, -13))[len(near) % 4]
        ax.annotate(
            row.label, (row.value, row.v2), xytext=(dx, dy), textcoords="offset points",
            ha="left" if dx > 0 else "right", fontsize="small", zorder=5,
        )  # fmt: skip
        taken.append((row.label, *here))


def _within(distance: float, mark: tuple[str, float, float], place: tuple[float, float]) -> bool:
    return abs(mark[1] - place[0]) < distance and abs(mark[2] - place[1]) < distance
