"""Deflection of the block and mean speed over the frequency."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mems_impact.plotting.style import new_figure, tidy
from mems_impact.tables.common import heading

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["plot_response"]

MARKS = {"up": {"marker": "o", "fillstyle": "full"}, "down": {"marker": "o", "fillstyle": "none"}}
WORDS = {"up": "up", "down": "down"}


def plot_response(table: pd.DataFrame, axes: Any = None) -> tuple[Any, Any]:
    """Draw deflection and mean speed over the frequency, a colour an amplitude.

    Filled dots on the way up, rings on the way down.

    Parameters
    ----------
    table : DataFrame
        From `mems_impact.frequency_response`.
    axes : two matplotlib Axes, optional
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
    if axes is None:
        axes = new_figure(6.4, 5.0).subplots(2, sharex=True)
    colors: dict[float, str] = {}
    for (amplitude, direction), group in table.groupby(["amplitude", "direction"], sort=False):
        color = colors.setdefault(amplitude, f"C{len(colors)}")
        for ax, name in zip(axes, ("deflection", "mean speed"), strict=True):
            ax.plot(
                group["omega"], group[name], linewidth=0.8, markersize=3.5, color=color,
                label=f"{amplitude:g}, {WORDS[direction]}", **MARKS[direction],
            )  # fmt: skip
    for ax, name in zip(axes, ("deflection", "mean speed"), strict=True):
        ax.set_ylabel(heading(table, name))
        tidy(ax)
    axes[1].set_xlabel(heading(table, "omega"))
    axes[0].legend(frameon=False, fontsize=8, title=heading(table, "amplitude"))
    return axes[0], axes[1]
