"""Arcs and events with their derivatives with respect to state and parameters."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact.errors import FunctionError, OrbitError
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.engine import EngineBinding, create_engine
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.variational.flow import (
    exact_or_not,
    extended_parameters,
    tangent_flow,
    tangents_of_events,
    with_columns,
)
from mems_impact.hybrid.variational.saltation import (
    NO_EVENT,
    evaluate_shooting,
    propagate_segments,
    segment_fields,
    variational_workspace,
)


class Arc(NamedTuple):
    """An arc of fixed length and its sensitivities."""

    end: Floats  # the state at the end, shape (n,)
    by_state: Floats  # derivatives by the free components of the initial state, shape (n, free)
    by_parameter: Floats  # shape (n, directions)
    slope_start: Floats  # the flow at the start, shape (n,); `slope_end` at the end
    slope_end: Floats
    # Smallest margin at a closest approach inside the arc, shape (m,); inf if there is none.
    minima: Floats
    minima_time: Floats
    touches: Floats  # the state at `minima_time`, shape (m, n)
    margins: Floats  # at both ends, shape (2, m), as `rates`
    rates: Floats


class Event(NamedTuple):
    """A transition and its derivatives, by state, time and parameters (directions).

    The derivatives of margins are of all margins, then of all rates, shapes (2 m, n), (2 m,), (2 m,
    directions); those of the jump, the state after, have the shapes (n, n), (n,), (n, directions).
    """

    after: Floats  # shape (n,)
    margins: Floats  # before the transition, shape (m,), as `rates`
    rates: Floats
    margin_by_state: Floats
    margin_by_time: Floats
    margin_by_parameter: Floats
    jump_by_state: Floats
    jump_by_time: Floats
    jump_by_parameter: Floats
    mode: int  # the mode after the transition


class Traversal(NamedTuple):
    """The arcs and events of N segments, for n states, a part of them free, and m guards."""

    rows: Any  # record array, shape (N,): see `saltation.segment_fields`
    n: int
    m: int
    free: int

    def arc(self, i: int) -> Arc:
        """Return the arc of segment `i`."""
        row, n, m = self.rows[i], self.n, self.m
        y, slopes, margins, minima = row["states"], row["slopes"], row["margins"], row["minima"]
        columns = y[n:].reshape(n, -1)
        return Arc(
            end=y[:n],
            by_state=columns[:, : self.free],
            by_parameter=columns[:, self.free :],
            slope_start=slopes[0],
            slope_end=slopes[1],
            minima=minima[0],
            minima_time=minima[1],
            touches=row["touches"],
            margins=margins[:, :m],
            rates=margins[:, m:],
        )

    def event(self, i: int) -> Event:
        """Return the event at the end of segment `i`."""
        row, n, m = self.rows[i], self.n, self.m
        margin, jump = row["margin"], row["jump"]
        return Event(
            after=row["after"],
            margins=margin[:m, 0],
            rates=margin[m:, 0],
            margin_by_state=margin[:, 1 : n + 1],
            margin_by_time=margin[:, n + 1],
            margin_by_parameter=margin[:, n + 2 :],
            jump_by_state=jump[:, 1 : n + 1],
            jump_by_time=jump[:, n + 1],
            jump_by_parameter=jump[:, n + 2 :],
            mode=int(row["head"][5]),
        )


class Variational:
    """Computes arcs and events of a problem with their derivatives, on one engine.

    `directions` of differentiation in parameter space, shape (k, count), have lengths of order one.
    """

    def __init__(self, problem: Problem, directions: Floats) -> None:
        automaton = problem.automaton
        self.n, self.m = len(automaton.states), len(automaton.guards)
        self.free = free_components(automaton)
        directions = np.atleast_2d(np.asarray(directions, dtype=float))
        p = np.asarray(problem.parameters, dtype=float)
        self.k = directions.shape[0]
        columns = len(self.free) + self.k
        self._size = self.n * (1 + columns)
        self._block = extended_parameters(p, directions, self.n, columns)

        def build(exact: bool) -> tuple[EngineBinding, Any]:
            flow = tangent_flow(automaton.flow, self.n, p.size, columns, self.k, exact=exact)
            extended = with_columns(automaton, flow, self._block, self._size, guarded=True)
            binding = create_engine(problem, extended)
            return binding, tangents_of_events(problem, binding, self.k, exact)

        self._time_scale = problem.time_scale or problem.period
        self._binding, (tangents, self._kernel) = exact_or_not(automaton, build)
        self._workspace = variational_workspace(problem, self.k, self._size, tangents)
        # The row of an arc before it: zero but for its columns.
        self._fields = segment_fields(self.n, self.m, self.k, self._size)
        before = np.zeros(1, self._fields)
        start = before["states"][0, self.n :].reshape(self.n, columns)
        start[self.free, range(len(self.free))] = 1.0
        self._before = before.view(float)[None]

    @property
    def time_scale(self) -> float:
        """The time that bounds the steps."""
        return self._time_scale

    def at(self, p: Floats, directions: Floats) -> Variational:
        """Return a copy at other parameters and directions, which shares the engine.

        The problem's period and time scale still bound the steps.
        """
        other = object.__new__(Variational)
        vars(other).update(vars(self))
        other._block = extended_parameters(p, directions, self.n, len(self.free) + self.k)
        return other

    def traverse(
        self,
        segments: NDArray[np.int64],
        states: Floats,
        times: Floats,
        equations: tuple[Any, ...] = (),
    ) -> Traversal:
        """Compute N segments from given states, without event detection.

        `segments`, shape (N, 2), are mode, and code of the transition at the end;
        `saltation.NO_EVENT` leaves the state unchanged. `states` has the shape (N, n); `times`,
        shape (N, 3), are start, end, and the time at which the margins at the end are evaluated.
        `equations` are further arguments of `saltation.evaluate_shooting`, which are evaluated too.
        Raises OrbitError if the engine fails or exceeds the budget of steps.
        """
        values = self._before.repeat(len(segments), axis=0)
        rows = values.view(self._fields)[:, 0]
        head = rows["head"]
        head[:, :2], head[:, 2:5], rows["states"][:, : self.n] = segments, times, states
        function = evaluate_shooting if equations else propagate_segments
        try:
            failure = self._binding.call(function, self._block, self._workspace, values, *equations)
        except FunctionError as error:
            raise OrbitError(error.reason, error.remedy) from error
        if failure >= 0:
            raise OrbitError(
                reason="an arc of the orbit cannot be integrated",
                remedy="start nearer to an orbit, loosen the tolerances, or give typical "
                "magnitudes of states far from one: System(typical=)",
            )
        return Traversal(rows, self.n, self.m, len(self.free))

    def arc(self, mode: int, y: Floats, start: float, end: float) -> Arc:
        """Integrate `mode` from (start, y) to `end`, with all columns; see `propagate_segments`."""
        return self._one(mode, NO_EVENT, y, (start, end, end)).arc(0)

    def event(self, mode: int, code: int, t: float, y: Floats) -> Event:
        """Perform the transition `code` at (t, y), with derivatives; see `propagate_segments`."""
        return self._one(mode, code, y, (t, t, t)).event(0)

    def margins(self, mode: int, t: float, y: Floats) -> tuple[Floats, Floats]:
        """Return margins and rates in `mode` at (t, y)."""
        arc = self.arc(mode, y, t, t)
        return arc.margins[0], arc.rates[0]

    def _one(
        self,
        mode: int,
        code: int,
        y: Floats,
        times: tuple[float, float, float],
    ) -> Traversal:
        segments = np.array([[mode, code]], dtype=np.int64)
        return self.traverse(segments, np.asarray(y)[None], np.array([times]))


def free_components(automaton: Automaton) -> tuple[int, ...]:
    """Return the components of the state that are not cyclic."""
    return tuple(i for i in range(len(automaton.states)) if i not in automaton.cyclic)
