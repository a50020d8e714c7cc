"""CasADi functions and steps of models with memory as ONNX graphs in double precision.

The graph works on columns, (batch, 1) each, so that a batch of points is evaluated at once. ONNX defines its operators
for doubles, but runtimes do not implement all: onnxruntime lacks Tan and Atan, and ONNX has no Atan2 and no Expm1.
These are composed of other operators, accurate to a few units in the last place. The window of a model with memory is
one array, (batch, memory), not twenty columns: written sample by sample the graph would have thousands of nodes, which
runtimes take a minute to load.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import pi
from typing import Any

import casadi as cs
import onnx
from onnx import TensorProto, helper

from ..base.errors import BadInput
from .memory_equations import MemoryEquations

IR_VERSION = 8
_DOUBLE, _FLOAT, _BOOL = TensorProto.DOUBLE, TensorProto.FLOAT, TensorProto.BOOL


class Builder:
    """Builds nodes and constants; methods return the name of the node's result."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self._initializers: dict[str, onnx.TensorProto] = {}

    def add(self, operator: str, *sources: str, **attributes: Any) -> str:
        """Add a node with one result; returns its name."""
        return self.several(operator, 1, *sources, **attributes)[0]

    def several(self, operator: str, results: int, *sources: str, **attributes: Any) -> list[str]:
        """Add a node with several results; returns their names."""
        names = [f"v{len(self.nodes)}_{k}" for k in range(results)]
        self.nodes.append(helper.make_node(operator, list(sources), names, **attributes))
        return names

    def name(self, result: str, operator: str, *sources: str, **attributes: Any) -> None:
        """Add a node whose result gets a given name."""
        self.nodes.append(helper.make_node(operator, list(sources), [result], **attributes))

    def constant(self, value: float) -> str:
        """Name of a constant; equal numbers share one."""
        return self._held(value.hex(), _DOUBLE, [1, 1], [value])

    def numbers(self, *whole: int) -> str:
        """Name of a constant list of integers; equal lists share one."""
        return self._held(str(whole), TensorProto.INT64, [len(whole)], list(whole))

    def model(
        self,
        name: str,
        opset: int,
        inputs: Mapping[str, tuple[str | int, int]],
        outputs: Mapping[str, tuple[str | int, int]],
        defaults: Mapping[str, Sequence[float]],
        about: Mapping[str, str],
    ) -> onnx.ModelProto:
        """The checked ONNX model of the graph built so far.

        Parameters
        ----------
        name : of the graph.
        opset : version of ONNX's operators.
        inputs, outputs : name -> shape.
        defaults : input -> default entries.
        about : the model's metadata.
        """
        given, made = (
            [helper.make_tensor_value_info(name, _DOUBLE, shape) for name, shape in named.items()]
            for named in (inputs, outputs)
        )
        held = [helper.make_tensor(name, _DOUBLE, [1, len(values)], values) for name, values in defaults.items()]
        graph = helper.make_graph(self.nodes, name, given, made, [*self._initializers.values(), *held])
        operators = helper.make_opsetid("", opset)
        model = helper.make_model(graph, opset_imports=[operators], ir_version=IR_VERSION, producer_name="greybox-id")
        helper.set_model_props(model, dict(about))
        onnx.checker.check_model(model, full_check=True)
        return model

    def _held(self, key: str, kind: int, shape: list[int], values: list[Any]) -> str:
        if key not in self._initializers:
            self._initializers[key] = helper.make_tensor(f"c{len(self._initializers)}", kind, shape, values)
        return self._initializers[key].name


def graph_of(function: cs.Function) -> Builder:
    """Graph of a CasADi function of dense SX columns with one dense result; names of inputs and result are kept."""
    builder = Builder()
    names = function.name_in()
    places = [columns(builder, name, [1] * function.numel_in(k)) for k, name in enumerate(names)]
    (results,) = translated(builder, function, places)
    rows = builder.add("Slice", builder.add("Shape", names[0]), builder.numbers(0), builder.numbers(1))
    size = builder.add("Concat", rows, builder.numbers(1), axis=0)
    whole = [builder.add("Expand", name, size) for name in results]  # also if it is constant over the batch
    builder.name(function.name_out()[0], "Concat", *whole, axis=1)
    return builder


def columns(builder: Builder, name: str, widths: Sequence[int]) -> list[str]:
    """An array (batch, n) split into pieces of these widths."""
    if len(widths) < 2:
        return [name] * len(widths)
    return builder.several("Split", len(widths), name, builder.numbers(*widths), axis=1)


