"""Sequential quadratic programming with a trust region.

Sequential quadratic programming with a trust region. Its models are exact to first order, and get
their curvature by symmetric rank-one updates. A line search would have to cross what lies between
two points; here a trial that cannot be evaluated shrinks the region, and the point stays.

Functions may be smooth in pieces, which the points tell apart. Where two pieces meet in an edge
from which the value rises on both sides, the model is the larger of theirs, so that the search goes
along the edge (Womersley and Fletcher, J. Optim. Theory Appl. 50 (1986) 493).
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.errors import OrbitError

__all__ = ["Iterate", "search"]

ENOUGH = 2.0  # a penalty by the largest multiplier: with one an orbit is best that meets all
MIN_OBJECTIVE_SHARE = 0.3  # of what meeting constraints is worth, that a step must promise
EDGE = 1e-12  # nearer to a side of the box is on it
FIRST, SMALLEST = 0.1, 1e-9  # size of the trust region, in parts of the ranges
GOOD, POOR = 0.75, 0.25  # what a step brings by what it promised, to widen or narrow the region
GAIN = 1e-8  # that a model must promise for the search to go on
CONSTRAINT_TOLERANCE = 1e-6  # within which a constraint is met
EDGE_DISTANCE = 1e-5  # of an edge, in parts of the ranges: from here it is known
EQUAL_PIECES_RATIO = 1e-3  # of what a step promises: pieces that differ by no more meet there


@dataclass(frozen=True, eq=False)
class LocalModel:
    """The functions at one point of the unit box.

    Attributes
    ----------
    value, gradient
        Of what is minimized; float, float array of shape (n,).
    margins, by_margin
        Of the constraints, which hold where margins are 0 or more; shapes (m,), (m, n).
    piece
        On which the functions are smooth; hashable.
    """

    value: float
    gradient: Floats
    margins: Floats
    by_margin: Floats
    piece: Hashable = None

    def merit(self, penalty: float) -> float:
        """Return the value and a penalty for constraints that are violated."""
        return self.value + penalty * float(np.maximum(0.0, -self.margins).sum())

    @property
    def violation(self) -> float:
        """The largest by which a constraint is violated."""
        return float(np.maximum(0.0, -self.margins).max(initial=0.0))


T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Iterate(Generic[T]):
    """Where a search has come to.

    Attributes
    ----------
    x : float array, shape (n,)
    item : object
        What was made of it.
    local : LocalModel
    ended : str
        "converged", "lost" (the points beyond cannot be evaluated), "small" (steps are as small as
        rounding), "spent" (the number of iterations); "" while it goes on.
    lost : str
        Why the last point that could not be evaluated could not.
    edge : tuple of object
        What was made of points on other pieces, where the end lies on an edge.
    """

    x: Floats
    item: T
    local: LocalModel
    ended: str = ""
    lost: str = ""
    edge: tuple[T, ...] = ()


@dataclass(frozen=True, eq=False)
class _Beyond(Generic[T]):
    """The model of another piece: the nearest point on it, and its curvature."""

    there: Iterate[T]
    curvature: Floats

    def at(self, x: Floats) -> tuple[float, Floats]:
        """Return value and gradient at a point."""
        way, local = x - self.there.x, self.there.local
        bent = self.curvature @ way
        return float(local.value + local.gradient @ way + 0.5 * way @ bent), local.gradient + bent

    def excess(self, here: Iterate[T]) -> float:
        """Return by how much the model is above the value at a point of a piece of its own."""
        return max(0.0, self.at(here.x)[0] - here.local.value)

    def across(self, here: Iterate[T]) -> Iterator[Floats]:
        """Give points from `here` straight to the edge and over it, ever farther.

        Values are equal along an edge, so that their gradients differ across it. The models
        mistake its place by the square of the distance from which they look.
        """
        value, gradient = self.at(here.x)
        turn = gradient - here.local.gradient
        steep = float(np.linalg.norm(turn))
        away = float(np.abs(self.there.x - here.x).max())
        length = max(2.0 * (here.local.value - value) / steep, away**2)
        while length < away:
            yield _boxed(here.x + length / steep * turn)
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
    """Minimize within the unit box from `start` on.

    Parameters
    ----------
    start : float array, shape (n,)
    item : object
        What there is at `start`.
    move : callable
        ``move(item, x)`` returns what there is at another point, or raises `OrbitError`.
    look : callable
        ``look(item)`` returns the functions there, or raises `OrbitError`.
    report : callable
        Called with every point that is taken, the first one included.
    iterations : int
        Trials at most.

    Returns
    -------
    Iterate
    """
    here = Iterate(start, item, look(item))
    report(here)
    flat = np.zeros((start.size, start.size))
    curvatures: dict[Hashable, Floats] = {}
    others: dict[Hashable, Iterate[T]] = {}
    seen = {here.local.piece: here}  # on every piece the last point, from which it bends
    radius, lost, penalty = FIRST, "", 0.0

    def keep(there: Iterate[T]) -> None:
        piece = there.local.piece
        if piece in seen:
            curvatures[piece] = _updated(curvatures.get(piece, flat), seen[piece], there)
        seen[piece] = there
        if piece != here.local.piece:
            others[piece] = there

    for _ in range(iterations):
        penalty = max(penalty, ENOUGH * float(_multipliers(here.local).max(initial=0.0)))
        curvature = curvatures.get(here.local.piece, flat)
        beyond = [
            _Beyond(other, curvatures.get(piece, flat))
            for piece, other in others.items()
            if _is_edge(here, other)
        ]
        step, gained, met, edge = _model_step(here, curvature, radius, beyond)
        least = GAIN * max(1.0, abs(here.local.merit(penalty)))
        if met > 0.0:
            penalty = max(penalty, -gained / ((1.0 - MIN_OBJECTIVE_SHARE) * met))
        promised = gained + penalty * met
        length = float(np.abs(step).max())
        away = max((float(np.abs(each.there.x - here.x).max()) for each in edge), default=0.0)
        if promised < least and away > EDGE_DISTANCE:
            # Where an edge is, points as far from it as these do not know: look again, nearer.
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
        if promised < least or length < SMALLEST:
            held = length > 0.99 * radius  # by the region alone, which has shrunk
            ended = ("lost" if lost else "small") if held else "converged"
            met_there = tuple(each.there.item for each in edge)
            return replace(here, ended=ended, lost=lost if held else "", edge=met_there)
        try:
            there = _at(here, _boxed(here.x + step), move, look)
            ratio = (here.local.merit(penalty) - there.local.merit(penalty)) / promised
            keep(there)
            if ratio < POOR and there.local.violation > here.local.violation:
                # Constraints bend, and the model does not know by how much: step back onto them.
                back = _boxed(there.x + _back(here.local, there.local))
                nearer = _at(here, back, move, look)
                better = (here.local.merit(penalty) - nearer.local.merit(penalty)) / promised
                there, ratio = (nearer, better) if better > ratio else (there, ratio)
        except OrbitError as error:
            lost, radius = error.reason, 0.25 * length
            continue
        if ratio > GOOD and length > 0.99 * radius:
            radius = min(1.0, 2.0 * radius)
        elif ratio < POOR:
            radius = 0.25 * length
        if ratio > 1e-4:
            if there.local.piece != here.local.piece:
                others[here.local.piece] = here
                others.pop(there.local.piece, None)
            here, lost = there, ""
            report(here)
    return replace(here, ended="spent", lost=lost)


def _is_edge(here: Iterate[T], other: Iterate[T]) -> bool:
    """Return whether values rise from an edge between two points, on either side of it."""
    way = other.x - here.x
    bends = float((other.local.gradient - here.local.gradient) @ way)
    seen = other.local.value - float(other.local.gradient @ way) - here.local.value
    return bends > 0.0 and seen < 0.1 * bends


def _boxed(x: Floats) -> Floats:
    """Return a point of the unit box, on its sides where it is as near as rounding."""
    x = np.where(x > 1.0 - EDGE, 1.0, x)
    return np.asarray(np.where(x < EDGE, 0.0, x))


def _back(here: LocalModel, there: LocalModel) -> Floats:
    """Return the shortest step that makes up for violated constraints, to first order."""
    missed = there.margins < 0.0
    return np.asarray(np.linalg.lstsq(here.by_margin[missed], -there.margins[missed])[0])


def _at(
    here: Iterate[T], x: Floats, move: Callable[[T, Floats], T], look: Callable[[T], LocalModel]
) -> Iterate[T]:
    item = move(here.item, x)
    return Iterate(x, item, look(item))


def _model_step(
    here: Iterate[T], curvature: Floats, radius: float, beyond: Sequence[_Beyond[T]]
) -> tuple[Floats, float, float, list[_Beyond[T]]]:
    """Return the step that minimizes the model in the trust region.

    Where constraints are violated, they come first: they are met as far as the region allows. With
    it comes by how much it lessens value and violations, as far as the model knows, and the pieces
    at whose edges it ends.
    """
    from scipy.optimize import minimize  # which need not be read before

    local, n = here.local, here.x.size
    # In parts of the region and of what it promises at most, lest small steps drown in rounding.
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

    def of(piece: _Beyond[T]) -> Callable[[Floats], tuple[float, Floats]]:
        excess = piece.excess(here)

        def model(z: Floats) -> tuple[float, Floats]:
            value, gradient = piece.at(here.x + radius * z)
            return (value - excess - local.value) / unit, gradient * radius / unit

        return model

    pieces = [own, *map(of, beyond)]
    held = [
        {"type": "ineq", "fun": lambda z: allowed + rows @ z[:n], "jac": lambda z: _wide(rows, z)}
    ]
    ends = {"ftol": 1e-12, "maxiter": 200}
    if not beyond:
        solved = minimize(
            lambda z: own(z)[0], first, jac=lambda z: own(z)[1], bounds=box,
            constraints=held if local.margins.size else [], method="SLSQP", options=ends,
        )  # fmt: skip
    else:
        # The largest of the pieces is one more unknown, which none of them exceeds.
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


def _wide(rows: Floats, z: Floats) -> Floats:
    """Return rows with columns of zeros for unknowns that they do not know."""
    return np.hstack([rows, np.zeros((len(rows), z.size - rows.shape[1]))])


def _towards_constraints(margins: Floats, rows: Floats, box: Floats) -> Floats:
    """Return the step that meets linear constraints best; none where they are met."""
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
    """Return the curvature of the Lagrangian after one more step (symmetric rank one)."""
    weights = _multipliers(there.local)
    step = there.x - here.x
    turned = [each.gradient - weights @ each.by_margin for each in (here.local, there.local)]
    left = turned[1] - turned[0] - curvature @ step
    along = float(left @ step)
    if abs(along) < 1e-8 * float(np.linalg.norm(step) * np.linalg.norm(left)) or along == 0.0:
        return curvature
    return np.asarray(curvature + np.outer(left, left) / along)


def _multipliers(local: LocalModel) -> Floats:
    """Return Lagrange multipliers of the constraints that are near active, by least squares."""
    from scipy.optimize import nnls

    weights = np.zeros(local.margins.size)
    near = np.flatnonzero(local.margins < 1e-3)
    if near.size:
        weights[near] = nnls(local.by_margin[near].T, local.gradient)[0]
    return weights
