"""What a study is to those who run it: points with numbers, and how some of them are computed."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

from numpy.typing import NDArray

__all__ = ["OK", "STATUS", "Columns", "Study", "places_of"]

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
