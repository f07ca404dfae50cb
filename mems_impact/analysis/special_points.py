"""Special points of branches, and types of grazing."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from types import UnionType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mems_impact.analysis.boundary_equilibrium_type import BoundaryType, boundary_type
from mems_impact.analysis.equilibrium import Equilibrium
from mems_impact.analysis.orbit import Orbit
from mems_impact.analysis.sliding_type import SlidingType, sliding_type
from mems_impact.continuation import grazing
from mems_impact.continuation.codimension_two import codimension_two_form
from mems_impact.continuation.equilibrium_branch import EquilibriumEvent
from mems_impact.continuation.normal_forms import (
    NormalForm,
    equilibrium_normal_form,
    orbit_normal_form,
)
from mems_impact.continuation.orbit_branch import follow
from mems_impact.continuation.special_points import BranchEvent
from mems_impact.continuation.test_functions import (
    ClosestApproachTest,
    ContactSpeedTest,
    FoldTest,
)
from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.orbits.periodic_orbit import PeriodicOrbit
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.result import Result

__all__ = [
    "BifurcationPoint",
    "CodimensionTwo",
    "EquilibriumPoint",
    "GrazingType",
    "SpecialPoint",
    "check_kind",
]

GRAZING_SEARCH_RATIO = (
    1e-3  # relative range of the parameter in which the other side of a grazing is sought
)


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


class BifurcationPoint(Result, ABC):
    """Base class of special points of branches."""

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
class SpecialPoint(BifurcationPoint):
    """A special point of a branch of periodic orbits.

    Attributes
    ----------
    kind : str
        "grazing", "fold", "period-doubling", "Neimark-Sacker", "branch point" (another branch
        crosses, as in symmetric systems), the name of another guard that is touched, such as
        "break-away", "onset of complete chatter" (beyond which the chatter sequence does not end in
        sticking contact), or "unexplained" where the number of unstable multipliers changes without
        such a point.
    label : str
        G, CF or PD, as in the paper; NS, BP, CC, ?; for another guard the kind. `sliding_type`
        classifies the latter.
    parameter : str
    value : float
        Value of the parameter.
    orbit : Orbit
        The orbit at that value.
    bounds : tuple of float
        Bounds of the branch.

    See Also
    --------
    Branch, switch_branch, continue_curve, GrazingType, SlidingType

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> branch = mi.continue_orbit(orbit, "amplitude", stop=0.17)
    >>> fold = branch.special_points[0]
    >>> fold.kind, fold.parameter, round(fold.value, 7)
    ('fold', 'amplitude', 0.1765154)
    >>> f"{max(fold.multipliers.real):.3f}"
    '1.000'
    >>> branch.special_points[1].grazing_type.paper
    'I'
    """

    kind: str
    label: str
    parameter: str
    value: float
    orbit: Orbit
    bounds: tuple[float, float] = field(repr=False)
    numeric: BranchEvent = field(repr=False)
    next_orbit: PeriodicOrbit | None = field(repr=False, default=None)

    def __repr__(self) -> str:
        return f"SpecialPoint({self.label} at {self.parameter}={self.value:.9g}, {self.orbit})"

    @property
    def system(self) -> HybridSystem:
        """System of the orbit."""
        return self.orbit.system

    def summary(self) -> dict[str, Any]:
        """Return the kind, the values of the parameters and the orbit."""
        return {
            "kind": self.kind,
            self.system.label(self.parameter): self.value,
            **self.orbit.summary(),
        }

    @property
    def multipliers(self) -> NDArray[np.complex128]:
        """Floquet multipliers; unbounded at a grazing on the side with the impact."""
        return self.orbit.multipliers

    @cached_property
    def normal_form(self) -> NormalForm | None:
        """The normal form of a fold, period doubling, Neimark-Sacker or branch point; else None.

        Raises
        ------
        OrbitError
            If the Poincaré map near the orbit cannot be differentiated.
        """
        orbit = self.numeric.orbit
        doubled = isinstance(self.numeric.monitor, FoldTest)
        return orbit_normal_form(self.kind, orbit.shooting, orbit.point, doubled=doubled)

    @property
    def grazing_type(self) -> GrazingType:
        """The type of a grazing of an orbit without impacts, by the first impact's normal form.

        The sign of the sequence grad h . M^k kick, k = 1, 2, …, decides, with the monodromy matrix
        M of the orbit without impact (Nordmark 1991).

        Raises
        ------
        InvalidParameter
            If the point is of another kind, or the orbit has other impacts.
        OrbitError
            If a weak contact does not lead back to the mode before it.
        """
        equivalent = self.without_impact
        if self.label != "G" or not isinstance(equivalent.monitor, ClosestApproachTest):
            raise InvalidParameter("kind", self.kind, "a grazing of an orbit without impacts")
        return GrazingType(grazing.grazing_type(equivalent.orbit, equivalent.monitor))

    @property
    def sliding_type(self) -> SlidingType:
        """The type of a point at which an orbit meets a discontinuity of its field.

        A mode slides on the surface of a guard if it keeps the guard's margin constant there, so
        modes of components, of hand-written guards and of the actuator are recognized alike. The
        field on the other side is known only if a guard leads from there to sliding. See di
        Bernardo, Kowalczyk and Nordmark, Physica D 170 (2002) 175-205.

        Raises
        ------
        InvalidParameter
            If no guard other than an impact is touched at the point, and no events coincide.
        OrbitError
            If the type cannot be determined, as where no mode of the automaton slides.
        """
        return sliding_type(self.system, self.numeric)

    @cached_property
    def without_impact(self) -> BranchEvent:
        """The same grazing, as a point of the branch without the impact.

        On that side everything is smooth; on the side with the impact multipliers are infinite.
        """
        event = self.numeric
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
class EquilibriumPoint(BifurcationPoint):
    """A special point of a branch of equilibria.

    Attributes
    ----------
    kind : str
        "fold", "Hopf", "branch point", "boundary equilibrium", or "unexplained" where the number of
        unstable eigenvalues changes without one of these.
    label : str
        LP, H, BP, BE or ?.
    guard : str
        The guard of a boundary equilibrium; empty for other kinds.
    parameter : str
    value : float
        Value of the parameter.
    equilibrium : Equilibrium
        The equilibrium at that value.
    bounds : tuple of float
        Bounds of the branch.

    See Also
    --------
    EquilibriumBranch, continue_curve, switch_branch

    Examples
    --------
    >>> import mems_impact as mi
    >>> def duffing(mode, t, y, p):
    ...     return y.v, p.a * y.x - y.x**3 - 0.1 * y.v
    >>> well = mi.System(states=("x", "v"), flow=duffing, parameters={"a": 1.0})
    >>> (found,) = mi.find_equilibria(well, guess={"x": 0.9})
    >>> branch = mi.continue_equilibrium(found, "a", stop=-0.2)
    >>> point = branch.special_points[0]
    >>> point.kind, point.parameter
    ('branch point', 'a')
    """

    kind: str
    label: str
    guard: str
    parameter: str
    value: float
    equilibrium: Equilibrium
    bounds: tuple[float, float] = field(repr=False)
    numeric: EquilibriumEvent = field(repr=False)

    def __repr__(self) -> str:
        location = f"{self.label} at {self.parameter}={self.value:.9g}"
        return f"EquilibriumPoint({location}, {self.equilibrium})"

    @property
    def system(self) -> HybridSystem:
        """System of the equilibrium."""
        return self.equilibrium.system

    @cached_property
    def normal_form(self) -> NormalForm | None:
        """The normal form of a fold, Hopf or branch point; None for other kinds.

        Raises
        ------
        OrbitError
            If the flow near the equilibrium cannot be differentiated.
        """
        return equilibrium_normal_form(self.kind, self.equilibrium.numeric)

    @property
    def boundary_type(self) -> BoundaryType:
        """The type of a boundary equilibrium, in either mode, by Feigin's rules.

        For a field that is continuous across the surface, the criterion is the ratio of the
        determinants of both Jacobians, 1 + C^T N^-1 E. For a Filippov system the other branch
        consists of pseudo-equilibria, and the criterion has the sign of -C^T N^-1 E, where E is the
        jump of the field. See di Bernardo, Budd, Champneys and Kowalczyk, "Piecewise-smooth
        Dynamical Systems", Springer, 2008, sections 5.2 and 5.3.

        Raises
        ------
        InvalidParameter
            If the point is of another kind.
        OrbitError
            If no other mode has an equilibrium there, as at an impact without rest contact, or the
            branch of either mode has a fold there.
        """
        return boundary_type(self.system, self.numeric, self.parameter)

    def summary(self) -> dict[str, Any]:
        """Return the kind, the value of the parameter and the equilibrium."""
        return {
            "kind": self.kind,
            self.system.label(self.parameter): self.value,
            **self.equilibrium.summary(),
        }


@dataclass(frozen=True, kw_only=True, eq=False)
class CodimensionTwo(BifurcationPoint):
    """A point of codimension two on a curve.

    Attributes
    ----------
    kind : str
        "cusp", "fold-flip", "fold-Neimark-Sacker", "flip-Neimark-Sacker", "double Neimark-Sacker";
        "1:1 resonance" to "1:4 resonance" by the angle of a pair of multipliers on the unit circle;
        "generalized flip" and "Chenciner" (the cubic coefficient of the normal form is zero);
        "grazing-fold" (a grazing orbit with a multiplier +1), "grazing-flip",
        "grazing-Neimark-Sacker", "degenerate grazing" (the first impact leads neither away from the
        stopper nor towards it), "double grazing"; for another guard its name replaces "grazing".
        Of equilibria: "cusp", "Bogdanov-Takens" (a double eigenvalue zero), "zero-Hopf",
        "Hopf-Hopf", "Bautin" (a Hopf point changes its criticality), "boundary-fold",
        "boundary-Hopf", "double boundary".
    values : dict of str to float
        Values of the two parameters.
    solution : Orbit or Equilibrium
    """

    kind: str
    values: dict[str, float]
    solution: Orbit | Equilibrium

    def __repr__(self) -> str:
        location = ", ".join(f"{name}={value:.9g}" for name, value in self.values.items())
        return f"CodimensionTwo({self.kind} at {location})"

    @property
    def orbit(self) -> Orbit:
        """The orbit; AttributeError on a curve of equilibria."""
        if not isinstance(self.solution, Orbit):
            raise AttributeError(f"{self!r} is a point of an equilibrium: use its equilibrium")
        return self.solution

    @property
    def equilibrium(self) -> Equilibrium:
        """The equilibrium; AttributeError on a curve of orbits."""
        if isinstance(self.solution, Orbit):
            raise AttributeError(f"{self!r} is a point of an orbit: use its orbit")
        return self.solution

    @property
    def system(self) -> HybridSystem:
        """System of the solution."""
        return self.solution.system

    @cached_property
    def normal_form(self) -> NormalForm | None:
        """The normal form on the center manifold.

        To the third order, of a cusp, a fold-flip, the resonances, and points with a
        Neimark-Sacker pair and another multiplier or pair; to the fifth of a generalized flip and a
        Chenciner point. None of points with a grazing, and of equilibria.

        Raises
        ------
        OrbitError
            If the Poincaré map near the orbit cannot be differentiated.
        """
        if not isinstance(self.solution, Orbit):
            return None
        solution = self.solution.numeric
        return codimension_two_form(self.kind, solution.shooting, solution.point)

    def summary(self) -> dict[str, Any]:
        """Return the kind, the values of the parameters and the solution."""
        return {"kind": self.kind, **self.values, **self.solution.summary()}


def check_kind(value: object, field: str, kind: type | UnionType, allowed: str) -> None:
    """Raise InvalidParameter unless `value` is an instance of `kind`."""
    if not isinstance(value, kind):
        raise InvalidParameter(field, value, allowed)
