"""A command."""

import click

from mems_impact.cli.showing import Told, show_values


@click.command(short_help="Greet.")
def command():
    """Greet."""
    show_values({"greeting": Told("hello")})
