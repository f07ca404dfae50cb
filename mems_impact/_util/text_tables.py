"""Tables in text files as instruments and spreadsheets write them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.quantities import base_powers
from mems_impact.errors import InvalidFile

BYTE_ORDER_MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
SEPARATORS = re.compile(r"\s*[;\t]\s*|\s+")  # beside decimal commas
DECIMAL = re.compile(r"[\"']?[-+\N{MINUS SIGN}]?\d*(,\d+)?([eE][-+]?\d+)?[\"']?")
CELLS = re.compile(r"[,;\t]")
INCREMENT = re.compile(r"sampl\w+ (interval|period)|increment|x_?inc|hresolution", re.IGNORECASE)
START = re.compile(r"start|x_?org|hoffset", re.IGNORECASE)
INSTANT = re.compile(r"\d{4}-\d\d-\d\d|\d\d?[./-]\w+[./-]\d\d|\d\d?:\d\d")
UNIT = re.compile(r"[\[(]\s*([^\])]*?)\s*[\])]\s*$|\bin\s+(\S+)$")
UNIT_WORDS = {
    "seconds": "s", "second": "s", "sec": "s", "volts": "V", "volt": "V",
    "milli": "m", "micro": "u", "nano": "n", "pico": "p", "kilo": "k",
}  # fmt: skip
"""Units and prefixes in words, as oscilloscopes write them."""
SETTING_CELLS = 3  # name, value and unit of a setting, beside the numbers of a line
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


def with_times(lines: Sequence[str], source: str) -> list[str]:
    """Return the lines of a table with its times, and without settings beside its numbers.

    Some instruments write numbers of samples, or nothing, in place of times, and the increment of
    the times above. Raises InvalidFile if there is one column without an increment, or dates stand
    in place of times.
    """
    if lines and _after_setting(lines[0]) != lines[0]:
        lines = [_after_setting(line) for line in lines]
    rows = [_cells(line) for line in lines]
    begin, width = _first_numbers(rows)
    if not width:
        for i, row in enumerate(rows, start=1):
            if INSTANT.match(row[0]) and number_of(row[-1]) is not None:
                reason = f"line {i} begins with {row[0]}, a date or a time of day"
                raise InvalidFile(source, reason, "replace it by seconds")
        return list(lines)
    increment, start = _setting(INCREMENT, rows[:begin]), _setting(START, rows[:begin]) or 0.0
    above = rows[:begin][-2:]
    numbered = bool(above) and {"start", "increment"} <= {cell.lower() for cell in above[0]}
    if not numbered and width > 1:
        return list(lines)
    if increment is None:
        reason = f"from line {begin + 1} on has no times, and no sampling interval above"
        raise InvalidFile(source, reason, "add a column of times")
    values = [[cell for cell in row if cell][numbered:] for row in rows[begin:] if any(row)]
    heads = [["Time [s]", above[-1][-1] if above else "1"]]
    if numbered:
        heads = [[name, *row[1:width]] for name, row in zip(("Time", "s"), above, strict=True)]
    times = [[repr(start + i * increment)] for i in range(len(values))]
    return [";".join(row) for row in (*heads, *map(list.__add__, times, values))]


def with_headings(lines: Sequence[str]) -> list[str]:
    """Return the lines of a table below a heading ``t [unit];name [unit];…``, as far as given."""
    rows = [_cells(line) for line in lines]
    begin, width = _first_numbers(rows)
    named = [row for row in rows[:begin] if len(row) == width and all(row)][-2:]
    units = [[short_unit(cell) for cell in row] for row in named]
    if named and not all(units[-1]):
        named = named[-1:]
        units = [[short_unit(cell) if UNIT.search(cell) else "" for cell in named[0]]]
    names = named[0] if named else [str(i) for i in range(width)]
    names = ["t", *(UNIT.sub("", name).strip() for name in names[1:])]
    pairs = zip(names, units[-1] if units else [""] * width, strict=True)
    heading = ";".join(f"{name} [{unit}]" if unit else name for name, unit in pairs)
    return [heading, *(";".join(filter(None, row)) for row in rows[begin:])]


def _cells(line: str) -> list[str]:
    """Return the cells of a line, without empty ones at its end."""
    cells = [cell.strip(" #\t\"'") for cell in CELLS.split(line)]
    while len(cells) > 1 and not cells[-1]:
        cells.pop()
    return cells


def _first_numbers(rows: Sequence[Sequence[str]]) -> tuple[int, int]:
    """Return the first line of numbers, and how many it has; 0 if there is none."""
    for i, row in enumerate(rows):
        numbers = [number_of(cell) for cell in row if cell]
        if numbers and None not in numbers:
            return i, len(numbers)
    return len(rows), 0


def _setting(name: re.Pattern[str], rows: Sequence[Sequence[str]]) -> float | None:
    """Return the number beside the name of a setting, or below it; None if there is none."""
    for row, below in zip(rows, [*rows, ()][1:], strict=True):
        for i, cell in enumerate(row):
            for near in (*row[i + 1 : i + 2], *below[i : i + 1]) if name.match(cell) else ():
                number = number_of(near.rpartition(":")[2])
                if number is not None:
                    return number
    return None


def _after_setting(line: str) -> str:
    """Return a line without name, value and unit of a setting before two numbers."""
    cells = _cells(line)
    numbers = cells[SETTING_CELLS:]
    is_setting = bool(cells[0]) and number_of(cells[0]) is None and len(numbers) == 2
    return ";".join(numbers) if is_setting and None not in map(number_of, numbers) else line


def short_unit(heading: str) -> str:
    """Return the unit of a heading such as "time [ms]", "U in mV" or "Volt"; "" for none."""
    found = UNIT.search(heading)
    unit = (found[1] or found[2] or "") if found else heading
    for word, short in UNIT_WORDS.items():
        unit = re.sub(word, short, unit, flags=re.IGNORECASE)
    try:
        return unit if base_powers(unit) else ""
    except KeyError:
        return ""


def number_of(cell: str) -> float | None:
    """Return a number, which may have quotes and the sign U+2212; None for a text."""
    try:
        return float(cell.strip("\"'").replace("\N{MINUS SIGN}", "-"))
    except ValueError:
        return None


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
