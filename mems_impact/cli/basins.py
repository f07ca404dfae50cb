"""`mems-impact basins`: basins of attraction."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import click

from mems_impact.cli.arguments import Command, function_options
from mems_impact.cli.inputs import run_saving_partial, study_of, symbol_for, warn_of_failures
from mems_impact.cli.options import device_options, drive_options, output_options
from mems_impact.cli.output import show_table
from mems_impact.cli.value_types import RangeType

if TYPE_CHECKING:
    import mems_impact as mi

KIND = "basins"
FUNCTION = "mems_impact.studies.basins:basins"
HIDDEN = ("mean", "min", "max", "final", "std")  # columns of attractors that the screen omits


@click.command(cls=Command, short_help="Compute basins of attraction.")
@device_options
@function_options(FUNCTION)
@click.option(
    "--follow",
    type=RangeType(points=True),
    help="Then continue the attractors over a parameter, to the ends of their branches.",
)
@click.option("--shares", is_flag=True, help="With --follow, also compute basin shares.")
@drive_options
@output_options
@click.pass_context
def command(ctx: click.Context, /, **options: Any) -> None:
    """Compute the basins of attraction of DEVICE.

    \b
    Examples:
      mems-impact basins zhao2004 --x x2=-0.35:0.35:60 --y v2=-0.5:0.5:60 \\
        --amplitude 0.2 --omega 0.5
      mems-impact basins zhao2004 --y v2=-1:1:40 --amplitude 0.2 --omega 0.5 \\
        --follow amplitude=0.15:0.25:41

    The command shows the attractors with the shares of their basins, and writes the attractors,
    one row per initial state, and a figure. A grid (--x, --y) draws the basins; a sample of a box
    (--box) estimates shares with confidence bounds. --follow adds the branches of the attractors
    over a parameter. A study file can replace DEVICE.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi

    follow = options["follow"]
    system, arguments = study_of(ctx, KIND, FUNCTION, options, own_options=("follow", "shares"))
    if follow is not None:
        follow = symbol_for(follow[0], system), *follow[1:]
        system.check_parameter(follow[0])
    with options["output"](KIND) as files:
        basins = run_saving_partial(
            lambda: mi.basins(system, **arguments), lambda table: files.tables({"table": table})
        )
        files.tables(
            {"table": basins.table, "attractors": basins.attractors, "returns": basins.returns}
        )
        files.draw(lambda: mi.plot_basins(basins).figure)
        columns = [name for name in basins.attractors if not str(name).endswith(tuple(HIDDEN))]
        show_table("attractors", basins.attractors[columns], digits=5)
        if follow is not None:
            followed = run_saving_partial(
                lambda: _follow(basins, follow, options["shares"], arguments),
                lambda table: files.tables({"followed": table}),
            )
            files.tables({"followed": followed.table, "branches": followed.branches})
            show_table("branches", followed.branches, digits=6)
        files.show()
    warn_of_failures(basins.table)


def _follow(
    basins: mi.Basins,
    follow: tuple[str, float, float, int],
    shares: bool,
    arguments: Mapping[str, Any],
) -> mi.AttractorBranches:
    """Continue the attractors with the arguments of the basins, in a store within theirs."""
    import mems_impact as mi
    from mems_impact.studies.engine.config import range_axis

    shared = ("recurrence", "distance", "options", "executor", "workers", "progress")
    same = {name: arguments[name] for name in shared if name in arguments}
    store = os.path.join(arguments["store"], "followed") if "store" in arguments else None
    return mi.continue_attractors(basins, *range_axis(*follow), shares=shares, store=store, **same)
