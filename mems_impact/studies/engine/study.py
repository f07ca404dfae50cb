"""The interface of a study: points, chunks, columns."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from mems_impact._util.progress import Watch

# --- Interface of studies

Columns = dict[str, NDArray[Any]]  # columns of equal length by heading
STATUS = "status"  # column with `OK`, or the reason for which a point failed
OK = "ok"


class Study(ABC):
    """Points of a study, numbered from 0, each a pure function of the study and its number.

    A study is immutable and can be pickled for other processes. The table does not depend on the
    number of points computed together, on the number of workers, or on the order.
    """

    kind: ClassVar[str]
    """Its verb, such as ``"operating_map"``, which names it in messages and stores."""
    chunk: ClassVar[int] = 64
    """Number of points computed together by default: some seconds of work."""

    @property
    @abstractmethod
    def points(self) -> int:
        """Number of points."""

    @property
    def threaded(self) -> bool:
        """Whether threads of one process may compute points at the same time."""
        return True

    @property
    def chains(self) -> tuple[range, ...]:
        """Ranges of points in which each point depends on the previous one; none by default.

        If there are any, they cover all points. A chain is computed in order, by one worker at a
        time, and the data that `compute` carries to the next part are stored with each part.
        """
        return ()

    @abstractmethod
    def identity(self) -> Mapping[str, Any]:
        """Return all inputs of its numbers by name, as values that JSON represents exactly.

        Two studies are the same if these are equal. Messages name the top-level entries that
        differ, so these have names that a user knows ("system", "x", "options", "rng").
        """

    @property
    @abstractmethod
    def schema(self) -> Mapping[str, str]:
        """Headings of the table in order, each with its type: "float", "int", "bool" or "str"."""

    @property
    def attrs(self) -> Mapping[str, Any]:
        """``attrs`` of the table: units, system, version; JSON values."""
        return {}

    def prepare(self) -> None:
        """Prepare a process that computes points, by compilation of the event loop.

        The method is called before the first point. Errors are ignored here, since points raise
        them again.
        """
        return

    @abstractmethod
    def compute(
        self, first: int, last: int, carried: Any = None, watch: Watch | None = None
    ) -> tuple[Columns, Any]:
        """Compute the points `first` to `last` - 1: columns of `schema`, and data to carry.

        The columns have the rows of each point, one or several, in the order of the points; a
        failed point is one row with its reason in `STATUS` and NaN for unknown values. In a chain,
        `carried` is the JSON value that the previous part returned, None for the first; None
        without chains. `watch` is called several times a second with the points done so far; an
        exception that it raises ends the work.
        """

    def point_label(self, number: int) -> str:
        """Return the name of a point in messages."""
        return f"point {number}"

    @abstractmethod
    def failed(self, first: int, last: int, reason: str) -> Columns:
        """Return one row per point that could not be computed, with `reason` in `STATUS`."""


def row_label(columns: Columns) -> str:
    """Return the identifying columns of one row, as text for a message."""
    numbers = {name: values[0] for name, values in columns.items() if values.dtype != object}
    return ", ".join(f"{name} = {value:.6g}" for name, value in numbers.items())


# --- Columns of chunks

DTYPES = {"float": np.float64, "int": np.int64, "bool": np.bool_, "str": object}


def arranged(columns: Mapping[str, Any], schema: Mapping[str, str]) -> Columns:
    """Return columns in the order and with the types of the schema."""
    return {name: np.asarray(columns[name], dtype=DTYPES[kind]) for name, kind in schema.items()}


def failures(columns: Columns) -> int:
    """Return the number of failed points."""
    return int(np.count_nonzero(columns[STATUS] != OK))


def frame(
    chunks: Sequence[Columns], schema: Mapping[str, str], attrs: Mapping[str, Any]
) -> pd.DataFrame:
    """Return the table of chunks, in order."""
    columns = {
        name: np.concatenate([np.empty(0, DTYPES[kind]), *(chunk[name] for chunk in chunks)])
        if chunks
        else np.empty(0, str if kind == "str" else DTYPES[kind])  # pandas: no texts, no objects
        for name, kind in schema.items()
    }
    table = pd.DataFrame(columns)
    table.attrs = dict(attrs)
    return table


def json_value(value: Any) -> Any:
    """Return a value after a JSON round trip, so that it equals a stored one."""
    return json.loads(json.dumps(value))


# --- Chunks: contiguous ranges of points


class Chunk(NamedTuple):
    """The points `first` to `last` - 1."""

    first: int
    last: int
    follows: bool
    """Whether it continues the previous part of a chain."""

    @property
    def points(self) -> int:
        """Number of points."""
        return self.last - self.first


def layout(points: int, chains: Sequence[range], chunk: int) -> list[Chunk]:
    """Return the parts of a study in the order of its points; without chains these are independent.

    The last part, also of each chain, may have fewer than `chunk` points.
    """
    return list(_parts(chains or (range(points),), chunk, follow=bool(chains)))


def _parts(ranges: Sequence[range], chunk: int, follow: bool) -> Iterator[Chunk]:
    for each in ranges:
        for first in range(each.start, each.stop, chunk):
            last = min(first + chunk, each.stop)
            yield Chunk(first, last, follow and first > each.start)
