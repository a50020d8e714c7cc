#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <time.h>
#include "instance.h"

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

int main(void)
{
    static instance own;
    double x[NX] = {15.0}, u[NU + 1] = {0.03}, begun, plain = 1e9, unit = 1e9;
    int k, round;
    for (round = 0; round < 7; round++) {
        MODEL(instance_reset)(&own);
        own.x[0] = 15.0;
        own.u[0] = 0.03;
        MODEL(instance_run)(&own);
        begun = now();
        for (k = 0; k < 100000; k++) {
            MODEL(step)(x, u, MODEL(default_parameters), 0.01, x);
            if (k % 100 == 99) {
                x[0] = 15.0;
            }
        }
        plain = now() - begun < plain ? now() - begun : plain;
        begun = now();
        for (k = 0; k < 100000; k++) {
            MODEL(instance_advance)(&own, own.time, 0.01);
            if (k % 100 == 99) {
                own.x[0] = 15.0;
            }
        }
        unit = now() - begun < unit ? now() - begun : unit;
    }
    printf("%g %g %g\n", plain * 1e4, unit * 1e4, x[0] + own.x[0]);
    return 0;
}
