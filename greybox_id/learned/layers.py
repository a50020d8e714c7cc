"""Feed-forward networks of exponential linear units in plain numpy: forwards, and backwards for training.

Source: ELU, Clevert, Unterthiner & Hochreiter, ICLR 2016.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..parameter import Array


@dataclass(frozen=True)
class Layers:
    """One network: layers of ELU, the last one linear.

    Attributes
    ----------
    weights : (in, out) of each layer.
    biases : (out,) of each layer.

    Raises
    ------
    ValueError : shapes that do not follow each other, or what is no finite number.
    """

    weights: tuple[Array, ...]
    biases: tuple[Array, ...]

    def __post_init__(self) -> None:
        if not self.weights or len(self.weights) != len(self.biases):
            raise ValueError("a layer has weights and biases")
        sizes = [len(self.weights[0]), *(len(own) for own in self.biases)]
        for k, (W, b) in enumerate(zip(self.weights, self.biases, strict=True)):
            if W.shape != (sizes[k], sizes[k + 1]) or b.ndim != 1:
                raise ValueError(f"layer {k + 1} takes {sizes[k]} numbers, its weights are {W.shape}")
            if not (np.all(np.isfinite(W)) and np.all(np.isfinite(b))):
                raise ValueError(f"layer {k + 1} holds what is no finite number")

    @property
    def sizes(self) -> tuple[int, ...]:
        """Numbers that go in, units of the hidden layers, numbers that come out."""
        return (len(self.weights[0]), *(len(own) for own in self.biases))

    def __call__(self, x: Array) -> Array:
        """(L, out) of (L, in), each row by itself: to the bit the same alone and among others."""
        h = x[:, None, :]
        for W, b in zip(self.weights[:-1], self.biases[:-1], strict=True):
            h = elu(h @ W + b)
        found: Array = (h @ self.weights[-1] + self.biases[-1])[:, 0]
        return found


def drawn(sizes: Sequence[int], rng: np.random.Generator) -> Array:
    """Weights drawn such that what goes through keeps its variance (Glorot & Bengio 2010); biases zero; packed."""
    shapes = list(zip(sizes[:-1], sizes[1:], strict=True))
    weights = [rng.normal(0.0, np.sqrt(2.0 / (a + b)), (a, b)) for a, b in shapes]
    return packed(weights, [np.zeros(b) for _, b in shapes])


def packed(weights: Sequence[Array], biases: Sequence[Array]) -> Array:
    """All numbers in one row: layer by layer, weights before biases."""
    return np.concatenate([part for W, b in zip(weights, biases, strict=True) for part in (W.ravel(), b)])


def unpacked(q: Array, sizes: Sequence[int]) -> tuple[list[Array], list[Array]]:
    """Weights and biases out of one row."""
    weights, biases, at = [], [], 0
    for a, b in zip(sizes[:-1], sizes[1:], strict=True):
        weights.append(q[at : at + a * b].reshape(a, b))
        biases.append(q[at + a * b : at + a * b + b])
        at += a * b + b
    return weights, biases


def elu(h: Array) -> Array:
    """h above zero, exp(h) - 1 below."""
    found: Array = np.maximum(h, 0.0) + (np.exp(np.minimum(h, 0.0)) - 1.0)
    return found


class SquaredError:
    """Half the mean squared error of a network on rows, and its gradient.

    Parameters
    ----------
    sizes : of the layers.
    x, y : (n, in) and (n, out) rows.
    """

    def __init__(self, sizes: Sequence[int], x: Array, y: Array) -> None:
        self._sizes, self._x, self._y = sizes, np.ascontiguousarray(x), y

    def __call__(self, q: Array) -> tuple[float, Array]:
        """Loss and gradient at packed weights."""
        weights, biases = unpacked(q, self._sizes)
        seen = [self._x]
        for W, b in zip(weights[:-1], biases[:-1], strict=True):
            seen.append(elu(seen[-1] @ W + b))
        error = seen[-1] @ weights[-1] + biases[-1] - self._y
        back = error / error.size
        W_by, b_by = list(weights), list(biases)
        for k in range(len(weights) - 1, -1, -1):
            W_by[k], b_by[k] = seen[k].T @ back, back.sum(axis=0)
            if k:
                back = (back @ weights[k].T) * (1.0 + np.minimum(seen[k], 0.0))  # an ELU's slope is its value plus 1
        return 0.5 * float(np.sum(error**2)) / error.size, packed(W_by, b_by)

    def errors(self, q: Array) -> Array:
        """(n, out) what the network says, less what it should."""
        weights, biases = unpacked(q, self._sizes)
        h = self._x
        for W, b in zip(weights[:-1], biases[:-1], strict=True):
            h = elu(h @ W + b)
        found: Array = h @ weights[-1] + biases[-1] - self._y
        return found
