"""The motion of any system as lines: exact at transitions, broken where it jumps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd

from mems_impact.analysis.system import System
from mems_impact.errors import InvalidParameter
from mems_impact.plotting.style import LINES, MODE_COLORS, color, thickness

__all__ = [
    "IMPACT", "SMALL", "between", "check_states", "interleaved", "jump", "line", "mode_styles",
    "moves", "plane", "shade", "spans",
]  # fmt: skip

IMPACT: dict[str, Any] = {
    "linestyle": "none", "marker": "o", "markersize": 4.5, "markeredgecolor": "white",
    "markeredgewidth": 0.6, "zorder": 4,
}  # fmt: skip
"""How an impact is marked, beside its colour."""

HATCHES = ("", "////", "....", "\\\\\\\\", "xxxx", "||||")
SMALL = 1e-9  # a jump that is none, as a part of the largest value
SAME = 1e-12  # instants that are one, as a part of the time shown


def check_states(field: str, names: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    """Return the names of states as a tuple; InvalidParameter where one is none of the system's."""
    names = (names,) if isinstance(names, str) else tuple(names)
    for name in names or [""]:
        if name not in known:
            raise InvalidParameter(field, name, f"one of {', '.join(known)}")
    return names


def plane(system: System, x: str | None, y: str | None) -> tuple[str, str]:
    """Return the states that span the plane."""
    free = [name for i, name in enumerate(system.states) if i not in system.automaton.cyclic]
    known = (*system.states, "t")
    for field, name in (("x", x), ("y", y)):
        if name is not None:
            check_states(field, name, known)
    if x is None:
        x = next((name for name in free if name != y), "t") if len(free) > 1 else "t"
    if y is None:
        y = next(name for name in (*free, *known) if name != x)
    return x, y


def between(corners: pd.DataFrame, samples: pd.DataFrame) -> pd.DataFrame:
    """Return the transitions from the first sample to the last."""
    first, last = samples["t"].iloc[0], samples["t"].iloc[-1]
    return corners[(corners["t"] >= first) & (corners["t"] <= last)]


def moves(corners: pd.DataFrame, name: str, samples: pd.DataFrame) -> pd.Series:
    """Return at which transitions a state jumps."""
    size = SMALL * float(samples[name].abs().max())
    return (corners[f"{name} after"] - corners[f"{name} before"]).abs() > size


def line(samples: pd.DataFrame, corners: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    """Return a line through samples and transitions: t, the states `names`, mode.

    At a transition stand the states before and after it; between them a row of NaN where one jumps.
    """
    names, taken = list(names), corners["t"].to_numpy()
    jumps = np.zeros(len(corners), dtype=bool)
    for name in names:
        jumps |= moves(corners, name, samples).to_numpy()
    kept, order = interleaved(samples["t"].to_numpy(), taken, jumps)
    sides = []
    for side in ("before", "after"):
        rows = {name: corners[f"{name} {side}"].to_numpy() for name in names}
        modes = corners[f"mode {side}"].astype(str).to_numpy()
        sides.append(pd.DataFrame({"t": taken, **rows, "mode": modes}))
    gaps = sides[1][jumps].copy()
    gaps[names] = np.nan
    shown = samples.loc[kept, ["t", *names]].assign(mode=samples["mode"].astype(str))
    parts = [part for part in (shown, sides[0], gaps, sides[1]) if len(part)]
    return pd.concat(parts, ignore_index=True).iloc[order].reset_index(drop=True)


def interleaved(
    time: np.ndarray, instants: np.ndarray, jumps: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return which samples stay, and how a line goes through them and the transitions.

    Parameters
    ----------
    time : ndarray
        Of the samples.
    instants : ndarray
        Of the transitions.
    jumps : ndarray of bool
        At which of these the line is broken.

    Returns
    -------
    tuple of ndarray
        A mask of the samples that are at no transition, and the order in time of these samples,
        the sides before transitions, one gap for each jump and the sides after, one behind another.
    """
    # A sample at the instant of a transition may stand on either side of it.
    place, near = np.searchsorted(instants, time), np.full(time.size, np.inf)
    for beside in (place - 1, place):
        inside = (beside >= 0) & (beside < instants.size)
        near[inside] = np.minimum(near[inside], np.abs(time[inside] - instants[beside[inside]]))
    kept = near > SAME * (time[-1] - time[0])
    turn = 3 * np.arange(instants.size)
    ranks = [np.full(int(kept.sum()), -1), turn, turn[jumps] + 1, turn + 2]
    times = [time[kept], instants, instants[jumps], instants]
    return kept, np.lexsort((np.concatenate(ranks), np.concatenate(times)))


def jump() -> dict[str, Any]:
    """Return how a jump is drawn."""
    width = thickness(0.8)
    return {"color": color("impact"), "linewidth": width, "linestyle": (0, (2, 1.2)), "zorder": 3}


def shade(number: int) -> dict[str, Any]:
    """Return how stretches in the mode of that place among those shaded are filled."""
    own = MODE_COLORS[number % len(MODE_COLORS)]
    return {
        "facecolor": (own, 0.3),
        "edgecolor": (own, 0.6),
        "hatch": HATCHES[number % len(HATCHES)],
    }


def mode_styles(spent: pd.Series, modes: Sequence[str]) -> dict[str, tuple[str, Any]]:
    """Return colour and line style of the modes in which time is spent, in the system's order.

    Parameters
    ----------
    spent : Series
        By mode, the time in it; the longest has the colour of the motion.
    modes : sequence of str
        All of the system's.
    """
    most = spent.idxmax()
    others = [mode for mode in modes if mode in spent.index and mode != most]
    styles = {
        mode: (MODE_COLORS[i % len(MODE_COLORS)], LINES[(i + 1) % len(LINES)])
        for i, mode in enumerate(others)
    }
    return {str(most): (color("motion"), "-"), **styles}


def spans(samples: pd.DataFrame, corners: pd.DataFrame) -> pd.DataFrame:
    """Return the stretches of time in one mode: mode, start, end; without those of no length."""
    changes = corners[corners["mode before"].astype(str) != corners["mode after"].astype(str)]
    first, last = samples["t"].iloc[0], samples["t"].iloc[-1]
    # The mode of the first sample is that before the first change, if there is one.
    begin = changes["mode before"].iloc[0] if len(changes) else samples["mode"].iloc[0]
    borders = np.concatenate([[first], changes["t"].to_numpy(), [last]])
    found = pd.DataFrame(
        {
            "mode": [str(begin), *changes["mode after"].astype(str)],
            "start": borders[:-1],
            "end": borders[1:],
        }
    )
    return found[found["end"] > found["start"]].reset_index(drop=True)
