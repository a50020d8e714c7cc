"""Refitting of hypotheses: nuisances and the magnitudes of some candidates, on whitened residuals.

Nuisances move little: their derivatives are taken once, about the best model so far, and kept (chords). A hypothesis
then costs a few simulations: one where it stands and one beside it for each magnitude. What shifts nuisances move in
time, and starts, enters to first order only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..parameter import Array
from .axes import Axis, Candidate
from .bench import Bench
from .colour import Colour

ITERATIONS = 7
SETTLED = 0.02
"""A refit ends when a step gains less than this much log-likelihood."""
HOPELESS = 2e-4
"""Added to that, of what is left to explain: how far a poor explanation is from the truth need not be known well."""
BESIDE = 1e-3
"""Distance of the simulation beside a hypothesis, in its magnitude's scale."""
FAR = 1e-9
AT_ONCE, JUMPS_SD = 0.02, 1.0
"""Share of an abrupt tolerance that stands for the least there can be of it; how much of what that does is believed, of
one at most."""


@dataclass(frozen=True)
class Hypothesis:
    """Some candidates at the magnitudes that explain the recording best.

    Attributes
    ----------
    candidates : those that are present.
    m : their coordinates, in the order of their axes.
    theta : coordinates of the nuisances that move nonlinearly.
    linear : of those that enter to first order.
    cost : negative log-likelihood with beliefs, up to a constant.
    e : (N, channels) residuals, prediction minus reading.
    J : (N, channels, m) their derivative by m.
    """

    candidates: tuple[Candidate, ...]
    m: Array
    theta: Array
    linear: Array
    cost: float
    e: Array
    J: Array

    @property
    def names(self) -> tuple[str, ...]:
        """The effects'."""
        return tuple(candidate.effect for candidate in self.candidates)

    @property
    def axes(self) -> tuple[Axis, ...]:
        """Of all candidates."""
        return tuple(axis for candidate in self.candidates for axis in candidate.axes)


class Projection(NamedTuple):
    """What single columns would gain, (K,) each.

    Attributes
    ----------
    gain : in log-likelihood.
    step : along each.
    curve : information on each, nuisances refitted.
    raw : the same with nuisances held.
    """

    gain: Array
    step: Array
    curve: Array
    raw: Array


@dataclass(frozen=True)
class Start:
    """Where a refit begins.

    Attributes
    ----------
    candidates : of the hypothesis.
    m, theta, linear : coordinates.
    origin : a hypothesis without the last candidate, and the coordinates at which the whole equals it: a start that
        explains less is drawn back towards it. None where there is no way back.
    """

    candidates: tuple[Candidate, ...]
    m: Array
    theta: Array
    linear: Array
    origin: tuple[Hypothesis, Array] | None = None


