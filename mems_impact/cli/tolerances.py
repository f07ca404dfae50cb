"""`mems-impact tolerances`: manufacturing tolerances (Monte Carlo, Sobol indices, yield)."""

from __future__ import annotations

from typing import Any

import click

from mems_impact.cli.arguments import Command, function_options
from mems_impact.cli.inputs import run_saving_partial, study_of, warn_of_failures
from mems_impact.cli.options import device_options, drive_options, output_options
from mems_impact.cli.output import show_table, with_unit_column, with_units_in

KIND = "tolerances"
FUNCTION = "mems_impact.studies.uncertainty:tolerance_analysis"
SPREAD = (0.05, 0.5, 0.95)


@click.command(cls=Command, short_help="Propagate manufacturing tolerances (Monte Carlo, Sobol).")
@device_options
@function_options(FUNCTION)
@drive_options
@output_options
@click.pass_context
def command(ctx: click.Context, /, **options: Any) -> None:
    """Propagate manufacturing tolerances of DEVICE to the quantities of its attractor.

    \b
    Example:
      mems-impact tolerances zhao2004 --amplitude 0.24 --omega 0.5 \\
        --initial kicked --over e=norm:0.8:0.02 --over mu_d=uniform:0.25:0.04 \\
        --specification "displacement per period=3e-4:"

    The command samples devices, and writes CSV tables and a figure. A study file can replace
    DEVICE. Columns:

    \b
      table      parameters, kind of motion, period and quantities of each sample
      quantiles  of each quantity, over "points" samples with a value
      yields     "share" of samples within the bounds "from" and "to"
      indices    with --indices; "first": the share of the variance that vanishes
                 if the parameter is known; "total": the share that remains if all
                 others are known

    The true share or index lies from "low" to "high" with a probability of 95 %.
    "mems-impact docs statistics" describes the quantities.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi

    system, arguments = study_of(ctx, KIND, FUNCTION, options)
    with options["output"](KIND) as files:
        analysis = run_saving_partial(
            lambda: mi.tolerance_analysis(system, **arguments),
            lambda table: files.tables({"table": table}),
        )
        spread = analysis.quantiles(SPREAD).reset_index(names="quantity")
        units = analysis.table.attrs.get("units", {})
        tables = {
            "table": analysis.table,
            "quantiles": with_unit_column(spread, "quantity", units),
            "yields": with_unit_column(analysis.yields, "quantity", units),
        }
        if analysis.indices is not None:
            tables["indices"] = analysis.indices
        files.tables(tables)
        files.draw(lambda: mi.plot_tolerance_analysis(analysis).figure)
        observed = spread[spread["points"] > 0]
        show_table("quantiles", with_units_in(observed, "quantity", units), digits=5)
        if analysis.specification:
            show_table("yields", with_units_in(analysis.yields, "quantity", units), digits=5)
        if analysis.indices is not None:
            show_table("indices", with_units_in(analysis.indices, "quantity", units), digits=5)
        files.show()
    warn_of_failures(analysis.points)
