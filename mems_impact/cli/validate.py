"""`mems-impact validate`: the paper against the code."""

from __future__ import annotations

from pathlib import Path

import click

from mems_impact.cli.options import directory_options, progress_option, workers_option
from mems_impact.cli.output import OutputValue, show, tell_values
from mems_impact.cli.runtime import FAILED, say


@click.command(short_help="Reproduce the paper, figure by figure, with verdicts.")
@click.argument("figures", type=int, nargs=-1, metavar="[FIGURE]...")
@click.option("--quick", is_flag=True, help="Coarse: under a minute for all.")
@directory_options("out/validation", "Where figures, tables and the report go")
@click.option(
    "--expect",
    type=click.Path(dir_okay=False),
    metavar="FILE",
    help="Fail if a verdict is not the one in this table (verdicts.csv of an earlier run).",
)
@workers_option("Processes.", default=2)
@progress_option
@click.pass_context
def command(
    ctx: click.Context,
    *,
    figures: tuple[int, ...],
    quick: bool,
    output: str,
    expect: str | None,
    workers: int,
    progress: bool,
) -> None:
    """Compute the figures of Zhao et al. (2004) and judge what the paper states about them.

    FIGURE is the number of a figure of the paper, 2 to 7; without one, all are computed.

    Writes the figures (PNG and SVG), tables (CSV) and one report (HTML and Markdown) in which each
    statement of the paper stands beside the computed value and a verdict, by rules that were
    written before the run. Differences are no failure: they are what the report is for.

    \b
    Example:
      mems-impact validate 4 --quick
    """  # noqa: D301 - click looks for the backspace itself
    from mems_impact.cli.output import Output
    from mems_impact.paper.outcome import Effort
    from mems_impact.paper.suite import (
        FIGURES,
        SuiteInterrupted,
        changed_verdicts,
        expected_verdicts,
        run_suite,
    )

    wanted = sorted(set(figures)) or list(FIGURES)
    expected = None if expect is None else expected_verdicts(expect)
    with Output(output, None, True, "validate") as files:
        try:
            report = run_suite(
                wanted,
                output=output,
                effort=Effort(quick=quick, workers=workers),
                processes=workers,
                progress=(lambda number: say(f"figure {number} done")) if progress else None,
            )
        except SuiteInterrupted as stop:
            files.written += map(Path, stop.report.written)
            raise
        files.written += map(Path, report.written)
        tell_values({name: OutputValue(verdict) for name, verdict in report.verdicts.items()})
        show(str(report))
        show(f"{files.said()}; read {output}/report.md first")
    if expected is not None:
        changes = changed_verdicts(report, expected)
        if changes:
            say(f"verdicts changed: {'; '.join(changes)}")
            ctx.exit(FAILED)
        show(f"no verdict differs from {expect}")
