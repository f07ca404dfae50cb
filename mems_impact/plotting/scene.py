"""What moving pictures share: their frames out of a run, and flashes that none of them misses."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from mems_impact.analysis.run import Run
from mems_impact.errors import InvalidParameter
from mems_impact.plotting.motion import between

__all__ = ["Frames", "Scene", "caption", "clock", "frames_of", "glow"]

SHOWN = 6  # forcing periods by default
FLASH = 6  # frames over which the flash of an impact fades
FEWEST = 400  # samples of a line in a period


class Scene(NamedTuple):
    """A figure that moves.

    Attributes
    ----------
    figure : matplotlib Figure
    draw : callable
        Puts its artists where they are in the frame of that number.
    frames : int
        How many frames there are.
    moving : list of Artist
        All that changes; the rest is drawn once.
    """

    figure: Any
    draw: Callable[[int], None]
    frames: int
    moving: list[Any]


class Frames(NamedTuple):
    """The part of a run that moves.

    Attributes
    ----------
    samples : DataFrame
        Close to each other, for lines.
    every : int
        Which of them are frames: each one after so many.
    corners : DataFrame
        The transitions among them.
    """

    samples: pd.DataFrame
    every: int
    corners: pd.DataFrame

    @property
    def shown(self) -> pd.DataFrame:
        """The samples that are frames."""
        return self.samples.iloc[:: self.every].reset_index(drop=True)

    @property
    def step(self) -> float:
        """The time from one frame to the next."""
        t = self.samples["t"].to_numpy()
        return float((t[-1] - t[0]) / (len(t) - 1) * self.every)


def frames_of(run: Run, first: float | None, last: float | None, per_period: int) -> Frames:
    """Return the samples of a run that frames show, and the transitions among them."""
    begin, end = run.extent
    every = math.ceil(FEWEST / per_period)
    rate = per_period * every
    if run.system.forced:
        if first is None:
            first = max(begin, (end if last is None else last) - SHOWN)
    else:  # as many frames in all as there would be by default
        whole = max((end - begin) * run.system.out("time", run.trajectory.period), 1e-300)
        low, high = 0.0 if first is None else first, whole if last is None else last
        rate = every * max(1, math.ceil(SHOWN * per_period / max(high - low, 1e-300)))
    samples = run.samples(rate, first, last)
    if len(samples) <= every:
        raise InvalidParameter("first, last", (first, last), "at least two frames apart")
    return Frames(samples, every, between(run.corners, samples))


def glow(time: float, step: float, hits: pd.DataFrame) -> pd.DataFrame:
    """Return the impacts that flash at a time, one row each, with their `strength` in (0, 1].

    An impact flashes at full strength in the first frame that is not before it, and fades over
    `FLASH` frames.
    """
    frame = np.maximum(np.ceil((time - hits["t"]) / step - 1e-6), 0.0)
    seen = (hits["t"] <= time + 1e-6 * step) & (frame < FLASH)
    return hits[seen].assign(strength=1.0 - frame[seen] / FLASH)


def caption(ax: Any) -> Any:
    """Return the text above axes; a title would wander, as axes are drawn without it."""
    return ax.annotate(
        " ", (0.0, 1.0), xycoords="axes fraction", xytext=(0, 3), textcoords="offset points",
        fontsize="small", va="bottom",
    )  # fmt: skip


def clock(run: Run, time: float) -> str:
    """Return what a frame says of the time."""
    period = run.system.forcing_period
    if period is not None:
        return f"period {time / period:.2f}"
    unit = run.system.unit("time")
    return f"t = {time:.4g} {unit}".rstrip()
