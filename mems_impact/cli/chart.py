"""`mems-impact chart`: voltages at which a device switches on and off, over the frequency."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import click

from mems_impact.cli.arguments import Command, function_options
from mems_impact.cli.inputs import arguments_for
from mems_impact.cli.options import actuator_from, device_options, output_options
from mems_impact.cli.output import Output, show_table
from mems_impact.cli.runtime import warn, write_message
from mems_impact.cli.value_types import QuantityType

if TYPE_CHECKING:
    import pandas as pd

    import mems_impact as mi

CRISES = 7  # default of `operating_chart`
MAX_FREQUENCY_ROWS = 9  # frequencies at which voltages are shown

FUNCTION = "mems_impact.actuator.design.chart_construction:operating_chart"


@click.command(cls=Command, short_help="Chart the switching voltages over the frequency.")
@device_options
@function_options(FUNCTION)
@click.option(
    "--bias",
    type=QuantityType("V"),
    default=0,
    show_default=True,
    help="Constant part of the voltage [V].",
)
@output_options
def command(
    *, device: str, changes: dict[str, float], bias: float, output: Callable[[str], Output]
) -> None:
    """Chart the voltages at which DEVICE switches on and off over the frequency, as in Fig. 7.

    \b
    Example:
      mems-impact chart zhao2004

    Boundaries are continued as curves of grazings and folds; where the device switches off in a
    crisis (type III), the voltage is found by simulation. If the spring moves the frame without
    blows, there are no types; the command then also finds where the frame begins to slip ("slip")
    and between which voltages all forcing periods have the same impacts ("steady from", "steady
    to"). The output is the voltages at some frequencies, boundaries, types and points as CSV
    tables, and the chart as a figure.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi

    actuator = actuator_from(device, changes)
    drive = mi.Sine(amplitude=0.0, omega=1.0, bias=bias)
    arguments = arguments_for(FUNCTION)
    if arguments["progress"]:
        arguments["progress"] = write_message
    if actuator.scales.named and "omega" not in arguments:
        arguments.setdefault("frequency", (None, None))
    with output("chart") as files:
        try:
            chart = mi.operating_chart(actuator, drive, **arguments)
        except mi.Interrupted as interruption:
            if interruption.partial.pieces:
                files.tables(_tables(interruption.partial))
            raise
        files.tables(_tables(chart))
        files.draw(lambda: mi.plot_chart(chart).figure)
        for note in chart.notes:
            warn(note)
        show_table(
            "voltages",
            _voltages(chart, arguments.get("columns", arguments.get("crises", CRISES))),
            digits=6,
        )
        show_table("types", chart.types, digits=9)
        show_table("points", chart.special_table, digits=12)
        files.show()


def _tables(chart: mi.OperatingChart) -> dict[str, pd.DataFrame]:
    return {"boundaries": chart.table, "types": chart.types, "points": chart.special_table}


def _voltages(chart: mi.OperatingChart, columns_of_slip: int) -> pd.DataFrame:
    """Return the voltages of all boundaries at a few frequencies, interpolated on the curves.

    Without types, these are the frequencies at which they are computed, since a curve does not
    always lead from one to the next.
    """
    import numpy as np
    import pandas as pd

    system = chart.system
    name = chart.parameters[0]
    count = MAX_FREQUENCY_ROWS if chart.regions else columns_of_slip or MAX_FREQUENCY_ROWS
    grid = np.linspace(*chart.frequencies, count)
    slack = 1e-9 * grid  # rounding by units
    columns = {name: grid}
    sides = ("slip", "on", "off", "steady from", "steady to")
    boundaries = [side for side in sides if any(side == piece[0] for piece in chart.pieces)]
    units = (
        {name: "Hz", **dict.fromkeys(boundaries, system.drive_unit)}
        if system.units.scales.named
        else {}
    )
    for boundary in boundaries:
        columns[boundary] = np.full(count, math.nan)
        for of, _, _, points in chart.pieces:
            if of == boundary and points:
                frequency, voltage = np.array(points).T
                frequency, voltage = (
                    system.units.out(name, frequency),
                    system.units.out("amplitude", voltage),
                )
                covered = (frequency.min() <= grid + slack) & (grid - slack <= frequency.max())
                columns[boundary][covered] = np.interp(grid[covered], frequency, voltage)
    table = pd.DataFrame(columns)
    table.attrs["units"] = units
    return table
