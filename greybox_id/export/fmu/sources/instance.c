/* A vehicle as an FMU has it. No heap here; loops end whatever they are given. */

#include "instance.h"

#include <math.h>
#include <string.h>

#define AT_ONCE 1e-9   /* instants, s, that are one */
#define MOST_STEPS 1e6 /* of the Runge-Kutta method in one communication step */

static const double start_x[NX] = START_X;
static const double start_u[NU + 1] = START_U;
#if DELAYED
static const int delay_of[NU + 1] = DELAY_OF; /* the place of an input's delay; -1: none */
#endif
#if LATE
static const int latency_of[NY + 1] = LATENCY_OF; /* the place of an output's latency; -1: none */
#endif

void MODEL(instance_reset)(instance *own)
{
    memset(own, 0, sizeof *own);
    memcpy(own->x, start_x, sizeof own->x);
    memcpy(own->u, start_u, sizeof own->u);
    memcpy(own->p, MODEL(default_parameters), NP * sizeof *own->p);
    own->longest_step = LONGEST_STEP;
    own->stage = MADE;
#if DELAYED
    MODEL(commands_start)(&own->line, own->u);
#endif
}

/* What was not given settles: actuators at their commands, relaxed quantities where they come to rest. */
static void settle(instance *own)
{
#if SETTLES
    double settled[NX];
    int k;
    MODEL(settled)(own->x, own->u, own->p, settled);
    for (k = MOVING; k < NX; k++) {
        if (!own->given[k]) {
            own->x[k] = settled[k];
        }
    }
#endif
#if DELAYED
    MODEL(commands_start)(&own->line, own->u);
#endif
    (void)own;
}

void MODEL(instance_run)(instance *own)
{
    settle(own);
    own->stage = RUNNING;
}

/* the inputs as they act now, those just set among them */
static outcome acting(const instance *own, double *u)
{
    memcpy(u, own->u, sizeof own->u);
#if DELAYED
    {
        double before[NU + 1], late[DELAYED], on;
        int k;
        const int found = MODEL(commands_until)(&own->line, own->p, own->time + AT_ONCE, before, &on);
        MODEL(delays)(own->p, late);
        for (k = 0; k < NU; k++) {
            if (delay_of[k] >= 0 && late[delay_of[k]] > AT_ONCE) {
                u[k] = before[k];
            }
        }
        return found == 0 ? DONE : FORGOTTEN;
    }
#else
    return DONE;
#endif
}

/* what sensors read at the beginning of a segment, so many seconds ago */
#if LATE
static outcome read_late(const instance *own, double ago, double *y)
{
    const double instant = own->time - ago;
    const size_t held = own->passed < PAST ? own->passed : PAST;
    size_t back = 0;
    const moment *then;
    double x[NX];
    while (back + 1 < held && own->past[(own->passed - 1 - back) % PAST].time > instant + AT_ONCE) {
        back++;
    }
    then = &own->past[(own->passed - 1 - back) % PAST];
    memcpy(x, then->x, sizeof x);
    if (instant - then->time > AT_ONCE) {
        MODEL(step)(x, then->u, own->p, instant - then->time, x);
    }
    MODEL(output)(x, then->u, own->p, y);
    return then->time > instant + AT_ONCE && own->passed > PAST ? FORGOTTEN : DONE;
}
#endif

static outcome output(const instance *own, int place, double *value)
{
    double u[NU + 1], y[NY + 1];
    outcome found;
#if LATE
    if (own->passed > 0 && latency_of[place] >= 0) {
        double late[LATE];
        MODEL(latencies)(own->p, late);
        if (late[latency_of[place]] > AT_ONCE) {
            found = read_late(own, late[latency_of[place]], y);
            *value = y[place];
            return found;
        }
    }
#endif
    found = acting(own, u);
    MODEL(output)(own->x, u, own->p, y);
    *value = y[place];
    return found;
}

