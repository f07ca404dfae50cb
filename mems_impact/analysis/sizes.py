"""What is told where nothing was said of typical sizes, and numbers lie far from order one."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping

import numpy as np

from mems_impact.engines.options import Options
from mems_impact.hybrid.trajectory import Events, Floats, Trajectory
from mems_impact.warnings import ScaleWarning

__all__ = ["Largest", "tell_of_orbits", "tell_of_run"]

RESOLVED = 1e3  # absolute tolerances that a state should at least come to
FASTEST = 1e-4  # steps on average, in the time that is taken for the system's own
LOOKS = 64  # between events
ORDER_ONE = (1e-5, 1e5)  # sizes of times and parameters on which differences may count


class Largest:
    """The largest sizes that the states have come to at events."""

    def __init__(self, y: Floats) -> None:
        self.sizes = np.abs(y)

    def __call__(self, events: Events) -> None:
        """Take a chunk of events in."""
        for y in (events.before, events.after):
            if len(y):
                np.maximum(self.sizes, np.abs(y).max(axis=0), out=self.sizes)


def tell_of_run(
    states: tuple[str, ...],
    options: Options,
    trajectory: Trajectory,
    largest: Largest,
    timed: bool,
) -> None:
    """Warn if a state stays below what the absolute tolerance resolves, or time does.

    Parameters
    ----------
    states : tuple of str
    options : Options
    trajectory : Trajectory
    largest : Largest
    timed : bool
        Whether the system has a time of its own: a period, or a time scale.
    """
    limit = RESOLVED * options.atol
    sizes = np.maximum(largest.sizes, np.abs(trajectory.final.y))
    if ((sizes > 0.0) & (sizes < limit)).any():
        # A speed may be zero at all events: they are its turning points.
        sizes = np.maximum(sizes, between(trajectory))
    small = {
        name: decade(float(size))
        for name, size in zip(states, sizes, strict=True)
        if 0.0 < size < limit
    }
    start, final, period = trajectory.start, trajectory.final, trajectory.period
    length = (final.cycle - start.cycle) * period + final.time - start.time
    step = length / trajectory.steps if trajectory.steps else 1.0
    if small:
        stay = " and ".join(f"{name} stays below {size:.0e}" for name, size in small.items())
        what = f"{stay}, where atol = {options.atol:g} resolves little"
        _warn(what, small)
    elif not timed and 0.0 < step < FASTEST:
        step = decade(step)
        what = f"steps are below {step:.0e}, in a system that is taken to move within a time of 1"
        _warn(what, {"time": 10.0 * step})


def tell_of_orbits(period: float, parameters: Mapping[str, float]) -> None:
    """Warn if differences on which orbits rest would drown in a time or a parameter."""
    low, high = ORDER_ONE
    sizes = {"time": period, **parameters}
    far = {name: abs(size) for name, size in sizes.items() if size and not low < abs(size) < high}
    if far:
        listed = ", ".join(
            f"{'the period' if name == 'time' else name} = {size:.1e}" for name, size in far.items()
        )
        _warn(f"{listed}: far from order one, in which differences for orbits count", far)


def between(trajectory: Trajectory) -> Floats:
    """Return the largest sizes of the states in the first two periods, between events too."""
    start, final, period = trajectory.start, trajectory.final, trajectory.period
    first, last = (each.cycle + each.time / period for each in (start, final))
    length = min(2.0, last - first)
    if length <= 0.0:
        return np.abs(start.y)
    seen = trajectory.samples(math.ceil(LOOKS / length), last=first + length).y
    return np.abs(seen).max(axis=0, initial=0.0)


def decade(size: float) -> float:
    """Return the power of ten above a size: a sweep shall not tell the same in many numbers."""
    return float(10.0 ** math.ceil(math.log10(size)))


def _warn(what: str, sizes: Mapping[str, float]) -> None:
    pairs = ", ".join(f"{name!r}: {size:.0e}" for name, size in sizes.items())
    message = f"{what}; say what is typical, for example System(typical={{{pairs}}})"
    warnings.warn(message, ScaleWarning, stacklevel=6)
