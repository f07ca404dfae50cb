"""The header of an exported model: its sizes, tables, functions and the event loop in C."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from mems_impact._util.limits import BOUND_RTOL
from mems_impact.export.c_kinds import INTEGER, REAL, Array, Tuple, literal
from mems_impact.export.c_source import CSource
from mems_impact.export.event_loop_source import ENGINE, LOOP, event_loop_source, record_structure
from mems_impact.export.model import ExportedModel, ExportedNumber
from mems_impact.hybrid.definition import RATE_STEP
from mems_impact.hybrid.event_loop import workspace
from mems_impact.hybrid.event_loop.long_steps import STEPS_PER_PERIOD
from mems_impact.integrators.dop853 import stepper

EVENT_BUFFER_ROWS = 512  # and eight for each guard; transitions of one instant fit
EVENT_VARIABLES = 4  # mode, and number, kind and guard of the latest event
TOKEN = "@token@"
CONSTANT, PARAMETER, INPUT = 0, 1, 2  # kinds of numbers

LOOP_POINTERS = ("double *table", "double *events", "double *samples")
ENGINE_POINTERS = (
    *("void *owner", "double *rows", "double *components"),
    *("double *bias", "double *parameters", "int64_t *fired"),
)
PROTOTYPES = """\
static void engine_state(Engine *, double *);
static void engine_end_margins(Engine *, double *);
static void engine_flow(Engine *, int64_t, double, double *, double *);
static void engine_margins(Engine *, int64_t, double, double *, double *);
static int64_t engine_transition(Engine *, int64_t, int64_t, double, double *);
static void engine_restart(Engine *, int64_t, double, double *, double);"""


def first_integer(model: ExportedModel) -> int:
    """Return the value reference of the first integer variable; real ones precede it."""
    n, m = len(model.automaton.states), len(model.automaton.guards)
    return 1 + 2 * n + len(model.numbers) + 3 * m + 1


def kind_of_number(model: ExportedModel, i: int) -> int:
    """Return CONSTANT, PARAMETER or INPUT."""
    number = model.numbers[i]
    if number.name in model.inputs:
        return INPUT
    return PARAMETER if number.index is not None else CONSTANT


def model_header(model: ExportedModel) -> str:
    """Return the source of ``model.h``, with TOKEN in place of the token of instantiation."""
    automaton, problem = model.automaton, model.problem
    source, names = event_loop_source(automaton, len(problem.parameters), model.generated)
    n, m = len(automaton.states), len(automaton.guards)
    switches = len(problem.switches)
    sizes: dict[str, Any] = {
        "STATES": n,
        "GUARDS": m,
        "MODES": len(automaton.modes),
        "PARAMETERS": len(problem.parameters),
        "VALUES": len(model.numbers),
        "INPUTS": len(model.inputs),
        "BOUNDS": len(model.bounds),
        "SWITCHES": switches,
        "INDICATORS": m + sum(guard.impact for guard in automaton.guards),
        "FIRST_INTEGER": first_integer(model),
        "MODE_START": int(model.initial.mode),
        "FORCED": int(automaton.forced),
        "CLOCK": f"({workspace.NONE if automaton.clock is None else automaton.clock})",
        "TABLE_ROWS": workspace.ROWS,
        "TABLE_WIDTH": max(n, 2 * m, switches),
        "EVENT_ROWS": EVENT_BUFFER_ROWS + 8 * m,
        "EVENT_WIDTH": workspace.HEAD + 2 * n,
        "ENGINE_ROWS": stepper.ROWS,
        "ENGINE_WIDTH": max(n, 2 * m + 2),
        "ENGINE_NUMBERS": stepper.ENGINE_NUMBERS,
        "ENGINE_STATE": stepper.STATE,
        "ENGINE_LOW": stepper.LOW,
        "MAX_STEPS": min(problem.options.max_steps, 2**31 - 1),
        "MAX_EVENTS": min(problem.options.max_events, 2**31 - 1),
        "NO_REST": f"({workspace.NO_REST})",
        "EVENT_STATES": workspace.HEAD,
    }
    rows = ("Y", "OFFSET", "ORDER", "IMPACT", "RECORDS", "CONDITION", "TIMED", "CYCLIC", "HIT_TIME")
    sizes |= {f"ROW_{row}": getattr(workspace, row) for row in (*rows, "HIT_BEGIN", "SWITCHES")}
    columns = ("CYCLE", "TIME", "KIND", "GUARD", "MODE_BEFORE", "MODE_AFTER")
    sizes |= {f"EVENT_{column}": getattr(workspace, column) for column in columns}
    sizes |= {f"KIND_{kind.name}": int(kind) for kind in workspace.Kind}
    sizes |= {f"STATUS_{status.name}": int(status) for status in workspace.Status}
    sizes |= {
        "BOUND_RTOL": literal(BOUND_RTOL),
        "RTOL": literal(problem.options.rtol),
        "ATOL": literal(problem.options.atol),
        "STEPS_PER_PERIOD": literal(STEPS_PER_PERIOD),
        "TIME_UNIT": literal(model.time_factor),
        "TOKEN": f'"{TOKEN}"',
        "MODEL_FLOW": names["flow"],
        "MODEL_MARGINS": names["margins"],
        "MODEL_TRANSITION": names["transition"],
        "STEPPER_RESTART": names["restart"],
        "STEPPER_RESET": names["reset"],
        "STEPPER_INTERPOLATE": names["interpolate"],
        "LOOP_RUN_STEPS": names["run_steps"],
        "LOOP_FIRST_INSTANT": names["first_instant"],
        "LOOP_IMPORTED_INSTANT": names["imported_instant"],
        "LOOP_IMPORTED_STEP": names["imported_step"],
        "LOOP_RESUME": names["resume"],
    }
    guards = automaton.guards
    factors = np.array(model.state_factors, dtype=float)
    tables = [
        reals("STATE_UNITS", model.state_factors),
        reals("STATE_STARTS", (np.asarray(model.initial.y) * factors).tolist()),
        reals("STATE_CYCLIC", [float(i in automaton.cyclic) for i in range(n)]),
        reals("GUARD_ORDERS", [float(guard.order or 0) for guard in guards]),
        reals("GUARD_IMPACTS", [float(guard.impact) for guard in guards]),
        reals("GUARD_RECORDS", [float(guard.records) for guard in guards]),
        reals("GUARD_CONDITIONS", [float(guard.condition or guard.impact) for guard in guards]),
        reals("GUARD_TIMED", [float(i in automaton.timed) for i in range(m)]),
        texts("GUARD_NAMES", [guard.name for guard in guards]),
        reals("VALUE_STARTS", [number.value for number in model.numbers] or [0.0]),
        "static const int VALUE_KINDS[] = { "
        + (", ".join(str(kind_of_number(model, i)) for i in range(len(model.numbers))) or "0")
        + " };",
        "static const int RATE_INDICES[] = { "
        + (", ".join(str(rate_index(number)) for number in model.numbers) or "-1")
        + " };",
        reals("VALUE_FACTORS", [number.factor for number in model.numbers] or [1.0]),
        *limit_tables(model),
        reals("PARAMETER_STARTS", problem.parameters),
    ]
    functions = "\n\n".join(
        [
            parameter_function(model, source),
            bound_function(model, source),
            mode_function(model, source),
        ]
    )
    lines = [f"#define {name} {value}" for name, value in sizes.items()]
    return "\n\n".join(
        [
            comment(f"{model.name or 'A system'}, exported by the package mems_impact."),
            "#ifndef MODEL_H\n#define MODEL_H",
            "\n".join(lines),
            "typedef struct LoopState LoopState;\ntypedef struct Engine Engine;",
            record_structure(LOOP, LOOP_POINTERS),
            record_structure(ENGINE, ENGINE_POINTERS),
            PROTOTYPES,
            "\n".join(tables),
            source.text().rstrip(),
            functions,
            "#endif\n",
        ]
    )


def rate_index(number: ExportedNumber) -> int:
    """Return the index of the rate of an input; -1 without one."""
    return -1 if number.rate_index is None else number.rate_index


def limit_tables(model: ExportedModel) -> list[str]:
    """Return names and ranges of the numbers, and where their bounds by others apply."""
    numbers = model.numbers
    lows, highs, ranges = [], [], []
    for number in numbers:
        limits = number.limits
        lows.append(math.nextafter(limits.low, math.inf) if limits.low_excluded else limits.low)
        highs.append(
            math.nextafter(limits.high, -math.inf) if limits.high_excluded else limits.high
        )
        ranges.append(limits.allowed)
    numbers_by_name = {number.name: i for i, number in enumerate(numbers)}
    rows = []
    for bound in model.bounds:
        i = numbers_by_name[bound.name]
        index = numbers[i].index
        assert index is not None
        rows.append((i, index, bound.upper, bound.excluded))
    return [
        reals("VALUE_LOWS", lows or [0.0]),
        reals("VALUE_HIGHS", highs or [0.0]),
        texts("VALUE_NAMES", [number.name for number in numbers]),
        texts("VALUE_UNITS", [f" {number.unit}".rstrip() for number in numbers]),
        texts("VALUE_RANGES", ranges),
        "static const int VALUE_BOUNDS[][4] = { "
        + (
            ", ".join(f"{{ {', '.join(str(int(cell)) for cell in row)} }}" for row in rows)
            or "{ 0 }"
        )
        + " };",
        texts("BOUND_SIGNS", [bound.sign for bound in model.bounds]),
        texts("BOUND_MEANINGS", [bound.meaning for bound in model.bounds]),
    ]


def texts(name: str, values: Sequence[str]) -> str:
    """Return a table of strings."""
    literals = ", ".join(map(text, values)) or text("")
    return f"static const char *const {name}[] = {{ {literals} }};"


def reals(name: str, values: Sequence[float]) -> str:
    """Return a table of reals."""
    return f"static const double {name}[] = {{ {', '.join(map(literal, values))} }};"


def comment(value: str) -> str:
    """Return a comment."""
    return f"/* {plain(value).replace('*/', '*_')} */"


def text(value: str) -> str:
    """Return a string literal."""
    return f'"{plain(value)}"'


def plain(value: str) -> str:
    """Return a text without characters that C or its preprocessor interprets."""
    return "".join(c if c.isascii() and c.isprintable() and c not in '"\\?' else "_" for c in value)


def named_values(model: ExportedModel) -> tuple[Tuple, str]:
    """Return the kind of the parameters by name, and their C expression."""
    names = tuple(number.name for number in model.numbers)
    kind = Tuple((REAL,) * len(names), names)
    return kind, f"({kind.ctype}){{{', '.join(f'values[{i}]' for i in range(len(names)))}}}"


def call_expression(function: Any, model: ExportedModel, source: CSource) -> str:
    """Return the value of a user's function of the parameters, as C."""
    kind, values = named_values(model)
    return f"{source.function(function, (kind,)).name}({values})"


