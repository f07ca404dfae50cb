"""What one figure of the paper comes to: values for the statements, tables, a picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from mems_impact.actuator.parameters import Actuator, load_actuator
from mems_impact.paper.statements import Value

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Devices", "Effort", "Outcome"]


@dataclass(frozen=True, kw_only=True)
class Devices:
    """The devices of the paper.

    Attributes
    ----------
    paper : Actuator
        The dimensionless set of its Section 4.
    real : Actuator
        The device of Mita et al., in SI, of its Section 3.
    """

    paper: Actuator = field(default_factory=lambda: load_actuator("zhao2004"))
    real: Actuator = field(default_factory=lambda: load_actuator("mita2003"))


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How fine the figures are.

    Attributes
    ----------
    quick : bool
        Coarse sweeps and short waits; the continued branches are the same.
    workers : int
        Threads.
    """

    quick: bool = False
    workers: int = 2

    def of(self, full: int, quick: int) -> int:
        """Return one of two numbers."""
        return quick if self.quick else full


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What was computed for one figure.

    Attributes
    ----------
    values : dict of str to value
        By the `id` of the statements; one that could not be computed is None or missing.
    tables : dict of str to DataFrame
        By the last part of their file names.
    draw : callable
        Returns the matplotlib figure.
    notes : tuple of str
        What the report says besides.
    """

    values: dict[str, Value | None]
    tables: dict[str, pd.DataFrame]
    draw: Callable[[], Any]
    notes: tuple[str, ...] = ()
