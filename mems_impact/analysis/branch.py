"""Branches of orbits and equilibria, of a system."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from mems_impact import tables as orbit_tables
from mems_impact._util.arrays import Floats
from mems_impact._util.progress import parameter_progress
from mems_impact._util.warning_scopes import warn
from mems_impact.analysis.continuation_range import amount, checked_ends, checked_range
from mems_impact.analysis.continuation_result import ContinuationResult
from mems_impact.analysis.equilibrium import Equilibrium, equilibrium_of
from mems_impact.analysis.homoclinic import HomoclinicEnd
from mems_impact.analysis.orbit import Orbit
from mems_impact.analysis.solution import S, Solution, branch_table, row, solution_of
from mems_impact.analysis.special_points import SpecialPoint, special_point
from mems_impact.analysis.symmetry import Symmetry, symmetry_of_halves
from mems_impact.analysis.user_test_functions import EventFunction, Events
from mems_impact.continuation.arclength import CLOSED, StepControl
from mems_impact.continuation.branch import (
    EquilibriumBranch,
    EquilibriumEvent,
    OrbitBranch,
    OrbitEvent,
)
from mems_impact.continuation.branch_switching import switched_solutions
from mems_impact.continuation.branching_equation import ONE_SIDE
from mems_impact.continuation.corners import corners
from mems_impact.continuation.equilibrium_branch import EQUILIBRIUM_LABELS, follow_equilibrium
from mems_impact.continuation.homoclinic import homoclinic_value, leading
from mems_impact.continuation.orbit_branch import follow
from mems_impact.continuation.test_functions import BRANCH_POINT, MEETING, ORBIT_LABELS, kind_of
from mems_impact.errors import DiscontinuityWarning, InvalidParameter, OrbitError
from mems_impact.hybrid.definition import PLACEHOLDER_GUARD
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.result import check_kind

if TYPE_CHECKING:
    import pandas as pd

MIN_EXTRAPOLATED = 3  # cycles from which the homoclinic value is extrapolated
BRANCH_STEPS = StepControl(max_step=0.02)  # so that a branch is smooth to the eye
EQUILIBRIUM_STEPS = StepControl(max_step=0.2)


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
    bounds, side = checked_ends(solution.system, parameter, stop, back)
    followed = _follower(solution, parameter, bounds, through_grazing, events, stop_at, progress)
    with followed as follow_side:
        branch = follow_side(solution.numeric, side, steps or _steps(solution))
        return _branch(solution.system, branch, bounds)


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
        location = amount(system, parameter, special.value)
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
        parameter=branch.parameter, value=value, error=error, saddle=equilibrium_of(system, saddle)
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
