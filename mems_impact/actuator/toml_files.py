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

# --- Python code that a file names: run on a word only, and never from elsewhere.


class CodeRequest(NamedTuple):
    """What a file says of code.

    Attributes
    ----------
    field : str
        Under which name.
    what : str
        What the code is to be: "Python file with functions …".
    kind : str
        What kind of file it is: "drive file".
    reader : str
        The function that reads the file.
    """

    field: str
    what: str
    kind: str
    reader: str


def resolve_code_path(source: Any, file: Path, allowed: bool, wanted: CodeRequest) -> Path:
    """Return the Python file `source` that `file` names, if it may be run.

    Raises
    ------
    InvalidParameter
        If it is no Python file.
    InvalidFile
        If code is not allowed, or it lies outside the folder of the file, links followed.
    """
    field, what, kind, reader = wanted
    if not isinstance(source, str) or not source.endswith(".py"):
        raise InvalidParameter(field, source, f"a {what}")
    named = f"{field} = {shown(source)}"
    if not allowed:
        reason = f"names Python code, {named}, which would be run"
        remedy = f"read it, then allow it (--allow-code, or allow_code=True in {reader})"
        raise InvalidFile(file, reason, remedy)
    try:
        path = (file.parent / source).resolve()
        inside = path.is_relative_to(file.parent.resolve())
    except (OSError, RuntimeError, ValueError) as error:  # links in a circle, a null character
        raise InvalidFile(file, f"{named} is no path ({error})", f"give a {what}") from None
    if not inside:
        reason = f"{named} lies outside the folder of the {kind}"
        raise InvalidFile(file, reason, "read it, then copy it into that folder")
    if not path.is_file():
        raise InvalidFile(path, "no such file", f"give a {what}")
    return path


def execute_code(path: Path, wanted: CodeRequest) -> ModuleType:
    """Run a Python file and return what it defines; InvalidFile if it fails."""
    # Not imported: two files may have the same name, and compiled code kept beside the file need
    # not be that of the text that was read.
    module = ModuleType(f"mems_impact_{wanted.field}_{path.stem}")
    module.__file__ = str(path)
    try:
        exec(compile(path.read_bytes(), str(path), "exec", dont_inherit=True), vars(module))
    except (Exception, SystemExit) as error:
        reason = f"fails ({type(error).__name__}: {error})"
        raise InvalidFile(path, reason, f"give a {wanted.what}") from None
    return module


# --- Reading of the files that users write: every failure is one `InvalidFile` with a remedy.

_SEPARATOR = re.compile(r"\s*[,;\t]\s*|\s+")
_COUNTED = {"start", "increment"}  # headings of a record whose samples are numbered
_LARGEST_TABLE = 50_000_000  # bytes
_DEEPEST = 20  # tables in each other; a burst within a burst takes one more


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
        # A null character in the path.
        raise InvalidFile(source, f"not a path ({error})", remedy) from None
    if len(raw) > largest:
        raise InvalidFile(source, f"too large for a {kind}", remedy)
    return raw


def read_text(raw: bytes, source: str) -> str:
    """Return `raw` as text."""
    try:
        # Editors on Windows put a byte order mark first, which TOML does not know.
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
        # Not TOMLDecodeError alone: absurdly long integers and deep nesting raise the others.
        reason = f"not valid TOML ({str(error).splitlines()[0]})"
        raise InvalidFile(source, reason, f"mend it there: {remedy}") from None
    if _deeper_than(_DEEPEST, content):
        reason = f"holds tables within tables, more than {_DEEPEST} deep"
        raise InvalidFile(source, reason, f"mend it there: {remedy}")
    return content


def _deeper_than(most: int, content: Any) -> bool:
    """Return whether tables and lists stand in each other more than `most` deep.

    A dotted name may hold thousands of tables, over which all that looks into them would fail.
    """
    level = [content]
    for _ in range(most):
        holders = [one.values() if isinstance(one, dict) else one for one in level]
        level = [one for each in holders for one in each if isinstance(one, dict | list)]
    return bool(level)


def read_columns(path: str | PathLike[str], count: int) -> list[list[float]]:
    """Return the `count` columns of numbers in a text file.

    Columns are separated by comma, semicolon, tab or blanks. Lines that begin with # are left out,
    as are those above the numbers: headings, and what an oscilloscope tells of its settings. Some
    write these before the numbers of the first lines, in three columns.
    """
    if not isinstance(path, str | PathLike) or isinstance(fspath(path), bytes):
        raise InvalidParameter("path", path, "the path of a file of numbers")
    source = fspath(path)
    remedy = f"give a text file of {count} columns of numbers"
    raw = read_bytes(source, remedy, largest=_LARGEST_TABLE, kind="table")
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
            if _COUNTED.issubset(cell.lower() for cell in cells):
                reason = f"line {number} says that the first column counts samples"
                raise InvalidFile(source, reason, "multiply it by the increment told there")
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
    """Return what a line holds behind name, value and unit of a setting; else the line."""
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
