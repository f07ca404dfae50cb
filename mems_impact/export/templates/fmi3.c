/* FMI 3.0 interface of an exported model, for model exchange and co-simulation. */

#include <stddef.h>
#include "arithmetic.h"
#include "model.h"
#include "runtime.h"

/* Types of the standard */

typedef void *fmi3Instance, *fmi3InstanceEnvironment, *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef const char *fmi3String;
typedef const uint8_t *fmi3Binary;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef enum { fmi3Independent } fmi3DependencyKind;
typedef enum { fmi3IntervalNotYetKnown } fmi3IntervalQualifier;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3AnyCallback)(void);

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif
#if defined(FMI3_FUNCTION_PREFIX) && !defined(FMI3_OVERRIDE_FUNCTION_PREFIX)
#define JOINED(a, b) a##b
#define JOIN(a, b) JOINED(a, b)
#define NAME(name) JOIN(FMI3_FUNCTION_PREFIX, name)
#else
#define NAME(name) name
#endif
#define FMI(name) EXPORT fmi3Status NAME(name)
#define UNUSED(x) (void)(x)

/* Instances */

typedef struct {
    Memory memory;
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
    bool exchange, events, early;
} Instance;

static Memory *of(fmi3Instance instance) { return &((Instance *)instance)->memory; }

static fmi3Status failed(fmi3Instance instance, const char *message)
{
    Instance *own = instance;
    if (own->log != NULL) own->log(own->environment, fmi3Error, "logStatusError", message);
    return fmi3Error;
}

static fmi3Status run_failed(fmi3Instance instance)
{
    char text[256];
    return failed(instance, explain(of(instance), text, sizeof text));
}

static fmi3Instance create(fmi3String token, fmi3InstanceEnvironment environment,
                           fmi3LogMessageCallback log)
{
    Instance *instance;
    if (token == NULL || strcmp(token, TOKEN) != 0) return NULL;
    instance = calloc(1, sizeof *instance);
    if (instance == NULL) return NULL;
    instance->environment = environment;
    instance->log = log;
    set_up(&instance->memory);
    return instance;
}

EXPORT const char *NAME(fmi3GetVersion)(void) { return "3.0"; }

FMI(fmi3SetDebugLogging)(fmi3Instance c, bool on, size_t n, const fmi3String categories[])
{ UNUSED(c); UNUSED(on); UNUSED(n); UNUSED(categories); return fmi3OK; }

EXPORT fmi3Instance NAME(fmi3InstantiateModelExchange)(
    fmi3String name, fmi3String token, fmi3String resources, bool visible, bool logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    Instance *instance = create(token, environment, log);
    UNUSED(name); UNUSED(resources); UNUSED(visible); UNUSED(logging);
    if (instance != NULL) instance->exchange = true;
    return instance;
}

EXPORT fmi3Instance NAME(fmi3InstantiateCoSimulation)(
    fmi3String name, fmi3String token, fmi3String resources, bool visible, bool logging,
    bool events, bool early, const fmi3ValueReference required[], size_t n,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3AnyCallback update)
{
    Instance *instance = create(token, environment, log);
    UNUSED(name); UNUSED(resources); UNUSED(visible); UNUSED(logging);
    UNUSED(required); UNUSED(n); UNUSED(update);
    if (instance != NULL) {
        instance->events = events;
        instance->early = early;
    }
    return instance;
}

EXPORT fmi3Instance NAME(fmi3InstantiateScheduledExecution)(
    fmi3String name, fmi3String token, fmi3String resources, bool visible, bool logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3AnyCallback update,
    fmi3AnyCallback lock, fmi3AnyCallback unlock)
{
    UNUSED(name); UNUSED(token); UNUSED(resources); UNUSED(visible); UNUSED(logging);
    UNUSED(environment); UNUSED(log); UNUSED(update); UNUSED(lock); UNUSED(unlock);
    return NULL;
}

