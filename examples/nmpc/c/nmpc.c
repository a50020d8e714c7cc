#include "nmpc.h"

#include <math.h>
#include <string.h>

#define COLUMNS (NMPC_NZ + CAR_NU)

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

/* z a period later; J, where it is wanted, its derivatives by z and rates. */
static void stage(const nmpc *c, const double *z, const double *rate, double *next, double J[NMPC_NZ][COLUMNS])
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
        memset(J, 0, sizeof(double) * NMPC_NZ * COLUMNS);
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
        for (column = 0; column < COLUMNS; column++) {
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

#define DEVIATIONS 6

/* What costs at a stage's end, so that the cost is half the sum of squares; G, where it is wanted, its derivatives. */
static void deviations(const nmpc *c, const double *z, double *r, double G[DEVIATIONS][NMPC_NZ])
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
    memset(G, 0, sizeof(double) * DEVIATIONS * NMPC_NZ);
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

static double cost(const nmpc *c, const double *rate, const double *z)
{
    double r[DEVIATIONS], sum = 0.0;
    int i;
    deviations(c, z, r, NULL);
    for (i = 0; i < DEVIATIONS; i++) {
        sum += 0.5 * r[i] * r[i];
    }
    for (i = 0; i < CAR_NU; i++) {
        sum += 0.5 * rate[i] * rate[i] / (c->set.rates[i] * c->set.rates[i]);
    }
    return sum;
}

/* Rates between which a command at z stays within its bounds and those of its rate. */
static void bounds(const nmpc *c, const double *z, int j, double *low, double *high)
{
    const double T = c->set.period, command = z[c->queue[j]];
    *low = fmin(fmax(-c->set.fastest[j], (c->set.low[j] - command) / T), c->set.fastest[j]);
    *high = fmax(fmin(c->set.fastest[j], (c->set.high[j] - command) / T), -c->set.fastest[j]);
}

/* Cholesky's method on the inputs that are free; what it solves is replaced by the solution, zero where not free. */
static void solve(double Q[CAR_NU][CAR_NU], const int *is_free, double *b, size_t stride, int columns)
{
    double L[CAR_NU][CAR_NU] = {{0.0}};
    int i, j, k, column;
    for (i = 0; i < CAR_NU; i++) {
        for (j = 0; j <= i; j++) {
            double sum = is_free[i] && is_free[j] ? Q[i][j] : (i == j ? 1.0 : 0.0);
            for (k = 0; k < j; k++) {
                sum -= L[i][k] * L[j][k];
            }
            L[i][j] = i == j ? sqrt(fmax(sum, 1e-12)) : sum / L[j][j];
        }
    }
    for (column = 0; column < columns; column++) {
        for (i = 0; i < CAR_NU; i++) {
            double sum = is_free[i] ? b[stride * (size_t)i + (size_t)column] : 0.0;
            for (k = 0; k < i; k++) {
                sum -= L[i][k] * b[stride * (size_t)k + (size_t)column];
            }
            b[stride * (size_t)i + (size_t)column] = sum / L[i][i];
        }
        for (i = CAR_NU - 1; i >= 0; i--) {
            double sum = b[stride * (size_t)i + (size_t)column];
            for (k = i + 1; k < CAR_NU; k++) {
                sum -= L[k][i] * b[stride * (size_t)k + (size_t)column];
            }
            b[stride * (size_t)i + (size_t)column] = sum / L[i][i];
        }
    }
}

/* Best moves of the rates, and how they follow deviations from the plan, from the last stage to the first. */
static void backwards(nmpc *c)
{
    static const double zero[NMPC_NZ];
    double V[NMPC_NZ][NMPC_NZ] = {{0.0}}, w[NMPC_NZ], J[NMPC_NZ][COLUMNS], VJ[NMPC_NZ][COLUMNS];
    double G[DEVIATIONS][NMPC_NZ], r[DEVIATIONS], next[NMPC_NZ];
    const int n = c->nz, all = n + CAR_NU;
    int a, b, i, j, k, pass;
    memcpy(w, zero, sizeof w);
    for (k = c->set.stages - 1; k >= 0; k--) {
        double H[NMPC_NZ + CAR_NU][NMPC_NZ + CAR_NU], g[NMPC_NZ + CAR_NU], Q[CAR_NU][CAR_NU];
        int is_free[CAR_NU];
        stage(c, c->z[k], c->rate[k], next, J);
        deviations(c, c->z[k + 1], r, G);
        for (a = 0; a < n; a++) {
            for (i = 0; i < DEVIATIONS; i++) {
                w[a] += G[i][a] * r[i];
                for (b = 0; b < n; b++) {
                    V[a][b] += G[i][a] * G[i][b];
                }
            }
        }
#define AT(column) ((column) < n ? (column) : NMPC_NZ + (column) - n)
        for (a = 0; a < n; a++) {
            for (b = 0; b < all; b++) {
                VJ[a][b] = 0.0;
                for (i = 0; i < n; i++) {
                    VJ[a][b] += V[a][i] * J[i][AT(b)];
                }
            }
        }
        for (a = 0; a < all; a++) {
            g[a] = 0.0;
            for (i = 0; i < n; i++) {
                g[a] += J[i][AT(a)] * w[i];
            }
            for (b = 0; b < all; b++) {
                H[a][b] = 0.0;
                for (i = 0; i < n; i++) {
                    H[a][b] += J[i][AT(a)] * VJ[i][b];
                }
            }
        }
        for (j = 0; j < CAR_NU; j++) {
            const double thrift = 1.0 / (c->set.rates[j] * c->set.rates[j]);
            H[n + j][n + j] += thrift;
            g[n + j] += thrift * c->rate[k][j];
            is_free[j] = 1;
        }
        for (a = 0; a < CAR_NU; a++) {
            for (b = 0; b < CAR_NU; b++) {
                Q[a][b] = H[n + a][n + b];
            }
        }
        for (pass = 0; pass <= CAR_NU; pass++) { /* what goes beyond a bound is held there, and the others moved anew */
            double held[CAR_NU] = {0.0}, move[CAR_NU];
            int changed = 0;
            for (j = 0; j < CAR_NU; j++) {
                held[j] = is_free[j] ? 0.0 : c->move[k][j];
            }
            for (j = 0; j < CAR_NU; j++) {
                move[j] = -g[n + j];
                for (i = 0; i < CAR_NU; i++) {
                    move[j] -= Q[j][i] * held[i];
                }
            }
            solve(Q, is_free, move, 1, 1);
            for (j = 0; j < CAR_NU; j++) {
                double low, high;
                bounds(c, c->z[k], j, &low, &high);
                if (is_free[j]) {
                    c->move[k][j] = fmin(fmax(move[j], low - c->rate[k][j]), high - c->rate[k][j]);
                    if (c->move[k][j] != move[j]) {
                        is_free[j] = 0;
                        changed = 1;
                    }
                }
            }
            if (!changed) {
                break;
            }
        }
        for (j = 0; j < CAR_NU; j++) {
            for (a = 0; a < n; a++) {
                c->gain[k][j][a] = -H[n + j][a];
            }
        }
        solve(Q, is_free, &c->gain[k][0][0], NMPC_NZ, n);
        for (a = 0; a < n; a++) {
            w[a] = g[a];
            for (j = 0; j < CAR_NU; j++) {
                w[a] += H[a][n + j] * c->move[k][j] + c->gain[k][j][a] * g[n + j];
                for (i = 0; i < CAR_NU; i++) {
                    w[a] += c->gain[k][j][a] * Q[j][i] * c->move[k][i];
                }
            }
            for (b = 0; b < n; b++) {
                V[a][b] = H[a][b];
                for (j = 0; j < CAR_NU; j++) {
                    V[a][b] += H[a][n + j] * c->gain[k][j][b] + c->gain[k][j][a] * H[n + j][b];
                    for (i = 0; i < CAR_NU; i++) {
                        V[a][b] += c->gain[k][j][a] * Q[j][i] * c->gain[k][i][b];
                    }
                }
            }
        }
    }
}

/* The plan with a share of the moves; its cost. */
static double forwards(const nmpc *c, double share, double z[][NMPC_NZ], double rate[][CAR_NU])
{
    double sum = 0.0;
    int i, j, k;
    memcpy(z[0], c->z[0], sizeof c->z[0]);
    for (k = 0; k < c->set.stages; k++) {
        for (j = 0; j < CAR_NU; j++) {
            double low, high, wanted = c->rate[k][j] + share * c->move[k][j];
            for (i = 0; i < c->nz; i++) {
                wanted += c->gain[k][j][i] * (z[k][i] - c->z[k][i]);
            }
            bounds(c, z[k], j, &low, &high);
            rate[k][j] = fmin(fmax(wanted, low), high);
        }
        stage(c, z[k], rate[k], z[k + 1], NULL);
        sum += cost(c, rate[k], z[k + 1]);
    }
    return sum;
}

int nmpc_start(nmpc *c, const nmpc_settings *set, double v_x, double s)
{
    int j;
    memset(c, 0, sizeof *c);
    c->set = *set;
    c->nz = CAR_NX + 3;
    if (set->stages < 1 || set->stages > NMPC_STAGES) {
        return -1;
    }
    for (j = 0; j < CAR_NU; j++) {
        c->periods[j] = (int)floor(set->late[j] / set->period + 1e-9);
        c->share[j] = fmax(set->late[j] / set->period - c->periods[j], 0.0);
        c->queue[j] = c->nz;
        if (c->periods[j] > NMPC_LATE) {
            return -1;
        }
        c->nz += c->periods[j] + 1;
    }
    c->now[CAR_X_V_X] = v_x;
    c->now[CAR_NX] = s;
    return 0;
}

int nmpc_decide(nmpc *c, const double *measured, double s, double e_y, double e_psi, double *commands)
{
    static const double shares[4] = {1.0, 0.5, 0.2, 0.05};
    double z[NMPC_STAGES + 1][NMPC_NZ], rate[NMPC_STAGES][CAR_NU];
    const int N = c->set.stages;
    double best;
    int sweep, i, j, better = 0;
    memcpy(c->z[0], c->now, sizeof c->now);
    c->z[0][CAR_X_V_X] = measured[0];
    c->z[0][CAR_X_V_Y] = measured[1];
    c->z[0][CAR_X_YAW_RATE] = measured[2];
    c->z[0][CAR_NX] = s;
    c->z[0][CAR_NX + 1] = e_y;
    c->z[0][CAR_NX + 2] = e_psi;
    memset(c->gain, 0, sizeof c->gain);
    memset(c->move, 0, sizeof c->move);
    best = forwards(c, 0.0, z, rate);
    memcpy(c->z, z, sizeof z);
    memcpy(c->rate, rate, sizeof rate);
    for (sweep = 0; sweep < c->set.sweeps; sweep++) {
        backwards(c);
        for (i = 0; i < 4; i++) {
            const double found = forwards(c, shares[i], z, rate);
            if (found < best) {
                best = found;
                better = 1;
                memcpy(c->z, z, sizeof z);
                memcpy(c->rate, rate, sizeof rate);
                break;
            }
        }
        if (i == 4) {
            break;
        }
    }
    memcpy(c->now, c->z[1], sizeof c->now);
    for (j = 0; j < CAR_NU; j++) {
        commands[j] = c->now[c->queue[j]];
    }
    memmove(c->rate[0], c->rate[1], sizeof(double) * CAR_NU * (size_t)(N - 1));
    memset(c->rate[N - 1], 0, sizeof c->rate[N - 1]);
    return better ? 0 : -1;
}

size_t nmpc_size(void)
{
    return sizeof(nmpc);
}
