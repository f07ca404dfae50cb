"""Tables of outside suites: of all cases of one, and the summary that the documentation shows."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

from validation.outside.case import FAILED, PASSED, REFUSED, Result

__all__ = ["SUMMARY", "record", "row", "summary", "write"]

SUMMARY = Path(__file__).with_name("results.csv")
HEADER = ("suite", "commit", "group", "cases", "passed", "failed", "refused")


def row(result: Result) -> tuple[str, ...]:
    """Return the line of a case."""
    error = f"{result.error:.2g}" if result.verdict != REFUSED else ""
    return result.case.group, result.case.name, result.verdict, error, result.note


def write(results: Iterable[Result], path: Path) -> None:
    """Write the lines of all cases."""
    path.parent.mkdir(parents=True, exist_ok=True)
    _write(path, [("group", "case", "verdict", "error in tolerances", "note"), *map(row, results)])


def summary(suite: str, commit: str, results: Sequence[Result]) -> list[tuple[str, ...]]:
    """Return a line for each group: counts, and the reasons of refusals with theirs."""
    lines = []
    for group in dict.fromkeys(result.case.group for result in results):
        members = [result for result in results if result.case.group == group]
        counts = Counter(result.verdict for result in members)
        reasons = Counter(result.note for result in members if result.verdict == REFUSED)
        refused = "; ".join(f"{count} {reason}" for reason, count in reasons.most_common())
        numbers = len(members), counts[PASSED], counts[FAILED]
        lines.append((suite, commit, group, *map(str, numbers), refused))
    return lines


def record(suite: str, lines: Sequence[tuple[str, ...]]) -> None:
    """Replace the lines of a suite in the summary."""
    others = []
    if SUMMARY.exists():
        with SUMMARY.open(newline="") as file:
            others = [tuple(line) for line in csv.reader(file) if line[0] not in (suite, HEADER[0])]
    _write(SUMMARY, [HEADER, *sorted([*others, *lines])])


def _write(path: Path, lines: Iterable[Sequence[str]]) -> None:
    with path.open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(lines)
