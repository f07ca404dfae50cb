"""`mems-impact map`: attractors on a grid of two parameters."""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING, Any

import click

from mems_impact.cli.arguments import Command, function_options
from mems_impact.cli.inputs import run_saving_partial, study_of
from mems_impact.cli.options import device_options, drive_options, output_options
from mems_impact.cli.output import show, show_table, unit_of
from mems_impact.cli.runtime import warn, write_message

if TYPE_CHECKING:
    import pandas as pd

    import mems_impact as mi

KIND = "map"
FUNCTION = "mems_impact.studies.operating_map:operating_map"
SHOWN_FAILURES = 3
CURVES = "amplitude", "omega or frequency"


@click.command(cls=Command, short_help="Compute attractors on a two-parameter grid.")
@device_options
@function_options(FUNCTION)
@click.option(
    "--column",
    metavar="NAME",
    show_default="kinds of motions",
    help="Column of the table that the figure shows, such as 'mean speed'.",
)
@click.option(
    "--curves",
    is_flag=True,
    help="Overlay the switching curves of DEVICE, found by continuation; for maps over amplitude "
    "and frequency.",
)
@click.option(
    "--energy", is_flag=True, help="Compute the work of the drive per period and per impact."
)
@drive_options
@output_options
@click.pass_context
def command(ctx: click.Context, /, **options: Any) -> None:
    """Compute the attractor of DEVICE at each point of a two-parameter grid.

    \b
    Examples:
      mems-impact map zhao2004 --x amplitude=0.16:0.30:15 \\
        --y omega=0.44:0.51:15 --store out/map
      mems-impact map study.toml

    Every point starts from the initial state, not from its neighbour. Its row has the kind of
    motion (off, period 1, 2, …, chaotic or quasi-periodic), the step and its standard deviation,
    speed, impacts and energy. The command writes the table, a summary and a figure. With --store,
    an interrupted map resumes where it stopped.

    A study file can replace DEVICE: TOML that describes system, study and store.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi
    from mems_impact.actuator.system import ActuatorSystem

    column = options["column"]
    system, arguments = study_of(
        ctx, KIND, FUNCTION, options, own_options=("column", "curves", "energy")
    )
    if options["energy"]:
        if not isinstance(system, ActuatorSystem):
            raise click.UsageError("--energy: for maps of a device only")
        system = system.with_energy()
    _check_column(column, system, arguments)
    with options["output"](KIND) as files:
        chart = _chart(system, arguments) if options["curves"] else None
        operating_map = run_saving_partial(
            lambda: mi.operating_map(system, **arguments),
            lambda table: files.tables(_tables(table)),
        )
        files.tables({**_tables(operating_map.table), **({"curves": chart.table} if chart else {})})
        boundaries = chart or ()
        files.draw(lambda: mi.plot_map(operating_map, column, boundaries=boundaries).figure)
        _show(operating_map.table)
        files.show()


def _check_column(column: str | None, system: mi.HybridSystem, arguments: dict[str, Any]) -> None:
    """Refuse a column that the table will lack, before it is computed."""
    from mems_impact.studies.attractor_study import AttractorEvaluator

    chosen = {"recurrence": arguments["recurrence"]} if "recurrence" in arguments else {}
    schema = AttractorEvaluator(system=system, **chosen).schema
    numbers = [name for name, kind in schema.items() if kind != "str"]
    if column is not None and column not in numbers:
        raise click.UsageError(f"--column {column}: must be one of {', '.join(numbers)}")


def _chart(system: mi.HybridSystem, arguments: dict[str, Any]) -> mi.OperatingChart:
    """Return the switching curves of the device, in the range of the map."""
    import mems_impact as mi
    from mems_impact.actuator.system import ActuatorSystem

    axes = dict([arguments["x"], arguments["y"]])
    name = next((name for name in ("frequency", "omega") if name in axes), "")
    if set(axes) != {"amplitude", name} or not isinstance(system, ActuatorSystem):
        raise click.UsageError(f"--curves: for maps of a device over {' and '.join(CURVES)} only")
    values = axes[name]
    ends = float(min(values)), float(max(values))
    chart = mi.operating_chart(
        system.actuator,
        system.drive,
        omega=ends if name == "omega" else None,
        frequency=ends if name == "frequency" else None,
        crises=0,  # the map itself shows them
        progress=write_message if arguments["progress"] else False,
    )
    for note in chart.notes:
        warn(note)
    return chart


def _tables(table: pd.DataFrame) -> dict[str, pd.DataFrame]:
    from mems_impact.studies.attractor_study import map_summary

    return {"table": table, "summary": map_summary(table)}


def _show(table: pd.DataFrame) -> None:
    """Show number and range of the points of each kind, and why points failed."""
    from mems_impact.studies.attractor_study import map_summary

    show_table("summary", map_summary(table), digits=6)
    failed = table[table["status"] != "ok"]
    x, y = table.columns[:2]
    rows = zip(failed[x], failed[y], failed["status"], strict=True)
    for a, b, reason in islice(rows, SHOWN_FAILURES):
        point = f"{x} = {a:.9g}{unit_of(table, x)}, {y} = {b:.9g}{unit_of(table, y)}"
        show(f"  failed at {point}: {reason}")
    if len(failed):
        show("")
