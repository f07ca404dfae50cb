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
from mems_impact.plotting.labels import Label, label_axis, label_of, symbol
from mems_impact.plotting.motion import (
    IMPACT,
    between,
    check_states,
    jump,
    line,
    mode_styles,
    moves,
    shade,
    spans,
)
from mems_impact.plotting.placing import legend_above
from mems_impact.plotting.style import color, given_axes, new_figure, styled

__all__ = ["PER_PERIOD", "SHOWN", "plot_run"]

SHOWN = 6  # forcing periods by default
PER_PERIOD = 400
POINTS = 3000  # over a run without forcing
PANELS = 6  # by default


@styled
def plot_run(
    run: Run,
    first: float | None = None,
    last: float | None = None,
    ax: Any = None,
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
    ax : matplotlib Axes or sequence of these, optional
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
        return resolve_name(run.figure)(run, first, last, ax)[0]
    known = run.system.states
    chosen = known[:PANELS] if states is None else check_states("states", states, known)
    if ax is None:
        figure = new_figure(0.55 * len(chosen), 2.5)
        axes = list(figure.subplots(len(chosen), sharex=True, squeeze=False)[:, 0])
    else:
        axes = given_axes(ax, len(chosen), "one a state")

    samples = _samples(run, first, last)
    corners = between(run.corners, samples)
    curve = line(samples, corners, chosen)
    unit = run.system.forcing_period or 1.0  # of the axis of time
    stretches = spans(samples, corners)
    spent = (stretches["end"] - stretches["start"]).groupby(stretches["mode"]).sum()
    most, *shaded = mode_styles(spent, run.system.modes)
    shades = {mode: shade(i) for i, mode in enumerate(shaded)}
    for panel, name in zip(axes, chosen, strict=True):
        for stretch in stretches[stretches["mode"] != most].itertuples():
            # The edge keeps a stretch visible that is thinner than a dot.
            panel.axvspan(
                stretch.start / unit, stretch.end / unit, linewidth=0.8, zorder=0,
                **shades[stretch.mode],
            )  # fmt: skip
        panel.plot(curve["t"] / unit, curve[name], color=color("motion"))
        _mark(panel, name, corners, samples, unit)
        label_axis(panel.yaxis, label_of(samples, name, symbol(name)))
    axes[-1].set_xlim(samples["t"].iloc[0] / unit, samples["t"].iloc[-1] / unit)
    words = Label("time / forcing period") if run.system.forced else label_of(samples, "t", "time")
    label_axis(axes[-1].xaxis, words)
    _key(axes[0], most if len(run.system.modes) > 1 else "", shades, corners)
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
        ax.plot(np.repeat(jumps["t"] / unit, 3), broken, **jump())
    hits = corners[corners["impact"] & ~moves(corners, name, samples)]
    if len(hits):  # matplotlib gives a line without points a place, outside the figure
        ax.plot(
            hits["t"] / unit, hits[f"{name} after"], color=color("impact"), clip_on=False, **IMPACT
        )


def _key(ax: Any, most: str, shades: dict[str, dict[str, Any]], corners: pd.DataFrame) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries: list[Any] = []
    if corners["impact"].any():
        entries.append(Line2D([], [], color=color("impact"), label="impact", **IMPACT))
    entries += [Patch(label=mode, **look) for mode, look in shades.items()]
    if shades and most:
        entries.append(Patch(facecolor="none", edgecolor="0.6", label=most))
    legend_above(ax, entries)  # the motion may be anywhere within the axes
