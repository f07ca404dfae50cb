"""Chunks: the contiguous ranges of points in which a study is computed and kept."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

__all__ = ["Chunk", "layout"]


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
