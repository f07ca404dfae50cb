"""`mems-impact datasheet`: the data sheet of a device."""

from __future__ import annotations

import click

from mems_impact.cli.options import actuator_from, device_options
from mems_impact.cli.output import OutputValue, show_table, show_values


@click.command(short_help="Show the data sheet of a device.")
@device_options
def command(*, device: str, changes: dict[str, float]) -> None:
    """Show parameters and derived quantities of DEVICE, which is in SI.

    \b
    Example:
      mems-impact datasheet mita2003

    The names are as in a table [design] of a device file: frequency of the block in a held
    frame, quality factor, pull-in voltage and so on. The regime tells whether static friction
    holds the frame until the blow of a slow pull-in. A device of a drawing has a second table, of
    the quantities that its formulas give.
    """  # noqa: D301 - click looks for the backspace itself
    from mems_impact.actuator.design.data_sheet_quantities import QUANTITIES

    sheet = actuator_from(device, changes).datasheet
    rows = {name: entry for name, entry in QUANTITIES.items() if name in sheet}
    values = {name: OutputValue(sheet[name], entry.unit) for name, entry in rows.items()}
    if sheet.regime:
        values["regime"] = OutputValue(sheet.regime)
    show_values(values)
    if not sheet.geometry.empty:
        columns = ["value", "unit", "source"]
        show_table("geometry", sheet.geometry[columns].reset_index(), digits=6)
