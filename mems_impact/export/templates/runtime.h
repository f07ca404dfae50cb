/* Run-time functions of an exported model: memory, co-simulation, model exchange.
 *
 * The generated file model.h defines the sizes, the model and the event loop; the event loop and
 * the integrator are those of the package mems_impact, translated to C. Times are in the unit of
 * the numerics: the time of the importer divided by TIME_UNIT.
 */

#ifndef RUNTIME_H
#define RUNTIME_H

#include <float.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    LoopState loop;
    Engine engine;
    double table[TABLE_ROWS * TABLE_WIDTH];
    double events[EVENT_ROWS * EVENT_WIDTH];
    double rows[ENGINE_ROWS * ENGINE_WIDTH];
    double components[STATES * ENGINE_NUMBERS];
    int64_t fired[2 * GUARDS + 1];
    double bias[2 * GUARDS];
    double parameters[PARAMETERS];
    /* numbers of the importer: parameters and inputs, initial state and mode */
    double values[VALUES + 1];
    /* rates of inputs in model exchange, by their values at the last completed step */
    double rates[VALUES + 1], last_values[VALUES + 1], last_time;
    double start[STATES];
    int64_t start_mode;
    /* the latest arc of co-simulation: its period, mode and offsets of cyclic states */
    int64_t arc_cycle, arc_mode;
    double arc_offset[STATES];
    double now;          /* time of the importer */
    double origin;       /* its start */
    double shown[STATES];
    int64_t shown_mode;
    int64_t read;        /* rows of the event buffer that have been reported */
    int64_t event_count, event_kind, event_guard;
    double event_time;
    int64_t counts[GUARDS];
    double times[GUARDS];
    int64_t running, imports, in_event, changed, ended, status;
} Memory;

/* Rows of the event buffer that are events of the model. */
static int is_event(const Memory *memory, const double *row)
{
    int64_t kind = (int64_t)row[EVENT_KIND];
    if (kind == KIND_SWITCH) return memory->loop.switches > 0;
    return kind == KIND_TRANSITION || kind == KIND_ACCUMULATION;
}

static double *event_row(Memory *memory, int64_t i) { return memory->events + EVENT_WIDTH * i; }

static double row_time(const Memory *memory, const double *row)
{ return row[EVENT_CYCLE] * memory->loop.period + row[EVENT_TIME]; }

static double loop_time(const Memory *memory)
{ return (double)memory->loop.cycle * memory->loop.period + memory->loop.t; }

static double *table_row(Memory *memory, int64_t i) { return memory->table + TABLE_WIDTH * i; }

/* Functions that the event loop calls */

static void engine_state(Engine *engine, double *y)
{ memcpy(y, engine->rows + engine->width * ENGINE_STATE, STATES * sizeof(double)); }

static void engine_end_margins(Engine *engine, double *out)
{ memcpy(out, engine->rows + engine->width * ENGINE_LOW, 2 * GUARDS * sizeof(double)); }

/* Give inputs with a rate the time at which they have their values. */
static void set_input_time(Engine *engine, double t)
{
    int i;
    for (i = 0; i < VALUES; i++)
        if (RATE_INDICES[i] >= 0) engine->parameters[RATE_INDICES[i] + 1] = t;
}

static void engine_flow(Engine *engine, int64_t mode, double t, double *y, double *dy)
{
    int j;
    set_input_time(engine, t);
    for (j = 0; j < STATES; j++) dy[j] = NAN;
    MODEL_FLOW(mode, t, y, engine->parameters, dy);
    if (take_integer_fault()) dy[0] = NAN;
}

static void engine_margins(Engine *engine, int64_t mode, double t, double *y, double *out)
{
    int i;
    set_input_time(engine, t);
    for (i = 0; i < 2 * GUARDS; i++) out[i] = 1.0;
    MODEL_MARGINS(mode, t, y, engine->parameters, out, out + GUARDS);
    if (take_integer_fault()) out[0] = NAN;
}

static int64_t engine_transition(Engine *engine, int64_t mode, int64_t code, double t, double *y)
{
    int64_t new_mode;
    set_input_time(engine, t);
    new_mode = MODEL_TRANSITION(mode, code, t, y, engine->parameters);
    return take_integer_fault() ? INT64_MIN : new_mode;
}

