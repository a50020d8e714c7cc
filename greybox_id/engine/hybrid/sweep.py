"""Windows side by side, forward in time and back: physics by CasADi, the network by matrices (`layers`).

A sample of a hybrid model is traced with the network cut out of it: what it is asked are expressions, what it answers
are symbols. In between CasADi's functions and the layers take turns; slopes go the same way backward, with CasADi's
reverse mode for the physics. Networks are most of the work, and CasADi multiplies matrices without the processor's
vectors: ten times as slow for four layers of 24.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as cs
import numpy as np

from ...base.shorthands import Array
from ...models.hybrid_model import HybridModel
from ...models.model import Symbol
from .cell import Network, parameters
from .layers import NetworkLayers

Traced = Callable[[Symbol, Symbol, dict[str, Symbol], Network], tuple[Symbol, Symbol]]
"""(carried, inputs, parameters by name, network) -> (carried a sample later, what is told now)."""


@dataclass(frozen=True)
class Tape:
    """What a sweep forward leaves for the one back: row by row what was carried, asked and said."""

    inputs: Array
    p: Array
    carried: list[Array]
    asked: list[list[Array]]
    said: list[list[Array]]
    layers: list[list[list[Array]]]


class Sweep:
    """Windows of a model, so many side by side.

    Arrays are (columns, numbers), or (rows, columns, numbers).

    Parameters
    ----------
    model : whose parameters are handed over as one vector.
    traced : a sample of it.
    sizes : numbers that are carried, and of inputs.
    columns : windows side by side.
    """

    def __init__(self, model: HybridModel, traced: Traced, sizes: tuple[int, int], columns: int) -> None:
        self._layers = NetworkLayers(model.network)
        weights = model.network.shapes
        ends = np.cumsum([own.size for own in model.parameters])
        self._places = {
            own.name: (slice(end - own.size, end), own.shape)
            for own, end in zip(model.parameters, ends.tolist(), strict=True)
            if own.name in weights
        }
        self._physical = np.array([own.name not in weights for own in model.parameters for _ in range(own.size)])
        carried, u = (cs.MX.sym(name, size, columns) for name, size in zip(("carried", "u"), sizes, strict=True))
        physical = cs.MX.sym("physical", int(np.sum(self._physical)))
        p = cs.MX(model.size, 1)
        p[np.flatnonzero(self._physical).tolist()] = physical
        asked: list[Symbol] = []
        said: list[Symbol] = []

        def network(features: Symbol, before: Symbol) -> tuple[Symbol, Symbol]:
            asked.append(cs.vertcat(features, before))
            said.append(cs.MX.sym("said", self._layers.answered, columns))
            return said[-1][: model.network.outputs, :], said[-1][model.network.outputs :, :]

        moved, told = traced(carried, u, parameters(model, p), network)
        known = [carried, u, physical]
        self._asks = [_Called([*known, *said[:k]], own) for k, own in enumerate(asked)]
        self._move = _Called([*known, *said], moved)
        self._tell = _Called([*known, *said], told)
        self._needed = any(cs.depends_on(told, own) for own in said)
        """Whether what is told needs the network's answers of that row."""

    def forward(self, starts: Array, inputs: Array, p: Array) -> tuple[Array, Tape]:
        """What is told, (rows, columns, numbers), and what `backward` wants."""
        weights, physical = self._weights(p), p[self._physical]
        tape, told = Tape(inputs, p, [], [], [], []), []
        now = starts
        for row, u in enumerate(inputs):
            asked: list[Array] = []
            said: list[Array] = []
            layers: list[list[Array]] = []
            last = row == len(inputs) - 1
            for ask in self._asks:
                if last and not self._needed:
                    said.append(np.zeros((len(now), self._layers.answered)))
                    continue
                asked.append(ask(now, u, physical, *said))
                answer, kept = self._layers.forward(asked[-1], weights)
                said.append(answer)
                layers.append(kept)
            told.append(self._tell(now, u, physical, *said))
            tape.carried.append(now)
            tape.asked.append(asked)
            tape.said.append(said)
            tape.layers.append(layers)
            if not last:
                now = self._move(now, u, physical, *said)
        return np.array(told), tape

    def backward(self, slope: Array, tape: Tape) -> Array:
        """From the slope by what is told, (rows, columns, numbers), that by the parameters."""
        found, physical = np.zeros(len(tape.p)), tape.p[self._physical]
        weights, by_weights = self._weights(tape.p), self._weights(found)
        of_physical = np.zeros(len(physical))
        by_carried = np.zeros_like(tape.carried[0])
        last = len(tape.inputs) - 1
        for row in range(last, -1, -1):
            known, said = (tape.carried[row], tape.inputs[row], physical), tape.said[row]
            slopes = [self._tell.back(slope[row], *known, *said)]
            if row < last:
                slopes.append(self._move.back(by_carried, *known, *said))
            by_carried, of_p, by_said = _summed(slopes)
            of_physical += of_p
            for k in range(len(tape.layers[row]) - 1, -1, -1):
                asked = tape.asked[row][k]
                by_asked = self._layers.backward(by_said[k], asked, tape.layers[row][k], weights, by_weights)
                more, of_p, by_earlier = _summed([self._asks[k].back(by_asked, *known, *said[:k])])
                by_carried += more
                of_physical += of_p
                for own, further in zip(by_said, by_earlier, strict=False):
                    own += further
        found[self._physical] = of_physical
        return found

    def _weights(self, p: Array) -> dict[str, Array]:
        return {name: p[place].reshape(shape) for name, (place, shape) in self._places.items()}


class _Called:
    """An expression of (carried, inputs, physical parameters, answers ...), and its slopes by all but the inputs."""

    def __init__(self, known: list[Symbol], value: Symbol) -> None:
        function = cs.Function("value", known, [cs.densify(value)])
        seed = cs.MX.sym("seed", *value.shape)
        slopes = function.reverse(1).call([*known, function(*known), seed], True, False)
        wanted = [cs.densify(own) for k, own in enumerate(slopes) if k != 1]
        self._forward = _on_arrays(function)
        self._backward = _on_arrays(cs.Function("slopes", [seed, *known], wanted))

    def __call__(self, *known: Array) -> Array:
        return self._forward(known)[0]

    def back(self, slope: Array, *known: Array) -> list[Array]:
        return self._backward((slope, *known))


def _on_arrays(function: cs.Function) -> Callable[[tuple[Array, ...]], list[Array]]:
    """A function on numpy's arrays in place, without copies to CasADi's and back."""
    buffer, evaluate = function.buffer()
    shapes = [function.size_out(k)[::-1] for k in range(function.n_out())]

    def called(known: tuple[Array, ...]) -> list[Array]:
        found = [np.empty(shape) for shape in shapes]
        for k, own in enumerate(known):
            buffer.set_arg(k, np.ascontiguousarray(own).data)
        for k, own in enumerate(found):
            buffer.set_res(k, own.data)
        evaluate()
        return found

    return called


def _summed(slopes: list[list[Array]]) -> tuple[Array, Array, list[Array]]:
    """By what is carried, by physical parameters, and by each answer."""
    carried, physical, *said = (sum(own[1:], own[0]) for own in zip(*slopes, strict=True))
    return carried, np.ravel(physical), said
