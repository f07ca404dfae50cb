"""Branches of orbits and equilibria, and curves of special points, of a system."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar, overload

import numpy as np

from mems_impact import tables as orbit_tables
from mems_impact._util.arrays import Floats
from mems_impact._util.progress import parameter_progress
from mems_impact._util.warning_scopes import warn
from mems_impact.analysis.boundary_equilibrium_type import type_of_boundary
from mems_impact.analysis.equilibrium import Equilibrium, equilibrium_of
from mems_impact.analysis.homoclinic import HomoclinicEnd
from mems_impact.analysis.orbit import Orbit, orbit_of
from mems_impact.analysis.sliding_type import type_of
from mems_impact.analysis.special_points import (
    BifurcationPoint,
    CodimensionTwo,
    EquilibriumPoint,
    SpecialPoint,
    check_kind,
)
from mems_impact.analysis.symmetry import Symmetry, symmetry_of_halves
from mems_impact.analysis.user_test_functions import (
    MEASURES,
    EquilibriumFunction,
    Events,
    OrbitFunction,
)
from mems_impact.continuation.arclength import CLOSED, StepControl
from mems_impact.continuation.branch_point_curve import BranchPointCurve
from mems_impact.continuation.branch_switching import (
    switch_at_branch_point,
    switch_at_hopf,
    switch_at_period_doubling,
    switch_equilibrium,
)
from mems_impact.continuation.branching_equation import FirstPoint
from mems_impact.continuation.codim1_curve import OrbitCurve, follow_curve
from mems_impact.continuation.corners import corners
from mems_impact.continuation.equilibrium_branch import (
    EQUILIBRIUM_LABELS,
    Equilibria,
    follow_equilibrium,
)
from mems_impact.continuation.equilibrium_curve import (
    EquilibriumCurve,
    EquilibriumCurveEvent,
    follow_equilibrium_curve,
)
from mems_impact.continuation.homoclinic import homoclinic_value, leading
from mems_impact.continuation.orbit_branch import OrbitBranch, follow
from mems_impact.continuation.special_points import BranchEvent
from mems_impact.continuation.test_functions import (
    BRANCH_POINT,
    MEETING,
    ORBIT_LABELS,
    UNEXPLAINED,
    kind_of,
)
from mems_impact.continuation.user_test_functions import FunctionTest
from mems_impact.errors import DiscontinuityWarning, InvalidParameter
from mems_impact.hybrid.definition import PLACEHOLDER_GUARD
from mems_impact.orbits.equilibrium import EquilibriumState
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.result import Result
from mems_impact.systems.state import is_number

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Branch",
    "Curve",
    "EquilibriumBranch",
    "continue_curve",
    "continue_equilibrium",
    "continue_orbit",
    "curve_of",
    "joined_branch",
    "switch_branch",
]

# --- Branches of periodic orbits

MIN_EXTRAPOLATED = 3  # cycles from which the homoclinic value is extrapolated
BRANCH_STEPS = StepControl(max_step=0.02)  # so that a branch is smooth to the eye


class ContinuationResult(Result):
    """Base class of results of continuation: a branch in one parameter, by default."""

    system: HybridSystem
    parameter: str
    bounds: tuple[float, float]
    special_points: tuple[Any, ...]
    ended: str
    numeric: Any

    _stored: ClassVar[tuple[str, ...]] = ("table", "special_table")

    @property
    def of(self) -> str:
        """Noun for its points, in the plural."""
        return "orbits"

    def __len__(self) -> int:
        return len(self.numeric.points)

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__}({self._subject}, {len(self)} {self.of}, "
            f"special points: {self._special}; ended: {self.ended})"
        )

    def summary(self) -> dict[str, Any]:
        """Return the parameter and its range, the special points and the reason for the end."""
        return {
            "system": repr(self.system),
            **self._subject_rows,
            self.of: len(self),
            "special points": self._special,
            "ended": self.ended,
        }

    @property
    def _subject(self) -> str:
        """Parameter and range, for the repr."""
        return f"{self.parameter} {self._range}"

    @property
    def _subject_rows(self) -> dict[str, Any]:
        """The same in the summary."""
        return {self.system.label(self.parameter): self._range}

    @property
    def _range(self) -> str:
        low, high = self.bounds
        return f"{low:g} to {high:g}"

    @property
    def _special(self) -> str:
        return ", ".join(f"{s.label} {s.value:.6g}" for s in self.special_points) or "none"


def _orbits_of(result: Branch | Curve) -> tuple[Orbit, ...]:
    """Return all orbits of a branch or curve; orbits of special points are the points' own.

    An orbit is integrated once for its tables, so the same orbit must not appear as two objects.
    """
    if isinstance(result.numeric, EquilibriumCurve):
        return ()
    special = {id(s.orbit.numeric): s.orbit for s in result.special_points}
    return tuple(
        special.get(id(point.orbit)) or orbit_of(result.system, point.orbit)
        for point in result.numeric.points
    )


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Branch(ContinuationResult):
    """Branch of periodic orbits in one parameter.

    Attributes
    ----------
    system : System
        The system at the start of the branch.
    parameter : str
    bounds : tuple of float
        Smallest and largest value of the parameter.
    special_points : tuple of SpecialPoint
        In the order in which the branch passes them.
    ended : str
        Why the branch ends.

    See Also
    --------
    continue_orbit, plot_branch, SpecialPoint

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> branch = mi.continue_orbit(orbit, "amplitude", stop=0.17)
    >>> branch.special_table["label"].tolist()
    ['CF', 'G']
    >>> bool(branch.table["stable"].all())
    False
    """

    system: HybridSystem = field(repr=False)
    parameter: str
    bounds: tuple[float, float]
    special_points: tuple[SpecialPoint, ...]
    ended: str
    numeric: OrbitBranch = field(repr=False)

    @cached_property
    def orbits(self) -> tuple[Orbit, ...]:
        """All orbits, in order along the branch."""
        return _orbits_of(self)

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row per orbit, in order along the branch.

        Columns: the parameter, stable, admissible, piece (0, 1, …: a new one where an impact or
        another event appears or disappears), the period of limit cycles, largest multiplier (its
        absolute value; inf at a grazing impact), impacts and the largest impact speed over the
        orbit, closest approach, observables, and the states at the upward crossings of the section,
        or at the start of forcing periods, largest first: v2, v2 2, v2 3, …; for a cycle without a
        section their largest values.
        """
        rows = [
            {
                "value": self.system.out(self.parameter, point.value),
                **orbit_row(orbit, piece=point.piece),
            }
            for point, orbit in zip(self.numeric.points, self.orbits, strict=True)
        ]
        return orbit_tables.branch(self.parameter, rows, self.system)

    @cached_property
    def special_table(self) -> pd.DataFrame:
        """One row per special point.

        Columns: label, the parameter, kind, criticality (see `NormalForm`), type (see
        `SlidingType`), then those of `table` but for the piece.
        """
        rows = [{**_names(s), "value": s.value, **orbit_row(s.orbit)} for s in self.special_points]
        like = self.table.drop(columns="piece")
        return orbit_tables.special_points(self.parameter, rows, self.system, like)

    @cached_property
    def symmetry(self) -> Symmetry | None:
        """The symmetry that maps each half of the branch to the other; else None.

        The halves meet at a branch point, a pitchfork, where the branch breaks the symmetry.
        """
        points = [s.orbit for s in self.special_points if s.kind == BRANCH_POINT]
        return symmetry_of_halves(points, self.orbits, lambda orbit: orbit.numeric.point)

    @cached_property
    def homoclinic(self) -> HomoclinicEnd | None:
        """The homoclinic orbit that the last limit cycle approaches, if the branch ends there."""
        return _homoclinic_end(self.system, self.numeric)


