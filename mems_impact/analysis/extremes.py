"""The largest values that the states reach along an arc, between its samples too."""

from __future__ import annotations

import numpy as np

from mems_impact.hybrid.trajectory import Floats, Instant, Trajectory
from mems_impact.orbits.returning import flow_at

__all__ = ["largest_values"]

SAMPLES = 200  # in a period


def largest_values(arc: Trajectory) -> Floats:
    """Return the largest value of each state along an arc without events, shape (n,).

    Around the largest sample a state is the cubic that has its values and its rates.
    """
    grid = arc.samples(SAMPLES)
    found = np.maximum(arc.start.y, arc.final.y)
    if not len(grid.y):
        return np.asarray(found)
    at = grid.cycle * arc.period + grid.time
    for state, i in enumerate(np.argmax(grid.y, axis=0).tolist()):
        found[state] = max(found[state], grid.y[i, state])
        for j in (i - 1, i):
            if j >= 0 and j + 1 < len(grid.y):
                length = float(at[j + 1] - at[j])
                rates = [
                    length * flow_at(arc.problem, Instant(0, at[k], arc.start.mode, grid.y[k]))
                    for k in (j, j + 1)
                ]
                ends = grid.y[j, state], grid.y[j + 1, state]
                top = _top(*ends, rates[0][state], rates[1][state])
                found[state] = max(found[state], top)
    return np.asarray(found)


def _top(first: float, last: float, rate: float, last_rate: float) -> float:
    """Return the largest value in [0, 1] of the cubic with these values and rates at the ends."""
    rise = last - first
    cubic, square = rate + last_rate - 2.0 * rise, 3.0 * rise - 2.0 * rate - last_rate
    polynomial = np.polynomial.Polynomial([first, rate, square, cubic])
    turns = polynomial.deriv().roots()
    inside = turns[np.isreal(turns) & (turns.real > 0.0) & (turns.real < 1.0)].real
    return float(max(first, last, *polynomial(inside)))
