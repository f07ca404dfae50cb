"""Figures of runs and orbits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pkgutil import resolve_name
from typing import Any

import numpy as np
import pandas as pd

from mems_impact._util.arrays import distance_to_nearest
from mems_impact.analysis.orbit import Orbit
from mems_impact.analysis.run import Run
from mems_impact.errors import InvalidParameter
from mems_impact.plotting.labels import (
    Label,
    crosses,
    label_axis,
    label_of,
    legend_above,
    letter_panels,
    symbol,
)
from mems_impact.plotting.style import (
    LINES,
    MODE_COLORS,
    Axes,
    color,
    given_axes,
    new_figure,
    styled,
    thickness,
)
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.result import check_kind
from mems_impact.tables import captions

# --- Lines: exact at transitions, broken at jumps

IMPACT: dict[str, Any] = {
    "linestyle": "none", "marker": "o", "markersize": 4.5, "markeredgecolor": "white",
    "markeredgewidth": 0.6, "zorder": 4,
}  # fmt: skip
"""Marker style of impacts."""

MODE_HATCHES = ("", "////", "....", "\\\\\\\\", "xxxx", "||||")
MIN_DRAWN_JUMP = 1e-9  # smaller jumps, relative to the largest value, are ignored
SAME_INSTANT_RATIO = 1e-12  # difference of equal instants, as a part of the shown time


def check_states(field: str, names: Sequence[str], allowed: Sequence[str]) -> tuple[str, ...]:
    """Return the names of states as a tuple; raise InvalidParameter for an unknown state."""
    names = (names,) if isinstance(names, str) else tuple(names)
    for name in names or [""]:
        if name not in allowed:
            raise InvalidParameter(field, name, f"one of {', '.join(allowed)}")
    return names


def plane(system: HybridSystem, x: str | None, y: str | None) -> tuple[str, str]:
    """Return the states that span the plane."""
    free, allowed = system.state_space.free, (*system.states, "t")
    for field, name in (("x", x), ("y", y)):
        if name is not None:
            check_states(field, name, allowed)
    if x is None:
        x = next((name for name in free if name != y), "t") if len(free) > 1 else "t"
    if y is None:
        y = next(name for name in (*free, *allowed) if name != x)
    return x, y


def between(corners: pd.DataFrame, samples: pd.DataFrame) -> pd.DataFrame:
    """Return the transitions from the first sample to the last."""
    first, last = samples["t"].iloc[0], samples["t"].iloc[-1]
    return corners[(corners["t"] >= first) & (corners["t"] <= last)]


def is_jump(corners: pd.DataFrame, name: str, samples: pd.DataFrame) -> pd.Series:
    """Return whether a state jumps at each transition."""
    size = MIN_DRAWN_JUMP * float(samples[name].abs().max())
    return (corners[f"{name} after"] - corners[f"{name} before"]).abs() > size


def line(samples: pd.DataFrame, corners: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    """Return a line through samples and transitions: t, the states `names`, mode.

    Each transition gives the states before and after it, with a row of NaN between them at a jump.
    """
    names, instants = list(names), corners["t"].to_numpy()
    jumps = np.zeros(len(corners), dtype=bool)
    for name in names:
        jumps |= is_jump(corners, name, samples).to_numpy()
    distinct, order = interleaved(samples["t"].to_numpy(), instants, jumps)
    sides = []
    for side in ("before", "after"):
        rows = {name: corners[f"{name} {side}"].to_numpy() for name in names}
        modes = corners[f"mode {side}"].astype(str).to_numpy()
        sides.append(pd.DataFrame({"t": instants, **rows, "mode": modes}))
    gaps = sides[1][jumps].copy()
    gaps[names] = np.nan
    selected = samples.loc[distinct, ["t", *names]].assign(mode=samples["mode"].astype(str))
    pieces = [part for part in (selected, sides[0], gaps, sides[1]) if len(part)]
    return pd.concat(pieces, ignore_index=True).iloc[order].reset_index(drop=True)


def interleaved(
    time: np.ndarray, instants: np.ndarray, jumps: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the samples to keep, and the order of samples and transitions along a line.

    `jumps` are the transitions (at `instants`) where the line is broken. The result is a mask of
    the samples away from transitions, and the order in time of the concatenation of these samples,
    the states before transitions, one gap for each jump, and the states after.
    """
    # A sample at the instant of a transition may be on either side of it.
    near = distance_to_nearest(time, instants)
    distinct = near > SAME_INSTANT_RATIO * (time[-1] - time[0])
    turn = 3 * np.arange(instants.size)
    ranks = [np.full(int(distinct.sum()), -1), turn, turn[jumps] + 1, turn + 2]
    times = [time[distinct], instants, instants[jumps], instants]
    return distinct, np.lexsort((np.concatenate(ranks), np.concatenate(times)))


