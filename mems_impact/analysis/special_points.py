"""Special points of branches, and types of grazing."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import Any, Generic, TypeVar

from mems_impact.analysis.boundary_equilibrium_type import BoundaryType, boundary_type
from mems_impact.analysis.equilibrium import Equilibrium
from mems_impact.analysis.orbit import Orbit
from mems_impact.analysis.sliding_type import SlidingType, sliding_type
from mems_impact.analysis.solution import S, solution_of
from mems_impact.continuation import grazing
from mems_impact.continuation.branch import EquilibriumEvent, OrbitEvent
from mems_impact.continuation.codimension_two import codimension_two_form
from mems_impact.continuation.equilibrium_branch import BOUNDARY
from mems_impact.continuation.normal_forms import (
    NormalForm,
    equilibrium_normal_form,
    orbit_normal_form,
)
from mems_impact.continuation.orbit_branch import follow
from mems_impact.continuation.sliding import is_discontinuity
from mems_impact.continuation.test_functions import ClosestApproachTest, ContactSpeedTest, FoldTest
from mems_impact.errors import OrbitError
from mems_impact.orbits.equilibrium import EquilibriumState
from mems_impact.orbits.periodic_orbit import PeriodicOrbit
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.result import Result

T = TypeVar("T")

GRAZING_SEARCH_RATIO = 1e-3  # relative range in which the other side of a grazing is sought


class GrazingType(StrEnum):
    """Type of a grazing bifurcation: the attractor beyond it.

    CONTINUOUS: a small attractor with impacts bifurcates from the grazing orbit, the paper's type
    II. JUMP: the next attractor is far away, with hysteresis, type I. AFTER_FOLD: the orbit is
    already unstable when it grazes, since the stable orbit vanished in a fold, type III.

    See Also
    --------
    SpecialPoint, operating_chart

    Examples
    --------
    >>> import mems_impact as mi
    >>> [kind.paper for kind in mi.GrazingType]
    ['II', 'I', 'III']
    >>> mi.GrazingType("jump").paper
    'I'
    """

    CONTINUOUS = grazing.CONTINUOUS
    JUMP = grazing.JUMP
    AFTER_FOLD = grazing.AFTER_FOLD

    @property
    def paper(self) -> str:
        """The type's number in the paper: I, II or III."""
        return {GrazingType.CONTINUOUS: "II", GrazingType.JUMP: "I"}.get(self, "III")


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class BifurcationPoint(Result, ABC, Generic[S]):
    """Base class of special points of branches and curves."""

    solution: S

    @property
    def orbit(self) -> Orbit:
        """The orbit; AttributeError at an equilibrium."""
        return _only(self, self.solution, Orbit)

    @property
    def equilibrium(self) -> Equilibrium:
        """The equilibrium; AttributeError at an orbit."""
        return _only(self, self.solution, Equilibrium)

    @property
    def system(self) -> HybridSystem:
        """System of the solution."""
        return self.solution.system

    @property
    @abstractmethod
    def normal_form(self) -> NormalForm | None:
        """The normal form of the bifurcation; None if points of this kind have none."""

    @property
    def criticality(self) -> str:
        """Supercritical or subcritical; empty if the point has none, or its sign is uncertain."""
        try:
            form = self.normal_form
        except OrbitError:
            return ""
        return "" if form is None else form.criticality


