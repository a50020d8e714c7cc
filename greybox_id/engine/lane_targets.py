"""Targets of simulated readings, lane by lane, and the normal equations of the residuals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ..base.shorthands import Array, Index

HOURS = 1_000_000
"""Readings processed at once, an hour at 100 Hz with three outputs: temporary arrays are no longer than this."""


@dataclass(frozen=True)
class LaneTargets:
    """Targets that the readings of lanes are compared with.

    Attributes
    ----------
    target : (L, R, ny) target of each reading.
    weight : (L, R, ny) factor on each residual; zero drops it.
    robust : Huber threshold, beyond which weighted residuals weigh less; None: least squares.
    """

    target: Array
    weight: Array
    robust: float | None = None

    def misfit(self, y: Array) -> float:
        """Half the sum of squared residuals, linear beyond the Huber threshold."""
        if y.size > HOURS:  # in parts, as temporary arrays would be as long as the recording
            read, target, weight = (item.reshape(-1) for item in (y, self.target, self.weight))
            parts = (slice(first, first + HOURS) for first in range(0, y.size, HOURS))
            return sum(LaneTargets(target[part], weight[part], self.robust).misfit(read[part]) for part in parts)
        with np.errstate(over="ignore", invalid="ignore"):  # a simulation that diverged counts as infinite
            e = self._residuals(y)
            if self.robust is None:
                return 0.5 * float(np.vdot(e, e))
            e = np.abs(e)
            return float(np.sum(np.where(e <= self.robust, 0.5 * e**2, self.robust * (e - 0.5 * self.robust))))

    def weighted(self, y: Array) -> tuple[Array, Array]:
        """Weighted residuals and their weights, (L, R, ny) each, both scaled down beyond the Huber threshold."""
        r = self._residuals(y)
        if self.robust is None:
            return r, self.weight
        tail = np.abs(r)  # in place from here: for hours of data every further array is large
        np.maximum(tail, 1e-300, out=tail)
        np.divide(self.robust, tail, out=tail)
        np.minimum(1.0, tail, out=tail)
        np.sqrt(tail, out=tail)
        r *= tail
        return r, np.multiply(self.weight, tail, out=tail)

    def _residuals(self, y: Array) -> Array:
        """Weighted residuals, zero where the weight is zero; in a single array, which may be hours long."""
        r = np.subtract(y, self.target)
        r *= self.weight
        r[~(self.weight > 0.0)] = 0.0
        return r

    def accumulated(self, y: Array, Y: Array, residuals: Array | None) -> tuple[Array, Array]:
        """J'J and J'r of every lane, from stored derivatives, (L, R, ny, c)."""
        r, weight = self.weighted(y)
        J = (Y * weight[..., None]).reshape(len(Y), -1, Y.shape[-1])
        transposed = J.swapaxes(1, 2)
        g = transposed @ (r if residuals is None else residuals).reshape(len(Y), -1, 1)
        return transposed @ J if residuals is None else np.empty((len(Y), 0, 0)), g[..., 0]


def to_unknowns(free: Array, seed: Array, places: NDArray[np.intp]) -> Array:
    """Chain rule: derivatives by initial states and free parameters -> by the c unknowns, (L, ..., c)."""
    states = seed.shape[1]
    flat = free.reshape(len(free), -1, free.shape[-1])
    result: Array = flat[:, :, :states] @ seed
    result[:, :, places] += flat[:, :, states:]
    return result.reshape(*free.shape[:-1], -1)


def square(packed: Array, count: int) -> Array:
    """Symmetric matrices from their lower triangles, packed row by row."""
    if not packed.shape[1]:
        return np.empty((len(packed), 0, 0))
    row, column = _triangle(count)
    result = np.empty((len(packed), count, count))
    result[:, row, column] = result[:, column, row] = packed
    return result


@lru_cache(maxsize=64)
def _triangle(count: int) -> tuple[Index, Index]:
    """Rows and columns of a lower triangle; finding them takes as long as filling a small one."""
    return np.tril_indices(count)
