"""Sensitivities of periodic orbits, and margins to bifurcations."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact.analysis.orbit import Orbit, orbit_of
from mems_impact.continuation.arclength import StepControl
from mems_impact.continuation.branch import OrbitBranch
from mems_impact.continuation.orbit_branch import points_of
from mems_impact.errors import FunctionError, InvalidParameter, OrbitError, RunError
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.differences import sixth_order_difference
from mems_impact.hybrid.problem import Problem, ProblemParameters
from mems_impact.hybrid.variational.derivatives import Arc, Event
from mems_impact.orbits.family import Family
from mems_impact.orbits.newton import solve
from mems_impact.orbits.periodic_orbit import PeriodicOrbit, make_orbit
from mems_impact.orbits.shooting import Shooting, rate_gradient, touch_gradient
from mems_impact.studies.sampling import deviations
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.observables import Quantity
from mems_impact.systems.result import Result, check_kind
from mems_impact.systems.state import is_number

if TYPE_CHECKING:
    import pandas as pd

# --- Neighbouring orbits, to first order or corrected

SINGULAR_RTOL = 1e-12  # least singular value of a regular Jacobian, relative to the largest


class TangentOrbit:
    """The orbits of the same signature near `orbit`, for nearby values of one parameter.

    By the shooting equations F(u, p) = 0 their unknowns have the derivative du/dp = -(dF/du)^-1
    dF/dp; other derivatives follow from the variational equations. `growth` is the relative change
    of the unknowns by the parameter. Raises OrbitError if the orbit is at a fold, where it has no
    derivative.
    """

    def __init__(self, orbit: PeriodicOrbit, parameter: str) -> None:
        self._orbit, self._parameter = orbit, parameter
        self._value = orbit.family.value(parameter)
        self._shooting = shooting = orbit.equations((parameter,))
        self._point = point = shooting.evaluate(orbit.point.unknowns, np.array([self._value]))
        sizes = np.linalg.svd(point.jacobian, compute_uv=False)
        if not sizes[-1] > SINGULAR_RTOL * sizes[0]:
            raise OrbitError(
                "the orbit is at a fold, where its derivative does not exist",
                "move a parameter away from the fold",
            )
        self._rate = np.linalg.solve(point.jacobian, -point.by_parameter[:, 0])
        self._direction = np.append(self._rate, 1.0)
        self.growth = float(np.abs(self._rate).max() / np.abs(point.unknowns).max())
        self._arcs = [self._arc_rates(i) for i in range(len(shooting.segments))]

    def to_first_order(self, step: float) -> PeriodicOrbit:
        """Return the first-order approximation of the orbit at a parameter larger by `step`.

        The orbit includes states, times, margins and rates of events. Multipliers are NaN.
        """
        shooting, before, value = self._shooting, self._point, self._value + step
        unknowns = before.unknowns + step * self._rate
        at = shooting.parameter_point(np.array([value]))
        if shooting.phase is not None:
            at = at.with_period(shooting.unit * float(unknowns[-1]))
        starts, ends = shooting.layout.instants(at, shooting.unpack(unknowns)[1])
        moved = [self._moved(i, step) for i in range(len(before.arcs))]
        point = replace(
            before,
            unknowns=unknowns,
            parameter_point=at,
            starts=starts[:, 0],
            ends=ends[:, 0],
            arcs=tuple(arc for arc, _ in moved),
            events=tuple(event for _, event in moved),
        )
        return replace(
            self._orbit,
            family=self._orbit.family.at(**{self._parameter: value}),
            shooting=shooting,
            point=point,
            multipliers=np.full(self._orbit.multipliers.shape, np.nan, dtype=complex),
        )

    def solved(self, step: float) -> PeriodicOrbit:
        """Return the orbit at a parameter larger by `step`, admissible or not; else OrbitError."""
        guess = self._point.unknowns + step * self._rate
        return make_orbit(
            self._shooting, solve(self._shooting, guess, np.array([self._value + step]))
        )

    def _arc_rates(self, i: int) -> tuple[Floats, Floats, Floats, float]:
        """Return the derivatives for arc `i`: of its end, the state after it, minima, and rate."""
        shooting, point = self._shooting, self._point
        arc, event = point.arcs[i], point.events[i]
        guard_number = shooting.segments[i].guard(shooting.m)
        begins, instant = (each[i, 1:] @ self._direction for each in shooting.instants(point))
        end = point.end_derivatives[i] @ self._direction
        # A later start reduces the gain of cyclic states, which are not part of the equations.
        cyclic = list(shooting.automaton.cyclic)
        end[cyclic] -= begins * arc.slope_start[cyclic]
        minima = np.zeros(shooting.m)
        for guard in np.flatnonzero(np.isfinite(arc.minima)).tolist():
            minima[guard] = touch_gradient(shooting, point, i, guard) @ self._direction
        if event is None:
            return end, end, minima, 0.0
        after = event.jump_by_state @ end + event.jump_by_time * instant
        after = after + event.jump_by_parameter[:, 0] * point.parameter_point.scales[0]
        rate = 0.0
        if guard_number >= 0 and i in shooting.events:
            rate = float(rate_gradient(shooting, point, i, guard_number) @ self._direction)
        return end, after, minima, rate

    def _moved(self, i: int, step: float) -> tuple[Arc, Event | None]:
        end, after, minima, rate = self._arcs[i]
        arc, event = self._point.arcs[i], self._point.events[i]
        arc = arc._replace(end=arc.end + step * end, minima=arc.minima + step * minima)
        if event is None:
            return arc, None
        rates, guard_number = event.rates.copy(), self._shooting.segments[i].guard(self._shooting.m)
        if guard_number >= 0:
            rates[guard_number] += step * rate
        return arc, event._replace(after=event.after + step * after, rates=rates)


# --- Derivatives of quantities by parameters

DERIVATIVE_STEP = 1e-3
"""Largest step relative to a parameter, if the unknowns change as little; at least a tenth of it.

