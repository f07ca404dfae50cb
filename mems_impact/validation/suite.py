"""The suite: figures computed, statements judged, everything written."""

from __future__ import annotations

import csv
import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from mems_impact.errors import InvalidFile, InvalidParameter
from mems_impact.validation.outcome import Devices, Effort, Outcome
from mems_impact.validation.report import summary, to_html, to_markdown
from mems_impact.validation.statements import Judgement, Value, judge, load_statements

__all__ = ["FIGURES", "Report", "changed_verdicts", "expected_verdicts", "run_suite"]

FIGURES = (2, 3, 4, 5, 6, 7)


@dataclass(frozen=True, kw_only=True)
class Report:
    """The verdicts of a run of the suite.

    Attributes
    ----------
    judgements : tuple of Judgement
        Of the figures that were run.
    notes : dict of int to tuple of str
        What there is to say besides, by the number of the figure.
    written : tuple of str
        The files.
    """

    judgements: tuple[Judgement, ...]
    notes: Mapping[int, tuple[str, ...]]
    written: tuple[str, ...] = ()

    @property
    def verdicts(self) -> dict[str, str]:
        """Verdict by the `id` of the statement."""
        return {j.statement.id: str(j.verdict) for j in self.judgements}

    def __str__(self) -> str:
        return summary(self.judgements)


def run_suite(
    figures: Sequence[int] = FIGURES,
    *,
    output: str | Path | None = None,
    effort: Effort = Effort(),  # noqa: B008 - immutable
    devices: Devices | None = None,
    processes: int = 1,
    progress: Callable[[int], None] | None = None,
) -> Report:
    """Compute figures, judge the statements about them, and write everything.

    Parameters
    ----------
    figures : sequence of int
        Their numbers in the paper.
    output : str or Path, optional
        Directory for figures (PNG and SVG), tables and verdicts (CSV) and the report (Markdown
        and HTML); created. Nothing is written without it.
    effort : Effort, optional
    devices : Devices, optional
        Those of the paper by default; with others, verdicts change.
    processes : int, optional
        How many figures are computed at the same time.
    progress : callable, optional
        Called with the number of each figure that is done.

    Returns
    -------
    Report
    """
    devices = Devices() if devices is None else devices
    for number in figures:
        if number not in FIGURES:
            allowed = f"one of {', '.join(map(str, FIGURES))}"
            raise InvalidParameter("figure", number, allowed)
    here = None if output is None else Path(output)
    if here is not None:
        here.mkdir(parents=True, exist_ok=True)
    done: dict[int, _Done] = {}
    with _pool(min(processes, len(figures))) as submit:
        # The figures that take longest stand last in the paper.
        waiting = {
            submit(_figure, number, devices, effort, here): number
            for number in sorted(figures, reverse=True)
        }
        for future in as_completed(waiting):
            done[waiting[future]] = future.result()
            if progress is not None:
                progress(waiting[future])
    numbers = sorted(done)
    values = {name: value for one in done.values() for name, value in one.values.items()}
    judged = tuple(
        judge(statement, values.get(statement.id))
        for statement in load_statements()
        if statement.figure in done
    )
    notes = {number: done[number].notes for number in numbers}
    written = [name for number in numbers for name in done[number].written]
    if here is not None:
        written += _write_report(here, judged, notes, effort)
    return Report(judgements=judged, notes=notes, written=tuple(written))


class _Done(NamedTuple):
    """What comes back from a figure, maybe from another process."""

    values: dict[str, Value | None]
    notes: tuple[str, ...]
    written: tuple[str, ...]


def _figure(number: int, devices: Devices, effort: Effort, directory: Path | None) -> _Done:
    """Compute one figure and write its files."""
    outcome: Outcome = import_module(f"mems_impact.validation.figure{number}").compute(
        devices, effort
    )
    written: list[Path] = []
    if directory is not None:
        figure = outcome.draw()
        for suffix in ("png", "svg"):
            written.append(directory / f"figure{number}.{suffix}")
            figure.savefig(written[-1], dpi=150)
        for name, table in outcome.tables.items():
            written.append(directory / f"figure{number}-{name}.csv")
            table.to_csv(written[-1], index=False)
    return _Done(outcome.values, outcome.notes, tuple(map(str, written)))


@contextmanager
def _pool(processes: int) -> Iterator[Callable[..., Future[_Done]]]:
    """Give what submits a figure: to other processes, or to be computed on the spot."""
    if processes > 1:
        # Spawned, since the threads of a parent do not survive a fork.
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(processes, mp_context=context) as executor:
            yield executor.submit
        return

    def at_once(function: Callable[..., _Done], *arguments: Any) -> Future[_Done]:
        future: Future[_Done] = Future()
        future.set_result(function(*arguments))
        return future

    yield at_once


def _write_report(
    here: Path,
    judged: Sequence[Judgement],
    notes: Mapping[int, tuple[str, ...]],
    effort: Effort,
) -> list[str]:
    """Write the verdicts and the report."""
    with open(here / "verdicts.csv", "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(("id", "paper", "computed", "difference", "verdict"))
        for j in judged:
            row = (j.statement.id, j.statement.value, j.computed, j.difference, j.verdict)
            writer.writerow(row)
    words = "quick, coarse sweeps" if effort.quick else "full"
    (here / "report.md").write_text(to_markdown(judged, notes, words), encoding="utf-8")
    (here / "report.html").write_text(to_html(judged, notes, words), encoding="utf-8")
    return [str(here / name) for name in ("verdicts.csv", "report.md", "report.html")]


def expected_verdicts(path: str | Path) -> dict[str, str]:
    """Read the verdicts of an earlier run (``verdicts.csv``, or a file of its form)."""
    remedy = "give a table with the columns id and verdict, such as verdicts.csv of a run"
    try:
        with open(path, newline="", encoding="utf-8") as file:
            return {row["id"]: row["verdict"] for row in csv.DictReader(file)}
    except OSError as error:
        raise InvalidFile(path, f"cannot be read ({error.strerror})", remedy) from None
    except (KeyError, ValueError, csv.Error):
        raise InvalidFile(path, "holds no verdicts", remedy) from None


def changed_verdicts(report: Report, expected: Mapping[str, str]) -> list[str]:
    """Return in words which verdicts are not the expected ones."""
    lines = []
    for name, verdict in report.verdicts.items():
        if name not in expected:
            lines.append(f"{name}: {verdict}, was not there")
        elif verdict != expected[name]:
            lines.append(f"{name}: {verdict}, was: {expected[name]}")
    return lines
