"""What the device sees of a drive: voltage and force over one forcing period."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mems_impact.plotting.style import BLUE, GREEN, GREY, ORANGE, new_figure, tidy

if TYPE_CHECKING:
    from mems_impact.actuator.drive import Drive
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


def plot_drive(
    drive: Drive, actuator: Actuator | None = None, axes: Sequence[Any] | None = None
) -> tuple[Any, Any]:
    """Draw what the device sees: voltage and force at x2 = 0 over one forcing period.

    Parameters
    ----------
    drive : Drive
    actuator : Actuator, optional
        Whose force is drawn; by default the force is in units of alpha/d^2.
    axes : two matplotlib Axes, optional
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
    if axes is None:
        axes = new_figure(7.0, 4.4).subplots(2, sharex=True)
    above, below = axes
    si = actuator is not None and actuator.units == "SI"
    stretches = seen(drive, actuator)
    time, right, left, force = (_joined([s[i] for s in stretches]) for i in range(4))
    two = drive.left_voltage is not None
    above.plot(time, right, color=BLUE, linewidth=1.4, label="right electrode")
    if two:
        above.plot(time, left, color=ORANGE, linewidth=1.4, label="left electrode")
        above.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False)
    below.plot(time, force, color=GREEN, linewidth=1.4)
    for ax in (above, below):
        ax.axhline(0.0, color=GREY, linewidth=0.6, zorder=0)
        if len(drive.switches) <= 64:
            for switch in drive.switches:
                ax.axvline(switch, color=GREY, linewidth=0.6, linestyle=(0, (1, 3)), zorder=0)
        tidy(ax)
    above.set_ylabel("voltage [V]" if si else "voltage")
    unit = r" [$\alpha/d^2$]" if actuator is None else (" [N]" if si else "")
    below.set_ylabel(f"force at $x_2 = 0${unit}")
    below.set_xlabel("time [s]" if si else "time")
    below.set_xlim(0.0, drive.period)
    return above, below


def _joined(parts: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Join stretches with a gap in the line between them, where the voltage may jump."""
    gap = np.array([np.nan])
    return np.concatenate([piece for part in parts for piece in (part, gap)])[:-1]
