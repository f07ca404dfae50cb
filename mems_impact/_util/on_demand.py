"""Fields that are computed on demand."""

from __future__ import annotations

from collections.abc import Callable
from types import FunctionType
from typing import Any, Generic, TypeVar, cast

T = TypeVar("T")


def computed(instance: object) -> dict[str, Any]:
    """Return the attributes of an instance, to be pickled, after those on demand were computed."""
    return {name: getattr(instance, name) for name in vars(instance)}


class OnDemand(Generic[T]):
    """A field of a dataclass, given as a value, or as a function that is called at first use."""

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    def __get__(self, instance: object | None, owner: type | None = None) -> T:
        if instance is None:
            raise AttributeError(self._name)  # the field has no default
        value = vars(instance)[self._name]
        if isinstance(value, FunctionType):
            value = vars(instance)[self._name] = value()
        return cast(T, value)

    def __set__(self, instance: object, value: T | Callable[[], T]) -> None:
        vars(instance)[self._name] = value
