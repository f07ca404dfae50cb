"""Optimization of periodic orbits: one objective, Pareto fronts, constraints."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.progress import progress_bar
from mems_impact._util.quantities import quantities
from mems_impact.analysis.continuation_range import amount
from mems_impact.analysis.orbit import Orbit
from mems_impact.errors import Interrupted, InvalidParameter, OrbitError
from mems_impact.orbits.signature import BOUNDARY
from mems_impact.studies.sampling import deviations
from mems_impact.studies.sensitivity import (
    bifurcation_margins,
    chosen_quantities,
    continue_to,
    derivatives,
    first_order_deviations,
)
from mems_impact.studies.trust_region import CONSTRAINT_TOLERANCE, Iterate, LocalModel, search
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.observables import MULTIPLIER, Quantity
from mems_impact.systems.result import Result, check_kind
from mems_impact.systems.state import interval, whole
from mems_impact.tables import unit_of

if TYPE_CHECKING:
    import pandas as pd

# --- Constraints on orbits

MAX_MULTIPLIER = 0.95  # default bound of the modulus of multipliers; it keeps a distance from folds
CLOSEST_APPROACH = "closest approach"


@dataclass(frozen=True)
class QuantityBounds:
    """Bounds of a quantity; infinite for none."""

    quantity: Quantity
    low: float
    high: float
    scale: float  # unit in which margins are scaled

    @property
    def sides(self) -> list[tuple[float, float]]:
        """Sign of the margin and value of each finite limit."""
        pairs = [(1.0, self.low), (-1.0, self.high)]
        return [(sign, bound) for sign, bound in pairs if math.isfinite(bound)]

    def margins(self, value: float, gradient: Floats) -> tuple[Floats, Floats]:
        """Return the margin of a value to each bound, and its derivatives.

        A quantity that an orbit lacks does not constrain it.
        """
        signs = np.array([sign for sign, _ in self.sides])
        bounds = np.array([bound for _, bound in self.sides])
        if math.isnan(value):
            return np.ones(signs.size), np.zeros((signs.size, gradient.size))
        return signs * (value - bounds) / self.scale, np.outer(signs, gradient) / self.scale

    def sentences(self, unit: str) -> list[str]:
        """Return the bounds in words."""
        name, word = self.quantity.name, {1.0: "least", -1.0: "most"}
        return [f"{name} at {word[sign]} {bound:.6g} {unit}".rstrip() for sign, bound in self.sides]


def limits_of(
    orbit: Orbit,
    subject_to: Mapping[str, tuple[float | None, float | None]],
    tolerances: Mapping[str, float | str],
) -> tuple[QuantityBounds, ...]:
    """Return the constraints on an orbit: the given ones, stability, and no penetration.

    A pair of None is no constraint; the quantity is only displayed. Raises InvalidParameter if a
    quantity is unknown, or a pair does not consist of ascending numbers or None.
    """
    system = orbit.system
    defaults: dict[str, tuple[float | None, float | None]] = {
        MULTIPLIER.name: (None, MAX_MULTIPLIER)
    }
    if any(each.name == CLOSEST_APPROACH for each in system.statistics.orbit_quantities):
        defaults[CLOSEST_APPROACH] = (0.0, None)
    limits = []
    for name, pair in {**defaults, **subject_to}.items():
        quantity = _quantity(system, name, tolerances)
        label, unit = f"subject_to {name}", quantity.unit if system.units else None
        low, high = interval(label, pair, quantities(label, pair, unit), bounded=False)
        size = max((abs(bound) for bound in (low, high) if math.isfinite(bound)), default=0.0)
        size = size or abs(quantity(orbit))
        limits.append(QuantityBounds(quantity, low, high, size if 0.0 < size < math.inf else 1.0))
    return tuple(limits)


# --- Optimization along a periodic orbit

Bounds = Mapping[str, tuple[float, float]]
Limits = Mapping[str, tuple[float | None, float | None]]
STANDARD_DEVIATION = "standard deviation of "
OPTIMIZATION_ENDINGS = {
    "converged": "converged",
    "lost": "the orbit ends there",
    "small": "the step size reached rounding errors",
    "spent": "the number of iterations was reached",
    "interrupted": "interrupted",
}


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Optimum(Result):
    """The best orbit of an optimization.

    Attributes
    ----------
    orbit : Orbit
    quantity : str
        The maximized or minimized quantity.
    value : float
        Its value, in the units of the system.
    over : dict of str to tuple of float
        The varied parameters and their bounds.
    values : dict of str to float
        The optimal values of these parameters.
    history : DataFrame
        One row per accepted iterate, the initial one first: the parameters, the quantity and the
        constrained quantities.
    active : tuple of str
        The active constraints, in words: bounds of parameters, constraints, or the end of the
        orbit's branch.
    ended : str
        Why the search ended.
    converged : bool
        Whether the first-order conditions of a local optimum hold.

    See Also
    --------
    optimize, pareto_front

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
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
    def system(self) -> HybridSystem:
        """System of the orbit."""
        return self.orbit.system

    @cached_property
    def margins(self) -> pd.DataFrame:
        """Distance of each varied parameter from a bifurcation of the orbit.

        As `bifurcation_margins`, from half to one and a half of each value.
        """
        return bifurcation_margins(self.orbit, tuple(self.over))

    def summary(self) -> dict[str, Any]:
        """Return the optimum, its active constraints and why the search ended."""
        label = self.system.units.label
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
    """Optimize a quantity of a periodic orbit over some parameters.

    A local search with the gradients of `sensitivity`: sequential quadratic programming with a
    trust region. The orbit is continued from iterate to iterate, through changes in the order of
    its events, within the grazings, folds and period doublings that end the orbit. By default the
    largest modulus of its multipliers is at most 0.95. Other orbits lead to other local optima.

    Parameters
    ----------
    orbit : Orbit
        Stable and admissible.
    over : mapping of str to tuple of float
        The parameters to vary, each with its lowest and highest value.
    maximize, minimize : str or Quantity
        The objective, exactly one of both: a quantity of `sensitivity`, or with `tolerances` its
        first-order standard deviation, "standard deviation of mean speed".
    subject_to : mapping of str to tuple of float, optional
        Lowest and highest value of a quantity, None for no bound: ``{"largest multiplier": (None,
        0.9), "closest approach": (0.05, None)}``. A quantity with two None is only shown in
        `history`.
    tolerances : mapping of str to float, optional
        Standard deviations of parameters, in their units, for "standard deviation of …".
    iterations : int, optional
        Largest number of trial points.
    progress : bool or callable, optional
        True: show a counter after a second. A function is called with the number of points taken.

    Returns
    -------
    Optimum

    Raises
    ------
    InvalidParameter
        If an argument is out of range.
    OrbitError
        If no orbit is found that meets `subject_to`; ``partial`` is the `Optimum` with the least
        violation.
    Interrupted
        By Ctrl-C; ``partial`` is the best point so far.

    See Also
    --------
    Optimum, pareto_front, sensitivity

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> best = mi.optimize(orbit, maximize="mean speed", over={"amplitude": (0.23, 0.25)})
    >>> best.converged, best.values
    (True, {'amplitude': 0.25})
    """
    check_kind(orbit, "orbit", Orbit, "an Orbit, from find_orbit")
    aim = _Objective.of(orbit, over, maximize, minimize, subject_to or {}, tolerances or {})
    max_iterations = whole("iterations", iterations, 1)
    iterates: list[Iterate[Orbit]] = []
    with progress_bar(progress, "points", work="optimize") as show:

        def report(iterate: Iterate[Orbit]) -> None:
            iterates.append(iterate)
            if show is not None:
                show(len(iterates))

        try:
            end = search(
                aim.position(orbit), orbit, move=aim.move, look=aim.look, report=report,
                iterations=max_iterations,
            )  # fmt: skip
        except KeyboardInterrupt:
            if not iterates:
                raise
            last = iterates[-1]
            stopped = Iterate(last.x, last.item, last.local, "interrupted", "")
            best, after = aim.optimum(stopped, iterates), f"{len(iterates)} points"
            raise Interrupted("search", after, best) from None
    best = aim.optimum(end, iterates)
    if end.local.violation > CONSTRAINT_TOLERANCE:
        missed = ", ".join(aim.violated(end))
        raise OrbitError(
            f"no orbit of this kind was found that has {missed}",
            "widen the bounds, loosen the constraints, or begin with another orbit",
            best,
        )
    return best


