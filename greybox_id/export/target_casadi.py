"""Target `casadi`: serialised functions, and a Python module that loads them and requires only CasADi."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from math import isfinite

import casadi as cs

from ..base.version import __version__
from .c.naming import docstring
from .equations import Equations, Named
from .memory_equations import MemoryEquations, equations_of
from .memory_equations import shifts_left_out as cautions
from .subject import Subject
from .template import filled

__all__ = ["cautions", "files"]


def files(subject: Subject) -> Mapping[str, bytes]:
    """Name of file -> content. Raises `BadInput` for a hybrid."""
    equations = equations_of(subject)
    functions = functions_of(equations)
    result = {file_of(subject, name): function.serialize() for name, function in functions.items()}
    result[f"{subject.name}.py"] = _module(subject, equations, functions)
    return {name: text.encode() for name, text in result.items()}


def functions_of(equations: Equations | MemoryEquations) -> dict[str, cs.Function]:
    """Name -> function, including Jacobians."""
    step, output = equations.step, equations.output
    result = {"step": step, "output": output}
    if isinstance(equations, MemoryEquations):
        result["push"] = equations.push
    else:
        result |= {"ode": equations.ode, "delays": equations.delays, "latencies": equations.latencies}
        result["ode_jacobians"] = _jacobians(equations.ode)
    return result | {"step_jacobians": _jacobians(step), "output_jacobians": _jacobians(output)}


def file_of(subject: Subject, function: str) -> str:
    """Name of the file with a serialised function."""
    return f"{subject.name}_{function}.casadi"


def literals(equations: Equations | MemoryEquations) -> str:
    """Meaning of the entries of x, u, p and y, and the default parameters, as Python code."""
    lists = {"STATES": equations.states, "INPUTS": equations.inputs, "OUTPUTS": equations.outputs}
    lists["PARAMETERS"] = equations.parameters
    text = "".join(f"{name} = (\n{_entries(named)})\n" for name, named in lists.items())
    numbers = ", ".join(_number(float(value)) for value in equations.values)
    values = textwrap.fill(numbers, 118, initial_indent="    ", subsequent_indent="    ")
    return f"{text}P = cs.DM([\n{values}\n])\n"


def _number(value: float) -> str:
    return repr(value) if isfinite(value) else f"{'-' * (value < 0)}cs.inf"


def _jacobians(function: cs.Function) -> cs.Function:
    """Jacobians of a function by x and by u, with the same arguments."""
    arguments = dict(zip(function.name_in(), function.sx_in(), strict=True))
    value = function(*arguments.values())
    by = [cs.jacobian(value, arguments[name]) for name in ("x", "u")]
    result = function.name_out()[0]
    names = [f"d{result}_dx", f"d{result}_du"]
    return cs.Function(
        f"{function.name()}_jacobians", list(arguments.values()), by, list(arguments), names, {"cse": True}
    )


def _entries(named: Sequence[Named]) -> str:
    return "".join(f"    Named({item.name!r}, {item.unit!r}, {item.about!r}),\n" for item in named)


def _module(subject: Subject, equations: Equations | MemoryEquations, functions: Mapping[str, cs.Function]) -> str:
    signatures = "\n".join(f"    {_signature(name, function)}" for name, function in functions.items())
    loaded = "".join(f"{name} = _load({name!r})\n" for name in functions)
    return filled(
        "casadi_module.py.in", subject.name, ABOUT=docstring(subject.model.about), SOURCE=docstring(subject.source),
        VERSION=__version__, CASADI=cs.CasadiMeta.version(), SIGNATURES=signatures, TIME=_time(equations),
        ENTRIES=literals(equations) + _timing(equations), LOADED=loaded,
    )  # fmt: skip


def _signature(name: str, function: cs.Function) -> str:
    return f"{name}({', '.join(function.name_in())}) -> {', '.join(function.name_out())}"


def _time(equations: Equations | MemoryEquations) -> str:
    if isinstance(equations, MemoryEquations):
        return (
            "A step is SAMPLE_TIME seconds long. x is a window of the past: start with x = 0 and fill it with\n"
            "push(x, u, y, p), once for each sample read, oldest first; y is what was read a sample after u. From\n"
            "then on step(x, u, p) predicts and appends its own predictions to the window."
        )
    shifted = (*equations.delayed, *equations.late)
    stated = f" Those of this model: {', '.join(shifted)}." if shifted else ""
    return (
        "Inputs are held over a step. Delays of inputs (DELAYED) and latencies of readings (LATE) are not in these\n"
        f"functions; delays(p) and latencies(p) give them in s. Pass the command that acts.{stated}"
    )


def _timing(equations: Equations | MemoryEquations) -> str:
    if isinstance(equations, MemoryEquations):
        return f"SAMPLE_TIME = {equations.sample_time!r}\n"
    return f"DELAYED = {tuple(equations.delayed)!r}\nLATE = {tuple(equations.late)!r}\n"
