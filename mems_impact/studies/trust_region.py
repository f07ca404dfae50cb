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

__all__ = ["Iterate", "search"]

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
    """The functions at one point of the unit box.

    Attributes
    ----------
    value, gradient
        Objective and its gradient; float, float array of shape (n,).
    margins, by_margin
        Margins of the constraints, >= 0 if satisfied, and their gradients; shapes (m,), (m, n).
    piece
        Identifier of the smooth piece; hashable.
    """

    value: float
    gradient: Floats
    margins: Floats
    by_margin: Floats
    piece: Hashable = None

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
    """A point of a search.

    Attributes
    ----------
    x : float array, shape (n,)
    item : object
        Object at this point.
    local : LocalModel
    ended : str
        "converged", "lost" (points beyond cannot be evaluated), "small" (steps are at the level of
        rounding), "spent" (the iterations are exhausted); "" before the end.
    lost : str
        Reason of the last failed evaluation.
    edge : tuple of object
        Objects at points of other pieces, if the end is on an edge.
    """

    x: Floats
    item: T
    local: LocalModel
    ended: str = ""
    lost: str = ""
    edge: tuple[T, ...] = ()


@dataclass(frozen=True, eq=False)
class _PieceModel(Generic[T]):
    """The model of another piece: the nearest point on it, and its curvature."""

    there: Iterate[T]
    curvature: Floats

    def at(self, x: Floats) -> tuple[float, Floats]:
        """Return value and gradient at a point."""
        way, local = x - self.there.x, self.there.local
        bent = self.curvature @ way
        return float(local.value + local.gradient @ way + 0.5 * way @ bent), local.gradient + bent

    def excess(self, here: Iterate[T]) -> float:
        """Return the excess of the model over the value at a point of another piece."""
        return max(0.0, self.at(here.x)[0] - here.local.value)

    def across(self, here: Iterate[T]) -> Iterator[Floats]:
        """Yield points from `here` across the edge, at increasing distances.

        Values of both pieces are equal along an edge, so that the difference of their gradients is
        normal to it. The error of its predicted position is quadratic in the distance.
        """
        value, gradient = self.at(here.x)
        turn = gradient - here.local.gradient
        steep = float(np.linalg.norm(turn))
        away = float(np.abs(self.there.x - here.x).max())
        length = max(2.0 * (here.local.value - value) / steep, away**2)
        while length < away:
            yield _clipped(here.x + length / steep * turn)
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
    """Minimize within the unit box, starting from `start`.

    Parameters
    ----------
    start : float array, shape (n,)
    item : object
        Object at `start`.
    move : callable
        ``move(item, x)`` returns the object at another point, or raises `OrbitError`.
    look : callable
        ``look(item)`` returns the functions there, or raises `OrbitError`.
    report : callable
        Called with every accepted point, including the first.
    iterations : int
        Maximum number of trials.

    Returns
    -------
    Iterate
    """
    here = Iterate(start, item, look(item))
    report(here)
    flat = np.zeros((start.size, start.size))
    curvatures: dict[Hashable, Floats] = {}
    others: dict[Hashable, Iterate[T]] = {}
    seen = {here.local.piece: here}  # last point of every piece, for its curvature
    radius, lost, penalty = INITIAL_RADIUS, "", 0.0

    def keep(there: Iterate[T]) -> None:
        piece = there.local.piece
        if piece in seen:
            curvatures[piece] = _updated(curvatures.get(piece, flat), seen[piece], there)
        seen[piece] = there
        if piece != here.local.piece:
            others[piece] = there

    for _ in range(iterations):
        penalty = max(penalty, PENALTY_RATIO * float(_multipliers(here.local).max(initial=0.0)))
        curvature = curvatures.get(here.local.piece, flat)
        beyond = [
            _PieceModel(other, curvatures.get(piece, flat))
            for piece, other in others.items()
            if _is_edge(here, other)
        ]
        step, gained, met, edge = _model_step(here, curvature, radius, beyond)
        least = MIN_PREDICTED_REDUCTION * max(1.0, abs(here.local.merit(penalty)))
        if met > 0.0:
            penalty = max(penalty, -gained / ((1.0 - MIN_OBJECTIVE_SHARE) * met))
        promised = gained + penalty * met
        length = float(np.abs(step).max())
        away = max((float(np.abs(each.there.x - here.x).max()) for each in edge), default=0.0)
        if promised < least and away > EDGE_DISTANCE:
            # These points are too far from the edge to determine it: repeat with closer ones.
            others.clear()
            for place in (place for each in edge for place in each.across(here)):
                try:
                    keep(_at(here, place, move, look))
                except OrbitError as error:
                    lost = error.reason
                if others:
                    break
            if not others:
                radius = 0.25 * min(radius, away)
            continue
        if promised < least or length < MIN_RADIUS:
            held = length > 0.99 * radius  # the shrunken region alone limits the step
            ended = ("lost" if lost else "small") if held else "converged"
            met_there = tuple(each.there.item for each in edge)
            return replace(here, ended=ended, lost=lost if held else "", edge=met_there)
        try:
            there = _at(here, _clipped(here.x + step), move, look)
            ratio = (here.local.merit(penalty) - there.local.merit(penalty)) / promised
            keep(there)
            if ratio < REDUCTION_RATIO and there.local.violation > here.local.violation:
                # Second-order correction for the curvature of the constraints.
                back = _clipped(there.x + _restoration_step(here.local, there.local))
                nearer = _at(here, back, move, look)
                better = (here.local.merit(penalty) - nearer.local.merit(penalty)) / promised
                there, ratio = (nearer, better) if better > ratio else (there, ratio)
        except OrbitError as error:
            lost, radius = error.reason, 0.25 * length
            continue
        if ratio > EXPANSION_RATIO and length > 0.99 * radius:
            radius = min(1.0, 2.0 * radius)
        elif ratio < REDUCTION_RATIO:
            radius = 0.25 * length
        if ratio > 1e-4:
            if there.local.piece != here.local.piece:
                others[here.local.piece] = here
                others.pop(there.local.piece, None)
            here, lost = there, ""
            report(here)
    return replace(here, ended="spent", lost=lost)


