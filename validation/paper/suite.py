"""The suite: figures computed, statements judged, everything written."""

from __future__ import annotations

import contextlib
import csv
import io
import multiprocessing
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from mems_impact._util.files import replacing, unwritable
from mems_impact.errors import Interrupted, InvalidFile, InvalidParameter
from mems_impact.plotting.style import wearing
from mems_impact.studies.engine.executors import ignoring_ctrl_c
from validation.paper.figures import FIGURES, Devices, Effort
from validation.paper.report import summary, to_html, to_markdown
from validation.paper.statements import Judgement, Value, judge, load_statements

__all__ = ["Report", "changed_verdicts", "expected_verdicts", "run_suite"]


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
    figures: Sequence[int] = tuple(FIGURES),
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

    Raises
    ------
    InvalidParameter
        If the paper has no such figure to reproduce.
    InvalidFile, FileNotWritten
        If a file cannot be written.
    Interrupted
        At once on Ctrl-C; ``partial`` is the report of the finished figures.
    """
    devices = Devices() if devices is None else devices
    for number in figures:
        if number not in FIGURES:
            allowed = f"one of {', '.join(map(str, FIGURES))}"
            raise InvalidParameter("figure", number, allowed)
    here = None if output is None else Path(output)
    if here is not None:
        try:
            here.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise unwritable(here, error) from None
    done: dict[int, _Done] = {}
    interrupted = False
    try:
        drawn = here is not None
        with contextlib.closing(
            _computed(figures, devices, effort, drawn, min(processes, len(figures)))
        ) as results:
            for number, one in results:
                if here is not None:
                    _write(here, one.files)
                done[number] = one
                if progress is not None:
                    progress(number)
    except KeyboardInterrupt:
        interrupted = True
    report = _judged(done, effort, here)
    if interrupted:
        raise Interrupted("suite", f"{len(done)} of {len(figures)} figures", report)
    return report


def _judged(done: Mapping[int, _Done], effort: Effort, here: Path | None) -> Report:
    """Return the report of the figures that were computed, and write it."""
    numbers = sorted(done)
    values = {name: value for one in done.values() for name, value in one.values.items()}
    judged = tuple(
        judge(statement, values.get(statement.id))
        for statement in load_statements()
        if statement.figure in done
    )
    notes = {number: done[number].notes for number in numbers}
    written: tuple[str, ...] = ()
    if here is not None and done:
        files = _report_files(judged, notes, effort)
        _write(here, files)
        names = [name for number in numbers for name in done[number].files]
        written = tuple(str(here / name) for name in (*names, *files))
    return Report(judgements=judged, notes=notes, written=written)


def _write(here: Path, files: Mapping[str, bytes]) -> None:
    """Write files by their names, each whole or not at all."""
    for name, content in files.items():
        with replacing(here / name) as temporary:
            temporary.write_bytes(content)


class _Done(NamedTuple):
    """What comes back from a figure, maybe from another process."""

    values: dict[str, Value | None]
    notes: tuple[str, ...]
    files: dict[str, bytes]  # not written there, so that the process may be ended at any time


def _computed(
    figures: Sequence[int], devices: Devices, effort: Effort, drawn: bool, processes: int
) -> Generator[tuple[int, _Done], None, None]:
    """Compute figures, in other processes if there are to be several; give each when it is done."""
    # The figures that take longest stand last in the paper.
    latest_first = sorted(figures, reverse=True)
    if processes <= 1:
        for number in latest_first:
            yield number, _figure(number, devices, effort, drawn)
        return
    with _pool(processes) as executor:
        with ignoring_ctrl_c():
            waiting = {
                executor.submit(_figure, number, devices, effort, drawn): number
                for number in latest_first
            }
        for future in as_completed(waiting):
            yield waiting[future], future.result()


def _figure(number: int, devices: Devices, effort: Effort, drawn: bool) -> _Done:
    """Compute one figure, and draw it if that is wanted."""
    outcome = FIGURES[number](devices, effort)
    files: dict[str, bytes] = {}
    if not drawn:
        return _Done(outcome.values, outcome.notes, files)
    figure = outcome.draw()
    for suffix in ("png", "svg"):
        picture = io.BytesIO()
        with wearing():
            figure.savefig(picture, format=suffix)
        files[f"figure{number}.{suffix}"] = picture.getvalue()
    for name, table in outcome.tables.items():
        files[f"figure{number}-{name}.csv"] = table.to_csv(index=False).encode()
    return _Done(outcome.values, outcome.notes, files)


@contextlib.contextmanager
def _pool(processes: int) -> Iterator[ProcessPoolExecutor]:
    """Give a pool of processes that end at once where the block is left early.

    Left alone, an executor waits for the figures that are being computed, half a minute.
    """
    others = set(multiprocessing.active_children())
    # Spawned, since the threads of a parent do not survive a fork.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=context) as executor:
        try:
            yield executor
        except BaseException:
            for worker in set(multiprocessing.active_children()) - others:
                worker.kill()
            executor.shutdown(cancel_futures=True)
            raise


def _report_files(
    judged: Sequence[Judgement], notes: Mapping[int, tuple[str, ...]], effort: Effort
) -> dict[str, bytes]:
    """Return the verdicts and the report by the names of their files."""
    verdicts = io.StringIO()
    writer = csv.writer(verdicts)
    writer.writerow(("id", "paper", "computed", "difference", "verdict"))
    for j in judged:
        row = (j.statement.id, j.statement.value, j.computed, j.difference, j.verdict)
        writer.writerow(row)
    words = "quick, coarse sweeps" if effort.quick else "full"
    texts = {
        "verdicts.csv": verdicts.getvalue(),
        "report.md": to_markdown(judged, notes, words),
        "report.html": to_html(judged, notes, words),
    }
    return {name: text.encode() for name, text in texts.items()}


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
