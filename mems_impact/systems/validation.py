"""Validation of user functions: short run, constraints, discontinuities, start values.

When a system is made, the interpreted event loop takes a few steps, and the functions are called
again with checks where steps end. The short run seldom reaches all modes. Runs and orbits therefore
record the first states in modes that have not been checked, and the same checks are made there when
they are done; otherwise an error in such a mode would go unnoticed.

A point that the checks choose themselves cannot cause a rejection. Errors that do not depend on
values, such as a component that is never written or an unknown mode, are reported wherever they
occur; a function without a value is reported only at an initial state given by the user.
"""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from dis import get_instructions
from functools import cache, lru_cache
from types import CodeType, FunctionType, ModuleType
from typing import Any, NamedTuple

import numpy as np

from mems_impact._util.arrays import Floats
from mems_impact._util.warning_scopes import warn
from mems_impact.errors import DiscontinuityWarning, FunctionError, InvalidParameter, StartWarning
from mems_impact.hybrid.automaton import Guard
from mems_impact.hybrid.definition import RATE_STEP, Definition, named_tuple
from mems_impact.hybrid.diagnostics.failures import AT_TIMES, depends_on_time_only
from mems_impact.hybrid.diagnostics.user_functions import (
    CheckedFunctions,
    DomainError,
    EvaluationPoint,
    UserFunction,
    describe_value,
    rounding_size,
)
from mems_impact.hybrid.event_loop.long_steps import STEPS_PER_PERIOD
from mems_impact.hybrid.event_loop.loop import run_steps
from mems_impact.hybrid.event_loop.workspace import (
    ACCUMULATION,
    DONE,
    ENDED,
    EVENT_BUDGET,
    FAILED,
    INADMISSIBLE,
    NO_SUCH_MODE,
    PAUSED,
    STATE_BEFORE,
    SWITCH,
    TRANSITION,
)
from mems_impact.hybrid.problem import Problem
from mems_impact.hybrid.simulation import NO_CHECKPOINTS, Events, Simulation
from mems_impact.hybrid.state import HybridState
from mems_impact.integrators.dual_numbers import along, with_rate
from mems_impact.integrators.options import Options
from mems_impact.integrators.python_functions import MARGINS
from mems_impact.systems.description import SystemDescription
from mems_impact.systems.observables import EventObserver, Observable

# --- Side effects of functions

COMPILED_LIBRARIES = ("numba", "numpy")  # compiled code never runs them


def check_effects(definition: Definition) -> None:
    """Raise FunctionError if a function, or a function that it calls, changes an outer variable."""
    for function in _functions(definition):
        for inner in reachable_functions(function.call, set()):
            code = inner.__code__
            for name in _changed(code, set(code.co_freevars)):
                problem = f"changes {name}, a variable outside the function"
                remedy = "only read outer variables: quantities that change along a run are states"
                place = code.co_filename, code.co_firstlineno
                raise FunctionError(function.role, problem, remedy, *place)


def _changed(code: CodeType, outside: set[str]) -> Iterator[str]:
    """Yield the names of outer variables that code, or a function within it, changes.

    `outside` are the variables that it closes over and that are not its own.
    """
    for operation, name in _instructions(code):
        shared = operation in ("STORE_DEREF", "DELETE_DEREF") and name in outside
        if shared or operation in ("STORE_GLOBAL", "DELETE_GLOBAL"):
            yield name
    for inner in _within(code):
        yield from _changed(inner, outside & set(inner.co_freevars))


def reachable_functions(value: Any, visited: set[FunctionType]) -> Iterator[FunctionType]:
    """Yield a function and the functions that it may call: globals and closure variables."""
    function = getattr(value, "py_func", value)  # of one that numba compiled
    if not isinstance(function, FunctionType) or function in visited:
        return
    if (function.__module__ or "").partition(".")[0] in COMPILED_LIBRARIES:
        return
    visited.add(function)
    yield function
    for each in loaded(function.__code__, function.__globals__):
        yield from reachable_functions(each, visited)
    for cell in function.__closure__ or ():
        try:
            yield from reachable_functions(cell.cell_contents, visited)
        except ValueError:  # not set yet
            continue