static void engine_restart(Engine *engine, int64_t mode, double t, double *y, double stop)
{
    Memory *memory = (Memory *)engine->owner;
    STEPPER_RESTART(engine, mode, t, y, stop);
    memory->arc_cycle = memory->loop.cycle;
    memory->arc_mode = mode;
    memcpy(memory->arc_offset, table_row(memory, ROW_OFFSET), sizeof memory->arc_offset);
}

/* Memory */

static void attach(Memory *memory)
{
    memory->loop.table = memory->table;
    memory->loop.events = memory->events;
    memory->loop.samples = NULL;
    memory->engine.owner = memory;
    memory->engine.rows = memory->rows;
    memory->engine.components = memory->components;
    memory->engine.fired = memory->fired;
    memory->engine.bias = memory->bias;
    memory->engine.parameters = memory->parameters;
}

static void set_up(Memory *memory)
{
    memset(memory, 0, sizeof *memory);
    attach(memory);
    memcpy(memory->values, VALUE_STARTS, sizeof VALUE_STARTS);
    memcpy(memory->start, STATE_STARTS, sizeof memory->start);
    memory->start_mode = MODE_START;
    memory->shown_mode = MODE_START;
    memory->loop.rtol = RTOL;
    memory->loop.atol = ATOL;
}

/* Update the state shown to the importer from the loop. */
static void show(Memory *memory)
{
    int j;
    double *y = table_row(memory, ROW_Y), *offset = table_row(memory, ROW_OFFSET);
    for (j = 0; j < STATES; j++) memory->shown[j] = (y[j] + offset[j]) * STATE_UNITS[j];
    memory->shown_mode = memory->loop.mode;
}

/* Report one row of the event buffer. */
static void report(Memory *memory, const double *row)
{
    int64_t guard = (int64_t)row[EVENT_GUARD];
    memory->shown_mode = (int64_t)row[EVENT_MODE_AFTER];
    if (!is_event(memory, row)) return;
    memory->event_count++;
    memory->event_kind = (int64_t)row[EVENT_KIND] + 1;
    memory->event_time = row_time(memory, row) * TIME_UNIT;
    memory->event_guard = memory->event_kind - 1 == KIND_SWITCH ? 0 : guard + 1;
    if (memory->event_kind - 1 == KIND_TRANSITION) {
        memory->counts[guard]++;
        memory->times[guard] = memory->event_time;
    }
}

static void report_all(Memory *memory)
{
    for (; memory->read < memory->loop.events_written; memory->read++)
        report(memory, event_row(memory, memory->read));
    memory->loop.events_written = 0;
    memory->read = 0;
}

/* Give the time base to functions that read the time of the importer. */
static void set_clock(Memory *memory)
{
    const int64_t clock = CLOCK;
    if (clock >= 0) memory->parameters[clock] = (double)memory->loop.cycle * memory->loop.period;
}

/* Compute the parameter array from the numbers of the importer. */
static void update_parameters(Memory *memory)
{
    int i;
    double period, scale, switches[SWITCHES + 1];
    model_parameters(memory->values, memory->parameters, &period, &scale, switches);
    for (i = 0; i < VALUES; i++)
        if (RATE_INDICES[i] >= 0)
            memory->parameters[RATE_INDICES[i]] = memory->rates[i] * TIME_UNIT / VALUE_FACTORS[i];
    memory->loop.period = period;
    memory->loop.scale = scale;
    memory->loop.switches = SWITCHES;
    set_clock(memory);
    memcpy(table_row(memory, ROW_SWITCHES), switches, SWITCHES * sizeof(double));
}

/* Set the time since the start of the period. */
static void set_time(Memory *memory, double time)
{
    double period = memory->loop.period, whole = floor(time / period);
    if (whole * period > time) whole -= 1.0;
    else if ((whole + 1.0) * period <= time) whole += 1.0;
    memory->loop.cycle = (int64_t)whole;
    memory->loop.t = time - whole * period;
    set_clock(memory);
}

