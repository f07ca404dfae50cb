"""Mapping of initial conditions to attractors, in compiled batches."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mems_impact._util.arrays import Floats
from mems_impact.errors import FunctionError
from mems_impact.hybrid.attractors import recurrence
from mems_impact.hybrid.attractors.recurrence import (
    AT_REST,
    END_CYCLE,
    END_MODE,
    END_TIME,
    MEASURED,
    NUMBERS,
    OUTCOME,
    REPEATS,
    RESULTS,
    RETURNS,
)
from mems_impact.hybrid.automaton import GENERATED
from mems_impact.hybrid.definition import Typical, function, indented, named_tuple
from mems_impact.hybrid.engine import LoopMemory, create_engine
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.event_loop.long_steps import STEPS_PER_PERIOD
from mems_impact.hybrid.problem import Problem, ProblemParameters
from mems_impact.hybrid.state import HybridState

# --- Observables


@dataclass(frozen=True)
class CompiledObservables:
    """The observables of a motion, as one function.

    ``function(mode, code, t, states, p, out)`` writes the observables: with `code` -1 those of the
    state (`gains`), into the first components of `out`; with the code of a transition those of its
    events (`marks`), into the components after them. `states` contains the states before and after
    an event.
    """

    function: Callable[..., Any]
    gains: tuple[str, ...]
    marks: tuple[str, ...]


@cache
def observed(
    observables: tuple[tuple[str, Callable[..., Any], tuple[int, ...]], ...],
    states: tuple[str, ...],
    parameters: tuple[str, ...] | None,
    by_array: bool = False,
    typical: Typical | None = None,
) -> CompiledObservables:
    """Return observables as one function; cached.

    An observable has a name, a function, and the codes of the events at which it is evaluated; none
    for an observable of the state. `parameters` are the names by which functions read ``p``; None
    if they take an array. With `by_array` functions receive the state as an array. `typical` has
    the units of the numerics, if they differ from those of the functions.
    """
    gains = [each for each in observables if not each[2]]
    marks = [each for each in observables if each[2]]
    n, count = len(states), 0 if parameters is None else len(parameters)
    space: dict[str, Any] = {"__name__": __name__, "nan": math.nan}
    units = [1.0] * n if typical is None else list(typical.states)
    p_units = [1.0] * count if typical is None else list(typical.parameters)
    time = 1.0 if typical is None else typical.time

    def state(first: int) -> str:
        if by_array:
            return f"y[{first}:{first + n}]"
        return "State(" + ", ".join(_times(f"y[{first + i}]", units[i]) for i in range(n)) + ")"

    lines: list[str] = []
    if by_array and typical is not None:
        space["SIZE"] = typical.states * 2
        lines += [f"for k in range({2 * n}):", "    y[k] *= SIZE[k]"]
    if not by_array:
        space["State"] = named_tuple("State", states)
    if parameters is None:
        lines.append("q = p")
    else:
        space["Parameters"] = named_tuple("Parameters", parameters)
        values = (_times(f"p[{i}]", p_units[i]) for i in range(count))
        lines.append("q = Parameters(" + ", ".join(values) + ")")
    lines += [f"before = {state(0)}", f"after = {state(n)}", f"time = {_times('t', time)}"]
    state_lines, event_lines = [], []
    for i, (_, observable, _guards) in enumerate(gains):
        space[f"gain_{i}"] = observable
        state_lines.append(f"out[{i}] = gain_{i}(before, q)")
    for i, (_, observable, codes) in enumerate(marks):
        space[f"mark_{i}"] = observable
        condition = " or ".join(f"code == {code}" for code in codes)
        event_lines.append(f"if {condition}:")
        event_lines += indented([f"out[{len(gains) + i}] = mark_{i}(mode, time, before, after, q)"])
    lines += ["if code < 0:", *indented(state_lines or ["pass"])]
    lines += ["else:", *indented(event_lines or ["pass"])]
    text = function("observe(mode, code, t, y, p, out)", lines)
    exec(compile(text, GENERATED, "exec"), space)
    names = (tuple(each[0] for each in group) for group in (gains, marks))
    return CompiledObservables(space["observe"], *names)


def _times(name: str, unit: float) -> str:
    return name if unit == 1.0 else f"{name} * {unit!r}"


# --- Batches of points

MAX_PERIOD_STARTS = 32  # starts of forcing periods that the sample buffer can hold


@dataclass(frozen=True, kw_only=True)
class RecurrenceColumns:
    """The attractors of points, by columns, in the units of the numerics.

    Each array has one row per point; an array of one axis is a column.
    """

    outcome: NDArray[np.int64]  # PERIODIC, APERIODIC, STATIONARY or FAILED of `recurrence`
    repeats: NDArray[np.int64]  # period of the motion in returns; 0 if it is not periodic
    returns: NDArray[np.int64]  # number of computed returns
    # Number of returns that the statistics below cover: one period of a periodic motion.
    measured: Floats
    at_rest: NDArray[np.bool_]  # whether all non-cyclic components are at rest
    # Time and mode of the last state, in this and the next two; of a periodic motion that at the
    # last return.
    cycle: NDArray[np.int64]
    time: Floats
    mode: NDArray[np.int64]
    y: Floats  # the last state, shape (points, n)
    duration: Floats  # time that the statistics cover
    endings: Floats  # number of complete chatter sequences
    counts: Floats  # transitions by guard, shape (points, m)
    closest: Floats  # smallest margins at closest approaches, shape (points, m); inf without any
    lasted: Floats  # time in each mode, shape (points, modes)
    gains: dict[str, Floats]  # total change of each observable of the state
    deviations: dict[str, Floats]  # standard deviation of the change per return
    # Of each observable at events: number, sum, minimum, maximum; shape (points, 4).
    marks: dict[str, Floats]
    # The states at the last returns, latest first, shape (points, longest, n); NaN for returns
    # before the start.
    visited: Floats

    def take(self, points: Sequence[int]) -> RecurrenceColumns:
        """Return the columns of some points."""
        columns: dict[str, Any] = {
            name: {key: column[points] for key, column in value.items()}
            if isinstance(value, dict)
            else value[points]
            for name, value in vars(self).items()
        }
        return RecurrenceColumns(**columns)

    def final(self, i: int) -> HybridState:
        """Return the last state of point `i`."""
        return HybridState(int(self.cycle[i]), float(self.time[i]), int(self.mode[i]), self.y[i])

    def states(self, i: int) -> Floats:
        """Return the states of point `i` at its last returns: one period, or all that are known."""
        repeats = int(self.repeats[i])
        if repeats:
            return self.visited[i, :repeats]
        is_known = ~np.isnan(self.visited[i]).any(axis=1)
        return self.visited[i, is_known]


class AttractorMapper:
    """Maps initial states to attractors, for points of one automaton.

    Each point replaces parameters and switching times of the problem, whose numbers are fixed.
    `longest` is the longest period, in returns; `tolerance` is relative, per component, for
    recognizing a periodic motion. `return_kind` is STROBOSCOPIC, AT_SECTION or AT_GUARD of
    `recurrence`, and `return_index` the direction of the section, or the guard. `observed` are
    observables beside counts and times.
    """

    def __init__(
        self,
        problem: Problem,
        *,
        longest: int,
        tolerance: float,
        return_kind: int = recurrence.STROBOSCOPIC,
        return_index: int = 0,
        observed: CompiledObservables | None = None,
    ) -> None:
        automaton = problem.automaton
        n, m = len(automaton.states), len(automaton.guards)
        self._observed = observed or NO_OBSERVABLES
        gains, marks = len(self._observed.gains), len(self._observed.marks)
        is_forced = return_kind == recurrence.STROBOSCOPIC
        without = {"section": workspace.NONE} if is_forced else {}  # only other returns need it
        self._binding = binding = create_engine(problem, sectioned=not is_forced)
        self._sizes = n, m, len(automaton.modes), gains, marks
        self._loop = LoopMemory(problem, binding, MAX_PERIOD_STARTS if is_forced else 0, **without)
        self._clock = clock = self._loop.clock
        observe = self._observed.function if gains + marks else None
        addresses, self._kernels = binding.kernel_addresses(clock, observe, n, gains + marks)
        self._work = binding.record(
            recurrence.WORK,
            {},
            {
                **addresses,
                "return_kind": return_kind,
                "return_index": return_index,
                "longest": longest,
                "tolerance": tolerance,
                "noise": problem.options.rtol,
                "min_size": problem.options.atol / problem.options.rtol,
                "gains": gains,
                "marks": marks,
            },
        )
        self._longest = longest
        widths = {"head": 2, "counts": m, "closest": m, "lasted": len(automaton.modes)}
        widths |= {"gains": gains, "marks": recurrence.PARTS * marks, "squares": gains}
        widths = {"y": n, **widths, "states": longest * n}
        ends = np.cumsum([RESULTS, *widths.values()]).tolist()
        self._slices = {
            name: slice(*pair) for name, pair in zip(widths, pairwise(ends), strict=True)
        }
        self._memory = np.zeros(recurrence.memory_shape(n, m, len(automaton.modes), self._work))
        self._set_array("memory", "memory_width", self._memory)

    def follow(
        self,
        points: Sequence[tuple[ProblemParameters, HybridState]],
        transient: float,
        length: float,
        watch: Callable[[float], None] | None = None,
        discontinuity_check: Callable[[int, HybridState, float], None] | None = None,
    ) -> RecurrenceColumns:
        """Compute the attractors of points: parameters of the problem and initial state of each.

        The longest transient is in periods of the problem, as is the length of the statistics of a
        motion that is not periodic by then. `watch` is called several times a second with the
        number of completed points; it may raise. `discontinuity_check` is as that of `Problem`,
        with the number of the point as first argument. A failed point has the outcome FAILED; an
        ordinary run gives the reason.
        """
        n, m, modes, _, _ = self._sizes
        inputs = np.array([_row(*point, m) for point in points])
        width = recurrence.result_width(n, m, modes, self._work)
        results = np.zeros((len(points), width))
        work = self._work
        self._set_array("inputs", "input_width", inputs)
        self._set_array("results", "result_width", results)
        work["points"], work["point"], work["begun"] = len(points), 0, 0
        work["transient"], work["length"] = transient, length
        status = workspace.PAUSED
        while status != workspace.DONE:
            try:
                status = self._binding.quota.call(
                    self._binding.call, recurrence.map_points, self._clock, work
                )
            except FunctionError:  # an ordinary run of the point reports it
                status = workspace.PAUSED
            collapse = self._loop.take_step_collapse()
            if collapse is not None and discontinuity_check is not None:
                discontinuity_check(int(work["point"]), *collapse)
            if watch is not None:
                watch(float(work["point"]))
        return self._columns(results)

    def _set_array(self, name: str, width: str, rows: Floats) -> None:
        """Write array or address, and the width, of rows of numbers into the work record."""
        self._work[name] = self._binding.array_reference(rows)
        self._work[width] = rows.shape[1]

    def close(self) -> None:
        """Free the engine's memory."""
        self._binding.engine.close()

    def _columns(self, results: Floats) -> RecurrenceColumns:
        points, slices, observed = len(results), self._slices, self._observed
        head, measured = results[:, slices["head"]], results[:, MEASURED]
        squares = (
            results[:, slices["squares"]] / np.where(measured > 0.0, measured, math.nan)[:, None]
        )
        marks = results[:, slices["marks"]].reshape(points, len(observed.marks), recurrence.PARTS)

        def integers(column: int) -> NDArray[np.int64]:
            return results[:, column].astype(np.int64)

        def by_name(names: tuple[str, ...], columns: Floats) -> dict[str, Floats]:
            return {name: columns[:, i] for i, name in enumerate(names)}

        return RecurrenceColumns(
            outcome=integers(OUTCOME),
            repeats=integers(REPEATS),
            returns=integers(RETURNS),
            measured=measured,
            at_rest=results[:, AT_REST] == 1.0,
            cycle=integers(END_CYCLE),
            time=results[:, END_TIME],
            mode=integers(END_MODE),
            y=results[:, slices["y"]],
            duration=head[:, 0],
            endings=head[:, 1],
            counts=results[:, slices["counts"]],
            closest=results[:, slices["closest"]],
            lasted=results[:, slices["lasted"]],
            gains=by_name(observed.gains, results[:, slices["gains"]]),
            deviations=by_name(observed.gains, np.sqrt(squares)),
            marks=by_name(observed.marks, marks),
            visited=results[:, slices["states"]].reshape(points, self._longest, self._sizes[0]),
        )


NO_OBSERVABLES = CompiledObservables(lambda mode, code, t, states, p, out: None, (), ())


def _row(numbers: ProblemParameters, start: HybridState, m: int) -> NDArray[np.float64]:
    """Return a row of the inputs of `recurrence` for an automaton of m guards."""
    scale = numbers.time_scale or numbers.period
    head = np.zeros(NUMBERS)
    head[recurrence.PERIOD], head[recurrence.SCALE] = numbers.period, scale
    head[recurrence.LONGEST_STEP] = scale / STEPS_PER_PERIOD
    head[recurrence.PHASE], head[recurrence.MODE] = start.time, start.mode
    head[recurrence.INITIAL] = start.initial
    waiting = np.isin(np.arange(m), start.waiting)
    return np.concatenate([head, waiting, numbers.switches, start.y, numbers.parameters])