def continue_orbit(
    orbit: Orbit,
    parameter: str,
    stop: float,
    *,
    back: float | str | None = None,
    steps: StepControl = BRANCH_STEPS,
    through_grazing: bool = True,
    events: Events | None = None,
    stop_at: str | Collection[str] = (),
    progress: bool | Callable[[float], None] = False,
) -> Branch:
    """Continue a periodic orbit, stable or unstable, in one parameter.

    Folds, grazings and period doublings of the branch are located and listed. Where the number of
    unstable multipliers changes without such a point, an "unexplained" point is listed.

    Parameters
    ----------
    orbit : Orbit
    parameter : str
        A parameter of the drive (``"amplitude"``, ``"omega"``, …), of the actuator or of the
        system.
    stop : float
        Value towards which the branch starts, and its bound.
    back : float, optional
        Opposite bound, used if the branch folds back; by default the value at its start.
    steps : StepControl, optional
        Step lengths, and the largest number of steps.
    through_grazing : bool, optional
        Whether to continue at a grazing with the orbit that has one impact more or fewer. Otherwise
        the branch continues with orbits that penetrate the stopper or impact backwards, marked as
        inadmissible.
    events : mapping of str to callable or (str, float), optional
        Further special points by name: the zeros of a function of the `Orbit`, or a column of the
        branch's table with its value there, such as ``("impact speed", 0.3)``. The name is the kind
        and label of these points. A function returns NaN where it is undefined; a jump is no zero.
    stop_at : str or collection of str, optional
        Labels or kinds of special points, events included: the branch ends at the first such point.
    progress : bool or callable, optional
        True: show a counter after a second. A function is called with each value of the parameter.

    Returns
    -------
    Branch
        ``ended`` holds the reason of its end.

    Raises
    ------
    InvalidParameter
        If an argument is out of range, or the parameter cannot have the value `stop`.
    FunctionError
        If a function of `events` raises, or returns no number, at the first orbit; a later failure
        ends the branch.

    See Also
    --------
    Branch, switch_branch, continue_curve, sweep

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> branch = mi.continue_orbit(orbit, "amplitude", stop=0.17)
    >>> [(special.label, round(special.value, 7)) for special in branch.special_points]
    [('CF', 0.1765154), ('G', 0.2271776)]
    >>> branch.ended
    'amplitude reached its bound'
    >>> events = {"weak": ("impact speed", 0.15)}
    >>> weak = mi.continue_orbit(orbit, "amplitude", 0.23, events=events, stop_at="weak")
    >>> [special.label for special in weak.special_points], weak.ended
    (['weak'], 'the branch stops at weak')
    """
    check_kind(orbit, "orbit", Orbit, "an Orbit, from find_orbit")
    system = orbit.system
    stop, back = _ends(system, parameter, stop, back)
    bounds = check_bounds(system, parameter, stop, back)
    tests = _orbit_tests(events, orbit, parameter)
    stops = _orbit_stops(stop_at, system, tests)
    direction = math.copysign(1.0, stop - system.value(parameter))
    low, high = (system.into(parameter, bound) for bound in bounds)
    # The parameter at the start of the branch, to the last digit of the numerics.
    begin = orbit.numeric.family.values[parameter]
    with parameter_progress(
        progress, system.label(parameter), "orbits", partial(system.out, parameter)
    ) as report:
        branch = follow(
            orbit.numeric,
            parameter,
            low=min(low, begin),
            high=max(high, begin),
            direction=direction,
            steps=steps,
            reconnecting=through_grazing,
            functions=tests,
            stop_at=stops,
            progress=report,
        )
    return _branch(system, branch, bounds)


def _orbit_tests(events: Events | None, orbit: Orbit, parameter: str) -> tuple[FunctionTest, ...]:
    guards = (each.name for each in orbit.system.automaton.guards)
    kinds = {*ORBIT_LABELS, *ORBIT_LABELS.values(), *guards}
    return OrbitFunction.tests(events, orbit, parameter, kinds)


