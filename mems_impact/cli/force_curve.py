"""`mems-impact force-curve`: mean speed over an opposing load, and the stall force."""

from __future__ import annotations

from collections.abc import Callable

import click

from mems_impact.cli.arguments import Command, function_options
from mems_impact.cli.inputs import (
    arguments_for,
    device_system,
    numbers_of_range,
    run_saving_partial,
)
from mems_impact.cli.options import device_options, drive_options, output_options
from mems_impact.cli.output import Output, OutputValue, show, show_table, show_values
from mems_impact.cli.value_types import RangeType

FUNCTION = "mems_impact.actuator.design.force_curve:force_curve"


@click.command(cls=Command, short_help="Compute the speed over a load, and the stall force.")
@device_options
@click.option(
    "--loads",
    type=RangeType(named=False, points=True),
    show_default="0 to somewhat more than the stall force",
    help="Forces against motion to the right [N].",
)
@function_options(FUNCTION)
@drive_options
@output_options
def command(
    *,
    device: str,
    changes: dict[str, float],
    loads: tuple[float | str, float | str, int] | None,
    output: Callable[[str], Output],
) -> None:
    """Compute the mean speed of DEVICE over an opposing load, and its stall force.

    \b
    Examples:
      mems-impact force-curve mine.toml
      mems-impact force-curve mita2003 --amplitude 100 --frequency 1 \\
        --loads "0:50 uN:6" --transient 4 --periods 4

    The command shows the loads up to which static friction holds the frame without voltage, up to
    which every slip ends, and against which the device walks. It writes a CSV table and a figure.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi

    system = device_system(device, changes)
    arguments = arguments_for(FUNCTION, system)
    if loads is not None:
        arguments["loads"] = numbers_of_range(system.actuator, "loads", loads, "N")
    with output("force-curve") as files:
        curve = run_saving_partial(
            lambda: mi.force_curve(system.actuator, system.drive, **arguments),
            lambda table: files.tables({"table": table}),
        )
        files.tables({"table": curve.table})
        files.draw(lambda: mi.plot_force_curve(curve).figure)
        values = {
            name.replace("_", " "): OutputValue(getattr(curve, name), "N")
            for name in ("holding_force", "sliding_force", "stall_force")
        }
        show_values(values, in_units=bool(system.units))
        show("")
        show_table("loads", curve.table, digits=5)
        files.show()
