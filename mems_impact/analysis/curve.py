"""Curves of special points in two parameters."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, ClassVar

from mems_impact.analysis.branch import Followed, bounds_of, measures
from mems_impact.analysis.orbit import orbit_of
from mems_impact.analysis.progress import values_of
from mems_impact.analysis.special import CodimensionTwo, SpecialPoint, check_kind
from mems_impact.analysis.system import System
from mems_impact.continuation.branch import Steps
from mems_impact.continuation.curve import OrbitCurve, follow_curve
from mems_impact.continuation.monitors import BRANCH_POINT, LABELS, UNEXPLAINED
from mems_impact.errors import InvalidParameter
from mems_impact.tables import orbits as orbit_tables

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Curve", "continue_curve", "curve_of"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve(Followed):
    """A special point followed in a second parameter.

    Attributes
    ----------
    system : System
    kind, label : str
        Of the special point.
    parameters : tuple of str
        The parameter of the branch, then the second one.
    special_points : tuple of CodimensionTwo
    ended : str
        Why the curve ends.

    See Also
    --------
    continue_curve, plot_curve

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked(actuator))
    >>> branch = mi.continue_orbit(orbit, "amplitude", stop=0.17)
    >>> curve = mi.continue_curve(branch.special_points[0], "omega", stop=0.51)
    >>> list(curve.table.columns[:2]), curve.ended
    (['omega', 'amplitude'], 'omega reached its bound')
    """

    system: System = field(repr=False)
    kind: str
    label: str
    parameters: tuple[str, str]
    special_points: tuple[CodimensionTwo, ...]
    ended: str
    found: OrbitCurve = field(repr=False)

    kept: ClassVar[tuple[str, ...]] = ("table", "special_table")

    def __repr__(self) -> str:
        return (
            f"Curve({self.label} over {' and '.join(self.parameters)}, {len(self)} orbits, "
            f"special points: {self._special()}; ended: {self.ended})"
        )

    def summary(self) -> dict[str, Any]:
        """Return what is followed, the points of codimension two and why the curve ends."""
        return {
            "system": repr(self.system),
            "kind": self.kind,
            "parameters": ", ".join(map(self.system.label, self.parameters)),
            "orbits": len(self),
            "special points": self._special(),
            "ended": self.ended,
        }

    def _special(self) -> str:
        found = [
            f"{s.kind} ({', '.join(f'{value:.6g}' for value in s.values.values())})"
            for s in self.special_points
        ]
        return ", ".join(found) or "none"

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row an orbit: the second parameter, the first, and as in `Branch.table`."""
        first, second = self.parameters
        rows = [
            {
                "values": [
                    self.system.out(second, point.values[1]),
                    self.system.out(first, point.values[0]),
                ],
                **measures(orbit),
            }
            for point, orbit in zip(self.found.points, self.orbits, strict=True)
        ]
        return orbit_tables.curve([second, first], rows, self.system)

    @cached_property
    def special_table(self) -> pd.DataFrame:
        """One row a point of codimension two."""
        first, second = self.parameters
        rows = [
            {"kind": s.kind, "values": [s.values[second], s.values[first]], **measures(s.orbit)}
            for s in self.special_points
        ]
        return orbit_tables.codimension_two([second, first], rows, self.system)


def continue_curve(
    special: SpecialPoint,
    parameter: str,
    stop: float,
    *,
    back: float | None = None,
    steps: Steps = Steps(),  # noqa: B008 - immutable
    progress: bool | Callable[[float], None] = False,
) -> Curve:
    """Follow a special point of a branch in a second parameter.

    Points of codimension two on the way are located and listed. A curve of Neimark-Sacker points
    ends where its pair of multipliers becomes real, at a 1:1 or 1:2 resonance.

    Parameters
    ----------
    special : SpecialPoint
        A grazing, fold, period doubling or Neimark-Sacker point, or the touching of another guard.
    parameter : str
        The second parameter; the first is that of the branch.
    stop : float
        Value towards which the curve sets out, and at which it ends.
    back : float, optional
        A curve that turns round ends here at the latest; where it began by default.
    steps, progress
        As for `continue_orbit`.

    Returns
    -------
    Curve
        Whatever ends it: `ended` says what.

    Raises
    ------
    InvalidParameter
        If an argument is out of range.

    See Also
    --------
    Curve, continue_orbit, plot_curve, operating_chart

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked(actuator))
    >>> branch = mi.continue_orbit(orbit, "amplitude", stop=0.17)
    >>> fold = branch.special_points[0]
    >>> curve = mi.continue_curve(fold, "omega", stop=0.51)
    >>> curve.kind, curve.parameters
    ('fold', ('amplitude', 'omega'))
    """
    check_kind(special, "special", SpecialPoint, "a special point of a branch")
    system, first = special.orbit.system, special.parameter
    if parameter == first:
        raise InvalidParameter("parameter", parameter, "another one than that of the branch")
    if special.kind == BRANCH_POINT:
        allowed = "one whose curve is followed: a branch point is none of a family of orbits alone"
        raise InvalidParameter("special", special.kind, allowed)
    if special.kind == UNEXPLAINED:
        raise InvalidParameter("special", special.kind, "a point of which it is known what it is")
    bounds = bounds_of(system, parameter, stop, back)
    direction = math.copysign(1.0, stop - system.value(parameter))
    with values_of(
        progress, system.label(parameter), "orbits", partial(system.out, parameter)
    ) as report:
        found = follow_curve(
            special.without_impact,
            first,
            parameter,
            low=system.into(parameter, bounds[0]),
            high=system.into(parameter, bounds[1]),
            direction=direction,
            steps=steps,
            progress=report,
        )
    return curve_of(system, found)


def curve_of(system: System, found: OrbitCurve) -> Curve:
    """Return a curve of the continuation in the user's terms."""
    special = tuple(
        CodimensionTwo(
            kind=s.kind,
            values={
                name: system.out(name, value)
                for name, value in zip(found.parameters, s.values, strict=True)
            },
            orbit=orbit_of(system, s.orbit),
        )
        for s in found.special_points
    )
    return Curve(
        system=system,
        kind=found.kind,
        label=LABELS.get(found.kind, found.kind),
        parameters=found.parameters,
        special_points=special,
        ended=found.ended,
        found=found,
    )
