"""`mems-impact sensitivity`: sensitivities of a periodic orbit to its parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from mems_impact.cli.arguments import Command, function_options
from mems_impact.cli.inputs import study_of, symbol_for
from mems_impact.cli.options import device_options, drive_options, output_options
from mems_impact.cli.output import (
    Output,
    OutputValue,
    show,
    show_table,
    show_values,
    with_unit_column,
    with_units_in,
)
from mems_impact.cli.value_types import ToleranceType

if TYPE_CHECKING:
    import mems_impact as mi

KIND = "sensitivity"
FUNCTION = "mems_impact.studies.engine.config:orbit_sensitivity_study"


@click.command(
    cls=Command, short_help="Compute sensitivities of a periodic orbit to its parameters."
)
@device_options
@function_options(FUNCTION, omit=("quantities",))
@click.option(
    "--quantity",
    default="mean speed",
    show_default=True,
    help="Quantity in the figure, such as 'displacement per period' or 'impact speed'.",
)
@click.option(
    "--tolerance",
    "tolerances",
    multiple=True,
    type=ToleranceType(),
    help="Standard deviation of a parameter, such as delta=0.005, or relative to its value, such "
    "as delta=2%. May be repeated.",
)
@drive_options
@output_options
@click.pass_context
def command(
    ctx: click.Context,
    /,
    *,
    quantity: str,
    tolerances: tuple[tuple[str, float | str], ...],
    output: Callable[[str], Output],
    **options: Any,
) -> None:
    """Compute sensitivities of a periodic orbit of DEVICE to all parameters.

    \b
    Example:
      mems-impact sensitivity zhao2004 --amplitude 0.24 --omega 0.5 \\
        --tolerance delta=0.005

    A run from the initial state leads to the orbit. The command writes the
    derivatives and, with tolerances, first-order standard deviations as CSV tables, and draws a
    tornado chart of one quantity. A study file can replace DEVICE.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi
    from mems_impact.studies.engine.config import orbit_sensitivity_study
    from mems_impact.studies.sampling import deviations
    from mems_impact.studies.sensitivity import chosen_quantities

    system, arguments = study_of(
        ctx, KIND, FUNCTION, options, own_options=("quantity", "tolerances")
    )
    names = arguments.pop("quantities", None)
    quantities = {each.name: each for each in chosen_quantities(system, names)}
    quantities |= {each.name: each for each in chosen_quantities(system, [quantity])}
    scatter = {symbol_for(name, system): each for name, each in tolerances}
    deviations(scatter, system)
    with output(KIND) as files:
        result = orbit_sensitivity_study(system, quantities=tuple(quantities.values()), **arguments)
        tables = {"table": result.table}
        if scatter:
            tables["deviations"] = with_unit_column(
                result.standard_deviations(scatter), "quantity", _units(result)
            )
        files.tables(tables)
        chosen = scatter or None
        files.draw(lambda: mi.plot_sensitivity(result, quantity, tolerances=chosen).figure)
        _show(result, quantity)
        if scatter:
            deviations = tables["deviations"].iloc[:, :4]
            show_table(
                "deviations", with_units_in(deviations, "quantity", _units(result)), digits=6
            )
        files.show()


def _show(result: mi.Sensitivity, quantity: str) -> None:
    row = result.row(quantity)
    value = OutputValue(float(result.values[row]), result.units[row])
    show_values({quantity: value}, in_units=result.system.units.scales.named)
    show("")
    table = result.table
    rows = table[table["quantity"] == quantity].sort_values(
        "per cent", key=lambda column: -column.abs()
    )
    rows = rows[["parameter", "at", "derivative", "elasticity"]]
    show_table("table", with_units_in(rows, "parameter", result.system.units.shown), digits=6)


def _units(result: mi.Sensitivity) -> dict[str, str]:
    """Return the units of the quantities, if they have any."""
    in_units = result.system.units.scales.named
    return dict(zip(result.quantities, result.units, strict=True)) if in_units else {}
