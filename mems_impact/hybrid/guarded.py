"""Arrays that watch over those who read and write them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

__all__ = ["GuardedMatrix", "GuardedVector", "Misuse"]


class Misuse(Exception):
    """What was done to an array, and the remedy."""

    def __init__(self, problem: str, remedy: str) -> None:
        super().__init__(f"{problem}; {remedy}")
        self.problem, self.remedy = problem, remedy


class GuardedVector(list[Any]):
    """A list that says what is done wrong to it, None being what was never written."""

    def __init__(self, name: str, values: Iterable[Any], *, fixed: bool = False) -> None:
        super().__init__(values)
        self._name, self._fixed = name, fixed

    def __getitem__(self, i: Any) -> Any:
        self._check(i, "reads")
        value = super().__getitem__(i)
        if value is None:
            raise Misuse(f"reads {self._name}[{i}] before it is written", "write it first")
        return value

    def __setitem__(self, i: Any, value: Any) -> None:
        if self._fixed:
            problem = f"writes {self._name}[{i}]"
            raise Misuse(problem, "leave it as it is, and write into the last argument")
        self._check(i, "writes")
        super().__setitem__(i, value)

    def _check(self, i: Any, verb: str) -> None:
        if isinstance(i, int) and not -len(self) <= i < len(self):
            problem = f"{verb} {self._name}[{i}], but it has {len(self)} components"
            raise Misuse(problem, f"go from 0 to {len(self) - 1}")


class GuardedMatrix:
    """A square matrix, filled with zeros, that says what is done wrong to it."""

    def __init__(self, name: str, size: int) -> None:
        self._name, self._size = name, size
        self._entries: dict[Any, Any] = {}

    def __getitem__(self, place: Any) -> Any:
        return self._entries.get(self._checked(place, "reads"), 0.0)

    def __setitem__(self, place: Any, value: Any) -> None:
        self._entries[self._checked(place, "writes")] = value

    def __iter__(self) -> Any:
        return iter(sorted(self._entries.items()))

    def _checked(self, place: Any, verb: str) -> tuple[int, int]:
        n, name = self._size, self._name
        if not (isinstance(place, tuple) and len(place) == 2):
            raise Misuse(f"{verb} {name}[{place}]", f"write {name}[i, j]")
        for i in place:
            if not -n <= i < n:
                problem = f"{verb} {name}[{place[0]}, {place[1]}], but it is {n} x {n}"
                raise Misuse(problem, f"let both go from 0 to {n - 1}")
        return place[0] % n, place[1] % n
