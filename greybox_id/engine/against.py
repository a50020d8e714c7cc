"""What simulated readings are held against, lane by lane, and normal equations of what is left."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..base.shorthands import Array


@dataclass(frozen=True)
class Against:
    """What the readings of lanes are held against.

    Attributes
    ----------
    target : (L, R, ny) what should be read.
    weight : (L, R, ny) what a residual is multiplied with; zero where none counts.
    robust : weighted residuals beyond it weigh less, as in a Huber loss; None: all alike.
    """

    target: Array
    weight: Array
    robust: float | None = None

    def misfit(self, y: Array) -> float:
        """Half the sum of squared residuals, those in the tails linear."""
        with np.errstate(over="ignore", invalid="ignore"):  # a simulation that diverged counts as infinite
            e = np.where(self.weight > 0.0, (y - self.target) * self.weight, 0.0)
            if self.robust is None:
                return 0.5 * float(np.vdot(e, e))
            e = np.abs(e)
            return float(np.sum(np.where(e <= self.robust, 0.5 * e**2, self.robust * (e - 0.5 * self.robust))))

    def weighted(self, y: Array) -> tuple[Array, Array]:
        """Weighted residuals of readings and their weights, (L, R, ny) each."""
        r = np.where(self.weight > 0.0, (y - self.target) * self.weight, 0.0)
        if self.robust is None:
            return r, self.weight
        tail = np.sqrt(np.minimum(1.0, self.robust / np.maximum(np.abs(r), 1e-300)))
        return r * tail, self.weight * tail

    def accumulated(self, y: Array, Y: Array, residuals: Array | None) -> tuple[Array, Array]:
        """J'J and J'r of every lane, from derivatives that are laid out, (L, R, ny, c)."""
        r, weight = self.weighted(y)
        J = (Y * weight[..., None]).reshape(len(Y), -1, Y.shape[-1])
        along = J.swapaxes(1, 2)
        g = along @ (r if residuals is None else residuals).reshape(len(Y), -1, 1)
        return along @ J if residuals is None else np.empty((len(Y), 0, 0)), g[..., 0]


def led(free: Array, seed: Array, places: NDArray[np.intp]) -> Array:
    """Derivatives by the unknowns, (L, ..., c), of those by initial states and by parameters that move."""
    states = seed.shape[1]
    flat = free.reshape(len(free), -1, free.shape[-1])
    result: Array = flat[:, :, :states] @ seed
    result[:, :, places] += flat[:, :, states:]
    return result.reshape(*free.shape[:-1], -1)


def square(packed: Array, count: int) -> Array:
    """Symmetric matrices, of their lower triangles, which are packed row by row."""
    if not packed.shape[1]:
        return np.empty((len(packed), 0, 0))
    row, column = np.tril_indices(count)
    result = np.empty((len(packed), count, count))
    result[:, row, column] = result[:, column, row] = packed
    return result
