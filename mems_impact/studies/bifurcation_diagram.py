"""Bifurcation diagrams: attractors, their branches, and branches that emanate from these."""

from __future__ import annotations

import math
import os
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from mems_impact import tables as diagram_tables
from mems_impact._util.arrays import Floats
from mems_impact._util.progress import Report, progress_bar
from mems_impact._util.warning_scopes import collected_warnings
from mems_impact.analysis.attractor import (
    SAME_ATTRACTOR_RTOL,
    STUDY_OPTIONS,
    Attractor,
    InitialCondition,
    RecurrenceOptions,
    map_attractors,
    same_attractor,
    span_of,
)
from mems_impact.analysis.branch import (
    BRANCH_STEPS,
    Branch,
    checked_range,
    continue_solution,
    joined_branch,
    no_orbits,
    switch_branch,
)
from mems_impact.analysis.equilibrium import Equilibrium, checked_box, find_equilibria
from mems_impact.analysis.orbit import ORBIT_OPTIONS, Orbit, find_orbit, orbit_of
from mems_impact.analysis.simulate import simulate
from mems_impact.analysis.special_points import SpecialPoint
from mems_impact.continuation.arclength import CLOSED, StepControl
from mems_impact.continuation.branch import EquilibriumBranch, OrbitBranch
from mems_impact.continuation.orbit_identity import (
    covered_period,
    equilibrium_on_branch,
    orbit_on_branch,
    same_orbit,
    up_to_cover,
)
from mems_impact.continuation.test_functions import VANISHING_LENGTH, FoldTest
from mems_impact.errors import (
    Interrupted,
    InvalidFile,
    InvalidParameter,
    MemsImpactError,
    ScaleWarning,
)
from mems_impact.hybrid.definition import PLACEHOLDER_GUARD
from mems_impact.integrators.options import Options
from mems_impact.orbits.equilibrium import EquilibriumState
from mems_impact.orbits.orbit_search import find_cycle, find_periodic_orbit
from mems_impact.studies.engine.store import difference
from mems_impact.studies.engine.study import frame
from mems_impact.studies.sweep import SweepStudy
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.dispatch import takes_system
from mems_impact.systems.result import Result
from mems_impact.systems.serialization.file import load_result
from mems_impact.systems.serialization.identity import (
    identity,
    identity_of_options,
    identity_of_state,
)
from mems_impact.systems.state import State, state_from, whole
from mems_impact.systems.statistics import (
    CHAOTIC,
    FAILED,
    OFF,
    PERIODIC,
    QUASI_PERIODIC,
    RESTING,
    UNSETTLED,
)

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["BifurcationDiagram", "bifurcation_diagram"]

AnyBranch = Branch[Any]
AnyPoint = SpecialPoint[Any]

DIAGRAM_RECURRENCE = RecurrenceOptions(chaos_persistence=1.0)
SAME_VALUE_RTOL = 1e-7  # largest relative difference of the values of one special point
REST_RTOL = 1e-3  # relative range of states at rest
PROBE_POINTS = 12  # orbits of an emanating branch after which it is compared with known branches
SEARCHED_VALUES = 5  # values of the parameter at which Newton's method starts from many states
SEARCHED_PERIODS = 4  # longest period of the orbits that it finds
BOX_MARGIN = 1.2  # size of the box of starting states, in sizes of the states that were visited
BOX_PERIODS = 50  # length of the runs that determine it
CLOUD_PERIODS = 150  # forcing periods drawn of a motion that is not periodic
STORE_INTERVAL = 30.0  # seconds between two savings of a partial result
PARTS = ("attractors", "branches", "other orbits", "cloud")
BRANCH = "branch"
NO_BRANCH = -1


