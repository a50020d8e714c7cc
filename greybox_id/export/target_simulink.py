"""Target `simulink`: parameters and covariance as .mat, the exported C behind an idnlgrey model and an S-function.

Sources: MATLAB's documentation of idnlgrey, whose files are [dx, y] = file(t, x, u, p1, ..., pN, auxiliary), of the C
MEX interface and of level-2 C S-functions; the MAT-file format of version 5.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.io import savemat

from ..base.version import __version__
from .c.motion import MotionC
from .c.naming import constant
from .equations import entries
from .origin import KeyOrigin
from .quoting import c_comment, matlab_comment, matlab_text
from .subject import Subject

HEAD = 116
"""Bytes of text at the beginning of a MAT-file; a time stands there, which would make every file another one."""
REMEMBERED = 4096
"""Commands that the S-function remembers."""


def files(subject: Subject) -> Mapping[str, bytes]:
    """Name of file -> content. Raises `BadInput` for what is no model of motion."""
    name, e = subject.name, subject.equations
    title = f"{subject.model.about} ({subject.model.name}), from {subject.source or 'Python'}, greybox-id {__version__}"
    unused = ("step_jacobian", "step_by_p", "ode_jacobian", "output_jacobian")
    written = MotionC(name, e, c_comment(f"{name}: {title}."), REMEMBERED, unused)
    texts = {
        f"{name}.h": written.header,
        f"{name}.c": written.source,
        f"{name}_mex.c": _filled(_MEX, subject, title),
        f"{name}_sfun.c": _filled(_LATE if e.delayed else _PLAIN, subject, title),
        f"{name}_build.m": _filled(_BUILD, subject, title),
        f"{name}_idnlgrey.m": _idnlgrey(subject, title),
    }
    return {file: text.encode() for file, text in texts.items()} | {f"{name}.mat": _mat(subject, title)}


def cautions(subject: Subject) -> list[str]:
    """Sentences on what these files do not hold."""
    e, one = subject.equations, []
    if e.delayed:
        late = ", ".join(e.delayed)
        one.append(f"idnlgrey knows no delay of {late}: hand in the command that acts; the S-function has the delay.")
    if e.late:
        late = ", ".join(e.late)
        one.append(f"Neither idnlgrey nor the S-function reads {late} late: put a delay behind the outputs.")
    if subject.fit is None or subject.fit.covariance is None:
        one.append("The covariance of the parameters is not known and is NaN in the .mat file.")
    return one


def origins(subject: Subject) -> list[KeyOrigin]:
    """What is behind each field of the .mat file's parameters."""
    return [
        KeyOrigin(f"{subject.name}.mat", f"{subject.name}.parameters.{item.name}", float(value), behind=item.name)
        for item, value in zip(subject.equations.parameters, subject.equations.values, strict=True)
    ]


def _mat(subject: Subject, title: str) -> bytes:
    e = subject.equations
    held: dict[str, Any] = {
        "about": title,
        "model": subject.model.name,
        "parameters": {_field(parameter.name): float(v) for parameter, v in zip(e.parameters, e.values, strict=True)},
        "covariance": _covariance(subject),
        "names": _cells(parameter.name for parameter in e.parameters),
        "units": _cells(parameter.unit for parameter in e.parameters),
        "values": e.values.reshape(-1, 1),
        "states": _cells(state.name for state in e.states),
        "inputs": _cells(item.name for item in e.inputs),
        "outputs": _cells(output.name for output in e.outputs),
        "effects": _cells(subject.model.effects),
    }
    opened: Any = io.BytesIO()
    savemat(opened, {subject.name: held}, long_field_names=True)
    content: bytes = opened.getvalue()
    return f"MATLAB 5.0 MAT-file, written by greybox-id {__version__}".ljust(HEAD)[:HEAD].encode() + content[HEAD:]


def _field(name: str) -> str:
    """A parameter's name as that of a field: entries of arrays lose their brackets."""
    return name.replace("[", "_").replace(",", "_").replace("]", "")


def _cells(texts: Any) -> np.ndarray[Any, Any]:
    listed = list(texts)
    cells = np.empty((len(listed), 1), dtype=object)
    cells[:, 0] = listed
    return cells


