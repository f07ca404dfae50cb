"""Bifurcation diagrams: sweeps, branches and curves."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from mems_impact._util.formatting import stability_name
from mems_impact.continuation.sliding import TYPE_LABELS
from mems_impact.errors import InvalidParameter
from mems_impact.plotting.labels import (
    Label,
    Mark,
    crosses,
    label_axis,
    label_of,
    legend_above,
    letter_panels,
    mark_points,
    on_section,
    parameter_label,
    symbol,
)
from mems_impact.plotting.style import (
    DASHES,
    DOTS,
    LINES,
    MODE_COLORS,
    Axes,
    cased,
    color,
    new_figure,
    styled,
    thickness,
)
from mems_impact.tables import NUMBER, PERIOD, impact_changes, sweep_summary, without_units

if TYPE_CHECKING:
    from mems_impact.analysis.branch import Branch
    from mems_impact.analysis.curve import Curve
    from mems_impact.studies.bifurcation_diagram import BifurcationDiagram
    from mems_impact.studies.engine.store import StoredStudy
    from mems_impact.studies.sweep import Sweep

# --- Branches

# Marker and colour of special points: of orbits, then of equilibria.
POINT_MARKS = {
    "G": ("o", "grazing"),
    "CF": ("s", "fold"),
    "PD": ("^", "doubling"),
    "NS": ("D", "torus"),
}
POINT_MARKS |= {"BE": ("o", "grazing"), "LP": ("s", "fold"), "H": ("D", "torus")}
STABILITY_LINES: dict[str, tuple[str, Any]] = {
    "stable": ("motion", "-"),
    "unstable": ("unstable", (0, (4, 1.5))),
    "neutral": ("motion", (0, (4, 1.5, 1, 1.5))),
}
BRANCH_SAME = 0.01  # distance at which points coincide, as a part of the axes
MARKER_FACE = "white"  # of subcritical and branch points, and points named after a guard


@styled
def plot_branch(
    branch: Branch[Any] | Sequence[Branch[Any]],
    sweep: Sweep | pd.DataFrame | None = None,
    ax: Any = None,
    *,
    quantity: str | None = None,
) -> Axes:
    """Draw a state on the section over the parameter of one or more branches.

    Stable orbits and equilibria are solid lines, unstable solutions dashed, inadmissible solutions
    omitted. Special points are labelled: G, CF, PD, NS, BP of orbits, or the guard that is grazed;
    LP, H, BP, BE of equilibria, and ? where stability changes without a detected special point.

    Parameters
    ----------
    branch : Branch, or sequence of these
    sweep : Sweep or DataFrame, optional
        A sweep over the same parameter, or its table, drawn as dots below the branches.
    ax : matplotlib Axes, optional
        Axes to draw on; a new figure by default.
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
        If `branch` is not a branch, the quantity is unknown, or branches and sweep are over
        different parameters.

    See Also
    --------
    continue_solution, Branch, plot_sweep

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> branch = mi.continue_solution(orbit, "amplitude", stop=0.17)
    >>> mi.plot_branch(branch).figure.savefig("branch.png")
    """
    diagrams = list(branch) if isinstance(branch, Sequence) else [branch]
    for diagram in diagrams:
        if not hasattr(diagram, "special_table"):
            allowed = "a Branch, as mems_impact.continue_solution returns it"
            raise InvalidParameter("branch", type(diagram).__name__, allowed)
    first = diagrams[0].table
    parameter, state = first.columns[0], _ordinate(first, quantity)
    dots = None if sweep is None else without_units(getattr(sweep, "table", sweep))
    over = [diagram.table.columns[0] for diagram in diagrams]
    over += [] if dots is None else [dots.columns[0]]
    if set(over) != {parameter}:
        raise InvalidParameter("parameter", ", ".join(over), "the same of all branches and sweep")
    if ax is None:
        ax = new_figure(1.2).subplots()
    if dots is not None:
        if state not in dots:
            raise InvalidParameter("quantity", state, f"one of the sweep's {', '.join(dots)}")
        ax.plot(
            dots[parameter], dots[state], linestyle="none", marker="o", color=color("dots"),
            markersize=1.0 if len(dots) > 2000 else 2.0,
            markeredgewidth=0.0, label="brute force", rasterized=len(dots) > 20_000, zorder=1,
        )  # fmt: skip
    labels: set[str] = set()
    for diagram in diagrams:
        _lines(ax, diagram.table, state, labels)
    special_tables = [diagram.special_table for diagram in diagrams if len(diagram.special_table)]
    ax.margins(x=0.02, y=0.08)
    marks = (
        _points(ax, pd.concat([_marks(table, parameter, state) for table in special_tables]))
        if special_tables
        else []
    )
    label_axis(ax.xaxis, parameter_label(first, parameter))
    is_state = state in first.attrs.get("states", ())
    label_axis(ax.yaxis, on_section(first, state) if is_state else label_of(first, state))
    legend_above(ax)
    mark_points(ax, marks)
    return ax


@styled
def plot_diagram(
    diagram: BifurcationDiagram, ax: Any = None, *, quantity: str | None = None
) -> Axes:
    """Draw a bifurcation diagram: its branches over its attractors.

    Stable orbits are solid lines, unstable orbits dashed, with the labels of `plot_branch`; dots
    are attractors from runs.

    Parameters
    ----------
    diagram : BifurcationDiagram
    ax : matplotlib Axes, optional
        Axes to draw on; a new figure by default.
    quantity : str, optional
        As for `plot_branch`.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If `diagram` is not a diagram, or the quantity is unknown.

    See Also
    --------
    bifurcation_diagram, plot_branch

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> diagram = mi.bifurcation_diagram(actuator, drive, "amplitude", (0.22, 0.24), values=3)
    >>> mi.plot_diagram(diagram).figure.savefig("diagram.png")
    """
    if not hasattr(diagram, "cloud"):
        allowed = "a BifurcationDiagram, as mems_impact.bifurcation_diagram returns it"
        raise InvalidParameter("diagram", type(diagram).__name__, allowed)
    if not diagram.branches:
        return plot_sweep(diagram.cloud, ax, quantity=quantity)
    dots = diagram.cloud if quantity is None or quantity in without_units(diagram.cloud) else None
    return plot_branch(diagram.branches, dots, ax, quantity=quantity)


def _ordinate(table: pd.DataFrame, quantity: str | None) -> str:
    """Return the column to draw."""
    states: list[str] = table.attrs.get("states", [])
    if quantity is None and states:
        return states[0]
    columns = [name for name in table.columns[1:] if name not in ("stable", "admissible", "piece")]
    if quantity not in columns:
        raise InvalidParameter("quantity", quantity, f"one of {', '.join(columns)}")
    return str(quantity)


def _lines(ax: Any, table: pd.DataFrame, state: str, labels: set[str]) -> None:
    """Draw successive orbits of equal stability as one line, up to the next line."""
    values = table.iloc[:, 0].to_numpy()
    stable = [None if pd.isna(each) else bool(each) for each in table["stable"]]
    kind = np.array([stability_name(each) for each in stable])
    # The stability changes in a neutral part of no visible length.
    lines = np.flatnonzero(kind[1:] != kind[:-1]) + 1
    for part in np.split(np.arange(kind.size), lines):
        beside = [j for j in (part[0] - 1, part[-1] + 1) if 0 <= j < kind.size]
        if kind[part[0]] == "neutral" and beside and _is_short(part, values, table[state]):
            kind[part] = kind[beside[0]]
    kind = np.where(table["admissible"], kind, "")
    # One column per crossing of the section: v2, v2 2, v2 3, …
    columns = [name for name in table if re.fullmatch(rf"{re.escape(state)}( \d+)?", name)]
    noun, thin = ("orbit", 1.0) if "piece" in table else ("equilibrium", 0.6)
    # Equilibria have one mode; a change of an orbit's events begins a new line.
    pieces = table.get("piece", pd.Series(0, table.index)).to_numpy()
    edges = [0, *(np.flatnonzero((kind[1:] != kind[:-1]) | (pieces[1:] != pieces[:-1])) + 1)]
    for begin, end in zip(edges, [*edges[1:], len(table)], strict=True):
        if not kind[begin]:
            continue
        stable = kind[begin] == "stable"
        # One additional orbit closes the gap to the next line.
        more = end < len(table) and kind[end] != ""
        rows = slice(begin, end + more)
        name, dashes = STABILITY_LINES[str(kind[begin])]
        style: dict[str, Any] = {"color": color(name), "linestyle": dashes}
        style["linewidth"] = (1.2 if stable else 1.0) * thickness(thin)
        # Set off from the dots of chaos below; a rim of dashes would look like a ladder.
        style["zorder"] = 4 + stable
        if stable:
            style["path_effects"] = cased(style["linewidth"])
        before = np.full(end + more - begin, np.nan)
        for column in columns:
            y = table[column].to_numpy()[rows]
            # An orbit with a smaller period than its branch is drawn once.
            if np.isnan(y).all() or np.allclose(y, before, rtol=1e-9):
                continue
            before = y
            text = f"{kind[begin]} {noun}"
            ax.plot(values[rows], y, label=None if text in labels else text, **style)
            labels.add(text)


def _is_short(part: Any, *columns: Any) -> bool:
    """Return whether some rows have no visible length on the axes."""
    return all(np.ptp(np.asarray(x)[part]) <= BRANCH_SAME * np.ptp(x) for x in columns)


def _marks(table: pd.DataFrame, parameter: str, state: str) -> pd.DataFrame:
    rows = table[table["admissible"].astype(bool)]
    label = rows["label"]
    if "type" in rows:
        label = rows["type"].map(TYPE_LABELS).fillna(label)
    names = {"label": label, "criticality": rows["criticality"]}
    return pd.DataFrame({**names, "value": rows[parameter], "y": rows[state]})


def _points(ax: Any, marks: pd.DataFrame) -> list[Mark]:
    """Return the marks of special points, a single mark for several of one kind at one place."""
    found = []
    for row in marks.itertuples():
        marker, meaning = POINT_MARKS.get(row.label, ("o", ""))
        filled = meaning and row.criticality != "subcritical"
        face = color(meaning) if filled else MARKER_FACE
        found.append(Mark(str(row.label), row.value, row.y, marker, face))
    return _distinct(ax, found, BRANCH_SAME)


def _distinct(ax: Any, marks: Iterable[Mark], same: float) -> list[Mark]:
    """Return the marks without those close to an equal one; `same` is a part of the axes."""
    size = np.array([np.ptp(ax.get_xlim()) or 1.0, np.ptp(ax.get_ylim()) or 1.0])
    kept: list[Mark] = []
    for mark in marks:
        alike = [other[1:3] for other in kept if other.text == mark.text]
        apart = np.abs(np.array(alike).reshape(-1, 2) - mark[1:3]) / size
        if not (apart < same).all(axis=1).any():
            kept.append(mark)
    return kept


# --- Curves of special points over two parameters.

SPECIAL_POINT_NAMES = {
    "grazing": "grazing", "fold": "fold", "period-doubling": "doubling", "Neimark-Sacker": "torus",
}  # fmt: skip
"""Colours of kinds of special points."""

SOLID = (LINES[0], LINES[1], LINES[3], (0, (8, 2)))  # inadmissible parts are dotted
CURVE_SAME = 0.005  # distance at which points coincide, as a part of the axes


@styled
def plot_curve(curve: Curve | Sequence[Curve], ax: Any = None) -> Axes:
    """Draw the first parameter of one or more curves over the second; inadmissible orbits dotted.

    Axes are as for the first curve; other curves may have the two parameters in either order.
    Points of codimension two are marked, with their kinds.

    Parameters
    ----------
    curve : Curve or sequence of Curve
    ax : matplotlib Axes, optional
        Axes to draw on; a new figure by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If `curve` is not a curve, or the curves are over different parameters.

    See Also
    --------
    continue_curve, Curve, plot_chart

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> branch = mi.continue_solution(orbit, "amplitude", stop=0.17)
    >>> curve = mi.continue_curve(branch.special_points[0], "omega", stop=0.505)
    >>> mi.plot_curve(curve).figure.savefig("curve.png")
    """
    curves = list(curve) if isinstance(curve, Sequence) else [curve]
    for each in curves:
        if not (hasattr(each, "special_table") and hasattr(each, "kind")):
            allowed = "a Curve, as mems_impact.continue_curve returns it"
            raise InvalidParameter("curve", type(each).__name__, allowed)
    first = curves[0].table
    x, y = first.columns[:2]
    for each in curves:
        if set(each.table.columns[:2]) != {x, y}:
            others = ", ".join(each.table.columns[:2])
            raise InvalidParameter("parameters", others, f"{x}, {y}, as of the first curve")
    if ax is None:
        ax = new_figure(1.2).subplots()
    kinds = list(dict.fromkeys(each.kind for each in curves))
    rest = iter(MODE_COLORS * len(kinds))
    colors = {
        k: color(SPECIAL_POINT_NAMES[k]) if k in SPECIAL_POINT_NAMES else next(rest) for k in kinds
    }
    for each in curves:
        table, paint = each.table, colors[each.kind]
        good = table["admissible"].to_numpy(dtype=bool)
        # One additional orbit on either side, so that the dots reach the line.
        bad = ~good | ~np.roll(good, 1) | ~np.roll(good, -1) if (~good).any() else ~good
        ax.plot(table[x], table[y].where(good), color=paint, linewidth=thickness(1.2), zorder=3,
                linestyle=SOLID[kinds.index(each.kind) % len(SOLID)], label=each.kind)  # fmt: skip
        if bad.any():
            ax.plot(table[x], table[y].where(bad), color=paint, linewidth=thickness(0.8),
                    linestyle=(0, (1, 1.5)), zorder=2, label="inadmissible")  # fmt: skip
    ax.margins(x=0.04, y=0.14)
    special_tables = [
        each.special_table[["kind", x, y]] for each in curves if len(each.special_table)
    ]
    marks: list[Mark] = []
    if special_tables:
        rows = pd.concat(special_tables).drop_duplicates().itertuples(index=False)
        # Two curves share the point where they meet.
        marks = _distinct(ax, (Mark(*row) for row in rows), CURVE_SAME)
    label_axis(ax.xaxis, parameter_label(first, x))
    label_axis(ax.yaxis, parameter_label(first, y))
    legend_above(ax)
    mark_points(ax, marks)
    return ax


# --- Sweeps

# Rings of one direction around dots of the other, so that coincident points are visible.
MOTION_MARKS: dict[str, dict[str, Any]] = {
    "up": {"marker": "o", "markersize": 1.9, "zorder": 3},
    "down": {"marker": "o", "markersize": 3.6, "fillstyle": "none", "zorder": 2},
}
SWEEP_DIRECTIONS = {"up": "increased", "down": "decreased"}
BRANCH_COLUMNS = ("direction", "status")
"""Other columns of a sweep, neither parameter, counter, state nor statistic."""


@styled
def plot_sweep(
    sweep: Sweep | StoredStudy | pd.DataFrame, ax: Any = None, *, quantity: str | None = None
) -> Axes:
    """Draw a sweep over its parameter: the first state on the section, and statistics.

    For an actuator these are v2 on the section x2 = 0, step and speed of the frame; for any other
    system its first displayed state and its observables. A thin line marks the first value at which
    impacts begin or cease. Marks at the lower edge show values without a state: triangles where the
    measured part has no crossing of the section, crosses where the run failed. Without impacts
    there is no step.

    Parameters
    ----------
    sweep : Sweep, StoredStudy or DataFrame
        A sweep, its running or finished store, or a table of either. A table read back from a file
        shows only the state by default.
    ax : matplotlib Axes, optional
        Where to draw one quantity; a new figure by default.
    quantity : str, optional
        A column of the table, or a short name such as an actuator's "step" and "speed". By default
        all displayed quantities, one below the other, on a new figure, and the first state on given
        axes.

    Returns
    -------
    Axes
        The uppermost; ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If `sweep` is not a sweep, or the quantity is unknown.

    See Also
    --------
    sweep, Sweep, plot_branch

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> sweep = mi.sweep(actuator, drive, "amplitude", [0.2, 0.24], transient=200, periods=10)
    >>> mi.plot_sweep(sweep, quantity="speed").figure.savefig("sweep.png")
    """
    table = without_units(getattr(sweep, "table", sweep))
    if not set(BRANCH_COLUMNS) <= set(table.columns) or table.columns[2] not in (PERIOD, NUMBER):
        allowed = "a Sweep, as mems_impact.sweep returns it, or its table or store"
        raise InvalidParameter("sweep", type(sweep).__name__, allowed)
    quantities = _quantities(table)
    if quantity is not None and quantity not in quantities:
        raise InvalidParameter("quantity", quantity, f"one of {', '.join(quantities)}")
    first = next(iter(quantities))
    observables = [name for name in table.attrs.get("quantities", {}) if name in quantities]
    # A panel without data is omitted, such as that of the step of a device that never impacts.
    observables = [name for name in observables if table[quantities[name][0]].notna().any()]
    drawn = [first, *observables] if quantity is None and ax is None else [quantity or first]
    if ax is not None:
        panels = [ax]
    else:
        figure = new_figure(1.1 + 0.55 * (len(drawn) - 1))
        heights = [2.0 if name == first and len(drawn) > 1 else 1.0 for name in drawn]
        grid = {"height_ratios": heights}
        panels = figure.subplots(len(drawn), sharex=True, squeeze=False, gridspec_kw=grid)[:, 0]
        letter_panels(panels)
    for panel, name in zip(panels, drawn, strict=True):
        _draw_dots(panel, table, *quantities[name])
        draw_switches(panel, table)
    label_axis(panels[-1].xaxis, parameter_label(table, table.columns[0]))
    legend_above(panels[0])
    return panels[0]


def _quantities(table: pd.DataFrame) -> dict[str, tuple[str, Label]]:
    """Return the drawable columns with their axis labels, the first state first."""
    columns = [name for name in table.columns[3:] if name not in BRANCH_COLUMNS]
    states: list[str] = table.attrs.get("states", [table.columns[3]])
    quantities = {states[0]: (states[0], on_section(table, states[0]))}
    for name, (column, caption) in table.attrs.get("quantities", {}).items():
        if column in columns:
            quantities[name] = (column, label_of(table, column, caption))
    for name in columns:
        label = on_section(table, name) if name in states else label_of(table, name)
        quantities.setdefault(name, (name, label))
    return quantities


def _draw_dots(ax: Any, table: pd.DataFrame, column: str, label: Label) -> None:
    """Draw one quantity; for a state, mark the values without a crossing."""
    summary = sweep_summary(table)
    of_crossings = column not in summary
    rows = table if of_crossings else summary
    parameter = rows.columns[0]
    sign = _symbol(table)
    # Many dots are small, so that rings do not merge; coincident dots count once.
    spread = max(1e-300, rows[column].max() - rows[column].min())
    levels = (rows[column] / spread * 300.0).round()
    dots = len(pd.DataFrame({"at": rows[parameter], "level": levels}).drop_duplicates())
    scale = min(1.0, max(0.35, math.sqrt(150.0 / max(1, dots))))
    for direction, style in MOTION_MARKS.items():
        mark = {**style, "markersize": scale * style["markersize"], "linestyle": "none"}
        mark["color"] = color(direction)
        chain = rows[rows["direction"] == direction]
        if len(chain):
            ax.plot(
                chain[parameter], chain[column], label=f"{sign} {SWEEP_DIRECTIONS[direction]}",
                markeredgewidth=0.7 * scale, rasterized=len(chain) > 20_000, **mark,
            )  # fmt: skip
    if of_crossings:
        _draw_feet(ax, rows, column, scale)
    label_axis(ax.yaxis, label)


def _draw_feet(ax: Any, rows: pd.DataFrame, state: str, scale: float) -> None:
    """Mark the values without a crossing at the lower edge."""
    parameter, good = rows.columns[0], rows["status"] == "ok"
    foot = {"transform": ax.get_xaxis_transform(), "clip_on": False, "linestyle": "none"}
    label = f"no crossing of {crosses(rows.attrs) or 'the section'}"
    if rows.attrs.get("maxima"):
        label = "no maximum"
    # Another state may have more maxima than this one.
    missing = rows.groupby([parameter, "direction"])[state].transform("count") == 0
    for direction, style in MOTION_MARKS.items():
        selected = good & missing & (rows["direction"] == direction)
        values = rows.loc[selected, parameter]
        if len(values):
            mark = {**style, "marker": "v", "markersize": 2.0 * scale * style["markersize"]}
            mark |= {"zorder": style["zorder"] + 3, "color": color(direction)}  # above the axis
            ax.plot(values, [0.0] * len(values), label=label, **foot, **mark)
            label = "_"  # one legend entry
    failed = rows.loc[~good, parameter].unique()
    if len(failed):
        cross = {"marker": "x", "color": color("guide"), "markersize": 4, "label": "failed"}
        ax.plot(failed, [0.02] * len(failed), **foot, **cross)


def _symbol(table: pd.DataFrame) -> str:
    return symbol(table.columns[0], table.attrs.get("symbols", {}))


def draw_switches(ax: Any, table: pd.DataFrame) -> None:
    """Draw a line at the first value at which impacts have begun or ceased, and their interval."""
    parameter = _symbol(table)
    unit = table.attrs.get("units", {}).get(table.columns[0], "")
    for change in sorted(impact_changes(table), key=lambda mark: mark.after):
        low, high = sorted((change.before, change.after))
        text = f"{'on' if change.begins else 'off'} at {parameter} = {low:.5g} to {high:.5g} {unit}"
        look = DASHES if change.begins else {**DASHES, "linestyle": DOTS}
        line = color(change.direction)
        ax.axvline(change.after, color=line, zorder=1, label=text.rstrip(), **look)
