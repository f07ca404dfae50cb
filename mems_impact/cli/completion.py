"""`mems-impact completion`: the shell script that completes commands and options."""

from __future__ import annotations

import click

from mems_impact.cli.runtime import PROGRAM

SHELLS = ("bash", "zsh", "fish")


@click.command(short_help="Print the script for shell completion.")
@click.argument("shell", type=click.Choice(SHELLS))
@click.pass_context
def command(ctx: click.Context, *, shell: str) -> None:
    """Print the script by which a shell completes commands, options and device names.

    \b
    Example:
      mems-impact completion bash

    \b
    In ~/.bashrc:                  eval "$(mems-impact completion bash)"
    In ~/.zshrc:                   eval "$(mems-impact completion zsh)"
    In ~/.config/fish/config.fish: mems-impact completion fish | source
    """  # noqa: D301 - click looks for the backspace itself
    from click.shell_completion import get_completion_class

    kind = get_completion_class(shell)
    assert kind is not None
    variable = f"_{PROGRAM}_COMPLETE".replace("-", "_").upper()  # click's own
    maker = kind(ctx.find_root().command, {}, PROGRAM, variable)
    # Not `source`, which asks bash for its version.
    click.echo(maker.source_template % maker.source_vars())