def loaded(code: CodeType, scope: dict[str, Any]) -> Iterator[Any]:
    """Yield the globals that code reads, and the attributes of modules that it reads.

    Other attributes are not globals: ``p.k`` is unrelated to a function ``k``.
    """
    value: Any = None
    for operation, name in _instructions(code):
        if operation in ("LOAD_GLOBAL", "LOAD_NAME"):
            value = scope.get(name)
        elif operation in ("LOAD_ATTR", "LOAD_METHOD") and isinstance(value, ModuleType):
            value = getattr(value, name, None)
        else:
            value = None
        yield value
    for inner in _within(code):
        yield from loaded(inner, scope)


# Systems are made again and again of the same functions.
@lru_cache(maxsize=512)
def _instructions(code: CodeType) -> list[tuple[str, Any]]:
    return [(step.opname, step.argval) for step in get_instructions(code)]


def _within(code: CodeType) -> Iterator[CodeType]:
    return (part for part in code.co_consts if isinstance(part, CodeType))


def _functions(definition: Definition) -> Iterator[UserFunction]:
    for kind in ("flow", "switch_transition"):
        if getattr(definition, kind) is not None:
            yield UserFunction(kind, getattr(definition, kind))
    for guard in definition.guards:
        for kind in ("margin", "transition", "rest"):
            if getattr(guard, kind) is not None:
                yield UserFunction(kind, getattr(guard, kind), guard.name)


# --- Undeclared discontinuities of the flow

STEPS_AHEAD = (1.0, 8.0, 64.0)  # relative to very short steps: intervals searched for a jump
DECLARED_RATIO = 8.0  # of the interval, within which a guard declares a jump
MIN_JUMP_RATIO = 1e-6  # smallest jump, relative to the slope
JUMP_BISECTIONS = 60  # of the enclosing interval, unless rounding ends the bisection before
JUMP_REMAINDER = 0.5  # of the difference, for a jump; for a steep slope almost nothing remains
JUMP_ROUNDING_RATIO = 0.1  # of the difference that rounding of state and time may cause


def warn_of_discontinuity(
    system: SystemDescription, definition: Definition, at: HybridState, length: float
) -> bool:
    """Warn if the flow is discontinuous where steps of a run have become very short.

    Return whether the flow is. The definition has functions in the user's units. `at`, in scaled
    units with arbitrary cyclic components, is the start of such a step of this `length`.
    """
    numbers, checked = system.numbers(), checked_functions(system, definition)
    if system.forced:
        time = math.fmod(at.time, numbers.period)
        switches = numbers.switches and (*numbers.switches, numbers.period + numbers.switches[0])
    else:
        time, switches = at.cycle * numbers.period + at.time, numbers.switches
    stop = next((switch for switch in switches if switch > time), math.inf)
    lengths = (part * length for part in STEPS_AHEAD)
    stretches = [
        float(system.units.out("time", each))
        for each in lengths
        if time + DECLARED_RATIO * each < stop
    ]
    try:
        return _jumps(checked, _in_units(system, at.mode, time, at.y), stretches)
    except (FunctionError, DomainError, ArithmeticError):
        return False  # other checks report errors of functions


def checked_functions(system: SystemDescription, definition: Definition) -> CheckedFunctions:
    """Return checked functions of a definition, at the parameters of the system."""
    return CheckedFunctions(definition, [system.parameters[name] for name in definition.parameters])


def _in_units(system: SystemDescription, mode: int, time: float, y: Floats) -> EvaluationPoint:
    """Return a scaled point in the user's units."""
    values = zip(system.states, y.tolist(), strict=True)
    states = [float(system.units.out(name, value)) for name, value in values]
    return EvaluationPoint(mode, float(system.units.out("time", time)), states)


