/* The interface FMI 3.0 (standard of that name, version 3.0.2) around an instance. */

#include "instance.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

/* Plain names, for a shared library; with -DFMI3_FUNCTION_PREFIX the model's before them, to link several units. */
#if defined FMI3_FUNCTION_PREFIX && !defined FMI3_OVERRIDE_FUNCTION_PREFIX
#define FMI(name) MODEL(fmi3##name)
#else
#define FMI(name) fmi3##name
#endif

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL } status;
typedef uint32_t reference;
typedef void (*logger)(void *, status, const char *, const char *);

typedef struct {
    instance own;
    bool steps; /* co-simulation; else the integrator is the importer's */
    logger log;
    void *environment;
} component;

static status told(component *c, outcome what)
{
    const status how = what == DONE ? OK : what == ASTRAY || what == TOO_LONG ? DISCARD : ERROR;
    if (what != DONE && c->log != NULL) {
        c->log(c->environment, how, "logStatusError", MODEL(instance_words)(what));
    }
    return how;
}

static void *taken(const component *c, size_t size)
{
    (void)c;
    return calloc(1, size);
}

static void given_back(const component *c, void *what)
{
    (void)c;
    free(what);
}

typedef uint8_t byte;
#define OF_STATE(verb, what) FMI(verb##FMUState##what)
#define DESERIALIZE FMI(DeserializeFMUState)
#define RATES FMI(GetContinuousStateDerivatives)
#include "shared.h"

static component *made(const char *token, bool steps, void *environment, logger log)
{
    component *c;
    if (token == NULL || strcmp(token, TOKEN) != 0 || (!steps && !CONTINUOUS)) {
        return NULL;
    }
    c = calloc(1, sizeof *c);
    if (c != NULL) {
        c->steps = steps;
        c->log = log;
        c->environment = environment;
        MODEL(instance_reset)(&c->own);
    }
    return c;
}

EXPORTED const char *FMI(GetVersion)(void)
{
    return "3.0";
}

EXPORTED status FMI(SetDebugLogging)(void *c, bool on, size_t count, const char *const categories[])
{
    (void)on;
    (void)count;
    (void)categories;
    return c != NULL ? OK : ERROR;
}

EXPORTED void *FMI(InstantiateModelExchange)(const char *name, const char *token, const char *resources, bool visible,
    bool logging, void *environment, logger log)
{
    (void)name;
    (void)resources;
    (void)visible;
    (void)logging;
    return made(token, false, environment, log);
}

EXPORTED void *FMI(InstantiateCoSimulation)(const char *name, const char *token, const char *resources, bool visible,
    bool logging, bool event_mode, bool early_return, const reference intermediate[], size_t count, void *environment,
    logger log, void (*update)(void))
{
    (void)name;
    (void)resources;
    (void)visible;
    (void)logging;
    (void)event_mode;
    (void)early_return;
    (void)intermediate;
    (void)update;
    return count == 0 ? made(token, true, environment, log) : NULL;
}

EXPORTED void *FMI(InstantiateScheduledExecution)(const char *name, const char *token, const char *resources,
    bool visible, bool logging, void *environment, logger log, void (*update)(void), void (*lock)(void),
    void (*unlock)(void))
{
    (void)name;
    (void)token;
    (void)resources;
    (void)visible;
    (void)logging;
    (void)environment;
    (void)log;
    (void)update;
    (void)lock;
    (void)unlock;
    return NULL;
}

EXPORTED void FMI(FreeInstance)(void *c)
{
    free(c);
}

EXPORTED status FMI(EnterInitializationMode)(
    void *c, bool tolerant, double tolerance, double start, bool ends, double stop)
{
    (void)tolerant;
    (void)tolerance;
    (void)ends;
    (void)stop;
    if (c == NULL || ((component *)c)->own.stage != MADE || !isfinite(start)) {
        return ERROR;
    }
    ((component *)c)->own.stage = STARTING;
    ((component *)c)->own.time = start;
    return OK;
}

EXPORTED status FMI(GetFloat64)(void *c, const reference references[], size_t count, double values[], size_t size)
{
    size_t k;
    for (k = 0; c != NULL && k < count && k < size; k++) {
        const outcome what = MODEL(instance_get)(&((component *)c)->own, references[k], &values[k]);
        if (what != DONE) {
            return told(c, what);
        }
    }
    return c != NULL && count == size ? OK : ERROR;
}

EXPORTED status FMI(SetFloat64)(
    void *c, const reference references[], size_t count, const double values[], size_t size)
{
    size_t k;
    for (k = 0; c != NULL && k < count && k < size; k++) {
        const outcome what = MODEL(instance_set)(&((component *)c)->own, references[k], values[k]);
        if (what != DONE) {
            return told(c, what);
        }
    }
    return c != NULL && count == size ? OK : ERROR;
}