EXPORT void NAME(fmi3FreeInstance)(fmi3Instance c) { free(c); }

FMI(fmi3EnterInitializationMode)(fmi3Instance c, bool defined, double tolerance, double start,
                                 bool stops, double stop)
{
    UNUSED(stops); UNUSED(stop);
    of(c)->now = of(c)->origin = start;
    if (defined && tolerance > 0.0 && ((Instance *)c)->exchange) {
        of(c)->loop.rtol = tolerance;
        of(c)->loop.atol = 1e-2 * tolerance;
    }
    return fmi3OK;
}

FMI(fmi3ExitInitializationMode)(fmi3Instance c)
{
    char text[256];
    Instance *instance = c;
    if (contradiction(of(c), text, sizeof text) != NULL) return failed(c, text);
    if (!is_good(begin_run(of(c), instance->exchange))) return run_failed(c);
    of(c)->changed = 0;
    if (!instance->exchange && advance(of(c), of(c)->now, 0) < 0) return run_failed(c);
    return fmi3OK;
}

FMI(fmi3EnterEventMode)(fmi3Instance c) { of(c)->in_event = 1; return fmi3OK; }
FMI(fmi3Terminate)(fmi3Instance c) { UNUSED(c); return fmi3OK; }
FMI(fmi3Reset)(fmi3Instance c) { set_up(of(c)); return fmi3OK; }
FMI(fmi3EnterConfigurationMode)(fmi3Instance c) { UNUSED(c); return fmi3OK; }
FMI(fmi3ExitConfigurationMode)(fmi3Instance c) { UNUSED(c); return fmi3OK; }

/* Values */

FMI(fmi3GetFloat64)(fmi3Instance c, const fmi3ValueReference vr[], size_t n, double values[],
                    size_t count)
{
    size_t i;
    UNUSED(count);
    for (i = 0; i < n; i++)
        if (!get_real(of(c), vr[i], &values[i])) return failed(c, "no such real variable");
    return fmi3OK;
}

FMI(fmi3SetFloat64)(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const double values[],
                    size_t count)
{
    char text[256];
    size_t i;
    UNUSED(count);
    for (i = 0; i < n; i++) {
        const char *refusal = set_real(of(c), vr[i], values[i], text, sizeof text);
        if (refusal != NULL) return failed(c, refusal);
    }
    return fmi3OK;
}

FMI(fmi3GetInt32)(fmi3Instance c, const fmi3ValueReference vr[], size_t n, int32_t values[],
                  size_t count)
{
    size_t i;
    int64_t number;
    UNUSED(count);
    for (i = 0; i < n; i++) {
        if (!get_integer(of(c), vr[i], &number)) return failed(c, "no such integer variable");
        values[i] = (int32_t)number;
    }
    return fmi3OK;
}

FMI(fmi3SetInt32)(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const int32_t values[],
                  size_t count)
{
    size_t i;
    UNUSED(count);
    for (i = 0; i < n; i++)
        if (!set_integer(of(c), vr[i], values[i]))
            return failed(c, "this variable cannot be set now, or has no such value");
    return fmi3OK;
}

#define NO_VARIABLES(kind, type) \
    FMI(fmi3Get##kind)(fmi3Instance c, const fmi3ValueReference vr[], size_t n, type values[], \
                       size_t count) \
    { UNUSED(vr); UNUSED(values); UNUSED(count); \
      return n == 0 ? fmi3OK : failed(c, "no such variable"); } \
    FMI(fmi3Set##kind)(fmi3Instance c, const fmi3ValueReference vr[], size_t n, \
                       const type values[], size_t count) \
    { UNUSED(vr); UNUSED(values); UNUSED(count); \
      return n == 0 ? fmi3OK : failed(c, "no such variable"); }