def _orbit_stops(
    stop_at: str | Collection[str], system: HybridSystem, tests: Sequence[FunctionTest]
) -> frozenset[str]:
    guards = [kind_of(each) for each in system.automaton.guards if each.name != PLACEHOLDER_GUARD]
    return _stops(stop_at, ORBIT_LABELS, [MEETING, *guards, *(test.kind for test in tests)])


def _stops(
    stop_at: str | Collection[str], labels: Mapping[str, str], others: Sequence[str]
) -> frozenset[str]:
    """Return the kinds of special points with given labels or kinds."""
    kinds = {kind: kind for kind in [*labels, *others]}
    kinds |= {label: kind for kind, label in labels.items()}
    if not isinstance(stop_at, str | Collection):
        raise InvalidParameter("stop_at", stop_at, "labels of special points")
    names = [stop_at] if isinstance(stop_at, str) else list(stop_at)
    for name in names:
        if name not in kinds:
            raise InvalidParameter("stop_at", name, f"one of {', '.join(sorted(kinds))}")
    return frozenset(kinds[name] for name in names)


@overload
def switch_branch(
    special: SpecialPoint,
    *,
    bounds: tuple[float, float] | None = None,
    steps: StepControl | None = None,
    through_grazing: bool = True,
    events: Events | None = None,
    stop_at: str | Collection[str] = (),
    progress: bool | Callable[[float], None] = False,
) -> Branch: ...


@overload
def switch_branch(
    special: EquilibriumPoint,
    *,
    bounds: tuple[float, float] | None = None,
    steps: StepControl | None = None,
    through_grazing: bool = True,
    events: Events | None = None,
    stop_at: str | Collection[str] = (),
    progress: bool | Callable[[float], None] = False,
) -> Branch | EquilibriumBranch: ...


def switch_branch(
    special: SpecialPoint | EquilibriumPoint,
    *,
    bounds: tuple[float, float] | None = None,
    steps: StepControl | None = None,
    through_grazing: bool = True,
    events: Events | None = None,
    stop_at: str | Collection[str] = (),
    progress: bool | Callable[[float], None] = False,
) -> Branch | EquilibriumBranch:
    """Switch to the branch that emanates from a period doubling, Hopf point or branch point.

    At a branch point, the branch that crosses is continued on both sides of the point: at a
    pitchfork, both halves with the branch point between them.

    Parameters
    ----------
    special : SpecialPoint or EquilibriumPoint
        A period doubling or branch point of a branch of orbits, or a Hopf point or branch point of
        a branch of equilibria.
    bounds : tuple of float, optional
        Smallest and largest value of the parameter; by default the values of the branch.
    steps : StepControl, optional
        As for `continue_orbit`, or `continue_equilibrium`. The largest number of steps is for each
        side.
    through_grazing
        As for `continue_orbit`.
    events, stop_at
        As for `continue_orbit`, or `continue_equilibrium`. A branch through a branch point ends at
        the first such point on each side.
    progress
        As for `continue_orbit`.

    Returns
    -------
    Branch or EquilibriumBranch
        Equilibria at a branch point of equilibria; else orbits.

    Raises
    ------
    InvalidParameter
        If `special` is none of these.
    OrbitError
        If no orbit of the branch is found.

    See Also
    --------
    continue_orbit, continue_equilibrium, SpecialPoint

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.29, omega=0.45)
    >>> orbit = mi.find_orbit(actuator, drive, guess=mi.kicked_state(actuator), transient=300)
    >>> branch = mi.continue_orbit(orbit, "amplitude", stop=0.25)
    >>> (doubling,) = [special for special in branch.special_points if special.label == "PD"]
    >>> twice = mi.switch_branch(doubling, bounds=(0.26, 0.29))
    >>> twice.orbits[1].periods / orbit.periods
    2.0

    Both halves of a pitchfork:

    >>> def duffing(mode, t, y, p):
    ...     return y.v, p.a * y.x - y.x**3 - 0.1 * y.v
    >>> well = mi.System(states=("x", "v"), flow=duffing, parameters={"a": -1.0})
    >>> (rest,) = mi.find_equilibria(well, guess={"x": 0.0})
    >>> (fork,) = mi.continue_equilibrium(rest, "a", stop=1.0).special_points
    >>> halves = mi.switch_branch(fork)
    >>> [round(halves.equilibria[i].state.x, 6) for i in (0, -1)]
    [1.0, -1.0]
    """
    check_kind(special, "special", SpecialPoint | EquilibriumPoint, "a special point of a branch")
    if special.label not in ("PD", "H", "BP"):
        allowed = "a period doubling, a Hopf point or a branch point"
        raise InvalidParameter("special", special.kind, allowed)
    parameter, system = special.parameter, special.system
    low, high = checked_range(system, parameter, special.bounds if bounds is None else bounds)
    if not low < special.value < high:
        location = _amount(system, parameter, special.value)
        allowed = f"smallest and largest value, with {location} between them"
        raise InvalidParameter("bounds", (low, high), allowed)
    if special.kind != BRANCH_POINT:
        if isinstance(special, EquilibriumPoint):
            orbit, away = switch_at_hopf(special.equilibrium.numeric, parameter)
        else:
            orbit, away = switch_at_period_doubling(special.numeric.orbit, parameter)
    elif isinstance(special, EquilibriumPoint):
        chosen = steps or EQUILIBRIUM_STEPS
        return _crossing_equilibria(special, (low, high), chosen, events, stop_at, progress)
    else:
        event = special.numeric
        orbit, first = switch_at_branch_point(event.orbit, event.direction, parameter)
    tests = _orbit_tests(events, orbit_of(system, orbit), parameter)
    stops = _orbit_stops(stop_at, system, tests)
    with parameter_progress(
        progress, system.label(parameter), "orbits", partial(system.out, parameter)
    ) as report:

        def followed(side: float | Floats, steps: StepControl) -> Branch:
            branch = follow(
                orbit,
                parameter,
                low=system.into(parameter, low),
                high=system.into(parameter, high),
                direction=side,
                steps=steps,
                reconnecting=through_grazing,
                functions=tests,
                stop_at=stops,
                progress=report,
            )
            return _branch(system, branch, (low, high))

        steps = steps or BRANCH_STEPS
        if special.kind != BRANCH_POINT:
            return followed(away, steps)
        return _both_sides(followed, first, steps)


