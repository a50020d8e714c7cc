"""The loss that training of a hybrid model minimises, with its exact gradient.

The loss is half the mean squared error over all compared rows, in units of each output's noise (the square of the
paper's Eq. 13, which has the same minima), plus the priors of physical parameters and a weak L2 regulariser of weights.
It is differentiated backwards through time, network and physics (`sweep`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from ...base.shorthands import Array
from ...models.hybrid_model import HybridModel
from ...models.model import Symbol
from .cell import Cell, Network
from .stretches import Stretch, windows
from .sweep import Sweep, Traced

_ABREAST, _FEWEST = 8192, 128
"""Rows simulated at a time, limited by the processor's caches, and the fewest windows."""
_SHARE = 0.1
"""Unit of a physical parameter without a prior, relative to its nominal value."""
_HUGE = 1e8
"""Loss of a simulation that diverges."""
PULL = 1e-5
"""Weight of the L2 regulariser: weak, since early stopping by the held-out error ends training."""


class SquaredErrors:
    """Mean squared error of the reported results, as a function of the parameter vector.

    Parameters
    ----------
    model : the model, for its parameters.
    traced : one sample of it.
    starts : (columns, numbers) carried state at the start.
    inputs, target, weight : (rows, columns, numbers) inputs, targets of the results, and the inverse of their unit
        errors, zero where nothing is compared.
    abreast : number of columns simulated at a time.
    """

    def __init__(
        self, model: HybridModel, traced: Traced, starts: Array, inputs: Array, target: Array, weight: Array,
        abreast: int,
    ) -> None:  # fmt: skip
        self.readings = int(np.count_nonzero(weight))
        count = len(starts)
        blocks = -(-count // abreast)
        columns = -(-count // blocks)
        self._sweep = Sweep(model, traced, (starts.shape[1], inputs.shape[2]), columns)
        self._blocks = []
        for k in range(blocks):
            numbers = np.arange(k * columns, (k + 1) * columns)
            at = np.minimum(numbers, count - 1)  # padding of the last block, with weight zero
            used_weight = weight[:, at] * (numbers < count)[:, None]
            self._blocks.append((starts[at], np.ascontiguousarray(inputs[:, at]), target[:, at], used_weight))

    def __call__(self, p: Array) -> float:
        """Mean square at a parameter vector; infinite if the simulation diverges."""
        with np.errstate(all="ignore"):
            total = sum(
                float(np.sum(((self._sweep.forward(starts, inputs, p)[0] - target) * weight) ** 2))
                for starts, inputs, target, weight in self._blocks
            )
        return total / self.readings if np.isfinite(total) else np.inf

    def with_gradient(self, p: Array) -> tuple[float, Array]:
        """Mean square and its gradient."""
        total, slope = 0.0, np.zeros(len(p))
        with np.errstate(all="ignore"):
            for starts, inputs, target, weight in self._blocks:
                results, tape = self._sweep.forward(starts, inputs, p)
                errors = (results - target) * weight
                total += float(np.sum(errors**2))
                slope += self._sweep.backward(2.0 * errors * weight, tape)
        return total / self.readings, slope / self.readings


class WindowErrors(SquaredErrors):
    """Mean squared error over windows, in units of noise."""

    def __init__(self, model: HybridModel, stretchs: Sequence[Stretch], noise: Array) -> None:
        several, cell = windows(model, stretchs), Cell(model)
        outputs = several.outputs.transpose(0, 2, 1)
        weight = np.where(np.isfinite(outputs), np.nan_to_num(1.0 / noise), 0.0)
        super().__init__(
            model, partial(cell.traced, reported=model.outputs), cell.start(several.starts).T,
            several.inputs.transpose(0, 2, 1), np.nan_to_num(outputs), weight, max(_ABREAST // len(outputs), _FEWEST),
        )  # fmt: skip


class RateErrors(SquaredErrors):
    """Mean squared error of the derivatives of states.

    Parameters
    ----------
    model : a model whose network has no memory.
    states : (states, n).
    inputs : (inputs, n).
    rates : (states, n) target derivatives.
    scale : (states, n) unit errors.
    """

    def __init__(self, model: HybridModel, states: Array, inputs: Array, rates: Array, scale: Array) -> None:
        cell = Cell(model)

        def traced(x: Symbol, u: Symbol, p: Mapping[str, Symbol], network: Network) -> tuple[Symbol, Symbol]:
            return x, cell.traced_rates(x, u, p, network)

        super().__init__(model, traced, states.T, inputs.T[None], rates.T[None], 1.0 / scale.T[None], _ABREAST)


class HybridProblem:
    """The loss as a function of the free parameters, scaled to similar sizes.

    Attributes
    ----------
    model : the model, at its nominal values.
    errors : by default over windows of the stretches.
    lesson : further errors, whose mean square is added.
    free : (parameters,) whether a parameter is an unknown.
    bounds : (unknowns, 2) in scaled units.
    """

    def __init__(
        self,
        model: HybridModel,
        stretchs: Sequence[Stretch],
        noise: Array,
        errors: SquaredErrors | None = None,
        lesson: SquaredErrors | None = None,
    ) -> None:
        self.model, self.lesson = model, lesson
        self.errors = WindowErrors(model, stretchs, noise) if errors is None else errors
        weight_decay: list[float] = []
        unit: list[float] = []
        prior: list[float] = []
        bounds: list[tuple[float, float]] = []
        for parameter in model.parameters:
            n, is_weight = parameter.size, parameter.name in model.network.shapes
            weight_decay += [PULL if is_weight else 0.0] * n
            sd = np.nan if parameter.prior is None else float(np.asarray(parameter.prior.sd))
            unit += [
                1.0 if is_weight else sd if np.isfinite(sd) else _SHARE * max(abs(float(parameter.array)), 1e-9)
            ] * n
            prior += [1.0 if np.isfinite(sd) else 0.0] * n
            bounds += [parameter.bounds] * n
        self.free = np.array([not p.fixed for p in model.parameters for _ in range(p.size)])
        self.nominal = model.values
        self._means = self._prior_means()
        self._unit = np.array(unit)[self.free]
        self._pull, self._prior = np.array(weight_decay)[self.free], np.array(prior)[self.free]
        self.bounds = (np.array(bounds)[self.free] - self.nominal[self.free, None]) / self._unit[:, None]

    def parameters(self, q: Array) -> Array:
        """The parameter vector at scaled unknowns, which are zero at nominal values."""
        p = self.nominal.copy()
        p[self.free] += self._unit * q
        return np.asarray(p)

    def unknowns(self, p: Array) -> Array:
        """Scaled unknowns of a parameter vector."""
        return np.asarray((p - self.nominal)[self.free] / self._unit)

    def __call__(self, q: Array) -> tuple[float, Array]:
        """Loss and gradient; if the simulation diverges, the loss is huge and flat."""
        p = self.parameters(q)
        mean, slope = self.errors.with_gradient(p)
        if self.lesson is not None:
            more, further = self.lesson.with_gradient(p)
            mean, slope = mean + more, slope + further
        if not (mean < _HUGE and np.all(np.isfinite(slope))):
            return _HUGE, np.zeros(len(q))
        deviations = self._prior * (p[self.free] - self._means) / self._unit
        regulariser = self._pull * p[self.free]
        loss = (
            0.5 * mean
            + 0.5 * float(deviations @ deviations) / self.errors.readings
            + 0.5 * float(regulariser @ p[self.free])
        )
        return loss, self._unit * (0.5 * slope[self.free] + regulariser) + deviations / self.errors.readings

    def _prior_means(self) -> Array:
        result = [
            np.broadcast_to(p.array if p.prior is None or p.prior.mean is None else np.asarray(p.prior.mean), p.shape)
            for p in self.model.parameters
        ]
        return np.asarray(np.concatenate([np.ravel(item) for item in result])[self.free])


def drawn(model: HybridModel, seed: int) -> Array:
    """A parameter vector at which training starts: random weights, all else at its value.

    Layers preserve the spread of their inputs (He et al. 2015), memory fades (its spectral radius is about a third),
    and the output starts near its nominal value: the first simulations are those of a plain vehicle.
    """
    rng, values = np.random.default_rng((seed, 5081)), []
    for parameter in model.parameters:
        name, shape = parameter.name, parameter.shape
        if parameter.fixed or name not in model.network.shapes or name in ("b_out", "W_skip"):
            values.append(np.ravel(parameter.array))
            continue
        if name.startswith("b_"):
            drawn_ones = rng.uniform(0.0, 0.3, shape)
        else:
            spread = {"W_out": 0.05 * np.sqrt(shape[-1])}.get(name, 1.0 if name.startswith("W_") else 0.3)
            drawn_ones = spread / np.sqrt(shape[-1]) * rng.standard_normal(shape)
        values.append(np.ravel(drawn_ones))
    return np.concatenate(values)
