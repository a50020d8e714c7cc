/* The interface FMI 2.0 (standard of that name, version 2.0.4) around an instance. */

#include "instance.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Plain names, for a shared library; with -DFMI2_FUNCTION_PREFIX the model's before them, to link several units. */
#if defined FMI2_FUNCTION_PREFIX && !defined FMI2_OVERRIDE_FUNCTION_PREFIX
#define FMI(name) MODEL(fmi2##name)
#else
#define FMI(name) fmi2##name
#endif

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } status;
typedef enum { MODEL_EXCHANGE, CO_SIMULATION } purpose;
typedef enum { STEP_STATUS, PENDING_STATUS, LAST_TIME, TERMINATED } question;
typedef void (*logger)(void *, const char *, status, const char *, const char *, ...);

typedef struct {
    logger log;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*step_finished)(void *, status);
    void *environment;
} callbacks;

typedef struct {
    int more, terminate, nominals_changed, values_changed, next_defined;
    double next;
} events;

typedef struct {
    instance own;
    purpose kind;
    callbacks by;
    char name[128];
} component;

static status told(component *c, outcome what)
{
    const status how = what == DONE ? OK : what == ASTRAY || what == TOO_LONG ? DISCARD : ERROR;
    if (what != DONE && c->by.log != NULL) {
        c->by.log(c->by.environment, c->name, how, "logStatusError", "%s", MODEL(instance_words)(what));
    }
    return how;
}

static void *taken(const component *c, size_t size)
{
    return c->by.allocate != NULL ? c->by.allocate(1, size) : calloc(1, size);
}

static void given_back(const component *c, void *what)
{
    if (c->by.release != NULL) {
        c->by.release(what);
    } else if (c->by.allocate == NULL) {
        free(what);
    }
}

typedef char byte;
#define OF_STATE(verb, what) FMI(verb##FMUstate##what)
#define DESERIALIZE FMI(DeSerializeFMUstate)
#define RATES FMI(GetDerivatives)
#include "shared.h"

EXPORTED const char *FMI(GetTypesPlatform)(void)
{
    return "default";
}

EXPORTED const char *FMI(GetVersion)(void)
{
    return "2.0";
}

EXPORTED status FMI(SetDebugLogging)(void *c, int on, size_t count, const char *const categories[])
{
    (void)on;
    (void)count;
    (void)categories;
    return c != NULL ? OK : ERROR;
}

EXPORTED void *FMI(Instantiate)(const char *name, purpose kind, const char *guid, const char *resources,
    const callbacks *by, int visible, int logging)
{
    component head, *c;
    (void)resources;
    (void)visible;
    (void)logging;
    memset(&head, 0, sizeof head);
    if (guid == NULL || strcmp(guid, TOKEN) != 0 || (kind != CO_SIMULATION && !CONTINUOUS)) {
        return NULL;
    }
    if (by != NULL) {
        head.by = *by;
    }
    c = taken(&head, sizeof *c);
    if (c == NULL) {
        return NULL;
    }
    *c = head;
    c->kind = kind;
    strncpy(c->name, name != NULL ? name : "", sizeof c->name - 1);
    MODEL(instance_reset)(&c->own);
    return c;
}

EXPORTED void FMI(FreeInstance)(void *c)
{
    if (c != NULL) {
        const component head = *(component *)c;
        given_back(&head, c);
    }
}

EXPORTED status FMI(SetupExperiment)(void *c, int tolerant, double tolerance, double start, int ends, double stop)
{
    (void)tolerant;
    (void)tolerance;
    (void)ends;
    (void)stop;
    if (c == NULL || !isfinite(start)) {
        return ERROR;
    }
    ((component *)c)->own.time = start;
    return OK;
}

EXPORTED status FMI(EnterInitializationMode)(void *c)
{
    if (c == NULL || ((component *)c)->own.stage != MADE) {
        return ERROR;
    }
    ((component *)c)->own.stage = STARTING;
    return OK;
}

