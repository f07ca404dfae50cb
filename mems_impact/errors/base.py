"""The base of every exception, which survives pickling with all its attributes."""

from __future__ import annotations

from typing import Any

__all__ = ["MemsImpactError", "Picklable"]


class Picklable(BaseException):
    """An exception that is pickled with all that it holds."""

    def __reduce__(self) -> tuple[Any, ...]:
        # The inherited method calls the class with `args`, which fails for keyword-only arguments.
        return _restore, (type(self), self.args, self.__dict__)


class MemsImpactError(Picklable, Exception):
    """Base of every exception that the package raises on purpose.

    See Also
    --------
    InvalidParameter, RunError, OrbitError, Interrupted

    Examples
    --------
    >>> import mems_impact as mi
    >>> try:
    ...     mi.load_actuator("zhao2004").replace(delta=2)
    ... except mi.MemsImpactError as error:
    ...     print(error)
    delta = 2: must be between 0 and d = 1 (exclusive)
    """


def _restore(
    kind: type[BaseException], args: tuple[Any, ...], attributes: dict[str, Any]
) -> BaseException:
    """Rebuild a pickled exception without calling its constructor."""
    error = kind.__new__(kind, *args)
    error.__dict__.update(attributes)
    return error
