
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
        /* asymmetry from rounding would grow from reading to reading if noise is tiny */
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
            if (tell && out.predicted) { /* only for the smoother */
                keep(x, NX, out.predicted + k * NX);
                keep(P, NX * NX, out.predicted_P + k * NX * NX);
            }
            read_all(now, q, wo, y + k * NY, splat(gate * gate), x, P, &cost, off, spread);
            if (tell) {
                keep(x, NX, out.filtered + k * NX);
                keep(P, NX * NX, out.filtered_P + k * NX * NX);
            }
            for (int l = 0; out.off && l < (out.filtered ? tell : real); l++) { /* of the first filter only, or of each */
                const ptrdiff_t at = ((out.filtered ? 0 : first + l) * segments + k) * NY;
                for (ptrdiff_t i = 0; i < NY; i++) out.off[at + i] = off[i][l], out.spread[at + i] = spread[i][l];
            }
            if (k + 1 == segments) break;
            v next[NX], noise[NX], F[NF + 1], T[NX * NX], U[NX * NX];
            step(x, now, q, ws, next, noise, F);
            memcpy(x, next, sizeof next);
#ifdef THROUGHOUT /* noise Q enters throughout: the mean of (1 + t (F - 1)) Q (1 + t (F - 1))' over t from 0 to 1 */
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
