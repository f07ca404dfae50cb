"""`mems-impact characteristic`: step, speed, energy and wear over a parameter."""

from __future__ import annotations

from collections.abc import Callable

import click

from mems_impact.cli.arguments import Command, function_options, given_arguments
from mems_impact.cli.inputs import arguments_for, device_system, run_saving_partial, values_of_axis
from mems_impact.cli.options import device_options, drive_options, output_options
from mems_impact.cli.output import Output, show_table
from mems_impact.cli.value_types import RangeType, symbol_of

FUNCTION = "mems_impact.actuator.design.characteristic:characteristic"
# The screen leaves out the other columns.
SHOWN_COLUMNS = (
    "direction", "blows per period", "displacement per blow", "mean speed", "energy in per blow",
    "life", "stall force",
)  # fmt: skip


@click.command(cls=Command, short_help="Tabulate step, speed, energy and wear over a parameter.")
@device_options
@click.argument("axis", metavar="NAME=START:STOP:POINTS", type=RangeType(points=True))
@function_options(FUNCTION, omit=("parameter",))
@drive_options
@output_options
def command(
    *,
    device: str,
    changes: dict[str, float],
    axis: tuple[str, float, float, int],
    output: Callable[[str], Output],
) -> None:
    """Tabulate the working points of DEVICE over a voltage, a frequency or another parameter.

    \b
    Examples:
      mems-impact characteristic mine.toml amplitude=40:60:9
      mems-impact characteristic mine.toml "frequency=5 kHz:6 kHz:11" \\
        --curves "amplitude=40 V:50 V:3" --stall

    Every working point is in the steady state: step per blow, mean speed and its error, energy per
    blow and power, slip path; with wear rate, area and depth the life, with --stall the stall
    force. The command writes a CSV table, the range of values with impacts, and a figure.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi

    name, *ends = axis
    parameter = symbol_of(name)
    family = given_arguments(FUNCTION, complete=False).get("curves")
    varied = {} if family is None else {symbol_of(family[0]): family[1]}
    system = device_system(device, changes, {**varied, parameter: ends[0]})
    values = values_of_axis(system, parameter, ends)
    arguments = arguments_for(FUNCTION, system)
    with output("characteristic") as files:
        found = run_saving_partial(
            lambda: mi.characteristic(
                system.actuator, system.drive, parameter, values, **arguments
            ),
            lambda table: files.tables({"table": table}),
        )
        files.tables({"table": found.table, "impacts": found.impact_onset})
        files.draw(lambda: mi.plot_characteristic(found).figure)
        shown = found.table.filter([found.curves, parameter, *SHOWN_COLUMNS])
        show_table("working points", shown, digits=5)
        show_table("impacts", found.impact_onset, digits=5)
        files.show()
