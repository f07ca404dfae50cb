"""`mems-impact new`: a commented template of a device or a system."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

import click

from mems_impact.cli.output import add_json_files, show
from mems_impact.cli.runtime import PROGRAM

TEMPLATES = {
    "device": ("device.toml", "simulate {}"),
    "system": ("system.py", "simulate {}:oscillator"),
}
"""By kind: template, which is the default name of the file, and a first command for it."""


@click.command(short_help="Write a template of a device or a system.")
@click.argument("kind", type=click.Choice(list(TEMPLATES)))
@click.argument("file", type=click.Path(), required=False)
def command(*, kind: str, file: str | None) -> None:
    """Write a commented template FILE: a device (TOML) or a system (Python).

    \b
    Examples:
      mems-impact new device mine.toml
      mems-impact simulate mine.toml

    FILE is device.toml or system.py by default. An existing file is never overwritten. The template
    runs as it stands.
    """  # noqa: D301 - click looks for the backspace itself
    template, first = TEMPLATES[kind]
    path = Path(file or template)
    ending = Path(template).suffix
    if path.suffix != ending:
        raise click.UsageError(f"{path}: the name must end in {ending}")
    text = (files("mems_impact.cli") / "templates" / template).read_text("utf-8")
    text = text.replace("FILE", str(path))
    try:
        with open(path, "x", encoding="utf-8") as new:
            new.write(text)
    except FileExistsError:
        raise click.ClickException(f"{path}: already exists; choose another name") from None
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise click.ClickException(f"{path}: cannot be written ({reason})") from None
    add_json_files([path])
    show(f"written: {path}; try it: {PROGRAM} {first.format(path)}")