def translated(builder: Builder, function: cs.Function, places: Sequence[Sequence[str]]) -> list[list[str]]:
    """A CasADi function applied to arguments given by the names of their entries; returns the names of results'
    entries.

    Raises `BadInput` for an operation that is not in `OPERATIONS`.
    """
    slots: dict[int, str] = {}  # CasADi reuses the entries of its work vector
    results = [[""] * function.numel_out(k) for k in range(function.n_out())]
    for k in range(function.n_instructions()):
        op, sources, targets = function.instruction_id(k), function.instruction_input(k), function.instruction_output(k)
        if op == cs.OP_OUTPUT:
            results[targets[0]][targets[1]] = slots[sources[0]]
        elif op == cs.OP_INPUT:
            slots[targets[0]] = places[sources[0]][sources[1]]
        elif op == cs.OP_CONST:
            slots[targets[0]] = builder.constant(float(function.instruction_constant(k)))
        elif op in OPERATIONS:
            slots[targets[0]] = OPERATIONS[op](builder, *[slots[j] for j in sources])
        else:
            raise BadInput(f"The model uses CasADi's operation {op}, which cannot be written as ONNX.")
    return results


def step_of(equations: MemoryEquations) -> Builder:
    """(x, u, p) -> x_next, for a single set of parameters."""
    builder, trace = Builder(), equations.trace
    given = columns(builder, "p", [1] * len(equations.parameters))
    p = _all_parameters(builder, equations, given)
    u = columns(builder, "u", [1] * len(equations.inputs))
    now, actuators, past = _split(builder, equations)
    newest = [item[0] for item in now]
    seen, moved = translated(builder, equations.seen, [newest, actuators, u, given])
    longer = [
        builder.add("Concat", *held, value, axis=1) if held else value for held, value in zip(past, seen, strict=True)
    ]
    counts = equations.looked_back.values()
    windows = [_reaching(builder, name, k, trace.memory) for name, k in zip(longer, counts, strict=True)]
    (signals,) = translated(builder, trace.stage.function, [windows, p])
    (weights,) = translated(builder, trace.weights.function, [p])
    h = []
    for tap, signal in enumerate(trace.tap_signal):
        row = builder.add("Concat", *weights[tap * trace.memory : (tap + 1) * trace.memory], axis=1)
        weighted = builder.add("Mul", signals[signal], row)
        h.append(builder.add("ReduceSum", weighted, builder.numbers(1), keepdims=1))
    (y,) = translated(builder, trace.head.function, [h, seen, p])
    predicted = [name for k, held in enumerate(now) for name in (y[k], *held[:-1])]
    kept = [
        builder.add("Slice", name, builder.numbers(1), builder.numbers(count + 1), builder.numbers(1))
        for name, count in zip(longer, counts, strict=True)
        if count
    ]
    builder.name("x_next", "Concat", *predicted, *moved, *kept, axis=1)
    return builder


def _all_parameters(builder: Builder, equations: MemoryEquations, given: list[str]) -> list[str]:
    """All parameters: those in p from the input, the others as constants."""
    left, chosen = iter(given), {parameter.name for parameter in equations.chosen}
    return [
        next(left) if parameter.name in chosen else builder.constant(value)
        for parameter in equations.model.parameters
        for value in parameter.array.ravel().tolist()
    ]


def _split(builder: Builder, equations: MemoryEquations) -> tuple[list[list[str]], list[str], list[list[str]]]:
    """Predictions of each output, newest first; actuators; the past of each input, empty if none is held."""
    counts = [count for count in equations.looked_back.values() if count]
    predicted, actuators = sum(equations.held.values()), len(equations.model.actuators)
    pieces = iter(columns(builder, "x", [*[1] * (predicted + actuators), *counts]))
    now = [[next(pieces) for _ in range(count)] for count in equations.held.values()]
    return (
        now,
        [next(pieces) for _ in range(actuators)],
        [[next(pieces)] if count else [] for count in equations.looked_back.values()],
    )


def _reaching(builder: Builder, name: str, past: int, memory: int) -> str:
    """An input extended to the longest window by repeating its oldest sample, whose weights are zero there."""
    missing = memory - 1 - past
    if not missing:
        return name
    return builder.add("Gather", name, builder.numbers(*[max(0, k - missing) for k in range(memory)]), axis=1)


Row = Callable[..., str]
"""(builder, names of the operands) -> name of the result."""


def _plain(operator: str, **attributes: Any) -> Row:
    return lambda to, *operands: to.add(operator, *operands, **attributes)


def _test(operator: str, operands: Callable[..., tuple[str, ...]] = lambda to, *item: item) -> Row:
    """A comparison; CasADi represents true as one."""
    return lambda to, *item: to.add("Cast", to.add(operator, *operands(to, *item)), to=_DOUBLE)


