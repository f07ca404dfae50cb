"""Derivatives along a run by parameters and initial states: columns that follow its event log.

A *column* is the derivative of the state at a fixed time since the time base by one quantity: its
direction in the space of parameters, and its start. Every arc begins at the state that the run has
logged, so that columns belong to the run and not to a neighbouring motion. A later time base adds
the flow times the change of the period.

Functions over `integrators.interface`, interpreted and compiled.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import permutations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact.errors import RunError
from mems_impact.hybrid.engine import EngineBinding, create_engine
from mems_impact.hybrid.event_loop.workspace import (
    ACCUMULATION,
    APPROACH,
    REBASE,
    SECTION_CROSSING,
    SWITCH,
    TRANSITION,
)
from mems_impact.hybrid.simulation import Trajectory
from mems_impact.hybrid.variational.flow import (
    exact_or_not,
    extended_parameters,
    tangent_flow,
    tangents_of_events,
    with_columns,
)
from mems_impact.hybrid.variational.saltation import (
    VariationalWorkspace,
    copy,
    differentiate_event,
    integrate,
    integrate_backward,
    just_before,
    margin_error,
    project,
    rate_along,
    simultaneous_below,
    variational_workspace,
)
from mems_impact.integrators import interface

SAMPLE = -1  # kind of a piece that ends without an event
DONE = -1  # result of `propagate_columns`
LOCATION = 1e-12  # largest error of the location of an event, in time scales


class ColumnPath(NamedTuple):
    """Pieces of a run, each an arc with the event at its end, and the s columns along them.

    The fields from `before` to `margins` are output.
    """

    variational: VariationalWorkspace
    columns: int  # s
    pieces: Any  # int array, shape (N, 4): mode; kind of the event or SAMPLE; guard; mode after
    # Start and end since the time base; periods by which the time base is later than before;
    # periods before the time base. Shape (N, 4).
    times: Any
    # States at the start, shape (N, n); nan where the piece continues the piece before.
    starts: Any
    arrivals: Any  # States before the event, shape (N, n); nan for a cyclic component.
    ends: Any  # states after the event, shape (N, n)
    period_rates: Any  # shape (s,)
    switch_rates: Any  # derivatives of the time of a switch, shape (N, s)
    records: Any  # 1 for a guard that only records, shape (m,)
    tolerances: Any  # relative and absolute tolerance of the run, time scale, period
    clock: int  # index of the time base in the parameters, or -1
    y: Any  # state and columns, shape (n (1 + s),)
    y_start: Any  # those at the start of the arc
    before: Any  # columns at the end of each piece, before its event, shape (N, n, s)
    after: Any  # the same after the event
    slopes: Any  # the flow before and after the event, shape (N, 2, n)
    instants: Any  # derivatives of the time of the event, shape (N, s)
    # Of the margin of the event its rate, the change of the rate along the flow, and its error,
    # shape (N, 3).
    margins: Any
    first_margins: Any  # margins before the first event of the present instant, shape (2 m,)


def propagate_columns(engine: Any, block: Any, path: Any, first: int) -> int:
    """Propagate the columns from piece `first` on.

    Returns DONE; the number of a piece whose event is simultaneous with the event before but not
    its consequence; or -2 - i if piece i cannot be integrated.
    """
    w, s = path.variational, path.columns
    n, y, slope, first_of_arc = w.n, path.y, w.work[8], first
    for i in range(block.size):
        interface.set_parameter(engine, i, block[i])
    for i in range(first, path.pieces.shape[0]):
        mode, kind = path.pieces[i, 0], path.pieces[i, 1]
        start, end = path.times[i, 0], path.times[i, 1]
        set_clock(engine, path, i)
        is_first = path.starts[i, 0] == path.starts[i, 0]
        if is_first:
            for j in range(n):
                y[j] = path.starts[i, j]
        if path.times[i, 2] != 0.0:
            interface.flow(engine, mode, start, y, slope)
            for j in range(n):
                for c in range(s):
                    y[n + s * j + c] += path.times[i, 2] * slope[j] * path.period_rates[c]
        if is_first:
            first_of_arc = i
            copy(y, path.y_start)
        if kind == ACCUMULATION:
            # Samples after the last impact belong to its flight.
            start = path.times[first_of_arc, 0]
            copy(path.y_start, y)
            for c in range(s):
                path.instants[i, c] = path.instants[first_of_arc - 1, c] if first_of_arc else 0.0
            keep_columns(i, path)
            # The motion until the end of the sequence is that in contact from the last impact on.
            mode = jump_at(engine, i, mode, w.m + path.pieces[i, 2], start, path)
        if w.constrained[mode] == 1:
            project(engine, mode, start, y, w)
        if end > start and not integrate(engine, mode, y, start, end, w, approaches=False):
            return -2 - i
        if kind == ACCUMULATION and mode != path.pieces[i, 3]:
            mode = stop(engine, i, mode, path)
        keep_columns(i, path)
        if kind in (SAMPLE, ACCUMULATION, APPROACH):
            # The limit from the left, before a switch of the drive.
            interface.flow(engine, mode, just_before(end) if end > start else end, y, slope)
            for j in range(n):
                path.ends[i, j] = y[j]
                path.slopes[i, 0, j] = path.slopes[i, 1, j] = slope[j]
        if kind == APPROACH:
            approach(engine, i, slope, path)
        if kind in (TRANSITION, SWITCH):
            is_later = i == 0 or end > start or path.pieces[i - 1, 1] != TRANSITION
            if not cross(engine, i, first_of_arc, is_later, path):
                return i
        for j in range(n):
            for c in range(s):
                y[n + s * j + c] = path.after[i, j, c]
    return DONE


def approach(engine: Any, i: int, slope: Any, path: Any) -> None:
    """Write the derivatives of the instant at which the rate of a margin is zero."""
    w = path.variational
    differentiate_event(engine, path.pieces[i, 0], 2 * w.m, path.times[i, 1], path.y, w)
    differentiate_instant(i, w.m + path.pieces[i, 2], slope, path)


def differentiate_instant(i: int, row: int, flow: Any, path: Any) -> None:
    """Write the derivatives of the instant at which a margin, or its rate, is zero."""
    n, s, derivatives = path.variational.n, path.columns, path.variational.margin[row]
    rate = rate_along(derivatives, flow, n)
    for c in range(s):
        shift = column_of(derivatives, path.y, n, s, c)
        path.instants[i, c] = -shift / rate if rate != 0.0 else math.nan


def column_of(row: Any, y: Any, n: int, s: int, c: int) -> float:
    """Return the derivative of a margin by quantity `c`, from its derivatives and the columns."""
    total: float = row[n + 2 + c]
    for j in range(n):
        total += row[1 + j] * y[n + s * j + c]
    return total


def set_clock(engine: Any, path: Any, i: int) -> None:
    """Set the time base of piece `i` in the parameters, and its derivatives."""
    s, count, cycles = path.columns, path.variational.parameters, path.times[i, 3]
    if path.clock >= 0:
        interface.set_parameter(engine, path.clock, cycles * path.tolerances[3])
        for c in range(s):
            rate = cycles * path.period_rates[c]
            interface.set_parameter(engine, count * (1 + c) + path.clock, rate)
            interface.set_parameter(engine, count * (1 + s) + s * path.clock + c, rate)


def cross(engine: Any, i: int, first_of_arc: int, is_later: bool, path: Any) -> bool:
    """Propagate the columns through the transition at the end of piece `i`.

    An event of the same instant as the event before is its consequence, and happens with it, if its
    margin was not zero before the first, nor is now. Return False for another one.
    """
    w, s = path.variational, path.columns
    n, m, y, t = w.n, w.m, path.y, path.times[i, 1]
    mode, kind, guard = path.pieces[i, 0], path.pieces[i, 1], path.pieces[i, 2]
    margin, before = w.margin, w.work[8]
    for j in range(n):
        if path.arrivals[i, j] == path.arrivals[i, j]:
            y[j] = path.arrivals[i, j]
    # The limit from the left, before a switch of the drive.
    interface.flow(engine, mode, just_before(t), y, before)
    code = guard if kind == TRANSITION else 2 * m
    differentiate_event(engine, mode, code, t, y, w)
    if is_later:
        for j in range(2 * m):
            path.first_margins[j] = margin[j, 0]
    if kind == TRANSITION:
        row = margin[guard]
        rate, change = rate_along(row, before, n), rate_along(margin[m + guard], before, n)
        error = margin_error(row, y, n, path.tolerances[0], path.tolerances[1])
        path.margins[i, 0], path.margins[i, 1], path.margins[i, 2] = rate, change, error
        nearest = min(abs(path.first_margins[guard]), abs(row[0]))
        below = simultaneous_below(error, rate, path.tolerances[2])
        own = is_later or nearest <= below
        if own and not is_later and path.records[guard] == 0:
            return False
        path.first_margins[guard] = math.inf  # what another event makes happen again follows it
        if own:
            differentiate_instant(i, guard, before, path)
            if path.times[first_of_arc, 0] < t:
                below = error + LOCATION * abs(rate) * path.tolerances[2]
            if is_later and row[0] < -below:
                return_to_start(engine, i, first_of_arc, rate, path)
                differentiate_event(engine, mode, code, t, y, w)
        else:
            for c in range(s):
                path.instants[i, c] = path.instants[i - 1, c]
        if path.records[guard] == 1:
            return True
    else:
        for c in range(s):
            path.instants[i, c] = path.switch_rates[i, c]
    for j in range(n):
        path.slopes[i, 0, j] = before[j]
        y[j] = path.ends[i, j]
    apply_jump(engine, i, path.pieces[i, 3], t, before, path)
    return True


def return_to_start(engine: Any, i: int, first: int, rate: float, path: Any) -> None:
    """Correct the derivatives of the instant at which a margin falls to its value at the start.

    A guard whose margin is below zero where the arc begins, at piece `first`, and remains below,
    fires there or at once (`event_loop.loop.begin_arc`).
    """
    w, s, mode, guard = path.variational, path.columns, path.pieces[i, 0], path.pieces[i, 2]
    t, y, slope, margin = path.times[first, 0], path.y_start, w.work[9], w.margin[guard, 0]
    interface.flow(engine, mode, t, y, slope)
    differentiate_event(engine, mode, guard, t, y, w)
    row = w.margin[guard]
    if rate != 0.0 and abs(margin - row[0]) < abs(margin):
        for c in range(s):
            delay = path.instants[first - 1, c] if first > 0 else 0.0
            delay -= path.times[first, 2] * path.period_rates[c]
            change = column_of(row, y, w.n, s, c) + delay * rate_along(row, slope, w.n)
            path.instants[i, c] += change / rate


def keep_columns(i: int, path: Any) -> None:
    """Store the columns as those before and after the event of piece `i`."""
    n, s = path.variational.n, path.columns
    for j in range(n):
        for c in range(s):
            path.before[i, j, c] = path.after[i, j, c] = path.y[n + s * j + c]


def apply_jump(engine: Any, i: int, mode: int, t: float, before: Any, path: Any) -> None:
    """Write the columns after an event, from those before it and the derivatives of its instant.

    `mode` and the state are those after it, `before` is the flow before it.
    """
    w, s, y = path.variational, path.columns, path.y
    n, jump, after = w.n, w.jump, w.work[9]
    interface.flow(engine, mode, t, y, after)
    for j in range(n):
        path.slopes[i, 1, j] = after[j]
        # A motion whose event is later follows the flow before it for longer.
        kick = jump[j, n + 1] - after[j]
        for k in range(n):
            kick += jump[j, 1 + k] * before[k]
        for c in range(s):
            value = jump[j, n + 2 + c] + kick * path.instants[i, c]
            for k in range(n):
                value += jump[j, 1 + k] * path.before[i, k, c]
            path.after[i, j, c] = value


def stop(engine: Any, i: int, mode: int, path: Any) -> int:
    """Propagate state and columns through the event between last impact and end of chatter.

    Friction has stopped a body that the impacts moved. Return the mode after it.
    """
    w, y, end = path.variational, path.y, path.times[i, 1]
    differentiate_event(engine, mode, 2 * w.m, end, y, w)
    for guard in range(w.m):
        margin, rate = w.margin[guard, 0], w.margin[w.m + guard, 0]
        if guard == path.pieces[i, 2] or not (margin < 0.0 and rate < 0.0):
            continue
        t = end - margin / rate
        integrate_backward(engine, mode, y, end, t, w.work)
        keep_columns(i, path)
        mode = jump_at(engine, i, mode, guard, t, path)
        if integrate(engine, mode, y, t, end, w, approaches=False):
            return mode
    y[w.n :] = math.nan
    return mode


def jump_at(engine: Any, i: int, mode: int, code: int, t: float, path: Any) -> int:
    """Propagate state and columns through a transition that the run has not logged.

    The columns before it are those of piece `i`, and the derivatives of its instant, unless it
    happens at a margin. Return the mode after it.
    """
    w, s, y, before = path.variational, path.columns, path.y, path.variational.work[8]
    interface.flow(engine, mode, just_before(t), y, before)
    differentiate_event(engine, mode, code, t, y, w)
    if code < w.m:
        differentiate_instant(i, code, before, path)
    mode_after: int = interface.transition(engine, mode, code, t, y)
    apply_jump(engine, i, mode_after, t, before, path)
    for j in range(w.n):
        for c in range(s):
            y[w.n + s * j + c] = path.after[i, j, c]
    return mode_after


# --- Columns along a run

MOST_TIED = 3  # simultaneous events whose orders are compared
SAME_RTOL = 1e-9  # difference of columns by two orders of events, relative to their size
ERRORS_OF_RUNS = 10.0  # errors of a run, in its tolerances
SMOOTH, TIE, GRAZE, CHATTER_ENDS = "smooth", "tie", "graze", "chatter ends"


class Quantities(NamedTuple):
    """The quantities by which a run is differentiated."""

    starts: Floats  # derivatives of the initial state, shape (n, s)
    directions: Floats  # derivatives of the parameters, of order one, shape (s, count)
    period_rates: Floats  # shape (s,)
    switch_rates: Floats  # shape (s, switches)

    def along(self, direction: Floats) -> Quantities:
        """Return the one quantity that is a combination of these."""
        return Quantities(
            self.starts @ direction[:, None],
            direction[None] @ self.directions,
            np.array([direction @ self.period_rates]),
            direction[None] @ self.switch_rates,
        )


class Columns(NamedTuple):
    """Derivatives at the events of a run, then at some times."""

    rows: NDArray[np.int64]  # of the event log, shape (N,); -1 for a sample
    states: Floats  # after the event, shape (N, n)
    # At a fixed time since the time base of the arc, before the event, shape (N, n, s).
    before: Floats
    after: Floats  # the same after the event
    slopes: Floats  # the flow before and after the event, shape (N, 2, n)
    instants: Floats  # of the time of the event, since the time base of the arc, shape (N, s)
    bases: Floats  # periods before the time base of the arc, shape (N,)
    times: Floats  # time of the event since then, shape (N,)
    kinds: NDArray[np.str_]  # "smooth", "tie", "graze" or "chatter ends", shape (N,)
    errors: Floats  # relative errors of the instants by the error of the margin, shape (N,)


class RunColumns:
    """The columns of a run, with its events, by some quantities.

    If `one_sided`, simultaneous events happen in the order of their instants for a small positive
    step. Otherwise a column is nan beyond them unless all orders lead to it.
    """

    def __init__(
        self,
        trajectory: Trajectory,
        quantities: Quantities,
        *,
        one_sided: bool = False,
    ) -> None:
        problem, (starts, directions, *_) = trajectory.problem, quantities
        automaton, options = problem.automaton, problem.options
        self._trajectory, self._quantities, self._one_sided = trajectory, quantities, one_sided
        self._moving = np.array([i not in automaton.cyclic for i in range(len(automaton.states))])
        self._problem, self._n, (_, self._s) = problem, len(automaton.states), starts.shape
        n, s, p = self._n, self._s, np.asarray(problem.parameters, dtype=float)
        size = n * (1 + s)
        self._block = extended_parameters(p, directions, n, s)
        # The columns of a smooth arc are more accurate by dop853, and need half the time.
        method = "dop853" if options.method == "adams" else options.method
        chosen = replace(options, method=method)

        def build(exact: bool) -> tuple[EngineBinding, Any]:
            flow = tangent_flow(automaton.flow, n, p.size, s, s, exact=exact)
            extended = with_columns(automaton, flow, self._block, size)
            binding = create_engine(replace(problem, options=chosen), extended)
            return binding, tangents_of_events(problem, binding, s, exact)

        self._binding, (tangents, self._kernel) = exact_or_not(automaton, build)
        self._workspace = variational_workspace(problem, s, size, tangents)

    def at(self, times: Floats, side: str = "after", inner: bool = False) -> Columns:
        """Return the columns at all events, and at some times since the start of period 0.

        With `inner`, at closest approaches and crossings of the section, too. Raises RunError if an
        arc cannot be integrated with its columns.
        """
        rows, path = self._path(np.asarray(times, dtype=float), side, inner)
        kinds = np.full(len(rows), SMOOTH, dtype=object)
        first, lost = 0, np.zeros((len(rows), self._s), dtype=bool)
        while (result := self._binding.call(propagate_columns, self._block, path, first)) >= 0:
            first = self._resolve(path, rows, kinds, lost, result)
        if result < DONE:
            raise RunError(
                reason="the derivatives of the run cannot be integrated",
                remedy="loosen or tighten rtol and atol",
                cycle=int(path.times[-2 - result, 3]),
                phase_time=float(path.times[-2 - result, 0]),
                mode=self._problem.automaton.modes[int(path.pieces[-2 - result, 0])],
                state={},
                period=self._problem.period,
            )
        path.instants[lost] = np.nan
        for values in (path.before, path.after):
            values.transpose(0, 2, 1)[lost] = np.nan
        self._end_chatter(path, kinds)
        errors = self._mark_grazes(path, kinds)
        return Columns(
            rows, self._states(rows, path), path.before, path.after, path.slopes, path.instants,
            path.times[:, 3], path.times[:, 1], kinds.astype(str), errors,
        )  # fmt: skip

    def _path(
        self, samples: Floats, side: str, inner: bool
    ) -> tuple[NDArray[np.int64], ColumnPath]:
        """Return the row of the event log of each piece, and the pieces."""
        trajectory, problem, n, s = self._trajectory, self._problem, self._n, self._s
        log, start, period = trajectory.events, trajectory.start, problem.period
        inside = (APPROACH, SECTION_CROSSING) if inner else ()
        kinds = (TRANSITION, ACCUMULATION, SWITCH, REBASE, *inside)
        shown = np.flatnonzero(np.isin(log.kind, kinds))
        instants = log.cycle[shown] * period + log.time[shown]
        places = np.searchsorted(instants, samples, side="right" if side == "after" else "left")
        numbers = np.concatenate([shown, np.full(samples.size, -1)])
        order = np.argsort(np.concatenate([np.arange(shown.size) + 0.5, places]), kind="stable")
        rows, count = numbers[order], len(order)
        later = np.concatenate([instants, samples])[order]
        # The last entry is that of a sample, or of the start before the first event.
        events = log.cycle, log.time, log.kind, log.guard, log.mode_after
        first = start.cycle, start.time, SAMPLE, 0, start.mode
        listed = [np.append(column, last) for column, last in zip(events, first, strict=True)]
        cycle, instant, kind, guard, mode_after = (column[rows] for column in listed)
        logged = rows >= 0
        happens = logged & ~np.isin(kind, inside)
        numbered = np.arange(count)
        latest = np.maximum.accumulate(np.where(happens, numbered, -1))
        before = np.where(latest >= 0, rows[latest], -1)
        before = np.concatenate([[-1], before[:-1]])
        reached, since, _, _, mode = (column[before] for column in listed)
        # Events of one instant have one time base.
        moves = ~(logged & (cycle == reached) & (instant == since))
        bases = np.append(reached, start.cycle)[
            np.maximum.accumulate(np.where(moves, numbered, -1))
        ]
        shifts = np.diff(bases, prepend=start.cycle)
        ends_at = np.where(happens, instant + (cycle - bases) * period, later - bases * period)
        begins = np.empty(count)
        time = start.time
        for i, (end, shift) in enumerate(zip(ends_at.tolist(), shifts.tolist(), strict=True)):
            begins[i] = time = since[i] if shift else time
            ends_at[i] = time = max(end, time)
        switch_rates, switches = np.zeros((count, s)), np.array(problem.switches)
        for i in np.flatnonzero(kind == SWITCH).tolist() if switches.size else ():
            whole = np.round((switches - instant[i]) / period)
            nearest = int(np.argmin(np.abs(switches - instant[i] - whole * period)))
            later_periods = cycle[i] - bases[i] - whole[nearest]
            switch_rates[i] = self._quantities.switch_rates[:, nearest]
            switch_rates[i] += later_periods * self._quantities.period_rates
        shown_kind = np.where(happens | (kind == APPROACH), kind, SAMPLE)
        pieces = np.column_stack([mode, shown_kind, guard, np.where(happens, mode_after, mode)])
        starts, arrivals = np.full((2, 1 + count, n), np.nan)
        ends = np.zeros((count, n))
        starts[0], ends[happens] = start.y, log.after[rows[happens]]
        arrivals[:-1][happens] = log.before[rows[happens]]
        arrivals[:, ~self._moving] = np.nan
        starts[1:][happens] = ends[happens]
        for states in (starts, ends):
            states[:, ~self._moving] *= 0.0
        y = np.concatenate([starts[0], self._quantities.starts.ravel()])
        automaton, options = problem.automaton, problem.options
        path = ColumnPath(
            variational=self._workspace,
            columns=s,
            pieces=pieces.astype(np.int64),
            times=np.column_stack([begins, ends_at, shifts, bases]),
            starts=starts[:count],
            arrivals=arrivals[:count],
            ends=ends,
            period_rates=np.ascontiguousarray(self._quantities.period_rates),
            switch_rates=switch_rates,
            records=np.array([int(guard.records) for guard in automaton.guards], dtype=np.int64),
            tolerances=np.array([options.rtol, options.atol, problem.time_scale or period, period]),
            clock=-1 if automaton.clock is None else automaton.clock,
            y=y,
            y_start=y.copy(),
            before=np.zeros((count, n, s)),
            after=np.zeros((count, n, s)),
            slopes=np.zeros((count, 2, n)),
            instants=np.zeros((count, s)),
            margins=np.zeros((count, 3)),
            first_margins=np.zeros(2 * len(automaton.guards)),
        )
        return rows, path

    def _states(self, rows: NDArray[np.int64], path: ColumnPath) -> Floats:
        """Return the states after the pieces; along an arc, cyclic components begin at zero."""
        log, start = self._trajectory.events.after, self._trajectory.start.y
        logged, known = rows >= 0, np.vstack([log, start])
        arc = np.maximum.accumulate(np.where(logged, np.arange(len(rows)), -1))
        began = known[np.where(arc >= 0, rows[arc], -1)]
        return np.where(logged[:, None], began, path.ends + np.where(self._moving, 0.0, began))

    def _resolve(
        self,
        path: ColumnPath,
        rows: NDArray[np.int64],
        kinds: NDArray[Any],
        lost: NDArray[np.bool_],
        tie: int,
    ) -> int:
        """Propagate the columns through simultaneous events; return the number of the next piece.

        Events of one instant may happen in any order nearby. Every order has columns of its own;
        the order of a perturbed motion is that of the instants at which it meets each guard.
        """
        t, begin, end = path.times[tie, 1], tie - 1, tie + 1
        while (
            begin > 0
            and path.times[begin, 0] == path.times[begin, 1]
            and (path.pieces[begin - 1, 1] == TRANSITION)
        ):
            begin -= 1
        while (
            end < len(rows)
            and path.times[end, 1] <= t
            and path.times[end, 2] == 0.0
            and (path.pieces[end, 1] == TRANSITION)
        ):
            end += 1
        guards, log = path.pieces[begin:end, 2].tolist(), self._trajectory.events
        columns, mode = path.before[begin].copy(), int(path.pieces[begin, 0])
        state = np.where(self._moving, log.before[rows[begin]], 0.0)
        instant, kinds[begin:end] = (t, path.times[begin, 3]), TIE
        margins, instants = path.first_margins.copy(), {}
        known = tie == begin + 1 and len(set(guards)) == len(guards) <= MOST_TIED
        for guard in guards:
            alone, *_ = self._cross(path, instant, columns, mode, state, guard)
            instants[guard] = alone.instants[0]
            rate, _, error = alone.margins[0]
            below = simultaneous_below(error, rate, path.tolerances[2])
            known &= guard == guards[0] or abs(margins[guard]) <= below
        outcomes = {}
        for order in permutations(guards) if known else ():
            w, y, reached = columns, state, mode
            for guard in order:
                alone, y, reached = self._cross(path, instant, w, reached, y, guard)
                w = alone.after[0]
            same = np.abs(y - path.ends[end - 1]) <= SAME_RTOL * (1.0 + np.abs(y))
            if reached == path.pieces[end - 1, 3] and same.all():
                outcomes[order] = w
        after = np.zeros_like(columns)
        for c in range(self._s):
            ahead = tuple(sorted(guards, key=lambda guard: float(instants[guard][c])))
            sides = (ahead,) if self._one_sided else (ahead, ahead[::-1])
            found = np.array([outcomes[side][:, c] for side in sides if side in outcomes])
            differs = (
                len(found) < len(sides)
                or (np.abs(found - found[0]) > SAME_RTOL * np.abs(found).max()).any()
            )
            if differs:
                lost[end - 1 if known else begin + 1 :, c] = True
            else:
                after[:, c] = found[0]
        w, y, reached = columns, state, mode
        for i, guard in enumerate(guards, begin):
            alone, y, reached = self._cross(path, instant, w, reached, y, guard)
            path.before[i], path.after[i], w = w, alone.after[0], alone.after[0]
            path.instants[i], path.slopes[i] = instants[guard], alone.slopes[0]
        path.after[end - 1], path.y[self._n :] = after, after.ravel()
        return end

    def _cross(
        self,
        path: ColumnPath,
        instant: tuple[float, float],
        columns: Floats,
        mode: int,
        state: Floats,
        guard: int,
    ) -> tuple[ColumnPath, Floats, int]:
        """Return one event as a path, and state and mode after it."""
        (t, base), n, s = instant, self._n, self._s
        p = self._problem.parameters_at(int(base))
        mode_after, end = self._problem.automaton.state_after(mode, guard, t, state, p)
        alone = path._replace(
            pieces=np.array([[mode, TRANSITION, guard, mode_after]]),
            times=np.array([[t, t, 0.0, base]]),
            starts=state[None].astype(float),
            arrivals=np.full((1, n), np.nan),
            ends=end[None],
            y=np.concatenate([state, columns.ravel()]),
            before=np.zeros((1, n, s)),
            after=np.zeros((1, n, s)),
            slopes=np.zeros((1, 2, n)),
            instants=np.zeros((1, s)),
            margins=np.zeros((1, 3)),
            switch_rates=np.zeros((1, s)),
        )
        self._binding.call(propagate_columns, self._block, alone, 0)
        return alone, end, mode_after

    def _end_chatter(self, path: ColumnPath, kinds: NDArray[Any]) -> None:
        """Write the derivatives of the instants at which chatter ends.

        The rest of a sequence after a flight of length T is T r/(1 - r), with the ratio r of the
        last two flights.
        """
        for i in np.flatnonzero(path.pieces[:, 1] == ACCUMULATION).tolist():
            kinds[i] = CHATTER_ENDS
            hits = np.flatnonzero(
                (path.pieces[:i, 1] == TRANSITION) & (path.pieces[:i, 2] == path.pieces[i, 2])
            )[-3:]
            base = path.times[i, 3]
            times = path.times[hits, 1] + (path.times[hits, 3] - base) * self._problem.period
            rates = path.instants[hits] + np.outer(
                path.times[hits, 3] - base, self._quantities.period_rates
            )
            path.instants[i] = rates[-1] if len(hits) else 0.0
            remaining = path.times[i, 1] - times[-1] if len(hits) else 0.0
            if len(hits) == 3 and remaining > 0.0:
                (before, last), (before_rate, last_rate) = np.diff(times), np.diff(rates, axis=0)
                ratio = remaining / (remaining + last)
                ratio_rate = ratio * (last_rate / last - before_rate / before)
                change = remaining * (last_rate / last + ratio_rate / (ratio * (1.0 - ratio)))
                path.instants[i] += change

    def _mark_grazes(self, path: ColumnPath, kinds: NDArray[Any]) -> Floats:
        """Return the errors of the instants by the errors of the margins; nan beyond a graze.

        At the depth rate^2/(2 change) beyond a graze the instant changes as the square root of the
        margin. It is unknown where the error of the margin exceeds the depth.
        """
        rates, changes, errors = path.margins.T
        errors = ERRORS_OF_RUNS * errors
        with np.errstate(divide="ignore", invalid="ignore"):
            depths = np.where(changes > 0.0, rates**2 / (2.0 * changes), np.inf)
            parts = np.where(errors > 0.0, errors / (2.0 * depths), 0.0)
        for i in np.flatnonzero(parts >= 0.5).tolist()[:1]:
            kinds[i] = GRAZE
            path.instants[i:], path.after[i:], path.before[i + 1 :] = np.nan, np.nan, np.nan
        return parts
