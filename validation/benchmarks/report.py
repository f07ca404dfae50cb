"""The figures as a table on the screen, as CSV and as Markdown."""

from __future__ import annotations

import csv
from collections.abc import Mapping, Sequence
from pathlib import Path

from validation.benchmarks.timing import Row

HEADER = ("topic", "case", "quantity", "median", "min", "max", "unit", "target", "met", "note")


def line(row: Row) -> str:
    """One row for the screen."""
    mark = f"  [target {row.target}: {row.met}]" if row.target else ""
    return f"{row.topic:21} {row.case:29} {row.quantity:45} {row.value} {row.unit}{mark}"


def write(
    rows: Sequence[Row], machine: Mapping[str, str], directory: Path, settings: str
) -> tuple[Path, Path]:
    """Write ``benchmarks.csv`` and ``benchmarks.md``; their paths."""
    directory.mkdir(parents=True, exist_ok=True)
    table, page = directory / "benchmarks.csv", directory / "benchmarks.md"
    with table.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(HEADER)
        for row in rows:
            value = row.value
            writer.writerow(
                [
                    row.topic,
                    row.case,
                    row.quantity,
                    value.median,
                    value.low,
                    value.high,
                    row.unit,
                    row.target,
                    row.met,
                    row.note,
                ]
            )
    lines = ["# Benchmarks", "", f"Medians, with the extremes of all rounds. {settings}", ""]
    lines += [f"- {name}: {value}" for name, value in machine.items()]
    lines += [
        "",
        "| topic | case | quantity | median (min to max) | target | met | note |",
        "|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        value = f"{row.value} {row.unit}".strip()
        cells = (row.topic, row.case, row.quantity, value, row.target, row.met, row.note)
        lines.append(f"| {' | '.join(cells)} |")
    page.write_text("\n".join(lines) + "\n")
    return table, page
