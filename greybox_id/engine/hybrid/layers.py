"""A network's layers in numpy, many columns at once, forward and backward: products of matrices are BLAS's.

What a network is asked are its features and, of one with a memory, what its layers said a step before; what it answers
are its outputs, and what its layers say now. Both are (columns, numbers): rows of an array here are CasADi's columns.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...base.shorthands import Array
from ...models.hybrid_model import FeedForwardNetwork, RecurrentNetwork

Weights = Mapping[str, Array]
"""By the names of a network's `shapes`."""


class NetworkLayers:
    """A network, whose weights are handed over with every call.

    Attributes
    ----------
    asked, answered : numbers of a question and of an answer.
    """

    def __init__(self, network: RecurrentNetwork | FeedForwardNetwork) -> None:
        self._network = network
        self._recurrent = isinstance(network, RecurrentNetwork)
        mirrored = () if isinstance(network, RecurrentNetwork) else network.mirrored
        self._signs = np.array([-1.0 if item else 1.0 for item in mirrored])
        self._tanh = isinstance(network, FeedForwardNetwork) and network.activation == "tanh"
        remembered = sum(network.hidden) if self._recurrent else 0
        self.asked, self.answered = network.features + remembered, network.outputs + remembered

    def forward(self, question: Array, p: Weights) -> tuple[Array, list[Array]]:
        """An answer, and what layers said, the features first, which `backward` wants."""
        network = self._network
        layer = features = question[:, : network.features]
        if len(self._signs):
            layer = np.concatenate((features, features * self._signs))
        stated, start = [layer], network.features
        for number, units in enumerate(network.hidden, 1):
            layer = layer @ p[f"W_{number}"].T
            layer += p[f"b_{number}"]
            if self._recurrent:
                layer += question[:, start : start + units] @ p[f"R_{number}"].T
                start += units
            if self._tanh:
                np.tanh(layer, out=layer)
            else:
                np.maximum(layer, 0.0, out=layer)
            stated.append(layer)
        z = layer @ p["W_out"].T
        if len(self._signs):  # biases of both halves cancel
            z = z[: len(features)] - z[len(features) :]
        else:
            z += p["b_out"]
        if network.skip:
            z += features @ p["W_skip"].T
        return (np.concatenate((z, *stated[1:]), axis=1) if self._recurrent else z), stated

    def backward(self, slope: Array, question: Array, stated: list[Array], p: Weights, weights: Weights) -> Array:
        """From the slope by an answer that by the question; slopes by weights are added to `found`."""
        network = self._network
        at, ones = network.outputs, np.ones(len(stated[0]))
        z = slope[:, :at]
        if network.skip:
            weights["W_skip"][...] += z.T @ stated[0]
        if not len(self._signs):
            weights["b_out"][...] += ones @ z
        outer = np.concatenate((z, -z)) if len(self._signs) else z
        weights["W_out"][...] += outer.T @ stated[-1]
        layer, memory = outer @ p["W_out"], []
        at, start = slope.shape[1], question.shape[1]
        for number in range(len(network.hidden), 0, -1):
            units, value = network.hidden[number - 1], stated[number]
            if self._recurrent:
                layer += slope[:, at - units : at]
            if self._tanh:
                bent = value * value
                np.subtract(1.0, bent, out=bent)
                layer *= bent
            else:
                layer *= value > 0.0
            weights[f"W_{number}"][...] += layer.T @ stated[number - 1]
            weights[f"b_{number}"][...] += ones @ layer
            if self._recurrent:
                weights[f"R_{number}"][...] += layer.T @ question[:, start - units : start]
                memory.append(layer @ p[f"R_{number}"])
                at, start = at - units, start - units
            layer = layer @ p[f"W_{number}"]
        if len(self._signs):
            half = len(layer) // 2
            layer = layer[:half] + layer[half:] * self._signs
        if network.skip:
            layer += z @ p["W_skip"]
        return np.concatenate((layer, *reversed(memory)), axis=1) if memory else layer
