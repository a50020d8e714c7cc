/* TITLE
   [dx, y] = @NAME@_mex(t, x, u, p1, ..., pN, auxiliary), as idnlgrey calls it. */

#include "mex.h"

#include "@NAME@.h"

#include <string.h>

void mexFunction(int nlhs, mxArray *plhs[], int nrhs, const mxArray *prhs[])
{
    double x[@NX@], u[@NU@ + 1] = {0.0}, p[@NP@ + 1];
    int k;
    if (nrhs < 3 + @NP@ || mxGetNumberOfElements(prhs[1]) != @NX@ || mxGetNumberOfElements(prhs[2]) != @NU@) {
        mexErrMsgTxt("@NAME@_mex(t, x, u, p1, ..., pN): sizes of x, u or the number of parameters do not fit.");
        return;
    }
    memcpy(x, mxGetPr(prhs[1]), sizeof x);
    memcpy(u, mxGetPr(prhs[2]), @NU@ * sizeof *u);
    p[@NP@] = 0.0;
    for (k = 0; k < @NP@; k++) {
        p[k] = mxGetScalar(prhs[3 + k]);
    }
    plhs[0] = mxCreateDoubleMatrix(@NX@, 1, mxREAL);
    @NAME@_ode(x, u, p, mxGetPr(plhs[0]));
    if (nlhs > 1) {
        plhs[1] = mxCreateDoubleMatrix(@NY@, 1, mxREAL);
        @NAME@_output(x, u, p, mxGetPr(plhs[1]));
    }
}
