"""`mems-impact basins`: basins of attraction."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import click

from mems_impact.cli.inputs import run_saving_partial, study_of, warn_of_failures
from mems_impact.cli.options import (
    AXIS_TYPE,
    axis_options,
    device_options,
    drive_options,
    initial_option,
    output_options,
    progress_option,
    ranges_option,
    recurrence_options,
    sample_options,
    study_integrator_options,
    study_options,
    symbol_of,
)
from mems_impact.cli.output import show_table

if TYPE_CHECKING:
    import mems_impact as mi

KIND = "basins"
HIDDEN = ("mean", "min", "max", "final", "std")  # columns of attractors that the screen omits


@click.command(short_help="Compute basins of attraction.")
@device_options
@axis_options(
    "Component of the initial state on the horizontal axis: x1, x2, v1 or v2.",
    "Component on the vertical axis; one axis is enough.",
)
@click.option(
    "--follow",
    type=AXIS_TYPE,
    metavar="NAME START STOP POINTS",
    help="Then continue the attractors over a parameter, to the ends of their branches.",
)
@click.option("--shares", is_flag=True, help="With --follow, also compute basin shares.")
@ranges_option(
    "--box",
    "v2=-1:1",
    "Instead of --x and --y: range of a component, from which initial states are sampled.",
)
@sample_options(1000, "random")
@drive_options
@initial_option
@recurrence_options
@study_integrator_options
@study_options
@progress_option
@output_options
@click.pass_context
def command(ctx: click.Context, /, **options: Any) -> None:
    """Compute the basins of attraction of DEVICE.

    \b
    Examples:
      mems-impact basins zhao2004 --x x2 -0.35 0.35 60 --y v2 -0.5 0.5 60 \\
        --amplitude 0.2 --omega 0.5
      mems-impact basins zhao2004 --y v2 -1 1 40 --amplitude 0.2 --omega 0.5 \\
        --follow amplitude 0.15 0.25 41

    The command shows the attractors with the shares of their basins, and writes the attractors,
    one row per initial state, and a figure. A grid (--x, --y) draws the basins; a sample of a box
    (--box) estimates shares with confidence bounds. --follow adds the branches of the attractors
    over a parameter. A study file can replace DEVICE.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi
    from mems_impact.actuator.system import ActuatorSystem

    progress = options["progress"]
    allowed_options = ("follow", "shares")
    system, arguments = study_of(
        ctx, options, KIND, lambda: _starts(options), allowed_options=allowed_options
    )
    if options["follow"] is not None:
        name, *values = options["follow"]
        if isinstance(system, ActuatorSystem):
            name = symbol_of(name)
            options["follow"] = name, *values
        system.check_parameter(name)
    with options["output"](KIND) as files:
        basins = run_saving_partial(
            lambda: mi.basins(system, **arguments, progress=progress),
            lambda table: files.tables({"table": table}),
        )
        files.tables(
            {"table": basins.table, "attractors": basins.attractors, "returns": basins.returns}
        )
        files.draw(lambda: mi.plot_basins(basins).figure)
        columns = [name for name in basins.attractors if not str(name).endswith(tuple(HIDDEN))]
        few = basins.attractors[columns]
        few.attrs = basins.attractors.attrs
        show_table("attractors", few, digits=5)
        if options["follow"] is not None:
            followed = run_saving_partial(
                lambda: _follow(basins, options, arguments),
                lambda table: files.tables({"followed": table}),
            )
            files.tables({"followed": followed.table, "branches": followed.branches})
            show_table("branches", followed.branches, digits=6)
        files.show()
    warn_of_failures(basins.table)


def _starts(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments that describe the initial states."""
    from mems_impact.studies.engine.config import range_axis

    axes = {name: options[name] for name in ("x", "y") if options[name] is not None}
    arguments: dict[str, Any] = {name: range_axis(*axis) for name, axis in axes.items()}
    if options["box"]:
        arguments |= {name: options[name] for name in ("box", "samples", "sampling", "seed")}
    if not arguments:
        raise click.UsageError("missing option '--x', '--y' or '--box'")
    return arguments


def _follow(
    basins: mi.Basins, options: Mapping[str, Any], arguments: Mapping[str, Any]
) -> mi.AttractorBranches:
    """Continue the attractors with the options of the basins, in a store within theirs."""
    import mems_impact as mi
    from mems_impact.studies.engine.config import range_axis

    shared = ("recurrence", "distance", "options", "executor", "workers")
    same = {name: arguments[name] for name in shared if name in arguments}
    store = os.path.join(arguments["store"], "followed") if "store" in arguments else None
    parameter, values = range_axis(*options["follow"])
    more = {"shares": options["shares"], "store": store, "progress": options["progress"]}
    return mi.continue_attractors(basins, parameter, values, **same, **more)
