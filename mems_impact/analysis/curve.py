"""Curves of special points in two parameters."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any

import numpy as np

from mems_impact import tables as orbit_tables
from mems_impact._util.progress import parameter_progress
from mems_impact.analysis.continuation_range import checked_ends
from mems_impact.analysis.continuation_result import ContinuationResult
from mems_impact.analysis.equilibrium import Equilibrium
from mems_impact.analysis.orbit import Orbit
from mems_impact.analysis.solution import S, branch_table, row, solution_of
from mems_impact.analysis.special_points import CodimensionTwo, SpecialPoint, special_point
from mems_impact.analysis.user_test_functions import EventFunction
from mems_impact.continuation.arclength import StepControl
from mems_impact.continuation.branch import EquilibriumCurve, OrbitCurve, OrbitEvent
from mems_impact.continuation.equilibrium_branch import EQUILIBRIUM_LABELS
from mems_impact.continuation.equilibrium_curve import branch_event, follow_equilibrium_curve
from mems_impact.continuation.orbit_curve import follow_curve
from mems_impact.continuation.test_functions import ORBIT_LABELS, UNEXPLAINED
from mems_impact.continuation.user_test_functions import FunctionTest
from mems_impact.errors import InvalidParameter
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.result import check_kind

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Curve(ContinuationResult[S]):
    """Curve of a special point in two parameters.

    Attributes
    ----------
    system : System
    kind, label : str
        Of the special point.
    parameters : tuple of str
        The parameter of the branch, then the second one.
    special_points : tuple of CodimensionTwo
    ended : str
        Why the curve ends.

    See Also
    --------
    continue_curve, plot_curve

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> branch = mi.continue_solution(orbit, "amplitude", stop=0.17)
    >>> curve = mi.continue_curve(branch.special_points[0], "omega", stop=0.51)
    >>> list(curve.table.columns[:2]), curve.ended
    (['omega', 'amplitude'], 'omega reached its bound')
    """

    system: HybridSystem = field(repr=False)
    kind: str
    label: str
    parameters: tuple[str, str]
    special_points: tuple[CodimensionTwo[S], ...]
    ended: str
    numeric: OrbitCurve | EquilibriumCurve = field(repr=False)

    @cached_property
    def points(self) -> tuple[SpecialPoint[Equilibrium], ...]:
        """The special points along a curve of equilibria, in the form of the points of a branch.

        Their parameter is the first one; the second one has its value on the curve. `switch_branch`
        takes those of a Hopf curve. Empty for a curve of orbits.
        """
        numeric, parameter = self.numeric, self.parameters[0]
        if not isinstance(numeric, EquilibriumCurve):
            return ()
        low, high = (float(self.system.units.out(parameter, bound)) for bound in numeric.bounds)
        return tuple(
            special_point(each.system, parameter, branch_event(numeric, each.numeric), (low, high))
            for each in self.equilibria
        )

    @property
    def _subject(self) -> str:
        return f"{self.label} over {' and '.join(self.parameters)}"

    @property
    def _subject_rows(self) -> dict[str, Any]:
        names = ", ".join(map(self.system.units.label, self.parameters))
        return {"kind": self.kind, "parameters": names}

    @property
    def _special(self) -> str:
        descriptions = [
            f"{s.kind} ({', '.join(f'{value:.6g}' for value in s.values.values())})"
            for s in self.special_points
        ]
        return ", ".join(descriptions) or "none"

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row per point: the second parameter, the first, and the columns of a branch's table.

        The columns are as in `Branch.table`.
        """
        first, second = self.parameters
        out, rows = self.system.units.out, []
        for each in self.solutions:
            at = each.numeric.family.values
            rows.append({"values": [out(name, at[name]) for name in (second, first)], **row(each)})
        table = orbit_tables.curve([second, first], rows, self.system)
        return branch_table(table, self.system, equilibria=self.of == "equilibria")

    @cached_property
    def special_table(self) -> pd.DataFrame:
        """One row per point of codimension two."""
        first, second = self.parameters
        rows = [
            {"kind": s.kind, "values": [s.values[second], s.values[first]], **row(s.solution)}
            for s in self.special_points
        ]
        return orbit_tables.codimension_two([second, first], rows, self.system, self.table)


