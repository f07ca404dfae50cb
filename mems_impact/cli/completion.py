"""`mems-impact completion`: what a shell needs to complete commands and options."""

from __future__ import annotations

import click

from mems_impact.cli.runtime import PROGRAM

SHELLS = ("bash", "zsh", "fish")


@click.command(short_help="Show the script that lets a shell complete words.")
@click.argument("shell", type=click.Choice(SHELLS))
@click.pass_context
def command(ctx: click.Context, *, shell: str) -> None:
    """Show the script by which a shell completes commands, options and names of devices.

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
