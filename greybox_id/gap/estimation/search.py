"""What hypotheses are refitted on: a bench, nuisances with their derivatives, and noise that whitens residuals.

Nuisances move little: their derivatives are taken once, about the best model so far, and kept (chords). A hypothesis
then costs a few simulations: one at its coordinates, and one beside them for each magnitude that has moved. Delays,
other abrupt nuisances and starts of runs enter to first order only: delays about no delay, lags about their estimates.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...base.shorthands import Array
from ...engine.simulation import FreeRuns
from .axes import Axis
from .calibration import CAL
from .form import curve_priors
from .hypothesis import Hypothesis, Start
from .noise import Whitener, blocks
from .problem import inverse


class Search:
    """Simulation, priors and whitening on which hypotheses are refitted.

    Parameters
    ----------
    bench : simulates the recordings.
    nuisances : parameters with priors.
    whitener : whitens residuals.
    trust : how many independent readings one counts as: less than one where model error outlasts a row, whatever the
        noise.
    error_scale : errors of tyre curves over their usual size.

    Attributes
    ----------
    nominal : the parameter vector about which nuisances are linearised.
    expanded : (shifts,) coordinates about which abrupt nuisances are linearised.
    simulations : how many were requested; the bench remembers some.
    """

    def __init__(
        self,
        bench: FreeRuns,
        nuisances: Sequence[Axis],
        whitener: Whitener,
        trust: float = 1.0,
        error_scale: float = 1.0,
    ) -> None:
        self.bench = bench
        self.moving, self._mix = curve_priors([axis for axis in nuisances if not axis.abrupt], error_scale)
        self.shifts = tuple(axis for axis in nuisances if axis.abrupt)
        self.nominal = np.array(bench.model.values)
        sds = np.array([axis.sd for axis in (*self.moving, *self.shifts)])
        shaped = np.append(np.any(self._mix != np.diag(np.diag(self._mix)), axis=0), [False] * len(self.shifts))
        self._reach = CAL.reach_sd * sds
        self._stride = np.where(shaped, CAL.stride * sds, np.inf)
        self.expanded = np.array([axis.null for axis in self.shifts])
        self.simulations = 0
        self.whitener, self.trust = whitener, trust
        self._columns = np.zeros((*bench.measured.shape, len(self.moving)))

    # ---- linearisation

    def about(self, hypothesis: Hypothesis | None, delays: bool = True) -> None:
        """Linearise nuisances about a hypothesis; None: about their prior means.

        Parameters
        ----------
        hypothesis : where all coordinates are.
        delays : whether the columns of delays are simulated anew; else they stay those of the hypothesis before.
        """
        self._expand(hypothesis)
        p = self.vector(hypothesis) if hypothesis else self.moved(np.array([axis.mean for axis in self.moving]))
        _, J, S = self.bench.linearise(p, [axis.index for axis in self.moving])
        before, first, count = self._columns, len(self.moving), len(self.shifts)
        self._columns = np.empty((*J.shape[:2], first + 2 * count + S.shape[2]))
        by_coordinate = self._mix * np.array([p[axis.index] if axis.relative else 1.0 for axis in self.moving])[:, None]
        self._columns[:, :, :first] = (J.reshape(self.bench.measured.size, first) @ by_coordinate).reshape(J.shape)
        self._columns[:, :, first + 2 * count :] = S
        self._secants(
            p, [delays or not axis.shift for axis in self.shifts], self._columns[:, :, first : first + 2 * count]
        )
        for k, axis in enumerate(self.shifts):
            if axis.shift and not delays:
                same = [first + k, first + count + k]
                self._columns[:, :, same] = before[:, :, same]
        if not abs(np.sum(self._columns)) < CAL.far:  # where the vehicle spins, derivatives overflow
            np.clip(np.nan_to_num(self._columns, copy=False), -CAL.far, CAL.far, out=self._columns)
        self._whiten()

    @contextmanager
    def counted(self, whitener: Whitener) -> Iterator[None]:
        """Whiten residuals by `whitener`, and linearise anywhere, within the context; afterwards all is as before."""
        before, kept = self.place(), self.whitener
        self.set_whitener(whitener)
        try:
            yield
        finally:
            self.whitener = kept
            self.back(before)

    def place(self) -> dict[str, object]:
        """The linearisation as it is, for `back`."""
        return {**vars(self), "nominal": self.nominal.copy(), "expanded": self.expanded.copy()}

    def back(self, place: dict[str, object]) -> None:
        """Return to a linearisation, whitened as now."""
        now, counted = self.whitener, self.simulations
        vars(self).update(place)
        self.simulations = counted
        if now is not self.whitener:
            self.set_whitener(now)

    def _expand(self, hypothesis: Hypothesis | None) -> None:
        """Linearise lags, plays and limits about a hypothesis; delays stay at none, and cut no segments."""
        for k, axis in enumerate(self.shifts):
            at = axis.null
            if hypothesis is not None and not axis.shift and not axis.narrow:
                at = float(hypothesis.linear[k])
            self.expanded[k] = at if abs(at - axis.null) > CAL.shift_beside * axis.sd else axis.null
            self.nominal[axis.index] = axis.value(float(self.expanded[k]))

    def _secants(self, p: Array, target: Sequence[bool], result: Array) -> None:
        """Columns of abrupt nuisances about `expanded`, (N, channels, 2 shifts): per unit, then for the least size.

        They are put into `result`, zero for those that are not in `target`. A candidate of the hypothesis stays at its
        magnitude in all columns but its own, which other hypotheses need, without it.
        """
        result[:] = 0.0
        requested = [k for k, want in enumerate(target) if want]
        spans, sides = list[tuple[float, float]](), list[Array]()
        for k in requested:
            axis, at = self.shifts[k], float(self.expanded[k])
            near, far = (CAL.at_once, 1.0) if at == axis.null else (-CAL.shift_beside, CAL.shift_beside)
            spans.append((at + near * axis.sd, at + far * axis.sd))
            sides += [self.placed(p, [axis], [x]) for x in (at, *spans[-1])]
        e = self.residuals(sides)
        for k, (start, end), at, one, other in zip(requested, spans, e[::3], e[1::3], e[2::3], strict=True):
            result[:, :, k] = (other - one) / (end - start)
            if self.expanded[k] == self.shifts[k].null:
                result[:, :, len(self.shifts) + k] = one - at

    def set_whitener(self, whitener: Whitener) -> None:
        """Whiten residuals by another whitener."""
        self.whitener = whitener
        self._whiten()

    def trusting(self, trust: float) -> None:
        """Let every reading count as `trust` independent ones."""
        self.trust = trust
        self._whiten()

    def weighed(self, values: Array) -> Array:
        """Residuals or derivatives, (N, channels, ...), whitened: half their squares are negative log-likelihood."""
        result: Array = self.whitener.white(values)
        return result if self.trust == 1.0 else result * np.sqrt(self.trust)

    def _whiten(self) -> None:
        self.white = self.weighed(self._columns).reshape(self.bench.measured.size, self._columns.shape[2])
        starts = np.tile(
            [self.whitener.stationary_sd[self._channel(k)] for k in self.bench.loose], len(self.bench.runs)
        )
        axes, count = (*self.moving, *self.shifts), len(self.shifts)
        sds = [*(axis.sd for axis in self.shifts), *[CAL.jumps_sd] * count, *starts]
        self.precision = np.diag(1 / np.array([*(axis.sd for axis in self.moving), *sds]) ** 2)
        self.means = np.array([*(axis.mean for axis in axes), *np.zeros(count + len(starts))])
        means = self.means[: len(axes)]
        low = np.maximum([axis.low for axis in axes], means - self._reach)
        high = np.minimum([axis.high for axis in axes], means + self._reach)
        self.stride = np.array([*self._stride, *np.full(count + len(starts), np.inf)])
        self.low = np.array([*low, *np.zeros(count), *np.full(len(starts), -np.inf)])
        self.high = np.array([*high, *np.ones(count), *np.full(len(starts), np.inf)])
        self.null_linear = np.array([*self.expanded, *np.zeros(count + len(starts))])
        self.gram = self.white.T @ self.white

    def among(self, indices: set[int]) -> NDArray[np.bool_]:
        """(nuisances,) whether a nuisance, moving or linear, is one of the parameters of these indices."""
        moving = [axis.index in indices for axis in self.moving]
        shifts = [axis.index in indices for axis in self.shifts]
        starts = len(self.means) - len(moving) - 2 * len(shifts)
        return np.array([*moving, *shifts, *shifts, *[False] * starts], dtype=bool)

    def _channel(self, state: int) -> int:
        return self.bench.channels.index(self.bench.model.states[state].name)

    def at_means(self) -> Hypothesis:
        """No candidate, and nuisances at their prior means; not simulated yet."""
        count, shape = len(self.moving), self.bench.measured.shape
        nothing, empty = np.zeros(shape), np.zeros((*shape, 0))
        return Hypothesis((), np.empty(0), self.means[:count], self.means[count:], np.inf, nothing, empty)

    def at_values(self, values: Mapping[str, float]) -> Hypothesis:
        """The same with moving nuisances at these values of their parameters, as far as bounds allow."""
        prior_means = self.at_means()
        means = prior_means.theta
        coordinates = [
            axis.coordinate(values[axis.name]) if axis.name in values else mean
            for axis, mean in zip(self.moving, means, strict=True)
        ]
        count = len(means)
        theta = means + np.linalg.solve(self._mix, np.array(coordinates) - means) if count else means
        return replace(prior_means, theta=np.clip(theta, self.low[:count], self.high[:count]))

    def values(self, hypothesis: Hypothesis) -> dict[str, float]:
        """Values of the parameters that moving nuisances stand for."""
        p = self.vector(hypothesis)
        return {axis.name: float(p[axis.index]) for axis in self.moving}

    # ---- vectors

    def vector(self, hypothesis: Hypothesis) -> Array:
        """The parameter vector of a hypothesis; first-order nuisances stay where they are expanded."""
        return self.placed(self.moved(hypothesis.theta), hypothesis.axes, hypothesis.m)

    def moved(self, theta: Array) -> Array:
        """The nominal parameter vector with nuisances moved."""
        means = np.array([axis.mean for axis in self.moving])
        return self.placed(self.nominal, self.moving, means + self._mix @ (theta - means))

    @staticmethod
    def placed(p: Array, axes: Sequence[Axis], coordinates: Sequence[float] | Array) -> Array:
        """A parameter vector with some axes at these coordinates."""
        result = p.copy()
        for axis, coordinate in zip(axes, coordinates, strict=True):
            result[axis.index] = axis.value(float(coordinate))
        return result

    def where(self, hypothesis: Hypothesis, axis: Axis) -> float:
        """The coordinate of an axis in a hypothesis."""
        for shift, coordinate in zip(self.moving, hypothesis.theta, strict=True):
            if shift.index == axis.index:
                return axis.coordinate(shift.value(float(coordinate)))
        for shift, at in zip(self.shifts, self.expanded, strict=True):
            if shift.index == axis.index:
                return float(at)
        return axis.null

    def first_orders(self, linear: Sequence[Array]) -> Array:
        """(N, channels, K) what K sets of linear nuisances add to simulations."""
        by = self._columns.reshape(self.bench.measured.size, self._columns.shape[2])[:, len(self.moving) :]
        return np.asarray(by @ (np.array(linear) - self.null_linear).T).reshape(*self.bench.measured.shape, len(linear))

    def moved_by(self, step: Array) -> Array:
        """(N, channels) what a step of all nuisances changes, to first order."""
        by = self._columns.reshape(self.bench.measured.size, self._columns.shape[2])
        return np.asarray(by @ step).reshape(self.bench.measured.shape)

    def released(self, linear: Array, axes: Sequence[Axis]) -> Array:
        """Linear nuisances with those that are candidates now at their null: they move as candidates instead."""
        candidates = self.among({axis.index for axis in axes})[len(self.moving) :]
        return np.where(candidates, self.null_linear, linear)

    def tolerated(self, hypothesis: Hypothesis) -> bool:
        """Whether one of its candidates is within its stated tolerance: it is no gap then."""
        nuisances = {axis.index: axis for axis in (*self.moving, *self.shifts)}
        return any(
            abs(item.coordinate(axis.value(float(at))) - item.mean) <= CAL.tolerated_sd * item.sd
            for axis, at in zip(hypothesis.axes, hypothesis.m, strict=True)
            for item in [nuisances.get(axis.index)]
            if item is not None
        )

    @staticmethod
    def start_of(hypothesis: Hypothesis) -> Start:
        """A start where a hypothesis stands."""
        return Start(hypothesis.candidates, hypothesis.m, hypothesis.theta, hypothesis.linear, slopes=hypothesis.J)

    def charge(self, hypothesis: Hypothesis) -> float:
        """Cost of the nuisances, twice their negative log prior; those that are candidates cost nothing."""
        off = np.concatenate([hypothesis.theta, hypothesis.linear]) - self.means
        return float(off @ self.prior_precision({axis.index for axis in hypothesis.axes}) @ off)

    def expected_charge(self, hypothesis: Hypothesis) -> float:
        """Expected `charge` if parameters are draws of their priors: how many nuisances the readings determine.

        At least none and at most all of them: where the vehicle spins, rounding leads beyond that.
        """
        held = ~self.among({axis.index for axis in hypothesis.axes})
        known, prior = (each[np.ix_(held, held)] for each in (self.gram, self.precision))
        determined = float(np.sum(inverse(known + prior) * known))
        return float(np.clip(determined, 0.0, np.count_nonzero(held)))

    def prior_precision(self, released: set[int]) -> Array:
        """(n, n) prior precision of the nuisances, zero for those that are candidates: tolerances do not hold these."""
        held = np.where(self.among(released), 0.0, 1.0)
        result: Array = held[:, None] * self.precision * held
        return result

    def residuals(self, P: Sequence[Array]) -> Array:
        """(K, N, channels) predictions minus readings; zero where no reading counts."""
        if not len(P):
            return np.zeros((0, *self.bench.measured.shape))
        self.simulations += len(P)
        y = self.bench.simulate(np.array(P))
        return np.where(self.bench.counted, y - self.bench.measured, 0.0)

    def covariance(self, hypothesis: Hypothesis) -> Array:
        """(m, m) covariance of a hypothesis' coordinates with nuisances marginalised, if residuals are noise."""
        return self._informed(hypothesis)[2]

    def scatter(self, hypothesis: Hypothesis) -> tuple[Array, Array]:
        """(m, m) covariances of a hypothesis' coordinates due to readings and due to the priors of nuisances.

        Their sum is `covariance`, or more: errors of an inexact model stay alike for seconds, and the gradients of
        blocks then scatter more than those of noise (a sandwich over blocks, after White, Econometrica 50, 1982).
        """
        W, undone, covariance = self._informed(hypothesis)
        by_priors = covariance @ undone.T @ self.precision @ undone @ covariance
        by_readings = covariance - by_priors
        W = W - self.white @ undone  # the part that nuisances cannot cancel
        r = self.weighed(hypothesis.e[:, :, None])
        pulls = np.sum((W * r.reshape(-1, 1)).reshape(hypothesis.J.shape), axis=1)
        gradients = np.array([np.sum(pulls[a:b], axis=0) for a, b in blocks(self.bench)])
        gradients -= np.mean(gradients, axis=0)
        seen = covariance @ (gradients.T @ gradients) @ covariance
        widening = np.sqrt(np.maximum(np.diag(seen) / np.maximum(np.diag(by_readings), 1e-300), 1.0))
        return by_readings * np.outer(widening, widening), by_priors

    def _informed(self, hypothesis: Hypothesis) -> tuple[Array, Array, Array]:
        """Whitened derivatives by the coordinates, nuisances' steps that cancel them, the coordinates' covariance."""
        plain = self.weighed(hypothesis.J).reshape(-1, hypothesis.J.shape[2])
        others = ~self.among({axis.index for axis in hypothesis.axes})
        cross = (plain.T @ self.white).T
        undone = np.zeros(cross.shape)
        undone[others] = inverse((self.gram + self.precision)[np.ix_(others, others)]) @ cross[others]
        S = plain.T @ plain - cross.T @ undone
        scale = np.sqrt(np.maximum(np.diag(S), 1e-300))
        covariance = np.linalg.pinv(S / np.outer(scale, scale), hermitian=True) / np.outer(scale, scale)
        return plain, undone, np.asarray(covariance)
