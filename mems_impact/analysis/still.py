"""Runs that end when nothing goes on any more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from mems_impact.analysis.run import Run
from mems_impact.hybrid.trajectory import Trajectory

__all__ = ["STILL", "until_still"]

STILL = "still"
FIRST, MORE = 64, 4  # periods of the first attempt, and how many times as long the next one is


def until_still(
    still: Callable[[Trajectory], float | None],
    attempt: Callable[[float], Run],
    run: Callable[[float], Run],
    most: float,
) -> Run:
    """Return the run up to where the system stands still, or over `most` periods if it never does.

    A run has the same steps however far it goes, so that what a longer one has shown holds for the
    one that ends there.

    Parameters
    ----------
    still : callable
        ``still(trajectory)``, the periods after which the system stands still; None if it does not.
    attempt, run : callable
        Runs over so many periods: with events, and as it was asked for.
    most : float
        Periods.
    """
    length = min(float(FIRST), most)
    while True:
        after = still(attempt(length).trajectory)
        if after is not None:
            return replace(run(after), ended=STILL)
        if length >= most:
            return run(most)
        length = min(MORE * length, most)
