"""Networks of layers of tanh, or of ELU (Clevert, Unterthiner & Hochreiter, ICLR 2016), with their gradients."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float32]
Numbers = NDArray[Any]
"""In single or double precision, as the weights are."""

FIRST, SECOND, SMALL = 0.9, 0.999, 1e-5
"""How long Adam remembers gradients and their squares, and what keeps its division finite (Kingma and Ba, 2015; the
last as reinforcement learning has it)."""


class Perceptron:
    """Layers of tanh or ELU, the last one linear; all numbers lie in one vector, weights before biases of each layer.

    Parameters
    ----------
    weights : of the layers, (in, out) each.
    biases : of the layers, (out,) each.
    activation : of all layers but the last.

    Attributes
    ----------
    vector : (n,) weights and biases.
    weights, biases : views of it.
    sizes : numbers that go in, units of the hidden layers, numbers that come out.

    Raises
    ------
    ValueError : shapes that do not follow each other, or what is no finite number.
    """

    def __init__(
        self, weights: Sequence[Numbers], biases: Sequence[Numbers], activation: Literal["tanh", "elu"] = "tanh"
    ) -> None:
        self.sizes = sizes_of(weights, biases)
        pieces = [item for layer in zip(weights, biases, strict=True) for item in layer]
        self.vector: Numbers = np.concatenate([np.ravel(piece) for piece in pieces])
        self._tanh = activation == "tanh"
        self.weights, self.biases = unpacked(self.vector, self.sizes)
        self._gradient = np.zeros_like(self.vector)
        self._by_weights, self._by_biases = unpacked(self._gradient, self.sizes)

    def at(self, vector: Numbers) -> Perceptron:
        """One of the same form with other numbers, (n,)."""
        return Perceptron(*unpacked(vector, self.sizes), "tanh" if self._tanh else "elu")

    def each(self, x: Numbers) -> Numbers:
        """(N, out) of (N, in), each row by itself: to the bit the same alone and among others."""
        return self.forward(x[:, None, :])[-1][:, 0]

    def forward(self, x: Numbers) -> list[Numbers]:
        """What the layers give for (N, in): x, then (N, out) of each."""
        layers = [x]
        for W, b in zip(self.weights, self.biases, strict=True):
            z = layers[-1] @ W
            z += b
            layers.append(z if b is self.biases[-1] else np.tanh(z, out=z) if self._tanh else elu(z))
        return layers

    def backward(self, layers: Sequence[Numbers], by_last: Numbers) -> Numbers:
        """(n,) the gradient by the vector, of one by the last layer's results, (N, out); valid until the next call."""
        along = by_last
        for k in reversed(range(len(self.weights))):
            np.matmul(layers[k].T, along, out=self._by_weights[k])
            np.sum(along, axis=0, out=self._by_biases[k])
            if k:
                along = along @ self.weights[k].T
                # the slope of an ELU is its value plus 1
                along *= 1.0 - layers[k] * layers[k] if self._tanh else 1.0 + np.minimum(layers[k], 0.0)
        return self._gradient


def sizes_of(weights: Sequence[Numbers], biases: Sequence[Numbers]) -> tuple[int, ...]:
    """Numbers that go into layers, and that come out of each.

    Raises
    ------
    ValueError : shapes do not follow each other, or hold what is no finite number.
    """
    if not weights or len(weights) != len(biases):
        raise ValueError("a layer has weights and biases")
    sizes = (len(weights[0]), *(len(bias) for bias in biases))
    for k, (W, b) in enumerate(zip(weights, biases, strict=True)):
        if W.shape != (sizes[k], sizes[k + 1]) or b.ndim != 1:
            raise ValueError(f"layer {k + 1} takes {sizes[k]} numbers, its weights are {W.shape}")
        if not (np.all(np.isfinite(W)) and np.all(np.isfinite(b))):
            raise ValueError(f"layer {k + 1} holds a value that is not a number")
    return sizes


def unpacked(vector: Numbers, sizes: Sequence[int]) -> tuple[tuple[Numbers, ...], tuple[Numbers, ...]]:
    """Weights and biases as views of one row: layer by layer, weights before biases."""
    shapes = [shape for a, b in pairwise(sizes) for shape in ((a, b), (b,))]
    ends = np.cumsum([int(np.prod(shape)) for shape in shapes])
    pieces = [item.reshape(shape) for item, shape in zip(np.split(vector, ends[:-1]), shapes, strict=True)]
    return tuple(pieces[0::2]), tuple(pieces[1::2])


def elu(h: Numbers) -> Numbers:
    """h above zero, exp(h) - 1 below."""
    result: Numbers = np.maximum(h, 0.0) + (np.exp(np.minimum(h, 0.0)) - 1.0)
    return result


def drawn(sizes: Sequence[int], last: float, generator: np.random.Generator) -> Perceptron:
    """A network of orthogonal weights and no biases.

    Parameters
    ----------
    sizes : numbers taken, of each layer, given.
    last : gain of the last layer; that of the others is sqrt(2), as customary for PPO.
    generator : what the weights are drawn from.
    """
    weights = []
    for k, shape in enumerate(pairwise(sizes)):
        result, triangle = np.linalg.qr(generator.normal(size=(max(shape), min(shape))))
        result = result * np.sign(np.diag(triangle))
        gain = last if k == len(sizes) - 2 else np.sqrt(2.0)
        weights.append((gain * (result if shape[0] >= shape[1] else result.T)).astype(np.float32))
    return Perceptron(weights, [np.zeros(n, dtype=np.float32) for n in sizes[1:]])


class Adam:
    """Steps down gradients, each number's own length apart (Kingma and Ba, 2015).

    Parameters
    ----------
    vector : (n,) what is changed, in place.
    largest : length to which longer gradients are cut.
    """

    def __init__(self, vector: Floats, largest: float) -> None:
        self._vector, self._largest = vector, largest
        self._mean, self._square, self._steps = np.zeros_like(vector), np.zeros_like(vector), 0

    def step(self, gradient: Floats, rate: float) -> None:
        """A step against a gradient, (n,)."""
        length = float(np.sqrt(gradient @ gradient))
        if length > self._largest:
            gradient = gradient * np.float32(self._largest / length)
        self._steps += 1
        self._mean += np.float32(1 - FIRST) * (gradient - self._mean)
        self._square += np.float32(1 - SECOND) * (gradient * gradient - self._square)
        longest = np.sqrt(self._square / np.float32(1 - SECOND**self._steps))
        longest += np.float32(SMALL)
        self._vector -= np.float32(rate / (1 - FIRST**self._steps)) * self._mean / longest
