"""Warnings: to the caller of the package, once, or collected by a study."""

from __future__ import annotations

import contextlib
import sys
import threading
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

__all__ = [
    "CollectedWarning",
    "at_study_point",
    "collected_warnings",
    "first_of_each",
    "warn",
    "warned_once",
]

_OURS = (str(Path(__file__).parents[1]), contextlib.__file__)  # files that are no caller's
_here = threading.local()


class CollectedWarning(NamedTuple):
    """A warning that was gathered.

    Attributes
    ----------
    category : type of Warning
    subject : str
        What it is about, such as the name of a guard.
    message : str
    point : int
        Of a study; -1 elsewhere.
    """

    category: type[Warning]
    subject: str
    message: str
    point: int = -1


def warn(message: str, category: type[Warning], subject: str = "") -> None:
    """Warn the caller of the package, or who gathers warnings in this thread."""
    told: list[CollectedWarning] | None = getattr(_here, "told", None)
    if told is not None:
        told.append(CollectedWarning(category, subject, message, getattr(_here, "point", -1)))
        return
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_OURS):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)


@contextmanager
def collected_warnings() -> Iterator[list[CollectedWarning]]:
    """Gather what is told in this thread while the block runs."""
    before = getattr(_here, "told", None)
    _here.told = told = list[CollectedWarning]()
    try:
        yield told
    finally:
        _here.told = before


@contextmanager
def at_study_point(point: int) -> Iterator[None]:
    """Note that what is told in the block is about a point; the outermost block says."""
    before = getattr(_here, "point", -1)
    _here.point = point if before < 0 else before
    try:
        yield
    finally:
        _here.point = before


@contextmanager
def warned_once() -> Iterator[None]:
    """Tell once of each subject what the block, which runs often, tells of it."""
    told: list[CollectedWarning] = []
    try:
        with collected_warnings() as told:
            yield
    finally:
        for each in first_of_each(told):
            with at_study_point(each.point):
                warn(each.message, each.category, each.subject)


def first_of_each(told: Iterable[CollectedWarning]) -> list[CollectedWarning]:
    """Return the first that was told of each subject."""
    first: dict[tuple[type[Warning], str], CollectedWarning] = {}
    for each in told:
        first.setdefault((each.category, each.subject), each)
    return list(first.values())
