/* A nonlinear model-predictive controller in C99 around the functions that `greybox export --target c --name car` writes.

   It minimises what ../controller.py minimises, by differential dynamic programming with bounds on the inputs (Tassa,
   Mansard & Todorov, ICRA 2014) in real time: a fixed number of sweeps a period, each begun at the plan before. Nothing
   is taken from the heap; all that is remembered stands in `nmpc`. SI units. */

#ifndef NMPC_H
#define NMPC_H

#include "car.h"

#include <stddef.h>

#define NMPC_STAGES 60 /* at most */
#define NMPC_LATE 8    /* periods by which a command may be late at most */
#define NMPC_NZ (CAR_NX + 3 + CAR_NU * (NMPC_LATE + 1))

typedef struct {
    double period;         /* s, for which a command is held */
    double late[CAR_NU];   /* s, by which commands arrive late */
    double front, rear;    /* m, axles from the centre of gravity */
    int stages, sweeps;    /* periods looked ahead; sweeps a decision */
    double path, course, speed, rates[CAR_NU];             /* deviations that weigh the same: m, rad, m/s, per second */
    double low[CAR_NU], high[CAR_NU], fastest[CAR_NU];     /* bounds of commands and of their rates */
    double slip, half_width, beyond;                       /* soft bounds: rad, m; weight of what exceeds them */
    const double *curvature, *wanted;                      /* 1/m and m/s at points along the closed track */
    int points;
    double spacing;        /* m, between points */
} nmpc_settings;

/* A stage's state z: x of the model, s, e_y and e_psi, and for every input the commands that are on their way, the
   newest first. Its control: the rates of the commands. */
typedef struct {
    nmpc_settings set;
    int nz, queue[CAR_NU], periods[CAR_NU];
    double share[CAR_NU];
    double z[NMPC_STAGES + 1][NMPC_NZ], rate[NMPC_STAGES][CAR_NU]; /* the plan */
    double now[NMPC_NZ];                                          /* foretold, where nothing is measured */
    double gain[NMPC_STAGES][CAR_NU][NMPC_NZ], move[NMPC_STAGES][CAR_NU];
} nmpc;

/* Begin straight ahead at a speed and place on the track, commands of zero. Returns -1 where settings go too far. */
int nmpc_start(nmpc *c, const nmpc_settings *set, double v_x, double s);

/* Commands of the next period from v_x, v_y, yaw_rate and the place on the track. Returns -1 where no sweep did better
   than the plan before, which is carried on. */
int nmpc_decide(nmpc *c, const double *measured, double s, double e_y, double e_psi, double *commands);

size_t nmpc_size(void); /* of an nmpc, bytes */

#endif
