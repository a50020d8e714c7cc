
#define POINTS (2 * NX + 1)
#define G ((POINTS + W - 1) / W)

static inline double sum(v a) { double t = 0; LANES t += a[l]; return t; }

/* lower triangle L with L L' = P, row by row; zero in directions without variance */
static void root(const double *P, double *L)
{
    for (ptrdiff_t j = 0; j < NX; j++) {
        double d = P[j * NX + j];
        for (ptrdiff_t k = 0; k < j; k++) d -= L[j * NX + k] * L[j * NX + k];
        const double l = d > 1e-14 * P[j * NX + j] ? sqrt(d) : 0;
        L[j * NX + j] = l;
        for (ptrdiff_t i = j + 1; i < NX; i++) {
            double t = P[i * NX + j];
            for (ptrdiff_t k = 0; k < j; k++) t -= L[i * NX + k] * L[j * NX + k];
            L[i * NX + j] = l > 0 ? t / l : 0;
        }
    }
}

/* point 0 is the mean, 1 to NX lie on one side of it and NX + 1 to 2 NX on the other; further lanes repeat the mean */
static void spread_out(const double *x, const double *P, double reach, v X[G][NX])
{
    double L[NX * NX];
    root(P, L);
    for (ptrdiff_t g = 0; g < G; g++)
        for (ptrdiff_t i = 0; i < NX; i++) X[g][i] = splat(x[i]);
    for (ptrdiff_t j = 0; j < NX; j++)
        for (ptrdiff_t i = j; i < NX; i++) {
            const double by = reach * L[i * NX + j];
            X[(1 + j) / W][i][(1 + j) % W] += by;
            X[(1 + NX + j) / W][i][(1 + NX + j) % W] -= by;
        }
}

static void weigh(const double *weights, v wm[G], v wc[G])
{
    for (ptrdiff_t g = 0; g < G; g++) LANES {
        const ptrdiff_t point = g * W + l;
        wm[g][l] = point == 0 ? weights[0] : point < POINTS ? weights[2] : 0;
        wc[g][l] = point == 0 ? weights[1] : point < POINTS ? weights[2] : 0;
    }
}

/* mean of n numbers over the points, relative to the first one so that common values are exact; the numbers become
   deviations from it */
static void centre(v *X, ptrdiff_t n, const v *wm, double *mean)
{
    for (ptrdiff_t i = 0; i < n; i++) {
        const double first = X[i][0];
        v t = splat(0);
        for (ptrdiff_t g = 0; g < G; g++) t += wm[g] * (X[g * n + i] - splat(first));
        mean[i] = first + sum(t);
        for (ptrdiff_t g = 0; g < G; g++) X[g * n + i] -= splat(mean[i]);
    }
}

static double together(const v *A, ptrdiff_t n, ptrdiff_t i, const v *B, ptrdiff_t m, ptrdiff_t j, const v *wc)
{
    v t = splat(0);
    for (ptrdiff_t g = 0; g < G; g++) t += wc[g] * A[g * n + i] * B[g * m + j];
    return sum(t);
}

