"""Sequential quadratic programming with a trust region.

The models are exact to first order; symmetric rank-one updates provide their curvature. A trial
point that cannot be evaluated shrinks the region, whereas a line search would have to evaluate the
points on its way.

Functions may be piecewise smooth, with the piece known at each point. At an edge between two pieces
from which the value increases on both sides, the model is the maximum of both, so that the search
continues along the edge (Womersley and Fletcher, J. Optim. Theory Appl. 50 (1986) 493).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.errors import OrbitError

PENALTY_RATIO = 2.0  # penalty relative to the largest multiplier; above 1 it is exact
MIN_OBJECTIVE_SHARE = 0.3  # least predicted reduction of merit, relative to that of violations
BOX_TOLERANCE = 1e-12  # distance from a side of the box within which a point is on it
INITIAL_RADIUS, MIN_RADIUS = 0.1, 1e-9  # of the trust region, relative to the ranges
# Ratios of actual to predicted reduction above and below which the region changes its size.
EXPANSION_RATIO, REDUCTION_RATIO = 0.75, 0.25
MIN_PREDICTED_REDUCTION = 1e-8  # least predicted reduction of a step
CONSTRAINT_TOLERANCE = 1e-6  # violation within which a constraint is satisfied
EDGE_DISTANCE = 1e-5  # of a located edge, relative to the ranges
EQUAL_PIECES_RATIO = 1e-3  # difference of pieces at an edge, relative to the predicted reduction


@dataclass(frozen=True, eq=False)
class LocalModel:
    """The functions at one point of the unit box."""

    value: float  # objective, with its gradient of shape (n,)
    gradient: Floats
    margins: Floats  # of the constraints, >= 0 if satisfied, shape (m,)
    by_margin: Floats  # their gradients, shape (m, n)
    piece: Hashable = None  # identifier of the smooth piece

    def merit(self, penalty: float) -> float:
        """Return the value plus a penalty for violated constraints."""
        return self.value + penalty * float(np.maximum(0.0, -self.margins).sum())

    @property
    def violation(self) -> float:
        """The largest violation of a constraint."""
        return float(np.maximum(0.0, -self.margins).max(initial=0.0))


T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Iterate(Generic[T]):
    """A point of a search."""

    x: Floats
    item: T  # object at this point
    local: LocalModel
    # "converged", "lost" (points beyond cannot be evaluated), "small" (steps are at the level of
    # rounding), "spent" (the iterations are exhausted); "" before the end
    ended: str = ""
    lost: str = ""  # reason of the last failed evaluation
    edge: tuple[T, ...] = ()  # objects at points of other pieces, if the end is on an edge


@dataclass(frozen=True, eq=False)
class _PieceModel(Generic[T]):
    """The model of another piece: the nearest point on it, and its curvature."""

    nearest: Iterate[T]
    curvature: Floats

    def at(self, x: Floats) -> tuple[float, Floats]:
        """Return value and gradient at a point."""
        direction, local = x - self.nearest.x, self.nearest.local
        bending = self.curvature @ direction
        change = local.gradient @ direction + 0.5 * direction @ bending
        return float(local.value + change), local.gradient + bending

    def excess(self, current: Iterate[T]) -> float:
        """Return the excess of the model over the value at a point of another piece."""
        return max(0.0, self.at(current.x)[0] - current.local.value)

    def across(self, current: Iterate[T]) -> Iterator[Floats]:
        """Yield points from `current` across the edge, at increasing distances.

        Values of both pieces are equal along an edge, so that the difference of their gradients is
        normal to it. The error of its predicted position is quadratic in the distance.
        """
        value, gradient = self.at(current.x)
        turn = gradient - current.local.gradient
        steep = float(np.linalg.norm(turn))
        away = float(np.abs(self.nearest.x - current.x).max())
        length = max(2.0 * (current.local.value - value) / steep, away**2)
        while length < away:
            yield _clipped(current.x + length / steep * turn)
            length *= 4.0


def search(
    start: Floats,
    item: T,
    *,
    move: Callable[[T, Floats], T],
    look: Callable[[T], LocalModel],
    report: Callable[[Iterate[T]], None],
    iterations: int,
) -> Iterate[T]:
    """Minimize within the unit box, by at most `iterations` trials from `start` and its object.

    ``move(item, x)`` returns the object at another point, ``look(item)`` the functions there; both
    may raise OrbitError. `report` is called with every accepted point, including the first.
    """
    current = Iterate(start, item, look(item))
    report(current)
    flat = np.zeros((start.size, start.size))
    curvatures: dict[Hashable, Floats] = {}
    others: dict[Hashable, Iterate[T]] = {}
    last_points = {current.local.piece: current}  # last point of every piece, for its curvature
    radius, lost, penalty = INITIAL_RADIUS, "", 0.0

    def keep(trial: Iterate[T]) -> None:
        piece = trial.local.piece
        if piece in last_points:
            curvatures[piece] = _updated(curvatures.get(piece, flat), last_points[piece], trial)
        last_points[piece] = trial
        if piece != current.local.piece:
            others[piece] = trial

    for _ in range(iterations):
        penalty = max(penalty, PENALTY_RATIO * float(_multipliers(current.local).max(initial=0.0)))
        curvature = curvatures.get(current.local.piece, flat)
        beyond = [
            _PieceModel(other, curvatures.get(piece, flat))
            for piece, other in others.items()
            if _is_edge(current, other)
        ]
        step, gained, regained, edge = _model_step(current, curvature, radius, beyond)
        min_reduction = MIN_PREDICTED_REDUCTION * max(1.0, abs(current.local.merit(penalty)))
        if regained > 0.0:
            penalty = max(penalty, -gained / ((1.0 - MIN_OBJECTIVE_SHARE) * regained))
        promised = gained + penalty * regained
        length = float(np.abs(step).max())
        away = max((float(np.abs(each.nearest.x - current.x).max()) for each in edge), default=0.0)
        if promised < min_reduction and away > EDGE_DISTANCE:
            # These points are too far from the edge to determine it: repeat with closer ones.
            others.clear()
            for x in (x for each in edge for x in each.across(current)):
                try:
                    keep(_at(current, x, move, look))
                except OrbitError as error:
                    lost = error.reason
                if others:
                    break
            if not others:
                radius = 0.25 * min(radius, away)
            continue
        if promised < min_reduction or length < MIN_RADIUS:
            limited = length > 0.99 * radius  # the shrunken region alone limits the step
            ended = ("lost" if lost else "small") if limited else "converged"
            edge_items = tuple(each.nearest.item for each in edge)
            return replace(current, ended=ended, lost=lost if limited else "", edge=edge_items)
        try:
            trial = _at(current, _clipped(current.x + step), move, look)
            ratio = (current.local.merit(penalty) - trial.local.merit(penalty)) / promised
            keep(trial)
            if ratio < REDUCTION_RATIO and trial.local.violation > current.local.violation:
                # Second-order correction for the curvature of the constraints.
                back = _clipped(trial.x + _restoration_step(current.local, trial.local))
                nearer = _at(current, back, move, look)
                better = (current.local.merit(penalty) - nearer.local.merit(penalty)) / promised
                trial, ratio = (nearer, better) if better > ratio else (trial, ratio)
        except OrbitError as error:
            lost, radius = error.reason, 0.25 * length
            continue
        if ratio > EXPANSION_RATIO and length > 0.99 * radius:
            radius = min(1.0, 2.0 * radius)
        elif ratio < REDUCTION_RATIO:
            radius = 0.25 * length
        if ratio > 1e-4:
            if trial.local.piece != current.local.piece:
                others[current.local.piece] = current
                others.pop(trial.local.piece, None)
            current, lost = trial, ""
            report(current)
    return replace(current, ended="spent", lost=lost)


def _is_edge(current: Iterate[T], other: Iterate[T]) -> bool:
    """Return whether values increase on both sides of an edge between two points."""
    direction = other.x - current.x
    bends = float((other.local.gradient - current.local.gradient) @ direction)
    difference = other.local.value - float(other.local.gradient @ direction) - current.local.value
    return bends > 0.0 and difference < 0.1 * bends


def _clipped(x: Floats) -> Floats:
    """Return a point of the unit box, moved onto sides within rounding."""
    x = np.where(x > 1.0 - BOX_TOLERANCE, 1.0, x)
    return np.asarray(np.where(x < BOX_TOLERANCE, 0.0, x))


def _restoration_step(current: LocalModel, trial: LocalModel) -> Floats:
    """Return the shortest step that satisfies violated constraints to first order."""
    missed = trial.margins < 0.0
    return np.asarray(np.linalg.lstsq(current.by_margin[missed], -trial.margins[missed])[0])


def _at(
    current: Iterate[T], x: Floats, move: Callable[[T, Floats], T], look: Callable[[T], LocalModel]
) -> Iterate[T]:
    item = move(current.item, x)
    return Iterate(x, item, look(item))


def _model_step(
    current: Iterate[T], curvature: Floats, radius: float, beyond: Sequence[_PieceModel[T]]
) -> tuple[Floats, float, float, list[_PieceModel[T]]]:
    """Return the step that minimizes the model in the trust region.

    Violated constraints have priority: they are satisfied as far as the region allows. Further
    results are the predicted reductions of value and violation, and the pieces at whose edges the
    step ends.
    """
    from scipy.optimize import minimize  # imported on first use

    local, n = current.local, current.x.size
    # Scaled by the region and by the largest predicted reduction, so that small steps are accurate.
    unit = radius * max(float(np.abs(local.gradient).max()), 1e-30)
    slope, bend = local.gradient * radius / unit, curvature * radius**2 / unit
    rows = local.by_margin * radius
    box = np.column_stack(
        [np.maximum(-1.0, -current.x / radius), np.minimum(1.0, (1.0 - current.x) / radius)]
    )
    first = _towards_constraints(local.margins, rows, box)
    allowed = local.margins + np.maximum(0.0, -(local.margins + rows @ first))

    def objective(z: Floats) -> tuple[float, Floats]:
        return float(slope @ z + 0.5 * z @ bend @ z), slope + bend @ z

    def of(piece: _PieceModel[T]) -> Callable[[Floats], tuple[float, Floats]]:
        excess = piece.excess(current)

        def model(z: Floats) -> tuple[float, Floats]:
            value, gradient = piece.at(current.x + radius * z)
            return (value - excess - local.value) / unit, gradient * radius / unit

        return model

    pieces = [objective, *map(of, beyond)]
    held = [
        {"type": "ineq", "fun": lambda z: allowed + rows @ z[:n], "jac": lambda z: _padded(rows, z)}
    ]
    ends = {"ftol": 1e-12, "maxiter": 200}
    if not beyond:
        solved = minimize(
            lambda z: objective(z)[0], first, jac=lambda z: objective(z)[1], bounds=box,
            constraints=held if local.margins.size else [], method="SLSQP", options=ends,
        )  # fmt: skip
    else:
        # The maximum of the pieces is an additional unknown that bounds all of them.
        below = [
            {
                "type": "ineq",
                "fun": lambda z, model=model: z[n] - model(z[:n])[0],
                "jac": lambda z, model=model: np.append(-model(z[:n])[1], 1.0),
            }
            for model in pieces
        ]
        top = max(model(first)[0] for model in pieces)
        solved = minimize(
            lambda z: z[n], np.append(first, top), jac=lambda z: np.append(np.zeros(n), 1.0),
            bounds=[*map(tuple, box), (None, None)],
            constraints=below + (held if local.margins.size else []), method="SLSQP", options=ends,
        )  # fmt: skip
    part = np.clip(solved.x[:n], box[:, 0], box[:, 1])
    values = np.array([model(part)[0] for model in pieces])
    gained = -unit * float(values.max())
    regained = local.merit(1.0) - local.value
    regained -= float(np.maximum(0.0, -(local.margins + rows @ part)).sum())
    at = values[1:] > values.max() - EQUAL_PIECES_RATIO
    edge = [piece for piece, yes in zip(beyond, at.tolist(), strict=True) if yes]
    return radius * part, gained, regained, edge


def _padded(rows: Floats, z: Floats) -> Floats:
    """Return rows with columns of zeros for additional unknowns."""
    return np.hstack([rows, np.zeros((len(rows), z.size - rows.shape[1]))])


def _towards_constraints(margins: Floats, rows: Floats, box: Floats) -> Floats:
    """Return the step that best satisfies linear constraints; zero if they are satisfied."""
    from scipy.optimize import linprog

    n, m = box.shape[0], margins.size
    if not (margins < 0.0).any():
        return np.zeros(n)
    solved = linprog(
        np.append(np.zeros(n), np.ones(m)),
        A_ub=-np.hstack([rows, np.eye(m)]),
        b_ub=margins,
        bounds=[*map(tuple, box), *[(0.0, None)] * m],
    )
    return np.clip(solved.x[:n], box[:, 0], box[:, 1])


def _updated(curvature: Floats, current: Iterate[T], trial: Iterate[T]) -> Floats:
    """Return the curvature of the Lagrangian after another step (symmetric rank one)."""
    weights = _multipliers(trial.local)
    step = trial.x - current.x
    gradients = [each.gradient - weights @ each.by_margin for each in (current.local, trial.local)]
    left = gradients[1] - gradients[0] - curvature @ step
    along = float(left @ step)
    if abs(along) < 1e-8 * float(np.linalg.norm(step) * np.linalg.norm(left)) or along == 0.0:
        return curvature
    return np.asarray(curvature + np.outer(left, left) / along)


def _multipliers(local: LocalModel) -> Floats:
    """Return Lagrange multipliers of nearly active constraints, by least squares."""
    from scipy.optimize import nnls

    weights = np.zeros(local.margins.size)
    near = np.flatnonzero(local.margins < 1e-3)
    if near.size:
        weights[near] = nnls(local.by_margin[near].T, local.gradient)[0]
    return weights
