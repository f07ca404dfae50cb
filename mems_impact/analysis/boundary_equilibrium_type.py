"""Types of boundary equilibria."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Self

from mems_impact.analysis.equilibrium import Equilibrium, equilibrium_of
from mems_impact.analysis.special_points import BifurcationPoint, EquilibriumPoint, check_kind
from mems_impact.continuation.boundary_equilibrium import boundary_crossing
from mems_impact.continuation.equilibrium_branch import BOUNDARY
from mems_impact.errors import InvalidParameter, OrbitError

__all__ = ["BoundaryType", "boundary_type", "type_of_boundary"]


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
    boundary_type, SlidingType

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
    >>> branch = mi.continue_equilibrium(low, "a", stop=1.0)
    >>> found = mi.boundary_type(branch.special_points[0])
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


def boundary_type(special: EquilibriumPoint) -> BoundaryType:
    """Classify a boundary equilibrium by Feigin's rules.

    Parameters
    ----------
    special : EquilibriumPoint
        A boundary equilibrium of a branch in either mode.

    Returns
    -------
    BoundaryType
        "persistence" or "nonsmooth fold", with the numbers of the criterion.

    Raises
    ------
    InvalidParameter
        If `special` is a point of another kind.
    OrbitError
        If no other mode has an equilibrium there, as at an impact without rest contact, or the
        branch of either mode has a fold there.

    See Also
    --------
    BoundaryType, continue_equilibrium, continue_curve, sliding_type

    Notes
    -----
    For a field that is continuous across the surface, the criterion is the ratio of the
    determinants of both Jacobians, 1 + C^T N^-1 E [1]_. For a Filippov system the other branch
    consists of pseudo-equilibria, and the criterion has the sign of -C^T N^-1 E, where E is the
    jump of the field.

    References
    ----------
    .. [1] M. di Bernardo, C. J. Budd, A. R. Champneys and P. Kowalczyk, "Piecewise-smooth Dynamical
       Systems", Springer, 2008, sections 5.2 and 5.3.

    Examples
    --------
    >>> import mems_impact as mi
    >>> def flow(mode, t, y, p):
    ...     return (p.a - y.x, -y.z + p.a + 0.5 * y.x) if mode.line == 1 else (p.e, 1.0)
    >>> system = mi.System(
    ...     states=("x", "z"), flow=flow, parameters={"a": 1.0, "e": 1.0},
    ...     parts=[mi.SwitchingSurface("line", "z")],
    ... )
    >>> (up,) = mi.find_equilibria(system, modes=["above"])
    >>> branch = mi.continue_equilibrium(up, "a", stop=-1.0)
    >>> mi.boundary_type(branch.special_points[0]).modes
    ('above', 'sliding')
    """
    check_kind(special, "special", EquilibriumPoint, "a special point of a branch of equilibria")
    if special.kind != BOUNDARY:
        raise InvalidParameter("special", special.kind, "a boundary equilibrium")
    system, parameter = special.system, special.parameter
    crossing = boundary_crossing(special.numeric, parameter)
    guards, unit = system.automaton.guards, system.factor(parameter)
    first, second = (
        slope * system.margin_unit(guards[guard].name) / unit
        for slope, guard in zip(crossing.slopes, crossing.guards, strict=True)
    )
    names = system.modes
    return BoundaryType(
        crossing.type,
        modes=(names[special.numeric.equilibrium.mode], names[crossing.other.mode]),
        other=equilibrium_of(system, crossing.other),
        slopes=(first, second),
        criterion=-first / second,
    )


def type_of_boundary(special: BifurcationPoint) -> str:
    """Return the type of a boundary equilibrium, for tables; empty if it has none."""
    if not isinstance(special, EquilibriumPoint) or special.kind != BOUNDARY:
        return ""
    try:
        return str(boundary_crossing(special.numeric, special.parameter).type)
    except OrbitError:
        return ""
