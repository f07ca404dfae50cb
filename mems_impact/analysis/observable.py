"""Observables: quantities that a model adds to tables and studies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from mems_impact.errors import InvalidParameter

__all__ = ["Observable"]

Reduction = Literal["sum", "mean", "min", "max", "gain"]
AT_EVENTS = ("sum", "mean", "min", "max")


@dataclass(frozen=True)
class Observable:
    """A named quantity of a system.

    Written as plain scalar functions, as all of a system is. At events it is
    ``function(mode, t, before, after, p)``, with the states just before and after; its values stand
    in a column of the table of these events. Without events it is ``function(y, p)`` of the state,
    of which studies tell the gain per period.

    Parameters
    ----------
    name : str
        Heading of its column.
    function : callable
    at : tuple of str, optional
        Names of the guards at whose events it is taken; none for a quantity of the state.
    reduce : {"sum", "mean", "min", "max", "gain"}, optional
        What studies tell of many values: of those at events the sum per period, or the mean,
        smallest or largest; "gain" is the change of a quantity of the state per period.
    unit : str, optional

    See Also
    --------
    System, Quantity, sweep

    Examples
    --------
    >>> import mems_impact as mi
    >>> speed = mi.Observable(
    ...     "impact speed", lambda mode, t, before, after, p: -before.v, at=("floor",), reduce="max"
    ... )
    """

    name: str
    function: Callable[..., Any]
    at: tuple[str, ...] = ()
    reduce: Reduction = "gain"
    unit: str = ""

    def __post_init__(self) -> None:
        allowed = AT_EVENTS if self.at else ("gain",)
        if self.reduce not in allowed:
            raise InvalidParameter("reduce", self.reduce, f"one of {', '.join(allowed)}")