outcome MODEL(instance_set)(instance *own, unsigned reference, double value)
{
    const unsigned kind = reference / REFERENCES, place = reference % REFERENCES;
    if (value != value) {
        return NO_NUMBER;
    }
    if (kind == INPUT && place < NU) {
        own->u[place] = value;
    } else if (kind == STATE && place < NX) {
        own->x[place] = value;
        own->given[place] = 1;
    } else if (kind == PARAMETER && place < NP) {
        own->p[place] = value;
    } else if (kind == SETTING && place == 0) {
        if (!(value > 0.0)) {
            return NO_NUMBER;
        }
        own->longest_step = value;
    } else {
        return UNKNOWN;
    }
    return DONE;
}

outcome MODEL(instance_get)(instance *own, unsigned reference, double *value)
{
    const unsigned kind = reference / REFERENCES, place = reference % REFERENCES;
    if (own->stage <= STARTING) {
        settle(own);
    }
    if (kind == TIME && place == 0) {
        *value = own->time;
    } else if (kind == INPUT && place < NU) {
        *value = own->u[place];
    } else if (kind == OUTPUT && place < NY) {
        return output(own, (int)place, value);
    } else if (kind == STATE && place < NX) {
        *value = own->x[place];
#if CONTINUOUS
    } else if (kind == RATE && place < NX) {
        double rates[NX];
        MODEL(ode)(own->x, own->u, own->p, rates);
        *value = rates[place];
#endif
    } else if (kind == PARAMETER && place < NP) {
        *value = own->p[place];
    } else if (kind == SETTING && place == 0) {
        *value = own->longest_step;
    } else {
        return UNKNOWN;
    }
    return DONE;
}

/* the longest step, s, at which the method is stable here */
static double stable(const instance *own, const double *x, const double *u)
{
#if SPEED_IS_STATE
    const double speed = fabs(x[SPEED]);
    (void)u;
#elif SPEED_IS_INPUT
    const double speed = fabs(u[SPEED]);
    (void)x;
#else
    const double speed = SLOWEST;
    (void)x;
    (void)u;
#endif
    const double step = STABLE / (STIFF + STIFF_BY_SPEED / (speed > SLOWEST ? speed : SLOWEST));
    return step < own->longest_step ? step : own->longest_step;
}

#if LATE
/* how long until something is read, if steps go on as long as this one; h where nothing is before */
static double until_read(const instance *own, double now, double end, double length, double soon, double h)
{
    double late[LATE];
    int k;
    MODEL(latencies)(own->p, late);
    for (k = 0; k < LATE; k++) {
        const double first = end - late[k];
        const double more = ceil((now + soon - first) / length);
        const double on = first + (more > 0.0 ? more : 0.0) * length - now;
        if (on > soon && on < h) {
            h = on;
        }
    }
    return h;
}
#endif

/* one communication step on x, beginning at own->time as the caller has it; own is as it was but for what it remembers */
static outcome advanced(instance *own, double time, double length, double *x)
{
    const double end = time + length, soon = 1e-9 * length; /* cuts a billionth of a step apart are one */
    double u[NU + 1], now = time, steps = 0.0;
    int k;
#if DELAYED
    if (MODEL(commands_push)(&own->line, time, own->u) != 0) { /* a step that is taken again */
        memcpy(own->line.u[(own->line.count - 1) % MODEL_COMMANDS], own->u, NU * sizeof *own->u);
    }
#endif
    memcpy(x, own->x, NX * sizeof *x);
    memcpy(u, own->u, sizeof u);
    while (end - now > soon) {
        double h = end - now, longest;
#if DELAYED
        double on;
        if (MODEL(commands_until)(&own->line, own->p, now + soon, u, &on) != 0) {
            return FORGOTTEN;
        }
        if (on + soon < h) {
            h = on + soon;
        }
#endif
#if LATE
        h = until_read(own, now, end, length, soon, h);
#endif
        longest = stable(own, x, u);
        if (h > longest) {
            h /= ceil(h / longest - 1e-9);
        }
        steps += 1.0;
        if (!(now + h > now) || steps + (end - now) / longest > MOST_STEPS) {
            return TOO_LONG;
        }
#if LATE
        {
            moment *const then = &own->past[own->passed % PAST];
            then->time = now;
            memcpy(then->x, x, sizeof then->x);
            memcpy(then->u, u, sizeof u);
            own->passed++;
        }
#endif
        MODEL(step)(x, u, own->p, h, x);
        now += h;
    }
    for (k = 0; k < NX; k++) {
        if (!isfinite(x[k])) {
            return ASTRAY;
        }
    }
    return DONE;
}