def _jumps(checked: CheckedFunctions, at: EvaluationPoint, stretches: Sequence[float]) -> bool:
    """Warn if the flow is discontinuous within lengths of time, ascending, ahead of a point.

    A guard that fires there declares the discontinuity.
    """
    slope, guards = checked.flow(at), active_guards(checked.definition, at.mode)

    def ahead(s: float) -> EvaluationPoint:
        return EvaluationPoint(
            at.mode, at.t + s, [y + s * rate for y, rate in zip(at.y, slope, strict=True)]
        )

    for length in stretches:
        end, beyond = ahead(length), ahead(DECLARED_RATIO * length)
        enclosed = _enclosed(checked, ahead, length)
        if enclosed is None:
            continue
        if any(checked.margin(i, at) * checked.margin(i, beyond) <= 0.0 for i in guards):
            return False
        before, after, min_jump = enclosed
        if min(_rounding(checked, at), _rounding(checked, end)) < JUMP_ROUNDING_RATIO * min_jump:
            _warn(checked, before, after, min_jump, end)
            return True
    return False


def _enclosed(
    checked: CheckedFunctions, ahead: Callable[[float], EvaluationPoint], length: float
) -> tuple[EvaluationPoint, EvaluationPoint, float] | None:
    """Return neighbouring points that enclose a jump of the flow, and its smallest size.

    Bisection stops when a half has only its share of the difference, as for a steep flow.
    """
    low, high = ahead(0.0), ahead(length)
    before, after = checked.flow(low), checked.flow(high)
    min_jump = JUMP_REMAINDER * _size(before, after)
    if min_jump <= MIN_JUMP_RATIO * max(map(abs, (*before, *after))):
        return None
    modes = range(len(checked.definition.modes))
    if min_jump <= rounding_size(checked.flow, (low, high), modes):
        return None
    first, last = 0.0, length
    for _ in range(JUMP_BISECTIONS):
        middle = 0.5 * (first + last)
        point = ahead(middle)
        if point in (low, high):
            break  # no number lies between
        between = checked.flow(point)
        differences = _size(before, between), _size(between, after)
        if max(differences) < min_jump:
            return None
        if differences[0] >= differences[1]:
            last, high, after = middle, point, between
        else:
            first, low, before = middle, point, between
    return low, high, min_jump


def _rounding(checked: CheckedFunctions, at: EvaluationPoint) -> float:
    """Return the change of the flow by rounding of state and time."""
    flow, largest = checked.flow(at), 0.0
    for pattern in ((1.0,), (-1.0,), (1.0, -1.0)):
        signs = [pattern[i % len(pattern)] for i in range(checked.n + 1)]
        *y, t = (math.nextafter(a, s * math.inf) for a, s in zip((*at.y, at.t), signs, strict=True))
        largest = max(largest, _size(flow, checked.flow(EvaluationPoint(at.mode, t, y))))
    return largest


def _warn(
    checked: CheckedFunctions,
    before: EvaluationPoint,
    after: EvaluationPoint,
    min_jump: float,
    end: EvaluationPoint,
) -> None:
    """Warn about a jump between two points of an interval."""
    slopes = checked.flow(before), checked.flow(after)
    k = max(range(checked.n), key=lambda i: abs(slopes[1][i] - slopes[0][i]))
    jump = f"d{checked.states[k]}/dt jumps from {slopes[0][k]:.6g} to {slopes[1][k]:.6g}"

    def changes(point: EvaluationPoint) -> bool:
        return _size(slopes[0], checked.flow(point)) >= min_jump

    def by(point_of: Callable[[int], EvaluationPoint]) -> list[str]:
        moved = [i for i in range(checked.n) if changes(point_of(i))]
        # A zero within rounding is the point of the jump.
        at = [0.0 if abs(y) <= abs(y - far) else y for y, far in zip(before.y, end.y, strict=True)]
        return [f"{checked.states[i]} = {at[i]:.6g}" for i in moved]

    def one(i: int) -> EvaluationPoint:
        y = [*before.y[:i], after.y[i], *before.y[i + 1 :]]
        return EvaluationPoint(before.mode, before.t, y)

    if changes(EvaluationPoint(before.mode, after.t, before.y)):
        location = f"t = {before.t:.6g}"
        remedy = "give the times of the jumps in switches="
    else:
        location = " or ".join(by(one)) or checked.location(before).removeprefix("at ")
        remedy = "use a Guard between two modes, or a part: Friction, Relay, SwitchingSurface"
    message = (
        f"the flow is discontinuous: {jump} at {location}, where no step is accurate; {remedy}"
    )
    warn(message, DiscontinuityWarning)


