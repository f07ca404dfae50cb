"""One periodic orbit in the phase plane of the block."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

from mems_impact.errors import InvalidParameter
from mems_impact.plotting.style import BLUE, GREEN, GREY, ORANGE, new_figure, tidy
from mems_impact.tables.common import heading

if TYPE_CHECKING:
    import pandas as pd

    from mems_impact.actuator.parameters import Actuator

__all__ = ["plot_orbit"]

PER_PERIOD = 1000


class Closed(Protocol):
    """What `plot_orbit` needs of a `mems_impact.analysis.orbit.Orbit`."""

    @property
    def actuator(self) -> Actuator:
        """Owner of the stoppers."""

    @property
    def impacts(self) -> pd.DataFrame:
        """One row an impact."""

    def samples(self, per_period: int) -> pd.DataFrame:
        """Return the state at equal intervals."""


def plot_orbit(orbit: Closed, ax: Any = None) -> Any:
    """Draw v2 over x2 along a periodic orbit, with stoppers, impacts and slips.

    Parameters
    ----------
    orbit : Orbit
    ax : matplotlib Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.
    """
    if not hasattr(orbit, "samples"):
        allowed = "an Orbit, as mems_impact.find_orbit returns it"
        raise InvalidParameter("orbit", type(orbit).__name__, allowed)
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
    ax.set_xlabel("$x_2$" + heading(table, x)[2:])
    ax.set_ylabel("$v_2$" + heading(table, v)[2:])
    ax.legend(frameon=False, loc="upper center", bbox_to_anchor=(0.5, 1.1), ncols=3)
    tidy(ax)
    return ax
