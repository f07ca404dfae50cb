"""`mems-impact diagram`: the bifurcation diagram of a device or a system."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import click

from mems_impact.cli.arguments import Command, function_options
from mems_impact.cli.inputs import arguments_for, load_subject, symbol_for
from mems_impact.cli.options import device_options, drive_options, output_options
from mems_impact.cli.output import Output, add_json_tables, show, show_table
from mems_impact.cli.value_types import RangeType

if TYPE_CHECKING:
    import pandas as pd

    import mems_impact as mi

SHOWN_SPECIAL_POINTS = 10

FUNCTION = "mems_impact.studies.diagram_construction:bifurcation_diagram"


@click.command(cls=Command, short_help="Compute a bifurcation diagram.")
@device_options
@click.argument("axis", metavar="NAME=LOW:HIGH", type=RangeType())
@function_options(FUNCTION, omit=("parameter", "bounds", "recurrence"))
@drive_options
@output_options
def command(
    *,
    device: str,
    changes: dict[str, float],
    axis: tuple[str, float, float],
    output: Callable[[str], Output],
) -> None:
    """Compute the bifurcation diagram of DEVICE over a parameter.

    \b
    Examples:
      mems-impact diagram zhao2004 amplitude=0.16:0.30 --omega 0.5
      mems-impact diagram system.py:oscillator A=0.1:1.5 --depth 2

    Runs find the attractors, their orbits are continued both ways, and branches that emanate from
    period doublings, branch points and Hopf points in turn. The command shows the tree of the
    branches and the first special points, and writes branches, special points, attractors and their
    states on the section as CSV tables and the diagram as a figure.

    A system of your own can replace DEVICE: FILE.py:NAME or MODULE:NAME, whose Python code is run.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi

    parameter, low, high = axis
    system = load_subject(device, changes, {parameter: low})
    parameter = symbol_for(parameter, system)
    arguments = arguments_for(FUNCTION, system)
    with output("diagram") as files:
        try:
            diagram = mi.bifurcation_diagram(system, parameter, (low, high), **arguments)
        except mi.Interrupted as interruption:
            if interruption.partial.branches:
                files.tables(_tables(interruption.partial))
            raise
        files.tables(_tables(diagram))
        files.draw(lambda: mi.plot_diagram(diagram).figure)
        add_json_tables({"branches": _summary(diagram)})
        special = diagram.special_table
        show(f"{diagram.tree}\n")
        few = special.reindex(columns=["label", "kind", "type", parameter, "branch"])
        show_table("points", few.head(SHOWN_SPECIAL_POINTS), digits=10)
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
