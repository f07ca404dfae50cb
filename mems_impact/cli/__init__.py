"""The command line: one file a command, each loaded when it is asked for.

Nothing at module level here or in a command's file imports a numerical library, so that ``--help``
answers at once; a command imports what it needs when it runs.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from keyword import iskeyword
from typing import NoReturn

import click

from mems_impact.cli.failures import PROGRAM, report

__all__ = ["main"]

COMMANDS = (
    "chart",
    "continue",
    "devices",
    "drive",
    "fit",
    "orbit",
    "pull-in",
    "simulate",
    "sweep",
    "validate",
)


class _Commands(click.Group):
    """A group whose commands are the modules of this package."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in COMMANDS:
            return None
        module = f"{name}_" if iskeyword(name) else name.replace("-", "_")
        command: click.Command = import_module(f"mems_impact.cli.{module}").command
        return command


def _show_version(ctx: click.Context, _parameter: click.Parameter, asked: bool) -> None:
    if asked:
        from importlib.metadata import version

        click.echo(f"{PROGRAM} {version('mems-impact')}")
        ctx.exit()


@click.command(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_show_version,
    help="Show the version and exit.",
)
def _group() -> None:
    """Simulate impact microactuators: frames that walk by the blows of a block inside them.

    A DEVICE is the name of a preset ("mems-impact devices" lists them) or the path of a TOML file.
    Numbers are in the units of the device; times are counted in forcing periods.
    """


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit.

    Parameters
    ----------
    arguments : sequence of str, optional
        By default those of the process.

    Notes
    -----
    Exit statuses: 0, done; 1, the run could not go on or its verdict is not the one wanted; 2, bad
    input; 130, interrupted.
    """
    try:
        # Outside click's own mode, which would print several lines for a usage error.
        status = _group.main(arguments, prog_name=PROGRAM, standalone_mode=False)
    except (Exception, KeyboardInterrupt) as error:
        sys.exit(report(error))
    sys.exit(status if isinstance(status, int) else 0)
