/* A vehicle as an FMU has it: one struct that holds everything, and what may be asked of it. */

#ifndef INSTANCE_H
#define INSTANCE_H

#include "model.h"

#include <stddef.h>

/* Value references: what a variable is, and its place there. */
enum { REFERENCES = 1000 };
enum { TIME, INPUT, OUTPUT, STATE, RATE, PARAMETER, SETTING };

enum { MADE, STARTING, RUNNING, OVER };

/* What came of a request. */
typedef enum { DONE, UNKNOWN, NO_NUMBER, WRONG_TIME, TOO_LONG, ASTRAY, FORGOTTEN } outcome;

#if LATE
typedef struct {
    double time;
    double x[NX];
    double u[NU + 1];
} moment;
#endif

/* Everything a vehicle knows; a copy of it is a copy of the vehicle. */
typedef struct {
    double time;
    double x[NX];
    double u[NU + 1];
    double p[NP + 1];
    double longest_step;
    int stage;
    unsigned char given[NX]; /* whether a state was set by who starts it */
#if DELAYED
    MODEL(commands) line;
#endif
#if LATE
    moment past[PAST]; /* the beginnings of segments, for readings that are late */
    size_t passed;
#endif
} instance;

void MODEL(instance_reset)(instance *own);
outcome MODEL(instance_set)(instance *own, unsigned reference, double value);
outcome MODEL(instance_get)(instance *own, unsigned reference, double *value);
void MODEL(instance_run)(instance *own); /* the start is over */
outcome MODEL(instance_advance)(instance *own, double time, double length);
/* how outputs and rates move with inputs and states: sensitivity[j] = d unknown / d known[j], summed over known */
outcome MODEL(instance_slope)(
    instance *own, unsigned unknown, const unsigned *known, size_t count, const double *by, double *slope);
const char *MODEL(instance_words)(outcome what);

#if defined _WIN32
#define EXPORTED __declspec(dllexport)
#elif defined __GNUC__
#define EXPORTED __attribute__((visibility("default")))
#else
#define EXPORTED
#endif

#endif
