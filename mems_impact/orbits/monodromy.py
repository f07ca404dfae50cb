"""Monodromy matrix, Floquet multipliers and stability of an orbit.

Where perturbations grow little, the monodromy matrix is a product, with its eigenvalues. Otherwise
the factors along the flow of a limit cycle would be lost to rounding: multipliers are then those of
the factors of short pieces (`periodic_schur`). So are multipliers that others exceed by far, for
which an orbit integrates its pieces again when they are read.
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from mems_impact._util.arrays import Complexes, Floats
from mems_impact.errors import FunctionsMissing, OrbitError
from mems_impact.orbits.division import MAX_GROWTH, NODE_GROWTH, bisected, growth
from mems_impact.orbits.periodic_schur import product_eigenvalues
from mems_impact.orbits.shooting import (
    SegmentPiece,
    Shooting,
    ShootingEvaluation,
    normal_basis,
    without_flow_direction,
)
from mems_impact.orbits.spectrum import MULTIPLIER_RTOL, multipliers_stable, ratios

RESET_TOLERANCE = 1e-9  # largest element in the row of a component that is reset
MAX_PIECES = 1000  # of an orbit, by bisection
MAX_ERROR_RATIO = 1e6  # largest ratio of the error of a monodromy matrix to the tolerance
ERROR_SAFETY = 3.0  # factor on the estimate of this error


def reduced_monodromy(
    shooting: Shooting, point: ShootingEvaluation, first: int | None = None
) -> Floats:
    """Return the monodromy matrix without the components that the first mode holds fixed.

    For a limit cycle it is restricted to the plane normal to the flow, without the trivial
    multiplier 1. With `first` it covers only that number of segments.
    """
    monodromy = shooting.monodromy(point)
    keep = reduced_components(shooting, point, monodromy)
    matrix = monodromy if first is None else shooting.monodromy(point, first)
    matrix = matrix[np.ix_(keep, keep)]
    if shooting.phase is None or not keep:
        return matrix
    return without_flow_direction(matrix, point.arcs[0].slope_start[shooting.free][keep])


def monodromy_factors(shooting: Shooting, point: ShootingEvaluation) -> Floats:
    """Return factors of the reduced monodromy matrix, in order, shape (factors, r, r).

    There is one factor if perturbations grow little.
    """
    key = "factors", *shooting.pinned.items()
    return point.matrix(key, lambda: _factors(shooting, point))


def _factors(shooting: Shooting, point: ShootingEvaluation) -> Floats:
    arcs, free = point.arcs, shooting.free
    grows = any(not growth(arc.by_state[free]) <= MAX_GROWTH for arc in arcs)
    if any(shooting.nodes) or (shooting.phase is not None and grows):
        return _factors_of_pieces(shooting, point)
    return reduced_monodromy(shooting, point)[None]


def _factors_of_pieces(
    shooting: Shooting, point: ShootingEvaluation, limit: float = MAX_GROWTH
) -> Floats:
    """Return factors of pieces in which perturbations grow and decay at most by this factor."""
    free, is_cycle = shooting.free, shooting.phase is not None
    budget = iter(range(MAX_PIECES))

    def is_short(piece: SegmentPiece) -> bool:
        by_state = piece.arc.by_state[free]
        # Constraints forget a component; a flow that seems to do so decays beyond all digits.
        is_singular = piece.mode in shooting.automaton.constrained
        return _is_resolved(by_state, limit, is_singular) or next(budget, None) is None

    keep = reduced_components(shooting, point)
    start = np.eye(len(keep))
    if is_cycle and keep:
        start = normal_basis(point.arcs[0].slope_start[free][keep])
    columns = np.zeros((len(free), start.shape[1]))
    columns[keep] = start
    for c, factors in shooting.pinned.items():
        columns[c] -= np.array(factors) @ columns
    found = []
    pieces = list(bisected(shooting, point, is_short))
    last = {piece.segment: number for number, piece in enumerate(pieces)}
    for number, (i, *_, arc) in enumerate(pieces):
        after, flow = arc.by_state @ columns, arc.slope_end
        if number == last[i] and point.events[i] is not None:
            before = _without(flow[free], after[free]) if is_cycle else after[free]
            columns = np.zeros_like(after)
            columns[free] = before
            after = shooting.after_event(i, point, columns)
            flow = point.arcs[(i + 1) % len(point.arcs)].slope_start
        # A large shift along the flow would hide the other perturbations.
        moved = _without(flow[free], after[free]) if is_cycle else after[free]
        columns, factor = np.linalg.qr(moved)
        found.append(factor)
    return np.array([*found, start.T @ columns[keep]])


def _is_resolved(by_state: Floats, limit: float = MAX_GROWTH, is_singular: bool = True) -> bool:
    """Return whether perturbations grow and decay too little to lose their digits."""
    if not growth(by_state) <= limit:
        return False
    try:
        return growth(np.asarray(np.linalg.inv(by_state), dtype=float)) <= limit
    except np.linalg.LinAlgError:
        return is_singular


def _without(flow: Floats, columns: Floats) -> Floats:
    """Return perturbations without their components along the flow."""
    return np.asarray(columns - np.outer(flow, flow @ columns) / (flow @ flow))


def reduced_components(
    shooting: Shooting, point: ShootingEvaluation, monodromy: Floats | None = None
) -> list[int]:
    """Return the free components that the first mode does not hold fixed, by position."""
    arc = point.arcs[0]
    monodromy = shooting.monodromy(point) if monodromy is None else monodromy
    still = [
        arc.slope_start[i] == 0.0 == arc.slope_end[i] and arc.by_state[i, c] in (0.0, 1.0)
        for c, i in enumerate(shooting.free)
    ]
    # A component that is fixed in the first segment and reset later has a trivial multiplier 0.
    forgotten = [np.abs(row).max() < RESET_TOLERANCE for row in monodromy]
    return [
        c
        for c in range(len(shooting.free))
        if c not in shooting.pinned and not (still[c] and forgotten[c])
    ]


def multipliers_at(shooting: Shooting, point: ShootingEvaluation) -> Complexes:
    """Return the multipliers at an orbit, in no order; raise OrbitError unless they are finite."""
    factors = monodromy_factors(shooting, point)
    if not np.isfinite(factors).all():
        raise OrbitError("the monodromy matrix is not finite", "take another guess", point)
    if len(factors) == 1:
        return np.linalg.eigvals(factors[0]).astype(complex)
    return _product(shooting, point)[0]


def resolved_multipliers(shooting: Shooting, point: ShootingEvaluation) -> Complexes:
    """Return the multipliers, in no order, with the digits of those that others exceed by far.

    An orbit that was loaded without the functions of its system has those that were saved.
    """
    factors = monodromy_factors(shooting, point)
    if len(factors) == 1 and not _is_resolved(factors[0]):
        refined = shooting.refined
        with suppress(FunctionsMissing, OrbitError, np.linalg.LinAlgError):
            exact = refined.evaluate(point.unknowns, point.values)
            factors = _factors_of_pieces(refined, exact, NODE_GROWTH)
            if np.isfinite(factors).all():
                return product_eigenvalues(factors)[0]
    return multipliers_at(shooting, point)


def _product(shooting: Shooting, point: ShootingEvaluation) -> Complexes:
    """Return the eigenvalues of the product of several factors, and their conditions."""
    key = "eigenvalues", *shooting.pinned.items()
    factors = monodromy_factors(shooting, point)
    return np.asarray(point.matrix(key, lambda: np.array(product_eigenvalues(factors))), complex)


def is_stable(shooting: Shooting, point: ShootingEvaluation) -> bool | None:
    """Return the stability, by the error of the monodromy matrix where a bound does not decide."""
    factors = monodromy_factors(shooting, point)
    if len(factors) > 1:
        values, conditions = _product(shooting, point)
        with np.errstate(divide="ignore"):
            distances = np.log(np.abs(values))
        certain = np.abs(distances) > MULTIPLIER_RTOL * conditions.real
        if (certain & (distances > 0.0)).any():
            return False
        return True if certain.all() else None
    matrix = factors[0]
    sizes, bound = _sizes(shooting, point), MAX_ERROR_RATIO * shooting.family.problem().options.rtol
    stable = multipliers_stable(matrix, sizes, bound)
    if stable is not None:
        return stable
    try:
        refined = shooting.refined.evaluate(point.unknowns, point.values)
        change = ratios(reduced_monodromy(shooting.refined, refined) - matrix, sizes)
    except (OrbitError, ValueError):  # the components that count differ
        return None
    error = ERROR_SAFETY * np.abs(change).max() / np.abs(ratios(matrix, sizes)).max()
    return multipliers_stable(matrix, sizes, float(error))


def _sizes(shooting: Shooting, point: ShootingEvaluation) -> Floats | float:
    """Return the magnitudes of the components of the reduced monodromy matrix along the orbit."""
    if shooting.phase is not None:
        return 1.0  # combinations of components
    lengths = np.maximum(point.ends - point.starts, 0.0)
    along = [
        np.abs([state, arc.end, length * arc.slope_start, length * arc.slope_end]).max(axis=0)
        for state, arc, length in zip(
            shooting.unpack(point.unknowns)[0], point.arcs, lengths, strict=True
        )
    ]
    sizes = np.max(along, axis=0)[shooting.free][reduced_components(shooting, point)]
    return np.asarray(np.where(sizes > 0.0, sizes, 1.0))
