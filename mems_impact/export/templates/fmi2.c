/* FMI 2.0 interface of an exported model, for model exchange and co-simulation. */

#include <stdarg.h>
#include <stddef.h>
#include "arithmetic.h"
#include "model.h"
#include "runtime.h"

/* Types of the standard */

typedef void *fmi2Component, *fmi2ComponentEnvironment, *fmi2FMUstate;
typedef unsigned int fmi2ValueReference;
typedef double fmi2Real;
typedef int fmi2Integer, fmi2Boolean;
typedef const char *fmi2String;
typedef char fmi2Byte;
typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated }
    fmi2StatusKind;
typedef struct {
    void (*logger)(fmi2ComponentEnvironment, fmi2String, fmi2Status, fmi2String, fmi2String, ...);
    void *(*allocateMemory)(size_t, size_t);
    void (*freeMemory)(void *);
    void (*stepFinished)(fmi2ComponentEnvironment, fmi2Status);
    fmi2ComponentEnvironment componentEnvironment;
} fmi2CallbackFunctions;
typedef struct {
    fmi2Boolean newDiscreteStatesNeeded, terminateSimulation, nominalsOfContinuousStatesChanged,
        valuesOfContinuousStatesChanged, nextEventTimeDefined;
    fmi2Real nextEventTime;
} fmi2EventInfo;

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#elif defined(__GNUC__)
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif
#ifdef FMI2_FUNCTION_PREFIX
#define JOINED(a, b) a##b
#define JOIN(a, b) JOINED(a, b)
#define NAME(name) JOIN(FMI2_FUNCTION_PREFIX, name)
#else
#define NAME(name) name
#endif
#define FMI(name) EXPORT fmi2Status NAME(name)
#define UNUSED(x) (void)(x)

/* Instances */

typedef struct {
    Memory memory;
    fmi2Type type;
    fmi2CallbackFunctions functions;
    char name[128];
} Instance;

static Memory *of(fmi2Component component) { return &((Instance *)component)->memory; }

static fmi2Status failed(fmi2Component component, const char *message)
{
    Instance *instance = component;
    if (instance->functions.logger != NULL)
        instance->functions.logger(instance->functions.componentEnvironment, instance->name,
                                   fmi2Error, "logStatusError", "%s", message);
    return fmi2Error;
}

static fmi2Status run_failed(fmi2Component component)
{
    char text[256];
    return failed(component, explain(of(component), text, sizeof text));
}

EXPORT const char *NAME(fmi2GetTypesPlatform)(void) { return "default"; }
EXPORT const char *NAME(fmi2GetVersion)(void) { return "2.0"; }