def _size(one: Sequence[float], other: Sequence[float]) -> float:
    """Return the difference of two slopes."""
    return max(abs(b - a) for a, b in zip(one, other, strict=True))


# --- Constraints

CONSTRAINT_RTOL = 1e-5  # of the typical change of a constraint: below it is zero


def check_constraint(
    checked: CheckedFunctions, i: int, at: EvaluationPoint, slope: Sequence[float], unit: float
) -> None:
    """Raise FunctionError unless a constraint is and remains zero in its mode."""
    value, call = checked.constraint(i, at), checked.definition.constraints[i][1]

    def derivative(slopes: Sequence[float], time: float) -> float:
        y = checked.state(list(map(with_rate, at.y, slopes)))
        step = RATE_STEP * unit
        return float(along(call, step, at.mode, with_rate(at.t, time), y, checked.p)[1])

    rate, size = derivative(slope, 1.0), 0.0
    for y, d, direction in zip(at.y, slope, np.eye(len(slope)).tolist(), strict=True):
        size = max(size, abs(derivative(direction, 0.0)) * max(abs(y), abs(d) * unit, 1e-3))
    function = UserFunction("constraint", call)
    if abs(value) > CONSTRAINT_RTOL * size:
        problem = f"is {value:.6g} {checked.location(at)}, must be zero in this mode"
        raise function.error(
            problem, "make it zero in transitions into the mode and in the initial state"
        )
    if abs(rate) * unit > CONSTRAINT_RTOL * size:
        problem = f"changes at the rate {rate:.6g} {checked.location(at)}, must remain zero"
        raise function.error(problem, "make the flow of the mode keep it zero")


# --- Dependence of functions on time

PROBE_TIMES = (0.1459, 0.3820, 0.6180)  # of a period: no common fractions of it
FLOW_RTOL = 1e-6  # of the largest component: a difference of flows that is tolerated
TIME_TOLERANCE_RATIO = 1e-9  # of the time scale


class TimeGrid(NamedTuple):
    """The times of a system: its forcing period if it has one, time scale and switches."""

    period: float | None
    unit: float
    switches: Sequence[float]


def check_period(
    checked: CheckedFunctions,
    at: EvaluationPoint,
    slope: Sequence[float],
    period: float,
    unit: float,
) -> None:
    """Raise FunctionError unless the flow has the forcing period.

    `slope` is the flow at the point, `unit` the time scale.
    """

    def ahead(time: float) -> list[float]:
        return checked.flow(at._replace(t=at.t + time))

    others = [ahead(part * period) for part in PROBE_TIMES]
    # Where terms of the flow cancel, their rounding is far larger than the sum.
    size = max(abs(value) for each in (slope, *others) for value in each)
    size = max(size, *(abs(value) / unit for value in at.y))
    # A discontinuous forcing may jump just before or after this time by rounding.
    for shift in (0.0, -TIME_TOLERANCE_RATIO * unit, TIME_TOLERANCE_RATIO * unit):
        if not _size(slope, ahead(period + shift)) > FLOW_RTOL * size:
            return
    again = ahead(period)
    changes = [abs(a - b) for a, b in zip(slope, again, strict=True)]
    i = changes.index(max(changes))
    if changes[i] <= rounding_size(checked.flow, (at,), range(len(checked.definition.modes))):
        return
    values = f"{slope[i]:.6g} at t = {at.t:.6g} and {again[i]:.6g} at t = {at.t + period:.6g}"
    problem = f"differs a period later (for {checked.states[i]} it gives {values})"
    remedy = "give the period of the forcing, or simulate the system without one"
    raise UserFunction("flow", checked.definition.flow).error(problem, remedy)


# --- Checks at points of runs

