"""How a parameter of one vehicle changed along its recordings: the likeliest change of each kind, and how sure that is.

Given what recordings scatter by and vehicles spread by, everything is Gaussian: the estimate of a change, its variance
and the gain in likelihood follow from sums over the recordings. A p-value counts all that was looked at: each
parameter, each kind, each place of a step. Which kind it is, and when a step was, follows from the evidence, its size
integrated out: the posterior over the places of a step gives the interval of its date.

Sources: the probability is one minus the least posterior probability of no change that a p-value leaves, Sellke,
Bayarri & Berger, Calibration of p values for testing precise null hypotheses, The American Statistician 55 (2001); a
walk is tested by its score, whose distribution is a sum of weighted squares: Nyblom, Testing for the constancy of
parameters over time, JASA 84 (1989), tails by Kuonen, Saddlepoint approximations for distributions of quadratic forms,
Biometrika 86 (1999).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy.linalg as la
from scipy.optimize import brentq
from scipy.special import chdtrc, gammaincc, log_ndtr, ndtri, stdtr

from greybox_id.base.shorthands import Array
from greybox_id.fitting.fit import Z

from .hierarchy import Population

STEADY = 0.9
"""Share of vehicles that are steady before anything is seen; it only enters the probability that is told."""
LEVEL = 0.95
"""Posterior probability of the interval of a date."""
DOUBTFUL = 0.01
"""p-value from which on neither a walk's tail nor its evidence is had exactly: it would not be found anyway."""
CONSTANT, SLOPE, STEP, WALK = ("constant", "slope", "step", "walk")
TESTED = (SLOPE, STEP, WALK)


@dataclass(frozen=True)
class VehicleChange:
    """A parameter of a vehicle along its recordings.

    Attributes
    ----------
    vehicle, parameter : their numbers.
    kind : "slope", "step" or "walk", whichever has most evidence.
    change, variance : from the first recording to the last, or of the step; in the coordinate of the estimate.
    at, earliest, latest : number of the vehicle's recording in their order at which a step begins, the likeliest, and
        the interval that holds 95 % of its posterior; -1 for others.
    p : how often a steady vehicle would seem to change so much, in any parameter.
    probability : that it changed.
    moved : (recordings,) how far the parameter is from where it began.
    wander : variance of a walk's increments over the whole series.
    begin, begin_variance, begin_shared : where it began, its variance, and its covariance with the change.
    drifts : whether it is found at the fleet's false discovery rate.
    """

    vehicle: int
    parameter: int
    kind: str
    change: float
    variance: float
    at: int
    earliest: int
    latest: int
    p: float
    probability: float
    moved: Array = field(compare=False)
    wander: float = 0.0
    begin: float = math.nan
    begin_variance: float = 0.0
    begin_shared: float = 0.0
    drifts: bool = False

    def designs(self, x: Array) -> Array:
        """The share of each of its unknowns that recordings have: (recordings, unknowns)."""
        if self.kind == WALK:
            return _walk(x)
        entry = x if self.kind == SLOPE else (np.arange(len(x)) >= self.at).astype(float)
        return entry[:, None]


