"""`mems-impact sweep`: a parameter varied slowly, up and down."""

from __future__ import annotations

from itertools import islice
from typing import TYPE_CHECKING, Literal

import click

from mems_impact.cli.options import (
    actuator_from,
    device_options,
    drive_from,
    drive_options,
    integrator_options,
    output_options,
    parameter_option,
    periods_option,
    progress_option,
    range_options,
    study_options,
    transient_option,
)
from mems_impact.cli.output import show, show_table, tell_tables, unit_of

if TYPE_CHECKING:
    import pandas as pd

DIRECTIONS = ("up", "down", "both")
DIRECTION_WORDS = {"up": "increased", "down": "decreased"}
SHOWN_FAILURES = 3


@click.command(short_help="Vary a parameter slowly, up and down.")
@device_options
@parameter_option
@range_options("First value upwards, in the parameter's unit.", "Last value upwards.")
@click.option(
    "--points",
    type=click.IntRange(2, 1_000_000),
    default=101,
    show_default=True,
    help="Number of values.",
)
@drive_options
@click.option(
    "--direction",
    type=click.Choice(DIRECTIONS),
    default="both",
    show_default=True,
    help="Way to go.",
)
@transient_option("Forcing periods to wait at a value.", 300)
@periods_option("Forcing periods to measure then.", 60)
@integrator_options
@study_options
@progress_option
@output_options
def command(
    *,
    device: str,
    changes: dict[str, float],
    parameter: str,
    start: float,
    stop: float,
    points: int,
    direction: Literal["up", "down", "both"],
    transient: int,
    periods: int,
    method: str | None,
    rtol: float,
    atol: float,
    engine: str,
    store: str | None,
    executor: str | None,
    workers: int | None,
    progress: bool,
    output: str,
    figure: str | None,
    no_figure: bool,
) -> None:
    """Vary a parameter of DEVICE or of its voltage slowly, each value from the state of the last.

    Upwards the first value starts at rest, downwards with a kick that strikes the stopper. Shows
    where impacts set in and where they cease, and writes the velocities on the Poincaré
    section x2 = 0 as a CSV table and as a figure, as in Fig. 4 of the paper.

    \b
    Example:
      mems-impact sweep zhao2004 --parameter amplitude --start 0.16 --stop 0.24 --omega 0.5
    """  # noqa: D301 - click looks for the backspace itself
    import numpy as np

    import mems_impact as mi
    from mems_impact.cli.output import Output
    from mems_impact.studies.engine.config import executor_named

    if "." in parameter:  # of a term, which the device may not have yet
        changes = {**changes, parameter: start}
    actuator = actuator_from(device, changes)
    drive = drive_from({parameter: start})
    options = mi.Options(method=method, rtol=rtol, atol=atol, engine=engine)
    with Output(output, figure, no_figure, "sweep") as files:
        try:
            table = mi.sweep(
                actuator,
                drive,
                parameter,
                np.linspace(start, stop, points),
                direction=direction,
                transient=transient,
                periods=periods,
                options=options,
                progress=progress,
                store=store,
                executor=None if executor is None else executor_named(executor, workers),
                workers=workers,
            )
        except mi.SweepInterrupted as interruption:
            if interruption.done > 0:
                files.tables(_tables(interruption.table))
            raise
        files.tables(_tables(table))
        files.draw(lambda: mi.plot_sweep(table).figure)
        _show(table)
        files.tell()


def _tables(table: pd.DataFrame) -> dict[str, pd.DataFrame]:
    from mems_impact.tables import sweep_summary

    return {"table": table, "summary": sweep_summary(table)}


def _show(table: pd.DataFrame) -> None:
    import pandas as pd

    from mems_impact.tables import sweep_summary, switches

    summary = sweep_summary(table)
    show_table("summary", summary, 6)
    parameter = summary.columns[0]
    unit = unit_of(summary, parameter)
    found = switches(table)
    tell_tables(
        {"switches": pd.DataFrame(found, columns=["direction", parameter, "impacts begin"])}
    )
    turns = {direction: (value, begins) for direction, value, begins in found}
    for direction, chain in summary.groupby("direction", sort=False):
        failed = chain[chain["status"] != "ok"]
        changed = DIRECTION_WORDS[str(direction)]
        line = f"{parameter.partition(' [')[0]} {changed}, {len(chain)} values: "
        line += f"{int(chain['impacting'].sum())} with impacts"
        if direction in turns:
            value, begins = turns[direction]
            line += f", which {'begin' if begins else 'cease'} at {value:.9g}{unit}"
        if len(failed):
            line += f"; {len(failed)} failed"
        show(line)
        reasons = zip(failed[parameter], failed["status"], strict=True)
        for value, reason in islice(reasons, SHOWN_FAILURES):
            show(f"  failed at {value:.9g}{unit}: {reason}")
    show("")