def jump() -> dict[str, Any]:
    """Return the line style of a jump."""
    width = thickness(0.8)
    return {"color": color("impact"), "linewidth": width, "linestyle": (0, (2, 1.2)), "zorder": 3}


def shade(number: int) -> dict[str, Any]:
    """Return the fill style of the shaded mode with this index."""
    mode_color = MODE_COLORS[number % len(MODE_COLORS)]
    return {
        "facecolor": (mode_color, 0.3),
        "edgecolor": (mode_color, 0.6),
        "hatch": MODE_HATCHES[number % len(MODE_HATCHES)],
    }


def mode_styles(spent: pd.Series, modes: Sequence[str]) -> dict[str, tuple[str, Any]]:
    """Return colour and line style of the visited modes, in the order of all modes of the system.

    The mode in which most time is spent has the colour of the motion.
    """
    longest = spent.idxmax()
    others = [mode for mode in modes if mode in spent.index and mode != longest]
    styles = {
        mode: (MODE_COLORS[i % len(MODE_COLORS)], LINES[(i + 1) % len(LINES)])
        for i, mode in enumerate(others)
    }
    return {str(longest): (color("motion"), "-"), **styles}


def spans(samples: pd.DataFrame, corners: pd.DataFrame) -> pd.DataFrame:
    """Return the intervals in one mode: mode, start, end; without empty ones."""
    changes = corners[corners["mode before"].astype(str) != corners["mode after"].astype(str)]
    first, last = samples["t"].iloc[0], samples["t"].iloc[-1]
    # The mode of the first sample is that before the first change, if there is one.
    begin = changes["mode before"].iloc[0] if len(changes) else samples["mode"].iloc[0]
    borders = np.concatenate([[first], changes["t"].to_numpy(), [last]])
    intervals = pd.DataFrame(
        {
            "mode": [str(begin), *changes["mode after"].astype(str)],
            "start": borders[:-1],
            "end": borders[1:],
        }
    )
    return intervals[intervals["end"] > intervals["start"]].reset_index(drop=True)


# --- Periodic orbits

ORBIT_POINTS_PER_PERIOD = 1000


