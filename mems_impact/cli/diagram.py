"""`mems-impact diagram`: the bifurcation diagram of a device or a system."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import click

from mems_impact.cli.inputs import load_subject
from mems_impact.cli.options import (
    Initial,
    QuantityType,
    device_options,
    drive_options,
    initial_option,
    orbit_integrator_options,
    output_options,
    progress_option,
    store_option,
    symbol_of,
)
from mems_impact.cli.output import Output, add_json_tables, show, show_table
from mems_impact.integrators.options import Options

if TYPE_CHECKING:
    import pandas as pd

    import mems_impact as mi

SHOWN_SPECIAL_POINTS = 10


@click.command(short_help="Compute a bifurcation diagram.")
@device_options
@click.argument("parameter")
@click.argument("low", type=QuantityType())
@click.argument("high", type=QuantityType())
@drive_options
@initial_option
@click.option(
    "--depth",
    type=click.IntRange(0),
    default=4,
    show_default=True,
    help="Number of successive switches to emanating branches.",
)
@click.option(
    "--points",
    type=click.IntRange(2, 100_000),
    default=61,
    show_default=True,
    help="Number of values at which attractors are sought.",
)
@click.option(
    "--starts",
    type=click.IntRange(0, 100_000),
    default=4,
    show_default=True,
    help="Number of initial states at each value, besides the default ones.",
)
@click.option(
    "--longest",
    type=click.IntRange(1),
    default=16,
    show_default=True,
    help="Longest period of a branch, in forcing periods.",
)
@store_option("FILE", "File in which finished branches are kept; the same command resumes from it.")
@orbit_integrator_options
@progress_option
@output_options
def command(
    *,
    device: str,
    changes: dict[str, float],
    parameter: str,
    low: float,
    high: float,
    initial: Initial,
    depth: int,
    points: int,
    starts: int,
    longest: int,
    store: str | None,
    options: Options,
    progress: bool,
    output: Callable[[str], Output],
) -> None:
    """Compute the bifurcation diagram of DEVICE over PARAMETER from LOW to HIGH.

    \b
    Examples:
      mems-impact diagram zhao2004 amplitude 0.16 0.30 --omega 0.5
      mems-impact diagram system.py:oscillator A 0.1 1.5 --depth 2

    Runs find the attractors, their orbits are continued both ways, and branches that emanate from
    period doublings, branch points and Hopf points in turn. The command shows the tree of the
    branches and the first special points, and writes branches, special points, attractors and their
    states on the section as CSV tables and the diagram as a figure.

    A system of your own can replace DEVICE: FILE.py:NAME or MODULE:NAME, whose Python code is run.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi
    from mems_impact.actuator.system import ActuatorSystem

    system, state = load_subject(device, changes, initial, {parameter: low})
    if isinstance(system, ActuatorSystem):
        parameter = symbol_of(parameter)
    with output("diagram") as files:
        try:
            diagram = mi.bifurcation_diagram(
                system,
                parameter,
                (low, high),
                depth=depth,
                values=points,
                starts=starts,
                longest=longest,
                store=store,
                initial=state,
                options=options,
                progress=progress,
            )
        except mi.Interrupted as interruption:
            if interruption.partial.branches:
                files.tables(_tables(interruption.partial))
            raise
        files.tables(_tables(diagram))
        files.draw(lambda: mi.plot_diagram(diagram).figure)
        add_json_tables({"branches": _summary(diagram)})
        special = diagram.special_table
        show(f"{diagram.tree}\n")
        few = special.reindex(columns=["label", "kind", "type", parameter, "branch"]).head(
            SHOWN_SPECIAL_POINTS
        )
        few.attrs = special.attrs
        show_table("points", few, digits=10)
        files.show()


def _tables(diagram: mi.BifurcationDiagram) -> dict[str, pd.DataFrame]:
    return {
        "branches": diagram.table,
        "points": diagram.special_table,
        "attractors": diagram.attractors,
        "cloud": diagram.cloud,
    }


def _summary(diagram: mi.BifurcationDiagram) -> pd.DataFrame:
    """Return a table with one row per branch."""
    import pandas as pd

    return pd.DataFrame(
        {
            "points": [len(branch) for branch in diagram.branches],
            "stable": [int(branch.table["stable"].sum()) for branch in diagram.branches],
            "parent": [-1 if parent is None else parent for parent in diagram.parents],
            "ended": [branch.ended for branch in diagram.branches],
        }
    )