# --- The result


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class BifurcationDiagram(Result):
    """All branches of a system that were found over a parameter, with its attractors.

    Attributes
    ----------
    system : System
    parameter : str
    bounds : tuple of float
    branches : tuple of Branch
        Each once.
    parents : tuple of int or None
        For each branch the number of the branch from which it emanates; None for a branch found
        from an attractor or by a search.
    origins : tuple of SpecialPoint or None
        The special point of the parent at which the branch emanates.
    attractors : DataFrame
        One row per attractor and value: the parameter, motion, period, the number of its branch (-1
        if there is none), Lyapunov exponent, and the last state of the motion.
    cloud : DataFrame
        The attractors on the section, with the columns of `sweep`.
    finished : tuple of str
        The finished parts of the computation: "attractors", "branches", "other orbits", "cloud".
    inputs : dict
        Arguments and system, by which a `store` is recognized.

    See Also
    --------
    bifurcation_diagram, plot_diagram, Branch

    Examples
    --------
    >>> import mems_impact as mi
    >>> def duffing(mode, t, y, p):
    ...     return y.v, p.a * y.x - y.x**3 - 0.1 * y.v
    >>> well = mi.System(states=("x", "v"), flow=duffing, parameters={"a": 1.0})
    >>> diagram = mi.bifurcation_diagram(well, "a", (-1.0, 1.0), values=5, starts=2)
    >>> print(diagram.tree)
    a -1 to 1
    0: equilibria, a -1 to 1, BP 0
    └─ 1: equilibria, a 0 to 1, from BP 0
    """

    system: HybridSystem = field(repr=False)
    parameter: str
    bounds: tuple[float, float]
    branches: tuple[AnyBranch, ...]
    parents: tuple[int | None, ...]
    origins: tuple[AnyPoint | None, ...] = field(repr=False)
    attractors: pd.DataFrame = field(repr=False)
    cloud: pd.DataFrame = field(repr=False)
    finished: tuple[str, ...] = PARTS
    inputs: dict[str, Any] = field(default_factory=dict, repr=False)

    _stored: ClassVar[tuple[str, ...]] = ("table", "special_table")

    @property
    def complete(self) -> bool:
        """Whether the computation finished."""
        return self.finished == PARTS

    def __repr__(self) -> str:
        low, high = self.bounds
        rest = "" if self.complete else ", incomplete"
        return (
            f"BifurcationDiagram({self.parameter} {low:g} to {high:g}, {len(self.branches)} "
            f"branches, {len(self.special_points)} special points{rest})"
        )

    def summary(self) -> dict[str, Any]:
        """Return the parameter and its range, and one entry per branch."""
        low, high = self.bounds
        rows = {f"branch {i}": self._line(i) for i in range(len(self.branches))}
        return {
            "system": repr(self.system),
            self.system.units.label(self.parameter): f"{low:g} to {high:g}",
            **rows,
        }

    @property
    def tree(self) -> str:
        """The branches as text, each below the branch from which it emanates."""
        low, high = self.bounds
        lines = [f"{self.parameter} {low:g} to {high:g}"]

        def add(number: int, indent: str, mark: str, below: str) -> None:
            lines.append(f"{indent}{mark}{number}: {self._line(number)}")
            children = self.children(number)
            for child in children:
                last = child == children[-1]
                add(child, indent + below, "└─ " if last else "├─ ", "   " if last else "│  ")

        for root in self.children(None):
            add(root, "", "", "")
        return "\n".join(lines)

    def children(self, number: int | None) -> tuple[int, ...]:
        """Return the numbers of the branches that emanate from a branch; for None of the roots."""
        return tuple(i for i, parent in enumerate(self.parents) if parent == number)

    def _line(self, number: int) -> str:
        branch, origin = self.branches[number], self.origins[number]
        values = np.append(_values(branch), [s.value for s in branch.special_points])
        low, high = _value_text(values.min()), _value_text(values.max())
        phrases = [_kind(branch), f"{self.parameter} {low} to {high}"]
        if branch.ended.endswith(CLOSED):
            phrases.append("closed")
        phrases += [
            f"{s.label} {_value_text(s.value)}"
            for s in branch.special_points
            if origin is None or not _same_point(s, origin)
        ]
        if origin is not None:
            phrases.append(f"from {origin.label} {_value_text(origin.value)}")
        return ", ".join(phrases)

    @cached_property
    def special_points(self) -> tuple[AnyPoint, ...]:
        """The special points of all branches; a point that two branches share appears once."""
        return tuple(point for _, point in self._distinct)

    @cached_property
    def _distinct(self) -> list[tuple[int, AnyPoint]]:
        points: list[tuple[int, AnyPoint]] = []
        for i, branch in enumerate(self.branches):
            for point in branch.special_points:
                if not any(_same_point(point, other) for _, other in points):
                    points.append((i, point))
        return points

    @cached_property
    def table(self) -> pd.DataFrame:
        """The tables of all branches, one below the other, with the number of the branch."""
        tables = [branch.table for branch in self.branches]
        return _joined(tables or [no_orbits(self.parameter, self.system)])

    @cached_property
    def special_table(self) -> pd.DataFrame:
        """One row per special point, with the number of its branch."""
        displayed = {(i, id(point)) for i, point in self._distinct}
        masks = [
            np.array([(i, id(s)) in displayed for s in branch.special_points], dtype=bool)
            for i, branch in enumerate(self.branches)
        ]
        pairs = zip(self.branches, masks, strict=True)
        tables = [branch.special_table[mask] for branch, mask in pairs]
        like = no_orbits(self.parameter, self.system).drop(columns="piece")
        empty = diagram_tables.special_points(self.parameter, [], self.system, like)
        return _joined(tables or [empty])


def _up_to_cover(branch: AnyBranch) -> AnyBranch:
    """Return a branch up to the point where its orbits become those of a smaller period."""
    if not isinstance(branch.numeric, OrbitBranch):
        return branch
    shortened = up_to_cover(branch.numeric)
    if shortened is branch.numeric:
        return branch
    identities = {id(each) for each in shortened.special_points}
    special = tuple(each for each in branch.special_points if id(each.numeric) in identities)
    return replace(branch, numeric=shortened, special_points=special, ended=shortened.ended)


def _values(branch: AnyBranch) -> Floats:
    """Return the values of the parameter along a branch."""
    return branch.table.iloc[:, 0].to_numpy()