def _logic(operator: str) -> Row:
    return _test(operator, lambda to, *item: tuple(to.add("Cast", name, to=_BOOL) for name in item))


def _if_else_zero(to: Builder, condition: str, value: str) -> str:
    return to.add("Where", to.add("Cast", condition, to=_BOOL), value, to.constant(0.0))


def _tan(to: Builder, x: str) -> str:
    return to.add("Div", to.add("Sin", x), to.add("Cos", x))


def _atan(to: Builder, x: str) -> str:
    """Atan in single precision, and the exact rest: atan(x) = a + atan((x cos a - sin a) / (cos a + x sin a))."""
    x = to.add("Max", to.add("Min", x, to.constant(1e300)), to.constant(-1e300))  # avoids infinity times zero
    a = to.add("Cast", to.add("Atan", to.add("Cast", x, to=_FLOAT)), to=_DOUBLE)
    c, s = to.add("Cos", a), to.add("Sin", a)
    across = to.add("Sub", to.add("Mul", x, c), s)
    along = to.add("Add", c, to.add("Mul", x, s))
    return to.add("Add", a, to.add("Div", across, along))  # the third power of the rest is below 1e-18


def _atan2(to: Builder, y: str, x: str) -> str:
    """The angle of the smaller over the larger magnitude, mapped to its octant."""
    high, wide = to.add("Abs", y), to.add("Abs", x)
    larger = to.add("Max", high, wide)
    nowhere = to.add("Equal", larger, to.constant(0.0))
    divisor = to.add("Where", nowhere, to.constant(1.0), larger)
    angle = _atan(to, to.add("Div", to.add("Min", high, wide), divisor))
    angle = to.add("Where", to.add("Greater", high, wide), to.add("Sub", to.constant(pi / 2), angle), angle)
    backwards = to.add("Less", x, to.constant(0.0))
    angle = to.add("Where", backwards, to.add("Sub", to.constant(pi), angle), angle)
    return to.add("Where", to.add("Less", y, to.constant(0.0)), to.add("Neg", angle), angle)


def _expm1(to: Builder, x: str) -> str:
    """2 t / (1 - t) with t = tanh(x / 2), or exp(x) - 1 where the former cancels."""
    t = to.add("Tanh", to.add("Mul", x, to.constant(0.5)))
    one = to.constant(1.0)
    near = to.add("Div", to.add("Add", t, t), to.add("Sub", one, t))
    far = to.add("Sub", to.add("Exp", x), one)
    return to.add("Where", to.add("Less", x, to.constant(0.5)), near, far)


OPERATIONS: Mapping[int, Row] = {
    cs.OP_ASSIGN: _plain("Identity"),
    cs.OP_ADD: _plain("Add"),
    cs.OP_SUB: _plain("Sub"),
    cs.OP_MUL: _plain("Mul"),
    cs.OP_DIV: _plain("Div"),
    cs.OP_NEG: _plain("Neg"),
    cs.OP_INV: _plain("Reciprocal"),
    cs.OP_SQ: lambda to, x: to.add("Mul", x, x),
    cs.OP_TWICE: lambda to, x: to.add("Add", x, x),
    cs.OP_FABS: _plain("Abs"),
    cs.OP_FMIN: _plain("Min"),
    cs.OP_FMAX: _plain("Max"),
    cs.OP_FLOOR: _plain("Floor"),
    cs.OP_CEIL: _plain("Ceil"),
    cs.OP_SIGN: _plain("Sign"),
    cs.OP_SQRT: _plain("Sqrt"),
    cs.OP_POW: _plain("Pow"),
    cs.OP_CONSTPOW: _plain("Pow"),
    cs.OP_EXP: _plain("Exp"),
    cs.OP_LOG: _plain("Log"),
    cs.OP_SIN: _plain("Sin"),
    cs.OP_COS: _plain("Cos"),
    cs.OP_TANH: _plain("Tanh"),
    cs.OP_TAN: _tan,
    cs.OP_ATAN: _atan,
    cs.OP_ATAN2: _atan2,
    cs.OP_EXPM1: _expm1,
    cs.OP_LT: _test("Less"),
    cs.OP_LE: _test("LessOrEqual"),
    cs.OP_EQ: _test("Equal"),
    cs.OP_NE: lambda to, a, b: to.add("Cast", to.add("Not", to.add("Equal", a, b)), to=_DOUBLE),
    cs.OP_NOT: _logic("Not"),
    cs.OP_AND: _logic("And"),
    cs.OP_OR: _logic("Or"),
    cs.OP_IF_ELSE_ZERO: _if_else_zero,
}
"""CasADi operation -> ONNX operators."""