@styled
def plot_orbit(orbit: Orbit, ax: Any = None, *, x: str | None = None, y: str | None = None) -> Axes:
    """Draw one state of a periodic orbit over another, with impacts and the section.

    A dotted line joins the states before and after a jump. A diamond is where the orbit crosses the
    Poincaré section or, without a section, where a forcing period or the cycle begins.

    Parameters
    ----------
    orbit : Orbit
    ax : matplotlib Axes, optional
        Axes to draw on; a new figure by default.
    x, y : str, optional
        States on the axes, or ``"t"``; by default the first two non-cyclic states, or a single
        state over time, and for an actuator the block between the stoppers.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If `orbit` is not an orbit, or a state is unknown.

    See Also
    --------
    find_orbit, Orbit, plot_run

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> mi.plot_orbit(orbit, x="x2", y="v2").figure.savefig("orbit.png")
    """
    check_kind(orbit, "orbit", Orbit, "an Orbit, as mems_impact.find_orbit returns it")
    if orbit.figure and x is None and y is None:
        return resolve_name(orbit.figure)(orbit, ax)
    x, y = plane(orbit.system, x, y)
    if ax is None:
        ax = new_figure(1.2).subplots()
    samples, corners = _closed(orbit), orbit.corners
    names = [name for name in (x, y) if name != "t"]
    curve = line(samples, corners, names)
    system = orbit.system
    spent = curve["mode"].value_counts()
    for mode, (shade, dashes) in mode_styles(spent, system.modes).items():
        ordinate = curve[y].where(curve["mode"] == mode)
        label = mode if len(system.modes) > 1 else None
        ax.plot(curve[x], ordinate, color=shade, linestyle=dashes, label=label)
    jumps = pd.Series(False, index=corners.index)
    for name in names:
        jumps |= is_jump(corners, name, samples)
    for number, (_, row) in enumerate(corners[jumps].iterrows()):
        ends = [
            [row["t"]] * 2 if name == "t" else [row[f"{name} before"], row[f"{name} after"]]
            for name in (x, y)
        ]
        label = None if number else ("impact" if corners["impact"].any() else "jump")
        ax.plot(*ends, marker="o", label=label, **jump())
    _mark_section(ax, orbit, x, y)
    for name, axis in ((x, ax.xaxis), (y, ax.yaxis)):
        label_axis(axis, label_of(samples, name, "time" if name == "t" else symbol(name)))
    legend_above(ax)
    return ax


def _closed(orbit: Orbit) -> pd.DataFrame:
    """Return the samples of an orbit over one period."""
    samples = orbit.samples(ORBIT_POINTS_PER_PERIOD)
    last = samples.iloc[[0]].copy()
    last["t"] += orbit.periods * orbit.period
    for name, gain in orbit.gains.items():
        last[name] += gain
    return pd.concat([samples, last], ignore_index=True)


def _mark_section(ax: Any, orbit: Orbit, x: str, y: str) -> None:
    """Mark the crossings of the section, and the section itself if it is a line."""
    rows, section = orbit.section(), captions(orbit.system)
    label = crosses(section) or ("period begins" if orbit.system.forced else "cycle begins")
    if section["section"]:
        state, level = section["section"]
        draw = ax.axvline if state == x else ax.axhline if state == y else None
        if draw is not None:
            draw(level, color=color("guide"), linewidth=0.8, linestyle=(0, (1, 2)), zorder=1)
    ax.plot(
        rows[x], rows[y], linestyle="none", marker="D", color="white",
        markeredgecolor="black", markeredgewidth=0.8, zorder=5, label=label,
    )  # fmt: skip


# --- States over time

FIGURE_PERIODS = 6  # forcing periods by default
RUN_POINTS_PER_PERIOD = 400
SAMPLES_UNFORCED = 3000  # over a run without forcing
PANELS = 6  # by default


