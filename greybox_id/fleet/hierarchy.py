"""What many fits say together: a population, its vehicles, and how recordings of one vehicle scatter.

    estimate of recording j of vehicle i = a_i + w_ij + e_ij,   a_i ~ N(mu, T),   w_ij ~ N(0, W),   e_ij ~ N(0, S_ij)

S_ij is the covariance of the fit, as information, so that a direction that a recording does not inform counts nothing;
W is what recordings of one vehicle scatter by beyond that, as other roads and other manoeuvres make them; T and W are
diagonal. All is Gaussian, so vehicles and recordings are smoothed exactly given T and W, which restricted maximum
likelihood chooses, by expectation and maximisation.

Sources: Laird & Ware, Random-effects models for longitudinal data, Biometrics 38 (1982); steps extrapolated after
Varadhan & Roland, Simple and globally convergent methods for accelerating the convergence of any EM algorithm,
Scandinavian Journal of Statistics 35 (2008).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg as la

from ..parameter import Array

STEPS, ENOUGH, FARTHEST = 100, 1e-4, 16.0
"""Most steps; the relative change of standard deviations below which they end; how far one is extrapolated at most."""
SMALL = 1e-4
"""T and W are not let fall below this share of a usual fit's variance, a hundredth of its standard deviation: it makes
no difference to anything, and at zero steps would never leave it again."""
NOT_INFORMED = 1e-9
"""Share of a fit's information in a direction, its prior's taken off, below which there is none."""
LEAST_DOF = 5.0
"""Degrees of freedom below which Student's t has no finite fourth moment, and no variance stands for it."""


@dataclass(frozen=True)
class Informed:
    """What recordings say of parameters, in the coordinates in which they are estimated.

    Attributes
    ----------
    information : (recordings, parameters, parameters).
    vector : (recordings, parameters), information times estimate.
    vehicle : (recordings,) number of the vehicle.
    vehicles : how many there are.
    """

    information: Array
    vector: Array
    vehicle: np.ndarray[tuple[int], np.dtype[np.int64]]
    vehicles: int


@dataclass(frozen=True)
class Population:
    """A population and its vehicles.

    Attributes
    ----------
    mean, mean_covariance : (parameters,) mu, and its covariance.
    spread : (parameters,) T, a variance.
    spread_dof : (parameters,) of freedom with which T is known.
    scatter : (parameters,) W, a variance.
    vehicle : (vehicles, parameters) smoothed.
    covariance : (vehicles, parameters, parameters), what is not known of mu included.
    """

    mean: Array
    mean_covariance: Array
    spread: Array
    spread_dof: Array
    scatter: Array
    vehicle: Array
    covariance: Array


def informed(covariance: Array, centre: Array, prior_mean: Array, prior_sd: Array, dof: Array) -> tuple[Array, Array]:
    """What one recording says: information and vector, with what its fit's priors said taken off.

    Parameters
    ----------
    covariance, centre : (k, k) and (k,) of the fit.
    prior_mean, prior_sd : (k,) of its priors; infinite sd for none.
    dof : (k,) of freedom of the standard deviations: a variance guessed from few blocks stands for one of Student's t.
    """
    size = np.sqrt(np.diag(covariance))
    if not np.all(np.isfinite(size)) or np.any(size <= 0):
        raise ValueError("no covariance")
    freedom = np.where(np.isfinite(dof), np.maximum(dof, LEAST_DOF), np.inf)
    wider = np.sqrt(np.where(np.isfinite(freedom), freedom / np.where(np.isfinite(freedom), freedom - 2, 1.0), 1.0))
    values, axes = la.eigh(covariance / np.outer(size, size))
    values = np.maximum(values, values[-1] * 1e-12)
    whole = (axes / values) @ axes.T / np.outer(size * wider, size * wider)
    prior = np.where(np.isfinite(prior_sd), 1.0 / np.square(np.where(np.isfinite(prior_sd), prior_sd, 1.0)), 0.0)
    vector = whole @ centre - prior * prior_mean
    # in units in which the fit's information has a unit diagonal
    unit = np.sqrt(np.diag(whole))
    values, axes = la.eigh((whole - np.diag(prior)) / np.outer(unit, unit))
    kept = values > NOT_INFORMED
    data = (axes[:, kept] * values[kept]) @ axes[:, kept].T * np.outer(unit, unit)
    within = axes[:, kept] @ (axes[:, kept].T @ (vector / unit)) * unit
    return data, within


def scattered(seen: Informed, scatter: Array) -> tuple[Array, Array]:
    """Information and vector about the vehicle: the recording's own scatter is in between."""
    mixed = np.eye(len(scatter)) + seen.information * scatter[None, None, :]
    solved = np.linalg.solve(mixed, np.concatenate([seen.information, seen.vector[:, :, None]], axis=2))
    information = solved[:, :, :-1]
    return 0.5 * (information + information.transpose(0, 2, 1)), solved[:, :, -1]


