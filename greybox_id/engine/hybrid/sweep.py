"""Windows side by side, forward in time and back: physics by CasADi, the network by matrices (`NetworkLayers`).

A sample of a hybrid model is traced with the network cut out: the network's inputs are expressions, its outputs are
symbols. Evaluation alternates between CasADi's functions and the layers; derivatives go the same way backwards, with
CasADi's reverse mode for the physics. Networks are most of the work, and CasADi multiplies matrices without SIMD
instructions: ten times as slow for four layers of 24.

`NetworkLayers` evaluates a network in numpy, many columns at once, forward and backward, with BLAS's matrix products.
Its question contains the features and, for a network with memory, the layers' outputs of the previous step; its answer
contains the network's outputs and the layers' outputs now. Both are (columns, numbers): rows of an array are CasADi's
columns.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import casadi as cs
import numpy as np

from ...base.shorthands import Array
from ...models.hybrid_model import FeedForwardNetwork, HybridModel, RecurrentNetwork
from ...models.model import Symbol
from ...models.parameter import placed
from ..virtual import on_arrays
from .cell import Network, parameters

Weights = Mapping[str, Array]
"""Weights by the names of a network's `shapes`."""


class NetworkLayers:
    """A network whose weights are passed with every call.

    Attributes
    ----------
    question_size, answer_size : lengths of a question and of an answer.
    """

    def __init__(self, network: RecurrentNetwork | FeedForwardNetwork) -> None:
        self._network = network
        self._recurrent = isinstance(network, RecurrentNetwork)
        mirrored = () if isinstance(network, RecurrentNetwork) else network.mirrored
        self._signs = np.array([-1.0 if item else 1.0 for item in mirrored])
        self._tanh = isinstance(network, FeedForwardNetwork) and network.activation == "tanh"
        remembered = sum(network.hidden) if self._recurrent else 0
        self.question_size, self.answer_size = network.features + remembered, network.outputs + remembered

    def forward(self, question: Array, p: Weights) -> tuple[Array, list[Array]]:
        """The answer, and the outputs of all layers, features first, for `backward`."""
        network = self._network
        layer = features = question[:, : network.features]
        if len(self._signs):
            layer = np.concatenate((features, features * self._signs))
        outputs, start = [layer], network.features
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
            outputs.append(layer)
        z = layer @ p["W_out"].T
        if len(self._signs):  # biases of both halves cancel
            z = z[: len(features)] - z[len(features) :]
        else:
            z += p["b_out"]
        if network.skip:
            z += features @ p["W_skip"].T
        return (np.concatenate((z, *outputs[1:]), axis=1) if self._recurrent else z), outputs

    def backward(self, slope: Array, question: Array, outputs: list[Array], p: Weights, weights: Weights) -> Array:
        """Derivative by the question from that by the answer; derivatives by weights are added to `weights`."""
        network = self._network
        at, ones = network.outputs, np.ones(len(outputs[0]))
        z = slope[:, :at]
        if network.skip:
            weights["W_skip"][...] += z.T @ outputs[0]
        if not len(self._signs):
            weights["b_out"][...] += ones @ z
        outer = np.concatenate((z, -z)) if len(self._signs) else z
        weights["W_out"][...] += outer.T @ outputs[-1]
        layer, memory = outer @ p["W_out"], []
        at, start = slope.shape[1], question.shape[1]
        for number in range(len(network.hidden), 0, -1):
            units, output = network.hidden[number - 1], outputs[number]
            if self._recurrent:
                layer += slope[:, at - units : at]
            if self._tanh:
                squared = output * output
                np.subtract(1.0, squared, out=squared)
                layer *= squared
            else:
                layer *= output > 0.0
            weights[f"W_{number}"][...] += layer.T @ outputs[number - 1]
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


Traced = Callable[[Symbol, Symbol, dict[str, Symbol], Network], tuple[Symbol, Symbol]]
"""(carried, inputs, parameters by name, network) -> (carried a sample later, results now)."""


@dataclass(frozen=True)
class Tape:
    """Record of a forward sweep for the backward one: per row the carried state, questions, answers and layers."""

    inputs: Array
    p: Array
    carried: list[Array]
    questions: list[list[Array]]
    answers: list[list[Array]]
    layers: list[list[list[Array]]]


