/* The filter of error_filter.py, after vectors.c: lanes, and values to be whitened, lie in vectors. */

static INLINE v of_lanes(const double *from, ptrdiff_t first, ptrdiff_t lanes)
{
    if (first + W <= lanes) return (v)*(const u *)(from + first);
    v x;
    LANES x[l] = from[first + l < lanes ? first + l : lanes - 1];
    return x;
}

/* a weighted sum of rows of n vectors, each `apart` from the one before; weights that are zero cost nothing */
static INLINE void combined(v *result, const double *weights, ptrdiff_t rows, const v *X, ptrdiff_t apart, ptrdiff_t n)
{
    ptrdiff_t used[rows], count = 0, q = 0;
    for (ptrdiff_t j = 0; j < rows; j++) {
        used[count] = j;
        count += weights[j] != 0;
    }
    for (; q + 4 <= n; q += 4) { /* sums in registers */
        v a = splat(0), b = a, c = a, d = a;
        for (ptrdiff_t i = 0; i < count; i++) {
            const v weight = splat(weights[used[i]]), *const at = X + used[i] * apart + q;
            a = fused(weight, at[0], a); b = fused(weight, at[1], b);
            c = fused(weight, at[2], c); d = fused(weight, at[3], d);
        }
        result[q] = a; result[q + 1] = b; result[q + 2] = c; result[q + 3] = d;
    }
    for (; q < n; q++) {
        v a = splat(0);
        for (ptrdiff_t i = 0; i < count; i++) a = fused(splat(weights[used[i]]), X[used[i] * apart + q], a);
        result[q] = a;
    }
}

static void begin(v *x, v *P, ptrdiff_t n, ptrdiff_t nz, const double *start, const v *colour, ptrdiff_t slow_errors,
    const double *sd, ptrdiff_t first, ptrdiff_t lanes)
{
    for (ptrdiff_t k = 0; k < n * n; k++) P[k] = splat(0);
    for (ptrdiff_t a = 0; a < n; a++) {
        const ptrdiff_t force = a - nz - slow_errors;
        const v process = force < 0 ? splat(0) : of_lanes(sd + force * lanes, first, lanes);
        x[a] = splat(0);
        P[a * n + a] = a < nz ? splat(start[a]) : force < 0 ? colour[a - nz] * colour[a - nz] : process * process;
    }
}

/* a row of values in vectors, the last of which may be filled in part only; and back */
static INLINE void loaded(v *to, const double *from, ptrdiff_t count)
{
    ptrdiff_t q = 0;
    for (; q < count / W; q++) to[q] = (v)*(const u *)(from + q * W);
    if (count % W) memcpy(to + q, from + q * W, count % W * sizeof(double));
}
static INLINE void stored(const v *from, double *to, ptrdiff_t count)
{
    ptrdiff_t q = 0;
    for (; q < count / W; q++) *(u *)(to + q * W) = (u)from[q];
    if (count % W) memcpy(to + q * W, from + q, count % W * sizeof(double));
}

