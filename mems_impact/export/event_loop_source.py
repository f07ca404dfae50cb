"""C source of the event loop, of the DOP853 integrator and of an automaton.

The event loop and the integrator of a simulation are translated (`export.c_source`), so that
an exported model locates, orders and completes events as `simulate` does. Model exchange uses the
same treatment of an instant; only the integrator is another.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from types import FunctionType
from typing import Any

import numpy as np

from mems_impact.export.c_expressions import ExpressionWriter
from mems_impact.export.c_kinds import (
    BOOLEAN,
    INTEGER,
    NOTHING,
    REAL,
    Array,
    Expression,
    Structure,
    Tuple,
)
from mems_impact.export.c_source import CSource
from mems_impact.hybrid.automaton import Automaton
from mems_impact.hybrid.event_loop import flights, loop, workspace
from mems_impact.hybrid.event_loop.chatter import (
    CHATTER_END_RTOL,
    acceleration,
    remaining_chatter_time,
)
from mems_impact.hybrid.event_loop.event_detection import (
    first_violated_guard,
    inadmissible_gap,
    rk4_probe,
    rounding_error,
)
from mems_impact.hybrid.event_loop.loop import (
    SWITCH_RTOL,
    begin_arc,
    begin_period,
    is_switch,
    resolve_instant,
    set_clock,
    switch_instant,
)
from mems_impact.hybrid.event_loop.workspace import (
    ACCUMULATION,
    ACCUMULATION_STATE,
    CONTACT_STATE,
    DONE,
    HIT_BEGIN,
    HIT_SPEED,
    HIT_TIME,
    INADMISSIBLE,
    MARGINS_AFTER,
    MARGINS_AT,
    NONE,
    STATE_BEFORE,
    WAITING,
    G,
    Y,
    log_event,
    table_row,
)
from mems_impact.integrators import interface
from mems_impact.integrators.dop853 import stepper
from mems_impact.integrators.dual_numbers import (
    after,
    along,
    by_differences,
    with_rate,
    with_rates,
)

# --- Records

POINTERS = ("table", "events", "samples")
LOOP = Structure(
    "LoopState",
    tuple(
        (name, REAL if kind[0] == np.float64 else INTEGER)
        for name, kind in (workspace.LOOP_STATE.fields or {}).items()
        if name not in POINTERS
    ),
)
_WORDS = (
    "n",
    "states",
    "perturbations",
    "interpolated",
    "m",
    "width",
    "mode",
    "section",
    "direction",
    "begun",
    "rest",
    "has_dense",
)
_COUNTS = ("at_border", "off_border", "stiff", "steps")
_REALS = ("t", "last_instant", "level", "rtol", "atol", "max_step", "longest", "t_start", "t_end")
ENGINE = Structure(
    "Engine",
    (
        *((name, INTEGER) for name in (*_WORDS, *_COUNTS)),
        *((name, REAL) for name in (*_REALS, "stop", "h_next")),
    ),
)


def record_structure(record: Structure, pointers: Sequence[str]) -> str:
    """Return the C structure of a record, with pointers first."""
    lines = [f"    {pointer};" for pointer in pointers]
    lines += [f"    {kind.ctype} {name};" for name, kind in record.fields]
    return "\n".join([f"struct {record.name} {{", *lines, "};"])


# --- Instants in model exchange, where the importer integrates

BLUR = 0.02  # relative error of a flight beyond which an importer does not resolve it


def first_instant(engine, s):  # type: ignore[no-untyped-def]
    """Perform the transitions of the initial state."""
    y = table_row(s, Y)
    set_clock(engine, s)
    s.failure = inadmissible_gap(engine, s, s.t, y)
    if s.failure != NONE:
        return INADMISSIBLE
    guard = first_violated_guard(engine, s, s.mode, s.t, y, NONE, NONE)
    if is_switch(s):
        guard = 2 * s.m
    status = resolve_imported_instant(engine, s, y, guard)
    if status == DONE:
        begin_arc(engine, s, y)
    return status


def imported_instant(engine, s, input_change):  # type: ignore[no-untyped-def]
    """Perform the transitions at ``s.t``, which an importer has located, and begin an arc.

    `input_change` is 1 if an input has changed, after which the mode is determined again.
    """
    y = table_row(s, Y)
    if s.t > s.arc_start:
        s.switched = 0
    if at_next_switch(engine, s) or input_change == 1:
        guard = 2 * s.m
    else:
        guard = first_violated_guard(engine, s, s.mode, s.t, y, NONE, NONE)
    status = resolve_imported_instant(engine, s, y, guard)
    if status == DONE:
        begin_arc(engine, s, y)
    return status


def at_next_switch(engine, s):  # type: ignore[no-untyped-def]
    """Return whether ``s.t`` is the next switch but for rounding; then set it exactly."""
    if s.switched == 1 or s.stop - s.t > SWITCH_RTOL * s.period:
        return False
    s.t = switch_instant(s, math.inf)
    begin_period(engine, s)
    return True


def resume(engine, s, input_change):  # type: ignore[no-untyped-def]
    """Begin a new arc at a communication point, with the switch at which the last one ended.

    `input_change` is 1 if an input has changed, after which the mode is determined again.
    """
    if s.first_arc == 0:
        s.restart = 1
        if at_next_switch(engine, s) or input_change == 1:
            s.pending_guard = 2 * s.m


def imported_step(engine, s):  # type: ignore[no-untyped-def]
    """Return whether a guard fires at the end of a step of an importer."""
    margins, waiting = table_row(s, MARGINS_AFTER), table_row(s, WAITING)
    y = table_row(s, Y)
    interface.margins(engine, s.mode, s.t, y, margins)
    has_crossing = False
    for i in range(s.m):
        if margins[i] + interface.bias(engine, i) > 0.0:
            waiting[i] = 0.0
            if margins[i] > rounding_error(s, i):
                interface.set_bias(engine, i, 0.0)
        else:
            has_crossing = True
    return has_crossing and first_violated_guard(engine, s, s.mode, s.t, y, NONE, NONE) != NONE


def is_flight_blurred(engine, s, guard):  # type: ignore[no-untyped-def]
    """Return whether the importer's error is a large part of the flight that ends here.

    Its state before the impact, in STATE_BEFORE, is compared with a step of the classical
    Runge-Kutta method, and that with two half steps. Overwrites CONTACT_STATE and
    ACCUMULATION_STATE.
    """
    t_start, length = s.arc_start, s.t - s.arc_start
    if not (length > 0.0 and table_row(s, HIT_TIME)[guard] == t_start):
        return False
    g, y_start, mode = table_row(s, G), stepper.row(engine, stepper.START), engine.mode
    y_step, y_half_steps = table_row(s, ACCUMULATION_STATE), table_row(s, CONTACT_STATE)
    rk4_probe(engine, s, mode, t_start, y_start, length, y_step)
    rk4_probe(engine, s, mode, t_start, y_start, 0.5 * length, y_half_steps)
    rk4_probe(engine, s, mode, t_start + 0.5 * length, y_half_steps, 0.5 * length, y_half_steps)
    interface.margins(engine, mode, s.t, table_row(s, STATE_BEFORE), g)
    imported_margin = g[guard]
    interface.margins(engine, mode, s.t, y_step, g)
    step_margin = g[guard]
    interface.margins(engine, mode, s.t, y_half_steps, g)
    error, step_error = abs(imported_margin - g[guard]), abs(step_margin - g[guard])
    height = 0.25 * table_row(s, HIT_SPEED)[guard] * length
    return error > BLUR * height and error > 100.0 * step_error


def rest_at_contact(engine, s, y, guard):  # type: ignore[no-untyped-def]
    """Enter the sticking contact of a chatter sequence that would end soon.

    The event loop advances to the accumulation point. An importer does not, so the bodies move in
    contact from here on, as on average they do during the remaining flights.
    """
    y_before, y_contact, y_end = (
        table_row(s, STATE_BEFORE),
        table_row(s, CONTACT_STATE),
        table_row(s, ACCUMULATION_STATE),
    )
    mode, t, code = s.mode, s.t, s.m + guard
    is_blurred = is_flight_blurred(engine, s, guard)
    previous_speed, speed = table_row(s, HIT_SPEED)[guard], table_row(s, MARGINS_AT)[s.m + guard]
    remaining, interval = remaining_chatter_time(engine, s, t, y, guard)
    if remaining == math.inf and is_blurred and 0.0 <= speed < previous_speed:
        a = acceleration(engine, s, mode, t, y, guard, 0.125 * (t - s.arc_start))
        if a < 0.0:
            interval = 2.0 * previous_speed / -a
            remaining = 2.0 * speed / -a / (1.0 - speed / previous_speed)
    if not abs(remaining) < math.inf:
        return False
    for j in range(s.n):
        y_before[j] = y[j]
        y_contact[j] = y[j]
    contact_mode = interface.transition(engine, mode, code, t, y_contact)
    if remaining > 0.0 and 0 <= contact_mode < s.modes:
        rk4_probe(engine, s, contact_mode, t, y_contact, remaining, y_end)
        h = 0.125 * interval
        a_start = acceleration(engine, s, mode, t, y_contact, guard, h)
        a_end = acceleration(engine, s, mode, t + remaining, y_end, guard, h)
        relative_change = (a_end - a_start) / a_start if a_start != 0.0 else math.inf
        if not relative_change * relative_change * remaining <= CHATTER_END_RTOL * interval:
            return True
        remaining = max(0.0, remaining - 2.0 / 3.0 * relative_change * (interval + remaining))
    s.mode = contact_mode
    table_row(s, HIT_TIME)[guard] = table_row(s, HIT_BEGIN)[guard] = -math.inf
    log_event(s, t + remaining, ACCUMULATION, guard, mode, y_before, y_contact)
    for j in range(s.n):
        y[j] = y_contact[j]
    return True


# The same code with another function for the completion of chatter.
resolve_imported_instant = FunctionType(
    resolve_instant.__code__,
    {**resolve_instant.__globals__, "complete_chatter": rest_at_contact},
    "resolve_imported_instant",
)


# --- Calls that the C runtime answers


def _call(name: str, kind: Any = NOTHING) -> Any:
    """Return a handler that calls a C function with the arguments as they stand."""

    def handler(writer: ExpressionWriter, arguments: Sequence[Expression]) -> Expression:
        codes = (writer.runtime(each).code for each in arguments)
        return Expression(kind, f"{name}({', '.join(codes)})")

    return handler


def _code(pattern: str, kind: Any = NOTHING) -> Any:
    """Return a handler with a C expression of the arguments."""

    def handler(writer: ExpressionWriter, arguments: Sequence[Expression]) -> Expression:
        codes = [writer.runtime(each).code for each in arguments]
        return Expression(kind, pattern.format(*codes))

    return handler


def _function(function: Any) -> Any:
    """Return a handler that calls another Python function, translated."""

    def handler(writer: ExpressionWriter, arguments: Sequence[Expression]) -> Expression:
        return writer.user_call(function, arguments, {}, writer.node)

    return handler


RATED = Tuple((REAL, REAL), ("value", "rate"))


def _with_rate(writer: ExpressionWriter, arguments: Sequence[Expression]) -> Expression:
    return Expression(RATED, "", tuple(map(writer.runtime, arguments[:2])))


def _with_rates(_writer: ExpressionWriter, arguments: Sequence[Expression]) -> Expression:
    kinds = tuple(each.kind for each in arguments)
    return Expression(Tuple(kinds, ("values", "rates", "memory")), "", tuple(arguments))


def _after(writer: ExpressionWriter, arguments: Sequence[Expression]) -> Expression:
    given, time = arguments
    items = [writer.item(given, i) for i in range(len(given.kind.items))]
    if given.kind == RATED:
        value, rate = (each.code for each in items)
        return Expression(REAL, f"({value} + {time.code} * {rate})")
    if isinstance(items[0].kind, Tuple):
        moved = tuple(_after(writer, (each, time)) for each in items)
        return Expression(Tuple((REAL,) * len(moved), given.kind.names), "", moved)
    values, rates, memory = (each.code for each in items)
    for k in range(items[0].kind.length):
        writer.emit(f"{memory}[{k}] = {values}[{k}] + {time.code} * {rates}[{k}];")
    return Expression(items[0].kind, memory)


HEAD = workspace.HEAD
ROW = _code("({0}->rows + {0}->width * ({1}))", Array())
COMPONENT = _code(f"({{0}}->components + {stepper.ENGINE_NUMBERS} * ({{1}}))", Array())
HANDLERS: dict[Any, Any] = {
    # Rates are differences in C, whose numbers have no tangents.
    along: _function(by_differences),
    after: _after,
    with_rate: _with_rate,
    with_rates: _with_rates,
    workspace.table_row: _code("({0}->table + {0}->width * ({1}))", Array()),
    workspace.event_at: _code(f"({{0}}->events + ({HEAD} + 2 * {{0}}->n) * ({{1}}))", Array()),
    workspace.sample_at: _code("({0}->samples + (3 + {0}->n) * ({1}))", Array()),
    **dict.fromkeys((stepper.row, stepper.grouped), ROW),
    **dict.fromkeys((stepper.component, stepper.group), COMPONENT),
    stepper.groups: _code("{0}->n", INTEGER),
    stepper.group_size: _code("INT64_C(1)", INTEGER),
    stepper.sum_of: _code("({0})", REAL),
    # There are no columns.
    stepper.column_error: _code("0.0", REAL),
    stepper.scale_columns: _code("(void)0"),
    stepper.records_approaches: _code("(GUARD_IMPACTS[{1}] != 0.0)", BOOLEAN),
    stepper.set_fired: _code("({0}->fired[{1}] = {2})", INTEGER),
    interface.step: _function(stepper.step),
    interface.time: _code("{0}->t", REAL),
    interface.state: _call("engine_state"),
    interface.end_margins: _call("engine_end_margins"),
    interface.root_directions: _code("{0}->fired[{1}]", INTEGER),
    interface.interpolate: _function(stepper.interpolate),
    interface.restart: _call("engine_restart"),
    interface.method_memory: _code("INT64_C(0)", INTEGER),
    interface.bias: _code("{0}->bias[{1}]", REAL),
    interface.set_bias: _code("({0}->bias[{1}] = {2})", REAL),
    interface.flow: _call("engine_flow"),
    interface.margins: _call("engine_margins"),
    interface.set_parameter: _code("({0}->parameters[{1}] = {2})", REAL),
    interface.transition: _call("engine_transition", INTEGER),
    # DOP853 has far smaller errors in short flights than its tolerances.
    flights.sharpen: _code("(void)0"),
    interface.lengthen: _code("(void)0"),  # the importer bounds the steps
}

# Functions that the C runtime calls, with the kinds of their arguments.
ROOTS: dict[str, tuple[Any, tuple[Any, ...]]] = {
    "run_steps": (loop.run_steps, (ENGINE, LOOP, INTEGER)),
    "begin_arc": (loop.begin_arc, (ENGINE, LOOP, Array())),
    "restart": (stepper.restart, (ENGINE, INTEGER, REAL, Array(), REAL)),
    "reset": (stepper.reset, (ENGINE, REAL)),
    "interpolate": (stepper.interpolate, (ENGINE, REAL, Array())),
    "first_instant": (first_instant, (ENGINE, LOOP)),
    "imported_instant": (imported_instant, (ENGINE, LOOP, INTEGER)),
    "imported_step": (imported_step, (ENGINE, LOOP)),
    "resume": (resume, (ENGINE, LOOP, INTEGER)),
}


def event_loop_source(
    automaton: Automaton, parameters: int, generated: Mapping[Any, str]
) -> tuple[CSource, dict[str, str]]:
    """Return the source of the loop with an automaton, and its C functions by role.

    `parameters` is the length of the parameter array; `generated` has the source texts of generated
    functions, by their code objects.
    """
    source = CSource(HANDLERS, generated)
    n, m = len(automaton.states), len(automaton.guards)
    y, p, g = Array((n,)), Array((parameters,)), Array((m,))
    names = {
        "flow": source.function(automaton.flow, (INTEGER, REAL, y, p, y)).name,
        "margins": source.function(automaton.margins, (INTEGER, REAL, y, p, g, g)).name,
        "transition": source.function(automaton.transition, (INTEGER, INTEGER, REAL, y, p)).name,
    }
    for role, (function, kinds) in ROOTS.items():
        names[role] = source.function(function, kinds).name
    return source, names