def _is_edge(here: Iterate[T], other: Iterate[T]) -> bool:
    """Return whether values increase on both sides of an edge between two points."""
    way = other.x - here.x
    bends = float((other.local.gradient - here.local.gradient) @ way)
    seen = other.local.value - float(other.local.gradient @ way) - here.local.value
    return bends > 0.0 and seen < 0.1 * bends


def _clipped(x: Floats) -> Floats:
    """Return a point of the unit box, moved onto sides within rounding."""
    x = np.where(x > 1.0 - BOX_TOLERANCE, 1.0, x)
    return np.asarray(np.where(x < BOX_TOLERANCE, 0.0, x))


def _restoration_step(here: LocalModel, there: LocalModel) -> Floats:
    """Return the shortest step that satisfies violated constraints to first order."""
    missed = there.margins < 0.0
    return np.asarray(np.linalg.lstsq(here.by_margin[missed], -there.margins[missed])[0])


def _at(
    here: Iterate[T], x: Floats, move: Callable[[T, Floats], T], look: Callable[[T], LocalModel]
) -> Iterate[T]:
    item = move(here.item, x)
    return Iterate(x, item, look(item))


def _model_step(
    here: Iterate[T], curvature: Floats, radius: float, beyond: Sequence[_PieceModel[T]]
) -> tuple[Floats, float, float, list[_PieceModel[T]]]:
    """Return the step that minimizes the model in the trust region.

    Violated constraints have priority: they are satisfied as far as the region allows. Further
    results are the predicted reductions of value and violation, and the pieces at whose edges the
    step ends.
    """
    from scipy.optimize import minimize  # imported on first use

    local, n = here.local, here.x.size
    # Scaled by the region and by the largest predicted reduction, so that small steps are accurate.
    unit = radius * max(float(np.abs(local.gradient).max()), 1e-30)
    slope, bend = local.gradient * radius / unit, curvature * radius**2 / unit
    rows = local.by_margin * radius
    box = np.column_stack(
        [np.maximum(-1.0, -here.x / radius), np.minimum(1.0, (1.0 - here.x) / radius)]
    )
    first = _towards_constraints(local.margins, rows, box)
    allowed = local.margins + np.maximum(0.0, -(local.margins + rows @ first))

    def own(z: Floats) -> tuple[float, Floats]:
        return float(slope @ z + 0.5 * z @ bend @ z), slope + bend @ z

    def of(piece: _PieceModel[T]) -> Callable[[Floats], tuple[float, Floats]]:
        excess = piece.excess(here)

        def model(z: Floats) -> tuple[float, Floats]:
            value, gradient = piece.at(here.x + radius * z)
            return (value - excess - local.value) / unit, gradient * radius / unit

        return model

    pieces = [own, *map(of, beyond)]
    held = [
        {"type": "ineq", "fun": lambda z: allowed + rows @ z[:n], "jac": lambda z: _padded(rows, z)}
    ]
    ends = {"ftol": 1e-12, "maxiter": 200}
    if not beyond:
        solved = minimize(
            lambda z: own(z)[0], first, jac=lambda z: own(z)[1], bounds=box,
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
    met = local.merit(1.0) - local.value
    met -= float(np.maximum(0.0, -(local.margins + rows @ part)).sum())
    at = values[1:] > values.max() - EQUAL_PIECES_RATIO
    edge = [piece for piece, yes in zip(beyond, at.tolist(), strict=True) if yes]
    return radius * part, gained, met, edge


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


def _updated(curvature: Floats, here: Iterate[T], there: Iterate[T]) -> Floats:
    """Return the curvature of the Lagrangian after another step (symmetric rank one)."""
    weights = _multipliers(there.local)
    step = there.x - here.x
    turned = [each.gradient - weights @ each.by_margin for each in (here.local, there.local)]
    left = turned[1] - turned[0] - curvature @ step
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