def parameter_function(model: ExportedModel, source: CSource) -> str:
    """Return the function that computes the parameter array and the times."""
    problem = model.problem
    lines = ["memcpy(p, PARAMETER_STARTS, sizeof PARAMETER_STARTS);"]
    for i, number in enumerate(model.numbers):
        if number.index is not None:
            lines.append(
                f"if (values[{i}] != VALUE_STARTS[{i}]) "
                f"p[{number.index}] = values[{i}] / {literal(number.factor)};"
            )
    unit = literal(model.time_factor)
    if model.period is not None:
        lines.append(f"*period = {call_expression(model.period, model, source)} / {unit};")
    else:
        lines.append(f"*period = {literal(problem.period)};")
    if model.time_scale is not None:
        lines.append(f"*scale = {call_expression(model.time_scale, model, source)} / {unit};")
    elif problem.time_scale is not None:
        lines.append(f"*scale = {literal(problem.time_scale)};")
    else:
        lines.append("*scale = *period;")
    if model.rate_step_index is not None and (model.period or model.time_scale):
        lines.append(f"p[{model.rate_step_index}] = {literal(RATE_STEP)} * *scale;")
    if model.switches is not None and problem.switches:
        kind, values = named_values(model)
        times_function = source.function(model.switches, (kind,))
        lines.append(f"{{ {times_function.result.ctype} times = {times_function.name}({values});")
        lines += [
            f"switches[{i}] = (double)times.f{i} / {unit};" for i in range(len(problem.switches))
        ]
        lines.append("}")
    else:
        lines += [f"switches[{i}] = {literal(t)};" for i, t in enumerate(problem.switches)]
    lines.append("(void)values; (void)switches;")
    return block(
        "static void model_parameters(const double *values, double *p, double *period, "
        "double *scale, double *switches)",
        lines,
    )


