"""Which vehicle left where it was: a parameter that rises or falls along its recordings, or jumps between two of them.

A vehicle's recordings, in the order of their odometer or time, are those of `hierarchy` with one more unknown: the
change c of one parameter, along x from 0 to 1 (slope) or at once (step). Given T and W everything is Gaussian: the
estimate of c, its variance and the gain in likelihood follow from sums over the recordings. A p-value counts all that
was looked at: each parameter, slope or step, each place of a step. Over the fleet vehicles are found at a false
discovery rate (Benjamini & Hochberg); changes found are taken out before T and W are estimated again, which they would
else inflate.

Sources: Benjamini & Hochberg, Controlling the false discovery rate, JRSS B 57 (1995); the probability is one minus the
least posterior probability of no change that a p-value leaves, Sellke, Bayarri & Berger, Calibration of p values for
testing precise null hypotheses, The American Statistician 55 (2001).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as la
from scipy.special import logsumexp, stdtr

from ..combined import Z
from ..parameter import Array
from .hierarchy import NOT_INFORMED, Informed, Population, population, scattered

RATE = 0.05
"""False discovery rate."""
LEAST = 4
"""Recordings below which a change cannot be distinguished from scatter: two on either side of a step."""
ROUNDS = 3
"""How often changes are taken out and T and W estimated again."""
STEADY = 0.9
"""Share of vehicles that are steady before anything is seen; it only enters the probability that is told."""
CONSTANT, SLOPE, STEP = KINDS = ("constant", "slope", "step")


@dataclass(frozen=True)
class VehicleChange:
    """A parameter of a vehicle along its recordings.

    Attributes
    ----------
    vehicle, parameter : their numbers.
    kind : "slope" or "step", whichever has more evidence.
    change, variance : over the whole series, or of the step; in the coordinate of the estimate.
    at : number of the vehicle's recording in their order at which a step begins; -1 for slopes.
    p : how often a steady vehicle would seem to change so much, in any parameter.
    probability : that it changed.
    drifts : whether it is found at the fleet's false discovery rate.
    """

    vehicle: int
    parameter: int
    kind: str
    change: float
    variance: float
    at: int
    p: float
    probability: float
    drifts: bool = False

    def along(self, x: Array) -> Array:
        """The share of the change that each recording has, in their order."""
        return x if self.kind == SLOPE else (np.arange(len(x)) >= self.at).astype(float)


@dataclass(frozen=True)
class Drifted:
    """A fleet with its changes.

    Attributes
    ----------
    population : without what changed: vehicles where their series begin.
    changes : the likeliest change of every parameter of every vehicle that has enough recordings.
    today, covariance : (vehicles, parameters) and (vehicles, parameters, parameters) where series end.
    """

    population: Population
    changes: tuple[VehicleChange, ...]
    today: Array
    covariance: Array


def drifted(seen: Informed, order: Sequence[np.ndarray[tuple[int], np.dtype[np.int64]]], x: Sequence[Array]) -> Drifted:
    """Find what changed.

    Parameters
    ----------
    seen : what recordings say.
    order : per vehicle, its recordings' numbers in the order in which they were driven.
    x : per vehicle, from 0 to 1 along that order.
    """
    found = population(seen)
    changes: list[VehicleChange] = []
    kept: frozenset[tuple[int, int, str, int]] = frozenset()
    for _ in range(ROUNDS):
        information, vector = scattered(seen, found.scatter)
        changes = _all(information, vector, found, order, x)
        now = frozenset((own.vehicle, own.parameter, own.kind, own.at) for own in changes if own.drifts)
        if now == kept:
            break
        kept = now
        found = population(_without(seen, [own for own in changes if own.drifts], order, x), found)
    information, vector = scattered(seen, found.scatter)
    today, covariance = found.vehicle.copy(), found.covariance.copy()
    told = {(own.vehicle, own.parameter): own for own in changes}
    for vehicle in {own.vehicle for own in changes if own.drifts}:
        rows, taken = order[vehicle], [own for own in changes if own.drifts and own.vehicle == vehicle]
        today[vehicle], covariance[vehicle], final = together(information[rows], vector[rows], found, x[vehicle], taken)
        told |= {(vehicle, own.parameter): own for own in final}
    return Drifted(found, tuple(told.values()), today, covariance)


def _without(
    seen: Informed, changes: Sequence[VehicleChange], order: Sequence[np.ndarray[tuple[int], np.dtype[np.int64]]],
    x: Sequence[Array],
) -> Informed:  # fmt: skip
    """What recordings say of the vehicle before it changed."""
    vector = seen.vector.copy()
    for own in changes:
        rows = order[own.vehicle]
        moved = own.change * own.along(x[own.vehicle])
        vector[rows] -= seen.information[rows][:, :, own.parameter] * moved[:, None]
    return replace(seen, vector=vector)


def _all(
    information: Array, vector: Array, found: Population, order: Sequence[np.ndarray[tuple[int], np.dtype[np.int64]]],
    x: Sequence[Array],
) -> list[VehicleChange]:  # fmt: skip
    """The changes of all vehicles; those found at the rate are taken out before the vehicle's others are looked for."""
    size = len(found.mean)
    dof = float(max(1, len(vector) - len(order)))  # with which the scatter of recordings is known
    series = [own for own in range(len(order)) if len(order[own]) >= LEAST]
    taken: dict[int, list[VehicleChange]] = {own: [] for own in series}
    best: dict[int, list[VehicleChange]] = {}
    active = list(series)
    for _ in range(size):
        for own in active:
            rows = order[own]
            best[own] = _of_vehicle(own, information[rows], vector[rows], found, x[own], taken[own], dof)
        firsts = {own: min(best[own], key=lambda each: each.p) for own in active if best[own]}
        hits = _discovered([own.p for own in firsts.values()])
        active = [own for own, hit in zip(firsts, hits, strict=True) if hit]
        for own in active:
            taken[own].append(replace(firsts[own], drifts=True))
        if not active:
            break
    changes: list[VehicleChange] = []
    for own in series:
        done = {each.parameter for each in taken[own]}
        changes += [*taken[own], *(each for each in best[own] if each.parameter not in done)]
    return changes


