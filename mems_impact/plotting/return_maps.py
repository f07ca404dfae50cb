"""Figures of return maps: invariant manifolds in a section, and cobwebs of one quantity."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from mems_impact.analysis.manifold import COUNTS, Manifold
from mems_impact.analysis.run import Run
from mems_impact.errors import InvalidParameter
from mems_impact.plotting.labels import label_axis, legend_above, parameter_label
from mems_impact.plotting.style import Axes, cased, color, new_figure, styled, thickness
from mems_impact.systems.result import check_kind
from mems_impact.systems.state import whole

LINE_STYLES = {"unstable": "-", "stable": (0, (3.5, 1.2))}
LINE_COLORS = {"unstable": "#b2182b", "stable": "black"}


@styled
def plot_manifold(
    manifold: Manifold | Sequence[Manifold],
    ax: Any = None,
    *,
    x: str | None = None,
    y: str | None = None,
) -> Axes:
    """Draw stable and unstable manifolds, and the points of their saddles.

    Lines break where the Poincaré map jumps. Drawn over basins, manifolds keep the limits of the
    axes.

    Parameters
    ----------
    manifold : Manifold or sequence of Manifold
    ax : matplotlib Axes, optional
        Where to draw, such as the axes of `plot_basins`; a new figure of a column's width by
        default.
    x, y : str, optional
        States on the axes; the first two that vary on the section by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If an argument is not a manifold, or a state is unknown.

    See Also
    --------
    manifold, plot_basins

    Examples
    --------
    >>> import mems_impact as mi
    >>> def well(mode, t, y, p):
    ...     return y.v, y.x - y.x**3 - 0.2 * y.v
    >>> system = mi.System(states=("x", "v"), flow=well)
    >>> (saddle,) = mi.find_equilibria(system, guess={"x": 0.1})
    >>> both = [mi.manifold(saddle, kind, length=2.0) for kind in ("unstable", "stable")]
    >>> mi.plot_manifold(both).figure.savefig("manifolds.png")
    """
    manifolds: list[Any] = list(manifold) if isinstance(manifold, list | tuple) else [manifold]
    for each in manifolds:
        allowed = "a Manifold, as mems_impact.manifold returns it, or several"
        check_kind(each, "manifold", Manifold, allowed)
    if not manifolds:
        raise InvalidParameter("manifold", "none", "one or more")
    system = manifolds[0].system
    for field, name in (("x", x), ("y", y)):
        if name is not None and name not in system.states:
            raise InvalidParameter(field, name, f"one of {', '.join(system.states)}")
    names = [name for name in system.state_space.on_section if name not in (x, y)]
    across = x or names.pop(0)
    up = y or (names[0] if names else next(name for name in system.states if name != across))
    new_axes = ax is None
    if new_axes:
        ax = new_figure(1.4).subplots()
    limits = ax.get_xlim(), ax.get_ylim()
    handles: list[Any] = []
    for each in manifolds:
        line = {"color": LINE_COLORS[each.kind], "linestyle": LINE_STYLES[each.kind]}
        for i, (_, piece) in enumerate(each.table.groupby(list(COUNTS))):
            label = f"{each.kind} manifold"
            new = label not in [handle.get_label() for handle in handles]
            (artist,) = ax.plot(
                piece[across], piece[up], linewidth=thickness(0.7), zorder=5,
                path_effects=cased(thickness(0.7)), label=label if i == 0 and new else None, **line,
            )  # fmt: skip
            if i == 0 and new:
                handles.append(artist)
        origin = each.table[each.table["arclength"] == 0.0].groupby("point").first()
        ax.plot(
            origin[across], origin[up], linestyle="none", marker="X", markersize=5.0,
            color="white", markeredgecolor="black", zorder=6,
        )  # fmt: skip
    table = manifolds[0].table
    if new_axes:
        label_axis(ax.xaxis, parameter_label(table, across))
        label_axis(ax.yaxis, parameter_label(table, up))
        legend_above(ax, handles)
    else:
        ax.set(xlim=limits[0], ylim=limits[1])
    return ax


@styled
def plot_return_map(
    run: Run, quantity: str | None = None, ax: Any = None, *, last: int = 30, skip: int = 0
) -> Axes:
    """Draw a quantity at each return of a run against its value at the previous return.

    Returns are upward crossings of the section or, without one, starts of forcing periods. The
    diagonal and the cobweb of the last returns show how the motion settles, and a fixed point lies
    where the returns meet the diagonal.

    Parameters
    ----------
    run : Run
    quantity : str, optional
        A state, or another column of ``run.section()``; the first state that varies by default.
    ax : matplotlib Axes, optional
        Where to draw; a new figure of a column's width by default.
    last : int, optional
        Returns in the cobweb, 0 for none.
    skip : int, optional
        Returns omitted at the start.

    Returns
    -------
    Axes

    Raises
    ------
    InvalidParameter
        If the quantity is unknown, or fewer than two returns remain.

    See Also
    --------
    simulate, plot_run, plot_manifold

    Examples
    --------
    >>> import mems_impact as mi
    >>> def still(mode, t, y, p):
    ...     return (0.0,)
    >>> def logistic(mode, t, y, p):
    ...     return mode, (3.9 * y.x * (1.0 - y.x),)
    >>> system = mi.System(states=("x",), flow=still, switch_transition=logistic, period=1.0,
    ...     switches=[0.5], initial={"x": 0.3})
    >>> run = mi.simulate(system, periods=200)
    >>> mi.plot_return_map(run, "x").figure.savefig("logistic.png")
    """
    check_kind(run, "run", Run, "a Run, as mems_impact.simulate returns it")
    last, skip = whole("last", last, 0), whole("skip", skip, 0)
    table = run.section(1)
    numeric = [name for name in table.columns if table[name].dtype.kind == "f"]
    if quantity is None:
        quantity = run.system.state_space.on_section[0]
    if quantity not in numeric:
        raise InvalidParameter("quantity", quantity, f"one of {', '.join(numeric)}")
    values = table[quantity].to_numpy()[skip:]
    if values.size < 2:
        raise InvalidParameter("skip", skip, f"below {max(1, len(table) - 1)}, for two returns")
    if ax is None:
        ax = new_figure(1.4).subplots()
    low, high = float(values.min()), float(values.max())
    room = 0.04 * (high - low) or 0.04 * max(1.0, abs(high))
    ends = [low - room, high + room]
    ax.plot(ends, ends, color="0.6", linewidth=thickness(0.6), zorder=1)
    if last:
        web = np.repeat(values[-(last + 1) :], 2)
        ax.plot(
            web[:-1], web[1:], color=color("impact"), linewidth=thickness(0.5), alpha=0.8, zorder=2
        )
    ax.plot(
        values[:-1], values[1:], linestyle="none", marker=".", markersize=3.0,
        color=color("motion"), zorder=3,
    )  # fmt: skip
    label = parameter_label(table, quantity)
    ax.set(xlim=ends, ylim=ends)
    for axis, name in ((ax.xaxis, "n"), (ax.yaxis, "n + 1")):
        label_axis(axis, label._replace(text=_numbered(label.text, name)))
    ax.set_aspect("equal", adjustable="box")
    return ax


def _numbered(text: str, number: str) -> str:
    """Return an axis label with the number of the return as its index."""
    if text.startswith("$") and text.endswith("$"):
        sign = text[1:-1]
        return f"${sign}_{{{number}}}$" if len(sign) == 1 else f"$({sign})_{{{number}}}$"
    return f"{text} at return ${number}$"
