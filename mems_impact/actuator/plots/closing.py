"""Closing of a contact."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from mems_impact.actuator.plots.motion import NODES, draw_voltages
from mems_impact.plotting.labels import Label, label_axis, label_of, legend_above, letter_panels
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
from mems_impact.plotting.trajectories import IMPACT

if TYPE_CHECKING:
    from mems_impact.actuator.design.closing import Closing
    from mems_impact.actuator.design.soft_landing import SoftLanding


CLOSING_POINTS = 2000  # of the curve of the block
CLOSING_MARGIN = 1.3  # length of the figure relative to the settling time


@styled
def plot_closing(closing: Closing | SoftLanding, ax: Any = None) -> tuple[Axes, Axes, Axes]:
    """Draw displacement, voltage and contact over time.

    Parameters
    ----------
    closing : Closing or SoftLanding
    ax : three matplotlib Axes, optional
        Axes for displacement, voltage and contact; a new figure by default.

    Returns
    -------
    tuple of Axes
        ``axes[0].figure.savefig(…)`` writes the figure.

    See Also
    --------
    closing, soft_landing, plot_run

    Examples
    --------
    >>> import mems_impact as mi
    >>> switch = mi.load_actuator("abdulrahim2016")
    >>> found = mi.closing(switch, mi.VoltageStep(amplitude=90))
    >>> mi.plot_closing(found)[0].figure.savefig("closing.png")
    """
    result: Any = getattr(closing, "closing", closing)
    run, table = result.run, result.table
    if ax is None:
        ax = new_figure(1.5).subplots(3, sharex=True, height_ratios=(4, 2, 1.2))
        letter_panels(ax)
    block, volts, contact = given_axes(ax, 3, "for displacement, voltage and contact")
    drive, delta, period = run.drive, run.actuator.delta, run.system.forcing_period
    end = run.periods * period
    if math.isfinite(result.settling_time):
        late = [time for time in drive.switches if time < end]
        end = min(end, CLOSING_MARGIN * max(result.settling_time, *late, 0.0))
    share = end / period
    samples = run.samples(max(1, math.ceil(CLOSING_POINTS / share)), 0.0, share)
    sides = {"right": delta, "left": -delta}
    stoppers = set(table["stopper"]) or {"right"}
    for name in stoppers:
        block.axhline(sides[name], color=color("guide"), zorder=1, **DASHES)
    block.plot(samples["t"], samples["x2"], color=color("motion"))
    hits = table[table["t"] <= end]
    if len(hits):
        levels = hits["stopper"].map(sides).astype(float)
        block.plot(hits["t"], levels, color=color("impact"), clip_on=False, **IMPACT)
    nodes = [name for name in NODES if name in samples]
    if nodes:
        draw_voltages(volts, run, samples, nodes, samples["t"])
    else:
        borders = sorted({0.0, *(time for time in drive.switches if time < end), end})
        time = np.concatenate([np.linspace(a, np.nextafter(b, 0.0), CLOSING_POINTS // 10)
                               for a, b in pairwise(borders)])  # fmt: skip
        for side, line in zip(drive.sides, LINES, strict=False):
            values = drive.value(time % (2.0 * period), channel=side)
            volts.plot(time, values, color=color("voltage"), linestyle=line)
        label_axis(volts.yaxis, Label("voltage", "V" if run.system.units.scales.named else ""))
    _draw_contacts(contact, result, end)
    block.set_xlim(0.0, end)
    label_axis(block.yaxis, label_of(samples, "x2", "block in frame $x_2$"))
    contact.set_yticks([])
    contact.set_ylabel("contact")
    label_axis(contact.xaxis, label_of(samples, "t", "time"))
    _key_of_closing(block)
    return block, volts, contact


def _draw_contacts(ax: Any, closing: Closing, end: float) -> None:
    """Draw the times of contact as bars, an instantaneous one as a line."""
    table, style = closing.table, {"color": color("impact")}
    for start, length in zip(table["t"], table["contact"], strict=True):
        if length == 0.0:
            ax.axvline(start, linewidth=thickness(0.6), **style)
        elif math.isfinite(length):
            ax.axvspan(start, start + length, linewidth=0.0, **style)
    if math.isfinite(closing.settling_time):
        ax.axvspan(closing.settling_time, end, linewidth=0.0, **style)


def _key_of_closing(ax: Any) -> None:
    from matplotlib.lines import Line2D

    legend_above(ax, [
        Line2D([], [], label="impact", color=color("impact"), **IMPACT),
        Line2D([], [], label="stopper", color=color("guide"), **DASHES),
    ])  # fmt: skip
