"""What is told where nothing was said of typical sizes, and numbers lie far from order one."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping

import numpy as np

from mems_impact.engines.options import Options
from mems_impact.errors import ScaleWarning
from mems_impact.hybrid.trajectory import Events, Floats, Trajectory

__all__ = ["Largest", "tell_of_orbits", "tell_of_run"]

RESOLVED = 1e3  # absolute tolerances that a state should at least come to
FASTEST = 1e-4  # steps on average, in the time that is taken for the system's own
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
    sizes = np.maximum(largest.sizes, np.abs(trajectory.final.y))
    small = {
        name: float(size)
        for name, size in zip(states, sizes, strict=True)
        if 0.0 < size < RESOLVED * options.atol
    }
    start, final, period = trajectory.start, trajectory.final, trajectory.period
    length = (final.cycle - start.cycle) * period + final.time - start.time
    step = length / trajectory.steps if trajectory.steps else 1.0
    if small:
        small = {name: decade(size) for name, size in small.items()}
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


def decade(size: float) -> float:
    """Return the power of ten above a size: a sweep shall not tell the same in many numbers."""
    return float(10.0 ** math.ceil(math.log10(size)))


def _warn(what: str, sizes: Mapping[str, float]) -> None:
    pairs = ", ".join(f"{name!r}: {size:.0e}" for name, size in sizes.items())
    message = f"{what}; say what is typical, for example System(typical={{{pairs}}})"
    warnings.warn(message, ScaleWarning, stacklevel=6)
