"""The kernel's loops in CasADi's virtual machine and numpy: for models without a compiler, and for little work.

Evaluating CasADi functions on numpy's own memory, without copying through DM.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from ..base.shorthands import Array


class VirtualMachine:
    """Integrates trajectories and their sensitivities; the arguments are the kernel's.

    Parameters
    ----------
    step, output : (z, s, p) -> what they give, dense.
    step_by, output_by : (z, s, p) -> what they give, its derivative by z and that by p.
    """

    def __init__(self, step: cs.Function, output: cs.Function, step_by: cs.Function, output_by: cs.Function) -> None:
        self._step, self._output = _Rows(step), _Rows(output)
        self._step_by, self._output_by = _Rows(step_by), _Rows(output_by)

    def simulate(self, z0: Array, s: Array, p: Array, reads: NDArray[np.bool_]) -> tuple[Array, Array]:
        """States at the segments' starts and the end, and the readings."""
        lanes, segments, states = *s.shape[:2], z0.shape[1]
        z_all = np.empty((lanes, segments + 1, states))
        y_all = np.empty((lanes, reads.sum(), self._output.sizes[0][1]))
        for item, count in _blocks(lanes):
            z, s_own, p_own = z0[item], np.ascontiguousarray(s[item].swapaxes(0, 1)), p[item]
            here, reading = item[:count], 0
            for k in range(segments):
                z_all[here, k] = z[:count]
                if reads[k]:
                    y_all[here, reading] = self._output(z, s_own[k], p_own)[0][:count, 0]
                    reading += 1
                z = self._step(z, s_own[k], p_own)[0][:, 0]
            z_all[here, segments] = z[:count]
        return z_all, y_all

    def linearise(
        self, z0: Array, s: Array, p: Array, reads: NDArray[np.bool_], columns: NDArray[np.intp]
    ) -> tuple[Array, Array, Array, Array]:
        """States at the end and the readings, each with its derivative."""
        lanes, segments, states = *s.shape[:2], z0.shape[1]
        outputs, moved = self._output.sizes[0][1], states + len(columns)
        z_end, Z_end = np.empty((lanes, states)), np.empty((lanes, states, moved))
        y_all, Y_all = np.empty((lanes, reads.sum(), outputs)), np.empty((lanes, reads.sum(), outputs, moved))
        for item, count in _blocks(lanes):
            z, s_own, p_own = z0[item], np.ascontiguousarray(s[item].swapaxes(0, 1)), p[item]
            Z = np.tile(np.eye(states, moved), (len(item), 1, 1))
            here, reading = item[:count], 0
            for k in range(segments):
                if reads[k]:
                    y, C, D = self._output_by(z, s_own[k], p_own)
                    Y = _chained(C, D, Z, columns)
                    y_all[here, reading], Y_all[here, reading] = y[:count, 0], Y[:count]
                    reading += 1
                following, A, B = self._step_by(z, s_own[k], p_own)
                z, Z = following[:, 0], _chained(A, B, Z, columns)
            z_end[here], Z_end[here] = z[:count], Z[:count]
        return z_end, Z_end, y_all, Y_all


class _Rows:
    """A CasADi function evaluated for many rows: (rows, size) arrays in, (rows, columns, size) arrays out.

    The results come as CasADi stores them, column by column: transposed.
    """

    def __init__(self, function: cs.Function) -> None:
        self.function = function
        self.sizes = [(function.size2_out(k), function.size1_out(k)) for k in range(function.n_out())]
        self._mapped: dict[int, tuple[cs.Function, Any, Callable[[], None]]] = {}

    def __call__(self, *arguments: Array) -> list[Array]:
        rows = len(arguments[0])
        if rows not in self._mapped:
            mapped = self.function.map(rows)
            self._mapped[rows] = (mapped, *mapped.buffer())
        _, memory, run = self._mapped[rows]
        results = [np.empty((rows, *size)) for size in self.sizes]
        held = [np.ascontiguousarray(a) for a in arguments]
        for k, array in enumerate(held):
            if array.size:
                memory.set_arg(k, array.data)
        for k, array in enumerate(results):
            if array.size:
                memory.set_res(k, array.data)
        run()
        return results


def _chained(by_z: Array, by_p: Array, Z: Array, columns: NDArray[np.intp]) -> Array:
    """The derivative of what depends on z and p: by_z Z + [0 | by_p]; the factors come transposed."""
    with np.errstate(all="ignore"):  # a trajectory that blows up says so itself
        result: Array = by_z.swapaxes(1, 2) @ Z
    result[:, :, Z.shape[1] :] += by_p[:, columns].swapaxes(1, 2)
    return result


def _blocks(lanes: int) -> Iterator[tuple[NDArray[np.intp], int]]:
    """Which lanes go together, padded with the last one to a power of two: few mapped functions serve all."""
    for start in range(0, lanes, BLOCK):
        count = min(BLOCK, lanes - start)
        size = 1 << (count - 1).bit_length()
        yield start + np.minimum(np.arange(size), count - 1), count


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
