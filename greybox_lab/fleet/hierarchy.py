"""What many fits say together: a population, its vehicles, and how recordings of one vehicle scatter.

    estimate of recording j of vehicle i = a_i + w_ij + e_ij,   a_i ~ N(mu, T),   w_ij ~ N(0, W),   e_ij ~ N(0, S_ij)

S_ij is the covariance of the fit, as information, so that a direction that a recording does not inform counts nothing;
W is what recordings of one vehicle scatter by beyond that, as other roads and other manoeuvres make them; T and W are
diagonal. All is Gaussian, so vehicles and recordings are smoothed exactly given T and W, which restricted maximum
likelihood chooses, by Fisher's scoring.

Source: Laird & Ware, Random-effects models for longitudinal data, Biometrics 38 (1982).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.linalg as la
from scipy.sparse import csr_matrix

from greybox_id.base.shorthands import Array

MOST_TURNS, ENOUGH, FARTHEST = 60, 1e-4, 10.0
"""Most steps of scoring; the relative change of standard deviations below which they end; by which factor one moves a
variance at most."""
SMALL = 1e-4
"""T and W are not let fall below this share of a usual fit's variance, a hundredth of its standard deviation: it makes
no difference to anything, and at zero steps would never leave it again."""
NOT_INFORMED = 1e-9
"""Share of a fit's information in a direction, its prior's taken off, below which there is none."""
PRIOR_NOISE = 2.0
"""A direction that a fit knows hardly better than its prior does informs nothing where the difference is within so many
standard deviations of the fit's own precision, which is guessed from blocks."""
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
    freedom : (recordings,) degrees of freedom of what they say.
    prior : information and vector, (parameters,) each, of the prior that the fits share: taken off each of them, it
        counts once, for the mean; directions that no recording informs are left to it.
    """

    information: Array
    vector: Array
    vehicle: np.ndarray[tuple[int], np.dtype[np.int64]]
    vehicles: int
    freedom: Array = field(default_factory=lambda: np.array([np.inf]))
    prior: tuple[Array, Array] | None = None

    def __post_init__(self) -> None:
        """One number of degrees of freedom is that of all."""
        object.__setattr__(self, "freedom", np.broadcast_to(self.freedom, len(self.vector)))

    def weighted(self, weight: Array) -> Informed:
        """The same with weights of recordings."""
        return replace(self, information=self.information * weight[:, None, None], vector=self.vector * weight[:, None])

    @cached_property
    def groups(self) -> list[np.ndarray[tuple[int], np.dtype[np.int64]]]:
        """The recordings of each vehicle."""
        order = np.argsort(self.vehicle, kind="stable")
        ends = np.searchsorted(self.vehicle[order], np.arange(1, self.vehicles))
        return np.split(order, ends)

    def sums(self, values: Array) -> Array:
        """Sums over the recordings of each vehicle: (recordings, ...) to (vehicles, ...)."""
        result: Array = (self._membership @ values.reshape(len(values), -1)).reshape(self.vehicles, *values.shape[1:])
        return result

    @cached_property
    def _membership(self) -> csr_matrix:
        count = len(self.vehicle)
        return csr_matrix((np.ones(count), (self.vehicle, np.arange(count))), shape=(self.vehicles, count))


@dataclass(frozen=True)
class Population:
    """A population and its vehicles.

    Attributes
    ----------
    mean, mean_covariance, mean_dof : (parameters,) mu, its covariance, and the degrees of freedom of its variances.
    spread : (parameters,) T, a variance.
    spread_dof : (parameters,) of freedom with which T is known.
    scatter : (parameters,) W, a variance.
    vehicle : (vehicles, parameters) smoothed.
    covariance : (vehicles, parameters, parameters), what is not known of mu, T and W included.
    unsure : the part of it that is not known of T and W.
    dof : (vehicles, parameters) of freedom of its variances.
    """

    mean: Array
    mean_covariance: Array
    mean_dof: Array
    spread: Array
    spread_dof: Array
    scatter: Array
    vehicle: Array
    covariance: Array
    unsure: Array
    dof: Array


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
    values, axes = np.linalg.eigh(covariance / np.outer(size, size))
    values = np.maximum(values, values[-1] * 1e-12)
    root = axes / np.sqrt(values) / (size * wider)[:, None]  # whole = root @ root.T
    back = (axes * np.sqrt(values)).T * (size * wider)  # its inverse
    prior = np.where(np.isfinite(prior_sd), 1.0 / np.square(np.where(np.isfinite(prior_sd), prior_sd, 1.0)), 0.0)
    vector = root @ (root.T @ centre) - prior * prior_mean
    # in units in which the fit knows every direction equally well: which share of that is the prior's
    share, axes = np.linalg.eigh(back * prior @ back.T)
    noise = PRIOR_NOISE * np.sqrt(2.0 / np.min(freedom))
    kept = 1.0 - share > np.maximum(share * noise, NOT_INFORMED)
    base = root @ axes[:, kept]
    return (base * (1.0 - share[kept])) @ base.T, base @ (axes[:, kept].T @ (back @ vector))


def scattered(seen: Informed, scatter: Array) -> tuple[Array, Array]:
    """Information and vector about the vehicle: the recording's own scatter is in between."""
    size = np.sqrt(scatter)
    inner = np.linalg.inv(np.eye(len(size)) + seen.information * np.outer(size, size))
    information = (np.eye(len(size)) - inner) / np.outer(size, size)
    return _symmetric(information), (inner @ (seen.vector * size)[:, :, None])[:, :, 0] / size