@dataclass(frozen=True, eq=False)
class _Objective:
    """Objective and constraints of an orbit, as scaled functions on the unit box."""

    over: dict[str, tuple[float, float]]
    quantity: Quantity
    sign: float
    scale: float
    limits: tuple[QuantityBounds, ...]

    @property
    def limited(self) -> tuple[Quantity, ...]:
        """The constrained quantities."""
        return tuple(each.quantity for each in self.limits)

    @classmethod
    def of(
        cls,
        orbit: Orbit,
        over: Bounds,
        maximize: str | Quantity | None,
        minimize: str | Quantity | None,
        subject_to: Limits,
        tolerances: Mapping[str, float | str],
    ) -> _Objective:
        if (maximize is None) == (minimize is None):
            raise InvalidParameter("maximize", maximize, "given, or minimize, but not both")
        system = orbit.system
        if not (orbit.stable and orbit.admissible):
            raise InvalidParameter("orbit", orbit, "stable and admissible")
        deviations(tolerances, system)
        objective = maximize if maximize is not None else minimize
        assert objective is not None
        first = _quantity(system, objective, tolerances)
        limits = limits_of(orbit, subject_to, tolerances)
        scale = abs(first(orbit))
        if not math.isfinite(scale):
            raise InvalidParameter("orbit", orbit, f"an orbit with a {first.name}")
        return cls(
            over=_checked_bounds(system, over),
            quantity=first,
            sign=-1.0 if maximize is not None else 1.0,
            scale=scale or 1.0,
            limits=limits,
        )

    def position(self, orbit: Orbit) -> Floats:
        """Return the position of an orbit in the unit box."""
        return np.array(
            [
                (orbit.system.parameters[name] - low) / (high - low)
                for name, (low, high) in self.over.items()
            ]
        )

    def values(self, x: Floats) -> dict[str, float]:
        """Return the parameters at a position in the unit box."""
        pairs = zip(self.over.items(), x.tolist(), strict=True)
        return {
            name: high if part == 1.0 else low + part * (high - low)
            for (name, (low, high)), part in pairs
        }

    def move(self, orbit: Orbit, x: Floats) -> Orbit:
        """Return the orbit at a position in the unit box."""
        return continue_to(orbit, self.values(x))

    def look(self, orbit: Orbit) -> LocalModel:
        """Return value, margins and gradients, in units of their scales."""
        quantities = (self.quantity, *self.limited)
        values, by_parameter = derivatives(orbit, quantities, tuple(self.over))
        gradients = by_parameter * np.array([high - low for low, high in self.over.values()])
        if not math.isfinite(values[0]) or np.isinf(values).any():
            raise OrbitError(f"no {self.quantity.name}, or a grazing", "take a shorter way")
        constraints = [
            each.margins(value, gradient)
            for each, value, gradient in zip(self.limits, values[1:], gradients[1:], strict=True)
        ]
        return LocalModel(
            value=self.sign * float(values[0]) / self.scale,
            gradient=self.sign * gradients[0] / self.scale,
            margins=np.concatenate([margin for margin, _ in constraints]),
            by_margin=np.vstack([rates for _, rates in constraints]),
            piece=_piece(orbit),
        )

    def optimum(self, end: Iterate[Orbit], iterates: list[Iterate[Orbit]]) -> Optimum:
        """Return the result of a search, in the user's terms."""
        orbit, values = end.item, self.values(end.x)
        return Optimum(
            orbit=orbit,
            quantity=self.quantity.name,
            value=self.quantity(orbit),
            over=dict(self.over),
            values=values,
            history=self._history(iterates, orbit.system),
            active=(*self._bounds(end), *self.holding(end), *self._end(end)),
            ended=OPTIMIZATION_ENDINGS[end.ended],
            converged=end.ended == "converged",
        )

    def violated(self, iterate: Iterate[Orbit]) -> list[str]:
        """Return the violated constraints of an orbit, in words."""
        return self._sentences(iterate, iterate.local.margins < -CONSTRAINT_TOLERANCE)

    def holding(self, iterate: Iterate[Orbit]) -> list[str]:
        """Return the active constraints of an orbit, in words."""
        return self._sentences(iterate, np.abs(iterate.local.margins) <= CONSTRAINT_TOLERANCE)

    def _sentences(self, iterate: Iterate[Orbit], chosen: Any) -> list[str]:
        system = iterate.item.system
        sentences = [
            sentence
            for each in self.limits
            for sentence in each.sentences(each.quantity.unit if system.units else "")
        ]
        return [sentence for sentence, yes in zip(sentences, chosen, strict=True) if yes]

    def _bounds(self, iterate: Iterate[Orbit]) -> list[str]:
        return [
            f"{name} at its {'lowest' if part <= CONSTRAINT_TOLERANCE else 'highest'} value"
            for name, part in zip(self.over, iterate.x.tolist(), strict=True)
            if part <= CONSTRAINT_TOLERANCE or part >= 1.0 - CONSTRAINT_TOLERANCE
        ]

    def _end(self, iterate: Iterate[Orbit]) -> list[str]:
        sentences = [f"the orbit ends: {iterate.lost}"] if iterate.ended == "lost" else []
        events = _sequence(iterate.item)
        return sentences + [
            f"a corner, beyond which the events are {_sequence(other)} in place of {events}"
            for other in iterate.edge
        ]

    def _history(self, iterates: list[Iterate[Orbit]], system: HybridSystem) -> pd.DataFrame:
        import pandas as pd

        rows = []
        for each in iterates:
            row = {**self.values(each.x), self.quantity.name: self.quantity(each.item)}
            row |= {other.name: other(each.item) for other in self.limited}
            rows.append(row)
        table = pd.DataFrame(rows)
        units = {name: system.units.get(name, "") for name in self.over}
        units |= {each.name: each.unit for each in (self.quantity, *self.limited)}
        table.attrs = {
            "units": {name: unit for name, unit in units.items() if unit},
            "system": repr(system),
        }
        return table


