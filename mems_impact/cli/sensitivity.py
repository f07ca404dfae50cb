"""`mems-impact sensitivity`: sensitivities of a periodic orbit to its parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from mems_impact.cli.inputs import from_file
from mems_impact.cli.options import (
    actuator_from,
    device_options,
    drive_from,
    drive_options,
    guess_options,
    orbit_integrator_options,
    output_options,
    state_from,
    symbol_of,
    tolerance_option,
)
from mems_impact.cli.output import (
    Output,
    OutputValue,
    show,
    show_table,
    show_values,
    with_unit_column,
    with_units_in,
)
from mems_impact.integrators.options import Options

if TYPE_CHECKING:
    import mems_impact as mi

KIND = "sensitivity"


@click.command(short_help="Compute sensitivities of a periodic orbit to its parameters.")
@device_options
@drive_options
@click.option(
    "--quantity",
    default="mean speed",
    show_default=True,
    help="Quantity in the figure, such as 'displacement per period' or 'impact speed'.",
)
@tolerance_option
@guess_options
@orbit_integrator_options
@output_options
@click.pass_context
def command(
    ctx: click.Context,
    /,
    *,
    device: str,
    changes: dict[str, float],
    quantity: str,
    tolerances: dict[str, float | str],
    initial: dict[str, float],
    transient: float,
    periods: int | None,
    options: Options,
    output: Callable[[str], Output],
) -> None:
    """Compute sensitivities of a periodic orbit of DEVICE to all parameters.

    \b
    Example:
      mems-impact sensitivity zhao2004 --amplitude 0.24 --omega 0.5 \\
        --tolerance delta=0.005

    The orbit is the one to which a run from the initial state leads. The command writes the
    derivatives and, with tolerances, first-order standard deviations as CSV tables, and draws a
    tornado chart of one quantity. A study file can replace DEVICE.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi
    from mems_impact.actuator.parameters import names_in_file
    from mems_impact.studies.engine.config import orbit_sensitivity_study
    from mems_impact.studies.sampling import deviations
    from mems_impact.studies.sensitivity import chosen_quantities

    arguments: dict[str, Any]
    if "study" in names_in_file(device):
        system, arguments = from_file(ctx, device, KIND, allowed_options=("quantity", "tolerances"))
        names = arguments.pop("quantities", None)
    else:
        actuator = actuator_from(device, changes)
        system, names = actuator.under(drive_from()), None
        tolerances = {symbol_of(name): each for name, each in tolerances.items()}
        arguments = {
            "initial": state_from(initial, actuator),
            "transient": transient,
            "periods": periods,
            "options": options,
        }
    quantities = {each.name: each for each in chosen_quantities(system, names)}
    quantities |= {each.name: each for each in chosen_quantities(system, [quantity])}
    deviations(tolerances, system)
    with output(KIND) as files:
        result = orbit_sensitivity_study(system, quantities=tuple(quantities.values()), **arguments)
        tables = {"table": result.table}
        if tolerances:
            tables["deviations"] = with_unit_column(
                result.standard_deviations(tolerances), "quantity", _units(result)
            )
        files.tables(tables)
        chosen = tolerances or None
        files.draw(lambda: mi.plot_sensitivity(result, quantity, tolerances=chosen).figure)
        _show(result, quantity)
        if tolerances:
            deviations = tables["deviations"].iloc[:, :4]
            show_table(
                "deviations", with_units_in(deviations, "quantity", _units(result)), digits=6
            )
        files.show()


def _show(result: mi.Sensitivity, quantity: str) -> None:
    row = result.row(quantity)
    value = OutputValue(float(result.values[row]), result.units[row])
    show_values({quantity: value}, in_units=result.system.scales.named)
    show("")
    table = result.table
    rows = table[table["quantity"] == quantity].sort_values(
        "per cent", key=lambda column: -column.abs()
    )
    in_units = result.system.scales.named
    units = {name: result.system.unit(name) if in_units else "" for name in result.parameters}
    rows = rows[["parameter", "at", "derivative", "elasticity"]]
    show_table("table", with_units_in(rows, "parameter", units), digits=6)


def _units(result: mi.Sensitivity) -> dict[str, str]:
    """Return the units of the quantities, if they have any."""
    in_units = result.system.scales.named
    return dict(zip(result.quantities, result.units, strict=True)) if in_units else {}