def population(seen: Informed, start: Population | None = None) -> Population:
    """The population that recordings come from.

    Parameters
    ----------
    seen : what recordings say; every parameter is informed by at least one.
    start : an earlier one, to begin at.
    """
    first, typical = _first(seen)
    least = np.tile(SMALL * _noise(seen), 2)
    at = np.maximum(np.concatenate([first, typical] if start is None else [start.spread, start.scatter]), least)
    given = _given(seen, at)
    for _ in range(MOST_TURNS):
        slope, curvature = _scored(seen, given, at)
        new = np.clip(at + _step(slope, curvature, at, least), at / FARTHEST, at * FARTHEST)
        new = np.maximum(new, least)
        moved = np.max(np.abs(np.log(new / at)))
        at = new
        given = _given(seen, at)
        if moved < 2 * ENOUGH:
            break
    return _told(seen, given, at)


def _step(slope: Array, curvature: Array, at: Array, least: Array) -> Array:
    """Fisher's scoring; what lies at its least and would go below stays."""
    move, free = np.zeros(len(at)), (at > least) | (slope > 0)
    unit = np.sqrt(np.maximum(np.diag(curvature), 1e-300))
    free &= np.diag(curvature) > 0
    block = np.ix_(free, free)
    if free.any():
        move[free] = la.lstsq(curvature[block] / np.outer(unit, unit)[block], slope[free] / unit[free])[0] / unit[free]
    return move


def _noise(seen: Informed) -> Array:
    """The variance of each parameter that fits which inform it usually have, the others known."""
    diagonals = np.diagonal(seen.information, axis1=1, axis2=2)
    return np.array([1.0 / np.median(of[of > 0]) if np.any(of > 0) else 1.0 for of in diagonals.T])


def marginal(seen: Informed) -> tuple[Array, Array]:
    """Every recording's own estimate and its covariance; a direction that it does not inform is as good as unknown.

    Returns
    -------
    (recordings, parameters) and (recordings, parameters, parameters).
    """
    diagonals = np.diagonal(seen.information, axis1=1, axis2=2)
    unit = 1.0 / np.sqrt(np.where(diagonals > 0, diagonals, 1.0 / _noise(seen)))
    both = unit[:, :, None] * unit[:, None, :]
    inverse = np.asarray(
        np.linalg.inv(seen.information * both + NOT_INFORMED * np.eye(diagonals.shape[1])), dtype=np.float64
    )
    covariance = _symmetric(inverse) * both
    return (covariance @ seen.vector[:, :, None])[:, :, 0], covariance


def _first(seen: Informed) -> tuple[Array, Array]:
    """Where T and W start: the spread of estimates of recordings that inform a parameter well, and a tenth of it."""
    size = seen.vector.shape[1]
    first, typical = np.empty(size), np.empty(size)
    estimates, _ = marginal(seen)
    noise = _noise(seen)
    for k in range(size):
        precision = seen.information[:, k, k]
        best = precision >= np.median(precision[precision > 0]) if np.any(precision > 0) else precision > 0
        first[k] = max(float(np.var(estimates[best, k])) if best.any() else 0.0, 0.01 * noise[k])
        typical[k] = 0.1 * max(first[k], noise[k])
    return first, typical


