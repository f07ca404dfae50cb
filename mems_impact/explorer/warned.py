"""Warnings of the package, each to the page whose run gave it."""

from __future__ import annotations

import threading
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from mems_impact.warnings import (
    DiscontinuityWarning,
    ScaleWarning,
    StartWarning,
    StiffnessWarning,
    UnitsWarning,
    ValidityWarning,
)

__all__ = ["gathered", "heard"]

TOLD = (
    DiscontinuityWarning,
    ScaleWarning,
    StartWarning,
    StiffnessWarning,
    UnitsWarning,
    ValidityWarning,
)
_here = threading.local()


@contextmanager
def heard() -> Iterator[None]:
    """Let `gathered` hear warnings, of each thread its own, each time that they are given.

    Python's own recorder changes what the whole process does with warnings, and here pictures of
    several pages are computed side by side.
    """
    with warnings.catch_warnings():
        for kind in TOLD:
            warnings.simplefilter("always", kind)
        shown = warnings.showwarning

        def show(message: Any, category: Any, *rest: Any, **more: Any) -> None:
            messages = getattr(_here, "messages", None)
            if messages is not None and issubclass(category, TOLD):
                messages.append(str(message))
            else:
                shown(message, category, *rest, **more)

        warnings.showwarning = show
        yield


@contextmanager
def gathered() -> Iterator[list[str]]:
    """Gather what this thread is warned of, while the block runs."""
    _here.messages = messages = list[str]()
    try:
        yield messages
    finally:
        _here.messages = None