@styled
def plot_run(
    run: Run,
    first: float | None = None,
    last: float | None = None,
    ax: Any = None,
    *,
    states: Sequence[str] | None = None,
) -> Axes:
    """Draw the states of a run over time, with impacts marked and modes shaded.

    A dotted line joins the values before and after a jump at an impact. The most frequent mode is
    not shaded.

    Parameters
    ----------
    run : Run
        A run with events.
    first, last : float, optional
        Drawn interval in forcing periods, in time for an autonomous system; by default the last 6
        periods, or the whole run of an autonomous system.
    ax : matplotlib Axes or sequence of these, optional
        Axes to draw on, one per state; a new figure by default.
    states : sequence of str, optional
        The states to draw; by default at most the first 6, and for an actuator the block between
        its stoppers, the frame, and the voltage at the electrodes if it differs from the drive's.

    Returns
    -------
    Axes
        The uppermost; ``ax.figure.savefig(…)`` writes the figure, ``ax.figure.axes`` are all.

    Raises
    ------
    InvalidParameter
        If the run has no events, does not cover the periods, or a state is unknown.

    See Also
    --------
    simulate, Run, plot_orbit

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> run = mi.simulate(actuator, drive, periods=300)
    >>> axes = mi.plot_run(run, first=296, states=["v2"])
    >>> axes.figure.savefig("run.png")
    """
    check_kind(run, "run", Run, "a Run, as mems_impact.simulate returns it")
    if run.figure and states is None:
        return resolve_name(run.figure)(run, first, last, ax)[0]
    known_states = run.system.states
    chosen = (
        known_states[:PANELS] if states is None else check_states("states", states, known_states)
    )
    if ax is None:
        figure = new_figure(0.55 * len(chosen), 2.5)
        axes = list(figure.subplots(len(chosen), sharex=True, squeeze=False)[:, 0])
        letter_panels(axes)
    else:
        axes = given_axes(ax, len(chosen), "one per state")

    samples = _samples(run, first, last)
    corners = between(run.corners, samples)
    curve = line(samples, corners, chosen)
    unit, label = time_axis(run.system)
    stretches = spans(samples, corners)
    spent = (stretches["end"] - stretches["start"]).groupby(stretches["mode"]).sum()
    longest, *shaded = mode_styles(spent, run.system.modes)
    shades = {mode: shade(i) for i, mode in enumerate(shaded)}
    for panel, name in zip(axes, chosen, strict=True):
        for stretch in stretches[stretches["mode"] != longest].itertuples():
            # The edge keeps intervals visible that are thinner than a pixel.
            panel.axvspan(
                stretch.start / unit, stretch.end / unit, linewidth=0.8, zorder=0,
                **shades[stretch.mode],
            )  # fmt: skip
        panel.plot(curve["t"] / unit, curve[name], color=color("motion"))
        _mark(panel, name, corners, samples, unit)
        label_axis(panel.yaxis, label_of(samples, name, symbol(name)))
    axes[-1].set_xlim(samples["t"].iloc[0] / unit, samples["t"].iloc[-1] / unit)
    label_axis(axes[-1].xaxis, label)
    _key(axes[0], longest if len(run.system.modes) > 1 else "", shades, corners)
    return axes[0]


def time_axis(system: HybridSystem) -> tuple[float, Label]:
    """Return the unit in which figures of runs count time, and the label of the axis.

    Time is absolute where it has a unit, or there is no forcing period.
    """
    unit, period = system.units.get("time", ""), system.forcing_period
    if period is not None and not unit:
        return float(period), Label("time / forcing period")
    return 1.0, Label("time", unit)


def _samples(run: Run, first: float | None, last: float | None) -> pd.DataFrame:
    """Return the samples to draw, at the resolution of a figure."""
    begin, end = run.extent
    if run.system.forced:
        if first is None:
            first = max(begin, (end if last is None else last) - FIGURE_PERIODS)
        return run.samples(RUN_POINTS_PER_PERIOD, first, last)
    return run.samples(max(1, math.ceil(SAMPLES_UNFORCED / max(end - begin, 1e-300))), first, last)


def _mark(ax: Any, name: str, corners: pd.DataFrame, samples: pd.DataFrame, unit: float) -> None:
    """Mark impacts by dots, and jumps of the state by dotted lines."""
    jumps = corners[is_jump(corners, name, samples)]
    if len(jumps):
        before, after = jumps[f"{name} before"], jumps[f"{name} after"]
        broken = np.column_stack([before, after, np.full(len(jumps), np.nan)]).ravel()
        ax.plot(np.repeat(jumps["t"] / unit, 3), broken, **jump())
    hits = corners[corners["impact"] & ~is_jump(corners, name, samples)]
    if len(hits):  # matplotlib places a line without points outside the figure
        ax.plot(
            hits["t"] / unit, hits[f"{name} after"], color=color("impact"), clip_on=False, **IMPACT
        )


def _key(ax: Any, longest: str, shades: dict[str, dict[str, Any]], corners: pd.DataFrame) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries: list[Any] = []
    if corners["impact"].any():
        entries.append(Line2D([], [], color=color("impact"), label="impact", **IMPACT))
    entries += [Patch(label=mode, **look) for mode, look in shades.items()]
    if shades and longest:
        entries.append(Patch(facecolor="none", edgecolor="0.6", label=longest))
    legend_above(ax, entries)  # the motion may be anywhere within the axes
