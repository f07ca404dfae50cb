"""Warnings to the caller of the package, or collected by a study."""

from __future__ import annotations

import contextlib
import functools
import os
import sys
import threading
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

# Files that are not the caller's.
_OURS = (f"{Path(__file__).parents[1]}{os.sep}", contextlib.__file__, functools.__file__)
_here = threading.local()


class CollectedWarning(NamedTuple):
    """A collected warning."""

    category: type[Warning]
    subject: str  # such as the name of a guard
    message: str
    point: int = -1  # of a study; -1 outside studies


def warn(message: str, category: type[Warning], subject: str = "") -> None:
    """Warn the caller of the package, or add to the collected warnings of this thread."""
    collected: list[CollectedWarning] | None = getattr(_here, "collected", None)
    if collected is not None:
        collected.append(CollectedWarning(category, subject, message, getattr(_here, "point", -1)))
        return
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_OURS):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)


@contextmanager
def collected_warnings() -> Iterator[list[CollectedWarning]]:
    """Collect the warnings of this thread in the block."""
    before = getattr(_here, "collected", None)
    _here.collected = collected = list[CollectedWarning]()
    try:
        yield collected
    finally:
        _here.collected = before


@contextmanager
def at_study_point(point: int) -> Iterator[None]:
    """Attribute the warnings of the block to a point; the outermost block takes precedence."""
    before = getattr(_here, "point", -1)
    _here.point = point if before < 0 else before
    try:
        yield
    finally:
        _here.point = before


@contextmanager
def warned_once() -> Iterator[None]:
    """Issue the warnings of the block, once per category and subject."""
    collected: list[CollectedWarning] = []
    try:
        with collected_warnings() as collected:
            yield
    finally:
        for each in first_of_each(collected):
            with at_study_point(each.point):
                warn(each.message, each.category, each.subject)


def first_of_each(collected: Iterable[CollectedWarning]) -> list[CollectedWarning]:
    """Return the first warning of each category and subject."""
    first: dict[tuple[type[Warning], str], CollectedWarning] = {}
    for each in collected:
        first.setdefault((each.category, each.subject), each)
    return list(first.values())
