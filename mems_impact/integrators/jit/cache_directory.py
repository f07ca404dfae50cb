"""Folder of compiled code, found without numba."""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path


@cache
def cache_directory() -> Path | None:
    """Return the folder of compiled code, or None if no folder can be written.

    The directory is in ``NUMBA_CACHE_DIR``, or else beside the sources, or else among the user's
    caches.
    """
    given = os.environ.get("NUMBA_CACHE_DIR")
    caches = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    places = [Path(__file__).with_name("__pycache__"), caches / "mems_impact"]
    for place in [Path(given).expanduser()] if given else places:
        directory = place.absolute() / "machine_code"
        try:
            directory.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(directory, os.W_OK):
            return directory
    return None
