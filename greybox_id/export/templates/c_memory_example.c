/* @TITLE@
#if STEER
   Five seconds with a step of the steering, as CSV. */
#else
   Five seconds, as CSV. */
#endif

#include "@.h"

#include <stdio.h>

int main(void)
{
    static @_window window;
    double u[$_NU] = {@U@};
    double y[$_NY] = {0.0};
    int i, k;
    @_start(&window, @_default_parameters, u, y);
    printf("time");
    for (i = 0; i < $_NY; i++) {
        printf(",%s", @_output_names[i]);
    }
    printf("\n");
    for (k = 0; k * $_SAMPLE_TIME < 5.0; k++) {
#if STEER
        u[$_U_STEER] = k < 20 ? 0.0 : 0.1; /* rad */
#endif
        @_output(&window, y);
        printf("%.2f", k * $_SAMPLE_TIME);
        for (i = 0; i < $_NY; i++) {
            printf(",%.6g", y[i]);
        }
        printf("\n");
        @_step(&window, u);
    }
    return 0;
}
