"""What the points of a scatter tell: how their quantities are spread, and the yield."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from mems_impact.errors import InvalidParameter
from mems_impact.studies.draws import FIRST, SECOND
from mems_impact.studies.motions import MOTION, in_order, motions
from mems_impact.studies.sampling import wilson

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["SAMPLE", "Spread"]

SAMPLE = "sample"  # column: to which of the samples that indices need a row belongs
ALL = "all"  # in the last row of yields


@dataclass(frozen=True, kw_only=True, eq=False)
class Spread:
    """Points with parameters that were drawn; all of a scatter, or those that are done.

    Attributes
    ----------
    drawn : tuple of str
        What was drawn.
    specification : dict of str to (float, float)
    table : DataFrame
        One row a point.
    indices : DataFrame or None
    """

    drawn: tuple[str, ...]
    table: pd.DataFrame = field(repr=False)
    specification: dict[str, tuple[float, float]] = field(repr=False, default_factory=dict)
    indices: pd.DataFrame | None = field(repr=False, default=None)

    @property
    def points(self) -> pd.DataFrame:
        """The rows that are drawn independently: all, or without those that indices need."""
        rows = self.table[self.table[SAMPLE].isin(["", FIRST, SECOND])]
        rows.attrs = dict(self.table.attrs)
        return rows

    @property
    def quantities(self) -> list[str]:
        """The columns of what is measured."""
        begin = list(self.table.columns).index(MOTION)
        numbers = self.table.iloc[:, begin:].select_dtypes("float").columns
        return [str(name) for name in numbers]

    @property
    def yields(self) -> pd.DataFrame:
        """How many points are as specified.

        One row a quantity: ``from`` and ``to``, the number of ``points`` and their ``share`` with
        the interval of Wilson (95 %), ``low`` and ``high``. In the last row those that are so in
        all. A point that has failed, or has no number, is not as specified.
        """
        import pandas as pd

        points, rows = self.points, []
        good = np.full(len(points), True)
        for name, (low, high) in self.specification.items():
            fine = points[name].between(low, high).to_numpy()
            good &= fine
            rows.append((name, low, high, fine))
        rows.append((ALL, math.nan, math.nan, good))
        found = []
        for name, low, high, fine in rows:
            count = int(fine.sum())
            found.append((name, low, high, count, count / len(fine), *wilson(count, len(fine))))
        headings = ["quantity", "from", "to", "points", "share", "low", "high"]
        return pd.DataFrame(found, columns=headings)

    def quantiles(self, q: Sequence[float] = (0.05, 0.5, 0.95)) -> pd.DataFrame:
        """Return quantiles of what is measured, over the points that have a number.

        Parameters
        ----------
        q : sequence of float, optional
            Between 0 and 1.

        Returns
        -------
        DataFrame
            One row a quantity, one column a quantile, and the number of ``points``.
        """
        values = np.atleast_1d(np.asarray(q, dtype=float))
        if not ((values >= 0.0) & (values <= 1.0)).all():
            raise InvalidParameter("q", q, "between 0 and 1")
        points = self.points[self.quantities]
        found = points.quantile(values.tolist()).T
        found["points"] = points.notna().sum()
        found.attrs = dict(self.table.attrs)
        return found

    def _counted(self) -> str:
        kinds = motions(self.points)
        counts = kinds.value_counts()
        return ", ".join(f"{counts[kind]} {kind}" for kind in in_order(kinds))