def _crossing_equilibria(
    special: EquilibriumPoint,
    bounds: tuple[float, float],
    steps: StepControl,
    events: Events | None,
    stop_at: str | Collection[str],
    progress: bool | Callable[[float], None],
) -> EquilibriumBranch:
    """Return the branch of equilibria that crosses at a branch point."""
    parameter, system, event = special.parameter, special.system, special.numeric
    equilibrium, first = switch_equilibrium(event.equilibrium, event.direction, parameter)
    tests = _equilibrium_tests(events, equilibrium_of(system, equilibrium), parameter)
    stops = _equilibrium_stops(stop_at, tests)
    with parameter_progress(
        progress, system.label(parameter), "equilibria", partial(system.out, parameter)
    ) as report:

        def followed(side: float, steps: StepControl) -> EquilibriumBranch:
            branch = follow_equilibrium(
                equilibrium,
                parameter,
                low=system.into(parameter, bounds[0]),
                high=system.into(parameter, bounds[1]),
                direction=side,
                steps=steps,
                functions=tests,
                stop_at=stops,
                progress=report,
            )
            return _equilibrium_branch(system, branch, bounds)

        return _both_sides(followed, first, steps)


B = TypeVar("B", "Branch", "EquilibriumBranch")


def _both_sides(
    followed: Callable[[float, StepControl], B], first: FirstPoint[Any], steps: StepControl
) -> B:
    """Return the branch through a branch point, given its continuation to one side."""
    outward = followed(first.side, steps)
    if outward.ended.endswith(CLOSED):
        return outward
    # One step passes the branch point: an error of the equations separates the branches there.
    initial = max(steps.initial_step, PASSING_RATIO * first.distance)
    return joined_branch(outward, followed(-first.side, replace(steps, initial_step=initial)))


def joined_branch(outward: B, inward: B) -> B:
    """Return one branch of two that start at the same point in opposite directions."""
    ends = outward.ended, inward.ended
    ended = ends[0] if ends[0] == ends[1] else f"{ends[1]}; at its beginning, {ends[0]}"
    return replace(
        outward,
        special_points=(*outward.special_points[::-1], *inward.special_points),
        ended=ended,
        numeric=outward.numeric.joined(inward.numeric),
    )


def _branch(system: HybridSystem, branch: OrbitBranch, bounds: tuple[float, float]) -> Branch:
    parameter = branch.parameter
    after = {
        id(point.orbit): following.orbit
        for point, following in zip(branch.points, branch.points[1:], strict=False)
    }
    special = tuple(
        SpecialPoint(
            kind=s.kind,
            label=s.label,
            parameter=parameter,
            value=system.out(parameter, s.value),
            orbit=orbit_of(system, s.orbit),
            bounds=bounds,
            numeric=s,
            next_orbit=after.get(id(s.orbit)),
        )
        for s in branch.special_points
    )
    warn_of_corners(system, branch)
    return Branch(
        system=system,
        parameter=parameter,
        bounds=bounds,
        special_points=special,
        ended=branch.ended if branch.passage is None else _beyond_bounds(system, branch),
        numeric=branch,
    )


def warn_of_corners(system: HybridSystem, branch: OrbitBranch) -> None:
    """Warn of each transition that is not smooth on a branch, which no test function shows."""
    guards, parameter, names = system.automaton.guards, branch.parameter, set()
    for corner in corners([point.orbit for point in branch.points], parameter):
        is_switch = corner.code == system.automaton.switch_code
        name = "switch_transition" if is_switch else (
            f"the transition of {guards[corner.code % len(guards)].name!r}")  # fmt: skip
        of_user = is_switch or guards[corner.code % len(guards)].name in system.user_transitions
        if name in names or not of_user:
            continue
        names.add(name)
        at = ", ".join(
            f"{system.label(state)} = {float(system.out(state, value)):.6g}"
            for state, value in zip(system.states, corner.y.tolist(), strict=True)
        )
        message = (
            f"{name} is not smooth near {at}, which the branch meets near {parameter} = "
            f"{float(system.out(parameter, corner.value)):.6g}: no special point is located there; "
            "let each path of the function be a mode of its own, with a guard between them"
        )
        warn(message, DiscontinuityWarning)


def _beyond_bounds(system: HybridSystem, branch: OrbitBranch) -> str:
    """Return that the period of cycles diverges, and the state at which they are slow."""
    passage = branch.passage
    assert passage is not None
    shortest, last = (f"{system.out('time', period):.4g}" for period in passage.periods)
    location = ", ".join(
        f"{system.label(name)} = {system.out(name, value):.4g}"
        for i, (name, value) in enumerate(zip(system.states, passage.state.tolist(), strict=True))
        if i not in system.automaton.cyclic
    )
    end = _homoclinic_end(system, branch)
    if end is not None:
        cause = f"the cycles approach a saddle ({location}), as near a homoclinic orbit"
        cause += f" at {end.parameter} = {end.value:.7g}; saddle quantity {end.saddle_quantity:.4g}"
        cause += f": {end.cycles} near it" if end.cycles else ""
    elif passage.equilibrium is not None:
        cause = f"the cycles approach an equilibrium ({location}), as near a homoclinic orbit"
    else:
        cause = f"the cycles slow down at ({location}), as near a saddle-node of equilibria"
    return f"the period grows beyond bounds (from {shortest} to {last}): {cause}"


