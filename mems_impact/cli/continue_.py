"""`mems-impact continue`: a branch of periodic orbits over a parameter."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import click

from mems_impact.cli.arguments import Command, function_options
from mems_impact.cli.inputs import arguments_for, device_system
from mems_impact.cli.options import device_options, drive_options, output_options
from mems_impact.cli.output import Output, add_json_tables, filled, show, unit_of
from mems_impact.cli.runtime import warn
from mems_impact.cli.value_types import RangeType, symbol_of

if TYPE_CHECKING:
    import pandas as pd

    import mems_impact as mi

ORBIT = "mems_impact.studies.engine.config:orbit_from"
BRANCH = "mems_impact.analysis.branch:continue_solution"


@click.command(cls=Command, short_help="Continue a periodic orbit over a parameter.")
@device_options
@click.argument("axis", metavar="NAME=START:STOP", type=RangeType(ends="START:STOP"))
@function_options(ORBIT)
@function_options(BRANCH, omit=("parameter", "stop"))
@click.option("--doubled", is_flag=True, help="Also continue the period-doubled orbits.")
@drive_options
@output_options
def command(
    *,
    device: str,
    changes: dict[str, float],
    axis: tuple[str, float, float],
    doubled: bool,
    output: Callable[[str], Output],
) -> None:
    """Continue a periodic orbit of DEVICE, stable or unstable, over a parameter.

    \b
    Example:
      mems-impact continue zhao2004 amplitude=0.24:0.16 --omega 0.5

    A run from the initial state leads to the first orbit. The command shows the grazings (G),
    cyclic folds (CF) and period doublings (PD) on the branch, and writes branch and special points
    as CSV tables and a bifurcation diagram.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi
    from mems_impact.studies.engine.config import orbit_from

    parameter, start, stop = axis
    parameter = symbol_of(parameter)
    system = device_system(device, changes, {parameter: start})
    of_orbit = arguments_for(ORBIT, system)
    arguments = arguments_for(BRANCH, system)
    with output("continue") as files:
        orbit = orbit_from(system, **of_orbit)
        branch = mi.continue_solution(orbit, parameter, stop, **arguments)
        files.tables(_tables(branch))
        branches = [branch]
        unit = unit_of(branch.table, branch.table.columns[0])
        if doubled:
            for special in branch.special_points:
                if special.label == "PD":
                    try:
                        part = mi.switch_branch(special, progress=arguments["progress"])
                    except mi.OrbitError as error:
                        warn(f"period doubling at {special.value:.9g}{unit}: {error}")
                        continue
                    files.tables(_tables(part, f"-{len(branches)}"))
                    branches.append(part)
        files.draw(lambda: mi.plot_branch(branches).figure)
        add_json_tables({"branches": _summary(branches)})
        for part in branches:
            _show(part)
        files.show()


def _tables(branch: mi.Branch, end: str = "") -> dict[str, pd.DataFrame]:
    return {f"branch{end}": branch.table, f"points{end}": branch.special_table}


def _show(branch: mi.Branch) -> None:
    from mems_impact.continuation.sliding import TYPE_LABELS

    table = branch.table
    low, high = table.iloc[:, 0].min(), table.iloc[:, 0].max()
    unit = unit_of(table, table.columns[0])
    periods = branch.orbits[0].periods
    each = "one forcing period" if periods == 1 else f"{periods} forcing periods"
    show(
        filled(
            f"{len(branch)} orbits of {each}, {branch.parameter} "
            f"{low:.9g} to {high:.9g}{unit}, {int(table['stable'].sum())} stable; "
            f"{branch.ended}"
        )
    )
    width = max([3, *(len(special.label) + 1 for special in branch.special_points)])
    types = branch.special_table["type"]
    for special, kind in zip(branch.special_points, types, strict=True):
        side = f" ({_side(special)})" if special.label == "G" else ""
        if kind in TYPE_LABELS:  # by which the figure names it
            side = f" ({TYPE_LABELS[kind]}: {kind})"
        name = "" if special.label == special.kind else f" {special.kind}"
        show(f"  {special.label:<{width}}{special.value:.12g}{unit}{name}{side}")
    show("")


def _side(grazing: mi.SpecialPoint) -> str:
    """Return the type of a grazing, as the package and as the paper name it."""
    import mems_impact as mi

    try:
        kind = grazing.type
    except mi.OrbitError as error:
        return f"of no type: {error.reason}"
    assert isinstance(kind, mi.GrazingType)
    return f"{kind}: type {kind.paper}"


def _summary(branches: list[mi.Branch]) -> pd.DataFrame:
    """Return a table with one row per branch."""
    import pandas as pd

    return pd.DataFrame(
        {
            "periods": [branch.orbits[0].periods for branch in branches],
            "orbits": [len(branch) for branch in branches],
            "stable": [int(branch.table["stable"].sum()) for branch in branches],
            "ended": [branch.ended for branch in branches],
        }
    )
