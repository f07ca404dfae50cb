"""A phase portrait that draws itself."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from mems_impact.analysis.run import Run
from mems_impact.plotting.labels import label_axis, label_of, symbol
from mems_impact.plotting.motion import jump, line, moves, plane
from mems_impact.plotting.scene import Scene, caption, clock, frames_of, glow
from mems_impact.plotting.style import color, new_figure, thickness

__all__ = ["portrait"]


def portrait(
    run: Run, first: float | None, last: float | None, per_period: int, x: str | None, y: str | None
) -> Scene:
    """Return the phase portrait of a run, its last period standing out.

    Of a system without forcing the last sixth of what is shown.

    Parameters
    ----------
    run : Run
    first, last, per_period, x, y
        As in `mems_impact.animate`.
    """
    x, y = plane(run.system, x, y)
    frames = frames_of(run, first, last, per_period)
    names = [name for name in (x, y) if name != "t"]
    curve = line(frames.samples, frames.corners, names)
    time, points = curve["t"].to_numpy(), curve[[x, y]].to_numpy(dtype=float)
    corners = frames.corners
    hits = corners[corners["impact"].astype(bool)]
    leaps = corners[np.any([moves(corners, name, frames.samples) for name in names], axis=0)]
    leapt, sides = leaps["t"].to_numpy(), [_ends(leaps, name) for name in (x, y)]
    shown, step = frames.shown, frames.step
    lately = run.system.forcing_period or step * len(shown) / 6.0

    ax = new_figure(1.3).subplots()
    motion, black = color("motion"), color("impact")
    ax.plot(*points.T, linestyle="none")  # for the limits of the axes
    (before,) = ax.plot([], [], color=color("dots"), linewidth=thickness(0.6), zorder=2)
    (trail,) = ax.plot([], [], color=motion, zorder=3)
    (jumps,) = ax.plot([], [], **jump())
    (head,) = ax.plot([], [], linestyle="none", marker="o", markersize=6, color=motion, zorder=6,
                      markeredgecolor="white")  # fmt: skip
    label_axis(ax.xaxis, label_of(shown, x, "time" if x == "t" else symbol(x)))
    label_axis(ax.yaxis, label_of(shown, y, "time" if y == "t" else symbol(y)))
    now = caption(ax)
    moving = [before, trail, jumps, head, now]
    still = len(moving)

    def draw(number: int) -> None:
        here = shown.iloc[number]
        since, until = np.searchsorted(time, [here["t"] - lately, here["t"]], side="right")
        before.set_data(*points[: since + 1].T)
        trail.set_data(*points[since:until].T)
        done = np.searchsorted(leapt, here["t"], side="right")
        jumps.set_data(*(side[: 3 * done] for side in sides))
        head.set_data([here[x]], [here[y]])
        now.set_text(clock(run, here["t"]))
        for flash in moving[still:]:
            flash.remove()
        del moving[still:]
        for _, hit in glow(here["t"], step, hits).iterrows():
            place = [hit["t" if name == "t" else f"{name} before"] for name in (x, y)]
            size = 4.0 + 10.0 * hit["strength"]
            moving.extend(
                ax.plot(*place, color=black, alpha=hit["strength"], marker="*", markersize=size,
                        zorder=5)
            )  # fmt: skip

    return Scene(ax.figure, draw, len(shown), moving)


def _ends(leaps: pd.DataFrame, name: str) -> np.ndarray[Any, Any]:
    """Return where jumps begin and end in one direction of the plane, with gaps between them."""
    before, after = ("t", "t") if name == "t" else (f"{name} before", f"{name} after")
    gap = np.full(len(leaps), np.nan)
    return np.column_stack([leaps[before], leaps[after], gap]).ravel()
