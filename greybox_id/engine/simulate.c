void simulate(ptrdiff_t lanes, ptrdiff_t segments, ptrdiff_t readings, ptrdiff_t kept, ptrdiff_t apart,
    const double *z0, const double *s, const double *p, const unsigned char *reads, const unsigned char *keeps,
    double *z_out, double *y_out)
{
    for (ptrdiff_t first = 0; first < lanes; first += W) {
        ptrdiff_t row[W], reading = 0, at = 0;
        const int real = rows(row, first, lanes);
        v z[NZ], next[NZ], now[NS + 1], q[NP + 1], w[VALUE_KEPT + 1], y[NY + 1];
        gather(z, NZ, z0, NZ, row);
        gather(q, NP, p, NP, row);
        value_fixed(q, w);
        for (ptrdiff_t k = 0; k < segments; k++) {
            if (keeps[k]) scatter(z, NZ, z_out + at++ * NZ, kept * NZ, row, real);
            gather(now, NS, s + k * NS, apart, row);
            value(z, now, q, w, next, y, reads[k]);
            if (reads[k]) scatter(y, NY, y_out + reading++ * NY, readings * NY, row, real);
            memcpy(z, next, sizeof z);
        }
        if (keeps[segments]) scatter(z, NZ, z_out + at * NZ, kept * NZ, row, real);
    }
}