class Search:
    """Refits hypotheses about one bench.

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
        self._chords: tuple[Array, Array, Array] | None = None  # by moving nuisances, by linear ones; raw

    # ---- what everything is about

    def about(self, hypothesis: Hypothesis | None) -> None:
        """Take the nuisances' derivatives about this hypothesis; None: about their beliefs."""
        p = self.vector(hypothesis) if hypothesis else self._with(self.nominal, self.moving, _means(self.moving))
        _, self._theta, S = self.bench.linearise(p, [axis.index for axis in self.moving])
        self._linear = np.concatenate([*self._secants(p), S], axis=2)
        self._whiten()

    def _secants(self, p: Array) -> tuple[Array, Array]:
        """What abrupt nuisances do: per unit, and at once, (N, channels, shifts) each, from where none of them is."""
        p = self._with(p, self.shifts, np.array([axis.null for axis in self.shifts]))
        least = [self._with(p, [axis], np.array([AT_ONCE * axis.sd])) for axis in self.shifts]
        usual = [self._with(p, [axis], np.array([axis.sd])) for axis in self.shifts]
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
        both = np.concatenate([self._theta, self._linear], axis=2)
        self._white = self.colour.white(both).reshape(-1, both.shape[2])
        starts = np.tile([self.colour.stationary_sd[self._channel(k)] for k in self.bench.loose], len(self.bench.runs))
        axes, count = (*self.moving, *self.shifts), len(self.shifts)
        sds = [*(axis.sd for axis in axes), *[JUMPS_SD] * count, *starts]
        self.precision = 1 / np.array(sds) ** 2 if sds else np.empty(0)
        self.means = np.array([*(axis.mean for axis in axes), *np.zeros(count + len(starts))])
        self.low = np.array([*(axis.low for axis in axes), *np.zeros(count), *np.full(len(starts), -np.inf)])
        self.high = np.array([*(axis.high for axis in axes), *np.ones(count), *np.full(len(starts), np.inf)])
        self.null_linear = np.array([*(axis.null for axis in self.shifts), *np.zeros(count + len(starts))])
        self._gram = self._white.T @ self._white

    def _own(self, indices: set[int]) -> NDArray[np.bool_]:
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
        return self._with(self._with(self.nominal, self.moving, hypothesis.theta), hypothesis.axes, hypothesis.m)

    def full_vector(self, hypothesis: Hypothesis) -> Array:
        """The same with shift nuisances where they were found."""
        p = self.vector(hypothesis)
        taken = {axis.name for axis in hypothesis.axes}
        own = [(axis, x) for axis, x in zip(self.shifts, hypothesis.linear, strict=False) if axis.name not in taken]
        return self._with(p, [axis for axis, _ in own], np.array([np.clip(x, axis.low, axis.high) for axis, x in own]))

    @staticmethod
    def _with(p: Array, axes: Sequence[Axis], coordinates: Array) -> Array:
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

    def placed(self, p: Array, axes: Sequence[Axis], coordinates: Sequence[float]) -> Array:
        """A parameter vector with some axes elsewhere."""
        return self._with(p, axes, np.asarray(coordinates))

    def first_order(self, hypothesis: Hypothesis) -> Array:
        """(N, channels) what the linear nuisances add to a simulation."""
        found: Array = self._linear @ (hypothesis.linear - self.null_linear)
        return found

    def released(self, linear: Array, axes: Sequence[Axis]) -> Array:
        """Linear nuisances, those that are candidates now at their null: they move as candidates."""
        own = self._own({axis.index for axis in axes})[len(self.moving) :]
        return np.where(own, self.null_linear, linear)

    @staticmethod
    def start_of(hypothesis: Hypothesis) -> Start:
        """A start where a hypothesis stands."""
        return Start(hypothesis.candidates, hypothesis.m, hypothesis.theta, hypothesis.linear)

    def charge(self, hypothesis: Hypothesis) -> float:
        """What nuisances cost, twice their negative log-belief; those that are candidates cost nothing."""
        own = self._own({axis.index for axis in hypothesis.axes})
        u = np.concatenate([hypothesis.theta, hypothesis.linear])
        return float(np.sum(np.where(own, 0.0, self.precision) * (u - self.means) ** 2))

    def residuals(self, P: Sequence[Array]) -> Array:
        """(K, N, channels) predictions minus readings; zero where there is none."""
        self.simulations += len(P)
        y = self.bench.simulate(np.array(P))
        return np.where(self.bench.counted, y - self.bench.measured, 0.0)

    # ---- refits

    def refit(self, starts: Sequence[Start]) -> list[Hypothesis]:
        """Refit hypotheses side by side, in their order; those that have no finite residuals are left out."""
        work = [_Work(self, start) for start in starts]
        for _ in range(ITERATIONS):
            active = [own for own in work if not own.done]
            if not active:
                break
            wanted = [p for own in active for p in own.wanted()]
            e = self.residuals(wanted)
            first = 0
            for own in active:
                count = len(own.wanted())
                own.take(e[first : first + count])
                first += count
        return [own.best for own in work if own.best is not None]

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
        H = self._gram + np.diag(self.precision)
        g = self._white.T @ r + self.precision * (np.concatenate([theta, linear]) - self.means)
        C = self._white.T @ W
        solved = np.linalg.solve(H, np.column_stack([g, C])) if len(g) else np.zeros((0, 1 + W.shape[1]))
        slope, raw = W.T @ r - C.T @ solved[:, 0], np.sum(W**2, axis=0)
        curve = np.maximum(raw - np.sum(C * solved[:, 1:], axis=0), 1e-12 * raw + 1e-300)
        return Projection(0.5 * slope**2 / curve, -slope / curve, curve, raw)

    def covariance(self, hypothesis: Hypothesis) -> Array:
        """(m, m) of a hypothesis' coordinates, nuisances refitted."""
        W = self.colour.white(hypothesis.J).reshape(-1, hypothesis.J.shape[2])
        own = self._own({axis.index for axis in hypothesis.axes})
        white, C = self._white[:, ~own], None
        H = self._gram[np.ix_(~own, ~own)] + np.diag(self.precision[~own])
        C = white.T @ W
        S = W.T @ W - (C.T @ np.linalg.solve(H, C) if len(H) else 0.0)
        scale = np.sqrt(np.maximum(np.diag(S), 1e-300))
        return np.asarray(np.linalg.pinv(S / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale))


