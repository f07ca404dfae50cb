"""Operating charts: on- and off-voltages over the frequency."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from mems_impact.actuator.system import ActuatorSystem
from mems_impact.analysis.special_points import CodimensionTwo, GrazingType
from mems_impact.systems.result import Result
from mems_impact.tables import row_table

if TYPE_CHECKING:
    import pandas as pd

AMPLITUDE = "amplitude"
ON, OFF, SLIP = "on", "off", "slip"
STEADY_FROM, STEADY_TO = "steady from", "steady to"

Point = tuple[float, float]  # omega and amplitude


@dataclass(frozen=True, kw_only=True, eq=False)
class OperatingChart(Result):
    """On- and off-voltages over the frequency.

    Attributes
    ----------
    system : ActuatorSystem
    frequencies : tuple of float
        The range of omega or, for a drive given by its frequency, of the frequency [Hz].
    special_points : tuple of CodimensionTwo
        Points of codimension two of the grazing curve, which separate the types.
    notes : tuple of str
        Parts that could not be computed, and the reasons; empty if complete.

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
    frequencies: tuple[float, float]
    special_points: tuple[CodimensionTwo, ...]
    notes: tuple[str, ...]
    regions: tuple[tuple[GrazingType, float, float], ...]
    pieces: tuple[tuple[str, GrazingType | None, str, tuple[Point, ...]], ...] = field(repr=False)

    def __repr__(self) -> str:
        low, high = self.frequencies
        notes = f"; {len(self.notes)} notes" if self.notes else ""
        return f"OperatingChart({self._name} {low:g} to {high:g}, types {self._types()}{notes})"

    def summary(self) -> dict[str, Any]:
        """Return the range, the types and the points between them."""
        low, high = self.frequencies
        points = [f"{s.kind} at {s.values[self._name]:.6g}" for s in self.special_points]
        return {
            "system": repr(self.system),
            self.system.units.label(self._name): f"{low:g} to {high:g}",
            "types": self._types(),
            "special points": ", ".join(points) or "none",
            "notes": "; ".join(self.notes) or "none",
        }

    @property
    def parameters(self) -> tuple[str, str]:
        """Names of the two parameters: "omega" or "frequency", and "amplitude"."""
        return self.system.frequency_parameter, AMPLITUDE

    @property
    def _name(self) -> str:
        return self.parameters[0]

    def _types(self) -> str:
        return ", ".join(region.paper for region, _, _ in self.regions) or "none"

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row per point of a boundary, each boundary in ascending frequency.

        Columns: boundary ("on", "off"; if the frame slips before the block strikes also "slip", the
        onset of slip, and "steady from" and "steady to", the window of a period-1 orbit with
        impacts), omega or frequency, amplitude, type of the paper (I, II, III; none if the frame
        slips first), kind of bifurcation (grazing, fold, crisis, break-away, …).
        """
        out = self.system.units.out
        headings = {
            "boundary": str,
            **dict.fromkeys(self.parameters, float),
            "type": str,
            "kind": str,
        }
        rows = [
            (boundary, *map(out, self.parameters, point), region.paper if region else "", kind)
            for boundary, region, kind, points in self.pieces
            for point in points
        ]
        return row_table(headings, rows, self.system, symbols=dict(self.system.units.symbols))

    @cached_property
    def types(self) -> pd.DataFrame:
        """One row per type: its range, and the kinds of its boundaries."""
        kinds = {(boundary, region): kind for boundary, region, kind, _ in self.pieces}
        out, ends = self.system.units.out, (f"{self._name} from", f"{self._name} to")
        headings = {"type": str, "grazing": str, **dict.fromkeys(ends, float), ON: str, OFF: str}
        rows = [
            (
                region.paper, str(region), out(self._name, low), out(self._name, high),
                kinds.get((ON, region), ""), kinds.get((OFF, region), ""),
            )
            for region, low, high in self.regions
        ]  # fmt: skip
        return row_table(headings, rows, self.system)

    @cached_property
    def special_table(self) -> pd.DataFrame:
        """One row per point of codimension two: kind, omega or frequency, amplitude."""
        rows = [(s.kind, s.values[self._name], s.values[AMPLITUDE]) for s in self.special_points]
        return row_table({"kind": str, **dict.fromkeys(self.parameters, float)}, rows, self.system)
