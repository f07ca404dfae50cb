"""The commands: one file per command, each loaded on demand.

Neither this module nor a command's file imports a numerical library at module level, so that
``--help`` answers at once; a command imports its libraries when it runs.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib import import_module
from keyword import iskeyword
from pathlib import Path
from typing import Any

import click

from mems_impact.cli.arguments import option_of_field
from mems_impact.cli.output import finish
from mems_impact.cli.runtime import (
    FROM_FILE,
    PROGRAM,
    STORE,
    past_click,
    report_error,
    show_warnings_briefly,
    with_options,
)
from mems_impact.errors import InvalidParameter

COMMAND_NAMES = (
    "basins", "characteristic", "chart", "closing", "completion", "continue", "datasheet",
    "devices", "diagram", "docs", "drive", "explore", "export", "fit", "force-curve", "map", "new",
    "optimize", "orbit", "pull-in", "report", "sensitivity", "show", "simulate", "soft-landing",
    "sweep", "terms", "tolerances",
)  # fmt: skip


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

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name, names = args[0], self.list_commands(ctx)
        if not (name in names or name.startswith("-") or ctx.resilient_parsing):
            from difflib import get_close_matches

            close = " or ".join(get_close_matches(name, names))
            hint = f"; did you mean {close}?" if close else ""
            raise click.UsageError(f"no such command {name!r}{hint}", ctx)
        return super().resolve_command(ctx, args)

    def make_context(self, *arguments: Any, **more: Any) -> click.Context:
        with past_click():  # help pages are written here
            return super().make_context(*arguments, **more)

    def invoke(self, ctx: click.Context) -> Any:
        with past_click():
            try:
                result = super().invoke(ctx)
            except click.exceptions.Exit:  # an unfavourable verdict
                finish(ctx)
                raise
            except KeyboardInterrupt as error:
                store = ctx.meta.get(STORE)
                if store is not None and Path(store).exists():
                    error.add_note(f"the same command resumes from {store}")
                raise
            except InvalidParameter as error:
                command = self.get_command(ctx, ctx.invoked_subcommand or "")
                if command is None or ctx.meta.get(FROM_FILE) or error.source is not None:
                    raise
                raise error.renamed(option_of_field(command, error.field)) from None
            finish(ctx)
            return result


def _added(name: str) -> click.Command | None:
    """Return the command of that name from another package, if one exists."""
    from mems_impact._util import plugins

    def is_command(value: Any) -> bool:
        return isinstance(value, click.Command)

    command = plugins.plugin(plugins.COMMAND_GROUP, name, is_command, "a command of click")
    return None if command is None else with_options(command)


def _show_version(ctx: click.Context, _parameter: click.Parameter, requested: bool) -> None:
    if requested:
        from importlib.metadata import version

        from mems_impact.integrators.jit.cache_directory import cache_directory

        click.echo(f"{PROGRAM} {version('mems-impact')}")
        click.echo(f"compiled code: {cache_directory() or 'not kept, no folder can be written'}")
        ctx.exit()


@click.command(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_show_version,
    help="Show the version and the folder of compiled code, and exit.",
)
def main_group() -> None:
    """Simulate impact microactuators: a block strikes its frame, and the frame walks.

    \b
    Example:
      mems-impact simulate zhao2004 --amplitude 0.24 --omega 0.5

    DEVICE is the name of a preset ("mems-impact devices" lists them) or the path of a TOML file.
    Quantities are in the units of the device: SI, with the units in brackets, or dimensionless; for
    a device in SI they may have another unit, as '0.6 kHz'. Durations are counted in forcing
    periods.
    """  # noqa: D301 - click looks for the backspace itself


def run(arguments: Sequence[str] | None) -> Any:
    """Run the command line and return the exit status; see `mems_impact.cli.main`."""
    show_warnings_briefly()
    try:
        # Outside click's own mode, which would print several lines for a usage error.
        argv = tuple(sys.argv[1:] if arguments is None else arguments)
        return main_group.main(argv, prog_name=PROGRAM, standalone_mode=False, obj=argv)
    except (Exception, KeyboardInterrupt) as error:
        return report_error(error)
