/* @TITLE@
   A level-2 S-function: $_NU inputs, $_NY outputs, discrete at the sample time that is its first parameter, s; its
   second is the state at the start, of $_NX numbers, or []. */

#define S_FUNCTION_NAME @_sfun
#define S_FUNCTION_LEVEL 2

#include "simstruc.h"

#include "@.h"

#include <string.h>

static void mdlInitializeSizes(SimStruct *S)
{
    ssSetNumSFcnParams(S, 2);
    if (ssGetNumSFcnParams(S) != ssGetSFcnParamsCount(S)) {
        return;
    }
    ssSetNumContStates(S, 0);
    ssSetNumDiscStates(S, $_NX);
    if (!ssSetNumInputPorts(S, 1)) {
        return;
    }
    ssSetInputPortWidth(S, 0, $_NU);
    ssSetInputPortRequiredContiguous(S, 0, true);
    ssSetInputPortDirectFeedThrough(S, 0, 1);
    if (!ssSetNumOutputPorts(S, 1)) {
        return;
    }
    ssSetOutputPortWidth(S, 0, $_NY);
    ssSetNumSampleTimes(S, 1);
#if LATE
    ssSetNumDWork(S, 1);
    ssSetDWorkWidth(S, 0, (int_T)((sizeof(@_commands) + sizeof(double) - 1) / sizeof(double)));
    ssSetDWorkDataType(S, 0, SS_DOUBLE);
#endif
}

static void mdlInitializeSampleTimes(SimStruct *S)
{
    ssSetSampleTime(S, 0, mxGetScalar(ssGetSFcnParam(S, 0)));
    ssSetOffsetTime(S, 0, 0.0);
}

#define MDL_INITIALIZE_CONDITIONS
static void mdlInitializeConditions(SimStruct *S)
{
    double *x = ssGetRealDiscStates(S), u[$_NU + 1] = {0.0}, settled[$_NX];
    const mxArray *start = ssGetSFcnParam(S, 1);
    memset(x, 0, $_NX * sizeof *x);
    (void)u;
    (void)settled;
    if (mxGetNumberOfElements(start) == $_NX) {
        memcpy(x, mxGetPr(start), $_NX * sizeof *x);
    } else {
        @SETTLE@
    }
#if LATE
    ((@_commands *)ssGetDWork(S, 0))->count = 0; /* begins with the first command */
#endif
}
#if LATE

/* the line of commands with the one that holds now; a time that was there already is overwritten */
static const @_commands *pushed(SimStruct *S)
{
    @_commands *line = (@_commands *)ssGetDWork(S, 0);
    const double *u = (const double *)ssGetInputPortSignal(S, 0);
    if (line->count == 0) {
        @_commands_start(line, u);
    }
    if (@_commands_push(line, ssGetT(S), u) != 0) {
        const size_t held = sizeof line->u / sizeof *line->u;
        memcpy(line->u[(line->count - 1) % held], u, $_NU * sizeof *u);
    }
    return line;
}

static void mdlOutputs(SimStruct *S, int_T tid)
{
    double u[$_NU + 1] = {0.0};
    (void)tid;
    (void)@_commands_acting(pushed(S), @_default_parameters, ssGetT(S) + 1e-9, u);
    @_output(ssGetRealDiscStates(S), u, @_default_parameters, (double *)ssGetOutputPortSignal(S, 0));
}

#define MDL_UPDATE
static void mdlUpdate(SimStruct *S, int_T tid)
{
    double *x = ssGetRealDiscStates(S);
    const double dt = mxGetScalar(ssGetSFcnParam(S, 0));
    (void)tid;
    if (@_step_late(pushed(S), x, @_default_parameters, ssGetT(S), dt, x) != 0) {
        ssSetErrorStatus(S, "@: more commands than are remembered lie within the delay; take longer samples.");
    }
}

#else

static void mdlOutputs(SimStruct *S, int_T tid)
{
    (void)tid;
    @_output(ssGetRealDiscStates(S), (const double *)ssGetInputPortSignal(S, 0), @_default_parameters,
        (double *)ssGetOutputPortSignal(S, 0));
}

#define MDL_UPDATE
static void mdlUpdate(SimStruct *S, int_T tid)
{
    double *x = ssGetRealDiscStates(S);
    (void)tid;
    @_step(x, (const double *)ssGetInputPortSignal(S, 0), @_default_parameters,
        mxGetScalar(ssGetSFcnParam(S, 0)), x);
}

#endif
static void mdlTerminate(SimStruct *S)
{
    (void)S;
}

#ifdef MATLAB_MEX_FILE
#include "simulink.c"
#else
#include "cg_sfun.h"
#endif