NO_VARIABLES(Float32, float)
NO_VARIABLES(Int8, int8_t)
NO_VARIABLES(UInt8, uint8_t)
NO_VARIABLES(Int16, int16_t)
NO_VARIABLES(UInt16, uint16_t)
NO_VARIABLES(UInt32, uint32_t)
NO_VARIABLES(Int64, int64_t)
NO_VARIABLES(UInt64, uint64_t)
NO_VARIABLES(Boolean, bool)

FMI(fmi3GetString)(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3String values[],
                   size_t count)
{ UNUSED(vr); UNUSED(values); UNUSED(count); return n == 0 ? fmi3OK : failed(c, "no strings"); }
FMI(fmi3SetString)(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                   const fmi3String values[], size_t count)
{ UNUSED(vr); UNUSED(values); UNUSED(count); return n == 0 ? fmi3OK : failed(c, "no strings"); }
FMI(fmi3GetBinary)(fmi3Instance c, const fmi3ValueReference vr[], size_t n, size_t sizes[],
                   fmi3Binary values[], size_t count)
{
    UNUSED(vr); UNUSED(sizes); UNUSED(values); UNUSED(count);
    return n == 0 ? fmi3OK : failed(c, "no binaries");
}
FMI(fmi3SetBinary)(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const size_t sizes[],
                   const fmi3Binary values[], size_t count)
{
    UNUSED(vr); UNUSED(sizes); UNUSED(values); UNUSED(count);
    return n == 0 ? fmi3OK : failed(c, "no binaries");
}
FMI(fmi3GetClock)(fmi3Instance c, const fmi3ValueReference vr[], size_t n, bool values[])
{ UNUSED(vr); UNUSED(values); return n == 0 ? fmi3OK : failed(c, "no clocks"); }
FMI(fmi3SetClock)(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const bool values[])
{ UNUSED(vr); UNUSED(values); return n == 0 ? fmi3OK : failed(c, "no clocks"); }

FMI(fmi3GetNumberOfVariableDependencies)(fmi3Instance c, fmi3ValueReference vr, size_t *n)
{ UNUSED(vr); UNUSED(n); return failed(c, "no dependencies"); }
FMI(fmi3GetVariableDependencies)(fmi3Instance c, fmi3ValueReference vr, size_t elements[],
                                 fmi3ValueReference independents[], size_t others[],
                                 fmi3DependencyKind kinds[], size_t n)
{
    UNUSED(vr); UNUSED(elements); UNUSED(independents); UNUSED(others); UNUSED(kinds); UNUSED(n);
    return failed(c, "no dependencies");
}
FMI(fmi3GetDirectionalDerivative)(fmi3Instance c, const fmi3ValueReference unknowns[], size_t nu,
                                  const fmi3ValueReference knowns[], size_t nk,
                                  const double seed[], size_t ns, double sensitivity[], size_t n)
{
    UNUSED(unknowns); UNUSED(nu); UNUSED(knowns); UNUSED(nk);
    UNUSED(seed); UNUSED(ns); UNUSED(sensitivity); UNUSED(n);
    return failed(c, "no directional derivatives");
}
FMI(fmi3GetAdjointDerivative)(fmi3Instance c, const fmi3ValueReference unknowns[], size_t nu,
                              const fmi3ValueReference knowns[], size_t nk, const double seed[],
                              size_t ns, double sensitivity[], size_t n)
{
    UNUSED(unknowns); UNUSED(nu); UNUSED(knowns); UNUSED(nk);
    UNUSED(seed); UNUSED(ns); UNUSED(sensitivity); UNUSED(n);
    return failed(c, "no adjoint derivatives");
}

/* Clocks */

