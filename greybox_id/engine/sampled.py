"""Evaluating a CasADi function of one sample at many samples, without copying through DM."""

from __future__ import annotations

import casadi as cs
import numpy as np

from ..parameter import Array


class SampledFunction:
    """A CasADi function with dense vector arguments and one dense vector result, evaluated row by row.

    `function(a, b)` takes (n, size) arrays, one row per sample, or (size,) arrays that hold for all samples,
    and returns (n, outputs). CasADi's `map` loops over the samples; the buffers are numpy's own memory, which
    is some twenty times faster than going through `DM`.
    """

    def __init__(self, function: cs.Function) -> None:
        self.function = function
        self.outputs = int(function.numel_out(0))
        self._mapped: dict[tuple[int, tuple[int, ...]], cs.Function] = {}

    def __call__(self, *arguments: Array) -> Array:
        """Evaluate row by row: (n, outputs)."""
        samples = max((len(a) for a in arguments if a.ndim == 2), default=1)
        if self.outputs == 0:
            return np.empty((samples, 0))
        shared = tuple(k for k, a in enumerate(arguments) if a.ndim == 1)
        key = (samples, shared)
        if key not in self._mapped:
            name = f"{self.function.name()}_{samples}"
            self._mapped[key] = self.function.map(name, "serial", samples, list(shared), [])
        return call(self._mapped[key], *arguments).reshape(samples, self.outputs)


def call(function: cs.Function, *arguments: Array) -> Array:
    """A CasADi function of dense arguments on numpy's own memory: its first result, flat, column by column.

    An argument of k columns is handed over as a (k, rows) array: CasADi stores column by column what numpy stores
    row by row.
    """
    result = np.empty(function.numel_out(0))
    memory, run = function.buffer()
    held = [np.ascontiguousarray(a, dtype=float) for a in arguments]
    for k, array in enumerate(held):
        if array.size:
            memory.set_arg(k, array.data)
    memory.set_res(0, result.data)
    run()
    return result
