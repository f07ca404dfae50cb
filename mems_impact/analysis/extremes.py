"""The largest values that the states reach, between samples too: of an arc, or all of a run."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

from mems_impact.hybrid import loop
from mems_impact.hybrid.trajectory import Floats, Instant, Trajectory
from mems_impact.orbits.returning import flow_at

__all__ = ["largest_values", "maxima"]

SAMPLES = 200  # in a period
STILL = 1e-9  # part of the largest value by which a state moves that stands still


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


def maxima(run: Trajectory, first: float) -> list[Floats]:
    """Return, for each state, its local maxima along a run from `first`, in order.

    Corners count, and the values before and after events. A state that stands still has one, its
    value; one that only rises or falls has none.

    Parameters
    ----------
    run : Trajectory
    first : float
        In periods of the run's problem.
    """
    grid = run.samples(SAMPLES, first)
    log = run.events[np.isin(run.events.kind, (loop.TRANSITION, loop.ACCUMULATION, loop.SWITCH))]
    log = log[log.cycle * run.period + log.time >= first * run.period]
    at = [each.cycle * run.period + each.time for each in (log, log, grid)]
    # In one instant: what was before an event, what is after it, a sample.
    kinds = np.repeat([0, 1, 2], [len(log), len(log), len(grid.y)])
    order = np.lexsort((kinds, np.concatenate(at)))
    time, kinds = np.concatenate(at)[order], kinds[order]
    y = np.concatenate([log.before, log.after, grid.y])[order]
    mode = np.concatenate([log.mode_before, log.mode_after, grid.mode])[order]
    arc = np.cumsum(kinds == 1)

    @cache
    def slopes(j: int) -> Floats:
        return flow_at(run.problem, Instant(0, float(time[j]), int(mode[j]), y[j]))

    def slope(i: int, j: int) -> float:
        return float(slopes(j)[i])

    return [_maxima(time, y[:, i], partial(slope, i), arc) for i in range(y.shape[1])]


def _maxima(
    time: Floats, y: Floats, slope: Callable[[int], float], arc: NDArray[np.int64]
) -> Floats:
    """Return the local maxima of one state, whose arcs have numbers."""
    extent = float(np.ptp(y)) if y.size else 0.0
    if not extent > STILL * float(np.abs(y).max(initial=0.0)):
        return y[-1:]
    # Values that differ by rounding alone are a plateau, and that is one value.
    changes = np.flatnonzero(np.abs(np.diff(y)) > STILL * extent)
    begins, ends = np.append(0, changes + 1), np.append(changes, y.size - 1)
    values = y[begins]
    peaks = np.flatnonzero((values[1:-1] > values[:-2]) & (values[1:-1] > values[2:])) + 1
    found = []
    for begin, end in zip(begins[peaks].tolist(), ends[peaks].tolist(), strict=True):
        top = float(y[begin : end + 1].max())
        for j in (begin - 1, end):
            if arc[j] == arc[j + 1]:
                length = float(time[j + 1] - time[j])
                top = max(top, _top(y[j], y[j + 1], length * slope(j), length * slope(j + 1)))
        found.append(top)
    return np.array(found)


def _top(first: float, last: float, rate: float, last_rate: float) -> float:
    """Return the largest value in [0, 1] of the cubic with these values and rates at the ends."""
    rise = last - first
    cubic, square = rate + last_rate - 2.0 * rise, 3.0 * rise - 2.0 * rate - last_rate
    polynomial = np.polynomial.Polynomial([first, rate, square, cubic])
    turns = polynomial.deriv().roots()
    inside = turns[np.isreal(turns) & (turns.real > 0.0) & (turns.real < 1.0)].real
    return float(max(first, last, *polynomial(inside)))
