"""`mems-impact optimize`: optimal parameters of drive and device, or a Pareto front."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

from mems_impact.cli.arguments import Command, function_options
from mems_impact.cli.inputs import study_of
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
from mems_impact.cli.runtime import FAILED, warn, write_message

if TYPE_CHECKING:
    import pandas as pd

    import mems_impact as mi

KIND = "optimize"
FUNCTION = "mems_impact.studies.engine.config:optimize_from"


@click.command(cls=Command, short_help="Optimize parameters of a periodic orbit.")
@device_options
@function_options(FUNCTION)
@drive_options
@output_options
@click.pass_context
def command(ctx: click.Context, /, output: Callable[[str], Output], **options: Any) -> None:
    """Optimize a quantity of a periodic orbit of DEVICE over some parameters.

    \b
    Example:
      mems-impact optimize zhao2004 --amplitude 0.24 --omega 0.5 \\
        --maximize "mean speed" --over amplitude=0.2:0.3 --over omega=0.45:0.6

    The local search starts at the orbit to which a run from the initial state leads; the orbit
    stays stable and keeps its sequence of impacts. The command writes the iterations, the margins
    to the next bifurcations, and the motion as a figure, or the Pareto front of two quantities. A
    study file can replace DEVICE. The exit status is 1 if the search ends before a local optimum.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi
    from mems_impact.studies.engine.config import optimize_from

    system, arguments = study_of(ctx, KIND, FUNCTION, options)
    with output(KIND) as files:
        try:
            result: Any = optimize_from(system, **arguments)
        except mi.Interrupted as interruption:
            files.tables(_result_tables(interruption.partial))
            raise
        files.tables(_result_tables(result))
        if isinstance(result, mi.ParetoFront):
            files.draw(lambda: mi.plot_pareto(result).figure)
            show_table("front", result.table, digits=6)
        else:
            margins = result.margins
            rows = with_unit_column(margins, "parameter", result.system.units.shown)
            files.tables({"margins": rows})
            files.draw(lambda: mi.plot_orbit(result.orbit).figure)
            _show(result, margins)
        files.show()
    if isinstance(result, mi.Optimum):
        if not len(result.orbit.impacts):
            warn("the orbit has no impacts; to find one with impacts, start with --initial v2=…")
        if not result.converged:
            active = f" ({'; '.join(result.active)})" if result.active else ""
            write_message(f"first-order optimality not reached: {result.ended}{active}")
            ctx.exit(FAILED)


def _result_tables(result: Any) -> dict[str, pd.DataFrame]:
    """Return the table of a front, or of the iterations to an optimum."""
    return {"history": result.history} if hasattr(result, "history") else {"front": result.table}


def _show(best: mi.Optimum, margins: pd.DataFrame) -> None:
    system = best.system
    begin = best.history[best.quantity].iloc[0]
    unit = best.history.attrs.get("units", {}).get(best.quantity, "")
    better = f"{best.value:.9g}, from {begin:.6g}"
    show_values(
        {
            best.quantity: OutputValue(best.value, unit, better),
            **{
                name: OutputValue(value, system.units.get(name, ""))
                for name, value in best.values.items()
            },
            "held by": OutputValue(best.active, text="; ".join(best.active) or "nothing"),
            "ended": OutputValue(best.ended),
        },
        in_units=system.units.scales.named,
    )
    show("\nMargins to the next bifurcations:")
    show_table("margins", with_units_in(margins, "parameter", system.units.shown), digits=6)
