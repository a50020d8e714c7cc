/* car: kinematic single-track vehicle with an understeer gradient (kinematic), from fit, greybox-id 1.0.0rc1.
   Five seconds at 100 Hz with a step of the steering, as CSV. */

#include "car.h"

#include <stdio.h>

int main(void)
{
    const double dt = 0.01; /* s */
    double x[CAR_NX] = {0.0};
    double u[CAR_NU] = {0.0, 10.0};
    double y[CAR_NY];
    int i, k;
    car_commands line;
    car_commands_start(&line, u);
    printf("time");
    for (i = 0; i < CAR_NY; i++) {
        printf(",%s", car_output_names[i]);
    }
    printf("\n");
    for (k = 0; k < 500; k++) {
        u[CAR_U_STEER] = k < 50 ? 0.0 : 0.05; /* rad */
        car_output(x, u, car_default_parameters, y);
        printf("%.2f", k * dt);
        for (i = 0; i < CAR_NY; i++) {
            printf(",%.6g", y[i]);
        }
        printf("\n");
        if (car_commands_push(&line, k * dt, u) != 0
            || car_step_late(&line, x, car_default_parameters, k * dt, dt, x) != 0) {
            return 1;
        }
    }
    return 0;
}