@dataclass(frozen=True)
class _Given:
    """All that is Gaussian, T and W given: recordings (A, and A times their estimate), vehicles, and the mean."""

    information: Array
    vector: Array
    given: Array
    vehicle: Array
    mean: Array
    mean_covariance: Array


def _given(seen: Informed, at: Array) -> _Given:
    size = len(at) // 2
    spread, scatter = at[:size], at[size:]
    information, vector = scattered(seen, scatter)
    of_vehicle, vector_of = seen.sums(information), seen.sums(vector)
    root = np.sqrt(spread)
    inner = np.linalg.inv(np.eye(size) + of_vehicle * np.outer(root, root))
    given = _symmetric(inner) * np.outer(root, root)
    # information about the mean, (T + 1 / of_vehicle)^-1, and its vector
    about = _symmetric(np.eye(size) - inner) / np.outer(root, root)
    side = (inner @ (vector_of * root)[:, :, None])[:, :, 0] / root
    total, weighed = about.sum(axis=0), side.sum(axis=0)
    if seen.prior is not None:
        total, weighed = total + np.diag(seen.prior[0]), weighed + seen.prior[1]
    unit = np.sqrt(np.maximum(np.diag(total), 1e-300))
    mean_covariance = _symmetric(la.inv(total / np.outer(unit, unit))) / np.outer(unit, unit)
    mean = mean_covariance @ weighed
    vehicle = (given @ (vector_of + mean / spread)[:, :, None])[:, :, 0]
    return _Given(information, vector, given, vehicle, mean, mean_covariance)


def _covariance(given_at: _Given, spread: Array) -> Array:
    """Of vehicles, what is not known of the mean included."""
    pull = given_at.given / spread
    return _symmetric(given_at.given + pull @ given_at.mean_covariance @ pull.transpose(0, 2, 1))


def _scored(seen: Informed, given_at: _Given, at: Array) -> tuple[Array, Array]:
    """Slope of the restricted likelihood along T and W, and its expected curvature.

    With P the projected precision of all estimates, the slope along a variance is half the difference of a square and
    its expectation, y'P P_k P y - tr(P P_k), and the curvature tr(P P_k P P_l) / 2 (Patterson & Thompson, Recovery of
    inter-block information when block sizes are unequal, Biometrika 58 (1971)).
    """
    size = len(at) // 2
    spread = at[:size]
    a, centre = given_at.information, given_at.vehicle
    away = (centre - given_at.mean) / spread
    of_mean = given_at.given / spread  # how vehicles follow the mean
    between = _about(given_at, spread)
    shared = between @ given_at.mean_covariance @ between
    slope_t = 0.5 * np.sum(np.square(away) - np.diagonal(between - shared, axis1=1, axis2=2), axis=0)
    u = given_at.vector - (a @ centre[seen.vehicle][:, :, None])[:, :, 0]
    f = a @ given_at.given[seen.vehicle]
    aga = f @ a
    # diagonal of A Cov A: the part through the mean has rank one per vehicle, and needs the vehicles' sums alone
    led = a @ of_mean[seen.vehicle]
    through = np.einsum("jkm,jkm->jk", led @ given_at.mean_covariance, led)
    p_own = np.diagonal(a - aga, axis1=1, axis2=2) - through
    slope_w = 0.5 * np.sum(np.square(u) - p_own, axis=0)
    count = seen.vehicles
    lost = (count - 1) / count  # the mean takes one vehicle's worth
    tt = 0.5 * lost * np.einsum("ikl,ikl->kl", between, between)
    tw = 0.5 * lost * np.einsum("jlk,jlk->kl", f, f) / np.square(spread)[:, None]
    ww = np.einsum("jkl,jkl->kl", a - aga, a - aga) - np.einsum("jkl,jkl->kl", aga, aga)
    for rows in seen.groups:
        left, right = f[rows], a[rows]
        one = left.transpose(1, 2, 0) @ left.transpose(1, 0, 2)  # k, m, n: summed over recordings
        other = right.transpose(2, 1, 0) @ right.transpose(2, 0, 1)
        ww += one.reshape(size, -1) @ other.reshape(size, -1).T
    curvature = np.block([[tt, tw], [tw.T, 0.5 * ww]])
    return np.concatenate([slope_t, slope_w]), curvature


