"""Derivatives of a run by parameters and initial states."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, Generic, Literal, NamedTuple, Self, TypeVar

import numpy as np

from mems_impact import tables as run_tables
from mems_impact._util.arrays import Floats
from mems_impact.errors import InvalidParameter, OrbitError, TransientWarning
from mems_impact.hybrid.differences import sixth_order_difference
from mems_impact.hybrid.event_loop.workspace import SECTION_CROSSING
from mems_impact.hybrid.simulation import Events, Trajectory
from mems_impact.hybrid.simulation import run as integrate
from mems_impact.hybrid.variational.run_columns import Columns, Quantities, RunColumns
from mems_impact.integrators.dual_numbers import Dual, copy_for_tangents
from mems_impact.orbits.family import Family, ParameterPoint
from mems_impact.systems.base import system_at
from mems_impact.systems.state import is_number
from mems_impact.systems.statistics import LazyStatistics
from mems_impact.systems.window_statistics import TimeWindow

if TYPE_CHECKING:
    import pandas as pd
    from numpy.typing import ArrayLike

R = TypeVar("R", bound=Any)  # the class of runs

INITIAL = "x0."  # before the name of a state, for its initial value
LOOSER = 10.0  # ratio of tolerances whose difference shows the error
MOST_READ = 20  # events at which the functions of a system are evaluated for what they read
STEP = 1e-3  # largest relative change of events in the gradient of a function


class KeptDerivatives(NamedTuple):
    """What a run that keeps statistics alone keeps of its derivatives."""

    final: Floats  # of the last state, in scaled units, shape (n, s)
    # For each quantity a step, and the run to first order at multiples of the step.
    neighbours: tuple[tuple[float, Mapping[float, Any]], ...]


@dataclass(frozen=True, eq=False)
class RunDerivatives(Generic[R]):
    """Derivatives of a run by some of its parameters and initial states.

    They are exact through impacts, sliding, rest, the end of chatter and switches of the forcing:
    those of the run's sequence of events, which a discrete change such as one impact more or less
    would replace. Beyond simultaneous events whose order matters, and beyond a grazing whose depth
    is below the error of the run, they are nan. Events and the end of a forced run belong to phases
    of the forcing, and move with its period.

    Attributes
    ----------
    run : Run
    names : tuple of str
        Parameters, and initial states as ``"x0.x"``.
    moves : tuple of mapping
        For each quantity the parameters that change with it, and how fast, in scaled units.
    columns : Columns
        Of the events, then of the end; in scaled units.

    See Also
    --------
    Run, value_and_jacobian, sensitivity

    Notes
    -----
    Derivatives of a run with ``keep="statistics"`` are of its last state and statistics alone.

    Examples
    --------
    >>> import mems_impact as mi
    >>> def fall(mode, t, y, p):
    ...     return y.v, -p.g
    >>> ball = mi.System(
    ...     states=("x", "v"), flow=fall, parameters={"g": 9.8, "e": 0.8}, initial={"x": 1.0},
    ...     parts=[mi.Stopper("floor", "x", "v", lower=0.0, restitution="e")],
    ... )
    >>> found = mi.simulate(ball, duration=1.0).derivatives(["e", "x0.x"])
    >>> found.events["dt/dx0.x"].round(6).tolist()  # 1/sqrt(2 g x0)
    [0.225877]
    >>> found.final.round(6).loc["v"].tolist()
    [4.427189, 3.98447]
    """

    run: R = field(repr=False)
    names: tuple[str, ...]
    family: Family = field(repr=False)
    quantities: Quantities = field(repr=False)
    scales: Floats = field(repr=False)
    moves: tuple[Mapping[str, float], ...] = field(repr=False)
    one_sided: bool = False
    _kept: KeptDerivatives | None = field(default=None, repr=False)

    @cached_property
    def columns(self) -> Columns:
        """Derivatives at all events and at the end, in scaled units."""
        return self._checked(self._numeric.at(np.array([self._end]), "after"))

    @property
    def final(self) -> pd.DataFrame:
        """Derivatives of the last state: a row per state, a column per quantity."""
        return self._by_state(self._kept.final if self._kept else self._final(self.columns))

    @property
    def error(self) -> pd.DataFrame:
        """Estimated errors of `final`: its change by tolerances of the run ten times as large.

        They are nan if that run has another sequence of events.
        """
        if self._kept:
            return replace(self, run=_with_events(self.run), _kept=None).error
        trajectory = self.run.trajectory
        problem, log = trajectory.problem, trajectory.events
        options = problem.options
        rtol, atol = LOOSER * options.rtol, LOOSER * options.atol
        problem = replace(problem, options=replace(options, rtol=rtol, atol=atol))
        length = self.run.periods * (2.0 if trajectory.ended else 1.0)
        again = integrate(problem, trajectory.start, length)
        if not _same_sequence(again.events, log):
            return self._by_state(np.full_like(self._final(self.columns), np.nan))
        looser = replace(self, run=replace(self.run, trajectory=again))
        change = looser._final(looser.columns) - self._final(self.columns)
        grazing = self.columns.errors.max(initial=0.0)
        return self._by_state(np.abs(change) + grazing * np.abs(self._final(self.columns)))

    @property
    def events(self) -> pd.DataFrame:
        """One row per row of `Run.events`: time, event, kind, derivatives of time and state.

        The state is the state after the event, at its time. Kinds are smooth, tie (of events in
        one instant), graze and chatter ends.
        """
        run, columns = self.run, self.columns
        log = run.trajectory.events
        shown = run_tables.is_shown(log)
        here = np.isin(columns.rows, np.flatnonzero(shown))
        after = columns.after + columns.slopes[:, 1, :, None] * columns.instants[:, None]
        instants = columns.instants + np.outer(columns.bases, self.quantities.period_rates)
        table = run.events[["t", "event"]].copy()
        table["kind"] = columns.kinds[here]
        return table.assign(**self._flat(instants[here], after[here]))

    def samples(self, times: ArrayLike, side: Literal["after", "before"] = "after") -> pd.DataFrame:
        """Return the state at some times, and its derivatives by time and by the quantities.

        Parameters
        ----------
        times : array_like of float
            Within the run.
        side : {"after", "before"}, optional
            Of an event at one of these times.

        Returns
        -------
        DataFrame
            One row per time: ``x``, ``dx/dt``, ``dx/de``.
        """
        if side not in ("after", "before"):
            raise InvalidParameter("side", side, "'after' or 'before'")
        system, scaled = self.run.system, self.run._scaled_times(times)
        columns = self._checked(self._numeric.at(scaled, side))
        here = np.flatnonzero(columns.rows < 0)
        here = here[np.argsort(np.argsort(scaled, kind="stable"))]
        rates = np.outer(columns.bases[here], self.quantities.period_rates)
        slopes = columns.slopes[here, 0]
        states = columns.before[here] - slopes[:, :, None] * rates[:, None]
        values = run_tables.states(system.automaton.states, columns.states[here])
        unit = float(system.units.out("time", 1.0))
        import pandas as pd

        return pd.DataFrame(
            {
                "t": np.atleast_1d(np.asarray(times, dtype=float)),
                **{name: system.units.out(name, each) for name, each in values.items()},
                **{
                    f"d{name}/dt": system.units.out(name, slopes[:, i]) / unit
                    for i, name in enumerate(values)
                },
                **self._flat(None, states),
            }
        )

    def of(self, function: Callable[[R], float]) -> pd.Series:
        """Return the gradient of a scalar function of the run.

        Parameters
        ----------
        function : callable
            ``function(run)`` of events, impacts, statistics and the last state of a run. The number
            of events is constant: what is discrete has no derivative. `Run.samples` are integrated
            again, and exact to the tolerances only, unlike those of this class.

        Returns
        -------
        Series
            One derivative per quantity.
        """
        import pandas as pd

        found = self.jacobian(function)
        if len(found) != 1:
            allowed = "a function with one number as its result (jacobian takes more)"
            raise InvalidParameter("function", function, allowed)
        return pd.Series(found[0], index=list(self.names), name="derivative")

    def jacobian(self, function: Callable[[R], Any]) -> Floats:
        """Return the derivatives of a function of the run, shape (m, s).

        Parameters
        ----------
        function : callable
            ``function(run)``, one number or m numbers; as in `of`.
        """
        found = np.stack([self._gradient(function, c) for c in range(len(self.names))], axis=-1)
        if not self._kept and not found.any(axis=0).all():
            self._checked(self._inner)
        return found

    def directional(self, direction: Mapping[str, float]) -> RunDerivatives:
        """Return the derivative in a direction, for a small positive step.

        At simultaneous events it exists where partial derivatives do not (Burden, Council and
        Revzen, arXiv 2102.10702).

        Parameters
        ----------
        direction : mapping of str to float
            Parts of some of the quantities.

        Returns
        -------
        RunDerivatives
            By one quantity, ``direction``.
        """
        allowed = f"numbers by some of the names {', '.join(self.names)}"
        if not isinstance(direction, Mapping) or not set(direction) <= set(self.names):
            raise InvalidParameter("direction", direction, allowed)
        if not direction or not all(is_number(each) for each in direction.values()):
            raise InvalidParameter("direction", direction, allowed)
        parts = np.array([float(direction.get(name, 0.0)) for name in self.names]) / self._factors
        moves: dict[str, float] = {}
        for part, move in zip(parts, self.moves, strict=True):
            moves |= {name: part * value for name, value in move.items()}
        quantities = self.quantities.along(parts * self.scales)
        return RunDerivatives(
            self.run, ("direction",), self.family, quantities, np.ones(1), (moves,), True
        )._for(self.run.keep)

    def _for(self, keep: str) -> Self:
        """Return the derivatives that a run with this `keep` has."""
        if keep == "events":
            return self
        whole, nothing = replace(self, run=_with_events(self.run)), self.run.trajectory.events[:0]
        neighbours = []
        for c in range(len(self.names)):
            step, runs = whole._step(c), {}
            for distance in (part * step for part in (-3, -2, -1, 1, 2, 3)):
                run = whole._neighbour(c, distance)
                trajectory = run.trajectory.with_events(nothing)
                runs[distance] = replace(
                    run, keep=keep, trajectory=trajectory, _gatherer=run._accumulator
                )
            neighbours.append((step, runs))
        return replace(self, _kept=KeptDerivatives(whole._final(whole.columns), tuple(neighbours)))

    # --- Units

    @cached_property
    def _factors(self) -> Floats:
        """Units of the quantities."""
        system = self.run.system
        return np.array(
            [
                1.0
                if name == "direction"
                else float(system.units.out(name.removeprefix(INITIAL), 1.0))
                for name in self.names
            ]
        )

    def _by_state(self, values: Floats) -> pd.DataFrame:
        import pandas as pd

        system = self.run.system
        units = np.array([float(system.units.out(name, 1.0)) for name in system.automaton.states])
        scaled = values * self.scales * units[:, None] / self._factors
        return pd.DataFrame(scaled, index=list(system.automaton.states), columns=list(self.names))

    def _flat(self, instants: Floats | None, states: Floats) -> dict[str, Floats]:
        """Return the columns of a table, in the units of the system."""
        system = self.run.system
        blocks = [] if instants is None else [("t", "time", instants)]
        blocks += [(name, name, states[:, i]) for i, name in enumerate(system.automaton.states)]
        return {
            f"d{label}/d{name}": float(system.units.out(heading, 1.0))
            * values[:, c] * self.scales[c] / self._factors[c]
            for label, heading, values in blocks
            for c, name in enumerate(self.names)
        }  # fmt: skip

    # --- Columns

    @property
    def _end(self) -> float:
        return self._time(self.run.extent[1])

    def _time(self, periods: float) -> float:
        return periods * self.run.trajectory.period

    @cached_property
    def _numeric(self) -> RunColumns:
        self.run._log("derivatives of events and samples")
        return RunColumns(self.run.trajectory, self.quantities, one_sided=self.one_sided)

    def _final(self, columns: Columns) -> Floats:
        """Return the derivatives of the last state, at a phase of the forcing."""
        if self.run.trajectory.ended:  # by an event
            last = np.flatnonzero(columns.rows >= 0)[-1]
            return columns.after[last] + np.outer(columns.slopes[last, 1], columns.instants[last])
        local = columns.times[-1] / self.run.trajectory.period
        return columns.before[-1] + np.outer(
            columns.slopes[-1, 0], local * self.quantities.period_rates
        )

    def _checked(self, columns: Columns) -> Columns:
        """Return columns; raise InvalidParameter if nothing depends smoothly on a quantity."""
        of, tables = self.quantities, (columns.before, columns.after, columns.instants)
        for c, name in enumerate(self.names):
            rest = (of.starts[:, c], of.period_rates[c], of.switch_rates[c])
            zero = not any(map(np.any, (*rest, *(each[..., c] for each in tables))))
            watched = bool(self.run.system.observables)
            if zero and not watched and not _reads(self.run.trajectory, of.directions[c]):
                allowed = (
                    "one that the equations read as a real number: a whole number, or the "
                    "threshold of an if, has no derivative"
                )
                raise InvalidParameter("parameter", name, allowed)
        return columns

    # --- The gradient of a function of the run

    @cached_property
    def _inner(self) -> Columns:
        """Derivatives at all rows of the event log, at the start of the window and at its end."""
        return self._numeric.at(np.array([*self._borders, self._end]), "after", inner=True)

    @property
    def _borders(self) -> list[float]:
        """Start and end of the window of statistics, within the run."""
        period = self.run.trajectory.period / self.run.unit
        first, last = (self._time(border) for border in self.run.extent)
        return [min(max(border * period, first), last) for border in self.run.window]

    @cached_property
    def _border_states(self) -> tuple[Floats, Floats]:
        return self.run._state_at(0), self.run._state_at(1)

    def _gradient(self, function: Callable[[R], Any], c: int) -> Floats:
        """Return the derivatives of a function by one quantity, shape (m,).

        The run of a neighbouring value is the run plus a multiple of its derivatives, so that the
        difference of its events has no error of an integration.
        """
        if self._kept:
            step, runs = self._kept.neighbours[c]
            neighbour = runs.__getitem__
        else:
            step, neighbour = self._step(c), partial(self._neighbour, c)

        def value(distance: float) -> Floats:
            with warnings.catch_warnings(action="ignore", category=TransientWarning):
                found = function(neighbour(distance))
            return np.atleast_1d(np.asarray(found, dtype=float))

        by_unit: Floats = sixth_order_difference(value, step)
        return by_unit * float(self.scales[c] / self._factors[c])

    def _step(self, c: int) -> float:
        """Return the difference of a quantity in the gradient of a function."""
        run, columns = self.run, self._inner
        log = run.trajectory.events
        sizes = 1.0 + np.abs(log.after).max(axis=0, initial=0.0)
        totals = columns.after + columns.slopes[:, 1, :, None] * columns.instants[:, None]
        largest = max(
            float(np.nanmax(np.abs(totals[:, :, c]) / sizes, initial=0.0)),
            float(np.nanmax(np.abs(columns.instants[:, c]), initial=0.0)) / run.trajectory.period,
            float(np.abs(self.quantities.directions[c]).max()),
        )
        return STEP / largest

    def _neighbour(self, c: int, distance: float) -> R:
        """Return the run to first order at another value of a quantity."""
        run, columns, rows = self.run, self._inner, self._inner.rows
        trajectory, log = run.trajectory, run.trajectory.events
        family = self.family
        inner = {
            name: float(family.value(name) + distance * move)
            for name, move in self.moves[c].items()
            if not name.startswith(INITIAL)
        }
        family = family.at(**inner) if inner else family
        system, problem = system_at(run.system, family.values), family.problem()
        moved = np.flatnonzero(rows >= 0)
        instants = columns.instants[moved, c].copy()
        before, after = columns.before[moved, :, c], columns.after[moved, :, c]
        section = trajectory.problem.section
        if section is not None:
            crosses = log.kind[rows[moved]] == SECTION_CROSSING
            component = section[0]
            speed = columns.slopes[moved, 0, component]
            instants[crosses] = -before[crosses, component] / speed[crosses]
        instants_by_row, before_by_row, after_by_row = (
            np.zeros(len(log)), np.zeros_like(log.before), np.zeros_like(log.after)
        )  # fmt: skip
        later = columns.bases[moved] - log.cycle[rows[moved]]
        instants_by_row[rows[moved]] = instants + later * self.quantities.period_rates[c]
        before_by_row[rows[moved]] = before + columns.slopes[moved, 0] * instants[:, None]
        after_by_row[rows[moved]] = after + columns.slopes[moved, 1] * instants[:, None]
        events = replace(
            log,
            time=log.time + distance * instants_by_row,
            before=log.before + distance * before_by_row,
            after=log.after + distance * after_by_row,
        )
        start, final = trajectory.start, trajectory.final
        stretch = problem.period / trajectory.period
        final = replace(
            final, time=final.time * stretch, y=final.y + distance * self._final(columns)[:, c]
        )
        start = replace(start, y=start.y + distance * self.quantities.starts[:, c])
        borders = []
        for state, row in zip(self._border_states, np.flatnonzero(rows < 0)[:2], strict=True):
            at_end = columns.bases[row] * trajectory.period + columns.times[row] >= self._end
            phase = columns.times[row] / trajectory.period * self.quantities.period_rates[c]
            rate = columns.before[row, :, c] + columns.slopes[row, 0] * phase
            borders.append(final.y if at_end else state + distance * rate)
        first, last = (border / run.unit for border in run.window)
        window = TimeWindow(first, last, problem.period)
        lengths = getattr(run._gatherer, "lengths", [len(events)])
        return replace(
            run,
            system=system,
            trajectory=replace(
                trajectory, problem=problem, start=start, final=final, events=events
            ),
            _borders=tuple(borders),
            _gatherer=LazyStatistics(
                lambda: system.statistics.accumulator(problem, start, window), events, lengths
            ),
        )


def _same_sequence(one: Events, other: Events) -> bool:
    """Return whether two runs have the same transitions in the same order."""
    first, second = (
        np.column_stack([log.kind, log.guard, log.mode_after])[run_tables.is_shown(log)]
        for log in (one, other)
    )
    return np.array_equal(first, second)


def _reads(trajectory: Trajectory, direction: Floats) -> bool:
    """Return whether a function computes with parameters that have tangents in a direction."""
    automaton, p = trajectory.automaton, list(trajectory.problem.parameters)
    numbers = [Dual(v, np.array([d])) for v, d in zip(p, direction, strict=True)]
    moved = [number if number.slope.any() else number.value for number in numbers]
    m, n = len(automaton.guards), len(automaton.states)
    states = [trajectory.start.y, *trajectory.events.before[:MOST_READ]]
    try:
        for mode in range(len(automaton.modes)):
            for y in (state.tolist() for state in states):
                found, margins = [[1.0] * n], [1.0] * m
                copy_for_tangents(automaton.flow)(mode, 0.0, y, moved, found[0])
                # A derived rate is of numbers that all have tangents.
                state = [Dual(value, np.zeros(1)) for value in y]
                copy_for_tangents(automaton.margins)(mode, 0.0, state, numbers, margins, [1.0] * m)
                found.append([g for g in margins if isinstance(g, Dual) and g.slope.any()])
                for code in range(2 * m):
                    found.append([*y])
                    copy_for_tangents(automaton.transition)(mode, code, 0.0, found[-1], moved)
                if any(isinstance(number, Dual) for numbers in found for number in numbers):
                    return True
    except Exception:
        return True  # a function that takes no tangents, or not there
    return False


def _with_events(run: R) -> R:
    """Return a run that kept statistics alone, integrated again, with its events."""
    again = integrate(run.trajectory.problem, run.trajectory.start, run.periods)
    return replace(run, keep="events", trajectory=run.trajectory.with_events(again.events))


def derivatives_of(run: R, names: Sequence[str]) -> RunDerivatives[R]:
    """Return the derivatives of a run; see `Run.derivatives`."""
    names = (names,) if isinstance(names, str) else tuple(names or ())
    family, automaton = run.system.family(run.options), run.trajectory.automaton
    states = [f"{INITIAL}{name}" for name in automaton.states]
    for name in names:
        if name not in family.values and name not in states:
            allowed = f"one of {', '.join([*family.values, *states])}"
            raise InvalidParameter("parameter", name, allowed)
    if not names or len(set(names)) != len(names):
        raise InvalidParameter("parameters", names, "one or more different names")
    active = tuple(name for name in names if name in family.values)
    try:
        values = np.array([family.value(name) for name in active])
        point = ParameterPoint.of(family, active, values)
    except OrbitError as error:
        allowed = "those whose neighbours have the same pieces of the forcing"
        raise InvalidParameter("parameters", names, allowed) from error
    s, n, scales = len(names), len(automaton.states), np.ones(len(names))
    moves = [{name: 1.0} for name in names]
    quantities = Quantities(
        np.zeros((n, s)),
        np.zeros((s, len(point.parameters))),
        np.zeros(s),
        np.zeros((s, point.switches.size)),
    )
    for c, name in enumerate(names):
        if name in states:
            quantities.starts[states.index(name), c] = 1.0
            continue
        k = active.index(name)
        scales[c] = moves[c][name] = float(point.scales[k])
        quantities.directions[c] = point.directions[k]
        quantities.period_rates[c] = point.period_rates[k] / scales[c]
        quantities.switch_rates[c] = point.switch_rates[k] / scales[c]
    return RunDerivatives(run, names, family, quantities, scales, tuple(moves))._for(run.keep)
