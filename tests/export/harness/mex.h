#include "mex_types.h"
extern const char *told;
static void mexErrMsgTxt(const char *text) { told = text; }
static mxArray *mxCreateDoubleMatrix(size_t m, size_t n, int kind)
{
    mxArray *made = malloc(sizeof *made);
    (void)kind;
    made->count = m * n;
    made->values = calloc(m * n, sizeof(double));
    return made;
}
