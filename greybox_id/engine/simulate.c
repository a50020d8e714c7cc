/* whether states are within `near` of others, in all lanes */
static int alike(const v *z, const double *others, ptrdiff_t stride, const ptrdiff_t *row, const double *near)
{
    v other[NZ];
    m same = splat(0) == splat(0);
    int all = 1;
    gather(other, NZ, others, stride, row);
    for (int i = 0; i < NZ; i++) same &= v_fabs(z[i] - other[i]) <= splat(near[i]);
    LANES all &= same[l] != 0;
    return all;
}

void simulate(ptrdiff_t lanes, ptrdiff_t segments, ptrdiff_t readings, ptrdiff_t kept, ptrdiff_t apart,
    const ptrdiff_t *which, const double *z0, const double *s, const double *p, const unsigned char *reads,
    const unsigned char *keeps, const double *near, double *z_out, double *y_out)
{
    for (ptrdiff_t first = 0; first < lanes; first += W) {
        ptrdiff_t row[W], reading = 0, at = 0, k = 0;
        const int real = rows(row, first, lanes);
        v z[NZ], next[NZ], now[NS + 1], q[NP + 1], w[VALUE_KEPT + 1], y[NY + 1];
        LANES row[l] = which[row[l]];
        gather(z, NZ, z0, NZ, row);
        gather(q, NP, p, NP, row);
        value_fixed(q, w);
        for (; k < segments; k++) {
            if (keeps[k]) {
                if (near && alike(z, z_out + at * NZ, kept * NZ, row, near)) break; /* the rest is known */
                scatter(z, NZ, z_out + at++ * NZ, kept * NZ, row, real);
            }
            gather(now, NS, s + k * NS, apart, row);
            value(z, now, q, w, next, y, reads[k]);
            if (reads[k]) scatter(y, NY, y_out + reading++ * NY, readings * NY, row, real);
            memcpy(z, next, sizeof z);
        }
        if (k == segments && keeps[segments]) scatter(z, NZ, z_out + at * NZ, kept * NZ, row, real);
    }
}