/* Begin a run at the start values; return the status of the loop. */
static int64_t begin_run(Memory *memory, int imports)
{
    int j;
    LoopState *loop = &memory->loop;
    Engine *engine = &memory->engine;
    double *y = table_row(memory, ROW_Y);
    update_parameters(memory);
    loop->width = TABLE_WIDTH;
    loop->event_rows = EVENT_ROWS;
    loop->n = STATES;
    loop->m = GUARDS;
    loop->modes = MODES;
    loop->forced = FORCED;
    loop->clock = CLOCK;
    loop->first_arc = 1;
    loop->initial = 1;
    loop->pending_guard = -1;
    loop->stop = INFINITY;
    loop->max_steps = MAX_STEPS;
    loop->max_events = MAX_EVENTS;
    loop->section = -1;
    loop->end_cycle = (int64_t)1 << 50;
    for (j = 0; j < GUARDS; j++) {
        table_row(memory, ROW_ORDER)[j] = GUARD_ORDERS[j];
        table_row(memory, ROW_IMPACT)[j] = GUARD_IMPACTS[j];
        table_row(memory, ROW_RECORDS)[j] = GUARD_RECORDS[j];
        table_row(memory, ROW_CONDITION)[j] = GUARD_CONDITIONS[j];
        table_row(memory, ROW_TIMED)[j] = GUARD_TIMED[j];
        table_row(memory, ROW_HIT_TIME)[j] = -INFINITY;
        table_row(memory, ROW_HIT_BEGIN)[j] = -INFINITY;
    }
    for (j = 0; j < STATES; j++) {
        table_row(memory, ROW_CYCLIC)[j] = STATE_CYCLIC[j];
        y[j] = memory->start[j] / STATE_UNITS[j];
    }
    engine->n = engine->states = engine->interpolated = STATES;
    engine->m = GUARDS;
    engine->width = ENGINE_WIDTH;
    engine->section = -1;
    engine->rtol = loop->rtol;
    engine->atol = loop->atol;
    STEPPER_RESET(engine, loop->scale / STEPS_PER_PERIOD);
    set_time(memory, memory->now / TIME_UNIT);
    loop->mode = model_mode(memory->start_mode, FORCED ? loop->t : memory->now / TIME_UNIT, y,
                            memory->values, memory->parameters);
    memory->last_time = memory->now;
    memcpy(memory->last_values, memory->values, sizeof memory->values);
    memory->running = 1;
    memory->imports = imports;
    show(memory);
    if (!imports) return STATUS_DONE;
    memory->in_event = 2;   /* inputs may be set until the first step, but no guard fires again */
    memory->status = LOOP_FIRST_INSTANT(engine, loop);
    report_all(memory);
    show(memory);
    return memory->status;
}

/* Whether the loop can continue after this status. */
static int is_good(int64_t status)
{ return status == STATUS_PAUSED || status == STATUS_BUFFER_FULL || status == STATUS_DONE; }

static const char *explain(const Memory *memory, char *text, size_t size)
{
    const LoopState *loop = &memory->loop;
    const char *guard = loop->failure >= 0 && loop->failure < GUARDS ? GUARD_NAMES[loop->failure] : "";
    double time = loop_time(memory) * TIME_UNIT;
    switch (memory->status) {
    case STATUS_FAILED:
        snprintf(text, size, "t = %.9g: the integration failed (code %d); is the flow finite?",
                 time, (int)loop->failure);
        break;
    case STATUS_STEP_BUDGET:
        snprintf(text, size, "t = %.9g: more than %d steps in one arc", time, MAX_STEPS);
        break;
    case STATUS_EVENT_BUDGET:
        snprintf(text, size, "t = %.9g: more than %d events in one period", time, MAX_EVENTS);
        break;
    case STATUS_CYCLING:
        snprintf(text, size, "t = %.9g: a state recurs within one instant", time);
        break;
    case STATUS_INADMISSIBLE:
        snprintf(text, size, "t = %.9g: the start is beyond the guard '%s'", time, guard);
        break;
    case STATUS_WITHOUT_EFFECT:
        snprintf(text, size, "t = %.9g: the impact '%s' changes nothing", time, guard);
        break;
    case STATUS_NO_SUCH_MODE:
        if (loop->failure == NO_REST)
            snprintf(text, size, "t = %.9g: impacts accumulate; give the Impact a rest transition",
                     time);
        else
            snprintf(text, size, "t = %.9g: a transition leads to mode %d, which does not exist",
                     time, (int)loop->failure);
        break;
    case STATUS_NOT_FINITE:
        snprintf(text, size, "t = %.9g: the state after '%s' is not finite", time, guard);
        break;
    default:
        snprintf(text, size, "t = %.9g: status %d", time, (int)memory->status);
    }
    return text;
}

