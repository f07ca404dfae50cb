"""`mems-impact drive`: what a device sees of a voltage."""

from __future__ import annotations

import math

import click

from mems_impact.cli.drives import drive_from, drive_options
from mems_impact.cli.failures import show_warnings_briefly
from mems_impact.cli.options import actuator_from, device_options, output_options


@click.command(short_help="Show what a device sees of a voltage.")
@device_options
@drive_options
@output_options
def command(
    *,
    device: str,
    changes: dict[str, float],
    output: str,
    figure: str | None,
    no_figure: bool,
) -> None:
    """Show forcing period, switching times and force of a voltage on DEVICE.

    Draws voltage and force at x2 = 0 over one forcing period.

    \b
    Example:
      mems-impact drive zhao2004 --drive square --amplitude 0.3 --omega 0.5 --duty 0.3
    """  # noqa: D301 - click looks for the backspace itself
    from mems_impact.cli.output import Output
    from mems_impact.plotting.drive import plot_drive, seen

    show_warnings_briefly()
    actuator = actuator_from(device, changes)
    drive = drive_from()
    files = Output(output, figure, no_figure, "drive")
    forces = [force for stretch in seen(drive, actuator) for force in stretch.force]
    shown = ", ".join(f"{time:.9g}" for time in drive.switches[:8])
    more = f" and {len(drive.switches) - 8} more" if len(drive.switches) > 8 else ""
    lines = {
        "drive": str(type(drive).__name__),
        "forcing period": f"{drive.period:.9g}",
        "angular frequency": f"{2.0 * math.pi / drive.period:.9g}",
        "switches": f"{shown}{more}" if shown else "none",
        "force at x2 = 0": f"{min(forces):.9g} to {max(forces):.9g}",
    }
    for name, text in lines.items():
        click.echo(f"  {name:<18}{text}")
    files.draw(lambda: plot_drive(drive, actuator)[0].figure)
    click.echo(f"\n{files.said()}" if files.written else "")