def changes_of(
    vehicle: int,
    information: Array,
    vector: Array,
    population: Population,
    x: Array,
    taken: Sequence[VehicleChange],
    dof: float,
) -> list[VehicleChange]:
    """The likeliest change of every parameter that is not taken yet, beside those that are."""
    count, size = vector.shape
    steps = np.tril(np.ones((count, count)))[:, 1:count].copy()  # column c: recordings from c + 1 on
    designs = np.concatenate([x[:, None], steps], axis=1)
    free = [k for k in range(size) if all(change.parameter != k for change in taken)]
    matrix, side = _unknowns(information, vector, population, x, taken)
    unit = 1.0 / np.sqrt(np.diag(matrix))  # unknowns differ in size by many orders
    inverse = la.inv(matrix * np.outer(unit, unit)) * np.outer(unit, unit)
    # how every recording's own shift of a parameter is tied to the unknowns: (parameters, unknowns, recordings)
    cross = np.zeros((len(free), len(side), count))
    cross[:, :size] = information[:, free].transpose(1, 2, 0)
    first = size
    for change in taken:
        share = change.designs(x)
        tied = information[:, change.parameter, free]
        cross[:, first : first + share.shape[1]] = share.T[None] * tied.T[:, None, :]
        first += share.shape[1]
    alone = information[:, free, free].T
    shifts = -cross.transpose(0, 2, 1) @ (inverse @ cross)
    shifts[:, np.arange(count), np.arange(count)] += alone
    score = vector[:, free].T - cross.transpose(0, 2, 1) @ (inverse @ side)
    left = np.einsum("pdj,jd->pd", designs.T @ shifts, designs)
    usable = left > 1e-9 * np.maximum(alone @ np.square(designs), 1e-300)
    with np.errstate(divide="ignore"):
        variance = np.where(usable, 1.0 / np.where(usable, left, 1.0), np.inf)
    moved = np.where(usable, (score @ designs) * np.where(usable, variance, 0.0), 0.0)
    z = np.where(usable, np.abs(moved) / np.sqrt(np.where(usable, variance, 1.0)), 0.0)
    evidence, size_of = _evidence(moved, variance, z)
    walk = _walk(x)
    grown, pulled = walk.T @ shifts @ walk, score @ walk
    kinds = (_two_sided(z[:, 0], dof), np.minimum(_two_sided(np.max(z[:, 1:], axis=1), dof) * max(1, count - 1), 1.0),
             _wandering(grown, pulled, dof))  # fmt: skip
    p = np.minimum(1.0, len(TESTED) * len(free) * np.min(kinds, axis=0))
    results = []
    for row, parameter in enumerate(free):
        if not usable[row].any():
            continue
        body = (vehicle, parameter, float(p[row]))
        fixed = _fixed(body, moved[row], variance[row], evidence[row], designs)
        gain, wander = _walked(grown[row], pulled[row], size_of[row]) if p[row] < DOUBTFUL else (-math.inf, 0.0)
        best = float(evidence[row, 0] if fixed.kind == SLOPE else _averaged(evidence[row, 1:]))
        results.append(fixed if gain <= best else _as_walk(fixed, grown[row], pulled[row], wander, walk))
    return results


def _two_sided(z: Array, dof: float) -> Array:
    return np.asarray(2.0 * stdtr(dof, -z), dtype=np.float64)


def _evidence(change: Array, variance: Array, z: Array) -> tuple[Array, Array]:
    """Logarithm of the evidence of each design over none, changes as likely as the largest estimate says."""
    known = np.isfinite(variance)
    size = np.max(np.where(known, np.square(change) - np.where(known, variance, 0.0), 0.0), axis=1)
    size = np.maximum(size, 1e-300)
    share = np.where(known, size[:, None] / (size[:, None] + np.where(known, variance, 0.0)), 0.0)
    with np.errstate(divide="ignore"):
        return 0.5 * np.square(z) * share + 0.5 * np.log1p(-np.minimum(share, 1.0)), size


def _averaged(evidence: Array) -> float:
    most = float(np.max(evidence))
    return most + math.log(float(np.mean(np.exp(evidence - most))))


def _fixed(
    body: tuple[int, int, float], change: Array, variance: Array, evidence: Array, designs: Array
) -> VehicleChange:  # fmt: skip
    """Slope or step, and where."""
    vehicle, parameter, p = body
    stepped = _averaged(evidence[1:]) > evidence[0]
    at, earliest, latest = 0, -1, -1
    if stepped:
        if p < DOUBTFUL:
            earliest, latest = _dated(evidence[1:])
        at = 1 + int(np.argmax(evidence[1:]))
    return VehicleChange(
        vehicle, parameter, STEP if stepped else SLOPE, float(change[at]), float(variance[at]), at if stepped else -1,
        earliest, latest, p, _probability(p), float(change[at]) * designs[:, at],
    )  # fmt: skip


def _dated(evidence: Array) -> tuple[int, int]:
    """First and last place of a step in the shortest interval that holds 95 % of the posterior.

    All places are as likely before anything is seen.
    """
    share = np.exp(evidence - np.max(evidence))
    share /= np.sum(share)
    reached = np.concatenate([[0.0], np.cumsum(share)])
    ends = [(last - first, -(reached[last + 1] - reached[first]), first, last)
            for first in range(len(share)) for last in range(first, len(share))
            if reached[last + 1] - reached[first] >= LEVEL - 1e-12]  # fmt: skip
    _, _, first, last = min(ends)
    return first + 1, last + 1


