"""Test functions: quantities whose zeros along a branch are the points where something happens."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from mems_impact.hybrid.trajectory import Floats
from mems_impact.orbits.orbit import reduced
from mems_impact.orbits.shooting import Point, Shooting
from mems_impact.orbits.signature import BOUNDARY

GRAZING, FOLD, PERIOD_DOUBLING, NEIMARK_SACKER, BRANCH_POINT = (
    "grazing",
    "fold",
    "period-doubling",
    "Neimark-Sacker",
    "branch point",
)
LABELS = {GRAZING: "G", FOLD: "CF", PERIOD_DOUBLING: "PD", NEIMARK_SACKER: "NS", BRANCH_POINT: "BP"}


@dataclass(frozen=True)
class Monitor:
    """One test function.

    Attributes
    ----------
    kind : str
        "fold", "period-doubling", "Neimark-Sacker", "grazing" (of a guard with impacts), or the
        name of another guard whose margin is touched.
    role : str
        For a guard: "approach" (the smallest margin inside a segment), "rate" (the speed at which
        the guard that ends a segment is reached), "start" (a margin at the start of a segment) or
        "end" (another margin at its end).
    segment, guard : int
    """

    kind: str
    role: str = ""
    segment: int = -1
    guard: int = -1


def monitors(shooting: Shooting, point: Point, direction: Floats) -> dict[Monitor, float]:
    """Return all test functions at `point`; positive margins and falling rates are admissible."""
    shooting.move_to(point.values)
    values: dict[Monitor, float] = {}
    matrix = reduced(shooting, point)
    identity = np.eye(len(matrix))
    values[Monitor(FOLD)] = float(direction[-1])
    values[Monitor(PERIOD_DOUBLING)] = float(np.linalg.det(matrix + identity))
    values[Monitor(NEIMARK_SACKER)] = _products(np.linalg.eigvals(matrix))
    automaton, m = shooting.automaton, shooting.m
    states, _ = shooting.unpack(point.unknowns)
    for i, segment in enumerate(shooting.segments):
        arc, event = point.arcs[i], point.events[i]
        own = segment.code % m if segment.code not in (BOUNDARY, 2 * m) else -1
        at_start, rising = shooting.variational.margins(segment.mode, point.starts[i], states[i])
        at_end, _ = shooting.variational.margins(segment.mode, point.ends[i], arc.end)
        for j, guard in enumerate(automaton.guards):
            kind = GRAZING if guard.impact else guard.name
            if np.isfinite(arc.minima[j]):
                values[Monitor(kind, "approach", i, j)] = float(arc.minima[j])
            if j == own:
                assert event is not None
                values[Monitor(kind, "rate", i, j)] = -float(event.rates[j])
            else:
                values[Monitor(kind, "end", i, j)] = float(at_end[j])
            if not (abs(at_start[j]) < 1e-9 and rising[j] > 0.0):
                values[Monitor(kind, "start", i, j)] = float(at_start[j])
    return values


def _products(multipliers: Any) -> float:
    """Return the product of l_i l_j - 1 over all pairs; zero on the unit circle."""
    product = 1.0 + 0.0j
    for i in range(len(multipliers)):
        for j in range(i):
            product *= multipliers[i] * multipliers[j] - 1.0
    return float(product.real)
