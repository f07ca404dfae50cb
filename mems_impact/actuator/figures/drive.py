"""What the device sees of a drive: voltage and force over one forcing period."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mems_impact.plotting.labels import Label, label_axis
from mems_impact.plotting.placing import legend_above
from mems_impact.plotting.style import LINES, color, new_figure, styled

if TYPE_CHECKING:
    from mems_impact.actuator.drives import Drive
    from mems_impact.actuator.parameters import Actuator

__all__ = ["Excerpt", "plot_drive", "seen"]

POINTS = 2000  # over a period
FEWEST = 16  # between two switches


class Excerpt(NamedTuple):
    """A drive between two of its switches."""

    time: NDArray[np.float64]
    right: NDArray[np.float64]
    left: NDArray[np.float64]
    force: NDArray[np.float64]


def seen(drive: Drive, actuator: Actuator | None = None) -> list[Excerpt]:
    """Return one forcing period of a drive, cut at its switches.

    The force is that on the block at x2 = 0, alpha (right^2 - left^2)/d^2; without an actuator,
    that divided by alpha/d^2.
    """
    scale = 1.0 if actuator is None else actuator.alpha / actuator.d**2
    borders = sorted({0.0, *drive.switches, drive.period})
    stretches = []
    for begin, end in pairwise(borders):
        count = max(FEWEST, round(POINTS * (end - begin) / drive.period))
        time = np.linspace(begin, np.nextafter(end, 0.0), count)
        right, left = drive.value(time), drive.value(time, left=True)
        stretches.append(Excerpt(time, right, left, scale * (right**2 - left**2)))
    return stretches


@styled
def plot_drive(drive: Drive, actuator: Actuator | None = None, ax: Any = None) -> tuple[Any, Any]:
    """Draw what the device sees: voltage and force at x2 = 0 over one forcing period.

    Parameters
    ----------
    drive : Drive
    actuator : Actuator, optional
        Whose force is drawn; by default the force is in units of alpha/d^2.
    ax : two matplotlib Axes, optional
        Where to draw voltage and force; a new figure by default.

    Returns
    -------
    tuple of Axes
        For voltage and force.

    See Also
    --------
    Drive, plot_run

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> voltage, force = mi.plot_drive(drive, actuator)
    >>> voltage.figure.savefig("drive.png")
    """
    above, below = new_figure(1.2).subplots(2, sharex=True) if ax is None else ax
    si = actuator is not None and actuator.units == "SI"
    stretches = seen(drive, actuator)
    time, right, left, force = (_joined([s[i] for s in stretches]) for i in range(4))
    two = drive.left_voltage is not None
    own = color("voltage")
    above.plot(time, right, color=own, label="right electrode")
    if two:
        above.plot(time, left, color=own, linestyle=LINES[1], label="left electrode")
        legend_above(above)
    below.plot(time, force, color="black")
    guide = {"color": color("guide"), "linewidth": 0.5, "zorder": 0}
    for panel in (above, below):
        panel.axhline(0.0, **guide)
        if len(drive.switches) <= 64:
            for switch in drive.switches:
                panel.axvline(switch, linestyle=(0, (1, 3)), **guide)
    below.set_xlim(0.0, drive.period)
    volt, newton, second = ("V", "N", "s") if si else ("", "", "")
    label_axis(above.yaxis, Label("voltage", volt))
    unit = r"$\alpha/d^2$" if actuator is None else newton
    label_axis(below.yaxis, Label("force at $x_2 = 0$", unit))
    label_axis(below.xaxis, Label("time", second))
    return above, below


def _joined(parts: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Join stretches with a gap in the line between them, where the voltage may jump."""
    gap = np.array([np.nan])
    return np.concatenate([piece for part in parts for piece in (part, gap)])[:-1]