def _of_vehicle(
    vehicle: int,
    information: Array,
    vector: Array,
    found: Population,
    x: Array,
    taken: Sequence[VehicleChange],
    dof: float,
) -> list[VehicleChange]:
    """The likeliest change of every parameter that is not taken yet, beside those that are."""
    count, size = vector.shape
    steps = np.tril(np.ones((count, count)))[:, 1:count].copy()  # column c: recordings from c + 1 on
    designs = np.concatenate([x[:, None], steps], axis=1)
    own, side = _unknowns(information, vector, found, x, taken)
    known = len(side)
    unit = 1.0 / np.sqrt(np.diag(own))  # unknowns differ in size by many orders
    factor = la.cho_factor(own * np.outer(unit, unit))
    looked_at = size - len(taken)
    results = []
    for parameter in range(size):
        if any(change.parameter == parameter for change in taken):
            continue
        cross = np.zeros((known, designs.shape[1]))
        cross[:size] = np.einsum("jd,jp->pd", designs, information[:, :, parameter])
        for k, change in enumerate(taken, size):
            cross[k] = designs.T @ (change.along(x) * information[:, change.parameter, parameter])
        solved = unit[:, None] * la.cho_solve(factor, unit[:, None] * cross)
        precision = np.einsum("jd,j->d", np.square(designs), information[:, parameter, parameter])
        left = precision - np.einsum("pd,pd->d", cross, solved)
        score = designs.T @ vector[:, parameter] - solved.T @ side
        usable = left > 1e-9 * np.maximum(precision, 1e-300)
        if not usable.any():
            continue
        variance = np.where(usable, 1.0 / np.where(usable, left, 1.0), np.inf)
        estimate = np.where(usable, score * np.where(usable, variance, 0.0), 0.0)
        likeliest = _likeliest(vehicle, parameter, estimate, variance, looked_at, dof)
        if not _shows(likeliest, information, vector, x):
            likeliest = replace(likeliest, p=1.0, probability=_probability(1.0))
        results.append(likeliest)
    return results


def _shows(change: VehicleChange, information: Array, vector: Array, x: Array) -> bool:
    """Whether a change shows in the parameter's own estimates, whatever they are correlated with.

    What recordings say of one parameter given all others leans on the correlations of their fits. Where a model's form
    is off, these make changes of others out of the change of one.
    """
    k, weak = change.parameter, np.diag(NOT_INFORMED * np.median(np.diagonal(information, axis1=1, axis2=2), axis=0))
    unit = 1.0 / np.sqrt(np.maximum(np.diagonal(information + weak, axis1=1, axis2=2), 1e-300))
    scaled = (information + weak) * unit[:, :, None] * unit[:, None, :]
    covariance = np.linalg.pinv(scaled, hermitian=True) * unit[:, :, None] * unit[:, None, :]
    weight = 1.0 / np.maximum(covariance[:, k, k], 1e-300)
    own = np.einsum("jp,jp->j", covariance[:, k], vector)
    z = change.along(x)
    z = z - np.sum(weight * z) / np.sum(weight)
    size = float(np.sum(weight * z * z))
    found = float(np.sum(weight * z * own)) / max(size, 1e-300)
    return found * change.change > 0 and abs(found) * math.sqrt(size) > Z


