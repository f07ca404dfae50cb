"""The motion over time: block between its stoppers, and frame on the ground."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from mems_impact.plotting.run import PER_PERIOD, SHOWN
from mems_impact.plotting.style import BLUE, GREEN, GREY, ORANGE, new_figure, tidy

if TYPE_CHECKING:
    import pandas as pd

    from mems_impact.actuator.results import ActuatorRun

__all__ = ["plot_run"]


def plot_run(
    run: ActuatorRun,
    first: float | None = None,
    last: float | None = None,
    axes: Sequence[Any] | None = None,
) -> tuple[Any, Any]:
    """Draw x2 and x1 over time, impacts marked and slips shaded.

    Parameters
    ----------
    run : ActuatorRun
        With its events kept.
    first, last : float, optional
        Forcing periods between which to draw; the last 6 of the run by default.
    axes : two matplotlib Axes, optional
        Where to draw x2 and x1; a new figure by default.

    Returns
    -------
    tuple of Axes
        For x2 and x1; ``axes[0].figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If the run kept no events, or does not cover those periods.
    """
    period, delta = run.system.forcing_period, run.actuator.delta
    unit = " [m]" if run.actuator.units == "SI" else ""
    if first is None:
        begin, end = run.extent
        end = end if last is None else last
        first = max(begin, end - SHOWN)
    samples = run.samples(PER_PERIOD, first, last)
    time = samples["t"] / period
    left, right = time.iloc[0], time.iloc[-1]
    if axes is None:
        figure = new_figure(7.0, 4.4)
        axes = figure.subplots(2, sharex=True, height_ratios=(3, 2))
    block, frame = axes

    for slip in _slips(run.events, period, left, right, samples["mode"].iloc[0]):
        for ax in (block, frame):
            # The edge keeps a slip visible that is thinner than a dot.
            ax.axvspan(*slip, color=GREEN, alpha=0.3, linewidth=1.0, zorder=0)
    for stopper in (-delta, delta):
        block.axhline(stopper, color=GREY, linewidth=1.0, linestyle=(0, (4, 3)), zorder=1)
    block.plot(time, samples["x2"], color=BLUE, linewidth=1.4)
    hits = run.impacts
    hits = hits.assign(t=hits["period"] + hits["phase"])
    hits = hits[(hits["t"] >= left) & (hits["t"] <= right)]
    if len(hits):  # matplotlib gives a line without points a place, outside the figure
        sides = hits["stopper"].map({"right": delta, "left": -delta}).astype(float)
        block.plot(
            hits["t"], sides, linestyle="none", marker="o", markersize=5, color=ORANGE,
            markeredgecolor="white", markeredgewidth=0.6, zorder=3, clip_on=False,
        )  # fmt: skip
    frame.plot(time, samples["x1"], color=BLUE, linewidth=1.4)

    block.set_ylabel("$x_2$, block in frame" + unit)
    block.set_ylim(-1.15 * delta, 1.15 * delta)
    frame.set_ylabel("$x_1$, frame" + unit)
    frame.ticklabel_format(axis="y", useOffset=False)
    frame.set_xlabel("time / forcing period")
    frame.set_xlim(left, right)
    _key(block)
    for ax in (block, frame):
        tidy(ax)
    return block, frame


def _key(ax: Any) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    dot: dict[str, Any] = {"linestyle": "none", "marker": "o", "markersize": 5, "color": ORANGE}
    dashes: dict[str, Any] = {"linestyle": (0, (4, 3)), "linewidth": 1.0, "color": GREY}
    entries = [
        Line2D([], [], label="impact", **dot),
        Line2D([], [], label="stopper", **dashes),
        Patch(color=GREEN, alpha=0.3, label="frame slips"),
    ]
    # Above the axes: the block may be anywhere within them.
    ax.legend(handles=entries, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, frameon=False)


def _slips(
    events: pd.DataFrame, period: float, left: float, right: float, mode: str
) -> list[tuple[float, float]]:
    """Return the intervals between `left` and `right`, in forcing periods, of a sliding frame."""
    times = events["period"] + events["time"] / period
    within = (times >= left) & (times <= right)
    slips, begin = [], None if mode.startswith("stuck") else left
    for time, after in zip(times[within], events["mode after"][within], strict=True):
        slides = not after.startswith("stuck")
        if slides and begin is None:
            begin = time
        elif not slides and begin is not None:
            slips.append((begin, time))
            begin = None
    if begin is not None:
        slips.append((begin, right))
    return slips
