"""Displacement per blow over the voltage, and one cycle of it (Fig. 3 of the paper)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from mems_impact.plotting.style import BLUE, GREEN, GREY, ORANGE, new_figure, tidy

if TYPE_CHECKING:
    from mems_impact.actuator.results import ActuatorRun

__all__ = ["plot_displacement"]

PER_PERIOD = 2000
MEASURED = (100.0, 20.0)
"""Amplitude [V] and displacement per blow [nm] at 1 Hz that the paper measured."""


def plot_displacement(
    table: pd.DataFrame, run: ActuatorRun, pull_in: float, axes: Any = None
) -> tuple[Any, Any, Any]:
    """Draw displacement per blow over the amplitude, and the motion over one voltage cycle.

    Parameters
    ----------
    table : DataFrame
        From `tables.displacement`: frequency, amplitude, displacement per blow.
    run : ActuatorRun
        Of at least two forcing periods after the transient, in SI.
    pull_in : float
        [V]
    axes : three matplotlib Axes, optional
        For displacement, block and frame; a new figure by default.

    Returns
    -------
    tuple of Axes
    """
    if axes is None:
        figure = new_figure(9.0, 4.4)
        grid = figure.add_gridspec(2, 2, width_ratios=(5, 4))
        response = figure.add_subplot(grid[:, 0])
        block = figure.add_subplot(grid[0, 1])
        frame = figure.add_subplot(grid[1, 1], sharex=block)
    else:
        response, block, frame = axes
    frequency, amplitude, displacement = table.columns[:3]
    colors = (BLUE, GREEN, ORANGE)
    for color, (hertz, rows) in zip(colors, table.groupby(frequency, sort=False), strict=False):
        response.plot(rows[amplitude], 1e9 * rows[displacement], color=color, marker="o",
                      markersize=3, linewidth=1.2, label=f"{hertz:g} Hz")  # fmt: skip
    response.axvline(pull_in, color=GREY, linewidth=0.9, linestyle=(0, (4, 3)))
    response.annotate("pull-in", (pull_in, 1.0), xycoords=response.get_xaxis_transform(),
                      xytext=(-3, -3), textcoords="offset points", ha="right", va="top",
                      color=GREY, fontsize="small")  # fmt: skip
    measured: dict[str, Any] = {"marker": "x", "color": "black", "linestyle": "none"}
    response.plot(*MEASURED, markersize=9, zorder=5, label="measured, 1 Hz", **measured)
    response.set_xlabel("amplitude [V]")
    response.set_ylabel("displacement per blow [nm]")
    response.legend(frameon=False)

    begin = run.extent[1] - 2.0
    samples = run.samples(PER_PERIOD, begin, None)
    time = samples["t"] - samples["t"].iloc[0]
    block.plot(time, 1e6 * samples["x2"], color=BLUE, linewidth=1.0)
    voltage = block.twinx()
    period = run.drive.period
    volts = run.drive.value(np.remainder(samples["t"].to_numpy(), 2.0 * period))
    voltage.plot(time, volts, color=GREY, linewidth=0.8)
    voltage.set_ylabel("voltage [V]", color=GREY)
    block.axhline(1e6 * run.actuator.delta, color=GREY, linewidth=0.8, linestyle=(0, (4, 3)))
    block.set_ylabel("$x_2$ [µm]")
    frame.plot(time, 1e9 * (samples["x1"] - samples["x1"].iloc[0]), color=BLUE, linewidth=1.2)
    frame.set_ylabel("$x_1$ [nm]")
    frame.set_xlabel("time [s]")
    block.tick_params(labelbottom=False)
    block.set_xlim(0.0, math.ceil(1e6 * time.iloc[-1]) / 1e6)
    for ax in (response, frame):
        tidy(ax)
    block.spines["top"].set_visible(False)
    voltage.spines["top"].set_visible(False)
    return response, block, frame
