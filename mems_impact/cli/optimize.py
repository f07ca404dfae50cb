"""`mems-impact optimize`: optimal parameters of drive and device, or a Pareto front."""

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
    progress_option,
    ranges_option,
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
from mems_impact.cli.runtime import FAILED, warn, write_message
from mems_impact.integrators.options import Options

if TYPE_CHECKING:
    import pandas as pd

    import mems_impact as mi

KIND = "optimize"


@click.command(short_help="Optimize parameters of a periodic orbit.")
@device_options
@click.option(
    "--maximize", multiple=True, metavar="QUANTITY", help="Quantity to maximize: 'mean speed'."
)
@click.option(
    "--minimize",
    multiple=True,
    metavar="QUANTITY",
    help="Quantity to minimize: 'energy lost per period', 'standard deviation of mean speed'. "
    "Two quantities in all give a Pareto front.",
)
@ranges_option("--over", "omega=0.45:0.55", "A parameter to vary and its bounds.")
@ranges_option(
    "--subject-to",
    "'largest multiplier=:0.9'",
    "Bounds of a quantity (a constraint); one bound may be omitted.",
    half_open=True,
)
@tolerance_option
@click.option(
    "--points",
    type=click.IntRange(2, 1000),
    default=9,
    show_default=True,
    help="Number of points on a Pareto front.",
)
@drive_options
@guess_options
@orbit_integrator_options
@progress_option
@output_options
@click.pass_context
def command(
    ctx: click.Context,
    /,
    *,
    device: str,
    changes: dict[str, float],
    maximize: tuple[str, ...],
    minimize: tuple[str, ...],
    over: dict[str, tuple[float, float]],
    subject_to: dict[str, tuple[float | None, float | None]],
    tolerances: dict[str, float | str],
    points: int,
    initial: dict[str, float],
    transient: float,
    periods: int | None,
    options: Options,
    progress: bool,
    output: Callable[[str], Output],
) -> None:
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
    from mems_impact.actuator.parameters import names_in_file
    from mems_impact.studies.engine.config import optimize_from

    arguments: dict[str, Any]
    if "study" in names_in_file(device):
        system, arguments = from_file(ctx, device, KIND)
    else:
        if not over:
            raise click.UsageError("missing option '--over'")
        several = len(set(maximize + minimize))
        if not 1 <= several <= 2 or several != len(maximize) + len(minimize):
            problem = "give --maximize or --minimize: one quantity, or two for a front"
            raise click.UsageError(problem)
        actuator = actuator_from(device, changes)
        system = actuator.under(drive_from())
        arguments = {
            "over": {symbol_of(name): bounds for name, bounds in over.items()},
            "subject_to": subject_to,
            "tolerances": {symbol_of(name): each for name, each in tolerances.items()},
            "points": points,
            "initial": state_from(initial, actuator),
            "transient": transient,
            "periods": periods,
            "options": options,
        }
        arguments |= {"maximize": maximize, "minimize": minimize}
    with output(KIND) as files:
        try:
            result: Any = optimize_from(system, progress=progress, **arguments)
        except mi.Interrupted as interruption:
            files.tables(_result_tables(interruption.partial))
            raise
        files.tables(_result_tables(result))
        if isinstance(result, mi.ParetoFront):
            files.draw(lambda: mi.plot_pareto(result).figure)
            show_table("front", result.table, digits=6)
        else:
            margins = result.margins
            rows = with_unit_column(margins, "parameter", _units(result))
            files.tables({"margins": rows})
            files.draw(lambda: mi.plot_orbit(result.orbit).figure)
            _show(result, margins)
        files.show()
    if isinstance(result, mi.Optimum):
        if not len(result.orbit.impacts):
            warn("the orbit has no impacts; to find one with impacts, start with --initial v2=…")
        if not result.converged:
            write_message(
                f"first-order optimality not reached: {result.ended}{_constraint_suffix(result)}"
            )
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
            **{name: OutputValue(value, system.unit(name)) for name, value in best.values.items()},
            "held by": OutputValue(best.active, text="; ".join(best.active) or "nothing"),
            "ended": OutputValue(best.ended),
        },
        in_units=system.scales.named,
    )
    show("\nMargins to the next bifurcations:")
    show_table("margins", with_units_in(margins, "parameter", _units(best)), digits=6)


def _constraint_suffix(best: mi.Optimum) -> str:
    """Return the active constraints of an optimum, to be added to a sentence."""
    return f" ({'; '.join(best.active)})" if best.active else ""


def _units(best: mi.Optimum) -> dict[str, str]:
    """Return the units of the varied parameters; empty for a dimensionless device."""
    system = best.system
    return {name: system.unit(name) for name in best.values} if system.scales.named else {}
