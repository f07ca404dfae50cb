"""The interface of a study: points, chunks, columns."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

__all__ = [
    "OK",
    "STATUS",
    "Chunk",
    "Columns",
    "Study",
    "arranged",
    "failures",
    "frame",
    "layout",
    "places_of",
    "plain",
]

# --- What a study is to those who run it: points with numbers, and how some of them are computed.

Columns = dict[str, NDArray[Any]]  # by heading; all of one length, one row after the other
STATUS = "status"  # the column that says `OK`, or why a point has no numbers
OK = "ok"


class Study(ABC):
    """Points of a study, numbered from 0, each a pure function of the study and its number.

    A study is a value: it pickles, for it goes to other processes as it stands, and it does not
    change. How many points are computed together, by how many workers and in which order, makes no
    difference to any number in the table.
    """

    kind: ClassVar[str]
    """Its verb, such as ``"operating_map"``: what messages and stores call it."""

    @property
    @abstractmethod
    def points(self) -> int:
        """How many points there are."""

    @property
    def chunk(self) -> int:
        """How many points are computed together where nobody says it: some seconds of work."""
        return 64

    @property
    def threaded(self) -> bool:
        """Whether threads of one process may compute points at the same time."""
        return True

    @property
    def chains(self) -> tuple[range, ...]:
        """Ranges of points each of which goes on from the point before; none by default.

        They cover all points where there are any. A chain is computed in order, by one worker at a
        time, and what `compute` carries from one part of it to the next is kept with that part.
        """
        return ()

    @abstractmethod
    def identity(self) -> Mapping[str, Any]:
        """Return all that its numbers depend on, by name, as values that JSON can hold exactly.

        Two studies are the same if these are equal. Each top-level name is one that a user knows
        ("system", "x", "options", "seed"): messages name those that differ.
        """

    @property
    @abstractmethod
    def schema(self) -> Mapping[str, str]:
        """Headings of the table in order, each with its kind: "float", "int", "bool" or "str"."""

    @property
    def attrs(self) -> Mapping[str, Any]:
        """What stands in ``attrs`` of the table: units, system, version; JSON values."""
        return {}

    def prepare(self) -> None:
        """Do what is to be done once in each process that computes points: compile the loop.

        Called before the first of them. An error is left to the points, which say it as theirs.
        """
        return

    @abstractmethod
    def compute(
        self,
        first: int,
        last: int,
        carried: Any = None,
        watch: Callable[[float], None] | None = None,
    ) -> tuple[Columns, Any]:
        """Compute the points `first` to `last` - 1.

        Parameters
        ----------
        first, last : int
        carried : JSON value
            Of a chain: what the part before it has returned; None at its beginning.
        watch : callable, optional
            Called several times a second with the points done so far; an exception that it raises
            ends the work.

        Returns
        -------
        columns : dict of array
            Those of `schema`: the rows of each point, one or several, in the order of the points.
            A point that fails is one row with its reason in `STATUS` rather than `OK`, and what
            cannot be told is NaN.
        carried : JSON value
            What the next part of the chain goes on from; None without chains.
        """

    def place(self, number: int) -> str:
        """Return what a point is called in messages."""
        return f"point {number}"

    @abstractmethod
    def failed(self, first: int, last: int, reason: str) -> Columns:
        """Return one row for each of points that could not be computed, `reason` in `STATUS`."""


def places_of(columns: Columns) -> str:
    """Return the columns that tell a point apart, of one row, as words of a message."""
    numbers = {name: values[0] for name, values in columns.items() if values.dtype != object}
    return ", ".join(f"{name} = {value:.6g}" for name, value in numbers.items())


# --- Columns of chunks: brought into the form of their schema, and put together as a table.

DTYPES = {"float": np.float64, "int": np.int64, "bool": np.bool_, "str": object}


def arranged(columns: Mapping[str, Any], schema: Mapping[str, str]) -> Columns:
    """Return columns in the order and of the kinds of the schema, the same wherever computed."""
    return {name: np.asarray(columns[name], dtype=DTYPES[kind]) for name, kind in schema.items()}


def failures(columns: Columns) -> int:
    """Return how many points have failed."""
    return int(np.count_nonzero(columns[STATUS] != OK))


def frame(
    chunks: Sequence[Columns], schema: Mapping[str, str], attrs: Mapping[str, Any]
) -> pd.DataFrame:
    """Return the table of chunks, in their order."""
    columns = {
        name: np.concatenate([np.empty(0, DTYPES[kind]), *(chunk[name] for chunk in chunks)])
        for name, kind in schema.items()
    }
    table = pd.DataFrame(columns)
    table.attrs = dict(attrs)
    return table


def plain(value: Any) -> Any:
    """Return a value as JSON gives it back, so that what was stored is what was not."""
    return json.loads(json.dumps(value))


# --- Chunks: the contiguous ranges of points in which a study is computed and kept.


class Chunk(NamedTuple):
    """The points `first` to `last` - 1."""

    first: int
    last: int
    follows: bool
    """Whether it goes on, within a chain, from the part before."""

    @property
    def points(self) -> int:
        """How many points it has."""
        return self.last - self.first


def layout(points: int, chains: Sequence[range], chunk: int) -> list[Chunk]:
    """Return the parts of a study in the order of its points.

    Parameters
    ----------
    points : int
    chains : sequence of range
        Those of the study; none if its points are independent.
    chunk : int
        How many points a part has; the last one, and that of each chain, may have fewer.
    """
    return list(_parts(chains or (range(points),), chunk, follow=bool(chains)))


def _parts(ranges: Sequence[range], chunk: int, follow: bool) -> Iterator[Chunk]:
    for each in ranges:
        for first in range(each.start, each.stop, chunk):
            last = min(first + chunk, each.stop)
            yield Chunk(first, last, follow and first > each.start)
