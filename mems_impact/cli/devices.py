"""`mems-impact devices`: the presets that come with the package."""

from __future__ import annotations

import click


@click.command(short_help="List the devices of the package.")
def command() -> None:
    """List the devices that come with the package, their parameters and their terms."""
    from mems_impact.actuator.parameters import (
        PARAMETER_NAMES,
        PARAMETER_UNITS,
        load_actuator,
        preset_names,
    )

    for name in preset_names():
        actuator = load_actuator(name)
        units = PARAMETER_UNITS if actuator.units == "SI" else {}
        values = [
            f"{key} = {getattr(actuator, key):g} {units.get(key, '')}".rstrip()
            for key in PARAMETER_NAMES
        ]
        for term in actuator.terms:
            of_term = dict(term.units) if units else {}
            values += [
                f"{term.name()}.{key} = {value} {of_term.get(key, '')}".rstrip()
                for key, value in dict(term).items()
            ]
        click.echo(f"{name}: {', '.join(values)}")