def _homoclinic_end(system: HybridSystem, branch: OrbitBranch) -> HomoclinicEnd | None:
    """Return the homoclinic orbit at the end of a branch of limit cycles to a saddle."""
    passage = branch.passage
    saddle = None if passage is None else passage.equilibrium
    pair = None if saddle is None else leading(saddle.eigenvalues)
    if passage is None or saddle is None or pair is None or len(branch.points) < MIN_EXTRAPOLATED:
        return None
    values = np.array([system.out(branch.parameter, point.value) for point in branch.points])
    periods = np.array([point.orbit.point.period for point in branch.points])
    rate = min(abs(float(each[0].real)) for each in pair)
    value, error = homoclinic_value(values, periods / passage.passages, rate)
    return HomoclinicEnd(
        parameter=branch.parameter,
        value=value,
        error=error,
        saddle=equilibrium_of(system, saddle),
    )


def _names(special: BifurcationPoint) -> dict[str, str]:
    """Return the name of a special point, for its row in tables."""
    names, kind = ("label", "kind", "criticality"), ""
    if isinstance(special, SpecialPoint):
        kind = type_of(special.numeric)
    elif isinstance(special, EquilibriumPoint):
        kind = type_of_boundary(special.numeric, special.parameter)
    return {**{name: getattr(special, name) for name in names}, "type": kind}


def orbit_row(orbit: Orbit, **leading: int) -> dict[str, Any]:
    """Return the row of an orbit in tables; `leading` are its first columns."""
    solution = orbit.numeric
    first = {
        "stable": solution.stable,
        "admissible": solution.admissible,
        **leading,
        **({} if orbit.system.forced else {"period": orbit.period}),
    }
    measures = {
        "largest multiplier": MEASURES["largest multiplier"](orbit),
        "impacts": len(orbit.impact_speeds),
        "impact speed": MEASURES["impact speed"](orbit),
        "closest approach": MEASURES["closest approach"](orbit),
        **orbit.observables,  # a user's "impact speed" replaces that of all impacts
        "states": orbit.shown_states,
    }
    return orbit_tables.merged_columns(first, measures)


def no_orbits(parameter: str, system: HybridSystem) -> pd.DataFrame:
    """Return the table of a branch without its rows."""
    empty = {
        "value": math.nan,
        "stable": False,
        "admissible": False,
        "piece": 0,
        **({} if system.forced else {"period": math.nan}),
        "largest multiplier": math.nan,
        "impacts": 0,
        "impact speed": math.nan,
        "closest approach": math.nan,
        **{each.name: math.nan for each in system.observables},
        "states": {name: [math.nan] for name in system.displayed_states},
    }
    table = orbit_tables.branch(parameter, [empty], system)
    return table.iloc[:0]


def _ends(system: HybridSystem, parameter: str, stop: Any, back: Any) -> tuple[Any, Any]:
    """Return the two arguments of a continuation as numbers, if they are texts with units."""
    system.check_parameter(parameter)
    ends = {"stop": stop, "back": back}
    stop, back = (system.without_unit(parameter, value, name) for name, value in ends.items())
    return stop, back


def check_bounds(
    system: HybridSystem, parameter: str, stop: float, back: Any
) -> tuple[float, float]:
    """Return the bounds of continuation; InvalidParameter if they leave no interval."""
    system.check_continued(parameter)
    current = system.value(parameter)
    check_value(system, parameter, "stop", stop)
    if stop == current:
        allowed = f"another value than {_amount(system, parameter, current)}, where the orbit is"
        raise InvalidParameter("stop", stop, allowed)
    if back is None:
        back = current
    check_value(system, parameter, "back", back)
    if (back - current) * (stop - current) > 0.0:
        allowed = f"{_amount(system, parameter, current)}, or on the other side of it than stop"
        raise InvalidParameter("back", back, allowed)
    return (stop, back) if stop < back else (back, stop)


def _amount(system: HybridSystem, parameter: str, value: float) -> str:
    return f"{value:g} {system.unit(parameter)}".rstrip()


def checked_range(
    system: HybridSystem, parameter: str, bounds: tuple[float | str, float | str]
) -> tuple[float, float]:
    """Return the bounds of a parameter as numbers, the lower one first."""
    if not isinstance(bounds, tuple | list) or len(bounds) != 2:
        raise InvalidParameter("bounds", bounds, f"the lowest and the highest {parameter}")
    low, high = (system.without_unit(parameter, each, "bounds") for each in bounds)
    for value in (low, high):
        check_value(system, parameter, "bounds", value)
    if not low < high:
        raise InvalidParameter("bounds", (low, high), "a lower and a higher number")
    return float(low), float(high)


def check_value(system: HybridSystem, parameter: str, field: str, value: Any) -> None:
    """Raise InvalidParameter unless the system allows this value of the parameter."""
    if not is_number(value):
        raise InvalidParameter(field, value, f"a finite value of {parameter}")
    system.changed(**{parameter: value})


