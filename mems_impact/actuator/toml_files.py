"""TOML files of users, and Python code that they name."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from mems_impact._util.files import file_path, opened
from mems_impact._util.formatting import shown
from mems_impact._util.quantities import QuantityError, base_powers, magnitude
from mems_impact._util.text_tables import (
    UNIT_WORDS,
    decoded,
    number_of,
    with_points,
    with_times,
)
from mems_impact.errors import InvalidFile, InvalidParameter

# --- Python code named by a file


class CodeRequest(NamedTuple):
    """Context of Python code that a file names."""

    field: str  # name of the entry
    description: str  # expected code: "Python file with functions …"
    kind: str  # of the file: "drive file"
    reader: str  # function that reads the file


def resolve_code_path(source: Any, file: Path, allowed: bool, request: CodeRequest) -> Path:
    """Return the path of the Python file `source` that `file` names, if it may be executed.

    Raises InvalidParameter if `source` does not name a Python file, InvalidFile if code is not
    allowed, or the resolved path does not exist or lies outside the folder of `file`.
    """
    field, description, kind, reader = request
    if not isinstance(source, str) or not source.endswith(".py"):
        raise InvalidParameter(field, source, f"a {description}")
    entry = f"{field} = {shown(source)}"
    if not allowed:
        reason = f"names Python code, {entry}, which would be executed"
        remedy = f"read it, then allow it (--allow-code, or allow_code=True in {reader})"
        raise InvalidFile(file, reason, remedy)
    try:
        path = (file.parent / source).resolve()
        inside = path.is_relative_to(file.parent.resolve())
    except (OSError, RuntimeError, ValueError) as error:  # links in a circle, a null character
        raise InvalidFile(
            file, f"{entry} is not a path ({error})", f"give a {description}"
        ) from None
    if not inside:
        reason = f"{entry} lies outside the folder of the {kind}"
        raise InvalidFile(file, reason, "read it, then copy it into that folder")
    if not path.is_file():
        raise InvalidFile(path, "no such file", f"give a {description}")
    return path


def execute_code(path: Path, request: CodeRequest) -> ModuleType:
    """Execute a Python file and return it as a module; InvalidFile if it fails."""
    # Not imported: two files may have the same name, and cached bytecode may differ from the text.
    module = ModuleType(f"mems_impact_{request.field}_{path.stem}")
    module.__file__ = str(path)
    try:
        exec(compile(path.read_bytes(), str(path), "exec", dont_inherit=True), vars(module))
    except (Exception, SystemExit) as error:
        reason = f"fails ({type(error).__name__}: {error})"
        raise InvalidFile(path, reason, f"give a {request.description}") from None
    return module


# --- Files of users

_SEPARATOR = re.compile(r"\s*[,;\t]\s*|\s+")
_BEGINS_AS_NUMBER = re.compile(r"[\W_]*\d|[\W_]+[,;\t\s].*\d")
_MAX_TABLE_BYTES = 50_000_000  # bytes
_MAX_NESTING = 20  # levels of nested tables; a burst within a burst takes one more
_NAME = r"""(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+"""
_DEEP_NAME = re.compile(
    rf"(?:^|[\[{{,])[ \t]*+{_NAME}(?:\.[ \t]*+{_NAME}){{{_MAX_NESTING}}}", re.MULTILINE
)


MAX_FILE_BYTES = 10_000_000  # bytes of a file that users write


def read_bytes(
    source: str,
    remedy: str,
    *,
    largest: int = MAX_FILE_BYTES,
    kind: str,
    missing: str = "no such file",
) -> bytes:
    """Return the content of the file `source`, a `kind` of at most `largest` bytes."""
    with opened(source, remedy, missing) as file:
        raw = file.read(largest + 1)
    if len(raw) > largest:
        raise InvalidFile(source, f"too large for a {kind}", remedy)
    return raw


def read_text(raw: bytes, source: str) -> str:
    """Return `raw` as text."""
    try:
        # Editors on Windows write a byte order mark, which is not allowed in TOML.
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        reason = f"not UTF-8 text (byte {error.start})"
        raise InvalidFile(source, reason, "save it as UTF-8") from None


def parse_toml(raw: bytes, source: str, remedy: str) -> dict[str, Any]:
    """Return the tables of a TOML file."""
    text = read_text(raw, source)
    try:
        # The parser's memory grows with the square of the number of dots in a name.
        content = None if _DEEP_NAME.search(text) else tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        # Very long integers and deep nesting raise errors other than TOMLDecodeError.
        reason = f"not valid TOML ({str(error).splitlines()[0]})"
        raise InvalidFile(source, reason, f"correct it: {remedy}") from None
    if content is None or _deeper_than(_MAX_NESTING, content):
        reason = f"nests tables more than {_MAX_NESTING} deep"
        raise InvalidFile(source, reason, f"correct it: {remedy}")
    return content


def _deeper_than(depth: int, content: Any) -> bool:
    """Return whether tables and lists are nested more than `depth` deep."""
    level = [content]
    for _ in range(depth):
        holders = [one.values() if isinstance(one, dict) else one for one in level]
        level = [one for each in holders for one in each if isinstance(one, dict | list)]
    return bool(level)


def read_columns(
    path: str | PathLike[str],
    count: int,
    units: Sequence[Sequence[str]] = (),
    channel: int | str | None = None,
) -> list[list[float]]:
    """Return the `count` columns of numbers in a text file.

    Columns are separated by comma, semicolon, tab or blanks; beside other separators, commas may be
    decimal commas. Of a file with further columns, `channel` is the last one of two, by its heading
    or by its number, 1 after the times. Lines that begin with # are skipped, as are headings and
    settings of an oscilloscope above the numbers, or beside the first of them. A line above the
    numbers with as many cells is an error if it begins with a digit.

    With `units`, the SI units that each column may have, numbers are converted to SI if a heading
    or comment above them has their units, such as "time [ms]", "(mV)" or "x/um".
    """
    source = file_path(path, "the path of a file of numbers")
    remedy = f"give a text file of {count} columns of numbers"
    raw = read_bytes(source, remedy, largest=_MAX_TABLE_BYTES, kind="table")
    columns: list[list[float]] = [[] for _ in range(count)]
    factors = [1.0] * count
    above = True
    lines = with_points([line.strip() for line in decoded(raw).splitlines()])
    lines = with_times(lines, source)
    if units and count == 2:
        lines = two_columns(lines, channel, source)
    for number, line in enumerate(lines, start=1):
        if above and units:
            factors = _heading_factors(line, units, factors, f"line {number}", source)
        if not line or line.startswith("#"):
            continue
        cells = [cell for cell in _SEPARATOR.split(line) if cell]
        values = [number_of(cell) for cell in cells]
        above = above and (not values or values[0] is None)
        if above:
            if len(cells) == count and _BEGINS_AS_NUMBER.match(line):
                reason = f"line {number} holds {shown(cells[0])}, which is not a number"
                raise InvalidFile(source, reason, "correct it, or begin a heading with #")
            continue
        if len(cells) != count:
            reason = f"line {number} holds {len(cells)} columns, not {count}"
            if len(cells) == 2 * count and "." not in line:
                remedy = "separate columns by semicolons, if the commas are decimal commas"
            raise InvalidFile(source, reason, remedy)
        for column, cell, value in zip(columns, cells, values, strict=True):
            if value is None or not math.isfinite(value):
                reason = f"line {number} holds {shown(cell)}, which is not a finite number"
                raise InvalidFile(source, reason, remedy)
            column.append(value)
    if above:
        raise InvalidFile(source, "no line begins with a number", remedy)
    return [
        [scaled_once(value, factor) for value in column]
        for column, factor in zip(columns, factors, strict=True)
    ]


def two_columns(lines: list[str], channel: int | str | None, source: str) -> list[str]:
    """Return the lines with the first column and that of a channel."""
    split = ([cell for cell in _SEPARATOR.split(line) if cell] for line in lines)
    width = next((len(row) for row in split if len(row) > 1 and all(map(_is_number, row))), 2)
    if width == 2 and channel is None:
        return lines
    rows = [[cell for cell in _SEPARATOR.split(line) if cell] for line in lines]
    numeric = [len(row) > 1 and all(map(_is_number, row)) for row in rows]
    cells = [[cell.strip(" #\t\"'") for cell in re.split("[,;\t]", line)] for line in lines]
    named = [own for own, row in zip(cells, numeric, strict=True) if len(own) == width and not row]
    headings: list[str] = next((own for own in reversed(named) if all(own)), [])
    names = headings or [str(i) for i in range(width)]
    numbers = {name: i for i, name in enumerate(names)}
    numbers |= {name.split("[")[0].split("(")[0].strip(): i for name, i in numbers.items()}
    place = channel if isinstance(channel, int) else numbers.get(str(channel), 0)
    if not 0 < place < width:
        given = f"{', '.join(names[1:])}" if headings else f"1 to {width - 1}"
        if channel is None:
            if width == 4 and not any("." in line for line in lines):
                return lines  # perhaps of decimal commas, see `read_columns`
            raise InvalidFile(source, f"holds {width} columns", f"give channel=, one of {given}")
        raise InvalidParameter("channel", channel, f"one of {given}", source)
    found = []
    for line, own, row, is_row in zip(lines, cells, rows, numeric, strict=True):
        pair = row if is_row and len(row) == width else own if len(own) == width else []
        found.append(f"{pair[0]};{pair[place]}" if pair and any(pair) else line)
    return found


def scaled_once(value: float, factor: float) -> float:
    """Return a value times the factor of a unit, rounded once for a prefix such as micro."""
    return value * factor if factor >= 1.0 else value / round(1.0 / factor, 9)


_IN_BRACKETS = re.compile(r"[\[(]\s*([^\])]*?)\s*[\])]\s*$")
_AT_THE_END = re.compile(r"(?:^|[/_\s])([^\s/_]+)$")
_HEADING = re.compile(r"[^\s\[(]*\s*[\[(][^\])]*[\])]|\S+")


def _heading_factors(
    line: str, units: Sequence[Sequence[str]], before: list[float], location: str, source: str
) -> list[float]:
    """Return the factors of the units in a heading; the factors `before` without units."""
    line = line.lstrip("# ")
    cells = [cell.strip(" \t\"'") for cell in re.split("[,;\t]", line)]
    if len(cells) != len(units):
        cells = _HEADING.findall(line)
    if len(cells) != len(units) or any(map(_is_number, cells)):
        return before
    pairs = list(zip(cells, units, strict=True))
    factors = [_heading_factor(cell, allowed, location, source) for cell, allowed in pairs]
    if None in factors:  # a unit without brackets may be a word, or the value of a setting
        factors = [
            factor if _IN_BRACKETS.search(cell) else None
            for cell, factor in zip(cells, factors, strict=True)
        ]
    return [old if new is None else new for new, old in zip(factors, before, strict=True)]


def _heading_factor(cell: str, allowed: Sequence[str], location: str, source: str) -> float | None:
    """Return the factor of the unit in one heading, if it has one."""
    bracketed = _IN_BRACKETS.search(cell)
    match = bracketed or _AT_THE_END.search(cell)
    if match is None:
        return None
    unit = match[1]
    for word, short in UNIT_WORDS.items():
        unit = re.sub(word, short, unit, flags=re.IGNORECASE)
    for allowed_unit in allowed:
        try:
            return magnitude(f"1 {unit}", allowed_unit)
        except QuantityError:
            continue
    try:
        is_other = bracketed is not None and bool(base_powers(unit))
    except KeyError:
        is_other = False
    if is_other:
        reason = f"{location} has the unit {match[1]} for numbers in {' or '.join(allowed)}"
        raise InvalidFile(source, reason, "correct the unit, or omit it for numbers in SI")
    return None


def _is_number(cell: str) -> bool:
    return number_of(cell) is not None