def _piece(orbit: Orbit) -> tuple[tuple[int, int], ...]:
    """Return the modes and events of an orbit, independent of the start of the forcing period."""
    ends = [(s.mode, s.code) for s in orbit.numeric.segments if s.code != BOUNDARY]
    return min((tuple(ends[i:] + ends[:i]) for i in range(len(ends))), default=())


def _sequence(orbit: Orbit) -> str:
    """Return the events of an orbit in words."""
    segments, ended = orbit.numeric.segments, orbit.segments["ends with"]
    names = [name for name, s in zip(ended, segments, strict=True) if s.code != BOUNDARY]
    return ", ".join(names) or "none"


def _quantity(
    system: HybridSystem, quantity: str | Quantity, tolerances: Mapping[str, float | str]
) -> Quantity:
    """Return a quantity, or the standard deviation of one with the parameters."""
    if isinstance(quantity, Quantity) or not quantity.startswith(STANDARD_DEVIATION):
        return chosen_quantities(system, [quantity])[0]
    if not tolerances:
        raise InvalidParameter("tolerances", None, f"given for the {quantity}")
    inner = chosen_quantities(system, [quantity.removeprefix(STANDARD_DEVIATION)])[0]

    def deviation(orbit: Orbit) -> float:
        _, gradients = derivatives(orbit, [inner], tuple(tolerances))
        return float(first_order_deviations(gradients, deviations(tolerances, orbit.system))[0])

    return Quantity(quantity, deviation, inner.unit, solved=True)