def _about(given_at: _Given, spread: Array) -> Array:
    """What vehicles say of the mean: (T + 1 / their information)^-1."""
    return np.diag(1.0 / spread) - given_at.given / np.outer(spread, spread)


def _told(seen: Informed, given_at: _Given, at: Array) -> Population:
    """The population with intervals that know that T and W were estimated, which tells where vehicles are few.

    Covariances grow by what a vehicle's estimate moves with T and W, and have degrees of freedom by how they move
    themselves (Kenward & Roger, Small sample inference for fixed effects from restricted maximum likelihood,
    Biometrics 53 (1997), with Satterthwaite's degrees of freedom).
    """
    size, vehicles = len(at) // 2, seen.vehicles
    spread = at[:size]
    _, curvature = _scored(seen, given_at, at)
    unsure = _inverse(curvature)
    f = given_at.information @ given_at.given[seen.vehicle]
    u = given_at.vector - (given_at.information @ given_at.vehicle[seen.vehicle][:, :, None])[:, :, 0]
    pull = given_at.given / spread
    # how estimates and their variances move: (vehicles, variances, parameters)
    away = (given_at.vehicle - given_at.mean) / spread
    moved = np.concatenate([pull.transpose(0, 2, 1) * away[:, :, None], -seen.sums(f * u[:, :, None])], axis=1)
    between = _about(given_at, spread)
    of_mean = np.concatenate(
        [np.einsum("ikm,ikn->kmn", between, between), np.einsum("jkm,jkn->kmn", f / spread, f / spread)]
    )
    of_mean = given_at.mean_covariance @ of_mean @ given_at.mean_covariance
    wider = np.concatenate([np.square(pull.transpose(0, 2, 1)), seen.sums(np.square(f))], axis=1)
    wider += np.einsum("ipm,kmn,ipn->ikp", pull, of_mean, pull)
    covariance = _covariance(given_at, spread)
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    dof = _freedom(variance, np.einsum("ikp,kl,ilp->ip", wider, unsure, wider), vehicles)
    grown = np.einsum("ikp,kl,ilq->ipq", moved, unsure, moved)
    of_mean_own = np.diagonal(of_mean, axis1=1, axis2=2)
    mean_dof = _freedom(
        np.diag(given_at.mean_covariance), np.einsum("kp,kl,lp->p", of_mean_own, unsure, of_mean_own), vehicles
    )
    reliable = 1.0 - np.clip(np.diagonal(given_at.given, axis1=1, axis2=2) / spread, 0.0, 1.0)
    spread_dof = np.maximum(np.sum(np.square(reliable), axis=0) * (vehicles - 1) / vehicles, 1.0)
    return Population(
        given_at.mean, given_at.mean_covariance, mean_dof, spread, spread_dof, at[size:], given_at.vehicle,
        covariance + grown,
        grown, dof,
    )  # fmt: skip


def _inverse(curvature: Array) -> Array:
    """Covariance of T and W; what nothing is known of, as T of a single vehicle, moves nothing and counts nothing."""
    known = np.diag(curvature) > 0
    result = np.zeros_like(curvature)
    block = np.ix_(known, known)
    unit = np.sqrt(np.diag(curvature)[known])
    result[block] = la.pinvh(curvature[block] / np.outer(unit, unit)) / np.outer(unit, unit)
    return result


def _freedom(variance: Array, of_variance: Array, vehicles: int) -> Array:
    """Satterthwaite's degrees of freedom, and no fewer than those of a variance among vehicles that are well known."""
    freedom: Array = 2.0 * np.square(variance) / np.maximum(of_variance, 1e-300 + 1e-9 * np.square(variance))
    return np.maximum(freedom, max(vehicles - 1, 1))


def _symmetric(matrices: Array) -> Array:
    return 0.5 * (matrices + np.swapaxes(matrices, -1, -2))
