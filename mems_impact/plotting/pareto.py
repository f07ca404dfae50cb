"""A Pareto front: what two aims cost each other."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from mems_impact.errors import InvalidParameter
from mems_impact.plotting.style import (
    BLUE,
    GREY,
    ORANGE,
    in_brackets,
    new_figure,
    power_of_ten,
    tidy,
)
from mems_impact.tables.common import bare

if TYPE_CHECKING:
    import pandas as pd

    from mems_impact.studies.pareto import ParetoFront

__all__ = ["plot_pareto"]


def plot_pareto(front: ParetoFront | pd.DataFrame, ax: Any = None) -> Any:
    """Draw a Pareto front, and where the searches began.

    Each axis says which way is better.

    Parameters
    ----------
    front : ParetoFront or DataFrame
        From `mems_impact.pareto_front`, or its table.
    ax : matplotlib Axes, optional
        Where to draw; a new figure by default.

    Returns
    -------
    Axes
        ``ax.figure.savefig(…)`` writes the figure.

    Raises
    ------
    InvalidParameter
        If a table is none of a front.

    See Also
    --------
    pareto_front, ParetoFront

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked(actuator))
    >>> front = mi.pareto_front(
    ...     orbit, {"mean speed": "maximize", "energy lost per period": "minimize"},
    ...     over={"amplitude": (0.23, 0.25)}, points=3,
    ... )
    >>> mi.plot_pareto(front).figure.savefig("pareto.png")
    """
    start = getattr(front, "start", None)
    table = bare(getattr(front, "table", front))
    aims = table.attrs.get("aims")
    if not aims:
        raise InvalidParameter("front", None, "", problem="not of mems_impact.pareto_front")
    if ax is None:
        ax = new_figure(3.5, 3.0).subplots()
    first, second = aims
    begin = _begin(start, aims) if start is not None else {}
    powers, units = {}, table.attrs.get("units", {})
    for name in aims:
        powers[name] = power_of_ten(max(table[name].abs().max(), abs(begin.get(name, 0.0))))
    ax.plot(
        table[second] / 10.0 ** powers[second], table[first] / 10.0 ** powers[first],
        color=BLUE, marker="o", markersize=4, label="Pareto front", zorder=3,
    )  # fmt: skip
    if begin:
        ax.plot(
            begin[second] / 10.0 ** powers[second], begin[first] / 10.0 ** powers[first],
            color=ORANGE, marker="s", linestyle="none", label="start", zorder=4,
        )  # fmt: skip
    for name, label in ((second, ax.set_xlabel), (first, ax.set_ylabel)):
        unit = in_brackets(units.get(name, ""), powers[name])
        label(f"{name}{unit}\n{_better(aims[name])}")
    ax.margins(0.08)
    ax.grid(color=GREY, alpha=0.25, linewidth=0.5)
    ax.legend(frameon=False, fontsize="small")
    tidy(ax)
    return ax


def _begin(start: Any, aims: Mapping[str, str]) -> dict[str, float]:
    """Return the aims of the orbit where searches began, as far as they have names."""
    known = {each.name: each for each in start.system.orbit_quantities}
    return {name: known[name](start) for name in aims} if set(aims) <= set(known) else {}


def _better(sense: str) -> str:
    return "more is better" if sense == "maximize" else "less is better"
