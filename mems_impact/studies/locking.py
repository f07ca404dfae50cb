"""One process at a time: a lock that goes with the process that holds it."""

from __future__ import annotations

import errno
import fcntl
import logging
import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mems_impact.errors import InvalidFile
from mems_impact.writing import unwritable

__all__ = ["locked"]

_log = logging.getLogger("mems_impact")
_held: set[Path] = set()  # by this process, which a lock of the system would let in again


@contextmanager
def locked(path: Path) -> Iterator[bool]:
    """Hold the lock file `path` in the block; gives False where the file system knows no locks.

    Raises
    ------
    InvalidFile
        If another process holds it, or it cannot be written.
    """
    real = Path(os.path.realpath(path))
    if real in _held:
        raise _in_use(path, "by another study in this process")
    try:
        file = os.open(real, os.O_RDWR | os.O_CREAT, 0o666)
    except OSError as error:
        raise unwritable(path.parent, error) from None
    try:
        alone = _take(file, path)
        _held.add(real)
        yield alone
    finally:
        _held.discard(real)
        os.close(file)


def _take(file: int, path: Path) -> bool:
    try:
        # Of POSIX, since it is not inherited: the workers of a process that was killed, which may
        # live on for a while, do not hold it.
        fcntl.lockf(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in (errno.EACCES, errno.EAGAIN):
            holder = os.read(file, 200).decode(errors="replace").strip()
            raise _in_use(path, f"by {holder}" if holder else "by another process") from None
        # Some file systems of clusters have no locks. Chunks are whole and the same whoever writes
        # them, so that two processes lose time there and nothing else.
        _log.warning("%s: cannot be locked (%s)", path, (error.strerror or str(error)).lower())
        return False
    os.ftruncate(file, 0)
    os.write(file, f"process {os.getpid()} on {socket.gethostname()}".encode())
    return True


def _in_use(path: Path, holder: str) -> InvalidFile:
    return InvalidFile(path.parent, f"is in use {holder}", "wait for it, or give another directory")
