"""Derivatives of an orbit's quantities by its parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mems_impact.analysis.orbit import Orbit, orbit_of
from mems_impact.analysis.quantity import Quantity
from mems_impact.analysis.system import System
from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.hybrid.columns import weight_of
from mems_impact.hybrid.trajectory import Floats
from mems_impact.orbits.neighbours import Neighbours
from mems_impact.orbits.orbit import PeriodicOrbit

__all__ = ["chosen_quantities", "derivatives"]

STEP = 1e-4  # part of a parameter's size: what bends on the way is lost in rounding
SOLVED_STEPS = (1e-3, 1e-4, 1e-5)
"""Of orbits that are corrected, which leaves more than rounding; shorter where one ends nearby."""

ROUNDING = np.array([1e-10, 1e-8])
"""Parts of a value that differences leave: by first order, and of corrected orbits."""


def derivatives(
    orbit: Orbit, quantities: Sequence[Quantity], parameters: Sequence[str]
) -> tuple[Floats, Floats]:
    """Return the values of quantities, and their derivatives by parameters.

    The orbit's own derivatives come from the variational equations. A quantity is a plain function
    of an orbit, so that its derivative is that along the orbit as it moves to first order, by
    central differences of sixth order of this function alone. What needs solved orbits is
    differentiated along the corrected ones.

    Parameters
    ----------
    orbit : Orbit
    quantities : sequence of Quantity
    parameters : sequence of str

    Returns
    -------
    values : float array, shape (quantities,)
    derivatives : float array, shape (quantities, parameters)
        In the units of the system.

    Raises
    ------
    OrbitError
        If the orbit stands at a fold, or no orbits are found beside it.
    """
    values = np.array([each(orbit) for each in quantities])
    found = np.zeros((len(quantities), len(parameters)))
    of_solved = np.array([each.solved for each in quantities])
    for column, name in enumerate(parameters):
        beside = Neighbours(orbit.found, name)
        inner = orbit.found.family.value(name)
        size = abs(inner) if inner != 0.0 else 1.0
        for kind in (False, True):
            rows = np.flatnonzero(of_solved == kind)
            wanted = [quantities[row] for row in rows.tolist()]
            if wanted and kind:
                found[rows, column] = _along_solved(orbit.system, wanted, beside, size)
            elif wanted:
                found[rows, column] = _central(
                    orbit.system, wanted, beside.to_first_order, STEP * size
                )
        # A parameter that changes nothing has the derivative zero.
        nothing = np.abs(found[:, column]) * size <= ROUNDING[of_solved.astype(int)] * np.abs(
            values
        )
        found[nothing, column] = 0.0
        found[:, column] /= float(orbit.system.out(name, 1.0))
    return values, found


def _along_solved(
    system: System, quantities: Sequence[Quantity], beside: Neighbours, size: float
) -> Floats:
    for part in SOLVED_STEPS[:-1]:
        try:
            return _central(system, quantities, beside.solved, part * size)
        except OrbitError:
            continue
    return _central(system, quantities, beside.solved, SOLVED_STEPS[-1] * size)


def _central(
    system: System,
    quantities: Sequence[Quantity],
    at: Callable[[float], PeriodicOrbit],
    h: float,
) -> Floats:
    total = np.zeros(len(quantities))
    for s in (-3, -2, -1, 1, 2, 3):
        there = orbit_of(system, at(s * h))
        total += weight_of(s) / h * np.array([each(there) for each in quantities])
    return total


def chosen_quantities(
    system: System, wanted: Sequence[str | Quantity] | None
) -> tuple[Quantity, ...]:
    """Return the quantities of a system by name; all but costly ones by default.

    Raises
    ------
    InvalidParameter
        If a name is none of the system's, or comes twice.
    """
    known = {each.name: each for each in system.orbit_quantities}
    if wanted is None:
        return tuple(each for each in known.values() if not each.costly)
    found = []
    for each in wanted:
        if not isinstance(each, Quantity) and each not in known:
            raise InvalidParameter("quantity", each, f"one of {', '.join(known)}, or a Quantity")
        found.append(each if isinstance(each, Quantity) else known[each])
    names = [each.name for each in found]
    if not names or len(set(names)) != len(names):
        raise InvalidParameter("quantities", names, "one or more different quantities")
    return tuple(found)
