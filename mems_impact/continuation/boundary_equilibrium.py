"""Boundary equilibria: persistence or nonsmooth fold, by Feigin's rules.

At a boundary equilibrium a branch of equilibria of one mode meets a branch of another mode: of the
flow beyond the surface if the field is continuous, else of sliding along it (pseudo-equilibria), or
of a contact that holds. Along either branch a margin passes zero, with the derivatives h' and k' by
the parameter. If they have opposite signs, one equilibrium persists; if they have one sign, both
exist on the same side and vanish at the point. For a continuous field -h'/k' is Feigin's ratio of
determinants, 1 + C^T N^-1 E = det N2 / det N1.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from mems_impact.continuation.branch import EquilibriumEvent
from mems_impact.errors import OrbitError
from mems_impact.orbits.equilibrium import (
    EquilibriumEquations,
    EquilibriumEvaluation,
    EquilibriumState,
    make_equilibrium,
)

PERSISTENCE, NONSMOOTH_FOLD = "persistence", "nonsmooth fold"
MEETING_TOLERANCE = 1e-6  # of flow and margins at which a branch of another mode meets the point
PROBE_DISTANCE = 1e-4  # from the point, relative to it, at which transitions change the mode
MIN_REGULARITY = 1e-7  # least singular value of a Jacobian, relative to the largest


@dataclass(frozen=True)
class BoundaryCrossing:
    """The two branches of equilibria that meet at a boundary equilibrium."""

    type: str  # "persistence" or "nonsmooth fold"
    other: EquilibriumState  # the equilibrium in the other mode
    # Those with zero margins, in the mode of the branch and in the other mode.
    guards: tuple[int, int]
    # Derivatives of these margins by the parameter, each along its branch.
    slopes: tuple[float, float]


def boundary_crossing(event: EquilibriumEvent, parameter: str) -> BoundaryCrossing:
    """Classify a boundary equilibrium of a branch over a parameter.

    Raises OrbitError if no other mode has an equilibrium there, or one of the two branches is
    singular.
    """
    state = event.solution
    equations = EquilibriumEquations(state.family, state.mode, (parameter,))
    values = np.array([state.family.values[parameter]])
    names = [guard.name for guard in equations.automaton.guards]
    guard = names.index(event.guard)
    evaluation = equations.evaluate(state.balance.unknowns, values)
    crossings = list(_meeting(equations, evaluation))
    reached = _reached(equations, evaluation, guard)
    near = [each for each in crossings if each[0].mode in reached] or crossings
    if len({each[0].mode for each in near}) != 1:
        modes = ", ".join(equations.automaton.modes[each[0].mode] for each in near)
        problem = f"several modes have an equilibrium there: {modes}" if near else (
            "no other mode has an equilibrium there"
        )  # fmt: skip
        raise OrbitError(
            f"the boundary equilibrium has no type: {problem}",
            "give the impact a rest contact, or the surface a sliding mode",
        )
    other, point, beyond = near[0]
    slopes = _slope(equations, evaluation, guard), _slope(other, point, beyond)
    kind = PERSISTENCE if slopes[0] * slopes[1] < 0.0 else NONSMOOTH_FOLD
    return BoundaryCrossing(kind, make_equilibrium(other, point), (guard, beyond), slopes)


def _meeting(
    equations: EquilibriumEquations, evaluation: EquilibriumEvaluation
) -> Iterator[tuple[EquilibriumEquations, EquilibriumEvaluation, int]]:
    """Yield other modes with an equilibrium on a zero of a margin at the point."""
    guards = equations.automaton.guards
    for mode in range(len(equations.automaton.modes)):
        if mode == equations.mode:
            continue
        other = EquilibriumEquations(equations.family, mode, equations.active)
        try:
            point = other.evaluate(evaluation.unknowns, evaluation.values)
            margins = other.margins(point)
        except (OrbitError, ArithmeticError, ValueError):
            continue  # no flow there, such as that of sliding along a continuous field
        size = max(1.0, float(np.abs(point.jacobian).max(initial=0.0)))
        if not np.abs(point.residual).max(initial=0.0) < MEETING_TOLERANCE * size:
            continue
        zeros = [
            j
            for j, margin in enumerate(margins.tolist())
            if abs(margin) < MEETING_TOLERANCE and not guards[j].records
        ]
        if len(zeros) == 1 and margins.min() > -MEETING_TOLERANCE:
            yield other, point, zeros[0]


def _reached(
    equations: EquilibriumEquations, evaluation: EquilibriumEvaluation, guard: int
) -> set[int]:
    """Return the modes to which transitions lead from states around the point."""
    size = PROBE_DISTANCE * max(1.0, float(np.abs(evaluation.unknowns).max(initial=0.0)))
    reached = set()
    for shift in (0.0, size, -size):
        for unit in np.eye(evaluation.unknowns.size):
            shifted = replace(evaluation, unknowns=evaluation.unknowns + shift * unit)
            reached.add(equations.mode_after(shifted, guard))
    return reached - {equations.mode}


def _slope(equations: EquilibriumEquations, point: EquilibriumEvaluation, guard: int) -> float:
    """Return the derivative of a margin by the parameter along the branch."""
    sizes = np.linalg.svd(point.jacobian, compute_uv=False)
    if not sizes[-1] > MIN_REGULARITY * sizes[0]:
        raise OrbitError(
            "the boundary equilibrium has no type: a Jacobian is singular there, as at a fold",
            "take a point at another value of a second parameter",
        )
    onward = np.append(np.linalg.solve(point.jacobian, -point.by_parameter[:, 0]), 1.0)
    return float(equations.margin_gradient(point, guard) @ onward)
