"""Construction of bifurcation diagrams."""

from __future__ import annotations

import os
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np
import pandas as pd

from mems_impact import tables as diagram_tables
from mems_impact._util.progress import Report, progress_bar
from mems_impact._util.warning_scopes import collected_warnings
from mems_impact.analysis.attractor import (
    STUDY_OPTIONS,
    Attractor,
    RecurrenceOptions,
    check_recurrence,
    span_of,
)
from mems_impact.analysis.branch import (
    BRANCH_STEPS,
    continue_solution,
    joined_branch,
    switch_branch,
)
from mems_impact.analysis.continuation_range import checked_range
from mems_impact.analysis.equilibrium import Equilibrium, checked_box, find_equilibria
from mems_impact.analysis.orbit import ORBIT_OPTIONS, Orbit, find_orbit, orbit_of
from mems_impact.continuation.arclength import CLOSED, StepControl
from mems_impact.continuation.branch import EquilibriumBranch, OrbitBranch
from mems_impact.continuation.orbit_identity import (
    covered_period,
    equilibrium_on_branch,
    orbit_on_branch,
    up_to_cover,
)
from mems_impact.continuation.test_functions import VANISHING_LENGTH, FoldTest
from mems_impact.errors import Interrupted, InvalidFile, InvalidParameter, MemsImpactError
from mems_impact.integrators.options import Options
from mems_impact.orbits.orbit_search import find_cycle, find_periodic_orbit
from mems_impact.studies.attractor_search import (
    BRANCH,
    NO_BRANCH,
    AttractorSearch,
    Motion,
    attractor_table,
)
from mems_impact.studies.bifurcation_diagram import (
    PARTS,
    AnyBranch,
    AnyPoint,
    BifurcationDiagram,
    same_point,
)
from mems_impact.studies.engine.store import difference
from mems_impact.studies.engine.study import frame
from mems_impact.studies.sweep import SweepStudy
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.dispatch import takes_system
from mems_impact.systems.serialization.file import load_result
from mems_impact.systems.serialization.identity import identity, identity_of_state
from mems_impact.systems.state import State, state_from, whole
from mems_impact.systems.statistics import CHAOTIC, OFF, PERIODIC, QUASI_PERIODIC, RESTING

DIAGRAM_RECURRENCE = RecurrenceOptions(chaos_persistence=1.0)
PROBE_POINTS = 12  # orbits of an emanating branch after which it is compared with known branches
SEARCHED_VALUES = 5  # values of the parameter at which Newton's method starts from many states
SEARCHED_PERIODS = 4  # longest period of the orbits that it finds
CLOUD_PERIODS = 150  # forcing periods drawn of a motion that is not periodic
STORE_INTERVAL = 30.0  # seconds between two savings of a partial result


@dataclass(eq=False)
class DiagramBuilder:
    """Construction of a diagram: attractors, their branches, emanating branches, other orbits."""

    search: AttractorSearch
    bounds: tuple[float, float]
    depth: int
    longest: int
    steps: StepControl | None
    options: Options  # for orbits
    report: Report | None
    store: str | os.PathLike[str] | None  # file of partial results
    inputs: dict[str, Any]  # all that the result depends on

    branches: list[AnyBranch] = field(default_factory=list)
    parents: list[int | None] = field(default_factory=list)
    origins: list[AnyPoint | None] = field(default_factory=list)
    motions: list[Motion] = field(default_factory=list)
    cloud: list[pd.DataFrame] = field(default_factory=list)
    finished: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        self.system, self.parameter = self.search.system, self.search.parameter
        self._saved = time.monotonic()

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
        for motion in sorted(self.motions, key=lambda each: (each.attractor.period, each.value)):
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
        if any(same_point(special, each) for each in origins):
            return True
        if special.label != "BP":
            return False
        return any(
            same_point(special, each)
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
        origin = next((each for each in special_points if same_point(each, special)), None)
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
        study = self._study(self.bounds[0], self.system.initial, 1)
        table = (
            pd.concat(self.cloud, ignore_index=True) if self.cloud else frame([], study.schema, {})
        )
        table.attrs = dict(study.attrs)
        return table


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
    check_recurrence(recurrence)
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
            **identity(system, options),
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
        }
        resume = _stored(store, system, inputs, resume)
    elif resume is not None:
        _check_resumed(resume, system, parameter, bounds)
        if resume.complete:
            resume = replace(resume, finished=())
    with progress_bar(progress, "branches", work="bifurcation diagram") as report:
        builder = DiagramBuilder(
            search, bounds, depth, longest, steps, options, report, store, inputs
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
