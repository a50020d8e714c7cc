#include <stdlib.h>
#include <stddef.h>
typedef struct { size_t count; double *values; } mxArray;
enum { mxREAL };
static size_t mxGetNumberOfElements(const mxArray *a) { return a->count; }
static double *mxGetPr(const mxArray *a) { return a->values; }
static double mxGetScalar(const mxArray *a) { return a->values[0]; }
