"""The suite: figures computed, statements judged, everything written."""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from mems_impact.errors import InvalidFile, InvalidParameter
from mems_impact.validation.outcome import Devices, Effort, Outcome
from mems_impact.validation.report import summary, to_html, to_markdown
from mems_impact.validation.statements import Judgement, judge, load_statements

__all__ = ["FIGURES", "Report", "changed_verdicts", "expected_verdicts", "run_suite"]

FIGURES = (2, 3, 4, 5, 6, 7)


@dataclass(frozen=True, kw_only=True)
class Report:
    """The verdicts of a run of the suite.

    Attributes
    ----------
    judgements : tuple of Judgement
        Of the figures that were run.
    outcomes : dict of int to Outcome
        By the number of the figure.
    effort : Effort
    """

    judgements: tuple[Judgement, ...]
    outcomes: Mapping[int, Outcome]
    effort: Effort

    @property
    def verdicts(self) -> dict[str, str]:
        """Verdict by the `id` of the statement."""
        return {j.statement.id: str(j.verdict) for j in self.judgements}

    def __str__(self) -> str:
        return summary(self.judgements)

    def write(self, directory: str | Path) -> list[Path]:
        """Write figures (PNG and SVG), tables and verdicts (CSV) and the report (MD and HTML)."""
        here = Path(directory)
        here.mkdir(parents=True, exist_ok=True)
        written: list[Path] = []
        for number, outcome in self.outcomes.items():
            figure = outcome.draw()
            for suffix in ("png", "svg"):
                written.append(here / f"figure{number}.{suffix}")
                figure.savefig(written[-1], dpi=150)
            for name, table in outcome.tables.items():
                written.append(here / f"figure{number}-{name}.csv")
                table.to_csv(written[-1], index=False)
        written.append(here / "verdicts.csv")
        with open(written[-1], "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(("id", "paper", "computed", "difference", "verdict"))
            for j in self.judgements:
                row = (j.statement.id, j.statement.value, j.computed, j.difference, j.verdict)
                writer.writerow(row)
        effort = "quick, coarse sweeps" if self.effort.quick else "full"
        for name, text in (
            ("report.md", to_markdown(self.judgements, self.outcomes, effort)),
            ("report.html", to_html(self.judgements, self.outcomes, effort)),
        ):
            written.append(here / name)
            written[-1].write_text(text, encoding="utf-8")
        return written


def run_suite(
    figures: Sequence[int] = FIGURES,
    *,
    effort: Effort = Effort(),  # noqa: B008 - immutable
    devices: Devices | None = None,
    progress: Callable[[int], None] | None = None,
) -> Report:
    """Compute figures and judge the statements about them.

    Parameters
    ----------
    figures : sequence of int
        Their numbers in the paper.
    effort : Effort, optional
    devices : Devices, optional
        Those of the paper by default; with others, verdicts change.
    progress : callable, optional
        Called with the number of each figure before it is computed.

    Returns
    -------
    Report
    """
    devices = Devices() if devices is None else devices
    outcomes: dict[int, Outcome] = {}
    for number in figures:
        if number not in FIGURES:
            allowed = f"one of {', '.join(map(str, FIGURES))}"
            raise InvalidParameter("figure", number, allowed)
        if progress is not None:
            progress(number)
        module = import_module(f"mems_impact.validation.figure{number}")
        outcomes[number] = module.compute(devices, effort)
    values = {name: value for one in outcomes.values() for name, value in one.values.items()}
    judged = tuple(
        judge(statement, values.get(statement.id))
        for statement in load_statements()
        if statement.figure in outcomes
    )
    return Report(judgements=judged, outcomes=outcomes, effort=effort)


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
