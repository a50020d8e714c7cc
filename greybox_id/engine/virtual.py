"""The kernel's loops in CasADi's virtual machine and numpy: for models without a compiler, and for little work."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from ..base.shorthands import Array

BLOCK = 128
"""Most lanes that one mapped function evaluates."""


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
