/* The derivative of the state, and those of its sensitivities by state and inputs at the beginning:
   by_x S_x, and by_x S_u + by_u. Lengths: S_x $_NX x $_NX, S_u $_NX x $_NU. */
void @_vde_forw(const double *x, const double *S_x, const double *S_u, const double *u,
    const double *p, double *x_dot, double *S_x_dot, double *S_u_dot);
