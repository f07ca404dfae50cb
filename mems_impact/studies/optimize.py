"""The drive or the device that does best, along an orbit that stays what it is."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from mems_impact.analysis.orbit import Orbit
from mems_impact.analysis.progress import progress_bar
from mems_impact.analysis.quantity import Quantity
from mems_impact.analysis.special import check_kind
from mems_impact.analysis.state import is_number, whole
from mems_impact.analysis.system import System
from mems_impact.analysis.values import Value
from mems_impact.errors import InvalidParameter, OrbitError
from mems_impact.hybrid.trajectory import Floats
from mems_impact.interruptions import OptimizationInterrupted
from mems_impact.orbits.signature import BOUNDARY
from mems_impact.studies.derivatives import chosen_quantities, derivatives
from mems_impact.studies.limits import Constraint, limits_of
from mems_impact.studies.margins import margins
from mems_impact.studies.moving import moved
from mems_impact.studies.searching import HOLDS, Local, Search, search
from mems_impact.studies.sensitivity import scatter
from mems_impact.studies.tolerance import deviations

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Optimum", "optimize"]

Bounds = Mapping[str, tuple[float, float]]
Limits = Mapping[str, tuple[float | None, float | None]]
SCATTER = "scatter of "
ENDINGS = {
    "converged": "converged",
    "lost": "the orbit ends there",
    "small": "steps became as small as rounding",
    "spent": "the number of iterations was reached",
    "interrupted": "interrupted",
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Optimum(Value):
    """The best orbit that a search has found.

    Attributes
    ----------
    orbit : Orbit
    quantity : str
        What was maximized or minimized.
    value : float
        Of it, in the units of the system.
    over : dict of str to tuple of float
        The parameters that were varied, and their bounds.
    values : dict of str to float
        Of these parameters, at the optimum.
    history : DataFrame
        One row a point that the search took, the first one where it began: the parameters, the
        quantity and what was limited.
    active : tuple of str
        What holds the optimum, in words: bounds of parameters, limits, or the orbit's own end.
    ended : str
        Why the search ended.
    converged : bool
        Whether the conditions of a local optimum hold, to first order.

    See Also
    --------
    optimize, pareto_front

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked(actuator))
    >>> best = mi.optimize(orbit, maximize="mean speed", over={"amplitude": (0.23, 0.25)})
    >>> best.quantity, best.ended
    ('mean speed', 'converged')
    """

    orbit: Orbit
    quantity: str
    value: float
    over: dict[str, tuple[float, float]]
    values: dict[str, float]
    history: pd.DataFrame = field(repr=False)
    active: tuple[str, ...]
    ended: str
    converged: bool

    @property
    def system(self) -> System:
        """The orbit's."""
        return self.orbit.system

    @cached_property
    def margins(self) -> pd.DataFrame:
        """How far each varied parameter may move before the orbit bifurcates.

        As `margins`, from half to one and a half of each value.
        """
        return margins(self.orbit, tuple(self.over))

    def summary(self) -> dict[str, Any]:
        """Return where it is, what holds it and why the search ended."""
        label = self.system.label
        return {
            "system": repr(self.system),
            self.quantity: self.value,
            **{label(name): value for name, value in self.values.items()},
            "impacts": len(self.orbit.impacts),
            "held by": "; ".join(self.active) or "nothing",
            "ended": self.ended,
        }


