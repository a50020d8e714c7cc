"""Equations of models with memory, windows as sums."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import casadi as cs
import numpy as np

from ...models.memory_model import MemoryModel
from ...models.model import Symbol as Casadi
from .expression import Equation, Expression, Symbol, Window
from .tracing import Reader, traced

NEXT = "next"
"""Mark of an output one sample after the newest input."""


@traced.register(MemoryModel)
def memory_equations(model: MemoryModel) -> tuple[Equation, ...]:
    """The model's equations, and what follows from its outputs where it runs on its own."""
    read = Reader()

    def past(signal: Casadi, weights: Sequence[Casadi]) -> Casadi:
        window = Window(_weights(weights, read.known), read(cs.SX(signal)), len(weights))
        return read.named(window, f"window {len(read.known)}")

    u = SimpleNamespace(**{name: read.named(Symbol(name)) for name in model.inputs})
    p = SimpleNamespace()
    for parameter in model.parameters:
        if parameter.shape == ():
            setattr(p, parameter.name, read.named(Symbol(parameter.name)))
            continue
        entries = np.empty(parameter.shape, dtype=object)
        for index in np.ndindex(parameter.shape):
            entries[index] = read.named(Symbol(parameter.name, tuple(k + 1 for k in index)))
        setattr(p, parameter.name, entries)
    outputs = model.equations(u, p, past)
    result = [Equation(Symbol(name, mark=NEXT), read(cs.SX(outputs[name]))) for name in model.outputs]
    if model.feedback is not None:
        y = SimpleNamespace(**{name: read.named(Symbol(name)) for name in model.outputs})
        fed = {name: read(cs.SX(value)) for name, value in model.feedback(y, u).items()}
        result += [Equation(Symbol(name), value) for name, value in fed.items() if value != Symbol(name)]
    return tuple(result)


def _weights(weights: Sequence[Casadi], known: dict[str, Expression]) -> Symbol:
    """The parameter whose last entries they are, without those; a letter where they are something else."""
    result = [known.get(cs.SX(weight).name()) if cs.SX(weight).is_symbolic() else None for weight in weights]
    first = result[0]
    if isinstance(first, Symbol) and first.entry:
        expected = [Symbol(first.name, (*first.entry[:-1], k + 1)) for k in range(len(result))]
        if result == expected:
            return Symbol(first.name, first.entry[:-1])
    return Symbol("g")
