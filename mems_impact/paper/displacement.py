"""Displacement per blow over the voltage, and one cycle of it (Fig. 3 of the paper)."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from mems_impact.plotting.labels import Label, label_axis, label_of, legend_above
from mems_impact.plotting.style import DASHES, color, graded, new_figure, styled, thickness

if TYPE_CHECKING:
    from mems_impact.actuator.results import ActuatorRun

__all__ = ["plot_displacement"]

PER_PERIOD = 2000
MEASURED = (100.0, 20e-9)
"""Amplitude [V] and displacement per blow [m] at 1 Hz that the paper measured."""


@styled
def plot_displacement(
    table: pd.DataFrame, run: ActuatorRun, pull_in: float, ax: Any = None
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
    ax : three matplotlib Axes, optional
        For displacement, block and frame; a new figure by default.

    Returns
    -------
    tuple of Axes
    """
    if ax is None:
        ax = new_figure(2.2).subplots(3, height_ratios=(5, 3, 2))
        ax[1].sharex(ax[2])
    response, block, frame = ax
    frequency, amplitude, displacement = table.columns[:3]
    groups = table.groupby(frequency)
    for look, (hertz, rows) in zip(graded(groups.ngroups), groups, strict=True):
        response.plot(rows[amplitude], rows[displacement], markersize=3.0,
                      label=f"{hertz:g} Hz", **look)  # fmt: skip
    guide = color("guide")
    response.axvline(pull_in, color=guide, label="pull-in", **DASHES)
    cross: dict[str, Any] = {"marker": "x", "markersize": 6, "linestyle": "none", "zorder": 5}
    response.plot(*MEASURED, color="black", label="measured, 1 Hz", **cross)
    label_axis(response.xaxis, Label("amplitude $f$", "V"))
    label_axis(response.yaxis, Label("displacement per blow", "m"))
    legend_above(response)

    begin = run.extent[1] - 2.0
    samples = run.samples(PER_PERIOD, begin, None)
    time = samples["t"] - samples["t"].iloc[0]
    (motion,) = block.plot(time, samples["x2"], color=color("motion"), linewidth=thickness(0.8),
                           label="block")  # fmt: skip
    voltage = block.twinx()
    period = run.drive.period
    volts = run.drive.value(np.remainder(samples["t"].to_numpy(), 2.0 * period))
    (driven,) = voltage.plot(time, volts, color=color("voltage"), linewidth=thickness(0.8),
                             linestyle=(0, (4, 1.5)), label="voltage")  # fmt: skip
    voltage.spines["right"].set_visible(True)
    stopper = block.axhline(run.actuator.delta, color=guide, label="stopper", **DASHES)
    frame.plot(time, samples["x1"] - samples["x1"].iloc[0], color=color("motion"))
    block.tick_params(labelbottom=False)
    frame.set_xlim(0.0, math.ceil(1e6 * time.iloc[-1]) / 1e6)
    label_axis(voltage.yaxis, Label("voltage", "V"))
    label_axis(block.yaxis, label_of(samples, "x2", "$x_2$"))
    label_axis(frame.yaxis, label_of(samples, "x1", "$x_1$"))
    label_axis(frame.xaxis, Label("time", "s"))
    legend_above(block, [motion, driven, stopper])
    return response, block, frame
