#include "stage.h"

#include <math.h>
#include <string.h>

static double line(const nmpc_settings *set, const double *values, double s, double *change)
{
    const double at = s / set->spacing, below = floor(at);
    const long k = (long)below % set->points, here = k < 0 ? k + set->points : k;
    const double step = values[(here + 1) % set->points] - values[here];
    *change = step / set->spacing;
    return values[here] + (at - below) * step;
}

/* Rates of s, e_y, e_psi under v = (v_x, v_y, yaw_rate), and their derivatives. */
static void along(const nmpc_settings *set, const double *path, const double *v, double *rate, double by_path[3][3],
    double by_v[3][3])
{
    double bends;
    const double k = line(set, set->curvature, path[0], &bends), c = cos(path[2]), d = sin(path[2]);
    const double left = 1.0 / (1.0 - k * path[1]), forward = v[0] * c - v[1] * d, across = v[0] * d + v[1] * c;
    const double s_rate = forward * left;
    const double s_by[3] = {s_rate * left * bends * path[1], s_rate * left * k, -across * left};
    const double s_by_v[3] = {c * left, -d * left, 0.0};
    int i;
    rate[0] = s_rate;
    rate[1] = across;
    rate[2] = v[2] - k * s_rate;
    for (i = 0; i < 3; i++) {
        by_path[0][i] = s_by[i];
        by_path[1][i] = i == 2 ? forward : 0.0;
        by_path[2][i] = -k * s_by[i] - (i == 0 ? bends * s_rate : 0.0);
        by_v[0][i] = s_by_v[i];
        by_v[1][i] = i == 0 ? d : (i == 1 ? c : 0.0);
        by_v[2][i] = (i == 2 ? 1.0 : 0.0) - k * s_by_v[i];
    }
}

void nmpc_stage(const nmpc *c, const double *z, const double *rate, double *next, double J[NMPC_NZ][NMPC_COLUMNS])
{
    static const int motion[3] = {CAR_X_V_X, CAR_X_V_Y, CAR_X_YAW_RATE};
    const double T = c->set.period, *path = z + CAR_NX;
    double u[CAR_NU], after[CAR_NX], by_x[CAR_NX * CAR_NX], by_u[CAR_NX * CAR_NU];
    double v[3], mean[3], mid[3], k1[3], k2[3], P1[3][3], V1[3][3], P2[3][3], V2[3][3];
    int i, j, k, column;
    for (j = 0; j < CAR_NU; j++) {
        const double *queue = z + c->queue[j];
        const double later = c->periods[j] == 0 ? queue[0] + T * rate[j] : queue[c->periods[j] - 1];
        u[j] = c->share[j] * queue[c->periods[j]] + (1.0 - c->share[j]) * later;
    }
    if (J == NULL) {
        car_step(z, u, car_default_parameters, T, after);
    } else {
        car_step_jacobian(z, u, car_default_parameters, T, after, by_x, by_u);
    }
    for (i = 0; i < 3; i++) {
        v[i] = z[motion[i]];
        mean[i] = 0.5 * (v[i] + after[motion[i]]);
    }
    along(&c->set, path, v, k1, P1, V1);
    for (i = 0; i < 3; i++) {
        mid[i] = path[i] + 0.5 * T * k1[i];
    }
    along(&c->set, mid, mean, k2, P2, V2);
    if (J != NULL) {
        memset(J, 0, sizeof(double) * NMPC_NZ * NMPC_COLUMNS);
        for (i = 0; i < CAR_NX; i++) {
            for (k = 0; k < CAR_NX; k++) {
                J[i][k] = by_x[i + CAR_NX * k];
            }
            for (j = 0; j < CAR_NU; j++) {
                const double own = by_u[i + CAR_NX * j], later = own * (1.0 - c->share[j]);
                J[i][c->queue[j] + c->periods[j]] += own * c->share[j];
                J[i][c->queue[j] + (c->periods[j] > 0 ? c->periods[j] - 1 : 0)] += later;
                J[i][NMPC_NZ + j] = c->periods[j] == 0 ? later * T : 0.0;
            }
        }
        for (column = 0; column < NMPC_COLUMNS; column++) {
            double d_path[3], d_v[3], d_mid[3], d_mean[3];
            for (i = 0; i < 3; i++) {
                d_path[i] = column == CAR_NX + i ? 1.0 : 0.0;
                d_v[i] = column == motion[i] ? 1.0 : 0.0;
                d_mean[i] = 0.5 * (d_v[i] + J[motion[i]][column]);
            }
            for (i = 0; i < 3; i++) {
                d_mid[i] = d_path[i];
                for (k = 0; k < 3; k++) {
                    d_mid[i] += 0.5 * T * (P1[i][k] * d_path[k] + V1[i][k] * d_v[k]);
                }
            }
            for (i = 0; i < 3; i++) {
                J[CAR_NX + i][column] = d_path[i];
                for (k = 0; k < 3; k++) {
                    J[CAR_NX + i][column] += T * (P2[i][k] * d_mid[k] + V2[i][k] * d_mean[k]);
                }
            }
        }
        for (j = 0; j < CAR_NU; j++) {
            J[c->queue[j]][c->queue[j]] = 1.0;
            J[c->queue[j]][NMPC_NZ + j] = T;
            for (i = 1; i <= c->periods[j]; i++) {
                J[c->queue[j] + i][c->queue[j] + i - 1] = 1.0;
            }
        }
    }
    for (j = 0; j < CAR_NU; j++) {
        const double newest = z[c->queue[j]] + T * rate[j];
        memmove(next + c->queue[j] + 1, z + c->queue[j], sizeof(double) * (size_t)c->periods[j]);
        next[c->queue[j]] = newest;
    }
    memcpy(next, after, sizeof after);
    for (i = 0; i < 3; i++) {
        next[CAR_NX + i] = path[i] + T * k2[i];
    }
}