def _checked_bounds(system: HybridSystem, over: Bounds) -> dict[str, tuple[float, float]]:
    if not over:
        raise InvalidParameter("over", over, "one or more parameters with their bounds")
    bounds = {}
    for name, pair in over.items():
        system.checks.continuation(name)
        label, value = f"over {name}", system.parameters[name]
        low, high = interval(label, pair, system.units.parse(name, pair, label))
        if not low <= value <= high:
            at = amount(system, name, value)
            allowed = f"(lowest, highest), with {at} between them, where the orbit is"
            raise InvalidParameter(label, pair, allowed)
        for bound in (low, high):
            system.changed(**{name: bound})
        bounds[name] = low, high
    return bounds


# --- Pareto fronts

Sense = Literal["maximize", "minimize"]
SENSES = ("maximize", "minimize")
DOMINANCE_RTOL = 1e-6  # least relative improvement of an objective by a dominating point


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ParetoFront(Result):
    """Non-dominated optima of two objectives.

    Attributes
    ----------
    aims : dict of str to str
        The two quantities, and whether each was maximized or minimized.
    optima : tuple of Optimum
        From the best in the second aim to the best in the first.
    start : Orbit
        Where the searches began.
    failed : tuple of str
        Reasons for missing points.

    See Also
    --------
    pareto_front, plot_pareto

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
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
    def system(self) -> HybridSystem:
        """The system of the initial orbit."""
        return self.start.system

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row per optimum: the two quantities, the parameters, the constrained quantities.

        The columns are as in `Optimum.history`, and "held by", the active constraints.
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
        rows = {"system": repr(self.system), "points": len(table), **ends}
        return {**rows, **({"missing": "; ".join(self.failed)} if self.failed else {})}


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
    """Compute the Pareto front of two quantities of a periodic orbit.

    The method of epsilon constraints: each objective is optimized by itself, then the first
    objective with the second bounded at values between the two results.

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
        Largest number of trial points of each search.
    progress : bool or callable, optional
        True: show a counter after a second. A function is called with the number of points done.

    Returns
    -------
    ParetoFront
        Dominated points are omitted.

    Raises
    ------
    InvalidParameter
        If an argument is out of range.
    OrbitError
        If an end of the front has no orbit that meets `subject_to`.
    Interrupted
        By Ctrl-C; ``partial`` is the front so far.

    See Also
    --------
    ParetoFront, plot_pareto, optimize

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> front = mi.pareto_front(
    ...     orbit, {"mean speed": "maximize", "energy lost per period": "minimize"},
    ...     over={"amplitude": (0.23, 0.25)}, points=3,
    ... )
    >>> len(front.optima)
    3
    """
    check_kind(orbit, "orbit", Orbit, "an Orbit, from find_orbit")
    count = whole("points", points, 2)
    constraints = dict(subject_to or {})
    first, second = _checked_objectives(aims, constraints)

    def best(begin: Orbit, name: str, limits: Limits) -> Optimum:
        sought = {str(aims[name]): name}
        return optimize(
            begin, over=over, subject_to=limits, tolerances=tolerances, iterations=iterations,
            **sought,  # type: ignore[arg-type]
        )  # fmt: skip

    optima: list[Optimum] = []
    failed: list[str] = []
    with progress_bar(progress, "points", count, "Pareto front") as show:
        try:
            # At each end the other objective is displayed, without a constraint.
            for name, other in ((second, first), (first, second)):
                optima.append(best(orbit, name, {**constraints, other: (None, None)}))
                if show is not None:
                    show(len(optima))
            low, high = (_value(each, second) for each in optima)
            near, unit = optima[0], unit_of(second, orbit.system.units)
            for level in np.linspace(low, high, count)[1:-1].tolist():
                limit = (level, None) if aims[second] == "maximize" else (None, level)
                try:
                    near = best(near.orbit, first, {**constraints, second: limit})
                    optima.append(near)
                except OrbitError as error:
                    label = f"{second} {level:.6g} {unit}".rstrip()
                    failed.append(f"{label}: {error.reason}")
                if show is not None:
                    show(len(optima) + len(failed))
        except KeyboardInterrupt:
            if not optima:
                raise
            front = _front(orbit, aims, optima, failed)
            raise Interrupted("search", f"{len(optima)} points", front) from None
    return _front(orbit, aims, optima, failed)


def _front(
    orbit: Orbit, aims: Mapping[str, Sense], optima: list[Optimum], failed: list[str]
) -> ParetoFront:
    """Return the nondominated points, in descending order of the second objective."""
    signs = [-1.0 if sense == "maximize" else 1.0 for sense in aims.values()]
    costs = np.array([[_value(each, name) for name in aims] for each in optima]) * signs
    slack = DOMINANCE_RTOL * np.abs(costs).max(axis=0)
    nondominated = [
        i
        for i, cost in enumerate(costs)
        if not any(
            (other <= cost + slack).all() and (other < cost - slack).any() for other in costs
        )
        and not any((np.abs(other - cost) <= slack).all() for other in costs[:i])
    ]
    order = sorted(nondominated, key=lambda i: (costs[i, 1], costs[i, 0]))
    return ParetoFront(
        aims=dict(aims), optima=tuple(optima[i] for i in order), start=orbit, failed=tuple(failed)
    )


def _value(optimum: Optimum, name: str) -> float:
    return float(optimum.history[name].iloc[-1])


def _checked_objectives(aims: Mapping[str, Sense], limits: Limits) -> tuple[str, str]:
    if not isinstance(aims, Mapping) or len(aims) != 2 or not set(aims.values()) <= set(SENSES):
        allowed = 'two quantities, each with "maximize" or "minimize"'
        raise InvalidParameter("aims", aims, allowed)
    for name in aims:
        if name in limits:
            raise InvalidParameter("subject_to", name, "a quantity other than the objectives")
    first, second = aims
    return first, second