/* There are no variables of other types. */
#define NONE_OF(name, type) \
    EXPORTED status FMI(Get##name)(void *c, const reference references[], size_t count, type values[], size_t size) \
    { \
        (void)references; \
        (void)values; \
        (void)size; \
        return c != NULL && count == 0 ? OK : ERROR; \
    } \
    EXPORTED status FMI(Set##name)( \
        void *c, const reference references[], size_t count, const type values[], size_t size) \
    { \
        (void)references; \
        (void)values; \
        (void)size; \
        return c != NULL && count == 0 ? OK : ERROR; \
    }
typedef const char *text;
NONE_OF(Float32, float)
NONE_OF(Int8, int8_t)
NONE_OF(UInt8, uint8_t)
NONE_OF(Int16, int16_t)
NONE_OF(UInt16, uint16_t)
NONE_OF(Int32, int32_t)
NONE_OF(UInt32, uint32_t)
NONE_OF(Int64, int64_t)
NONE_OF(UInt64, uint64_t)
NONE_OF(Boolean, bool)
NONE_OF(String, text)

/* What there is nothing of here: clocks, binary values, a mode for structure, partitions. */
#define NOTHING(name, ...) \
    EXPORTED status FMI(name)(void *c, __VA_ARGS__) \
    { \
        (void)c; \
        return ERROR; \
    }
#if defined __GNUC__
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif
NOTHING(GetBinary, const reference references[], size_t n, size_t sizes[], const uint8_t *values[], size_t size)
NOTHING(SetBinary, const reference references[], size_t n, const size_t sizes[], const uint8_t *const values[],
    size_t size)
NOTHING(GetClock, const reference references[], size_t n, bool values[])
NOTHING(SetClock, const reference references[], size_t n, const bool values[])
NOTHING(GetNumberOfVariableDependencies, reference dependent, size_t *n)
NOTHING(GetVariableDependencies, reference dependent, size_t elements[], reference independents[], size_t others[],
    int kinds[], size_t n)
NOTHING(GetAdjointDerivative, const reference unknown[], size_t n, const reference known[], size_t m,
    const double seed[], size_t seeds, double slopes[], size_t size)
NOTHING(GetIntervalDecimal, const reference references[], size_t n, double intervals[], int qualifiers[])
NOTHING(GetIntervalFraction, const reference references[], size_t n, uint64_t counters[], uint64_t resolutions[],
    int qualifiers[])
NOTHING(GetShiftDecimal, const reference references[], size_t n, double shifts[])
NOTHING(GetShiftFraction, const reference references[], size_t n, uint64_t counters[], uint64_t resolutions[])
NOTHING(SetIntervalDecimal, const reference references[], size_t n, const double intervals[])
NOTHING(SetIntervalFraction, const reference references[], size_t n, const uint64_t counters[],
    const uint64_t resolutions[])
NOTHING(SetShiftDecimal, const reference references[], size_t n, const double shifts[])
NOTHING(SetShiftFraction, const reference references[], size_t n, const uint64_t counters[],
    const uint64_t resolutions[])
NOTHING(GetOutputDerivatives, const reference references[], size_t n, const int32_t orders[], double values[],
    size_t size)
NOTHING(ActivateModelPartition, reference clock, double time)
#if defined __GNUC__
#pragma GCC diagnostic pop
#endif

EXPORTED status FMI(EnterConfigurationMode)(void *c)
{
    (void)c;
    return ERROR;
}

EXPORTED status FMI(ExitConfigurationMode)(void *c)
{
    (void)c;
    return ERROR;
}

EXPORTED status FMI(EvaluateDiscreteStates)(void *c)
{
    return c != NULL ? OK : ERROR;
}

EXPORTED status FMI(EnterStepMode)(void *c)
{
    return c != NULL ? OK : ERROR;
}

EXPORTED status FMI(UpdateDiscreteStates)(void *c, bool *more, bool *terminate, bool *nominals_changed,
    bool *values_changed, bool *next_defined, double *next)
{
    *more = *terminate = *nominals_changed = *values_changed = *next_defined = false;
    *next = 0.0;
    return c != NULL ? OK : ERROR;
}

EXPORTED status FMI(GetDirectionalDerivative)(void *c, const reference unknown[], size_t unknowns,
    const reference known[], size_t count, const double seed[], size_t seeds, double slopes[], size_t size)
{
    size_t k;
    if (c == NULL || seeds != count || size != unknowns) {
        return ERROR;
    }
    for (k = 0; k < unknowns; k++) {
        const outcome what =
            MODEL(instance_slope)(&((component *)c)->own, unknown[k], known, count, seed, &slopes[k]);
        if (what != DONE) {
            return told(c, what);
        }
    }
    return OK;
}

EXPORTED status FMI(DoStep)(void *c, double time, double length, bool final, bool *event, bool *terminate, bool *early,
    double *last)
{
    component *const own = c;
    outcome what;
    (void)final;
    *event = *terminate = *early = false;
    if (own == NULL || own->own.stage != RUNNING || !own->steps) {
        return ERROR;
    }
    what = MODEL(instance_advance)(&own->own, time, length);
    *last = own->own.time;
    return told(own, what);
}

/* Model exchange */

EXPORTED status FMI(CompletedIntegratorStep)(void *c, bool final, bool *enter_event_mode, bool *terminate)
{
    (void)final;
    *enter_event_mode = *terminate = false;
    return c != NULL ? OK : ERROR;
}

EXPORTED status FMI(GetNumberOfEventIndicators)(void *c, size_t *count)
{
    *count = 0;
    return c != NULL ? OK : ERROR;
}

EXPORTED status FMI(GetNumberOfContinuousStates)(void *c, size_t *count)
{
    *count = CONTINUOUS ? NX : 0;
    return c != NULL ? OK : ERROR;
}