def _value_text(value: float) -> str:
    return f"{value:.6g}" if abs(value) > 1e-12 else "0"


def _kind(branch: AnyBranch) -> str:
    if branch.of == "equilibria":
        return branch.of
    if not branch.system.forced:
        return "cycles"
    return f"period {branch.orbits[0].periods}"


def _joined(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Return tables of branches as one, with the number of the branch after the other columns."""
    import pandas as pd

    numbered = [table.assign(**{BRANCH: i}) for i, table in enumerate(tables)]
    names = dict.fromkeys(name for table in numbered for name in table)
    full = [table for table in numbered if len(table)] or numbered[:1]
    joined = pd.concat(full, ignore_index=True).reindex(columns=list(names))
    joined.insert(len(names) - 1, BRANCH, joined.pop(BRANCH))
    joined.attrs = dict(tables[0].attrs)
    return joined


def _same_point(one: AnyPoint, other: AnyPoint) -> bool:
    """Return whether two special points of branches are the same."""
    a, b = one.solution.numeric, other.solution.numeric
    if one.kind != other.kind or type(a) is not type(b):
        return False
    if abs(one.value - other.value) > SAME_VALUE_RTOL * max(1.0, abs(one.value)):
        return False
    if isinstance(a, EquilibriumState):
        return float(np.abs(a.state - b.state).max(initial=0.0)) < SAME_ATTRACTOR_RTOL
    return same_orbit(a, b, one.parameter) or same_orbit(b, a, one.parameter)


# --- Attractors by runs


@dataclass
class Motion:
    """An attractor at a value of the parameter.

    Attributes
    ----------
    value : float
    attractor : Attractor
    branch : int
        Number of its branch, -1 if it lies on none, or none is known yet.
    """

    value: float
    attractor: Attractor
    branch: int = NO_BRANCH


class AttractorSearch:
    """Search for attractors over a grid of values.

    Each value starts from the last states at its neighbour, upwards and then downwards, and from
    states in a box.

    Parameters
    ----------
    system : System
    parameter : str
    grid : sequence of float
    starts : int
        Number of states per value.
    bounds : mapping of str to (float, float)
        Box of the states; as large as the states that runs visit for those that it omits.
    initial : sequence of State
    recurrence : RecurrenceOptions
    options : Options
    """

    def __init__(
        self,
        system: HybridSystem,
        parameter: str,
        grid: Sequence[float],
        starts: int,
        bounds: Mapping[str, tuple[float, float]],
        initial: Sequence[State],
        recurrence: RecurrenceOptions,
        options: Options,
    ) -> None:
        self.system, self.parameter, self.grid = system, parameter, grid
        self.starts, self.initial = starts, tuple(initial)
        self.recurrence, self.options = recurrence, options
        self._bounds = bounds

    def at(self, value: float) -> HybridSystem:
        """Return the system at a value."""
        return self.system.changed(**{self.parameter: value})

    def motions(self, known: Sequence[Motion], report: Report | None) -> Iterator[list[Motion]]:
        """Yield the attractors found so far, in ascending order of their values.

        At the values of known attractors, no motion starts from states of the box.
        """
        motions: dict[float, list[Motion]] = {value: [] for value in self.grid}
        for motion in known:
            if motion.value in motions:
                motions[motion.value].append(motion)
        begun = {value for value in self.grid if motions[value]}
        carried: list[State] = []
        for up in (True, False):
            for value in self.grid if up else self.grid[::-1]:
                if report is not None:
                    report(0, f"attractors at {self.parameter} = {value:.6g}")
                if not (up and value in begun):
                    fresh = [*self.initial, *self.fresh(value)] if up else []
                    motions[value] = self._distinct(value, [*carried, *fresh], motions[value])
                carried = [
                    m.attractor.final for m in motions[value] if m.attractor.final is not None
                ]
                yield [motion for each in self.grid for motion in motions[each]]

    def fresh(self, value: float, times: int = 0) -> list[State]:
        """Return states of the box that violate no guard, others for each number of `times`."""
        states: list[State] = []
        first = 4 * self.starts * (self.grid.index(value) + times * len(self.grid))
        for number in range(first, first + 4 * self.starts):
            if len(states) == self.starts:
                break
            part = _halton(number, len(self.box))
            values = {
                name: low + share * (high - low)
                for (name, (low, high)), share in zip(self.box.items(), part, strict=True)
            }
            state = state_from({**self.system.initial.as_dict(), **values})
            if self._is_inside(self.at(value), state):
                states.append(state)
        return states

    def _is_inside(self, system: HybridSystem, state: State) -> bool:
        """Return whether no impact is behind a state."""
        try:
            problem = system.problem(self.options)
            start = system.state_space.instant(state, problem)
            numbers = np.array(problem.parameters, dtype=float)
            margins, _ = problem.automaton.margins_at(start.mode, start.time, start.y, numbers)
        except MemsImpactError:
            return False
        guards = problem.automaton.guards
        return not any(
            margin < 0.0 for margin, guard in zip(margins, guards, strict=True) if guard.impact
        )

    @cached_property
    def box(self) -> dict[str, tuple[float, float]]:
        """Bounds of the states from which runs start."""
        system, cyclic = self.system, self.system.automaton.cyclic
        largest = np.zeros(len(system.states))
        length = BOX_PERIODS if system.forced else self.recurrence.transient
        span = span_of(system, length, self.options)
        for value in self.grid[:: max(1, (len(self.grid) - 1) // 2)]:
            for start in self.initial:
                try:
                    run = simulate(self.at(value), **span, initial=start, options=self.options)
                    y = run.trajectory.samples(8).y
                except MemsImpactError:
                    continue
                largest = np.maximum(largest, np.abs(y).max(axis=0))
        box = {}
        for i, name in enumerate(system.states):
            # A system at rest visits no other states.
            size = BOX_MARGIN * abs(float(system.units.out(name, largest[i] or 1.0)))
            if name in self._bounds:
                box[name] = self._bounds[name]
            elif i not in cyclic:
                box[name] = (-size, size)
        return box

    @cached_property
    def _sizes(self) -> dict[str, float]:
        """Sizes of the states that attractors are compared by."""
        return {name: max(map(abs, pair)) for name, pair in self.box.items()}

    def _distinct(
        self, value: float, starts: Sequence[State], known_motions: Sequence[Motion]
    ) -> list[Motion]:
        """Return the attractors at a value, known before or reached from states."""
        system = self.at(value)
        period = system.forcing_period or math.inf
        cases = [
            InitialCondition(system, state if state.time < period else state.replace(time=0.0))
            for state in starts
        ]
        motions = list(known_motions)
        guards = system.automaton.guards
        events = any(guard.name != PLACEHOLDER_GUARD for guard in guards if not guard.records)
        returns = system.forced or system.section is not None or events
        attractors = (
            map_attractors(cases, self.recurrence, self.options)
            if returns
            else [self._without_returns(case) for case in cases]
        )
        for each in attractors:
            if each.motion != FAILED and not any(
                same_attractor(system, each, other.attractor, self._sizes) for other in motions
            ):
                motions.append(Motion(value, each))
        return motions

    def _without_returns(self, case: InitialCondition) -> Attractor:
        """Return the attractor of an autonomous system without guards: at rest, or unsettled."""
        system, length = case.system, self.recurrence.transient + self.recurrence.periods
        try:
            span = span_of(system, length, self.options)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", ScaleWarning)  # a motion that approaches zero
                run = simulate(system, **span, initial=case.initial, options=self.options)
        except MemsImpactError as error:
            return Attractor(motion=FAILED, status=str(error))
        units = [float(system.units.out(name, 1.0)) for name in system.states]
        y = run.trajectory.samples(8).y * units
        late = y[-max(1, round(len(y) * self.recurrence.periods / length)) :]
        free = [i for i in range(len(system.states)) if i not in system.automaton.cyclic]
        moved = np.ptp(late, axis=0) > REST_RTOL * (np.abs(y).max(axis=0) + REST_RTOL)
        extrema = (np.diff(np.sign(np.diff(late, axis=0)), axis=0) != 0.0).sum(axis=0)
        # A monotonic motion approaches rest, however slowly.
        unsettled = bool((moved & (extrema > 1))[free].any())
        return Attractor(
            motion=UNSETTLED if unsettled else RESTING,
            final=run.final,
            states=late if unsettled else late[-1:],
        )


def _halton(number: int, size: int) -> list[float]:
    """Return a point of the Halton sequence."""
    primes = [n for n in range(2, 6 * size + 8) if all(n % k for k in range(2, n))]
    point = []
    for base in primes[:size]:
        share, part, rest = 0.0, 1.0, number + 1
        while rest:
            rest, digit = divmod(rest, base)
            part /= base
            share += digit * part
        point.append(share)
    return point


# --- The construction of a diagram


class DiagramBuilder:
    """Construction of a diagram: attractors, their branches, emanating branches, other orbits.

    Parameters
    ----------
    search : AttractorSearch
    bounds : tuple of float
    depth, longest : int
    steps : StepControl, optional
    options : Options
        For orbits.
    report : callable, optional
    store : str or os.PathLike, optional
        File for partial results.
    inputs : dict
        What the result depends on.
    """

    def __init__(
        self,
        search: AttractorSearch,
        bounds: tuple[float, float],
        depth: int,
        longest: int,
        steps: StepControl | None,
        options: Options,
        report: Report | None,
        store: str | os.PathLike[str] | None,
        inputs: dict[str, Any],
    ) -> None:
        self.search, self.system, self.parameter = search, search.system, search.parameter
        self.bounds, self.depth, self.longest = bounds, depth, longest
        self.steps, self.options = steps, options
        self.report = report
        self.store, self.inputs, self._saved = store, inputs, time.monotonic()
        self.branches: list[AnyBranch] = []
        self.parents: list[int | None] = []
        self.origins: list[AnyPoint | None] = []
        self.motions: list[Motion] = []
        self.cloud: list[pd.DataFrame] = []
        self.finished: tuple[str, ...] = ()

    def resume(self, diagram: BifurcationDiagram) -> None:
        """Take over the branches and attractors of a result, and the parts that it has finished."""
        self.finished = diagram.finished
        self.branches, self.parents = list(diagram.branches), list(diagram.parents)
        self.origins = list(diagram.origins)
        self.motions = motions_of(diagram)
        self.cloud = [diagram_tables.without_units(diagram.cloud)]

    def build(self) -> None:
        """Compute the parts of the diagram that are missing."""
        stages = (self._find_attractors, self._follow, self._search, self._measure)
        for name, compute in zip(PARTS, stages, strict=True):
            if name not in self.finished:
                compute()
                self.finished += (name,)
        self.save()

    def save(self) -> None:
        """Save the diagram as far as it is known, if there is a store."""
        if self.store is not None:
            self.diagram().save(self.store)
            self._saved = time.monotonic()

    def _find_attractors(self) -> None:
        for motions in self.search.motions(self.motions, self._tick):
            self.motions = motions
            self._save_sometimes()

    def _follow(self) -> None:
        """Add the branches of the attractors, with all branches that emanate from them."""
        for number in range(len(self.branches)):
            self._expand(number)
        for motion in sorted(self.motions, key=_simplest_first):
            if motion.branch == NO_BRANCH:
                motion.branch = self._branch_of(motion)

    def _save_sometimes(self) -> None:
        if time.monotonic() - self._saved > STORE_INTERVAL:
            self.save()

    def diagram(self) -> BifurcationDiagram:
        """Return the diagram as far as it is known."""
        return BifurcationDiagram(
            system=self.system,
            parameter=self.parameter,
            bounds=self.bounds,
            branches=tuple(self.branches),
            parents=tuple(self.parents),
            origins=tuple(self.origins),
            attractors=attractor_table(self.system, self.parameter, self.motions),
            cloud=self._cloud_table(),
            finished=self.finished,
            inputs=self.inputs,
        )

    def _tick(self, done: float = 0.0, note: str = "") -> None:
        if self.report is not None:
            self.report(len(self.branches), note)

    # Branches

    def _branch_of(self, motion: Motion) -> int:
        """Return the number of the branch of an attractor, which is continued if it is new."""
        attractor, system = motion.attractor, self.search.at(motion.value)
        start = attractor.final
        if start is None or attractor.motion in (CHAOTIC, QUASI_PERIODIC):
            return NO_BRANCH
        if system.forced:
            if attractor.motion not in (PERIODIC, OFF, RESTING):
                return NO_BRANCH
            with suppress(MemsImpactError):
                periods = max(1, attractor.period)
                return self._add_orbit(
                    find_orbit(system, guess=start, periods=periods, options=self.options)
                )
            return NO_BRANCH
        if attractor.motion != RESTING:
            with suppress(MemsImpactError):
                return self._add_orbit(find_orbit(system, guess=start, options=self.options))
        with suppress(MemsImpactError):
            (rest, *_) = find_equilibria(system, guess=start, modes=[start.mode or 0])
            return self._add_equilibrium(rest)
        return NO_BRANCH

    def _number(self, solution: Orbit | Equilibrium) -> int | None:
        """Return the number of the known branch on which an orbit or equilibrium lies."""
        for i, branch in enumerate(self.branches):
            numeric = branch.numeric
            if isinstance(numeric, OrbitBranch) and isinstance(solution, Orbit):
                on = orbit_on_branch(numeric, solution.numeric)
            elif isinstance(numeric, EquilibriumBranch) and isinstance(solution, Equilibrium):
                on = equilibrium_on_branch(numeric, solution.numeric)
            else:
                continue
            if on:
                return i
        return None

    def _add_orbit(self, orbit: Orbit) -> int:
        """Return the number of the branch of an orbit, which is continued if it is new."""
        point = orbit.numeric.point
        if (np.asarray(point.ends) - np.asarray(point.starts)).min() < VANISHING_LENGTH:
            return NO_BRANCH  # an orbit whose first segment ends at once, in another mode
        number = self._number(orbit)
        return self._add(self._branch_through(orbit)) if number is None else number

    def _add_equilibrium(self, equilibrium: Equilibrium) -> int:
        number = self._number(equilibrium)
        # The step from a start at a special point does not locate the point.
        regular = not equilibrium.nullity and bool(np.all(equilibrium.eigenvalues))
        if number is None and not (regular and equilibrium.admissible):
            return NO_BRANCH
        return self._add(self._branch_through(equilibrium)) if number is None else number

    def _branch_through(self, start: Any) -> Any:
        """Return the branch through an orbit or equilibrium."""
        current, (low, high) = start.system.parameters[self.parameter], self.bounds
        halves: list[Any] = []
        for stop, back in ((high, low), (low, high)):
            if stop == current:
                continue
            inside = min(max(back, low), high)
            through = continue_solution(
                start, self.parameter, stop, back=inside, steps=self.steps, progress=self._passed
            )
            half: Any = _up_to_cover(through)
            halves.append(half)
            if half.ended.endswith(CLOSED):
                return half
        return halves[0] if len(halves) == 1 else joined_branch(halves[1], halves[0])

    def _passed(self, value: float) -> None:
        self._tick(note=f"branch {len(self.branches)} at {self.parameter} = {value:.6g}")

    def _add(
        self, branch: AnyBranch, parent: int | None = None, origin: AnyPoint | None = None
    ) -> int:
        """Append a branch, with all branches that emanate from it, and return its number."""
        number = len(self.branches)
        self.branches.append(branch)
        self.parents.append(parent)
        self.origins.append(origin)
        self._tick()
        self._save_sometimes()
        self._expand(number)
        return number

    def _depth(self, number: int) -> int:
        parent = self.parents[number]
        return 0 if parent is None else 1 + self._depth(parent)

    def _expand(self, number: int) -> None:
        """Add the branches that emanate from a branch."""
        for special in self.branches[number].special_points:
            if special.label not in ("PD", "BP", "H"):
                continue
            if isinstance(special.numeric.monitor, FoldTest):
                if special.label == "PD":
                    self._find_parent(number, special)
                continue
            if self._depth(number) < self.depth and not self._is_explored(number, special):
                self._switch(number, special)

    def _is_explored(self, number: int, special: AnyPoint) -> bool:
        """Return whether a branch that emanates at a point, or crosses there, is known."""
        origins = (each for each in self.origins if each is not None)
        if any(_same_point(special, each) for each in origins):
            return True
        if special.label != "BP":
            return False
        return any(
            _same_point(special, each)
            for i, branch in enumerate(self.branches)
            if i != number
            for each in branch.special_points
        )

    def _switch(self, number: int, special: AnyPoint) -> None:
        """Add the branch that emanates at a special point, unless it is known or too long."""
        if special.label == "PD" and 2 * special.orbit.periods > self.longest:
            return
        bounds = self.bounds
        if not bounds[0] < special.value < bounds[1]:
            return
        steps = self.steps or BRANCH_STEPS
        try:
            probe: Any = switch_branch(
                special,
                bounds=bounds,
                steps=replace(steps, max_points=min(steps.max_points, PROBE_POINTS)),
            )
            child = self._number(probe.solutions[-1])
            if child is not None:
                self._set_parent(child, number, special)
                return
            branch = switch_branch(special, bounds=bounds, steps=self.steps, progress=self._passed)
        except MemsImpactError:
            return
        if special.label != "BP":
            branch = _up_to_cover(branch)
        self._add(branch, number, special)

    def _find_parent(self, number: int, special: AnyPoint) -> None:
        """Add the branch of half the period at which a branch ends."""
        orbit = special.orbit.numeric
        try:
            if special.orbit.system.forced:
                half = find_periodic_orbit(orbit.family, orbit.instant, periods=orbit.periods // 2)
            else:
                half = find_cycle(orbit.family, orbit.instant, period=0.5 * orbit.point.period)
            parent = self._add_orbit(orbit_of(self.system, half))
        except MemsImpactError:
            return
        special_points = self.branches[parent].special_points
        origin = next((each for each in special_points if _same_point(each, special)), None)
        if origin is not None:
            self._set_parent(number, parent, origin)

    def _set_parent(self, child: int, parent: int, origin: AnyPoint) -> None:
        """Record from which branch a root emanates."""
        above: int | None = parent
        while above is not None:
            if above == child:
                return
            above = self.parents[above]
        if self.parents[child] is None and child != parent and origin.label != "BP":
            self.parents[child], self.origins[child] = parent, origin

    # Orbits that no attractor leads to

    def _search(self) -> None:
        """Add orbits and equilibria that Newton's method finds from many states."""
        grid = self.search.grid
        chosen = np.unique(np.linspace(0, len(grid) - 1, SEARCHED_VALUES).round().astype(int))
        for value in (grid[i] for i in chosen.tolist()):
            self._tick(note=f"other orbits at {self.parameter} = {value:.6g}")
            for solution in self._solutions(value):
                if isinstance(solution, Equilibrium):
                    self._add_equilibrium(solution)
                else:
                    self._add_orbit(solution)

    def _solutions(self, value: float) -> Iterator[Orbit | Equilibrium]:
        """Yield the orbits, or equilibria, that Newton's method finds from states of the box."""
        system, search = self.search.at(value), self.search
        if not system.forced:
            samples = max(1, search.starts)
            with suppress(MemsImpactError):
                yield from find_equilibria(system, box=search.box, samples=samples)
            return
        starts = [*search.initial, *search.fresh(value, times=1)]
        for periods in range(1, min(self.longest, SEARCHED_PERIODS) + 1):
            for start in starts:
                with suppress(MemsImpactError):
                    orbit = find_orbit(system, guess=start, periods=periods, options=self.options)
                    covered = covered_period(orbit.numeric)
                    if covered:
                        orbit = find_orbit(
                            system, guess=orbit.state, periods=covered, options=self.options
                        )
                    yield orbit

    # The cloud

    def _measure(self) -> None:
        """Measure the attractors on the section."""
        import pandas as pd

        self.cloud = []
        for motion in self.motions:
            self._tick(note=f"cloud at {self.parameter} = {motion.value:.6g}")
            attractor = motion.attractor
            if attractor.final is None:
                continue
            length: float
            if self.system.forced:
                settled = attractor.motion in (PERIODIC, OFF, RESTING)
                length = max(1, attractor.period) if settled else CLOUD_PERIODS
            else:
                search = self.search
                length = search.recurrence.periods
                length = span_of(search.at(motion.value), length, search.options)["duration"]
            study = self._study(motion.value, attractor.final, length)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # the search for the attractor gave them
                columns, _ = study.compute(0, 1)
            self.cloud.append(pd.DataFrame(columns))

    def _study(self, value: float, start: State, length: float) -> SweepStudy:
        return SweepStudy(
            system=self.system,
            parameter=self.parameter,
            values=(value,),
            starts={"up": start.replace(time=0.0)},
            transient=0,
            length=length,
            section=1,
            options=self.search.options,
        )

    def _cloud_table(self) -> pd.DataFrame:
        import pandas as pd

        study = self._study(self.bounds[0], self.system.initial, 1)
        table = (
            pd.concat(self.cloud, ignore_index=True) if self.cloud else frame([], study.schema, {})
        )
        table.attrs = dict(study.attrs)
        return table


def _simplest_first(motion: Motion) -> tuple[int, float]:
    return motion.attractor.period, motion.value


def attractor_table(
    system: HybridSystem, parameter: str, motions: Iterable[Motion]
) -> pd.DataFrame:
    """Return one row per attractor and value."""
    rows = [(m, m.attractor, m.attractor.final) for m in motions]
    states = {
        name: np.array([math.nan if final is None else final[name] for _, _, final in rows], float)
        for name in system.states
    }
    columns = {
        parameter: np.array([m.value for m, _, _ in rows], dtype=float),
        "motion": diagram_tables.texts(a.motion for _, a, _ in rows),
        "period": np.array([a.period for _, a, _ in rows], dtype=np.int64),
        BRANCH: np.array([m.branch for m, _, _ in rows], dtype=np.int64),
        "exponent": np.array([a.exponent for _, a, _ in rows], dtype=float),
        **states,
        "time": np.array([0.0 if final is None else final.time for _, _, final in rows], float),
        "mode": diagram_tables.texts(
            "" if final is None else str(final.mode or "") for _, _, final in rows
        ),
    }
    return diagram_tables.table({}, system, user_columns=columns)


def motions_of(diagram: BifurcationDiagram) -> list[Motion]:
    """Return the attractors of a diagram."""
    table = diagram_tables.without_units(diagram.attractors)
    motions = []
    for row in table.to_dict("records"):
        values = {name: row[name] for name in diagram.system.states}
        state = state_from(values, row["time"], row["mode"] or None, initial=False)
        attractor = Attractor(
            motion=row["motion"], period=int(row["period"]), final=state, exponent=row["exponent"]
        )
        motions.append(Motion(float(row[diagram.parameter]), attractor, int(row[BRANCH])))
    return motions


# --- The verb


@takes_system(start="initial")
def bifurcation_diagram(
    system: HybridSystem,
    parameter: str,
    bounds: tuple[float, float],
    *,
    depth: int = 4,
    values: int = 61,
    starts: int = 4,
    longest: int = 16,
    box: Mapping[str, tuple[float, float]] | None = None,
    initial: State | Mapping[str, float] | None = None,
    recurrence: RecurrenceOptions = DIAGRAM_RECURRENCE,
    steps: StepControl | None = None,
    options: Options = ORBIT_OPTIONS,
    resume: BifurcationDiagram | None = None,
    store: str | os.PathLike[str] | None = None,
    progress: bool | Callable[[float], None] = False,
) -> BifurcationDiagram:
    """Compute the bifurcation diagram of a system over a parameter.

    Runs find the attractors at a grid of values: each value starts from the last states at its
    neighbours, and from states in a box. The orbit of each attractor is continued both ways,
    through grazings and folds, unless it lies on a known branch. At period doublings, branch points
    and Hopf points the branches that emanate are continued in turn. Newton's method from many
    states finds unstable orbits, of up to four forcing periods, and equilibria on no known branch.

    Parameters
    ----------
    system : System, or Actuator and Drive, or Run
    parameter : str
    bounds : tuple of float
        Range of the parameter: the lowest and the highest value.
    depth : int, optional
        Number of successive switches to emanating branches: 4 reaches the fourth period doubling.
    values : int, optional
        Number of values at which attractors are sought.
    starts : int, optional
        Number of states at each value from which runs start, besides the initial states.
    longest : int, optional
        Longest period of a branch, in forcing periods.
    box : mapping of str to (float, float), optional
        Ranges of these states; by default as large as the states that the system visits.
    initial : State or mapping of str to float, optional
        A further initial state.
    recurrence : RecurrenceOptions, optional
        Recognition of attractors, in the units of an autonomous system.
    steps : StepControl, optional
        Step lengths, and the largest number of points of a branch.
    options : Options, optional
        Of the integration, as for `find_orbit`.
    resume : BifurcationDiagram, optional
        A partial result, which the computation completes, or a complete result, whose branches and
        attractors are then known.
    store : str or os.PathLike, optional
        File in which the diagram is saved while it is computed; an interrupted or killed
        computation resumes from it, and a finished one is loaded.
    progress : bool or callable, optional
        Show progress. A function is called with the number of branches.

    Returns
    -------
    BifurcationDiagram

    Raises
    ------
    InvalidParameter
        If an argument is out of range.
    InvalidFile
        If `store` holds no diagram, or a diagram of other arguments.
    Interrupted
        On Ctrl-C; ``partial`` is the diagram of the finished branches, for `resume`.

    See Also
    --------
    BifurcationDiagram, plot_diagram, continue_solution, switch_branch, sweep

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.2, omega=0.5)
    >>> diagram = mi.bifurcation_diagram(actuator, drive, "amplitude", (0.16, 0.24), values=9)
    >>> print(diagram.tree)
    amplitude 0.16 to 0.24
    0: period 1, amplitude 0.16 to 0.24, G 0.227178, CF 0.176515
    """
    system.checks.continuation(parameter)
    bounds = checked_range(system, parameter, bounds)
    depth, starts = whole("depth", depth, 0), whole("starts", starts, 0)
    values, longest = whole("values", values, 2), whole("longest", longest, 1)
    if not isinstance(recurrence, RecurrenceOptions):
        raise InvalidParameter("recurrence", recurrence, "a RecurrenceOptions(…)")
    box = checked_box(system, box or {})
    runs = replace(STUDY_OPTIONS, engine=options.engine, method=options.method)
    first = [system.state_space.initial("up"), system.state_space.initial("down")]
    if initial is not None:
        first.append(system.state_space.parse(initial))
    first = [each for i, each in enumerate(first) if each not in first[:i]]
    for state in first:
        system.state_space.instant(state, system.problem(runs))
    search = AttractorSearch(
        system,
        parameter,
        np.linspace(*bounds, values).tolist(),
        starts,
        box,
        first,
        replace(recurrence, longest=min(recurrence.longest, longest)),
        runs,
    )
    inputs: dict[str, Any] = {}
    if store is not None:
        inputs = {
            **identity(system),
            "parameter": parameter,
            "range": list(bounds),
            "depth": depth,
            "values": values,
            "starts": starts,
            "longest": longest,
            "box": {name: list(pair) for name, pair in box.items()},
            "initial": [identity_of_state(state) for state in first],
            "recurrence": asdict(recurrence),
            "steps": None if steps is None else asdict(steps),
            "options": identity_of_options(system.problem(options).options),
        }
        resume = _stored(store, system, inputs, resume)
    elif resume is not None:
        _check_resumed(resume, system, parameter, bounds)
        if resume.complete:
            resume = replace(resume, finished=())
    with progress_bar(progress, "branches", work="bifurcation diagram") as report:
        builder = DiagramBuilder(
            search,
            bounds,
            depth,
            longest,
            steps,
            options,
            report,
            store,
            inputs,
        )
        if resume is not None:
            builder.resume(resume)
        try:
            with collected_warnings():
                builder.build()
        except KeyboardInterrupt:
            builder.save()
            diagram = builder.diagram()
            after = f"{len(diagram.branches)} branches"
            raise Interrupted("bifurcation diagram", after, diagram) from None
    return builder.diagram()


def _stored(
    store: str | os.PathLike[str],
    system: HybridSystem,
    inputs: dict[str, Any],
    resume: BifurcationDiagram | None,
) -> BifurcationDiagram | None:
    """Return the diagram in a file; None if there is no file."""
    if resume is not None:
        raise InvalidParameter("resume", resume, "", problem="is not possible with store=")
    if not os.path.exists(store):
        return None
    diagram = load_result(store, system=None if system.is_data_only else system)
    if not isinstance(diagram, BifurcationDiagram):
        raise InvalidFile(store, "holds no bifurcation diagram", "give another file")
    differing = difference(diagram.inputs, inputs)
    if differing:
        problem = f"holds a diagram of other arguments: {differing}"
        raise InvalidFile(store, problem, "give another file for this one")
    return diagram


def _check_resumed(
    resume: BifurcationDiagram, system: HybridSystem, parameter: str, bounds: tuple[float, float]
) -> None:
    if not isinstance(resume, BifurcationDiagram):
        raise InvalidParameter("resume", resume, "a BifurcationDiagram")
    same = resume.system == system and resume.parameter == parameter and resume.bounds == bounds
    if not same:
        problem = "is of another system, parameter or range; omit resume="
        raise InvalidParameter("resume", resume, "", problem=problem)