/* Write the derivatives and the margins at the time and state of the importer. */
static void evaluate(Memory *memory, double *derivatives, double *margins)
{
    int i, j;
    Engine *engine = &memory->engine;
    double y[STATES], dy[STATES], g[2 * GUARDS], time, period = memory->loop.period;
    int64_t mode = memory->shown_mode;
    for (j = 0; j < STATES; j++) {
        y[j] = memory->shown[j] / STATE_UNITS[j];
        if (STATE_CYCLIC[j]) y[j] -= table_row(memory, ROW_OFFSET)[j];
    }
    time = memory->now / TIME_UNIT;
    if (memory->imports) {
        time = memory->loop.t < engine->last_instant ? memory->loop.t : engine->last_instant;
    } else if (FORCED) {
        time -= period * floor(time / period);
        if (time < 0.0 || time >= period) time = 0.0;
    } else {
        time -= (double)memory->loop.cycle * period;
    }
    if (derivatives != NULL) {
        engine_flow(engine, mode, time, y, dy);
        for (j = 0; j < STATES; j++) derivatives[j] = dy[j] * (STATE_UNITS[j] / TIME_UNIT);
    }
    if (margins != NULL) {
        engine_margins(engine, mode, time, y, g);
        for (i = 0; i < GUARDS; i++) {
            double bias = memory->imports ? engine->bias[i] : 0.0;
            margins[i] = g[i] + bias;
            margins[GUARDS + i] = g[GUARDS + i];
        }
    }
}

/* Co-simulation */

/* Show the state at a time within the last step. */
static void show_at(Memory *memory, double time)
{
    int j;
    int64_t i;
    double y[STATES];
    LoopState *loop = &memory->loop;
    if (time >= loop_time(memory)) {
        show(memory);
        return;
    }
    for (i = memory->read; i < loop->events_written; i++) {
        /* between the last impact of a chatter sequence and its end */
        double *row = event_row(memory, i), end = row_time(memory, row), begin, share;
        if ((int64_t)row[EVENT_KIND] != KIND_ACCUMULATION || i == 0) continue;
        begin = row_time(memory, event_row(memory, i - 1));
        if (!(begin <= time && time < end)) continue;
        share = (time - begin) / (end - begin);
        for (j = 0; j < STATES; j++) {
            double past = row[EVENT_STATES + j], left = row[EVENT_STATES + STATES + j];
            memory->shown[j] = (past + share * (left - past)) * STATE_UNITS[j];
        }
        return;
    }
    STEPPER_INTERPOLATE(&memory->engine, time - (double)memory->arc_cycle * loop->period, y);
    for (j = 0; j < STATES; j++)
        memory->shown[j] = (y[j] + memory->arc_offset[j]) * STATE_UNITS[j];
    memory->shown_mode = memory->arc_mode;
}

/* Go to a time of the importer, or with `early` to the first event before it.
 *
 * Without inputs the loop runs ahead by whole steps, so that the motion does not depend on the
 * communication points. Return 1 at an event, 0 at the time, -1 after a failure.
 */
static int advance(Memory *memory, double until, int early)
{
    LoopState *loop = &memory->loop;
    double target = until / TIME_UNIT, slack = 4.0 * 2.220446049250313e-16 * fabs(target);
    if (INPUTS > 0) {
        double period = loop->period, whole = floor(target / period);
        loop->end_cycle = (int64_t)whole;
        loop->end_phase = target - whole * period;
        LOOP_RESUME(&memory->engine, loop, memory->changed);
        memory->changed = 0;
    }
    for (;;) {
        while (memory->read < loop->events_written) {
            double *row = event_row(memory, memory->read), time = row_time(memory, row);
            if (time > target + slack) break;
            memory->read++;
            if (early && is_event(memory, row)) {
                double now = time * TIME_UNIT;
                int j;
                report(memory, row);
                /* the other events of the instant */
                while (memory->read < loop->events_written
                       && row_time(memory, event_row(memory, memory->read)) == time)
                    report(memory, event_row(memory, memory->read++));
                memory->now = now < until ? now : until;
                row = event_row(memory, memory->read - 1);
                for (j = 0; j < STATES; j++)
                    memory->shown[j] = row[EVENT_STATES + STATES + j] * STATE_UNITS[j];
                memory->shown_mode = (int64_t)row[EVENT_MODE_AFTER];
                return 1;
            }
            report(memory, row);
        }
        if (memory->ended || (loop_time(memory) >= target && loop->first_arc == 0)) break;
        report_all(memory);
        memory->status = LOOP_RUN_STEPS(&memory->engine, loop, 1);
        if (memory->status == STATUS_ENDED) memory->ended = 1;
        else if (!is_good(memory->status)) return -1;
        if (INPUTS > 0 && memory->status == STATUS_DONE) target = loop_time(memory);
    }
    memory->now = until;
    show_at(memory, target);
    return 0;
}

