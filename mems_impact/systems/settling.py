"""Settling of a sequence: its limit, the distance from the limit, and the error of both.

The sequence consists of a statistic over successive blocks of equal length. Near a periodic orbit
it approaches its limit as a sum of powers of the multipliers, so that a combination of successive
blocks, with coefficients of sum 1 that annihilate the differences, is the limit (reduced rank
extrapolation; Sidi, "Vector Extrapolation Methods with Applications", SIAM, 2017). With one
multiplier q the limit is the last block plus its change times q/(1 - q). A sequence without a
significant trend fluctuates about its mean, whose error follows from the scatter of the blocks.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from mems_impact._util.arrays import Floats

SETTLED, CHANGING, FLUCTUATING, UNKNOWN = "settled", "changing", "fluctuating", "unknown"

FEWEST, ENOUGH = 4, 28  # blocks of a sequence, and for the error of its limit
REACH = 20.0  # longest extrapolation, relative to the change of the sequence
MAX_ORDER = 9  # of the extrapolation: number of multipliers
MAX_LAG = 12  # largest period of a motion, in blocks
CONFIDENCE = 1e-3  # probability that the error of a mean is larger
FIT_RATIO = 0.25  # largest scatter of an extrapolation, relative to the change of the sequence
CONTRACTION = 0.8  # ratio of the squared changes of both halves above which there is no trend
LINEAR_TREND = 3.9  # of the correlation with time, in standard errors of its inverse tanh
STEADY = 0.99  # least decrease of the distance from a limit over two thirds of the sequence
UNEXPLAINED = 1e-5  # largest share of the squared changes that multipliers leave
STATE_NOISE = 1e-5  # relative change of a state that does not count
STATE_ERROR = 3e-8  # relative error of a state over a run
LEAST_CHANGE = 1e3  # change of a state that counts in full, in errors
STATE_RESIDUAL = 4.0  # change of a state that multipliers may leave, in errors
SHARE = 0.1  # least error of an extrapolation, relative to the remaining change
GROUPS = 8  # of changes of a state, whose root mean squares show growth
LEAST_GROWTH = 1.1  # factor of the changes from the first to the last group
TREND_SIGNIFICANCE = 8.0  # of the rate of growth, in standard errors


class SequenceLimit(NamedTuple):
    """The limit of a sequence."""

    value: float
    error: float  # a bound; infinite if a trend has no end in sight
    # Factor of the distance from the limit from one block to the next, between 0 and 1; 0 without a
    # trend.
    ratio: float
    # "settled" (constant within the noise), "changing" (with a trend), "fluctuating" (without one)
    # or "unknown" (of too few blocks).
    kind: str


def limit_of(blocks: Floats, noise: float, states: Floats) -> SequenceLimit:
    """Return the limit of a sequence of blocks, shape (k,), NaN where it is not defined.

    Differences below `noise` do not count. `states`, shape (k, n), are at the ends of the blocks,
    relative to their sizes: they share the multipliers of the sequence, and show multipliers that
    the sequence hides.
    """
    defined = np.isfinite(blocks)
    b = blocks[defined]
    if b.size < max(FEWEST, 0.5 * blocks.size):
        return SequenceLimit(float(b[-1]) if b.size else math.nan, math.inf, 0.0, UNKNOWN)
    spread = float(np.ptp(b))
    if spread <= noise:
        return SequenceLimit(float(b[-1]), spread, 0.0, SETTLED)
    limit = _extrapolated(b, noise, states[defined])
    if limit is not None:
        return limit
    drift = np.diff(states[defined], axis=0)
    if not (_has_trend(b) or ((drift > 0.0).all(axis=0) | (drift < 0.0).all(axis=0)).any()):
        return _mean(b)
    late = b[b.size // 2 :]  # after a transient
    if float(np.ptp(late)) <= noise:
        return SequenceLimit(float(b[-1]), float(np.ptp(late)), 0.0, SETTLED)
    if late.size >= ENOUGH and not _has_trend(late):
        return _mean(late)
    return SequenceLimit(float(b[-1]), math.inf, 1.0, CHANGING)


def _mean(b: Floats) -> SequenceLimit:
    """Return the limit of a sequence without a trend."""
    if b.size < ENOUGH:
        return SequenceLimit(float(b[-1]), math.inf, 0.0, UNKNOWN)
    from scipy.special import stdtrit  # most runs do not need it

    factor = -float(stdtrit(b.size - 1, 0.5 * CONFIDENCE))
    error = factor * float(b.std(ddof=1)) / math.sqrt(b.size)
    return SequenceLimit(float(b.mean()), error, 0.0, FLUCTUATING)


def _has_trend(b: Floats) -> bool:
    """Return whether a sequence is smooth or has a linear trend.

    A smooth sequence is monotonic, or has a small von Neumann's ratio. The ratio of the squares of
    changes and deviations is near 2 without correlation of neighbours, and below the bound with a
    probability of 1e-4 (by simulation, for 8 to 100 blocks). A beat hides a trend from the ratio.
    The correlation with time exceeds its bound with the same probability (Fisher's transformation).
    """
    changes = np.diff(b)
    if (changes > 0.0).all() or (changes < 0.0).all():
        return True
    deviations = b - b.mean()
    square = float(deviations @ deviations)
    if float(changes @ changes) < 2.0 * b.size / (b.size + 53.0) * square:
        return True
    time = np.linspace(-1.0, 1.0, b.size)
    correlation = abs(float(time @ deviations)) / math.sqrt(float(time @ time) * square)
    return correlation > math.tanh(LINEAR_TREND / math.sqrt(b.size - 3))


class _Extrapolation(NamedTuple):
    value: float
    error: float
    ratio: float
    weights: Floats


def _extrapolated(b: Floats, noise: float, states: Floats) -> SequenceLimit | None:
    """Return the limit of a sequence that few multipliers explain, None for other sequences."""
    moving = np.ptp(states, axis=0) > STATE_NOISE
    changes = np.diff(np.column_stack([b, states[:, moving]]), axis=0)
    largest = np.abs(changes).max(axis=0)
    sizes = np.append(largest[0], np.maximum(largest[1:], LEAST_CHANGE * STATE_ERROR))
    changes /= sizes
    errors = np.append(0.0, np.full(len(sizes) - 1, STATE_RESIDUAL * STATE_ERROR)) / sizes
    orders = range(1, 1 + min(MAX_ORDER, (b.size - 2) // 2))
    found = [_of_order(b, n, noise, changes, errors) for n in orders]
    ordered = sorted((each for each in found if each is not None), key=lambda each: each.error)
    if not ordered:
        return None
    last, spread = float(b[-1]), float(np.ptp(b))
    value, error, ratio, weights = ordered[0]
    far = abs(value - last)
    # A second order and a part of the sequence agree, or the order is by chance.
    part = b.size - b.size // 4
    earlier = _of_order(b[:part], weights.size - 1, noise, changes[: part - 1], errors)
    others = [*ordered[1:2], *([] if earlier is None else [earlier])]
    error = max([error, *(abs(value - each.value) for each in others)])
    known = len(others) > 1 and error <= FIT_RATIO * max(far, spread) and far <= REACH * spread
    if b.size < ENOUGH or not known:
        half = len(changes) // 2
        early, late = ((part**2).sum() for part in (changes[:half, 0], changes[-half:, 0]))
        return SequenceLimit(last, math.inf, 1.0, CHANGING) if late < CONTRACTION * early else None
    ratio = max(ratio, _slowest(weights, b - value, noise))
    if earlier is not None:  # a missed multiplier may be as slow as the slowest known multiplier
        move = abs(value - earlier.value) / (b.size - part)
        error = max(error, move * ratio / (1.0 - ratio))
    return SequenceLimit(
        value, max(error, SHARE * far * (1.0 + far / spread), noise), ratio, CHANGING
    )


def _slowest(weights: Floats, distances: Floats, noise: float) -> float:
    """Return the largest modulus of the multipliers that remain at the end of a sequence."""
    multipliers = np.roots(weights[::-1])
    multipliers = multipliers[np.abs(multipliers) < 1.0]
    powers = multipliers ** np.arange(distances.size)[:, np.newaxis]
    parts = np.linalg.lstsq(powers, distances.astype(complex), rcond=None)[0] * powers[-1]
    return float(np.abs(multipliers[np.abs(parts) > noise]).max(initial=0.0))


def _of_order(
    b: Floats, order: int, noise: float, changes: Floats, errors: Floats
) -> _Extrapolation | None:
    """Return the extrapolation with some multipliers; None if they do not explain the changes."""
    count = len(changes) - order
    rows = np.stack([changes[i : i + count] for i in range(order + 1)], axis=-1)
    flat = rows.reshape(-1, order + 1)
    free = np.linalg.lstsq(flat[:, :-1] - flat[:, -1:], -flat[:, -1], rcond=None)[0]
    weights = np.append(free, 1.0 - free.sum())
    rest = rows @ weights
    allowed = UNEXPLAINED * (changes**2).sum(axis=0) + count * errors**2
    if ((rest**2).sum(axis=0) > allowed).any():
        return None
    limits = np.stack([b[i : i + count + 1] for i in range(order + 1)], axis=1) @ weights
    value = float(limits[-1])
    part = max(1, b.size // 3)
    far, near = (float(np.abs(each - value).max()) for each in (b[:part], b[-part:]))
    if not near < STEADY * far:
        return None
    ratio = (near / far) ** (1.0 / (b.size - part)) if near > 0.0 else 0.0
    return _Extrapolation(value, _drift(limits[(limits.size - 1) // 2 :], noise), ratio, weights)


def _drift(limits: Floats, noise: float) -> float:
    """Return a bound of the distance of successive extrapolations from the limit.

    Steady moves belong to a multiplier that the extrapolation does not resolve.
    """
    moves, spread = np.diff(limits), float(np.ptp(limits))
    if spread <= noise or not ((moves > 0.0).all() or (moves < 0.0).all()):
        return 2.0 * spread
    first, last = abs(float(moves[0])), abs(float(moves[-1]))
    if moves.size < 2 or not last < first:
        return REACH * spread
    ratio = (last / first) ** (1.0 / (moves.size - 1))
    return max(2.0 * spread, last * ratio / (1.0 - ratio)) if ratio < 1.0 else math.inf


def block_length(states: Floats) -> int:
    """Return the period of a sequence of states in rows, 1 if none is evident."""
    longest = min(MAX_LAG, len(states) // ENOUGH)
    if longest < 2:
        return 1
    late = states[len(states) // 2 :]
    apart = [
        float(np.abs(late[lag:] - late[:-lag]).mean(axis=0).max()) for lag in range(1, longest + 1)
    ]
    return next(lag for lag, each in enumerate(apart, 1) if each <= 2.0 * min(apart))


def departs(states: Floats) -> bool:
    """Return whether a sequence of states in rows leaves an unstable orbit.

    The changes of a state, or of the states that grow together, then grow exponentially. Changes
    that grow ever more slowly belong to an approach, or to a beat.
    """
    lag = block_length(states)
    squares = (states[lag:] - states[:-lag]) ** 2
    if len(squares) < GROUPS:
        return False
    parts = np.array([part.mean(axis=0) for part in np.array_split(squares, GROUPS)])
    parts = parts[:, (parts > 0.0).all(axis=0) & (parts[-1] > STATE_ERROR**2)]
    x = np.arange(GROUPS) - 0.5 * (GROUPS - 1)
    growing = parts[:, x @ np.log(parts) > 0.0]
    if not growing.size:
        return False
    growing /= growing.mean(axis=0)
    logs = 0.5 * np.log(np.column_stack([growing, growing.sum(axis=1)]))
    rates = x @ logs / (x @ x)
    rest = logs - logs.mean(axis=0) - np.outer(x, rates)
    errors = np.sqrt((rest**2).sum(axis=0) / ((GROUPS - 2) * (x @ x)))
    half = GROUPS // 2
    early, late = logs[half] - logs[0], logs[-1] - logs[half - 1]
    significant = (rates > TREND_SIGNIFICANCE * errors) & (late > 0.5 * early)
    return bool((significant & (logs[-1] - logs[0] > math.log(LEAST_GROWTH))).any())