def continue_curve(
    special: SpecialPoint[Any] | Orbit,
    parameter: str,
    stop: float,
    *,
    fixed: str | Callable[[Orbit], float] | None = None,
    free: str | None = None,
    back: float | None = None,
    steps: StepControl = StepControl(),  # noqa: B008 - immutable
    progress: bool | Callable[[float], None] = False,
) -> Curve[Any]:
    """Continue a special point of a branch in two parameters.

    Points of codimension two on the curve are located and listed. A curve of Neimark-Sacker points
    ends where its pair of multipliers becomes real, at a 1:1 or 1:2 resonance, and a curve of Hopf
    points where its pair of eigenvalues becomes real, at a Bogdanov-Takens point. A branch point
    has a curve if a symmetry or an invariant subspace keeps the branch point; otherwise the branch
    point unfolds.

    Parameters
    ----------
    special : SpecialPoint or Orbit
        A grazing, fold, period doubling, Neimark-Sacker or branch point, an onset of complete
        chatter (to some 1e-7), a point at which another guard is touched, or an event of
        `continue_solution`. A fold, Hopf point or boundary equilibrium of a branch of equilibria.
        An orbit is continued with a quantity `fixed` at its value.
    parameter : str
        The second parameter; the first is the parameter of the branch.
    stop : float
        Value towards which the curve starts, and its bound.
    fixed : str or callable, optional
        Quantity of an orbit: a column of its branch's table, such as ``"impact speed"``, or a
        function of the `Orbit`.
    free : str, optional
        The first parameter of an orbit, which keeps `fixed` constant.
    back : float, optional
        Opposite bound, used if the curve folds back; by default the value at its start.
    steps, progress
        As for `continue_solution`.

    Returns
    -------
    Curve
        ``ended`` holds the reason of its end.

    Raises
    ------
    InvalidParameter
        If an argument is out of range.
    FunctionError
        If `fixed` raises, or returns no number.

    See Also
    --------
    Curve, continue_solution, plot_curve, operating_chart

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> branch = mi.continue_solution(orbit, "amplitude", stop=0.17)
    >>> fold = branch.special_points[0]
    >>> curve = mi.continue_curve(fold, "omega", stop=0.51)
    >>> curve.kind, curve.parameters
    ('fold', ('amplitude', 'omega'))

    Orbits with impacts of one speed:

    >>> curve = mi.continue_curve(orbit, "omega", 0.505, fixed="impact speed", free="amplitude")
    >>> bool(abs(curve.table["impact speed"] - max(orbit.impact_speeds)).max() < 1e-9)
    True
    """
    check_kind(special, "special", SpecialPoint | Orbit, "a special point of a branch, or an Orbit")
    system, start = special.system, None
    if isinstance(special, Orbit):
        first, start = _at_level(special, fixed, free)
        kind = start.kind
    else:
        if fixed is not None or free is not None:
            field, value = ("free", free) if fixed is None else ("fixed", fixed)
            raise InvalidParameter(field, value, "omitted, except for an Orbit")
        first, kind = special.parameter, special.kind
        if isinstance(special.solution, Orbit):
            start = special.without_impact
    if parameter == first:
        raise InvalidParameter(
            "parameter", parameter, "a parameter other than the parameter of the branch"
        )
    if kind == UNEXPLAINED:
        raise InvalidParameter("special", kind, "a point of known kind")
    bounds, direction = checked_ends(system, parameter, stop, back)
    low, high = (system.units.into(parameter, bound) for bound in bounds)
    noun = "equilibria" if start is None else "orbits"
    with parameter_progress(
        progress, system.units.label(parameter), noun, partial(system.units.out, parameter)
    ) as report:
        if start is None:
            assert isinstance(special, SpecialPoint)
            lowest, highest = (system.units.into(first, bound) for bound in special.bounds)
            found: OrbitCurve | EquilibriumCurve = follow_equilibrium_curve(
                special.equilibrium.numeric,
                EquilibriumCurve(
                    kind, (first, parameter), bounds=(lowest, highest), guard=special.guard
                ),
                low=low,
                high=high,
                direction=direction,
                steps=steps,
                progress=report,
            )
        else:
            found = follow_curve(
                start,
                first,
                parameter,
                low=low,
                high=high,
                direction=direction,
                steps=steps,
                progress=report,
            )
    return curve_of(system, found)


def _at_level(
    orbit: Orbit, fixed: str | Callable[[Orbit], float] | None, free: str | None
) -> tuple[str, OrbitEvent]:
    """Return the free parameter, and an orbit as a point at which a quantity has its value."""
    if not isinstance(free, str):
        raise InvalidParameter("free", free, "a parameter that keeps the quantity constant")
    orbit.system.checks.continuation(free)
    if not (callable(fixed) or isinstance(fixed, str)):
        allowed = "a column of the table of a branch, or a function of the orbit"
        raise InvalidParameter("fixed", fixed, allowed)
    name = fixed if isinstance(fixed, str) else getattr(fixed, "__name__", "quantity")
    column, function = (fixed, None) if isinstance(fixed, str) else ("", fixed)
    quantity = EventFunction(name, orbit.system, free, column, 0.0, function)
    if column:
        quantity.check_column(orbit, "fixed")
    level = quantity.of(orbit)
    if not math.isfinite(level):
        raise InvalidParameter("fixed", name, f"a quantity of this orbit, where it is {level}")
    test = FunctionTest(f"{name} = {level:.6g}", replace(quantity, level=level))
    value, still = orbit.numeric.family.values[free], np.zeros(0)
    return free, OrbitEvent(test.kind, test.kind, value, orbit.numeric, still, test)


def curve_of(system: HybridSystem, curve: OrbitCurve | EquilibriumCurve) -> Curve[Any]:
    """Return a curve of `continuation` as a `Curve` in the system's units."""
    special = tuple(
        CodimensionTwo(
            kind=s.kind,
            values={
                name: system.units.out(name, value)
                for name, value in zip(curve.parameters, s.values, strict=True)
            },
            solution=solution_of(system, s.solution),
        )
        for s in curve.special_points
    )
    labels = EQUILIBRIUM_LABELS if isinstance(curve, EquilibriumCurve) else ORBIT_LABELS
    return Curve(
        system=system,
        kind=curve.kind,
        label=labels.get(curve.kind, curve.kind),
        parameters=curve.parameters,
        special_points=special,
        ended=curve.ended,
        numeric=curve,
    )
