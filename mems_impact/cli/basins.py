"""`mems-impact basins`: which attractor is reached from where."""

from __future__ import annotations

from typing import Any

import click

from mems_impact.cli.drives import drive_from, drive_options
from mems_impact.cli.failures import show_warnings_briefly
from mems_impact.cli.options import (
    actuator_from,
    axis_options,
    device_options,
    initial_option,
    output_options,
    progress_option,
    sample_options,
    settle_options,
    state_from,
    study_integrator_options,
    study_options,
)
from mems_impact.cli.ranges import ranges_option
from mems_impact.cli.showing import show_table
from mems_impact.cli.studied import add_running, from_file, run_kept, settling

KIND = "basins"
DPI = 300  # the figure is as wide as a column
HIDDEN = ("mean", "min", "max", "final", "std")  # columns of attractors that a screen leaves out


@click.command(short_help="Tell which attractor is reached from where.")
@device_options
@axis_options(
    "The component of the initial state to the right, x1, x2, v1 or v2.",
    "The component upwards; one may be enough.",
)
@ranges_option(
    "--box", "v2=-1:1", "In place of --x and --y, a component between ends: states are drawn."
)
@sample_options(1000, "random")
@drive_options
@initial_option
@settle_options
@study_integrator_options
@study_options
@progress_option
@output_options
@click.pass_context
def command(ctx: click.Context, /, **options: Any) -> None:
    """Tell what the motions of DEVICE come to from many initial states, and which are the same.

    Shows the attractors with their shares, and writes them, every point, and a figure of the
    basins. A sample of a box tells shares with bounds; a grid is a picture. In place of DEVICE a
    study file may stand.

    \b
    Example:
      mems-impact basins zhao2004 --x x2 -0.35 0.35 60 --y v2 -0.5 0.5 60 \\
        --amplitude 0.2 --omega 0.5
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi
    from mems_impact.actuator.study_file import holds_study
    from mems_impact.cli.output import Output
    from mems_impact.studies.words import range_axis

    show_warnings_briefly()
    device = options["device"]
    given: dict[str, Any]
    if holds_study(device):
        system, given = from_file(ctx, device, KIND)
    else:
        actuator = actuator_from(device, options["changes"])
        system = actuator.under(drive_from())
        axes = {name: options[name] for name in ("x", "y") if options[name] is not None}
        given = {name: range_axis(*axis) for name, axis in axes.items()}
        if options["box"]:
            given |= {name: options[name] for name in ("box", "samples", "sampling", "seed")}
        if options["initial"]:
            given["initial"] = state_from(options["initial"], actuator)
        given |= settling(options)
    add_running(given, options)
    figure, bare = options["figure"], options["no_figure"]
    with Output(options["output"], figure, bare, KIND) as files:
        found = run_kept(
            lambda: mi.basins(system, **given, progress=options["progress"]),
            lambda table: files.tables({"table": table}),
        )
        files.tables(
            {"table": found.table, "attractors": found.attractors, "returns": found.returns}
        )
        files.draw(lambda: mi.plot_basins(found).figure, DPI)
        shown = [name for name in found.attractors if not str(name).endswith(tuple(HIDDEN))]
        few = found.attractors[shown]
        few.attrs = found.attractors.attrs
        show_table("attractors", few, 5)
        files.tell()
