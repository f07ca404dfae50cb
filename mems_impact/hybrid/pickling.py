"""Pickling of user functions."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, is_dataclass, replace
from functools import lru_cache
from types import FunctionType
from typing import Any

__all__ = ["portable", "reference", "same_function"]

SHARED = 512  # functions that are remembered, so that what shares one goes on sharing it


def portable(value: Any) -> Any:
    """Return `value` with what plain pickling cannot take along made fit for it.

    A function that another process can import goes by its name. One that was defined in a notebook,
    in ``__main__``, within a function, or as a lambda, goes with its code.
    """
    if isinstance(value, dict):
        return {key: portable(part) for key, part in value.items()}
    if type(value) is tuple:
        return tuple(portable(part) for part in value)
    if isinstance(value, FunctionType) and not is_importable(value):
        return _carried(value)
    by_parts = is_dataclass(value) and "__reduce__" not in vars(type(value))
    if by_parts and not isinstance(value, type):
        inner = {key: portable(part) for key, part in vars(value).items()}
        changed = {key: part for key, part in inner.items() if part is not getattr(value, key)}
        return replace(value, **changed) if changed else value
    return value


def is_importable(function: Callable[..., Any]) -> bool:
    """Return whether another process finds the function under its name."""
    module = sys.modules.get(function.__module__)
    if module is None or module.__name__ == "__main__":
        return False
    found: Any = module
    for name in function.__qualname__.split("."):
        found = getattr(found, name, None)
    return found is function


def reference(function: Callable[..., Any]) -> str:
    """Return where a function was defined, as ``module:name``: to be shown, not to be imported."""
    return f"{function.__module__}:{function.__qualname__}"


def same_function(one: Callable[..., Any], other: Callable[..., Any]) -> bool:
    """Return whether two functions are one text that draws on the same values."""
    if one is other:
        return True
    if not (isinstance(one, FunctionType) and isinstance(other, FunctionType)):
        return bool(one == other)
    from mems_impact.integrators.jit.closures import take_snapshot  # which imports numba

    return take_snapshot(one).name == take_snapshot(other).name


@dataclass(frozen=True)
class _Carried:
    """A function that is pickled with its code, and comes back as the function itself."""

    function: Callable[..., Any]

    def __reduce__(self) -> Any:
        import cloudpickle

        return _unpacked, (cloudpickle.dumps(self.function),)


@lru_cache(SHARED)
def _carried(function: FunctionType) -> _Carried:
    """Return the same object for the same function: then a pickle holds its code once."""
    return _Carried(function)


@lru_cache(SHARED)
def _unpacked(packed: bytes) -> Any:
    """Return the same function for the same code: what is made of it is made once."""
    import cloudpickle

    return cloudpickle.loads(packed)
