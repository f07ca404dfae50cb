"""Branches of periodic orbits in one parameter, and curves of their special points in two."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from mems_impact.analysis.orbit import Orbit, orbit_of
from mems_impact.analysis.progress import values_of
from mems_impact.analysis.state import is_number
from mems_impact.analysis.system import System
from mems_impact.analysis.values import Value
from mems_impact.continuation import branch as branches
from mems_impact.continuation import curve as curves
from mems_impact.continuation import grazing
from mems_impact.continuation.branch import Steps
from mems_impact.continuation.monitors import LABELS
from mems_impact.continuation.switching import doubled
from mems_impact.errors import InvalidParameter
from mems_impact.orbits.orbit import PeriodicOrbit
from mems_impact.tables import orbits as tables

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Branch",
    "CodimensionTwo",
    "Curve",
    "GrazingType",
    "SpecialPoint",
    "Steps",
    "continue_curve",
    "continue_orbit",
    "grazing_type",
    "switch_branch",
]

BRANCH_STEPS = Steps(largest=0.02)  # so that a branch is smooth to the eye
NEAR = 1e-3  # within this part of its parameter, the other side of a grazing is looked for


class GrazingType(StrEnum):
    """How the attractor leaves a grazing orbit when the parameter goes on.

    CONTINUOUS: a small attractor with impacts bifurcates from it, the paper's type II. JUMP: the
    next attractor is far away, and there is hysteresis, type I. DIED_EARLIER: the orbit was
    unstable before it grazed, the stable one having vanished in a fold, type III.
    """

    CONTINUOUS = grazing.CONTINUOUS
    JUMP = grazing.JUMP
    DIED_EARLIER = grazing.DEAD

    @property
    def paper(self) -> str:
        """The type's number in the paper: I, II or III."""
        return {GrazingType.CONTINUOUS: "II", GrazingType.JUMP: "I"}.get(self, "III")


@dataclass(frozen=True, kw_only=True, eq=False)
class SpecialPoint(Value):
    """A point of a branch at which something happens.

    Attributes
    ----------
    kind : str
        "grazing", "fold", "period-doubling", "Neimark-Sacker", or the guard that is touched, such
        as "break-away".
    label : str
        As in the paper: G, CF, PD; NS; else the kind.
    parameter : str
    value : float
        Of the parameter.
    orbit : Orbit
        There.
    bounds : tuple of float
        Of the branch.
    """

    kind: str
    label: str
    parameter: str
    value: float
    orbit: Orbit
    bounds: tuple[float, float] = field(repr=False)
    found: branches.SpecialPoint = field(repr=False)
    beyond: PeriodicOrbit | None = field(repr=False, default=None)

    def __repr__(self) -> str:
        return f"SpecialPoint({self.label} at {self.parameter}={self.value:.9g}, {self.orbit})"

    @property
    def system(self) -> System:
        """The orbit's."""
        return self.orbit.system

    def summary(self) -> dict[str, Any]:
        """Return what happens, where, and to which orbit."""
        return {
            "kind": self.kind,
            self.system.label(self.parameter): self.value,
            **self.orbit.summary(),
        }

    @property
    def multipliers(self) -> NDArray[np.complex128]:
        """Floquet multipliers; where an impact comes in or drops out they grow without bound."""
        return self.orbit.multipliers

    @cached_property
    def without_impact(self) -> branches.SpecialPoint:
        """The same grazing, as the end of the branch that does not have the impact.

        There everything is smooth, while on the side of the impact multipliers are infinite.
        """
        found = self.found
        if found.monitor.role != "rate" or self.beyond is None:
            return found
        away = found.value - self.beyond.family.values[self.parameter]
        width = NEAR * abs(found.value)
        other = branches.follow(
            self.beyond,
            self.parameter,
            low=found.value - width,
            high=found.value + width,
            direction=math.copysign(1.0, away),
            reconnecting=False,
        )
        touching = [s for s in other.special_points if s.monitor.role == "approach"]
        return touching[0] if touching else found