The truncation error is below rounding."""

SOLVED_STEPS = (1e-3, 1e-4, 1e-5)
"""Steps for corrected orbits, whose errors exceed rounding; shorter near an end of the orbit."""

DERIVATIVE_ROUNDING = np.array([1e-10, 1e-8])
"""Relative errors of differences: of the first-order approximation, and of corrected orbits."""


def derivatives(
    orbit: Orbit, quantities: Sequence[Quantity], parameters: Sequence[str]
) -> tuple[Floats, Floats]:
    """Return the values of quantities, and their derivatives by parameters, in the system's units.

    The derivatives, shape (quantities, parameters), of the orbit follow from the variational
    equations. The derivative of a quantity, a function of an orbit, is that along the first-order
    approximation of the orbit, by central differences of sixth order. Quantities that require
    solved orbits are differentiated along corrected ones. Raises OrbitError if the orbit is at a
    fold, or no neighbouring orbits are found.
    """
    values = np.array([each(orbit) for each in quantities])
    result = np.zeros((len(quantities), len(parameters)))
    of_solved = np.array([each.solved for each in quantities])
    for column, name in enumerate(parameters):
        tangent = TangentOrbit(orbit.numeric, name)
        inner = orbit.numeric.family.value(name)
        size = abs(inner) if inner != 0.0 else 1.0
        for kind in (False, True):
            rows = np.flatnonzero(of_solved == kind)
            chosen = [quantities[row] for row in rows.tolist()]
            if chosen and kind:
                result[rows, column] = _along_solved(orbit.system, chosen, tangent, size)
            elif chosen:
                growth = float(np.clip(tangent.growth * size, 1.0, 10.0))
                result[rows, column] = _derivatives(
                    orbit.system, chosen, tangent.to_first_order, DERIVATIVE_STEP * size / growth
                )
        # A parameter without effect has the derivative zero.
        nothing = np.abs(result[:, column]) * size <= DERIVATIVE_ROUNDING[
            of_solved.astype(int)
        ] * np.abs(values)
        result[nothing, column] = 0.0
        result[:, column] /= float(orbit.system.units.out(name, 1.0))
    return values, result


def _along_solved(
    system: HybridSystem, quantities: Sequence[Quantity], tangent: TangentOrbit, size: float
) -> Floats:
    for part in SOLVED_STEPS[:-1]:
        try:
            return _derivatives(system, quantities, tangent.solved, part * size)
        except OrbitError:
            continue
    return _derivatives(system, quantities, tangent.solved, SOLVED_STEPS[-1] * size)


def _derivatives(
    system: HybridSystem,
    quantities: Sequence[Quantity],
    at: Callable[[float], PeriodicOrbit],
    step: float,
) -> Floats:
    def values(distance: float) -> Floats:
        orbit = orbit_of(system, at(distance))
        return np.array([each(orbit) for each in quantities])

    return sixth_order_difference(values, step)


def chosen_quantities(
    system: HybridSystem, selection: Sequence[str | Quantity] | None
) -> tuple[Quantity, ...]:
    """Return the quantities of a system by name; all but costly ones by default.

    Raises InvalidParameter if a name is unknown or repeated.
    """
    available = {each.name: each for each in system.statistics.orbit_quantities}
    if selection is None:
        return tuple(each for each in available.values() if not each.costly)
    chosen = []
    for each in selection:
        if not isinstance(each, Quantity) and each not in available:
            raise InvalidParameter("quantity", each, f"one of {', '.join(available)}")
        chosen.append(each if isinstance(each, Quantity) else available[each])
    names = [each.name for each in chosen]
    if not names or len(set(names)) != len(names):
        raise InvalidParameter("quantities", names, "one or more different quantities")
    return tuple(chosen)


# --- Continuation of an orbit to other parameters

BIFURCATION_LABELS = ("G", "CF", "PD", "NS", "BP", "?")
"""Labels of special points at which an orbit changes its signature, or loses its stability."""
LINE_PARAMETER = "part"
MAX_STATE_CHANGE = 0.3  # largest change of states in one step, in orbit sizes
LINE_REMEDY = "take a shorter way"


@dataclass(frozen=True)
class _LineFamily(Family):
    """The problems on a straight line in parameter space, by the fraction of its length."""

    family: Family
    target: Mapping[str, float]

    @property
    def automaton(self) -> Automaton:
        return self.family.automaton

    def problem(self) -> Problem:
        return self._family_at(self.values).problem()

    def with_method(self, method: str) -> _LineFamily:
        return replace(self, family=self.family.with_method(method))

    def numbers(self, /, **changes: float) -> ProblemParameters:
        return self._family_at({**self.values, **changes}).numbers()

    def amount(self, heading: str, value: float) -> str:
        return self.family.amount(heading, value)

    def convert(self, error: RunError) -> None:
        self.family.convert(error)

    def _family_at(self, values: Mapping[str, float]) -> Family:
        part, start = values[LINE_PARAMETER], self.family.values
        inner = {
            name: start[name] + part * (end - start[name]) for name, end in self.target.items()
        }
        return self.family.at(**inner)


def continue_to(orbit: Orbit, values: Mapping[str, float]) -> Orbit:
    """Return the orbit at other parameters, by one step or by continuation along a straight line.

    Along the line, events may move to another forcing period, or change their order. The
    continuation ends at a grazing, at a fold, or at a loss of stability: an OrbitError, whose
    `reason` names the bifurcation.
    """
    system, start = orbit.system, orbit.numeric
    target = {name: system.units.into(name, value) for name, value in values.items()}
    try:
        end = _solved(start, target, start)
        if end.admissible and _is_near(start, end):
            return orbit_of(system, end)
    except OrbitError:
        pass
    return orbit_of(system, _solved(_continued(orbit, target), target, start))


def _solved(
    near: PeriodicOrbit, target: Mapping[str, float], start: PeriodicOrbit
) -> PeriodicOrbit:
    """Return the orbit of the signature of `near`, in the family of `start`."""
    shooting = Shooting(
        start.family.at(**target), near.segments, (), near.shooting.pinned, near.shooting.phase
    )
    return make_orbit(shooting, solve(shooting, near.point.unknowns, np.zeros(0)))


def _is_near(one: PeriodicOrbit, other: PeriodicOrbit) -> bool:
    """Return whether the states of two orbits differ by a small part of their size."""
    states, other_states = (each.shooting.unpack(each.point.unknowns)[0] for each in (one, other))
    return bool(np.abs(other_states - states).max() < MAX_STATE_CHANGE * np.abs(states).max())


def _continued(orbit: Orbit, target: Mapping[str, float]) -> PeriodicOrbit:
    """Return the orbit at the end of a straight line, in the family of the line."""
    start = orbit.numeric
    line = _LineFamily({LINE_PARAMETER: 0.0}, start.family, dict(target))
    shooting = Shooting(line, start.segments, (), start.shooting.pinned, start.shooting.phase)
    branch = OrbitBranch(LINE_PARAMETER)
    begin = replace(start, family=line, shooting=shooting)
    for point in points_of(branch, begin, low=0.0, high=1.0):
        passed = [each for each in branch.special_points if each.label in BIFURCATION_LABELS]
        if passed:
            raise OrbitError(f"{passed[0].kind} on the way", LINE_REMEDY)
        if point.value == 1.0:
            return point.solution
    raise OrbitError(branch.ended, LINE_REMEDY)


# --- Bifurcation margins


class _End(NamedTuple):
    at: float
    what: str


def bifurcation_margins(orbit: Orbit, over: Sequence[str], reach: float = 0.5) -> pd.DataFrame:
    """Return the margins of parameters, one at a time, to the next bifurcation of an orbit.

    The orbit is continued in both directions, until it grazes, folds, doubles its period, otherwise
    loses its stability, or its branch ends.

    Parameters
    ----------
    orbit : Orbit
        Stable.
    over : sequence of str
    reach : float, optional
        Range of the search, as a fraction of a parameter's value, in (0, 1].

    Returns
    -------
    DataFrame
        One row per parameter and direction: parameter, value, direction ("down", "up"), at (the
        value at the bifurcation, or the end of the range), margin (distance), relative (to the
        value) and "what": the bifurcation, "" without one.

    Raises
    ------
    InvalidParameter
        If there is no such parameter, its value is 0, or `reach` is out of range.

    See Also
    --------
    sensitivity, continue_solution, period_one_window

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> table = mi.bifurcation_margins(orbit, ["amplitude"])
    >>> table.columns.tolist()
    ['parameter', 'value', 'direction', 'at', 'margin', 'relative', 'what']
    """
    import pandas as pd

    check_kind(orbit, "orbit", Orbit, "an Orbit, from find_orbit")
    if not (is_number(reach) and 0.0 < reach <= 1.0):
        raise InvalidParameter("reach", reach, "in (0, 1]")
    system, rows = orbit.system, []
    for name in over:
        system.checks.continuation(name)
        value = system.parameters[name]
        if value == 0.0:
            raise InvalidParameter(name, value, "nonzero, since reach is relative to it")
        for direction, sign in (("down", -1.0), ("up", 1.0)):
            stop = _allowed(orbit, name, value + sign * reach * abs(value))
            end = _next(orbit, name, stop)
            margin = abs(end.at - value)
            rows.append((name, value, direction, end.at, margin, margin / abs(value), end.what))
    headings = ["parameter", "value", "direction", "at", "margin", "relative", "what"]
    table = pd.DataFrame(rows, columns=headings)
    table.attrs = {"system": repr(system)}
    return table


def _allowed(orbit: Orbit, name: str, stop: float) -> float:
    """Return `stop`, or the nearest allowed value of the parameter."""
    value = orbit.system.parameters[name]
    for part in (1.0, 0.9, 0.75, 0.5, 0.25, 0.1, 0.01):
        try:
            orbit.system.changed(**{name: value + part * (stop - value)})
        except (InvalidParameter, FunctionError):
            continue
        return value + part * (stop - value)
    return value


def _next(orbit: Orbit, name: str, stop: float) -> _End:
    system, value = orbit.system, orbit.numeric.family.value(name)
    end = system.units.into(name, stop)
    if end == value:
        return _End(stop, "the end of its range")
    branch, last = OrbitBranch(name), value
    low, high = min(value, end), max(value, end)
    sign = math.copysign(1.0, end - value)
    steps = StepControl(max_step=0.02)
    for point in points_of(branch, orbit.numeric, low=low, high=high, direction=sign, steps=steps):
        for each in branch.special_points:
            if each.label in BIFURCATION_LABELS:
                return _End(float(system.units.out(name, each.value)), each.kind)
        last = point.value
        if last == end:
            return _End(stop, "")
    return _End(float(system.units.out(name, last)), branch.ended)


# --- Sensitivities and first-order tolerances


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Sensitivity(Result):
    """Sensitivities of an orbit's quantities to its parameters, in the units of the system.

    Attributes
    ----------
    orbit : Orbit
    quantities, parameters : tuple of str
    units : tuple of str
        Of the quantities; empty for pure numbers.
    values : float array, shape (quantities,)
    derivatives : float array, shape (quantities, parameters)

    See Also
    --------
    sensitivity, plot_sensitivity, bifurcation_margins

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> found = mi.sensitivity(orbit)
    >>> "mean speed" in found.quantities, "omega" in found.parameters
    (True, True)
    >>> float(found.gradient("mean speed")["mu_s"])  # each blow tears the frame off
    0.0
    """

    orbit: Orbit = field(repr=False)
    quantities: tuple[str, ...]
    parameters: tuple[str, ...]
    units: tuple[str, ...] = field(repr=False)
    values: Floats = field(repr=False)
    derivatives: Floats = field(repr=False)

    @property
    def system(self) -> HybridSystem:
        """System of the orbit."""
        return self.orbit.system

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row per quantity and parameter.

        Columns: quantity, value, parameter, at (value of the parameter), derivative, elasticity
        (change of the quantity in per cent for one per cent of the parameter) and per cent (the
        change of the quantity then); unit (of the quantity) for systems with units.
        """
        import pandas as pd

        q, p = len(self.quantities), len(self.parameters)
        at = np.array([self.system.parameters[name] for name in self.parameters])
        with np.errstate(divide="ignore", invalid="ignore"):
            elasticity = self.derivatives * at / self.values[:, None] + 0.0
        columns = {
            "quantity": np.repeat(self.quantities, p),
            "value": np.repeat(self.values, p),
            "parameter": np.tile(self.parameters, q),
            "at": np.tile(at, q),
            "derivative": self.derivatives.ravel(),
            "elasticity": elasticity.ravel(),
            "per cent": (0.01 * self.derivatives * at).ravel(),
        }
        if self.system.units:
            columns["unit"] = np.repeat(self.units, p)
        table = pd.DataFrame(columns)
        table.attrs = {"system": repr(self.system)}
        return table

    def gradient(self, quantity: str) -> pd.Series:
        """Return the derivatives of a quantity, by parameter.

        Raises
        ------
        InvalidParameter
            If the quantity is unknown.
        """
        import pandas as pd

        row = self.row(quantity)
        return pd.Series(self.derivatives[row], index=list(self.parameters), name=quantity)

    def row(self, quantity: str) -> int:
        """Return the row of a quantity in `values`; InvalidParameter if it is unknown."""
        if quantity not in self.quantities:
            raise InvalidParameter("quantity", quantity, f"one of {', '.join(self.quantities)}")
        return self.quantities.index(quantity)

    def standard_deviations(self, tolerances: Mapping[str, float | str]) -> pd.DataFrame:
        """Return standard deviations of the quantities under tolerances, to first order.

        The variance is the sum of (dq/dp sigma)^2.

        Parameters
        ----------
        tolerances : mapping of str to float
            Standard deviations of parameters, in their units, such as ``"0.1 um"``, or
            relative: ``"5%"``.

        Returns
        -------
        DataFrame
            One row per quantity: quantity, value, standard deviation, relative (to the value), and
            one column per parameter, its share of the variance.

        Raises
        ------
        InvalidParameter
            If a name is none of `parameters`, or a deviation is below 0.

        Examples
        --------
        >>> found = mi.sensitivity(orbit)
        >>> found.standard_deviations({"delta": 0.01, "mu_d": 0.02})
        """
        import pandas as pd

        sizes = deviations(tolerances, self.system, self.parameters)
        indices = [self.parameters.index(name) for name in sizes]
        variances = (self.derivatives[:, indices] * np.array(list(sizes.values()))) ** 2
        deviation = first_order_deviations(self.derivatives[:, indices], sizes)
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = variances / variances.sum(axis=1, keepdims=True)
            relative = deviation / np.abs(self.values)
        columns = {"standard deviation": deviation, "relative": relative}
        columns |= {f"share {name}": shares[:, i] for i, name in enumerate(tolerances)}
        table = pd.DataFrame({"quantity": self.quantities, "value": self.values, **columns})
        table.attrs = {"system": repr(self.system)}
        return table

    def summary(self) -> dict[str, Any]:
        """Return the value of each quantity, and the parameter with the largest influence."""
        table = self.table
        lines: dict[str, Any] = {"system": repr(self.system)}
        for name, unit in zip(self.quantities, self.units, strict=True):
            rows = table[table["quantity"] == name].dropna(subset=["per cent"])
            if len(rows):
                row = rows.loc[rows["per cent"].abs().idxmax()]
                lines[self.system.units.scales.label(name, unit)] = (
                    f"{row['value']:.6g}; {row['parameter']} + 1 %: {row['per cent']:+.3g}"
                )
        return lines


