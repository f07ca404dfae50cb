"""A Pareto front: what two aims cost each other."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from mems_impact.errors import InvalidParameter
from mems_impact.plotting.labels import label_axis, label_of
from mems_impact.plotting.placing import legend_above
from mems_impact.plotting.style import color, new_figure, styled
from mems_impact.tables.common import bare

if TYPE_CHECKING:
    import pandas as pd

    from mems_impact.studies.pareto import ParetoFront

__all__ = ["plot_pareto"]


@styled
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
        ax = new_figure(1.2).subplots()
    first, second = aims
    begin = _begin(start, aims) if start is not None else {}
    motion, guide = color("motion"), color("guide")
    ax.plot(table[second], table[first], color=motion, marker="o", label="Pareto front", zorder=3)
    if begin:
        ax.plot(
            begin[second], begin[first], color=guide, marker="s", linestyle="none", label="start",
            zorder=4,
        )  # fmt: skip
    ax.margins(0.08)
    for name, axis in ((second, ax.xaxis), (first, ax.yaxis)):
        label_axis(axis, label_of(table, name)._replace(behind=f"\n{_better(aims[name])}"))
    ax.grid(color=guide, alpha=0.25, linewidth=0.4)
    legend_above(ax)
    return ax


def _begin(start: Any, aims: Mapping[str, str]) -> dict[str, float]:
    """Return the aims of the orbit where searches began, as far as they have names."""
    known = {each.name: each for each in start.system.orbit_quantities}
    return {name: known[name](start) for name in aims} if set(aims) <= set(known) else {}


def _better(sense: str) -> str:
    return "more is better" if sense == "maximize" else "less is better"
