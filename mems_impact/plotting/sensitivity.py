"""A tornado chart: by how much each parameter moves a quantity of an orbit."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from mems_impact.errors import InvalidParameter
from mems_impact.plotting.labels import Label, label_axis, symbol
from mems_impact.plotting.placing import legend_above
from mems_impact.plotting.style import color, new_figure, styled
from mems_impact.studies.tolerance import deviations

if TYPE_CHECKING:
    from mems_impact.studies.sensitivity import Sensitivity

__all__ = ["plot_sensitivity"]

NOTHING = 1e-9  # part of the longest bar: rounding
MOST = 15  # bars that are read at a glance


@styled
def plot_sensitivity(
    found: Sensitivity,
    quantity: str,
    ax: Any = None,
    *,
    tolerances: Mapping[str, float | str] | None = None,
) -> Any:
    """Draw by how much a quantity of an orbit changes with each parameter, the most moving first.

    To first order, so that a bar to one side is as long as that to the other. Parameters that
    change nothing are left out.

    Parameters
    ----------
    found : Sensitivity
        From `mems_impact.sensitivity`.
    quantity : str
    ax : matplotlib Axes, optional
        Where to draw; a new figure by default.
    tolerances : mapping of str to float, optional
        By how much each parameter changes, in its units; 1 % of its value by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If there is no such quantity or parameter, or none changes it.

    See Also
    --------
    sensitivity, Sensitivity, plot_scatter

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked(actuator))
    >>> mi.plot_sensitivity(mi.sensitivity(orbit), "mean speed").figure.savefig("tornado.png")
    """
    gradient = found.gradient(quantity)
    system, symbols = found.system, found.system.symbols
    if tolerances is None:
        sizes = {name: 0.01 * abs(system.value(name)) for name in found.parameters}
    else:
        sizes = deviations(tolerances, system, found.parameters)
        for name, size in sizes.items():
            if not size > 0.0:
                raise InvalidParameter(f"tolerance of {name}", tolerances[name], "> 0")
    change = np.array([gradient[name] * size for name, size in sizes.items()])
    longest = np.nanmax(np.abs(change), initial=0.0)
    if not longest > 0.0:
        raise InvalidParameter("quantity", quantity, "one that a parameter changes")
    order = [i for i in np.argsort(-np.abs(change)) if np.abs(change[i]) > NOTHING * longest][:MOST]
    names, change = [list(sizes)[i] for i in order], change[order]
    if ax is None:
        ax = new_figure(0.0, 5.0 + len(names)).subplots()
    places = np.arange(len(names))
    words = ("+1 %", "-1 %") if tolerances is None else ("+ tolerance", "- tolerance")
    for sign, direction, label in ((1.0, "up", words[0]), (-1.0, "down", words[1])):
        ax.barh(
            places, sign * change, label=label.replace("-", "\N{MINUS SIGN}"),
            color=color(direction), hatch="" if sign > 0.0 else "////", edgecolor="white",
        )  # fmt: skip
    ax.axvline(0.0, color="black", linewidth=0.8)
    labels = {name: symbol(name, symbols) for name in names}
    if tolerances is not None:
        labels = {
            name: f"{sign} ± {sizes[name]:.3g} {system.unit(name)}".rstrip()
            for name, sign in labels.items()
        }
    ax.set_yticks(places, list(labels.values()))
    ax.tick_params(axis="y", length=0)
    ax.set(ylim=(len(names) - 0.4, -0.6), xlim=(-1.08 * longest, 1.08 * longest))
    row = found.row(quantity)
    unit = found.units[row]
    start = f"{found.values[row]:.4g} {unit}".rstrip()
    label_axis(ax.xaxis, Label(f"change of {quantity}", unit, f"\nfrom {start}"))
    legend_above(ax)
    ax.spines["left"].set_visible(False)
    return ax
