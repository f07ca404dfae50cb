"""`mems-impact devices`: the presets that come with the package."""

from __future__ import annotations

import click


@click.command(short_help="List the devices of the package.")
def command() -> None:
    """List the devices that come with the package, and their parameters."""
    from mems_impact.actuator.parameters import load_actuator, preset_names

    for name in preset_names():
        values = ", ".join(f"{key} = {value:g}" for key, value in load_actuator(name))
        click.echo(f"{name}: {values}")
