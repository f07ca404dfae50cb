"""`mems-impact drive`: voltage and electrostatic force over a forcing period."""

from __future__ import annotations

import math
from collections.abc import Callable

import click

from mems_impact.cli.options import (
    actuator_from,
    device_options,
    drive_from,
    drive_options,
    output_options,
)
from mems_impact.cli.output import Output, OutputValue, show, show_values


@click.command(short_help="Show voltage and force over a forcing period.")
@device_options
@drive_options
@output_options
def command(*, device: str, changes: dict[str, float], output: Callable[[str], Output]) -> None:
    """Show forcing period, switching times and electrostatic force of a voltage on DEVICE.

    \b
    Example:
      mems-impact drive zhao2004 --drive square --amplitude 0.3 --omega 0.5 \\
        --duty 0.3

    The figure shows voltage and force at x2 = 0 over one forcing period.
    """  # noqa: D301 - click looks for the backspace itself
    from mems_impact.actuator.plots.drive import forcing_period_of, plot_drive

    actuator = actuator_from(device, changes)
    drive = drive_from()
    forces = [force for stretch in forcing_period_of(drive, actuator) for force in stretch.force]
    switches = actuator.under(drive).source.switches
    times = ", ".join(f"{time:.9g}" for time in switches[:8])
    more = f" and {len(switches) - 8} more" if len(switches) > 8 else ""
    ends = min(forces), max(forces)
    lines = {
        "drive": OutputValue(type(drive).__name__),
        "forcing period": OutputValue(drive.period, "s"),
        "angular frequency": OutputValue(2.0 * math.pi / drive.period, "rad/s"),
        "switches": OutputValue(switches, "s", f"{times}{more}" if times else "none"),
        "force at x2 = 0": OutputValue(ends, "N", f"{ends[0]:.9g} to {ends[1]:.9g}"),
    }
    with output("drive") as files:
        files.draw(lambda: plot_drive(drive, actuator)[0].figure)
        show_values(lines, in_units=actuator.scales.named)
        show("")
        files.show()