def bound_function(model: ExportedModel, source: CSource) -> str:
    """Return the function that computes a bound, in the units of the numerics."""
    p = Array((len(model.problem.parameters),))
    names = [source.function(bound.value, (p,)).name for bound in model.bounds]
    lines = [f"if (i == {i}) return {name}(p);" for i, name in enumerate(names)]
    return block(
        "static double model_bound(int i, double *p)", [*lines, "(void)i; (void)p;", "return 0.0;"]
    )


def mode_function(model: ExportedModel, source: CSource) -> str:
    """Return the function that determines the mode of an initial state."""
    n = len(model.automaton.states)
    lines = ["(void)t; (void)y; (void)p; (void)values;"]
    if model.mode_by_switch:
        lines.append(f"return MODEL_TRANSITION(mode, {2 * len(model.automaton.guards)}, t, y, p);")
    elif model.mode_of is not None:
        kind, values = named_values(model)
        state = Tuple((REAL,) * n, model.automaton.states)
        translated = source.function(model.mode_of, (INTEGER, REAL, state, kind))
        y = ", ".join(f"y[{i}] * STATE_UNITS[{i}]" for i in range(n))
        lines.append(
            f"return {translated.name}(mode, t * TIME_UNIT, ({state.ctype}){{{y}}}, {values});"
        )
    else:
        lines.append("return mode;")
    return block(
        "static int64_t model_mode(int64_t mode, double t, double *y, const double *values, "
        "double *p)",
        lines,
    )


def block(head: str, lines: Sequence[str]) -> str:
    """Return a C function."""
    return "\n".join([head, "{", *("    " + line for line in lines), "}"])
