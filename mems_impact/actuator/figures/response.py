"""Deflection of the block and mean speed over the frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mems_impact.plotting.labels import label_axis, label_of, parameter_label
from mems_impact.plotting.placing import legend_above
from mems_impact.plotting.style import given_axes, graded, new_figure, styled, thickness

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["plot_response"]

FILLS = {"up": "full", "down": "none"}


@styled
def plot_response(table: pd.DataFrame, ax: Any = None) -> tuple[Any, Any]:
    """Draw deflection and mean speed over the frequency, a colour and a marker an amplitude.

    Filled on the way up, hollow on the way down.

    Parameters
    ----------
    table : DataFrame
        From `mems_impact.frequency_response`.
    ax : two matplotlib Axes, optional
        Where to draw deflection and speed; a new figure by default.

    Returns
    -------
    tuple of Axes
        ``axes[0].figure.savefig(…)`` writes the figure.

    See Also
    --------
    frequency_response, impact_onset

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> table = mi.frequency_response(actuator, drive, [0.46, 0.48, 0.5], [0.1, 0.24], transient=50)
    >>> mi.plot_response(table)[0].figure.savefig("response.png")
    """
    ax = new_figure(1.6).subplots(2, sharex=True) if ax is None else ax
    axes = given_axes(ax, 2, "one for the deflection, one for the speed")
    looks = dict(zip(values := table["amplitude"].unique(), graded(len(values)), strict=True))
    volts = label_of(table, "amplitude", "$f$")
    for (amplitude, direction), group in table.groupby(["amplitude", "direction"], sort=False):
        told = f"{volts.words} = {amplitude:g} {volts.unit}".rstrip()
        for panel, name in zip(axes, ("deflection", "mean speed"), strict=True):
            panel.plot(
                group["omega"], group[name], linewidth=thickness(0.6), label=f"{told}, {direction}",
                fillstyle=FILLS[direction], **looks[amplitude],
            )  # fmt: skip
    for panel, name in zip(axes, ("deflection", "mean speed"), strict=True):
        label_axis(panel.yaxis, label_of(table, name))
    label_axis(axes[1].xaxis, parameter_label(table, "omega"))
    legend_above(axes[0])
    return axes[0], axes[1]
