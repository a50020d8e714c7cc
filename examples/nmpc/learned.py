"""What the controller predicts with a model in which networks act: what they have seen is part of its states."""

from __future__ import annotations

import casadi as cs
import numpy as np
from prediction import Prediction, Row, Symbol

from greybox_lab.driving.learned.injection import InjectedModel
from greybox_lab.driving.racing.network import Perceptron
from greybox_lab.driving.racing.stage import BEND


class LearnedPrediction(Prediction):
    """A model, its networks and its commands, a period at a time; parameters as of `Prediction`.

    Behind the states of `Prediction`, z holds the rows that the networks have read before, the newest first. Where
    several networks part, what they say counts as little as it does in `injected`.
    """

    def __init__(self, model: InjectedModel, period: float, units: Row) -> None:
        super().__init__(model.physics, period, units, model.net.outputs)
        self._net, physics, slips = model.net, self.stage, self.slips
        self.size = self.own + (model.net.history - 1) * len(model.net.inputs)
        self.slips = lambda z: slips(z[: self.own])
        self.stage = self._corrected(physics, units)

    @property
    def pattern(self) -> Row:
        """See `Prediction.pattern`."""
        z, rates = (cs.DM(self.stage.sparsity_jac(k, 0)).full() for k in (0, 1))
        return np.hstack([z, rates])

    def started(self, v_x: float, s: float) -> Row:
        """z of a vehicle that has gone straight ahead; see `Prediction.started`."""
        z = super().started(v_x, s)
        row = [v_x if name == "v_x" else 0.0 for name in self._net.inputs]
        z[self.own :] = np.tile(row, self._net.history - 1)
        return z

    def _corrected(self, physics: cs.Function, units: Row) -> cs.Function:
        net = self._net
        z, rates, bend = cs.MX.sym("z", self.size), cs.MX.sym("rates", self.inputs), cs.MX.sym("bend", len(BEND))
        free = physics(z[: self.own], rates, cs.vertcat(bend, cs.DM.zeros(len(net.outputs))))
        given = [free[int(k)] * unit for k, unit in zip(self.newest, units, strict=True)]
        now = {"steer": given[0], "drive": given[1]} | {name: z[k] for k, name in enumerate(self.motion)}
        seen = cs.vertcat(*(now[name] for name in net.inputs), z[self.own :])
        read = (seen - np.tile(net.means, net.history)) / np.tile(net.scales, net.history)
        model = cs.vertcat(*(free[self.motion.index(name)] for name in net.outputs))
        said = [_through(own, read) * net.out_scales + net.out_means for own in net.members]
        mean = sum(said) / len(said)
        off = mean if net.residual else mean - model
        if len(said) > 1:
            square = sum((own - mean) ** 2 for own in said) / (len(said) - 1)
            off = off / (1.0 + square / net.sigma**2)
        after = physics(z[: self.own], rates, cs.vertcat(bend, off))
        kept = seen[: self.size - self.own]
        return cs.Function("stage", [z, rates, bend], [cs.vertcat(after, kept)])


def _through(layers: Perceptron, x: Symbol) -> Symbol:
    """What a network of ELU says."""
    for W, b in zip(layers.weights[:-1], layers.biases[:-1], strict=True):
        h = W.T @ x + b
        x = cs.fmax(h, 0.0) + cs.exp(cs.fmin(h, 0.0)) - 1.0
    return layers.weights[-1].T @ x + layers.biases[-1]
