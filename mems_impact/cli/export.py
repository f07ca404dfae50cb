"""`mems-impact export`: a device or system as a model of another tool."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import click
from click.core import ParameterSource

from mems_impact.cli.arguments import Command, function_options
from mems_impact.cli.inputs import arguments_for, load_subject
from mems_impact.cli.options import actuator_from, device_options, drive_options
from mems_impact.cli.output import add_json_files, show

FMU = "mems_impact.systems.base:HybridSystem.to_fmu"
VERILOG_A = "mems_impact.actuator.actuator:Actuator.to_verilog_a"


class Format(NamedTuple):
    """A format: its name, a function of DEVICE, ``--set`` and FILE, and the options of it alone.

    `driven` formats take a drive and a state.
    """

    name: str
    write: Callable[[str, dict[str, float], str], object]
    options: tuple[str, ...]
    driven: bool


def _write_fmu(device: str, changes: dict[str, float], file: str) -> None:
    system = load_subject(device, changes)
    system.to_fmu(file, **arguments_for(FMU, system))


def _write_verilog_a(device: str, changes: dict[str, float], file: str) -> None:
    actuator_from(device, changes).to_verilog_a(file, **arguments_for(VERILOG_A))


FORMATS = {
    ".fmu": Format("a functional mock-up unit", _write_fmu, ("fmi", "input"), driven=True),
    ".va": Format("a Verilog-A module", _write_verilog_a, ("electrodes",), driven=False),
}
"""Formats by the extension of the file."""


def _refuse_options(ctx: click.Context, file: str, chosen: Format) -> None:
    """Refuse options of other formats."""
    allowed = {"device", "changes", "file", *chosen.options}
    others = {name for each in FORMATS.values() for name in each.options}
    for option in ctx.command.get_params(ctx):
        name = option.name or ""
        from_command_line = ctx.get_parameter_source(name) is ParameterSource.COMMANDLINE
        if from_command_line and name not in allowed and (name in others or not chosen.driven):
            raise click.UsageError(f"{file}: {chosen.name} takes no {option.opts[0]}")


@click.command(cls=Command, short_help="Export a device as an FMU or in Verilog-A.")
@device_options
@click.argument("file", type=click.Path(dir_okay=False))
@function_options(FMU, omit=("path", "options"))
@function_options(VERILOG_A, omit=("path",))
@drive_options
@click.pass_context
def command(ctx: click.Context, /, *, device: str, changes: dict[str, float], file: str) -> None:
    """Write DEVICE under a voltage to FILE, whose extension determines the format.

    \b
    Examples:
      mems-impact export zhao2004 dev.fmu --amplitude 0.24 --omega 0.5
      mems-impact export mita2003 dev.va --set compliant_stopper.stiffness=500 \\
          --set regularized_friction.width=1e-5

    dev.fmu is a functional mock-up unit for model exchange and co-simulation, with C sources and,
    if a C compiler is available, a binary for this platform. A system of your own can replace
    DEVICE: FILE.py:NAME. dev.va is a Verilog-A module, for circuit simulators, of a device in SI
    with the terms compliant_stopper and regularized_friction.
    """  # noqa: D301 - click looks for the backspace itself
    suffix = Path(file).suffix.lower()
    if suffix not in FORMATS:
        formats = ", ".join(f"{name} ({each.name})" for name, each in FORMATS.items())
        raise click.UsageError(f"{file}: no format has the extension {suffix!r}; known: {formats}")
    _refuse_options(ctx, file, FORMATS[suffix])
    FORMATS[suffix].write(device, changes, file)
    add_json_files([file])
    show(f"written: {file}, {FORMATS[suffix].name}")
