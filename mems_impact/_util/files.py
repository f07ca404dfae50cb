"""Atomic file replacement."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mems_impact.errors import FileNotWritten, InvalidFile

__all__ = ["replacing", "unwritable"]

# What says that the place is a wrong one; anything else, such as a full disk, is nobody's input.
_WRONG_PLACE = (
    FileExistsError,
    FileNotFoundError,
    IsADirectoryError,
    NotADirectoryError,
    PermissionError,
)


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give the path of a temporary file, which takes the place of `path` when the block is done.

    If the block fails or is interrupted, the temporary file is removed, and what stood at `path`
    stands there still.

    Parameters
    ----------
    path : str or os.PathLike
        The file to be written. A link is followed.

    Yields
    ------
    Path
        Beside the file, with the same ending.

    Raises
    ------
    InvalidFile
        If the file cannot stand there (a directory does, or it is protected).
    FileNotWritten
        If it cannot be written for another reason: the disk is full, for example.

    Examples
    --------
    >>> with replacing("table.csv") as temporary:
    ...     table.to_csv(temporary)
    """
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{target.stem}-{os.getpid()}{target.suffix}")
    try:
        if target.is_dir():
            raise IsADirectoryError("is a directory")
        if target.exists() and not os.access(target, os.W_OK):
            raise PermissionError("permission denied")  # renaming would not ask
        yield temporary
        if target.exists():
            shutil.copymode(target, temporary)
        os.replace(temporary, target)
    except OSError as error:
        raise unwritable(path, error) from None
    finally:
        temporary.unlink(missing_ok=True)


def unwritable(path: str | os.PathLike[str], error: OSError) -> InvalidFile | FileNotWritten:
    """Return the package's own error for one of the system about a file to be written."""
    reason = (error.strerror or str(error)).lower()
    if isinstance(error, _WRONG_PLACE):
        return InvalidFile(path, f"cannot be written ({reason})", "give another place")
    return FileNotWritten(path, reason, "make room there, or give another place")