def _walk(x: Array) -> Array:
    """What increments of a walk, of the variance of the whole, add to recordings: (recordings, recordings - 1)."""
    steps = np.tril(np.ones((len(x), len(x))))[:, 1:]
    grown: Array = steps * np.sqrt(np.maximum(np.diff(x), 0.0))
    return grown


def _wandering(grown: Array, pulled: Array, dof: float) -> Array:
    """p-values of walks: how often scatter alone makes as large a sum of squares."""
    total = np.sum(np.square(pulled), axis=1)
    square = grown @ grown
    one, two = np.trace(grown, axis1=1, axis2=2), np.trace(square, axis1=1, axis2=2)
    three = np.maximum(np.einsum("pab,pba->p", square, grown), 1e-300)
    with np.errstate(divide="ignore", invalid="ignore"):
        freedom = np.where(two > 0, two**3 / three**2, 1.0)
        at = np.where(two > 0, freedom + (total - one) / np.sqrt(two) * np.sqrt(freedom), 0.0)
    p = np.where(two > 0, gammaincc(freedom / 2.0, np.maximum(at, 0.0) / 2.0), 1.0)
    for row in np.flatnonzero(p < DOUBTFUL):
        p[row] = _tail(np.linalg.eigvalsh(grown[row]), float(total[row]))
    # the size of the scatter is known with so many degrees of freedom, as for slopes and steps
    result: Array = np.where(p < 1.0, 2.0 * stdtr(dof, ndtri(np.maximum(p, 1e-300) / 2.0)), 1.0)
    return result


def _tail(weights: Array, value: float) -> float:
    """How often a sum of squares of normal numbers with these weights exceeds a value above its mean."""
    shares, value = weights[weights > 1e-12 * weights[-1]] / weights[-1], value / weights[-1]  # of any unit
    if len(shares) == 1:
        return float(chdtrc(1.0, value))
    most = 0.5

    def slope(s: float) -> float:
        return float(np.sum(shares / (1.0 - 2.0 * s * shares))) - value

    if slope(0.0) > -1e-6 * value:  # at the mean the approximation below is zero over zero
        return 1.0
    s = brentq(slope, 0.0, most * (1.0 - 1e-12))
    bend = 2.0 * float(np.sum(np.square(shares / (1.0 - 2.0 * s * shares))))
    w = math.sqrt(max(2.0 * (s * value + 0.5 * float(np.sum(np.log1p(-2.0 * s * shares)))), 1e-12))
    v = s * math.sqrt(bend)
    return float(np.exp(log_ndtr(-(w + math.log(v / w) / w))))


def _walked(grown: Array, pulled: Array, size: float) -> tuple[float, float]:
    """Logarithm of the evidence of a walk over none, and the variance of its increments that has most of it.

    Its variance is as likely a tenth of what the largest estimate says as ten times that: a walk fits so much that the
    best of its variances would win over a step that is there.
    """
    values, axes = la.eigh(grown)
    values, along = np.maximum(values, 0.0), np.square(axes.T @ pulled)
    tried = size * np.geomspace(0.1, 10.0, 9)
    gain = [
        float(np.sum(0.5 * q * along / (1.0 + q * values) - 0.5 * np.log1p(q * values))) for q in tried
    ]  # fmt: skip
    return _averaged(np.array(gain)), float(tried[int(np.argmax(gain))])


def _as_walk(vehicle_change: VehicleChange, grown: Array, pulled: Array, wander: float, walk: Array) -> VehicleChange:
    covariance = la.inv(grown + np.eye(len(grown)) / wander)
    increments = covariance @ pulled
    end = walk[-1]
    return replace(
        vehicle_change, kind=WALK, change=float(end @ increments), variance=float(end @ covariance @ end), at=-1,
        earliest=-1,
        latest=-1, moved=walk @ increments, wander=wander,
    )  # fmt: skip


def dismissed(vehicle_change: VehicleChange) -> VehicleChange:
    """The same as one that was not found."""
    return replace(vehicle_change, p=1.0, probability=_probability(1.0))


