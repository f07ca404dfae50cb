"""`mems-impact show`: the state of a stored study, running, finished or interrupted."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from mems_impact.cli.options import figure_options
from mems_impact.cli.output import (
    OutputValue,
    add_json_tables,
    add_json_values,
    show,
    show_table,
    with_unit_column,
    with_units_in,
)

if TYPE_CHECKING:
    import pandas as pd

    import mems_impact as mi

SHOWN_REASONS = 5
LONGEST_REASON = 60  # characters of why points failed, to fit a line


@click.command(short_help="Show progress and results of a stored study.")
@click.argument("store", type=click.Path())
@click.option(
    "--output",
    type=click.Path(),
    metavar="DIR",
    help="Directory for table and figure; created if needed.",
)
@figure_options
def command(*, store: str, output: str | None, figure: str | None, no_figure: bool) -> None:
    """Show finished points, failures and ranges of the columns of the study stored in STORE.

    \b
    Example (after the example of "mems-impact map --help"):
      mems-impact show out/map --output out

    The study may be running. With --output, the finished points are written as a CSV table and a
    figure, if its kind of study has one.
    """  # noqa: D301 - click looks for the backspace itself
    import mems_impact as mi
    from mems_impact.cli.output import Output

    study = mi.load(store)
    if figure is not None and not study.figure:
        raise click.UsageError(f"--figure: a study of the kind {study.kind} has no figure")
    directory = output or (None if figure is None else str(Path(figure).parent))
    if directory is None:
        _show(study)
        return
    with Output(directory, figure, no_figure or not study.figure, "show") as files:
        if output is not None:
            files.tables({"table": study.table})
        if study.done > 0:
            files.draw(lambda: study.draw().figure)
        _show(study)
        files.show()


def _show(study: mi.StoredStudy) -> None:
    share = study.done / study.total if study.total else 1.0
    show(f"{study.kind}: {study.done} of {study.total} points ({share:.0%}), {study.failed} failed")
    values = {name: getattr(study, name) for name in ("kind", "done", "total", "failed")}
    add_json_values({name: OutputValue(value) for name, value in values.items()})
    reasons = study.table["status"].value_counts()
    for reason, rows in reasons[reasons.index != "ok"].head(SHOWN_REASONS).items():
        show(f"  {rows} failed: {_cut(str(reason))}")
    if study.done > 0:
        show("")
        ranges, units = _ranges(study.table), study.table.attrs.get("units", {})
        add_json_tables({"ranges": with_unit_column(ranges, "column", units)})
        show_table("ranges", with_units_in(ranges, "column", units), digits=6)


def _cut(reason: str) -> str:
    return reason if len(reason) <= LONGEST_REASON else reason[: LONGEST_REASON - 1] + "…"


def _ranges(table: pd.DataFrame) -> pd.DataFrame:
    """Return one row per numeric column: smallest value, median, largest value and count."""
    import pandas as pd

    numbers = table.select_dtypes("number")
    return pd.DataFrame(
        {
            "column": list(numbers),
            "min": numbers.min().to_numpy(dtype=float),
            "median": numbers.median().to_numpy(dtype=float),
            "max": numbers.max().to_numpy(dtype=float),
            "numbers": numbers.count().to_numpy(),
        }
    )