# --- Curves of special points


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Curve(ContinuationResult):
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
    >>> branch = mi.continue_orbit(orbit, "amplitude", stop=0.17)
    >>> curve = mi.continue_curve(branch.special_points[0], "omega", stop=0.51)
    >>> list(curve.table.columns[:2]), curve.ended
    (['omega', 'amplitude'], 'omega reached its bound')
    """

    system: HybridSystem = field(repr=False)
    kind: str
    label: str
    parameters: tuple[str, str]
    special_points: tuple[CodimensionTwo, ...]
    ended: str
    numeric: OrbitCurve | EquilibriumCurve = field(repr=False)

    @property
    def of(self) -> str:
        """Noun for its points, in the plural."""
        return "equilibria" if isinstance(self.numeric, EquilibriumCurve) else "orbits"

    @cached_property
    def orbits(self) -> tuple[Orbit, ...]:
        """All orbits, in order along the curve; empty for a curve of equilibria."""
        return _orbits_of(self)

    @cached_property
    def equilibria(self) -> tuple[Equilibrium, ...]:
        """All equilibria, in order along the curve; empty for a curve of orbits."""
        if not isinstance(self.numeric, EquilibriumCurve):
            return ()
        return tuple(equilibrium_of(self.system, point) for point in self.numeric.points)

    @cached_property
    def points(self) -> tuple[EquilibriumPoint, ...]:
        """The special points along a curve of equilibria, in the form of the points of a branch.

        Their parameter is the first one; the second one has its value on the curve. `switch_branch`
        takes those of a Hopf curve. Empty for a curve of orbits.
        """
        if not isinstance(self.numeric, EquilibriumCurve):
            return ()
        parameter, (low, high) = self.parameters[0], self.numeric.bounds
        return tuple(
            EquilibriumPoint(
                kind=self.kind,
                label=self.label,
                guard=self.numeric.guard,
                parameter=parameter,
                value=each.system.value(parameter),
                equilibrium=each,
                bounds=(self.system.out(parameter, low), self.system.out(parameter, high)),
                numeric=self.numeric.event(each.numeric),
            )
            for each in self.equilibria
        )

    @property
    def _subject(self) -> str:
        return f"{self.label} over {' and '.join(self.parameters)}"

    @property
    def _subject_rows(self) -> dict[str, Any]:
        names = ", ".join(map(self.system.label, self.parameters))
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

        The columns are as in `Branch.table`, or `EquilibriumBranch.table`.
        """
        first, second = self.parameters
        if isinstance(self.numeric, EquilibriumCurve):
            rows = [
                {
                    "values": [
                        self.system.out(name, state.family.values[name]) for name in (second, first)
                    ],
                    **_measures(self.system, state),
                }
                for state in self.numeric.points
            ]
            return _captioned(orbit_tables.curve([second, first], rows, self.system), self.system)
        rows = [
            {
                "values": [
                    self.system.out(second, point.values[1]),
                    self.system.out(first, point.values[0]),
                ],
                **orbit_row(orbit),
            }
            for point, orbit in zip(self.numeric.points, self.orbits, strict=True)
        ]
        return orbit_tables.curve([second, first], rows, self.system)

    @cached_property
    def special_table(self) -> pd.DataFrame:
        """One row per point of codimension two."""
        first, second = self.parameters
        rows = [
            {
                "kind": s.kind,
                "values": [s.values[second], s.values[first]],
                **(
                    orbit_row(s.solution)
                    if isinstance(s.solution, Orbit)
                    else _measures(self.system, s.solution.numeric)
                ),
            }
            for s in self.special_points
        ]
        return orbit_tables.codimension_two([second, first], rows, self.system, self.table)


def continue_curve(
    special: SpecialPoint | EquilibriumPoint | Orbit,
    parameter: str,
    stop: float,
    *,
    fixed: str | Callable[[Orbit], float] | None = None,
    free: str | None = None,
    back: float | None = None,
    steps: StepControl = StepControl(),  # noqa: B008 - immutable
    progress: bool | Callable[[float], None] = False,
) -> Curve:
    """Continue a special point of a branch in two parameters.

    Points of codimension two on the curve are located and listed. A curve of Neimark-Sacker points
    ends where its pair of multipliers becomes real, at a 1:1 or 1:2 resonance, and a curve of Hopf
    points where its pair of eigenvalues becomes real, at a Bogdanov-Takens point. A branch point
    has a curve if a symmetry or an invariant subspace keeps the branch point; otherwise the branch
    point unfolds.

    Parameters
    ----------
    special : SpecialPoint, EquilibriumPoint or Orbit
        A grazing, fold, period doubling, Neimark-Sacker or branch point, an onset of complete
        chatter (to some 1e-7), a point at which another guard is touched, or an event of
        `continue_orbit`. A fold, Hopf point or boundary equilibrium of a branch of equilibria.
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
        As for `continue_orbit`.

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
    Curve, continue_orbit, plot_curve, operating_chart

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> branch = mi.continue_orbit(orbit, "amplitude", stop=0.17)
    >>> fold = branch.special_points[0]
    >>> curve = mi.continue_curve(fold, "omega", stop=0.51)
    >>> curve.kind, curve.parameters
    ('fold', ('amplitude', 'omega'))

    Orbits with impacts of one speed:

    >>> curve = mi.continue_curve(orbit, "omega", 0.505, fixed="impact speed", free="amplitude")
    >>> bool(abs(curve.table["impact speed"] - max(orbit.impact_speeds)).max() < 1e-9)
    True
    """
    kinds = SpecialPoint | EquilibriumPoint | Orbit
    check_kind(special, "special", kinds, "a special point of a branch, or an Orbit")
    system, start = special.system, None
    if isinstance(special, Orbit):
        first, start = _at_level(special, fixed, free)
        kind = start.kind
    else:
        if fixed is not None or free is not None:
            field, value = ("free", free) if fixed is None else ("fixed", fixed)
            raise InvalidParameter(field, value, "omitted, except for an Orbit")
        first, kind = special.parameter, special.kind
        if isinstance(special, SpecialPoint):
            start = special.without_impact
    if parameter == first:
        raise InvalidParameter(
            "parameter", parameter, "a parameter other than the parameter of the branch"
        )
    if kind == UNEXPLAINED:
        raise InvalidParameter("special", kind, "a point of known kind")
    stop, back = _ends(system, parameter, stop, back)
    bounds = check_bounds(system, parameter, stop, back)
    direction = math.copysign(1.0, stop - system.value(parameter))
    low, high = (system.into(parameter, bound) for bound in bounds)
    noun = "equilibria" if isinstance(special, EquilibriumPoint) else "orbits"
    with parameter_progress(
        progress, system.label(parameter), noun, partial(system.out, parameter)
    ) as report:
        if isinstance(special, EquilibriumPoint):
            found: OrbitCurve | EquilibriumCurve = follow_equilibrium_curve(
                special.equilibrium.numeric,
                EquilibriumCurve(
                    kind,
                    special.guard,
                    (first, parameter),
                    (system.into(first, special.bounds[0]), system.into(first, special.bounds[1])),
                ),
                low=low,
                high=high,
                direction=direction,
                steps=steps,
                progress=report,
            )
        else:
            assert start is not None
            found = follow_curve(
                start,
                first,
                parameter,
                low=low,
                high=high,
                direction=direction,
                steps=steps,
                progress=report,
                problem=BranchPointCurve if kind == BRANCH_POINT else None,
            )
    return curve_of(system, found)


