"""The kernel's loops in CasADi's virtual machine and numpy: without a compiler, and for little work.

CasADi functions are evaluated on numpy's memory, without copying through DM.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cached_property
from typing import Any

import casadi as cs
import numpy as np
from numpy.typing import NDArray

from ..base.shorthands import Array


class VirtualMachine:
    """Integrates trajectories and their sensitivities; the methods take the kernel's arguments.

    Parameters
    ----------
    step, output : (z, s, p) -> z_next; y, dense.
    step_by, output_by : the same with its derivatives by z and by p.
    """

    def __init__(self, step: cs.Function, output: cs.Function, step_by: cs.Function, output_by: cs.Function) -> None:
        self._step, self._output = _Rows(step), _Rows(output)
        self._step_by, self._output_by = _Rows(step_by), _Rows(output_by)

    def simulate(self, z0: Array, s: Array, p: Array, reads: NDArray[np.bool_]) -> tuple[Array, Array]:
        """States at the segments' starts and at the end, and the readings."""
        lanes, segments, states = *s.shape[:2], z0.shape[1]
        z_all = np.empty((lanes, segments + 1, states))
        y_all = np.empty((lanes, reads.sum(), self._output.sizes[0][1]))
        for item, count in _blocks(lanes):
            z, s_own, p_own = z0[item], np.ascontiguousarray(s[item].swapaxes(0, 1)), p[item]
            real, reading = item[:count], 0
            for k in range(segments):
                z_all[real, k] = z[:count]
                if reads[k]:
                    y_all[real, reading] = self._output(z, s_own[k], p_own)[0][:count, 0]
                    reading += 1
                z = self._step(z, s_own[k], p_own)[0][:, 0]
            z_all[real, segments] = z[:count]
        return z_all, y_all

    def linearise(
        self, z0: Array, s: Array, p: Array, reads: NDArray[np.bool_], columns: NDArray[np.intp]
    ) -> tuple[Array, Array, Array, Array]:
        """States at the end and the readings, each with its derivative."""
        lanes, segments, states = *s.shape[:2], z0.shape[1]
        outputs, width = self._output.sizes[0][1], states + len(columns)
        z_end, Z_end = np.empty((lanes, states)), np.empty((lanes, states, width))
        y_all, Y_all = np.empty((lanes, reads.sum(), outputs)), np.empty((lanes, reads.sum(), outputs, width))
        for item, count in _blocks(lanes):
            z, s_own, p_own = z0[item], np.ascontiguousarray(s[item].swapaxes(0, 1)), p[item]
            Z = np.tile(np.eye(states, width), (len(item), 1, 1))
            real, reading = item[:count], 0
            for k in range(segments):
                if reads[k]:
                    y, C, D = self._output_by(z, s_own[k], p_own)
                    Y = _chained(C, D, Z, columns)
                    y_all[real, reading], Y_all[real, reading] = y[:count, 0], Y[:count]
                    reading += 1
                following, A, B = self._step_by(z, s_own[k], p_own)
                z, Z = following[:, 0], _chained(A, B, Z, columns)
            z_end[real], Z_end[real] = z[:count], Z[:count]
        return z_end, Z_end, y_all, Y_all


def on_arrays(function: cs.Function) -> Callable[..., list[Array]]:
    """A function of dense matrices, evaluated on numpy arrays without copying them to CasADi and back.

    CasADi stores matrices by columns, numpy by rows: arguments and results are transposed.
    """
    memory, evaluate = function.buffer()
    shapes = [function.size_out(k)[::-1] for k in range(function.n_out())]

    def called(*arguments: Array) -> list[Array]:
        results = [np.empty(shape) for shape in shapes]
        contiguous = [np.ascontiguousarray(argument, dtype=float) for argument in arguments]
        for place, arrays in ((memory.set_arg, contiguous), (memory.set_res, results)):
            for k, array in enumerate(arrays):
                if array.size:
                    place(k, array.data)
        evaluate()
        return results

    return called


class _Rows:
    """A function evaluated for many rows: (rows, size) arrays in, (rows, columns, size) arrays out, transposed."""

    def __init__(self, function: cs.Function) -> None:
        self.function = function
        self.sizes = [(function.size2_out(k), function.size1_out(k)) for k in range(function.n_out())]
        self._mapped: dict[int, Callable[..., list[Array]]] = {}

    def __call__(self, *arguments: Array) -> list[Array]:
        rows = len(arguments[0])
        if rows not in self._mapped:
            self._mapped[rows] = on_arrays(self.function.map(rows))
        results = self._mapped[rows](*arguments)
        return [result.reshape(rows, *size) for result, size in zip(results, self.sizes, strict=True)]


