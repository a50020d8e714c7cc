"""Evaluating CasADi functions on numpy's own memory, without copying through DM."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as cs
import numpy as np

from ..base.shorthands import Array

BLOCK = 128
"""Samples a mapped function evaluates at a time. One map serves runs of every length: making one takes CasADi
milliseconds, as long as evaluating a run."""


class SampledFunction:
    """A CasADi function with dense vector arguments and one dense vector result, evaluated row by row.

    `function(a, b)` takes (n, size) arrays, one row per sample, or (size,) arrays that hold for all samples,
    and returns (n, outputs). CasADi's `map` loops over the samples; the buffers are numpy's own memory, which
    is some twenty times faster than going through `DM`.
    """

    def __init__(self, function: cs.Function) -> None:
        self.function = function
        self.outputs = int(function.numel_out(0))
        self._mapped: dict[tuple[int, ...], tuple[cs.Function, Any, Callable[[], None]]] = {}

    def __call__(self, *arguments: Array) -> Array:
        """Evaluate row by row: (n, outputs)."""
        samples = max((len(a) for a in arguments if a.ndim == 2), default=0)
        if samples == 0 and self.outputs:  # nothing varies from sample to sample
            return call(self.function, *arguments).reshape(1, self.outputs)
        result = np.empty((max(samples, 1), self.outputs))
        if self.outputs == 0:
            return result
        memory, run = self._buffer(tuple(k for k, a in enumerate(arguments) if a.ndim == 1))
        held = [np.ascontiguousarray(a, dtype=float) for a in arguments]
        for k, array in enumerate(held):
            if array.ndim == 1 and array.size:
                memory.set_arg(k, array.data)
        for start in range(0, samples, BLOCK):
            rows = slice(start, min(start + BLOCK, samples))
            whole = rows.stop - start == BLOCK
            target = result[rows] if whole else np.empty((BLOCK, self.outputs))
            given = [_padded(a[rows]) if a.ndim == 2 and not whole else a[rows] for a in held]
            for k, array in enumerate(held):
                if array.ndim == 2 and array.size:
                    memory.set_arg(k, given[k].data)
            memory.set_res(0, target.data)
            run()
            if not whole:
                result[rows] = target[: rows.stop - start]
        return result

    def _buffer(self, shared: tuple[int, ...]) -> tuple[Any, Callable[[], None]]:
        if shared not in self._mapped:
            mapped = self.function.map(f"{self.function.name()}_block", "serial", BLOCK, list(shared), [])
            self._mapped[shared] = (mapped, *mapped.buffer())
        return self._mapped[shared][1:]


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


def _padded(rows: Array) -> Array:
    """The last rows of a run, filled up to a block with copies of the last one."""
    return np.concatenate([rows, np.repeat(rows[-1:], BLOCK - len(rows), axis=0)])
