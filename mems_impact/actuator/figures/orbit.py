"""One periodic orbit in the phase plane of the block."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mems_impact.plotting.orbit import PER_PERIOD
from mems_impact.plotting.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    new_figure,
    symbol,
    tidy,
    with_unit,
)

if TYPE_CHECKING:
    from mems_impact.actuator.results import ActuatorOrbit

__all__ = ["plot_orbit"]


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
        ax = new_figure(5.2, 4.4).subplots()
    table = orbit.samples(PER_PERIOD)
    x, v = "x2", "v2"
    stuck = table["mode"].astype(str).str.startswith("stuck")
    free, slips = table[v].where(stuck), table[v].where(~stuck)
    # At an impact the velocity jumps: the line is broken there.
    jumps = (table[x].diff().abs() < 1e-9) | (table[v].diff().abs() > 0.2 * table[v].abs().max())
    ax.plot(table[x], free.mask(jumps), color=BLUE, linewidth=1.5, label="frame stuck")
    if (~stuck).any():
        ax.plot(table[x], slips, color=GREEN, linewidth=2.4, label="frame slips")
    delta = orbit.actuator.delta
    for stopper in (-delta, delta):
        ax.axvline(stopper, color=GREY, linewidth=1.0, linestyle=(0, (4, 3)), zorder=1)
    hits = orbit.impacts
    for place, (_, hit) in enumerate(hits.iterrows()):
        side = delta if hit["stopper"] == "right" else -delta
        jump = [hit["v2 before"], hit["v2 after"]]
        ax.plot(
            [side, side], jump, color=ORANGE, linewidth=1.2, linestyle=(0, (2, 1)), marker="o",
            markersize=3.5, label=None if place else "impact", zorder=3,
        )  # fmt: skip
    ax.set_xlabel(with_unit(symbol(x), table, x))
    ax.set_ylabel(with_unit(symbol(v), table, v))
    ax.legend(frameon=False, loc="upper center", bbox_to_anchor=(0.5, 1.1), ncols=3)
    tidy(ax)
    return ax
