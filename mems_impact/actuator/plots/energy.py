"""Energy accounts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mems_impact.plotting.labels import label_axis, label_of, legend_above
from mems_impact.plotting.style import Axes, color, new_figure, styled

if TYPE_CHECKING:
    from mems_impact.actuator.design.energy import Energy


ENERGY_COLORS = {"in": "voltage", "load": "frame"}
ENERGY_HATCHES = {"lost": "////", "load": "....", "stored": ""}
ENERGY_WORDS = {
    "in": "given by the drive",
    "lost": "lost",
    "load": "work on loads",
    "stored": "stored",
}


NEGLIGIBLE_SHARE = 1e-6  # of the input: the stored energy of an orbit is an error of rounding


@styled
def plot_energy(energy: Energy, ax: Any = None) -> Axes:
    """Draw the energy per forcing period of every account as a bar, labelled with its share.

    Parameters
    ----------
    energy : Energy
    ax : matplotlib Axes, optional
        Axes to draw on; a new figure by default.

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
    positions = range(len(table))
    labeled = set()
    for position, row in zip(positions, table.itertuples(), strict=True):
        label = None if row.kind in labeled else ENERGY_WORDS[row.kind]
        labeled.add(row.kind)
        value = table["energy per period"].iloc[position]
        share = row.share
        if abs(share) < NEGLIGIBLE_SHARE:
            value = share = 0.0
        face = color(ENERGY_COLORS[row.kind]) if row.kind in ENERGY_COLORS else "0.8"
        bar = ax.barh(
            position,
            value,
            color=face,
            label=label,
            hatch=ENERGY_HATCHES.get(row.kind),
            edgecolor="0.3",
        )
        ax.bar_label(bar, labels=[f"{100.0 * share:.3g} %"], padding=3, fontsize="small")
    ax.set_yticks(list(positions), [name.replace("_", " ") for name in table["account"]])
    ax.invert_yaxis()
    ax.axvline(0.0, color=color("guide"), linewidth=0.6)
    ax.margins(x=0.25)
    label_axis(ax.xaxis, label_of(table, "energy per period"))
    legend_above(ax)
    return ax
