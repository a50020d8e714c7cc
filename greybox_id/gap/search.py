"""What hypotheses are refitted on: a bench, nuisances with their derivatives, and noise that whitens residuals.

Nuisances move little: their derivatives are taken once, about the best model so far, and kept (chords). A hypothesis
then costs a few simulations: one where it stands and one beside it for each magnitude. What shifts nuisances move in
time, and starts, enters to first order only.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..parameter import Array
from .axes import Axis
from .bench import Bench
from .colour import Colour
from .hypothesis import Hypothesis, Projection, Start

AT_ONCE, JUMPS_SD = 0.02, 1.0
"""Share of an abrupt tolerance that stands for the least there can be of it; how much of what that does is believed, of
one at most."""


class Search:
    """What hypotheses about one bench are weighed by.

    Parameters
    ----------
    bench : what simulates.
    nuisances : what is believed.
    colour : how residuals count.

    Attributes
    ----------
    nominal : the parameter vector everything is about.
    simulations : how many there have been.
    """

    def __init__(self, bench: Bench, nuisances: Sequence[Axis], colour: Colour) -> None:
        self.bench = bench
        self.moving = tuple(axis for axis in nuisances if not axis.abrupt)
        self.shifts = tuple(axis for axis in nuisances if axis.abrupt)
        self.nominal = np.array(bench.model.values)
        self.simulations = 0
        self.colour = colour

    # ---- what everything is about

    def about(self, hypothesis: Hypothesis | None) -> None:
        """Take the nuisances' derivatives about this hypothesis; None: about their beliefs."""
        p = (
            self.vector(hypothesis)
            if hypothesis
            else self.placed(self.nominal, self.moving, np.array([axis.mean for axis in self.moving]))
        )
        _, self.theta_by, S = self.bench.linearise(p, [axis.index for axis in self.moving])
        self.linear_by = np.concatenate([*self._secants(p), S], axis=2)
        self._whiten()

    def _secants(self, p: Array) -> tuple[Array, Array]:
        """What abrupt nuisances do: per unit, and at once, (N, channels, shifts) each, from where none of them is."""
        p = self.placed(p, self.shifts, np.array([axis.null for axis in self.shifts]))
        least = [self.placed(p, [axis], np.array([AT_ONCE * axis.sd])) for axis in self.shifts]
        usual = [self.placed(p, [axis], np.array([axis.sd])) for axis in self.shifts]
        if not self.shifts:
            return np.zeros((*self.bench.measured.shape, 0)), np.zeros((*self.bench.measured.shape, 0))
        e = self.residuals([p, *least, *usual])
        first, then = e[1 : 1 + len(least)], e[1 + len(least) :]
        spans = [(1 - AT_ONCE) * axis.sd for axis in self.shifts]
        slopes = [(b - a) / span for a, b, span in zip(first, then, spans, strict=True)]
        return np.stack(slopes, axis=2), np.stack([a - e[0] for a in first], axis=2)

    def recoloured(self, colour: Colour) -> None:
        """Count residuals otherwise."""
        self.colour = colour
        self._whiten()

    def _whiten(self) -> None:
        both = np.concatenate([self.theta_by, self.linear_by], axis=2)
        self.white = self.colour.white(both).reshape(both.shape[0] * both.shape[1], both.shape[2])
        starts = np.tile([self.colour.stationary_sd[self._channel(k)] for k in self.bench.loose], len(self.bench.runs))
        axes, count = (*self.moving, *self.shifts), len(self.shifts)
        sds = [*(axis.sd for axis in axes), *[JUMPS_SD] * count, *starts]
        self.precision = 1 / np.array(sds) ** 2 if sds else np.empty(0)
        self.means = np.array([*(axis.mean for axis in axes), *np.zeros(count + len(starts))])
        self.low = np.array([*(axis.low for axis in axes), *np.zeros(count), *np.full(len(starts), -np.inf)])
        self.high = np.array([*(axis.high for axis in axes), *np.ones(count), *np.full(len(starts), np.inf)])
        self.null_linear = np.array([*(axis.null for axis in self.shifts), *np.zeros(count + len(starts))])
        self.gram = self.white.T @ self.white

    def among(self, indices: set[int]) -> NDArray[np.bool_]:
        """Which nuisances, moving and linear, are the parameters of these indices."""
        moving = [axis.index in indices for axis in self.moving]
        shifts = [axis.index in indices for axis in self.shifts]
        starts = len(self.means) - len(moving) - 2 * len(shifts)
        return np.array([*moving, *shifts, *shifts, *[False] * starts], dtype=bool)

    def _channel(self, state: int) -> int:
        return self.bench.channels.index(self.bench.model.states[state].name)

    def at_means(self) -> Hypothesis:
        """Nothing but nuisances, where they are believed to be; not simulated yet."""
        count, shape = len(self.moving), self.bench.measured.shape
        nothing, empty = np.zeros(shape), np.zeros((*shape, 0))
        return Hypothesis((), np.empty(0), self.means[:count], self.means[count:], np.inf, nothing, empty)

    # ---- vectors

    def vector(self, hypothesis: Hypothesis) -> Array:
        """The parameter vector of a hypothesis; first-order nuisances stay at their null."""
        return self.placed(self.placed(self.nominal, self.moving, hypothesis.theta), hypothesis.axes, hypothesis.m)

    @staticmethod
    def placed(p: Array, axes: Sequence[Axis], coordinates: Sequence[float] | Array) -> Array:
        """A parameter vector with some axes elsewhere."""
        found = p.copy()
        for axis, coordinate in zip(axes, coordinates, strict=True):
            found[axis.index] = axis.value(float(coordinate))
        return found

    def where(self, hypothesis: Hypothesis, axis: Axis) -> float:
        """The coordinate at which a hypothesis has an axis."""
        for own, coordinate in zip(self.moving, hypothesis.theta, strict=True):
            if own.index == axis.index:
                return float(coordinate)
        return axis.null

    def first_order(self, hypothesis: Hypothesis) -> Array:
        """(N, channels) what the linear nuisances add to a simulation."""
        found: Array = self.linear_by @ (hypothesis.linear - self.null_linear)
        return found

    def released(self, linear: Array, axes: Sequence[Axis]) -> Array:
        """Linear nuisances, those that are candidates now at their null: they move as candidates."""
        own = self.among({axis.index for axis in axes})[len(self.moving) :]
        return np.where(own, self.null_linear, linear)

    @staticmethod
    def start_of(hypothesis: Hypothesis) -> Start:
        """A start where a hypothesis stands."""
        return Start(hypothesis.candidates, hypothesis.m, hypothesis.theta, hypothesis.linear)

    def charge(self, hypothesis: Hypothesis) -> float:
        """What nuisances cost, twice their negative log-belief; those that are candidates cost nothing."""
        own = self.among({axis.index for axis in hypothesis.axes})
        u = np.concatenate([hypothesis.theta, hypothesis.linear])
        return float(np.sum(np.where(own, 0.0, self.precision) * (u - self.means) ** 2))

    def residuals(self, P: Sequence[Array]) -> Array:
        """(K, N, channels) predictions minus readings; zero where there is none."""
        self.simulations += len(P)
        y = self.bench.simulate(np.array(P))
        return np.where(self.bench.counted, y - self.bench.measured, 0.0)

    # ---- to first order

    def project(self, e: Array, columns: Array, theta: Array, linear: Array) -> Projection:
        """What single columns would gain, nuisances refitted to first order.

        Parameters
        ----------
        e : (N, channels) residuals.
        columns : (N, channels, K) their derivatives by K coordinates.
        theta, linear : where nuisances stand.
        """
        W = self.colour.white(columns).reshape(-1, columns.shape[2])
        r = self.colour.white(e[:, :, None]).ravel()
        H = self.gram + np.diag(self.precision)
        g = self.white.T @ r + self.precision * (np.concatenate([theta, linear]) - self.means)
        C = self.white.T @ W
        solved = np.linalg.solve(H, np.column_stack([g, C])) if len(g) else np.zeros((0, 1 + W.shape[1]))
        slope, raw = W.T @ r - C.T @ solved[:, 0], np.sum(W**2, axis=0)
        curve = np.maximum(raw - np.sum(C * solved[:, 1:], axis=0), 1e-12 * raw + 1e-300)
        return Projection(0.5 * slope**2 / curve, -slope / curve, curve, raw)

    def covariance(self, hypothesis: Hypothesis) -> Array:
        """(m, m) of a hypothesis' coordinates, nuisances refitted."""
        W = self.colour.white(hypothesis.J).reshape(-1, hypothesis.J.shape[2])
        own = self.among({axis.index for axis in hypothesis.axes})
        white = self.white[:, ~own]
        H = self.gram[np.ix_(~own, ~own)] + np.diag(self.precision[~own])
        C = white.T @ W
        S = W.T @ W - (C.T @ np.linalg.solve(H, C) if len(H) else 0.0)
        scale = np.sqrt(np.maximum(np.diag(S), 1e-300))
        return np.asarray(np.linalg.pinv(S / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale))