def _covariance(subject: Subject) -> np.ndarray[Any, Any]:
    """Of the parameters that can be changed, in their order; NaN where it is not known."""
    e = subject.equations
    if subject.fit is None or subject.fit.covariance is None:
        return np.full((len(e.values), len(e.values)), np.nan)
    known = [entry.name for parameter in subject.fit.model.parameters for entry in entries(parameter)]
    rows = [known.index(parameter.name) if parameter.name in known else -1 for parameter in e.parameters]
    padded = np.pad(np.asarray(subject.fit.covariance, dtype=float), (0, 1), constant_values=np.nan)
    return padded[np.ix_(rows, rows)]


def _filled(template: str, subject: Subject, title: str) -> str:
    e, value = subject.equations, subject.name
    sizes = {letters: constant(value, letters) for letters in ("NX", "NU", "NP", "NY")}
    text = template.replace("TITLE", c_comment(title) if template is not _BUILD else matlab_comment(title))
    for letters, name in sizes.items():
        text = text.replace(f"@{letters}@", name)
    call = f"{value}_settled(x, u, {value}_default_parameters, settled); memcpy(x, settled, sizeof settled);"
    start = call if e.settles else ""
    return text.replace("@SETTLE@", start).replace("@NAME@", value)


def _idnlgrey(subject: Subject, title: str) -> str:
    e, current = subject.equations, subject.name
    known = {p.name: p for p in subject.model.parameters}
    lines = []
    for entry, value in zip(e.parameters, e.values.tolist(), strict=True):
        parameter = known.get(entry.name)
        low, high = parameter.bounds if parameter is not None else (-np.inf, np.inf)
        fixed = "true" if parameter is None or parameter.fixed else "false"
        lines.append(
            f"    {matlab_text(entry.name)}, {matlab_text(entry.unit)}, {_number(value)}, {_number(min(low, value))}, "
            f"{_number(max(high, value))}, {fixed}"
        )
    table = "\n".join(lines) if lines else ""
    names = {
        which: ", ".join(matlab_text(entry.name) for entry in held)
        for which, held in (("states", e.states), ("inputs", e.inputs), ("outputs", e.outputs))
    }
    units = {
        which: ", ".join(matlab_text(entry.unit) for entry in held)
        for which, held in (("states", e.states), ("inputs", e.inputs), ("outputs", e.outputs))
    }
    return f"""\
function model = {current}_idnlgrey()
% {matlab_comment(title)}
% An idnlgrey model of {current}_mex; run {current}_build first. System Identification Toolbox.
table = {{ % name, unit, value, minimum, maximum, held
{table}
}};
fields = {{'Name', 'Unit', 'Value', 'Minimum', 'Maximum', 'Fixed'}};
parameters = cell2struct(table, fields, 2);
order = [{len(e.outputs)} {len(e.inputs)} {len(e.states)}];
model = idnlgrey('{current}_mex', order, parameters, zeros({len(e.states)}, 1), 0);
model.StateName = {{{names["states"]}}};
model.StateUnit = {{{units["states"]}}};
model.InputName = {{{names["inputs"]}}};
model.InputUnit = {{{units["inputs"]}}};
model.OutputName = {{{names["outputs"]}}};
model.OutputUnit = {{{units["outputs"]}}};
end
"""


def _number(value: float) -> str:
    """As MATLAB has it."""
    return repr(float(value)).replace("inf", "Inf").replace("nan", "NaN")


_BUILD = """\
function @NAME@_build()
% TITLE
% Compiles the MEX file for @NAME@_idnlgrey and the S-function for Simulink.
mex @NAME@_mex.c @NAME@.c
mex @NAME@_sfun.c @NAME@.c
end
"""

_MEX = """\
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
"""

_HEAD = """\
/* TITLE
   A level-2 S-function: @NU@ inputs, @NY@ outputs, discrete at the sample time that is its first parameter, s; its
   second is the state at the start, of @NX@ numbers, or []. */

#define S_FUNCTION_NAME @NAME@_sfun
#define S_FUNCTION_LEVEL 2

#include "simstruc.h"

#include "@NAME@.h"

#include <string.h>

static void mdlInitializeSizes(SimStruct *S)
{
    ssSetNumSFcnParams(S, 2);
    if (ssGetNumSFcnParams(S) != ssGetSFcnParamsCount(S)) {
        return;
    }
    ssSetNumContStates(S, 0);
    ssSetNumDiscStates(S, @NX@);
    if (!ssSetNumInputPorts(S, 1)) {
        return;
    }
    ssSetInputPortWidth(S, 0, @NU@);
    ssSetInputPortRequiredContiguous(S, 0, true);
    ssSetInputPortDirectFeedThrough(S, 0, 1);
    if (!ssSetNumOutputPorts(S, 1)) {
        return;
    }
    ssSetOutputPortWidth(S, 0, @NY@);
    ssSetNumSampleTimes(S, 1);
"""