@dataclass(frozen=True, kw_only=True, eq=False)
class SpecialPoint(BifurcationPoint[S]):
    """A special point of a branch of periodic orbits or equilibria.

    Attributes
    ----------
    kind : str
        Of orbits: "grazing", "fold", "period-doubling", "Neimark-Sacker", "branch point" (another
        branch crosses, as in symmetric systems), the name of another guard that is touched, such as
        "break-away", "onset of complete chatter" (beyond which the chatter sequence does not end in
        sticking contact). Of equilibria: "fold", "Hopf", "branch point", "boundary equilibrium".
        Of both: "unexplained" where the number of unstable multipliers or eigenvalues changes
        without such a point.
    label : str
        G, CF or PD, as in the paper; NS, BP, CC, ?; for another guard the kind. Of equilibria: LP,
        H, BP, BE, ?.
    parameter : str
    value : float
        Value of the parameter.
    solution : Orbit or Equilibrium
        The solution at that value, also as `orbit` or `equilibrium`.
    bounds : tuple of float
        Bounds of the branch.

    See Also
    --------
    Branch, switch_branch, continue_curve, GrazingType, SlidingType, BoundaryType

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> branch = mi.continue_solution(orbit, "amplitude", stop=0.17)
    >>> fold = branch.special_points[0]
    >>> fold.kind, fold.parameter, round(fold.value, 7)
    ('fold', 'amplitude', 0.1765154)
    >>> f"{max(fold.orbit.multipliers.real):.3f}"
    '1.000'
    >>> branch.special_points[1].type.paper
    'I'
    """

    kind: str
    label: str
    parameter: str
    value: float
    bounds: tuple[float, float] = field(repr=False)
    numeric: OrbitEvent | EquilibriumEvent = field(repr=False)
    next_orbit: PeriodicOrbit | None = field(repr=False, default=None)

    def __repr__(self) -> str:
        return f"SpecialPoint({self.label} at {self.parameter}={self.value:.9g}, {self.solution})"

    @property
    def guard(self) -> str:
        """The guard of a boundary equilibrium; empty for other kinds."""
        return self.numeric.guard

    def summary(self) -> dict[str, Any]:
        """Return the kind, the value of the parameter and the solution."""
        location = {self.system.units.label(self.parameter): self.value}
        return {"kind": self.kind, **location, **self.solution.summary()}

    @cached_property
    def normal_form(self) -> NormalForm | None:
        """The normal form of a fold, period doubling, Neimark-Sacker, Hopf or branch point.

        None for other kinds.

        Raises
        ------
        OrbitError
            If the Poincaré map near the orbit, or the flow near the equilibrium, cannot be
            differentiated.
        """
        numeric, doubled = self.numeric.solution, isinstance(self.numeric.monitor, FoldTest)
        if isinstance(numeric, EquilibriumState):
            return equilibrium_normal_form(self.kind, numeric)
        return orbit_normal_form(self.kind, numeric.shooting, numeric.point, doubled=doubled)

    @cached_property
    def type(self) -> GrazingType | SlidingType | BoundaryType | None:
        """The type of a grazing, of a point at a discontinuity or of a boundary equilibrium.

        None for other kinds.

        - A grazing of an orbit without impacts has a `GrazingType` by the normal form of the first
          impact: the sign of the sequence grad h . M^k kick, k = 1, 2, …, decides, with the
          monodromy matrix M of the orbit without impact (Nordmark 1991).
        - A point at which an orbit meets a discontinuity of its field has a `SlidingType`. A mode
          slides on the surface of a guard if it keeps the guard's margin constant there, so modes
          of components, of hand-written guards and of the actuator are recognized alike. The field
          on the other side is known only if a guard leads from there to sliding. See di Bernardo,
          Kowalczyk and Nordmark, Physica D 170 (2002) 175-205.
        - A boundary equilibrium has a `BoundaryType` by Feigin's rules. For a field that is
          continuous across the surface, the criterion is the ratio of the determinants of both
          Jacobians, 1 + C^T N^-1 E. For a Filippov system the other branch consists of
          pseudo-equilibria, and the criterion has the sign of -C^T N^-1 E, where E is the jump of
          the field. See di Bernardo, Budd, Champneys and Kowalczyk, "Piecewise-smooth Dynamical
          Systems", Springer, 2008, sections 5.2 and 5.3.

        Raises
        ------
        OrbitError
            If the type cannot be determined: a grazing of an orbit with other impacts, or a weak
            contact that does not lead back to the mode before it; a discontinuity where no mode
            slides; a boundary equilibrium where no other mode has an equilibrium, as at an impact
            without rest contact, or the branch of either mode has a fold.
        """
        event: Any = self.numeric
        if self.kind == BOUNDARY:
            return boundary_type(self.system, event, self.parameter)
        if self.label == "G":
            touching = self.without_impact
            return GrazingType(grazing.grazing_type(touching.solution, touching.monitor))
        return sliding_type(self.system, event) if is_discontinuity(event) else None

    @cached_property
    def without_impact(self) -> OrbitEvent:
        """The same grazing, as a point of the branch without the impact.

        On that side everything is smooth; on the side with the impact multipliers are infinite.
        """
        event: Any = self.numeric
        if not isinstance(event.monitor, ContactSpeedTest) or self.next_orbit is None:
            return event
        away = event.value - self.next_orbit.family.values[self.parameter]
        width = GRAZING_SEARCH_RATIO * abs(event.value)
        other = follow(
            self.next_orbit,
            self.parameter,
            low=event.value - width,
            high=event.value + width,
            direction=math.copysign(1.0, away),
            reconnecting=False,
        )
        touching = [s for s in other.special_points if isinstance(s.monitor, ClosestApproachTest)]
        return touching[0] if touching else event


