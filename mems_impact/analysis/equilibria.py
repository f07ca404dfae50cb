"""Branches of equilibria in one parameter."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from mems_impact.analysis.branch import OneParameter, bounds_of
from mems_impact.analysis.equilibrium import Equilibrium, EquilibriumPoint
from mems_impact.analysis.progress import values_of
from mems_impact.analysis.special import check_kind
from mems_impact.analysis.system import System
from mems_impact.continuation.corrector import Steps
from mems_impact.continuation.equilibria import Equilibria, follow_equilibrium
from mems_impact.errors import InvalidParameter
from mems_impact.orbits.equilibrium import StationaryState
from mems_impact.tables import orbits as orbit_tables

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["EquilibriumBranch", "continue_equilibrium"]

EQUILIBRIUM_STEPS = Steps(largest=0.2)


@dataclass(frozen=True, kw_only=True, eq=False)
class EquilibriumBranch(OneParameter):
    """Equilibria over one parameter.

    Attributes
    ----------
    system : System
        Where the branch began.
    parameter : str
    bounds : tuple of float
        Between which the parameter was varied.
    special_points : tuple of EquilibriumPoint
        In the order in which the branch passes them.
    ended : str
        Why the branch ends.

    See Also
    --------
    continue_equilibrium, plot_branch

    Examples
    --------
    >>> import mems_impact as mi
    >>> def duffing(mode, t, y, p):
    ...     return y.v, p.a * y.x - y.x**3 - 0.1 * y.v
    >>> well = mi.System(states=("x", "v"), flow=duffing, parameters={"a": 1.0})
    >>> (found,) = mi.find_equilibria(well, guess={"x": 0.9})
    >>> branch = mi.continue_equilibrium(found, "a", stop=-0.2)
    >>> [(point.label, round(point.value, 6) + 0.0) for point in branch.special_points]
    [('BP', 0.0)]
    """

    system: System = field(repr=False)
    parameter: str
    bounds: tuple[float, float]
    special_points: tuple[EquilibriumPoint, ...]
    ended: str
    found: Equilibria = field(repr=False)

    of: ClassVar[str] = "equilibria"

    @cached_property
    def equilibria(self) -> tuple[Equilibrium, ...]:
        """All equilibria, in the order in which they were followed."""
        return tuple(equilibrium_of(self.system, point) for point in self.found.points)

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row an equilibrium: the parameter, stable, admissible, largest real part, states.

        The largest real part of its eigenvalues is per unit of time.
        """
        rows = [
            {"value": self._value(state), **_measures(self.system, state)}
            for state in self.found.points
        ]
        return self._captioned(orbit_tables.branch(self.parameter, rows, self.system))

    @cached_property
    def special_table(self) -> pd.DataFrame:
        """One row a special point: label, kind, the parameter, and as in `table`."""
        rows = [
            {
                "label": s.label,
                "kind": s.kind,
                "value": s.value,
                **_measures(self.system, s.equilibrium.found),
            }
            for s in self.special_points
        ]
        return self._captioned(orbit_tables.special_points(self.parameter, rows, self.system))

    def _value(self, state: StationaryState) -> float:
        return self.system.out(self.parameter, state.family.values[self.parameter])

    def _captioned(self, table: pd.DataFrame) -> pd.DataFrame:
        """Say for figures that states are looked at where they stand, on no section."""
        system = self.system
        cyclic = {system.states[i] for i in system.automaton.cyclic}
        table.attrs["states"] = [name for name in system.states if name not in cyclic]
        table.attrs["equilibria"] = True
        return table


def continue_equilibrium(
    equilibrium: Equilibrium,
    parameter: str,
    stop: float,
    *,
    back: float | None = None,
    steps: Steps = EQUILIBRIUM_STEPS,
    progress: bool | Callable[[float], None] = False,
) -> EquilibriumBranch:
    """Follow an equilibrium, stable or not, over one parameter.

    Folds are passed; Hopf points, points at which another branch crosses and those at which a guard
    is met are located and listed. Where the number of unstable eigenvalues changes and none of
    these is found, the list has an "unexplained" point. Beyond a guard the equilibrium is a virtual
    one.

    Parameters
    ----------
    equilibrium : Equilibrium
        An isolated one, from `find_equilibria`.
    parameter : str
    stop : float
        Value towards which the branch sets out, and at which it ends.
    back : float, optional
        A branch that turns round ends here at the latest; where it began by default.
    steps : Steps, optional
        Lengths of the steps, and their largest number.
    progress : bool or callable, optional
        True: show a counter if it takes over a second. A function is called with every value.

    Returns
    -------
    EquilibriumBranch
        Whatever ends it: `ended` says what.

    Raises
    ------
    InvalidParameter
        If an argument is out of range, or the equilibrium is one of a continuum.

    See Also
    --------
    find_equilibria, EquilibriumBranch, switch_branch

    Examples
    --------
    >>> import mems_impact as mi
    >>> def duffing(mode, t, y, p):
    ...     return y.v, p.a * y.x - y.x**3 - 0.1 * y.v
    >>> well = mi.System(states=("x", "v"), flow=duffing, parameters={"a": 1.0})
    >>> (found,) = mi.find_equilibria(well, guess={"x": 0.9})
    >>> branch = mi.continue_equilibrium(found, "a", stop=0.2)
    >>> branch.ended
    'a reached its bound'
    """
    check_kind(equilibrium, "equilibrium", Equilibrium, "an Equilibrium, from find_equilibria")
    system = equilibrium.system
    if equilibrium.neutral:
        raise InvalidParameter("equilibrium", equilibrium, "an isolated one: this is one of many")
    bounds = bounds_of(system, parameter, stop, back)
    low, high = (system.into(parameter, bound) for bound in bounds)
    begin = equilibrium.found.family.values[parameter]
    with values_of(
        progress, system.label(parameter), "equilibria", partial(system.out, parameter)
    ) as report:
        found = follow_equilibrium(
            equilibrium.found,
            parameter,
            low=min(low, begin),
            high=max(high, begin),
            direction=math.copysign(1.0, stop - system.value(parameter)),
            steps=steps,
            progress=report,
        )
    special = tuple(
        EquilibriumPoint(
            kind=s.kind,
            label=s.label,
            guard=s.guard,
            parameter=parameter,
            value=system.out(parameter, s.value),
            equilibrium=equilibrium_of(system, s.equilibrium),
            bounds=bounds,
        )
        for s in found.special_points
    )
    return EquilibriumBranch(
        system=system,
        parameter=parameter,
        bounds=bounds,
        special_points=special,
        ended=found.ended,
        found=found,
    )


def equilibrium_of(system: System, found: StationaryState) -> Equilibrium:
    """Return an equilibrium of `system`, at its own parameters."""
    return Equilibrium(system=system.at(found.family.values), found=found)


def _measures(system: System, state: StationaryState) -> dict[str, Any]:
    """Return what the tables say of an equilibrium."""
    y, cyclic = state.state, system.automaton.cyclic
    largest = max(state.eigenvalues.real.tolist(), default=math.nan)
    return {
        "stable": state.stable,
        "admissible": state.admissible,
        "largest real part": largest / system.out("time", 1.0),
        "states": {
            name: np.array([system.out(name, y[i])])
            for i, name in enumerate(system.states)
            if i not in cyclic
        },
    }
