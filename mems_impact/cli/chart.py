"""`mems-impact chart`: voltages at which a device switches on and off, over the frequency."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import click

from mems_impact.cli.options import (
    QuantityType,
    actuator_from,
    device_options,
    orbit_integrator_options,
    output_options,
    periods_option,
    progress_option,
    range_options,
    workers_option,
)
from mems_impact.cli.output import Output, show_table
from mems_impact.cli.runtime import warn, write_message
from mems_impact.integrators.options import Options

if TYPE_CHECKING:
    import pandas as pd

    import mems_impact as mi

MAX_FREQUENCY_ROWS = 9  # frequencies at which voltages are shown


@click.command(short_help="Chart the switching voltages over the frequency.")
@device_options
@range_options(
    "Lowest frequency [Hz]; omega of a dimensionless device.",
    "Highest frequency.",
    defaults=("0.88 of half the resonance, or of the resonance with a bias", "1.02 of the same"),
)
@click.option(
    "--bias",
    type=QuantityType("V"),
    default=0,
    show_default=True,
    help="Constant part of the voltage [V].",
)
@click.option(
    "--crises",
    type=int,
    default=7,
    show_default=True,
    help="Number of frequencies at which a crisis is simulated, or, without types, all voltages "
    "are found.",
)
@periods_option("Forcing periods for which an attractor must persist there.", 2000)
@orbit_integrator_options
@workers_option("Number of threads.", show_default="one per crisis, at most 4")
@progress_option
@output_options
def command(
    *,
    device: str,
    changes: dict[str, float],
    start: float | None,
    stop: float | None,
    bias: float,
    crises: int,
    periods: int,
    options: Options,
    workers: int | None,
    progress: bool,
    output: Callable[[str], Output],
) -> None:
    """Chart the voltages at which DEVICE switches on and off over the frequency, as in Fig. 7.

    \b
    Example:
      mems-impact chart zhao2004

    Boundaries are continued as curves of grazings and folds; where the device switches off in a
    crisis (type III), the voltage is found by simulation. If the spring moves the frame without
    blows, there are no types; the command then also finds where the frame begins to slip ("slip")
    and between which voltages all forcing periods have the same impacts ("steady from", "steady
    to"). It shows the voltages at some frequencies, and writes boundaries, types and points as CSV
    tables and the chart as a figure.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi

    actuator = actuator_from(device, changes)
    in_units = actuator.scales.named
    drive = mi.Sine(amplitude=0.0, omega=1.0, bias=bias)
    with output("chart") as files:
        try:
            chart = mi.operating_chart(
                actuator,
                drive,
                omega=None if in_units else (start, stop),
                frequency=(start, stop) if in_units else None,
                crises=crises,
                periods=periods,
                options=options,
                workers=workers,
                progress=write_message if progress else False,
            )
        except mi.Interrupted as interruption:
            if interruption.partial.pieces:
                files.tables(_tables(interruption.partial))
            raise
        files.tables(_tables(chart))
        files.draw(lambda: mi.plot_chart(chart).figure)
        for note in chart.notes:
            warn(note)
        show_table("voltages", _voltages(chart, crises), digits=6)
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
        {name: "Hz", **dict.fromkeys(boundaries, system.drive_unit)} if system.scales.named else {}
    )
    for boundary in boundaries:
        columns[boundary] = np.full(count, math.nan)
        for of, _, _, points in chart.pieces:
            if of == boundary and points:
                frequency, voltage = np.array(points).T
                frequency, voltage = system.out(name, frequency), system.out("amplitude", voltage)
                covered = (frequency.min() <= grid + slack) & (grid - slack <= frequency.max())
                columns[boundary][covered] = np.interp(grid[covered], frequency, voltage)
    table = pd.DataFrame(columns)
    table.attrs["units"] = units
    return table
