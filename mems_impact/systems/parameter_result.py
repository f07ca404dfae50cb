"""Results over the values of one parameter of a system."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from mems_impact.systems.base import HybridSystem
from mems_impact.systems.result import Result

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ParameterResult(Result):
    """Base class of results over the values of one parameter."""

    system: HybridSystem  # at its own value of the parameter
    parameter: str
    table: pd.DataFrame  # the values of the parameter are one of the columns

    def summary(self) -> dict[str, Any]:
        """Return the system, and the range and number of the values of the parameter."""
        values = self.table[self.parameter]
        extent = f"{values.min():g} to {values.max():g}, {values.nunique()} values"
        return {"system": repr(self.system), self.system.units.label(self.parameter): extent}

    def __repr__(self) -> str:
        (_, (_, extent), *others) = self.summary().items()
        parts = (f"{self.parameter} = {extent}", *(f"{name} {value}" for name, value in others))
        return f"{type(self).__name__}({'; '.join(parts)})"