def optimize(
    orbit: Orbit,
    *,
    over: Bounds,
    maximize: str | Quantity | None = None,
    minimize: str | Quantity | None = None,
    subject_to: Limits | None = None,
    tolerances: Mapping[str, float | str] | None = None,
    iterations: int = 100,
    progress: bool | Callable[[float], None] = False,
) -> Optimum:
    """Return the best orbit over some parameters, near one that is given.

    A local search by the gradients of `sensitivity`: sequential quadratic programming with a trust
    region. The orbit is followed from point to point, and keeps its impacts; where it would lose
    one, graze, fold or double its period, the search turns back. It stays stable: if nothing else
    is said, the largest modulus of its multipliers at most 0.95. For other local optima begin with
    other orbits.

    Parameters
    ----------
    orbit : Orbit
        Stable and admissible.
    over : mapping of str to tuple of float
        The parameters to vary, each with its lowest and highest value.
    maximize, minimize : str or Quantity
        What: one of the two. A quantity of `sensitivity`; with `tolerances` also its scatter to
        first order, "scatter of mean speed".
    subject_to : mapping of str to tuple of float, optional
        By quantity its lowest and highest value, None for none: ``{"largest multiplier": (None,
        0.9), "closest approach": (0.05, None)}``. With two of None it is only shown in `history`.
    tolerances : mapping of str to float, optional
        Standard deviations of parameters, in their units, for "scatter of …".
    iterations : int, optional
        Points that are tried at most.
    progress : bool or callable, optional
        True: show a counter if it takes over a second. A function is called with the number of
        points taken.

    Returns
    -------
    Optimum

    Raises
    ------
    InvalidParameter
        If an argument is out of range.
    OrbitError
        If no orbit is found that meets `subject_to`; ``partial`` is the `Optimum` that misses them
        least.
    OptimizationInterrupted
        By Ctrl-C; the best point so far is in ``optimum``.

    See Also
    --------
    Optimum, pareto_front, sensitivity

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked(actuator))
    >>> best = mi.optimize(orbit, maximize="mean speed", over={"amplitude": (0.23, 0.25)})
    >>> best.converged, best.values
    (True, {'amplitude': 0.25})
    """
    check_kind(orbit, "orbit", Orbit, "an Orbit, from find_orbit")
    aim = _Aim.of(orbit, over, maximize, minimize, subject_to or {}, tolerances or {})
    most = whole("iterations", iterations, 1)
    taken: list[Search[Orbit]] = []
    with progress_bar(progress, "points") as show:

        def report(found: Search[Orbit]) -> None:
            taken.append(found)
            if show is not None:
                show(len(taken))

        try:
            found = search(
                aim.place(orbit), orbit, move=aim.move, look=aim.look, report=report,
                iterations=most,
            )  # fmt: skip
        except KeyboardInterrupt:
            if not taken:
                raise
            last = taken[-1]
            stopped = Search(last.x, last.item, last.local, "interrupted", "")
            raise OptimizationInterrupted(aim.optimum(stopped, taken), len(taken)) from None
    best = aim.optimum(found, taken)
    if found.local.violation > HOLDS:
        missed = ", ".join(aim.violated(found))
        raise OrbitError(
            f"no orbit of this kind was found that has {missed}",
            "widen the bounds of over, loosen subject_to, or begin with another orbit; the nearest "
            "one is in .partial",
            best,
        )
    return best


@dataclass(frozen=True, eq=False)
class _Aim:
    """What is wanted of an orbit, as a search sees it: in the unit box, and in parts of scales."""

    over: dict[str, tuple[float, float]]
    quantity: Quantity
    sign: float
    scale: float
    limits: tuple[Constraint, ...]
    limited: tuple[Quantity, ...]

    @classmethod
    def of(
        cls,
        orbit: Orbit,
        over: Bounds,
        maximize: str | Quantity | None,
        minimize: str | Quantity | None,
        subject_to: Limits,
        tolerances: Mapping[str, float | str],
    ) -> _Aim:
        if (maximize is None) == (minimize is None):
            raise InvalidParameter("maximize", maximize, "given, or minimize; and not both")
        system = orbit.system
        if not (orbit.stable and orbit.admissible):
            raise InvalidParameter("orbit", orbit, "stable and admissible")
        deviations(tolerances, system)
        wanted = maximize if maximize is not None else minimize
        assert wanted is not None
        first = _quantity(system, wanted, tolerances)
        limits = limits_of(orbit, subject_to)
        limited = tuple(_quantity(system, each.name, tolerances) for each in limits)
        scale = abs(first(orbit))
        if not math.isfinite(scale):
            raise InvalidParameter("orbit", orbit, f"one that has a {first.name}")
        return cls(
            over=_checked_bounds(system, over),
            quantity=first,
            sign=-1.0 if maximize is not None else 1.0,
            scale=scale or 1.0,
            limits=limits,
            limited=limited,
        )

    def place(self, orbit: Orbit) -> Floats:
        """Return where an orbit stands in the unit box."""
        return np.array(
            [
                (orbit.system.value(name) - low) / (high - low)
                for name, (low, high) in self.over.items()
            ]
        )

    def values(self, x: Floats) -> dict[str, float]:
        """Return the parameters at a place in the unit box."""
        pairs = zip(self.over.items(), x.tolist(), strict=True)
        return {
            name: high if part == 1.0 else low + part * (high - low)
            for (name, (low, high)), part in pairs
        }

    def move(self, orbit: Orbit, x: Floats) -> Orbit:
        """Return the orbit at a place in the unit box."""
        return moved(orbit, self.values(x))

    def look(self, orbit: Orbit) -> Local:
        """Return value, limits and gradients, in parts of their scales."""
        quantities = (self.quantity, *self.limited)
        values, found = derivatives(orbit, quantities, tuple(self.over))
        gradients = found * np.array([high - low for low, high in self.over.values()])
        if not math.isfinite(values[0]) or np.isinf(values).any():
            raise OrbitError(f"no {self.quantity.name}, or a grazing", "take a shorter way")
        parts = [
            each.margins(value, gradient)
            for each, value, gradient in zip(self.limits, values[1:], gradients[1:], strict=True)
        ]
        return Local(
            value=self.sign * float(values[0]) / self.scale,
            gradient=self.sign * gradients[0] / self.scale,
            margins=np.concatenate([margin for margin, _ in parts]),
            by_margin=np.vstack([rates for _, rates in parts]),
            piece=_piece(orbit),
        )

    def optimum(self, found: Search[Orbit], taken: list[Search[Orbit]]) -> Optimum:
        """Return what a search has found, in the user's terms."""
        orbit, values = found.item, self.values(found.x)
        return Optimum(
            orbit=orbit,
            quantity=self.quantity.name,
            value=self.quantity(orbit),
            over=dict(self.over),
            values=values,
            history=self._history(taken, orbit.system),
            active=(*self._bounds(found), *self.holding(found), *self._end(found)),
            ended=ENDINGS[found.ended],
            converged=found.ended == "converged",
        )

    def violated(self, found: Search[Orbit]) -> list[str]:
        """Return the limits that an orbit misses, in words."""
        return self._words(found, found.local.margins < -HOLDS)

    def holding(self, found: Search[Orbit]) -> list[str]:
        """Return the limits at which an orbit stands, in words."""
        return self._words(found, np.abs(found.local.margins) <= HOLDS)

    def _words(self, found: Search[Orbit], chosen: Any) -> list[str]:
        system = found.item.system
        words = [
            sentence
            for each, quantity in zip(self.limits, self.limited, strict=True)
            for sentence in each.words(quantity.unit if system.units else "")
        ]
        return [sentence for sentence, yes in zip(words, chosen, strict=True) if yes]

    def _bounds(self, found: Search[Orbit]) -> list[str]:
        return [
            f"{name} at its {'lowest' if part <= HOLDS else 'highest'} value"
            for name, part in zip(self.over, found.x.tolist(), strict=True)
            if part <= HOLDS or part >= 1.0 - HOLDS
        ]

    def _end(self, found: Search[Orbit]) -> list[str]:
        words = [f"the orbit ends: {found.lost}"] if found.ended == "lost" else []
        here = _sequence(found.item)
        return words + [
            f"a corner, beyond which the events are {_sequence(other)} in place of {here}"
            for other in found.edge
        ]

    def _history(self, taken: list[Search[Orbit]], system: System) -> pd.DataFrame:
        import pandas as pd

        rows = []
        for each in taken:
            row = {**self.values(each.x), self.quantity.name: self.quantity(each.item)}
            row |= {other.name: other(each.item) for other in self.limited}
            rows.append(row)
        table = pd.DataFrame(rows)
        units = {name: system.unit(name) for name in self.over}
        units |= {each.name: each.unit for each in (self.quantity, *self.limited)}
        table.attrs = {
            "units": {name: unit for name, unit in units.items() if unit},
            "system": repr(system),
        }
        return table


