"""A run that goes on chunk by chunk, with perturbations carried along: one call for many chunks.

Written over the engine's contract, for both forms. The run has an engine of its own, and writes its
events; the columns are carried through them by that of the extended flow.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mems_impact.hybrid import loop
from mems_impact.hybrid.perturbed import ahead_of, carry, go, put
from mems_impact.hybrid.record import (
    BUFFER_FULL,
    DONE,
    FAILED,
    NONE,
    PAUSED,
    Y,
    event_at,
    row,
    whole_periods,
)

# How far `stretch` has come.
STRETCHING = np.dtype(
    [
        ("advance", np.int64),  # address of the event loop
        ("plain", np.int64),  # and of the run's own engine
        ("chunk", np.int64),
        ("begun", np.int64),  # 1 while that one has begun
        ("lost", np.int64),  # 1 where the columns cannot be carried on
    ]
)
BITE = 4  # steps that the event loop takes before what it has written is read
NEAR = 0.75  # part of the time between two orthonormalizations by which the run may be ahead


def stretch(engine: Any, s: Any, w: Any, at: Any, setup: Any, lengths: Any, grown: Any,
            quota: int) -> int:  # fmt: skip
    """Let the run go on chunk by chunk, and carry the columns along.

    Parameters
    ----------
    engine
        Of the extended flow (see `mems_impact.hybrid.columns`).
    s : CLOCK
        Of the run.
    w : STRETCHING
    at : Perturbed
    setup : Setup
    lengths : float array, shape (N,)
        Periods in each chunk.
    grown : float array, shape (N, k)
        Gets the logarithms of what columns have grown by in each.
    quota : int
        Steps of the run that this call may take.

    Returns
    -------
    int
        DONE, PAUSED, FAILED if the columns cannot be carried on, or what ended the run.
    """
    while w.chunk < lengths.size:
        if w.begun == 0:
            begin(s, lengths[w.chunk])
            for c in range(setup.k):
                at.growth[c] = 0.0
            w.begun = 1
        while w.begun == 1:
            if quota <= 0:
                return PAUSED
            status = run_on(s, w)
            quota -= BITE
            for i in range(s.rows):
                if not carry(engine, event_at(s, i), at, setup):
                    w.lost = 1
                    return FAILED
            s.rows = 0
            if status == DONE:
                w.begun = 0
            elif status not in (PAUSED, BUFFER_FULL):
                return status
            elif not follow(engine, s, at, setup):
                w.lost = 1
                return FAILED
        if not go(engine, s.end_cycle, s.end_phase, at, setup):
            w.lost = 1
            return FAILED
        put(row(s, Y), 0, at, setup)
        for c in range(setup.k):
            grown[w.chunk, c] = at.growth[c]
        w.chunk += 1
    return DONE


def begin(s: Any, length: float) -> None:
    """Let the run go on for so many periods from where it was to end."""
    whole = math.floor(length)
    s.end_phase += (length - whole) * s.period
    ahead = whole_periods(s.end_phase, s.period)
    s.end_phase -= ahead * s.period
    s.end_cycle += whole + ahead
    s.fresh = 1


def follow(engine: Any, s: Any, at: Any, setup: Any) -> bool:
    """Carry the columns to where the run has come, if it is far enough ahead; False on failure.

    The state that carries them is integrated on its own, and parts from the run as neighbouring
    motions do. Put back too late, it would jump, and columns along the flow would no longer be.
    """
    far = ahead_of(at, s.cycle, s.t, setup) >= NEAR * at.length[0]
    if s.pending != NONE or not far:
        return True
    went = go(engine, s.cycle, s.t, at, setup)
    put(row(s, Y), 0, at, setup)
    return went


def run_on(s: Any, w: Any) -> int:
    """Let the event loop of the run take some steps."""
    return loop.advance(w.plain, s, BITE)
