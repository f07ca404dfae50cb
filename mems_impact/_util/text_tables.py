"""Tables in text files as instruments and spreadsheets write them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mems_impact._util.arrays import Floats

__all__ = ["EvenTimes", "decoded", "even_times", "with_points"]

BYTE_ORDER_MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
SEPARATORS = re.compile(r"\s*[;\t]\s*|\s+")  # beside decimal commas
DECIMAL = re.compile(r"[\"']?[-+\N{MINUS SIGN}]?\d*(,\d+)?([eE][-+]?\d+)?[\"']?")
TRIED_LINES = 200
SAME_SPACING_RTOL = 1e-6
MOST_SPACINGS = 4  # of rounded times that are equally spaced: two in each decade of the numbers


def decoded(raw: bytes) -> str:
    """Return the text of a file: UTF-8 or UTF-16, else Latin text of Windows."""
    for mark, encoding in BYTE_ORDER_MARKS.items():
        if raw.startswith(mark):
            return raw.decode(encoding, errors="replace")
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError:
        return raw.decode("cp1252", errors="replace")


def with_points(lines: Sequence[str]) -> list[str]:
    """Return the lines with decimal points and semicolons if their commas are decimal commas."""
    tried = [SEPARATORS.split(line.strip(" ;\t")) for line in lines if re.match(r"\W*\d", line)]
    tried = tried[:TRIED_LINES]
    numbers = [row for row in tried if len(row) > 1 and all(map(DECIMAL.fullmatch, row))]
    if 2 * len(numbers) <= len(tried) or not any("," in cell for row in numbers for cell in row):
        return list(lines)
    found = []
    for line in lines:
        cells = SEPARATORS.split(line.strip())
        numeric = all(map(DECIMAL.fullmatch, cells))
        points = ";".join(cell.replace(",", ".") for cell in cells)
        found.append(points if numeric else line.replace("\t", ";"))
    return found


class EvenTimes(NamedTuple):
    """Equally spaced times, and their largest distance from the given ones."""

    times: Floats
    spacing: float
    deviation: float


def even_times(times: Sequence[float]) -> EvenTimes | None:
    """Return the equally spaced times whose rounded values are given; None if there are none.

    Differences of such values take two values that differ by a unit of the last digit.
    """
    given = np.asarray(times, dtype=np.float64)
    gaps = np.diff(given)
    if gaps.size < 2 or gaps.min() < 0.0 or gaps.max() <= 0.0:
        return None
    resolution = SAME_SPACING_RTOL * float(gaps.max())
    spacings = np.unique(np.round(gaps / resolution))
    unit = float(np.ptp(gaps))
    if unit <= resolution or spacings.size > MOST_SPACINGS:
        return None
    spacing, start = np.polyfit(np.arange(given.size), given, 1)
    even = start + spacing * np.arange(given.size)
    deviation = float(np.abs(even - given).max())
    if deviation > unit or spacing <= 0.0:
        return None
    return EvenTimes(even - even[0] + given[0], float(spacing), deviation)