static void read_all(const v *s, const v *p, const v *w, const double *y, double gate, double reach, const v *wm,
    const v *wc, double *x, double *P, double *cost, double *off, double *spread)
{
    v X[G][NX], Y[G][NY + 1];
    double at[NX], mean[NY + 1], noise[NY + 1], S[NY * NY + 1], C[NX * NY + 1], e[NY + 1];
    ptrdiff_t which[NY + 1], count = 0;
    for (ptrdiff_t i = 0; i < NY; i++) {
        off[i] = spread[i] = NAN;
        if (y[i] == y[i]) which[count++] = i;
    }
    if (!count) return;
    spread_out(x, P, reach, X);
    v flat[G * (NY + 1)];
    for (ptrdiff_t g = 0; g < G; g++) {
        v r[NY + 1];
        output(X[g], s, p, (v *)w, Y[g], r);
        for (ptrdiff_t i = 0; i < NY; i++) {
            flat[g * NY + i] = Y[g][i];
            if (g == 0) noise[i] = r[i][0];
        }
    }
    centre(flat, NY, wm, mean);
    centre((v *)X, NX, wm, at);
    for (ptrdiff_t a = 0; a < count; a++) {
        const ptrdiff_t i = which[a];
        e[a] = y[i] - mean[i];
        for (ptrdiff_t b = 0; b <= a; b++)
            S[a * NY + b] = S[b * NY + a] = together(flat, NY, i, flat, NY, which[b], wc);
        S[a * NY + a] += noise[i];
        off[i] = e[a], spread[i] = S[a * NY + a];
        S[a * NY + a] = fmax(S[a * NY + a], e[a] * e[a] / (gate * gate));
        for (ptrdiff_t j = 0; j < NX; j++) C[j * NY + a] = together((v *)X, NX, j, flat, NY, i, wc);
    }
    /* S = L L'; C becomes C L'^-1 and e becomes L^-1 e, so that updates are plain sums */
    for (ptrdiff_t a = 0; a < count; a++) {
        for (ptrdiff_t b = 0; b < a; b++) {
            for (ptrdiff_t k = 0; k < b; k++) S[a * NY + b] -= S[a * NY + k] * S[b * NY + k];
            S[a * NY + b] /= S[b * NY + b];
            S[a * NY + a] -= S[a * NY + b] * S[a * NY + b];
            e[a] -= S[a * NY + b] * e[b];
        }
        S[a * NY + a] = sqrt(S[a * NY + a]);
        e[a] /= S[a * NY + a];
        *cost += 0.5 * e[a] * e[a] + log(S[a * NY + a]);
        for (ptrdiff_t j = 0; j < NX; j++) {
            for (ptrdiff_t b = 0; b < a; b++) C[j * NY + a] -= C[j * NY + b] * S[a * NY + b];
            C[j * NY + a] /= S[a * NY + a];
            x[j] += C[j * NY + a] * e[a];
        }
    }
    for (ptrdiff_t i = 0; i < NX; i++)
        for (ptrdiff_t j = 0; j <= i; j++) {
            double t = P[i * NX + j];
            for (ptrdiff_t a = 0; a < count; a++) t -= C[i * NY + a] * C[j * NY + a];
            P[i * NX + j] = P[j * NX + i] = t;
        }
}

void filter(ptrdiff_t lanes, ptrdiff_t segments, double gate, const double *weights, const double *s, const double *y,
    const double *p, double *x_all, double *P_all, double *cost_all, Record out)
{
    v wm[G], wc[G];
    weigh(weights, wm, wc);
    const double reach = weights[3];
    for (ptrdiff_t lane = 0; lane < lanes; lane++) {
        double *x = x_all + lane * NX, *P = P_all + lane * NX * NX, cost = 0, off[NY + 1], spread[NY + 1];
        v q[NP + 1], now[NS + 1], ws[STEP_KEPT + 1], wo[OUTPUT_KEPT + 1];
        for (ptrdiff_t j = 0; j < NP; j++) q[j] = splat(p[lane * NP + j]);
        step_fixed(q, ws);
        output_fixed(q, wo);
        const int tell = out.filtered && lane == 0;
        for (ptrdiff_t k = 0; k < segments; k++) {
            for (ptrdiff_t j = 0; j < NS; j++) now[j] = splat(s[k * NS + j]);
            if (tell && out.predicted) {
                memcpy(out.predicted + k * NX, x, NX * sizeof(double));
                memcpy(out.predicted_P + k * NX * NX, P, NX * NX * sizeof(double));
            }
            read_all(now, q, wo, y + k * NY, gate, reach, wm, wc, x, P, &cost, off, spread);
            if (tell) {
                memcpy(out.filtered + k * NX, x, NX * sizeof(double));
                memcpy(out.filtered_P + k * NX * NX, P, NX * NX * sizeof(double));
            }
            if (out.off && (tell || !out.filtered)) {
                const ptrdiff_t at = ((out.filtered ? 0 : lane) * segments + k) * NY;
                memcpy(out.off + at, off, NY * sizeof(double));
                memcpy(out.spread + at, spread, NY * sizeof(double));
            }
            if (k + 1 == segments) break;
            v X[G][NX], Z[G][NX];
            double at[NX], noise[NX];
            spread_out(x, P, reach, X);
            for (ptrdiff_t g = 0; g < G; g++) {
                v r[NX];
                step(X[g], now, q, ws, Z[g], r);
                for (ptrdiff_t i = 0; g == 0 && i < NX; i++) noise[i] = r[i][0];
            }
            centre((v *)Z, NX, wm, x);
            if (tell && out.forward) {
                centre((v *)X, NX, wm, at);
                for (ptrdiff_t i = 0; i < NX; i++)
                    for (ptrdiff_t j = 0; j < NX; j++)
                        out.forward[(k * NX + i) * NX + j] = together((v *)X, NX, i, (v *)Z, NX, j, wc);
            }
            for (ptrdiff_t i = 0; i < NX; i++) {
                for (ptrdiff_t j = 0; j <= i; j++)
                    P[i * NX + j] = P[j * NX + i] = together((v *)Z, NX, i, (v *)Z, NX, j, wc);
                P[i * NX + i] += noise[i];
            }
        }
        cost_all[lane] = cost;
    }
}
