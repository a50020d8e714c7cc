"""Which of many causes are present, in a linear and Gaussian problem: evidence maximisation, and scores of sets.

A cause that is present has a magnitude of its usual size (slab), any other one lies in its zone (spike). During a
search, each magnitude has a prior variance of its own that maximises the evidence: those that the recording does not
support shrink to their zones. Sources: MacKay, Neural Computation 4, 1992; Tipping, J. Mach. Learn. Res. 1, 2001;
George & McCulloch, J. Am. Stat. Assoc. 88, 1993, for the spike and slab.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np
from scipy.linalg import lapack

from ...base.shorthands import Array, Mask
from ...engine.solvers.gauss_newton import least_within
from .calibration import CAL
from .problem import RIDGE, Linear, inverse

NEVER = -np.inf


@dataclass(frozen=True)
class Quadratic:
    """Normal equations of a linearised problem.

    Attributes
    ----------
    about : the linearised problem.
    G, g : (K, K), (K,) products of columns, and of columns with residuals.
    rr : sum of squared residuals.
    """

    about: Linear
    G: Array
    g: Array
    rr: float

    @staticmethod
    def of(about: Linear) -> Quadratic:
        """Normal equations of a linearised problem."""
        products = about.columns.T @ about.columns
        return Quadratic(about, products[1:, 1:].copy(), products[1:, 0].copy(), float(products[0, 0]))

    def precision(self, variance: Array) -> Array:
        """(K,) prior precisions of all coordinates, with these variances of magnitudes."""
        sd = self.about.sd.copy()
        sd[self.about.main] = np.sqrt(variance)
        return np.asarray(1 / np.maximum(sd, 1e-150) ** 2)

    def best(self, variance: Array, within: tuple[Array, Array] | None = None, damping: float | Array = 0.0) -> Array:
        """(K,) coordinates of least cost within bounds.

        Parameters
        ----------
        variance : (causes,) prior variances of magnitudes.
        within : (K,) and (K,) how far coordinates may go from where they are; None: to their bounds.
        damping : (K,) precisions that hold coordinates where they are.
        """
        about, prec = self.about, self.precision(variance)
        low, high = within or (about.low - about.at, about.high - about.at)
        slope, H = self.g + prec * (about.at - about.mean), self.G + np.diag(prec + damping)
        return np.asarray(about.at + least_within(H, slope, low, high, np.ones(len(H), dtype=bool)))

    def switched(self, variance: Array, zone: Array, usual: Array) -> Array:
        """(causes,) prior variances of magnitudes of most evidence, from the zone to three times the usual size.

        No magnitude may be more than `CAL.leaves` of these standard deviations off: before a cause leaves, everything
        else has to be where it belongs without it.
        """
        about, main = self.about, self.about.main
        least = np.maximum(zone**2, ((about.at - about.mean)[main] / CAL.leaves) ** 2)
        for _ in range(CAL.evidence_rounds):
            off = (self.best(variance) - about.mean)[main]
            known = 1 - np.diag(inverse(self.G + np.diag(self.precision(variance))))[main] / variance
            new = np.clip(off**2 / np.maximum(known, 1e-3), least, np.maximum(least, (3 * usual) ** 2))
            done = np.max(np.abs(np.log(new / variance)), initial=0.0) < CAL.evidence_settled
            variance = new
            if done:
                break
        return variance


class Sets:
    """Scores of sets of causes: log evidence with all else marginalised, and log prior odds.

    Parameters
    ----------
    quadratic : normal equations.
    zone, usual : (causes,) standard deviations of spike and slab.
    odds : (causes,) log-odds against each.
    never : pairs of causes that are forms of one another, and are never both in a set.
    """

    def __init__(
        self, quadratic: Quadratic, zone: Array, usual: Array, odds: Array, never: Sequence[tuple[int, int]]
    ) -> None:
        about = quadratic.about
        ours = about.cause >= 0
        rest = ~ours
        H = quadratic.G[np.ix_(rest, rest)] + np.diag(1 / about.sd[rest] ** 2)
        off = about.mean - about.at
        g = quadratic.g + quadratic.G @ off  # at the means of everything
        scale = 1 / np.sqrt(np.diag(H))
        factor = np.linalg.cholesky(H * np.outer(scale, scale) + RIDGE * np.eye(len(H)))
        cross = scale[:, None] * quadratic.G[np.ix_(rest, ours)]
        both = np.linalg.solve(factor, np.column_stack([cross, scale * g[rest]]))
        C, d = both[:, :-1], both[:, -1]
        self.S = quadratic.G[np.ix_(ours, ours)] - C.T @ C
        self.b = g[ours] - C.T @ d
        self.raw = np.diag(quadratic.G)[ours]
        self.cause, self.main, self.sd = about.cause[ours], about.main[ours], about.sd[ours]
        self.low, self.high, self.mean = about.low[ours], about.high[ours], about.mean[ours]
        at_means = 0.5 * (quadratic.rr + 2 * float(quadratic.g @ off) + float(off @ quadratic.G @ off))
        self.left = at_means - 0.5 * float(d @ d)
        if not self.left > CAL.rounding * at_means:  # only rounding is left where the vehicle spins
            self.left = np.inf
        self.base = -self.left
        self.base += -float(np.sum(np.log(np.diag(factor)))) + float(np.sum(np.log(scale / about.sd[rest])))
        self.spike = zone**2
        self.slab = np.maximum(usual**2, 9 * self.spike)
        self.odds, self.never = odds, tuple(never)
        self._cache = dict[bytes, tuple[float, float]]()

    def reaching(self, low: Array, high: Array) -> Sets:
        """The same scores with these bounds of magnitudes, (causes,) each."""
        other = copy(self)
        other.low, other.high, other._cache = self.low.copy(), self.high.copy(), {}
        other.low[self.main], other.high[self.main] = low, high
        return other

    def _precision(self, included: Mask) -> Array:
        """(..., coordinates) prior precisions with sets, (..., causes)."""
        prec = np.where(included[..., self.cause], 1 / self.sd**2, 1e12 / self.sd.clip(1e-12) ** 2)
        prec[..., self.main] = 1 / np.where(included, self.slab, self.spike)
        return np.asarray(prec)

    def score(self, included: Mask) -> float:
        """Log evidence and log prior odds of a set, (causes,)."""
        return self._score_and_fit(included)[0]

    def cost(self, included: Mask) -> float:
        """Half the squares of residuals and prior that a set leaves, all else at its best within its bounds."""
        fit = self._score_and_fit(included)[1]
        if fit == NEVER and not self._excluded(included):
            fit = self._within_bounds(included)
        return self.left - fit

    def _within_bounds(self, included: Mask) -> float:
        """By how much a set lowers this cost with no coordinate beyond its bounds."""
        H, free = self.S + np.diag(self._precision(included)), np.ones(len(self.b), dtype=bool)
        low, high = np.minimum(self.low - self.mean, 0.0), np.maximum(self.high - self.mean, 0.0)
        off = least_within(H, self.b, low, high, free)
        fit = -float(self.b @ off + 0.5 * off @ H @ off)
        return fit if 0.0 <= fit <= self.left else NEVER  # only rounding is left where the vehicle spins

    def _excluded(self, included: Mask) -> bool:
        return any(included[a] and included[b] for a, b in self.never)

    def _score_and_fit(self, included: Mask) -> tuple[float, float]:
        key = included.tobytes()
        if key not in self._cache:
            self._score([included])
        return self._cache[key]

    def _score(self, sets: Sequence[Mask]) -> None:
        """Score sets, all at once as far as possible: their matrices are small."""
        new = {item.tobytes(): item for item in sets}
        new = {key: item for key, item in new.items() if key not in self._cache}
        self._cache |= dict.fromkeys(new, (NEVER, NEVER))
        possible = {key: item for key, item in new.items() if not self._excluded(item)}
        if possible:
            self._cache |= dict(zip(possible, self._scored(np.array(list(possible.values()))), strict=True))

    def _scored(self, included: Mask) -> list[tuple[float, float]]:
        """Score and fit of sets, (n, causes)."""
        by = 1 / np.sqrt(self._precision(included))
        H, b = np.ascontiguousarray(self.S * (by[:, :, None] * by[:, None, :])), by * self.b
        x = np.full(by.shape, np.nan)
        diagonals = np.einsum("nkk->nk", H)  # a view
        diagonals += 1.0
        for k, (each, slope) in enumerate(zip(H, b, strict=True)):  # symmetric: LAPACK's column order without a copy
            _, solution, failed = lapack.dposv(each.T, slope, lower=1, overwrite_a=1)
            if not failed:
                x[k] = solution
        magnitudes, size = self.mean - by * x, 1e-6 * np.sqrt(self.slab)[self.cause]
        off = (magnitudes < self.low - size) | (magnitudes > self.high + size)
        fits = 0.5 * np.sum(b * x, axis=1)
        # sets without a fit, or that leave rounding alone, as where the vehicle spins
        never = np.any(off & self.main & included[:, self.cause], axis=1) | ~(fits <= self.left)
        scores = fits - np.sum(np.log(np.where(never[:, None], 1.0, diagonals)), axis=1) - included @ self.odds
        return [(NEVER, NEVER) if no else (float(s), float(f)) for no, s, f in zip(never, scores, fits, strict=True)]

    def beyond(self, included: Mask) -> Mask:
        """(causes,) whether a cause is in the set and its best magnitude lies beyond its bounds."""
        magnitudes = self.sizes(included)[0]
        size = 1e-6 * np.sqrt(self.slab)
        return included & ((magnitudes < self.low[self.main] - size) | (magnitudes > self.high[self.main] + size))

    def sizes(self, included: Mask) -> tuple[Array, Array]:
        """(causes,) magnitudes and their sds given a set; sds are infinite where only rounding is left."""
        covariance = inverse(self.S + np.diag(self._precision(included)))
        variance = np.diag(covariance)[self.main]
        return (self.mean - covariance @ self.b)[self.main], np.sqrt(np.where(variance > 0, variance, np.inf))

    def climbed(self, included: Mask) -> Mask:
        """The best set that single additions, deletions and exchanges lead to."""
        best, score = included.copy(), self.score(included)
        if not np.isfinite(score):
            best = np.zeros_like(included)
            score = self.score(best)
        while True:
            tried = list[Mask]()
            for k in range(len(included)):
                other = best.copy()
                other[k] = not best[k]
                tried.append(other)
                if not best[k]:
                    for j in np.flatnonzero(best):
                        swap = other.copy()
                        swap[j] = False
                        tried.append(swap)
            self._score(tried)
            scores = [self.score(item) for item in tried]
            k = int(np.argmax(scores))
            if not scores[k] > score + 1e-6:  # stops at NaN, too
                return best
            best, score = tried[k], scores[k]


class Behind:
    """A refit that is to reach an evidence.

    Parameters
    ----------
    included : (causes,) inclusion mask of the refit.
    evidence : of causes, to be reached.
    """

    def __init__(self, included: Mask, evidence: float) -> None:
        self.included, self.evidence, self.last = included, evidence, np.inf

    def __call__(self, sets: Sets) -> bool:
        """Whether it will not, by its scores after a step: it lacks more than its further, halved steps may gain."""
        lacking = self.evidence - sets.base - sets.score(self.included)
        moved, self.last = abs(self.last - lacking), lacking
        return bool(lacking > CAL.steps_behind * moved)
