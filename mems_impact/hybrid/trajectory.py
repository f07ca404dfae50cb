"""What a run returns: its events, its last state, and samples on demand."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
from numpy.typing import NDArray

from mems_impact.hybrid import loop
from mems_impact.hybrid.automaton import Automaton, Guard
from mems_impact.hybrid.problem import Problem

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Events:
    """Rows of the event log, as columns.

    Attributes
    ----------
    cycle : int array, shape (k,)
        Periods completed before the event.
    time : float array, shape (k,)
        Time since the start of that period, 0 <= time < period.
    kind : int array, shape (k,)
        TRANSITION, ACCUMULATION, SWITCH, APPROACH, SECTION_CROSSING, REBASE or HANDOVER of
        `mems_impact.hybrid.loop`.
    guard : int array, shape (k,)
        Number of the guard; for a crossing of the section the sign of the crossing; for a handover
        what the engine then remembers of the mode (see `mems_impact.engines.auto.choosing`).
    mode_before, mode_after : int array, shape (k,)
    before, after : float array, shape (k, n)
        The state just before and just after the event.
    """

    cycle: NDArray[np.int64]
    time: Floats
    kind: NDArray[np.int64]
    guard: NDArray[np.int64]
    mode_before: NDArray[np.int64]
    mode_after: NDArray[np.int64]
    before: Floats
    after: Floats

    @classmethod
    def from_rows(cls, rows: Floats) -> Events:
        """Split the rows of the loop's event buffer into columns."""
        integer = rows[:, : loop.HEAD].astype(np.int64)
        n = (rows.shape[1] - loop.HEAD) // 2
        return cls(
            cycle=integer[:, loop.CYCLE],
            time=rows[:, loop.TIME].copy(),
            kind=integer[:, loop.KIND],
            guard=integer[:, loop.GUARD],
            mode_before=integer[:, loop.MODE_BEFORE],
            mode_after=integer[:, loop.MODE_AFTER],
            before=rows[:, loop.HEAD : loop.HEAD + n].copy(),
            after=rows[:, loop.HEAD + n :].copy(),
        )

    @classmethod
    def joined(cls, chunks: Sequence[Events]) -> Events:
        """Join chunks of events, one at least."""
        if len(chunks) == 1:
            return chunks[0]
        columns = ([getattr(chunk, column.name) for chunk in chunks] for column in fields(cls))
        return cls(*(np.concatenate(parts) for parts in columns))

    @property
    def begin_arcs(self) -> NDArray[np.bool_]:
        """Where the rows begin an arc that can be integrated again by itself.

        Passages only note what an arc did, and a handover belongs to the arc before it.
        """
        return ~np.isin(self.kind, (loop.APPROACH, loop.SECTION_CROSSING, loop.HANDOVER))

    @property
    def handovers(self) -> Events:
        """Where the engine has gone on by another method."""
        return self[self.kind == loop.HANDOVER]

    def remembered(self, before: tuple[int, ...]) -> tuple[int, ...]:
        """Return what the engine remembers of each mode after these rows, and before them."""
        rows = self.handovers
        known = dict(enumerate(before))
        known |= zip(rows.mode_after.tolist(), rows.guard.tolist(), strict=True)
        return tuple(known.get(mode, 0) for mode in range(max(known, default=-1) + 1))

    def impacts(self, automaton: Automaton) -> NDArray[np.bool_]:
        """Return where the rows are impacts."""
        return self.impacts_among(automaton.guards)

    def impacts_among(self, guards: Sequence[Guard]) -> NDArray[np.bool_]:
        """Return where the rows are impacts at one of the first of an automaton's guards."""
        places = [i for i, guard in enumerate(guards) if guard.impact]
        return (self.kind == loop.TRANSITION) & np.isin(self.guard, places)

    def crossings(self, direction: int) -> Events:
        """Return the crossings of the section in `direction` (0: both)."""
        wanted = self.kind == loop.SECTION_CROSSING
        return self[wanted if direction == 0 else wanted & (self.guard == direction)]

    def __len__(self) -> int:
        return self.cycle.size

    def __getitem__(self, rows: NDArray[np.bool_] | slice) -> Events:
        """Return the chosen rows."""
        return Events(
            self.cycle[rows],
            self.time[rows],
            self.kind[rows],
            self.guard[rows],
            self.mode_before[rows],
            self.mode_after[rows],
            self.before[rows],
            self.after[rows],
        )