def _piece(orbit: Orbit) -> tuple[tuple[int, int], ...]:
    """Return the modes and events of an orbit, wherever its forcing period begins."""
    ends = [(s.mode, s.code) for s in orbit.found.segments if s.code != BOUNDARY]
    return min((tuple(ends[i:] + ends[:i]) for i in range(len(ends))), default=())


def _sequence(orbit: Orbit) -> str:
    """Return the events of an orbit in words."""
    segments, ended = orbit.found.segments, orbit.segments["ends with"]
    names = [name for name, s in zip(ended, segments, strict=True) if s.code != BOUNDARY]
    return ", ".join(names) or "none"


def _quantity(
    system: System, wanted: str | Quantity, tolerances: Mapping[str, float | str]
) -> Quantity:
    """Return a quantity, or the scatter of one with the parameters."""
    if isinstance(wanted, Quantity) or not wanted.startswith(SCATTER):
        return chosen_quantities(system, [wanted])[0]
    if not tolerances:
        raise InvalidParameter("tolerances", None, f"given for the {wanted}")
    inner = chosen_quantities(system, [wanted.removeprefix(SCATTER)])[0]

    def deviation(orbit: Orbit) -> float:
        _, gradients = derivatives(orbit, [inner], tuple(tolerances))
        return float(scatter(gradients, deviations(tolerances, orbit.system))[0])

    return Quantity(wanted, deviation, inner.unit, solved=True)


def _checked_bounds(system: System, over: Bounds) -> dict[str, tuple[float, float]]:
    if not over:
        raise InvalidParameter("over", over, "one or more parameters with their bounds")
    found = {}
    for name, pair in over.items():
        system.check_continued(name)
        try:
            low, high = pair
        except (TypeError, ValueError):
            low, high = math.nan, math.nan
        here = system.value(name)
        if not (is_number(low) and is_number(high) and low < high and low <= here <= high):
            told = f"{here:g} {system.unit(name)}".rstrip()
            allowed = f"(lowest, highest), with {told} between them, where the orbit is"
            raise InvalidParameter(f"over {name}", pair, allowed)
        for bound in (low, high):
            system.changed(**{name: float(bound)})
        found[name] = (float(low), float(high))
    return found
