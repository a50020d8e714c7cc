/* What the controller in nmpc.c knows of the vehicle, the track and what it is to do. */

#ifndef NMPC_STAGE_H
#define NMPC_STAGE_H

#include "nmpc.h"

#define NMPC_COLUMNS (NMPC_NZ + CAR_NU) /* derivatives by z, then by the rates */
#define NMPC_DEVIATIONS 6

/* z a period later; J, where it is wanted, its derivatives. */
void nmpc_stage(const nmpc *c, const double *z, const double *rate, double *next, double J[NMPC_NZ][NMPC_COLUMNS]);

/* What costs at a stage's end, so that the cost is half the sum of squares; G, where it is wanted, its derivatives. */
void nmpc_deviations(const nmpc *c, const double *z, double *r, double G[NMPC_DEVIATIONS][NMPC_NZ]);

/* Of a stage that ends at z. */
double nmpc_cost(const nmpc *c, const double *rate, const double *z);

#endif
