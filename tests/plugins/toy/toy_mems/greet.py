"""A command."""

import click

from mems_impact.cli.output import OutputValue, show_values


@click.command(short_help="Greet.")
def command():
    """Greet."""
    show_values({"greeting": OutputValue("hello")})
