"""Who is told what is worth a warning: the caller of the package, or who gathers for many runs."""

from __future__ import annotations

import contextlib
import sys
import threading
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

__all__ = ["Told", "about", "first_of_each", "gathered", "tell", "told_once"]

_OURS = (str(Path(__file__).parent), contextlib.__file__)  # files that are no caller's
_here = threading.local()


class Told(NamedTuple):
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


def tell(message: str, category: type[Warning], subject: str = "") -> None:
    """Warn the caller of the package, or who gathers warnings in this thread."""
    told: list[Told] | None = getattr(_here, "told", None)
    if told is not None:
        told.append(Told(category, subject, message, getattr(_here, "point", -1)))
        return
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_OURS):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)


@contextmanager
def gathered() -> Iterator[list[Told]]:
    """Gather what is told in this thread while the block runs."""
    before = getattr(_here, "told", None)
    _here.told = told = list[Told]()
    try:
        yield told
    finally:
        _here.told = before


@contextmanager
def about(point: int) -> Iterator[None]:
    """Note that what is told in the block is about a point; the outermost block says."""
    before = getattr(_here, "point", -1)
    _here.point = point if before < 0 else before
    try:
        yield
    finally:
        _here.point = before


@contextmanager
def told_once() -> Iterator[None]:
    """Tell once of each subject what the block, which runs often, tells of it."""
    told: list[Told] = []
    try:
        with gathered() as told:
            yield
    finally:
        for each in first_of_each(told):
            with about(each.point):
                tell(each.message, each.category, each.subject)


def first_of_each(told: Iterable[Told]) -> list[Told]:
    """Return the first that was told of each subject."""
    first: dict[tuple[type[Warning], str], Told] = {}
    for each in told:
        first.setdefault((each.category, each.subject), each)
    return list(first.values())
