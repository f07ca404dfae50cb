"""Edge states: saddles on the boundary between two basins of attraction, by edge tracking.

Bisection between two initial states finds two states on either side of the boundary. Both states
follow the boundary until they have separated; bisection between them then brings them together
again. Skufca, Yorke and Eckhardt, *Physical Review Letters* 96, 174101 (2006).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from mems_impact.analysis.attractor import (
    SAME_ATTRACTOR_RTOL,
    Attractor,
    InitialCondition,
    RecurrenceOptions,
    check_recurrence,
    map_attractors,
    same_attractor,
    states_at_returns,
)
from mems_impact.analysis.equilibrium import Equilibrium, find_equilibria
from mems_impact.analysis.orbit import ORBIT_OPTIONS, Orbit, find_orbit
from mems_impact.errors import InvalidParameter, OrbitError, RunError
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.hybrid.variational.derivatives import free_components
from mems_impact.integrators.options import Options
from mems_impact.systems.base import HybridSystem
from mems_impact.systems.dispatch import takes_system
from mems_impact.systems.result import Result
from mems_impact.systems.state import State, positive, whole
from mems_impact.systems.statistics import FAILED, UNSETTLED
from mems_impact.tables import captions
from mems_impact.tables import table as labelled

if TYPE_CHECKING:
    import pandas as pd

MAX_BISECTIONS = 80
MAX_CONTINUATIONS = 16  # runs of a motion that does not settle
ORBIT_RTOL = 1e-2  # distance from the last state at which an orbit is the edge state
MAX_PERIOD = 16  # returns over which an edge state may be periodic
PERTURBATION = 1e-4  # of the way to an attractor, to which another is stable and a saddle not
OTHER, UNCLEAR = 2, 3  # in place of the number of a known attractor


@dataclass(frozen=True, kw_only=True, eq=False)
class EdgeState(Result):
    """The edge state between two attractors.

    Attributes
    ----------
    system : System
    state : State
        The last state on the boundary.
    settled : bool
        Whether the motion along the boundary is periodic or at rest within `tolerance`.
    orbit : Orbit or Equilibrium or None
        The saddle, found from the last state by Newton's method; None if no saddle is near, as on a
        chaotic edge state.
    attractors : tuple of State
        A state of either attractor.
    table : DataFrame
        One row per return: ``return``, the states on the boundary, and ``distance`` of the two
        states that enclose it.

    See Also
    --------
    edge_state, manifold, basins

    Examples
    --------
    >>> import mems_impact as mi
    >>> def well(mode, t, y, p):
    ...     return y.v, y.x - y.x**3 - 0.5 * y.v
    >>> system = mi.System(states=("x", "v"), flow=well)
    >>> found = mi.edge_state(system, {"x": 1.0, "v": 0.3}, {"x": -1.0})
    >>> found.settled, [f"{abs(value):.6f}" for value in found.orbit.state.as_dict().values()]
    (True, ['0.000000', '0.000000'])
    """

    system: HybridSystem = field(repr=False)
    state: State
    settled: bool
    orbit: Orbit | Equilibrium | None = field(repr=False)
    attractors: tuple[State, State] = field(repr=False)
    table: pd.DataFrame = field(repr=False)

    def __repr__(self) -> str:
        kind = "settled" if self.settled else "not settled"
        return f"EdgeState({self.state}, {kind} after {len(self.table)} returns)"

    def summary(self) -> dict[str, Any]:
        """Return the state, and the saddle."""
        return {
            "system": repr(self.system),
            "state": repr(self.state),
            "settled": self.settled,
            "returns": len(self.table),
            "saddle": repr(self.orbit),
        }


@dataclass(eq=False)
class _Tracking:
    """Edge tracking: two states that enclose the boundary, in the units of the numerics."""

    system: HybridSystem
    recurrence: RecurrenceOptions
    options: Options
    problem: Problem
    step: float
    min_distance: float
    max_distance: float
    tolerance: float
    known: list[Attractor] = field(default_factory=list)

    @cached_property
    def free(self) -> list[int]:
        """The components that are not cyclic."""
        return list(free_components(self.problem.automaton))

    def attractor(self, start: HybridState) -> Attractor:
        """Return the attractor that a state reaches.

        Raises OrbitError if its run fails.
        """
        case = InitialCondition(self.system, self.system.state_space.state(start))
        (attractor,) = map_attractors([case], self.recurrence, self.options)
        if attractor.motion == FAILED:
            raise OrbitError(
                f"the run from a state between the two fails: {attractor.status}",
                "take initial states closer to the boundary",
            )
        return attractor

    def reached(self, start: HybridState) -> tuple[int, Attractor]:
        """Return the attractor that a state reaches, and its number among the known.

        The number is `OTHER` for another attractor, and `UNCLEAR` for a motion that stays beside
        the edge state. A motion beside the boundary begins slowly, so a motion that has not settled
        is continued; so is a motion that a perturbation ends, since the motion is not on an
        attractor.
        """
        attractor = self.attractor(start)
        for _ in range(MAX_CONTINUATIONS):
            same = (i for i, each in enumerate(self.known) if self.is_same(attractor, each))
            number = next(same, OTHER)
            is_first = not self.known
            has_settled = attractor.motion != UNSETTLED
            if number != OTHER or attractor.final is None or (is_first and has_settled):
                return number, attractor
            last = self.system.state_space.instant(attractor.final, self.problem)
            if has_settled:
                first = self.system.state_space.instant(self.known[0].final, self.problem)
                moved = self.between(last, first, PERTURBATION)
                if self.is_same(self.attractor(moved), attractor):
                    return OTHER, attractor
            attractor = self.attractor(last)
        return OTHER if attractor.motion == UNSETTLED else UNCLEAR, attractor

    def on_attractor(self, rows: list[HybridState], period: int) -> bool:
        """Return whether the last states belong to a known attractor, periodic or at rest."""
        last = rows[-(period or MAX_PERIOD) :]
        names = self.system.states
        y = np.array(
            [[self.system.state_space.state(each)[name] for name in names] for each in last]
        )
        for each in self.known:
            if each.motion != UNSETTLED:
                states = states_at_returns(self.system, each)
                distances = np.abs(y[:, None] - states)[..., self.free]
                size = SAME_ATTRACTOR_RTOL * np.maximum(
                    np.abs(states).max(axis=0)[self.free], 1e-300
                )
                if (distances <= size).all(axis=2).any(axis=1).all():
                    return True
        return False

    def is_same(self, one: Attractor, other: Attractor) -> bool:
        """Return whether two motions, of one kind and period, have the same attractor."""
        if (one.motion, one.period) != (other.motion, other.period):
            return False
        visited = [states_at_returns(self.system, each) for each in (one, other)]
        largest = np.abs(np.concatenate(visited)).max(axis=0)
        least = 1e3 * self.options.atol / self.options.rtol
        names = {i: self.system.states[i] for i in self.free}
        sizes = {
            name: max(float(largest[i]), float(self.system.units.out(name, least)))
            for i, name in names.items()
        }
        return same_attractor(self.system, one, other, sizes)

    def distance(self, one: HybridState, other: HybridState) -> float:
        """Return the distance of two states."""
        return float(np.linalg.norm((one.y - other.y)[self.free]))

    def between(self, one: HybridState, other: HybridState, part: float = 0.5) -> HybridState:
        """Return the state at a part of the way, half by default, in a mode that it has."""
        y, mode = (1.0 - part) * one.y + part * other.y, one.mode
        if len(self.problem.automaton.modes) > 1 and not (
            one.mode == other.mode and self.system.state_space.fits(mode, y, self.problem)
        ):
            mode = self.system.state_space.mode_of(y, one.time, self.problem, mode)
        return replace(one, mode=mode, y=y)

    def bisect(self, one: HybridState, other: HybridState) -> tuple[HybridState, HybridState]:
        """Return two states within a distance of each other that reach different attractors."""
        for _ in range(MAX_BISECTIONS):
            if self.distance(one, other) <= self.min_distance:
                break
            middle = self.between(one, other)
            side, attractor = self.reached(middle)
            if side == 0:
                one = middle
            else:
                other = middle
                if side == OTHER:
                    self.known[1] = attractor
        return one, other

    def advance(self, at: HybridState) -> HybridState:
        """Return a state one return, or one time step, later."""
        final = run(self.problem, at, self.step).final
        return replace(final, cycle=0, time=at.time, remembered=(), switched=False)

    def follow(
        self, one: HybridState, other: HybridState, returns: int
    ) -> tuple[list[HybridState], list[float], int]:
        """Return states on the boundary, their distances, and the returns of its period.

        The last is 0 if the motion has no period.
        """
        one, other = self.bisect(one, other)
        rows, distances = [self.between(one, other)], [self.distance(one, other)]
        period = 0
        while not period and len(rows) <= returns:
            try:
                one, other = self.advance(one), self.advance(other)
            except RunError as error:
                raise OrbitError(
                    f"a run along the boundary fails: {error}", "take other initial states"
                ) from error
            if self.distance(one, other) > self.max_distance:
                one, other = self.bisect(one, other)
            rows.append(self.between(one, other))
            distances.append(self.distance(one, other))
            period = self._period(rows, distances[-1])
        if self.on_attractor(rows, period):
            raise OrbitError(
                f"the motion has left the boundary after {len(rows)} returns, since integration "
                f"errors exceed the distance {self.min_distance:g} of the enclosing states",
                "lower rtol and atol of options, or raise min_distance",
            )
        return rows, distances, period

    def _period(self, rows: list[HybridState], distance: float) -> int:
        """Return after how many returns the last state has come back, twice; 0 if it has not."""
        largest = max(float(np.abs(each.y[self.free]).max()) for each in rows[-MAX_PERIOD:])
        limit = max(self.tolerance * max(1e-3, largest), 4.0 * distance)
        for period in range(1, min(MAX_PERIOD, (len(rows) - 1) // 2) + 1):
            gaps = [self.distance(rows[-1 - i], rows[-1 - i - period]) for i in range(period + 1)]
            last, gain = gaps[0], gaps[-1] - gaps[0]
            # The remaining distance, of a geometric sequence, unless the changes are errors.
            is_near = last <= 4.0 * distance or last * last <= limit * gain
            if max(gaps) <= limit and is_near:
                return period
        return 0


@takes_system(start="first")
def edge_state(
    system: HybridSystem,
    first: State | Mapping[str, float],
    second: State | Mapping[str, float],
    *,
    returns: int = 500,
    min_distance: float = 1e-8,
    max_distance: float = 1e-5,
    tolerance: float = 1e-6,
    step: float | None = None,
    recurrence: RecurrenceOptions = RecurrenceOptions(exponents="none"),  # noqa: B008 - immutable
    options: Options = ORBIT_OPTIONS,
) -> EdgeState:
    """Find the edge state between the attractors of two states, by edge tracking.

    The edge state attracts the motions on the boundary between the basins: usually a saddle orbit
    or a saddle equilibrium. If a state between the two reaches a third attractor, the boundary
    between this attractor and the attractor of `first` is tracked.

    Parameters
    ----------
    system : System, or Actuator and Drive
    first, second : State or mapping of str to float
        Initial states that reach different attractors.
    returns : int, optional
        Largest number of returns, which are forcing periods or, for an autonomous system, time
        steps.
    min_distance, max_distance : float, optional
        Distances of the two enclosing states after a bisection, and at which the next bisection
        begins, in the units of the integration.
    tolerance : float, optional
        Distance from the edge state at which the motion has settled, relative to the size of the
        state: the last change per period, and the distance extrapolated from the last two changes.
    step : float, optional
        Time step for an autonomous system; 1 by default.
    recurrence : RecurrenceOptions, optional
        Recognition of the attractor of a state.
    options : Options, optional
        Options of the integration. Its errors must stay far below `min_distance`; otherwise both
        enclosing states leave the boundary on one side.

    Returns
    -------
    EdgeState

    Raises
    ------
    InvalidParameter
        If an argument is out of range, or both states reach the same attractor.
    OrbitError
        If a run fails, or the enclosing states no longer enclose the boundary.

    See Also
    --------
    EdgeState, manifold, basins, find_orbit

    Notes
    -----
    Skufca, Yorke and Eckhardt, *Physical Review Letters* 96, 174101 (2006). On a fractal boundary
    the motion wanders, often for hundreds of returns, before it settles; raise `returns`, or begin
    with other states.

    Examples
    --------
    >>> import mems_impact as mi
    >>> def well(mode, t, y, p):
    ...     return y.v, y.x - y.x**3 - 0.5 * y.v
    >>> system = mi.System(states=("x", "v"), flow=well)
    >>> mi.edge_state(system, {"x": 1.0, "v": 0.3}, {"x": -1.0}).orbit.stable
    False
    """
    returns = whole("returns", returns, 1)
    positive("min_distance", min_distance)
    positive("max_distance", max_distance)
    positive("tolerance", tolerance)
    if max_distance <= min_distance:
        allowed = f"above min_distance = {min_distance:g}"
        raise InvalidParameter("max_distance", max_distance, allowed)
    if step is not None:
        positive("step", step)
        if system.forced:
            raise InvalidParameter("step", step, "None: the system has a forcing period")
    check_recurrence(recurrence)
    # The states are bisected and followed by the same numerics: other errors of the bisection would
    # move the boundary, by more than `min_distance`, away from the states that are followed.
    problem = system.problem(options)
    length = 1.0
    if not system.forced:
        length = float(system.units.into("time", 1.0 if step is None else step)) / problem.period
    tracking = _Tracking(
        system, recurrence, options, problem, length, min_distance, max_distance, tolerance
    )
    one, other = (
        system.state_space.instant(each, problem, field=name)
        for name, each in (("first", first), ("second", second))
    )
    tracking.known = [tracking.reached(each)[1] for each in (one, other)]
    if tracking.is_same(*tracking.known):
        raise InvalidParameter(
            "second", second, "", problem="it reaches the same attractor as first"
        )
    rows, distances, settled = tracking.follow(one, other, returns)
    last = rows[-1]
    columns = dict(zip(system.states, np.array([each.y for each in rows]).T, strict=True))
    series = {"return": np.arange(len(rows)), "distance": np.array(distances)}
    return EdgeState(
        system=system,
        state=system.state_space.state(last),
        settled=settled > 0,
        orbit=_saddle(system, problem, last, settled),
        attractors=tuple(each.final for each in tracking.known),  # type: ignore[arg-type]
        table=labelled(columns, system, user_columns=series, **captions(system)),
    )


def _saddle(
    system: HybridSystem, problem: Problem, last: HybridState, period: int
) -> Orbit | Equilibrium | None:
    """Return the unstable orbit or equilibrium at a state, None if there is none."""
    guess = system.state_space.state(last)
    solution: Orbit | Equilibrium | None = None
    try:
        if system.forced:
            solution = find_orbit(system, guess=guess, periods=max(1, period))
        elif period == 1:
            solution = next(iter(find_equilibria(system, guess=guess)), None)
        else:
            solution = find_orbit(system, guess=guess)
    except (OrbitError, RunError, InvalidParameter, ValueError):
        return None
    if solution is None or solution.stable is not False:
        return None
    if not system.forced and isinstance(solution, Orbit):
        return solution  # it starts elsewhere on the cycle
    at = system.state_space.instant(solution.state, problem)
    free = list(free_components(problem.automaton))
    away = float(np.abs(at.y - last.y)[free].max())
    return solution if away <= ORBIT_RTOL * max(1e-3, float(np.abs(last.y[free]).max())) else None