def sensitivity(
    orbit: Orbit,
    over: Sequence[str] | None = None,
    quantities: Sequence[str | Quantity] | None = None,
) -> Sensitivity:
    """Compute sensitivities of a periodic orbit to its parameters.

    The orbit may be unstable. Derivatives of its states, event times, margins and speeds follow
    from the variational equations along its arcs and the implicit function theorem, derivatives of
    `Quantity` functions by the chain rule. Multipliers are differentiated along corrected
    neighbouring orbits.

    Parameters
    ----------
    orbit : Orbit
    over : sequence of str, optional
        All parameters by default, except the bias of a symmetric voltage, which would double the
        period.
    quantities : sequence of str or Quantity, optional
        All quantities of the system by default, except costly quantities. For any system: "x per
        period" (or "per cycle") for each cyclic state x, its observables (over the orbit), "period"
        of a limit cycle, "impact speed" (the largest), "closest approach", "largest multiplier"
        (its modulus). For an actuator also "displacement per period", "mean speed", "displacement
        per impact", "energy lost per period" (in impacts, without friction; `energy` has the whole
        balance), and "energy given per period", which is costly.

    Returns
    -------
    Sensitivity

    Raises
    ------
    InvalidParameter
        If there is no such parameter or quantity.
    OrbitError
        If the orbit is at a fold, or no orbit is found near it.

    See Also
    --------
    Sensitivity, optimize, bifurcation_margins, tolerance_analysis

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> found = mi.sensitivity(orbit)
    >>> f"{found.gradient('mean speed')['omega']:.5e}"
    '1.82824e-03'
    """
    check_kind(orbit, "orbit", Orbit, "an Orbit, from find_orbit")
    system = orbit.system
    names = _all_parameters(system) if over is None else tuple(over)
    for name in names:
        system.checks.continuation(name)
    if not names or len(set(names)) != len(names):
        raise InvalidParameter("over", names, "one or more different parameters")
    chosen = chosen_quantities(system, quantities)
    values, rates = derivatives(orbit, chosen, names)
    return Sensitivity(
        orbit=orbit,
        quantities=tuple(each.name for each in chosen),
        parameters=names,
        units=tuple(each.unit for each in chosen),
        values=values,
        derivatives=rates,
    )


def first_order_deviations(gradients: Floats, tolerances: Mapping[str, float]) -> Floats:
    """Return standard deviations to first order; the last axis of `gradients` is the parameters."""
    return np.asarray(np.sqrt(((gradients * np.array(list(tolerances.values()))) ** 2).sum(-1)))


def _all_parameters(system: HybridSystem) -> tuple[str, ...]:
    names = []
    for name in system.parameters:
        try:
            system.checks.continuation(name)
        except InvalidParameter:
            continue  # the bias of a voltage without one
        names.append(name)
    return tuple(names)
