"""`mems-impact sweep`: attractors while a parameter is varied slowly, up and down."""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice
from typing import TYPE_CHECKING

import click

from mems_impact.cli.arguments import Command, function_options
from mems_impact.cli.inputs import arguments_for, device_system, run_saving_partial, values_of_axis
from mems_impact.cli.options import device_options, drive_options, output_options
from mems_impact.cli.output import Output, add_json_tables, show, show_table, unit_of
from mems_impact.cli.value_types import RangeType, symbol_of

if TYPE_CHECKING:
    import pandas as pd

    from mems_impact.studies.sweep import Sweep
    from mems_impact.tables import ImpactChange

DIRECTION_WORDS = {"up": "increasing", "down": "decreasing"}
SHOWN_FAILURES = 3
SHOWN_ROWS = 5  # of each direction
# The screen leaves out the other statistics.
SHOWN_COLUMNS = ("impacts per period", "displacement per period", "mean speed")

FUNCTION = "mems_impact.studies.sweep:sweep"


@click.command(cls=Command, short_help="Sweep a parameter slowly, up and down.")
@device_options
@click.argument("axis", metavar="NAME=START:STOP:POINTS", type=RangeType(points=True))
@function_options(FUNCTION, omit=("parameter",), defaults={"direction": "both"})
@drive_options
@output_options
def command(
    *,
    device: str,
    changes: dict[str, float],
    axis: tuple[str, float, float, int],
    output: Callable[[str], Output],
) -> None:
    """Sweep a parameter of DEVICE or its voltage slowly, up and down.

    \b
    Example:
      mems-impact sweep zhao2004 amplitude=0.16:0.24:101 --omega 0.5

    Each value starts from the final state of the previous one. The sweep starts at rest upwards,
    and with a kick that strikes the stopper downwards. The command shows where the device switches
    on and off, and writes the velocities on the Poincaré section x2 = 0 as a CSV table and a
    figure, as in Fig. 4 of the paper.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi

    name, *ends = axis
    parameter = symbol_of(name)
    system = device_system(device, changes, {parameter: ends[0]})
    values = values_of_axis(system, parameter, ends)
    arguments = arguments_for(FUNCTION, system)
    with output("sweep") as files:
        sweep = run_saving_partial(
            lambda: mi.sweep(system, parameter, values, **arguments),
            lambda table: files.tables(_tables(table)),
        )
        files.tables(_tables(sweep.table))
        files.draw(lambda: mi.plot_sweep(sweep).figure)
        _show(sweep, files.written[1] if files.directory else "--json")
        files.show()


def _tables(table: pd.DataFrame) -> dict[str, pd.DataFrame]:
    from mems_impact.tables import sweep_summary

    return {"table": table, "summary": sweep_summary(table)}


def _show(sweep: Sweep, place: object) -> None:
    import pandas as pd

    from mems_impact.tables import impact_changes

    summary, parameter = sweep.statistics, sweep.parameter
    unit = unit_of(summary, parameter)
    changes = impact_changes(sweep.table)
    add_json_tables(
        {
            "summary": summary,
            "switches": pd.DataFrame(
                changes, columns=["direction", f"{parameter} before", parameter, "impacts begin"]
            ),
        }
    )
    show(_headline(changes, parameter, unit) + "\n")
    rows = _shown_rows(summary, {each.direction: each.after for each in changes})
    displayed = summary.loc[rows, [parameter, "direction", *SHOWN_COLUMNS]]
    show_table("summary", displayed, digits=6)
    if len(rows) < len(summary):
        show(f"{len(rows)} of {len(summary)} rows; all rows and columns: {place}")
    for direction, chain in summary.groupby("direction", sort=False):
        failed = chain[chain["status"] != "ok"]
        line = f"{DIRECTION_WORDS[str(direction)]} {parameter}: impacts at "
        line += f"{int(chain['impacting'].sum())} of {len(chain)} values"
        if len(failed):
            line += f", {len(failed)} failed"
        show(line)
        reasons = zip(failed[parameter], failed["status"], strict=True)
        for value, reason in islice(reasons, SHOWN_FAILURES):
            show(f"  failed at {value:.9g}{unit}: {reason}")
    show("")


def _headline(changes: list[ImpactChange], parameter: str, unit: str) -> str:
    """Return between which values the device switches on and off, as a sentence."""
    if not changes:
        return f"The device does not switch between the computed values of {parameter}."
    phrases = [
        f"{'on' if each.begins else 'off'} at {each.before:.9g} to {each.after:.9g}{unit} "
        f"({DIRECTION_WORDS[each.direction]})"
        for each in changes
    ]
    return f"{parameter}: {', '.join(phrases)}"


def _shown_rows(summary: pd.DataFrame, switch_values: dict[str, float]) -> list[int]:
    """Return the rows of a summary for a screen: ends and switch of each direction, and others."""
    if len(summary) <= 2 * SHOWN_ROWS:
        return list(summary.index)
    parameter = summary.columns[0]
    rows: list[int] = []
    for direction, chain in summary.groupby("direction", sort=False):
        last = len(chain) - 1
        chosen = {0, last}
        at = chain[parameter].tolist()
        if (value := switch_values.get(str(direction))) in at:
            chosen |= {max(at.index(value) - 1, 0), at.index(value)}
        spaced = (last * i // (SHOWN_ROWS - 1) for i in (2, 1, 3))
        for position in spaced:
            if len(chosen) < SHOWN_ROWS:
                chosen.add(position)
        rows += [int(chain.index[i]) for i in sorted(chosen)]
    return rows