void filtered(ptrdiff_t segments, ptrdiff_t nz, ptrdiff_t n, ptrdiff_t channels, ptrdiff_t slow_errors, ptrdiff_t lanes,
    const double *F, const double *H, const double *start, const double *colours, const double *slow, const double *sd,
    const double *fade, const double *white, const unsigned char *first, const ptrdiff_t *pointer,
    const ptrdiff_t *channel, const double *r, double *innovation, double *variance, double *gain, double *scratch)
{
    const ptrdiff_t forces = n - nz - slow_errors;
    v *const P = (v *)(((size_t)scratch + sizeof(v) - 1) / sizeof(v) * sizeof(v));
    v *const M = P + n * n, *const N = M + nz * n, *const x = N + nz * n, *const g = x + n, *const K = g + n, *const moved = K + n;
    v *const decay = moved + n, *const driven = decay + n, *const colour = driven + n;
    for (ptrdiff_t lane = 0; lane < lanes; lane += W) {
        const ptrdiff_t count = lanes - lane < W ? lanes - lane : W;
        for (ptrdiff_t m = 0; m < slow_errors; m++) colour[m] = of_lanes(colours + m * lanes, lane, lanes);
        for (ptrdiff_t k = 0; k < segments; k++) {
            const double *const now = sd + k * forces * lanes, *const next = now + forces * lanes;
            if (first[k]) begin(x, P, n, nz, start, colour, slow_errors, now, lane, lanes);
            for (ptrdiff_t i = pointer[k]; i < pointer[k + 1]; i++) {
                const double *const h = H + (k * channels + channel[i]) * n;
                v s = of_lanes(white + channel[i] * lanes, lane, lanes), nu = splat(r[i]);
                combined(g, h, n, P, n, n);
                for (ptrdiff_t a = 0; a < n; a++)
                    if (h[a] != 0) {
                        s = fused(splat(h[a]), g[a], s);
                        nu = fused(splat(-h[a]), x[a], nu);
                    }
                const v precision = splat(1) / s;
                for (ptrdiff_t a = 0; a < n; a++) {
                    K[a] = g[a] * precision;
                    x[a] = fused(K[a], nu, x[a]);
                }
                for (ptrdiff_t a = 0; a < n; a++)
                    for (ptrdiff_t b = 0; b < n; b++) P[a * n + b] = fused(-g[a], K[b], P[a * n + b]);
                stored(&nu, innovation + i * lanes + lane, count);
                stored(&s, variance + i * lanes + lane, count);
                if (lane == 0)
                    for (ptrdiff_t a = 0; a < n; a++) gain[i * n + a] = K[a][0];
            }
            if (k + 1 == segments || first[k + 1]) continue;
            const double *const f = F + k * nz * n;
            const v faded = of_lanes(slow + k * lanes, lane, lanes);
            for (ptrdiff_t m = 0; m < slow_errors; m++) {
                decay[m] = faded;
                driven[m] = colour[m] * colour[m] * (splat(1) - faded * faded);
            }
            for (ptrdiff_t j = 0; j < forces; j++) {
                const v kept = of_lanes(fade + (k * forces + j) * lanes, lane, lanes);
                const v later = of_lanes(next + j * lanes, lane, lanes);
                decay[slow_errors + j] = kept * later / of_lanes(now + j * lanes, lane, lanes);
                driven[slow_errors + j] = later * later * (splat(1) - kept * kept);
            }
            for (ptrdiff_t a = 0; a < nz; a++) {
                combined(moved + a, f + a * n, n, x, 1, 1);
                combined(M + a * n, f + a * n, n, P, n, n);
            }
            for (ptrdiff_t j = 0; j < n; j++)
                for (ptrdiff_t a = 0; a < nz; a++) N[j * nz + a] = M[a * n + j];
            for (ptrdiff_t a = 0; a < nz; a++) {
                x[a] = moved[a];
                combined(P + a * n, f + a * n, n, N, nz, nz);
                for (ptrdiff_t b = nz; b < n; b++) P[b * n + a] = P[a * n + b] = M[a * n + b] * decay[b - nz];
            }
            for (ptrdiff_t a = nz; a < n; a++) {
                x[a] *= decay[a - nz];
                for (ptrdiff_t b = nz; b < n; b++) P[a * n + b] *= decay[a - nz] * decay[b - nz];
                P[a * n + a] += driven[a - nz];
            }
        }
    }
}

/* columns that are whitened side by side: with a dozen states they fit into a first-level cache */
#define SIDE 128

void innovations(ptrdiff_t segments, ptrdiff_t nz, ptrdiff_t n, ptrdiff_t channels, ptrdiff_t columns,
    const double *F, const double *H, const double *decay, const unsigned char *first, const ptrdiff_t *pointer,
    const ptrdiff_t *channel, const double *gain, const double *size, const ptrdiff_t *place, const double *values,
    double *result, double *scratch)
{
    v *const x = (v *)(((size_t)scratch + sizeof(v) - 1) / sizeof(v) * sizeof(v));
    for (ptrdiff_t column = 0; column < columns; column += SIDE) {
        const ptrdiff_t count = columns - column < SIDE ? columns - column : SIDE, wide = (count + W - 1) / W;
        v *const moved = x + n * wide, *const nu = moved + nz * wide, *const expected = nu + wide;
        memset(nu, 0, wide * sizeof(v));
        for (ptrdiff_t k = 0; k < segments; k++) {
            if (first[k]) memset(x, 0, n * wide * sizeof(v));
            for (ptrdiff_t i = pointer[k]; i < pointer[k + 1]; i++) {
                combined(expected, H + (k * channels + channel[i]) * n, n, x, wide, wide);
                loaded(nu, values + place[i] * columns + column, count);
                for (ptrdiff_t q = 0; q < wide; q++) nu[q] -= expected[q];
                for (ptrdiff_t a = 0; a < n; a++) {
                    const v factor = splat(gain[i * n + a]);
                    for (ptrdiff_t q = 0; q < wide; q++) x[a * wide + q] = fused(factor, nu[q], x[a * wide + q]);
                }
                const v factor = splat(1 / size[i]);
                for (ptrdiff_t q = 0; q < wide; q++) expected[q] = nu[q] * factor;
                stored(expected, result + place[i] * columns + column, count);
            }
            if (k + 1 == segments || first[k + 1]) continue;
            for (ptrdiff_t a = 0; a < nz; a++) combined(moved + a * wide, F + (k * nz + a) * n, n, x, wide, wide);
            memcpy(x, moved, nz * wide * sizeof(v));
            for (ptrdiff_t a = nz; a < n; a++) {
                const v factor = splat(decay[k * (n - nz) + a - nz]);
                for (ptrdiff_t q = 0; q < wide; q++) x[a * wide + q] *= factor;
            }
        }
    }
}
