"""`mems-impact simulate`: one run of the actuator."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from mems_impact.cli.drives import drive_from, drive_options
from mems_impact.cli.failures import FAILED, INTERRUPTED, say, show_warnings_briefly
from mems_impact.cli.options import (
    actuator_from,
    device_options,
    integrator_options,
    output_options,
    state_options,
)

if TYPE_CHECKING:
    import pandas as pd

    import mems_impact as mi
    from mems_impact.cli.output import Output

FIRST_ROWS = 6


@click.command(short_help="Run a device under a voltage.")
@device_options
@drive_options
@click.option("--periods", type=float, default=300.0, help="Forcing periods to simulate.  [300]")
@state_options
@click.option(
    "--window",
    type=(float, float),
    metavar="FIRST LAST",
    help="Forcing periods that the statistics are taken over.  [the last part of the run]",
)
@integrator_options
@output_options
@click.pass_context
def command(
    ctx: click.Context,
    *,
    device: str,
    changes: dict[str, float],
    periods: float,
    x2: float,
    v2: float,
    v1: float,
    window: tuple[float, float] | None,
    method: str,
    rtol: float,
    atol: float,
    engine: str,
    output: str,
    figure: str | None,
    no_figure: bool,
) -> None:
    """Simulate DEVICE under a voltage, bias + amplitude cos(omega t) unless --drive is given.

    Shows the statistics, the first impacts and the first blows (a sequence of impacts that ends in
    rest is one), and writes the tables of impacts, blows, events and statistics as CSV and the
    last periods of the motion as a figure.

    \b
    Example:
      mems-impact simulate zhao2004 --amplitude 0.24 --omega 0.5 --periods 300
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi
    from mems_impact.cli.output import Output

    show_warnings_briefly()
    actuator = actuator_from(device, changes)
    drive = drive_from()
    initial = mi.State(x2=x2, v1=v1, v2=v2)
    options = mi.Options(method=method, rtol=rtol, atol=atol, engine=engine)
    files = Output(output, figure, no_figure, "simulate")
    try:
        run = mi.simulate(
            actuator,
            drive,
            periods,
            initial=initial,
            window=window,
            options=options,
            progress=True,
        )
    except (mi.RunError, mi.RunInterrupted) as error:
        if not isinstance(error.trajectory, mi.Run):
            raise
        _write(files, error.trajectory)
        if isinstance(error, mi.RunInterrupted):
            say(f"interrupted after {error.periods:.1f} forcing periods; {files.said()}")
            ctx.exit(INTERRUPTED)
        say(f"{error}; up to there, {files.said()}")
        ctx.exit(FAILED)
    _show(run)
    _write(files, run)
    files.draw(lambda: mi.plot_run(run)[0].figure)
    click.echo(files.said())


def _show(run: mi.Run) -> None:
    first, last = run.window
    click.echo(f"Statistics over forcing periods {first:g} to {last:g}:")
    # Without an impact there is no impact speed: what is not defined is not shown.
    defined = run.statistics.drop(["window first", "window last"]).dropna()
    width = max(map(len, defined.index))
    for name, value in defined.items():
        click.echo(f"  {name:<{width}}  {value:.9g}")
    impacts = run.impacts
    if impacts.empty:
        click.echo("\nNo impact.")
    else:
        click.echo(f"\nThe first of {len(impacts)} impacts:")
        click.echo(_first_rows(impacts))
        if len(run.blows) == len(impacts):
            click.echo("\nEach is a blow of its own.")
        else:
            click.echo(f"\nThe first of the {len(run.blows)} blows that they make:")
            click.echo(_first_rows(run.blows))
    click.echo("")


def _first_rows(table: pd.DataFrame) -> str:
    return table.head(FIRST_ROWS).to_string(index=False, float_format="{:.6g}".format)


def _write(files: Output, run: mi.Run) -> None:
    files.table("impacts", run.impacts)
    files.table("blows", run.blows)
    files.table("events", run.events)
    statistics = run.statistics
    files.table("statistics", statistics.rename_axis("quantity").reset_index(name="value"))