def _chained(by_z: Array, by_p: Array, Z: Array, columns: NDArray[np.intp]) -> Array:
    """Chain rule, by_z Z + [0 | by_p], for a function of z and p; both factors are passed transposed."""
    with np.errstate(all="ignore"):  # a diverging trajectory shows in its values
        result: Array = by_z.swapaxes(1, 2) @ Z
    result[:, :, Z.shape[1] :] += by_p[:, columns].swapaxes(1, 2)
    return result


def _blocks(lanes: int) -> Iterator[tuple[NDArray[np.intp], int]]:
    """Lanes that are evaluated together, padded to a power of two with the last one: few mapped functions serve all."""
    for start in range(0, lanes, BLOCK):
        count = min(BLOCK, lanes - start)
        size = 1 << (count - 1).bit_length()
        yield start + np.minimum(np.arange(size), count - 1), count


SIDE_BY_SIDE = 4096
"""Samples per pass through the operations: intermediate values stay in the processor's cache, numpy's calls are few.
With 2400 samples, gradients of the MS-NN networks take a quarter less than with 1024 per pass."""
BLOCK = 128
"""Samples per evaluation of a mapped function. One map serves runs of every length: making one takes CasADi
milliseconds, as long as evaluating a run."""


NUMPY: dict[int, Callable[..., Any]] = {
    cs.OP_ASSIGN: lambda a: a, cs.OP_LIFT: lambda a, _: a,
    cs.OP_ADD: np.add, cs.OP_SUB: np.subtract, cs.OP_MUL: np.multiply, cs.OP_DIV: np.divide, cs.OP_NEG: np.negative,
    cs.OP_SQ: np.square, cs.OP_TWICE: lambda a: a + a, cs.OP_INV: lambda a: np.divide(1.0, a),
    cs.OP_LT: lambda a, b: np.less(a, b) + 0.0, cs.OP_LE: lambda a, b: np.less_equal(a, b) + 0.0,
    cs.OP_EQ: lambda a, b: np.equal(a, b) + 0.0, cs.OP_NE: lambda a, b: np.not_equal(a, b) + 0.0,
    cs.OP_NOT: lambda a: np.logical_not(a) + 0.0, cs.OP_AND: lambda a, b: np.logical_and(a, b) + 0.0,
    cs.OP_OR: lambda a, b: np.logical_or(a, b) + 0.0, cs.OP_IF_ELSE_ZERO: lambda a, b: np.where(a, b, 0.0),
    cs.OP_FABS: np.abs, cs.OP_COPYSIGN: np.copysign, cs.OP_FMIN: np.fmin, cs.OP_FMAX: np.fmax, cs.OP_SIGN: np.sign,
    cs.OP_SQRT: np.sqrt, cs.OP_FLOOR: np.floor, cs.OP_CEIL: np.ceil,
    cs.OP_SIN: np.sin, cs.OP_COS: np.cos, cs.OP_TAN: np.tan, cs.OP_ASIN: np.arcsin, cs.OP_ACOS: np.arccos,
    cs.OP_ATAN: np.arctan, cs.OP_SINH: np.sinh, cs.OP_COSH: np.cosh, cs.OP_TANH: np.tanh, cs.OP_ASINH: np.arcsinh,
    cs.OP_ACOSH: np.arccosh, cs.OP_ATANH: np.arctanh, cs.OP_EXP: np.exp, cs.OP_LOG: np.log, cs.OP_EXPM1: np.expm1,
    cs.OP_LOG1P: np.log1p, cs.OP_POW: np.power, cs.OP_CONSTPOW: np.power, cs.OP_ATAN2: np.arctan2,
    cs.OP_HYPOT: np.hypot, cs.OP_FMOD: np.fmod,
}  # fmt: skip
"""CasADi's operations in numpy. A comparison returns a number, since conditions are multiplied and added."""
_FROM_ARGUMENT, _TO_RESULT, _CONSTANT = (object() for _ in range(3))


