"""The equations of a map with memory: outputs one sample on, windows of past inputs, what windows look at."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace

import casadi as cs
import numpy as np

from ...memory_model import MemoryModel
from ...model import Symbol as Casadi
from .expression import Equation, Expression, Symbol, Window
from .symbolic import Reader

NEXT = "next"
"""Mark of an output one sample after the newest input."""


def memory_equations(model: MemoryModel) -> tuple[Equation, ...]:
    """The model's equations, and what follows from its outputs where it runs on its own."""
    known: dict[str, Expression] = {}
    read = Reader(known)

    def named(symbol: Expression, key: str) -> Casadi:
        known[key] = symbol
        return cs.SX.sym(key)

    def past(signal: Casadi, weights: Sequence[Casadi]) -> Casadi:
        window = Window(_weights(weights, known), read(cs.SX(signal)), len(weights))
        return named(window, f"window {len(known)}")

    u = SimpleNamespace(**{name: named(Symbol(name), name) for name in model.inputs})
    p = SimpleNamespace()
    for own in model.parameters:
        if own.shape == ():
            setattr(p, own.name, named(Symbol(own.name), own.name))
            continue
        entries = np.empty(own.shape, dtype=object)
        for index in np.ndindex(own.shape):
            entry = tuple(k + 1 for k in index)
            entries[index] = named(Symbol(own.name, entry), f"{own.name}{entry}")
        setattr(p, own.name, entries)
    outputs = model.equations(u, p, past)
    found = [Equation(Symbol(name, mark=NEXT), read(cs.SX(outputs[name]))) for name in model.outputs]
    if model.feedback is not None:
        y = SimpleNamespace(**{name: named(Symbol(name), f"output {name}") for name in model.outputs})
        fed = {name: read(cs.SX(value)) for name, value in model.feedback(y, u).items()}
        found += [Equation(Symbol(name), value) for name, value in fed.items() if value != Symbol(name)]
    return tuple(found)


def _weights(weights: Sequence[Casadi], known: dict[str, Expression]) -> Symbol:
    """The parameter whose last entries they are, without those; a letter where they are something else."""
    found = [known.get(cs.SX(own).name()) if cs.SX(own).is_symbolic() else None for own in weights]
    first = found[0]
    if isinstance(first, Symbol) and first.entry:
        expected = [Symbol(first.name, (*first.entry[:-1], k + 1)) for k in range(len(found))]
        if found == expected:
            return Symbol(first.name, first.entry[:-1])
    return Symbol("g")