def _unknowns(
    information: Array, vector: Array, found: Population, x: Array, taken: Sequence[VehicleChange]
) -> tuple[Array, Array]:
    """Precision of a vehicle's unknowns, where it begins and its changes, and that times their estimate."""
    size = len(found.mean)
    prior = np.diag(1.0 / found.spread)
    own, side = np.zeros((size + len(taken),) * 2), np.zeros(size + len(taken))
    own[:size, :size] = information.sum(axis=0) + prior
    side[:size] = vector.sum(axis=0) + prior @ found.mean
    for k, change in enumerate(taken, size):
        z = change.along(x)
        own[k, :size] = own[:size, k] = np.einsum("j,jp->p", z, information[:, :, change.parameter])
        side[k] = z @ vector[:, change.parameter]
        for other, earlier in enumerate(taken, size):
            own[k, other] = np.sum(z * earlier.along(x) * information[:, change.parameter, earlier.parameter])
    return own, side


def together(
    information: Array, vector: Array, found: Population, x: Array, taken: Sequence[VehicleChange]
) -> tuple[Array, Array, list[VehicleChange]]:
    """A vehicle at the end of its recordings, and its changes, all estimated together.

    Parameters
    ----------
    information, vector : of the vehicle's recordings, their scatter included, in order.
    found : the population.
    x : from 0 to 1 along them.
    taken : its changes.

    Returns
    -------
    mean, covariance : (parameters,) and (parameters, parameters), what is not known of the population's mean included.
    changes : with their estimates.
    """
    size = len(found.mean)
    own, side = _unknowns(information, vector, found, x, taken)
    unit = 1.0 / np.sqrt(np.diag(own))
    covariance = la.inv(own * np.outer(unit, unit)) * np.outer(unit, unit)
    estimate = covariance @ side
    pull = covariance[:, :size] / found.spread
    covariance = covariance + pull @ found.mean_covariance @ pull.T
    end = np.zeros((size, len(side)))
    end[:, :size] = np.eye(size)
    for k, change in enumerate(taken, size):
        end[change.parameter, k] = change.along(x)[-1]
    changes = [
        replace(change, change=float(estimate[k]), variance=float(covariance[k, k]))
        for k, change in enumerate(taken, size)
    ]
    return end @ estimate, end @ covariance @ end.T, changes


def _likeliest(
    vehicle: int, parameter: int, change: Array, variance: Array, looked_at: int, dof: float
) -> VehicleChange:
    """Slope or step, and where; its p-value for all that was looked at."""
    z = np.abs(change) / np.sqrt(variance)
    p_slope, p_step = 2.0 * stdtr(dof, -float(z[0])), 2.0 * stdtr(dof, -float(np.max(z[1:]))) * max(1, len(z) - 1)
    p = float(min(1.0, 2.0 * looked_at * min(p_slope, p_step)))
    # evidence of each design, the size of the change as likely as the largest estimate says
    size = max(float(np.max(np.where(np.isfinite(variance), np.square(change) - variance, 0.0))), 1e-300)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(np.isfinite(variance), size / (size + variance), 0.0)
        evidence = 0.5 * np.square(z) * share + 0.5 * np.log1p(-share)
    step = 1 + int(np.argmax(evidence[1:]))
    stepped = float(logsumexp(evidence[1:]) - np.log(len(evidence) - 1)) > evidence[0]
    at = step if stepped else 0
    return VehicleChange(
        vehicle, parameter, STEP if stepped else SLOPE, float(change[at]), float(variance[at]), step if stepped else -1,
        p, _probability(p),
    )  # fmt: skip


def _probability(p: float) -> float:
    """That something changed, at most, for a p-value."""
    bound = -math.e * p * math.log(p) if 0 < p < 1 / math.e else 1.0 if p > 0 else 0.0
    odds = bound * STEADY / (1 - STEADY)
    return float(1.0 / (1.0 + odds))


def _discovered(p: Sequence[float]) -> list[bool]:
    """Which of several hypotheses are rejected at the false discovery rate."""
    if not p:
        return []
    order = np.argsort(p)
    passed = np.flatnonzero(np.sort(p) <= RATE * np.arange(1, len(p) + 1) / len(p))
    found = np.zeros(len(p), dtype=bool)
    if len(passed):
        found[order[: passed[-1] + 1]] = True
    return [bool(own) for own in found]
