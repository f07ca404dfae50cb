"""Branches and curves of solutions, periodic orbits or equilibria, with their special points."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, ClassVar, Generic, Self, TypeVar

from mems_impact._util.arrays import Floats
from mems_impact.orbits.equilibrium import EquilibriumState
from mems_impact.orbits.periodic_orbit import PeriodicOrbit

if TYPE_CHECKING:
    from mems_impact.continuation.homoclinic import SlowPassage
    from mems_impact.continuation.test_functions import TestFunction

N = TypeVar("N", bound=PeriodicOrbit | EquilibriumState)


@dataclass(frozen=True)
class BranchPoint(Generic[N]):
    """One solution on a branch, at a value of the parameter, with its tangent."""

    solution: N
    value: float
    direction: Floats = field(repr=False)
    piece: int = 0  # number of the signature on a branch of orbits, counted from 0


@dataclass(frozen=True)
class BranchEvent(Generic[N]):
    """A located special point of a branch.

    `kind` is "grazing", "fold", "period-doubling", "Neimark-Sacker", "Hopf", "branch point"
    (another branch crosses), "onset of complete chatter", "boundary equilibrium" (a margin is zero,
    and the equilibrium is virtual beyond), "unexplained" (a change of stability), or the name of
    the guard whose margin is zero.
    """

    kind: str
    # G, CF and PD as in the paper; NS, BP, CC, ?; of equilibria LP, H, BP, BE, ?; else the kind.
    label: str
    value: float
    solution: N = field(repr=False)
    direction: Floats = field(repr=False)  # tangent of the branch
    # The test function of orbits that is zero.
    monitor: TestFunction = field(repr=False, default=None)  # type: ignore[assignment]
    guard: str = ""  # the guard of a boundary equilibrium, else empty


@dataclass
class SolutionBranch(Generic[N]):
    """A branch in one parameter."""

    noun: ClassVar[str] = "orbits"

    parameter: str
    points: list[BranchPoint[N]] = field(default_factory=list)
    special_points: list[BranchEvent[N]] = field(default_factory=list)
    ended: str = ""  # reason for the end of the branch
    # Slow passage of the last limit cycle, if the period grows beyond bounds.
    passage: SlowPassage | None = None

    @property
    def solutions(self) -> list[N]:
        """The solutions of all points."""
        return [point.solution for point in self.points]

    def joined(self, other: Self, at: BranchEvent[N] | None = None) -> Self:
        """Return this branch, reversed, and then another branch.

        Both start at the same solution, or on the two sides of a special point.
        """
        last, between = self.points[-1].piece if self.points else 0, [] if at is None else [at]
        points = [
            replace(point, direction=-point.direction, piece=last - point.piece)
            for point in reversed(self.points)
        ]
        points += [BranchPoint(each.solution, each.value, each.direction, last) for each in between]
        points += [replace(each, piece=last + each.piece) for each in other.points[at is None :]]
        ended = f"{other.ended}; at its beginning, {self.ended}"
        return replace(
            other,
            points=points,
            special_points=[*reversed(self.special_points), *between, *other.special_points],
            ended=other.ended if self.ended == other.ended else ended,
            passage=other.passage or self.passage,
        )


@dataclass(frozen=True)
class CurveEvent(Generic[N]):
    """A codimension-two point of a curve, at values of the two parameters."""

    kind: str
    values: tuple[float, float]
    solution: N


@dataclass
class SolutionCurve(Generic[N]):
    """A curve of special points of one kind in two parameters."""

    noun: ClassVar[str] = "orbits"

    kind: str
    parameters: tuple[str, str]
    points: list[N] = field(default_factory=list)
    special_points: list[CurveEvent[N]] = field(default_factory=list)
    ended: str = ""  # reason for the end of the curve
    # Bounds of the first parameter, of a branch through the curve.
    bounds: tuple[float, float] = (-float("inf"), float("inf"))
    guard: str = ""  # the guard of boundary equilibria, else empty

    @property
    def solutions(self) -> list[N]:
        """The solutions of all points."""
        return self.points

    def values(self, solution: N) -> tuple[float, float]:
        """Return the values of the two parameters at a solution."""
        first, second = (float(solution.family.values[name]) for name in self.parameters)
        return first, second


OrbitPoint = BranchPoint[PeriodicOrbit]
OrbitEvent = BranchEvent[PeriodicOrbit]
EquilibriumPoint = BranchPoint[EquilibriumState]
EquilibriumEvent = BranchEvent[EquilibriumState]


class OrbitBranch(SolutionBranch[PeriodicOrbit]):
    """A branch of periodic orbits."""


class EquilibriumBranch(SolutionBranch[EquilibriumState]):
    """A branch of equilibria."""

    noun = "equilibria"


class OrbitCurve(SolutionCurve[PeriodicOrbit]):
    """A curve of periodic orbits."""


class EquilibriumCurve(SolutionCurve[EquilibriumState]):
    """A curve of equilibria."""

    noun = "equilibria"
