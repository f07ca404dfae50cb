"""TOML files of users, and Python code that they name."""

from __future__ import annotations

import math
import re
import tomllib
from os import PathLike, fspath
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from mems_impact._util.formatting import shown
from mems_impact.errors import InvalidFile, InvalidParameter

__all__ = [
    "CodeRequest",
    "execute_code",
    "parse_toml",
    "read_bytes",
    "read_columns",
    "resolve_code_path",
]

# --- Python code named by a file


class CodeRequest(NamedTuple):
    """Context of Python code that a file names.

    Attributes
    ----------
    field : str
        Name of the entry.
    what : str
        Expected code: "Python file with functions …".
    kind : str
        Kind of the file: "drive file".
    reader : str
        Function that reads the file.
    """

    field: str
    what: str
    kind: str
    reader: str


def resolve_code_path(source: Any, file: Path, allowed: bool, wanted: CodeRequest) -> Path:
    """Return the path of the Python file `source` that `file` names, if it may be executed.

    Raises
    ------
    InvalidParameter
        If it is not a Python file.
    InvalidFile
        If code is not allowed, or the resolved path lies outside the folder of `file`.
    """
    field, what, kind, reader = wanted
    if not isinstance(source, str) or not source.endswith(".py"):
        raise InvalidParameter(field, source, f"a {what}")
    named = f"{field} = {shown(source)}"
    if not allowed:
        reason = f"names Python code, {named}, which would be executed"
        remedy = f"read it, then allow it (--allow-code, or allow_code=True in {reader})"
        raise InvalidFile(file, reason, remedy)
    try:
        path = (file.parent / source).resolve()
        inside = path.is_relative_to(file.parent.resolve())
    except (OSError, RuntimeError, ValueError) as error:  # links in a circle, a null character
        raise InvalidFile(file, f"{named} is not a path ({error})", f"give a {what}") from None
    if not inside:
        reason = f"{named} lies outside the folder of the {kind}"
        raise InvalidFile(file, reason, "read it, then copy it into that folder")
    if not path.is_file():
        raise InvalidFile(path, "no such file", f"give a {what}")
    return path


def execute_code(path: Path, wanted: CodeRequest) -> ModuleType:
    """Execute a Python file and return it as a module; InvalidFile if it fails."""
    # Not imported: two files may have the same name, and cached bytecode may differ from the text.
    module = ModuleType(f"mems_impact_{wanted.field}_{path.stem}")
    module.__file__ = str(path)
    try:
        exec(compile(path.read_bytes(), str(path), "exec", dont_inherit=True), vars(module))
    except (Exception, SystemExit) as error:
        reason = f"fails ({type(error).__name__}: {error})"
        raise InvalidFile(path, reason, f"give a {wanted.what}") from None
    return module


# --- Files of users

_SEPARATOR = re.compile(r"\s*[,;\t]\s*|\s+")
_SAMPLE_NUMBER_HEADINGS = {"start", "increment"}  # headings of a record with sample numbers
_MAX_TABLE_BYTES = 50_000_000  # bytes
_MAX_NESTING = 20  # levels of nested tables; a burst within a burst takes one more


def read_bytes(
    source: str, remedy: str, *, largest: int, kind: str, missing: str = "no such file"
) -> bytes:
    """Return the content of the file `source`, a `kind` of at most `largest` bytes."""
    try:
        if source and Path(source).is_dir():
            raise InvalidFile(source, "is a directory", remedy)
        with open(source, "rb") as file:
            raw = file.read(largest + 1)
    except FileNotFoundError:
        raise InvalidFile(source, missing, remedy) from None
    except OSError as error:
        raise InvalidFile(source, f"cannot be read ({error.strerror})", remedy) from None
    except ValueError as error:
        if isinstance(error, InvalidFile):
            raise
        # The path contains a null character.
        raise InvalidFile(source, f"not a path ({error})", remedy) from None
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
        content = tomllib.loads(text)
    except (ValueError, RecursionError) as error:
        # Very long integers and deep nesting raise errors other than TOMLDecodeError.
        reason = f"not valid TOML ({str(error).splitlines()[0]})"
        raise InvalidFile(source, reason, f"correct it: {remedy}") from None
    if _deeper_than(_MAX_NESTING, content):
        reason = f"nests tables more than {_MAX_NESTING} deep"
        raise InvalidFile(source, reason, f"correct it: {remedy}")
    return content


def _deeper_than(most: int, content: Any) -> bool:
    """Return whether tables and lists are nested more than `most` deep.

    A dotted name may hold thousands of tables, which recursive functions cannot process.
    """
    level = [content]
    for _ in range(most):
        holders = [one.values() if isinstance(one, dict) else one for one in level]
        level = [one for each in holders for one in each if isinstance(one, dict | list)]
    return bool(level)


def read_columns(path: str | PathLike[str], count: int) -> list[list[float]]:
    """Return the `count` columns of numbers in a text file.

    Columns are separated by comma, semicolon, tab or blanks. Lines that begin with # are skipped,
    as are headings and settings of an oscilloscope above the numbers. Some oscilloscopes write
    settings in three columns before the numbers of the first lines.
    """
    if not isinstance(path, str | PathLike) or isinstance(fspath(path), bytes):
        raise InvalidParameter("path", path, "the path of a file of numbers")
    source = fspath(path)
    remedy = f"give a text file of {count} columns of numbers"
    raw = read_bytes(source, remedy, largest=_MAX_TABLE_BYTES, kind="table")
    columns: list[list[float]] = [[] for _ in range(count)]
    above = True
    for number, line in enumerate(read_text(raw, source).splitlines(), start=1):
        line = line.strip()
        if not line or line.startswith("#"):
            continue
        if line[0].isalpha():
            line = _after_setting(line, count)
        cells = [cell for cell in _SEPARATOR.split(line) if cell]
        values = [_number(cell) for cell in cells]
        above = above and (not values or values[0] is None)
        if above:
            if _SAMPLE_NUMBER_HEADINGS.issubset(cell.lower() for cell in cells):
                reason = f"by line {number} the first column counts samples"
                raise InvalidFile(source, reason, "multiply it by the increment in that line")
            continue
        if len(cells) != count:
            reason = f"line {number} holds {len(cells)} columns, not {count}"
            raise InvalidFile(source, reason, remedy)
        for column, cell, value in zip(columns, cells, values, strict=True):
            if value is None or not math.isfinite(value):
                reason = f"line {number} holds {shown(cell)}, which is not a finite number"
                raise InvalidFile(source, reason, remedy)
            column.append(value)
    if above:
        raise InvalidFile(source, "no line begins with a number", remedy)
    return columns


def _after_setting(line: str, count: int) -> str:
    """Return a line without name, value and unit of a setting before the numbers."""
    name, *others = [cell.strip() for cell in re.split("[,;\t]", line)]
    numbers = others[2 : 2 + count]
    is_setting = bool(name) and _number(name) is None and len(numbers) == count
    if is_setting and all(map(_is_number, numbers)) and not any(others[2 + count :]):
        return ",".join(numbers)
    return line


def _is_number(cell: str) -> bool:
    return _number(cell) is not None


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None
