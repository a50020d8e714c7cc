#include "mex_types.h"
#include <stdbool.h>
typedef int int_T;
enum { SS_DOUBLE };
typedef struct {
    mxArray parameters[2];
    int states, inputs, outputs, work;
    double period, time, x[64], u[16], y[16], held[200000];
    const char *error;
} SimStruct;
#define ssSetNumSFcnParams(S, n) ((void)(S))
#define ssGetNumSFcnParams(S) ((void)(S), 2)
#define ssGetSFcnParamsCount(S) ((void)(S), 2)
#define ssSetNumContStates(S, n) ((void)(S))
#define ssSetNumDiscStates(S, n) ((S)->states = (n))
#define ssSetNumInputPorts(S, n) ((void)(S), 1)
#define ssSetInputPortWidth(S, p, n) ((S)->inputs = (n))
#define ssSetInputPortRequiredContiguous(S, p, n) ((void)(S))
#define ssSetInputPortDirectFeedThrough(S, p, n) ((void)(S))
#define ssSetNumOutputPorts(S, n) ((void)(S), 1)
#define ssSetOutputPortWidth(S, p, n) ((S)->outputs = (n))
#define ssSetNumSampleTimes(S, n) ((void)(S))
#define ssSetNumDWork(S, n) ((void)(S))
#define ssSetDWorkWidth(S, k, n) ((S)->work = (n))
#define ssSetDWorkDataType(S, k, t) ((void)(S))
#define ssGetDWork(S, k) ((void *)(S)->held)
#define ssSetSampleTime(S, k, t) ((S)->period = (t))
#define ssSetOffsetTime(S, k, t) ((void)(S))
#define ssGetSFcnParam(S, k) (&(S)->parameters[k])
#define ssGetRealDiscStates(S) ((S)->x)
#define ssGetInputPortSignal(S, k) ((const void *)(S)->u)
#define ssGetOutputPortSignal(S, k) ((void *)(S)->y)
#define ssGetT(S) ((S)->time)
#define ssSetErrorStatus(S, t) ((S)->error = (t))
