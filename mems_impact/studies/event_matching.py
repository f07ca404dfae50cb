"""Assignment of recorded events to those of a run, monotone in time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats

UNMATCHED = -1


def local_spacings(times: Floats, duration: float) -> Floats:
    """Return the distance of each time from the nearest other one; of a single one `duration`."""
    if times.size < 2:
        return np.full(times.size, duration)
    intervals = np.diff(times)
    return np.minimum(np.append(intervals, np.inf), np.insert(intervals, 0, np.inf))


def match_events(
    recorded: Floats, computed: Floats, spacings: Floats, gap: float
) -> NDArray[np.int64]:
    """Return for each recorded event the number of its computed one, or UNMATCHED.

    The assignment with the least price, by dynamic programming, of ascending times. A distance of
    `spacings`, one for each recorded event, counts as one in the price of a pair; `gap` is the
    price of an event without a partner. Computed events after the last recorded one are free, as a
    record ends at any time.
    """
    m, n = recorded.size, computed.size
    if n >= m and (np.abs(computed[:m] - recorded) < min(gap, 0.5) * spacings).all():
        return np.arange(m)
    skipped, numbers = gap * np.arange(n + 1), np.arange(n + 1)
    prices, pairs = skipped, np.abs(recorded[:, None] - computed) / spacings[:, None]
    sources, paired = np.empty((m, n + 1), dtype=np.int64), np.zeros((m, n + 1), dtype=bool)
    for i in range(m):
        best = prices + gap
        joined = prices[:-1] + pairs[i]
        paired[i, 1:] = joined < best[1:]
        best[1:] = np.minimum(best[1:], joined)
        reduced = best - skipped
        least = np.minimum.accumulate(reduced)
        sources[i] = np.maximum.accumulate(np.where(reduced == least, numbers, 0))
        prices = least + skipped
    found, j = np.full(m, UNMATCHED, dtype=np.int64), int(np.argmin(prices))
    for i in range(m - 1, -1, -1):
        j = int(sources[i, j])
        if paired[i, j]:
            j -= 1
            found[i] = j
    return found
