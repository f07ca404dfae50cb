"""`mems-impact soft-landing`: pulse-and-hold voltages that close a contact at the least speed."""

from __future__ import annotations

from collections.abc import Callable

import click

from mems_impact.cli.arguments import Command, function_options
from mems_impact.cli.closing import show_closing
from mems_impact.cli.inputs import arguments_for
from mems_impact.cli.options import (
    KEY,
    actuator_from,
    device_options,
    drive_choice,
    drive_from,
    output_options,
    pulse_and_hold_options,
)
from mems_impact.cli.output import Output, OutputValue, show, show_values
from mems_impact.cli.runtime import FAILED, write_message

KIND = "pulse-and-hold"  # the drive

FUNCTION = "mems_impact.actuator.design.soft_landing:soft_landing"


@click.command(
    "soft-landing", cls=Command, short_help="Find the voltage that closes a contact softly."
)
@device_options
@function_options(FUNCTION)
@pulse_and_hold_options
@output_options
@click.pass_context
def command(
    ctx: click.Context, *, device: str, changes: dict[str, float], output: Callable[[str], Output]
) -> None:
    """Find pulse and pause that close the contact of DEVICE at the least impact speed.

    \b
    Example:
      mems-impact soft-landing abdulrahim2016

    Without options of the voltage, pulse and hold have 1.2 times the pull-in voltage. Otherwise
    --amplitude, --width and --hold are required, and those that --over does not vary are kept. The
    command writes the search as a CSV table, and displacement, voltage and contact as a figure. The
    exit status is 1 if the search ends before an optimum.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi

    actuator = actuator_from(device, changes)
    drive_options = ctx.meta.get(KEY, {})
    arguments = arguments_for(FUNCTION)
    low = {name: bounds[0] for name, bounds in arguments.get("over", {}).items()}
    drive = drive_from(low, default_kind=KIND) if any(drive_options.values()) else None
    if drive is not None and not isinstance(drive, mi.PulseAndHold):
        chosen = drive_choice(KIND)
        if chosen == device:
            problem = f"has a table [drive] of another kind; add --drive {KIND}"
            raise click.UsageError(f"{device} {problem}")
        raise click.UsageError(f"--drive {chosen}: must be {KIND}, or a file with one")
    with output("soft-landing") as files:
        result = mi.soft_landing(actuator, drive, **arguments)
        files.tables({"history": result.history, "impacts": result.closing.table})
        files.draw(lambda: mi.plot_closing(result)[0].figure)
        values = {
            name: OutputValue(
                result.drive.number(name), result.closing.run.system.units.get(name, "")
            )
            for name in result.drive.names
        }
        values["largest impact speed"] = OutputValue(result.speed, "m/s", result.bound)
        values["largest impact speed under a step"] = OutputValue(result.step_speed, "m/s")
        values["ended"] = OutputValue(result.ended)
        show_values(values, in_units=result.si)
        show("\nClosing:")
        show_closing(result.closing)
        files.show()
    if not result.converged:
        write_message(f"no optimum reached: {result.ended}")
        ctx.exit(FAILED)