outcome MODEL(instance_advance)(instance *own, double time, double length)
{
    double x[NX];
    outcome found;
#if LATE
    const size_t passed = own->passed;
#endif
    if (!(length > 0.0) || !isfinite(time + length)) {
        return WRONG_TIME;
    }
    if (!(fabs(time - own->time) <= AT_ONCE + 1e-12 * fabs(time) + 1e-6 * length)) {
        return WRONG_TIME;
    }
    found = advanced(own, time, length, x);
    if (found == DONE) {
        memcpy(own->x, x, sizeof own->x);
        own->time = time + length;
    }
#if LATE
    else {
        own->passed = passed;
    }
#endif
    return found;
}

outcome MODEL(instance_slope)(
    instance *own, unsigned unknown, const unsigned *known, size_t count, const double *by, double *slope)
{
    const unsigned kind = unknown / REFERENCES, row = unknown % REFERENCES;
    double u[NU + 1], value[NX > NY ? NX : NY + 1];
    double by_x[(NX > NY ? NX : NY + 1) * NX], by_u[(NX > NY ? NX : NY + 1) * (NU + 1)];
    unsigned rows;
    int is_late = 0;
    size_t j;
    if (own->stage <= STARTING) {
        settle(own);
    }
    (void)acting(own, u);
    if (kind == OUTPUT && row < NY) {
        MODEL(output_jacobian)(own->x, u, own->p, value, by_x, by_u);
        rows = NY;
#if LATE
        if (latency_of[row] >= 0) {
            double late[LATE];
            MODEL(latencies)(own->p, late);
            is_late = late[latency_of[row]] > AT_ONCE;
        }
#endif
#if CONTINUOUS
    } else if (kind == RATE && row < NX) {
        MODEL(ode_jacobian)(own->x, u, own->p, value, by_x, by_u);
        rows = NX;
#endif
    } else {
        return UNKNOWN;
    }
    *slope = 0.0;
    for (j = 0; j < count; j++) {
        const unsigned column = known[j] % REFERENCES;
        if (known[j] / REFERENCES == STATE && column < NX) {
            *slope += is_late ? 0.0 : by_x[row + rows * column] * by[j];
        } else if (known[j] / REFERENCES == INPUT && column < NU) {
            int waits = is_late;
#if DELAYED
            if (delay_of[column] >= 0) {
                double late[DELAYED];
                MODEL(delays)(own->p, late);
                waits = waits || late[delay_of[column]] > AT_ONCE;
            }
#endif
            *slope += waits ? 0.0 : by_u[row + rows * column] * by[j];
        } else {
            return UNKNOWN;
        }
    }
    return DONE;
}

const char *MODEL(instance_words)(outcome what)
{
    switch (what) {
    case UNKNOWN: return "There is no such variable, or it cannot be had or set now.";
    case NO_NUMBER: return "A value is no number, or a longest step is not above zero; hand in finite values.";
    case WRONG_TIME: return "A step must begin where the last one ended, be above zero and end at a finite time.";
    case TOO_LONG: return "The step is too long: it would take more than a million of the longest inner step.";
    case ASTRAY: return "The state went beyond all bounds; look at inputs and parameters, or take shorter steps.";
    case FORGOTTEN: return "Steps are so short that a command or state as old as the delay is no longer held.";
    default: return "";
    }
}
