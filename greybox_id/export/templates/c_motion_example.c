/* @TITLE@
#if STEER
   Five seconds at 100 Hz with a step of the steering, as CSV. */
#else
   Five seconds at 100 Hz, as CSV. */
#endif

#include "@.h"

#include <stdio.h>

int main(void)
{
    const double dt = 0.01; /* s */
    double x[$_NX] = {@X@};
    double u[$_NU] = {@U@};
    double y[$_NY];
    int i, k;
#if LATE
    @_commands line;
    @_commands_start(&line, u);
#endif
    printf("time");
    for (i = 0; i < $_NY; i++) {
        printf(",%s", @_output_names[i]);
    }
    printf("\n");
    for (k = 0; k < 500; k++) {
#if STEER
        u[$_U_STEER] = k < 50 ? 0.0 : 0.05; /* rad */
#endif
        @_output(x, u, @_default_parameters, y);
        printf("%.2f", k * dt);
        for (i = 0; i < $_NY; i++) {
            printf(",%.6g", y[i]);
        }
        printf("\n");
#if LATE
        if (@_commands_push(&line, k * dt, u) != 0
            || @_step_late(&line, x, @_default_parameters, k * dt, dt, x) != 0) {
            return 1;
        }
#else
        @_step(x, u, @_default_parameters, dt, x);
#endif
    }
    return 0;
}