void nmpc_deviations(const nmpc *c, const double *z, double *r, double G[NMPC_DEVIATIONS][NMPC_NZ])
{
    const nmpc_settings *set = &c->set;
    const double v = z[CAR_X_V_X], *path = z + CAR_NX, price = sqrt(set->beyond);
    const int steer = c->queue[CAR_U_STEER] + c->periods[CAR_U_STEER];
    const double slip_f = z[steer] - (z[CAR_X_V_Y] + set->front * z[CAR_X_YAW_RATE]) / v;
    const double slip_r = -(z[CAR_X_V_Y] - set->rear * z[CAR_X_YAW_RATE]) / v;
    const double soft[3] = {path[1], slip_f, slip_r}, bound[3] = {set->half_width, set->slip, set->slip};
    double change;
    const double wanted = line(set, set->wanted, path[0], &change);
    int i;
    r[0] = path[1] / set->path;
    r[1] = (path[2] + z[CAR_X_V_Y] / v) / set->course;
    r[2] = (v - wanted) / set->speed;
    for (i = 0; i < 3; i++) {
        const double over = fabs(soft[i]) / bound[i] - 1.0;
        r[3 + i] = over > 0.0 ? price * over : 0.0;
    }
    if (G == NULL) {
        return;
    }
    memset(G, 0, sizeof(double) * NMPC_DEVIATIONS * NMPC_NZ);
    G[0][CAR_NX + 1] = 1.0 / set->path;
    G[1][CAR_NX + 2] = 1.0 / set->course;
    G[1][CAR_X_V_Y] = 1.0 / (v * set->course);
    G[1][CAR_X_V_X] = -z[CAR_X_V_Y] / (v * v * set->course);
    G[2][CAR_X_V_X] = 1.0 / set->speed;
    G[2][CAR_NX] = -change / set->speed;
    for (i = 0; i < 3; i++) {
        const double slope = r[3 + i] > 0.0 ? (soft[i] > 0.0 ? price : -price) / bound[i] : 0.0;
        if (i == 0) {
            G[3][CAR_NX + 1] = slope;
            continue;
        }
        G[3 + i][CAR_X_V_X] = slope * ((i == 1 ? z[steer] : 0.0) - soft[i]) / v;
        G[3 + i][CAR_X_V_Y] = -slope / v;
        G[3 + i][CAR_X_YAW_RATE] = slope * (i == 1 ? -set->front : set->rear) / v;
        G[3 + i][steer] += i == 1 ? slope : 0.0;
    }
}

double nmpc_cost(const nmpc *c, const double *rate, const double *z)
{
    double r[NMPC_DEVIATIONS], sum = 0.0;
    int i;
    nmpc_deviations(c, z, r, NULL);
    for (i = 0; i < NMPC_DEVIATIONS; i++) {
        sum += 0.5 * r[i] * r[i];
    }
    for (i = 0; i < CAR_NU; i++) {
        sum += 0.5 * rate[i] * rate[i] / (c->set.rates[i] * c->set.rates[i]);
    }
    return sum;
}
