"""Whether a motion has no orbit because some of its states grow for ever."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from mems_impact.errors import RunError
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.run import run
from mems_impact.hybrid.trajectory import Floats, Instant, Samples, Trajectory
from mems_impact.hybrid.variational import free_components
from mems_impact.orbits.timing import FAR, state_enters

PERIODS = 96  # of the forcing that a motion is followed for
SHORTEST, STEPS = 1e-6, 4000  # where nothing forces it: first piece, in units of time; steps
STEADY = 0.1  # change of a rate, relative to it, below which a state grows as before
LOOKED = 8  # instants of the run at which the functions are looked at

_Kind = Literal["unread", "angle", "together"]


class Drift(NamedTuple):
    """Components of the state that grow for ever, where functions do not notice it.

    Attributes
    ----------
    places : tuple of int
    rates : float array
        What each gains in a period of the problem.
    kind : {"unread", "angle", "together"}
        Functions do not read them; repeat every 2 pi of each; read their differences only.
    """

    places: tuple[int, ...]
    rates: Floats
    kind: _Kind


def drift_of(problem: Problem, start: Instant, units: Floats, *, forced: bool) -> Drift | None:
    """Return what grows for ever along a motion; None if nothing does.

    Parameters
    ----------
    problem : Problem
    start : Instant
    units : float array, shape (n,)
        The user's units of the components, in those of the numerics.
    forced : bool
        Whether the period of the problem is one.
    """
    try:
        longer = _followed(problem, replace(start, cycle=0, time=0.0), forced)
    except RunError:
        return None
    length = longer.final.cycle + longer.final.time / problem.period
    each = max(1, math.ceil(PERIODS / length))
    grid = longer.samples(each)
    rates = _rates(grid.y, each)
    grows = [i for i in free_components(problem.automaton) if rates[i] != 0.0]
    unit = np.diag(units)

    def unfelt(shifts: Iterable[Floats], exactly: bool = False) -> bool:
        return not any(_felt(problem, grid, shift, exactly) for shift in shifts)

    alone = [i for i in grows if unfelt((f * rates[i] / units[i] * unit[i] for f in FAR), True)]
    if alone:
        return Drift(tuple(alone), rates[alone], "unread")
    turning = [i for i in grows if unfelt([2.0 * math.pi * unit[i]])]
    if turning:
        return Drift(tuple(turning), rates[turning], "angle")
    if len(grows) > 1:
        most = np.abs(rates / units)[grows].max()
        if unfelt(f * most * unit[grows].sum(axis=0) for f in FAR):
            return Drift(tuple(grows), rates[grows], "together")
    return None


def _followed(problem: Problem, start: Instant, forced: bool) -> Trajectory:
    """Return a run over which what grows for ever can be told from what swings."""
    if forced:
        return run(problem, start, PERIODS)
    length = SHORTEST
    while True:
        piece = run(problem, start, length)
        if piece.steps > STEPS or length > PERIODS:
            return piece
        length *= 4.0


def _rates(y: Floats, each: int) -> Floats:
    """Return what components gain in a period; 0 for one that does not grow, or not steadily."""
    window = len(y) // 4
    pieces = [y[len(y) - (k + 1) * window : len(y) - k * window] for k in range(3)]
    last, middle, first = (piece.mean(axis=0) for piece in pieces)
    gained, before = last - middle, middle - first
    straight = np.outer(np.arange(window) / window, gained)
    swing = np.ptp(pieces[0] - straight, axis=0)
    steady = np.abs(gained - before) <= STEADY * np.abs(gained)
    return np.where(steady & (swing < np.abs(gained)), gained * each / window, 0.0)


def _felt(problem: Problem, grid: Samples, shift: Floats, exactly: bool) -> bool:
    rows = np.linspace(1, len(grid.y) - 1, LOOKED).astype(int)
    return any(
        state_enters(problem, Instant(0, grid.time[i], int(grid.mode[i]), grid.y[i]), shift,
                     exactly=exactly)
        for i in rows
    )  # fmt: skip
