"""Frequency responses."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import pandas as pd

from mems_impact.plotting.labels import (
    label_axis,
    label_of,
    legend_above,
    letter_panels,
    parameter_label,
    symbol,
)
from mems_impact.plotting.style import color, given_axes, graded, new_figure, styled, thickness

if TYPE_CHECKING:
    from mems_impact.actuator.design.characteristics import FrequencyResponse


__all__ = ["plot_response"]


FILLS: dict[str, Any] = {"up": "full", "down": "none"}


@styled
def plot_response(response: FrequencyResponse | pd.DataFrame, ax: Any = None) -> tuple[Any, Any]:
    """Draw deflection and mean speed over the frequency.

    Each amplitude has a colour and a marker, filled in sweeps up and hollow in sweeps down.

    Parameters
    ----------
    response : FrequencyResponse or DataFrame
        A frequency response, or its table.
    ax : two matplotlib Axes, optional
        Axes for deflection and speed; a new figure by default.

    Returns
    -------
    tuple of Axes
        ``axes[0].figure.savefig(…)`` writes the figure.

    See Also
    --------
    frequency_response, FrequencyResponse

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> response = mi.frequency_response(actuator, drive, [0.46, 0.48, 0.5], [0.1, 0.24])
    >>> mi.plot_response(response)[0].figure.savefig("response.png")
    """
    from matplotlib.lines import Line2D

    if ax is None:
        ax = new_figure(1.6).subplots(2, sharex=True)
        letter_panels(ax)
    axes = given_axes(ax, 2, "one for the deflection, one for the speed")
    table = response if isinstance(response, pd.DataFrame) else response.table
    parameter = "frequency" if "frequency" in table else "omega"
    looks = dict(zip(values := table["amplitude"].unique(), graded(len(values)), strict=True))
    for (amplitude, direction), group in table.groupby(["amplitude", "direction"], sort=False):
        for panel, name in zip(axes, ("deflection", "mean speed"), strict=True):
            panel.plot(
                group[parameter], group[name], linewidth=thickness(0.6), fillstyle=FILLS[direction],
                **looks[amplitude],
            )  # fmt: skip
    for panel, name in zip(axes, ("deflection", "mean speed"), strict=True):
        label_axis(panel.yaxis, label_of(table, name))
    label_axis(axes[1].xaxis, parameter_label(table, parameter))
    unit = label_of(table, "amplitude").unit
    sign = "" if unit else f"{symbol('amplitude', table.attrs.get('symbols', {}))} = "
    handles = [
        Line2D(
            [], [], linewidth=thickness(0.6), label=f"{sign}{amplitude:g} {unit}".rstrip(), **look
        )
        for amplitude, look in looks.items()
    ]
    handles += [
        Line2D([], [], linestyle="none", marker="o", color=color("guide"), fillstyle=FILLS[way],
               label=way)
        for way in FILLS if (table["direction"] == way).any()
    ]  # fmt: skip
    legend_above(axes[0], handles)
    return axes[0], axes[1]
