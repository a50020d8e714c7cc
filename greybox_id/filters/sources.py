"""The C of filters: extended Kalman filters side by side, and an unscented one whose sigma points are.

Extended ones run one to a lane, on the same readings: noise is tuned by comparing them. A reading at a time (noise of
readings is independent), covariances in Joseph's form; those of the unscented one by the unscented transform. A reading
further off than `gate` standard deviations counts as noisier by just so much that it lies at the gate: a glitch then
moves nothing, and a filter that has gone astray still finds its way back.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as cs

from ..engine.emit import Result, straight_line
from ..engine.vectors import PRELUDE, product

NARROW = "#define NARROW"
"""Asks for vectors of four lanes where there are wider ones."""
LOOPS = r"""
/* loops over the entries of covariances are worth unrolling, which -O1 does not do: a sixth of the time */
#pragma GCC optimize("O3")

typedef struct { double *predicted, *predicted_P, *filtered, *filtered_P, *forward, *off, *spread; } Record;
"""


def written(
    step: cs.Function, output: cs.Function, tables: Sequence[str], loops: str, *, narrow: bool = False, **sizes: int
) -> str:
    """The C of a filter.

    Parameters
    ----------
    step, output : (x, s, p) -> value, variance of its noise and, if the filter uses it, the derivative by x.
    tables : declarations that the loops need.
    loops : over segments, with `filter` as the function that is called.
    narrow : whether vectors of four lanes will do.
    sizes : further constants.
    """
    x, s, p = (step.numel_in(k) for k in range(3))
    constants = {"NX": x, "NS": s, "NP": p, "NY": output.numel_out(0), **sizes}
    names = [["next", "noise", "F"], ["y", "noise", "H"]]
    return "\n".join(
        [
            *([NARROW] if narrow else []),
            PRELUDE,
            *[f"#define {name} {size}" for name, size in constants.items()],
            *[
                straight_line(function.name(), function, [Result(name) for name in item[: function.n_out()]])
                for function, item in zip((step, output), names, strict=True)
            ],
            *tables,
            LOOPS,
            loops,
        ]
    )


_EKF = r"""
static void keep(const v *from, ptrdiff_t n, double *to) { for (ptrdiff_t k = 0; k < n; k++) to[k] = from[k][0]; }

static void read_all(const v *s, const v *p, const v *w, const double *y, v gate2, v *x, v *P, v *cost,
    v *off, v *spread)
{
    v y0[NY + 1], r[NY + 1], H[NH + 1], x0[NX];
    output(x, s, p, (v *)w, y0, r, H);
    memcpy(x0, x, sizeof x0);
    for (ptrdiff_t i = 0; i < NY; i++) {
        off[i] = spread[i] = splat(NAN);
        if (!(y[i] == y[i])) continue;
        v PH[NX], K[NX], T[NX * NX];
        v e = splat(y[i]) - y0[i], hPh = splat(0);
        for (ptrdiff_t a = 0; a < NX; a++) PH[a] = splat(0);
        for (ptrdiff_t k = H_BEGIN[i]; k < H_BEGIN[i + 1]; k++) {
            const ptrdiff_t c = H_COLUMN[k];
            e -= H[H_PLACE[k]] * (x[c] - x0[c]);
            for (ptrdiff_t a = 0; a < NX; a++) PH[a] += P[a * NX + c] * H[H_PLACE[k]];
        }
        for (ptrdiff_t k = H_BEGIN[i]; k < H_BEGIN[i + 1]; k++) hPh += H[H_PLACE[k]] * PH[H_COLUMN[k]];
        const v S = hPh + r[i], taken = v_fmax(S, e * e / gate2), noise = taken - hPh;
        off[i] = e, spread[i] = S;
        *cost += splat(0.5) * (e * e / taken + v_log(taken));
        for (ptrdiff_t a = 0; a < NX; a++) {
            K[a] = PH[a] / taken;
            x[a] += K[a] * e;
        }
        for (ptrdiff_t a = 0; a < NX; a++)
            for (ptrdiff_t b = 0; b < NX; b++) T[a * NX + b] = P[a * NX + b] - K[a] * PH[b];
        for (ptrdiff_t a = 0; a < NX; a++) {
            v Th = splat(0);
            for (ptrdiff_t k = H_BEGIN[i]; k < H_BEGIN[i + 1]; k++) Th += T[a * NX + H_COLUMN[k]] * H[H_PLACE[k]];
            const v pull = noise * K[a] - Th;
            for (ptrdiff_t b = 0; b < NX; b++) P[a * NX + b] = T[a * NX + b] + pull * K[b];
        }
        /* what rounding leaves of asymmetry grows from reading to reading where noise is tiny */
        for (ptrdiff_t a = 0; a < NX; a++)
            for (ptrdiff_t b = 0; b < a; b++)
                P[a * NX + b] = P[b * NX + a] = splat(0.5) * (P[a * NX + b] + P[b * NX + a]);
    }
}

