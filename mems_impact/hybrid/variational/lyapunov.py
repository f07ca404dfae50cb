"""Lyapunov exponents of a run.

`LyapunovIntegrator` runs a problem chunk by chunk and carries columns along (`propagation`);
`largest` is for studies: a `Problem` and a `HybridState` on the attractor in, the largest exponent
per period, its standard error and the periods used out. It draws on nothing but its arguments, so
that its result is the same to the last bit wherever and however often it is asked for; all
integration releases the GIL.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact.errors import RunError
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.problem import LoopMemory, Problem, create_engine
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.hybrid.variational.derivatives import free_components
from mems_impact.hybrid.variational.flow import stretched_flow, with_columns
from mems_impact.hybrid.variational.saltation import (
    STRETCHING,
    PerturbationState,
    PropagationProblem,
    constrain,
    flow_at,
    orthonormalize,
    stretch,
    variational_workspace,
)

CHUNK = 60  # periods in one: whole passes of orbits of up to six periods
MIN_CHUNKS = 16  # chunks of which a standard error is told
GOLDEN_SECTION = 0.5 * (math.sqrt(5.0) - 1.0)


class Exponents(NamedTuple):
    """Lyapunov exponents, largest first, as far as they are known.

    Attributes
    ----------
    per_period : float array, shape (k,)
        In one period of the problem; -inf where nothing is left of perturbations.
    errors : float array, shape (k,)
        Standard errors; nan as long as there are fewer than `MIN_CHUNKS` chunks.
    periods : float
        Over which they were averaged.
    """

    per_period: Floats
    errors: Floats
    periods: float


class LyapunovIntegrator:
    """A run that goes on chunk by chunk, and what k perturbations of it have grown by.

    Parameters
    ----------
    problem : Problem
    start : HybridState
        On the attractor.
    count : int, optional
        k, up to the number of components that are not cyclic.
    chunk : int, optional
        Periods in one.
    uneven : bool, optional
        Whether chunks are of half to three halves of that length, all different: nothing forces the
        system, and what it does may have a period near theirs.
    """

    def __init__(
        self,
        problem: Problem,
        start: HybridState,
        count: int = 1,
        *,
        chunk: int = CHUNK,
        uneven: bool = False,
    ) -> None:
        automaton, options = problem.automaton, problem.options
        n = len(automaton.states)
        p = np.asarray(problem.parameters, dtype=float)
        size = n * (1 + count)
        extended = stretched_flow(automaton.flow, n, count, p.size, automaton.step)
        self.problem, self.final, self.chunk, self.uneven = problem, start, chunk, uneven
        self.grown: list[Floats] = []
        self.lengths: list[float] = []
        self._run = own = create_engine(problem)
        own.engine.import_memory(start.remembered)
        self._memory = LoopMemory(
            problem,
            own,
            0,
            cycle=start.cycle,
            t=start.time,
            mode=start.mode,
            switched=int(start.switched),
            end_cycle=start.cycle,
            end_phase=start.time,
            events_from=start.cycle,
        )
        self._memory.put(start.y)
        clock = self._memory.clock
        places, _ = own.kernel_addresses(clock, None, n, 0)
        numbers = {"plain": own.handle_address, "advance": places.get("advance", 0)}
        self._work = own.record(STRETCHING, {}, numbers)
        self._bound = create_engine(
            with_columns(problem, extended, np.concatenate([p, np.zeros(2 * n)]), size)
        )
        scale = problem.time_scale or problem.period
        self._setup = PropagationProblem(
            variational=variational_workspace(problem, 0, size),
            k=count,
            period=problem.period,
            scale=scale,
            rtol=options.rtol,
            atol=options.atol,
            cyclic=np.array([int(i in automaton.cyclic) for i in range(n)]),
            records=np.array([int(guard.records) for guard in automaton.guards], dtype=np.int64),
            switches=np.array(problem.switches, dtype=float),
        )
        y = np.zeros(size)
        free = list(free_components(automaton))
        y[free] = np.asarray(start.y, dtype=float)[free]
        self._at = PerturbationState(
            y=y,
            place=np.array([start.cycle, start.mode], dtype=np.int64),
            t=np.array([start.time]),
            shifts=np.zeros(count),
            growth=np.zeros(count),
            alive=np.ones(count, dtype=np.int64),
            changed=np.zeros(n, dtype=np.int64),
            length=np.array([scale]),
        )
        self._begin(np.zeros(n, dtype=bool))

    @property
    def result(self) -> Exponents:
        """What is known by now."""
        grown = np.array(self.grown).reshape(-1, self._setup.k)
        lengths, periods = np.array(self.lengths), sum(self.lengths)
        known = grown.sum(axis=0) / periods if periods else np.full(self._setup.k, math.nan)
        dead, errors = self._at.alive == 0, standard_errors(grown, lengths)
        return Exponents(
            np.where(dead, -math.inf, known),
            np.where(dead, 0.0, np.hypot(errors, self.problem.options.rtol)),
            periods,
        )

    @property
    def speed(self) -> float:
        """How fast the state changes now, in the units of the numerics."""
        slope = np.abs(self._slopes()[0])
        return float(slope[self._setup.cyclic == 0].max(initial=0.0))

    def advance_exponents(
        self, count: int = 1, progress: Callable[[float], None] | None = None
    ) -> None:
        """Run some chunks more.

        Raises
        ------
        RunError
            If the run cannot go on. As on Ctrl-C, the chunks done are kept.
        """
        done = len(self.lengths)
        lengths = np.array([self._length(done + i) for i in range(count)])
        grown = np.zeros((count, self._setup.k))
        clock, work = self._memory.clock, self._work
        begin = clock["end_cycle"] + clock["end_phase"] / clock["period"]
        work["chunk"] = work["begun"] = 0
        status = workspace.PAUSED
        try:
            while status == workspace.PAUSED:
                status = self._bound.call(
                    stretch,
                    clock,
                    work,
                    self._at,
                    self._setup,
                    lengths,
                    grown,
                    self._bound.steps_per_call,
                )
                fall = self._memory.take_step_collapse()
                if fall is not None and self.problem.discontinuity_check is not None:
                    self.problem.discontinuity_check(*fall)
                if progress is not None:
                    progress(float(clock["cycle"] + clock["t"] / clock["period"] - begin))
        finally:
            whole = int(work["chunk"])
            self.grown += list(grown[:whole])
            self.lengths += lengths[:whole].tolist()
        if status != workspace.DONE:
            raise self._failure(float(lengths[: whole + 1].sum()))
        self.final = HybridState(
            int(clock["end_cycle"]),
            float(clock["end_phase"]),
            int(clock["mode"]),
            self._memory.state,
            self._run.engine.export_memory(),
        )

    def turn(self, progress: Callable[[float], None] | None = None) -> None:
        """Run one chunk that does not count: the columns turn to where they grow most.

        Another one if events have changed what was taken to be fixed.
        """
        self.advance_exponents(1, progress)
        loose = self._at.changed == 1
        if (self._fixed & loose).any():
            self._begin(loose)
            self.advance_exponents(1, progress)
        self.grown.clear()
        self.lengths.clear()

    def _length(self, number: int) -> float:
        """Return the periods in a chunk."""
        if not self.uneven:
            return float(self.chunk)
        return self.chunk * (0.5 + GOLDEN_SECTION * number % 1.0)

    def _failure(self, periods: float) -> RunError:
        """Return why neither run nor columns go on: an ordinary run, up to there, says so."""
        reason = "a perturbation of the run cannot be integrated"
        remedy = "check parameters and drive at this time; loosen or tighten rtol and atol"
        if not self._work["lost"]:
            reason, remedy = "the run ends before that", "give it less time, or another start"
            try:
                run(self.problem, self.final, periods, consume=lambda _: None)
            except RunError as error:
                return error
        clock = self._memory.clock
        return RunError(
            reason=reason,
            remedy=remedy,
            cycle=int(clock["cycle"]),
            phase_time=float(clock["t"]),
            mode=self.problem.automaton.modes[int(clock["mode"])],
            state={},
        )

    def _slopes(self) -> Floats:
        """Return the derivatives of state and columns, shape (1 + k, n)."""
        at, dy = self._at, np.zeros_like(self._at.y)
        self._bound.call(flow_at, int(at.place[1]), float(at.t[0]), at.y, dy)
        return dy.reshape(-1, self._setup.variational.n)

    def _begin(self, loose: NDArray[np.bool_]) -> None:
        """Put the columns somewhere in general, but for what the mode of the start holds fixed.

        What no flow changes may be held by a constraint, as the velocity of a stuck frame is, or be
        `loose`: changed by events, as that of a body without forces between its impacts.
        """
        at, n, k = self._at, self._setup.variational.n, self._setup.k
        columns = at.y[n:].reshape(k, n)
        at.alive[:] = 1
        for c in range(k):
            columns[c] = np.cos(math.sqrt(2.0) * (1.0 + c) * np.arange(1, n + 1) + c)
        self._fixed = (self._slopes() == 0.0).all(axis=0) & ~loose
        columns[:, self._fixed] = 0.0
        self._bound.call(constrain, at, self._setup)
        orthonormalize(1e-6, at, self._setup)


def largest(
    problem: Problem,
    start: HybridState,
    *,
    tolerance: float,
    sure: float,
    periods: int,
    chunk: int = 16,
) -> tuple[float, float, int]:
    """Return the largest exponent per period, its standard error, and the periods it took.

    Parameters
    ----------
    problem : Problem
    start : HybridState
        On the attractor.
    tolerance : float
        Done when the error is below.
    sure : float
        Done when the exponent is so many errors, and `tolerance`, away from zero: its sign is told.
    periods : int
        Done after so many.
    chunk : int, optional
        Periods between two looks; at least `MIN_CHUNKS` of them are taken, after one in which the
        perturbation turns to where it grows most.

    Raises
    ------
    RunError
        If the run cannot go on.
    """
    stretching = LyapunovIntegrator(problem, start, chunk=chunk)
    stretching.turn()
    count = MIN_CHUNKS
    while True:
        stretching.advance_exponents(count)
        (exponent,), (error,), done = stretching.result
        told = abs(exponent) > max(sure * error, tolerance)
        if error <= tolerance or told or done + chunk > periods:
            return float(exponent), float(error), int(done)
        count = 1


def standard_errors(grown: Floats, lengths: Floats) -> Floats:
    """Return the standard errors of the rates at which columns grow.

    Successive chunks depend on each other, so they are joined to longer and longer blocks, and the
    largest estimate counts (Flyvbjerg and Petersen 1989). Down to two, the halves of the run: what
    the rate still changes between them shows too, as where it settles with log(t)/t.

    Beside it counts that columns are not yet where they grow most, and that the run ends somewhere
    on its way round: a factor of order one, and so 1/T of the rate over a time T. Rates that two
    halves have in common to within d are past that. With columns that approach each other at a rate
    g, a first half is off by some g exp(-g T), and one off by a differs from the other by
    a g T > a^2 T, so that a is below sqrt(d/T).

    Parameters
    ----------
    grown : float array, shape (N, k)
        Logarithms, of N chunks of a run.
    lengths : float array, shape (N,)
    """
    errors = np.full(grown.shape[1], math.nan)
    if len(grown) < MIN_CHUNKS:
        return errors
    periods = lengths.sum()
    while True:
        rates = grown / lengths[:, None]
        errors = np.fmax(errors, rates.std(axis=0, ddof=1) / math.sqrt(len(rates)))
        if len(grown) < 4:
            break
        even = len(grown) // 2 * 2
        grown = grown[0:even:2] + grown[1:even:2]
        lengths = lengths[0:even:2] + lengths[1:even:2]
    apart = np.abs(rates[-1] - rates[0])
    return np.hypot(errors, np.minimum(1.0 / periods, np.sqrt(apart / periods)))
