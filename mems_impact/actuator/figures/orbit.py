"""One periodic orbit in the phase plane of the block."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mems_impact.actuator.modes import slips
from mems_impact.plotting.labels import label_axis, label_of, symbol
from mems_impact.plotting.motion import jump
from mems_impact.plotting.orbit import PER_PERIOD
from mems_impact.plotting.placing import legend_above
from mems_impact.plotting.style import DASHES, color, new_figure, styled, thickness

if TYPE_CHECKING:
    from mems_impact.actuator.results import ActuatorOrbit

__all__ = ["plot_orbit"]


@styled
def plot_orbit(orbit: ActuatorOrbit, ax: Any = None) -> Any:
    """Draw v2 over x2 along a periodic orbit, with stoppers, impacts and slips.

    Parameters
    ----------
    orbit : ActuatorOrbit
    ax : matplotlib Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.
    """
    if ax is None:
        ax = new_figure(1.2).subplots()
    table = orbit.samples(PER_PERIOD)
    x, v = "x2", "v2"
    stuck = ~table["mode"].astype(str).map(slips)
    free, slipping = table[v].where(stuck), table[v].where(~stuck)
    # At an impact the velocity jumps: the line is broken there.
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
    for place, (_, hit) in enumerate(hits.iterrows()):
        side = delta if hit["stopper"] == "right" else -delta
        ends = [hit["v2 before"], hit["v2 after"]]
        ax.plot([side, side], ends, marker="o", label=None if place else "impact", **jump())
    for name, axis in ((x, ax.xaxis), (v, ax.yaxis)):
        label_axis(axis, label_of(table, name, symbol(name)))
    legend_above(ax)
    return ax
