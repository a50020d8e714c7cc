/* one trajectory from row to row; in complete rows, given states are reset to their values in z */
void follow(ptrdiff_t rows, const ptrdiff_t *begins, const double *s, const double *p, const unsigned char *complete,
    const unsigned char *given, double *z_along)
{
    const ptrdiff_t row[W] = {0};
    v z[NZ], next[NZ], now[NS + 1], q[NP + 1], w[VALUE_KEPT + 1], y[NY + 1];
    int all = 1;
    for (int i = 0; i < NZ; i++) all &= given[i];
    gather(z, NZ, z_along, NZ, row);
    gather(q, NP, p, NP, row);
    value_fixed(q, w);
    for (ptrdiff_t r = 1; r < rows; r++) {
        double *const here = z_along + r * NZ;
        for (ptrdiff_t k = complete[r] && all ? begins[r] : begins[r - 1]; k < begins[r]; k++) {
            gather(now, NS, s + k * NS, 0, row);
            value(z, now, q, w, next, y, 0);
            memcpy(z, next, sizeof z);
        }
        for (int i = 0; i < NZ; i++)
            if (complete[r] && given[i]) z[i] = splat(here[i]);
            else here[i] = z[i][0];
    }
}
