"""Dependence of a system on time: conditions on a period, operations that need a period.

The loop gives flow and margins of a system with forcing the time without whole periods, so they
must be periodic. Values decide that, in all parts of a run: a pulse may come late. Which functions
read the time at all follows from their code (`mems_impact.hybrid.time_dependence`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from itertools import chain, compress, cycle
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mems_impact.errors import InvalidParameter
from mems_impact.hybrid.definition import Definition, forcing, moves
from mems_impact.hybrid.diagnostics.user_functions import (
    CheckedFunctions,
    DomainError,
    EvaluationPoint,
    UserFunction,
    rounding_size,
)
from mems_impact.hybrid.simulation import Trajectory
from mems_impact.hybrid.time_dependence import Argument, reads_time
from mems_impact.systems.description import SystemDescription
from mems_impact.systems.state import is_number
from mems_impact.systems.validation import checked_functions, loaded, reachable_functions

BLOCKS = 64  # parts of a run in which one phase is compared
CONSECUTIVE_PERIODS = 64  # compared for motions without an end, before 2^n periods
MAX_DOUBLINGS = 20
GOLDEN_RATIO = 0.5 * (math.sqrt(5.0) - 1.0)  # its multiples, less whole numbers, are spread evenly
VALUE_RTOL = 1e-6  # difference of periodic values, relative to the largest
DRIFT = 2e-7  # of a period per period: error of a period, within which values may differ
PHASES = 32  # compared along a run
STATES = 16  # states of a run at which functions are compared
PHASES_BESIDE = (-0.146, 0.382)  # of a period: times compared beside a number of a function

Values = Callable[[EvaluationPoint], list[float]]


class TimeFunction(NamedTuple):
    """A function that reads the time, and its values at a point."""

    function: UserFunction
    values: Values
    modes: tuple[int, ...] | None = None


def time_functions(checked: CheckedFunctions, *, motion: bool) -> Iterator[TimeFunction]:
    """Yield the functions that read the time.

    With `motion` those of the motion within a mode, which receive the time less whole periods; else
    the others.
    """
    definition = checked.definition

    def scalar(function: Callable[..., float], i: int) -> Values:
        return lambda at: [function(i, at)]

    def change(kind: str, i: int | None) -> Values:
        def values(at: EvaluationPoint) -> list[float]:
            mode, y = checked.transition(kind, i, at)
            return [float(mode), *y]

        return values

    found: list[TimeFunction] = []
    if motion:
        found.append(TimeFunction(UserFunction("flow", definition.flow), checked.flow))
        for i, (mode, constraint) in enumerate(definition.constraints):
            function = UserFunction("constraint", constraint)
            found.append(TimeFunction(function, scalar(checked.constraint, i), (mode,)))
    elif definition.switch_transition is not None:
        kind = "switch_transition"
        function = UserFunction(kind, definition.switch_transition)
        found.append(TimeFunction(function, change(kind, None)))
    for i, guard in enumerate(definition.guards):
        if moves(guard) == motion:
            assert guard.margin is not None
            function = UserFunction("margin", guard.margin, guard.name)
            found.append(TimeFunction(function, scalar(checked.margin, i), guard.modes))
        for kind in ("transition", "rest") if not motion else ():
            if getattr(guard, kind) is not None:
                function = UserFunction(kind, getattr(guard, kind), guard.name)
                found.append(TimeFunction(function, change(kind, i), guard.modes))
    periodic: set[Argument] = set()  # A function that reads t only by the forcing is periodic.
    for forced in forcing(definition) if not motion else ():
        reads_time(forced, periodic)
    return (each for each in found if reads_time(each.function.call, set(periodic)))


# --- Systems without a period


def check_autonomy(definition: Definition, switches: Sequence[float]) -> None:
    """Raise an error if a system without a period depends on time.

    FunctionError if a function reads the time, InvalidParameter if there are switching times.
    """
    checked = CheckedFunctions(definition, [math.nan] * len(definition.parameters))
    reason = "depends on time, and the system has no period"
    for motion in (True, False):
        for each in time_functions(checked, motion=motion):
            remedy = "give the period of the forcing, or simulate the system"
            raise each.function.error(reason, remedy)
    if switches:
        problem = f"the flow {reason}: it switches at {', '.join(f'{t:g}' for t in switches)}"
        raise InvalidParameter("switches", None, "", problem=problem)


# --- Systems with a period


def check_forcing(
    system: SystemDescription, definition: Definition, trajectory: Trajectory
) -> None:
    """Raise FunctionError unless the functions of the forcing are periodic along a run."""
    checked = checked_functions(system, definition)
    functions = list(time_functions(checked, motion=True))
    if not functions:
        return
    start, final, events = trajectory.start, trajectory.final, trajectory.events
    rows = np.unique(np.linspace(0, len(events) - 1, min(STATES, len(events))).astype(int))
    modes = [start.mode, final.mode, *events.mode_after[rows], *events.mode_before[rows]]
    y = np.vstack([start.y, final.y, events.after[rows], events.before[rows]])
    for i, name in enumerate(system.states):
        y[:, i] = 0.0 if i in definition.cyclic else system.units.out(name, y[:, i])
    points = [
        EvaluationPoint(int(mode), 0.0, at) for mode, at in zip(modes, y.tolist(), strict=True)
    ]
    first = start.cycle + start.time / trajectory.period
    last = final.cycle + final.time / trajectory.period
    starts = np.linspace(first, last, min(BLOCKS, max(2, math.ceil(last - first))), endpoint=False)
    phases = [math.fmod(GOLDEN_RATIO * i, 1.0) for i in range(PHASES)]
    instants = [
        (math.ceil(start - phase), phase)
        for start, phase in zip(starts.tolist(), cycle(phases), strict=False)
    ]
    period = float(system.units.out("time", trajectory.period))
    _compare(system, checked, functions, points, period, instants, (first, last))


def check_recurrence(system: SystemDescription, definition: Definition, period: float) -> None:
    """Raise FunctionError unless the functions of a system have a period, at any time."""
    checked = checked_functions(system, definition)
    functions = [
        each for motion in (True, False) for each in time_functions(checked, motion=motion)
    ]
    if not functions:
        return
    start = {**dict.fromkeys(system.states, 0.0), **system.initial.as_dict()}
    y = [float(start[name]) for name in system.states]
    points = [EvaluationPoint(mode, 0.0, y) for mode in range(len(definition.modes))]
    cycles = [*range(1, CONSECUTIVE_PERIODS), *(2**n for n in range(6, MAX_DOUBLINGS))]
    phases = (math.fmod(GOLDEN_RATIO * i, 1.0) for i in range(1, len(cycles) + 1))
    instants = list(zip(cycles, phases, strict=True))
    _compare(system, checked, functions, points, period, instants, (0.0, 2.0**MAX_DOUBLINGS))


def _compare(
    system: SystemDescription,
    checked: CheckedFunctions,
    functions: Iterable[TimeFunction],
    points: Sequence[EvaluationPoint],
    period: float,
    instants: Sequence[tuple[int, float]],
    within: tuple[float, float],
) -> None:
    """Raise FunctionError if functions differ from their values in the first period.

    They are compared at the states of `points` in turn. `instants` are whole periods and phases, in
    addition to the times that the functions name; `within` has the first and last time, in periods.
    """
    for each in functions:
        places = [at for at in points if each.modes is None or at.mode in each.modes]
        named = [
            number / period + phase
            for number in {*_numbers(each.function.call), *checked.p}
            for phase in PHASES_BESIDE
        ]
        later = ((math.floor(t), t - math.floor(t)) for t in named if abs(t) < math.inf)
        pairs = [
            (i % PHASES % len(places), phase, n)
            for i, (n, phase) in enumerate(chain(instants, later) if places else ())
            if n >= 1 and within[0] <= n + phase <= within[1]
        ]
        for i, phase, n in _differences(checked, each.function.call, places, pairs, period):
            try:
                _compare_at(system, each, places[i], phase, n, period, places)
            except DomainError:
                continue


def _differences(
    checked: CheckedFunctions,
    call: Callable[..., Any],
    places: Sequence[EvaluationPoint],
    pairs: Sequence[tuple[int, float, int]],
    period: float,
) -> Iterable[tuple[int, float, int]]:
    """Return where values of a function, called without checks, differ; all if a call fails."""
    call = getattr(call, "py_func", call)  # the source of a numba function
    modes, states = [at.mode for at in places], [checked.state(at.y) for at in places]

    def value(i: int, t: float) -> Any:
        if not checked.by_array:
            return call(modes[i], t, states[i], checked.p)
        call(modes[i], t, states[i], checked.p, slope := [math.nan] * checked.n)
        return slope

    early = cache(value)  # phases repeat
    try:
        values = [
            (early(i, phase * period), value(i, (n + phase) * period)) for i, phase, n in pairs
        ]
        one, other = np.array(values, dtype=float).reshape(len(pairs), 2, -1).swapaxes(0, 1)
    except Exception:
        return pairs
    size = VALUE_RTOL * np.maximum(abs(one), abs(other)).max(axis=1, initial=0.0)
    near: NDArray[np.bool_] = (abs(one - other) <= size[:, None]).all(axis=1)
    return compress(pairs, ~near)


def _numbers(function: Callable[..., Any]) -> Iterator[float]:
    """Yield the numbers that a function and its callees name: constants and variables."""
    for each in reachable_functions(function, set()):
        cells = (cell.cell_contents for cell in each.__closure__ or ())
        for value in (*each.__code__.co_consts, *loaded(each.__code__, each.__globals__), *cells):
            if is_number(value):
                yield float(value)


def _compare_at(
    system: SystemDescription,
    each: TimeFunction,
    at: EvaluationPoint,
    phase: float,
    cycle: int,
    period: float,
    places: Sequence[EvaluationPoint],
) -> None:
    early, late = phase * period, (cycle + phase) * period
    one, other = each.values(at._replace(t=early)), each.values(at._replace(t=late))
    size = VALUE_RTOL * max(map(abs, (*one, *other)))
    if all(abs(a - b) <= size for a, b in zip(one, other, strict=True)):
        return
    # The period may be rounded, and a phase lie at a jump.
    shift = min(DRIFT * cycle, 0.01) * period
    beside = [each.values(at._replace(t=early + sign * shift)) for sign in (-1.0, 1.0)]
    modes = each.modes or range(len(system.modes))
    size += rounding_size(each.values, (place._replace(t=early) for place in places), modes)
    for i, (a, b) in enumerate(zip(one, other, strict=True)):
        room = size + 2.0 * max(abs(values[i] - a) for values in beside)
        if abs(a - b) > room:
            first, last = (
                f"{t:.9g} {system.units.get('time', '')}".rstrip() for t in (early, late)
            )
            problem = (
                f"is not periodic: it gives {a:.6g} at t = {first} and {b:.6g} at t = {last}, "
                f"{cycle} periods later"
            )
            remedy = "give the period of the forcing, or simulate the system without one"
            raise each.function.error(problem, remedy)
