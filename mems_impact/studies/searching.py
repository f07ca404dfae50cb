"""A constrained local search by gradients, among points that may not exist.

Sequential quadratic programming with a trust region. Its models are exact to first order, and get
their curvature by symmetric rank-one updates. A line search would have to cross what lies between
two points; here a trial that cannot be evaluated shrinks the region, and the point stays.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from mems_impact.errors import OrbitError
from mems_impact.hybrid.trajectory import Floats

__all__ = ["Search", "search"]

ENOUGH = 2.0  # a penalty by the largest multiplier: with one an orbit is best that meets all
SHARE = 0.3  # of what meeting constraints is worth, that a step must promise
EDGE = 1e-12  # nearer to a side of the box is on it
FIRST, SMALLEST = 0.1, 1e-9  # size of the trust region, in parts of the ranges
GOOD, POOR = 0.75, 0.25  # what a step brings by what it promised, to widen or narrow the region
GAIN = 1e-8  # that a model must promise for the search to go on
HOLDS = 1e-6  # within which a constraint is met


@dataclass(frozen=True, eq=False)
class Local:
    """The functions at one point of the unit box.

    Attributes
    ----------
    value, gradient
        Of what is minimized; float, float array of shape (n,).
    margins, by_margin
        Of the constraints, which hold where margins are 0 or more; shapes (m,), (m, n).
    """

    value: float
    gradient: Floats
    margins: Floats
    by_margin: Floats

    def merit(self, penalty: float) -> float:
        """Return the value and a penalty for constraints that are violated."""
        return self.value + penalty * float(np.maximum(0.0, -self.margins).sum())

    @property
    def violation(self) -> float:
        """The largest by which a constraint is violated."""
        return float(np.maximum(0.0, -self.margins).max(initial=0.0))


T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Search(Generic[T]):
    """Where a search has come to.

    Attributes
    ----------
    x : float array, shape (n,)
    item : object
        What was made of it.
    local : Local
    ended : str
        "converged", "lost" (the points beyond cannot be evaluated), "small" (steps are as small as
        rounding), "spent" (the number of iterations); "" while it goes on.
    lost : str
        Why the last point that could not be evaluated could not.
    """

    x: Floats
    item: T
    local: Local
    ended: str = ""
    lost: str = ""


def search(
    start: Floats,
    item: T,
    *,
    move: Callable[[T, Floats], T],
    look: Callable[[T], Local],
    report: Callable[[Search[T]], None],
    iterations: int,
) -> Search[T]:
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
    Search
    """
    here = Search(start, item, look(item))
    report(here)
    curvature, radius, lost, penalty = np.zeros((start.size, start.size)), FIRST, "", 0.0
    for _ in range(iterations):
        penalty = max(penalty, ENOUGH * float(_multipliers(here.local).max(initial=0.0)))
        step, gained, met = _model_step(here, curvature, radius)
        if met > 0.0:
            penalty = max(penalty, -gained / ((1.0 - SHARE) * met))
        promised = gained + penalty * met
        length = float(np.abs(step).max())
        if promised < GAIN * max(1.0, abs(here.local.merit(penalty))) or length < SMALLEST:
            held = length > 0.99 * radius  # by the region alone, which has shrunk
            ended = ("lost" if lost else "small") if held else "converged"
            return replace(here, ended=ended, lost=lost if held else "")
        try:
            there = _at(here, _boxed(here.x + step), move, look)
            ratio = (here.local.merit(penalty) - there.local.merit(penalty)) / promised
            curvature = _updated(curvature, here, there)
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
            here, lost = there, ""
            report(here)
    return replace(here, ended="spent", lost=lost)


def _boxed(x: Floats) -> Floats:
    """Return a point of the unit box, on its sides where it is as near as rounding."""
    x = np.where(x > 1.0 - EDGE, 1.0, x)
    return np.asarray(np.where(x < EDGE, 0.0, x))


def _back(here: Local, there: Local) -> Floats:
    """Return the shortest step that makes up for violated constraints, to first order."""
    missed = there.margins < 0.0
    return np.asarray(np.linalg.lstsq(here.by_margin[missed], -there.margins[missed])[0])


def _at(
    here: Search[T], x: Floats, move: Callable[[T, Floats], T], look: Callable[[T], Local]
) -> Search[T]:
    item = move(here.item, x)
    return Search(x, item, look(item))


def _model_step(here: Search[T], curvature: Floats, radius: float) -> tuple[Floats, float, float]:
    """Return the step that minimizes the model in the trust region.

    Where constraints are violated, they come first: they are met as far as the region allows. With
    it comes by how much it lessens value and violations, as far as the model knows.
    """
    from scipy.optimize import minimize  # which need not be read before

    local = here.local
    # In parts of the region and of what it promises at most, lest small steps drown in rounding.
    unit = radius * max(float(np.abs(local.gradient).max()), 1e-30)
    slope, bend = local.gradient * radius / unit, curvature * radius**2 / unit
    rows = local.by_margin * radius
    box = np.column_stack(
        [np.maximum(-1.0, -here.x / radius), np.minimum(1.0, (1.0 - here.x) / radius)]
    )
    first = _towards_constraints(local.margins, rows, box)
    allowed = local.margins + np.maximum(0.0, -(local.margins + rows @ first))
    held = {"type": "ineq", "fun": lambda z: allowed + rows @ z, "jac": lambda _: rows}
    solved = minimize(
        lambda z: float(slope @ z + 0.5 * z @ bend @ z),
        first,
        jac=lambda z: slope + bend @ z,
        bounds=box,
        constraints=[held] if local.margins.size else [],
        method="SLSQP",
        options={"ftol": 1e-12, "maxiter": 200},
    )
    part = np.clip(solved.x, box[:, 0], box[:, 1])
    gained = -unit * float(slope @ part + 0.5 * part @ bend @ part)
    met = local.merit(1.0) - local.value
    met -= float(np.maximum(0.0, -(local.margins + rows @ part)).sum())
    return radius * part, gained, met


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


def _updated(curvature: Floats, here: Search[T], there: Search[T]) -> Floats:
    """Return the curvature of the Lagrangian after one more step (symmetric rank one)."""
    weights = _multipliers(there.local)
    step = there.x - here.x
    turned = [each.gradient - weights @ each.by_margin for each in (here.local, there.local)]
    left = turned[1] - turned[0] - curvature @ step
    along = float(left @ step)
    if abs(along) < 1e-8 * float(np.linalg.norm(step) * np.linalg.norm(left)) or along == 0.0:
        return curvature
    return np.asarray(curvature + np.outer(left, left) / along)


def _multipliers(local: Local) -> Floats:
    """Return Lagrange multipliers of the constraints that are near active, by least squares."""
    from scipy.optimize import nnls

    weights = np.zeros(local.margins.size)
    near = np.flatnonzero(local.margins < 1e-3)
    if near.size:
        weights[near] = nnls(local.by_margin[near].T, local.gradient)[0]
    return weights
