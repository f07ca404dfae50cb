"""Sensitivities and optima of the orbit to which a run leads, as study files tell them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from mems_impact.analysis.finding import ORBIT_OPTIONS, find_orbit
from mems_impact.analysis.orbit import Orbit
from mems_impact.analysis.quantity import Quantity
from mems_impact.analysis.state import State
from mems_impact.analysis.system import System
from mems_impact.engines.options import Options
from mems_impact.errors import InvalidParameter
from mems_impact.studies.optimize import Optimum, optimize
from mems_impact.studies.pareto import ParetoFront, pareto_front
from mems_impact.studies.sensitivity import Sensitivity, sensitivity

__all__ = ["optimize_from", "sensitivity_from"]

TRANSIENT = 300.0  # forcing periods before an orbit is looked for

Limits = Mapping[str, tuple[float | None, float | None]]


def sensitivity_from(
    system: System,
    *,
    initial: State | Mapping[str, float] | None = None,
    transient: float = TRANSIENT,
    periods: int | None = None,
    options: Options = ORBIT_OPTIONS,
    parameters: Sequence[str] | None = None,
    quantities: Sequence[str | Quantity] | None = None,
) -> Sensitivity:
    """Return the `sensitivity` of the orbit to which a run leads.

    Parameters
    ----------
    system : System
    initial, transient, periods, options
        Of the run and of `find_orbit`.
    parameters, quantities
        As of `sensitivity`.
    """
    orbit = _orbit(system, initial, transient, periods, options)
    return sensitivity(orbit, parameters, quantities)


def optimize_from(
    system: System,
    *,
    over: Mapping[str, tuple[float, float]],
    maximize: str | Sequence[str] = (),
    minimize: str | Sequence[str] = (),
    subject_to: Limits | None = None,
    tolerances: Mapping[str, float | str] | None = None,
    points: int = 12,
    initial: State | Mapping[str, float] | None = None,
    transient: float = TRANSIENT,
    periods: int | None = None,
    options: Options = ORBIT_OPTIONS,
    progress: bool | Callable[[float], None] = False,
) -> Optimum | ParetoFront:
    """Return what `optimize` makes of the orbit to which a run leads; of two aims the front.

    Parameters
    ----------
    system : System
    over, subject_to, tolerances
        As of `optimize`.
    maximize, minimize : str or sequence of str
        One quantity in all, or two.
    points : int
        On the front of two.
    initial, transient, periods, options
        Of the run and of `find_orbit`.
    progress : bool or callable, optional
    """
    names = [*_several(maximize), *_several(minimize)]
    if not 1 <= len(names) <= 2 or len(set(names)) != len(names):
        allowed = "one quantity, maximize or minimize, or two for a front"
        raise InvalidParameter("maximize", maximize or None, allowed)
    aims: dict[str, Any] = dict.fromkeys(_several(maximize), "maximize")
    aims |= dict.fromkeys(_several(minimize), "minimize")
    orbit = _orbit(system, initial, transient, periods, options)
    given: dict[str, Any] = {"over": over, "subject_to": subject_to, "tolerances": tolerances}
    if len(aims) == 2:
        return pareto_front(orbit, aims, points=points, progress=progress, **given)
    given[aims[names[0]]] = names[0]
    return optimize(orbit, progress=progress, **given)


def _several(names: str | Sequence[str]) -> tuple[str, ...]:
    return (names,) if isinstance(names, str) else tuple(names)


def _orbit(
    system: System,
    initial: State | Mapping[str, float] | None,
    transient: float,
    periods: int | None,
    options: Options,
) -> Orbit:
    return find_orbit(system, guess=initial, periods=periods, transient=transient, options=options)