POINTS_PER_MODE = 3  # at which a mode is checked after a run
COMPARISON_CALLS = 1000  # of functions after a run, roughly: some milliseconds


@cache
def checked_modes(definition: Definition, period: float | Callable[..., float] | None) -> set[int]:
    """Return the modes in which functions have been checked, at any parameters; mutable."""
    return set()


def compare(
    checked: CheckedFunctions, clock: TimeGrid, at: EvaluationPoint, slope: Sequence[float]
) -> None:
    """Check the dependence of the flow on time, and constraints, at a point."""
    if clock.period is not None and not clock.switches:
        check_period(checked, at, slope, clock.period, clock.unit)
    for i, (mode, _) in enumerate(checked.definition.constraints):
        if mode == at.mode:
            check_constraint(checked, i, at, slope, clock.unit)


class ModeMonitor(EventObserver):
    """Records the first states of a run in modes that have not been checked.

    The definition has functions in the user's units, the problem is in scaled units. `met` has the
    modes that have been checked; checks add to it.
    """

    def __init__(
        self, system: SystemDescription, definition: Definition, problem: Problem, met: set[int]
    ) -> None:
        self.system, self.problem = system, problem
        self.definition, self.met = definition, met
        unmet = set(range(len(system.modes))) - met
        self.points: dict[int, list[EvaluationPoint]] = {mode: [] for mode in unmet}

    def __call__(self, events: Events) -> None:
        """Process a chunk of events: the starts and ends of arcs."""
        for modes, states in (
            (events.mode_after, events.after),
            (events.mode_before, events.before),
        ):
            for mode, points in self.points.items():
                if len(points) < POINTS_PER_MODE:
                    for row in np.flatnonzero(modes == mode)[: POINTS_PER_MODE - len(points)]:
                        cycle, time = int(events.cycle[row]), float(events.time[row])
                        self.put(HybridState(cycle, time, mode, states[row]))

    def put(self, at: HybridState) -> None:
        """Record a state, in scaled units, if its mode has not been checked."""
        if at.mode not in self.points or len(self.points[at.mode]) == POINTS_PER_MODE:
            return
        y = at.y.copy()
        y[list(self.definition.cyclic)] = 0.0  # the value in functions, which do not depend on them
        time = at.time if self.system.forced else at.cycle * self.problem.period + at.time
        self.points[at.mode].append(_in_units(self.system, at.mode, time, y))

    def check(self) -> None:
        """Check the functions at the recorded states.

        Raises FunctionError for the first function that fails or is inconsistent.
        """
        if not any(self.points.values()):
            return
        system, problem, definition = self.system, self.problem, self.definition
        checked = checked_functions(system, definition)
        unit = float(system.units.out("time", problem.time_scale or problem.period))
        clock = TimeGrid(system.forcing_period, unit, problem.switches)
        each = 10 * max(1, len(definition.guards))  # calls at a point, roughly
        left = max(1, COMPARISON_CALLS // each)
        for mode, points in self.points.items():
            for at in points[:left]:
                try:
                    compare(checked, clock, at, checked.flow(at))
                except DomainError:
                    continue  # differences may leave the domain of the flow
            left -= len(points[:left])
            if points:
                self.met.add(mode)


# --- Short run

CHECK_STEPS = 40  # steps, of a system of few states
FEW_STATES = 8  # states
CHECK_LENGTH = 8.0  # length of the run, in its time scale
LONGEST_STEP = 0.25  # of the time scale
CHECK_RTOL = 1e-8  # of the run
COMPARED_POINTS = 6  # points per mode at which times and rates are checked
INSTANT = 100  # times that guards may fire in one instant
CHECK_OPTIONS = Options(method="dop853", engine="interpreted", rtol=CHECK_RTOL, max_events=INSTANT)
KINDS = {TRANSITION: "transition", ACCUMULATION: "rest"}  # of the transitions of a guard

EventCallback = Callable[[int, EvaluationPoint, EvaluationPoint], None]


class ShortRun:
    """A short run by the interpreted event loop, whose calls are repeated with checks.

    `unit` is the time scale.
    """

    def __init__(
        self,
        system: SystemDescription,
        checked: CheckedFunctions,
        problem: Problem,
        start: HybridState,
        unit: float,
    ) -> None:
        self.system, self.checked = system, checked
        self.guards = checked.definition.guards
        slope = checked.flow(_point(start.mode, start.time, start.y))
        sizes = (max(abs(y), abs(dy) * unit) for y, dy in zip(start.y, slope, strict=True))
        options = replace(
            CHECK_OPTIONS,
            atol=CHECK_RTOL * min((float(size) for size in sizes if size > 0.0), default=1.0),
        )
        scale = LONGEST_STEP * STEPS_PER_PERIOD * unit
        self.problem = replace(problem, options=options, time_scale=scale)
        end = replace(start, time=start.time + CHECK_LENGTH * unit)
        self.run = Simulation(self.problem, start, end, NO_CHECKPOINTS, None, None)

    def points(self, on_event: EventCallback) -> Iterator[EvaluationPoint]:
        """Yield the points at which steps end.

        `on_event` is called with guard, point before and point after at every event. Raises
        DomainError if a transition has no value, FunctionError if a function fails, or a transition
        leaves its guard firing, and InvalidParameter if the run starts beyond an impact.
        """
        engine: Any = self.run.binding.engine
        clock, memory = self.run.clock, self.run.memory
        period, n = self.problem.period, self.checked.n
        for _ in range(CHECK_STEPS * FEW_STATES // max(FEW_STATES, n)):
            status = run_steps(engine, clock, 1)
            events = self.check_events(on_event)
            time = clock.t if self.problem.automaton.forced else clock.cycle * period + clock.t
            at = _point(clock.mode, time, memory.local)
            if status == INADMISSIBLE and clock.arcs == 0:
                i, location = clock.failure, self.checked.location(at)
                name, margin = self.guards[i].name, self.checked.margin(i, at)
                reason = f"lies beyond the guard {name!r}, whose margin is {margin:.6g} {location}"
                raise InvalidParameter("initial", None, "", problem=reason)
            if status == EVENT_BUDGET and self.repeats(clock.failure, events):
                raise self.still_falling(clock.failure, at)
            fault = engine.fault()
            if fault is not None and fault.role == MARGINS:
                at = _point(fault.mode, time, fault.y)
            if status == NO_SUCH_MODE:
                before = np.array(memory.table[STATE_BEFORE][:n])
                self.check_transitions(_point(clock.mode, time, before))
            if status not in (PAUSED, DONE, ENDED, FAILED):
                return
            yield at
            jump = memory.take_step_collapse()
            if jump and warn_of_discontinuity(self.system, self.checked.definition, *jump):
                return
            if status != PAUSED:
                return

    def repeats(self, i: int, events: Events) -> bool:
        """Return whether a guard whose margin is a condition of the mode has had all events."""
        guard = self.guards[i] if i < len(self.guards) else Guard("a switch")
        is_condition = guard.condition or guard.impact
        return is_condition and bool((events.guard[-INSTANT // 2 :] == i).all())

    def check_events(self, on_event: EventCallback) -> Events:
        """Return the events of the last step, whose transitions are repeated with checks."""
        events = Events.from_rows(self.run.events[: self.run.clock.events_written])
        self.run.clock.events_written = 0
        times = (events.cycle * self.problem.period + events.time).tolist()
        rows = zip(events.kind.tolist(), events.guard.tolist(), times, strict=True)
        last: tuple[int, int, float] | None = None
        for row, (kind, i, time) in enumerate(rows):
            before = _point(events.mode_before[row], time, events.before[row])
            if kind == SWITCH:
                self.checked.transition("switch_transition", None, before)
            elif kind in KINDS and i < len(self.guards):
                mode, y = self.checked.transition(KINDS[kind], i, before)
                on_event(i, before, before._replace(mode=mode, y=y))
                if (kind, i, time) == last and kind == TRANSITION and self.guards[i].impact:
                    raise self.still_falling(i, before)
            last = kind, i, time
        return events

    def check_transitions(self, at: EvaluationPoint) -> None:
        """Check the functions one of which has returned no mode."""
        for i in active_guards(self.checked.definition, at.mode):
            for kind in KINDS.values():
                with contextlib.suppress(DomainError):
                    self.checked.transition(kind, i, at)
        self.checked.transition("switch_transition", None, at)

    def still_falling(self, i: int, at: EvaluationPoint) -> FunctionError:
        """Return the error of a transition that leaves its guard firing."""
        guard, automaton = self.guards[i], self.problem.automaton
        rates = automaton.margins_at(at.mode, at.t, np.array(at.y), self.problem.parameters)[1]
        assert guard.transition is not None
        problem = f"leaves its margin at zero and falling, at the rate {rates[i]:.6g}"
        problem += ", so that it fires again at the same instant"
        remedy = "reverse the rate, or lead to a mode in which the guard is not active"
        if depends_on_time_only(lambda y: self.checked.margin(i, at._replace(y=list(y))), at.y):
            remedy = AT_TIMES
        return UserFunction("transition", guard.transition, guard.name).error(problem, remedy)


def _point(mode: int, t: float, y: Floats) -> EvaluationPoint:
    return EvaluationPoint(int(mode), float(t), y.tolist())


def active_guards(definition: Definition, mode: int) -> list[int]:
    """Return the active guards of a mode."""
    guards = definition.guards
    return [i for i, guard in enumerate(guards) if guard.modes is None or mode in guard.modes]


# --- Checks of a system before it runs


def check_run(
    system: SystemDescription,
    definition: Definition,
    problem: Problem,
    start: HybridState,
    met: set[int],
    *,
    time: float | None,
    initial_given: bool,
) -> None:
    """Check the functions of a system along a short run.

    `met` has the modes that have been checked, and the check adds those of the run. `time` is a
    typical time, if the user gave one; unless the user gave the initial state, functions may have
    no value there. Raises FunctionError for the first function that fails or is inconsistent,
    InvalidParameter if the initial state does not fit the system, or the user gave it and it lies
    beyond an impact.
    """
    check_effects(definition)
    checked = _checked(definition, problem)
    unit = time or problem.time_scale or problem.period
    clock = TimeGrid(system.forcing_period, unit, problem.switches)
    visits: dict[int, int] = {}
    measured: set[int] = set()

    def look(at: EvaluationPoint) -> None:
        slope = checked.flow(at)
        for i in active_guards(definition, at.mode):
            checked.margin(i, at)
        visits[at.mode] = visits.get(at.mode, 0) + 1
        if visits[at.mode] <= COMPARED_POINTS:
            compare(checked, clock, at, slope)

    def on_event(i: int, before: EvaluationPoint, after: EvaluationPoint) -> None:
        for each in system.observables:
            if definition.guards[i].name in each.at and id(each) not in measured:
                measured.add(id(each))
                states = checked.state(before.y), checked.state(after.y)
                _measured(each, before.mode, before.t, *states, checked.p)

    for each in system.observables:
        if not each.at:
            _measured(each, checked.state(start.y.tolist()), checked.p)
    try:
        look(_point(start.mode, start.time, start.y))
    except DomainError as found:
        if initial_given:
            raise found.error from None
        return
    try:
        for at in ShortRun(system, checked, problem, start, unit).points(on_event):
            look(at)
    except DomainError:
        pass  # at a point chosen by the checks
    except InvalidParameter:
        if initial_given:
            raise
    met.update(visits)


def check_end(definition: Definition, problem: Problem, start: HybridState) -> None:
    """Check the margin of the last guard of a definition, which ends a run, at the start."""
    with contextlib.suppress(DomainError):
        checked = _checked(definition, problem)
        at = _point(start.mode, start.time, start.y)
        checked.margin(len(definition.guards) - 1, at)


def _checked(definition: Definition, problem: Problem) -> CheckedFunctions:
    return CheckedFunctions(definition, problem.parameters[: len(definition.parameters)].tolist())


def _measured(observable: Observable, *arguments: Any) -> None:
    """Raise FunctionError if an observable fails for any values, or is not a number."""
    function = UserFunction("observable", observable.function, observable.name)
    try:
        value = observable.function(*arguments)
    except Exception as error:
        problem, always = function.explain_exception(error)
        if always:
            raise problem from error
        return
    try:
        float(value)
    except (TypeError, ValueError):
        raise function.error(
            f"returns {describe_value(value)}", "return one number on every path"
        ) from None


# --- Checks of the flow of a system with parts


def check_parted(
    flow: Callable[..., Any],
    states: tuple[str, ...],
    parameters: Mapping[str, float],
    signs: Mapping[str, Sequence[int]],
    start: Mapping[str, float],
) -> None:
    """Check a flow without its parts, at the start, in every combination of modes of the parts.

    An error in the assembled flow would point to generated source. ``flow(mode, t, y, p)`` reads
    the mode of each part by its name; `signs` has the values of this mode. Raises FunctionError if
    the flow fails or is inconsistent.
    """
    definition = Definition(states=states, modes=("any",), parameters=tuple(parameters), flow=flow)
    checked = CheckedFunctions(definition, list(parameters.values()))
    modes = named_tuple("Modes", tuple(signs))
    y = [float(start.get(name, 0.0)) for name in states]
    for each in itertools.product(*signs.values()):
        try:
            checked.flow(EvaluationPoint(modes(*each), 0.0, y))
        except DomainError:
            continue  # the checks of the whole system follow the runs


# --- Side of the guards at the start of a run

MARGIN_TOLERANCES = 1e3  # number of tolerances below zero of a negative margin


def check_start_side(
    system: SystemDescription, problem: Problem, start: HybridState, other: int
) -> None:
    """Warn if a run starts beyond a guard whose transition changes the state, or where it may part.

    The run itself rejects a start beyond an impact. A start beyond a guard that changes only the
    mode is allowed: a relay switches at once. A margin that is zero within the tolerances causes no
    warning.
    """
    automaton, options = problem.automaton, problem.options
    if other >= 0:
        mode, other_name = automaton.modes[start.mode], automaton.modes[other]
        message = (
            f"the motion from this start is not unique: the flow leads away from a switching "
            f"surface to both sides; the run begins in mode {mode!r}, and could begin in "
            f"{other_name!r}; start beside the surface"
        )
        warn(message, StartWarning, mode)
    p = problem.parameters_at(start.cycle)
    numbers = [
        i for i, guard in enumerate(automaton.guards) if not guard.impact and not guard.records
    ]
    if not numbers:
        return
    room = np.zeros(len(automaton.guards))
    sizes = options.rtol * np.abs(start.y) + options.atol
    try:
        margins, _ = automaton.margins_at(start.mode, start.time, start.y, p)
        if not (margins[numbers] < 0.0).any():
            return
        for j, size in enumerate(sizes):
            y = start.y.copy()
            y[j] += size
            aside, _ = automaton.margins_at(start.mode, start.time, y, p)
            room += np.abs(aside - margins)
        for i in numbers:
            if not margins[i] < -MARGIN_TOLERANCES * room[i]:
                continue
            _, y = automaton.state_after(start.mode, i, start.time, start.y, p)
            if not (np.abs(y - start.y) > MARGIN_TOLERANCES * sizes).any():
                continue
            moved = ", ".join(
                f"{system.units.label(state)} from {system.units.out(state, a):.6g} to "
                f"{system.units.out(state, b):.6g}"
                for state, a, b, size in zip(system.states, start.y, y, sizes, strict=True)
                if abs(b - a) > MARGIN_TOLERANCES * size
            )
            name = automaton.guards[i].name
            message = (
                f"the margin of {name!r} is negative at the start, but must be positive until its "
                f"guard fires: at once the transition changes {moved}; reverse the sign of the "
                "margin, or start on its other side"
            )
            warn(message, StartWarning, name)
    except (ArithmeticError, ValueError, TypeError, AttributeError, IndexError, NameError):
        return  # other checks report errors of functions
