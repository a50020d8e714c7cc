"""One step of a hybrid model, for many windows side by side, as a CasADi function.

The state carried from step to step consists of, top to bottom: states, their derivatives in the previous step, a flag
that is one if there was a previous step, outputs of the network's layers. Each column is a separate window. CasADi is
fastest with products of weight matrices and matrices of windows. Training takes the network out of the sample
(`sweep`).

States follow by the second-order Adams-Bashforth formula,

    x_(k+1) = x_k + h (f_k + (f_k - f_(k-1)) / 2)

which like the paper's Euler step (Eq. 12) evaluates the network once per step. Euler's is half a sample late, at 100 Hz
and 1 Hz of steering 3 % of the force. The formula extrapolates f by f_(k-1); a command that is held until the next row
must not be extrapolated, and acts on the states as half of its step (its mean with the previous row). Stable while h
times the fastest eigenvalue, about 2 C_alpha / (m v_x), stays below 1.

Networks without a memory may be evaluated more than once a step: the classical Runge-Kutta step is that of the engine,
on inputs that are held or linear up to the next row, so that the trained model is the one simulated elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from types import SimpleNamespace

import casadi as cs
import numpy as np

from ...base.shorthands import Array
from ...datasets.recording import Recording
from ...models.hybrid_model import FeedForwardNetwork, HybridModel, RecurrentNetwork
from ...models.model import Symbol
from ...models.parameter import placed
from .stretches import stretches

Network = Callable[[Symbol, Symbol], tuple[Symbol, Symbol]]
"""(features, layers' outputs in the previous step) -> (network's outputs, layers' outputs), (numbers, columns) each."""


class Cell:
    """One sample of a hybrid model.

    Attributes
    ----------
    model : the model.
    carried : length of the state carried from step to step.
    reported : names of a step's results, in order: outputs and estimates.
    """

    def __init__(self, model: HybridModel) -> None:
        self.model = model
        self.carried = 2 * len(model.states) + 1 + model.remembered
        self.reported = tuple(dict.fromkeys((*model.outputs, *model.estimates)))

    def sample(self, columns: int, reported: Sequence[str]) -> cs.Function:
        """(carried, inputs now and as they act, parameters) -> (carried a sample later, reported results now).

        Parameters
        ----------
        columns : number of windows side by side.
        reported : names of states and quantities.
        """
        carried = cs.MX.sym("carried", self.carried, columns)
        u = cs.MX.sym("u", 2 * len(self.model.inputs), columns)
        p = cs.MX.sym("p", self.model.size)
        by_name = parameters(self.model, p)
        moved = self.traced(carried, u, by_name, partial(_answer, self.model.network, by_name), reported)
        return cs.Function("sample", [carried, u, p], moved)

    def traced(
        self, carried: Symbol, u: Symbol, p: Mapping[str, Symbol], network: Network, reported: Sequence[str]
    ) -> tuple[Symbol, Symbol]:
        """The carried state a sample later, and the reported results now; parameters are by name."""
        model = self.model
        present, acting = cs.vertsplit(u, len(model.inputs))
        now, results = carried, None
        for k in range(model.substeps):
            begin, end = present, acting
            if model.integrator != "ab2":  # `acting` are the inputs at the end of the sample
                begin, end = (present + share / model.substeps * (acting - present) for share in (k, k + 1))
            now, quantities = self._step(now, begin, end, p, model.sample_time / model.substeps, network)
            results = results if results is not None else cs.vertcat(*[quantities[name] for name in reported])
            if model.integrator == "ab2":
                acting = present
        return now, results

    def start(self, states: Array) -> Array:
        """Carried state at the start of windows: (states, columns) -> (carried, columns).

        The network's memory is zero, and there is no previous step: the first one is Euler's.
        """
        result = np.zeros((self.carried, states.shape[1]))
        result[: len(self.model.states)] = states
        return result

    def _step(
        self, carried: Symbol, u: Symbol, acting: Symbol, p: Mapping[str, Symbol], h: float, network: Network
    ) -> tuple[Symbol, Mapping[str, Symbol]]:
        model, n = self.model, len(self.model.states)
        if model.integrator != "ab2":
            return self._one_step(carried, u, acting, p, h, network)
        names = [state.name for state in model.states]
        x = SimpleNamespace(**{name: carried[k, :] for k, name in enumerate(names)})
        inputs, acting_inputs = (
            SimpleNamespace(**{name: each[k, :] for k, name in enumerate(model.inputs)}) for each in (u, acting)
        )
        physical = self._physical(p)
        z, remembered = network(cs.vertcat(*model.features(x, inputs, physical)), carried[2 * n + 1 :, :])
        _, quantities = model.physics(x, inputs, physical, cs.vertsplit(z))
        rates, _ = model.physics(x, acting_inputs, physical, cs.vertsplit(z))
        rate = cs.vertcat(*[rates[name] for name in names])
        not_first = cs.repmat(carried[2 * n, :], n, 1)
        following = carried[:n, :] + h * (rate + 0.5 * not_first * (rate - carried[n : 2 * n, :]))
        return cs.vertcat(following, rate, cs.DM.ones(1, u.shape[1]), remembered), {**vars(x), **quantities}

    def _one_step(
        self, carried: Symbol, u: Symbol, following: Symbol, p: Mapping[str, Symbol], h: float, network: Network
    ) -> tuple[Symbol, Mapping[str, Symbol]]:
        """An Euler or Runge-Kutta step; `following` are the inputs at the end of the step."""
        n = len(self.model.states)
        start = carried[:n, :]
        first, quantities = self._rates(start, u, p, network)
        if self.model.integrator == "euler":
            after = start + h * first
        else:
            middle = 0.5 * (u + following)
            second, _ = self._rates(start + 0.5 * h * first, middle, p, network)
            third, _ = self._rates(start + 0.5 * h * second, middle, p, network)
            fourth, _ = self._rates(start + h * third, following, p, network)
            after = start + h / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
        return cs.vertcat(after, first, cs.DM.ones(1, u.shape[1])), quantities

    def rates(self, state: Symbol, u: Symbol, p: Symbol) -> Symbol:
        """Derivatives of the states (states, columns), for a network without memory."""
        by_name = parameters(self.model, p)
        return self.traced_rates(state, u, by_name, partial(_answer, self.model.network, by_name))

    def traced_rates(self, state: Symbol, u: Symbol, p: Mapping[str, Symbol], network: Network) -> Symbol:
        """`rates` with parameters by name."""
        return self._rates(state, u, p, network)[0]

    def _rates(
        self, state: Symbol, u: Symbol, p: Mapping[str, Symbol], network: Network
    ) -> tuple[Symbol, Mapping[str, Symbol]]:
        model = self.model
        x = SimpleNamespace(**{item.name: state[k, :] for k, item in enumerate(model.states)})
        inputs = SimpleNamespace(**{name: u[k, :] for k, name in enumerate(model.inputs)})
        physical = self._physical(p)
        z, _ = network(cs.vertcat(*model.features(x, inputs, physical)), cs.MX(0, state.shape[1]))
        rates, quantities = model.physics(x, inputs, physical, cs.vertsplit(z))
        return cs.vertcat(*[rates[state.name] for state in model.states]), {**vars(x), **quantities}

    def _physical(self, p: Mapping[str, Symbol]) -> SimpleNamespace:
        return SimpleNamespace(**{name: value for name, value in p.items() if name not in self.model.network.shapes})


def _answer(
    network: RecurrentNetwork | FeedForwardNetwork, p: Mapping[str, Symbol], features: Symbol, before: Symbol
) -> tuple[Symbol, Symbol]:
    if isinstance(network, FeedForwardNetwork):
        return network_outputs(network, features, p), before
    layers: list[Symbol] = []
    start, layer, columns = 0, features, features.shape[1]
    for number, units in enumerate(network.hidden, 1):
        previous = before[start : start + units, :]
        bias = cs.repmat(p[f"b_{number}"], 1, columns)
        layer = cs.fmax(p[f"W_{number}"] @ layer + p[f"R_{number}"] @ previous + bias, 0)
        layers.append(layer)
        start += units
    z = p["W_out"] @ layer + cs.repmat(p["b_out"], 1, columns)
    return (z + p["W_skip"] @ features if network.skip else z), cs.vertcat(*layers)


def network_outputs(network: FeedForwardNetwork, features: Symbol, p: Mapping[str, Symbol]) -> Symbol:
    """Outputs of a network without memory for features (features, columns)."""

    def through(layer: Symbol) -> Symbol:
        columns = layer.shape[1]
        for number in range(1, len(network.hidden) + 1):
            layer = p[f"W_{number}"] @ layer + cs.repmat(p[f"b_{number}"], 1, columns)
            layer = cs.tanh(layer) if network.activation == "tanh" else cs.fmax(layer, 0)
        return p["W_out"] @ layer + cs.repmat(p["b_out"], 1, columns)

    if not network.mirrored:
        return through(features)
    signs = cs.DM([-1.0 if item else 1.0 for item in network.mirrored])
    return through(features) - through(cs.repmat(signs, 1, features.shape[1]) * features)


def parameters(model: HybridModel, vector: Symbol) -> dict[str, Symbol]:
    """The parts of a parameter vector by name, arrays as matrices (stored row by row)."""
    result = {}
    for parameter, place in placed(model.parameters):
        part = vector[place]
        if len(parameter.shape) == 2:
            rows, columns = parameter.shape
            part = cs.reshape(part, columns, rows).T
        result[parameter.name] = part
    return result


_BLOCK = 100
"""Rows simulated per call."""


def free_run(model: HybridModel, recording: Recording) -> dict[str, Array]:
    """Outputs and estimates by name, (n,) each, from the first row of every stretch to its end; NaN between them.

    Each stretch starts from its first readings. Where a slip is too small to identify a stiffness, that is NaN.

    Raises
    ------
    BadInput : an input is missing, or the sample time is not the model's.
    """
    cell = Cell(model)
    block = cell.sample(1, cell.reported).mapaccum("free_run", _BLOCK)
    p = cs.repmat(cs.DM(model.values), 1, _BLOCK)
    result = {name: np.full(len(recording), np.nan) for name in cell.reported}
    for stretch in stretches(model, recording):
        carried = cell.start(stretch.start(0)[:, None])
        for k in range(0, len(stretch), _BLOCK):
            inputs = stretch.inputs[:, k : k + _BLOCK]
            rows = inputs.shape[1]
            padded = np.pad(inputs, ((0, 0), (0, _BLOCK - rows)), mode="edge")  # pads the last block; results are cut
            after, results = block(carried, padded, p)
            carried, first = np.array(after)[:, -1:], stretch.rows.start + k
            for name, values in zip(cell.reported, np.array(results), strict=True):
                result[name][first : first + rows] = values[:rows]
    for name, (of, least) in model.untold.items():
        with np.errstate(invalid="ignore"):
            result[name][~(np.abs(result[of]) >= least)] = np.nan
    return result
