"""The command line: one file a command, each loaded when it is asked for.

Nothing at module level here or in a command's file imports a numerical library, so that ``--help``
answers at once; a command imports what it needs when it runs.
"""

from __future__ import annotations

import atexit
import gc
import signal
import sys
from collections.abc import Sequence
from importlib import import_module
from keyword import iskeyword
from typing import Any, NoReturn

import click

from mems_impact.cli.output import finish
from mems_impact.cli.runtime import (
    INTERRUPTED,
    PROGRAM,
    TERMINATED,
    interruptible,
    past_click,
    report,
    show_warnings_briefly,
    with_options,
)

__all__ = ["main"]

COMMAND_NAMES = (
    "basins",
    "chart",
    "completion",
    "continue",
    "devices",
    "docs",
    "drive",
    "explore",
    "fit",
    "map",
    "new",
    "optimize",
    "orbit",
    "pull-in",
    "sensitivity",
    "show",
    "simulate",
    "sweep",
    "terms",
    "tolerances",
)


class _Commands(click.Group):
    """A group whose commands are the modules of this package."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        from mems_impact._util import plugins

        return list(plugins.names(plugins.COMMAND_GROUP, COMMAND_NAMES))

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in COMMAND_NAMES:
            return _added(name)
        module = f"{name}_" if iskeyword(name) else name.replace("-", "_")
        command: click.Command = import_module(f"mems_impact.cli.{module}").command
        return with_options(command)

    def make_context(self, *arguments: Any, **more: Any) -> click.Context:
        with past_click():  # help pages are written here
            return super().make_context(*arguments, **more)

    def invoke(self, ctx: click.Context) -> Any:
        with past_click():
            try:
                result = super().invoke(ctx)
            except click.exceptions.Exit:  # a verdict that is not the one wanted
                finish(ctx)
                raise
            finish(ctx)
            return result


def _added(name: str) -> click.Command | None:
    """Return the command of that name of another package, if there is one."""
    from mems_impact._util import plugins

    def is_command(found: Any) -> bool:
        return isinstance(found, click.Command)

    found = plugins.plugin(plugins.COMMAND_GROUP, name, is_command, "a command of click")
    return None if found is None else with_options(found)


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
def main_group() -> None:
    """Simulate impact microactuators: frames that walk by the blows of a block inside them.

    A DEVICE is the name of a preset ("mems-impact devices" lists them) or the path of a TOML file.
    Numbers are in the units of the device: SI, in the units that help pages give in brackets, or
    dimensionless. Durations are counted in forcing periods.
    """


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit.

    Parameters
    ----------
    arguments : sequence of str, optional
        By default those of the process.

    Notes
    -----
    Exit statuses: 0, done; 1, the run could not go on, its verdict is not the one wanted, or the
    disk or standard output is full; 2, bad input; 130 and 143, interrupted by Ctrl-C or SIGTERM;
    141, nobody reads standard output.
    """
    # The interpreter would look through all that is there when it ends: a fifth of a short run.
    atexit.register(gc.freeze)
    show_warnings_briefly()
    with interruptible() as signals:
        try:
            # Outside click's own mode, which would print several lines for a usage error.
            status = main_group.main(arguments, prog_name=PROGRAM, standalone_mode=False)
        except (Exception, KeyboardInterrupt) as error:
            status = report(error)
    if status == INTERRUPTED and signal.SIGTERM in signals:
        status = TERMINATED
    sys.exit(status if isinstance(status, int) else 0)
