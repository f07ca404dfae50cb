"""Branches of orbits and equilibria, and curves of special points, of a system."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar, Generic

import numpy as np

from mems_impact import tables as orbit_tables
from mems_impact._util.arrays import Floats
from mems_impact._util.progress import parameter_progress
from mems_impact._util.warning_scopes import warn
from mems_impact.analysis.equilibrium import Equilibrium, equilibrium_of
from mems_impact.analysis.homoclinic import HomoclinicEnd
from mems_impact.analysis.orbit import Orbit
from mems_impact.analysis.solution import S, Solution, branch_table, row, solution_of
from mems_impact.analysis.special_points import (
    CodimensionTwo,
    SpecialPoint,
    check_kind,
    special_point,
)
from mems_impact.analysis.symmetry import Symmetry, symmetry_of_halves
from mems_impact.analysis.user_test_functions import EventFunction, Events
from mems_impact.continuation.arclength import CLOSED, StepControl
from mems_impact.continuation.branch import (
    EquilibriumBranch,
    EquilibriumCurve,
    EquilibriumEvent,
    OrbitBranch,
    OrbitCurve,
    OrbitEvent,
)
from mems_impact.continuation.branch_switching import switched_solutions
from mems_impact.continuation.branching_equation import ONE_SIDE
from mems_impact.continuation.corners import corners
from mems_impact.continuation.equilibrium_branch import EQUILIBRIUM_LABELS, follow_equilibrium
from mems_impact.continuation.equilibrium_curve import branch_event, follow_equilibrium_curve
from mems_impact.continuation.homoclinic import homoclinic_value, leading
from mems_impact.continuation.orbit_branch import follow
from mems_impact.continuation.orbit_curve import follow_curve
from mems_impact.continuation.test_functions import (
    BRANCH_POINT,
    MEETING,
    ORBIT_LABELS,
    UNEXPLAINED,
    kind_of,
)
from mems_impact.continuation.user_test_functions import FunctionTest
from mems_impact.errors import DiscontinuityWarning, InvalidParameter, OrbitError
from mems_impact.hybrid.definition import PLACEHOLDER_GUARD
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.result import Result
from mems_impact.systems.state import is_number

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "Branch",
    "Curve",
    "continue_curve",
    "continue_solution",
    "curve_of",
    "joined_branch",
    "switch_branch",
]

# --- Branches of solutions

MIN_EXTRAPOLATED = 3  # cycles from which the homoclinic value is extrapolated
BRANCH_STEPS = StepControl(max_step=0.02)  # so that a branch is smooth to the eye
EQUILIBRIUM_STEPS = StepControl(max_step=0.2)


class ContinuationResult(Result, Generic[S]):
    """Base class of results of continuation: a branch in one parameter, by default."""

    system: HybridSystem
    parameter: str
    bounds: tuple[float, float]
    special_points: tuple[Any, ...]
    ended: str
    numeric: Any

    _stored: ClassVar[tuple[str, ...]] = ("table", "special_table")

    @cached_property
    def solutions(self) -> tuple[S, ...]:
        """All orbits or equilibria, in order along the branch or curve."""
        # An orbit is integrated once for its tables, so the orbits of special points are the same.
        special = {id(s.solution.numeric): s.solution for s in self.special_points}
        return tuple(
            special.get(id(point)) or solution_of(self.system, point)
            for point in self.numeric.solutions
        )

    @property
    def orbits(self) -> tuple[Orbit, ...]:
        """All orbits, in order; AttributeError on a branch or curve of equilibria."""
        return self._solutions_of("orbits")

    @property
    def equilibria(self) -> tuple[Equilibrium, ...]:
        """All equilibria, in order; AttributeError on a branch or curve of orbits."""
        return self._solutions_of("equilibria")

    def _solutions_of(self, noun: str) -> tuple[Any, ...]:
        if self.of != noun:
            raise AttributeError(f"{self!r} consists of {self.of}: see its solutions")
        return self.solutions

    @property
    def of(self) -> str:
        """Noun for its solutions, in the plural."""
        return str(self.numeric.noun)

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
        return {self.system.units.label(self.parameter): self._range}

    @property
    def _range(self) -> str:
        low, high = self.bounds
        return f"{low:g} to {high:g}"

    @property
    def _special(self) -> str:
        return ", ".join(f"{s.label} {s.value:.6g}" for s in self.special_points) or "none"


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Branch(ContinuationResult[S]):
    """Branch of periodic orbits or equilibria in one parameter.

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
    continue_solution, plot_branch, SpecialPoint

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> branch = mi.continue_solution(orbit, "amplitude", stop=0.17)
    >>> branch.special_table["label"].tolist()
    ['CF', 'G']
    >>> bool(branch.table["stable"].all())
    False
    """

    system: HybridSystem = field(repr=False)
    parameter: str
    bounds: tuple[float, float]
    special_points: tuple[SpecialPoint[S], ...]
    ended: str
    numeric: OrbitBranch | EquilibriumBranch = field(repr=False)

    @cached_property
    def table(self) -> pd.DataFrame:
        """One row per solution, in order along the branch.

        Columns of orbits: the parameter, stable, admissible, piece (0, 1, …: a new one where an
        impact or another event appears or disappears), the period of limit cycles, largest
        multiplier (its absolute value; inf at a grazing impact), impacts and the largest impact
        speed over the orbit, closest approach, observables, and the states at the upward crossings
        of the section, or at the start of forcing periods, largest first: v2, v2 2, v2 3, …; for a
        cycle without a section their largest values. Columns of equilibria: the parameter, stable,
        admissible, the largest real part of the eigenvalues, per unit of time, and the states.
        """
        points: list[Any] = list(self.numeric.points)
        rows = [
            {
                "value": float(self.system.units.out(self.parameter, point.value)),
                **row(solution, **({"piece": point.piece} if self.of == "orbits" else {})),
            }
            for point, solution in zip(points, self.solutions, strict=True)
        ]
        table = orbit_tables.branch(self.parameter, rows, self.system)
        return branch_table(table, self.system, equilibria=self.of == "equilibria")

    @cached_property
    def special_table(self) -> pd.DataFrame:
        """One row per special point.

        Columns: label, the parameter, kind, criticality (see `NormalForm`), type (see
        `SpecialPoint`), then those of `table` but for the piece.
        """
        rows = [{**_names(s), "value": s.value, **row(s.solution)} for s in self.special_points]
        like = self.table.drop(columns="piece", errors="ignore")
        table = orbit_tables.special_points(self.parameter, rows, self.system, like)
        return branch_table(table, self.system, equilibria=self.of == "equilibria")

    @cached_property
    def symmetry(self) -> Symmetry | None:
        """The symmetry that maps each half of the branch to the other; else None.

        The halves meet at a branch point, a pitchfork, where the branch breaks the symmetry.
        """
        points = [s.solution for s in self.special_points if s.kind == BRANCH_POINT]
        return symmetry_of_halves(points, self.solutions)

    @cached_property
    def homoclinic(self) -> HomoclinicEnd | None:
        """The homoclinic orbit that the last limit cycle approaches, if the branch ends there."""
        numeric = self.numeric
        return _homoclinic_end(self.system, numeric) if isinstance(numeric, OrbitBranch) else None


def continue_solution(
    solution: S,
    parameter: str,
    stop: float,
    *,
    back: float | str | None = None,
    steps: StepControl | None = None,
    through_grazing: bool = True,
    events: Events | None = None,
    stop_at: str | Collection[str] = (),
    progress: bool | Callable[[float], None] = False,
) -> Branch[S]:
    """Continue a periodic orbit or an equilibrium, stable or unstable, in one parameter.

    Folds, grazings and period doublings of orbits, folds, Hopf points and boundary equilibria, and
    branch points are located and listed. Where the number of unstable multipliers or eigenvalues
    changes without such a point, an "unexplained" point is listed. Beyond a guard an equilibrium is
    virtual.

    Parameters
    ----------
    solution : Orbit or Equilibrium
        An orbit, or an isolated equilibrium.
    parameter : str
        A parameter of the drive (``"amplitude"``, ``"omega"``, …), of the actuator or of the
        system.
    stop : float
        Value towards which the branch starts, and its bound.
    back : float, optional
        Opposite bound, used if the branch folds back; by default the value at its start.
    steps : StepControl, optional
        Step lengths, and the largest number of steps. By default steps of orbits are at most 0.02,
        steps of equilibria 0.2.
    through_grazing : bool, optional
        Whether to continue at a grazing with the orbit that has one impact more or fewer. Otherwise
        the branch continues with orbits that penetrate the stopper or impact backwards, marked as
        inadmissible.
    events : mapping of str to callable or (str, float), optional
        Further special points by name: the zeros of a function of the solution, or a column of the
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
        If an argument is out of range, the parameter cannot have the value `stop`, or the
        equilibrium belongs to a continuum.
    FunctionError
        If a function of `events` raises, or returns no number, at the first solution; a later
        failure ends the branch.

    See Also
    --------
    Branch, find_orbit, find_equilibria, switch_branch, continue_curve, sweep

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> orbit = mi.find_orbit(actuator, drive, transient=300, guess=mi.kicked_state(actuator))
    >>> branch = mi.continue_solution(orbit, "amplitude", stop=0.17)
    >>> [(special.label, round(special.value, 7)) for special in branch.special_points]
    [('CF', 0.1765154), ('G', 0.2271776)]
    >>> branch.ended
    'amplitude reached its bound'
    >>> events = {"weak": ("impact speed", 0.15)}
    >>> weak = mi.continue_solution(orbit, "amplitude", 0.23, events=events, stop_at="weak")
    >>> [special.label for special in weak.special_points], weak.ended
    (['weak'], 'the branch stops at weak')

    Equilibria:

    >>> def duffing(mode, t, y, p):
    ...     return y.v, p.a * y.x - y.x**3 - 0.1 * y.v
    >>> well = mi.System(states=("x", "v"), flow=duffing, parameters={"a": 1.0})
    >>> (found,) = mi.find_equilibria(well, guess={"x": 0.9})
    >>> branch = mi.continue_solution(found, "a", stop=-0.2)
    >>> [(point.label, round(point.value, 6) + 0.0) for point in branch.special_points]
    [('BP', 0.0)]
    """
    kinds = "an Orbit or an Equilibrium, from find_orbit or find_equilibria"
    check_kind(solution, "solution", Orbit | Equilibrium, kinds)
    if isinstance(solution, Equilibrium) and solution.nullity:
        raise InvalidParameter("solution", solution, "isolated, not one of a continuum")
    system = solution.system
    stop, back = _ends(system, parameter, stop, back)
    bounds = check_bounds(system, parameter, stop, back)
    followed = _follower(solution, parameter, bounds, through_grazing, events, stop_at, progress)
    steps = steps or _steps(solution)
    with followed as follow_side:
        side = math.copysign(1.0, stop - system.parameters[parameter])
        return _branch(system, follow_side(solution.numeric, side, steps), bounds)


def _steps(solution: Solution) -> StepControl:
    return EQUILIBRIUM_STEPS if isinstance(solution, Equilibrium) else BRANCH_STEPS


@contextmanager
def _follower(
    start: Solution,
    parameter: str,
    bounds: tuple[float, float],
    through_grazing: bool,
    events: Events | None,
    stop_at: str | Collection[str],
    progress: bool | Callable[[float], None],
) -> Iterator[Callable[[Any, float | Floats, StepControl], OrbitBranch | EquilibriumBranch]]:
    """Yield a function that continues a solution in a direction, with one display of progress.

    The solution is one of `continuation`, of the kind of `start`.
    """
    system = start.system
    names: list[str] = []
    if isinstance(start, Orbit):
        labels, noun = ORBIT_LABELS, "orbits"
        follow_start: Any = partial(follow, reconnecting=through_grazing)
        guards = [each for each in system.automaton.guards if each.name != PLACEHOLDER_GUARD]
        names = [MEETING, *(name for each in guards for name in (each.name, kind_of(each)))]
    else:
        labels, noun, follow_start = EQUILIBRIUM_LABELS, "equilibria", follow_equilibrium
    kinds = {*labels, *labels.values(), *names}
    tests = EventFunction.tests(events, start, parameter, kinds)
    stops = _stops(stop_at, labels, [*names, *(test.kind for test in tests)])
    low, high = (system.units.into(parameter, bound) for bound in bounds)
    amount = partial(system.units.out, parameter)
    with parameter_progress(progress, system.units.label(parameter), noun, amount) as report:

        def followed(
            solution: Any, direction: float | Floats, steps: StepControl
        ) -> OrbitBranch | EquilibriumBranch:
            # The parameter at the start of the branch, to the last digit of the numerics.
            begin = solution.family.values[parameter]
            branch: OrbitBranch | EquilibriumBranch = follow_start(
                solution,
                parameter,
                low=min(low, begin),
                high=max(high, begin),
                direction=direction,
                steps=steps,
                functions=tests,
                stop_at=stops,
                progress=report,
            )
            return branch

        yield followed


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


def switch_branch(
    special: SpecialPoint[Any],
    *,
    bounds: tuple[float, float] | None = None,
    steps: StepControl | None = None,
    through_grazing: bool = True,
    events: Events | None = None,
    stop_at: str | Collection[str] = (),
    progress: bool | Callable[[float], None] = False,
) -> Branch[Any]:
    """Switch to the branch that emanates from a period doubling, Hopf point or branch point.

    At a branch point, the branch that crosses is continued on both sides of the point: at a
    pitchfork, both halves with the branch point between them.

    Parameters
    ----------
    special : SpecialPoint
        A period doubling or branch point of a branch of orbits, or a Hopf point or branch point of
        a branch of equilibria.
    bounds : tuple of float, optional
        Smallest and largest value of the parameter; by default the values of the branch.
    steps : StepControl, optional
        As for `continue_solution`. The largest number of steps is for each side.
    through_grazing
        As for `continue_solution`.
    events, stop_at
        As for `continue_solution`. A branch through a branch point ends at the first such point on
        each side.
    progress
        As for `continue_solution`.

    Returns
    -------
    Branch
        Equilibria at a branch point of equilibria; else orbits.

    Raises
    ------
    InvalidParameter
        If `special` is none of these.
    OrbitError
        If no orbit of the branch is found.

    See Also
    --------
    continue_solution, SpecialPoint

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.29, omega=0.45)
    >>> orbit = mi.find_orbit(actuator, drive, guess=mi.kicked_state(actuator), transient=300)
    >>> branch = mi.continue_solution(orbit, "amplitude", stop=0.25)
    >>> (doubling,) = [special for special in branch.special_points if special.label == "PD"]
    >>> twice = mi.switch_branch(doubling, bounds=(0.26, 0.29))
    >>> twice.orbits[1].periods / orbit.periods
    2.0

    Both halves of a pitchfork:

    >>> def duffing(mode, t, y, p):
    ...     return y.v, p.a * y.x - y.x**3 - 0.1 * y.v
    >>> well = mi.System(states=("x", "v"), flow=duffing, parameters={"a": -1.0})
    >>> (rest,) = mi.find_equilibria(well, guess={"x": 0.0})
    >>> (fork,) = mi.continue_solution(rest, "a", stop=1.0).special_points
    >>> halves = mi.switch_branch(fork)
    >>> [round(halves.equilibria[i].state.x, 6) for i in (0, -1)]
    [1.0, -1.0]
    """
    check_kind(special, "special", SpecialPoint, "a special point of a branch")
    if special.label not in ("PD", "H", "BP"):
        allowed = "a period doubling, a Hopf point or a branch point"
        raise InvalidParameter("special", special.kind, allowed)
    parameter, system = special.parameter, special.system
    low, high = checked_range(system, parameter, special.bounds if bounds is None else bounds)
    if not low < special.value < high:
        location = _amount(system, parameter, special.value)
        allowed = f"smallest and largest value, with {location} between them"
        raise InvalidParameter("bounds", (low, high), allowed)
    limits = system.units.into(parameter, low), system.units.into(parameter, high)
    starts, event = switched_solutions(special.numeric, parameter, *limits)
    start = solution_of(system, starts[0][0])
    sides: list[Branch[Any]] = []
    with _follower(
        start, parameter, (low, high), through_grazing, events, stop_at, progress
    ) as followed:
        for numeric, onward in starts:
            side = followed(numeric, onward, steps or _steps(start))
            sides.append(_branch(system, side, (low, high)))
            if event is None or side.ended.endswith(CLOSED):
                return sides[-1]
    if len(sides) == 1:
        sides.append(_branch(system, type(side)(parameter, ended=ONE_SIDE), (low, high)))
    return joined_branch(sides[0], sides[1], event)


def joined_branch(
    outward: Branch[S], inward: Branch[S], at: OrbitEvent | EquilibriumEvent | None = None
) -> Branch[S]:
    """Return one branch of two from the same point in opposite directions.

    The halves may start on the two sides of a special point.
    """
    numeric = outward.numeric.joined(inward.numeric, at)  # type: ignore[arg-type]
    system, parameter, bounds = outward.system, outward.parameter, outward.bounds
    between = [] if at is None else [special_point(system, parameter, at, bounds, None)]
    return replace(
        outward,
        special_points=(*outward.special_points[::-1], *between, *inward.special_points),
        ended=numeric.ended,
        numeric=numeric,
    )


def _branch(
    system: HybridSystem, branch: OrbitBranch | EquilibriumBranch, bounds: tuple[float, float]
) -> Branch[Any]:
    parameter, ended = branch.parameter, branch.ended
    solutions = branch.solutions
    after = {id(one): following for one, following in pairwise(solutions)}
    special = tuple(
        special_point(system, parameter, event, bounds, after.get(id(event.solution)))
        for event in branch.special_points
    )
    if isinstance(branch, OrbitBranch):
        warn_of_corners(system, branch)
        ended = ended if branch.passage is None else _beyond_bounds(system, branch)
    return Branch(
        system=system,
        parameter=parameter,
        bounds=bounds,
        special_points=special,
        ended=ended,
        numeric=branch,
    )


def warn_of_corners(system: HybridSystem, branch: OrbitBranch) -> None:
    """Warn of each transition that is not smooth on a branch, which no test function shows."""
    guards, parameter, names = system.automaton.guards, branch.parameter, set()
    for corner in corners(branch.solutions, parameter):
        is_switch = corner.code == system.automaton.switch_code
        name = "switch_transition" if is_switch else (
            f"the transition of {guards[corner.code % len(guards)].name!r}")  # fmt: skip
        of_user = is_switch or guards[corner.code % len(guards)].name in system.checks.transitions
        if name in names or not of_user:
            continue
        names.add(name)
        at = ", ".join(
            f"{system.units.label(state)} = {float(system.units.out(state, value)):.6g}"
            for state, value in zip(system.states, corner.y.tolist(), strict=True)
        )
        message = (
            f"{name} is not smooth near {at}, which the branch meets near {parameter} = "
            f"{system.units.out(parameter, corner.value):.6g}: no special point is located there; "
            "let each path of the function be a mode of its own, with a guard between them"
        )
        warn(message, DiscontinuityWarning)


def _beyond_bounds(system: HybridSystem, branch: OrbitBranch) -> str:
    """Return that the period of cycles diverges, and the state at which they are slow."""
    passage = branch.passage
    assert passage is not None
    shortest, last = (f"{system.units.out('time', period):.4g}" for period in passage.periods)
    location = ", ".join(
        f"{system.units.label(name)} = {system.units.out(name, value):.4g}"
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
    values = np.array([system.units.out(branch.parameter, point.value) for point in branch.points])
    periods = np.array([point.solution.point.period for point in branch.points])
    rate = min(abs(float(each[0].real)) for each in pair)
    value, error = homoclinic_value(values, periods / passage.passages, rate)
    return HomoclinicEnd(
        parameter=branch.parameter,
        value=value,
        error=error,
        saddle=equilibrium_of(system, saddle),
    )


def _names(special: SpecialPoint[Any]) -> dict[str, str]:
    """Return the name of a special point, for its row in tables."""
    names = ("label", "kind", "criticality")
    return {**{name: getattr(special, name) for name in names}, "type": _type_name(special)}


def _type_name(special: SpecialPoint[Any]) -> str:
    try:
        return str(special.type or "")
    except OrbitError:
        return ""


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
        "states": {name: [math.nan] for name in system.state_space.displayed},
    }
    table = orbit_tables.branch(parameter, [empty], system)
    return table.iloc[:0]


def _ends(system: HybridSystem, parameter: str, stop: Any, back: Any) -> tuple[Any, Any]:
    """Return the two arguments of a continuation as numbers, if they are texts with units."""
    system.check_parameter(parameter)
    ends = {"stop": stop, "back": back}
    stop, back = (system.units.parse(parameter, value, name) for name, value in ends.items())
    return stop, back


def check_bounds(
    system: HybridSystem, parameter: str, stop: float, back: Any
) -> tuple[float, float]:
    """Return the bounds of continuation; InvalidParameter if they leave no interval."""
    system.checks.continuation(parameter)
    current = system.parameters[parameter]
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
    return f"{value:g} {system.units.get(parameter, '')}".rstrip()


def checked_range(
    system: HybridSystem, parameter: str, bounds: tuple[float | str, float | str]
) -> tuple[float, float]:
    """Return the bounds of a parameter as numbers, the lower one first."""
    if not isinstance(bounds, tuple | list) or len(bounds) != 2:
        raise InvalidParameter("bounds", bounds, f"the lowest and the highest {parameter}")
    low, high = (system.units.parse(parameter, each, "bounds") for each in bounds)
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
    stop, back = _ends(system, parameter, stop, back)
    bounds = check_bounds(system, parameter, stop, back)
    direction = math.copysign(1.0, stop - system.parameters[parameter])
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
