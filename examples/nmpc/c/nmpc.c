#include "stage.h"

#include <math.h>
#include <string.h>

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
    double V[NMPC_NZ][NMPC_NZ] = {{0.0}}, w[NMPC_NZ], J[NMPC_NZ][NMPC_COLUMNS], VJ[NMPC_NZ][NMPC_COLUMNS];
    double G[NMPC_DEVIATIONS][NMPC_NZ], r[NMPC_DEVIATIONS], next[NMPC_NZ];
    const int n = c->nz, all = n + CAR_NU;
    int a, b, i, j, k, pass;
    memcpy(w, zero, sizeof w);
    for (k = c->set.stages - 1; k >= 0; k--) {
        double H[NMPC_NZ + CAR_NU][NMPC_NZ + CAR_NU], g[NMPC_NZ + CAR_NU], Q[CAR_NU][CAR_NU];
        int is_free[CAR_NU];
        nmpc_stage(c, c->z[k], c->rate[k], next, J);
        nmpc_deviations(c, c->z[k + 1], r, G);
        for (a = 0; a < n; a++) {
            for (i = 0; i < NMPC_DEVIATIONS; i++) {
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
        nmpc_stage(c, z[k], rate[k], z[k + 1], NULL);
        sum += nmpc_cost(c, rate[k], z[k + 1]);
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