def shows(change: VehicleChange, estimate: Array, covariance: Array) -> bool:
    """Whether a change shows in the parameter's own estimates, whatever they are correlated with.

    What recordings say of one parameter given all others leans on the correlations of their fits. Where a model's form
    is off, these make changes of others out of the change of one.
    """
    k = change.parameter
    weight = 1.0 / np.maximum(covariance[:, k, k], 1e-300)
    z = change.moved - np.sum(weight * change.moved) / np.sum(weight)
    size = float(np.sum(weight * z * z))
    result = float(np.sum(weight * z * estimate[:, k])) / max(size, 1e-300)
    return result * math.sqrt(max(size, 0.0)) > Z


def _unknowns(
    information: Array, vector: Array, population: Population, x: Array, taken: Sequence[VehicleChange]
) -> tuple[Array, Array]:
    """Precision of a vehicle's unknowns, where it begins and its changes, and that times their estimate."""
    size = len(population.mean)
    shares = [change.designs(x) for change in taken]
    starts = np.cumsum([size, *(share.shape[1] for share in shares)])
    prior = np.diag(1.0 / population.spread)
    matrix, side = np.zeros((starts[-1],) * 2), np.zeros(starts[-1])
    matrix[:size, :size] = information.sum(axis=0) + prior
    side[:size] = vector.sum(axis=0) + prior @ population.mean
    for change, share, start in zip(taken, shares, starts, strict=False):
        here = slice(start, start + share.shape[1])
        matrix[here, :size] = share.T @ information[:, :, change.parameter]
        matrix[:size, here] = matrix[here, :size].T
        side[here] = share.T @ vector[:, change.parameter]
        for other, its, begin in zip(taken, shares, starts, strict=False):
            tied = information[:, change.parameter, other.parameter]
            matrix[here, begin : begin + its.shape[1]] = share.T @ (its * tied[:, None])
        if change.kind == WALK:
            matrix[here, here] += np.eye(share.shape[1]) / change.wander
    return matrix, side


@dataclass(frozen=True)
class VehicleSeries:
    """A vehicle along its recordings: mean (recordings, parameters), covariance, changes, estimated together."""

    mean: Array
    covariance: Array
    changes: list[VehicleChange]


def together(
    information: Array, vector: Array, population: Population, x: Array, taken: Sequence[VehicleChange]
) -> VehicleSeries:  # fmt: skip
    """A vehicle at each of its recordings, and its changes, all estimated together.

    Parameters
    ----------
    information, vector : of the vehicle's recordings, their scatter included, in order.
    population : the population.
    x : from 0 to 1 along them.
    taken : its changes.

    Returns
    -------
    VehicleSeries
        What is not known of the population's mean included.
    """
    size, count = len(population.mean), len(x)
    matrix, side = _unknowns(information, vector, population, x, taken)
    unit = 1.0 / np.sqrt(np.diag(matrix))
    covariance = la.inv(matrix * np.outer(unit, unit)) * np.outer(unit, unit)
    estimate = covariance @ side
    pull = covariance[:, :size] / population.spread
    covariance = covariance + pull @ population.mean_covariance @ pull.T
    to = np.zeros((count, size, len(side)))
    to[:, :, :size] = np.eye(size)
    changes, start = [], size
    for change in taken:
        share = change.designs(x)
        here = slice(start, start + share.shape[1])
        to[:, change.parameter, here] = share
        end = share[-1]
        k = change.parameter
        changes.append(
            replace(
                change, change=float(end @ estimate[here]), variance=float(end @ covariance[here, here] @ end),
                moved=share @ estimate[here], begin=float(estimate[k]), begin_variance=float(covariance[k, k]),
                begin_shared=float(covariance[k, here] @ end),
            )
        )  # fmt: skip
        start += share.shape[1]
    return VehicleSeries(to @ estimate, to @ covariance @ to.transpose(0, 2, 1), changes)


def _probability(p: float) -> float:
    """That something changed, at most, for a p-value."""
    bound = -math.e * p * math.log(p) if 0 < p < 1 / math.e else 1.0 if p > 0 else 0.0
    odds = bound * STEADY / (1 - STEADY)
    return float(1.0 / (1.0 + odds))