def _at_level(
    orbit: Orbit, fixed: str | Callable[[Orbit], float] | None, free: str | None
) -> tuple[str, BranchEvent]:
    """Return the free parameter, and an orbit as a point at which a quantity has its value."""
    if not isinstance(free, str):
        raise InvalidParameter("free", free, "a parameter that keeps the quantity constant")
    orbit.system.check_continued(free)
    if not (callable(fixed) or isinstance(fixed, str)):
        allowed = "a column of the table of a branch, or a function of the orbit"
        raise InvalidParameter("fixed", fixed, allowed)
    name = fixed if isinstance(fixed, str) else getattr(fixed, "__name__", "quantity")
    column, function = (fixed, None) if isinstance(fixed, str) else ("", fixed)
    quantity = OrbitFunction(name, orbit.system, free, column, 0.0, function)
    if column:
        quantity.check_column(orbit, "fixed")
    level = quantity.of(orbit)
    if not math.isfinite(level):
        raise InvalidParameter("fixed", name, f"a quantity of this orbit, where it is {level}")
    test = FunctionTest(f"{name} = {level:.6g}", replace(quantity, level=level))
    value, still = orbit.numeric.family.values[free], np.zeros(0)
    return free, BranchEvent(test.kind, test.kind, value, orbit.numeric, still, test)


