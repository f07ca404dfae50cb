"""Many points of one automaton, each followed to where it comes to: what drives `settling`."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mems_impact.errors import FunctionError
from mems_impact.hybrid import gathering, loop, settling
from mems_impact.hybrid.memory import LoopMemory
from mems_impact.hybrid.observed import Observed
from mems_impact.hybrid.problem import STEPS_PER_PERIOD, Numbers, Problem, bind
from mems_impact.hybrid.settling import (
    END_CYCLE,
    END_MODE,
    END_TIME,
    MEASURED,
    NUMBERS,
    OUTCOME,
    REPEATS,
    RESULTS,
    RETURNS,
    STILL,
)
from mems_impact.hybrid.trajectory import Floats, Instant

__all__ = ["Recipe", "Settled", "Survey"]

SAMPLES = 128  # forcing periods whose beginnings fit between two looks


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """How points are followed.

    Attributes
    ----------
    transient, length : float
        Periods of the problem that a motion is given to repeat itself, and over which it is then
        measured if it has not.
    longest : int
        Returns after which a motion may repeat itself.
    tolerance : float
        To which it has to, relative to the size of each component.
    returned : int
        What a return is: AT_PERIODS, AT_SECTION or AT_GUARD of `settling`.
    at : int
        The direction of the section, or the guard.
    """

    transient: float
    length: float
    longest: int = 16
    tolerance: float = 1e-6
    returned: int = settling.AT_PERIODS
    at: int = 0


@dataclass(frozen=True, kw_only=True)
class Settled:
    """What has become of a point, in the units of the numerics.

    Attributes
    ----------
    outcome : int
        PERIODIC, WANDERS, REST or FAILED of `settling`.
    repeats : int
        Returns after which the motion repeats itself; 0 if it does not.
    returns : int
        Returns that it was followed for.
    measured : int
        Returns over which was gathered what follows: once round a periodic motion.
    still : bool
        Whether nothing moves but cyclic components.
    final : Instant
        Where it was left: at the last return of a periodic motion.
    duration : float
        Time over which was gathered.
    endings : int
        Sequences of impacts that came to their end.
    counts : float array, shape (m,)
        Transitions by guard.
    closest : float array, shape (m,)
        Smallest margins at closest approaches; inf without any.
    lasted : float array, shape (modes,)
        Time in each mode.
    gains, deviations : dict of str to float
        What each observable of the state gained in all, and the standard deviation of its gains
        from return to return.
    marks : dict of str to float array, shape (4,)
        Of each observable at events: number, sum, smallest, largest.
    states : float array, shape (k, n)
        The state at the last returns, the latest first: once round, or as many as are known.
    """

    outcome: int
    repeats: int
    returns: int
    measured: int
    still: bool
    final: Instant
    duration: float
    endings: int
    counts: Floats
    closest: Floats
    lasted: Floats
    gains: dict[str, float]
    deviations: dict[str, float]
    marks: dict[str, Floats]
    states: Floats


class Survey:
    """An engine with the memory to follow points of one automaton, one after the other.

    Parameters
    ----------
    problem : Problem
        Its parameters are replaced by those of each point; their number, and that of the switching
        times, is that of all points.
    recipe : Recipe
    observed : Observed, optional
        What is gathered beside counts and times.
    """

    def __init__(self, problem: Problem, recipe: Recipe, observed: Observed | None = None) -> None:
        automaton = problem.automaton
        n, m = len(automaton.states), len(automaton.guards)
        self._observed = observed or NOTHING
        gains, marks = len(self._observed.gains), len(self._observed.marks)
        self._problem = problem
        self._bound = bound = bind(problem)
        self._sizes = n, m, len(automaton.modes), gains, marks
        forced = recipe.returned == settling.AT_PERIODS
        self._loop = LoopMemory(problem, bound, SAMPLES, per_period=int(forced))
        clock = self._loop.clock
        observe = self._observed.function if gains + marks else None
        places, self._kept = bound.links(clock, observe, n, gains + marks)
        self._work = bound.record(
            gathering.WORK,
            {},
            {
                **places,
                "returned": recipe.returned,
                "at": recipe.at,
                "longest": recipe.longest,
                "tolerance": recipe.tolerance,
                "noise": problem.options.rtol,
                "smallest": problem.options.atol / problem.options.rtol,
                "transient": recipe.transient,
                "length": recipe.length,
                "gains": gains,
                "marks": marks,
            },
        )
        self._clock, self._longest = clock, recipe.longest
        lengths = {"head": 2, "counts": m, "closest": m, "lasted": len(automaton.modes)}
        lengths |= {"gains": gains, "marks": gathering.PARTS * marks, "squares": gains}
        lengths = {"y": n, **lengths, "states": recipe.longest * n}
        ends = np.cumsum([RESULTS, *lengths.values()]).tolist()
        self._places = {
            name: slice(*pair) for name, pair in zip(lengths, pairwise(ends), strict=True)
        }
        self._memory = np.zeros(settling.memory_shape(n, m, len(automaton.modes), self._work))
        self._put("memory", "memory_width", self._memory)

    def follow(
        self,
        points: Sequence[tuple[Numbers, Instant]],
        watch: Callable[[float], None] | None = None,
        falls: Callable[[int, Instant, float], None] | None = None,
    ) -> list[Settled]:
        """Follow points to where they come to.

        Parameters
        ----------
        points : sequence of (Numbers, Instant)
            The problem's numbers at each, and where the motion starts.
        watch : callable, optional
            Called several times a second with the points done; it may raise.
        falls : callable, optional
            As that of a problem, with the number of the point before the other arguments.

        Returns
        -------
        list of Settled
            One that has failed says so; an ordinary run of it says why.
        """
        inputs = np.array([_row(*point) for point in points])
        n, m, modes, _, _ = self._sizes
        width = settling.result_width(n, m, modes, self._work)
        results = np.zeros((len(points), width))
        work = self._work
        self._put("inputs", "input_width", inputs)
        self._put("results", "result_width", results)
        work["points"], work["point"], work["begun"] = len(points), 0, 0
        status = loop.PAUSED
        while status != loop.DONE:
            try:
                status = self._bound.call(
                    settling.settle,
                    self._clock,
                    work,
                    self._bound.quota,
                )
            except FunctionError:  # told by who runs the point again
                status = loop.PAUSED
            fall = self._loop.take_fall()
            if fall is not None and falls is not None:
                falls(int(work["point"]), *fall)
            if watch is not None:
                watch(float(work["point"]))
        return [self._settled(result) for result in results]

    def _put(self, name: str, width: str, rows: Floats) -> None:
        """Let the work lead to rows of numbers: an array, in compiled code its address."""
        self._work[name] = self._bound.place(rows)
        self._work[width] = rows.shape[1]

    def is_stiff(self) -> bool:
        """Return whether stability has limited the steps of the last point."""
        return self._bound.engine.is_stiff()

    def close(self) -> None:
        """Free the engine's memory."""
        self._bound.engine.close()

    def _settled(self, result: Floats) -> Settled:
        n, at = self._sizes[0], self._places
        measured, repeats = int(result[MEASURED]), int(result[REPEATS])
        known = result[at["states"]].reshape(self._longest, n)[: repeats or self._longest]
        squares = result[at["squares"]] / measured if measured else result[at["squares"]] + math.nan
        marks = result[at["marks"]].reshape(-1, gathering.PARTS)
        gains, names = self._observed.gains, self._observed.marks
        duration, endings = result[at["head"]].tolist()
        cycle, mode = int(result[END_CYCLE]), int(result[END_MODE])
        return Settled(
            outcome=int(result[OUTCOME]),
            repeats=repeats,
            returns=int(result[RETURNS]),
            measured=measured,
            still=bool(result[STILL]),
            final=Instant(cycle, float(result[END_TIME]), mode, result[at["y"]]),
            duration=duration,
            endings=int(endings),
            counts=result[at["counts"]],
            closest=result[at["closest"]],
            lasted=result[at["lasted"]],
            gains=dict(zip(gains, result[at["gains"]].tolist(), strict=True)),
            deviations=dict(zip(gains, np.sqrt(squares).tolist(), strict=True)),
            marks=dict(zip(names, marks, strict=True)),
            states=known[~np.isnan(known).any(axis=1)],
        )


NOTHING = Observed(lambda mode, code, t, states, p, out: None, (), ())


def _row(numbers: Numbers, start: Instant) -> NDArray[np.float64]:
    """Return a row of the inputs of `settling`."""
    scale = numbers.time_scale or numbers.period
    head = np.zeros(NUMBERS)
    head[settling.PERIOD], head[settling.SCALE] = numbers.period, scale
    head[settling.LONGEST_STEP] = scale / STEPS_PER_PERIOD
    head[settling.PHASE], head[settling.MODE] = start.time, start.mode
    return np.concatenate([head, numbers.switches, start.y, numbers.parameters])