FMI(fmi3GetIntervalDecimal)(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                            double intervals[], fmi3IntervalQualifier qualifiers[])
{ UNUSED(vr); UNUSED(n); UNUSED(intervals); UNUSED(qualifiers); return failed(c, "no clocks"); }
FMI(fmi3GetIntervalFraction)(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                             uint64_t counters[], uint64_t resolutions[],
                             fmi3IntervalQualifier qualifiers[])
{
    UNUSED(vr); UNUSED(n); UNUSED(counters); UNUSED(resolutions); UNUSED(qualifiers);
    return failed(c, "no clocks");
}
FMI(fmi3GetShiftDecimal)(fmi3Instance c, const fmi3ValueReference vr[], size_t n, double shifts[])
{ UNUSED(vr); UNUSED(n); UNUSED(shifts); return failed(c, "no clocks"); }
FMI(fmi3GetShiftFraction)(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                          uint64_t counters[], uint64_t resolutions[])
{ UNUSED(vr); UNUSED(n); UNUSED(counters); UNUSED(resolutions); return failed(c, "no clocks"); }
FMI(fmi3SetIntervalDecimal)(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                            const double intervals[])
{ UNUSED(vr); UNUSED(n); UNUSED(intervals); return failed(c, "no clocks"); }
FMI(fmi3SetIntervalFraction)(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                             const uint64_t counters[], const uint64_t resolutions[])
{ UNUSED(vr); UNUSED(n); UNUSED(counters); UNUSED(resolutions); return failed(c, "no clocks"); }
FMI(fmi3SetShiftDecimal)(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                         const double shifts[])
{ UNUSED(vr); UNUSED(n); UNUSED(shifts); return failed(c, "no clocks"); }
FMI(fmi3SetShiftFraction)(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                          const uint64_t counters[], const uint64_t resolutions[])
{ UNUSED(vr); UNUSED(n); UNUSED(counters); UNUSED(resolutions); return failed(c, "no clocks"); }
FMI(fmi3ActivateModelPartition)(fmi3Instance c, fmi3ValueReference clock, double time)
{ UNUSED(clock); UNUSED(time); return failed(c, "no model partitions"); }

/* Saved states */

FMI(fmi3GetFMUState)(fmi3Instance c, fmi3FMUState *state)
{
    if (*state == NULL) *state = malloc(sizeof(Memory));
    if (*state == NULL) return failed(c, "out of memory");
    memcpy(*state, of(c), sizeof(Memory));
    return fmi3OK;
}
FMI(fmi3SetFMUState)(fmi3Instance c, fmi3FMUState state)
{ memcpy(of(c), state, sizeof(Memory)); attach(of(c)); return fmi3OK; }
FMI(fmi3FreeFMUState)(fmi3Instance c, fmi3FMUState *state)
{ UNUSED(c); free(*state); *state = NULL; return fmi3OK; }
FMI(fmi3SerializedFMUStateSize)(fmi3Instance c, fmi3FMUState state, size_t *size)
{ UNUSED(c); UNUSED(state); *size = sizeof(Memory); return fmi3OK; }
FMI(fmi3SerializeFMUState)(fmi3Instance c, fmi3FMUState state, uint8_t bytes[], size_t size)
{
    if (size != sizeof(Memory)) return failed(c, "a serialized state of another size");
    memcpy(bytes, state, size);
    return fmi3OK;
}
FMI(fmi3DeserializeFMUState)(fmi3Instance c, const uint8_t bytes[], size_t size,
                             fmi3FMUState *state)
{
    if (size != sizeof(Memory)) return failed(c, "a serialized state of another size");
    if (*state == NULL) *state = malloc(size);
    if (*state == NULL) return failed(c, "out of memory");
    memcpy(*state, bytes, size);
    return fmi3OK;
}

/* Events */

FMI(fmi3EvaluateDiscreteStates)(fmi3Instance c) { UNUSED(c); return fmi3OK; }

FMI(fmi3UpdateDiscreteStates)(fmi3Instance c, bool *again, bool *terminate, bool *nominals,
                              bool *states, bool *defined, double *time)
{
    Instance *instance = c;
    Memory *memory = of(c);
    int changed = 0;
    double next = INFINITY;
    if (instance->exchange) {
        if ((memory->in_event == 1 || memory->changed) && !memory->ended)
            changed = import_instant(memory);
        if (changed < 0) return run_failed(c);
        next = next_time_event(memory);
    }
    memory->in_event = 0;
    *again = false;
    *terminate = instance->exchange && memory->ended != 0;
    *nominals = false;
    *states = changed != 0;
    *defined = !isinf(next);
    *time = isinf(next) ? 0.0 : next;
    return fmi3OK;
}

