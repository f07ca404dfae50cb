"""Files of users: checks of paths, atomic replacement, opening."""

from __future__ import annotations

import errno
import os
import shutil
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO

from mems_impact.errors import FileNotWritten, InvalidFile, InvalidParameter

TEMPORARY_PREFIX = ".mems_impact-"  # of the folders of incomplete files

# Errors due to an invalid path; others, such as a full disk, are not errors of input.
_WRONG_PLACE = {
    *(errno.EACCES, errno.EEXIST, errno.EINVAL, errno.EISDIR, errno.ELOOP, errno.ENAMETOOLONG),
    *(errno.ENOENT, errno.ENOTDIR, errno.EPERM),
}
_UNCHECKED_BYTES = 2_000_000  # of expanded content
_NO_FILE = "is a pipe, a socket or a device, not a file"


def file_path(path: object, allowed: str = "the path of a file", field: str = "path") -> str:
    """Return a path as text; raise InvalidParameter if no file system takes it as a path."""
    if isinstance(path, str | os.PathLike):
        text = os.fspath(path)
        try:
            if isinstance(text, str) and b"\0" not in os.fsencode(text):
                return text
        except UnicodeEncodeError:  # a lone surrogate
            pass
    raise InvalidParameter(field, path, allowed)


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path, in a hidden folder beside `path`, which it replaces after the block.

    The temporary file has the same name. Symbolic links are followed. If the block fails or is
    interrupted, the temporary file is removed, and `path` is unchanged. Raises InvalidParameter if
    `path` is no path, InvalidFile if it is a directory, a pipe or a device, or write-protected, and
    FileNotWritten for another reason, such as a full disk.

    >>> with replacing("table.csv") as temporary:
    ...     _ = temporary.write_text("amplitude,step")
    """
    target = Path(os.path.realpath(file_path(path)))
    try:
        exists = check_replaceable(path)
        with TemporaryDirectory(
            prefix=TEMPORARY_PREFIX, dir=target.parent, ignore_cleanup_errors=True
        ) as folder:
            temporary = Path(folder, target.name)
            yield temporary
            if exists:
                shutil.copymode(target, temporary)
            os.replace(temporary, target)
    except OSError as error:
        raise unwritable(path, error) from None


def check_replaceable(path: str | os.PathLike[str]) -> bool:
    """Return whether a file exists; raise an error if it must not be replaced."""
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        return False
    if stat.S_ISDIR(mode):
        raise OSError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        raise InvalidFile(path, _NO_FILE, "give the path of a file")
    if not os.access(path, os.W_OK):
        raise OSError(errno.EACCES, os.strerror(errno.EACCES))  # os.replace ignores it
    return True


def unwritable(path: str | os.PathLike[str], error: OSError) -> InvalidFile | FileNotWritten:
    """Return the package's error for an OSError in writing a file."""
    reason = _reason(error)
    if error.errno in _WRONG_PLACE:
        return InvalidFile(path, f"cannot be written ({reason})", "give another place")
    return FileNotWritten(path, reason, "make room there, or give another place")


@contextmanager
def opened(
    path: str | os.PathLike[str], remedy: str, missing: str | None = "no such file"
) -> Iterator[BinaryIO]:
    """Yield an open file; errors of the operating system become InvalidFile, as do pipes.

    Without `missing`, the reason for a missing file, FileNotFoundError is raised.
    """
    try:
        mode = os.stat(file_path(path)).st_mode
        if not stat.S_ISREG(mode):
            reason = "is a directory" if stat.S_ISDIR(mode) else _NO_FILE
            raise InvalidFile(path, reason, remedy)
        with open(path, "rb") as file:
            yield file
    except FileNotFoundError:
        if missing is None:
            raise
        raise InvalidFile(path, missing, remedy) from None
    except OSError as error:
        raise InvalidFile(path, f"cannot be read ({_reason(error)})", remedy) from None


def check_expansion(
    path: str | os.PathLike[str], size: int, content: int, ratio: int, remedy: str
) -> None:
    """Raise InvalidFile for `size` bytes that expand to more than `ratio` times as many."""
    if content > _UNCHECKED_BYTES + ratio * size:
        reason = f"expands {size} bytes to {content}, as no file of this package does"
        raise InvalidFile(path, reason, remedy)


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()