EXPORTED status FMI(GetReal)(void *c, const unsigned references[], size_t count, double values[])
{
    size_t k;
    for (k = 0; c != NULL && k < count; k++) {
        const outcome what = MODEL(instance_get)(&((component *)c)->own, references[k], &values[k]);
        if (what != DONE) {
            return told(c, what);
        }
    }
    return c != NULL ? OK : ERROR;
}

EXPORTED status FMI(SetReal)(void *c, const unsigned references[], size_t count, const double values[])
{
    size_t k;
    for (k = 0; c != NULL && k < count; k++) {
        const outcome what = MODEL(instance_set)(&((component *)c)->own, references[k], values[k]);
        if (what != DONE) {
            return told(c, what);
        }
    }
    return c != NULL ? OK : ERROR;
}

/* There are no variables but real ones. */
#define NONE_OF(name, type) \
    EXPORTED status FMI(name)(void *c, const unsigned references[], size_t count, type values[]) \
    { \
        (void)references; \
        (void)values; \
        return c != NULL && count == 0 ? OK : ERROR; \
    }
NONE_OF(GetInteger, int)
NONE_OF(GetBoolean, int)
NONE_OF(GetString, const char *)
NONE_OF(SetInteger, const int)
NONE_OF(SetBoolean, const int)
NONE_OF(SetString, const char *const)

EXPORTED status FMI(GetDirectionalDerivative)(void *c, const unsigned unknown[], size_t unknowns,
    const unsigned known[], size_t count, const double by[], double slopes[])
{
    size_t k;
    for (k = 0; c != NULL && k < unknowns; k++) {
        const outcome what = MODEL(instance_slope)(&((component *)c)->own, unknown[k], known, count, by, &slopes[k]);
        if (what != DONE) {
            return told(c, what);
        }
    }
    return c != NULL ? OK : ERROR;
}

/* Co-simulation */

EXPORTED status FMI(SetRealInputDerivatives)(
    void *c, const unsigned references[], size_t count, const int order[], const double values[])
{
    (void)references;
    (void)order;
    (void)values;
    return c != NULL && count == 0 ? OK : ERROR;
}

EXPORTED status FMI(GetRealOutputDerivatives)(
    void *c, const unsigned references[], size_t count, const int order[], double values[])
{
    (void)references;
    (void)order;
    (void)values;
    return c != NULL && count == 0 ? OK : ERROR;
}

EXPORTED status FMI(DoStep)(void *c, double time, double length, int final)
{
    (void)final;
    if (c == NULL || ((component *)c)->own.stage != RUNNING || ((component *)c)->kind != CO_SIMULATION) {
        return ERROR;
    }
    return told(c, MODEL(instance_advance)(&((component *)c)->own, time, length));
}

EXPORTED status FMI(CancelStep)(void *c)
{
    (void)c;
    return ERROR;
}

EXPORTED status FMI(GetStatus)(void *c, question what, status *value)
{
    (void)c;
    (void)what;
    (void)value;
    return DISCARD;
}

EXPORTED status FMI(GetRealStatus)(void *c, question what, double *value)
{
    if (c == NULL || what != LAST_TIME) {
        return DISCARD;
    }
    *value = ((component *)c)->own.time;
    return OK;
}

EXPORTED status FMI(GetIntegerStatus)(void *c, question what, int *value)
{
    (void)c;
    (void)what;
    (void)value;
    return DISCARD;
}

EXPORTED status FMI(GetBooleanStatus)(void *c, question what, int *value)
{
    if (c == NULL || what != TERMINATED) {
        return DISCARD;
    }
    *value = 0;
    return OK;
}

EXPORTED status FMI(GetStringStatus)(void *c, question what, const char **value)
{
    (void)c;
    (void)what;
    (void)value;
    return DISCARD;
}

/* Model exchange */

EXPORTED status FMI(NewDiscreteStates)(void *c, events *found)
{
    memset(found, 0, sizeof *found);
    return c != NULL ? OK : ERROR;
}

EXPORTED status FMI(CompletedIntegratorStep)(void *c, int final, int *enter_event_mode, int *terminate)
{
    (void)final;
    *enter_event_mode = *terminate = 0;
    return c != NULL ? OK : ERROR;
}
