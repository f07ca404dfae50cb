"""`mems-impact export`: a device or system as a model of another tool."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import click

from mems_impact.cli.inputs import load_subject
from mems_impact.cli.options import Initial, device_options, drive_options, initial_option
from mems_impact.cli.output import add_json_files, show


class Format(NamedTuple):
    """A format: its name, and a function of DEVICE, ``--set``, FILE and the other options."""

    name: str
    write: Callable[[str, dict[str, float], str, Mapping[str, Any]], object]


def _write_fmu(
    device: str, changes: dict[str, float], file: str, options: Mapping[str, Any]
) -> None:
    system, state = load_subject(device, changes, options["initial"])
    system.to_fmu(file, fmi=options["fmi"], inputs=options["inputs"], initial=state)


FORMATS = {".fmu": Format("a functional mock-up unit", _write_fmu)}
"""Formats by the extension of the file."""


@click.command(short_help="Write a device as a model of another tool.")
@device_options
@click.argument("file", type=click.Path(dir_okay=False))
@drive_options
@initial_option
@click.option(
    "--fmi",
    type=click.Choice(("2.0", "3.0")),
    default="3.0",
    show_default=True,
    help="Version of the FMI standard.",
)
@click.option(
    "--input",
    "inputs",
    multiple=True,
    metavar="NAME",
    help="A parameter that becomes an input of the FMU; of a device also voltage, in place of the "
    "drive. May be repeated.",
)
def command(
    *,
    device: str,
    changes: dict[str, float],
    file: str,
    initial: Initial,
    **options: Any,
) -> None:
    """Write DEVICE under a voltage to FILE, whose extension determines the format.

    \b
    Example:
      mems-impact export zhao2004 dev.fmu --amplitude 0.24 --omega 0.5

    dev.fmu is a functional mock-up unit for model exchange and co-simulation, with C sources and,
    if a C compiler is available, a binary for this platform. A system of your own can replace
    DEVICE: FILE.py:NAME.
    """  # noqa: D301 - click looks for the backspace itself
    suffix = Path(file).suffix.lower()
    if suffix not in FORMATS:
        known = ", ".join(f"{name} ({each.name})" for name, each in FORMATS.items())
        raise click.UsageError(f"{file}: no format has the extension {suffix!r}; known: {known}")
    FORMATS[suffix].write(device, changes, file, {**options, "initial": initial})
    add_json_files([file])
    show(f"written: {file}, {FORMATS[suffix].name}")