def population(seen: Informed, start: Population | None = None) -> Population:
    """The population that recordings come from.

    Parameters
    ----------
    seen : what recordings say; every parameter is informed by at least one.
    start : an earlier one, to begin at.
    """
    first, typical = _first(seen)
    spread, scatter = (first, typical) if start is None else (start.spread, start.scatter)
    size, least = len(spread), np.tile(SMALL * _noise(seen), 2)

    def stepped(at: Array) -> Array:
        variances = np.exp(at)
        found = _smoothed(seen, variances[:size], variances[size:])
        new: Array = np.log(np.maximum(np.concatenate([found[3], found[4]]), least))
        return new

    logs = np.log(np.maximum(np.concatenate([spread, scatter]), least))
    for _ in range(STEPS):
        once = stepped(logs)
        twice = stepped(once)
        if np.max(np.abs(twice - once)) < 2 * ENOUGH:
            logs = twice
            break
        move, bend = once - logs, twice - 2 * once + logs
        longer = min(max(1.0, float(la.norm(move) / max(la.norm(bend), 1e-300))), FARTHEST)
        logs = np.maximum(logs + 2 * longer * move + longer**2 * bend, np.log(least))
    spread, scatter = np.exp(logs[:size]), np.exp(logs[size:])
    mean, covariance, dof, _, _, own, own_covariance = _smoothed(seen, spread, scatter)
    return Population(mean, covariance, spread, dof, scatter, own, own_covariance)


def _noise(seen: Informed) -> Array:
    """The variance of each parameter that fits which inform it usually have, the others known."""
    own = np.diagonal(seen.information, axis1=1, axis2=2)
    return np.array([1.0 / np.median(of[of > 0]) for of in own.T])


def _first(seen: Informed) -> tuple[Array, Array]:
    """Where T and W start: the spread of estimates of recordings that inform a parameter well, and a tenth of it."""
    size = seen.vector.shape[1]
    first, typical = np.empty(size), np.empty(size)
    for k in range(size):
        own = seen.information[:, k, k]
        best = np.flatnonzero((own > 0) & (own >= np.median(own[own > 0])))
        estimates = np.array([la.lstsq(seen.information[j], seen.vector[j])[0][k] for j in best])
        noise = float(np.median(1.0 / own[best]))
        first[k] = max(float(np.var(estimates)), 0.01 * noise)
        typical[k] = 0.1 * max(first[k], noise)
    return first, typical


def _smoothed(seen: Informed, spread: Array, scatter: Array) -> tuple[Array, ...]:
    """Everything given T and W, and what T and W are then expected to be."""
    size = len(spread)
    information, vector = scattered(seen, scatter)
    of_vehicle, vector_of = np.zeros((seen.vehicles, size, size)), np.zeros((seen.vehicles, size))
    np.add.at(of_vehicle, seen.vehicle, information)
    np.add.at(vector_of, seen.vehicle, vector)
    # the population's mean
    mixed = np.eye(size) + of_vehicle * spread[None, None, :]
    solved = np.linalg.solve(mixed, np.concatenate([of_vehicle, vector_of[:, :, None]], axis=2))
    mean_covariance = la.inv(solved[:, :, :-1].sum(axis=0))
    mean_covariance = 0.5 * (mean_covariance + mean_covariance.T)
    mean = mean_covariance @ solved[:, :, -1].sum(axis=0)
    # vehicles
    prior = np.diag(1.0 / spread)
    given = np.linalg.inv(of_vehicle + prior)
    own = (given @ (vector_of + prior @ mean)[:, :, None])[:, :, 0]
    pull = given @ prior
    covariance = given + pull @ mean_covariance @ pull.transpose(0, 2, 1)
    away = given @ of_vehicle  # d(a - mu)/d(mu), but for its sign
    apart = given + away @ mean_covariance @ away.transpose(0, 2, 1)
    expected = np.mean(np.square(own - mean) + np.diagonal(apart, axis1=1, axis2=2), axis=0)
    # the scatter of recordings
    inner = np.linalg.inv(seen.information + np.diag(1.0 / scatter))
    at = own[seen.vehicle]
    residual = seen.vector - (seen.information @ at[:, :, None])[:, :, 0]
    w = (inner @ residual[:, :, None])[:, :, 0]
    gain = inner @ seen.information
    of_w = inner + gain @ covariance[seen.vehicle] @ gain.transpose(0, 2, 1)
    scattered_by = np.mean(np.square(w) + np.diagonal(of_w, axis1=1, axis2=2), axis=0)
    reliable = 1.0 - np.clip(np.diagonal(given, axis1=1, axis2=2) / spread, 0.0, 1.0)
    dof = np.maximum(np.sum(np.square(reliable), axis=0) - 1.0, 1.0)
    return mean, mean_covariance, dof, expected, scattered_by, own, covariance