def curve_of(system: HybridSystem, curve: OrbitCurve | EquilibriumCurve) -> Curve:
    """Return a curve of `continuation` as a `Curve` in the system's units."""
    special = tuple(
        CodimensionTwo(
            kind=s.kind,
            values={
                name: system.out(name, value)
                for name, value in zip(curve.parameters, s.values, strict=True)
            },
            solution=equilibrium_of(system, s.equilibrium)
            if isinstance(s, EquilibriumCurveEvent)
            else orbit_of(system, s.orbit),
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


# --- Branches of equilibria

EQUILIBRIUM_STEPS = StepControl(max_step=0.2)
PASSING_RATIO = 2.5  # of the step past a branch point, to the distance of its start


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class EquilibriumBranch(ContinuationResult):
    """Branch of equilibria in one parameter.

    Attributes
    ----------
    system : System
        The system at the start of the branch.
    parameter : str
    bounds : tuple of float
        Smallest and largest value of the parameter.
    special_points : tuple of EquilibriumPoint
        In the order in which the branch passes them.
    ended : str
        Why the branch ends.

    See Also
    --------
    continue_equilibrium, plot_branch

    Examples
    --------
    >>> import mems_impact as mi
    >>> def duffing(mode, t, y, p):
    ...     return y.v, p.a * y.x - y.x**3 - 0.1 * y.v
    >>> well = mi.System(states=("x", "v"), flow=duffing, parameters={"a": 1.0})
    >>> (found,) = mi.find_equilibria(well, guess={"x": 0.9})
    >>> branch = mi.continue_equilibrium(found, "a", stop=-0.2)
    >>> [(point.label, round(point.value, 6) + 0.0) for point in branch.special_points]
    [('BP', 0.0)]
    """

    system: HybridSystem = field(repr=False)
    parameter: str
    bounds: tuple[float, float]
    special_points: tuple[EquilibriumPoint, ...]
    ended: str
    numeric: Equilibria = field(repr=False)

    @property
    def of(self) -> str:
        """Noun for its points, in the plural."""
        return "equilibria"

    @cached_property
    def equilibria(self) -> tuple[Equilibrium, ...]:
        """All equilibria, in order along the branch."""
        return tuple(equilibrium_of(self.system, point) for point in self.numeric.points)

    @cached_property
    def symmetry(self) -> Symmetry | None:
        """The symmetry that maps each half of the branch to the other; else None.

        The halves meet at a branch point, a pitchfork, where the branch breaks the symmetry.
        """
        points = [s.equilibrium for s in self.special_points if s.kind == BRANCH_POINT]
        return symmetry_of_halves(points, self.equilibria, lambda each: each.numeric.balance)

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row per equilibrium: the parameter, stable, admissible, largest real part, states.

        The largest real part of its eigenvalues is per unit of time.
        """
        rows = [
            {"value": self._value(state), **_measures(self.system, state)}
            for state in self.numeric.points
        ]
        return _captioned(orbit_tables.branch(self.parameter, rows, self.system), self.system)

    @cached_property
    def special_table(self) -> pd.DataFrame:
        """One row per special point.

        Columns: label, the parameter, kind, criticality (see `NormalForm`), type (see
        `BoundaryType`), then those of `table`.
        """
        rows = [
            {
                **_names(s),
                "value": s.value,
                **_measures(self.system, s.equilibrium.numeric),
            }
            for s in self.special_points
        ]
        table = orbit_tables.special_points(self.parameter, rows, self.system, self.table)
        return _captioned(table, self.system)

    def _value(self, state: EquilibriumState) -> float:
        return self.system.out(self.parameter, state.family.values[self.parameter])


def continue_equilibrium(
    equilibrium: Equilibrium,
    parameter: str,
    stop: float,
    *,
    back: float | None = None,
    steps: StepControl = EQUILIBRIUM_STEPS,
    events: Events | None = None,
    stop_at: str | Collection[str] = (),
    progress: bool | Callable[[float], None] = False,
) -> EquilibriumBranch:
    """Continue an equilibrium, stable or unstable, in one parameter.

    The branch passes folds. Folds, Hopf points, branch points and boundary equilibria are located
    and listed. Where the number of unstable eigenvalues changes without such a point, an
    "unexplained" point is listed. Beyond a guard the equilibrium is virtual.

    Parameters
    ----------
    equilibrium : Equilibrium
        An isolated equilibrium, from `find_equilibria`.
    parameter : str
    stop : float
        Value towards which the branch starts, and its bound.
    back : float, optional
        Opposite bound, used if the branch folds back; by default the value at its start.
    steps : StepControl, optional
        Step lengths, and the largest number of steps.
    events : mapping of str to callable or (str, float), optional
        Further special points, as for `continue_orbit`; functions of the `Equilibrium`.
    stop_at : str or collection of str, optional
        Labels or kinds of special points, events included: the branch ends at the first such point.
    progress : bool or callable, optional
        True: show a counter after a second. A function is called with each value of the parameter.

    Returns
    -------
    EquilibriumBranch
        ``ended`` holds the reason of its end.

    Raises
    ------
    InvalidParameter
        If an argument is out of range, or the equilibrium belongs to a continuum.
    FunctionError
        If a function of `events` raises, or returns no number, at the first equilibrium.

    See Also
    --------
    find_equilibria, EquilibriumBranch, switch_branch

    Examples
    --------
    >>> import mems_impact as mi
    >>> def duffing(mode, t, y, p):
    ...     return y.v, p.a * y.x - y.x**3 - 0.1 * y.v
    >>> well = mi.System(states=("x", "v"), flow=duffing, parameters={"a": 1.0})
    >>> (found,) = mi.find_equilibria(well, guess={"x": 0.9})
    >>> branch = mi.continue_equilibrium(found, "a", stop=0.2)
    >>> branch.ended
    'a reached its bound'
    """
    check_kind(equilibrium, "equilibrium", Equilibrium, "an Equilibrium, from find_equilibria")
    system = equilibrium.system
    if equilibrium.nullity:
        raise InvalidParameter("equilibrium", equilibrium, "isolated, not one of a continuum")
    stop, back = _ends(system, parameter, stop, back)
    bounds = check_bounds(system, parameter, stop, back)
    tests = _equilibrium_tests(events, equilibrium, parameter)
    stops = _equilibrium_stops(stop_at, tests)
    low, high = (system.into(parameter, bound) for bound in bounds)
    begin = equilibrium.numeric.family.values[parameter]
    with parameter_progress(
        progress, system.label(parameter), "equilibria", partial(system.out, parameter)
    ) as report:
        found = follow_equilibrium(
            equilibrium.numeric,
            parameter,
            low=min(low, begin),
            high=max(high, begin),
            direction=math.copysign(1.0, stop - system.value(parameter)),
            steps=steps,
            functions=tests,
            stop_at=stops,
            progress=report,
        )
    return _equilibrium_branch(system, found, bounds)


def _equilibrium_tests(
    events: Events | None, equilibrium: Equilibrium, parameter: str
) -> tuple[FunctionTest, ...]:
    kinds = {*EQUILIBRIUM_LABELS, *EQUILIBRIUM_LABELS.values()}
    return EquilibriumFunction.tests(events, equilibrium, parameter, kinds)


def _equilibrium_stops(
    stop_at: str | Collection[str], tests: Sequence[FunctionTest]
) -> frozenset[str]:
    return _stops(stop_at, EQUILIBRIUM_LABELS, [test.kind for test in tests])


def _equilibrium_branch(
    system: HybridSystem, branch: Equilibria, bounds: tuple[float, float]
) -> EquilibriumBranch:
    parameter = branch.parameter
    special = tuple(
        EquilibriumPoint(
            kind=s.kind,
            label=s.label,
            guard=s.guard,
            parameter=parameter,
            value=system.out(parameter, s.value),
            equilibrium=equilibrium_of(system, s.equilibrium),
            bounds=bounds,
            numeric=s,
        )
        for s in branch.special_points
    )
    return EquilibriumBranch(
        system=system,
        parameter=parameter,
        bounds=bounds,
        special_points=special,
        ended=branch.ended,
        numeric=branch,
    )


def _measures(system: HybridSystem, state: EquilibriumState) -> dict[str, Any]:
    """Return the row of an equilibrium in tables."""
    y, cyclic = state.state, system.automaton.cyclic
    largest = max(state.eigenvalues.real.tolist(), default=math.nan)
    return {
        "stable": state.stable,
        "admissible": state.admissible,
        "largest real part": largest / system.out("time", 1.0),
        "states": {
            name: np.array([system.out(name, y[i])])
            for i, name in enumerate(system.states)
            if i not in cyclic
        },
    }


def _captioned(table: pd.DataFrame, system: HybridSystem) -> pd.DataFrame:
    """Mark for figures that the states belong to equilibria, not to a section."""
    cyclic = {system.states[i] for i in system.automaton.cyclic}
    table.attrs["states"] = [name for name in system.states if name not in cyclic]
    table.attrs["equilibria"] = True
    return table