class SampledFunction:
    """A CasADi function with dense vector arguments and one dense vector result, evaluated row by row.

    `function(a, b)` takes (n, size) arrays, one row per sample, or (size,) arrays for all samples, and returns
    (n, outputs). Many samples are evaluated in numpy, one operation at a time; few in CasADi's `map`, on numpy's
    memory, which is some twenty times faster than through `DM`.
    """

    def __init__(self, function: cs.Function) -> None:
        self.function = function
        self.outputs = int(function.numel_out(0))
        self._mapped: dict[tuple[int, ...], tuple[cs.Function, Any, Callable[[], None]]] = {}

    def __call__(self, *arguments: Array) -> Array:
        """Evaluate row by row: (n, outputs)."""
        samples = max((len(a) for a in arguments if a.ndim == 2), default=0)
        if samples == 0 and self.outputs:  # no argument varies from sample to sample
            return call(self.function, *arguments).reshape(1, self.outputs)
        if samples > BLOCK and self.outputs and self._side_by_side is not None:
            result = np.empty((self.outputs, samples)).T  # stored by outputs, as the operations produce them
            for start in range(0, samples, SIDE_BY_SIDE):
                rows = slice(start, start + SIDE_BY_SIDE)
                self._side_by_side([a[rows] if a.ndim == 2 else a for a in arguments], result[rows])
            return result
        result = np.empty((max(samples, 1), self.outputs))
        if self.outputs == 0:
            return result
        memory, run = self._buffer(tuple(k for k, a in enumerate(arguments) if a.ndim == 1))
        contiguous = [np.ascontiguousarray(a, dtype=float) for a in arguments]
        for k, array in enumerate(contiguous):
            if array.ndim == 1 and array.size:
                memory.set_arg(k, array.data)
        for start in range(0, samples, BLOCK):
            rows = slice(start, min(start + BLOCK, samples))
            full = rows.stop - start == BLOCK
            target = result[rows] if full else np.empty((BLOCK, self.outputs))
            arguments_of_block = [_padded(a[rows]) if a.ndim == 2 and not full else a[rows] for a in contiguous]
            for k, array in enumerate(contiguous):
                if array.ndim == 2 and array.size:
                    memory.set_arg(k, arguments_of_block[k].data)
            memory.set_res(0, target.data)
            run()
            if not full:
                result[rows] = target[: rows.stop - start]
        return result

    @cached_property
    def _side_by_side(self) -> _Operations | None:
        return _Operations.of(self.function)

    def _buffer(self, shared: tuple[int, ...]) -> tuple[Any, Callable[[], None]]:
        if shared not in self._mapped:
            mapped = self.function.map(f"{self.function.name()}_block", "serial", BLOCK, list(shared), [])
            self._mapped[shared] = (mapped, *mapped.buffer())
        return self._mapped[shared][1:]


class _Operations:
    """The operations of an SX function with one dense result, each evaluated for many samples at once."""

    def __init__(self, work: int, steps: list[tuple[int, Any, list[Any]]]) -> None:
        self._work, self._steps = work, steps

    @staticmethod
    def of(function: cs.Function) -> _Operations | None:
        """Those of a function; None if it has others than those in `NUMPY`."""
        if not function.is_a("SXFunction"):
            return None
        steps: list[tuple[int, Any, list[Any]]] = []
        for k in range(function.n_instructions()):
            op, targets = function.instruction_id(k), function.instruction_output(k)
            if op == cs.OP_CONST:
                steps.append((targets[0], _CONSTANT, [function.instruction_constant(k)]))
                continue
            sources = function.instruction_input(k)
            if op == cs.OP_OUTPUT:
                steps.append((targets[1], _TO_RESULT, sources))
            elif op == cs.OP_INPUT:
                steps.append((targets[0], _FROM_ARGUMENT, sources))
            elif op in NUMPY:
                steps.append((targets[0], NUMPY[op], sources))
            else:
                return None
        return _Operations(int(function.sz_w()), steps)

    def __call__(self, arguments: Sequence[Array], result: Array) -> None:
        """Evaluate into `result`, (n, outputs)."""
        columns = [np.ascontiguousarray(np.asarray(a, dtype=float).T) for a in arguments]
        work: list[Any] = [0.0] * self._work
        with np.errstate(all="ignore"):
            for target, operation, sources in self._steps:
                if operation is _FROM_ARGUMENT:
                    work[target] = columns[sources[0]][sources[1]]
                elif operation is _TO_RESULT:
                    result[:, target] = work[sources[0]]
                elif operation is _CONSTANT:
                    work[target] = sources[0]
                elif len(sources) == 2:
                    work[target] = operation(work[sources[0]], work[sources[1]])
                else:
                    work[target] = operation(*[work[k] for k in sources])


def call(function: cs.Function, *arguments: Array) -> Array:
    """The first result of a function, flat, as `on_arrays` evaluates it."""
    return on_arrays(function)(*arguments)[0].ravel()


def _padded(rows: Array) -> Array:
    """The last rows of a run, padded to a block with copies of the last one."""
    return np.concatenate([rows, np.repeat(rows[-1:], BLOCK - len(rows), axis=0)])
