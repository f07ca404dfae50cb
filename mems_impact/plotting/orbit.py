"""One periodic orbit in a phase plane."""

from __future__ import annotations

from pkgutil import resolve_name
from typing import Any

import pandas as pd

from mems_impact.analysis.orbit import Orbit
from mems_impact.errors import InvalidParameter
from mems_impact.plotting.labels import crosses, label_axis, label_of, symbol
from mems_impact.plotting.motion import jump, line, mode_styles, moves, plane
from mems_impact.plotting.placing import legend_above
from mems_impact.plotting.style import color, new_figure, styled
from mems_impact.tables.common import captions

__all__ = ["PER_PERIOD", "plot_orbit"]

PER_PERIOD = 1000


@styled
def plot_orbit(orbit: Orbit, ax: Any = None, *, x: str | None = None, y: str | None = None) -> Any:
    """Draw one state of a periodic orbit over another, with impacts and the section.

    A dotted line joins the states before and after a jump. A diamond is where the orbit crosses
    the Poincaré section, or where a forcing period or the cycle begins if the system has none.

    Parameters
    ----------
    orbit : Orbit
    ax : matplotlib Axes, optional
        Where to draw; a new figure by default.
    x, y : str, optional
        Which states, or ``"t"``; the first two that are not cyclic by default, and of a system that
        has one alone, this one over time. Of an actuator its block between the stoppers, as it is
        drawn if neither is given.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If `orbit` is none, or has no such state.

    See Also
    --------
    find_orbit, Orbit, plot_run

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked(actuator))
    >>> mi.plot_orbit(orbit, x="x2", y="v2").figure.savefig("orbit.png")
    """
    if not isinstance(orbit, Orbit):
        allowed = "an Orbit, as mems_impact.find_orbit returns it"
        raise InvalidParameter("orbit", type(orbit).__name__, allowed)
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
        here = curve[y].where(curve["mode"] == mode)
        label = mode if len(system.modes) > 1 else None
        ax.plot(curve[x], here, color=shade, linestyle=dashes, label=label)
    jumps = pd.Series(False, index=corners.index)
    for name in names:
        jumps |= moves(corners, name, samples)
    for place, (_, row) in enumerate(corners[jumps].iterrows()):
        ends = [
            [row["t"]] * 2 if name == "t" else [row[f"{name} before"], row[f"{name} after"]]
            for name in (x, y)
        ]
        label = None if place else ("impact" if corners["impact"].any() else "jump")
        ax.plot(*ends, marker="o", label=label, **jump())
    _mark_section(ax, orbit, x, y)
    for name, axis in ((x, ax.xaxis), (y, ax.yaxis)):
        label_axis(axis, label_of(samples, name, "time" if name == "t" else symbol(name)))
    legend_above(ax)
    return ax


def _closed(orbit: Orbit) -> pd.DataFrame:
    """Return the samples of an orbit, from its beginning to where it closes."""
    samples = orbit.samples(PER_PERIOD)
    last = samples.iloc[[0]].copy()
    last["t"] += orbit.periods * orbit.period
    for name, gain in orbit.gains.items():
        last[name] += gain
    closed = pd.concat([samples, last], ignore_index=True)
    closed.attrs = samples.attrs
    return closed


def _mark_section(ax: Any, orbit: Orbit, x: str, y: str) -> None:
    """Mark the crossings of the section, and the section itself where it is a line."""
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