class Sweep:
    """Windows of a model side by side, simulated and differentiated.

    Arrays are (columns, numbers), or (rows, columns, numbers).

    Parameters
    ----------
    model : the model, whose parameters are passed as one vector.
    traced : one sample of it.
    sizes : lengths of the carried state and of the inputs.
    columns : number of windows.
    """

    def __init__(self, model: HybridModel, traced: Traced, sizes: tuple[int, int], columns: int) -> None:
        self._layers = NetworkLayers(model.network)
        weights = model.network.shapes
        self._places = {
            parameter.name: (place, parameter.shape)
            for parameter, place in placed(model.parameters)
            if parameter.name in weights
        }
        self._physical = np.array(
            [parameter.name not in weights for parameter in model.parameters for _ in range(parameter.size)]
        )
        carried, u = (cs.MX.sym(name, size, columns) for name, size in zip(("carried", "u"), sizes, strict=True))
        physical = cs.MX.sym("physical", int(np.sum(self._physical)))
        p = cs.MX(model.size, 1)
        p[np.flatnonzero(self._physical).tolist()] = physical
        questions: list[Symbol] = []
        symbols: list[Symbol] = []

        def network(features: Symbol, before: Symbol) -> tuple[Symbol, Symbol]:
            questions.append(cs.vertcat(features, before))
            symbols.append(cs.MX.sym("said", self._layers.answer_size, columns))
            return symbols[-1][: model.network.outputs, :], symbols[-1][model.network.outputs :, :]

        moved, results = traced(carried, u, parameters(model, p), network)
        arguments = [carried, u, physical]
        self._questions = [_Expression([*arguments, *symbols[:k]], item) for k, item in enumerate(questions)]
        self._next = _Expression([*arguments, *symbols], moved)
        self._results = _Expression([*arguments, *symbols], results)
        self._needed = any(cs.depends_on(results, item) for item in symbols)
        """Whether a row's results depend on the network's answers of that row."""

    def forward(self, starts: Array, inputs: Array, p: Array) -> tuple[Array, Tape]:
        """The results, (rows, columns, numbers), and the record for `backward`."""
        weights, physical = self._weights(p), p[self._physical]
        tape, results = Tape(inputs, p, [], [], [], []), []
        now = starts
        for row, u in enumerate(inputs):
            questions: list[Array] = []
            answers: list[Array] = []
            layers: list[list[Array]] = []
            last = row == len(inputs) - 1
            for question in self._questions:
                if last and not self._needed:
                    answers.append(np.zeros((len(now), self._layers.answer_size)))
                    continue
                questions.append(question(now, u, physical, *answers))
                answer, outputs = self._layers.forward(questions[-1], weights)
                answers.append(answer)
                layers.append(outputs)
            results.append(self._results(now, u, physical, *answers))
            tape.carried.append(now)
            tape.questions.append(questions)
            tape.answers.append(answers)
            tape.layers.append(layers)
            if not last:
                now = self._next(now, u, physical, *answers)
        return np.array(results), tape

    def backward(self, slope: Array, tape: Tape) -> Array:
        """Derivative by the parameters, from that by the results, (rows, columns, numbers)."""
        result, physical = np.zeros(len(tape.p)), tape.p[self._physical]
        weights, by_weights = self._weights(tape.p), self._weights(result)
        of_physical = np.zeros(len(physical))
        by_carried = np.zeros_like(tape.carried[0])
        last = len(tape.inputs) - 1
        for row in range(last, -1, -1):
            arguments, answers = (tape.carried[row], tape.inputs[row], physical), tape.answers[row]
            slopes = [self._results.back(slope[row], *arguments, *answers)]
            if row < last:
                slopes.append(self._next.back(by_carried, *arguments, *answers))
            by_carried, of_p, by_answers = _summed(slopes)
            of_physical += of_p
            for k in range(len(tape.layers[row]) - 1, -1, -1):
                question = tape.questions[row][k]
                by_question = self._layers.backward(by_answers[k], question, tape.layers[row][k], weights, by_weights)
                more, of_p, by_earlier = _summed([self._questions[k].back(by_question, *arguments, *answers[:k])])
                by_carried += more
                of_physical += of_p
                for item, further in zip(by_answers, by_earlier, strict=False):
                    item += further
        result[self._physical] = of_physical
        return result

    def _weights(self, p: Array) -> dict[str, Array]:
        return {name: p[place].reshape(shape) for name, (place, shape) in self._places.items()}


class _Expression:
    """An expression of (carried, inputs, physical parameters, answers ...), and its derivatives by all but inputs."""

    def __init__(self, known: list[Symbol], value: Symbol) -> None:
        function = cs.Function("value", known, [cs.densify(value)])
        seed = cs.MX.sym("seed", *value.shape)
        slopes = function.reverse(1).call([*known, function(*known), seed], True, False)
        target = [cs.densify(slope) for k, slope in enumerate(slopes) if k != 1]
        self._forward = on_arrays(function)
        self._backward = on_arrays(cs.Function("slopes", [seed, *known], target))

    def __call__(self, *known: Array) -> Array:
        return self._forward(*known)[0]

    def back(self, slope: Array, *known: Array) -> list[Array]:
        return self._backward(slope, *known)


def _summed(slopes: list[list[Array]]) -> tuple[Array, Array, list[Array]]:
    """Sums of the derivatives by the carried state, by physical parameters, and by each answer."""
    carried, physical, *answers = (sum(item[1:], item[0]) for item in zip(*slopes, strict=True))
    return carried, np.ravel(physical), answers