@dataclass(frozen=True, kw_only=True, eq=False)
class CodimensionTwo(BifurcationPoint[S]):
    """A point of codimension two on a curve.

    Attributes
    ----------
    solution : Orbit or Equilibrium
        The same as `orbit` or `equilibrium`.
    kind : str
        "cusp", "fold-flip", "fold-Neimark-Sacker", "flip-Neimark-Sacker", "double Neimark-Sacker";
        "1:1 resonance" to "1:4 resonance" by the angle of a pair of multipliers on the unit circle;
        "generalized flip" and "Chenciner" (the cubic coefficient of the normal form is zero);
        "grazing-fold" (a grazing orbit with a multiplier +1), "grazing-flip",
        "grazing-Neimark-Sacker", "degenerate grazing" (the first impact leads neither away from the
        stopper nor towards it), "double grazing"; for another guard its name replaces "grazing". Of
        equilibria: "cusp", "Bogdanov-Takens" (a double eigenvalue zero), "zero-Hopf", "Hopf-Hopf",
        "Bautin" (a Hopf point changes its criticality), "boundary-fold", "boundary-Hopf", "double
        boundary".
    values : dict of str to float
        Values of the two parameters.
    """

    kind: str
    values: dict[str, float]

    def __repr__(self) -> str:
        location = ", ".join(f"{name}={value:.9g}" for name, value in self.values.items())
        return f"CodimensionTwo({self.kind} at {location})"

    @cached_property
    def normal_form(self) -> NormalForm | None:
        """The normal form on the center manifold.

        To the third order, of a cusp, a fold-flip, the resonances, and points with a Neimark-Sacker
        pair and another multiplier or pair; to the fifth of a generalized flip and a Chenciner
        point. None of points with a grazing, and of equilibria. Raises OrbitError if the Poincaré
        map near the orbit cannot be differentiated.
        """
        if not isinstance(self.solution, Orbit):
            return None
        solution = self.solution.numeric
        return codimension_two_form(self.kind, solution.shooting, solution.point)

    def summary(self) -> dict[str, Any]:
        """Return the kind, the values of the parameters and the solution."""
        return {"kind": self.kind, **self.values, **self.solution.summary()}


def special_point(
    system: HybridSystem,
    parameter: str,
    event: OrbitEvent | EquilibriumEvent,
    bounds: tuple[float, float],
    next_orbit: Any = None,
) -> SpecialPoint[Any]:
    """Return a special point of `continuation` in the units of the system."""
    return SpecialPoint(
        kind=event.kind,
        label=event.label,
        parameter=parameter,
        value=float(system.units.out(parameter, event.value)),
        solution=solution_of(system, event.solution),
        bounds=bounds,
        numeric=event,
        next_orbit=next_orbit if isinstance(next_orbit, PeriodicOrbit) else None,
    )


def _only(result: object, solution: object, kind: type[T]) -> T:
    """Return the solution of a result if it is of a kind; else raise AttributeError."""
    if isinstance(solution, kind):
        return solution
    other = "an equilibrium" if isinstance(solution, Equilibrium) else "an orbit"
    raise AttributeError(f"the solution of {result!r} is {other}")
