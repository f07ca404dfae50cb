"""Rows and columns of orbits and equilibria in the tables of branches and curves."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from mems_impact import tables
from mems_impact.analysis.equilibrium import Equilibrium, equilibrium_of
from mems_impact.analysis.orbit import Orbit, orbit_of
from mems_impact.orbits.periodic_orbit import PeriodicOrbit
from mems_impact.systems import observables
from mems_impact.systems.base import HybridSystem

if TYPE_CHECKING:
    import pandas as pd

    from mems_impact.orbits.equilibrium import EquilibriumState

Solution = Orbit | Equilibrium
S = TypeVar("S", bound=Solution)


def solution_of(system: HybridSystem, numeric: PeriodicOrbit | EquilibriumState) -> Any:
    """Return a solution of `orbits` as an `Orbit` or `Equilibrium` at its own parameters."""
    if isinstance(numeric, PeriodicOrbit):
        return orbit_of(system, numeric)
    return equilibrium_of(system, numeric)


def row(solution: Solution, **leading: int) -> dict[str, Any]:
    """Return the row of a solution in tables; `leading` are its first columns."""
    stability = {"stable": solution.stable, "admissible": solution.admissible}
    if isinstance(solution, Equilibrium):
        values = {
            name: np.array([solution.state[name]]) for name in solution.system.state_space.free
        }
        return {**stability, "largest real part": _largest_real_part(solution), "states": values}
    period = {} if solution.system.forced else {"period": solution.period}
    measures = {
        "largest multiplier": MEASURES["largest multiplier"](solution),
        "impacts": len(solution.impact_speeds),
        "impact speed": MEASURES["impact speed"](solution),
        "closest approach": MEASURES["closest approach"](solution),
        **solution.observables,  # a user's "impact speed" replaces that of all impacts
        "states": solution.shown_states,
    }
    return tables.merged_columns({**stability, **leading, **period}, measures)


def branch_table(table: pd.DataFrame, system: HybridSystem, *, equilibria: bool) -> pd.DataFrame:
    """Mark a table of equilibria for figures: its states do not belong to a section."""
    if equilibria:
        table.attrs |= {"states": list(system.state_space.free), "equilibria": True}
    return table


def _largest_real_part(equilibrium: Equilibrium) -> float:
    return max(equilibrium.eigenvalues.real.tolist(), default=math.nan)


# --- Columns that vary continuously along a branch

MEASURES: dict[str, Callable[[Orbit], float]] = {
    "period": observables.period,
    "largest multiplier": lambda orbit: (
        math.inf if orbit.numeric.touches else float(abs(orbit.numeric.multipliers[0]))
    ),
    "impact speed": observables.impact_speed,
    "closest approach": observables.closest_approach,
}
"""Numbers in the row of an orbit, besides observables and states."""


def quantities(solution: Solution, parameter: str) -> dict[str, Callable[[], float]]:
    """Return the columns of the row of a solution that vary continuously, computed on demand."""
    system = solution.system
    columns: dict[str, Callable[[], float]] = {
        parameter: partial(system.parameters.__getitem__, parameter)
    }
    if isinstance(solution, Equilibrium):
        columns["largest real part"] = partial(_largest_real_part, solution)
        states = system.state_space.free
        return columns | {name: partial(solution.state.__getitem__, name) for name in states}
    columns |= {name: partial(measure, solution) for name, measure in MEASURES.items()}
    if system.forced:
        del columns["period"]
    for each in system.observables:
        columns[each.name] = partial(observables.observable, solution, name=each.name)
    for name in system.state_space.displayed:
        columns[name] = partial(_largest, solution, name)
    return columns


def _largest(orbit: Orbit, state: str) -> float:
    """Return the largest of the displayed values of a state, the first of its columns."""
    values = orbit.shown_states[state]
    return float(values[0]) if values.size else math.nan
