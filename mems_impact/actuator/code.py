"""Python code that a file names: run on a word only, and never from elsewhere."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from mems_impact.errors import InvalidFile, InvalidParameter
from mems_impact.wording import shown

__all__ = ["Wanted", "code_path", "run_code"]


class Wanted(NamedTuple):
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


def code_path(source: Any, file: Path, allowed: bool, wanted: Wanted) -> Path:
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


def run_code(path: Path, wanted: Wanted) -> ModuleType:
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