void filter(ptrdiff_t lanes, ptrdiff_t segments, double gate, const double *weights, const double *s, const double *y,
    const double *p, double *x_all, double *P_all, double *cost_all, Record out)
{
    (void)weights;
    for (ptrdiff_t first = 0; first < lanes; first += W) {
        ptrdiff_t row[W];
        const int real = rows(row, first, lanes);
        v x[NX], P[NX * NX], q[NP + 1], now[NS + 1], ws[STEP_KEPT + 1], wo[OUTPUT_KEPT + 1], cost = splat(0);
        v off[NY + 1], spread[NY + 1];
        gather(x, NX, x_all, NX, row);
        gather(P, NX * NX, P_all, NX * NX, row);
        gather(q, NP, p, NP, row);
        step_fixed(q, ws);
        output_fixed(q, wo);
        const int tell = out.filtered && first == 0;
        for (ptrdiff_t k = 0; k < segments; k++) {
            for (ptrdiff_t j = 0; j < NS; j++) now[j] = splat(s[k * NS + j]);
            if (tell && out.predicted) { /* for the smoother alone */
                keep(x, NX, out.predicted + k * NX);
                keep(P, NX * NX, out.predicted_P + k * NX * NX);
            }
            read_all(now, q, wo, y + k * NY, splat(gate * gate), x, P, &cost, off, spread);
            if (tell) {
                keep(x, NX, out.filtered + k * NX);
                keep(P, NX * NX, out.filtered_P + k * NX * NX);
            }
            for (int l = 0; out.off && l < (out.filtered ? tell : real); l++) { /* of the first alone, or of each */
                const ptrdiff_t at = ((out.filtered ? 0 : first + l) * segments + k) * NY;
                for (ptrdiff_t i = 0; i < NY; i++) out.off[at + i] = off[i][l], out.spread[at + i] = spread[i][l];
            }
            if (k + 1 == segments) break;
            v next[NX], noise[NX], F[NF + 1], T[NX * NX], U[NX * NX];
            step(x, now, q, ws, next, noise, F);
            memcpy(x, next, sizeof next);
#ifdef THROUGHOUT /* noise Q joins all along: the mean of (1 + t (F - 1)) Q (1 + t (F - 1))' over t from 0 to 1 */
            for (ptrdiff_t a = 0; a < NX; a++) noise[a] *= splat(1.0 / 3), P[a * NX + a] += noise[a];
#endif
            F_times(F, P, T, NX);
            for (ptrdiff_t a = 0; a < NX; a++)
                for (ptrdiff_t b = 0; b < NX; b++) U[b * NX + a] = T[a * NX + b];
            if (tell && out.forward) keep(U, NX * NX, out.forward + k * NX * NX);
            F_times(F, U, T, NX);
            for (ptrdiff_t a = 0; a < NX; a++) {
                P[a * NX + a] = T[a * NX + a] + noise[a];
                for (ptrdiff_t b = 0; b < a; b++)
                    P[a * NX + b] = P[b * NX + a] = splat(0.5) * (T[a * NX + b] + T[b * NX + a]);
            }
#ifdef THROUGHOUT
            for (ptrdiff_t i = 0; i < NF; i++) {
                const v half = splat(0.5) * F[i] * noise[F_COLUMN[i]];
                P[F_ROW[i] * NX + F_COLUMN[i]] += half, P[F_COLUMN[i] * NX + F_ROW[i]] += half;
            }
#endif
        }
        scatter(x, NX, x_all, NX, row, real);
        scatter(P, NX * NX, P_all, NX * NX, row, real);
        for (int l = 0; l < real; l++) cost_all[first + l] = cost[l];
    }
}
"""


def ekf_source(step: cs.Function, output: cs.Function, many: bool, throughout: bool) -> str:
    """The C of extended Kalman filters.

    Parameters
    ----------
    many : whether many filters are to run side by side; a single one is a quarter faster in vectors of four lanes.
    throughout : whether a segment's noise joins all along it; smoothers know of none that does.
    step : (x, s, p) -> x_next, variance of its noise, F = d x_next / d x (sparse).
    output : (x, s, p) -> y, variance of its noise, H = d y / d x (sparse).
    """
    F, H = step.sparsity_out(2), output.sparsity_out(2)
    row, column = H.get_triplet()
    by_row = sorted(range(H.nnz()), key=row.__getitem__)
    tables = [
        _table("H_BEGIN", [sum(r < i for r in row) for i in range(H.size1() + 1)]),
        _table("H_PLACE", by_row),
        _table("H_COLUMN", [column[k] for k in by_row]),
        product("F_times", F),
        *(_table(f"F_{name}", item) for name, item in zip(("ROW", "COLUMN"), F.get_triplet(), strict=True)),
        *(["#define THROUGHOUT"] if throughout else []),
    ]
    return written(step, output, tables, _EKF, narrow=not many, NF=F.nnz(), NH=H.nnz())


def _table(name: str, entries: Sequence[int]) -> str:
    return f"static const short {name}[] = {{{', '.join(map(str, entries)) or 0}}};"


_UKF = r"""
#define POINTS (2 * NX + 1)
#define G ((POINTS + W - 1) / W)

static inline double sum(v a) { double t = 0; LANES t += a[l]; return t; }

/* lower triangle L with L L' = P, row by row; a direction without variance has none */
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

/* point 0 is the mean, 1 to NX lie ahead of it and NX + 1 to 2 NX behind; lanes beyond repeat the mean */
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

/* mean of n numbers over the points, taken from the first one so that what all of them share comes out exactly; they
   become deviations from it */
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
    /* S = L L'; C becomes C L'^-1 and e becomes L^-1 e, in which everything is a plain sum */
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
"""


def ukf_source(step: cs.Function, output: cs.Function) -> str:
    """The C of an unscented Kalman filter; the functions as for `ekf_source`, whose derivatives are not used."""
    return written(_without_derivative(step), _without_derivative(output), [], _UKF)


def _without_derivative(function: cs.Function) -> cs.Function:
    arguments = function.sx_in()
    return cs.Function(function.name(), arguments, list(function(*arguments))[:2])