@dataclass(frozen=True, kw_only=True, eq=False)
class Branch(Value):
    """Periodic orbits over one parameter.

    Attributes
    ----------
    system : System
        Where the branch began.
    parameter : str
    bounds : tuple of float
        Between which the parameter was varied.
    special_points : tuple of SpecialPoint
        In the order in which the branch passes them.
    ended : str
        Why the branch ends.
    """

    system: System = field(repr=False)
    parameter: str
    bounds: tuple[float, float]
    special_points: tuple[SpecialPoint, ...]
    ended: str
    found: branches.OrbitBranch = field(repr=False)

    kept: ClassVar[tuple[str, ...]] = ("table", "special_table")

    def __repr__(self) -> str:
        low, high = self.bounds
        return (
            f"Branch({self.parameter} {low:g} to {high:g}, {len(self)} orbits, "
            f"special points: {self._special()}; ended: {self.ended})"
        )

    def summary(self) -> dict[str, Any]:
        """Return the range, the special points and why the branch ends."""
        low, high = self.bounds
        return {
            "system": repr(self.system),
            self.system.label(self.parameter): f"{low:g} to {high:g}",
            "orbits": len(self),
            "special points": self._special(),
            "ended": self.ended,
        }

    def _special(self) -> str:
        return ", ".join(f"{s.label} {s.value:.6g}" for s in self.special_points) or "none"

    def __len__(self) -> int:
        return len(self.found.points)

    @cached_property
    def orbits(self) -> tuple[Orbit, ...]:
        """All orbits of the branch, in its order."""
        return tuple(orbit_of(self.system, point.orbit) for point in self.found.points)

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row an orbit, in the order of the branch.

        Columns: the parameter, stable, admissible, piece (0, 1, …: a new one where an impact or
        another event comes in or drops out), largest multiplier (its absolute value; inf where an
        impact has lost its speed), impacts and the largest impact speed over the orbit, closest
        approach, observables, and the states at the crossings of the section upwards, or where
        forcing periods begin, largest first: v2, v2 2, v2 3, …
        """
        rows = [
            {
                "value": self.system.out(self.parameter, point.value),
                **_measures(orbit, piece=point.piece),
            }
            for point, orbit in zip(self.found.points, self.orbits, strict=True)
        ]
        return tables.branch(self.parameter, rows, self.system)

    @cached_property
    def special_table(self) -> pd.DataFrame:
        """One row a special point: label, kind, the parameter, and as in `table`."""
        rows = [
            {"label": s.label, "kind": s.kind, "value": s.value, **_measures(s.orbit)}
            for s in self.special_points
        ]
        return tables.special_points(self.parameter, rows, self.system)

    def switch(self, special: SpecialPoint, **arguments: Any) -> Branch:
        """Follow the branch of twice the period that leaves a period doubling of this one.

        As `switch_branch`.
        """
        return switch_branch(special, **arguments)


@dataclass(frozen=True, kw_only=True, eq=False)
class CodimensionTwo(Value):
    """A point of a curve at which a second thing happens.

    Attributes
    ----------
    kind : str
        "grazing-fold" (a grazing orbit with a multiplier +1), "degenerate grazing" (the first
        impact leads neither away from the stopper nor towards it), "cusp", "fold-flip", or in
        words what else is touched.
    values : dict of str to float
        Of the two parameters.
    orbit : Orbit
    """

    kind: str
    values: dict[str, float]
    orbit: Orbit

    def __repr__(self) -> str:
        where = ", ".join(f"{name}={value:.9g}" for name, value in self.values.items())
        return f"CodimensionTwo({self.kind} at {where})"

    @property
    def system(self) -> System:
        """The orbit's."""
        return self.orbit.system

    def summary(self) -> dict[str, Any]:
        """Return what happens, where, and to which orbit."""
        return {"kind": self.kind, **self.values, **self.orbit.summary()}


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve(Value):
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
    """

    system: System = field(repr=False)
    kind: str
    label: str
    parameters: tuple[str, str]
    special_points: tuple[CodimensionTwo, ...]
    ended: str
    found: curves.OrbitCurve = field(repr=False)

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

    def __len__(self) -> int:
        return len(self.found.points)

    @cached_property
    def orbits(self) -> tuple[Orbit, ...]:
        """All orbits of the curve, in its order."""
        return tuple(orbit_of(self.system, point.orbit) for point in self.found.points)

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
                **_measures(orbit),
            }
            for point, orbit in zip(self.found.points, self.orbits, strict=True)
        ]
        return tables.curve([second, first], rows, self.system)

    @cached_property
    def special_table(self) -> pd.DataFrame:
        """One row a point of codimension two."""
        first, second = self.parameters
        rows = [
            {"kind": s.kind, "values": [s.values[second], s.values[first]], **_measures(s.orbit)}
            for s in self.special_points
        ]
        return tables.codimension_two([second, first], rows, self.system)


def continue_orbit(
    orbit: Orbit,
    parameter: str,
    stop: float,
    *,
    back: float | None = None,
    steps: Steps = BRANCH_STEPS,
    through_grazing: bool = True,
    progress: bool | Callable[[float], None] = False,
) -> Branch:
    """Follow a periodic orbit, stable or not, over one parameter.

    Folds are passed, and grazings and period doublings; each is located and listed.

    Parameters
    ----------
    orbit : Orbit
    parameter : str
        A number of the drive (``"amplitude"``, ``"omega"``, …) or of the actuator.
    stop : float
        Value towards which the branch sets out, and at which it ends.
    back : float, optional
        A branch that turns round ends here at the latest; where it began by default.
    steps : Steps, optional
        Lengths of the steps, and their largest number.
    through_grazing : bool, optional
        Whether to go on with the orbit that has one impact more, or less, where one is grazed. If
        not, the branch goes on with orbits that penetrate the stopper or impact backwards; they
        are marked as not admissible.
    progress : bool or callable, optional
        True: show a counter if it takes over a second. A function is called with every value.

    Returns
    -------
    Branch
        Whatever ends it: `ended` says what.

    Raises
    ------
    InvalidParameter
        If an argument is out of range, or `stop` is no value for the parameter.
    """
    _check(orbit, "orbit", Orbit, "an Orbit, from find_orbit")
    system = orbit.system
    bounds = _bounds(system, parameter, stop, back)
    direction = math.copysign(1.0, stop - system.value(parameter))
    low, high = (system.into(parameter, bound) for bound in bounds)
    # Where the branch begins, to the last digit of the numerics.
    begin = orbit.found.family.values[parameter]
    with values_of(progress, parameter, "orbits", partial(system.out, parameter)) as report:
        found = branches.follow(
            orbit.found,
            parameter,
            low=min(low, begin),
            high=max(high, begin),
            direction=direction,
            steps=steps,
            reconnecting=through_grazing,
            progress=report,
        )
    return _branch(system, found, bounds)


def switch_branch(
    special: SpecialPoint,
    *,
    bounds: tuple[float, float] | None = None,
    steps: Steps = BRANCH_STEPS,
    through_grazing: bool = True,
    progress: bool | Callable[[float], None] = False,
) -> Branch:
    """Follow the orbit of twice the period that begins at a period doubling.

    Parameters
    ----------
    special : SpecialPoint
        A period doubling of a branch.
    bounds : tuple of float, optional
        Smallest and largest value of the parameter; those of the branch by default.
    steps, through_grazing, progress
        As for `continue_orbit`.

    Returns
    -------
    Branch

    Raises
    ------
    InvalidParameter
        If `special` is no period doubling.
    OrbitError
        If no orbit of twice the period is found.
    """
    _check(special, "special", SpecialPoint, "a special point of a branch")
    if special.label != "PD":
        raise InvalidParameter("special", special.kind, "a period doubling")
    parameter, system = special.parameter, special.orbit.system
    low, high = special.bounds if bounds is None else bounds
    _value(system, parameter, "bounds", low)
    _value(system, parameter, "bounds", high)
    if not low < special.value < high:
        allowed = f"smallest and largest value, with {special.value:g} between them"
        raise InvalidParameter("bounds", (low, high), allowed)
    first, side = doubled(special.found.orbit, parameter)
    with values_of(progress, parameter, "orbits", partial(system.out, parameter)) as report:
        found = branches.follow(
            first,
            parameter,
            low=system.into(parameter, low),
            high=system.into(parameter, high),
            direction=side,
            steps=steps,
            reconnecting=through_grazing,
            progress=report,
        )
    return _branch(system, found, (low, high))


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

    Points of codimension two on the way are located and listed.

    Parameters
    ----------
    special : SpecialPoint
        A grazing, fold or period doubling, or the touching of another guard.
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
    """
    _check(special, "special", SpecialPoint, "a special point of a branch")
    system, first = special.orbit.system, special.parameter
    if parameter == first:
        raise InvalidParameter("parameter", parameter, "another one than that of the branch")
    bounds = _bounds(system, parameter, stop, back)
    direction = math.copysign(1.0, stop - system.value(parameter))
    with values_of(progress, parameter, "orbits", partial(system.out, parameter)) as report:
        found = curves.follow_curve(
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


def grazing_type(special: SpecialPoint) -> GrazingType:
    """Return how the attractor leaves a grazing, from the normal form of the first impact.

    Parameters
    ----------
    special : SpecialPoint
        The grazing of an orbit without impacts, met from either side.

    Returns
    -------
    GrazingType
        "continuous" (type II of the paper), "jump" (type I) or "died earlier" (type III); its
        ``paper`` is the number.

    Raises
    ------
    InvalidParameter
        If `special` is another point, or the orbit has other impacts.

    Notes
    -----
    Nordmark (1991): the sign of the sequence grad h . M^k kick, k = 1, 2, …, with the monodromy
    matrix M of the orbit without impact.
    """
    _check(special, "special", SpecialPoint, "a special point of a branch")
    found = special.without_impact
    if special.label != "G" or found.monitor.role != "approach":
        raise InvalidParameter("special", special.kind, "a grazing of an orbit without impacts")
    return GrazingType(grazing.grazing_type(found.orbit, found.monitor))


def _branch(system: System, found: branches.OrbitBranch, bounds: tuple[float, float]) -> Branch:
    parameter = found.parameter
    after = {
        id(here.orbit): there.orbit
        for here, there in zip(found.points, found.points[1:], strict=False)
    }
    special = tuple(
        SpecialPoint(
            kind=s.kind,
            label=s.label,
            parameter=parameter,
            value=system.out(parameter, s.value),
            orbit=orbit_of(system, s.orbit),
            bounds=bounds,
            found=s,
            beyond=after.get(id(s.orbit)),
        )
        for s in found.special_points
    )
    return Branch(
        system=system,
        parameter=parameter,
        bounds=bounds,
        special_points=special,
        ended=found.ended,
        found=found,
    )


def curve_of(system: System, found: curves.OrbitCurve) -> Curve:
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


def _measures(orbit: Orbit, **place: int) -> dict[str, Any]:
    """Return what the tables say of an orbit, in the units of the numerics; `place`: on what."""
    found, system = orbit.found, orbit.system
    return {
        "stable": found.stable,
        "admissible": found.admissible,
        **place,
        "largest multiplier": math.inf if found.touches else float(abs(found.multipliers[0])),
        "impacts": len(orbit.impact_speeds),
        "impact speed": max(orbit.impact_speeds, default=math.nan),
        "closest approach": orbit.closest,
        **orbit.observables,
        "states": dict(zip(system.shown, orbit.shown_states.T, strict=True)),
    }


def _bounds(system: System, parameter: str, stop: float, back: float | None) -> tuple[float, float]:
    """Return the bounds between which to go; InvalidParameter if there is no way to go."""
    system.check_continued(parameter)
    here = system.value(parameter)
    _value(system, parameter, "stop", stop)
    if stop == here:
        raise InvalidParameter("stop", stop, f"another value than {here:g}, where the orbit is")
    if back is None:
        back = here
    _value(system, parameter, "back", back)
    if (back - here) * (stop - here) > 0.0:
        raise InvalidParameter("back", back, f"{here:g}, or on the other side of it than stop")
    return (stop, back) if stop < back else (back, stop)


def _value(system: System, parameter: str, field: str, value: Any) -> None:
    if not is_number(value):
        raise InvalidParameter(field, value, f"a finite value of {parameter}")
    system.changed(**{parameter: value})


def _check(value: object, field: str, kind: type, allowed: str) -> None:
    if not isinstance(value, kind):
        raise InvalidParameter(field, value, allowed)
