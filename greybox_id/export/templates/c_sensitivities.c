void @_vde_forw(const double *x, const double *S_x, const double *S_u, const double *u,
    const double *p, double *x_dot, double *S_x_dot, double *S_u_dot)
{
    double by_x[$_NX * $_NX], by_u[$_NX * $_NU];
    int i, j, k;
    @_ode_jacobian(x, u, p, x_dot, by_x, by_u);
    for (j = 0; j < $_NX; j++) {
        for (i = 0; i < $_NX; i++) {
            double sum = 0.0;
            for (k = 0; k < $_NX; k++) {
                sum += by_x[i + $_NX * k] * S_x[k + $_NX * j];
            }
            S_x_dot[i + $_NX * j] = sum;
        }
    }
    for (j = 0; j < $_NU; j++) {
        for (i = 0; i < $_NX; i++) {
            double sum = by_u[i + $_NX * j];
            for (k = 0; k < $_NX; k++) {
                sum += by_x[i + $_NX * k] * S_u[k + $_NX * j];
            }
            S_u_dot[i + $_NX * j] = sum;
        }
    }
}
