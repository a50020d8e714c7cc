"""Target `onnx`: the step and the outputs as ONNX graphs in double precision, evaluated for a batch of points."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import casadi as cs

from ..base.errors import BadInput
from .equations import Equations, Named
from .memory_equations import MemoryEquations, equations_of
from .memory_equations import shifts_left_out as cautions
from .subject import Subject

__all__ = ["ABOUT", "cautions", "files"]

OPSET = 17
ABOUT = {"opset": OPSET, "precision": "float64"}


def files(subject: Subject) -> Mapping[str, bytes]:
    """Name of file -> content. Raises `BadInput` for a hybrid, and if the package onnx is not installed."""
    try:
        from . import onnx_graph
    except ImportError as error:
        raise BadInput("The target onnx needs the package onnx; pip install 'greybox-id[onnx]'.") from error
    equations = equations_of(subject)
    about = {name: str(value) for name, value in ABOUT.items()} | _described(subject, equations)
    if isinstance(equations, MemoryEquations):
        step = onnx_graph.step_of(equations)
    else:
        step = onnx_graph.graph_of(equations.step)
    graphs = {"step": (step, equations.step), "output": (onnx_graph.graph_of(equations.output), equations.output)}
    defaults = {"p": equations.values.tolist()} if len(equations.values) else {}
    return {
        f"{subject.name}_{name}.onnx": builder.model(
            name, OPSET, *_shapes(function), defaults, about
        ).SerializeToString()
        for name, (builder, function) in graphs.items()
    }


_Shapes = dict[str, tuple[str | int, int]]


def _shapes(function: cs.Function) -> tuple[_Shapes, _Shapes]:
    """Shapes of the arguments and of the result. Parameters and step length are common to the batch."""
    sets: dict[str, str | int] = {"x": "batch", "u": "batch", "p": 1, "dt": 1}
    return (
        {name: (sets[name], function.numel_in(k)) for k, name in enumerate(function.name_in()) if function.numel_in(k)},
        {function.name_out()[0]: ("batch", function.numel_out(0))},
    )


def _described(subject: Subject, equations: Equations | MemoryEquations) -> dict[str, str]:
    time = (
        {"sample_time_s": repr(equations.sample_time)}
        if isinstance(equations, MemoryEquations)
        else {"delayed": json.dumps(equations.delayed), "late": json.dumps(equations.late)}
    )
    return {
        "model": subject.model.name,
        "source": subject.source,
        "x": _listed(equations.states),
        "u": _listed(equations.inputs),
        "p": _listed(equations.parameters),
        "y": _listed(equations.outputs),
        **time,
    }


def _listed(entries: Sequence[Named]) -> str:
    """Names and units, as a JSON list of pairs."""
    return json.dumps([(entry.name, entry.unit) for entry in entries], ensure_ascii=False)
