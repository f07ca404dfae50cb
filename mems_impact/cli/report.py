"""`mems-impact report`: one HTML page on a device, with tables and figures."""

from __future__ import annotations

import shlex
from typing import TYPE_CHECKING, Any

import click

from mems_impact.cli.arguments import Command, function_options
from mems_impact.cli.inputs import arguments_for, numbers_of_range
from mems_impact.cli.options import (
    KEY,
    actuator_from,
    device_options,
    drive_choice,
    drive_from,
    drive_options,
)
from mems_impact.cli.output import OutputValue, add_json_files, add_json_values, show, show_values
from mems_impact.cli.runtime import PROGRAM, warn
from mems_impact.cli.value_types import RangeType

if TYPE_CHECKING:
    import mems_impact as mi

FUNCTION = "mems_impact.actuator.report:report"


@click.command(cls=Command, short_help="Make a report on a device: one HTML page.")
@device_options
@click.option(
    "--output",
    type=click.Path(dir_okay=False),
    default="report.html",
    show_default=True,
    metavar="FILE",
    help="File of the page; it is written after each section.",
)
@function_options(FUNCTION, omit=("path", "description", "command"))
@click.option(
    "--voltages",
    type=RangeType(named=False, points=True),
    show_default="0.4 to 1.3 times the amplitude",
    help="Amplitudes of the curve over the voltage.",
)
@drive_options
@click.pass_context
def command(
    ctx: click.Context,
    /,
    *,
    device: str,
    changes: dict[str, float],
    output: str,
    voltages: tuple[float | str, float | str, int] | None,
) -> None:
    """Make a report on DEVICE under a voltage: one HTML page that can be sent.

    \b
    Examples:
      mems-impact report mine.toml
      mems-impact report mita2003 --amplitude '100 V' --frequency '1 Hz'

    The page holds data sheet, regime, pull-in and release, drive, motion, operating chart, step
    and speed over voltage and frequency, voltage window, load curve, energy, life, tolerances with
    their yield, and corners. Without a drive, here or in the file of DEVICE, the report finds one
    under which the frame walks. A section that cannot be computed says why. Ctrl-C keeps the
    finished sections.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi
    from mems_impact.actuator.device_files import device_text
    from mems_impact.actuator.terms.base import drive_unit

    actuator = actuator_from(device, changes)
    drive = drive_from() if _has_drive() else None
    name, description = device_text(device)
    arguments: dict[str, Any] = {"title": name, "description": description}
    arguments |= arguments_for(FUNCTION, actuator)
    if voltages is not None:
        unit = drive_unit(actuator.terms)
        arguments["voltages"] = numbers_of_range(actuator, "voltages", voltages, unit)
    arguments["command"] = shlex.join([PROGRAM, *(ctx.obj or ())])
    try:
        page = mi.report(actuator, drive, output, **arguments)
    except mi.Interrupted as interruption:
        add_json_files([output])
        interruption.add_note(f"written: {output}")
        raise
    _show(page, output)


def _has_drive() -> bool:
    """Return whether options or the file of the device describe a drive."""
    drive_options = click.get_current_context().meta.get(KEY, {})
    return any(value is not False for value in drive_options.values()) or drive_choice() != "sine"


def _show(page: mi.DeviceReport, output: str) -> None:
    if page.facts:
        show_values({name: OutputValue(text) for name, text in page.facts.items()})
    for section in page.sections:
        if section.problem:
            warn(f"{section.title}: {section.problem}")
    problems = {section.title: OutputValue(section.problem) for section in page.sections}
    add_json_values({name: each for name, each in problems.items() if each.value})
    add_json_files([output])
    show(f"\nwritten: {output}")
