/* @TITLE@
   [dx, y] = @_mex(t, x, u, p1, ..., pN, auxiliary), as idnlgrey calls it. */

#include "mex.h"

#include "@.h"

#include <string.h>

void mexFunction(int nlhs, mxArray *plhs[], int nrhs, const mxArray *prhs[])
{
    double x[$_NX], u[$_NU + 1] = {0.0}, p[$_NP + 1];
    int k;
    if (nrhs < 3 + $_NP || mxGetNumberOfElements(prhs[1]) != $_NX || mxGetNumberOfElements(prhs[2]) != $_NU) {
        mexErrMsgTxt("@_mex(t, x, u, p1, ..., pN): sizes of x, u or the number of parameters do not fit.");
        return;
    }
    memcpy(x, mxGetPr(prhs[1]), sizeof x);
    memcpy(u, mxGetPr(prhs[2]), $_NU * sizeof *u);
    p[$_NP] = 0.0;
    for (k = 0; k < $_NP; k++) {
        p[k] = mxGetScalar(prhs[3 + k]);
    }
    plhs[0] = mxCreateDoubleMatrix($_NX, 1, mxREAL);
    @_ode(x, u, p, mxGetPr(plhs[0]));
    if (nlhs > 1) {
        plhs[1] = mxCreateDoubleMatrix($_NY, 1, mxREAL);
        @_output(x, u, p, mxGetPr(plhs[1]));
    }
}
