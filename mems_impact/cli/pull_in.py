"""`mems-impact pull-in`: at which voltages a device is pulled in and lets go."""

from __future__ import annotations

import math

import click

from mems_impact.cli.options import actuator_from, device_options
from mems_impact.cli.output import OutputValue, show_values


@click.command("pull-in", short_help="Show the voltages at which a device pulls in and lets go.")
@device_options
def command(*, device: str, changes: dict[str, float]) -> None:
    """Show pull-in voltage, resting voltage and resonance of DEVICE, from its parameters alone.

    Pulled by a slowly rising voltage, the block snaps to the right stopper at the pull-in voltage;
    above the resting voltage it stays there. The resonance is that of the block in a frame that is
    held.

    \b
    Example:
      mems-impact pull-in mita2003
    """  # noqa: D301 - click looks for the backspace itself
    from mems_impact.actuator.design.fit import of_device

    actuator = actuator_from(device, changes)
    named = actuator.scales.named
    told = {name: OutputValue(*quantity) for name, quantity in of_device(actuator).items()}
    if named:
        told["resonance frequency"] = OutputValue(told["resonance"].value / (2.0 * math.pi), "Hz")
    show_values(told, named=named)
