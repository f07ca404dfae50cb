"""Rows of the benchmarks on the screen and as a CSV file, which the documentation shows."""

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


def write(rows: Sequence[Row], conditions: Mapping[str, str], path: Path) -> None:
    """Write the conditions and the rows."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(HEADER)
        for name, value in conditions.items():
            writer.writerow(("conditions", "", name, value, *[""] * 6))
        for row in rows:
            numbers = [f"{x:.3g}" for x in (row.value.median, row.value.low, row.value.high)]
            texts = (row.unit, row.target, row.met, row.note)
            writer.writerow((row.topic, row.case, row.quantity, *numbers, *texts))