/* Model exchange */

static void import_time(Memory *memory, double time)
{
    memory->now = time;
    if (memory->running)
        memory->loop.t = time / TIME_UNIT - (double)memory->loop.cycle * memory->loop.period;
}

static void import_states(Memory *memory, const double *x)
{
    int j;
    double *y = table_row(memory, ROW_Y), *offset = table_row(memory, ROW_OFFSET);
    for (j = 0; j < STATES; j++) {
        memory->shown[j] = x[j];
        y[j] = x[j] / STATE_UNITS[j] - offset[j];
    }
}

/* Complete a step of the importer; return whether a guard fires at its end. */
static int import_step(Memory *memory)
{
    int i;
    double length = memory->now - memory->last_time;
    if (INPUTS > 0 && length > 0.0) {
        for (i = 0; i < VALUES; i++) {
            if (VALUE_KINDS[i] == 2)
                memory->rates[i] = (memory->values[i] - memory->last_values[i]) / length;
            memory->last_values[i] = memory->values[i];
        }
        memory->last_time = memory->now;
        update_parameters(memory);
    }
    return LOOP_IMPORTED_STEP(&memory->engine, &memory->loop);
}

/* Perform the transitions at the present time; return whether the state has changed. */
static int import_instant(Memory *memory)
{
    int j, changed = 0;
    double before[STATES];
    memcpy(before, memory->shown, sizeof before);
    memory->status = LOOP_IMPORTED_INSTANT(&memory->engine, &memory->loop, memory->changed);
    if (memory->changed) {
        /* the rates before a jump say nothing about those after it */
        memset(memory->rates, 0, sizeof memory->rates);
        memcpy(memory->last_values, memory->values, sizeof memory->values);
        memory->last_time = memory->now;
        update_parameters(memory);
    }
    memory->changed = 0;
    report_all(memory);
    show(memory);
    if (memory->status == STATUS_ENDED) memory->ended = 1;
    else if (!is_good(memory->status)) return -1;
    for (j = 0; j < STATES; j++)
        if (before[j] != memory->shown[j]) changed = 1;
    return changed;
}

static double next_time_event(const Memory *memory)
{
    const double *switches = memory->table + ROW_SWITCHES * TABLE_WIDTH;
    double time = (double)memory->loop.cycle * memory->loop.period + memory->loop.stop;
    if (isinf(memory->loop.stop)) return INFINITY;
    if (!FORCED) {   /* the loop stops at the last time before the switch */
        while (*switches < time) switches++;
        time = *switches;
    }
    return time * TIME_UNIT;
}

static void event_indicators(Memory *memory, double *out)
{
    int i, k = 0;
    double margins[2 * GUARDS];
    evaluate(memory, NULL, margins);
    for (i = 0; i < GUARDS; i++) {
        /* A gap that opens is not closed: between impacts lower than its tolerance an importer
           may interpolate a negative gap, and would locate events without end. */
        int opens = GUARD_IMPACTS[i] != 0.0 && margins[GUARDS + i] > 0.0;
        out[k++] = opens && margins[i] <= 0.0 ? 1e-300 : margins[i];
    }
    for (i = 0; i < GUARDS; i++)
        if (GUARD_IMPACTS[i] != 0.0) out[k++] = margins[GUARDS + i];
}

/* Values by reference */

static int get_real(Memory *memory, unsigned reference, double *value)
{
    double many[2 * GUARDS > STATES ? 2 * GUARDS : STATES];
    int64_t i = (int64_t)reference;
    if (i == 0) { *value = memory->now; return 1; }
    i -= 1;
    if (i < STATES) { *value = memory->running ? memory->shown[i] : memory->start[i]; return 1; }
    i -= STATES;
    if (i < STATES) { evaluate(memory, many, NULL); *value = many[i]; return 1; }
    i -= STATES;
    if (i < VALUES) { *value = memory->values[i]; return 1; }
    i -= VALUES;
    if (i < 2 * GUARDS) { evaluate(memory, NULL, many); *value = many[i]; return 1; }
    i -= 2 * GUARDS;
    if (i == 0) { *value = memory->event_time; return 1; }
    i -= 1;
    if (i < GUARDS) { *value = memory->times[i]; return 1; }
    return 0;
}

