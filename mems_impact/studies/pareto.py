"""What two aims cost each other: the front of orbits none of which is better in both."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mems_impact.analysis.orbit import Orbit
from mems_impact.analysis.progress import progress_bar
from mems_impact.analysis.special import check_kind
from mems_impact.analysis.state import whole
from mems_impact.analysis.system import System
from mems_impact.analysis.values import Value
from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.interruptions import OptimizationInterrupted
from mems_impact.studies.optimize import Bounds, Limits, Optimum, optimize
from mems_impact.tables.common import unit_of

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["ParetoFront", "pareto_front"]

Sense = Literal["maximize", "minimize"]
SENSES = ("maximize", "minimize")
EQUAL = 1e-6  # part of its size by which one point must beat another in an aim


@dataclass(frozen=True, kw_only=True, eq=False)
class ParetoFront(Value):
    """Optima none of which is better in both aims than another.

    Attributes
    ----------
    aims : dict of str to str
        The two quantities, and whether each was maximized or minimized.
    optima : tuple of Optimum
        From the best in the second aim to the best in the first.
    start : Orbit
        Where the searches began.
    failed : tuple of str
        Why points are missing, if any are.

    See Also
    --------
    pareto_front, plot_pareto

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
    >>> list(front.aims), len(front.table)
    (['mean speed', 'energy lost per period'], 3)
    """

    aims: dict[str, Sense]
    optima: tuple[Optimum, ...] = field(repr=False)
    start: Orbit = field(repr=False)
    failed: tuple[str, ...] = ()

    @property
    def system(self) -> System:
        """That of the orbit where the searches began."""
        return self.start.system

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row an optimum: the two quantities, the parameters, what was limited, what holds it.

        As the last row of `Optimum.history`, and a column "held by".
        """
        import pandas as pd

        rows = [each.history.iloc[-1].to_dict() for each in self.optima]
        first, second = self.aims
        names = [first, second, *(name for name in rows[0] if name not in self.aims)]
        table = pd.DataFrame(rows)[names]
        table["held by"] = ["; ".join(each.active) for each in self.optima]
        table.attrs = {**self.optima[0].history.attrs, "aims": dict(self.aims)}
        return table

    def summary(self) -> dict[str, Any]:
        """Return the ends of the front."""
        table = self.table
        pairs = {name: table[name].iloc[[0, -1]].to_list() for name in self.aims}
        ends = {name: f"{one:.6g} to {other:.6g}" for name, (one, other) in pairs.items()}
        told = {"system": repr(self.system), "points": len(table), **ends}
        return {**told, **({"missing": "; ".join(self.failed)} if self.failed else {})}


def pareto_front(
    orbit: Orbit,
    aims: Mapping[str, Sense],
    *,
    over: Bounds,
    points: int = 9,
    subject_to: Limits | None = None,
    tolerances: Mapping[str, float | str] | None = None,
    iterations: int = 60,
    progress: bool | Callable[[float], None] = False,
) -> ParetoFront:
    """Return what two aims cost each other, along an orbit that stays what it is.

    The method of epsilon constraints: each aim by itself first, then the first one while the
    second is held at values between what these two gave.

    Parameters
    ----------
    orbit : Orbit
        Stable and admissible.
    aims : mapping of str to {"maximize", "minimize"}
        Two quantities: ``{"mean speed": "maximize", "energy lost per period": "minimize"}``.
    over : mapping of str to tuple of float
        The parameters to vary, each with its lowest and highest value.
    points : int, optional
        On the front, ends included, >= 2.
    subject_to, tolerances
        As for `optimize`; neither of the two aims may be limited.
    iterations : int, optional
        Points that each search tries at most.
    progress : bool or callable, optional
        True: show a counter if it takes over a second. A function is called with the number of
        points done.

    Returns
    -------
    ParetoFront
        Points that another one beats are left out.

    Raises
    ------
    InvalidParameter
        If an argument is out of range.
    OrbitError
        If an end of the front has no orbit that meets `subject_to`.
    OptimizationInterrupted
        By Ctrl-C; the front so far is in ``optimum``.

    See Also
    --------
    ParetoFront, plot_pareto, optimize

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
    >>> len(front.optima)
    3
    """
    check_kind(orbit, "orbit", Orbit, "an Orbit, from find_orbit")
    count = whole("points", points, 2)
    held = dict(subject_to or {})
    first, second = _checked(aims, held)

    def best(begin: Orbit, name: str, limits: Limits) -> Optimum:
        sought = {str(aims[name]): name}
        return optimize(
            begin, over=over, subject_to=limits, tolerances=tolerances, iterations=iterations,
            **sought,  # type: ignore[arg-type]
        )  # fmt: skip

    found: list[Optimum] = []
    failed: list[str] = []
    with progress_bar(progress, "points", count) as show:
        try:
            # Each end in both aims: the other one is shown beside it, but not limited.
            for name, other in ((second, first), (first, second)):
                found.append(best(orbit, name, {**held, other: (None, None)}))
                if show is not None:
                    show(len(found))
            low, high = (_value(each, second) for each in found)
            near, unit = found[0], unit_of(second, orbit.system.units)
            for level in np.linspace(low, high, count)[1:-1].tolist():
                limit = (level, None) if aims[second] == "maximize" else (None, level)
                try:
                    near = best(near.orbit, first, {**held, second: limit})
                    found.append(near)
                except OrbitError as error:
                    where = f"{second} {level:.6g} {unit}".rstrip()
                    failed.append(f"{where}: {error.reason}")
                if show is not None:
                    show(len(found) + len(failed))
        except KeyboardInterrupt:
            if not found:
                raise
            front = _front(orbit, aims, found, failed)
            raise OptimizationInterrupted(front, len(found)) from None
    return _front(orbit, aims, found, failed)


def _front(
    orbit: Orbit, aims: Mapping[str, Sense], found: list[Optimum], failed: list[str]
) -> ParetoFront:
    """Return the points that no other beats, in order of the second aim, the best of it first."""
    signs = [-1.0 if sense == "maximize" else 1.0 for sense in aims.values()]
    costs = np.array([[_value(each, name) for name in aims] for each in found]) * signs
    slack = EQUAL * np.abs(costs).max(axis=0)
    kept = [
        i
        for i, cost in enumerate(costs)
        if not any(
            (other <= cost + slack).all() and (other < cost - slack).any() for other in costs
        )
        and not any((np.abs(other - cost) <= slack).all() for other in costs[:i])
    ]
    order = sorted(kept, key=lambda i: (costs[i, 1], costs[i, 0]))
    return ParetoFront(
        aims=dict(aims), optima=tuple(found[i] for i in order), start=orbit, failed=tuple(failed)
    )


def _value(optimum: Optimum, name: str) -> float:
    return float(optimum.history[name].iloc[-1])


def _checked(aims: Mapping[str, Sense], held: Limits) -> tuple[str, str]:
    if not isinstance(aims, Mapping) or len(aims) != 2 or not set(aims.values()) <= set(SENSES):
        allowed = 'two quantities, each with "maximize" or "minimize"'
        raise InvalidParameter("aims", aims, allowed)
    for name in aims:
        if name in held:
            raise InvalidParameter("subject_to", name, "a quantity that is none of the aims")
    first, second = aims
    return first, second
