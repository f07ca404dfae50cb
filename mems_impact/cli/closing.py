"""`mems-impact closing`: closing of a contact under a voltage step."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import click

from mems_impact.cli.arguments import Command, function_options
from mems_impact.cli.inputs import arguments_for
from mems_impact.cli.options import (
    actuator_from,
    device_options,
    drive_from,
    output_options,
    step_options,
)
from mems_impact.cli.output import Output, OutputValue, show, show_table, show_values
from mems_impact.cli.runtime import FAILED, write_message

if TYPE_CHECKING:
    import mems_impact as mi

FIRST_ROWS = 6

FUNCTION = "mems_impact.actuator.design.closing:closing"


@click.command(cls=Command, short_help="Compute closing time and bounces of a contact.")
@device_options
@function_options(FUNCTION)
@step_options
@output_options
@click.pass_context
def command(
    ctx: click.Context, *, device: str, changes: dict[str, float], output: Callable[[str], Output]
) -> None:
    """Compute closing time, bounces, impact speeds and settling of the contact of DEVICE.

    \b
    Example:
      mems-impact closing abdulrahim2016 --amplitude 90

    The voltage is switched on at t = 0, by default as a step. The command writes the impacts as a
    CSV table, and displacement, voltage and contact as a figure. The exit status is 1 if the
    contact does not close within the run.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi

    actuator = actuator_from(device, changes)
    drive = drive_from(default_kind="voltage-step")
    arguments = arguments_for(FUNCTION, actuator)
    with output("closing") as files:
        closing = mi.closing(actuator, drive, **arguments)
        files.tables({"impacts": closing.table})
        files.draw(lambda: mi.plot_closing(closing)[0].figure)
        show_closing(closing)
        files.show()
    if math.isnan(closing.closing_time):
        other = "" if isinstance(drive, mi.VoltageStep) else ", or give --drive voltage-step"
        other += "" if arguments.get("duration") is None else ", or lengthen --duration"
        remedy = f"raise the voltage (see mems-impact pull-in){other}"
        length = f"{closing.run.end:.4g} {closing.run.system.units.get('time', '')}".rstrip()
        write_message(f"the contact does not close within {length}; {remedy}")
        ctx.exit(FAILED)


def show_closing(closing: mi.Closing) -> None:
    """Show a closing and its first impacts."""
    names = ("stopper", "closing_time", "impact_speed", "bounces", "settling_time")
    known = closing.summary()
    values = {
        name.replace("_", " "): OutputValue(
            getattr(closing, name),
            closing._si_unit(name),
            # Known digits; --json has all digits.
            f"{known[name]:.6g}" if isinstance(known[name], float) else known[name],
        )
        for name in names
    }
    values["energy input"] = OutputValue(closing.energy.input, "J")
    values["energy lost"] = OutputValue(closing.energy.lost, "J")
    show_values(values, in_units=closing.si)
    if len(closing.table):
        show("\nFirst impacts:")
        show_table("impacts", closing.table.head(FIRST_ROWS), digits=6)
