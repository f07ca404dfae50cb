"""Voltage and force of a drive."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mems_impact.plotting.labels import Label, label_axis, legend_above, letter_panels
from mems_impact.plotting.style import LINES, Axes, color, new_figure, styled, thickness

if TYPE_CHECKING:
    from mems_impact.actuator.actuator import Actuator
    from mems_impact.actuator.drives.base import Drive
    from mems_impact.actuator.system import ActuatorSystem


SAMPLES_PER_WAVEFORM = 2000
MIN_SAMPLES_BETWEEN_SWITCHES = 16


class Excerpt(NamedTuple):
    """A drive between two of its switches."""

    time: NDArray[np.float64]
    right: NDArray[np.float64]
    left: NDArray[np.float64]
    force: NDArray[np.float64]


def forcing_period_of(drive: Drive, actuator: Actuator | None = None) -> list[Excerpt]:
    """Return one forcing period of a drive, divided at its switches.

    The force is that on the block at x2 = 0, alpha (right^2 - left^2)/d^2 for parallel plates;
    without an actuator it is in units of alpha/d^2. With an actuator, the voltages are those of the
    source, and terms that depend on the sign of the voltage are omitted.
    """
    system = None if actuator is None else _unsigned(actuator, drive)
    source = drive if system is None else system.source
    borders = sorted({0.0, *drive.switches, *source.switches, drive.period})
    stretches = []
    for begin, end in pairwise(borders):
        count = max(
            MIN_SAMPLES_BETWEEN_SWITCHES, round(SAMPLES_PER_WAVEFORM * (end - begin) / drive.period)
        )
        time = np.linspace(begin, np.nextafter(end, 0.0), count)
        right, left = (source.value(time, channel=side) for side in ("right", "left"))
        force = right**2 - left**2 if system is None else system.resting_pull(right, left)
        stretches.append(Excerpt(time, right, left, force))
    return stretches


def _unsigned(actuator: Actuator, drive: Drive) -> ActuatorSystem:
    """Return the device under the drive, without terms that depend on the sign of the voltage."""
    from mems_impact.actuator.system import ActuatorSystem

    signed = [term.name() for term in actuator.terms if term.signed]
    return ActuatorSystem(actuator.without(*signed) if signed else actuator, drive)


@styled
def plot_drive(drive: Drive, actuator: Actuator | None = None, ax: Any = None) -> tuple[Axes, Axes]:
    """Draw voltage and force at x2 = 0 over one forcing period.

    Parameters
    ----------
    drive : Drive
    actuator : Actuator, optional
        The actuator for the force; by default the force is in units of alpha/d^2.
    ax : two matplotlib Axes, optional
        Axes for voltage and force; a new figure by default.

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
    if ax is None:
        ax = new_figure(1.2).subplots(2, sharex=True)
        letter_panels(ax)
    above, below = ax
    si = actuator is not None and actuator.units == "SI"
    stretches = forcing_period_of(drive, actuator)
    time, right, left, force = (_joined([s[i] for s in stretches]) for i in range(4))
    two, line_color = drive.left_voltage is not None, color("voltage")
    system = None if actuator is None else _unsigned(actuator, drive)
    limited = system is not None and system.source is not drive
    if limited:
        for i, side in enumerate(drive.sides):
            values = _joined([drive.value(s.time, channel=side) for s in stretches])
            above.plot(time, values, color=color("guide"), linestyle=LINES[i],
                       linewidth=thickness(0.8), label=None if i else "drive")  # fmt: skip
    clamped = drive.clamp_voltage is not None
    above.plot(time, right, color=line_color, label="right electrode" if two else "source")
    if two:
        above.plot(time, left, color=line_color, linestyle=LINES[1], label="left electrode")
    if clamped:
        values = _joined([drive.value(s.time, channel="clamp") for s in stretches])
        above.plot(time, values, color=line_color, linestyle=LINES[2], label="clamp")
    if two or clamped or limited:
        legend_above(above)
    below.plot(time, force, color="black")
    guide = {"color": color("guide"), "linewidth": 0.5, "zorder": 0}
    for panel in (above, below):
        panel.axhline(0.0, **guide)
        if len(drive.switches) <= 64:
            for switch in drive.switches:
                panel.axvline(switch, linestyle=(0, (1, 3)), **guide)
    below.set_xlim(0.0, drive.period)
    charge = system is not None and system.drive_unit == "C"
    volt, newton, second = ("C" if charge else "V", "N", "s") if si else ("", "", "")
    label_axis(above.yaxis, Label("charge" if charge else "voltage", volt))
    unit = r"$\alpha/d^2$" if actuator is None else newton
    label_axis(below.yaxis, Label("force at $x_2 = 0$", unit))
    label_axis(below.xaxis, Label("time", second))
    return above, below


def _joined(pieces: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    """Join excerpts with a gap in the line between them, where the voltage may jump."""
    gap = np.array([np.nan])
    return np.concatenate([piece for part in pieces for piece in (part, gap)])[:-1]
