"""Division of the segments of an orbit by nodes, where perturbations grow.

Errors of a state grow with perturbations, and its shooting equations lose as many digits. Between
nodes that are close enough both grow little, however much they do along the orbit. The nodes are
chosen at a solution; Newton's method never changes them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.orbits.shooting import SegmentPiece, Shooting, ShootingEvaluation

MAX_GROWTH = 1e3  # of perturbations in a piece, beyond which a segment has other nodes
NODE_GROWTH = 30.0  # largest growth between two new nodes
MIN_PIECE_RATIO = 2.0**-12  # shortest piece, relative to a former one
NODE_DISTANCE = 1e-9  # least distance of a node from the ends of its segment, relative to it


def growth(by_state: Floats) -> float:
    """Return the growth of perturbations of the free components, whatever their units."""
    if np.abs(by_state).max(initial=0.0) > NODE_GROWTH and np.isfinite(by_state).all():
        # Imported on first use, which a run need not wait for.
        from scipy.linalg import matrix_balance

        with np.errstate(invalid="ignore"):  # of scales beyond those of integers
            by_state, _ = matrix_balance(by_state, permute=False)
    return float(np.abs(by_state).max(initial=0.0))


def bisected(
    shooting: Shooting, point: ShootingEvaluation, is_short: Callable[[SegmentPiece], bool]
) -> Iterator[SegmentPiece]:
    """Yield the pieces of all segments, in order, bisected until they are short."""
    variational = shooting.variational(point.parameter_point)
    for piece in shooting.pieces(point):
        smallest = MIN_PIECE_RATIO * (piece.end - piece.start)
        waiting = [piece]
        while waiting:
            each = waiting.pop()
            start, end = each.start, each.end
            if is_short(each) or end - start <= smallest:
                yield each
                continue
            middle = 0.5 * (start + end)
            first = variational.arc(each.mode, each.state, start, middle)
            second = variational.arc(each.mode, first.end, middle, end)
            waiting.append(each._replace(start=middle, state=first.end, arc=second))
            waiting.append(each._replace(end=middle, arc=first))


class OtherEquations(NamedTuple):
    """Other equations of the same orbit, with its unknowns."""

    shooting: Shooting
    unknowns: Floats
    first: int = 0  # the former number of their first segment, in which a cycle may start


def divided(shooting: Shooting, point: ShootingEvaluation) -> OtherEquations | None:
    """Return the equations of an orbit with other nodes.

    None if perturbations grow neither too much between the nodes nor too little to need them.
    """
    free = shooting.free
    too_far = any(growth(piece.arc.by_state[free]) > MAX_GROWTH for piece in shooting.pieces(point))
    needless = any(
        nodes and growth(arc.by_state[free]) <= NODE_GROWTH
        for nodes, arc in zip(shooting.nodes, point.arcs, strict=True)
    )
    if not (too_far or needless):
        return None
    instants: list[list[tuple[float, Floats]]] = [[] for _ in shooting.segments]
    number, total = -1, np.eye(len(free))

    def is_short(piece: SegmentPiece) -> bool:
        return growth(piece.arc.by_state[free]) <= NODE_GROWTH

    for piece in bisected(shooting, point, is_short):
        own = piece.arc.by_state[free]
        total = own @ total
        if piece.segment == number and growth(total) <= NODE_GROWTH:
            continue
        if piece.segment == number:
            instants[number].append((piece.start, piece.state))
        number, total = piece.segment, own
    starts = shooting.unpack(point.unknowns)[0]
    nodes, states = with_nodes(starts, point.starts, point.ends, instants)
    other = shooting.with_phase(shooting.segments, shooting.phase, nodes)
    times = point.unknowns[len(free) * shooting.layout.segment.size :]
    return OtherEquations(other, np.append(states[:, free].ravel(), times))


def with_nodes(
    states: Floats,
    starts: Floats,
    ends: Floats,
    instants: Sequence[Sequence[tuple[float, Floats]]],
) -> tuple[tuple[tuple[float, ...], ...], Floats]:
    """Return the nodes of all segments, and the states at the starts of their pieces.

    `states`, shape (N, n), are at the starts of the segments; `instants` has times and states
    within each segment.
    """
    nodes, rows = [], []
    for state, start, end, inside in zip(states, starts, ends, instants, strict=True):
        shares = [((time - start) / (end - start), row) for time, row in inside]
        within = sorted(
            (each for each in shares if NODE_DISTANCE < each[0] < 1.0 - NODE_DISTANCE),
            key=lambda each: each[0],
        )
        nodes.append(tuple(float(share) for share, _ in within))
        rows += [state, *(row for _, row in within)]
    return tuple(nodes), np.array(rows)