/* Model exchange */

FMI(fmi3EnterContinuousTimeMode)(fmi3Instance c) { UNUSED(c); return fmi3OK; }

FMI(fmi3CompletedIntegratorStep)(fmi3Instance c, bool final, bool *enter, bool *terminate)
{
    UNUSED(final);
    *enter = import_step(of(c));
    *terminate = false;
    return fmi3OK;
}

FMI(fmi3SetTime)(fmi3Instance c, double time) { import_time(of(c), time); return fmi3OK; }

FMI(fmi3SetContinuousStates)(fmi3Instance c, const double x[], size_t n)
{
    if (n != STATES) return failed(c, "another number of states");
    import_states(of(c), x);
    return fmi3OK;
}
FMI(fmi3GetContinuousStateDerivatives)(fmi3Instance c, double derivatives[], size_t n)
{
    if (n != STATES) return failed(c, "another number of states");
    evaluate(of(c), derivatives, NULL);
    return fmi3OK;
}
FMI(fmi3GetEventIndicators)(fmi3Instance c, double indicators[], size_t n)
{
    if (n != INDICATORS) return failed(c, "another number of event indicators");
    event_indicators(of(c), indicators);
    return fmi3OK;
}
FMI(fmi3GetContinuousStates)(fmi3Instance c, double x[], size_t n)
{
    if (n != STATES) return failed(c, "another number of states");
    memcpy(x, of(c)->shown, n * sizeof(double));
    return fmi3OK;
}
FMI(fmi3GetNominalsOfContinuousStates)(fmi3Instance c, double nominals[], size_t n)
{
    if (n != STATES) return failed(c, "another number of states");
    memcpy(nominals, STATE_UNITS, n * sizeof(double));
    return fmi3OK;
}
FMI(fmi3GetNumberOfEventIndicators)(fmi3Instance c, size_t *n)
{ UNUSED(c); *n = INDICATORS; return fmi3OK; }
FMI(fmi3GetNumberOfContinuousStates)(fmi3Instance c, size_t *n)
{ UNUSED(c); *n = STATES; return fmi3OK; }

/* Co-simulation */

FMI(fmi3EnterStepMode)(fmi3Instance c) { UNUSED(c); return fmi3OK; }

FMI(fmi3GetOutputDerivatives)(fmi3Instance c, const fmi3ValueReference vr[], size_t n,
                              const int32_t orders[], double values[], size_t count)
{
    size_t i;
    UNUSED(count);
    for (i = 0; i < n; i++) {
        if (orders[i] != 1 || vr[i] < 1 || vr[i] > STATES)
            return failed(c, "derivatives of order 1, of states only");
        get_real(of(c), vr[i] + STATES, &values[i]);
    }
    return fmi3OK;
}

FMI(fmi3DoStep)(fmi3Instance c, double time, double step, bool keeps, bool *event, bool *terminate,
                bool *early, double *last)
{
    Instance *instance = c;
    Memory *memory = of(c);
    double until = time + step;
    int status = 0;
    UNUSED(keeps);
    if (!(step >= 0.0) || !isfinite(until)) return failed(c, "the step is not a length of time");
    if (!memory->ended || memory->read < memory->loop.events_written)
        status = advance(memory, until, instance->early);
    if (status < 0) return run_failed(c);
    *event = instance->events && status == 1;
    *terminate = memory->ended && memory->read == memory->loop.events_written
                 && loop_time(memory) * TIME_UNIT <= until;
    *early = memory->now < until;
    *last = memory->now;
    return fmi3OK;
}
