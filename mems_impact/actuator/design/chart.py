"""The chart of Fig. 7: at which voltage the device switches on and off, over the frequency."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from mems_impact.actuator import tables
from mems_impact.actuator.system import ActuatorSystem
from mems_impact.analysis.special import CodimensionTwo, GrazingType
from mems_impact.analysis.values import Value

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["AMPLITUDE", "OFF", "OMEGA", "ON", "SLIP", "STEADY_FROM", "STEADY_TO", "Chart", "Point"]

AMPLITUDE, OMEGA = "amplitude", "omega"
ON, OFF, SLIP = "on", "off", "slip"
STEADY_FROM, STEADY_TO = "steady from", "steady to"

Point = tuple[float, float]  # omega and amplitude


@dataclass(frozen=True, kw_only=True, eq=False)
class Chart(Value):
    """On- and off-boundaries over the frequency.

    Attributes
    ----------
    system : ActuatorSystem
    omega : tuple of float
        The range of the chart.
    special_points : tuple of CodimensionTwo
        Of the grazing curve: the frequencies that separate the types.
    notes : tuple of str
        What could not be computed, and why; empty if all was.

    See Also
    --------
    operating_chart, plot_chart

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> chart = mi.operating_chart(actuator, drive, omega=(0.478, 0.495), crises=0)
    >>> chart.special_table.columns.tolist()
    ['kind', 'omega', 'amplitude']
    """

    system: ActuatorSystem = field(repr=False)
    omega: tuple[float, float]
    special_points: tuple[CodimensionTwo, ...]
    notes: tuple[str, ...]
    regions: tuple[tuple[GrazingType, float, float], ...]
    pieces: tuple[tuple[str, GrazingType | None, str, tuple[Point, ...]], ...] = field(repr=False)

    def __repr__(self) -> str:
        low, high = self.omega
        notes = f"; {len(self.notes)} notes" if self.notes else ""
        return f"Chart({OMEGA} {low:g} to {high:g}, types {self._types()}{notes})"

    def summary(self) -> dict[str, Any]:
        """Return the range, the types and what separates them."""
        low, high = self.omega
        found = [f"{s.kind} at {s.values[OMEGA]:.6g}" for s in self.special_points]
        return {
            "system": repr(self.system),
            self.system.label(OMEGA): f"{low:g} to {high:g}",
            "types": self._types(),
            "special points": ", ".join(found) or "none",
            "notes": "; ".join(self.notes) or "none",
        }

    def _types(self) -> str:
        return ", ".join(region.paper for region, _, _ in self.regions) or "none"

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row a point of a boundary, each boundary in ascending omega.

        Columns: boundary ("on", "off"; where the frame slips before the block strikes also "slip",
        where it begins to, and "steady from" and "steady to", between which the block strikes alike
        in every forcing period), omega, amplitude, type of the paper (I, II, III; none where the
        frame slips first), kind (what happens there: grazing, fold, crisis, break-away, …).
        """
        rows = [
            {
                "boundary": boundary,
                "values": (self.system.out(OMEGA, omega), self.system.out(AMPLITUDE, amplitude)),
                "type": region.paper if region is not None else "",
                "kind": kind,
            }
            for boundary, region, kind, points in self.pieces
            for omega, amplitude in points
        ]
        return tables.chart((OMEGA, AMPLITUDE), rows, self.system)

    @cached_property
    def types(self) -> pd.DataFrame:
        """One row a type: where it begins and ends, and what its boundaries are."""
        kinds = {(boundary, region): kind for boundary, region, kind, _ in self.pieces}
        rows = [
            {
                "type": region.paper,
                "grazing": str(region),
                "values": (self.system.out(OMEGA, low), self.system.out(OMEGA, high)),
                ON: kinds.get((ON, region), ""),
                OFF: kinds.get((OFF, region), ""),
            }
            for region, low, high in self.regions
        ]
        return tables.chart_types(OMEGA, rows, self.system)

    @cached_property
    def special_table(self) -> pd.DataFrame:
        """One row a point of codimension two: kind, omega, amplitude."""
        rows = [
            {"kind": s.kind, "values": (s.values[OMEGA], s.values[AMPLITUDE])}
            for s in self.special_points
        ]
        return tables.chart_points((OMEGA, AMPLITUDE), rows, self.system)