/* The first time that the loop cannot take, or number beyond a bound by others, as a text; NULL
   if there is none. */
static const char *contradiction(const Memory *memory, char *text, size_t size)
{
    int i;
    double period, scale, before = 0.0, switches[SWITCHES + 1], p[PARAMETERS + 1];
    model_parameters(memory->values, p, &period, &scale, switches);
    if (!(period > 0.0 && isfinite(period))) {
        snprintf(text, size, "period = %.9g: must be finite and above 0", period * TIME_UNIT);
        return text;
    }
    for (i = 0; i < SWITCHES; before = switches[i++]) {
        double last = FORCED ? period : DBL_MAX;
        if (switches[i] > before && switches[i] <= last) continue;
        snprintf(text, size, "switch %d = %.9g: must be above %.9g and at most %.9g%s", i + 1,
                 switches[i] * TIME_UNIT, before * TIME_UNIT, last * TIME_UNIT,
                 FORCED ? ", the period" : "");
        return text;
    }
    if (!(scale > 0.0)) {
        snprintf(text, size, "time_scale = %.9g: must be above 0", scale * TIME_UNIT);
        return text;
    }
    for (i = 0; i < BOUNDS; i++) {
        int k = VALUE_BOUNDS[i][0];
        double bound = model_bound(i, p), value = p[VALUE_BOUNDS[i][1]];
        double room = VALUE_BOUNDS[i][2] ? bound - value : value - bound;
        if (VALUE_BOUNDS[i][3] ? room > 0.0 : room >= -BOUND_RTOL * fabs(bound)) continue;
        snprintf(text, size, "%s = %.9g%s: must be %s %.9g%s, %s", VALUE_NAMES[k],
                 memory->values[k], VALUE_UNITS[k], BOUND_SIGNS[i], bound * VALUE_FACTORS[k],
                 VALUE_UNITS[k], BOUND_MEANINGS[i]);
        return text;
    }
    return NULL;
}

/* Set a state, parameter or input; return NULL, or why not. */
static const char *set_real(Memory *memory, unsigned reference, double value, char *text,
                            size_t size)
{
    static const char *const NOT_NOW = "this variable cannot be set now";
    double before;
    int64_t i = (int64_t)reference - 1;
    if (i >= 0 && i < STATES) {
        if (memory->running && !memory->imports) return NOT_NOW;
        if (!isfinite(value)) return "an initial state must be a finite number";
        memory->start[i] = value;
        if (memory->running) {
            memory->shown[i] = value;
            import_states(memory, memory->shown);
        }
        return NULL;
    }
    i -= 2 * STATES;
    if (i < 0 || i >= VALUES) return NOT_NOW;
    if (memory->values[i] == value) return NULL;
    if (VALUE_KINDS[i] == 0 || (memory->running && VALUE_KINDS[i] != 2)) return NOT_NOW;
    if (!isfinite(value) || value < VALUE_LOWS[i] || value > VALUE_HIGHS[i]) {
        snprintf(text, size, "%s = %.9g%s: must be %s", VALUE_NAMES[i], value, VALUE_UNITS[i],
                 VALUE_RANGES[i]);
        return text;
    }
    before = memory->values[i];
    memory->values[i] = value;
    if (memory->running && contradiction(memory, text, size) != NULL) {
        memory->values[i] = before;
        return text;
    }
    if (!memory->imports || memory->in_event) memory->changed = 1;
    if (memory->running) update_parameters(memory);
    return NULL;
}

static int get_integer(Memory *memory, unsigned reference, int64_t *value)
{
    int64_t i = (int64_t)reference - FIRST_INTEGER;
    if (i == 0) *value = memory->running ? memory->shown_mode : memory->start_mode;
    else if (i == 1) *value = memory->event_count;
    else if (i == 2) *value = memory->event_kind;
    else if (i == 3) *value = memory->event_guard;
    else if (i >= 4 && i < 4 + GUARDS) *value = memory->counts[i - 4];
    else return 0;
    return 1;
}

static int set_integer(Memory *memory, unsigned reference, int64_t value)
{
    if ((int64_t)reference != FIRST_INTEGER || value < 0 || value >= MODES || memory->running)
        return 0;
    memory->start_mode = value;
    return 1;
}

#endif
