"""Figures of tolerance analyses, sensitivities and Pareto fronts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mems_impact.errors import InvalidParameter
from mems_impact.plotting.labels import (
    Label,
    amount,
    label_axis,
    label_of,
    legend_above,
    letter_panels,
    symbol,
)
from mems_impact.plotting.style import Axes, color, inches, new_figure, styled
from mems_impact.studies.engine.store import StoredStudy
from mems_impact.studies.sampling import deviations
from mems_impact.studies.uncertainty import Spread
from mems_impact.tables import without_units

if TYPE_CHECKING:
    import pandas as pd

    from mems_impact.studies.optimize import ParetoFront
    from mems_impact.studies.sensitivity import Sensitivity

# --- Pareto fronts


@styled
def plot_pareto(front: ParetoFront | pd.DataFrame, ax: Any = None) -> Axes:
    """Draw a Pareto front, and the start of the searches.

    Axis labels state the better direction.

    Parameters
    ----------
    front : ParetoFront or DataFrame
        From `mems_impact.pareto_front`, or its table.
    ax : matplotlib Axes, optional
        Axes to draw on; a new figure by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If a table is not from a front.

    See Also
    --------
    pareto_front, ParetoFront

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> front = mi.pareto_front(
    ...     orbit, {"mean speed": "maximize", "energy lost per period": "minimize"},
    ...     over={"amplitude": (0.23, 0.25)}, points=3,
    ... )
    >>> mi.plot_pareto(front).figure.savefig("pareto.png")
    """
    start = getattr(front, "start", None)
    table = without_units(getattr(front, "table", front))
    aims = table.attrs.get("aims")
    if not aims:
        raise InvalidParameter("front", None, "", problem="not of mems_impact.pareto_front")
    if ax is None:
        ax = new_figure(1.2).subplots()
    first, second = aims
    begin = _begin(start, aims) if start is not None else {}
    motion, guide = color("motion"), color("guide")
    ax.plot(table[second], table[first], color=motion, marker="o", label="Pareto front", zorder=3)
    if begin:
        ax.plot(
            begin[second], begin[first], color=guide, marker="s", linestyle="none", label="start",
            zorder=4,
        )  # fmt: skip
    ax.margins(0.08)
    for name, axis in ((second, ax.xaxis), (first, ax.yaxis)):
        better = "more" if aims[name] == "maximize" else "less"
        label_axis(axis, label_of(table, name)._replace(suffix=f"\n{better} is better"))
    ax.grid(color=guide, alpha=0.25, linewidth=0.4)
    legend_above(ax)
    return ax


def _begin(start: Any, aims: Mapping[str, str]) -> dict[str, float]:
    """Return the aims of the initial orbit of the searches, if they have names."""
    quantities = {each.name: each for each in start.system.statistics.orbit_quantities}
    return {name: quantities[name](start) for name in aims} if set(aims) <= set(quantities) else {}


# --- Tolerance analyses

OUTSIDE, OUTSIDE_COLOR = "out of specification", "0.85"
PALE = "#72b2dd"  # a blue with visible lines on it
MAX_HISTOGRAMS = 4  # most quantities by default


@styled
def plot_tolerance_analysis(
    analysis: Spread | StoredStudy, ax: Any = None, *, quantity: str | Sequence[str] | None = None
) -> Axes:
    """Draw histograms of quantities with their specification, and Sobol indices.

    Each quantity has a panel: a histogram, blue within the specification, grey and hatched outside,
    with dashed lines at the bounds, a line at the median, and the yield. Bins follow the rule of
    Freedman and Diaconis, or of Sturges if that is finer. If indices were computed,
    a panel below has a bar for each sampled parameter: the first-order index, filled, within the
    total index, open; lines are their intervals.

    Parameters
    ----------
    analysis : ToleranceAnalysis or StoredStudy
        A store, running or finished, has neither specification nor indices.
    ax : matplotlib Axes, optional
        Where to draw the histogram of one quantity; a new figure of a column's width by default.
    quantity : str or sequence of str, optional
        Columns of the table; by default columns with a specification, or the first columns that
        vary.

    Returns
    -------
    Axes
        The uppermost; ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If `analysis` is not a tolerance analysis, or a quantity is unknown.

    See Also
    --------
    tolerance_analysis, ToleranceAnalysis, plot_sensitivity

    Examples
    --------
    >>> from scipy import stats
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> found = mi.tolerance_analysis(
    ...     actuator, mi.Sine(amplitude=0.24, omega=0.5), over={"e": stats.norm(0.8, 0.02)},
    ...     specification={"displacement per period": (1e-4, None)}, samples=16,
    ...     initial=mi.kicked_state(actuator),
    ... )
    >>> ax = mi.plot_tolerance_analysis(found, quantity="displacement per period")
    >>> ax.figure.savefig("tolerances.png")
    """
    if isinstance(analysis, StoredStudy) and analysis.kind == "tolerances":
        analysis = Spread(drawn=tuple(analysis.attrs["drawn"]), table=analysis.table)
    if isinstance(analysis, StoredStudy) or not hasattr(analysis, "yields"):
        allowed = "a ToleranceAnalysis, as mems_impact.tolerance_analysis returns it, or its store"
        raise InvalidParameter("analysis", type(analysis).__name__, allowed)
    names = _displayed_quantities(analysis, quantity)
    if ax is not None:
        _histogram(ax, analysis, names[0])
        return ax
    rows = [(name, kind) for name in names for kind in _panels(analysis, name)]
    bars = 2.6 + len(analysis.points.attrs.get("drawn", ()))
    figure = new_figure(0.8 * len(names), bars * (len(rows) - len(names)))
    ratios = [inches(0.8) if kind == "spread" else inches(0.0, bars) for _, kind in rows]
    panels = figure.subplots(len(rows), squeeze=False, gridspec_kw={"height_ratios": ratios})[:, 0]
    letter_panels(panels)
    for panel, (name, kind) in zip(panels, rows, strict=True):
        if kind == "spread":
            _histogram(panel, analysis, name)
        else:
            _bars(panel, analysis, name)
    return panels[0]


def _panels(analysis: Spread, name: str) -> tuple[str, ...]:
    """Return the panels of a quantity; indices need a number at every point."""
    if analysis.indices is None or _missing(analysis, name):
        return ("spread",)
    return ("spread", "indices")


def _missing(analysis: Spread, name: str) -> int:
    """Return at how many points a quantity has no number, where that leaves it without indices."""
    if analysis.indices is None:
        return 0
    return int(analysis.indices.loc[analysis.indices["quantity"] == name, "missing"].max())


def _displayed_quantities(analysis: Spread, quantity: str | Sequence[str] | None) -> list[str]:
    """Return the quantities to draw."""
    allowed = [*analysis.quantities, *(n for n in analysis.specification if n in analysis.points)]
    if quantity is not None:
        names = [quantity] if isinstance(quantity, str) else list(quantity)
        for name in names:
            if name not in allowed:
                raise InvalidParameter("quantity", name, f"one of {', '.join(allowed)}")
        return names
    spreads = analysis.points[analysis.quantities].agg(np.ptp)
    size = analysis.points[analysis.quantities].abs().max()
    varying = [name for name in analysis.quantities if spreads[name] > 1e-9 * size[name]]
    return list(analysis.specification) or varying[:MAX_HISTOGRAMS] or analysis.quantities[:1]


def _histogram(ax: Any, analysis: Spread, name: str) -> None:
    """Draw the histogram of a quantity."""
    points = analysis.points
    values = points[name].dropna().to_numpy()
    low, high = analysis.specification.get(name, (-math.inf, math.inf))
    ends = _ends(values, low, high)
    fine = (values >= low) & (values <= high)
    specified = name in analysis.specification
    _, _, (_, outside) = ax.hist(
        [values[fine], values[~fine]], _bins(values, ends), stacked=True,
        color=[color("motion"), OUTSIDE_COLOR],
        label=["as specified" if specified else "devices", OUTSIDE],
    )  # fmt: skip
    for bar in outside:
        bar.set(hatch="////", edgecolor="0.5", linewidth=0.0)
    for bound in (low, high):
        if math.isfinite(bound):
            ax.axvline(bound, color="black", linewidth=0.9, linestyle=(0, (4, 2)), label="bound")
    if len(values):
        median = float(np.median(values))
        ax.axvline(median, color="black", linewidth=1.0, label="median")
    ax.set_xlim(ends)
    notes = []
    if specified:
        row = analysis.yields.set_index("quantity").loc[name]
        notes.append(f"yield {row['share']:.1%} ({row['low']:.1%} to {row['high']:.1%})")
    if missing := _missing(analysis, name):
        notes.append(f"no indices: {missing} points have no number")
    label = Label(name, points.attrs.get("units", {}).get(name, ""))
    label_axis(ax.xaxis, label._replace(suffix="".join(f"\n{each}" for each in notes)))
    label_axis(ax.yaxis, Label("number of devices"))
    ax.yaxis.get_major_locator().set_params(integer=True)
    legend_above(ax, [each for each in ax.get_legend_handles_labels()[0]
                      if specified or each.get_label() != OUTSIDE])  # fmt: skip


def _bins(values: Any, ends: tuple[float, float]) -> Any:
    """Return the edges of bins by the rule of Freedman and Diaconis, or of Sturges if finer."""
    return (
        np.histogram_bin_edges(values, "auto")
        if len(values) and np.ptp(values) > 0.0
        else list(ends)
    )


def _ends(values: Any, low: float, high: float) -> tuple[float, float]:
    """Return the limits of the axis: all values, and nearby bounds; no sign that no value has."""
    if not len(values):
        return 0.0, 1.0
    first, last = float(values.min()), float(values.max())
    width, signs = last - first, (first >= 0.0, last <= 0.0)
    first = low if first - width < low < first else first
    last = high if last < high < last + width else last
    margin = 0.04 * (last - first) or 0.5 * abs(first) or 0.5
    first, last = first - margin, last + margin
    return max(first, 0.0) if signs[0] else first, min(last, 0.0) if signs[1] else last


def _bars(ax: Any, analysis: Spread, name: str) -> None:
    """Draw indices of one quantity."""
    assert analysis.indices is not None
    table = analysis.indices
    rows = table[table["quantity"] == name]
    symbols = table.attrs.get("symbols", {})
    positions = np.arange(len(rows))[::-1]
    style, guide = {"capsize": 0.0, "elinewidth": 1.0}, color("guide")
    for order, face, edge, shift in (("total", "none", guide, 0.13), ("first", PALE, PALE, -0.13)):
        middle = rows[order].to_numpy()
        ax.barh(positions, middle, height=0.62, color=face, edgecolor=edge, linewidth=0.9)
        reach = np.stack([middle - rows[f"{order} low"], rows[f"{order} high"] - middle])
        ax.errorbar(
            middle, positions + shift, xerr=np.maximum(reach, 0.0), fmt="none",
            ecolor="black" if order == "first" else guide, **style,
        )  # fmt: skip
    ax.set_yticks(positions, [symbol(each, symbols) for each in rows["parameter"]])
    ax.set_xlim(min(0.0, *ax.get_xlim()), max(1.0, ax.get_xlim()[1]))
    label_axis(ax.xaxis, Label("first-order (filled) and total index"))


# --- Tornado charts

MIN_BAR_RATIO = 1e-9  # part of the longest bar below which a bar is rounding
MAX_BARS = 15


@styled
def plot_sensitivity(
    sensitivity: Sensitivity,
    quantity: str,
    ax: Any = None,
    *,
    tolerances: Mapping[str, float | str] | None = None,
) -> Axes:
    """Draw a tornado chart: the change of a quantity with each parameter, the largest first.

    Changes are first-order, so that both sides of a bar are equal. Parameters without influence are
    omitted.

    Parameters
    ----------
    sensitivity : Sensitivity
        From `mems_impact.sensitivity`.
    quantity : str
    ax : matplotlib Axes, optional
        Axes to draw on; a new figure by default.
    tolerances : mapping of str to float, optional
        Change of each parameter, in its units; 1 % of its value by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If there is no such quantity or parameter, or no parameter changes the quantity.

    See Also
    --------
    sensitivity, Sensitivity, plot_tolerance_analysis

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> mi.plot_sensitivity(mi.sensitivity(orbit), "mean speed").figure.savefig("tornado.png")
    """
    gradient = sensitivity.gradient(quantity)
    system, symbols = sensitivity.system, sensitivity.system.units.symbols
    if tolerances is None:
        sizes = {name: 0.01 * abs(system.parameters[name]) for name in sensitivity.parameters}
    else:
        sizes = deviations(tolerances, system, sensitivity.parameters)
        for name, size in sizes.items():
            if not size > 0.0:
                raise InvalidParameter(f"tolerance of {name}", tolerances[name], "> 0")
    change = np.array([gradient[name] * size for name, size in sizes.items()])
    longest = np.nanmax(np.abs(change), initial=0.0)
    if not longest > 0.0:
        raise InvalidParameter("quantity", quantity, "a quantity that a parameter changes")
    # Equal bars, as of factors of one product, keep the order of the table.
    ranks = np.argsort(-np.round(np.abs(change) / longest, 6), kind="stable")
    order = [i for i in ranks if np.abs(change[i]) > MIN_BAR_RATIO * longest][:MAX_BARS]
    names, change = [list(sizes)[i] for i in order], change[order]
    if ax is None:
        ax = new_figure(0.0, 5.0 + len(names)).subplots()
    positions = np.arange(len(names))
    steps = ("+1 %", "-1 %") if tolerances is None else ("+ tolerance", "- tolerance")
    for sign, direction, label in ((1.0, "up", steps[0]), (-1.0, "down", steps[1])):
        ax.barh(
            positions, sign * change, label=label.replace("-", "\N{MINUS SIGN}"),
            color=color(direction), hatch="" if sign > 0.0 else "////", edgecolor="white",
        )  # fmt: skip
    ax.axvline(0.0, color="black", linewidth=0.8)
    labels = {name: symbol(name, symbols) for name in names}
    if tolerances is not None:
        labels = {
            name: f"{sign} ± {amount(sizes[name], system.units.get(name, ''), 3)}"
            for name, sign in labels.items()
        }
    ax.set_yticks(positions, list(labels.values()))
    ax.tick_params(axis="y", length=0)
    ax.set(ylim=(len(names) - 0.4, -0.6), xlim=(-1.08 * longest, 1.08 * longest))
    row = sensitivity.row(quantity)
    unit = sensitivity.units[row]
    start = amount(sensitivity.values[row], unit, 4).replace("-", "\N{MINUS SIGN}", 1)
    label_axis(ax.xaxis, Label(f"change of {quantity}", unit, f"\nfrom {start}"))
    legend_above(ax)
    ax.spines["left"].set_visible(False)
    return ax
