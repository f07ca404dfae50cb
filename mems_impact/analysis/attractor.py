"""Attractors of many initial conditions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, closing
from dataclasses import dataclass, field, replace
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.progress import Watch
from mems_impact._util.warning_scopes import at_study_point, collected_warnings
from mems_impact.analysis.lyapunov import SIGNIFICANCE, ZERO_EXPONENT, classify
from mems_impact.analysis.simulate import simulate
from mems_impact.errors import FunctionError, InvalidParameter, RunError
from mems_impact.hybrid.attractors import recurrence as detection
from mems_impact.hybrid.attractors.mapper import AttractorMapper, RecurrenceColumns
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.state import HybridState
from mems_impact.hybrid.variational.lyapunov import LyapunovIntegrator, largest
from mems_impact.integrators.options import Options
from mems_impact.systems.base import HybridSystem, conversion
from mems_impact.systems.state import State, is_number, positive, whole
from mems_impact.systems.statistics import (
    CHAOTIC,
    FAILED,
    OFF,
    PERIODIC,
    QUASI_PERIODIC,
    RESTING,
    UNSETTLED,
)

STUDY_OPTIONS = Options(method="auto")

Exponents = Literal["unsettled", "all", "none"]
EXPONENT_CHUNK = 16  # periods between two checks of an exponent
# Relative tolerance of run and perturbations where an exponent only classifies a motion: with it
# exponents change by a small part of their standard error.
CLASSIFICATION_RTOL = 1e-7
# Largest number of periods over which an exponent is computed: at first, and for a motion that has
# been followed for longer; most exponents have a sign long before.
EXPONENT_PERIODS, LONGEST_EXPONENT_PERIODS = 3_000, 24_000
LARGEST_SWING = 3.0  # logarithm of the factor by which quasi-periodic perturbations swing
MAX_PERIOD_FACTOR = 4  # of `longest`: the longest period of a motion unsettled otherwise
SAME_ATTRACTOR_RTOL = 1e-3  # distance of equal orbits, in sizes of the states
NEAR_RETURN = 1e-2  # distance, in sizes of the components, of returns that are nearly the same


class InitialCondition(NamedTuple):
    """A point of a study: a system and an initial state, by default its own."""

    system: HybridSystem
    initial: State | None = None


@dataclass(frozen=True, kw_only=True)
class RecurrenceOptions:
    """Options of recurrence detection: transient, tolerance and Lyapunov exponents.

    A motion that converges slowly to an orbit is followed to the orbit, for up to 64 times as long.
    Chaos may be a transient that ends in an orbit; only a longer run shows this.

    Parameters
    ----------
    transient : int
        Forcing periods within which a motion may become periodic. For an autonomous system in its
        ``time_scale`` (1 by default), as `periods`.
    periods : int
        Forcing periods over which a motion that has not become periodic is then measured.
    longest : int
        Longest period in returns: the largest n of a period-n motion. A motion that the exponent
        does not classify is followed once more with four times this n.
    tolerance : float
        Relative tolerance for recognizing a periodic motion, per component of the state.
    exponents : {"unsettled", "all", "none"}
        Motions whose largest Lyapunov exponent is computed. The exponent classifies an aperiodic
        motion as chaotic or quasi-periodic.
    chaos_persistence : float
        Multiple (>= 1) of `transient` + `periods` after which a motion must still be chaotic to
        count as chaotic. A motion whose exponent has no sign yet is followed for as long.

    Raises
    ------
    InvalidParameter
        If a number is out of range.

    See Also
    --------
    operating_map, basins, classify

    Examples
    --------
    >>> import mems_impact as mi
    >>> actuator = mi.load_actuator("zhao2004")
    >>> drive = mi.Sine(amplitude=0.24, omega=0.5)
    >>> found = mi.operating_map(
    ...     actuator, drive, x=("amplitude", [0.2, 0.24]), y=("omega", [0.5]),
    ...     recurrence=mi.RecurrenceOptions(transient=100, periods=50, exponents="none"),
    ... )
    >>> found.table["period"].tolist()
    [1, 1]
    """

    transient: float = 300
    periods: float = 100
    longest: int = 16
    tolerance: float = 1e-6
    exponents: Exponents = "unsettled"
    chaos_persistence: float = 16.0

    def __post_init__(self) -> None:
        positive("transient", self.transient, zero=True)
        positive("periods", self.periods)
        whole("longest", self.longest, 1)
        if not (is_number(self.tolerance) and 0.0 < self.tolerance < 0.1):
            raise InvalidParameter("tolerance", self.tolerance, "a number above 0 and below 0.1")
        if self.exponents not in get_args(Exponents):
            allowed = f"one of {', '.join(get_args(Exponents))}"
            raise InvalidParameter("exponents", self.exponents, allowed)
        if not (is_number(self.chaos_persistence) and self.chaos_persistence >= 1.0):
            raise InvalidParameter(
                "chaos_persistence", self.chaos_persistence, "a finite number >= 1"
            )


def check_recurrence(options: object) -> None:
    """Raise InvalidParameter unless options are those of recurrence detection."""
    if not isinstance(options, RecurrenceOptions):
        raise InvalidParameter("recurrence", options, "a RecurrenceOptions(…)")


@dataclass(frozen=True, kw_only=True)
class Attractor:
    """The attractor that the motion from a point reaches.

    Returns are forcing periods or, for an autonomous system, crossings of the section (events of
    the first guard if there is no section).

    Attributes
    ----------
    motion : str
        "periodic"; "off" for a motion without impacts, in a system with impacts, that is periodic
        or whose exponent shows that it becomes periodic; "resting" at rest; "chaotic" or
        "quasi-periodic" by its largest exponent (see `classify`) if it has not become periodic;
        "unsettled" if the exponent does not decide, for example because the motion approaches an
        orbit slowly, has a period of more than four times `longest` or is transiently chaotic;
        "failed".
    period : int
        In returns; 0 for a motion that is not periodic.
    returns : int
        Number of returns for which the motion was followed.
    final : State
        The last state, at a return if the motion is periodic.
    states : array, shape (k, n)
        States at the returns, the latest first, in the units of the system: one period, or
        `longest` returns if the motion is not periodic.
    measures : dict of str to float
        Statistics by heading (see `System.statistics`).
    exponent : float
        The largest Lyapunov exponent in 1/time; NaN if it was not requested, -inf if events
        annihilate perturbations.
    error : float
        Standard error of the exponent.
    status : str
        "ok", or the reason of the failure.
    instant : HybridState
        `final` in scaled units.
    """

    motion: str
    period: int = 0
    returns: int = 0
    final: State | None = None
    states: Floats | None = field(default=None, repr=False)
    measures: dict[str, float] = field(default_factory=dict)
    exponent: float = math.nan
    error: float = math.nan
    status: str = "ok"
    instant: HybridState | None = field(default=None, repr=False)


def map_attractors(
    cases: Sequence[InitialCondition],
    recurrence: RecurrenceOptions = RecurrenceOptions(),
    options: Options = STUDY_OPTIONS,
    watch: Watch | None = None,
    numbers: Sequence[int] | None = None,
) -> list[Attractor]:
    """Compute the attractors of many initial conditions; each depends on its case alone.

    Points that share an automaton are integrated together in compiled code, which releases the GIL.
    `watch` is called several times a second with the number of points done; it may raise. `numbers`
    are those of the cases in a study, for warnings about a start beyond a guard or a discontinuous
    flow.
    """
    results: list[Attractor] = []
    batch: list[tuple[InitialCondition, Problem, HybridState]] = []

    def follow() -> None:
        if batch:
            first = len(results)
            chunk = None if numbers is None else numbers[first : first + len(batch)]
            results.extend(_followed(batch, recurrence, options, watch, first, chunk))
            batch.clear()

    for case in cases:
        try:
            same_system = bool(batch) and case.system is batch[-1][0].system
            problem = batch[-1][1] if same_system else case.system.problem(options)
            start = case.system.state_space.instant(case.initial, problem)
        except (InvalidParameter, FunctionError) as error:
            follow()
            results.append(Attractor(motion=FAILED, status=str(error)))
            continue
        if batch and not _same_structure(batch[0][1], problem):
            follow()
        if numbers is not None:
            with at_study_point(numbers[len(results) + len(batch)]):
                case.system.checks.start_side(problem, start)
        batch.append((case, problem, start))
    follow()
    return results


def _followed(
    batch: Sequence[tuple[InitialCondition, Problem, HybridState]],
    recurrence: RecurrenceOptions,
    options: Options,
    watch: Watch | None,
    before: int,
    numbers: Sequence[int] | None,
) -> list[Attractor]:
    """Return the attractors of points that share an automaton."""
    system, problem = batch[0][0].system, batch[0][1]
    return_kind, return_index = _return_of(system)

    def mapper_of(longest: int) -> AttractorMapper:
        return AttractorMapper(
            problem,
            longest=longest,
            tolerance=recurrence.tolerance,
            return_kind=return_kind,
            return_index=return_index,
            observed=system.statistics.recorded,
        )

    unit = float(system.units.out("time", problem.period)) / _length_unit(system, problem)
    total, length = recurrence.transient + recurrence.periods, recurrence.periods / unit
    transient, longer = (
        max(0.0, times * total - recurrence.periods) / unit
        for times in (1.0, recurrence.chaos_persistence - 1.0)
    )
    report = None if watch is None else (lambda done: watch(before + done))
    on = None if report is None else (lambda _: report(float(len(batch))))
    without = replace(recurrence, exponents="none")
    classifier = _Classifier(batch, recurrence, options, numbers, on)
    jumps = False

    def falls(i: int, at: HybridState, length: float) -> None:
        nonlocal jumps
        check = batch[i][1].discontinuity_check
        if not jumps and check is not None and numbers is not None:
            with at_study_point(numbers[i]):
                jumps = check(at, length)

    with closing(mapper_of(recurrence.longest)) as mapper:
        points = [(each.numbers, start) for _, each, start in batch]
        settled = mapper.follow(points, transient, length, report, falls)
        results = classifier.attractors(range(len(batch)), settled, recurrence)

        def continued(
            mapper: AttractorMapper, chosen: Sequence[int], transient: float
        ) -> RecurrenceColumns:
            """Follow some points from their last states; all at once, in compiled code."""
            ends = [(points[i][0], settled.final(i)) for i in chosen]
            return mapper.follow(ends, transient, length, on)

        def follow_to_orbit(
            mapper: AttractorMapper, chosen: Sequence[int], transient: float
        ) -> None:
            """Follow some points further, and replace points that become periodic or rest."""
            later = continued(mapper, chosen, transient)
            settling = detection.PERIODIC, detection.STATIONARY
            rows = np.flatnonzero(np.isin(later.outcome, settling)).tolist()
            ends = [chosen[row] for row in rows]
            attractors = classifier.attractors(ends, later.take(rows), without)
            for i, after in zip(ends, attractors, strict=True):
                each = results[i]
                returns = each.returns + after.returns
                results[i] = replace(
                    after, returns=returns, exponent=each.exponent, error=each.error
                )

        approaching, lasting = [], []
        for i, ((case, at, _), each) in enumerate(zip(batch, results, strict=True)):
            if math.isnan(each.exponent):
                continue
            period = float(case.system.units.out("time", at.period))
            kind = classify(each.exponent * period, each.error * period)
            unsure = each.motion == UNSETTLED and not math.isnan(each.error)
            if each.motion in (UNSETTLED, OFF) and not each.period and kind == PERIODIC:
                approaching.append(i)  # the motion came near an orbit late
            elif recurrence.chaos_persistence > 1.0 and (each.motion == CHAOTIC or unsure):
                # Chaos may be a transient. An exponent without a sign may also belong to a
                # transient, or to too few periods.
                lasting.append(i)
        if approaching:
            follow_to_orbit(mapper, approaching, transient)
        if lasting:
            later = continued(mapper, lasting, longer)
            attractors = classifier.attractors(lasting, later, recurrence, LONGEST_EXPONENT_PERIODS)
            for i, after in zip(lasting, attractors, strict=True):
                if after.motion == FAILED:
                    results[i] = replace(results[i], motion=UNSETTLED)
                elif not results[i].motion == after.motion == CHAOTIC:
                    results[i] = replace(after, returns=results[i].returns + after.returns)
        # An orbit of a longer period, or an orbit that is approached slowly.
        chosen = [
            i
            for i, each in enumerate(results)
            if each.motion == UNSETTLED and not math.isnan(each.error) and longer > 0.0
        ]
        if chosen:
            with closing(mapper_of(MAX_PERIOD_FACTOR * recurrence.longest)) as long_mapper:
                follow_to_orbit(long_mapper, chosen, longer)
    return results


class _Classifier:
    """Classifies the motions of points that share an automaton, by their results.

    `numbers` are those of the points in a study; `watch` is called several times a second during an
    exponent and may raise.
    """

    def __init__(
        self,
        batch: Sequence[tuple[InitialCondition, Problem, HybridState]],
        recurrence: RecurrenceOptions,
        options: Options,
        numbers: Sequence[int] | None,
        watch: Watch | None,
    ) -> None:
        self._batch, self._options, self._numbers = batch, options, numbers
        self._watch, self._system = watch, batch[0][0].system
        self._impacts = [i for i, guard in enumerate(self._system.automaton.guards) if guard.impact]
        # Of run and perturbations of exponents, if it is above that of the problem.
        self._rtol = CLASSIFICATION_RTOL if recurrence.exponents == "unsettled" else 0.0
        self._stretching: LyapunovIntegrator | None = None  # of all points, by one engine

    def attractors(
        self,
        chosen: Sequence[int],
        settled: RecurrenceColumns,
        recurrence: RecurrenceOptions,
        exponent_periods: int = EXPONENT_PERIODS,
    ) -> list[Attractor]:
        """Return the attractors of chosen points, whose results are `settled`."""
        if len(chosen) == 0:
            return []
        system, names = self._system, self._system.states
        systems = [self._batch[i][0].system for i in chosen]
        periods = np.array([self._batch[i][1].period for i in chosen])
        out = conversion(systems)
        with np.errstate(all="ignore"):  # numbers of failed points
            durations = settled.duration
            lengths = durations / periods if system.forced else out("time", durations)
            measures = system.statistics.of_attractors(settled, lengths, out)
        units = np.stack([np.broadcast_to(out(each, 1.0), periods.shape) for each in names], axis=1)
        hits = settled.counts[:, self._impacts].sum(axis=1)
        events = settled.counts.sum(axis=1) + settled.endings
        stays = settled.at_rest & (events == 0.0) & (settled.repeats == 1)
        quiet = (hits == 0.0) & bool(self._impacts)
        periodic = settled.outcome == detection.PERIODIC
        motions = np.select(
            [
                settled.outcome == detection.FAILED,
                (settled.outcome == detection.STATIONARY) | stays,
                periodic & quiet,
                periodic,
            ],
            [FAILED, RESTING, OFF, PERIODIC],
            UNSETTLED,
        ).tolist()
        rows = zip(*(column.tolist() for column in measures.values()), strict=True)
        times = np.broadcast_to(out("time", periods), periods.shape).tolist()
        result = []
        for k, (i, motion, row) in enumerate(zip(chosen, motions, rows, strict=True)):
            if motion == FAILED:
                with self._at_point(i):
                    reason = _reason(self._batch[i][0], recurrence, self._options)
                result.append(Attractor(motion=FAILED, status=reason))
                continue
            exponent, error = math.nan, math.nan
            instant, states = settled.final(k), settled.states(k)
            if recurrence.exponents == "all" or (
                recurrence.exponents == "unsettled" and motion == UNSETTLED
            ):
                with self._at_point(i):
                    exponent, error, length = self._exponent(
                        self._batch[i][1], instant, exponent_periods
                    )
                if motion == UNSETTLED:
                    motion = self._by_exponent(exponent, error, length, states, bool(quiet[k]))
            result.append(
                Attractor(
                    motion=motion,
                    period=int(settled.repeats[k]),
                    returns=int(settled.returns[k]),
                    final=systems[k].state_space.state(instant),
                    states=states * units[k],
                    measures=dict(zip(measures, row, strict=True)),
                    exponent=exponent / times[k],
                    error=error / times[k],
                    instant=instant,
                )
            )
        return result

    def _exponent(
        self, problem: Problem, start: HybridState, periods: int
    ) -> tuple[float, float, int]:
        """Return the largest exponent per period, its error and the periods it took.

        NaN if the run fails.
        """
        options = problem.options
        looser = max(1.0, self._rtol / options.rtol)
        options = replace(options, rtol=looser * options.rtol, atol=looser * options.atol)
        problem = replace(problem, options=options)
        try:
            if self._stretching is None:
                self._stretching = LyapunovIntegrator(problem, start, chunk=EXPONENT_CHUNK)
            else:
                self._stretching.restart(problem, start)
            return largest(
                self._stretching,
                tolerance=ZERO_EXPONENT,
                sure=SIGNIFICANCE,
                periods=periods,
                progress=self._watch or (lambda _: None),  # lets the user interrupt it
            )
        except (RunError, FunctionError):
            return math.nan, math.nan, 0

    def _at_point(self, i: int) -> AbstractContextManager[object]:
        """Return the context of warnings of a point."""
        return collected_warnings() if self._numbers is None else at_study_point(self._numbers[i])

    def _by_exponent(
        self, exponent: float, error: float, periods: int, states: Floats, quiet: bool
    ) -> str:
        """Return the motion of a point that has not become periodic."""
        system, kind = self._system, classify(exponent, error, returns=False)
        if kind == CHAOTIC:
            return CHAOTIC
        # The exponent along the flow is zero for any motion of an autonomous system.
        if (
            kind == QUASI_PERIODIC
            and system.forced
            and _is_neutral(exponent * periods, periods)
            and not _is_near_return(system, states)
        ):
            return QUASI_PERIODIC
        # Without impacts it is on its way to the orbit without them.
        return OFF if kind == PERIODIC and quiet else UNSETTLED


def _is_neutral(growth: float, periods: int) -> bool:
    """Return whether the growth of a perturbation is compatible with a quasi-periodic motion.

    There a perturbation varies by a bounded factor, and shear makes it grow in proportion to time.
    `growth` is the logarithm of the growth factor over this number of periods.
    """
    return -LARGEST_SWING < growth < LARGEST_SWING + math.log(max(1, periods))


def same_attractor(
    system: HybridSystem, one: Attractor, other: Attractor, sizes: Mapping[str, float]
) -> bool:
    """Return whether two motions share an attractor, by their returns.

    Orbits are the same if a state is, other motions if their ranges intersect. `sizes` has the
    sizes of the states that are compared.
    """
    kinds = (PERIODIC, OFF, RESTING)
    if (one.motion in kinds) != (other.motion in kinds):
        return False
    columns = [system.states.index(name) for name in sizes]
    a, b = (states_at_returns(system, each)[:, columns] for each in (one, other))
    if one.motion in kinds:
        allowed = SAME_ATTRACTOR_RTOL * np.array(list(sizes.values()))
        return one.period == other.period and bool((np.abs(b - a[0]) <= allowed).all(axis=1).any())
    return bool(np.all((a.min(axis=0) <= b.max(axis=0)) & (b.min(axis=0) <= a.max(axis=0))))


def states_at_returns(system: HybridSystem, attractor: Attractor) -> Floats:
    """Return the states at the returns; the last state of a motion without returns."""
    states, final = attractor.states, attractor.final
    if states is not None and len(states):
        return states
    return np.array([[math.nan if final is None else final[name] for name in system.states]])


def _is_near_return(system: HybridSystem, states: Floats) -> bool:
    """Return whether the last return is close to an earlier one: a slow approach to an orbit.

    Near a bifurcation the exponent is as close to zero as for a quasi-periodic motion.
    """
    free = [i for i in range(len(system.states)) if i not in system.automaton.cyclic]
    states = states[:, free]
    sizes = np.abs(states).max(axis=0, initial=0.0)
    sizes[sizes == 0.0] = 1.0
    distances = (np.abs(states[1:] - states[0]) / sizes).max(axis=1, initial=0.0)
    return bool(distances.min(initial=math.inf) < NEAR_RETURN)


def _reason(case: InitialCondition, recurrence: RecurrenceOptions, options: Options) -> str:
    """Return why a point fails: the message of an ordinary run, which fails at the same place."""
    length = recurrence.transient + recurrence.periods
    try:
        span = span_of(case.system, length, options)
        simulate(case.system, **span, initial=case.initial, options=options)._scaled_statistics  # noqa: B018
    except (RunError, FunctionError, InvalidParameter) as error:
        return str(error)
    return "an ordinary run does not fail"


def span_of(system: HybridSystem, length: float, options: Options) -> dict[str, Any]:
    """Return a length of `RecurrenceOptions` as an argument of `simulate`."""
    if system.forced:
        return {"periods": length}
    return {"duration": length * _length_unit(system, system.problem(options))}


def _length_unit(system: HybridSystem, problem: Problem) -> float:
    """Return the unit of lengths in `RecurrenceOptions` in time: period, time scale, or 1."""
    has_unit = system.forced or problem.time_scale is not None
    return float(system.units.out("time", problem.period)) if has_unit else 1.0


def _same_structure(one: Problem, other: Problem) -> bool:
    """Return whether two problems differ only in numbers."""
    return (
        one.automaton is other.automaton
        and one.section == other.section
        and len(one.parameters) == len(other.parameters)
        and len(one.switches) == len(other.switches)
    )


def _return_of(system: HybridSystem) -> tuple[int, int]:
    """Return the kind of return of the system's motions, and its guard or direction."""
    if system.forced:
        return detection.STROBOSCOPIC, 0
    if system.section is not None:
        return detection.AT_SECTION, 1
    # The first guard whose events serve as returns.
    guards = system.automaton.guards
    chosen = [i for i, guard in enumerate(guards) if not guard.records]
    impacts = [i for i in chosen if guards[i].impact]
    return detection.AT_GUARD, (impacts or chosen or [0])[0]
