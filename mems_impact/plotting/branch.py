"""Bifurcation diagrams: branches of orbits, stable and unstable, over what brute force shows."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import pandas as pd

from mems_impact.errors import InvalidParameter
from mems_impact.plotting.labels import label_axis, label_of, on_section, parameter_label
from mems_impact.plotting.placing import Mark, label_points, legend_above
from mems_impact.plotting.style import cased, color, new_figure, styled, thickness
from mems_impact.tables.common import bare

__all__ = ["plot_branch"]

# Marker and colour of special points: of orbits, then of equilibria.
MARKS = {"G": ("o", "grazing"), "CF": ("s", "fold"), "PD": ("^", "doubling"), "NS": ("D", "torus")}
MARKS |= {"BE": ("o", "grazing"), "LP": ("s", "fold"), "H": ("D", "torus")}
SAME = 0.01  # part of the axes within which points are one
FACE = "white"  # of the others, which are named after a guard, and branch points


class Diagram(Protocol):
    """What `plot_branch` needs of a `Branch` or an `EquilibriumBranch`."""

    @property
    def table(self) -> pd.DataFrame:
        """One row an orbit, the parameter first."""

    @property
    def special_table(self) -> pd.DataFrame:
        """One row a special point."""


@styled
def plot_branch(
    branch: Diagram | Sequence[Diagram],
    sweep: pd.DataFrame | None = None,
    ax: Any = None,
    *,
    quantity: str | None = None,
) -> Any:
    """Draw a state on the section over the parameter of one or more branches.

    Stable orbits and equilibria are solid lines, unstable ones dashed, inadmissible ones left out.
    Special points are labelled: G, CF, PD, NS, BP of orbits, or the guard that is touched; LP, H,
    BP, BE of equilibria, and ? where stability changes at no such point that is found.

    Parameters
    ----------
    branch : Branch or EquilibriumBranch, or sequence of these
    sweep : DataFrame, optional
        From `mems_impact.sweep` over the same parameter, drawn as dots below.
    ax : matplotlib Axes, optional
        Where to draw; a new figure by default.
    quantity : str, optional
        A state, or another column of the branch's table, such as ``"impact speed"``; the first
        state that the system shows by default, of an actuator v2.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If `branch` is none, there is no such quantity, or branches and sweep are over different
        parameters.

    See Also
    --------
    continue_orbit, Branch, plot_sweep

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked(actuator))
    >>> branch = mi.continue_orbit(orbit, "amplitude", stop=0.17)
    >>> mi.plot_branch(branch).figure.savefig("branch.png")
    """
    diagrams = list(branch) if isinstance(branch, Sequence) else [branch]
    for diagram in diagrams:
        if not hasattr(diagram, "special_table"):
            allowed = "a Branch, as mems_impact.continue_orbit returns it"
            raise InvalidParameter("branch", type(diagram).__name__, allowed)
    first = diagrams[0].table
    parameter, state = first.columns[0], _ordinate(first, quantity)
    dots = None if sweep is None else bare(sweep)
    over = [diagram.table.columns[0] for diagram in diagrams]
    over += [] if dots is None else [dots.columns[0]]
    if set(over) != {parameter}:
        raise InvalidParameter("parameter", ", ".join(over), "the same of all branches and sweep")
    if ax is None:
        ax = new_figure(1.1).subplots()
    if dots is not None:
        if state not in dots:
            raise InvalidParameter("quantity", state, f"one of the sweep's {', '.join(dots)}")
        ax.plot(
            dots[parameter], dots[state], linestyle="none", marker="o", color=color("dots"),
            markersize=1.0 if len(dots) > 2000 else 2.0,
            markeredgewidth=0.0, label="brute force", rasterized=len(dots) > 20_000, zorder=1,
        )  # fmt: skip
    drawn: set[str] = set()
    for diagram in diagrams:
        _lines(ax, diagram.table, state, drawn)
    found = [diagram.special_table for diagram in diagrams if len(diagram.special_table)]
    marks = _points(ax, pd.concat([_marks(table, state) for table in found])) if found else []
    ax.margins(x=0.02, y=0.08)
    label_axis(ax.xaxis, parameter_label(first, parameter))
    shown = state in first.attrs.get("states", ())
    label_axis(ax.yaxis, on_section(first, state) if shown else label_of(first, state))
    legend_above(ax)
    label_points(ax, marks)
    return ax


def _ordinate(table: pd.DataFrame, quantity: str | None) -> str:
    """Return the column to draw."""
    states: list[str] = table.attrs.get("states", [])
    if quantity is None and states:
        return states[0]
    known = [name for name in table.columns[1:] if name not in ("stable", "admissible", "piece")]
    if quantity not in known:
        raise InvalidParameter("quantity", quantity, f"one of {', '.join(known)}")
    return str(quantity)


def _lines(ax: Any, table: pd.DataFrame, state: str, drawn: set[str]) -> None:
    """Draw each run of orbits of one stability; it ends where the next one begins."""
    values = table.iloc[:, 0].to_numpy()
    kind = np.where(table["stable"], "stable", "unstable")
    kind = np.where(table["admissible"], kind, "")
    # One column a crossing of the section: v2, v2 2, v2 3, …
    columns = [name for name in table if re.fullmatch(rf"{re.escape(state)}( \d+)?", name)]
    what, thin = ("orbit", 1.0) if "piece" in table else ("equilibrium", 0.6)
    # Equilibria keep their mode; an orbit's events may change, and a new piece begin.
    pieces = table.get("piece", pd.Series(0, table.index)).to_numpy()
    edges = [0, *(np.flatnonzero((kind[1:] != kind[:-1]) | (pieces[1:] != pieces[:-1])) + 1)]
    for begin, end in zip(edges, [*edges[1:], len(table)], strict=True):
        if not kind[begin]:
            continue
        stable = kind[begin] == "stable"
        # One orbit more closes the gap to the next line.
        more = end < len(table) and kind[end] != ""
        rows = slice(begin, end + more)
        style: dict[str, Any] = {"color": color("motion"), "linewidth": 1.2 * thickness(thin)}
        if not stable:
            style = {"color": color("unstable"), "linewidth": thickness(thin)}
            style["linestyle"] = (0, (4, 1.5))
        # Set off from the dots of chaos below.
        style |= {"zorder": 4 + stable, "path_effects": cased(style["linewidth"])}
        before = np.full(end + more - begin, np.nan)
        for column in columns:
            y = table[column].to_numpy()[rows]
            # An orbit that repeats itself within the period of its branch is drawn once.
            if np.isnan(y).all() or np.allclose(y, before, rtol=1e-9):
                continue
            before = y
            text = f"{kind[begin]} {what}"
            ax.plot(values[rows], y, label=None if text in drawn else text, **style)
            drawn.add(text)


def _marks(table: pd.DataFrame, state: str) -> pd.DataFrame:
    rows = table[table["admissible"].astype(bool)]
    return pd.DataFrame({"label": rows["label"], "value": rows.iloc[:, 2], "y": rows[state]})


def _points(ax: Any, marks: pd.DataFrame) -> list[Mark]:
    """Mark special points; of several at one place, one stands for all. Return their labels."""
    x, y = (np.diff(ax.get_xlim())[0] or 1.0), (np.diff(ax.get_ylim())[0] or 1.0)
    taken: list[Mark] = []
    for row in marks.itertuples():
        near = (
            abs(mark.x - row.value) < SAME * x and abs(mark.y - row.y) < SAME * y
            for mark in taken if mark.text == row.label
        )  # fmt: skip
        if any(near):
            continue
        marker, meaning = MARKS.get(row.label, ("o", ""))
        ax.plot(
            row.value, row.y, marker=marker, markersize=4.5, linestyle="none", zorder=7,
            color=color(meaning) if meaning else FACE, markeredgecolor="black", markeredgewidth=0.6,
        )  # fmt: skip
        taken.append(Mark(str(row.label), row.value, row.y))
    return taken
