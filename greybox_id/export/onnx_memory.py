"""The step of a map with memory as an ONNX graph: a window is one array, not twenty columns.

What windows look at is computed for a whole window at once, (batch, memory), so that the graph has hundreds of nodes;
written out sample by sample it would have thousands, and runtimes take a minute to load that.
"""

from __future__ import annotations

from .memory_equations import MemoryEquations
from .onnx_graph import Builder, columns, translated


def step_of(equations: MemoryEquations) -> Builder:
    """(x, u, p) -> x_next, of one set of parameters."""
    builder, trace = Builder(), equations.trace
    given = columns(builder, "p", [1] * len(equations.parameters))
    p = _all_parameters(builder, equations, given)
    u = columns(builder, "u", [1] * len(equations.inputs))
    now, actuators, past = _split(builder, equations)
    newest = [own[0] for own in now]
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
    """Those that p holds from there, the others as numbers."""
    left, chosen = iter(given), {parameter.name for parameter in equations.chosen}
    return [
        next(left) if parameter.name in chosen else builder.constant(value)
        for parameter in equations.model.parameters
        for value in parameter.array.ravel().tolist()
    ]


def _split(builder: Builder, equations: MemoryEquations) -> tuple[list[list[str]], list[str], list[list[str]]]:
    """Predictions of each output, newest first; actuators; the past of each input, none where it is not held."""
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
    """An input over the longest window, its oldest sample held before; nothing looks there."""
    missing = memory - 1 - past
    if not missing:
        return name
    return builder.add("Gather", name, builder.numbers(*[max(0, k - missing) for k in range(memory)]), axis=1)
