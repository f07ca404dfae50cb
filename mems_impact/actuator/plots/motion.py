"""Runs and orbits of a device."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from mems_impact.actuator.automaton import slips
from mems_impact.plotting.labels import (
    label_axis,
    label_of,
    legend_above,
    letter_panels,
    symbol,
)
from mems_impact.plotting.style import (
    DASHES,
    LINES,
    Axes,
    color,
    given_axes,
    new_figure,
    styled,
    thickness,
)
from mems_impact.plotting.trajectories import (
    FIGURE_PERIODS,
    IMPACT,
    ORBIT_POINTS_PER_PERIOD,
    RUN_POINTS_PER_PERIOD,
    jump,
    time_axis,
)

if TYPE_CHECKING:
    from mems_impact.actuator.results import ActuatorOrbit, ActuatorRun


@styled
def plot_orbit(orbit: ActuatorOrbit, ax: Any = None) -> Axes:
    """Draw v2 over x2 along a periodic orbit, with stoppers, impacts and slips."""
    if ax is None:
        ax = new_figure(1.2).subplots()
    table = orbit.samples(ORBIT_POINTS_PER_PERIOD)
    x, v = "x2", "v2"
    stuck = ~table["mode"].astype(str).map(slips)
    free, slipping = table[v].where(stuck), table[v].where(~stuck)
    # The line has a gap at impacts, where the velocity jumps.
    jumps = (table[x].diff().abs() < 1e-9) | (table[v].diff().abs() > 0.2 * table[v].abs().max())
    ax.plot(table[x], free.mask(jumps), color=color("motion"), label="frame stuck")
    if (~stuck).any():
        ax.plot(
            table[x], slipping, color=color("frame"), linewidth=thickness(2.0), label="frame slips"
        )
    delta = orbit.actuator.delta
    for stopper in (-delta, delta):
        ax.axvline(stopper, color=color("guide"), zorder=1, **DASHES)
    hits = orbit.impacts
    for number, (_, hit) in enumerate(hits.iterrows()):
        side = delta if hit["stopper"] == "right" else -delta
        ends = [hit["v2 before"], hit["v2 after"]]
        ax.plot([side, side], ends, marker="o", label=None if number else "impact", **jump())
    for name, axis in ((x, ax.xaxis), (v, ax.yaxis)):
        label_axis(axis, label_of(table, name, symbol(name)))
    legend_above(ax)
    return ax


NODES = ("node voltage", "left node voltage")  # columns of samples


@styled
def plot_run(
    run: ActuatorRun,
    first: float | None = None,
    last: float | None = None,
    ax: Any = None,
) -> tuple[Axes, Axes]:
    """Draw x2 and x1 over time, with impacts marked and slips shaded; return the axes of both.

    `first` and `last` are in forcing periods, by default the last 6 of the run. The voltage at the
    electrodes has a third panel if it differs from that of the drive; `ax` has two or three axes.
    Raises InvalidParameter if the run has no recorded events, or does not cover these periods.
    """
    (unit, label), delta = time_axis(run.system), run.actuator.delta
    if first is None:
        begin, end = run.extent
        end = end if last is None else last
        first = max(begin, end - FIGURE_PERIODS)
    samples = run.samples(RUN_POINTS_PER_PERIOD, first, last)
    time = samples["t"] / unit
    left, right = time.iloc[0], time.iloc[-1]
    nodes = [name for name in NODES if name in samples]
    if ax is None:
        heights = (3, 2, 2) if nodes else (3, 2)
        figure = new_figure(1.75 if nodes else 1.3)
        ax = figure.subplots(len(heights), sharex=True, height_ratios=heights)
        letter_panels(ax)
    if nodes and np.size(ax) == 3:
        requirement = "one for the block, one for the frame, one for the voltage"
        block, frame, voltage = given_axes(ax, 3, requirement)
        draw_voltages(voltage, run, samples, nodes, time)
    else:
        block, frame = given_axes(ax, 2, "one for the block, one for the frame")
        voltage = frame

    for slip in _slips(run.events, unit, left, right, samples["mode"].iloc[0]):
        for panel in (block, frame):
            # The edge keeps short slips visible.
            panel.axvspan(*slip, linewidth=0.8, zorder=0, **_slip())
    for stopper in (-delta, delta):
        block.axhline(stopper, color=color("guide"), zorder=1, **DASHES)
    block.plot(time, samples["x2"], color=color("motion"))
    hits = run.impacts
    hits = hits.assign(t=hits["t"] / unit)
    hits = hits[(hits["t"] >= left) & (hits["t"] <= right)]
    if len(hits):  # an empty line would extend the bounding box of the figure
        sides = hits["stopper"].map({"right": delta, "left": -delta}).astype(float)
        block.plot(hits["t"], sides, color=color("impact"), clip_on=False, **IMPACT)
    frame.plot(time, samples["x1"], color=color("motion"))

    block.set_ylim(-1.15 * delta, 1.15 * delta)
    frame.set_xlim(left, right)
    label_axis(block.yaxis, label_of(samples, "x2", "block in frame $x_2$"))
    label_axis(frame.yaxis, label_of(samples, "x1", "frame $x_1$"))
    label_axis(voltage.xaxis, label)
    _key(block)
    return block, frame


def draw_voltages(
    ax: Any, run: ActuatorRun, samples: pd.DataFrame, nodes: list[str], time: pd.Series
) -> None:
    """Draw the voltages at the electrodes and of the drive over the times of samples."""
    period = run.system.forcing_period
    for name in nodes:
        look = {"linestyle": LINES[NODES.index(name)]}
        if run.system.drive_unit == "V":
            channel = run.drive.sides[NODES.index(name)]
            drive = run.drive.value(np.remainder(samples["t"], 2.0 * period), channel=channel)
            ax.plot(time, drive, color=color("guide"), linewidth=thickness(0.8), **look,
                    label="drive" if name == nodes[0] else None)  # fmt: skip
        side = f"{'left' if name == NODES[1] else 'right'} electrode"
        ax.plot(time, samples[name], color=color("voltage"), **look,
                label=side if len(nodes) > 1 else "electrode")  # fmt: skip
    label_axis(ax.yaxis, label_of(samples, nodes[0], "voltage"))
    if len(ax.lines) > 1:
        legend_above(ax)


def _key(ax: Any) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries = [
        Line2D([], [], label="impact", color=color("impact"), **IMPACT),
        Line2D([], [], label="stopper", color=color("guide"), **DASHES),
        Patch(label="frame slips", **_slip()),
    ]
    legend_above(ax, entries)  # the motion may fill the axes


def _slip() -> dict[str, Any]:
    """Return the shading of slips."""
    mode_color = color("frame")
    return {"facecolor": (mode_color, 0.3), "edgecolor": (mode_color, 0.6)}


def _slips(
    events: pd.DataFrame, unit: float, left: float, right: float, mode: str
) -> list[tuple[float, float]]:
    """Return the intervals of slip between `left` and `right`, in the `unit` of the axis."""
    times = events["t"] / unit
    within = (times >= left) & (times <= right)
    intervals, begin = [], left if slips(mode) else None
    for time, after in zip(times[within], events["mode after"][within], strict=True):
        slides = slips(after)
        if slides and begin is None:
            begin = time
        elif not slides and begin is not None:
            intervals.append((begin, time))
            begin = None
    if begin is not None:
        intervals.append((begin, right))
    return intervals
