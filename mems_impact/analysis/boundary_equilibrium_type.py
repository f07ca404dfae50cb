"""Types of boundary equilibria."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

from mems_impact.analysis.equilibrium import Equilibrium, equilibrium_of
from mems_impact.continuation.boundary_equilibrium import boundary_crossing
from mems_impact.continuation.branch import EquilibriumEvent
from mems_impact.systems.base import HybridSystem


@dataclass(frozen=True, eq=False)
class BoundaryType(str):
    """Type of a boundary equilibrium: a string, with the numbers of Feigin's criterion.

    - "persistence": on either side of the point the equilibrium of one mode exists;
    - "nonsmooth fold": both exist on the same side, and neither on the other.

    Attributes
    ----------
    value : str
        The type.
    modes : tuple of str
        The mode of the branch, and the other mode.
    other : Equilibrium
        The equilibrium at the point in the other mode, with its eigenvalues there. If the other
        mode slides, it is a pseudo-equilibrium.
    slopes : tuple of float
        Derivatives by the parameter of the margins that are zero, each along the branch of its
        mode; the equilibrium of a mode exists where its margin is positive.
    criterion : float
        The negative ratio of the slopes: positive at persistence, negative at a nonsmooth fold.

    See Also
    --------
    SpecialPoint, SlidingType

    Examples
    --------
    >>> import mems_impact as mi
    >>> def flow(mode, t, y, p):
    ...     return (p.a - y.x if mode.step == -1 else p.a - 3.0 * y.x,)
    >>> kinked = mi.System(
    ...     states=("x",), flow=flow, parameters={"a": -1.0},
    ...     parts=[mi.SwitchingSurface("step", "x")],
    ... )
    >>> (low,) = mi.find_equilibria(kinked, modes=["below"])
    >>> branch = mi.continue_solution(low, "a", stop=1.0)
    >>> found = branch.special_points[0].type
    >>> found == "persistence", found.modes, round(found.criterion, 9)
    (True, ('below', 'above'), 3.0)
    """

    value: str
    modes: tuple[str, str] = ("", "")
    other: Equilibrium | None = None
    slopes: tuple[float, float] = (math.nan, math.nan)
    criterion: float = math.nan

    def __new__(cls, value: str, *_: Any, **__: Any) -> Self:
        """Return the string."""
        return super().__new__(cls, value)


def boundary_type(system: HybridSystem, special: EquilibriumEvent, parameter: str) -> BoundaryType:
    """Return the type of a boundary equilibrium; see `SpecialPoint.type`."""
    crossing = boundary_crossing(special, parameter)
    guards, unit = system.automaton.guards, system.units.factor(parameter)
    first, second = (
        slope * system.units.margin_factor(guards[guard].name) / unit
        for slope, guard in zip(crossing.slopes, crossing.guards, strict=True)
    )
    names = system.modes
    return BoundaryType(
        crossing.type,
        modes=(names[special.solution.mode], names[crossing.other.mode]),
        other=equilibrium_of(system, crossing.other),
        slopes=(first, second),
        criterion=-first / second,
    )