class _Work:
    """One hypothesis on its way."""

    def __init__(self, search: Search, start: Start) -> None:
        self.search, self.candidates = search, start.candidates
        self.axes = tuple(axis for candidate in start.candidates for axis in candidate.axes)
        self._own = {axis.index for axis in self.axes}
        linear = search.released(np.array(start.linear, dtype=float), self.axes)
        self.at = (np.array(start.m, dtype=float), np.array(start.theta, dtype=float), linear)
        self.best: Hypothesis | None = None
        self.done, self._step, self._share = False, None, 1.0
        if start.origin is not None and np.array_equal(linear, start.linear):
            self._begin_at(*start.origin)

    def _begin_at(self, origin: Hypothesis, m: Array) -> None:
        """Take the start for a step from the origin, which may be shortened."""
        nothing = np.zeros((*origin.e.shape, len(m)))
        self.best = Hypothesis(self.candidates, m, origin.theta, origin.linear, origin.cost, origin.e, nothing)
        there = np.concatenate([self.at[1], self.at[2], self.at[0]])
        self._step = there - np.concatenate([origin.theta, origin.linear, m])

    def wanted(self) -> list[Array]:
        """Parameter vectors to simulate: where it stands, and beside it."""
        m, theta, _ = self.at
        search = self.search
        p = search._with(search._with(search.nominal, search.moving, theta), self.axes, m)
        found = [p]
        for k, axis in enumerate(self.axes):
            beside = m.copy()
            beside[k] += self._beside(axis, m[k])
            found.append(search._with(p, self.axes, beside))
        return found

    @staticmethod
    def _beside(axis: Axis, at: float) -> float:
        step = max(BESIDE * axis.scale, BESIDE * abs(at)) if not axis.shift else 1e-4
        return step if at + step <= axis.high else -step

    def take(self, e: Array) -> None:
        """Simulations have come back."""
        search, (m, theta, linear) = self.search, self.at
        base = e[0] + search._linear @ (linear - search.null_linear)
        r = search.colour.white(base[:, :, None]).ravel()
        u = np.concatenate([theta, linear])
        precision = self._precision()
        cost = 0.5 * float(r @ r) + 0.5 * float(np.sum(precision * (u - search.means) ** 2))
        if not np.isfinite(cost):
            cost = np.inf
        if self.best is not None and not cost <= self.best.cost:
            self._back()
            return
        if not np.isfinite(cost):
            self.done = True
            return
        gained = np.inf if self.best is None else self.best.cost - cost
        J = (
            np.stack([(e[1 + k] - e[0]) / self._beside(a, m[k]) for k, a in enumerate(self.axes)], axis=2)
            if len(self.axes)
            else np.zeros((*base.shape, 0))
        )
        self.best = Hypothesis(self.candidates, m, theta, linear, cost, base, J)
        if gained < SETTLED + HOPELESS * max(cost - 0.5 * search.colour.readings, 0.0):
            self.done = True
            return
        self._share = 1.0
        self._step = self._solve(r, J, u, precision)
        self._go()

    def _precision(self) -> Array:
        """Beliefs, without those of candidates: a candidate is not held to its tolerance."""
        return np.where(self.search._own(self._own), 0.0, self.search.precision)

    def _solve(self, r: Array, J: Array, u: Array, precision: Array) -> Array:
        """A Gauss-Newton step within the bounds: what would leave them is held there, one after the other."""
        search = self.search
        W = search.colour.white(J).reshape(-1, J.shape[2]) if J.shape[2] else np.zeros((len(r), 0))
        cross = search._white.T @ W
        H = np.block([[search._gram + np.diag(precision), cross], [cross.T, W.T @ W]])
        g = np.concatenate([search._white.T @ r + precision * (u - search.means), W.T @ r])
        m = self.at[0]
        low = np.concatenate([search.low - u, [a.low for a in self.axes] - m])
        high = np.concatenate([search.high - u, [a.high for a in self.axes] - m])
        held = np.append(search._own(self._own), np.zeros(len(m), dtype=bool))
        return bounded_step(H, g, low, high, held)

    def _go(self) -> None:
        """Step from the best so far."""
        assert self.best is not None
        n, count = len(self.best.theta), len(self.best.theta) + len(self.best.linear)
        step = self._share * self._step
        self.at = (self.best.m + step[count:], self.best.theta + step[:n], self.best.linear + step[n:count])

    def _back(self) -> None:
        """The step was too long."""
        self._share /= 3
        if self._share < 0.03 or self._step is None:
            self.done = True
            return
        self._go()


def bounded_step(H: Array, g: Array, low: Array, high: Array, held: Array) -> Array:
    """Minimiser of g d + d H d / 2 with low <= d <= high, by holding what would leave; zero where held."""
    d, free, fixed = np.zeros(len(g)), ~held, np.zeros(len(g))
    scale = np.sqrt(np.maximum(np.diag(H), 1e-300))
    for _ in range(len(g) + 1):
        index = np.flatnonzero(free)
        if len(index) == 0:
            break
        s = scale[index]
        A = H[np.ix_(index, index)] / np.outer(s, s) + FAR * np.eye(len(index))
        d = fixed.copy()
        d[index] = -np.linalg.solve(A, (g[index] + H[index] @ fixed) / s) / s
        outside = np.maximum(low - d, d - high) * scale
        outside[~free] = 0.0
        worst = int(np.argmax(outside))
        if outside[worst] <= 1e-12:
            break
        fixed[worst] = low[worst] if d[worst] < low[worst] else high[worst]
        free[worst] = False
        d = fixed.copy()
    return np.clip(d, np.where(held, 0.0, low), np.where(held, 0.0, high))


def _means(axes: Sequence[Axis]) -> Array:
    return np.array([axis.mean for axis in axes])
