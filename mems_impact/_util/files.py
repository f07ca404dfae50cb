"""Atomic file replacement."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mems_impact.errors import FileNotWritten, InvalidFile

__all__ = ["replacing", "unwritable"]

# Errors due to an invalid path; others, such as a full disk, are not errors of input.
_WRONG_PLACE = (
    FileExistsError,
    FileNotFoundError,
    IsADirectoryError,
    NotADirectoryError,
    PermissionError,
)


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield the path of a temporary file, which replaces `path` at the end of the block.

    If the block fails or is interrupted, the temporary file is removed, and `path` is unchanged.

    Parameters
    ----------
    path : str or os.PathLike
        The file to write. Symbolic links are followed.

    Yields
    ------
    Path
        A path in the same folder, with the same suffix.

    Raises
    ------
    InvalidFile
        If `path` is invalid: a directory, or write-protected.
    FileNotWritten
        If the file cannot be written for another reason, such as a full disk.

    Examples
    --------
    >>> with replacing("table.csv") as temporary:
    ...     _ = temporary.write_text("amplitude,step")
    """
    target = Path(os.path.realpath(path))
    temporary = target.with_name(f".{target.stem}-{os.getpid()}{target.suffix}")
    try:
        if target.is_dir():
            raise IsADirectoryError("is a directory")
        if target.exists() and not os.access(target, os.W_OK):
            raise PermissionError("permission denied")  # os.replace ignores it
        yield temporary
        if target.exists():
            shutil.copymode(target, temporary)
        os.replace(temporary, target)
    except OSError as error:
        raise unwritable(path, error) from None
    finally:
        temporary.unlink(missing_ok=True)


def unwritable(path: str | os.PathLike[str], error: OSError) -> InvalidFile | FileNotWritten:
    """Return the package's error for an OSError in writing a file."""
    reason = (error.strerror or str(error)).lower()
    if isinstance(error, _WRONG_PLACE):
        return InvalidFile(path, f"cannot be written ({reason})", "give another place")
    return FileNotWritten(path, reason, "make room there, or give another place")
