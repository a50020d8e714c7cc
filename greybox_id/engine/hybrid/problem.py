"""What training a hybrid model minimises, with its exact gradient.

The loss is half the mean squared error over all compared rows, in units of each output's noise (the square of the
paper's Eq. 13, which has the same minima), plus the priors of physical parameters and a weak pull of weights to zero.
CasADi differentiates it backwards through time, network and physics in one.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as cs
import numpy as np

from ...hybrid_model import HybridModel
from ...shorthands import Array
from .cell import Cell
from .stretches import Stretch, Windows, windows

_ABREAST = 64
"""Windows that one call takes: more of them do not stay in the processor's caches."""
_POINTS_ABREAST = 2048
_SHARE = 0.1
"""Unit of a physical parameter without a prior, over its nominal value."""
_HUGE = 1e8
"""Mean square of a vehicle that leaves all bounds."""
PULL = 1e-5
"""Of weights to zero: weak, for what ends training is the held-out error."""


class WindowErrors:
    """Mean squared error over windows, in units of noise, as a function of the parameter vector."""

    def __init__(self, model: HybridModel, found: Sequence[Stretch], noise: Array) -> None:
        laid = windows(model, found)
        cell = Cell(model)
        self.readings = int(np.sum(np.isfinite(laid.outputs)))
        self._functions = [
            _squares(model, cell, laid, slice(k, k + _ABREAST), noise) for k in range(0, laid.count, _ABREAST)
        ]

    def __call__(self, p: Array) -> float:
        """Mean square at a parameter vector; infinite where the vehicle is simulated out of all bounds."""
        total = sum(float(plain(p)) for plain, _ in self._functions) / self.readings
        return total if np.isfinite(total) else np.inf

    def with_gradient(self, p: Array) -> tuple[float, Array]:
        """Mean square and its gradient."""
        total, slope = 0.0, np.zeros(len(p))
        for _, both in self._functions:
            value, own = both(p)
            total, slope = total + float(value), slope + np.array(own).ravel()
        return total / self.readings, slope / self.readings


class RateErrors:
    """Mean squared error of the rates of states, as a function of the parameter vector.

    Parameters
    ----------
    model : whose network has no memory.
    states : (states, n).
    inputs : (inputs, n).
    rates : (states, n) that are to be met.
    scale : (states, n) errors that count as one.
    """

    def __init__(self, model: HybridModel, states: Array, inputs: Array, rates: Array, scale: Array) -> None:
        self.readings = rates.size
        cell = Cell(model)
        columns = _POINTS_ABREAST
        x, u, p, y, w = (
            cs.MX.sym("x", len(states), columns), cs.MX.sym("u", len(inputs), columns), cs.MX.sym("p", model.size),
            cs.MX.sym("y", len(rates), columns), cs.MX.sym("w", len(rates), columns),
        )  # fmt: skip
        value = cs.sumsqr((cell.rates(x, u, p) - y) * w)
        self._plain = cs.Function("value", [x, u, y, w, p], [value])
        self._both = cs.Function("both", [x, u, y, w, p], [value, cs.gradient(value, p)])
        self._blocks = []
        for k in range(0, rates.shape[1], columns):
            own = [table[:, k : k + columns] for table in (states, inputs, rates, 1.0 / scale)]
            more = columns - own[0].shape[1]
            own = [np.pad(table, ((0, 0), (0, more)), mode="edge") for table in own]
            own[3][:, columns - more :] = 0.0  # what fills the last block up does not count
            self._blocks.append([cs.DM(table) for table in own])

    def __call__(self, p: Array) -> float:
        """Mean square at a parameter vector."""
        return sum(float(self._plain(*block, p)) for block in self._blocks) / self.readings

    def with_gradient(self, p: Array) -> tuple[float, Array]:
        """Mean square and its gradient."""
        total, slope = 0.0, np.zeros(len(p))
        for block in self._blocks:
            value, own = self._both(*block, p)
            total, slope = total + float(value), slope + np.array(own).ravel()
        return total / self.readings, slope / self.readings


class HybridProblem:
    """The loss over scaled unknowns: those that are free, in units that make them alike.

    Attributes
    ----------
    model : at its nominal values.
    errors : over windows of the stretches, unless others are handed over.
    free : (parameters,) which of the numbers are unknowns.
    bounds : (unknowns, 2) in their own units.
    """

    def __init__(
        self,
        model: HybridModel,
        found: Sequence[Stretch],
        noise: Array,
        errors: RateErrors | None = None,
    ) -> None:
        self.model = model
        self.errors: WindowErrors | RateErrors = WindowErrors(model, found, noise) if errors is None else errors
        pull: list[float] = []
        unit: list[float] = []
        prior: list[float] = []
        bounds: list[tuple[float, float]] = []
        for parameter in model.parameters:
            n, is_weight = parameter.size, parameter.name in model.network.shapes
            pull += [PULL if is_weight else 0.0] * n
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
        self._pull, self._prior = np.array(pull)[self.free], np.array(prior)[self.free]
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
        """Loss and gradient; where the simulation leaves all bounds the loss is huge and flat."""
        p = self.parameters(q)
        mean, slope = self.errors.with_gradient(p)
        if not (mean < _HUGE and np.all(np.isfinite(slope))):
            return _HUGE, np.zeros(len(q))
        off = self._prior * (p[self.free] - self._means) / self._unit
        pulled = self._pull * p[self.free]
        loss = 0.5 * mean + 0.5 * float(off @ off) / self.errors.readings + 0.5 * float(pulled @ p[self.free])
        return loss, self._unit * (0.5 * slope[self.free] + pulled) + off / self.errors.readings

    def _prior_means(self) -> Array:
        found = [
            np.broadcast_to(p.array if p.prior is None or p.prior.mean is None else np.asarray(p.prior.mean), p.shape)
            for p in self.model.parameters
        ]
        return np.asarray(np.concatenate([np.ravel(own) for own in found])[self.free])


def drawn(model: HybridModel, seed: int) -> Array:
    """A parameter vector from which training starts: weights drawn, all else as it stands.

    Layers keep the spread of what they read (He et al. 2015), memory fades (its spectral radius is about a third), and
    the output begins near its nominal value: the first simulations are those of a plain vehicle.
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


def _squares(
    model: HybridModel, cell: Cell, laid: Windows, which: slice, noise: Array
) -> tuple[cs.Function, cs.Function]:
    """Sum of squares over some of the windows: p -> value, and p -> (value, gradient)."""
    inputs, outputs = laid.inputs[:, :, which], laid.outputs[:, :, which]
    rows, _, columns = inputs.shape
    p = cs.MX.sym("p", model.size)
    steps = cell.sample(columns, model.outputs).mapaccum("windows", rows)
    _, told = steps(cell.start(laid.starts[:, which]), np.concatenate(list(inputs), axis=1), cs.repmat(p, 1, rows))
    read = np.concatenate(list(outputs), axis=1)
    weight = np.where(np.isfinite(read), 1.0 / noise[:, None], 0.0)
    value = cs.sumsqr((told - np.nan_to_num(read)) * np.nan_to_num(weight))
    return cs.Function("value", [p], [value]), cs.Function("both", [p], [value, cs.gradient(value, p)])
