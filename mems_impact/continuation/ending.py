"""Why a branch or a curve ends, in words that a user can act on."""

from __future__ import annotations

import numpy as np

from mems_impact.continuation.corrector import Steps
from mems_impact.errors import FunctionError, InvalidParameter, OrbitError, RunError
from mems_impact.orbits.family import Family
from mems_impact.orbits.orbit import PeriodicOrbit
from mems_impact.orbits.shooting import Point

LOSSES = (FunctionError, InvalidParameter, OrbitError, RunError, ArithmeticError, ValueError)
"""What may keep a branch from going on: it ends there, and what there is of it is returned.

Beside the package's own errors those that a function of the system raises out of its range.
"""

SHORT = 0.1  # part of the largest step below which a branch says what holds it back
NEUTRAL = 1e-7  # distance from +1 of a multiplier that is there all along
SIDE_BY_SIDE = (
    "a multiplier is 1, as where something may be shifted, or is conserved: then orbits lie side "
    "by side at one value, and none of them can be followed; a weak spring or damper holds it"
)
SHORTER = "take a shorter step"  # what a corrector says to a branch; to its user it is no help


def reason_of(error: Exception, family: Family) -> str:
    """Return what an error says in the units of the user, without advice to a step."""
    if isinstance(error, RunError):
        family.convert(error)
    if isinstance(error, OrbitError) and error.remedy == SHORTER:
        return str(error.reason)
    return str(error)


def stuck(orbit: PeriodicOrbit, parameters: str | tuple[str, ...], error: Exception) -> str:
    """Return why there is no step beyond `orbit`, however short."""
    names = (parameters,) if isinstance(parameters, str) else parameters
    family = orbit.family
    where = " and ".join(f"{name} = {family.amount(name, family.value(name))}" for name in names)
    told = f"no further step possible beyond {where}: {reason_of(error, family)}"
    if np.abs(orbit.multipliers - 1.0).min() < NEUTRAL:
        return f"{told}; {SIDE_BY_SIDE}"
    return told


def none_beyond(error: Exception, family: Family) -> str:
    """Return why the orbits of another signature cannot be found where two signatures meet."""
    point = error.partial if isinstance(error, OrbitError) else None
    if isinstance(point, Point):
        sizes = np.linalg.svd(point.jacobian, compute_uv=False)
        if not sizes[-1] > NEUTRAL * sizes[0]:
            return f"{reason_of(error, family)}; {SIDE_BY_SIDE}"
    return reason_of(error, family)


def spent(steps: Steps, length: float, held: str, parameter: str, part: float) -> str:
    """Return that the points are used up, and what has held the last steps back."""
    told = f"the budget of {steps.most} points is used up"
    if held and length < SHORT * steps.largest:
        return f"{told}; steps are down to a length of {length:.2g}: {held}"
    return f"{told}; a step of length {length:.2g} moves {parameter} by a part of {part:.1g}"