_MIDDLE = """\
}

static void mdlInitializeSampleTimes(SimStruct *S)
{
    ssSetSampleTime(S, 0, mxGetScalar(ssGetSFcnParam(S, 0)));
    ssSetOffsetTime(S, 0, 0.0);
}

#define MDL_INITIALIZE_CONDITIONS
static void mdlInitializeConditions(SimStruct *S)
{
    double *x = ssGetRealDiscStates(S), u[@NU@ + 1] = {0.0}, settled[@NX@];
    const mxArray *start = ssGetSFcnParam(S, 1);
    memset(x, 0, @NX@ * sizeof *x);
    (void)u;
    (void)settled;
    if (mxGetNumberOfElements(start) == @NX@) {
        memcpy(x, mxGetPr(start), @NX@ * sizeof *x);
    } else {
        @SETTLE@
    }
"""

_END = """\
static void mdlTerminate(SimStruct *S)
{
    (void)S;
}

#ifdef MATLAB_MEX_FILE
#include "simulink.c"
#else
#include "cg_sfun.h"
#endif
"""

_PLAIN = (
    _HEAD
    + _MIDDLE
    + """\
}

static void mdlOutputs(SimStruct *S, int_T tid)
{
    (void)tid;
    @NAME@_output(ssGetRealDiscStates(S), (const double *)ssGetInputPortSignal(S, 0), @NAME@_default_parameters,
        (double *)ssGetOutputPortSignal(S, 0));
}

#define MDL_UPDATE
static void mdlUpdate(SimStruct *S, int_T tid)
{
    double *x = ssGetRealDiscStates(S);
    (void)tid;
    @NAME@_step(x, (const double *)ssGetInputPortSignal(S, 0), @NAME@_default_parameters,
        mxGetScalar(ssGetSFcnParam(S, 0)), x);
}

"""
    + _END
)

_LATE = (
    _HEAD
    + """\
    ssSetNumDWork(S, 1);
    ssSetDWorkWidth(S, 0, (int_T)((sizeof(@NAME@_commands) + sizeof(double) - 1) / sizeof(double)));
    ssSetDWorkDataType(S, 0, SS_DOUBLE);
"""
    + _MIDDLE
    + """\
    ((@NAME@_commands *)ssGetDWork(S, 0))->count = 0; /* begins with the first command */
}

/* the line of commands with the one that holds now; a time that was there already is overwritten */
static const @NAME@_commands *pushed(SimStruct *S)
{
    @NAME@_commands *line = (@NAME@_commands *)ssGetDWork(S, 0);
    const double *u = (const double *)ssGetInputPortSignal(S, 0);
    if (line->count == 0) {
        @NAME@_commands_start(line, u);
    }
    if (@NAME@_commands_push(line, ssGetT(S), u) != 0) {
        const size_t held = sizeof line->u / sizeof *line->u;
        memcpy(line->u[(line->count - 1) % held], u, @NU@ * sizeof *u);
    }
    return line;
}

static void mdlOutputs(SimStruct *S, int_T tid)
{
    double u[@NU@ + 1] = {0.0};
    (void)tid;
    (void)@NAME@_commands_acting(pushed(S), @NAME@_default_parameters, ssGetT(S) + 1e-9, u);
    @NAME@_output(ssGetRealDiscStates(S), u, @NAME@_default_parameters, (double *)ssGetOutputPortSignal(S, 0));
}

#define MDL_UPDATE
static void mdlUpdate(SimStruct *S, int_T tid)
{
    double *x = ssGetRealDiscStates(S);
    const double dt = mxGetScalar(ssGetSFcnParam(S, 0));
    (void)tid;
    if (@NAME@_step_late(pushed(S), x, @NAME@_default_parameters, ssGetT(S), dt, x) != 0) {
        ssSetErrorStatus(S, "@NAME@: more commands than are remembered lie within the delay; take longer samples.");
    }
}

"""
    + _END
)
