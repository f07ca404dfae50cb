"""`mems-impact continue`: a branch of periodic orbits over a parameter."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import click

from mems_impact.cli.options import (
    Initial,
    QuantityType,
    actuator_from,
    device_options,
    drive_from,
    drive_options,
    guess_options,
    orbit_integrator_options,
    output_options,
    parameter_option,
    progress_option,
    range_options,
    refuse_system,
    state_from,
    symbol_of,
)
from mems_impact.cli.output import Output, add_json_tables, filled, show, unit_of
from mems_impact.cli.runtime import warn
from mems_impact.integrators.options import Options

if TYPE_CHECKING:
    import pandas as pd

    import mems_impact as mi


@click.command(short_help="Continue a periodic orbit over a parameter.")
@device_options
@parameter_option
@range_options(
    "Value at which the orbit is found, in the parameter's unit.", "Value at which the branch ends."
)
@click.option(
    "--back",
    type=QuantityType(),
    show_default="that of --start",
    help="Opposite bound, used if the branch folds back, in the parameter's unit.",
)
@drive_options
@guess_options
@click.option(
    "--through-grazing/--past-grazing",
    default=True,
    show_default=True,
    help="At a grazing, continue with one impact more or less, or continue past it with "
    "inadmissible orbits.",
)
@click.option(
    "--stop-at",
    multiple=True,
    metavar="LABEL",
    help="End the branch at its first special point with this label, such as G; repeatable.",
)
@click.option("--doubled", is_flag=True, help="Also continue the period-doubled orbits.")
@orbit_integrator_options
@progress_option
@output_options
def command(
    *,
    device: str,
    changes: dict[str, float],
    parameter: str,
    start: float,
    stop: float,
    back: float | None,
    initial: Initial,
    transient: float,
    periods: int | None,
    through_grazing: bool,
    stop_at: tuple[str, ...],
    doubled: bool,
    options: Options,
    progress: bool,
    output: Callable[[str], Output],
) -> None:
    """Continue a periodic orbit of DEVICE, stable or unstable, over a parameter.

    \b
    Example:
      mems-impact continue zhao2004 --parameter amplitude --start 0.24 \\
        --stop 0.16 --omega 0.5

    A run from the initial state leads to the first orbit. The command shows the grazings (G),
    cyclic folds (CF) and period doublings (PD) on the branch, and writes branch and special points
    as CSV tables and a bifurcation diagram.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi

    refuse_system(device)
    parameter = symbol_of(parameter)
    drive = drive_from({parameter: start})
    if parameter not in drive.names:
        changes = {**changes, parameter: start}
    actuator = actuator_from(device, changes)
    guess = state_from(initial, actuator)
    with output("continue") as files:
        orbit = mi.find_orbit(
            actuator, drive, guess=guess, periods=periods, transient=transient, options=options
        )
        branch = mi.continue_orbit(
            orbit,
            parameter,
            stop,
            back=back,
            through_grazing=through_grazing,
            stop_at=stop_at,
            progress=progress,
        )
        files.tables(_tables(branch))
        branches = [branch]
        unit = unit_of(branch.table, branch.table.columns[0])
        if doubled:
            for special in branch.special_points:
                if special.label == "PD":
                    try:
                        part = mi.switch_branch(special, progress=progress)
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
        kind = mi.grazing_type(grazing)
    except mi.InvalidParameter:
        return "of an orbit with impacts"
    except mi.OrbitError as error:
        return f"of no type: {error.reason}"
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
