"""Pickling of user functions."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, is_dataclass, replace
from functools import lru_cache
from types import FunctionType
from typing import Any

CACHE_SIZE = 512  # size of the caches that preserve the identity of shared functions


def portable(value: Any) -> Any:
    """Return `value` with functions that cannot be imported wrapped for pickling.

    A function that another process can import is pickled by name. A function defined in a notebook,
    in ``__main__``, or within a function, and a lambda, are pickled with their code.
    """
    if isinstance(value, dict):
        return {key: portable(part) for key, part in value.items()}
    if type(value) is tuple:
        return tuple(portable(part) for part in value)
    if isinstance(value, FunctionType) and not is_importable(value):
        return _wrap(value)
    is_record = is_dataclass(value) and "__reduce__" not in vars(type(value))
    if is_record and not isinstance(value, type):
        parts = {key: portable(part) for key, part in vars(value).items()}
        changes = {key: part for key, part in parts.items() if part is not getattr(value, key)}
        return replace(value, **changes) if changes else value
    return value


def is_importable(function: Callable[..., Any]) -> bool:
    """Return whether another process finds the function under its name."""
    module = sys.modules.get(function.__module__)
    if module is None or module.__name__ == "__main__":
        return False
    value: Any = module
    for name in function.__qualname__.split("."):
        value = getattr(value, name, None)
    return value is function


def reference(function: Callable[..., Any]) -> str:
    """Return where a function was defined, as ``module:name``, for display."""
    return f"{function.__module__}:{function.__qualname__}"


def same_function(one: Callable[..., Any], other: Callable[..., Any]) -> bool:
    """Return whether two functions have the same source and the same captured values."""
    if one is other:
        return True
    if not (isinstance(one, FunctionType) and isinstance(other, FunctionType)):
        return bool(one == other)
    from mems_impact.integrators.jit.closures import take_snapshot  # which imports numba

    return take_snapshot(one).name == take_snapshot(other).name


@dataclass(frozen=True)
class _PickledFunction:
    """A function that is pickled with its code and unpickled as a function."""

    function: Callable[..., Any]

    def __reduce__(self) -> Any:
        import cloudpickle

        return _load_function, (cloudpickle.dumps(self.function),)


@lru_cache(CACHE_SIZE)
def _wrap(function: FunctionType) -> _PickledFunction:
    """Return the same object for the same function, so that a pickle holds its code once."""
    return _PickledFunction(function)


@lru_cache(CACHE_SIZE)
def _load_function(data: bytes) -> Any:
    """Return the same function for the same code, so that caches by function apply."""
    import cloudpickle

    return cloudpickle.loads(data)
