"""Where the chunks of a study are kept while it runs: in memory, or, by `store`, on disk."""

from __future__ import annotations

import platform
from abc import ABC, abstractmethod
from typing import Any

import pandas as pd

from mems_impact.analysis.storing.file import versions
from mems_impact.studies.frames import arranged, failures, frame, plain
from mems_impact.studies.layout import layout
from mems_impact.studies.study import Columns, Study

__all__ = ["Kept", "Memory", "attributes", "provenance"]


class Kept(ABC):
    """The chunks that are done.

    Parameters
    ----------
    study : Study
    chunk : int
        How many points a part has.

    Attributes
    ----------
    parts : list of Chunk
    done : int
        Points whose chunks are kept.
    failed : int
        Those among them that have no numbers.
    """

    def __init__(self, study: Study, chunk: int) -> None:
        self.study = study
        self.parts = layout(study.points, study.chains, chunk)
        self.done = self.failed = 0
        self._missing = dict.fromkeys(range(len(self.parts)))

    @property
    def missing(self) -> list[int]:
        """The numbers of the parts that are not kept yet, in order."""
        return list(self._missing)

    def is_missing(self, number: int) -> bool:
        """Return whether there is such a part, and it is not kept yet."""
        return number in self._missing

    def is_ready(self, number: int) -> bool:
        """Return whether a part may be computed: what it goes on from is kept."""
        return not self.parts[number].follows or number - 1 not in self._missing

    def put(self, number: int, columns: Columns, carried: Any) -> None:
        """Keep the columns of a part, and what the next part of its chain goes on from."""
        columns, carried = arranged(columns, self.study.schema), plain(carried)
        bad = failures(columns)
        self.keep(number, columns, carried, bad)
        self.count(number, bad)

    def count(self, number: int, failed: int) -> None:
        """Count a part that is kept."""
        del self._missing[number]
        self.done += self.parts[number].points
        self.failed += failed

    def take_stock(self) -> None:
        """Count what is kept and not counted: of an earlier run, or where Ctrl-C came between."""
        for number in self.missing:
            failed = self.failed_in(number)
            if failed is not None:
                self.count(number, failed)

    @abstractmethod
    def keep(self, number: int, columns: Columns, carried: Any, failed: int) -> None:
        """Keep a part."""

    @abstractmethod
    def failed_in(self, number: int) -> int | None:
        """Return how many points of a part have no numbers; None if it is not kept."""

    @abstractmethod
    def carried(self, number: int) -> Any:
        """Return what a part of a chain goes on from; None at its beginning."""

    @abstractmethod
    def table(self) -> pd.DataFrame:
        """Return the table of all parts that are kept, in the order of the points."""


class Memory(Kept):
    """Chunks in memory."""

    def __init__(self, study: Study, chunk: int) -> None:
        super().__init__(study, chunk)
        self._columns: dict[int, Columns] = {}
        self._carried: dict[int, Any] = {}

    def keep(self, number: int, columns: Columns, carried: Any, failed: int) -> None:
        """Keep a part."""
        self._columns[number], self._carried[number] = columns, carried

    def failed_in(self, number: int) -> int | None:
        """Return how many points of a part have no numbers."""
        return failures(self._columns[number]) if number in self._columns else None

    def carried(self, number: int) -> Any:
        """Return what a part goes on from."""
        return self._carried[number - 1] if self.parts[number].follows else None

    def table(self) -> pd.DataFrame:
        """Return the table of all parts that are kept."""
        chunks = [self._columns[number] for number in sorted(self._columns)]
        return frame(chunks, self.study.schema, attributes(self.study))


def attributes(study: Study) -> dict[str, Any]:
    """Return ``attrs`` of the table of a study: its own, and where the numbers come from."""
    told: dict[str, Any] = plain({**study.attrs, "study": study.kind, "versions": provenance()})
    return told


def provenance() -> dict[str, str]:
    """Return the versions of what makes the numbers."""
    return {**versions(), "python": platform.python_version()}
