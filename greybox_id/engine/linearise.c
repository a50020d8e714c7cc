static inline void add(const v *J, ptrdiff_t n, const short *row, const short *column, const ptrdiff_t *moving,
    v *to, ptrdiff_t columns)
{
    for (ptrdiff_t j = 0; j < n; j++)
        if (moving[column[j]] >= 0) to[row[j] * columns + moving[column[j]]] += J[j];
}

/* loads each operand once: compilers would load it again for every product, and loads limit this loop */
#if defined __x86_64__
#define IN_REGISTERS(a, b, c) __asm__("" : "+v"(a), "+v"(b), "+v"(c));
#else
#define IN_REGISTERS(a, b, c)
#endif
#define TILE 3
#define BATCH (1 + 12 / (NY + 1))
/* adds products of columns over n rows to the lower triangle from row `from` on, in tiles of nine in registers */
static void accumulate(const v *rows, ptrdiff_t n, v *H, ptrdiff_t wide, ptrdiff_t from)
{
    for (ptrdiff_t i = from; i < wide; i += TILE)
        for (ptrdiff_t j = 0; j <= i; j += TILE) {
            v *const top = H + i * wide + j, *const middle = top + wide, *const low = middle + wide;
            v a = top[0], b = top[1], c = top[2], d = middle[0], e = middle[1], f = middle[2];
            v g = low[0], h = low[1], k = low[2];
            for (ptrdiff_t row = 0; row < n; row++) {
                const v *const left = rows + row * wide + i, *const right = rows + row * wide + j;
                v x = left[0], y = left[1], z = left[2], p = right[0], q = right[1], r = right[2];
                IN_REGISTERS(x, y, z) IN_REGISTERS(p, q, r)
                a = fused(x, p, a); b = fused(x, q, b); c = fused(x, r, c);
                d = fused(y, p, d); e = fused(y, q, e); f = fused(y, r, f);
                g = fused(z, p, g); h = fused(z, q, h); k = fused(z, r, k);
            }
            top[0] = a; top[1] = b; top[2] = c; middle[0] = d; middle[1] = e; middle[2] = f;
            low[0] = g; low[1] = h; low[2] = k;
        }
}

/* weighted residuals of one reading and their weights, reduced in the tails of a robust loss */
static void weigh(const v *y, const v *target, v *w, v *r, double robust)
{
    for (int i = 0; i < NY; i++) {
        r[i] = choose(w[i] > splat(0), (y[i] - target[i]) * w[i], splat(0));
        if (robust < INFINITY) {
            const v size = v_fabs(r[i]), tail = choose(size > splat(robust), v_sqrt(splat(robust) / size), splat(1));
            r[i] = r[i] * tail;
            w[i] = w[i] * tail;
        }
    }
}

void linearise(ptrdiff_t lanes, ptrdiff_t segments, ptrdiff_t readings, ptrdiff_t columns, ptrdiff_t apart,
    double robust, const ptrdiff_t *moving, const double *z0, const double *s, const double *p,
    const unsigned char *reads, const unsigned char *taken, const ptrdiff_t *place, const double *seed, double *z_out, double *Z_out, double *y_out, double *Y_out,
    const double *target, const double *weight, const double *given, double *H_out, double *scratch)
{
    /* derivatives with the residuals as last column: the last row of their product is J'r */
    const ptrdiff_t wide = (columns + TILE) / TILE * TILE, packed = columns * (columns + 1) / 2;
    v *J = (v *)(((size_t)scratch + sizeof(v) - 1) / sizeof(v) * sizeof(v)), *H = J + BATCH * NY * wide;
    if (H_out) memset(J, 0, BATCH * NY * wide * sizeof(v));
    for (ptrdiff_t first = 0; first < lanes; first += W) {
        ptrdiff_t row[W], next_place[W], reading = 0, batch = 0;
        const int real = rows(row, first, lanes);
        v z[NZ], next[NZ], now[AHEAD(NS) * NS + 1], q[NP + 1], w[SLOPE_KEPT + 1], y[NY + 1], r[NY + 1];
        v targets[AHEAD(NY) * NY + 1], weights[AHEAD(NY) * NY + 1];
        v A[NA + 1], B[NB + 1], C[NC + 1], D[ND + 1], Z[NZ * (NZ + NP)], Y[NY * (NZ + NP) + 1];
        gather(z, NZ, z0, NZ, row);
        gather(q, NP, p, NP, row);
        gather(Z, NZ * columns, seed, NZ * columns, row);
        slope_fixed(q, w);
        if (taken) LANES next_place[l] = place[row[l]];
        if (H_out) memset(H, 0, wide * wide * sizeof(v));
        for (ptrdiff_t k = 0; k < segments; k++) {
            slope(z, ahead(now, NS, s, apart, k, segments, row), q, w, next, y, A, B, C, D, reads[k], moving);
            if (reads[k]) {
                C_times(C, Z, Y, columns);
                add(D, ND, D_ROW, D_COLUMN, moving, Y, columns);
                if (H_out) {
                    const v *const t = ahead(targets, NY, target, readings * NY, reading, readings, row);
                    v *const counts = ahead(weights, NY, weight, readings * NY, reading, readings, row);
                    weigh(y, t, counts, r, robust);
                    if (given) gather(r, NY, given + reading * NY, readings * NY, row);
                    for (int i = 0; i < NY; i++) {
                        v *const to = J + (batch * NY + i) * wide;
                        for (ptrdiff_t c = 0; c < columns; c++) to[c] = Y[i * columns + c] * counts[i];
                        to[columns] = r[i];
                    }
                    if (++batch == BATCH) {
                        accumulate(J, batch * NY, H, wide, given ? wide - TILE : 0);
                        batch = 0;
                    }
                } else if (taken) { /* each lane's readings, one after the other */
                    int all = 1;
                    for (int l = 0; l < real; l++) all &= taken[row[l] * segments + k];
                    if (all) {
                        scatter(y, NY, y_out, NY, next_place, real);
                        scatter(Y, NY * columns, Y_out, NY * columns, next_place, real);
                    }
                    for (int l = 0; l < real; l++) {
                        if (!taken[row[l] * segments + k]) continue;
                        double *const y_to = y_out + next_place[l] * NY;
                        double *const Y_to = Y_out + next_place[l]++ * NY * columns;
                        for (int i = 0; i < NY && !all; i++) y_to[i] = y[i][l];
                        for (ptrdiff_t i = 0; i < NY * columns && !all; i++) Y_to[i] = Y[i][l];
                    }
                } else {
                    scatter(y, NY, y_out + reading * NY, readings * NY, row, real);
                    scatter(Y, NY * columns, Y_out + reading * NY * columns, readings * NY * columns, row, real);
                }
                reading++;
            }
            A_times(A, Z, Z, columns);
            add(B, NB, B_ROW, B_COLUMN, moving, Z, columns);
            memcpy(z, next, sizeof z);
        }
        scatter(z, NZ, z_out, NZ, row, real);
        scatter(Z, NZ * columns, Z_out, NZ * columns, row, real);
        if (H_out) {
            accumulate(J, batch * NY, H, wide, given ? wide - TILE : 0);
            for (ptrdiff_t c = 1; c <= columns; c++)
                memmove(H + c * (c + 1) / 2, H + c * wide, (c + 1) * sizeof(v));
            scatter(H, packed + columns, H_out, packed + columns, row, real);
        }
    }
}
