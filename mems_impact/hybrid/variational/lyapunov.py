"""Lyapunov exponents of a run.

`LyapunovIntegrator` runs a problem with perturbations chunk by chunk (`saltation`).
`largest` serves studies: it returns the largest exponent per period, its standard error and the
number of periods. Its result depends only on its arguments and is reproducible to the last bit. All
integration releases the GIL.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact.errors import FunctionError, RunError
from mems_impact.hybrid.engine import EngineBinding, LoopMemory, create_engine
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.event_loop.long_steps import STEPS_PER_PERIOD
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import run
from mems_impact.hybrid.state import HybridState
from mems_impact.hybrid.variational.derivatives import free_components
from mems_impact.hybrid.variational.flow import (
    exact_or_not,
    extended_parameters,
    tangent_flow,
    tangents_of_events,
    with_columns,
)
from mems_impact.hybrid.variational.saltation import (
    STRETCHING,
    ZERO_COLUMN,
    PerturbationState,
    PropagationProblem,
    constrain,
    flow_at,
    orthonormalize,
    reset,
    stretch,
    variational_workspace,
)

CHUNK = 60  # periods per chunk, a multiple of the periods 1 to 6 of orbits
MIN_CHUNKS = 16  # number of chunks for a standard error
GOLDEN_SECTION = 0.5 * (math.sqrt(5.0) - 1.0)


class Exponents(NamedTuple):
    """Lyapunov exponents, largest first."""

    per_period: Floats  # per period of the problem, shape (k,); -inf if perturbations vanish
    errors: Floats  # standard errors, shape (k,); nan for fewer than `MIN_CHUNKS` chunks
    periods: float  # length of the average


class LyapunovIntegrator:
    """A run, continued chunk by chunk, and the growth of k (`count`) perturbations.

    The start is on the attractor; k is at most the number of non-cyclic components; a chunk has
    `chunk` periods. If `uneven`, chunk lengths vary from one half to three halves of that length,
    for autonomous systems, whose period may be close to the length of a chunk. If `balanced`,
    components of columns are weighted for lengths and angles. Exponents do not depend on weights;
    without them, columns of a badly scaled system are nearly parallel.
    """

    def __init__(
        self,
        problem: Problem,
        start: HybridState,
        count: int = 1,
        *,
        chunk: int = CHUNK,
        uneven: bool = False,
        balanced: bool = False,
    ) -> None:
        automaton, n = problem.automaton, len(problem.automaton.states)
        self._columns, self._size = count, n * (1 + count)
        self.chunk, self.uneven = chunk, uneven

        def build(exact: bool) -> tuple[EngineBinding, Any]:
            flow = tangent_flow(automaton.flow, n, len(problem.parameters), count, exact=exact)
            parameters = _with_scratch(problem, self._size)
            extended = with_columns(
                automaton, flow, parameters, self._size, guarded=True, known=False
            )
            binding = create_engine(problem, extended)
            return binding, tangents_of_events(problem, binding, 0, exact)

        self._binding, (tangents, self._kernel) = exact_or_not(automaton, build)
        self._workspace = variational_workspace(problem, 0, self._size, tangents)
        self._free = list(free_components(automaton))
        self._cyclic = np.array([int(i in automaton.cyclic) for i in range(n)])
        self._weights, self._balanced = np.ones(n), balanced
        self._records = np.array([int(guard.records) for guard in automaton.guards], dtype=np.int64)
        self._initialize(problem, start)
        addresses, _ = self._binding.kernel_addresses(self._memory.clock, None, n, 0)
        self._work = self._binding.record(STRETCHING, {}, {"advance": addresses.get("advance", 0)})

    def restart(self, problem: Problem, start: HybridState) -> None:
        """Begin again, with a problem that differs in parameters and times only."""
        longest_step = (problem.time_scale or problem.period) / STEPS_PER_PERIOD
        self._binding.call(reset, _with_scratch(problem, self._size), longest_step)
        self._initialize(problem, start)
        self._work["steps"] = 0

    def _initialize(self, problem: Problem, start: HybridState) -> None:
        """Set the initial state of run and columns; the engine is in its own."""
        n, binding, options = self._workspace.n, self._binding, problem.options
        self.problem, self.final = problem, start
        self.growth: list[Floats] = []
        self.lengths: list[float] = []
        binding.engine.import_memory(start.remembered)
        self._memory = LoopMemory(
            problem,
            binding,
            0,
            cycle=start.cycle,
            t=start.time,
            mode=start.mode,
            switched=int(start.switched),
            initial=int(start.initial),
            end_cycle=start.cycle,
            end_phase=start.time,
            events_from=start.cycle,
            section=workspace.NONE,  # perturbations do not need its crossings
        )
        self._memory.put(start)
        scale = problem.time_scale or problem.period
        self._propagation = PropagationProblem(
            variational=self._workspace,
            k=self._columns,
            period=problem.period,
            scale=scale,
            rtol=options.rtol,
            atol=options.atol,
            cyclic=self._cyclic,
            records=self._records,
            switches=np.array(problem.switches, dtype=float),
            weights=self._weights,
        )
        y = np.zeros(self._size)
        y[self._free] = np.asarray(start.y, dtype=float)[self._free]
        self._state = PerturbationState(
            y=y,
            mode=np.array([start.mode], dtype=np.int64),
            t=np.array([start.time]),
            shifts=np.zeros(self._columns),
            growth=np.zeros(self._columns),
            alive=np.ones(self._columns, dtype=np.int64),
            jumps=np.zeros(n, dtype=np.int64),
            length=np.array([scale]),
        )
        if self._balanced:
            self._weights[:] = self._balancing_weights()
        self._set_columns(np.zeros(n, dtype=bool))

    @property
    def result(self) -> Exponents:
        """The exponents so far."""
        growth = np.array(self.growth).reshape(-1, self._propagation.k)
        lengths, periods = np.array(self.lengths), sum(self.lengths)
        rates = growth.sum(axis=0) / periods if periods else np.full(self._propagation.k, math.nan)
        is_dead, errors = self._state.alive == 0, standard_errors(growth, lengths)
        return Exponents(
            np.where(is_dead, -math.inf, rates),
            np.where(is_dead, 0.0, np.hypot(errors, self.problem.options.rtol)),
            periods,
        )

    @property
    def speed(self) -> float:
        """The present rate of change of the state, in the units of the numerics."""
        slope = np.abs(self._slopes()[0])
        return float(slope[self._propagation.cyclic == 0].max(initial=0.0))

    def advance_exponents(
        self, count: int = 1, progress: Callable[[float], None] | None = None
    ) -> None:
        """Run further chunks.

        Raises RunError if the run cannot continue. As on Ctrl-C, complete chunks are kept.
        """
        first = len(self.lengths)
        lengths = np.array([self._length(first + i) for i in range(count)])
        growth = np.zeros((count, self._propagation.k))
        clock, work = self._memory.clock, self._work
        start = clock["end_cycle"] + clock["end_phase"] / clock["period"]
        work["chunk"] = work["begun"] = 0
        status = workspace.PAUSED
        try:
            while status == workspace.PAUSED:
                status = self._binding.quota.call(
                    self._binding.call,
                    stretch,
                    clock,
                    work,
                    self._state,
                    self._propagation,
                    lengths,
                    growth,
                )
                collapse = self._memory.take_step_collapse()
                if collapse is not None and self.problem.discontinuity_check is not None:
                    self.problem.discontinuity_check(*collapse)
                if progress is not None:
                    progress(float(clock["cycle"] + clock["t"] / clock["period"] - start))
        except FunctionError as error:
            raise self._failure(lengths, status) from error
        finally:
            chunk_count = int(work["chunk"])
            self.growth += list(growth[:chunk_count])
            self.lengths += lengths[:chunk_count].tolist()
        if status != workspace.DONE:
            raise self._failure(lengths, status)
        self.final = HybridState(
            int(clock["end_cycle"]),
            float(clock["end_phase"]),
            int(clock["mode"]),
            self._memory.state,
            self._binding.engine.export_memory(),
            waiting=self._memory.waiting,
        )

    def align(self, progress: Callable[[float], None] | None = None) -> None:
        """Run one uncounted chunk, in which columns align with the directions of fastest growth.

        A second chunk follows if events have changed components that were assumed fixed.
        """
        self.advance_exponents(1, progress)
        jumps = self._state.jumps == 1
        if (self._fixed & jumps).any():
            self._set_columns(jumps)
            self.advance_exponents(1, progress)
        self.growth.clear()
        self.lengths.clear()

    def _length(self, number: int) -> float:
        """Return the length of a chunk in periods."""
        if not self.uneven:
            return float(self.chunk)
        return self.chunk * (0.5 + GOLDEN_SECTION * number % 1.0)

    def _failure(self, lengths: Floats, status: int) -> RunError:
        """Return the error that stopped run or columns, from an ordinary run up to there."""
        periods = float(lengths[: int(self._work["chunk"]) + 1].sum())
        try:
            run(self.problem, self.final, periods, consume=lambda _: None)
        except RunError as error:
            return error
        reason = "a perturbation of the run cannot be integrated"
        remedy = "check parameters and drive at this time; loosen or tighten rtol and atol"
        if status == workspace.ENDED:
            reason, remedy = "the run ends earlier", "reduce the run length, or change the start"
        clock = self._memory.clock
        return RunError(
            reason=reason,
            remedy=remedy,
            cycle=int(clock["cycle"]),
            phase_time=float(clock["t"]),
            mode=self.problem.automaton.modes[int(clock["mode"])],
            state={},
            period=self.problem.period,
        )

    def _slopes(self) -> Floats:
        """Return the derivatives of state and columns, shape (1 + k, n)."""
        state, dy = self._state, np.zeros_like(self._state.y)
        self._binding.call(flow_at, int(state.mode[0]), float(state.t[0]), state.y, dy)
        n = self._propagation.variational.n
        return np.vstack([dy[:n], dy[n:].reshape(n, -1).T])

    def _balancing_weights(self) -> Floats:
        """Return powers of 16 that balance rows and columns of the Jacobian matrix at the start."""
        from scipy.linalg import matrix_balance

        n = self._propagation.variational.n
        column, jacobian = self._state.y[n:].reshape(n, -1)[:, 0], np.zeros((n, n))
        for j in range(n):
            column[:] = 0.0
            column[j] = 1.0
            jacobian[:, j] = self._slopes()[1]
        finite = np.nan_to_num(jacobian, posinf=0.0, neginf=0.0)
        _, (scales, _) = matrix_balance(finite, permute=False, separate=True)
        exponents = -np.log2(scales)
        return 16.0 ** np.round((exponents - exponents.mean()) / 4.0)

    def _set_columns(self, jumps: NDArray[np.bool_]) -> None:
        """Set the columns to generic directions, except in components that the initial mode fixes.

        A component that the flow does not change is either fixed by a constraint, such as the
        velocity of a stuck frame, or in `jumps`: changed by events only, such as the velocity of a
        body that is free between impacts.
        """
        state, n, k = self._state, self._propagation.variational.n, self._propagation.k
        columns = state.y[n:].reshape(n, k).T
        state.alive[:] = 1
        for c in range(k):
            columns[c] = np.cos(math.sqrt(2.0) * (1.0 + c) * np.arange(1, n + 1) + c)
        self._fixed = (self._slopes() == 0.0).all(axis=0) & ~jumps
        columns[:, self._fixed] = 0.0
        lengths = np.linalg.norm(columns * self._weights, axis=1)
        self._binding.call(constrain, state, self._propagation)
        remaining = np.linalg.norm(columns * self._weights, axis=1)
        state.alive[remaining <= ZERO_COLUMN * lengths] = 0  # rounding errors of the projection
        orthonormalize(1e-6, state, self._propagation)
        self._memory.table[workspace.Y][n : self._size] = state.y[n:].tolist()


def largest(
    stretching: LyapunovIntegrator,
    *,
    tolerance: float,
    sure: float,
    periods: int,
    progress: Callable[[float], None] | None = None,
) -> tuple[float, float, int]:
    """Return the largest exponent per period, its standard error, and the number of periods.

    `stretching` is at its start, with one column. After a chunk in which the perturbation aligns
    with the direction of fastest growth, at least `MIN_CHUNKS` chunks are used; the error is
    checked after each of the further ones. The run stops when the error is below `tolerance`, when
    the exponent differs from zero by `sure` errors and by `tolerance`, or after `periods`.
    `progress` is called several times a second; it may raise. Raises RunError if the run cannot
    continue.
    """
    stretching.align(progress)
    chunk, count = stretching.chunk, MIN_CHUNKS
    while True:
        stretching.advance_exponents(count, progress)
        (exponent,), (error,), total = stretching.result
        is_decided = abs(exponent) > max(sure * error, tolerance)
        if error <= tolerance or is_decided or total + chunk > periods:
            return float(exponent), float(error), int(total)
        count = 1


def _with_scratch(problem: Problem, size: int) -> Floats:
    """Return the parameters of the extended flow."""
    p, n = np.asarray(problem.parameters, dtype=float), len(problem.automaton.states)
    return extended_parameters(p, np.zeros((0, p.size)), n, size // n - 1)


def standard_errors(growth: Floats, lengths: Floats) -> Floats:
    """Return the standard errors of the growth rates of columns.

    `growth`, shape (N, k), are logarithms of the growth in N chunks of a run, of `lengths` (N,).
    Successive chunks are correlated, so they are combined to longer and longer blocks, and the
    largest estimate counts (Flyvbjerg and Petersen 1989). The last blocks are the two halves of the
    run, whose difference shows a slow convergence of the rate, such as log(t)/t.

    A second contribution is the incomplete alignment of the columns and the incomplete last cycle
    of the run: a factor of order one, hence 1/T in the rate over a time T. It is smaller if the
    rates of the two halves agree within d. For columns that approach each other at a rate g, the
    error of the first half is about a = g exp(-g T), and the halves differ by a g T > a^2 T, so
    that a is below sqrt(d/T).
    """
    errors = np.full(growth.shape[1], math.nan)
    if len(growth) < MIN_CHUNKS:
        return errors
    periods = lengths.sum()
    while True:
        rates = growth / lengths[:, None]
        errors = np.fmax(errors, rates.std(axis=0, ddof=1) / math.sqrt(len(rates)))
        if len(growth) < 4:
            break
        even_count = len(growth) // 2 * 2
        growth = growth[0:even_count:2] + growth[1:even_count:2]
        lengths = lengths[0:even_count:2] + lengths[1:even_count:2]
    difference = np.abs(rates[-1] - rates[0])
    return np.hypot(errors, np.minimum(1.0 / periods, np.sqrt(difference / periods)))
