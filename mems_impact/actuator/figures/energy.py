"""Where the energy goes, as bars."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mems_impact.plotting.labels import label_axis, label_of
from mems_impact.plotting.placing import legend_above
from mems_impact.plotting.style import color, new_figure, styled

if TYPE_CHECKING:
    from mems_impact.actuator.design.energy import Energy

__all__ = ["plot_energy"]

COLORS = {"in": "voltage", "load": "frame"}
HATCHES = {"lost": "////", "load": "....", "stored": ""}
WORDS = {"in": "given by the drive", "lost": "lost", "load": "work on loads", "stored": "stored"}


@styled
def plot_energy(energy: Energy, ax: Any = None) -> Any:
    """Draw the energy per forcing period of every account as a bar, its share beside it.

    Parameters
    ----------
    energy : Energy
    ax : matplotlib Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    See Also
    --------
    energy, Energy

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> run = mi.simulate(actuator, drive, periods=60)
    >>> mi.plot_energy(mi.energy(run)).figure.savefig("energy.png")
    """
    table = energy.table
    if ax is None:
        ax = new_figure(0.0, 4.0 + 1.1 * len(table)).subplots()
    places = range(len(table))
    shown = set()
    for place, row in zip(places, table.itertuples(), strict=True):
        label = None if row.kind in shown else WORDS[row.kind]
        shown.add(row.kind)
        value = table["energy per period"].iloc[place]
        face = color(COLORS[row.kind]) if row.kind in COLORS else "0.8"
        bar = ax.barh(
            place, value, color=face, label=label, hatch=HATCHES.get(row.kind), edgecolor="0.3"
        )
        ax.bar_label(bar, labels=[f"{100.0 * row.share:.3g} %"], padding=3, fontsize="small")
    ax.set_yticks(list(places), [name.replace("_", " ") for name in table["account"]])
    ax.invert_yaxis()
    ax.axvline(0.0, color=color("guide"), linewidth=0.6)
    ax.margins(x=0.25)
    label_axis(ax.xaxis, label_of(table, "energy per period"))
    legend_above(ax)
    return ax