FMI(fmi2SetDebugLogging)(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{ UNUSED(c); UNUSED(on); UNUSED(n); UNUSED(categories); return fmi2OK; }

EXPORT fmi2Component NAME(fmi2Instantiate)(
    fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
    const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    Instance *instance;
    UNUSED(resources); UNUSED(visible); UNUSED(logging);
    if (guid == NULL || strcmp(guid, TOKEN) != 0) return NULL;
    instance = calloc(1, sizeof *instance);
    if (instance == NULL) return NULL;
    instance->type = type;
    if (functions != NULL) instance->functions = *functions;
    snprintf(instance->name, sizeof instance->name, "%s", name == NULL ? "" : name);
    set_up(&instance->memory);
    return instance;
}

EXPORT void NAME(fmi2FreeInstance)(fmi2Component c) { free(c); }

FMI(fmi2SetupExperiment)(fmi2Component c, fmi2Boolean defined, fmi2Real tolerance, fmi2Real start,
                         fmi2Boolean stops, fmi2Real stop)
{
    Instance *instance = c;
    UNUSED(stops); UNUSED(stop);
    of(c)->now = of(c)->origin = start;
    if (defined && tolerance > 0.0 && instance->type == fmi2ModelExchange) {
        of(c)->loop.rtol = tolerance;
        of(c)->loop.atol = 1e-2 * tolerance;
    }
    return fmi2OK;
}

FMI(fmi2EnterInitializationMode)(fmi2Component c) { UNUSED(c); return fmi2OK; }

FMI(fmi2ExitInitializationMode)(fmi2Component c)
{
    char text[256];
    Instance *instance = c;
    int exchange = instance->type == fmi2ModelExchange;
    if (contradiction(of(c), text, sizeof text) != NULL) return failed(c, text);
    if (!is_good(begin_run(of(c), exchange))) return run_failed(c);
    of(c)->changed = 0;
    if (!exchange && advance(of(c), of(c)->now, 0) < 0) return run_failed(c);
    return fmi2OK;
}

FMI(fmi2Terminate)(fmi2Component c) { UNUSED(c); return fmi2OK; }
FMI(fmi2Reset)(fmi2Component c) { set_up(of(c)); return fmi2OK; }

/* Values */

FMI(fmi2GetReal)(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[])
{
    size_t i;
    for (i = 0; i < n; i++)
        if (!get_real(of(c), vr[i], &value[i])) return failed(c, "no such real variable");
    return fmi2OK;
}

FMI(fmi2SetReal)(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[])
{
    char text[256];
    size_t i;
    for (i = 0; i < n; i++) {
        const char *refusal = set_real(of(c), vr[i], value[i], text, sizeof text);
        if (refusal != NULL) return failed(c, refusal);
    }
    return fmi2OK;
}

FMI(fmi2GetInteger)(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Integer value[])
{
    size_t i;
    int64_t number;
    for (i = 0; i < n; i++) {
        if (!get_integer(of(c), vr[i], &number)) return failed(c, "no such integer variable");
        value[i] = (fmi2Integer)number;
    }
    return fmi2OK;
}

FMI(fmi2SetInteger)(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                    const fmi2Integer value[])
{
    size_t i;
    for (i = 0; i < n; i++)
        if (!set_integer(of(c), vr[i], value[i]))
            return failed(c, "this variable cannot be set now, or has no such value");
    return fmi2OK;
}

FMI(fmi2GetBoolean)(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Boolean value[])
{ UNUSED(vr); UNUSED(value); return n == 0 ? fmi2OK : failed(c, "no boolean variables"); }
FMI(fmi2SetBoolean)(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                    const fmi2Boolean value[])
{ UNUSED(vr); UNUSED(value); return n == 0 ? fmi2OK : failed(c, "no boolean variables"); }
FMI(fmi2GetString)(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[])
{ UNUSED(vr); UNUSED(value); return n == 0 ? fmi2OK : failed(c, "no string variables"); }
FMI(fmi2SetString)(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                   const fmi2String value[])
{ UNUSED(vr); UNUSED(value); return n == 0 ? fmi2OK : failed(c, "no string variables"); }

/* Saved states */

FMI(fmi2GetFMUstate)(fmi2Component c, fmi2FMUstate *state)
{
    if (*state == NULL) *state = malloc(sizeof(Memory));
    if (*state == NULL) return failed(c, "out of memory");
    memcpy(*state, of(c), sizeof(Memory));
    return fmi2OK;
}
FMI(fmi2SetFMUstate)(fmi2Component c, fmi2FMUstate state)
{ memcpy(of(c), state, sizeof(Memory)); attach(of(c)); return fmi2OK; }
FMI(fmi2FreeFMUstate)(fmi2Component c, fmi2FMUstate *state)
{ UNUSED(c); free(*state); *state = NULL; return fmi2OK; }
FMI(fmi2SerializedFMUstateSize)(fmi2Component c, fmi2FMUstate state, size_t *size)
{ UNUSED(c); UNUSED(state); *size = sizeof(Memory); return fmi2OK; }
FMI(fmi2SerializeFMUstate)(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    if (size != sizeof(Memory)) return failed(c, "a serialized state of another size");
    memcpy(bytes, state, size);
    return fmi2OK;
}
FMI(fmi2DeSerializeFMUstate)(fmi2Component c, const fmi2Byte bytes[], size_t size,
                             fmi2FMUstate *state)
{
    if (size != sizeof(Memory)) return failed(c, "a serialized state of another size");
    if (*state == NULL) *state = malloc(size);
    if (*state == NULL) return failed(c, "out of memory");
    memcpy(*state, bytes, size);
    return fmi2OK;
}
FMI(fmi2GetDirectionalDerivative)(fmi2Component c, const fmi2ValueReference z[], size_t nz,
                                  const fmi2ValueReference v[], size_t nv, const fmi2Real dv[],
                                  fmi2Real dz[])
{
    UNUSED(z); UNUSED(nz); UNUSED(v); UNUSED(nv); UNUSED(dv); UNUSED(dz);
    return failed(c, "no directional derivatives");
}

/* Model exchange */

FMI(fmi2EnterEventMode)(fmi2Component c) { of(c)->in_event = 1; return fmi2OK; }

FMI(fmi2NewDiscreteStates)(fmi2Component c, fmi2EventInfo *info)
{
    Memory *memory = of(c);
    int changed = 0;
    double next;
    if ((memory->in_event == 1 || memory->changed) && !memory->ended) changed = import_instant(memory);
    if (changed < 0) return run_failed(c);
    memory->in_event = 0;
    next = next_time_event(memory);
    info->newDiscreteStatesNeeded = 0;
    info->terminateSimulation = (fmi2Boolean)memory->ended;
    info->nominalsOfContinuousStatesChanged = 0;
    info->valuesOfContinuousStatesChanged = changed;
    info->nextEventTimeDefined = !isinf(next);
    info->nextEventTime = isinf(next) ? 0.0 : next;
    return fmi2OK;
}

FMI(fmi2EnterContinuousTimeMode)(fmi2Component c) { UNUSED(c); return fmi2OK; }

FMI(fmi2CompletedIntegratorStep)(fmi2Component c, fmi2Boolean final, fmi2Boolean *enter,
                                 fmi2Boolean *terminate)
{
    UNUSED(final);
    *enter = (fmi2Boolean)import_step(of(c));
    *terminate = 0;
    return fmi2OK;
}

FMI(fmi2SetTime)(fmi2Component c, fmi2Real time) { import_time(of(c), time); return fmi2OK; }

FMI(fmi2SetContinuousStates)(fmi2Component c, const fmi2Real x[], size_t n)
{
    if (n != STATES) return failed(c, "another number of states");
    import_states(of(c), x);
    return fmi2OK;
}
FMI(fmi2GetDerivatives)(fmi2Component c, fmi2Real derivatives[], size_t n)
{
    if (n != STATES) return failed(c, "another number of states");
    evaluate(of(c), derivatives, NULL);
    return fmi2OK;
}
FMI(fmi2GetEventIndicators)(fmi2Component c, fmi2Real indicators[], size_t n)
{
    if (n != INDICATORS) return failed(c, "another number of event indicators");
    event_indicators(of(c), indicators);
    return fmi2OK;
}
FMI(fmi2GetContinuousStates)(fmi2Component c, fmi2Real x[], size_t n)
{
    if (n != STATES) return failed(c, "another number of states");
    memcpy(x, of(c)->shown, n * sizeof(double));
    return fmi2OK;
}
FMI(fmi2GetNominalsOfContinuousStates)(fmi2Component c, fmi2Real nominals[], size_t n)
{
    if (n != STATES) return failed(c, "another number of states");
    memcpy(nominals, STATE_UNITS, n * sizeof(double));
    return fmi2OK;
}

/* Co-simulation */

FMI(fmi2SetRealInputDerivatives)(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                 const fmi2Integer order[], const fmi2Real value[])
{ UNUSED(vr); UNUSED(n); UNUSED(order); UNUSED(value); return failed(c, "inputs are held"); }
FMI(fmi2GetRealOutputDerivatives)(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                  const fmi2Integer order[], fmi2Real value[])
{
    size_t i;
    for (i = 0; i < n; i++) {
        if (order[i] != 1 || vr[i] < 1 || vr[i] > STATES)
            return failed(c, "derivatives of order 1, of states only");
        get_real(of(c), vr[i] + STATES, &value[i]);
    }
    return fmi2OK;
}
FMI(fmi2DoStep)(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean keeps)
{
    UNUSED(keeps);
    if (!(step >= 0.0) || !isfinite(time + step))
        return failed(c, "the step is not a length of time");
    if (of(c)->ended && of(c)->read == of(c)->loop.events_written) return fmi2Discard;
    if (advance(of(c), time + step, 0) < 0) return run_failed(c);
    return of(c)->ended && loop_time(of(c)) * TIME_UNIT <= of(c)->now ? fmi2Discard : fmi2OK;
}
FMI(fmi2CancelStep)(fmi2Component c) { return failed(c, "no asynchronous steps"); }
FMI(fmi2GetStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{ UNUSED(c); UNUSED(kind); *value = fmi2OK; return fmi2OK; }
FMI(fmi2GetRealStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    if (kind != fmi2LastSuccessfulTime) return failed(c, "no such status");
    *value = of(c)->now;
    return fmi2OK;
}
FMI(fmi2GetIntegerStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{ UNUSED(kind); UNUSED(value); return failed(c, "no such status"); }
FMI(fmi2GetBooleanStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    if (kind != fmi2Terminated) return failed(c, "no such status");
    *value = (fmi2Boolean)of(c)->ended;
    return fmi2OK;
}
FMI(fmi2GetStringStatus)(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{ UNUSED(kind); UNUSED(value); return failed(c, "no such status"); }
