"""A Pareto front: what two aims cost each other."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mems_impact.errors import InvalidParameter
from mems_impact.plotting.style import BLUE, GREY, ORANGE, new_figure, tidy, with_unit
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

    Examples
    --------
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
    ax.plot(
        table[second], table[first], color=BLUE, marker="o", markersize=4, label="Pareto front",
        zorder=3,
    )  # fmt: skip
    if start is not None:
        known = {each.name: each for each in start.system.orbit_quantities}
        if first in known and second in known:
            place = known[second](start), known[first](start)
            ax.plot(*place, color=ORANGE, marker="s", linestyle="none", label="start", zorder=4)
    ax.set_xlabel(f"{with_unit(second, table, second)}, {_better(aims[second])}")
    ax.set_ylabel(f"{with_unit(first, table, first)}, {_better(aims[first])}")
    ax.ticklabel_format(scilimits=(-2, 4), useMathText=True)
    ax.margins(0.08)
    ax.grid(color=GREY, alpha=0.25, linewidth=0.5)
    ax.legend(frameon=False, fontsize="small")
    tidy(ax)
    return ax


def _better(sense: str) -> str:
    return "more is better" if sense == "maximize" else "less is better"