@dataclass(frozen=True)
class Instant:
    """A state and the time at which it holds.

    Attributes
    ----------
    cycle : int
        Periods completed.
    time : float
        Time since the start of the current period.
    mode : int
    y : float array, shape (n,)
    remembered : tuple of int
        What the engine has learnt of each mode, if its method learns; empty at the start of a run.
    """

    cycle: int
    time: float
    mode: int
    y: Floats
    remembered: tuple[int, ...] = ()


@dataclass(frozen=True)
class Samples:
    """The state on a uniform grid of times.

    Attributes
    ----------
    cycle : int array, shape (k,)
    time : float array, shape (k,)
        Time since the start of that period.
    mode : int array, shape (k,)
    y : float array, shape (k, n)
    """

    cycle: NDArray[np.int64]
    time: Floats
    mode: NDArray[np.int64]
    y: Floats


@dataclass(frozen=True)
class Trajectory:
    """A run: where it began and ended and every event that was kept.

    Attributes
    ----------
    problem : Problem
    start, final : Instant
    events : Events
    steps, arcs : int
        Steps of the method and arcs (restarts) that the run took.
    ended : bool
        Whether a transition ended the run.
    implicit_arcs : int
        How many of the arcs method ``"auto"`` has begun by BDF.
    """

    problem: Problem = field(repr=False, compare=False)
    start: Instant
    final: Instant
    events: Events
    steps: int
    arcs: int
    ended: bool
    implicit_arcs: int = 0

    @property
    def automaton(self) -> Automaton:
        """What was run."""
        return self.problem.automaton

    @property
    def period(self) -> float:
        """Unit in which the run is counted."""
        return self.problem.period

    @property
    def stiff(self) -> bool:
        """Whether method ``"auto"`` found BDF worth while, in any mode that was met.

        Of the events only those are known that were kept.
        """
        if (self.events.handovers.guard == 0).any():
            return True
        known, visited = self.final.remembered, {self.start.mode, *self.events.mode_after.tolist()}
        return any(known[mode] < 0 for mode in visited) if known else False

    def with_events(self, events: Events) -> Trajectory:
        """Return the trajectory with events that were kept elsewhere."""
        return replace(self, events=events)

    def samples(
        self, per_period: int, first: float | None = None, last: float | None = None
    ) -> Samples:
        """Return the state at `per_period` equal intervals of every period.

        The arcs concerned are integrated again; a step does not depend on who looks at it, so that
        the samples lie on the very trajectory of the run.

        Parameters
        ----------
        per_period : int
            Samples per period, above 0.
        first, last : float, optional
            Window in periods; the whole run by default.
        """
        from mems_impact.hybrid.run import sample  # which returns trajectories

        start, final = self._arc_before(first), self.final
        if last is not None:
            whole = int(np.floor(last))
            end = Instant(whole, (last - whole) * self.period, final.mode, final.y)
            if (end.cycle, end.time) < (final.cycle, final.time):
                final = end
        samples = sample(self.problem, start, final, per_period)
        if first is None:
            return samples
        keep = samples.cycle + samples.time / self.period >= first - 1e-12
        return Samples(samples.cycle[keep], samples.time[keep], samples.mode[keep], samples.y[keep])

    def _arc_before(self, first: float | None) -> Instant:
        """Return the start of the last kept arc that begins before `first` periods."""
        if first is None:
            return self.start
        events = self.events
        begins = events.begin_arcs
        begins &= events.cycle + events.time / self.period <= first
        # A sequence of impacts is completed by what the loop remembers of it: an arc that begins
        # within one can't be run again without all of it.
        instants = events.cycle * self.period + events.time
        cut = np.count_nonzero(events.cycle + events.time / self.period <= first)
        for guard in range(len(self.automaton.guards)):
            own = events.guard == guard
            ends = np.flatnonzero(own & (events.kind == loop.ACCUMULATION))
            coming = ends[ends >= cut]
            if coming.size:
                since = ends[ends < cut][-1] if coming.size < ends.size else -1
                impacts = np.flatnonzero(own & (events.kind == loop.TRANSITION))
                impacts = impacts[(impacts > since) & (impacts < coming[0])]
                flights = np.diff(instants[impacts])
                longer = np.flatnonzero(flights[1:] >= flights[:-1])
                sequence = impacts[longer[-1] + 1 :] if longer.size else impacts
                if sequence.size:
                    begins[sequence[0] : coming[0]] = False
        places = np.flatnonzero(begins)
        if places.size == 0:
            return self.start
        i = places[-1]
        return Instant(
            int(events.cycle[i]),
            float(events.time[i]),
            int(events.mode_after[i]),
            events.after[i],
            events[:i].remembered(self.start.remembered),
        )
