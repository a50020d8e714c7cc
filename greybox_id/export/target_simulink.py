"""Target `simulink`: parameters and covariance as .mat; an idnlgrey model and an S-function that use the exported C.

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
from .c.naming import c_comment, matlab_comment, matlab_text
from .equations import entries
from .subject import KeyOrigin, Subject
from .template import filled

HEAD = 116
"""Bytes of text at the beginning of a MAT-file, which are overwritten: they contain the time, so files would differ."""
REMEMBERED = 4096
"""Number of commands that the S-function stores."""


def files(subject: Subject) -> Mapping[str, bytes]:
    """Name of file -> content. Raises `BadInput` for models other than motion models."""
    name, e = subject.name, subject.equations
    title = f"{subject.model.about} ({subject.model.name}), from {subject.source or 'Python'}, greybox-id {__version__}"
    unused = ("step_jacobian", "step_by_p", "ode_jacobian", "output_jacobian")
    written = MotionC(name, e, c_comment(f"{name}: {title}."), REMEMBERED, unused)
    texts = {
        f"{name}.h": written.header,
        f"{name}.c": written.source,
        f"{name}_mex.c": _filled("simulink_mex.c", subject, title),
        f"{name}_sfun.c": _filled("simulink_sfun.c", subject, title),
        f"{name}_build.m": _filled("simulink_build.m", subject, title),
        f"{name}_idnlgrey.m": _idnlgrey(subject, title),
    }
    return {file: text.encode() for file, text in texts.items()} | {f"{name}.mat": _mat(subject, title)}


def cautions(subject: Subject) -> list[str]:
    """Sentences on what these files lack."""
    e, one = subject.equations, []
    if e.delayed:
        late = ", ".join(e.delayed)
        one.append(
            f"The idnlgrey model lacks the delay of {late}: pass it the delayed command. The S-function has the delay."
        )
    if e.late:
        late = ", ".join(e.late)
        one.append(f"Neither idnlgrey nor the S-function has the latency of {late}: put a delay behind the outputs.")
    if subject.fit is None or subject.fit.covariance is None:
        one.append("The covariance of the parameters is not known and is NaN in the .mat file.")
    return one


def origins(subject: Subject) -> list[KeyOrigin]:
    """Origin of each field of the .mat file's parameters."""
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
    """A parameter's name as a field name: brackets of array entries are replaced."""
    return name.replace("[", "_").replace(",", "_").replace("]", "")


def _cells(texts: Any) -> np.ndarray[Any, Any]:
    listed = list(texts)
    cells = np.empty((len(listed), 1), dtype=object)
    cells[:, 0] = listed
    return cells


def _covariance(subject: Subject) -> np.ndarray[Any, Any]:
    """Covariance of the adjustable parameters, in their order; NaN if not known."""
    e = subject.equations
    if subject.fit is None or subject.fit.covariance is None:
        return np.full((len(e.values), len(e.values)), np.nan)
    fitted = [entry.name for parameter in subject.fit.model.parameters for entry in entries(parameter)]
    rows = [fitted.index(parameter.name) if parameter.name in fitted else -1 for parameter in e.parameters]
    padded = np.pad(np.asarray(subject.fit.covariance, dtype=float), (0, 1), constant_values=np.nan)
    return padded[np.ix_(rows, rows)]


def _filled(template: str, subject: Subject, title: str) -> str:
    e, name = subject.equations, subject.name
    call = f"{name}_settled(x, u, {name}_default_parameters, settled); memcpy(x, settled, sizeof settled);"
    about = c_comment(title) if template.endswith(".c") else matlab_comment(title)
    return filled(template, name, TITLE=about, LATE=bool(e.delayed), SETTLE=call if e.settles else "")


def _idnlgrey(subject: Subject, title: str) -> str:
    e, current = subject.equations, subject.name
    by_name = {p.name: p for p in subject.model.parameters}
    lines = []
    for entry, value in zip(e.parameters, e.values.tolist(), strict=True):
        parameter = by_name.get(entry.name)
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
table = {{ % name, unit, value, minimum, maximum, fixed
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
    """A number in MATLAB's notation."""
    return repr(float(value)).replace("inf", "Inf").replace("nan", "NaN")
