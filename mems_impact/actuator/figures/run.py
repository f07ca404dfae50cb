"""The motion over time: block between its stoppers, and frame on the ground."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mems_impact.actuator.modes import slips
from mems_impact.plotting.labels import Label, label_axis, label_of
from mems_impact.plotting.motion import IMPACT
from mems_impact.plotting.placing import legend_above
from mems_impact.plotting.run import PER_PERIOD, SHOWN
from mems_impact.plotting.style import DASHES, color, given_axes, new_figure, styled

if TYPE_CHECKING:
    import pandas as pd

    from mems_impact.actuator.results import ActuatorRun

__all__ = ["plot_run"]


@styled
def plot_run(
    run: ActuatorRun,
    first: float | None = None,
    last: float | None = None,
    ax: Any = None,
) -> tuple[Any, Any]:
    """Draw x2 and x1 over time, impacts marked and slips shaded.

    Parameters
    ----------
    run : ActuatorRun
        With its events kept.
    first, last : float, optional
        Forcing periods between which to draw; the last 6 of the run by default.
    ax : two matplotlib Axes, optional
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
    if first is None:
        begin, end = run.extent
        end = end if last is None else last
        first = max(begin, end - SHOWN)
    samples = run.samples(PER_PERIOD, first, last)
    time = samples["t"] / period
    left, right = time.iloc[0], time.iloc[-1]
    if ax is None:
        ax = new_figure(1.3).subplots(2, sharex=True, height_ratios=(3, 2))
    block, frame = given_axes(ax, 2, "one for the block, one for the frame")

    for slip in _slips(run.events, period, left, right, samples["mode"].iloc[0]):
        for panel in (block, frame):
            # The edge keeps a slip visible that is thinner than a dot.
            panel.axvspan(*slip, linewidth=0.8, zorder=0, **_slip())
    for stopper in (-delta, delta):
        block.axhline(stopper, color=color("guide"), zorder=1, **DASHES)
    block.plot(time, samples["x2"], color=color("motion"))
    hits = run.impacts
    hits = hits.assign(t=hits["period"] + hits["phase"])
    hits = hits[(hits["t"] >= left) & (hits["t"] <= right)]
    if len(hits):  # matplotlib gives a line without points a place, outside the figure
        sides = hits["stopper"].map({"right": delta, "left": -delta}).astype(float)
        block.plot(hits["t"], sides, color=color("impact"), clip_on=False, **IMPACT)
    frame.plot(time, samples["x1"], color=color("motion"))

    block.set_ylim(-1.15 * delta, 1.15 * delta)
    frame.set_xlim(left, right)
    label_axis(block.yaxis, label_of(samples, "x2", "block in frame $x_2$"))
    label_axis(frame.yaxis, label_of(samples, "x1", "frame $x_1$"))
    label_axis(frame.xaxis, Label("time / forcing period"))
    _key(block)
    return block, frame


def _key(ax: Any) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries = [
        Line2D([], [], label="impact", color=color("impact"), **IMPACT),
        Line2D([], [], label="stopper", color=color("guide"), **DASHES),
        Patch(label="frame slips", **_slip()),
    ]
    legend_above(ax, entries)  # the block may be anywhere within the axes


def _slip() -> dict[str, Any]:
    """Return how slips are shaded."""
    own = color("frame")
    return {"facecolor": (own, 0.3), "edgecolor": (own, 0.6)}


def _slips(
    events: pd.DataFrame, period: float, left: float, right: float, mode: str
) -> list[tuple[float, float]]:
    """Return the intervals between `left` and `right`, in forcing periods, of a sliding frame."""
    times = events["period"] + events["time"] / period
    within = (times >= left) & (times <= right)
    found, begin = [], left if slips(mode) else None
    for time, after in zip(times[within], events["mode after"][within], strict=True):
        slides = slips(after)
        if slides and begin is None:
            begin = time
        elif not slides and begin is not None:
            found.append((begin, time))
            begin = None
    if begin is not None:
        found.append((begin, right))
    return found
