"""The motion over time: one panel a state, impacts marked, modes shaded."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pkgutil import resolve_name
from typing import Any

import numpy as np
import pandas as pd

from mems_impact.analysis.run import Run
from mems_impact.errors import InvalidParameter
from mems_impact.plotting.motion import JUMP, between, check_states, line, mode_colors, moves, spans
from mems_impact.plotting.style import BLUE, ORANGE, new_figure, symbol, tidy, with_unit

__all__ = ["PER_PERIOD", "SHOWN", "plot_run"]

SHOWN = 6  # forcing periods by default
PER_PERIOD = 400
POINTS = 3000  # over a run without forcing
PANELS = 6  # by default


def plot_run(
    run: Run,
    first: float | None = None,
    last: float | None = None,
    axes: Sequence[Any] | None = None,
    *,
    states: Sequence[str] | None = None,
) -> Any:
    """Draw the states of a run over time, impacts marked and modes shaded.

    Where an impact makes a state jump, a dotted line joins the values before and after. The mode in
    which most of the time is spent is not shaded.

    Parameters
    ----------
    run : Run
        With its events kept.
    first, last : float, optional
        Forcing periods between which to draw, times where nothing forces the system; the last 6
        periods of the run by default, or the whole of one without forcing.
    axes : sequence of matplotlib Axes, optional
        Where to draw, one for each state; a new figure by default.
    states : sequence of str, optional
        Which states; all by default, or the first 6. Of an actuator the block between its stoppers
        and the frame, as they are drawn if this is not given.

    Returns
    -------
    Axes
        The uppermost; ``ax.figure.savefig(…)`` writes the figure, ``ax.figure.axes`` are all.

    Raises
    ------
    InvalidParameter
        If the run kept no events, does not cover those periods, or has no such state.

    See Also
    --------
    simulate, Run, plot_orbit

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> run = mi.simulate(actuator, drive, periods=300)
    >>> axes = mi.plot_run(run, first=296, states=["v2"])
    >>> axes.figure.savefig("run.png")
    """
    if not isinstance(run, Run):
        allowed = "a Run, as mems_impact.simulate returns it"
        raise InvalidParameter("run", type(run).__name__, allowed)
    if run.figure and states is None:
        return resolve_name(run.figure)(run, first, last, axes)[0]
    known = run.system.states
    chosen = known[:PANELS] if states is None else check_states("states", states, known)
    if axes is None:
        figure = new_figure(7.0, 1.0 + 1.7 * len(chosen))
        axes = figure.subplots(len(chosen), sharex=True, squeeze=False)[:, 0]
    elif len(axes) != len(chosen):
        raise InvalidParameter("axes", len(axes), f"{len(chosen)} axes, one a state")

    samples = _samples(run, first, last)
    corners = between(run.corners, samples)
    curve = line(samples, corners, chosen)
    unit = run.system.forcing_period or 1.0  # of the axis of time
    stretches = spans(samples, corners)
    spent = (stretches["end"] - stretches["start"]).groupby(stretches["mode"]).sum()
    colors = mode_colors(spent, run.system.modes)
    most = next(iter(colors))
    for ax, name in zip(axes, chosen, strict=True):
        for stretch in stretches[stretches["mode"] != most].itertuples():
            color = colors[stretch.mode]
            # The edge keeps a stretch visible that is thinner than a dot.
            ax.axvspan(
                stretch.start / unit, stretch.end / unit, color=color, alpha=0.3, linewidth=1.0,
                zorder=0,
            )  # fmt: skip
        ax.plot(curve["t"] / unit, curve[name], color=BLUE, linewidth=1.4)
        _mark(ax, name, corners, samples, unit)
        ax.set_ylabel(with_unit(symbol(name), samples, name))
        ax.ticklabel_format(axis="y", useOffset=False, scilimits=(-4, 5))
        tidy(ax)
    words = "time / forcing period" if run.system.forced else with_unit("time", samples, "t")
    axes[-1].set_xlabel(words)
    axes[-1].set_xlim(samples["t"].iloc[0] / unit, samples["t"].iloc[-1] / unit)
    _key(axes[0], colors if len(run.system.modes) > 1 else {}, corners)
    return axes[0]


def _samples(run: Run, first: float | None, last: float | None) -> pd.DataFrame:
    """Return the samples to draw: as many as the eye can tell apart."""
    begin, end = run.extent
    if run.system.forced:
        if first is None:
            first = max(begin, (end if last is None else last) - SHOWN)
        return run.samples(PER_PERIOD, first, last)
    return run.samples(max(1, math.ceil(POINTS / max(end - begin, 1e-300))), first, last)


def _mark(ax: Any, name: str, corners: pd.DataFrame, samples: pd.DataFrame, unit: float) -> None:
    """Mark impacts by dots, and jumps of the state by dotted lines."""
    jumps = corners[moves(corners, name, samples)]
    if len(jumps):
        before, after = jumps[f"{name} before"], jumps[f"{name} after"]
        broken = np.column_stack([before, after, np.full(len(jumps), np.nan)]).ravel()
        ax.plot(np.repeat(jumps["t"] / unit, 3), broken, **JUMP)
    hits = corners[corners["impact"] & ~moves(corners, name, samples)]
    if len(hits):  # matplotlib gives a line without points a place, outside the figure
        ax.plot(
            hits["t"] / unit, hits[f"{name} after"], linestyle="none", marker="o", markersize=5,
            color=ORANGE, markeredgecolor="white", markeredgewidth=0.6, zorder=4, clip_on=False,
        )  # fmt: skip


def _key(ax: Any, colors: dict[str, str], corners: pd.DataFrame) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    dot: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 5, "color": ORANGE}
    entries: list[Any] = [Line2D([], [], label="impact", **dot)] if corners["impact"].any() else []
    shaded = list(colors.items())[1:]
    entries += [Patch(color=color, alpha=0.3, label=mode) for mode, color in shaded]
    if shaded:
        entries.append(Patch(facecolor="none", edgecolor="0.6", label=next(iter(colors))))
    if entries:
        # Above the axes: the motion may be anywhere within them.
        place = {"loc": "lower right", "bbox_to_anchor": (1.0, 1.0)}
        ax.legend(handles=entries, ncols=min(5, len(entries)), frameon=False, **place)
